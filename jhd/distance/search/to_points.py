"""Hausdorff distances from surfaces to sets of points: the point of the surface that is farthest from all of them.

Cells of the surface wait with proven upper bounds (jhd.distance.search.sources). A step takes those with the largest,
cuts them, looks for the nearest points of their middles and corners in a tree, and bounds the parts by these; a place
whose distance is proven to be large raises the lower bound. Cells are dropped as soon as their bound is within the
tolerance of that.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jhd.arithmetic.rounding import smallest_normal, unit_roundoff
from jhd.distance.cells.surfaces import FEET
from jhd.distance.frame.aim import Aim
from jhd.distance.frame.coordinates import Frame
from jhd.distance.search.search import AbstractSearch, Standing
from jhd.distance.search.sources import AbstractSource, CellRows, PlacesOfCells
from jhd.distance.witness.multipliers import balanced
from jhd.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness
from jhd.triangles.closest_point import TriangleTree, in_unit_of, nearest_triangles

# Cells cut in a step, at most, and most that wait; each takes 200 bytes.
_BATCH, _WAITING = 1 << 13, 1 << 22
# What is counted: steps, cells bounded, and cells that wait.
COUNTS = "steps", "cells", "waiting"
# Points are looked for around the place this far away, and count as nearest within this much; shares of the distance.
_RING, _EQUAL = 1e-6, 1e-8
_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
# So many points that are about equally near are looked at.
_MOST = 16
# Multipliers leave no more than this where they balance.
_UNBALANCED = 1e-4
# Steps of the first stretch.
_FIRST_STEPS = 24
# Feet count together where their distances agree to this many diameters of a cell.
_TOGETHER = 2.0


class Cloud(NamedTuple):
    """The points that distances are taken to, in common coordinates, and their tree."""

    rows: np.ndarray
    tree: TriangleTree

    def near(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of each place (places, 3) the nearest point, and proven lower and upper bounds of its distance."""
        tree, scaled = in_unit_of(self.tree, places)
        found = nearest_triangles(tree, scaled)
        distance = np.sqrt(found.square.astype(np.float64))
        error = tree.error(distance)
        ends = (np.ldexp(x, tree.exponent) for x in (np.maximum(distance - error, 0.0), distance + error))
        return tree.order[found.triangle], *ends


class PlaceFound(NamedTuple):
    """The farthest place found: its piece, parameters, point, nearest point, proven bound, and distance."""

    piece: int
    x: np.ndarray
    point: np.ndarray
    nearest: int
    lower: float
    distance: float


class _Waiting(NamedTuple):
    cells: CellRows
    upper: np.ndarray
    feet: np.ndarray  # (cells, FEET), numbers of points

    def take(self, rows: Any) -> "_Waiting":
        return _Waiting(self.cells.take(rows), self.upper[rows], self.feet[rows])


class _PointQuery(NamedTuple):
    waiting: _Waiting
    best: PlaceFound | None
    settled: float
    steps: int
    bounded: int


class ToPointsSearch(AbstractSearch):
    """The search.

    Args:
        source: the surface, in common coordinates.
        cloud: the points, in the same.
        frame: leads back to the user's; `aim` is in their unit.
        moved: by how much common coordinates may misplace both.
        allowed: the gap that may stay at a lower bound.
        aim: what of the distance matters.
        max_steps: most steps.
    """

    first_steps = _FIRST_STEPS

    def __init__(
        self,
        source: AbstractSource,
        cloud: Cloud,
        frame: Frame,
        moved: float,
        allowed: Callable[[float], float],
        aim: Aim,
        max_steps: int,
    ):
        self._source, self._cloud, self._frame, self._moved, self._allowed = source, cloud, frame, moved, allowed
        level, ceiling = (np.asarray(x, float) for x in aim)
        # Bounds here are off by as much as the coordinates are.
        self._level = float(frame.common(level, 0.0)) - moved
        self._ceiling = float(frame.common(ceiling, np.inf)) + moved
        self.max_steps = max_steps

    def begin(self) -> _PointQuery:
        """See AbstractSearch."""
        cells = self._source.cover()
        feet = np.zeros((len(cells.piece), FEET), int)
        state = _PointQuery(_Waiting(cells.take(slice(0, 0)), np.zeros(0), feet[:0]), None, -np.inf, 0, 0)
        return self._entered(state, cells, np.full(len(cells.piece), np.inf), None)

    def advance(self, state: _PointQuery, limit: int, growing: bool) -> tuple[_PointQuery, Standing]:
        """See AbstractSearch."""
        while self._going(state) and state.steps < limit:
            state = self._step(state)
        going = self._going(state)
        return state, Standing(self._solution(state), going, False, state.steps, len(state.waiting.upper))

    def longer(self, state: _PointQuery) -> _PointQuery:
        """See AbstractSearch; it is never full."""
        return state

    def _goal(self, best: PlaceFound | None) -> float:
        return self._level if best is None else max(best.lower + 0.9 * self._allowed(best.lower), self._level)

    def _going(self, state: _PointQuery) -> bool:
        lower = 0.0 if state.best is None else state.best.lower
        waiting = len(state.waiting.upper)
        return 0 < waiting <= _WAITING and lower <= self._ceiling

    def _step(self, state: _PointQuery) -> _PointQuery:
        waiting = state.waiting
        if len(waiting.upper) > _BATCH:
            order = np.argpartition(-waiting.upper, _BATCH)
            taken, rest = waiting.take(order[:_BATCH]), waiting.take(order[_BATCH:])
        else:
            taken, rest = waiting, waiting.take(slice(0, 0))
        cells, parent = self._source.cut(taken.cells)
        state = state._replace(waiting=rest, steps=state.steps + 1)
        return self._entered(state, cells, taken.upper[parent], taken.feet[parent])

    def _entered(self, state: _PointQuery, cells: CellRows, upper: np.ndarray, feet: np.ndarray | None) -> _PointQuery:
        """The state with new cells, of which bounds are known already."""
        if not len(cells.piece):
            return self._kept(state, _Waiting(cells, upper, np.zeros((0, FEET), int)))
        places = self._source.places(cells)
        shape = places.points.shape[:2]
        near, low, high = self._cloud.near(places.points.reshape(-1, 3))
        near, low = near.reshape(shape), low.reshape(shape)
        best = self._better(state.best, cells, places, near, low, high.reshape(shape))
        candidates = near if feet is None else np.concatenate([near, feet], axis=1)
        chosen = _spread(self._cloud.rows, places.points, candidates)
        found = self._source.over(cells, self._cloud.rows[chosen].astype(places.points.dtype))
        upper = np.fmin(upper, found.astype(np.float64))
        state = state._replace(best=best, bounded=state.bounded + len(cells.piece))
        return self._kept(state, _Waiting(cells, upper, chosen))

    def _kept(self, state: _PointQuery, new: _Waiting) -> _PointQuery:
        """The state without what cannot matter any more."""
        parts = state.waiting, new
        cells = CellRows(*(np.concatenate(x) for x in zip(*(p.cells for p in parts), strict=True)))
        every = _Waiting(cells, *(np.concatenate(x) for x in zip(*(p[1:] for p in parts), strict=True)))
        width = np.max(cells.high - cells.low, axis=1, initial=0.0)
        done = (every.upper <= self._goal(state.best)) | (width <= 16 * unit_roundoff(cells.low.dtype))
        settled = max(state.settled, float(np.max(every.upper[done], initial=-np.inf)))
        return state._replace(waiting=every.take(np.flatnonzero(~done)), settled=settled)

    def _better(
        self,
        best: PlaceFound | None,
        cells: CellRows,
        places: PlacesOfCells,
        near: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
    ) -> PlaceFound | None:
        """The farthest place found so far."""
        proven = np.where(np.isfinite(places.radius), (low - places.radius) * (1 - 4e-16), -np.inf)
        row, k = np.unravel_index(int(np.argmax(proven)), proven.shape)
        there = float(proven[row, k])
        if there == -np.inf or (best is not None and there <= best.lower):
            return best
        distance = 0.5 * float(low[row, k] + high[row, k])
        x, point = places.parameters[row, k], places.points[row, k]
        return PlaceFound(int(cells.piece[row]), x, point, int(near[row, k]), max(there, 0.0), distance)

    def _solution(self, state: _PointQuery) -> HausdorffSolution:
        """The solution in the user's coordinates."""
        best, dtype = state.best, self._cloud.rows.dtype
        known = best is not None
        # Where the surface has no proven point, some place stands for the witness.
        place = best if best is not None else PlaceFound(-1, np.full(1, np.nan), self._cloud.rows[0], 0, 0.0, 0.0)
        upper = max(state.settled, float(np.max(state.waiting.upper, initial=-np.inf)), place.lower)
        gap = upper - max(place.lower, self._level) + 2 * self._moved
        closed = gap <= self._allowed(place.lower) or place.lower > self._ceiling
        full = len(state.waiting.upper) > _WAITING
        failed = RESULTS.capacity_reached if full else RESULTS.gap_not_closed
        result = RESULTS.successful if closed else failed
        lower = max(place.lower - self._moved, 0.0)
        ends = self._frame.length(lower, 0.0), self._frame.length(upper + self._moved if known else np.inf, np.inf)
        distance = place.distance if place.lower > 0 else 0.0
        counts = state.steps, state.bounded, len(state.waiting.upper)
        return HausdorffSolution(
            value=jnp.clip(self._frame.length(np.asarray(distance, dtype)), *ends),
            lower=ends[0].astype(dtype),
            upper=ends[1].astype(dtype),
            witness=self._witness(place, distance, upper - place.lower),
            result=result if known else RESULTS.unverified,
            stats={name: jnp.asarray(count) for name, count in zip(COUNTS, counts, strict=True)},
        )

    def _witness(self, place: PlaceFound, distance: float, gap: float) -> Witness:
        """All points that are nearest to the place, with multipliers, and how the maximum arises."""
        dtype = self._cloud.rows.dtype
        nowhere = np.zeros((0, 3))
        free, into = self._source.rays(place.piece, place.x) if np.all(np.isfinite(place.x)) else (nowhere, nowhere)
        feet, shares = active_points(self._cloud, place.point, place.nearest, gap, free, into)
        several = np.count_nonzero(shares) > 1
        event = EVENTS.one_to_two if several else EVENTS.a_end if len(into) < len(free) else EVENTS.b_end
        t = np.append(place.x, np.zeros(2 - len(place.x))) if place.piece >= 0 else np.nan
        return Witness(
            segment=jnp.asarray(place.piece),
            t=jnp.asarray(t, dtype),
            point=self._frame.place(place.point),
            feet=self._frame.place(self._cloud.rows[feet]),
            foot_segments=jnp.asarray(feet),
            foot_params=jnp.zeros(FEET, dtype),
            multipliers=jnp.asarray(shares, dtype),
            event=event if distance > 0 else EVENTS.coincident,
            direction=DIRECTIONS.a_to_b,
        )


def active_points(
    cloud: Cloud, place: np.ndarray, nearest: int, gap: float, free: np.ndarray, into: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The points (FEET,) that are about nearest to a place and balance there, and their multipliers.

    Args:
        cloud: the points.
        place: the farthest place of the surface.
        nearest: its nearest point.
        gap: upper - lower, which the distances of active feet may differ by.
        free: directions along the surface, as if it had no border.
        into: those into the surface; multipliers that balance all of the free ones serve as well.
    """
    size = max(float(np.max(np.abs(place - cloud.rows[nearest]))), smallest_normal(cloud.rows.dtype))
    around = place + _RING * size * np.concatenate([np.zeros((1, 3)), _CUBE])
    near = np.unique(np.append(cloud.near(around.astype(cloud.rows.dtype))[0], nearest))
    apart = place.astype(np.float64) - cloud.rows[near]
    distance = np.linalg.norm(apart, axis=1)
    equal = max(4 * gap, _EQUAL * size)
    # Points at one place are one foot.
    _, first = np.unique(cloud.rows[near], axis=0, return_index=True)
    order = [k for k in np.argsort(distance, kind="stable") if k in first]
    kept = np.array([k for k in order if distance[k] <= distance.min() + equal][:_MOST])
    units = apart[kept] / np.where(distance[kept] > 0, distance[kept], 1.0)[:, None]
    excess = (distance[kept] - distance.min()) / equal
    shares = balanced(units, free, excess)
    if len(into) < len(free) and np.max(np.abs(free @ units.T @ shares)) > _UNBALANCED:
        shares = balanced(units, into, excess)
    chosen = np.flatnonzero(shares)
    rows = np.append(near[kept[chosen]], np.full(FEET - len(chosen), near[kept[chosen[0]]]))
    return rows, np.append(shares[chosen], np.zeros(FEET - len(chosen)))


def _spread(rows: np.ndarray, places: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """Some of the candidates: the nearest to the middle, and of those about as near the farthest from each other."""
    there = rows[candidates].astype(np.float64)
    middle = places[:, :1].astype(np.float64)
    size = np.sqrt(np.max(np.sum((places - middle) ** 2, axis=2), axis=1))
    far = np.sqrt(np.sum((there - middle) ** 2, axis=2))
    first = np.argmin(far, axis=1)
    index = np.arange(len(first))
    reach = far[index, first] + _TOGETHER * size
    chosen = [first]
    apart = np.sum((there - there[index, first][:, None]) ** 2, axis=2)
    for _ in range(FEET - 1):
        after = np.argmax(np.where(far <= reach[:, None], apart, -1.0), axis=1)
        chosen.append(after)
        apart = np.minimum(apart, np.sum((there - there[index, after][:, None]) ** 2, axis=2))
    return np.stack([candidates[index, k] for k in chosen], axis=1)
