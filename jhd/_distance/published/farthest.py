"""The farthest of many points of a by certified distances, and the solution made from it."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.nearest.curves import nearest
from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.curves import evaluation_error
from jhd._distance.normalization.jets import jet, polynomial_jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of
from jhd._distance.published.events.candidates import Candidates, Search, Stats, Unresolved
from jhd._distance.published.events.forms import restricted
from jhd._distance.published.events.host_pair import HostPair
from jhd._distance.witness.events import describe
from jhd._results.solution import RESULTS, HausdorffSolution
from jhd._runtime.compiled import compiled
from jhd._shapes.curve import BezierSegments

# Points measured in one call of the compiled function.
_MEASURED = 8


class Measured(NamedTuple):
    """The point of a that is proven to be farthest among those measured, in segments of the solver."""

    distance: float
    lower: float
    segment: int
    t: float


@compiled
def _nearest_all(points: Array, b: BezierSegments, skip: Array) -> tuple[Array, Array]:
    found = jax.vmap(lambda x: nearest(x, b.control_points, None, 0.0, skip))(points)
    return found.distance, found.lower


def measure(pair: HostPair, segment: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances of points of a to b, and proven lower bounds, without the error of the points themselves."""
    points, b = polynomial_jet(pair.a.points[..., segment], t)[0].T, pair.stored[1]
    values = []
    for start in range(0, len(points), _MEASURED):
        index = np.minimum(np.arange(start, start + _MEASURED), len(points) - 1)
        values.append(np.stack(_nearest_all(points[index].astype(b.control_points.dtype), b, pair.second.skip)))
    distance, lower = np.concatenate(values, axis=1)[:, : len(points)] if values else np.zeros((2, 0))
    return distance, lower


def farthest(pair: HostPair, candidates: Candidates, best: Measured | None) -> Measured | None:
    """Return the farthest of the candidates and the best known point; those bounded by the best are skipped."""
    order = np.argsort(-candidates.bound, kind="stable")
    for start in range(0, len(order), _MEASURED):
        rows = order[start : start + _MEASURED]
        if best is not None and candidates.bound[rows[0]] <= best.distance:
            break
        best = measured(pair, candidates.segment[rows], candidates.t[rows], best)
    return best


def measured(pair: HostPair, segment: np.ndarray, t: np.ndarray, best: Measured | None) -> Measured:
    """Return the farthest of these points of a and the best known one."""
    distance, lower = measure(pair, segment, t)
    k = int(np.argmax(distance))
    if best is not None and best.distance >= distance[k]:
        return best
    return Measured(float(distance[k]), float(lower[k]), int(segment[k]), float(t[k]))


def zoomed(pair: HostPair, best: Measured, width: float) -> Measured:
    """Return the best point after rounds of samples around it, each round in a smaller interval."""
    # Rounds of samples around a point that no equation fixes, each twice closer.
    for _ in range(8):
        around = np.clip(best.t + width * np.linspace(-1, 1, _MEASURED), 0.0, 1.0)
        best = measured(pair, np.full(_MEASURED, best.segment), around, best)
        width = 4 * width / _MEASURED
    return best


def _may_exceed(pair: HostPair, boxes: Unresolved, limit: float) -> bool:
    """Return whether the distance may exceed the limit in a box; within it the distance grows by at most its length."""
    rows = np.flatnonzero(boxes.upper > limit)
    if not len(rows):
        return False
    segment, side = boxes.segment[rows], boxes.side[:, rows]
    distance, _ = measure(pair, segment, side.mean(0))
    part = restricted(pair.a.points[..., segment], side)
    reach = np.hypot(*(part.max(0) - part.min(0)))
    return bool(np.any(distance + reach > limit))


@compiled
def _described(a: BezierSegments, b: BezierSegments, segment: Array, t: Array, skip: Array) -> tuple[Any, ...]:
    """Return the witness at a point of a, its distance and the proven lower bound."""
    point = jet(*piece_of(a, segment), t).point
    found = nearest(point, b.control_points, None, 0.0, skip)
    described = describe(a, b, CurvePlace(segment, t), CurvePlace(found.segment, found.t))
    lower = jnp.maximum(found.lower - evaluation_error(a, b), 0.0)
    return described.witness(), jnp.maximum(found.distance, lower), lower


def _describe(pair: HostPair, segment: int, t: float) -> tuple[Any, ...]:
    a, b = pair.stored
    place = np.asarray(pair.first.index[segment]), np.asarray(t, a.control_points.dtype)
    return _described(a, b, *place, pair.second.skip)


def best_of(
    pair: HostPair,
    candidates: Candidates,
    best: Measured | None,
    stats: Stats,
    search: Search,
    frame: Frame,
    level: float = -np.inf,
    upper: float = np.inf,
    **counts: float,
) -> HausdorffSolution:
    """Return the solution that the candidates give, with a report of known gaps.

    Args:
        pair: both curves.
        candidates: points that may be the maximum.
        best: the farthest point measured before, if any. It is no event, so one of the candidates must be as far, or
            the solver has missed it.
        stats: statistics of the search for the candidates.
        search: options of this search.
        frame: the map back to the user's coordinates.
        level: distances up to it do not matter, so the candidates need not reach them.
        upper: proven bound of the distance, if known.
        counts: more entries of `stats`.
    """
    described, unresolved = None, stats.unresolved
    if len(candidates.t) == 1 and not len(unresolved.upper):
        # Nothing to choose from: the description says how far it is.
        segment, t = int(candidates.segment[0]), float(candidates.t[0])
        described = _describe(pair, segment, t)
        found = Measured(float(described[1]), float(described[2]), segment, t)
    else:
        found = farthest(pair, candidates, None)
    missed = False
    if best is not None and (found is None or best.distance > found.distance):
        missed = best.distance > max(level, -np.inf if found is None else found.distance) + search.box_size
        found, described = best, None
    width = np.max(unresolved.side[1] - unresolved.side[0], initial=0.0)
    open_ = _may_exceed(pair, unresolved, max(0.0 if found is None else found.distance, level) + search.box_size)
    if found is not None and open_:
        # The middles of boxes on a curve of roots are no events: the largest distance is next to the best of them.
        found, described = zoomed(pair, found, width), None
    if described is None:
        described = _describe(pair, *((0, 0.0) if found is None else (found.segment, found.t)))
    witness, value, lower = described
    result = RESULTS.gap_not_closed if missed or open_ else RESULTS.successful
    result = RESULTS.capacity_reached if stats.exhausted else result
    every: dict[str, Any] = {
        "pairs": stats.pairs,
        "boxes": stats.boxes,
        "candidates": stats.candidates,
        "roots": stats.roots,
        "unresolved": len(unresolved.upper),
        "unresolved_lower": np.zeros((), lower.dtype),
        "unresolved_upper": np.zeros((), lower.dtype),
        # The distance at the witness is rounded, and so is the bound.
        "upper": np.nextafter(np.asarray(max(upper, float(value)), lower.dtype), np.inf, dtype=lower.dtype),
        **counts,
    }
    if len(unresolved.upper):
        for key, x, toward in (("lower", unresolved.lower.min(), 0.0), ("upper", unresolved.upper.max(), np.inf)):
            every[f"unresolved_{key}"] = frame.length(np.asarray(x, lower.dtype), toward)
    # All together: one transfer takes as long as ten.
    every = jax.device_put({key: x if isinstance(x, Array) else np.asarray(x) for key, x in every.items()})
    return HausdorffSolution(value, lower, every.pop("upper"), witness, result, every)
