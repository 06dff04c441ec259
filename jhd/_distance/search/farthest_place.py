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

# Feet count together where their distances agree to this many diameters of a cell.
_TOGETHER = 2.0
# Cells cut in a step, at most, and most that wait; each takes 400 bytes.
_BATCH, _WAITING = 1 << 13, 1 << 20
# From this number on, and for each step allowed or piece of the source from _SHARE on, cells that wait belong to a
# family of places that are nearly as far. A cell takes up to 0.2 ms.
_FAMILY, _SHARE = 1 << 15, 8
# What is counted: steps, cells bounded, and cells that wait.
COUNTS = "steps", "cells", "waiting"
# Steps of the first stretch, and the seconds after which any of them ends with the step that it is in.
_FIRST_STEPS, _SECONDS = 24, 0.2
# The step after which the place is first polished with all its feet; then after twice as many, and so on, or after
# every step if so many cells wait: a step takes longer then.
_POLISHED_FROM, _POLISHED_MANY = 4, 256
# Places that are measured in a step: of the cells with the largest bounds, and of those that seem farthest. Where a
# foot that was found is not the nearest a cell and its parts keep their bounds until this shows; most searches end
# before the step from which on that is looked for.
_PROVEN, _MENDED_FROM = 256, 16
# The share of the tolerance that the bounds of a measured place may take.
_MEASURED = 0.05


def spread(feet: FootRows, places: np.ndarray) -> FootRows:
    """Some feet of each cell: the nearest to the middle, and of those about as near the farthest from each other."""
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
    """One foot more for each of some cells, in place of the last one."""
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
    asked: float  # the largest distance of a place that was measured by itself


class FarthestSearch(AbstractSearch):
    """The search.

    Args:
        source: the shape whose farthest place is looked for, in common coordinates.
        target: the shape that distances are taken to, in the same.
        frame: leads back to the user's; `aim` is in their unit.
        moved: by how much common coordinates may misplace both.
        allowed: the gap that may stay at a lower bound.
        aim: what of the distance matters.
        max_steps: most steps.
        about: see FartherPlaces.
        followed: bounds that cost more and are closer, or None.
        graphs: the same of and on implicit surfaces, or None.
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

    @override
    def longer(self, state: _FarthestState) -> _FarthestState:
        """It is never full."""
        return state

    def _goal(self, best: PlaceFound | None) -> float:
        return self._level if best is None else max(best.lower + 0.9 * self._allowed(best.lower), self._level)

    def _close(self, best: PlaceFound | None) -> float:
        """By how much the bounds of a measured place may be apart."""
        return _MEASURED * self._allowed(0.0 if best is None else best.lower)

    def _going(self, state: _FarthestState) -> bool:
        lower = 0.0 if state.best is None else state.best.lower
        waiting = len(state.waiting.upper)
        return 0 < waiting <= _WAITING and lower <= self._ceiling and not self._hopeless(state)

    def _hopeless(self, state: _FarthestState) -> bool:
        """Whether the cells of a family of farthest places will need more room than there is before its bounds close.

        Their number grows like the inverse of the gap.
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
        """The state with new cells, of which bounds are known already."""
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
                    # Where many points of the target are nearest that takes longer, which one place by itself may.
                    alone = self._measured(best, flat[who[k]], open_[k])
                    best = self._raised(best, self._better(best, cells, places, who[k], alone))
                    state = state._replace(asked=float(open_[k[0]]))
        state = state._replace(best=best, bounded=state.bounded + len(cells.piece))
        return self._kept(state, _Waiting(cells, upper, chosen))

    def _measured(self, best: PlaceFound | None, points: np.ndarray, seems: np.ndarray) -> ProvenFeet:
        """Distances of places, as close as is needed where they may be farther than the best one, as they seem to be.

        Where they do not seem so the feet may be those of a place alone, which leave its cell and the cells beside it
        with bounds too large: the nearest ones are looked for.
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
        """Bounds over cells, by feet that are followed where that is known, then where they matter by flat pieces."""
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
        """Places worth a proof: of the cells with the largest bounds those that seem farthest, and the farthest of all.

        Args:
            best: the farthest place so far.
            high: upper bounds of the distances of the places, -inf of those that may not be of the source.
            upper: those of the cells.
            mending: whether cells whose places do not seem farther count too: their feet may not be the nearest.
        """
        place, seems = np.argmax(high, axis=1), np.max(high, axis=1)
        least = -np.inf if best is None else best.lower + self._close(best)
        matters = np.flatnonzero(upper > self._goal(best))
        worth = matters[seems[matters] > least]
        if best is None and not len(worth):
            # Some place is always measured: the witness is the farthest of those that were.
            worth = np.flatnonzero(seems == np.max(seems))[:1]
        open_ = matters if mending and best is not None else worth
        by_bound = open_[np.argsort(-upper[open_], kind="stable")[:_PROVEN]]
        by_place = worth[np.argsort(-seems[worth], kind="stable")[:_PROVEN]]
        chosen = np.union1d(by_bound, by_place)
        return chosen * high.shape[1] + place[chosen]

    def _kept(self, state: _FarthestState, new: _Waiting) -> _FarthestState:
        """The state without what cannot matter any more."""
        every = new if state.waiting is None else joined([state.waiting, new])
        width = np.max(np.abs(every.cells.high - every.cells.low), axis=1, initial=0.0)
        done = (every.upper <= self._goal(state.best)) | (width <= 16 * unit_roundoff(every.cells.low.dtype))
        settled = max(state.settled, float(np.max(every.upper[done], initial=-np.inf)))
        return state._replace(waiting=every.take(np.flatnonzero(~done)), settled=settled)

    def _better(
        self, best: PlaceFound | None, cells: CellRows, places: PlacesOfCells, who: np.ndarray, found: ProvenFeet
    ) -> PlaceFound | None:
        """The farthest place found so far, after some more were measured."""
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
        """A new place moved to where its distance is largest, as long as the same foot is the nearest."""
        if best is None or best is before or self._followed is None:
            return best
        return self._places.with_its_foot(best, self._close(best))

    def _solution(self, state: _FarthestState) -> HausdorffSolution:
        """The solution in the user's coordinates."""
        best, dtype = state.best, self._frame.center.dtype
        # Where no place is proven, some place stands for the witness.
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
        """The state with its place polished, after so many steps that this costs little beside them.

        On a ridge, where two feet are as near, places of cells come no nearer to it than cells are wide, and the
        distance falls off as fast: without this cells had to be as small as the gap.
        """
        often = state.steps & (state.steps - 1) == 0 or len(state.waiting.upper) >= _POLISHED_MANY
        due = state.steps >= _POLISHED_FROM and often
        if not due or state.best is None or not self._going(state):
            return state
        return state._replace(best=self._polished(state, state.best))

    def _polished(self, state: _FarthestState, best: PlaceFound) -> PlaceFound:
        """The farthest place to full precision, proven again; the one that is known where that is not farther."""
        return self._places.with_all_feet(best, self._upper(state) - best.lower, self._close(best))

    def _nowhere(self, dtype: Any) -> PlaceFound:
        cells = self._source.cover().take(slice(0, 1))
        point = self._source.places(cells).points[0, 0]
        foot = self._target.rows_of(self._target.near(point[None]))
        foot = foot._replace(point=np.where(np.isfinite(foot.point), foot.point, point))
        return PlaceFound(int(cells.piece[0]), np.full(cells.low.shape[1], np.nan, dtype), point, foot, 0.0, 0.0, 0.0)

    def _witness(self, place: PlaceFound, distance: float, gap: float) -> Witness:
        """All points that are nearest to the place, with multipliers, and how the maximum arises."""
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
