"""Arcs that stand for pieces of a curve: their deviations hold, and nothing of the curve is left out."""

from decimal import Decimal, localcontext
from fractions import Fraction
from math import comb

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd import BezierCurve, BezierSegments, BSplineCurve, NotProvenError, circle, hausdorff, point_set, polyline
from jhd._shapes import biarcs, deviation, least_tolerance
from tests import reference
from tests.sweeps import swept

# Directions of arcs that meet smoothly: the root find of the joint and the rounding of short chords.
SMOOTH = 1e-10
# Roundings of the arcs as rational quadratics, and of the distance between, in units of coordinates of size one.
ROUNDING = 1e-13

# Parameters of samples.
T = np.linspace(0, 1, 401)
RNG = np.random.default_rng(7)
CUBIC = RNG.normal(size=(1, 4, 2))


def spline(count, seed=3):
    """A closed wave, as outlines have it."""
    angle = np.linspace(0, 2 * np.pi * 0.97, count)
    radius = 4 + 0.9 * np.sin(3 * angle) + 0.5 * np.cos(5 * angle)
    rows = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return BSplineCurve.clamped(rows + 0.05 * np.random.default_rng(seed).normal(size=rows.shape))


CASES = {
    "cubic": BezierSegments(CUBIC),
    "quintics": BezierSegments(RNG.normal(size=(3, 6, 2))),
    "degree nine": BezierSegments(RNG.normal(size=(1, 10, 2))),
    "rational": BezierSegments(RNG.normal(size=(3, 5, 2)), np.exp(2 * RNG.normal(size=(3, 5)))),
    "uneven weights": BezierSegments(RNG.normal(size=(1, 4, 2)), [[1, 1e-20, 1e20, 1]]),
    "huge": BezierSegments(1e150 * CUBIC),
    "tiny": BezierSegments(1e-150 * CUBIC),
    "offset": BezierSegments(CUBIC + [1e8, -3e7]),
    "flat": BezierSegments(CUBIC * [1, 1e-12]),
    "inflection": BezierSegments([[[0, 0], [1, 1], [2, -1], [3, 0]]]),
    "symmetric": BezierSegments([[[0, 0], [1, 2], [2, 0]]]),
    "cusp in the middle": BezierSegments([[[0, 0], [1, 1], [0, 1], [1, 0]]]),
    "cusp elsewhere": BezierSegments([[[0, 0], [1.5, 1], [0, 2.5], [1, 0]]]),
    "almost a cusp": BezierSegments([[[0, 0], [1, 1], [1e-7, 1], [1, 0]]]),
    "still at the start": BezierSegments([[[0, 0], [0, 0], [1, 2], [3, 1]]]),
    "still at both ends": BezierSegments([[[0, 0], [0, 0], [3, 1], [3, 1]]]),
    "still inside": BezierSegments([[[0, 0], [1, 2], [1, 2], [3, 1]]]),
    "curvature infinite": BezierSegments([[[0, 0], [0, 0], [1 / 3, 0], [1, 1]]]),
    "loop": BezierSegments([[[0, 0], [2, 2], [-1, 2], [1, 0]]]),
    "closed": BezierSegments([[[0, 0], [2, 2], [-2, 2], [0, 0]]]),
    "corner": BezierSegments([[[0, 0], [1, 0], [1, 1e-9]], [[1, 1e-9], [0, 2e-9], [0, 1]]]),
    "straight": BezierSegments([[[0.1 * k, 0.3 * k] for k in range(4)]]),
    "to and fro": BezierSegments([[[0, 0], [2, 1], [-1, -0.5], [1, 0.5]]]),
    "folded": BezierSegments([[[0, 0], [2, 1.3], [0, 0]]]),
    "point": BezierSegments([[[0.1, 0.7]] * 4]),
    "circle": circle([3, 4], 5),
    "mixed": BezierSegments.join([point_set([[5.0, 5]]), circle([0, 0], 1), polyline([[0, 0], [1, 0], [1, 2]])]),
}


def exact_point(control_points, weights, t):
    """The point at t in rational arithmetic."""
    n, t, sums = len(control_points) - 1, Fraction(float(t)), [Fraction(0)] * 3
    for i, (row, weight) in enumerate(zip(control_points, weights, strict=True)):
        share = Fraction(float(weight)) * comb(n, i) * t**i * (1 - t) ** (n - i)
        sums = [s + share * x for s, x in zip(sums, (*map(Fraction, map(float, row)), 1), strict=True)]
    return sums[0] / sums[2], sums[1] / sums[2]


def root(x):
    """The square root of a fraction, to 50 digits."""
    return (Decimal(x.numerator) / Decimal(x.denominator)).sqrt()


def decimal(x):
    return Decimal(x.numerator) / Decimal(x.denominator)


def exact_distance(x, start, end, bulge):
    """Distance of x to the arc, to 45 digits, by its center; for lines by the normal."""
    a, b, beta = [Fraction(float(z)) for z in start], [Fraction(float(z)) for z in end], Fraction(float(bulge))
    v = b[0] - a[0], b[1] - a[1]
    ends = min(root(sum((p - q) ** 2 for p, q in zip(x, e, strict=True))) for e in (a, b))
    if v == (0, 0):
        return ends
    d, left = (x[0] - a[0], x[1] - a[1]), (-v[1], v[0])
    along, across = d[0] * v[0] + d[1] * v[1], d[0] * left[0] + d[1] * left[1]
    square = v[0] ** 2 + v[1] ** 2
    if beta == 0:
        return abs(decimal(across)) / root(square) if 0 <= along <= square else ends
    rise = (1 - beta**2) / (4 * beta)
    o = [(p + q) / 2 + rise * n for p, q, n in zip(a, b, left, strict=True)]
    u0, u1, u = ([p - q for p, q in zip(y, o, strict=True)] for y in (a, b, x))
    turn = 1 if beta > 0 else -1
    inside = turn * (u0[0] * u[1] - u0[1] * u[0]) >= 0 and turn * (u[0] * u1[1] - u[1] * u1[0]) >= 0
    return abs(root(u[0] ** 2 + u[1] ** 2) - root(u0[0] ** 2 + u0[1] ** 2)) if inside else ends


def arcs_of(curve, share):
    low, high = (np.asarray(x) for x in curve.bounds)
    tolerance = max(share * float(np.hypot(*(high - low))), 1.01 * least_tolerance(curve), 1e-300)
    return biarcs(curve, tolerance), tolerance


def check_pieces(curve, arcs, most, samples):
    segments = curve.segments()
    control_points = np.asarray(segments.control_points)
    weights = np.ones(control_points.shape[:2]) if segments.weights is None else np.asarray(segments.weights)
    start, end, bulge, t0, t1, deviation = (
        np.asarray(x) for x in (arcs.start, arcs.end, arcs.bulge, arcs.t0, arcs.t1, arcs.deviation)
    )
    with localcontext() as context:
        context.prec = 60
        for k in np.random.default_rng(0).permutation(arcs.count)[:most]:
            segment = int(arcs.segment[k])
            for share in np.linspace(0, 1, samples):
                t = np.clip(t0[k] + share * (t1[k] - t0[k]), t0[k], t1[k])
                x = exact_point(control_points[segment], weights[segment], t)
                assert exact_distance(x, start[k], end[k], bulge[k]) <= Decimal(float(deviation[k])), (k, t)


@pytest.mark.parametrize("share", swept([1e-4, 0.3], 1))
@pytest.mark.parametrize("name", CASES)
def test_points_of_a_piece_are_within_the_deviation_of_its_arc(name, share):
    arcs, tolerance = arcs_of(CASES[name], share)
    assert float(arcs.deviation.max()) <= tolerance
    check_pieces(CASES[name], arcs, 6, 5)


@pytest.mark.parametrize("seed", swept(range(30), 0, 2))
def test_deviations_hold_on_random_curves(seed):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(2, rng.integers(3, 8), 2)) * 10.0 ** rng.integers(-3, 3, size=2)
    weights = np.exp(3 * rng.normal(size=rows.shape[:2])) if seed % 2 else None
    curve = BezierSegments(rows + 1e6 * rng.normal(size=2) * (seed % 3 == 0), weights)
    for share in (1e-1, 1e-4, 1e-8):
        check_pieces(curve, arcs_of(curve, share)[0], 20, 17)


def deviation_of(curve, start, end, bulge):
    """The bound for one arc, of one's own choice, for each segment."""
    host, index = deviation.HostCurve.of(curve), np.arange(curve.count)
    arcs = deviation.HostArcs(index, 0.0 * index, 0.0 * index + 1, start @ [1, 1j], end @ [1, 1j], bulge, bulge)
    return deviation.deviation(host, deviation.pieces_of(host, arcs), bulge)


@pytest.mark.parametrize(
    ("fitted", "rational"), swept([(True, True), (False, False), (True, False), (False, True)], 1, 1)
)
def test_the_bound_holds_for_any_arc_and_any_piece(rational, fitted):
    """Ends that miss, bulges that do not fit, pieces that turn back: both directions, by samples less their spacing."""
    rng, count = np.random.default_rng(11), 300
    rows = np.stack([np.linspace(0, 1, 4), np.zeros(4)], axis=-1)
    rows = rows + rng.normal(size=(count, 4, 2)) * 10.0 ** rng.uniform(-4, 0.3, size=(count, 1, 1))
    curve = BezierSegments(rows, np.exp(rng.normal(size=(count, 4))) if rational else None)
    off = rng.normal(size=(2, count, 2)) * 10.0 ** rng.uniform(-9, -1, size=(2, count, 1))
    start, end = rows[:, 0] + off[0], rows[:, -1] + off[1]
    bulge = rng.uniform(-0.5, 0.5, count) * 10.0 ** rng.uniform(-6, 0, count)
    x, a, v = (y @ [1, 1j] for y in (np.asarray(curve.point(np.arange(count)[:, None], T)), start, end - start))
    if fitted:
        bulge = np.clip(-2 * np.imag((x[:, 200] - a - v / 2) / v), -0.5, 0.5)
    bound = deviation_of(curve, start, end, bulge)
    # From one end to the other by equal angles.
    angle = 2 * np.arctan(bulge)[:, None]
    share = np.where(angle == 0, T[::2], np.sin(angle * T[::2]) / np.where(angle == 0, 1, np.sin(angle)))
    y = a[:, None] + v[:, None] * share * np.exp(1j * angle * (T[::2] - 1))
    np.testing.assert_allclose(y[:, -1], end @ [1, 1j])
    apart = np.abs(x[:, :, None] - y[:, None, :])
    there = apart.min(axis=2).max(axis=1) - np.abs(np.diff(y)).max(axis=1) / 2
    back = apart.min(axis=1).max(axis=1) - np.abs(np.diff(x)).max(axis=1) / 2
    assert np.all(np.maximum(there, back) <= bound)
    assert np.mean(np.maximum(there, back) > 0.5 * bound) > 0.1


def test_a_piece_that_passes_the_center_is_as_far_as_it_goes():
    """From a short arc about the origin to the other side of the circle and back: the radial distance misses that."""
    half = 0.01
    start, end = [np.cos(half), -np.sin(half)], [np.cos(half), np.sin(half)]
    curve = BezierSegments([[start, [-3, 0], end]]).elevate(12)
    assert deviation_of(curve, np.array([start]), np.array([end]), np.array([np.tan(half / 2)]))[0] >= 1.99


def test_in_single_precision_the_deviation_counts_its_rounding():
    for shift in (0, 100):
        curve = BezierSegments(CUBIC + shift)
        single = eqx.tree_at(lambda c: c.control_points, curve, curve.control_points.astype(jnp.float32))
        arcs = biarcs(single, 1.01 * least_tolerance(single))
        assert all(getattr(arcs, name).dtype == jnp.float32 for name in ("start", "bulge", "t0", "deviation"))
        check_pieces(single, arcs, 30, 5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["rational", "to and fro", "cubic", "cusp elsewhere", "closed", "mixed"])
def test_the_hausdorff_distance_of_curve_and_arcs_is_at_most_the_deviation(name):
    curve = CASES[name]
    arcs, _ = arcs_of(curve, 1e-2)
    # Where they coincide the search may not close its bounds; they hold.
    found = hausdorff(curve, arcs.segments(), throw=False)
    assert float(found.lower) <= float(arcs.deviation.max()) + ROUNDING


@pytest.mark.parametrize("name", swept(["cubic", "rational", "quintics", "inflection"], 1, 1))
def test_each_arc_and_its_piece_are_within_the_deviation_in_both_directions_and_not_much_nearer(name):
    curve = CASES[name]
    arcs, _ = arcs_of(curve, 1e-3)
    conics, share = arcs.segments(), []
    for k in range(0, arcs.count, arcs.count // 3):
        row = [int(arcs.segment[k])]
        own = None if curve.weights is None else np.asarray(curve.weights)[row]
        whole = reference.homogeneous(np.asarray(curve.control_points)[row], own)
        arc = np.asarray(conics.control_points)[[k]], np.asarray(conics.weights)[[k]]
        rows = reference.restrict(whole, np.asarray(arcs.t0)[[k]], np.asarray(arcs.t1)[[k]])
        piece = rows[..., :2] / rows[..., 2:], rows[..., 2]
        found = reference.hausdorff(piece, arc, accuracy=1e-9)
        assert found <= float(arcs.deviation[k]) + ROUNDING
        share.append(found / float(arcs.deviation[k]))
    assert np.median(share) > 0.8


@pytest.mark.parametrize("name", CASES)
def test_the_pieces_cover_every_segment_without_a_gap(name):
    curve = CASES[name]
    arcs, _ = arcs_of(curve, 1e-4)
    segment, t0, t1, start, end = (np.asarray(x) for x in (arcs.segment, arcs.t0, arcs.t1, arcs.start, arcs.end))
    control_points = np.asarray(curve.control_points)
    for k in range(curve.count):
        mine = segment == k
        assert t0[mine][0] == 0 and t1[mine][-1] == 1
        np.testing.assert_array_equal(t0[mine][1:], t1[mine][:-1])
        assert np.all(t0[mine] < t1[mine])
        np.testing.assert_array_equal(start[mine][1:], end[mine][:-1])
        np.testing.assert_array_equal(start[mine][0], control_points[k, 0])
        np.testing.assert_array_equal(end[mine][-1], control_points[k, -1])


def test_arcs_follow_each_other_as_the_segments_do():
    curve = BezierSegments.join([circle([0, 0], 1), polyline([[3, 0], [4, 0], [4, 1]])])
    arcs = biarcs(curve, 1e-3)
    assert arcs.next_segment.tolist() == [1, 2, 3, 4, 5, 6, 7, 0, 9, -1]
    assert arcs.segments().next_segment.tolist() == arcs.next_segment.tolist()


def turns(arcs):
    """Angles between the end of each arc and the start of the one that follows."""
    next_segment = np.asarray(arcs.next_segment)
    tangents = np.asarray(arcs.tangents) @ [1, 1j]
    there = next_segment >= 0
    return np.abs(np.angle(tangents[next_segment[there], 0] / tangents[there, 1]))


@pytest.mark.parametrize("share", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("curve", [spline(30), spline(12), circle([1, 2], 3)], ids=["30", "12", "circle"])
def test_arcs_of_a_smooth_curve_join_smoothly(curve, share):
    arcs, _ = arcs_of(curve, share)
    assert turns(arcs).max() < SMOOTH


def test_corners_stay():
    square = polyline([[0, 0], [1, 0], [1, 1], [0, 1]], closed=True)
    arcs = biarcs(square, 1e-3)
    assert arcs.count == 4
    np.testing.assert_allclose(turns(arcs), np.pi / 2)


def test_the_number_of_arcs_grows_with_the_cube_root_of_the_tolerance():
    curve = spline(30)
    low, high = (np.asarray(x) for x in curve.bounds)
    diagonal = float(np.hypot(*(high - low)))
    counts = [biarcs(curve, share * diagonal).count for share in (1e-4, 1e-5, 1e-8)]
    assert counts[0] <= 100
    # Ten for a thousandth; halving by halves moves it by a few percent.
    assert 9 < counts[2] / counts[1] < 11


def test_the_arcs_of_a_circle_lie_on_it():
    arcs = biarcs(circle([3, 4], 5), 1e-9)
    assert arcs.count == 8
    np.testing.assert_allclose(arcs.radius, 5, rtol=1e-13)
    np.testing.assert_allclose(arcs.center, np.tile([3, 4], (8, 1)), rtol=1e-12)
    np.testing.assert_allclose(arcs.sweep, np.pi / 4, rtol=1e-9)
    np.testing.assert_allclose(arcs.curvature, 0.2, rtol=1e-13)


@pytest.mark.parametrize("shift", [1e3, 1e8])
def test_a_circle_whose_points_are_rounded_takes_no_more_arcs(shift):
    assert biarcs(circle([shift, -shift], 1), 1e-6).count == 8


def test_points_and_lines_are_themselves():
    arcs = biarcs(CASES["straight"], 1e-3)
    assert (arcs.count, float(arcs.bulge[0]), float(arcs.radius[0])) == (1, 0, np.inf)
    arcs = biarcs(CASES["folded"], 1e-3)
    assert arcs.count == 2 and not np.any(arcs.bulge)
    arcs = biarcs(point_set([[1, 2], [3, 4]]), 1e-3)
    assert arcs.start.tolist() == arcs.end.tolist() == [[1, 2], [3, 4]]
    assert not np.any(arcs.deviation) and not np.any(arcs.curvature) and not np.any(arcs.tangents)
    assert biarcs(CASES["point"], 1e-3).count == 1


def test_a_cusp_costs_arcs_with_the_logarithm_of_the_tolerance():
    curve = CASES["cusp elsewhere"]
    shares = (1e-3, 1e-4, 1e-5)
    steps = np.diff([arcs_of(curve, share)[0].count for share in shares])
    assert np.all(steps < [40, 80])


def test_scaling_by_a_power_of_two_and_a_quarter_turn_change_nothing():
    curve = CASES["rational"]
    arcs = biarcs(curve, 1e-4)
    scaled = biarcs(curve.transform(np.eye(2) * 2.0**70), 1e-4 * 2.0**70)
    turned = biarcs(curve.transform([[0, -1], [1, 0]]), 1e-4)
    for other, factor in ((scaled, 2.0**70), (turned, 1.0)):
        np.testing.assert_array_equal(other.segment, arcs.segment)
        np.testing.assert_allclose(other.t0, arcs.t0, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(other.bulge, arcs.bulge, rtol=0, atol=1e3 * ROUNDING)
        np.testing.assert_allclose(other.deviation / factor, arcs.deviation, rtol=1e-6, atol=ROUNDING)


@pytest.mark.parametrize("angle", [0.1, 1.0, 2.0])
def test_a_rotation_hardly_changes_the_arcs(angle):
    curve, c, s = spline(12), np.cos(angle), np.sin(angle)
    count = biarcs(curve, 1e-4).count
    assert biarcs(curve.transform([[c, -s], [s, c]], [5, 6]), 1e-4).count == count


def test_the_rational_segments_are_the_arcs():
    arcs = biarcs(CASES["loop"], 1e-2)
    segments = arcs.segments()
    assert float(np.min(np.asarray(segments.weights))) >= 0.6 and float(np.abs(arcs.bulge).max()) <= 0.5
    middle, start, end = (np.asarray(x) for x in (segments.point(np.arange(arcs.count), 0.5), arcs.start, arcs.end))
    np.testing.assert_allclose(np.hypot(*(middle - np.asarray(arcs.center)).T), arcs.radius, rtol=1e-11)
    # The middle of the arc is off the chord, to the right where it turns left, by the bulge times half the chord.
    right = np.stack([(end - start)[:, 1], -(end - start)[:, 0]], axis=1)
    expected = (start + end) / 2 + 0.5 * np.asarray(arcs.bulge)[:, None] * right
    np.testing.assert_allclose(middle, expected, rtol=0, atol=1e-14)


def test_a_tolerance_above_all_lengths_takes_one_arc():
    assert biarcs(BezierCurve([(0, 0), (1, 2), (2, 0)]), 1.7e308).count == 1


def test_what_cannot_be_approximated_is_refused(as_a_user):
    curve = CASES["cubic"]
    with pytest.raises(TypeError, match="curve must be a curve"):
        biarcs(3.0, 1e-3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="curve has 3 coordinates a point; biarcs needs 2"):
        biarcs(BezierSegments(np.zeros((1, 3, 3))), 1e-3)
    for tolerance in (0.0, -1.0, 1e-18):
        with pytest.raises(ValueError, match=r"tolerance is .*; needs (at least|one positive number)"):
            biarcs(curve, tolerance)
    for tolerance in (np.nan, np.inf):
        with pytest.raises(ValueError, match="tolerance is not finite"):
            biarcs(curve, tolerance)
    with pytest.raises(ValueError, match=r"tolerance is \[.*\]; needs one positive number"):
        biarcs(curve, [1e-3, 1e-3])
    with pytest.raises(TypeError, match="concrete control points"):
        jax.jit(lambda p: biarcs(BezierSegments(p), 1e-3).start)(CUBIC)
    with pytest.raises(TypeError, match="concrete curve and tolerance"):
        jax.jit(lambda x: biarcs(curve, x).start)(1e-3)


def test_a_jump_between_neighboring_parameters_is_reported_with_the_arcs():
    """The last point counts only beyond the last parameter below one."""
    curve = BezierSegments([[[0, 0], [1, 1], [9, 0]]], [[1, 1e-25, 1e-50]])
    with pytest.raises(NotProvenError, match="too uneven") as raised:
        biarcs(curve, 1e-3)
    arcs = raised.value.solution
    assert float(arcs.deviation.max()) > 1e-3
    check_pieces(curve, arcs, 50, 3)
