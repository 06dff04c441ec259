"""Biarcs and trimming before the equations: where a cannot be farthest from b no event is looked for.

 1. Both curves are replaced by biarcs with proven deviations.
 2. A lower bound of the distance: samples of a are ranked by their distance to the arcs of b, and the best ones are
    measured by the proven nearest point. Such a bound owes nothing to the deviation of the arcs or to pixels.
 3. An arc of a is trimmed where all of it, with both deviations, is nearer to one arc of b than the lower bound.
 4. The systems of all events are solved on what is left, for distances between the lower bound and the bound of each
    piece.

Changes to the source. Its distance map and the terms eps1 to eps3 give way to step 2 (jhd.distance_map draws the map).
Its test of an arc by the control polygon, condition (5), is unsafe; the one in `arc_reach` is exact and no dearer. It
trims both curves, which can remove a foot of the maximum; here only the parameter of the maximum is trimmed and b stays
whole: feet are told by their distances.

Source: Kim et al. 2010, sections 2 to 4.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma
from jhd.arrays import real_array
from jhd.distance.algebraic import (
    HostPair,
    Measured,
    Search,
    best_of,
    candidate_events,
    check_options,
    check_served,
    final_size,
    measured,
    zoomed,
)
from jhd.distance.event_systems import Pieces
from jhd.distance.method import AbstractHostMethod, Aim
from jhd.distance.prepare import Frame, evaluation_error
from jhd.shapes.biarc import BiarcCurve, biarcs, least_tolerance
from jhd.shapes.curve import BezierSegments
from jhd.solution import HausdorffSolution

# Samples measured at a time.
_SAMPLES = 64
# The default deviation of biarcs: this share of the first lower bound, between shares of the unit of coordinates.
_SHARE, _FINEST, _COARSEST = 1 / 64, 1e-5, 1e-2
# Radii above this are cut down to it, which moves an arc by less than its sagitta: centres then lose few digits.
_LARGEST_RADIUS = 1e6
# How far outside of a wedge (in radians) a direction still counts as inside.
_ABOUT = 1e-9


class BiarcTrimming(AbstractHostMethod):
    """Biarcs, trimming, then all events on what is left; for polynomial plane curves with known control points.

    `value`, `lower` and `upper` (infinite) as for AlgebraicEvents, and so are the counts in `stats`; in addition
    `arcs` of both curves, `trimmed` (the share of the parameters of a that was removed) and `pieces`
    left. The result is gap_not_closed where the events on what is left stay below a distance that was measured, which
    says that one was missed.

    Args:
        atol: size of final boxes in space, as for AlgebraicEvents.
        deviation: largest deviation of the biarcs, in the unit of the coordinates; by default a 64th of the distance
            of the best sample, between 1e-5 and 1e-2 of the extent. Finer arcs trim more and cost more.
        capacity: open boxes of one system at which it counts as one with a curve of roots.
        max_boxes: most boxes examined in all.

    Raises:
        ValueError: a negative atol, a deviation that is not positive, or numbers too small.
    """

    atol: Array | None = eqx.field(default=None, converter=lambda x: None if x is None else real_array("atol", x))
    deviation: Array | None = eqx.field(
        default=None, converter=lambda x: None if x is None else real_array("deviation", x)
    )
    capacity: int = eqx.field(static=True, default=256)
    max_boxes: int = eqx.field(static=True, default=2**23)

    def __check_init__(self) -> None:
        check_options(self.atol, (("capacity", self.capacity, 16), ("max_boxes", self.max_boxes, 0)))
        if self.deviation is not None:
            if self.deviation.shape != ():
                raise ValueError(f"deviation has shape {self.deviation.shape}; needs a scalar.")
            if not float(self.deviation) > 0:
                raise ValueError(f"deviation is {float(self.deviation):g}; needs a positive number.")

    def directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """One direction in common coordinates; what lies below the level of the aim is trimmed too.

        Raises:
            TypeError: rational segments, curves in space, or control points that are traced.
        """
        check_served(type(self).__name__, a, b)
        pair = HostPair.of(a, b)
        left = trimmed(pair, self, frame, float(aim.level))
        search = Search(final_size(self.atol, frame), self.capacity, self.max_boxes)
        candidates, stats = candidate_events(pair, left.pieces, search)
        found = best_of(pair, candidates, left.best, stats, search, frame, float(aim.level))
        kept = float(np.sum(left.pieces.side[1] - left.pieces.side[0]))
        counts = {
            "arcs": jnp.asarray(left.arcs),
            "pieces": jnp.asarray(len(left.pieces.segment)),
            "trimmed": jnp.asarray(1.0 - kept / max(pair.a.moving, 1)),
        }
        return eqx.tree_at(lambda s: s.stats, found, found.stats | counts)

    def arc_deviation(self, distance: float, pair: HostPair, frame: Frame) -> float:
        """The deviation of the arcs in common coordinates, for a distance that was measured."""
        wanted = min(max(_SHARE * distance, _FINEST), _COARSEST)
        if self.deviation is not None:
            wanted = float(frame.common(np.asarray(self.deviation)))
        return max(wanted, *(1.01 * least_tolerance(x) for x in pair.stored))


class Trimmed(NamedTuple):
    """What is left of a: pieces, the farthest place measured, and the number of arcs of both curves."""

    pieces: Pieces
    best: Measured
    arcs: int


def trimmed(pair: HostPair, method: BiarcTrimming, frame: Frame, level: float) -> Trimmed:
    """Removes the pieces of a that are nearer to b than the level or a distance that was measured.

    Args:
        pair: both curves.
        method: its deviation is used.
        frame: leads back to the user's coordinates.
        level: distances up to it do not matter; in common coordinates.
    """
    best = _first_sample(pair)
    d, c = _arcs(pair, method.arc_deviation(best.distance, pair, frame))
    best = _best_sample(pair, d, c, best)
    error = evaluation_error(*pair.stored)
    level = max(best.lower - error, level, 0.0)
    upper = reach(d, c) + error
    return Trimmed(_pieces(d, upper >= level, upper, level - 2 * error), best, len(d.t0) + len(c.t0))


class Arcs(NamedTuple):
    """Arcs on the host, last axis; in common coordinates.

    Args:
        start: where each starts, (2, arcs).
        end: where it ends.
        apex: where the tangents of both ends meet; the arc lies in the triangle of the three.
        centre: of its circle.
        radius: likewise; 0 for points, whose centre is the point.
        bulge: tan(sweep / 4), positive to the left; never 0.
        deviation: Hausdorff distance of the arc and its piece of the curve, at most.
        segment: the segment of the curve.
        t0: where the piece starts.
        t1: where it ends.
    """

    start: np.ndarray
    end: np.ndarray
    apex: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    bulge: np.ndarray
    deviation: np.ndarray
    segment: np.ndarray
    t0: np.ndarray
    t1: np.ndarray

    @property
    def turn(self) -> np.ndarray:
        """1 to the left, -1 to the right."""
        return np.sign(self.bulge)

    @property
    def middle(self) -> np.ndarray:
        """Where each arc is half way."""
        return 0.5 * (self.start + self.end) - 0.5 * self.bulge * _left(self.end - self.start)

    def halves(self) -> "Arcs":
        """First halves, then second halves; the intervals of the curve are those of the whole arcs."""
        bulge, middle = self.bulge / (1 + np.hypot(1, self.bulge)), self.middle
        parts = []
        for start, end in ((self.start, middle), (middle, self.end)):
            parts.append(self._replace(start=start, end=end, bulge=bulge, apex=_apex(start, end, bulge)))
        return Arcs(*(np.concatenate(x, axis=-1) for x in zip(*parts, strict=True)))

    def take(self, rows: np.ndarray) -> "Arcs":
        """Some of the arcs, or arcs again and again."""
        return Arcs(*(x[..., rows] for x in self))


def _arcs(pair: HostPair, deviation: float) -> tuple[Arcs, Arcs]:
    """The arcs of both curves; those of a for the moving segments of the solver, those of b for everything stored."""
    a, b = pair.stored
    kept = (pair.index[: pair.a.moving], np.flatnonzero(~pair.skip))
    return _arcs_of(a, kept[0], deviation), _arcs_of(b, kept[1], deviation)


def _arcs_of(curve: BezierSegments, kept: np.ndarray, deviation: float) -> Arcs:
    if not len(kept):
        plane, numbers, index = np.zeros((2, 0)), np.zeros(0), np.zeros(0, int)
        return Arcs(plane, plane, plane, plane, numbers, numbers, numbers, index, numbers, numbers)
    points = np.asarray(curve.control_points)[kept]
    # Where no joint exists, as on segments that are points, numbers that mean nothing are formed and thrown away.
    with np.errstate(all="ignore"):
        return on_host(biarcs(BezierSegments(points, None, np.full(len(kept), -1)), deviation))


def on_host(arcs: BiarcCurve) -> Arcs:
    """Arcs with centres that keep their digits: radii of at most a million, whose change counts as deviation.

    Arcs of one chord and one side lie within the larger sagitta of each other, |b| L / 2 with the bulge b and the
    chord L; a line becomes the flattest arc to its left.
    """
    start, end = (np.asarray(x, np.float64).T for x in (arcs.start, arcs.end))
    b, deviation = (np.asarray(x, np.float64) for x in (arcs.bulge, arcs.deviation))
    chord = end - start
    length = np.hypot(*chord)
    point = length < 1e-150
    flattest = length / (4 * _LARGEST_RADIUS)
    flat = np.abs(b) < flattest
    deviation = np.where(flat, deviation + 0.5 * flattest * length, deviation)
    b = np.where(flat, np.copysign(flattest, b), b)
    safe = np.where(point, 1.0, b)
    centre = np.where(point, start, 0.5 * (start + end) + _left(chord) * ((1 - safe) * (1 + safe) / (4 * safe)))
    apex = _apex(start, end, b)
    radius = np.where(point, 0.0, length * (1 + b * b) / (4 * np.abs(safe)))
    segment, t0, t1 = (np.asarray(x) for x in (arcs.segment, arcs.t0, arcs.t1))
    return Arcs(start, end, apex, centre, radius, b, deviation, segment, t0, t1)


def _left(x: np.ndarray) -> np.ndarray:
    return np.stack([-x[1], x[0]])


def _apex(start: np.ndarray, end: np.ndarray, bulge: np.ndarray) -> np.ndarray:
    return 0.5 * (start + end) - _left(end - start) * (bulge / ((1 - bulge) * (1 + bulge)))


def _cross(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return x[0] * y[1] - x[1] * y[0]


def _in_wedge(arcs: Arcs, offset: np.ndarray) -> np.ndarray:
    """Whether offsets from the centres point into the wedges of the arcs, or next to them; 0 does."""
    first, last = arcs.start - arcs.centre, arcs.end - arcs.centre
    least = -_ABOUT * arcs.radius * np.hypot(*offset)
    return (arcs.turn * _cross(first, offset) >= least) & (arcs.turn * _cross(offset, last) >= least)


def _range(arcs: Arcs, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest distance of the points of each arc from a point.

    The distance along a circle is extreme on the line of the centres; on an arc, there or at its ends.
    """
    between = centre - arcs.centre
    apart = np.hypot(*between)
    ends = [np.hypot(*(x - centre)) for x in (arcs.start, arcs.end)]
    low, high = np.minimum(*ends), np.maximum(*ends)
    low = np.where(_in_wedge(arcs, between), np.minimum(low, np.abs(apart - arcs.radius)), low)
    high = np.where(_in_wedge(arcs, -between), np.maximum(high, apart + arcs.radius), high)
    return low, high


def arc_reach(d: Arcs, c: Arcs) -> np.ndarray:
    """Bounds of the largest distance of the curve piece of each arc d to the curve piece of the arc c beside it.

    Let x be a point of the arc d. Its distance to c is | |x - o| - r | where x lies in the wedge of c, and at most the
    distance to either end of c anyway. The wedge is convex, for arcs turn by less than half a circle, so d lies in it
    with its control triangle; then the largest | |x - o| - r | is taken at the smallest or at the largest |x - o|,
    which `_range` knows. Elsewhere the largest |x - p| for an end p of c is the same formula with another centre. A
    point of the piece of d is within its deviation of the arc, and a point of the arc c within its deviation of b. So
    the distance to b of the whole piece is at most the sum. (Any pair of arcs gives a bound; which, needs no proof.)

    Rounding: ends, centres and distances are right up to gamma(64) (1 + r_c + r_d), for coordinates of at most one. A
    point that only rounding puts into the wedge is as near to it, and the arc as near to the radial foot. What lies
    next to the wedge of d only enlarges the range. The slack of gamma(200) (1 + r_c + r_d) covers the sum.
    """
    low, high = _range(d, c.centre)
    radial = np.maximum(np.abs(high - c.radius), np.abs(low - c.radius))
    first, last = c.start - c.centre, c.end - c.centre
    inside = c.radius > 0
    for x in (d.start, d.end, d.apex):
        offset = x - c.centre
        inside = inside & (c.turn * _cross(first, offset) >= 0) & (c.turn * _cross(offset, last) >= 0)
    to_ends = np.minimum(_range(d, c.start)[1], _range(d, c.end)[1])
    slack = gamma(200, np.float64) * (1 + c.radius + d.radius)
    return np.where(inside, np.minimum(radial, to_ends), to_ends) + slack + c.deviation + d.deviation


def near(d: Arcs, c: Arcs) -> np.ndarray:
    """For each arc of a some arcs of b that may be the nearest to its ends and its middle, (candidates, arcs)."""
    middles = c.middle
    rows = []
    for x in (d.start, d.middle, d.end):
        squares = (x[0][:, None] - middles[0]) ** 2 + (x[1][:, None] - middles[1]) ** 2
        rows.append(np.argmin(squares, axis=1))
    last = len(c.radius) - 1
    return np.stack([np.clip(row + k, 0, last) for row in rows for k in (-1, 0, 1)])


def reach(d: Arcs, c: Arcs) -> np.ndarray:
    """Bound of the distance to b for the piece of each arc of a: the largest of the bounds of its quarters.

    A long arc lies beside several arcs of b, a quarter of it beside one. Every point of the piece is within the
    deviation of a point of one of the quarters.
    """
    number = len(d.radius)
    if not number:
        return np.zeros(0)
    quarters = d.halves().halves()
    beside = near(quarters, c)
    bounds = arc_reach(quarters.take(np.tile(np.arange(4 * number), len(beside))), c.take(beside.ravel()))
    return bounds.reshape(len(beside), 4, number).min(axis=0).max(axis=0)


def _distance(x: np.ndarray, c: Arcs) -> np.ndarray:
    """Distances of points to arcs, for ranking."""
    offset = x - c.centre
    radial = np.abs(np.hypot(*offset) - c.radius)
    ends = np.minimum(np.hypot(*(x - c.start)), np.hypot(*(x - c.end)))
    return np.where(_in_wedge(c, offset), np.minimum(radial, ends), ends)


def _first_sample(pair: HostPair) -> Measured:
    """The farthest of some places spread over a: middles of its segments, more of them where it has few."""
    count = pair.a.moving
    if not count:
        return measured(pair, pair.isolated[:_SAMPLES], np.zeros(min(len(pair.isolated), _SAMPLES)), None)
    place = np.linspace(0, count, _SAMPLES)
    segment = np.minimum(place.astype(int), count - 1)
    return measured(pair, segment, place - segment, None)


def _best_sample(pair: HostPair, d: Arcs, c: Arcs, best: Measured) -> Measured:
    """The best of the samples that are farthest from the arcs, then of samples ever closer around it."""
    number = len(d.radius)
    if not number:
        return best
    arcs = [c.take(row) for row in near(d, c)]
    points = (d.start, d.middle)
    ranked = np.concatenate([np.min([_distance(x, arc) for arc in arcs], axis=0) for x in points])
    order = np.argsort(-ranked)[:_SAMPLES]
    t = np.concatenate([d.t0, 0.5 * (d.t0 + d.t1)])[order]
    best = measured(pair, d.segment[order % number], t, best)
    width = np.max((d.t1 - d.t0)[d.segment == best.segment], initial=2.0 / _SAMPLES)
    return zoomed(pair, best, float(width))


def _pieces(arcs: Arcs, kept: np.ndarray, upper: np.ndarray, level: float) -> Pieces:
    """Neighbouring arcs that were kept as pieces, with the interval of the distances that matter on each."""
    rows = np.flatnonzero(kept)
    segment, t0, t1 = arcs.segment[rows], arcs.t0[rows], arcs.t1[rows]
    goes_on = (segment[1:] == segment[:-1]) & (t0[1:] == t1[:-1])
    first = np.flatnonzero(np.append(True, ~goes_on)) if len(rows) else rows
    last = np.append(first[1:], len(rows)) - 1 if len(rows) else rows
    side = np.stack([t0[first], t1[last]])
    most = np.maximum.reduceat(upper[rows], first) if len(rows) else np.zeros(0)
    return Pieces(segment[first], side, np.stack([np.full(len(first), level), most]))
