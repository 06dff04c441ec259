import math
import os
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from matplotlib.path import Path
from matplotlib.textpath import TextPath

import jhd
from jhd import BezierSegments
from jhd._shapes.curve import check_curve
from jhd._shapes.joints import joints
from tests.processes import python

# A few roundings of numbers of size one.
ROUNDING = 1e-14
# Central differences with step 1e-6: truncation 1e-12, rounding 1e-10, of derivatives of size ten.
DIFFERENCES = 1e-8

CUBICS = np.random.default_rng(1).normal(size=(3, 4, 2))
WEIGHTS = np.random.default_rng(2).uniform(0.5, 2.0, size=(3, 4))
# Four cubics, each starting where the one before it ends, the last one back at the start.
LOOP = np.random.default_rng(3).normal(size=(4, 4, 2))
LOOP[:, 3] = np.roll(LOOP[:, 0], -1, axis=0)


def bernstein_value(control_points, weights, t):
    n = len(control_points) - 1
    basis = np.array([math.comb(n, i) * t**i * (1 - t) ** (n - i) for i in range(n + 1)]) * weights
    return basis @ control_points / basis.sum()


@pytest.mark.parametrize("weights", [None, WEIGHTS])
def test_evaluation_agrees_with_the_bernstein_sum(weights):
    curve = BezierSegments(CUBICS, weights)
    t = np.linspace(0.0, 1.0, 7)
    for k in range(3):
        w = np.ones(4) if weights is None else weights[k]
        expected = [bernstein_value(CUBICS[k], w, u) for u in t]
        np.testing.assert_allclose(curve.point(k, t), expected, atol=ROUNDING)
        np.testing.assert_allclose(curve(k + t[:-1]), expected[:-1], atol=ROUNDING)


def test_parameters_keep_their_shape():
    curve = BezierSegments(CUBICS, WEIGHTS)
    assert curve(0.5).shape == (2,)
    assert curve(np.full((2, 3), 0.5)).shape == (2, 3, 2)
    assert curve.point(np.array([0, 2]), 0.25).shape == (2, 2)
    np.testing.assert_array_equal(curve(3.0), CUBICS[2, 3])


@pytest.mark.parametrize("weights", [None, WEIGHTS])
def test_derivative_agrees_with_differences(weights):
    curve = BezierSegments(CUBICS, weights)
    t, h = np.array([0.2, 1.5, 2.9]), 1e-6
    differences = (curve(t + h) - curve(t - h)) / (2 * h)
    np.testing.assert_allclose(curve.derivative()(t), differences, atol=DIFFERENCES)


def test_derivative_of_a_rational_line_is_exact():
    # x = 2 t / (1 + t) has x' = 2 / (1 + t)^2.
    line = BezierSegments([[[0.0, 0.0], [1.0, 0.0]]], [[1.0, 2.0]])
    np.testing.assert_allclose(line.derivative()(np.array([0.0, 0.5]))[:, 0], [2.0, 2 / 2.25], rtol=ROUNDING)


def test_derivative_of_points_is_zero():
    np.testing.assert_array_equal(jhd.point_set([[1.0, 2.0]]).derivative()(0.5), [0.0, 0.0])
    np.testing.assert_array_equal(BezierSegments([[[1.0, 2.0]]], [[3.0]]).derivative()(0.5), [0.0, 0.0])


@pytest.mark.parametrize("t", [0.5, 2.0, 3.25])
def test_split_gives_the_parts_before_and_after(t):
    curve = BezierSegments(LOOP, np.ones((4, 4)))
    before, after = curve.split(t)
    whole = int(t)
    assert before.count == math.ceil(t)
    assert after.count == 4 - whole
    np.testing.assert_allclose(before.control_points[0, 0], LOOP[0, 0], atol=ROUNDING)
    np.testing.assert_allclose(before.control_points[-1, -1], curve(t), atol=ROUNDING)
    np.testing.assert_allclose(after.control_points[0, 0], curve(t), atol=ROUNDING)
    np.testing.assert_array_equal(before.next_segment, [*range(1, before.count), -1])
    np.testing.assert_array_equal(after.next_segment, [*range(1, after.count), -1])


def test_split_of_one_closed_segment_opens_it():
    loop = BezierSegments([[[0, 0], [1, 0], [0, 1], [0, 0]]])
    assert loop.next_segment.tolist() == [0]
    before, after = loop.split(0.5)
    assert before.next_segment.tolist() == after.next_segment.tolist() == [-1]


@pytest.mark.parametrize(
    ("t", "message"),
    [
        (0.0, r"t is 0; needs 0 < t < 3\."),
        (3, r"t is 3; needs 0 < t < 3\."),
        (np.nan, r"t is not finite: nan\."),
        ([0.5, 1.5], r"t has shape \(2,\); needs a scalar\."),
    ],
)
def test_split_refuses_parameters_outside(t, message):
    with pytest.raises(ValueError, match=message):
        BezierSegments(CUBICS).split(t)


def test_split_refuses_traced_parameters():
    with pytest.raises(TypeError, match=r"split of BezierSegments needs a concrete t"):
        jax.jit(lambda t: BezierSegments(CUBICS).split(t)[0].control_points)(0.5)


def test_split_at_a_known_parameter_may_be_compiled():
    cut = jax.jit(lambda c: BezierSegments(c).split(1.5)[0].control_points)
    np.testing.assert_allclose(cut(CUBICS), BezierSegments(CUBICS).split(1.5)[0].control_points, atol=ROUNDING)
    with pytest.raises(ValueError, match=r"t is 3; needs 0 < t < 3\."):
        jax.jit(lambda c: BezierSegments(c).split(3.0)[0].control_points)(CUBICS)


def test_restrict_cuts_every_segment():
    curve = BezierSegments(CUBICS, WEIGHTS)
    part = curve.restrict(0.25, [0.5, 0.75, 0.0])
    for k, end in enumerate([0.5, 0.75, 0.0]):
        expected = curve.point(k, 0.25 + np.linspace(0, 1, 5) * (end - 0.25))
        np.testing.assert_allclose(part.point(k, np.linspace(0, 1, 5)), expected, atol=ROUNDING)


@pytest.mark.parametrize(("ends", "message"), [((-0.1, 1), "t0 is -0.1; needs 0 <= t0 <= 1"), ((0, 2), "t1 is 2.0")])
def test_restrict_refuses_parameters_outside(ends, message):
    with pytest.raises(ValueError, match=message):
        BezierSegments(CUBICS).restrict(*ends)


@pytest.mark.parametrize("weights", [None, WEIGHTS])
def test_elevation_keeps_the_curve(weights):
    curve, t = BezierSegments(CUBICS, weights), np.linspace(0, 2.9, 11)
    raised = curve.elevate(7)
    assert raised.degree == 7
    np.testing.assert_allclose(raised(t), curve(t), atol=ROUNDING)
    assert curve.elevate(3).degree == 3


def test_elevation_refuses_to_lower():
    with pytest.raises(ValueError, match=r"degree is 3; cannot elevate to 2\."):
        BezierSegments(CUBICS).elevate(2)


def test_reversal_turns_segments_and_joints_around():
    curve = BezierSegments(LOOP)
    back = curve.reverse()
    t = np.linspace(0.1, 3.9, 9)
    np.testing.assert_allclose(back(t), curve(4 - t), atol=ROUNDING)
    assert back.next_segment.tolist() == [1, 2, 3, 0]
    assert BezierSegments(CUBICS).reverse().next_segment.tolist() == [-1, -1, -1]
    apart = BezierSegments(CUBICS, None, [2, -1, 1]).reverse()
    assert apart.next_segment.tolist() == [2, 0, -1]
    jitted = jax.jit(lambda c: c.reverse().next_segment)(BezierSegments(CUBICS, None, [2, -1, 1]))
    assert jitted.tolist() == [2, 0, -1]


def test_transform_is_affine_and_keeps_joints():
    matrix, offset = np.array([[1.0, 2.0], [0.0, 3.0]]), np.array([5.0, -1.0])
    curve = BezierSegments(LOOP, np.ones((4, 4)))
    image = curve.transform(matrix, offset)
    t = np.linspace(0, 3.9, 9)
    np.testing.assert_allclose(image(t), curve(t) @ matrix.T + offset, atol=10 * ROUNDING)
    assert image.next_segment.tolist() == [1, 2, 3, 0]


def test_a_seam_that_is_only_rounding_survives_a_move_to_the_origin():
    # Ends 1e-10 apart are one joint at 1e6, and must stay one when the offset makes that difference visible.
    loop = np.array([[[1e6, 0.0], [1e6, 1.0], [1e6 + 1e-10, 0.0]]])
    assert BezierSegments(loop).next_segment.tolist() == [0]
    assert BezierSegments(loop).transform(np.eye(2), [-1e6, 0.0]).next_segment.tolist() == [0]


def test_a_projection_that_closes_a_curve_joins_its_ends():
    helix = jhd.polyline([[1, 0, 0], [0, 1, 1], [-1, 0, 2], [1, 0, 3]])
    assert helix.next_segment.tolist() == [1, 2, -1]
    assert helix.transform([[1, 0, 0], [0, 1, 0]]).next_segment.tolist() == [1, 2, 0]


@pytest.mark.parametrize(
    ("matrix", "offset", "message"),
    [
        (np.eye(3), 0.0, r"matrix has shape \(3, 3\); needs \(new_dim, 2\)"),
        (np.eye(2), [1.0, 2.0, 3.0], r"offset has shape \(3,\); needs \(2,\)"),
        ([[np.nan, 0], [0, 1]], 0.0, r"matrix\[0\] is not finite: \(nan, 0\)"),
        (np.eye(2), np.inf, r"offset is not finite: inf"),
    ],
)
def test_transform_refuses_what_is_no_affine_map(matrix, offset, message):
    with pytest.raises(ValueError, match=message):
        BezierSegments(CUBICS).transform(matrix, offset)


def test_pad_repeats_the_last_segment():
    curve = BezierSegments(LOOP, np.ones((4, 4)))
    padded = curve.pad(6)
    assert padded.count == 6
    np.testing.assert_array_equal(padded.control_points[4:], LOOP[[3, 3]])
    assert padded.next_segment.tolist() == [1, 2, 3, 0, 0, 0]
    with pytest.raises(ValueError, match=r"count is 3; the curve has 4 segments\."):
        curve.pad(3)


def test_join_raises_degrees_and_keeps_joints():
    union = BezierSegments.join(
        [jhd.circle((0, 0), 1.0), jhd.point_set([[3, 3]]), jhd.polyline([[0, 0], [1, 1], [2, 0]])]
    )
    assert (union.degree, union.count) == (2, 7)
    assert union.next_segment.tolist() == [1, 2, 3, 0, -1, 6, -1]
    np.testing.assert_array_equal(np.asarray(union.weights)[4:], np.ones((3, 3)))
    np.testing.assert_allclose(union.point(4, 0.3), [3, 3], atol=ROUNDING)
    np.testing.assert_allclose(union.point(5, 0.5), [0.5, 0.5], atol=ROUNDING)
    assert BezierSegments.join([BezierSegments(CUBICS)]).weights is None


def test_join_keeps_two_closed_contours_apart_that_start_at_one_point():
    triangle = jhd.polyline([[0, 0], [1, 0], [0, 1]], closed=True)
    other = jhd.polyline([[0, 0], [-1, 0], [0, -1]], closed=True)
    assert BezierSegments.join([triangle, other]).next_segment.tolist() == [1, 2, 0, 4, 5, 3]


def test_join_refuses_nothing_and_mixed_dimensions():
    with pytest.raises(ValueError, match=r"join needs at least one curve; got none\."):
        BezierSegments.join([])
    with pytest.raises(ValueError, match=r"join needs curves of one dimension; got \[2, 3\]\."):
        BezierSegments.join([jhd.point_set([[0, 0]]), jhd.point_set([[0, 0, 0]])])
    with pytest.raises(TypeError, match=r"curves\[0\] must be a curve|type-checking|Type-check"):
        BezierSegments.join([CUBICS])  # pyright: ignore[reportArgumentType]


def test_anything_but_a_curve_is_refused_by_name():
    with pytest.raises(TypeError, match=r"a must be a curve .*jhd\.point_set.* got ndarray\."):
        check_curve("a", CUBICS)


def test_box_holds_the_control_points():
    lower, upper = BezierSegments(CUBICS, WEIGHTS).bounds
    np.testing.assert_array_equal(lower, CUBICS.min(axis=(0, 1)))
    np.testing.assert_array_equal(upper, CUBICS.max(axis=(0, 1)))
    lower, upper = jhd.BezierCurve(CUBICS[0]).bounds
    np.testing.assert_array_equal(upper - lower, np.ptp(CUBICS[0], axis=0))


# Joints


@pytest.mark.parametrize(
    ("rows", "next_segment"),
    [
        ([[0, 0], [1, 0], [1, 1]], [1, -1]),
        ([[0, 0], [1, 0], [1, 1], [0, 0]], [1, 2, 0]),
        # The end meets the start of the second line: no free end, but no seam either.
        ([[0, 0], [1, 0], [1, 1], [1, 0]], [1, 2, 1]),
        # Repeated points: a line of length zero leads on to the next one, and never back to itself.
        ([[0, 0], [1, 0], [1, 0]], [1, -1]),
        ([[0, 0], [1, 0], [1, 0], [1, 0]], [1, 2, -1]),
        ([[0, 0], [0, 0], [1, 0], [1, 1], [0, 0]], [1, 2, 3, 1]),
        ([[1, 1], [1, 1]], [-1]),
    ],
)
def test_joints_of_polylines(rows, next_segment):
    assert jhd.polyline(rows).next_segment.tolist() == next_segment
    traced = jax.jit(lambda x: jhd.polyline(x).next_segment)(np.array(rows, dtype=float))
    assert traced.tolist() == next_segment


def test_ends_that_differ_by_rounding_are_joined_and_others_are_not():
    gap = 4 * np.spacing(1e6)
    near = BezierSegments([[[1e6, 0], [1e6, 1]], [[1e6 + gap, 1], [0, 1]]])
    assert near.next_segment.tolist() == [1, -1]
    far = BezierSegments([[[1e6, 0], [1e6, 1]], [[1e6 + 100 * gap, 1], [0, 1]]])
    assert far.next_segment.tolist() == [-1, -1]


def test_many_loose_segments_find_their_joints():
    # More pairs than are compared at once: a chain of 2000 lines in random order.
    order = np.random.default_rng(0).permutation(2000)
    lines = np.stack([np.stack([order, order**2], 1), np.stack([order + 1, (order + 1) ** 2], 1)], axis=1)
    next_segment = np.asarray(BezierSegments(lines).next_segment)
    assert np.sum(next_segment < 0) == 1
    np.testing.assert_array_equal(order[next_segment[next_segment >= 0]], order[next_segment >= 0] + 1)


@pytest.mark.parametrize(
    ("next_segment", "message"),
    [
        ([0, 1], r"next_segment has shape \(2,\) .*; needs \(3,\) integers\."),
        ([0.0, 1.0, 2.0], r"next_segment has shape \(3,\) and dtype float64; needs \(3,\) integers\."),
        ([0, 3, -1], r"next_segment\[1\] is 3; needs -1 or a segment below 3\."),
        ([0, 1, -2], r"next_segment\[2\] is -2"),
    ],
)
def test_a_wrong_following_is_refused(next_segment, message):
    with pytest.raises(ValueError, match=message):
        BezierSegments(CUBICS, None, next_segment)


# Refusals of arrays


@pytest.mark.parametrize(
    ("control_points", "weights", "message"),
    [
        ([], None, r"control_points has shape \(0,\); needs \(segments, points, dim\)\."),
        (np.zeros((0, 4, 2)), None, r"control_points is empty: its shape is \(0, 4, 2\)\."),
        (np.zeros((4, 2)), None, r"control_points has shape \(4, 2\); needs \(segments, points, dim\)\."),
        (np.zeros((1, 4, 4)), None, r"control_points has 4 coordinates a point; needs 2 or 3\."),
        ([[[0, 0], [1, np.nan]]], None, r"control_points\[0, 1\] is not finite: \(1, nan\)\."),
        ([[[0, 0], [-np.inf, 1]]], None, r"control_points\[0, 1\] is not finite: \(-inf, 1\)\."),
        ([[[0, 0], [1]]], None, r"control_points must be a rectangular array of numbers"),
        (CUBICS, np.ones((3, 3)), r"weights has 3 x 3; control_points has 3 x 4 points\."),
        (CUBICS, 1.0, r"weights has no axis; control_points has 3 x 4 points\."),
        (CUBICS, WEIGHTS * [1, 1, 1, 0], r"weights\[0, 3\] is not positive: 0\."),
        (CUBICS, -WEIGHTS, r"weights\[0, 0\] is not positive: -"),
        (CUBICS, WEIGHTS * np.nan, r"weights\[0\] is not finite"),
    ],
)
def test_wrong_arrays_are_refused(control_points, weights, message):
    with pytest.raises(ValueError, match=message):
        BezierSegments(control_points, weights)


@pytest.mark.parametrize("wrong", [[[["a", "b"]]], np.ones((1, 2, 2)) * 1j, np.array([[[None, 1]]])])
def test_what_are_no_real_numbers_is_refused(wrong):
    with pytest.raises(TypeError, match=r"control_points must be real numbers; its dtype is"):
        BezierSegments(wrong)
    with pytest.raises(TypeError, match=r"weights must be real numbers; its dtype is"):
        BezierSegments(CUBICS, wrong)


def test_traced_complex_numbers_are_refused():
    with pytest.raises(TypeError, match=r"control_points must be real numbers"):
        jax.jit(lambda x: BezierSegments(x).control_points)(CUBICS + 1j)


# Points, polylines, circles


def test_points_are_segments_of_degree_zero():
    cloud = jhd.point_set([[1, 2], [3, 4]])
    assert (cloud.degree, cloud.count, cloud.dim) == (0, 2, 2)
    assert cloud.next_segment.tolist() == [-1, -1]
    np.testing.assert_array_equal(cloud(np.array([0.3, 1.9])), [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("array", "message"),
    [
        ([1.0, 2.0], r"points has shape \(2,\); needs \(points, 2\) or \(points, 3\)\."),
        (np.zeros((0, 2)), r"points has 0 points; needs at least 1\."),
        ([[0, 0], [np.nan, 1]], r"points\[1\] is not finite: \(nan, 1\)\."),
        (np.zeros((2, 4)), r"points has shape \(2, 4\)"),
    ],
)
def test_points_refuse_what_is_none(array, message):
    with pytest.raises(ValueError, match=message):
        jhd.point_set(array)


def test_polylines_close_once():
    rows = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    assert jhd.polyline(rows).count == 2
    assert jhd.polyline(rows, closed=True).count == 3
    assert jhd.polyline([*rows, rows[0]], closed=True).count == 3
    assert jhd.polyline(shapely.LineString(rows)).count == 2
    with pytest.raises(ValueError, match=r"points has 1 points; needs at least 2\."):
        jhd.polyline([[0, 0]])


def test_the_circle_is_round_closed_and_starts_at_angle_zero():
    circle = jhd.circle([1.0, 2.0], 3.0)
    assert circle.next_segment.tolist() == [1, 2, 3, 0]
    radii = np.hypot(*(np.asarray(circle(np.linspace(0, 4, 101))) - [1, 2]).T)
    np.testing.assert_allclose(radii, 3.0, rtol=ROUNDING)
    np.testing.assert_array_equal(circle(np.arange(4)), [[4, 2], [1, 5], [-2, 2], [1, -1]])


@pytest.mark.parametrize(
    ("center", "radius", "message"),
    [
        ([0, 0, 0], 1.0, r"center has shape \(3,\); needs \(2,\)\."),
        ([0, 0], [1.0], r"radius has shape \(1,\); needs a scalar\."),
        ([0, 0], 0.0, r"radius is not positive: 0\."),
        ([0, 0], -1.0, r"radius is not positive: -1\."),
        ([0, 0], np.inf, r"radius is not finite: inf\."),
        ([0, np.nan], 1.0, r"center\[1\] is not finite: nan\."),
    ],
)
def test_the_circle_refuses_what_is_none(center, radius, message):
    with pytest.raises(ValueError, match=message):
        jhd.circle(center, radius)


# Paths


def test_a_path_of_every_code():
    vertices = [[0, 0], [2, 0], [3, 0], [3, 1], [3, 2], [2, 3], [0, 3], [9, 9], [5, 5], [6, 6]]
    codes = [Path.MOVETO, Path.LINETO, Path.CURVE3, Path.CURVE3, *[Path.CURVE4] * 3, Path.CLOSEPOLY]
    outline = BezierSegments.from_path(Path(vertices, [*codes, Path.MOVETO, Path.LINETO]))
    assert (outline.degree, outline.count) == (3, 5)
    assert outline.next_segment.tolist() == [1, 2, 3, 0, -1]
    np.testing.assert_allclose(outline.point(0, 0.25), [0.5, 0], atol=ROUNDING)
    expected = bernstein_value(np.array([[2, 0], [3, 0], [3, 1]]), np.ones(3), 0.4)
    np.testing.assert_allclose(outline.point(1, 0.4), expected, atol=ROUNDING)
    np.testing.assert_array_equal(outline.control_points[2], [[3, 1], [3, 2], [2, 3], [0, 3]])
    np.testing.assert_allclose(outline.point(3, 0.5), [0, 1.5], atol=ROUNDING)
    np.testing.assert_allclose(outline.point(4, 0.5), [5.5, 5.5], atol=ROUNDING)


def test_a_path_without_codes_is_a_polyline():
    line = BezierSegments.from_path(Path([[0, 0], [1, 0], [1, 1]]))
    np.testing.assert_array_equal(line.control_points, jhd.polyline([[0, 0], [1, 0], [1, 1]]).control_points)


def test_a_closing_line_of_length_zero_is_dropped():
    square = Path([[0, 0], [1, 0], [1, 1], [0, 0], [0, 0]], [1, 2, 2, 2, 79])
    assert BezierSegments.from_path(square).next_segment.tolist() == [1, 2, 0]


def test_after_closing_the_pen_is_at_the_start_and_stop_ends_the_path():
    path = Path([[0, 0], [1, 0], [1, 1], [0, 0], [5, 0], [9, 9], [7, 7]], [1, 2, 2, 79, 2, 0, 2])
    outline = BezierSegments.from_path(path)
    assert outline.next_segment.tolist() == [1, 2, 0, -1]
    np.testing.assert_array_equal(outline.control_points[3], [[0, 0], [5, 0]])


def test_contours_that_touch_keep_their_own_seams():
    path = Path.make_compound_path(
        Path([[0, 0], [1, 0], [0, 1], [0, 0]], [1, 2, 2, 79]), Path([[0, 0], [-1, 0], [0, -1], [0, 0]], [1, 2, 2, 79])
    )
    assert BezierSegments.from_path(path).next_segment.tolist() == [1, 2, 0, 4, 5, 3]


@pytest.mark.parametrize("letter", ["a", "%"])
def test_the_outline_of_a_letter_is_closed_and_lies_on_its_path(letter):
    path = TextPath((0, 0), letter, size=10.0)
    outline = BezierSegments.from_path(path)
    assert np.all(np.asarray(outline.next_segment) >= 0)
    # matplotlib's own reading of the same path, one curve after the other.
    pairs: Any = path.iter_bezier()
    pieces = [piece for piece, code in pairs if code != Path.MOVETO and np.ptp(piece.control_points, axis=0).any()]
    assert len(pieces) == outline.count
    for k, piece in enumerate(pieces):
        np.testing.assert_allclose(outline.control_points[k, [0, -1]], piece.control_points[[0, -1]])
    mine = outline.point(np.arange(outline.count), 0.3)
    np.testing.assert_allclose(mine, [piece(0.3) for piece in pieces], atol=10 * ROUNDING)


class Codes:
    def __init__(self, vertices, codes):
        self.vertices, self.codes = vertices, codes


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (Path([[0, 0], [np.nan, 1], [2, 2]]), r"path.vertices\[1\] is not finite: \(nan, 1\)\."),
        (Path(np.zeros((0, 2))), r"path is empty: it has no vertices\."),
        (Path([[0, 0], [1, 1]], [1, 1]), r"path has no segment; its 2 vertices only move the pen\."),
        (Codes(np.zeros((2, 3)), None), r"path.vertices has shape \(2, 3\); needs \(points, 2\)\."),
        (Codes(np.zeros((2, 2)), [1]), r"path.codes has 1 entries; path.vertices has 2 rows\."),
        (Codes(np.zeros((2, 2)), [2, 2]), r"path.codes\[0\] is 2; needs MOVETO \(1\)\."),
        (Codes(np.zeros((2, 2)), [1, 5]), r"path.codes\[1\] is 5; needs one of \[0, 1, 2, 3, 4, 79\]\."),
        (Codes(np.zeros((3, 2)), [1, 4, 4]), r"path.codes\[1\] is 4, which takes 3 vertices; fewer have that code\."),
        (Codes(np.zeros((3, 2)), [1, 3, 2]), r"path.codes\[1\] is 3, which takes 2 vertices"),
    ],
)
def test_broken_paths_are_refused(path, message):
    with pytest.raises(ValueError, match=message):
        BezierSegments.from_path(path)


def test_what_is_no_path_is_refused():
    with pytest.raises(TypeError, match=r"path must be a matplotlib Path \(vertices and codes\); got str\."):
        BezierSegments.from_path("M 0 0")  # pyright: ignore[reportArgumentType]


# Geometries


@pytest.mark.parametrize(
    ("text", "degree", "next_segment"),
    [
        ("POINT (1 2)", 0, [-1]),
        ("MULTIPOINT (1 2, 3 4)", 0, [-1, -1]),
        ("LINESTRING (0 0, 1 0, 1 1)", 1, [1, -1]),
        ("LINEARRING (0 0, 1 0, 1 1, 0 0)", 1, [1, 2, 0]),
        ("MULTILINESTRING ((0 0, 1 0), (5 5, 6 6))", 1, [-1, -1]),
        ("POLYGON ((0 0, 9 0, 0 9, 0 0), (1 1, 2 1, 1 2, 1 1))", 1, [1, 2, 0, 4, 5, 3]),
        ("MULTIPOLYGON (((0 0, 1 0, 0 1, 0 0)), ((0 0, -1 0, 0 -1, 0 0)))", 1, [1, 2, 0, 4, 5, 3]),
        ("GEOMETRYCOLLECTION (POINT (7 7), POINT EMPTY, LINESTRING (0 0, 1 0))", 1, [-1, -1]),
        ("LINESTRING Z (0 0 1, 1 0 2)", 1, [-1]),
    ],
)
def test_geometries_become_their_points_and_lines(text, degree, next_segment):
    geometry = shapely.from_wkt(text)
    curve = BezierSegments.from_shapely(geometry)
    assert (curve.degree, curve.next_segment.tolist()) == (degree, next_segment)
    assert curve.dim == (3 if geometry.has_z else 2)
    ends = np.unique(np.asarray(curve.control_points).reshape(-1, curve.dim), axis=0)
    np.testing.assert_array_equal(ends, np.unique(shapely.get_coordinates(geometry, include_z=geometry.has_z), axis=0))


def test_a_measure_is_no_coordinate():
    curve = BezierSegments.from_shapely(shapely.from_wkt("LINESTRING M (0 0 8, 1 0 9)"))
    np.testing.assert_array_equal(curve.control_points, [[[0, 0], [1, 0]]])


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        (shapely.Polygon(), r"geometry is empty: Polygon\."),
        (shapely.from_wkt("GEOMETRYCOLLECTION EMPTY"), r"geometry is empty: GeometryCollection\."),
        (
            shapely.GeometryCollection([shapely.Point(0, 0), shapely.Point(0, 0, 0)]),
            r"geometry mixes members of 2 and 3 coordinates; needs one dimension\.",
        ),
    ],
)
def test_broken_geometries_are_refused(geometry, message):
    with pytest.raises(ValueError, match=message):
        BezierSegments.from_shapely(geometry)


def test_geometries_that_are_not_finite_are_refused():
    # GEOS compares the coordinates when it builds the geometry, which numpy reports.
    with np.errstate(invalid="ignore"):
        geometry = shapely.MultiLineString([[[0, 0], [1, 1]], [[0, 0], [np.nan, 1]]])
    with pytest.raises(ValueError, match=r"geometry\.coords of part 1\[1\] is not finite: \(nan, 1\)\."):
        BezierSegments.from_shapely(geometry)


def test_what_is_no_geometry_is_refused():
    with pytest.raises(TypeError, match=r"geometry must be a shapely geometry; got list\."):
        BezierSegments.from_shapely([[0, 0]])  # pyright: ignore[reportArgumentType]

    class Surface:
        geom_type, is_empty = "Tin", False

    with pytest.raises(TypeError, match=r"geometry is a Tin; needs points, lines, rings, polygons or collections"):
        BezierSegments.from_shapely(Surface())


# Transformations of JAX


def test_a_curve_is_a_tree_of_its_arrays():
    curve = BezierSegments(LOOP, np.ones((4, 4)))
    leaves, structure = jax.tree_util.tree_flatten(curve)
    assert len(leaves) == 3
    again = jax.tree_util.tree_unflatten(structure, leaves)
    assert bool(eqx.tree_equal(curve, again))


@pytest.mark.slow
def test_curves_are_mapped_over():
    batch = eqx.filter_vmap(BezierSegments)(np.stack([LOOP, LOOP[::-1]]))
    assert (batch.count, batch.degree, batch.dim) == (4, 3, 2)
    assert batch.next_segment.shape == (2, 4)
    values = jax.vmap(lambda curve: curve(1.5))(batch)
    expected = [BezierSegments(LOOP)(1.5), BezierSegments(LOOP[::-1])(1.5)]
    np.testing.assert_allclose(values, expected, atol=ROUNDING)


def test_the_gradient_of_a_point_is_its_bernstein_basis():
    gradient = jax.jit(jax.grad(lambda c: BezierSegments(c).point(1, 0.5)[0]))(CUBICS)
    np.testing.assert_allclose(gradient[1, :, 0], [0.125, 0.375, 0.375, 0.125], rtol=ROUNDING)
    assert float(jnp.sum(jnp.abs(gradient))) == pytest.approx(1.0)


@pytest.mark.slow
def test_the_precision_is_double_unless_the_environment_says_otherwise():
    assert jhd.circle((0, 0), 1).control_points.dtype == "float64"
    code = (
        "import numpy as np, jhd\n"
        "a = jhd.BSplineCurve.uniform(np.arange(8.0).reshape(4, 2) ** 2, periodic=True)\n"
        "for x in (a, a.segments(), jhd.BezierCurve([[0, 0.5], [1, 2]]), jhd.circle((0, 0), 1)):\n"
        "    assert x.control_points.dtype == x(0.5).dtype == 'float32', x\n"
        "assert a.segments().next_segment.tolist() == [1, 2, 3, 0]\n"
    )
    environment = os.environ | {"JAX_ENABLE_X64": "0"}
    python("-W", "error", "-c", code, env=environment)


def test_joints_are_the_same_known_and_traced_and_of_many_loose_segments_found_by_sorting(monkeypatch):
    generator = np.random.default_rng(5)
    traced = jax.jit(joints)
    # On a small grid ends meet often, several at one place, and some segments are single points.
    for k in range(100):
        pieces = generator.integers(0, 3, size=(7, 3, 2)).astype(float)
        # In turns by comparing all, and by sorting.
        monkeypatch.setattr("jhd._shapes.joints._FEW_PAIRS", 0 if k % 2 else 1 << 12)
        np.testing.assert_array_equal(joints(jnp.asarray(pieces)), traced(pieces))
    loose = generator.normal(size=(20_000, 2, 2))
    loose[123, 0] = loose[19_876, 1]
    found = np.asarray(joints(jnp.asarray(loose)))
    assert found[19_876] == 123 and np.sum(found >= 0) == 1


def test_joints_of_points_that_are_differentiated_are_known():
    seen = []

    def length(points):
        seen.append(BezierSegments(points).next_segment)
        return jnp.sum(points)

    square = jnp.array([[[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [1.0, 1.0]], [[1.0, 1.0], [0.0, 0.0]]])
    jax.grad(length)(square)
    jax.jvp(length, (square,), (square,))
    assert [next_segment.tolist() for next_segment in seen] == [[1, 2, 0], [1, 2, 0]]
