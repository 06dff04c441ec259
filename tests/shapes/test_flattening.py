"""Polylines and cubics of curves: the proven deviation holds both ways, and joints stay."""

import numpy as np
import pytest

import jhd
from jhd._runtime.decimals import upper_text
from jhd._shapes.flattening import flattened
from jhd._shapes.homogeneous import elevate

RANDOM = np.random.default_rng(41)
CURVES = {
    "cubic": jhd.BezierSegments(RANDOM.normal(size=(3, 4, 2))),
    "rational": jhd.BezierSegments(RANDOM.normal(size=(2, 4, 3)), 10.0 ** RANDOM.uniform(-3, 3, (2, 4))),
    "far away": jhd.BezierSegments(RANDOM.normal(size=(2, 4, 2)) + 1e6),
    "small": jhd.BezierSegments(1e-200 * RANDOM.normal(size=(2, 4, 2)), RANDOM.uniform(0.1, 1, (2, 4))),
    "large": jhd.BezierSegments(1e200 * RANDOM.normal(size=(2, 4, 2))),
    "uneven": jhd.BezierSegments([[[0.0, 0], [0, 0.1], [5, 0], [5, 0]], [[5, 0], [-1, 0.5], [5, 0.5], [0, 1.0]]]),
    "one point": jhd.BezierSegments(np.full((1, 4, 2), 3.0)),
}


def values(points, weights, t):
    """Points of one segment at parameters, summed in extended precision."""
    n = len(points) - 1
    t = np.asarray(t, np.longdouble)[:, None]
    table = np.repeat(np.asarray(points, np.longdouble)[None], len(t), 0)
    heavy = (
        np.ones((len(t), n + 1)) if weights is None else np.repeat(np.asarray(weights, np.longdouble)[None], len(t), 0)
    )
    h = np.concatenate([table * heavy[..., None], heavy[..., None]], axis=-1)
    for _ in range(n):
        h = (1 - t[..., None]) * h[:, :-1] + t[..., None] * h[:, 1:]
    return h[:, 0, :-1] / h[:, 0, -1:]


def distance_to_lines(x, lines):
    """The distance of each point to the nearest of some straight segments, in extended precision."""
    a, b = np.asarray(lines[:, 0], np.longdouble), np.asarray(lines[:, 1], np.longdouble)
    along = b - a
    length_sq = np.maximum(np.sum(along**2, axis=-1), np.finfo(np.longdouble).tiny)
    t = np.clip(np.sum((x[:, None] - a) * along, axis=-1) / length_sq, 0, 1)
    return np.sqrt(np.sum((x[:, None] - a - t[..., None] * along) ** 2, axis=-1)).min(axis=1)


@pytest.mark.parametrize("share", [1e-1, 1e-3])
@pytest.mark.parametrize("name", CURVES)
def test_no_point_of_the_curve_is_farther_from_the_polyline_than_its_deviation(name, share):
    curve = CURVES[name]
    points = np.asarray(curve.control_points)
    extent = float(np.ptp(points, axis=(0, 1)).max()) or 1.0
    found = curve.to_polyline(share * extent)
    lines = np.asarray(found.shape.control_points)
    assert found.shape.degree == 1 and found.deviation <= share * extent
    far = 0.0
    for k in range(curve.count):
        weights = None if curve.weights is None else np.asarray(curve.weights)[k]
        far = max(far, distance_to_lines(values(points[k], weights, np.linspace(0, 1, 101)), lines).max())
    assert far <= found.deviation
    # The bound is not many times what it bounds.
    assert name == "one point" or found.deviation <= 30 * far


@pytest.mark.parametrize("degree", [1, 3])
@pytest.mark.parametrize("name", CURVES)
def test_pieces_are_near_and_start_where_the_last_one_ends(name, degree):
    points, weights = np.asarray(CURVES[name].control_points), CURVES[name].weights
    weights = None if weights is None else np.asarray(weights)
    extent = float(np.ptp(points, axis=(0, 1)).max()) or 1.0
    found = flattened(points, weights, degree, 1e-3 * extent, 10_000)
    assert found.control_points.shape[1] == degree + 1
    for k in range(len(points)):
        pieces = found.control_points[found.segment == k]
        np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, -1])
        np.testing.assert_array_equal([pieces[0, 0], pieces[-1, -1]], points[k, [0, -1]])
    # From the pieces to the curve: dense points of it, the more the nearer to the ends, are near enough to tell.
    dense_t = np.concatenate([[0], 1 / (1 + np.exp(-np.linspace(-18, 18, 2001))), [1]])
    dense = [values(points[k], None if weights is None else weights[k], dense_t) for k in range(len(points))]
    dense = np.concatenate([np.stack([x[:-1], x[1:]], axis=1) for x in dense])
    t = np.linspace(0, 1, 7)
    inner = np.concatenate(
        [values(piece, None, t) for piece in found.control_points[:: max(1, len(found.segment) // 9)]]
    )
    assert distance_to_lines(inner, dense).max() <= found.deviation + 1e-4 * extent


def test_polynomials_of_degree_three_and_less_are_their_own_cubics():
    curve = CURVES["cubic"]
    np.testing.assert_allclose(curve.to_cubics(1e-12).shape.control_points, curve.control_points, atol=1e-14)
    parabola = jhd.BezierSegments([[[0.0, 0], [1, 2], [2, 0]]])
    found = parabola.to_cubics(1e-13)
    assert found.shape.count == 1 and 0 < found.deviation < 1e-13
    np.testing.assert_allclose(found.shape.control_points[0], elevate(parabola.control_points[0], 3), atol=1e-15)


def test_straight_segments_are_kept_whatever_their_weights_are():
    rows = RANDOM.normal(size=(3, 2, 2))
    found = jhd.BezierSegments(rows, RANDOM.uniform(0.1, 9, (3, 2)), [2, -1, 0]).to_polyline(1e-300)
    assert found.deviation == 0
    np.testing.assert_array_equal(found.shape.control_points, rows)
    np.testing.assert_array_equal(found.shape.next_segment, [2, -1, 0])


STRAIGHT = {
    "handles at the ends": [[0, 0], [0, 0], [100, 0], [100, 0]],
    "one handle": [[0, 0], [0, 0], [60, 30], [100, 50]],
    "back and forth": [[0, 0, 0], [90, 45, 9], [10, 5, 1], [100, 50, 10]],
}


@pytest.mark.parametrize("name", STRAIGHT)
def test_a_straight_segment_of_any_speed_is_one_line(name):
    points = np.array([STRAIGHT[name]], float)
    for weights in (None, [[1.0, 9, 0.2, 3]]):
        found = jhd.BezierSegments(points, weights).to_polyline(1e-9)
        np.testing.assert_array_equal(found.shape.control_points, points[:, [0, -1]])
        assert found.deviation < 1e-10


def test_a_segment_that_runs_beyond_its_ends_keeps_its_turns():
    found = jhd.BezierSegments([[[0.0, 0], [-6, 0], [7, 0], [1, 0]]]).to_polyline(1e-3)
    assert 2 < found.shape.count < 40 and found.shape.control_points[..., 0].min() < -1


def test_contours_stay_closed_and_apart():
    rings = jhd.BezierSegments.join([jhd.circle([0, 0], 1), jhd.circle([9, 0], 1)])
    found = rings.to_polyline(0.05).shape
    assert found.count == 32
    np.testing.assert_array_equal(found.next_segment, [*range(1, 16), 0, *range(17, 32), 16])
    smooth = jhd.BSplineCurve.uniform([[0, 0], [6, 0], [6, 6], [0, 6]], periodic=True).to_cubics(1e-6)
    np.testing.assert_array_equal(smooth.shape.next_segment, [1, 2, 3, 0])


def distance_of_arcs(cubics, radius, center):
    """How far dense points of cubics are from a circle, least and most, in extended precision."""
    t = np.linspace(0, 1, 1001)
    dense = np.concatenate([values(row, None, t) for row in np.asarray(cubics)])
    off = np.sqrt(np.sum((dense - np.asarray(center, np.longdouble)) ** 2, axis=-1)) - radius
    return float(off.min()), float(off.max())


@pytest.mark.parametrize(("tolerance", "count"), [(1e-3, 4), (1e-4, 8), (1e-9, 48)])
def test_cubics_of_a_circle_are_few_and_as_near_as_is_proven(tolerance, count):
    radius, center = 3.0, [1.0, -2.0]
    found = jhd.circle(center, radius).to_cubics(radius * tolerance)
    low, high = distance_of_arcs(found.shape.control_points, radius, center)
    assert found.shape.count == count and found.deviation <= radius * tolerance
    assert -1e-14 < low and 0.99 * found.deviation < high <= found.deviation
    np.testing.assert_array_equal(found.shape.next_segment, [*range(1, count), 0])


@pytest.mark.parametrize("seed", range(6))
def test_cubics_of_arcs_of_ellipses_are_near_both_ways(seed):
    # Rational quadratics in space, small and large arcs, with outer weights that differ.
    random = np.random.default_rng(seed)
    points, middle = random.normal(size=(1, 3, 3)), random.choice([0.05, 0.3, 0.9, 0.9999, 1 - 1e-10, 1.0, 2.0])
    ends = 10.0 ** random.uniform(-2, 2, 2)
    arc = jhd.BezierSegments(points, [[ends[0], middle * np.sqrt(ends[0] * ends[1]), ends[1]]])
    for tolerance in (1e-2, 1e-5):
        found = arc.to_cubics(tolerance)
        dense_t = 1 / (1 + np.exp(-np.linspace(-18, 18, 3001)))
        there = values(points[0], np.asarray(arc.weights)[0], dense_t)
        back = np.concatenate([values(row, None, np.linspace(0, 1, 301)) for row in found.shape.control_points])
        chains = [np.stack([x[:-1], x[1:]], axis=1) for x in (there, back)]
        # The chords of the dense points are off by less than this.
        room = max(float(np.linalg.norm(np.diff(x, 2, axis=0), axis=1).max()) for x in (there, back))
        assert distance_to_lines(back[::7], chains[0]).max() <= found.deviation + room
        assert distance_to_lines(there[::31], chains[1]).max() <= found.deviation + room
        assert found.deviation <= tolerance


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: jhd.circle([0, 0], 1).to_polyline(0), ValueError, "tolerance is 0"),
        (lambda: jhd.circle([0, 0], 1).to_polyline([1.0]), ValueError, "needs one positive number"),
        (
            lambda: jhd.circle([0, 0], 1).to_polyline(1e-9, max_segments=100),
            ValueError,
            "more than max_segments = 100",
        ),
        (
            lambda: jhd.circle([1e9, 0], 1).to_cubics(1e-12, max_segments=10**9),
            ValueError,
            "below the rounding of",
        ),
        (lambda: jhd.point_set([[0, 0]]).to_polyline(1), ValueError, "curve is a point set"),
    ],
)
def test_what_cannot_be_done_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_an_approximation_unpacks_and_prints_its_deviation_rounded_up():
    found = jhd.circle([0, 0], 1).to_polyline(0.05)
    shape, deviation = found
    assert shape is found.shape and deviation == found.deviation
    assert repr(found) == f"Approximation(shape={shape!r}, deviation={upper_text(deviation)})"
