"""Hausdorff distances from curves, surfaces and meshes to any shape: the point of a that is farthest from b.

Cells of a wait with proven upper bounds (jhd._distance.search.sources). A step takes the cells with the largest bounds,
cuts them, finds points of b near their middles and corners, and bounds the parts by these. A point with a large proven
distance to all of b raises the lower bound. If nearest points cost little, the search measures each point, otherwise
only points that seem to be farthest in the cells with the largest bounds, whose feet then improve as well. A cell is
dropped as soon as its bound is within the tolerance of the lower bound. Some of the feet known near a cell are kept for
its parts.
"""

import time
from typing import Any, NamedTuple

import numpy as np
from typing_extensions import override

from jhd._arithmetic.rounding import cast, unit_roundoff
from jhd._distance.cells.surfaces import FEET
from jhd._distance.nearest.target import AbstractTarget, FootRows, ProvenFeet
from jhd._distance.normalization.coordinates import Frame, user_length
from jhd._distance.normalization.stopping import Aim, AllowedGap
from jhd._distance.search.followed_cells import FollowedFeet
from jhd._distance.search.followed_graphs import FollowedGraphs, FollowedOnSurface
from jhd._distance.search.incumbent import FartherPlaces, PlaceFound
from jhd._distance.search.polished_place import About
from jhd._distance.search.search import AbstractSearch, Standing
from jhd._distance.search.sources import AbstractSource, CellRows, PlaceOfCut, PlacesOfCells
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness, on_device
from jhd._runtime.arrays import joined, taken

# Feet count together if their distances agree to this many diameters of a cell.
_TOGETHER = 2.0
# Cells cut in a step, at most, and most that wait; each takes 400 bytes.
_BATCH, _WAITING = 1 << 13, 1 << 20
# If more cells wait than this, and than _SHARE for each step allowed or piece of the source, the farthest points are
# not isolated. A cell takes up to 0.2 ms.
_FAMILY, _SHARE = 1 << 15, 8
# Counts: steps, cells bounded, and cells that wait.
COUNTS = "steps", "cells", "waiting"
# Steps of the first stretch, and the seconds after which any stretch ends with its current step.
_FIRST_STEPS, _SECONDS = 24, 0.2
# The step after which the point is first polished with all its feet; then after twice as many, and so on, or after
# every step if this many cells wait: a step takes longer then.
_POLISHED_FROM, _POLISHED_MANY = 4, 256
# Points measured in a step: in the cells with the largest bounds, and the points that seem farthest. If a foot found is
# not the nearest, a cell and its parts keep their bounds until this shows; most searches end before the step at which
# this is checked.
_PROVEN, _MENDED_FROM = 256, 16
# Fraction of the tolerance that the bounds of a measured point may take.
_MEASURED = 0.05


def spread(feet: FootRows, places: np.ndarray) -> FootRows:
    """Return some feet for each cell: the nearest to the middle, and of the about equally near the most distant."""
    there = np.where(feet.error[..., None] < np.inf, feet.point, np.nan).astype(np.float64)
    middle = places[:, :1].astype(np.float64)
    size = np.sqrt(np.max(np.sum((places - middle) ** 2, axis=2), axis=1))
    far = np.sqrt(np.sum((there - middle) ** 2, axis=2))
    far = np.where(np.isnan(far), np.inf, far)
    first = np.argmin(far, axis=1)
    index = np.arange(len(first))
    reach = far[index, first] + _TOGETHER * size
    chosen = [first]
    apart = np.sum((there - there[index, first][:, None]) ** 2, axis=2)
    for _ in range(FEET - 1):
        after = np.argmax(np.where(far <= reach[:, None], apart, -1.0), axis=1)
        chosen.append(after)
        apart = np.fmin(apart, np.sum((there - there[index, after][:, None]) ** 2, axis=2))
    rows = np.stack(chosen, axis=1)
    return feet.take((index[:, None], rows))


def put(feet: FootRows, cells: np.ndarray, rows: FootRows) -> None:
    """Write one foot for each of some cells over the last foot, in place."""
    for held, new in zip(feet, rows, strict=True):
        held[cells, -1] = new


class _Waiting(NamedTuple):
    cells: CellRows
    upper: np.ndarray
    feet: FootRows  # (cells, FEET)

    take = taken


class _FarthestState(NamedTuple):
    waiting: Any  # _Waiting, None before there are any
    best: PlaceFound | None
    settled: float
    steps: int
    bounded: int
    covered: int  # pieces that the search began with
    asked: float  # largest distance of a point that was measured alone


class FarthestSearch(AbstractSearch):
    """The search for the farthest point of a source.

    Args:
        source: the shape whose farthest point is searched, in common coordinates.
        target: the shape that distances are taken to, in common coordinates.
        frame: leads back to the user's; `aim` is in their unit.
        moved: bound on the error of the common coordinates of both.
        allowed: the gap that may stay at a lower bound.
        aim: range of distances that matter.
        max_steps: most steps.
        about: see FartherPlaces.
        followed: bounds that cost more and are closer, or None.
        graphs: such bounds over cells of, or with feet on, implicit surfaces, or None.
    """

    first_steps = _FIRST_STEPS

    def __init__(
        self,
        source: AbstractSource,
        target: AbstractTarget,
        frame: Frame,
        moved: float,
        allowed: AllowedGap,
        aim: Aim,
        max_steps: int,
        about: About,
        followed: FollowedFeet | None = None,
        graphs: FollowedGraphs | FollowedOnSurface | None = None,
    ):
        self._places, self._followed, self._graphs = FartherPlaces(source, target, about), followed, graphs
        self._source, self._target, self._frame, self._moved, self._allowed = source, target, frame, moved, allowed
        level, ceiling = (np.asarray(x, float) for x in aim)
        # Bounds here are off by as much as the coordinates are.
        self._level = float(frame.common(level, 0.0)) - moved
        self._ceiling = float(frame.common(ceiling, np.inf)) + moved
        self.max_steps = max_steps

    @override
    def begin(self) -> _FarthestState:
        cells = self._source.cover()
        upper = np.full(len(cells.piece), np.inf)
        return self._entered(_FarthestState(None, None, -np.inf, 0, 0, len(upper), -np.inf), cells, upper, None)

    @override
    def advance(self, state: _FarthestState, limit: int, growing: bool) -> tuple[_FarthestState, Standing]:
        began = time.perf_counter()
        while self._going(state) and state.steps < limit:
            state = self._sharpened(self._step(state))
            if time.perf_counter() - began > _SECONDS:
                break
        going = self._going(state)
        if not going and state.best is not None:
            state = state._replace(best=self._polished(state, state.best))
        return state, Standing(self._solution(state), going, False, state.steps, len(state.waiting.upper))

    def _goal(self, best: PlaceFound | None) -> float:
        return self._level if best is None else max(best.lower + 0.9 * self._allowed(best.lower), self._level)

    def _close(self, best: PlaceFound | None) -> float:
        """Return the gap that the bounds of a measured point may have."""
        return _MEASURED * self._allowed(0.0 if best is None else best.lower)

    def _going(self, state: _FarthestState) -> bool:
        lower = 0.0 if state.best is None else state.best.lower
        waiting = len(state.waiting.upper)
        return 0 < waiting <= _WAITING and lower <= self._ceiling and not self._hopeless(state)

    def _hopeless(self, state: _FarthestState) -> bool:
        """Return whether cells near non-isolated farthest points will exceed the capacity before the bounds close.

        The number of cells grows like the inverse of the gap.
        """
        waiting, lower = len(state.waiting.upper), 0.0 if state.best is None else state.best.lower
        gap = self._upper(state) - max(lower, self._level)
        many = waiting > max(_FAMILY, _SHARE * max(self.max_steps, state.covered))
        return many and waiting * gap > _WAITING * self._allowed(lower)

    def _step(self, state: _FarthestState) -> _FarthestState:
        waiting = state.waiting
        if len(waiting.upper) > _BATCH:
            order = np.argpartition(-waiting.upper, _BATCH)
            taken, rest = waiting.take(order[:_BATCH]), waiting.take(order[_BATCH:])
        else:
            taken, rest = waiting, waiting.take(slice(0, 0))
        best = state.best
        cells, parent = self._source.cut(taken.cells, None if best is None else PlaceOfCut(best.piece, best.x))
        state = state._replace(waiting=rest, steps=state.steps + 1)
        if not len(cells.piece):
            return state
        return self._entered(state, cells, taken.upper[parent], taken.feet.take(parent))

    def _entered(
        self, state: _FarthestState, cells: CellRows, upper: np.ndarray, feet: FootRows | None
    ) -> _FarthestState:
        """Return the state with new cells with known bounds."""
        places = self._source.places(cells)
        flat = places.points.reshape(-1, 3)
        if self._target.sharp:
            found = self._target.nearest(flat)
            who = np.arange(len(flat))
            best = self._raised(state.best, self._better(state.best, cells, places, who, found))
        else:
            found, best = self._target.near(flat), state.best
        rows = self._in_cells(self._target.rows_of(found), places)
        candidates = (
            rows if feet is None else FootRows(*(np.concatenate(x, axis=1) for x in zip(rows, feet, strict=True)))
        )
        chosen = spread(candidates, places.points)
        upper = self._bounded(best, cells, upper, places.points[:, 0], candidates, chosen)
        if not self._target.sharp:
            high = np.where(np.isfinite(places.radius), found.upper.reshape(places.radius.shape), -np.inf)
            who = self._promising(best, high, upper, state.steps >= _MENDED_FROM)
            if len(who):
                proven = self._measured(best, flat[who], high.ravel()[who])
                best = self._raised(best, self._better(best, cells, places, who, proven))
                # The feet serve the parts of these cells.
                in_cell = who // places.radius.shape[1]
                put(chosen, in_cell, self._target.rows_of(proven))
                open_ = np.where(proven.closed, -np.inf, np.minimum(proven.upper, upper[in_cell]))
                k = [int(np.argmax(open_))]
                if open_[k[0]] > max(self._goal(best), state.asked + self._close(best)):
                    # If many points of the target are nearest, measuring takes longer; a single point may take it.
                    alone = self._measured(best, flat[who[k]], open_[k])
                    best = self._raised(best, self._better(best, cells, places, who[k], alone))
                    state = state._replace(asked=float(open_[k[0]]))
        state = state._replace(best=best, bounded=state.bounded + len(cells.piece))
        return self._kept(state, _Waiting(cells, upper, chosen))

    def _measured(self, best: PlaceFound | None, points: np.ndarray, seems: np.ndarray) -> ProvenFeet:
        """Return nearest points, proven as close as needed for points that seem farther than the best one.

        Other points are measured completely: feet that are not the nearest leave their cell and its neighbors with
        bounds that are too large.
        """
        least = self._level if best is None else max(best.lower + self._close(best), self._level)
        return self._target.nearest(points, np.where(seems > least, least, -np.inf), self._close(best), hasty=True)

    def _bounded(
        self,
        best: PlaceFound | None,
        cells: CellRows,
        upper: np.ndarray,
        middle: np.ndarray,
        candidates: FootRows,
        feet: FootRows,
    ) -> np.ndarray:
        """Return bounds over cells by followed feet if possible, then, if still needed, by flat pieces and graphs."""
        goal, rows = self._goal(best), np.arange(len(upper))
        if self._followed is not None:
            order = np.argsort(np.sum((candidates.point - middle[:, None]) ** 2, axis=2), axis=1, kind="stable")
            ordered = candidates.take((rows[:, None], order))
            upper = np.fmin(upper, self._followed.over(cells, ordered, goal))
            rows = np.flatnonzero(upper > goal)
        if len(rows):
            bound = self._source.over(cells.take(rows), self._target, feet.take(rows))
            upper[rows] = np.fmin(upper[rows], bound.astype(np.float64))
            rows = rows[upper[rows] > goal]
        if self._graphs is not None and len(rows):
            bound = self._graphs.over(cells.take(rows), feet.take(rows), goal)
            upper[rows] = np.fmin(upper[rows], bound)
        return upper

    def _in_cells(self, rows: FootRows, places: PlacesOfCells) -> FootRows:
        shape = places.points.shape[:2]
        return rows.map(lambda x: x.reshape(*shape, *x.shape[1:]))

    def _promising(self, best: PlaceFound | None, high: np.ndarray, upper: np.ndarray, mending: bool) -> np.ndarray:
        """Return indices of points worth a proof: the farthest in cells with the largest bounds, and overall.

        Bounds `high` of points that may not lie on the source are -inf. If `mending`, cells whose points do not seem
        farther count too: their feet may not be the nearest.
        """
        place, seems = np.argmax(high, axis=1), np.max(high, axis=1)
        least = -np.inf if best is None else best.lower + self._close(best)
        matters = np.flatnonzero(upper > self._goal(best))
        worth = matters[seems[matters] > least]
        if best is None and not len(worth):
            # Some point is always measured: the witness is the farthest measured point.
            worth = np.flatnonzero(seems == np.max(seems))[:1]
        open_ = matters if mending and best is not None else worth
        by_bound = open_[np.argsort(-upper[open_], kind="stable")[:_PROVEN]]
        by_place = worth[np.argsort(-seems[worth], kind="stable")[:_PROVEN]]
        chosen = np.union1d(by_bound, by_place)
        return chosen * high.shape[1] + place[chosen]

    def _kept(self, state: _FarthestState, new: _Waiting) -> _FarthestState:
        """Return the state without the cells that cannot matter any more, and with new ones."""
        every = new if state.waiting is None else joined([state.waiting, new])
        width = np.max(np.abs(every.cells.high - every.cells.low), axis=1, initial=0.0)
        done = (every.upper <= self._goal(state.best)) | (width <= 16 * unit_roundoff(every.cells.low.dtype))
        settled = max(state.settled, float(np.max(every.upper[done], initial=-np.inf)))
        return state._replace(waiting=every.take(np.flatnonzero(~done)), settled=settled)

    def _better(
        self, best: PlaceFound | None, cells: CellRows, places: PlacesOfCells, who: np.ndarray, found: ProvenFeet
    ) -> PlaceFound | None:
        """Return the farthest point found so far, after more points were measured."""
        radius = places.radius.ravel()[who]
        lower = found.lower.astype(np.float64)
        proven = np.where(np.isfinite(radius), (lower - radius) * (1 - 4e-16), -np.inf)
        row = int(np.argmax(proven))
        there = float(proven[row])
        if there == -np.inf or (best is not None and there <= best.lower):
            return best
        k = int(who[row])
        cell, place = divmod(k, places.radius.shape[1])
        x, point = places.parameters[cell, place], places.points[cell, place]
        foot = self._target.rows_of(taken(found, slice(row, row + 1)))
        distance = float(found.distance[row])
        return PlaceFound(int(cells.piece[cell]), x, point, foot, max(there, 0.0), distance, float(radius[row]))

    def _raised(self, before: PlaceFound | None, best: PlaceFound | None) -> PlaceFound | None:
        """Move a new farthest point to a maximum of its distance, while its foot stays the nearest."""
        if best is None or best is before or self._followed is None:
            return best
        return self._places.with_its_foot(best, self._close(best))

    def _solution(self, state: _FarthestState) -> HausdorffSolution:
        """Return the solution in the user's coordinates."""
        best, dtype = state.best, self._frame.center.dtype
        # If no point is proven, an arbitrary point is the witness.
        place = best if best is not None else self._nowhere(dtype)
        upper = max(self._upper(state), place.lower)
        known = best is not None and np.isfinite(upper)
        gap = upper - max(place.lower, self._level) + 2 * self._moved
        closed = gap <= self._allowed.asked(place.lower) or place.lower > self._ceiling
        full = len(state.waiting.upper) > _WAITING
        failed = RESULTS.capacity_reached if full else RESULTS.gap_not_closed
        failed = RESULTS.nonisolated_maxima if self._hopeless(state) else failed
        result = RESULTS.successful if closed else failed
        lower = max(place.lower - self._moved, 0.0)
        distance = place.distance if place.lower > 0 else 0.0
        counts = state.steps, state.bounded, len(state.waiting.upper)
        high = upper + self._moved if known else np.inf
        ends = cast(user_length(self._frame, lower, 0.0), dtype, -np.inf)
        ends = ends, cast(user_length(self._frame, high, np.inf), dtype, np.inf)
        value = np.clip(user_length(self._frame, np.asarray(distance, dtype), None), *ends).astype(dtype)
        stats = {name: np.asarray(count) for name, count in zip(COUNTS, counts, strict=True)}
        witness = self._witness(place, distance, upper - place.lower)
        value, low, high, stats = on_device((value, *ends, stats))
        return HausdorffSolution(value, low, high, witness, result if known else RESULTS.existence_not_certified, stats)

    def _upper(self, state: _FarthestState) -> float:
        return max(state.settled, float(np.max(state.waiting.upper, initial=-np.inf)))

    def _sharpened(self, state: _FarthestState) -> _FarthestState:
        """Return the state with its farthest point polished, if it is due.

        On a ridge, which has two equally near feet, points of cells are as far from the ridge as cells are wide. The
        distance falls off linearly, so without polishing the cells would have to be as small as the gap.
        """
        often = state.steps & (state.steps - 1) == 0 or len(state.waiting.upper) >= _POLISHED_MANY
        due = state.steps >= _POLISHED_FROM and often
        if not due or state.best is None or not self._going(state):
            return state
        return state._replace(best=self._polished(state, state.best))

    def _polished(self, state: _FarthestState, best: PlaceFound) -> PlaceFound:
        """Return the farthest point to full precision, proven again; the known one unless the new one is farther."""
        return self._places.with_all_feet(best, self._upper(state) - best.lower, self._close(best))

    def _nowhere(self, dtype: Any) -> PlaceFound:
        cells = self._source.cover().take(slice(0, 1))
        point = self._source.places(cells).points[0, 0]
        foot = self._target.rows_of(self._target.near(point[None]))
        foot = foot._replace(point=np.where(np.isfinite(foot.point), foot.point, point))
        return PlaceFound(int(cells.piece[0]), np.full(cells.low.shape[1], np.nan, dtype), point, foot, 0.0, 0.0, 0.0)

    def _witness(self, place: PlaceFound, distance: float, gap: float) -> Witness:
        """Return all nearest points of the farthest point, with multipliers, and the event of the maximum."""
        dtype = self._frame.center.dtype
        feet, shares, at_border = self._places.active(place, gap)
        several = np.count_nonzero(shares) > 1
        event = EVENTS.one_to_two if several else EVENTS.b_end
        if at_border and not several:
            event = self._source.border_event(place.piece, place.x, place.point - place.foot.point[0])
        t, params = self._source.parameters(place.x), self._target.parameters(feet.t)
        numbers = (np.asarray(x, dtype) for x in (t, params, shares))
        segments = np.asarray(place.piece), np.asarray(feet.segment)
        t, params, shares, segment, feet_elements = on_device((*numbers, *segments))
        return Witness(
            element=segment,
            t=t,
            point=self._frame.place(place.point),
            feet=self._frame.place(feet.point),
            feet_elements=feet_elements,
            feet_params=params,
            multipliers=shares,
            event=event if distance > 0 else EVENTS.coincident,
            direction=DIRECTIONS.a_to_b,
        )
