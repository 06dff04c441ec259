"""Moving, scaling, raising and padding a pair changes no point by more than the bound, checked with fractions."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._arithmetic.rounding import gamma
from jhd._distance.normalization.curves import (
    Frame,
    elevation_matrix,
    padded_count,
    preparation_error,
    prepare,
    raised_degree,
    shared_count,
)
from jhd._shapes.unchecked import _structure, trusted
from tests.cases import CASES
from tests.distance import exact, pairs

PARAMETERS = [Fraction(0), Fraction(1, 3), Fraction(5, 8), Fraction(1)]


def moved(control_points, weights, frame, s):
    """The point at s of the stored curve, taken to the common coordinates without rounding."""
    center = exact.fractions(np.asarray(frame.center))
    first, second = (Fraction(2) ** -int(k) for k in (frame.first, frame.second))
    place = exact.point(control_points, weights, s)
    return [(x * first - c) * second for x, c in zip(place, center, strict=True)]


def largest_move(given, prepared, frame):
    """How far preparation moves any of several points of a curve, in the common coordinates; exact but for the root."""
    worst = Fraction(0)
    for k in range(given.count):
        stored, found = (
            (np.asarray(c.control_points)[k], None if c.weights is None else np.asarray(c.weights)[k])
            for c in (given, prepared)
        )
        for s in PARAMETERS:
            x, y = moved(*stored, frame, s), exact.point(*found, s)
            worst = max(worst, sum((p - q) ** 2 for p, q in zip(x, y, strict=True)))
    return float(worst) ** 0.5


def pair(seed, degrees, dim=2, weighted=False, scale=1.0, offset=0.0):
    rng = np.random.default_rng(seed)
    curves = []
    for degree in degrees:
        points = offset + scale * rng.normal(size=(2, degree + 1, dim))
        weights = 10 ** rng.uniform(-3, 3, size=(2, degree + 1)) if weighted else None
        curves.append(jhd.BezierSegments(points, weights))
    return curves


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("degrees", [(0, 3), (1, 2), (2, 4), (4, 9), (10, 12)], ids=str)
@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1.0, 1e8), (1e150, 0.0), (1e-150, 1e-150), (1e307, 0.0)])
def test_no_point_is_moved_by_more_than_the_bound(degrees, weighted, scale, offset):
    a, b = pair(sum(degrees), degrees, weighted=weighted, scale=scale, offset=offset)
    p, q, frame = prepare(a, b)
    for given, prepared in ((a, p), (b, q)):
        assert np.abs(prepared.control_points).max() <= 1
        error = preparation_error(prepared.degree, prepared.dim, np.float64)
        assert largest_move(given, prepared, frame) <= error


def test_subnormal_coordinates_survive_on_the_host():
    tiny = 2.0**-1070
    a, b = jhd.point_set([[0.0, 0.0], [3 * tiny, 0.0]]), jhd.point_set([[0.0, 4 * tiny]])
    p, q, frame = prepare(a, b)
    assert largest_move(a, p, frame) == 0 and largest_move(b, q, frame) == 0
    assert float(frame.length(jnp.array(1.0))) == 2.0 ** float(frame.first + frame.second)


def test_coordinates_near_the_largest_float_do_not_overflow():
    huge = np.finfo(float).max
    a, b = jhd.point_set([[huge, -huge]]), jhd.point_set([[-huge, huge]])
    p, q, _ = prepare(a, b)
    assert np.isfinite(p.control_points).all() and np.isfinite(q.control_points).all()


def test_a_far_pair_is_moved_exactly():
    # The control points differ by small dyadic numbers, so subtracting the center rounds nothing.
    a, b = jhd.polyline([[1e8, 1e8], [1e8 + 0.25, 1e8]]), jhd.polyline([[1e8, 1e8 + 0.5], [1e8 + 0.125, 1e8]])
    p, q, frame = prepare(a, b)
    assert np.abs(q.control_points).max() >= 0.5
    gap = np.asarray(p.control_points)[0, 0] - np.asarray(q.control_points)[0, 0]
    np.testing.assert_allclose(gap * 2.0 ** (int(frame.first) + int(frame.second)), [0.0, -0.5], atol=1e-15)


def test_a_pair_of_one_point_is_prepared():
    p, q, frame = prepare(jhd.point_set([[0.0, 0.0]]), jhd.point_set([[0.0, 0.0]]))
    assert not np.any(p.control_points) and not np.any(q.control_points)
    assert float(frame.length(jnp.array(0.0))) == 0.0


@pytest.mark.parametrize(("count", "padded"), [(1, 48), (48, 48), (49, 96), (90, 96), (97, 192), (193, 256)])
def test_segments_are_padded_to_a_few_sizes(count, padded):
    assert padded_count(count) == padded


@pytest.mark.parametrize(("count", "padded"), [(1, 4), (4, 4), (5, 16), (16, 16), (17, 48), (90, 96), (97, 192)])
def test_where_repetition_costs_small_numbers_of_segments_have_sizes_of_their_own(count, padded):
    assert padded_count(count, small=True) == padded


def test_curves_of_up_to_48_segments_share_a_program_of_the_search_and_keep_small_ones_under_tracing():
    def counts(*pair, sharing):
        return tuple(curve.count for curve in prepare(*pair, sharing=sharing)[:2])

    def traced(*pair):
        seen.append(counts(*pair, sharing=True))
        return 0.0

    seen = []
    short, longer = (jhd.polyline(np.arange(2 * n + 2.0).reshape(-1, 2)) for n in (3, 20))
    assert counts(short, short, sharing=True) == counts(short, longer, sharing=True) == (48, 48)
    assert counts(short, longer, sharing=False) == (4, 48)
    jax.eval_shape(traced, short, short)
    jax.eval_shape(traced, short, longer)
    assert seen == [(4, 4), (48, 48)]


@pytest.mark.parametrize(("degree", "raised"), [(0, 3), (3, 3), (4, 6), (7, 10), (10, 10), (11, 11)])
def test_degrees_are_raised_to_a_few_sizes(degree, raised):
    assert raised_degree(degree) == raised


def test_at_most_half_of_many_segments_is_repetition():
    assert all(2 * count >= padded_count(count) for count in range(24, 3000))


@pytest.mark.parametrize(("degree", "target"), [(0, 3), (1, 10), (3, 6), (6, 6)])
def test_the_elevation_matrix_has_non_negative_rows_of_sum_one(degree, target):
    matrix = elevation_matrix(degree, target)
    assert (matrix >= 0).all()
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=4 * np.finfo(float).eps)
    points = np.random.default_rng(1).normal(size=(degree + 1, 2))
    curve = jhd.BezierSegments(points[None]).elevate(target).control_points[0]
    np.testing.assert_allclose(matrix @ points, curve, atol=1e-14)


def test_padding_repeats_the_last_segment_and_its_follower():
    p, _, _ = prepare(jhd.polyline([[0, 0], [1, 0], [0, 1]], closed=True), jhd.point_set([[0.0, 0.0]]))
    np.testing.assert_array_equal(p.next_segment, [1, 2, 0, 0])
    np.testing.assert_array_equal(p.control_points[2], p.control_points[3])


def test_weights_are_brought_to_order_one_without_moving_a_point():
    points = [[[0.0, 0.0], [1.0, 1.0], [2.0, 0.0], [3.0, 1.0]]]
    a = jhd.BezierSegments(points, [[1e-200, 2e-200, 3e-200, 1e-200]])
    p, _, frame = prepare(a, jhd.BezierSegments(points))
    assert p.weights is not None and 0.5 <= p.weights.max() < 1
    assert largest_move(a, p, frame) <= preparation_error(3, 2, np.float64)


def test_the_frame_leads_back():
    a, b = pair(3, (3, 3), scale=1e-7, offset=12.5)
    p, _, frame = prepare(a, b)
    np.testing.assert_allclose(frame.place(p.control_points[:2]), a.control_points, rtol=4e-16)


@pytest.mark.parametrize("x", [1.0, 0.75, 1 + 2.0**-52, 0.0])
def test_lengths_are_rounded_outward_where_they_turn_subnormal(x):
    frame = Frame(np.zeros(2), np.array(-1060), np.array(-10))
    true = Fraction(x) * Fraction(2) ** -1070
    both = lambda x: (frame.length(x, 0.0), frame.length(x, np.inf))  # noqa: E731
    for lower, upper in (both(jnp.array(x)), jax.jit(both)(x)):
        # NumPy keeps subnormals; XLA would show them as zero.
        assert Fraction(float(np.asarray(lower))) <= true <= Fraction(float(np.asarray(upper)))


def test_lengths_that_are_normal_are_exact():
    frame = Frame(np.zeros(2), np.array(3), np.array(-40))
    for toward in (None, 0.0, np.inf):
        assert float(frame.length(jnp.array(0.7), toward)) == 0.7 * 2.0**-37


def test_preparation_is_the_same_when_traced():
    a, b = pair(4, (2, 3), offset=3.0)
    p, q, frame = prepare(a, b)
    pt, qt, traced = jax.jit(prepare)(a, b)
    for x, y in ((p, pt), (q, qt)):
        np.testing.assert_allclose(x.control_points, y.control_points, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(x.next_segment, y.next_segment)
    assert int(frame.first) == int(traced.first) and int(frame.second) == int(traced.second)


def test_the_error_bound_grows_with_the_degree_and_the_dimension():
    assert (
        preparation_error(3, 2, np.float64) < preparation_error(3, 3, np.float64) < preparation_error(10, 3, np.float64)
    )
    assert preparation_error(3, 2, np.float32) > gamma(40, np.float32)


def test_the_whole_table_needs_at_most_nine_programs():
    sizes = set()
    for case in CASES:
        a, b, _ = prepare(*pairs.both(case), sharing=True)
        for x, y in ((a, b), (b, a)):
            sizes.add((x.control_points.shape, y.control_points.shape, x.weights is not None))
    assert len(sizes) <= 9


def test_long_curves_share_a_size_where_they_are_about_equal():
    assert shared_count(1, 90) == (96, 96)
    assert shared_count(1, 100) == (48, 192)
    assert shared_count(100, 90) == shared_count(90, 100) == (192, 192)
    assert shared_count(600, 800) == (1024, 1024) and shared_count(200, 800) == (256, 1024)
    assert shared_count(1, 90, small=True) == (96, 96)
    assert shared_count(1, 100, small=True) == (4, 192)


def test_the_text_of_a_program_does_not_depend_on_what_was_traced_before():
    def text(curve):
        # A function of its own each time: jax keeps what it has traced.
        return str(jax.make_jaxpr(lambda points: trusted(points, None, curve.next_segment).control_points)(points))

    points = jnp.zeros((2, 4, 2))
    curve = jhd.BezierSegments(points)
    _structure.cache_clear()
    first = text(curve)
    assert text(curve) == first
