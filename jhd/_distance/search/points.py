"""The search over points: a point set needs no cells.

All points get a proven upper bound at once, from a point of the target near them. Then the farthest points are
measured, until the largest distance proven reaches the next upper bound.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from jhd._distance.nearest.target import AbstractTarget, ProvenFeet
from jhd._distance.normalization.stopping import Aim, AllowedGap
from jhd._distance.search.search import AbstractSearch, Standing
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness
from jhd._runtime.arrays import taken, undifferentiated
from jhd._shapes.curve import BezierSegments

# Points of the first step; each step takes twice as many, up to the best number for the target.
_FIRST = 32
# Counts: steps, points, and points that were measured.
COUNTS = "steps", "points", "measured"
# Steps of the first stretch.
_FIRST_STEPS = 16


class _Farthest(NamedTuple):
    index: int
    foot: ProvenFeet  # one row
    lower: float


class _PointSearchState(NamedTuple):
    order: np.ndarray  # points from the farthest to the nearest, by their bounds
    bounds: np.ndarray
    measured: int
    settled: float  # largest upper bound of the measured points
    best: _Farthest | None
    steps: int


class PointSearch(AbstractSearch):
    """The search over points; its state holds the points in the order of their upper bounds.

    Args:
        points: (points, dim), known and finite.
        target: the shape that distances are taken to.
        allowed: the gap that may stay at a lower bound.
        aim: range of distances that matter.
        max_steps: most steps.
    """

    first_steps = _FIRST_STEPS

    def __init__(self, points: np.ndarray, target: AbstractTarget, allowed: AllowedGap, aim: Aim, max_steps: int):
        self._points, self._target, self._allowed = points, target, allowed
        self._level, self._ceiling, self.max_steps = float(aim.level), float(aim.ceiling), max_steps

    @override
    def begin(self) -> _PointSearchState:
        upper = self._target.feet(self._points)
        order = np.argsort(-upper, kind="stable")
        return _PointSearchState(order, upper[order], 0, -np.inf, None, 0)

    @override
    def advance(self, state: _PointSearchState, limit: int, growing: bool) -> tuple[_PointSearchState, Standing]:
        while self._going(state) and state.steps < limit:
            state = self._step(state)
        # Some point is always measured: the witness is the farthest measured point.
        state = self._step(state) if state.best is None else state
        going = self._going(state)
        return state, Standing(self._solution(state), going, False, state.steps, len(state.order) - state.measured)

    def _next(self, state: _PointSearchState) -> float:
        return float(state.bounds[state.measured]) if state.measured < len(state.bounds) else -np.inf

    def _going(self, state: _PointSearchState) -> bool:
        if state.best is None:
            return True
        lower = state.best.lower
        after = self._next(state)
        # Without a proven point of the target no bound can get finite.
        beyond = after > max(lower + self._allowed(lower), self._level)
        return bool(np.isfinite(after)) and beyond and lower <= self._ceiling

    def _step(self, state: _PointSearchState) -> _PointSearchState:
        size = min(_FIRST << min(state.steps, 20), self._target.block)
        rows = state.order[state.measured : state.measured + size]
        best = state.best
        enough = self._level if best is None else max(best.lower, self._level)
        found = self._target.nearest(self._points[rows], enough)
        top = int(np.argmax(found.lower))
        if best is None or found.lower[top] > best.lower:
            foot = taken(found, slice(top, top + 1))
            best = _Farthest(int(rows[top]), foot, float(found.lower[top]))
        settled = max(state.settled, float(np.max(found.upper)))
        return state._replace(measured=state.measured + len(rows), settled=settled, best=best, steps=state.steps + 1)

    def _solution(self, state: _PointSearchState) -> HausdorffSolution:
        best: Any = state.best  # some point is measured by now
        upper = max(state.settled, self._next(state), best.lower)
        closed = upper - max(best.lower, self._level) <= self._allowed.asked(best.lower) or best.lower > self._ceiling
        result = RESULTS.successful if closed else RESULTS.gap_not_closed
        counts = state.steps, len(state.order), state.measured
        dtype, foot, rows = self._points.dtype, best.foot, self._target.feet_named
        distance = foot.distance[0] if best.lower > 0 else 0.0
        witness = Witness(
            element=jnp.asarray(best.index),
            t=jnp.zeros((), dtype),
            point=jnp.asarray(self._points[best.index]),
            feet=jnp.asarray(np.repeat(foot.foot, rows, axis=0)),
            feet_elements=jnp.asarray(np.repeat(foot.segment.astype(int), rows)),
            feet_params=jnp.asarray(np.repeat(foot.t, rows, axis=0)),
            multipliers=jnp.asarray(np.eye(rows)[0], dtype),
            event=EVENTS.a_end if distance > 0 else EVENTS.coincident,
            direction=DIRECTIONS.a_to_b,
        )
        return HausdorffSolution(
            value=jnp.asarray(np.clip(distance, best.lower, upper), dtype),
            lower=jnp.asarray(best.lower, dtype),
            upper=jnp.asarray(upper, dtype),
            witness=witness,
            result=RESULTS.existence_not_certified if np.isinf(upper) else result,
            stats={name: jnp.asarray(count) for name, count in zip(COUNTS, counts, strict=True)},
        )


def nearest_points(points: BezierSegments, target: Any) -> BezierSegments:
    """Return the points that may be nearest to a shape: all others are proven to be farther than one of them.

    Args:
        points: a set of points, its numbers known; it may be differentiated.
        target: the target of the shape.
    """
    rows = np.asarray(undifferentiated(points).control_points)[:, 0]
    if target.sharp:
        found = target.nearest(rows)
        return BezierSegments(points.control_points[np.flatnonzero(found.lower <= found.upper.min())])
    upper = float(np.min(target.feet(rows)))
    near = np.flatnonzero(target.within(rows, upper)) if np.isfinite(upper) else np.arange(len(rows))
    return BezierSegments(points.control_points[near])
