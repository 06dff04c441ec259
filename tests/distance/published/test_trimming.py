"""Biarcs and trimming: the same values, fewer boxes, and never the place of the maximum removed."""

import importlib
import itertools
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import jhd
from jhd._distance.normalization.coordinates import reported
from jhd._distance.normalization.curves import prepare
from jhd._distance.published import algebraic, arc_bounds, farthest, printed_trimming, trimming
from jhd._distance.published.events import candidates as event_candidates
from jhd._distance.published.events import host_pair
from jhd._distance.published.events import survivors as event_survivors
from jhd._results.solution import name_of
from jhd._shapes.deviation import HostArcs
from tests.distance import pairs
from tests.distance.published.test_algebraic import (
    CONTINUA,
    PROMISED,
    check_against_branch_and_bound,
    check_within,
    curves,
    parameters,
    random_pair,
    spline_pair,
)
from tests.sweeps import swept

kim10: Any = importlib.import_module("experiments.common_kim10")
# Points on a curve piece for the bound of an arc; the bound must hold at each.
SAMPLES = 33


def by_hand(a, b, wanted=None):
    """What the method does, one step after the other: the solution, the pair and what was left."""
    p, q, frame = prepare(a, b)
    pair = host_pair.HostPair.of(p, q)
    arcs = trimming.both_arcs(pair, trimming.arc_deviation(pair, wanted, frame))
    left = trimming.trimmed(pair, arcs[0], arcs[1], -np.inf)
    search = event_candidates.Search(algebraic.final_size(None, frame), 256, 2**23)
    candidates, stats = event_candidates.candidate_events(pair, left.pieces, search, left.feet)
    upper = trimming.upper_bound(pair, left)
    found = reported(frame, farthest.best_of(pair, candidates, left.best, stats, search, frame, upper=upper))
    return found, pair, left


def check_that_the_maximum_is_kept(a, b, wanted=None):
    """The place that branch and bound proves to be the farthest is kept, with its feet; the value is in its bounds."""
    proven = jhd.directed_hausdorff(a, b)
    solution, pair, left = by_hand(a, b, wanted)
    check_within(solution, proven, a, b)
    assert proven.lower <= solution.upper < np.inf
    check_kept(proven.witness, pair, left)


def check_kept(witness, pair, left):
    """Whether the place is in a piece whose parts of b hold the feet; places and feet may be ends of segments."""
    segment, t = int(witness.element), float(witness.t)
    pieces, feet = left.pieces, left.feet
    kept = (pair.first.index[pieces.segment] == segment) & around(pieces.side, t)
    assert kept.any() or min(t, 1 - t) < 1e-9
    for foot, s in zip(np.asarray(witness.feet_elements), np.asarray(witness.feet_params), strict=True):
        at = pair.second.index[feet.segment] == foot
        assert not kept.any() or np.any(kept[feet.piece] & at & around(feet.side, s)) or min(s, 1 - s) < 1e-9


def around(side, t):
    return (side[0] <= t + 1e-9) & (t - 1e-9 <= side[1])


@pytest.mark.parametrize(("name", "direction"), parameters())
def test_values_agree_with_the_table_and_the_maximum_is_kept(name, direction):
    a, b = curves(name, direction)
    solution, pair, left = by_hand(a, b)
    lower, upper = pairs.bounds(pairs.in_order(name, direction)[2])
    accuracy = PROMISED * pairs.diagonal(name)
    assert float(lower) - accuracy <= float(solution) <= float(upper) + accuracy
    assert 0 <= Fraction(float(solution.lower)) <= upper and solution.lower <= solution.value
    assert upper <= Fraction(float(solution.upper)) and solution.upper < np.inf
    assert name_of(solution.result) == "successful" or name in CONTINUA
    # Of coincident and parallel curves any place may be named as the farthest.
    if name not in CONTINUA and a.degree > 0:
        check_kept(jhd.directed_hausdorff(a, b).witness, pair, left)


@pytest.mark.parametrize("seed", range(8))
def test_random_chains_agree_and_keep_their_maximum(seed):
    check_that_the_maximum_is_kept(*random_pair(seed))


@pytest.mark.parametrize("block", swept(range(30), slow=[0]))
def test_three_hundred_random_chains_agree_and_keep_their_maximum(block):
    for seed in range(10 * block, 10 * block + 10):
        check_that_the_maximum_is_kept(*random_pair(seed), wanted=(None, 1e-3, 0.1)[seed % 3])


@pytest.mark.parametrize("deviation", swept([1e-1, 1e-2, 1e-3, 1e-5], slow=[1e-1, 1e-5]))
def test_the_deviation_of_the_arcs_changes_no_value(deviation):
    for seed in range(6):
        a, b = random_pair(seed)
        check_against_branch_and_bound(a, b, jhd.published.BiarcTrimming(deviation=deviation))
        check_against_branch_and_bound(b, a, jhd.published.BiarcTrimming(deviation=deviation))


# ---- the bound of an arc -------------------------------------------------------------------------


def random_arcs(rng, count):
    """Arcs of all sizes and sweeps, lines and points among them; deviations 0, pieces of the curve are the arcs."""
    start, step = rng.uniform(-1, 1, (2, count)), rng.normal(size=(2, count)) * 10.0 ** rng.uniform(-4, 0, count)
    step[:, rng.random(count) < 0.05] = 0
    bulge = rng.uniform(-0.5, 0.5, count) * 10.0 ** rng.uniform(-9, 0, count)
    bulge[rng.random(count) < 0.1] = 0
    return host_arcs(start[0] + 1j * start[1], (start + step)[0] + 1j * (start + step)[1], bulge)


def host_arcs(start, end, bulge):
    """Arcs of deviation 0."""
    zeros, index = np.zeros(len(bulge)), np.arange(len(bulge))
    return HostArcs(index, zeros, zeros + 1, start, end, bulge, zeros)


def arc_points(arcs, share):
    """Points at a share of the chord's rational parameter: exact circles up to rounding."""
    start, end, b = arcs.start, arcs.end, arcs.bulge
    apex = 0.5 * (start + end) - 1j * (end - start) * (b / (1 - b * b))
    weight = (1 - b * b) / (1 + b * b)
    u, v = 1 - share, share
    return (u * u * start + 2 * u * v * weight * apex + v * v * end) / (u * u + 2 * u * v * weight + v * v)


def test_the_bound_of_an_arc_holds_at_every_point_of_it():
    rng = np.random.default_rng(0)
    d, c = random_arcs(rng, 4000), random_arcs(rng, 4000)
    bound = arc_bounds.arc_reach(arc_bounds.arcs_of(d), arc_bounds.arcs_of(c))
    target = [arc_points(c, s) for s in np.linspace(0, 1, 4 * SAMPLES)]
    reached = np.zeros(4000)
    for share in np.linspace(0, 1, SAMPLES):
        x = arc_points(d, share)
        reached = np.maximum(reached, np.min([np.abs(x - y) for y in target], axis=0))
    # Points of c are sampled, so the distance is too large by less than a step.
    assert np.all(bound >= reached - np.abs(c.end - c.start) / SAMPLES)
    # And the bound is no luxury: it is close wherever d is small against its distance.
    small = (reached > 0.1) & (np.abs(d.end - d.start) < 0.01)
    assert np.median((bound / np.where(reached > 0, reached, 1))[small]) < 1.05


def test_the_counterexample_to_the_published_test_is_not_trimmed():
    """Control points within 1.195 of a circle of radius 100, an arc that reaches 1.445: it is above 1.2."""
    r_c, r_d, half = 100.0, 200.0, 10.0
    sagitta = lambda r, half=half: r - np.sqrt(r * r - half * half)  # noqa: E731
    dip = 1.4449 - (sagitta(r_c) - sagitta(r_d))
    # A little longer than d, whose control points are then in its wedge.
    c = one_arc(-11.0, 11.0, sagitta(r_c) - sagitta(r_c, 11.0), sagitta(r_c, 11.0))
    d = one_arc(-half, half, -dip, sagitta(r_d))
    middle_gap = dip + sagitta(r_c) - sagitta(r_d)
    bound = arc_bounds.arc_reach(arc_bounds.arcs_of(d), arc_bounds.arcs_of(c))[0]
    assert middle_gap == pytest.approx(1.4449, abs=1e-9)
    assert bound >= middle_gap - 1e-9 > 1.2
    # The published test lets it through.
    unsafe = printed_trimming.within_offset_unsafe(arc_bounds.arcs_of(d), arc_bounds.arcs_of(c), 1.2, 0.0)
    assert unsafe.tolist() == [True]


def one_arc(x0, x1, y, sagitta):
    """An arc that bends upward over its chord from (x0, y) to (x1, y)."""
    return host_arcs(np.array([x0 + 1j * y]), np.array([x1 + 1j * y]), np.array([-2 * sagitta / (x1 - x0)]))


@pytest.mark.parametrize("seed", swept(range(3), slow=[0]))
def test_the_bounds_hold_along_the_curve_itself(seed):
    """Every piece of a is as near to b as is claimed three times, by proven projections of points of the piece."""
    a, b = random_pair(seed)
    pair = host_pair.HostPair.of(*prepare(a, b)[:2])
    d, c = trimming.both_arcs(pair, 1e-3)
    d = d.take(np.flatnonzero(pair.first.moving[d.segment] >= 0))
    target = arc_bounds.ArcTarget(c)
    points = np.asarray(pair.stored[0].control_points) @ [1, 1j]
    cut = trimming._chords(points.T, d)
    bounds = [(d, target.coarse_reach(d)), (d, target.reach_by_quarters(d))]
    rng = np.random.default_rng(seed)
    for pieces, bound in [*bounds, (cut, target.reach(cut))]:
        t = pieces.t0 + rng.random((4, len(pieces.t0))) * (pieces.t1 - pieces.t0)
        for row in t:
            x = sum(w * points[pieces.segment, k] for k, w in enumerate(cubic(row)))
            distance = jhd.project(np.stack([x.real, x.imag], axis=1), pair.stored[1]).lower
            assert np.all(np.asarray(distance) <= bound)
    # Each is closer than the one before, by and large.
    means = [np.mean(bound[1]) for bound in bounds] + [np.mean(target.reach(cut))]
    assert means[0] > means[1] > means[2]


def cubic(t):
    u = 1 - t
    return u**3, 3 * u * u * t, 3 * u * t * t, t**3


# ---- what it saves -------------------------------------------------------------------------------


# Boxes that AlgebraicEvents examines for each box of BiarcTrimming, at least, by the number of control points.
RATIOS = {5: 20, 10: 20, 15: 20, 30: 50, 120: 50}
PAIRS = list(itertools.product(kim10.KINDS, kim10.COUNTS))


@pytest.mark.parametrize(("kind", "count"), swept(PAIRS, [x for x in PAIRS if x[1] == 5], [(kim10.KINDS[0], 30)]))
def test_trimming_examines_many_times_fewer_boxes(kind, count):
    a, b = kim10.pair(kind, count)
    deviation = 1e-4 * float(np.linalg.norm(np.ptp(np.concatenate([x.bounds for x in (a, b)]), axis=0)))
    methods = jhd.published.AlgebraicEvents(), jhd.published.BiarcTrimming(deviation=deviation)
    full, less = (jhd.hausdorff(a, b, method) for method in methods)
    assert abs(float(full) - float(less)) <= 1e-9
    assert name_of(less.event) == kim10.EVENTS[kind]
    boxes = [int(x.stats["a_to_b_boxes"]) for x in (full, less)]
    assert boxes[0] >= RATIOS[count] * max(boxes[1], 1)
    both = [boxes[k] + int(x.stats["b_to_a_boxes"]) for k, x in enumerate((full, less))]
    assert both[0] >= RATIOS[count] * max(both[1], 1)
    assert 0.9 < float(less.stats["a_to_b_trimmed"]) <= 1
    assert float(less.upper) <= float(less) + 8 * deviation


@pytest.mark.parametrize(
    ("kind", "count"),
    swept(PAIRS, [(kim10.KINDS[-1], 5)], [(kim10.KINDS[0], 30), *((kind, 5) for kind in kim10.KINDS)]),
)
def test_the_pairs_have_the_events_that_they_are_named_after(kind, count):
    a, b = kim10.pair(kind, count)
    both = jhd.hausdorff(a, b)
    there, back = jhd.directed_hausdorff(a, b), jhd.directed_hausdorff(b, a)
    assert name_of(both.event) == name_of(there.event) == kim10.EVENTS[kind]
    assert there.lower > back.upper


def test_segments_that_are_points_are_no_trouble():
    a = jhd.polyline([[0, 0], [2, 1], [2, 1], [3, -1]])
    b = jhd.polyline([[0, 1], [0, 1], [3, 2]])
    check_against_branch_and_bound(a, b, jhd.published.BiarcTrimming())
    check_against_branch_and_bound(b, a, jhd.published.BiarcTrimming())


def test_finer_arcs_trim_more():
    a, b = spline_pair(5)
    shares = [
        float(jhd.directed_hausdorff(a, b, jhd.published.BiarcTrimming(deviation=x)).stats["trimmed"])
        for x in (0.3, 1e-3)
    ]
    assert shares[0] <= shares[1]


def test_the_second_direction_is_trimmed_below_the_first():
    a, b = spline_pair(5)
    both = jhd.hausdorff(a, b, jhd.published.BiarcTrimming())
    alone = jhd.directed_hausdorff(b, a, jhd.published.BiarcTrimming())
    assert float(both.stats["b_to_a_trimmed"]) >= float(alone.stats["trimmed"])
    assert float(both) == pytest.approx(float(jhd.hausdorff(a, b)), abs=1e-9)


def test_a_missed_event_is_an_error():
    """Where the events on what is left stay below a measured distance, the result says so."""
    a, b = spline_pair(5)
    p, q, frame = prepare(b.segments(), a.segments())
    pair = host_pair.HostPair.of(p, q)
    search = event_candidates.Search(1e-8, 256, 10**6)
    none = event_survivors.EventPieces(np.zeros(0, int), np.zeros((2, 0)), np.zeros((2, 0)))
    candidates, stats = event_candidates.candidate_events(pair, none, search)
    # A sample that no event explains: the middle of a segment whose piece has been taken away.
    best = farthest.Measured(2.0, 2.0, 0, 0.5)
    solution = farthest.best_of(pair, candidates, best, stats, search, frame)
    assert name_of(solution.result) == "gap_not_closed"


def test_the_printed_trimming_keeps_an_end_and_loses_a_foot_and_says_nothing_false():
    """An end and its foot survive; of the self-bisector's two feet one is trimmed, as both curves are."""
    method = jhd.published.BiarcTrimming(variant="paper")
    for kind, lost in (("end", False), ("self_bisector", True)):
        a, b = kim10.pair(kind, 5)
        found, proven = jhd.directed_hausdorff(a, b, method), jhd.directed_hausdorff(a, b)
        assert name_of(found.result) == "not_certified" and found.upper == np.inf and found.lower <= proven.upper
        assert float(found.stats["lower_bound"]) <= float(proven.upper)
        assert float(found) <= float(proven.upper) + 1e-9
        assert (float(found) < float(proven.lower) - 1e-3) == lost


@pytest.mark.parametrize(("deviation", "message"), [(0.0, "deviation is 0; needs"), (-1.0, "deviation is -1; needs")])
def test_deviations_that_make_no_sense_are_refused(deviation, message):
    with pytest.raises(ValueError, match=message):
        jhd.published.BiarcTrimming(deviation=deviation)
