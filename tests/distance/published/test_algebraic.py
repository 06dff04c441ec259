"""All candidate events by the solver: values against the table, no root lost, what is refused and what is left open."""

import math
from typing import Any

import jax
import numpy as np
import pytest

import jhd
from jhd._distance.normalization.curves import prepare
from jhd._distance.published.events import forms as event_forms
from jhd._distance.published.events import host_pair
from jhd._distance.published.events import survivors as event_survivors
from jhd._distance.published.events import systems as event_systems
from jhd._results.solution import name_of
from tests.cases import CASES
from tests.distance import pairs
from tests.sweeps import swept

# What all methods promise of their values, in diagonals.
PROMISED = 1e-9
# Both places of an event are found to about 1e-12; a grid of this step tells events apart.
STEPS = 300
# A dozen pairs of every kind, all in the same few compiled programs; the whole table is slow.
QUICK = (
    "points_to_segment roof_over_segment wave_over_line loop_and_cusp across_evolute "
    "between_two_arches foot_and_end_of_hook end_and_end_of_horseshoe b_end_at_corner a_end_of_wave corner_of_polyline "
    "degrees_3_and_3 cusp_over_chord"
).split()
QUICK_WAYS = [(name, "ab" if k % 3 else "ba") for k, name in enumerate(QUICK)]
# Pairs with curves of roots that reach as far as the distance itself: parallel, coincident or symmetric pieces.
CONTINUA = (
    "parallel_segments crossing_segments hook letter_contours identical_wave reversed_wave elevated_wave halved_wave "
    "identical_loop identical_cusp identical_spline_12 part_of_a_wave wave_and_its_part segment_folded shifted_spline "
    "loop_and_cusp cusp_and_loop evolute_of_parabola loop_far_hundred_million parabola_and_shifted"
).split()


def plane_polynomials():
    return [c for c in CASES if c.a.weights is None and c.b.weights is None and c.a.control_points.shape[2] == 2]


def parameters(*more):
    """Pairs of a name and a direction; of those that are not quick each tag once, and further ones, are slow."""
    cases = plane_polynomials()
    slow = {*pairs.of_each_tag([case for case in cases if pairs.is_quick(case)]), *more}
    ways = [(case.name, way) for case in cases for way in ("ab", "ba")]
    return swept(ways, QUICK_WAYS, [(name, "ab") for name in slow])


def curves(name, direction):
    a, b, _ = pairs.in_order(name, direction)
    return pairs.curve(a), pairs.curve(b)


def random_pair(seed):
    """Chains of one to three cubics with corners or without, on a grid, so that symmetric accidents occur."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(2):
        count = rng.integers(1, 4)
        rows = rng.integers(-16, 17, size=(3 * count + 1, 2)) / 8
        if rng.random() < 0.5:
            for k in range(1, count):
                rows[3 * k + 1] = 2 * rows[3 * k] - rows[3 * k - 1]
        made.append(jhd.BezierSegments(np.stack([rows[3 * k : 3 * k + 4] for k in range(count)])))
    return made[0], made[1]


def spline_pair(count, seed=0):
    """Two close cubic B-splines of so many control points: one bumped at one place, both perturbed."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 1.94 * np.pi, count)
    radius = 4 + 0.9 * np.sin(3 * angle)
    a = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    b = a + 0.06 * rng.normal(size=a.shape)
    b[count // 3] *= 1.35
    return jhd.BSplineCurve.clamped(a), jhd.BSplineCurve.clamped(b)


def check_against_branch_and_bound(a, b, method):
    check_within(jhd.directed_hausdorff(a, b, method, throw=False), jhd.directed_hausdorff(a, b), a, b)


def check_within(ours, proven, a, b):
    """Whether a solution lies within proven bounds."""
    corners = np.concatenate([np.asarray(x.bounds) for x in (a, b)])
    accuracy = PROMISED * float(np.linalg.norm(np.ptp(corners, axis=0)))
    assert float(proven.lower) - accuracy <= float(ours) <= float(proven.upper) + accuracy
    assert 0 <= ours.lower <= min(ours.value, proven.upper)


@pytest.mark.parametrize(("name", "direction"), parameters("degrees_1_and_10"))
def test_values_agree_with_the_table_and_lie_in_its_bounds(name, direction):
    solution = jhd.directed_hausdorff(*curves(name, direction), jhd.published.AlgebraicEvents(), throw=False)
    lower, upper = pairs.bounds(pairs.in_order(name, direction)[2])
    accuracy = PROMISED * pairs.diagonal(name)
    assert float(lower) - accuracy <= float(solution) <= float(upper) + accuracy
    assert 0 <= float(solution.lower) <= upper and solution.lower <= solution.value
    assert solution.upper == np.inf
    assert name_of(solution.result) == "successful" or name in CONTINUA


@pytest.mark.parametrize("seed", swept(range(46), quick=range(2)))
def test_random_chains_agree_with_branch_and_bound(seed):
    a, b = random_pair(seed)
    check_against_branch_and_bound(a, b, jhd.published.AlgebraicEvents())


@pytest.mark.parametrize("name", swept(QUICK[3:], slow=QUICK[3:4]))
def test_all_four_methods_agree(name):
    a, b = curves(name, "ab")
    methods = (
        jhd.published.AlgebraicEvents(),
        jhd.published.BiarcTrimming(),
        jhd.published.TwoStep(),
        jhd.BranchAndBound(),
    )
    values = [float(jhd.directed_hausdorff(a, b, method, throw=False)) for method in methods]
    assert max(values) - min(values) <= PROMISED * pairs.diagonal(name)


# ---- the solver loses no root --------------------------------------------------------------------


def solved(a, b):
    """The pair for the solver, and all boxes of its systems."""
    pair = host_pair.HostPair.of(*prepare(jhd.BezierSegments(a), jhd.BezierSegments(b))[:2])
    count = pair.a.moving
    whole = np.broadcast_to([[0.0], [1.0]], (2, count))
    pieces = event_survivors.EventPieces(np.arange(count), whole, np.broadcast_to([[0.0], [np.inf]], (2, count)))
    feet = event_survivors.everywhere(pair.b, count)
    kept = event_survivors.survivors(pair.a, pair.b, pieces, feet)
    antipodal = event_survivors.pairs(pieces, kept)
    groups = [[antipodal, *triple] for triple in event_survivors.triples(pair.b, pieces, kept)]
    found = [event_systems.solve(pair.a, pair.b, g, box_size=1e-8, limit=256, max_boxes=10**6) for g in groups]
    return pair, found


def polynomial(coefficients) -> Any:
    """From Bernstein coefficients."""
    n = len(coefficients) - 1
    t, rest = np.polynomial.Polynomial([0, 1]), np.polynomial.Polynomial([1, -1])
    parts = [math.comb(n, k) * float(c) * t**k * rest ** (n - k) for k, c in enumerate(coefficients)]
    return sum(parts[1:], parts[0])


def power(rows):
    """Both coordinates of a segment as polynomials."""
    return [polynomial(rows[:, d]) for d in (0, 1)]


def critical_points(point, b):
    """Stationary parameters of the distance to each segment of b inside it, and the squared distances."""
    found = []
    for k, rows in enumerate(b):
        offset = [f - x for f, x in zip(power(rows), point, strict=True)]
        slope = offset[0] * offset[0].deriv() + offset[1] * offset[1].deriv()
        roots = slope.roots()
        inner = np.sort(roots[(abs(roots.imag) < 1e-9) & (roots.real > 1e-6) & (roots.real < 1 - 1e-6)].real)
        found += [(k, s, sum(f(s) ** 2 for f in offset)) for s in inner]
    return found


def crossings(a, b):
    """Intervals of t in which two stationary distances change places, with the segments and parameters of both."""
    f = power(a[0])
    previous, found = None, []
    for t in (np.arange(STEPS) + 0.5) / STEPS:
        now = critical_points([f[0](t), f[1](t)], b)
        if previous is not None and [k for k, *_ in now] == [k for k, *_ in previous]:
            for i in range(len(now)):
                for j in range(i + 1, len(now)):
                    before, after = (x[i][2] - x[j][2] for x in (previous, now))
                    # Next to a fold two branches are one, and rounding decides which is which.
                    if before * after < 0 and abs(before) > 1e-9 and abs(after) > 1e-9:
                        found.append((t, now[i][:2], now[j][:2]))
        previous = now
    return found


QUICK_CROSSINGS = [(1, 17), (2, 10), (2, 19)]


@pytest.mark.parametrize(
    ("segments", "seed"),
    swept(
        [*QUICK_CROSSINGS, *((k, seed) for k in (1, 2) for seed in (*range(4, 44, 8), 35, 47))],
        QUICK_CROSSINGS[:1],
        QUICK_CROSSINGS[1:],
    ),
)
def test_every_crossing_of_two_stationary_distances_is_a_root(segments, seed):
    rng = np.random.default_rng(seed)
    a = rng.uniform(-1, 1, size=(1, 4, 2))
    rows = rng.uniform(-1, 1, size=(3 * segments + 1, 2))
    if segments == 2:
        rows[4] = 2 * rows[3] - rows[2]
    b = np.stack([rows[3 * k : 3 * k + 4] for k in range(segments)])
    expected = crossings(a, b)
    _, found = solved(a, b)
    segment = np.concatenate([x.segment for x in found], axis=1)
    middle = np.concatenate([x.box.mean(axis=1) for x in found], axis=1)
    for t, (k, r), (m, s) in expected:
        at = abs(middle[0] - t) < 2 / STEPS
        hits = [
            at & (segment[1] == k1) & (segment[2] == k2) & (abs(middle[1] - s1) + abs(middle[2] - s2) < 0.1)
            for k1, s1, k2, s2 in ((k, r, m, s), (m, s, k, r))
        ]
        assert np.any(hits), (t, k, r, m, s)
    assert expected or (segments, seed) not in QUICK_CROSSINGS


def test_antipodal_roots_solve_both_equations_and_are_all_there():
    rng = np.random.default_rng(5)
    a, b = rng.uniform(-1, 1, size=(2, 1, 4, 2))
    _, found = solved(a, b)
    events = [x for x in found if x.segment.shape[1]][0]
    rows = np.flatnonzero((events.segment[1] == events.segment[2]) & (events.box[1] == events.box[2]).all(axis=0))
    moving = rows[events.segment[1, rows] == 0]
    f, g = power(a[0]), power(b[0])
    expected = set()
    for start in np.ndindex(8, 8):
        y = np.array(start) / 7
        residual = np.ones(2)
        for _ in range(20):
            c, da, dda = (np.array([p.deriv(k)(y[0]) if k else p(y[0]) for p in f]) for k in range(3))
            foot, db, ddb = (np.array([p.deriv(k)(y[1]) if k else p(y[1]) for p in g]) for k in range(3))
            c = c - foot
            residual = np.array([c @ da, c @ db])
            y = y - np.linalg.solve([[da @ da + c @ dda, -db @ da], [da @ db, -db @ db + c @ ddb]], residual)
        if np.all((y > 1e-6) & (y < 1 - 1e-6)) and abs(residual).sum() < 1e-12:
            expected.add(tuple(np.round(y, 6)))
    ours = {tuple(np.round(events.box[:2, :, k].mean(axis=1), 6)) for k in moving}
    assert len(expected) >= 2
    for y in expected:
        assert any(abs(y[0] - x[0]) + abs(y[1] - x[1]) < 1e-5 for x in ours)


def test_divided_differences_have_the_sheet_divided_out():
    """h'[r, s] and h[r, r, s, s] against their definitions."""
    rng = np.random.default_rng(3)
    slope = rng.normal(size=6)  # Bernstein coefficients of h', degree 5
    f = polynomial(slope)
    h = f.integ()
    form = event_forms.EventForm(slope[None, :, None], np.zeros(1))
    whole = np.array([[0.0], [1.0]])
    for r, s in ((0.1, 0.7), (0.4, 0.45), (0.0, 1.0)):
        first = (f(s) - f(r)) / (s - r)
        mean = (h(s) - h(r)) / (s - r)
        second = (f(r) + f(s) - 2 * mean) / (s - r) ** 2
        for order, expected in ((1, first / 5), (2, second / 5 / 4 * 6)):
            table = event_systems._divided(form, order, [whole, whole]).c[0, :, :, 0]
            m = len(table) - 1
            basis = [[math.comb(m, i) * x**i * (1 - x) ** (m - i) for i in range(m + 1)] for x in (r, s)]
            assert np.array(basis[0]) @ table @ np.array(basis[1]) == pytest.approx(expected, abs=1e-10)


# ---- joints, ends, scales ------------------------------------------------------------------------


def test_two_feet_at_an_end_and_on_its_own_segment_are_found():
    """The hook's end and a place on the same segment are equally near: the trivial root at the end hides nothing."""
    a, b = curves("foot_and_end_of_hook", "ab")
    solution = jhd.directed_hausdorff(a, b, jhd.published.AlgebraicEvents())
    assert name_of(solution.event) == "one_to_two"
    assert {0.0, 1.0} & set(np.asarray(solution.witness.feet_params).tolist())


@pytest.mark.parametrize("scale", [1e150, 1e-150])
def test_huge_and_tiny_curves(scale):
    a, b = curves("degrees_3_and_3", "ab")
    known = float(jhd.directed_hausdorff(a, b, jhd.published.AlgebraicEvents()))
    big, other = (jhd.BezierSegments(np.asarray(x.control_points) * scale) for x in (a, b))
    assert float(jhd.directed_hausdorff(big, other, jhd.published.AlgebraicEvents())) == pytest.approx(
        known * scale, rel=1e-12
    )


def test_smooth_joints_cost_few_boxes():
    a, b = (x.segments() for x in spline_pair(15))
    _, found = solved(a.control_points, b.control_points)
    # 3420; without the test of monotony 4524.
    assert sum(x.boxes for x in found) < 4000


def test_isolated_points_are_ends():
    a, b = jhd.point_set([[0.0, 0.0], [3.0, 0.0]]), jhd.point_set([[0.0, 1.0], [1.0, 0.0]])
    solution = jhd.directed_hausdorff(a, b, jhd.published.AlgebraicEvents())
    assert float(solution) == 2.0 and int(solution.witness.element) == 1
    assert int(solution.stats["boxes"]) == 0


@pytest.mark.slow
def test_the_gradient_is_that_of_the_default():
    a, b = curves("degrees_3_and_3", "ab")

    def value(points, method):
        return jhd.directed_hausdorff(jhd.BezierSegments(points), b, method).value

    ours, theirs = (
        jax.grad(value)(a.control_points, m) for m in (jhd.published.AlgebraicEvents(), jhd.BranchAndBound())
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


# ---- curves of roots and limits ------------------------------------------------------------------


def test_curves_of_roots_are_reported_as_intervals_and_not_as_roots():
    a, b = jhd.polyline([[0, 0], [4, 0]]), jhd.polyline([[0, 1], [4, 1]])
    method = jhd.published.AlgebraicEvents()
    with pytest.raises(jhd.NotProvenError):
        jhd.directed_hausdorff(a, b, method)
    solution = jhd.directed_hausdorff(a, b, method, throw=False)
    assert name_of(solution.result) == "gap_not_closed"
    assert float(solution) == 1.0 == float(jhd.directed_hausdorff(a, b, method, throw=False).lower.round(12))
    stats = {key: float(x) for key, x in solution.stats.items()}
    assert stats["unresolved"] > 100 and stats["roots"] < 10
    assert 0.9 < stats["unresolved_lower"] <= 1 <= stats["unresolved_upper"] < 1.1


def test_the_width_of_unresolved_boxes_follows_the_capacity():
    a, b = jhd.polyline([[0, 0], [4, 0]]), jhd.polyline([[0, 1], [4, 1]])
    gaps = []
    for capacity in (64, 512):
        stats = jhd.directed_hausdorff(a, b, jhd.published.AlgebraicEvents(capacity=capacity), throw=False).stats
        gaps.append(float(stats["unresolved_upper"]) - 1)
    assert 0 < gaps[1] < gaps[0] / 4


@pytest.mark.parametrize("method", [jhd.published.AlgebraicEvents(), jhd.published.BiarcTrimming()])
def test_curves_that_nearly_coincide_keep_their_digits(method):
    """One control point moved by a millionth: nearly a curve of roots, whose boxes are no events."""
    a = np.array([[[0.125, -1.5], [1.0, 0.5], [-0.25, 1.5], [2.0, 1.0]]])
    b = a.copy()
    b[0, 1, 1] += 1e-6
    check_against_branch_and_bound(jhd.BezierSegments(a), jhd.BezierSegments(b), method)


def test_a_limit_of_boxes_ends_the_search_with_what_it_has():
    a, b = curves("degrees_3_and_3", "ab")
    solution = jhd.directed_hausdorff(a, b, jhd.published.AlgebraicEvents(max_boxes=20), throw=False)
    assert name_of(solution.result) == "capacity_reached"
    assert int(solution.stats["boxes"]) <= 20
    assert 0 < solution.lower <= jhd.directed_hausdorff(a, b).upper


# ---- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize("method", [jhd.published.AlgebraicEvents(), jhd.published.BiarcTrimming()])
def test_what_the_systems_are_not_made_for_is_refused(method):
    line = jhd.polyline([[0, 0], [1, 0]])
    with pytest.raises(TypeError, match="rational"):
        jhd.directed_hausdorff(line, jhd.circle([0, 0], 1), method)
    with pytest.raises(TypeError, match="plane"):
        in_space = jhd.polyline([[0, 0, 0], [1, 0, 1]])
        jhd.directed_hausdorff(in_space, in_space, method)
    with pytest.raises(TypeError, match="concrete control points"):
        jax.jit(lambda x: jhd.directed_hausdorff(jhd.BezierSegments(x), line, method).value)(line.control_points)


def test_weights_that_are_all_equal_change_nothing():
    a, b = curves("degrees_3_and_3", "ab")
    heavy = jhd.BezierSegments(b.control_points, np.full(b.control_points.shape[:2], 3.0))
    values = [float(jhd.directed_hausdorff(a, x, jhd.published.AlgebraicEvents())) for x in (b, heavy)]
    assert values[0] == pytest.approx(values[1], rel=1e-14)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"box_size": -1.0}, "box_size is -1"),
        ({"box_size": [1.0]}, "box_size has shape"),
        ({"box_size": np.nan}, "box_size is not finite"),
        ({"capacity": 3}, "capacity is 3; needs"),
        ({"max_boxes": -1}, "max_boxes is -1; needs"),
        ({"capacity": 2.5}, "capacity is 2.5; needs"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message, as_a_user):
    for method in (jhd.published.AlgebraicEvents, jhd.published.BiarcTrimming):
        with pytest.raises(ValueError, match=message):
            method(**options)
