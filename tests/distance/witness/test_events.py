"""Residuals, following of feet, and the witness: which event, which feet, which multipliers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.nearest.curves import nearest
from jhd._distance.nearest.feet import follow_foot
from jhd._distance.normalization.curves import prepare
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of, preceding
from jhd._distance.witness.events import describe
from jhd._results.solution import name_of

# Feet are refined by Newton's method in float64.
ROUNDING = 1e-12

PARABOLA = jhd.BezierSegments([[[-2.0, 4.0], [0.0, -4.0], [2.0, 4.0]]])
BASE = jhd.polyline([[0.0, 0.0], [1.0, 0.0]])
_describe = jax.jit(lambda *pair: describe(*pair).witness())
_follow = jax.jit(follow_foot, static_argnums=5)


def witness(a, b, segment, t):
    """The witness of a pair in common coordinates, and the frame that leads back."""
    *both, frame = prepare(a, b)
    p, q = jax.tree_util.tree_map(jnp.asarray, both)
    at = CurvePlace(jnp.array(segment), jnp.array(t))
    point = jet(*piece_of(p, at.segment), at.t).point
    found = nearest(point, q.control_points, q.weights)
    return _describe(p, q, at, CurvePlace(found.segment, found.t)), frame


@pytest.mark.parametrize(
    ("a", "b", "segment", "t", "event"),
    [
        (jhd.polyline([[0.0, 1.0], [1.0, 2.0]]), BASE, 0, 1.0, "a_end"),
        (jhd.point_set([[0.0, 1.0]]), BASE, 0, 0.0, "a_end"),
        (jhd.polyline([[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]]), BASE, 0, 1.0, "corner"),
        (jhd.polyline([[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]]), BASE, 1, 0.0, "corner"),
        (jhd.BezierSegments([[[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]]]), BASE, 0, 0.5, "antipodal"),
        (jhd.BezierSegments([[[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]]]), BASE, 0, 0.0, "coincident"),
        (jhd.polyline([[-1.0, 0.5], [-1.0, -0.5]]), BASE, 0, 0.5, "b_end"),
        (jhd.polyline([[-0.5, 2.0], [0.5, 2.0]]), PARABOLA, 0, 0.5, "one_to_two"),
        (jhd.polyline([[0.0, 0.0], [4.0, 0.0]]), jhd.point_set([[0.0, 1.0], [3.0, 1.0]]), 0, 0.375, "one_to_two"),
    ],
)
def test_events_are_told_apart(a, b, segment, t, event):
    found, _ = witness(a, b, segment, t)
    assert name_of(found.event) == event
    assert name_of(found.direction) == "a_to_b"


def test_a_joint_without_a_corner_is_no_corner_and_a_seam_is_no_end():
    arch = jhd.BezierCurve([[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]])
    both = jhd.BezierSegments.join(arch.split(0.5))
    for segment, t in ((0, 1.0), (1, 0.0)):
        assert name_of(witness(both, BASE, segment, t)[0].event) == "antipodal"


def test_two_feet_are_named_in_the_order_of_b_with_multipliers_that_balance():
    # A slanted line through (0, 2): both feet are equally far, but the slopes differ.
    found, frame = witness(jhd.polyline([[-1.0, 1.0], [1.0, 3.0]]), PARABOLA, 0, 0.5)
    feet = np.asarray(frame.place(found.feet))
    np.testing.assert_allclose(feet, [[-np.sqrt(1.5), 1.5], [np.sqrt(1.5), 1.5]], atol=ROUNDING)
    offsets = np.array([0.0, 2.0]) - feet
    slopes = offsets @ np.array([1.0, 1.0]) / np.linalg.norm(offsets, axis=1)
    expected = np.array([-slopes[1], slopes[0]]) / (slopes[0] - slopes[1])
    np.testing.assert_allclose(found.multipliers, expected, atol=ROUNDING)
    assert found.feet_params[0] < found.feet_params[1]


def test_two_feet_that_pull_the_same_way_are_no_event_of_two():
    # The line through (0, 2) along the axis of the parabola: both feet draw the same way.
    found, _ = witness(jhd.polyline([[0.0, 1.0], [0.0, 3.0]]), PARABOLA, 0, 0.5)
    assert name_of(found.event) == "antipodal"
    np.testing.assert_array_equal(found.multipliers, [1.0, 0.0])


def test_the_center_of_a_circle_gives_a_witness_without_nan():
    circle = jhd.circle([0.0, 0.0], 1.0)
    for a in (jhd.polyline([[-0.5, 0.0], [0.5, 0.0]]), jhd.BezierSegments(np.zeros((1, 2, 2)))):
        found, frame = witness(a, circle, 0, 0.5)
        for leaf in jax.tree_util.tree_leaves(found):
            assert not np.isnan(np.asarray(leaf, dtype=float)).any()
        np.testing.assert_allclose(np.linalg.norm(frame.place(found.feet), axis=1), 1.0, atol=ROUNDING)
        assert abs(found.multipliers.sum() - 1) <= ROUNDING and (found.multipliers >= 0).all()


def test_curves_of_one_point_have_a_witness_without_nan():
    one = jhd.BezierSegments(np.ones((1, 4, 2)))
    found, _ = witness(one, one, 0, 0.25)
    assert name_of(found.event) == "coincident"
    assert not np.isnan(np.asarray(found.multipliers)).any()


def test_preceding_turns_following_round():
    np.testing.assert_array_equal(preceding(jnp.array([1, 2, 0, -1])), [2, 0, 1, -1])
    np.testing.assert_array_equal(preceding(jnp.array([-1, 0])), [1, -1])


@pytest.mark.parametrize(
    ("point", "start", "segment", "s"),
    [
        ([1.5, 0.75], (0, 0.5), 1, 0.5),
        ([0.25, 0.75], (1, 0.5), 0, 0.25),
        ([-1.0, 0.25], (1, 0.9), 0, 0.0),
        ([5.0, 0.25], (0, 0.1), 1, 1.0),
    ],
)
def test_feet_are_followed_across_joints_and_stop_at_free_ends(point, start, segment, s):
    b = jhd.polyline([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    found = _follow(jnp.array(point), b, preceding(b.next_segment), jnp.array(start[0]), jnp.array(start[1]), 12)
    assert int(found.segment) == segment
    assert abs(float(found.s) - s) <= ROUNDING
    assert bool(found.pinned) == (point[0] < 0 or point[0] > 2)
    np.testing.assert_allclose(found.point, [min(max(point[0], 0.0), 2.0), 0.0], atol=ROUNDING)


def test_a_foot_at_an_end_where_the_distance_is_stationary_is_free():
    b = jhd.polyline([[0.0, 0.0], [1.0, 0.0]])
    found = _follow(jnp.array([0.0, 1.0]), b, preceding(b.next_segment), jnp.array(0), jnp.array(0.5), 12)
    assert float(found.s) == 0 and not found.pinned


def test_an_isolated_point_is_always_a_pinned_foot():
    b = jhd.BezierSegments(np.ones((1, 2, 2)))
    found = _follow(jnp.array([1.0, 1.0]), b, preceding(b.next_segment), jnp.array(0), jnp.array(0.5), 12)
    assert bool(found.pinned)


def test_a_piece_carries_its_weights():
    circle = jhd.circle([0.0, 0.0], 1.0)
    piece = piece_of(circle, jnp.array(1))
    np.testing.assert_array_equal(piece.control_points, circle.control_points[1])
    assert piece.weights is not None and piece.weights.shape == (3,)
    assert piece_of(BASE, jnp.array(0)).weights is None
