"""Foot points: the global methods never miss, bounds hold, every stationary parameter is found, and refusals."""

import math
import sys
from fractions import Fraction
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._results.solution import name_of
from tests import reference
from tests.distance import exact
from tests.sweeps import swept

# Distances of the global methods, in sizes of the coordinates of curve and query.
PROMISED = 1e-12
# A simple root of a polynomial with coefficients of order one, found by numpy through eigenvalues.
ROOT = 1e-7
GLOBAL = [jhd.BestFirstProjection(), jhd.ProjectedPolyhedronProjection()]
LOCAL = [jhd.IntervalHalvingProjection(), jhd.NewtonProjection(), jhd.HybridProjection()]
# Queries of one curve: one of the sizes that programs are compiled for.
QUERIES = 128
CURVES = 40
ARCH = jhd.BezierCurve([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]])
PATCH = jhd.BezierPatch([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1]]])


def kind(method):
    return type(method).__name__


def name_in_ids(value):
    return str(value) if isinstance(value, int) else kind(value)


def size_of(points, control_points):
    return np.maximum(np.abs(points).max(axis=-1), np.abs(control_points).max())


def random_queries(rng, control_points, weights):
    """Half about the curve, a quarter on it, a quarter beside it by 1e-12 to 1e-1."""
    dim = control_points.shape[-1]
    rows = 2 * rng.normal(size=(QUERIES, dim))
    on = reference.evaluate(control_points, weights, rng.uniform(size=QUERIES // 2)).reshape(-1, dim)[: QUERIES // 2]
    beside = rng.normal(size=on.shape) * 10.0 ** rng.uniform(-12, -1, (len(on), 1))
    rows[: QUERIES // 2] = on + np.where(np.arange(len(on))[:, None] % 2, beside, 0.0)
    return rows


def is_global(found, rows, control_points, weights=None, expected=None):
    """Asserts that no foot was missed, that the bounds are true, and that both meet."""
    expected = reference.distance_profile(rows, control_points, weights) if expected is None else expected
    off = PROMISED * size_of(rows, control_points)
    assert np.all(np.abs(found.distance - expected) <= off)
    assert np.all((found.lower <= found.distance) & (found.distance <= found.upper))
    assert np.all(found.upper - found.lower <= off)
    assert np.all(np.abs(np.linalg.norm(np.asarray(found.foot) - rows, axis=-1) - found.distance) <= off)
    assert name_of(jax.tree_util.tree_map(lambda x: x.max(), found.result)) == "successful"


def bounds_hold(found, rows, control_points, weights=None):
    """Asserts upper >= the distance at the foot, and lower <= the distance to every point of the curve, exactly."""
    for row, segment, t, lower, upper in zip(rows, found.element, found.t, found.lower, found.upper, strict=True):
        piece = control_points[int(segment)], None if weights is None else weights[int(segment)]
        assert exact.distance_sq(row, *piece, float(t)) <= Fraction(float(upper)) ** 2
        least = exact.minimum_near(row, *piece, float(t))
        assert Fraction(float(lower)) ** 2 <= least


@cache
def random_curves(degree):
    """Curves with queries and the true distances, for both methods."""
    rng = np.random.default_rng(degree)
    curves = []
    for _ in range(CURVES):
        control_points = rng.normal(size=(1, degree + 1, 2))
        rows = random_queries(rng, control_points, None)
        curves.append((control_points, rows, reference.distance_profile(rows, control_points)))
    return curves


# The methods of the quick tests' cubics, for a degree between and for the highest.
SLOW = [(GLOBAL[1], 5), (GLOBAL[0], 8)]


@pytest.mark.parametrize(
    ("method", "degree"), swept([(m, d) for m in GLOBAL for d in range(1, 9)], slow=SLOW, ids=name_in_ids)
)
def test_random_queries_never_miss_the_nearest_point(degree, method):
    for control_points, rows, expected in random_curves(degree):
        found = jhd.project(rows, jhd.BezierSegments(control_points), method)
        is_global(found, rows, control_points, expected=expected)


@pytest.mark.parametrize(
    ("method", "degree"),
    swept([(m, d) for m in GLOBAL for d in (2, 3, 5)], slow=[(GLOBAL[0], 5)], ids=name_in_ids),
)
def test_random_queries_never_miss_the_nearest_point_of_a_rational_curve(method, degree):
    rng = np.random.default_rng(degree)
    for _ in range(CURVES // 4):
        control_points, weights = rng.normal(size=(1, degree + 1, 2)), 10 ** rng.uniform(-0.5, 0.5, (1, degree + 1))
        rows = random_queries(rng, control_points, weights)
        is_global(jhd.project(rows, jhd.BezierSegments(control_points, weights), method), rows, control_points, weights)


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", GLOBAL, ids=kind)
def test_bounds_hold_against_rational_arithmetic_for_weights_of_every_size(method):
    rng = np.random.default_rng(9)
    for reach in (1, 2, 3):
        control_points, weights = rng.normal(size=(1, 4, 2)), 10 ** rng.uniform(-reach, reach, (1, 4))
        rows = random_queries(rng, control_points, weights)
        found = jhd.project(rows, jhd.BezierSegments(control_points, weights), method, throw=False)
        pick = np.arange(0, QUERIES, 8)
        bounds_hold(jax.tree_util.tree_map(lambda x, pick=pick: x[pick], found), rows[pick], control_points, weights)


@pytest.mark.parametrize("method", swept(GLOBAL, slow=1, ids=kind))
def test_success_means_that_the_bounds_meet_whatever_the_weights(method):
    rows, weights = np.tile([1.0, 1.0], (QUERIES, 1)), np.array([[1e-3, 1.0, 1e3, 1e3]])
    control_points = np.array([[[0.0, 0.0], [1.0, 2.0], [3.0, 0.0], [3.0, 1.0]]])
    found = jhd.project(rows, jhd.BezierSegments(control_points, weights), method, throw=False)
    result = name_of(jax.tree_util.tree_map(lambda x: x[0], found.result))
    assert result != "successful" or found.upper[0] - found.lower[0] <= PROMISED * 3


def test_very_uneven_weights_leave_close_bounds_or_none_that_are_called_so():
    # By other parameters the parabola of the weights one: weights (1 / s, 1, s) leave the curve as it is.
    points, query = [(0.0, 0.0), (1.0, 2.0), (2.0, 0.0)], (1.2, 3.0)
    exact, found = 2.0079847003225586, []
    for weights in ([1e-10, 1, 1e10], [1e-20, 1, 1e20], [1e20, 1, 1e-20]):
        near = jhd.project(query, jhd.BezierCurve(points, weights), throw=False)
        found.append(name_of(near.result))
        assert near.lower <= near.distance <= near.upper
        if found[-1] == "successful":
            assert near.upper - near.lower <= PROMISED * 3 and near.lower <= exact <= near.upper
    assert found == ["successful", "successful", "many_nearest_points"]
    # Nearly half of it lies between one and the number before it.
    wide = jhd.BezierCurve([(0.8, -1.6), (1.4, -2.0), (-1.0, -0.7)], [1, 1e15, 1])
    assert name_of(jhd.project((-0.2, 0.0), wide, throw=False).result) == "many_nearest_points"


SPECIAL = {
    "cusp": [[0, 0], [1, 1], [0, 1], [1, 0]],
    "no speed at an end": [[0, 0], [0, 0], [1, 2], [3, 0]],
    "point": [[1, 2], [1, 2], [1, 2], [1, 2]],
    "line": [[0, 0], [1, 1], [2, 2], [3, 3]],
    "folded line": [[0, 0], [3, 0], [-2, 0], [1, 0]],
    "nearly flat": [[0, 0], [1, 1e-12], [2, -1e-12], [3, 0]],
    "loop": [[0, 0], [6, 4], [-2, 4], [4, 0]],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECIAL)
@pytest.mark.parametrize("method", GLOBAL, ids=kind)
def test_degenerate_cubics_are_projected_to(method, name):
    control_points = np.array([SPECIAL[name]], dtype=float)
    rows = random_queries(np.random.default_rng(len(name)), control_points, None)
    rows[:4] = control_points[0]
    found = jhd.project(rows, jhd.BezierSegments(control_points), method)
    is_global(found, rows, control_points)
    pick = np.arange(0, QUERIES, 8)
    bounds_hold(jax.tree_util.tree_map(lambda x: x[pick], found), rows[pick], control_points)


@pytest.mark.parametrize("exponent", [-1000, -300, 60, 500, 1000])
def test_scaling_by_a_power_of_two_is_exact(exponent):
    control_points = np.array([SPECIAL["loop"]], dtype=float)
    rows = random_queries(np.random.default_rng(1), control_points, None)
    one = jhd.project(rows, jhd.BezierSegments(control_points))
    other = jhd.project(np.ldexp(rows, exponent), jhd.BezierSegments(np.ldexp(control_points, exponent)))
    for name in ("distance", "foot", "lower", "upper"):
        scaled = np.ldexp(np.asarray(getattr(one, name)), exponent)
        # Below the normal numbers lower and upper are rounded outward.
        normal = np.abs(scaled) > 1e-290
        np.testing.assert_array_equal(np.asarray(getattr(other, name))[normal], scaled[normal])
    np.testing.assert_array_equal(other.t, one.t)


def test_far_from_the_origin_the_size_of_the_coordinates_is_the_unit():
    control_points = np.array([SPECIAL["loop"]], dtype=float) + 1e8
    rows = random_queries(np.random.default_rng(2), control_points - 1e8, None) + 1e8
    is_global(jhd.project(rows, jhd.BezierSegments(control_points)), rows, control_points)


def test_the_nearest_of_several_segments_is_named():
    rng = np.random.default_rng(3)
    control_points = rng.normal(size=(4, 4, 2))
    control_points[3] = control_points[2]
    rows = random_queries(rng, control_points, None)
    for method in GLOBAL:
        found = jhd.project(rows, jhd.BezierSegments(control_points), method)
        is_global(found, rows, control_points)
        assert found.element.max() <= 2
        bounds_hold(jax.tree_util.tree_map(lambda x: x[:8], found), rows[:8], control_points)


# ---- shapes of batches ---------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3), (1, 2, 1)])
def test_the_shape_of_the_queries_is_kept(shape):
    rows = np.random.default_rng(4).normal(size=(*shape, 2))
    found = jhd.project(rows, ARCH)
    for name in ("distance", "lower", "upper", "element", "t"):
        assert getattr(found, name).shape == shape
    assert found.foot.shape == (*shape, 2) and found.result._value.shape == shape
    expected = reference.distance_profile(rows.reshape(-1, 2), np.array([ARCH.control_points]))
    np.testing.assert_allclose(np.ravel(found.distance), expected, atol=PROMISED)


def test_a_list_of_numbers_is_one_query():
    # The top of the arch is (1, 1).
    found = jhd.project([1, 3], ARCH)
    assert abs(float(found.distance) - 2) <= PROMISED and abs(float(found.t) - 0.5) <= 1e-7
    np.testing.assert_allclose(found.foot, [1.0, 1.0], atol=1e-7)


def test_more_queries_than_one_block_are_done_in_order():
    rows = np.random.default_rng(5).normal(size=(130, 2))
    found = jhd.project(rows, ARCH)
    np.testing.assert_allclose(
        found.distance, reference.distance_profile(rows, np.array([ARCH.control_points])), atol=PROMISED
    )


def test_projection_passes_through_jit_and_vmap():
    rows = np.random.default_rng(6).normal(size=(4, 2))
    control_points = np.asarray(ARCH.control_points) * np.array([1.0, 2.0, 0.5, 3.0])[:, None, None]
    batched = jax.jit(jax.vmap(lambda p, c: jhd.project(p, jhd.BezierCurve(c))))(rows, control_points)
    for k in range(4):
        one = jhd.project(rows[k], jhd.BezierCurve(control_points[k]))
        np.testing.assert_allclose(batched.distance[k], one.distance, atol=PROMISED)
        np.testing.assert_allclose(batched.foot[k], one.foot, atol=1e-7)
        assert batched.lower[k] <= one.upper and one.lower <= batched.upper[k]


# ---- local methods -------------------------------------------------------------------------------


@pytest.mark.parametrize("method", LOCAL, ids=kind)
def test_local_methods_prove_no_lower_bound_and_are_never_below_the_distance(method):
    rng = np.random.default_rng(7)
    missed = 0
    for _ in range(8):
        control_points = rng.normal(size=(1, 4, 2))
        rows = random_queries(rng, control_points, None)
        found = jhd.project(rows, jhd.BezierSegments(control_points), method)
        expected = reference.distance_profile(rows, control_points)
        off = PROMISED * size_of(rows, control_points)
        assert np.all(found.lower == 0)
        assert np.all(found.distance >= expected - off) and np.all(found.upper >= found.distance)
        missed += int(np.sum(found.distance > expected + 1e-6))
    # They are wrong on a few queries in a hundred, which is why no bound rests on them; rarely on none of a thousand.
    assert 0 < missed < 0.25 * 8 * QUERIES


def test_interval_halving_finds_the_top_of_an_arch():
    found = jhd.project([1.0, 3.0], ARCH, jhd.IntervalHalvingProjection(xtol=1e-10))
    assert abs(float(found.distance) - 2) <= PROMISED


# ---- stationary parameters -----------------------------------------------------------------------


def power_form(control_points):
    """Coordinates of a polynomial segment as numpy polynomials in t."""
    n = len(control_points) - 1
    t, u = np.polynomial.Polynomial([0, 1]), np.polynomial.Polynomial([1, -1])
    basis = [float(np.prod([(n - k) / (k + 1) for k in range(i)])) * t**i * u ** (n - i) for i in range(n + 1)]
    return [sum((c * b for c, b in zip(column, basis, strict=True)), 0 * t) for column in control_points.T]


def simple_roots(point, control_points):
    """Real roots of (P - B).B' in (0, 1) at which the slope is not small."""
    zero = np.polynomial.Polynomial([0])
    f = sum(((p - x) * x.deriv() for p, x in zip(point, power_form(control_points), strict=True)), zero)
    roots = f.roots()
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    inside = real[(real > 1e-6) & (real < 1 - 1e-6)]
    return inside[np.abs(f.deriv()(inside)) > 1e-3], f


@pytest.mark.parametrize("degree", swept([3, 5], quick=[3]))
def test_every_stationary_parameter_is_found_and_in_order(degree):
    rng = np.random.default_rng(degree)
    for _ in range(8):
        control_points = rng.normal(size=(degree + 1, 2))
        rows = rng.normal(size=(16, 2))
        found = jhd.stationary_points(rows, jhd.BezierCurve(control_points))
        for k in range(16):
            valid = np.asarray(found.valid[k])
            lower, upper, t = (np.asarray(x[k])[valid] for x in (found.lower, found.upper, found.t))
            roots, f = simple_roots(rows[k], control_points)
            assert all(np.any((lower - ROOT <= r) & (r <= upper + ROOT)) for r in roots)
            assert np.all(np.diff(t) > 0) and np.all((lower <= t) & (t <= upper))
            # Nothing is reported where the polynomial does not vanish.
            assert np.all(np.abs(f(t)) <= 1e-6 * (1 + np.abs(f.coef).max()))
            points = reference.evaluate(control_points[None], None, t)[0]
            np.testing.assert_allclose(
                np.asarray(found.distance[k])[valid], np.linalg.norm(points - rows[k], axis=1), atol=1e-12
            )
            assert np.all(np.isinf(np.asarray(found.distance[k])[~valid]))
            assert valid.tolist() == sorted(valid.tolist(), reverse=True)


def test_the_center_of_a_circle_gives_intervals_that_cover_it():
    circle = jhd.BezierSegments(
        [
            [[1, 0], [1, 1], [0, 1]],
            [[0, 1], [-1, 1], [-1, 0]],
            [[-1, 0], [-1, -1], [0, -1]],
            [[0, -1], [1, -1], [1, 0]],
        ],
        [[1, 1, 2]] * 4,
    )
    found = jhd.stationary_points([0.0, 0.0], circle)
    valid = np.asarray(found.valid)
    np.testing.assert_array_equal(np.asarray(found.segment)[valid], [0, 1, 2, 3])
    assert np.all(np.asarray(found.lower)[valid] <= 1e-12) and np.all(np.asarray(found.upper)[valid] >= 1 - 1e-12)
    np.testing.assert_allclose(np.asarray(found.distance)[valid], 1.0, atol=1e-12)


def test_known_stationary_points():
    # From (0, 2) to y = x^2: the feet at x = +-sqrt(3/2) and the vertex.
    parabola = jhd.BezierCurve([[-2.0, 4.0], [0.0, -4.0], [2.0, 4.0]])
    found = jhd.stationary_points([0.0, 2.0], parabola, capacity=4)
    expected = (np.array([-np.sqrt(1.5), 0.0, np.sqrt(1.5)]) + 2) / 4
    np.testing.assert_allclose(found.t[:3], expected, atol=1e-10)
    np.testing.assert_array_equal(found.valid, [True, True, True, False])
    np.testing.assert_allclose(found.distance[:3], [np.sqrt(1.75), 2.0, np.sqrt(1.75)], atol=1e-12)


def test_a_set_of_points_has_no_stationary_parameter_that_moves():
    found = jhd.stationary_points([0.0, 0.0], jhd.point_set([[3.0, 4.0]]))
    valid = np.asarray(found.valid)
    np.testing.assert_allclose(np.asarray(found.distance)[valid], 5.0)


def test_distances_of_stationary_points_are_right_beside_a_query_that_is_very_far():
    curve = jhd.BezierCurve([(0.0, 0.0), (1.0, 2.0), (3.0, 0.0)])
    found = jhd.stationary_points([(1.0, 0.3), (1e160, 0.0)], curve)
    for k in np.flatnonzero(found.valid[0]):
        point = np.asarray(curve(found.t[0, k]))
        assert float(found.distance[0, k]) == pytest.approx(math.dist(point, (1.0, 0.3)), rel=1e-12)
    assert np.any(found.valid[0])


@pytest.mark.slow
def test_a_segment_that_repeats_the_one_before_it_has_stationary_points_of_its_own():
    row = np.array([[0.0, 0.0], [1.0, 0.0]])
    curve = jhd.BezierSegments(np.stack([row, row, row + [0.0, 1.0]]))
    for found in (
        jhd.stationary_points([0.5, 2.0], curve, capacity=8),
        jax.jit(lambda p: jhd.stationary_points(p, curve, capacity=8))(jnp.array([0.5, 2.0])),
    ):
        valid = np.asarray(found.valid)
        np.testing.assert_array_equal(np.asarray(found.segment)[valid], [0, 1, 2])
        np.testing.assert_allclose(np.asarray(found.distance)[valid], [2.0, 2.0, 1.0])
        near = jhd.project([0.5, -2.0], curve)
        assert int(near.element) in (0, 1) and float(near.distance) == 2.0


def test_what_does_not_fit_is_said():
    parabola = jhd.BezierCurve([[-2.0, 4.0], [0.0, -4.0], [2.0, 4.0]])
    found = jhd.stationary_points([0.0, 2.0], parabola, capacity=2, throw=False)
    assert name_of(found.result) == "capacity_reached"
    assert found.valid.all()
    with pytest.raises(jhd.NotProvenError, match="max_boxes or capacity") as caught:
        jhd.stationary_points([0.0, 2.0], parabola, capacity=2)
    # What it encloses are parameters, not the distance.
    assert "bounds reached" not in str(caught.value)
    assert isinstance(caught.value.solution, jhd.StationaryPoints)


@pytest.mark.slow
def test_a_full_solver_leaves_true_bounds():
    control_points = np.random.default_rng(8).normal(size=(1, 9, 2))
    rows = random_queries(np.random.default_rng(8), control_points, None)
    method = jhd.ProjectedPolyhedronProjection(capacity=1)
    found = jhd.project(rows, jhd.BezierSegments(control_points), method, throw=False)
    assert name_of(jax.tree_util.tree_map(lambda x: x.max(), found.result)) == "capacity_reached"
    expected = reference.distance_profile(rows, control_points)
    assert np.all(found.lower <= expected + PROMISED) and np.all(found.upper >= expected - PROMISED)
    with pytest.raises(jhd.NotProvenError, match="max_boxes or capacity"):
        jhd.project(rows, jhd.BezierSegments(control_points), method)


# ---- refusals ------------------------------------------------------------------------------------

FEW: Any = "few"


@pytest.mark.parametrize(
    ("points", "error", "message"),
    [
        ([1.0, 2.0, 3.0], ValueError, "points has shape (3,); needs (..., 2)."),
        (np.ones((4, 3)), ValueError, "points has shape (4, 3); needs (..., 2)."),
        (1.0, ValueError, "points has shape (); needs (..., 2)."),
        (np.ones((0, 2)), ValueError, "points is empty: its shape is (0, 2)."),
        ([np.nan, 1.0], ValueError, "points[0] is not finite: nan."),
        ([[0.0, 1.0], [np.inf, 1.0]], ValueError, "points[1] is not finite: (inf, 1)."),
        ([1j, 0], TypeError, "points must be real numbers; its dtype is complex128."),
        ("ab", TypeError, "points is 'ab'; needs numbers."),
    ],
    ids=str,
)
@pytest.mark.parametrize("entry", [jhd.project, jhd.stationary_points])
def test_queries_that_are_no_points_are_refused(entry, points, error, message, as_a_user):
    with pytest.raises(error) as caught:
        entry(points, ARCH)
    assert str(caught.value) == message


@pytest.mark.parametrize("entry", [jhd.project, jhd.stationary_points])
@pytest.mark.parametrize("shape", [None, 3.0, "circle"], ids=["None", "number", "str"])
def test_what_is_no_curve_is_refused(entry, shape, as_a_user):
    with pytest.raises(TypeError) as caught:
        entry([0.0, 0.0], shape)
    expected = (
        ("shape: text is not a shape",)
        if isinstance(shape, str)
        else ("shape must be a shape", "shape must be a curve")
    )
    assert str(caught.value).startswith(expected)
    assert str(caught.value).endswith(f"got {type(shape).__name__}.")


@pytest.mark.parametrize(
    "method", ["newton", jhd.NewtonProjection, jhd.published.TwoStep()], ids=["text", "class", "TwoStep"]
)
def test_what_is_no_projection_method_is_refused(method, as_a_user):
    with pytest.raises(TypeError) as caught:
        jhd.project([0.0, 0.0], ARCH, method)
    assert str(caught.value) == (
        "method must be one of BestFirstProjection, ProjectedPolyhedronProjection, IntervalHalvingProjection, "
        f"NewtonProjection, HybridProjection for curves; got {type(method).__name__}."
    )


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: jhd.ProjectedPolyhedronProjection(capacity=0), "capacity is 0; needs a whole number of at least 1."),
        (
            lambda: jhd.ProjectedPolyhedronProjection(capacity=True),
            "capacity is True; needs a whole number of at least 1.",
        ),
        (lambda: jhd.IntervalHalvingProjection(interval=0.0), "interval is 0.0; needs a positive number."),
        (lambda: jhd.IntervalHalvingProjection(xtol=-1.0), "xtol is -1.0; needs a positive number."),
        (lambda: jhd.IntervalHalvingProjection(max_steps=0), "max_steps is 0; needs a whole number of at least 1."),
        (lambda: jhd.NewtonProjection(xtol=float("inf")), "xtol is inf; needs a positive number."),
        (lambda: jhd.NewtonProjection(max_steps=FEW), "max_steps is 'few'; needs a whole number of at least 1."),
        (lambda: jhd.HybridProjection(rough=float("nan")), "rough is nan; needs a positive number."),
        (lambda: jhd.stationary_points([0, 0], ARCH, capacity=0), "capacity is 0; needs a whole number of at least 1."),
    ],
)
def test_options_out_of_range_are_refused(build, message, as_a_user):
    with pytest.raises(ValueError) as caught:
        build()
    assert str(caught.value) == message


def test_traced_queries_that_are_not_finite_never_look_like_a_distance():
    found = jax.jit(lambda p: jhd.project(p, ARCH))(jnp.array([jnp.nan, 0.0]))
    assert name_of(found.result) != "successful"
    assert found.lower == 0 and found.upper == np.inf


@pytest.mark.exhaustive
def test_a_query_that_is_no_number_keeps_its_answer_under_jit():
    curve = jhd.BezierCurve([[0.0, 0.0], [1.0, 2.0], [3.0, 0.0]])
    queries = jnp.array([[0.5, np.nan], [0.5, 2.0]])
    found = jax.jit(lambda x: jhd.project(x, curve))(queries)
    known = jhd.project(queries[1], curve)
    assert np.isinf(found.distance[0]) and np.isinf(found.upper[0]) and found.lower[0] == 0
    np.testing.assert_allclose(found.distance[1], known.distance, rtol=1e-14)
    slope = jax.jit(jax.grad(lambda x: jhd.project(x, curve).distance[1]))(queries)
    np.testing.assert_allclose(slope[1], (queries[1] - known.foot) / known.distance, rtol=1e-12)


@pytest.mark.parametrize(
    "shape",
    [
        ARCH,
        jhd.TriangleMesh(np.eye(3), [[0, 1, 2]]),
        pytest.param(PATCH, marks=pytest.mark.slow),
    ],
    ids=["curve", "mesh", "patch"],
)
def test_queries_that_are_not_reached_in_time_say_so(shape, monkeypatch):
    monkeypatch.setattr(sys.modules["jhd._distance.project"], "_AT_ONCE", 4)
    points = np.random.default_rng(0).normal(size=(3, 3, shape.dim))
    known, whole = jhd.project(points, shape), jhd.project(points, shape, max_seconds=600)
    np.testing.assert_array_equal(whole.distance, known.distance)
    np.testing.assert_array_equal(whole.t, known.t)
    late = jhd.project(points, shape, max_seconds=1e-9, throw=False)
    assert late.ok.ravel().tolist() == 4 * [True] + 5 * [False] and name_of(late[2, 2].result) == "out_of_time"
    assert late.distance[0, 0] == known.distance[0, 0] and late.lower[2, 2] == 0 and late.upper[2, 2] == np.inf
    with pytest.raises(jhd.NotProvenError, match="The time limit was reached"):
        jhd.project(points, shape, max_seconds=1e-9)
    with pytest.raises(TypeError, match="max_seconds cannot be combined with jit"):
        jax.jit(lambda x: jhd.project(x, shape, max_seconds=1).distance)(points)
