"""Every candidate event by a solver of polynomial systems: the method of Elber & Grandine, for plane curves.

The maximum over a of the distance to b lies at an end of a segment of a, or at one of finitely many events: an
antipodal pair, a normal of a through an end of b, or two equally near feet. All systems of equations of these events
are solved (jhd.distance.event_systems), with feet that may be far from the nearest, so there are many more events than
maxima. Each event is refined by Newton's method and measured by the proven nearest point; the farthest one wins.

Sources: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008; it is
the method without trimming that Kim et al. 2010 compare theirs with.
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arrays import is_traced, real_array
from jhd.compiled import compiled
from jhd.distance.event_systems import (
    CORNER_ANGLE,
    NO_EVENTS,
    Curve,
    Events,
    Pieces,
    Systems,
    hull_distances,
    pairs,
    restricted,
    solve,
    survivors,
    triples,
)
from jhd.distance.events import Place, describe, piece_of
from jhd.distance.jets import jet
from jhd.distance.method import AbstractHostMethod, Aim
from jhd.distance.nearest import nearest
from jhd.distance.prepare import Frame, evaluation_error
from jhd.shapes.curve import BezierSegments
from jhd.solution import RESULTS, HausdorffSolution

# Default size of final boxes, as a share of the extent of the pair; Newton's method goes on from there.
_FINAL = 1e-8
# Points measured in one call of the compiled program.
_MEASURED = 64
_NEWTON_STEPS = 8
# Rounds of samples around a place that no equation fixes, each sixteen times closer.
_ROUNDS = 2
# Tangents shorter than this share of their segment have no direction.
_STILL = 1e-9


class AlgebraicEvents(AbstractHostMethod):
    """Solves for all candidate events; for polynomial curves in the plane whose control points are known.

    `value` is the largest proven distance of all candidates and `lower` the proven bound of it. `upper` is infinite:
    the solver drops a box only where rounding allows it, but that no event is missed where the tangents of b differ by
    rounding at a joint is not proven.

    `stats`: `pairs` of segments looked at, `boxes` examined by the solver, `candidates` (boxes that it ended with, and
    ends of segments), `roots` (candidates that are isolated roots, double ones included) and `unresolved`: boxes on
    curves of roots, where equations vanish along a stretch. Those are no roots; the distances there lie between
    `unresolved_lower` and `unresolved_upper`, in the unit of the coordinates. Where they may exceed the value by more
    than `atol` the result is gap_not_closed; where max_boxes was reached it is capacity_reached.

    Args:
        atol: size of final boxes in space, in the unit of the coordinates, before Newton's method; by default 1e-8 of
            the largest half extent of the pair, between one and two times.
        capacity: open boxes of one system at which it counts as one with a curve of roots.
        max_boxes: most boxes examined in all.

    Raises:
        ValueError: a negative atol, or numbers too small.
    """

    atol: Array | None = eqx.field(default=None, converter=lambda x: None if x is None else real_array("atol", x))
    capacity: int = eqx.field(static=True, default=256)
    max_boxes: int = eqx.field(static=True, default=2**23)

    def __check_init__(self) -> None:
        check_options(self.atol, (("capacity", self.capacity, 16), ("max_boxes", self.max_boxes, 0)))

    def directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """One direction in common coordinates.

        Raises:
            TypeError: rational segments, curves in space, or control points that are traced.
        """
        check_served(type(self).__name__, a, b)
        pair = HostPair.of(a, b)
        count = pair.a.moving
        side = np.broadcast_to(np.array([[0.0], [1.0]]), (2, count))
        whole = Pieces(np.arange(count), side, np.broadcast_to(np.array([[0.0], [np.inf]]), (2, count)))
        search = Search(final_size(self.atol, frame), self.capacity, self.max_boxes)
        candidates, stats = candidate_events(pair, whole, search)
        return best_of(pair, candidates, None, stats, search, frame)


class Search(NamedTuple):
    """Options of the solver in common coordinates: size of final boxes, open boxes of a system, boxes in all."""

    atol: float
    limit: int
    max_boxes: int


def check_options(atol: Array | None, counts: tuple[tuple[str, int, int], ...]) -> None:
    """Raises ValueError for a tolerance that is no length or a count below its least."""
    if atol is not None:
        if atol.shape != ():
            raise ValueError(f"atol has shape {atol.shape}; needs a scalar.")
        if not is_traced(atol) and not float(atol) >= 0:
            raise ValueError(f"atol is {float(atol):g}; needs a number of at least 0.")
    for name, value, least in counts:
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise ValueError(f"{name} is {value!r}; needs a whole number of at least {least}.")


def check_served(method: str, a: BezierSegments, b: BezierSegments) -> None:
    """Raises TypeError, naming the methods that serve, for curves that the systems are not made for."""
    others = "BranchAndBound() and TwoStep() serve it."
    if is_traced(a, b):
        raise TypeError(f"{method} needs known control points, not traced ones; under jit {others}")
    if a.dim != 2:
        raise TypeError(f"{method} needs curves in the plane; these have {a.dim} coordinates a point. {others}")
    for curve in (a, b):
        if curve.weights is not None and np.ptp(np.asarray(curve.weights), axis=-1).any():
            raise TypeError(f"{method} needs polynomial segments; these are rational. {others}")


def final_size(atol: Array | None, frame: Frame) -> float:
    """The size of final boxes in common coordinates, not below what parameters resolve."""
    return _FINAL if atol is None else max(float(frame.common(np.asarray(atol))), 1e-13)


class HostPair(NamedTuple):
    """Both curves for the solver, with the indices of their segments, and for the proof of distances."""

    a: Curve
    b: Curve
    index: np.ndarray  # for each segment and isolated point of a the stored segment
    isolated: np.ndarray  # which segments of a are isolated points
    stored: tuple[BezierSegments, BezierSegments]
    skip: np.ndarray

    @classmethod
    def of(cls, a: BezierSegments, b: BezierSegments) -> "HostPair":
        """From the common coordinates; repeated segments are left out."""
        stored = tuple(BezierSegments(x.control_points, None, x.following) for x in (a, b))
        skip = [_repeated(x) for x in stored]
        (p, index), (q, _) = (_curve(x, ~s) for x, s in zip(stored, skip, strict=True))
        return cls(p, q, index, np.flatnonzero(index >= 0)[p.moving :], (stored[0], stored[1]), skip[1])


def _repeated(curve: BezierSegments) -> np.ndarray:
    points = np.asarray(curve.control_points)
    return np.concatenate([[False], np.all(points[1:] == points[:-1], axis=(1, 2))])


def _curve(curve: BezierSegments, kept: np.ndarray) -> tuple[Curve, np.ndarray]:
    """Segments that are no points, then the free ends, corners and points as segments of one point.

    With it the index of each segment and isolated point in the stored curve, -1 for free ends and corners.
    """
    points, following = np.asarray(curve.control_points, np.float64), np.asarray(curve.following)
    representative = np.flatnonzero(kept)[np.cumsum(kept) - 1]
    following = np.where(following < 0, -1, representative[following])
    single = np.all(points == points[:, :1], axis=(1, 2))
    moving = np.flatnonzero(kept & ~single)
    number = np.full(len(points), -1)
    number[moving] = np.arange(len(moving))
    rows = points[moving].copy()
    onward = np.where(following[moving] < 0, -1, number[following[moving]])
    from_, to = np.flatnonzero(onward >= 0), onward[onward >= 0]
    # Joined ends may differ by a few units of roundoff, which would make two feet of one.
    rows[to, 0] = rows[from_, -1]
    smooth = _smooth(rows[from_], rows[to])
    onward[from_[~smooth]] = -1
    started = np.isin(np.arange(len(moving)), to)
    none = lambda x: np.full(len(x), -1)  # noqa: E731
    starts, stops, corners = np.flatnonzero(~started), np.setdiff1d(np.arange(len(moving)), from_), ~smooth
    isolated = points[kept & single][:, 0]
    ends = np.concatenate([rows[starts, 0], rows[stops, -1], rows[from_[corners], -1], isolated])
    start_of = np.concatenate([starts, none(stops), to[corners], none(isolated)])
    end_of = np.concatenate([none(starts), stops, from_[corners], none(isolated)])
    every = np.concatenate([rows, np.repeat(ends[:, None], points.shape[1], axis=1)])
    velocity = (points.shape[1] - 1) * np.diff(every, axis=1)
    return (
        Curve(
            points=np.ascontiguousarray(np.moveaxis(every, 0, -1)),
            velocity=np.ascontiguousarray(np.moveaxis(velocity, 0, -1)),
            speed=np.abs(velocity).max(axis=(1, 2)),
            moving=len(moving),
            following=np.concatenate([onward, none(ends)]),
            start_of=np.concatenate([none(moving), start_of]),
            end_of=np.concatenate([none(moving), end_of]),
        ),
        np.concatenate([moving, none(ends[: len(ends) - len(isolated)]), np.flatnonzero(kept & single)]),
    )


def _smooth(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Whether the tangents at the joints of two rows of segments are one, and not too short to tell."""
    if before.shape[1] < 2:
        return np.zeros(len(before), bool)
    x, y = before[:, -1] - before[:, -2], after[:, 1] - after[:, 0]
    sizes = [np.hypot(*v.T) for v in (x, y)]
    extents = [np.ptp(rows, axis=1).max(axis=1) for rows in (before, after)]
    moves = (sizes[0] > _STILL * extents[0]) & (sizes[1] > _STILL * extents[1])
    cross, along = x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0], np.sum(x * y, axis=1)
    return moves & (np.abs(cross) <= CORNER_ANGLE * sizes[0] * sizes[1]) & (along > 0)


class Candidates(NamedTuple):
    """Places of a, by segments of the solver: (candidates,) arrays.

    Args:
        segment: which.
        t: where.
        bound: no less than the distance there, to be measured where it is large.
    """

    segment: np.ndarray
    t: np.ndarray
    bound: np.ndarray


class Unresolved(NamedTuple):
    """Boxes on curves of roots: segment and interval (2, boxes) of a, bounds of the distances."""

    segment: np.ndarray
    side: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class Stats(NamedTuple):
    """What the search did, and what it left."""

    pairs: int
    boxes: int
    candidates: int
    roots: int
    exhausted: bool
    unresolved: Unresolved


def candidate_events(pair: HostPair, pieces: Pieces, search: Search) -> tuple[Candidates, Stats]:
    """Ends of all segments of a, and all events with their maximum in the pieces."""
    a, b = pair.a, pair.b
    parts: list[tuple[np.ndarray, ...]] = []
    stretches = [_distances(a, b, NO_EVENTS)]
    boxes, roots, exhausted = 0, 0, False
    for groups in _groups(pair, pieces):
        found = solve(a, b, groups, atol=search.atol, limit=search.limit, max_boxes=search.max_boxes - boxes)
        boxes, exhausted, roots = boxes + found.boxes, exhausted or found.exhausted, roots + int(found.isolated.sum())
        parts.append(_refined(a, b, found))
        stretches.append(_distances(a, b, found))
    segment, t, bound = ([part[k] for part in parts] for k in range(3))
    start, stop = np.append(np.arange(a.moving), pair.isolated), np.arange(a.moving)
    end_points = np.concatenate([a.points[0, :, start], a.points[-1, :, stop]])
    candidates = Candidates(
        np.concatenate([start, stop, *segment]),
        np.concatenate([np.zeros(len(start)), np.ones(len(stop)), *t]),
        np.concatenate([_near_ends(end_points, b), *bound]),
    )
    left = Unresolved(*(np.concatenate(x, axis=-1) for x in zip(*stretches, strict=True)))
    looked_at = len(pieces.segment) * b.points.shape[-1]
    return candidates, Stats(looked_at, boxes, len(candidates.t), roots, exhausted, left)


def _groups(pair: HostPair, pieces: Pieces) -> Iterator[list[Systems]]:
    """The systems of the pieces, in portions: pairs, triples, triples on one segment."""
    if not len(pieces.segment):
        return
    kept = survivors(pair.a, pair.b, pieces)
    antipodal, none = pairs(pair.b, pieces, kept), np.zeros(0, int)
    for two, on_one in triples(pair.b, pieces, kept):
        yield [antipodal, two, on_one]
        antipodal = antipodal.take(none)


def _near_ends(points: np.ndarray, b: Curve) -> np.ndarray:
    """Distances of points (count, 2) to the nearest end of a segment of b."""
    ends = np.concatenate([b.points[0], b.points[-1]], axis=1)
    squares = sum((points[:, k, None] - ends[k]) ** 2 for k in (0, 1))
    return np.sqrt(np.min(squares, axis=1))


def _distances(a: Curve, b: Curve, found: Events) -> Unresolved:
    """The boxes that are no roots; the distance is at most that to any foot, an event's that to both."""
    rows = np.flatnonzero(~found.isolated)
    segment, box = found.segment[:, rows], found.box[:, :, rows]
    if not len(rows):
        return Unresolved(segment[0], box[0], np.zeros(0), np.zeros(0))
    p = restricted(a.points[..., segment[0]], box[0])
    bounds = [hull_distances(p, restricted(b.points[..., segment[k]], box[k])) for k in (1, 2)]
    return Unresolved(segment[0], box[0], np.maximum(*(x[0] for x in bounds)), np.minimum(*(x[1] for x in bounds)))


def _jets(points: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, velocities and accelerations of segments (points, 2, count), each (2, count)."""
    c, degree = points, len(points) - 1
    first = second = np.zeros_like(points[0])
    for level in range(degree, 0, -1):
        if level == 2:
            second = degree * (degree - 1) * (c[2] - 2 * c[1] + c[0])
        if level == 1:
            first = degree * (c[1] - c[0])
        c = (1 - t) * c[:-1] + t * c[1:]
    return c[0], first, second


def _refined(a: Curve, b: Curve, found: Events) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Segments, parameters and distances of the events, by Newton's method inside their boxes from the middles."""
    if not found.segment.shape[1]:
        return np.zeros(0, int), np.zeros(0), np.zeros(0)
    p, q, w = a.points[..., found.segment[0]], b.points[..., found.segment[1]], b.points[..., found.segment[2]]
    two = np.any(found.segment[1] != found.segment[2]) & (found.segment[1] != found.segment[2])
    two = two | np.any(found.box[1] != found.box[2], axis=0)
    still = [k >= b.moving for k in found.segment[1:]]
    low, high = found.box[:, 0], found.box[:, 1]
    y = 0.5 * (low + high)
    for _ in range(_NEWTON_STEPS):
        step = _newton_step(_jets(p, y[0]), _jets(q, y[1]), _jets(w, y[2]), two, still)
        y = np.clip(y + np.where(np.isfinite(step) & found.isolated, step, 0.0), low, high)
    point = _jets(p, y[0])[0]
    distance = [np.hypot(*(point - foot)) for foot in (_jets(q, y[1])[0], _jets(w, y[2])[0])]
    return found.segment[0], y[0], np.minimum(*distance)


def _newton_step(
    a: tuple[np.ndarray, ...],
    r: tuple[np.ndarray, ...],
    s: tuple[np.ndarray, ...],
    two: np.ndarray,
    still: list[np.ndarray],
) -> np.ndarray:
    """Newton's step of the equations (12) or (13) of Kim et al. 2010, by Cramer's rule; a foot in a point stays."""

    def dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return x[0] * y[0] + x[1] * y[1]

    c, e, one = a[0] - r[0], a[0] - s[0], np.ones_like(two, float)
    rows = []
    for offset, foot, held in ((c, r, still[0]), (e, s, still[1] | ~two)):
        value, along = dot(offset, foot[1]), dot(a[1], foot[1])
        bend = dot(offset, foot[2]) - dot(foot[1], foot[1])
        rows.append([np.where(held, 0.0, value), np.where(held, 0.0, along), np.where(held, one, bend)])
    (f2, a2, b2), (f3, a3, b3) = rows
    f1 = np.where(two, dot(c + e, s[0] - r[0]), dot(c, a[1]))
    a1 = np.where(two, 2 * dot(a[1], s[0] - r[0]), dot(a[1], a[1]) + dot(c, a[2]))
    b1 = np.where(two, -2 * dot(c, r[1]), -dot(r[1], a[1]))
    c1 = np.where(two, 2 * dot(e, s[1]), 0.0)
    with np.errstate(all="ignore"):
        t = -(f1 - b1 * f2 / b2 - c1 * f3 / b3) / (a1 - b1 * a2 / b2 - c1 * a3 / b3)
        return np.stack([t, -(f2 + a2 * t) / b2, -(f3 + a3 * t) / b3])


# ---- proven distances ----------------------------------------------------------------------------


class Measured(NamedTuple):
    """The place of a that is proven to be farthest among those measured, in segments of the solver."""

    distance: float
    lower: float
    segment: int
    t: float


@compiled
def _nearest_all(points: Array, b: BezierSegments, skip: Array) -> tuple[Array, Array]:
    found = jax.vmap(lambda x: nearest(x, b.control_points, None, 0.0, skip))(points)
    return found.distance, found.lower


def measure(pair: HostPair, segment: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances from places of a to b, and proven lower bounds of them, without the error of the points themselves."""
    points, b = _jets(pair.a.points[..., segment], t)[0].T, pair.stored[1]
    values = []
    for start in range(0, len(points), _MEASURED):
        index = np.minimum(np.arange(start, start + _MEASURED), len(points) - 1)
        values.append(np.stack(_nearest_all(points[index].astype(b.control_points.dtype), b, pair.skip)))
    distance, lower = np.concatenate(values, axis=1)[:, : len(points)] if values else np.zeros((2, 0))
    return distance, lower


def farthest(pair: HostPair, candidates: Candidates, best: Measured | None) -> Measured | None:
    """The farthest candidate, or the best one known; candidates in the order of their bounds, while these are above."""
    order = np.argsort(-candidates.bound, kind="stable")
    for start in range(0, len(order), _MEASURED):
        rows = order[start : start + _MEASURED]
        if best is not None and candidates.bound[rows[0]] <= best.distance:
            break
        segment, t = candidates.segment[rows], candidates.t[rows]
        distance, lower = measure(pair, segment, t)
        k = int(np.argmax(distance))
        if best is None or distance[k] > best.distance:
            best = Measured(float(distance[k]), float(lower[k]), int(segment[k]), float(t[k]))
    return best


def measured(pair: HostPair, segment: np.ndarray, t: np.ndarray, best: Measured | None) -> Measured:
    """The farthest of these places of a and the best one known."""
    distance, lower = measure(pair, segment, t)
    k = int(np.argmax(distance))
    if best is not None and best.distance >= distance[k]:
        return best
    return Measured(float(distance[k]), float(lower[k]), int(segment[k]), float(t[k]))


def zoomed(pair: HostPair, best: Measured, width: float) -> Measured:
    """The best place after rounds of samples around it, each round in a closer interval."""
    for _ in range(_ROUNDS):
        around = np.clip(best.t + width * np.linspace(-1, 1, _MEASURED), 0.0, 1.0)
        best = measured(pair, np.full(_MEASURED, best.segment), around, best)
        width = 4 * width / _MEASURED
    return best


def _may_exceed(pair: HostPair, boxes: Unresolved, limit: float) -> bool:
    """Whether the distance may be above the limit in one of the boxes; within them it grows by their length at most."""
    rows = np.flatnonzero(boxes.upper > limit)
    if not len(rows):
        return False
    segment, side = boxes.segment[rows], boxes.side[:, rows]
    distance, _ = measure(pair, segment, side.mean(0))
    part = restricted(pair.a.points[..., segment], side)
    reach = np.hypot(*(part.max(0) - part.min(0)))
    return bool(np.any(distance + reach > limit))


@compiled
def _described(a: BezierSegments, b: BezierSegments, segment: Array, t: Array, skip: Array) -> tuple:
    """The witness at a place of a, its distance and the proven lower bound."""
    point = jet(*piece_of(a, segment), t).point
    found = nearest(point, b.control_points, None, 0.0, skip)
    witness = describe(a, b, Place(segment, t), Place(found.segment, found.t), jnp.ones((), t.dtype))
    return witness, found.distance, jnp.maximum(found.lower - evaluation_error(a, b), 0.0)


def best_of(
    pair: HostPair,
    candidates: Candidates,
    best: Measured | None,
    stats: Stats,
    search: Search,
    frame: Frame,
    level: float = -np.inf,
) -> HausdorffSolution:
    """The solution that the candidates give, and what is known to be missing of it.

    Args:
        pair: both curves.
        candidates: where the maximum may be.
        best: the farthest place measured before, where there are any. It is no event, so one of the candidates must be
            as far, or the solver has missed it.
        stats: of the search for the candidates.
        search: its options.
        frame: leads back to the user's coordinates.
        level: distances up to it do not matter, so no candidate need reach them.
    """
    a, b = pair.stored
    found = farthest(pair, candidates, None)
    missed = False
    if best is not None and (found is None or best.distance > found.distance):
        missed = best.distance > max(level, -np.inf if found is None else found.distance) + search.atol
        found = best
    unresolved, width = stats.unresolved, np.max(stats.unresolved.side[1] - stats.unresolved.side[0], initial=0.0)
    open_ = _may_exceed(pair, unresolved, max(0.0 if found is None else found.distance, level) + search.atol)
    if found is not None and open_:
        # The middles of boxes on a curve of roots are no events: the largest distance is next to the best of them.
        found = zoomed(pair, found, width)
    place = (0, 0.0) if found is None else (int(pair.index[found.segment]), found.t)
    dtype = a.control_points.dtype
    witness, value, lower = _described(a, b, np.asarray(place[0]), np.asarray(place[1], dtype), pair.skip)
    result = RESULTS.gap_not_closed if missed or open_ else RESULTS.successful
    result = RESULTS.capacity_reached if stats.exhausted else result
    reach = (unresolved.lower.min(), unresolved.upper.max()) if len(unresolved.upper) else (0.0, 0.0)
    counts = {
        "pairs": jnp.asarray(stats.pairs),
        "boxes": jnp.asarray(stats.boxes),
        "candidates": jnp.asarray(stats.candidates),
        "roots": jnp.asarray(stats.roots),
        "unresolved": jnp.asarray(len(unresolved.upper)),
        "unresolved_lower": frame.length(np.asarray(reach[0], dtype), 0.0),
        "unresolved_upper": frame.length(np.asarray(reach[1], dtype), np.inf),
    }
    upper = jnp.full_like(lower, jnp.inf)
    return HausdorffSolution(jnp.maximum(value, lower), lower, upper, witness, result, counts)
