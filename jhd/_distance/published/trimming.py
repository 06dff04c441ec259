"""Biarcs and trimming before the equations: no event is sought on the parts of a that cannot be farthest from b.

 1. Both curves are replaced by biarcs with certified deviations; `hausdorff` uses them in both directions.
 2. A lower bound of the distance: points of a are ranked by their distance to the arcs of b, and the best ones are
    measured by the certified nearest point. This bound does not depend on the deviation of the arcs or on pixels.
 3. A piece of a is trimmed if all of it, with both deviations, is nearer to b than the lower bound: tested first by the
    middle of its arc, then by the quarters of the arc, then by short chords of the rest.
 4. The systems of all events are solved on the remaining pieces, for distances between the lower bound and the bound of
    each piece.

Source: Kim et al. 2010, sections 2 to 4.
"""

from typing import Any, Literal, NamedTuple
from weakref import ref

import equinox as eqx
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.curves import evaluation_error
from jhd._distance.normalization.jets import polynomial_jet
from jhd._distance.normalization.method import AbstractHostMethod
from jhd._distance.normalization.stopping import Aim
from jhd._distance.published.algebraic import final_size
from jhd._distance.published.arc_bounds import Arcs, ArcTarget, arcs_of, chords
from jhd._distance.published.events.candidates import Search, candidate_events, near_ends
from jhd._distance.published.events.forms import restricted
from jhd._distance.published.events.host_pair import HostPair, check_served
from jhd._distance.published.events.survivors import EventPieces, SurvivingFeet, event_pieces
from jhd._distance.published.farthest import Measured, best_of, measured
from jhd._distance.published.printed_trimming import printed_trimming
from jhd._results.solution import RESULTS, HausdorffSolution, result_where
from jhd._runtime.arrays import check_scalar, check_whole
from jhd._shapes.biarc_fit import fitted
from jhd._shapes.checks import optional_array
from jhd._shapes.curve import BezierSegments
from jhd._shapes.deviation import HostCurve, complex_points
from jhd._shapes.unchecked import trusted

# Points measured at a time.
_SAMPLES = 16
# Arcs of a that are examined for the best point, points on each, rounds of closer points around the best, and points of
# each round that are measured: eight at most, as the compiled function takes them.
_BEST, _PLACES, _ROUNDS, _KEPT = 8, 9, 3, 2
# Chords into which the rest of an arc is cut.
_CHORDS = 16
_NOTHING = (
    EventPieces(np.zeros(0, int), np.zeros((2, 0)), np.zeros((2, 0))),
    SurvivingFeet(np.zeros(0, int), np.zeros(0, int), np.zeros((2, 0))),
)


class BiarcTrimming(AbstractHostMethod):
    """Hausdorff distance of polynomial plane curves: trimming by biarcs, then all events on the rest; not under jit.

    Changes to the source, Kim et al. 2010:

     - A measured distance is the lower bound. The source reads a distance map by pixels and subtracts the terms eps1 to
       eps3 of (1) and (2).
     - An arc is tested exactly (`arc_bounds`). The source tests control points by (3) and (5) to (10); (5) is unsafe.
     - Arcs of b next to an arc are looked up by their ends and middles. The source takes the arcs that the pixels of
       its control points name.
     - Quarters of arcs and then short chords are tested as well as whole arcs.
     - Only the curve of the maximum is trimmed; foot points are distinguished by their distances. The source trims both
       curves, which can remove a foot point of the maximum.
     - Each direction has its own lower bound. The source uses one for both.
     - Divided differences leave the trivial solutions r = s out of (13).
     - Each event is measured by the certified nearest point of all of b. The source takes the largest solution.

    `variant="paper"` reverts the first five (`printed_trimming`). Each direction reads its own map, which is evaluated
    at the middles of pixels instead of rendered. The result is RESULTS.not_certified, without an upper bound: its test
    of arcs is unsafe, and it trims both curves. `stats` also has `lower_bound`, which the source calls LB, and
    `trimmed_of_b`. A directed value below LB shows that an event was lost.

    `value`, `lower` and the counts in `stats` are as in AlgebraicEvents. `stats` also counts `arcs` of both curves,
    `trimmed` (the fraction of the parameters of a that was removed) and remaining `pieces`. `upper` is the bound by
    which pieces are trimmed. It is certified even if the solver misses events. It exceeds the value by a few deviations
    of the arcs; a finer `deviation` lowers it. It is not proven that the value itself is the maximum. If all events on
    the remaining pieces stay below a measured distance, an event was missed, and the result is gap_not_closed.

    Use it as `jhd.directed_hausdorff(a, b, jhd.published.BiarcTrimming())`.

    Args:
        box_size: size of the final boxes in space, in the unit of the coordinates, as in AlgebraicEvents.
        deviation: largest deviation of the biarcs, in the unit of the coordinates; by default 1/64 of the distance of
            the best of a few samples, between 1e-5 and 1e-2 of the extent. Finer arcs trim more and cost more.
        capacity: number of open boxes of one system from which it counts as a system with a curve of roots.
        max_boxes: largest number of boxes examined in all.
        variant: "ours" or "paper", as above.
        pixels: number of pixels along the longer side of the distance map, for variant="paper".

    Raises:
        ValueError: a negative `box_size`, a deviation that is not positive, a count that is too small, or an unknown
            variant.
    """

    box_size: Array | None = eqx.field(default=None, converter=optional_array("box_size"))
    deviation: Array | None = eqx.field(default=None, converter=optional_array("deviation"))
    capacity: int = eqx.field(static=True, default=256)
    max_boxes: int = eqx.field(static=True, default=2**23)
    variant: Literal["ours", "paper"] = eqx.field(static=True, default="ours")
    pixels: int = eqx.field(static=True, default=512)

    def __check_init__(self) -> None:
        if self.variant not in ("ours", "paper"):
            raise ValueError(f"variant is {self.variant!r}; needs 'ours' or 'paper'.")
        check_whole("pixels", self.pixels, 1)
        check_scalar("box_size", self.box_size)
        check_whole("capacity", self.capacity, 16)
        check_whole("max_boxes", self.max_boxes, 0)
        check_scalar("deviation", self.deviation, positive=True)

    @override
    def _directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        # Parts below the level of the aim are trimmed too.
        check_served(type(self).__name__, a, b)
        pair, arcs = _replaced(a, b, None if self.deviation is None else float(self.deviation), frame)
        search = Search(final_size(self.box_size, frame), self.capacity, self.max_boxes)
        if self.variant == "paper":
            return self._as_printed(pair, arcs, search, frame, float(aim.level))
        left = trimmed(pair, *arcs, float(aim.level))
        candidates, stats = candidate_events(pair, left.pieces, search, left.feet)
        counts = _counts(pair, arcs, left.pieces)
        return best_of(
            pair, candidates, left.best, stats, search, frame, float(aim.level), upper_bound(pair, left), **counts
        )

    def _as_printed(
        self, pair: HostPair, arcs: tuple[Arcs, Arcs], search: Search, frame: Frame, level: float
    ) -> HausdorffSolution:
        """Return one direction as in the source."""
        left = printed_trimming(pair, *arcs, level, self.pixels)
        candidates, stats = candidate_events(pair, left.pieces, search, left.feet)
        counts = _counts(pair, arcs, left.pieces)
        counts["trimmed_of_b"] = 1.0 - left.kept_of_b / max(pair.b.moving, 1)
        counts["lower_bound"] = float(frame.length(np.asarray(left.lower)))
        found = best_of(pair, candidates, None, stats, search, frame, level, **counts)
        result = result_where(found.result == RESULTS.successful, RESULTS.not_certified, found.result)
        return eqx.tree_at(lambda s: s.result, found, result)


def _counts(pair: HostPair, arcs: tuple[Arcs, Arcs], pieces: EventPieces) -> dict[str, float]:
    """Return counts of the trimming for `stats`."""
    kept = float(np.sum(pieces.side[1] - pieces.side[0]))
    return {
        "arcs": len(arcs[0].t0) + len(arcs[1].t0),
        "pieces": len(pieces.segment),
        "trimmed": 1.0 - kept / max(pair.a.moving, 1),
    }


def arc_deviation(pair: HostPair, wanted: float | None, frame: Frame) -> float:
    """Return the deviation required of the arcs, in common coordinates.

    Args:
        pair: both curves.
        wanted: the deviation in the unit of the user; None takes a fraction of the distance of the best of some
            samples.
        frame: the map back to the coordinates of the user.
    """
    if wanted is not None:
        return float(frame.common(np.asarray(wanted)))
    # The default deviation of biarcs: this fraction of the first lower bound, between fractions of the unit of
    # coordinates.
    return min(max(_first_sample(pair) / 64, 1e-5), 1e-2)


class _Replaced(NamedTuple):
    """A pair and the arcs of both curves, identified by the curves that they were made from."""

    of: tuple[ref, ref]
    deviation: float | None
    pair: HostPair
    arcs: tuple[Arcs, Arcs]


# The last pair: `hausdorff` asks for both directions of one pair, one after the other. It is forgotten with its curves.
_last: list[_Replaced] = []


def _replaced(
    a: BezierSegments, b: BezierSegments, wanted: float | None, frame: Frame
) -> tuple[HostPair, tuple[Arcs, Arcs]]:
    """Return the pair for the solver, and the arcs of a and of b."""
    for known in _last[:1]:
        if known.of[0]() is b and known.of[1]() is a and known.deviation == wanted:
            return known.pair.reversed(), (known.arcs[1], known.arcs[0])
    pair = HostPair.of(a, b)
    arcs = both_arcs(pair, arc_deviation(pair, wanted, frame))
    _last[:] = [_Replaced((ref(a, _forget), ref(b, _forget)), wanted, pair, arcs)]
    return pair, arcs


def _forget(curve: ref) -> None:
    for known in _last[:1]:
        if any(curve is x for x in known.of):
            _last.clear()


def both_arcs(pair: HostPair, deviation: float) -> tuple[Arcs, Arcs]:
    """Return the arcs of both curves, for each stored segment that repeats no other, found in one pass."""
    kept = [np.flatnonzero(~x.skip) for x in (pair.first, pair.second)]
    points = [np.asarray(x.control_points)[rows] for x, rows in zip(pair.stored, kept, strict=True)]
    every = np.concatenate(points)
    host = HostCurve.of(trusted(every, None, np.full(len(every), -1)))
    arcs = fitted(host, max(deviation, 1.01 * host.least))
    cut = np.searchsorted(arcs.segment, len(points[0]))
    parts = [arcs.take(rows) for rows in (slice(cut), slice(cut, None))]
    first, second = (
        arcs_of(part._replace(segment=rows[part.segment - start]))
        for part, rows, start in zip(parts, kept, (0, len(points[0])), strict=True)
    )
    return first, second


class Trimmed(NamedTuple):
    """The parts of a that remain."""

    pieces: EventPieces  # the remaining parts
    feet: SurvivingFeet  # the parts of b that may hold their feet
    upper: float  # bound of the distances of all segments of a that are no points, in common coordinates
    best: Measured | None  # the farthest measured point, if any


def upper_bound(pair: HostPair, left: Trimmed) -> float:
    """Bound the distance from a to b: by the bound of the pieces, and the distances of isolated points to ends of b."""
    single = near_ends(pair.a.points[0, :, pair.first.isolated], pair.b)
    return max(left.upper, float(np.max(single, initial=0.0)) + evaluation_error(*pair.stored))


def trimmed(pair: HostPair, d: Arcs, c: Arcs, level: float) -> Trimmed:
    """Remove the pieces of a that are nearer to b than the level or a distance that was measured.

    Args:
        pair: both curves.
        d: arcs of a, of the stored segments.
        c: arcs of b.
        level: distances up to it do not matter; in common coordinates.
    """
    # Points have arcs as well, but are no pieces.
    moving = pair.first.moving
    d = d.take(np.flatnonzero(moving[d.segment] >= 0))
    level = max(level, 0.0)
    if not len(d.t0):
        return Trimmed(*_NOTHING, level, None)
    target, error = ArcTarget(c), evaluation_error(*pair.stored)
    d, upper = _above(level, d, target.coarse_reach(d) + error)
    if not len(upper):
        return Trimmed(*_NOTHING, level, None)
    points = complex_points(np.asarray(pair.stored[0].control_points, np.float64)).T
    segment, t = _best_place(points, target, d, upper)
    best = measured(pair, moving[segment], t, None)
    level = max(best.lower - error, level)
    d, *_ = _above(level, d, upper)
    d, upper = _above(level, d, target.reach_by_quarters(d) + error)
    for _ in range(2):
        d = _chords(points, d)
        d, upper = _above(level, d, np.minimum(target.reach(d) + error, np.repeat(upper, _CHORDS)))
        # An arc is cut again if its chords are longer than this many deviations, so that their length decides more than
        # the known distance to b.
        if np.max(np.abs(d.end - d.start), initial=0.0) <= 8 * target.largest_deviation:
            break
    pieces = event_pieces(moving[d.segment], d.t0, d.t1, upper, level - 2 * error)
    return Trimmed(pieces, _feet(pair, pieces, target), max(level, float(np.max(upper, initial=0.0))), best)


def _above(level: float, d: Arcs, *values: np.ndarray) -> tuple[Any, ...]:
    """Return the arcs, with their values, whose first value reaches the level."""
    rows = np.flatnonzero(values[0] >= level)
    return d.take(rows), *(x[rows] for x in values)


def _chords(points: np.ndarray, d: Arcs) -> Arcs:
    """Return the pieces of some arcs, each in several chords, in order."""
    share = np.arange(_CHORDS + 1) / _CHORDS
    t = np.clip(d.t0[:, None] + (d.t1 - d.t0)[:, None] * share, d.t0[:, None], d.t1[:, None])
    t[:, -1] = d.t1
    segment, side = np.repeat(d.segment, _CHORDS), np.stack([t[:, :-1].ravel(), t[:, 1:].ravel()])
    return chords(segment, side[0], side[1], restricted(points[:, segment], side))


def _first_sample(pair: HostPair) -> float:
    """Return the largest distance of some points spread over a."""
    count = pair.a.moving
    if not count:
        points = pair.first.isolated[:_SAMPLES]
        return measured(pair, points, np.zeros(len(points)), None).distance
    place = np.linspace(0, count, _SAMPLES)
    segment = np.minimum(place.astype(int), count - 1)
    return measured(pair, segment, place - segment, None).distance


def _best_place(points: np.ndarray, target: ArcTarget, d: Arcs, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stored segments and parameters of the points of a that are farthest from the arcs.

    They are samples on the arcs with the largest bounds, and then samples ever closer around the best one, until they
    are as close as the arcs are to the curve.
    """
    rows = np.argsort(-upper)[:_BEST]
    share = np.linspace(0, 1, _PLACES)
    t = (d.t0[rows, None] + (d.t1 - d.t0)[rows, None] * share).ravel()
    segment = np.repeat(d.segment[rows], _PLACES)
    width = np.repeat((d.t1 - d.t0)[rows] / (_PLACES - 1), _PLACES)
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(_ROUNDS):
        x = np.asarray(polynomial_jet(points[:, segment], t).point)
        distance = target.distance(x)
        order = np.argsort(-distance)[:_KEPT]
        found.append((segment[order], t[order]))
        k = order[0]
        if np.abs(x[k] - x[k - 1]) <= target.largest_deviation:
            break
        t, segment = (
            np.clip(t[k] + width[k] * np.linspace(-1, 1, 2 * _PLACES), 0, 1),
            np.repeat(segment[k], 2 * _PLACES),
        )
        width = np.repeat(width[k] * 2 / (2 * _PLACES - 1), 2 * _PLACES)
    segments, parameters = zip(*found, strict=True)
    return np.concatenate(segments), np.concatenate(parameters)


def _feet(pair: HostPair, pieces: EventPieces, target: ArcTarget) -> SurvivingFeet:
    """Return the parts of b that may hold feet of the pieces: those within the bound of the distance.

    A foot of an event of the maximum is a nearest point, so its distance is at most the bound of the piece. Arcs of b
    that are farther than this bound from a disc around the piece, with their deviations, hold no such foot.
    """
    points = restricted(pair.a.points[..., pieces.segment], pieces.side)
    center = points.mean(0)
    radius = np.hypot(*np.moveaxis(points - center, 1, 0)).max(0)
    piece, arc = target.within(center[0] + 1j * center[1], radius + pieces.wanted[1])
    moving = pair.second.moving
    b, arcs = pair.b, target.arcs
    segment = moving[arcs.segment[arc]]
    rows = np.flatnonzero(segment >= 0)
    piece, segment, t0, t1 = piece[rows], segment[rows], arcs.t0[arc[rows]], arcs.t1[arc[rows]]
    goes_on = (piece[1:] == piece[:-1]) & (segment[1:] == segment[:-1]) & (t0[1:] == t1[:-1])
    first, last = np.flatnonzero(np.append(True, ~goes_on)), np.flatnonzero(np.append(~goes_on, True))
    if not len(rows):
        first = last = rows
    # Ends and corners of b are few, and told by their own distances later.
    count, single = len(pieces.segment), np.arange(b.moving, b.points.shape[-1])
    every = SurvivingFeet(
        np.concatenate([piece[first], np.repeat(np.arange(count), len(single))]),
        np.concatenate([segment[first], np.tile(single, count)]),
        np.concatenate([np.stack([t0[first], t1[last]]), np.zeros((2, count * len(single)))], axis=1),
    )
    return every.take(np.lexsort((every.side[0], every.segment, every.piece)))
