"""Distribution of the distance to a shape over another: its mean, its root mean square, and cells for quantiles.

Cells of a with proven measures (jhd._distance.search.weighted_cells) get proven bounds of the distance over them and of
its means there (jhd._distance.cells.mean_bounds). A step cuts the cells that contribute most to the gaps, until both
means are known to the tolerance. Later requests (quantiles, fractions) use the same cells.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from typing_extensions import override

from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.cells.arc_length_area import FlatCells
from jhd._distance.cells.mean_bounds import NEAR, OverCells, distances_over
from jhd._distance.cells.weighted import Values, Weights, mean_bounds, quantile_bounds
from jhd._distance.nearest.target import AbstractTarget
from jhd._distance.search.cell_heights import CellHeights
from jhd._distance.search.search import AbstractSearch, Standing
from jhd._distance.search.sources import CellRows
from jhd._distance.search.weighted_cells import AbstractMeasured
from jhd._results.solution import RESULTS
from jhd._runtime.arrays import joined, taken

# Cells cut in a step: at most, and at least if there are enough; and the fraction of the gap that they leave.
_BATCH, _LEAST, _MOST_OF = 1 << 13, 64, 0.8
# Cells that get bounds at once under a time limit: those of a step may take a minute.
_AT_ONCE = 1 << 8
# Cells are cut down to this width.
_THIN = 2.0**-40
# Contribution to the gap of a cell without an upper bound; sums of it stay finite.
_UNKNOWN = 1e200
# Steps of the first stretch.
_FIRST_STEPS = 4
# Exceeds the roundings of a square or root and of this factor. Squares that underflow are less than the error of the
# common coordinates (jhd._distance.deviation).
_FEW = gamma(8, np.float64)
# Counts: steps, and cells at the end.
COUNTS = "steps", "cells"


class DistanceCells(NamedTuple):
    """Cells of a with their measures and distances, in common coordinates."""

    cells: CellRows  # the cells
    flat: FlatCells  # flat pieces close to them, with their measures
    over: OverCells  # bounds of the distance

    @property
    def weights(self) -> Weights:
        """Bounds of the measures."""
        return Weights(self.flat.lower, self.flat.upper)

    @property
    def values(self) -> Values:
        """Bounds of the distance."""
        return Values(self.over.lower, self.over.upper, self.over.ends)

    take = taken


class Distribution(NamedTuple):
    """Bounds of the distribution of the distance along a, in common coordinates."""

    lower: float  # lower bound of the mean
    upper: float  # upper bound of the mean
    rms: tuple[float, float]  # bounds of the root mean square
    result: Any  # a member of RESULTS
    cells: DistanceCells  # cells that cover all of a
    steps: int  # steps taken


class _DistributionState(NamedTuple):
    table: DistanceCells
    steps: int


class DistributionSearch(AbstractSearch):
    """The search for the distribution of the distance.

    Args:
        source: the shape along which the distance is measured.
        target: the shape that distances are taken to, in these coordinates.
        dtype: type of their numbers.
        most: an upper bound of all distances, infinite if none is known.
        allowed: the gap that may stay at an upper bound.
        max_cells: most cells.
        max_steps: most steps.
        share: fraction whose quantile must meet the tolerance too, or None.
        heights: bounds of the cells by heights, if the target is a curved shape.
        is_over: tells whether the time is up; further cells then keep the bounds that are known. None without a limit.
    """

    first_steps = _FIRST_STEPS

    def __init__(
        self,
        source: AbstractMeasured,
        target: AbstractTarget,
        dtype: Any,
        most: float,
        allowed: Callable[[float], float],
        max_cells: int,
        max_steps: int,
        share: float | None = None,
        heights: CellHeights | None = None,
        is_over: Callable[[], bool] | None = None,
    ):
        self._source, self._target, self._dtype, self._most = source, target, np.dtype(dtype), most
        self._allowed, self._max_cells, self.max_steps, self._share = allowed, max_cells, max_steps, share
        self._heights, self._is_over = heights, is_over

    @override
    def begin(self) -> _DistributionState:
        cells = self._source.cover()
        return _DistributionState(self._bounded(cells, None), 0)

    @override
    def advance(self, state: _DistributionState, limit: int, growing: bool) -> tuple[_DistributionState, Standing]:
        found, scores = self._found(state)
        while self._goes_on(found, scores) and state.steps < limit and not self._ends():
            state = self._step(state, scores)
            found, scores = self._found(state)
        waiting = int(np.count_nonzero(scores))
        return state, Standing(found, self._goes_on(found, scores), False, state.steps, waiting)

    def _bounded(self, cells: CellRows, parents: OverCells | None) -> DistanceCells:
        """Return cells with all their bounds; the bounds of the parents hold for them too."""
        flat = self._source.flat(cells)
        if self._source.dimension == 0:
            return DistanceCells(cells, flat, self._measured(flat.corners[:, 0], flat.slack))
        count = len(cells.piece)
        size = max(count, 1) if self._is_over is None else _AT_ONCE
        blocks = [np.arange(k, min(k + size, count)) for k in range(0, max(count, 1), size)]
        reach = np.full(count, NEAR) if parents is None else parents.reach
        over = joined([self._over(cells.take(rows), flat.take(rows), reach[rows]) for rows in blocks])
        upper = np.minimum(over.upper, self._most)
        lower = over.lower
        if parents is not None:
            lower, upper = np.maximum(lower, parents.lower), np.minimum(upper, parents.upper)
        # A bound over the whole cell also bounds the mean.
        mean = np.stack([np.maximum(over.mean[:, 0], lower), np.minimum(over.mean[:, 1], upper)], axis=1)
        ends = [np.maximum(over.square[:, 0], _down(lower**2)), np.minimum(over.square[:, 1], _up(upper**2))]
        over = over._replace(lower=lower, upper=upper, mean=mean, square=np.stack(ends, axis=1))
        return DistanceCells(cells, flat, over)

    def _ends(self) -> bool:
        return self._is_over is not None and self._is_over()

    def _over(self, cells: CellRows, flat: FlatCells, reach: np.ndarray) -> OverCells:
        """Return the bounds over cells, without those that hold for all; if the time is up, no others are known."""
        if self._ends():
            none, corners = np.tile([0.0, np.inf], (len(reach), 1)), flat.corners.shape[:2]
            ends = np.broadcast_to([0.0, self._most], (*corners, 2))
            return OverCells(none[:, 0], none[:, 1], none, none, reach, ends, np.zeros(corners))
        heights = None if self._heights is None else partial(self._heights.over, cells)
        return distances_over(flat, self._target, self._dtype, reach, self._allowed(0.0), heights)

    def _measured(self, points: np.ndarray, slack: np.ndarray) -> OverCells:
        """Return the bounds at single points."""
        found = self._target.nearest(points.astype(self._dtype))
        lower = _down(np.maximum(found.lower.astype(np.float64) - slack, 0.0))
        upper = np.minimum(_up(found.upper.astype(np.float64) + slack), self._most)
        mean = np.stack([lower, upper], axis=1)
        square = np.stack([_down(lower**2), _up(upper**2)], axis=1)
        nothing = np.zeros_like(lower)
        return OverCells(lower, upper, mean, square, nothing, mean[:, None], nothing[:, None])

    def _found(self, state: _DistributionState) -> tuple[Distribution, np.ndarray]:
        """Return the distribution so far, and the gap that each cell leaves, in units of the allowed gap."""
        table = state.table
        weights, over = table.weights, table.over
        mean = mean_bounds(weights, over.mean[:, 0], over.mean[:, 1])
        square = mean_bounds(weights, over.square[:, 0], over.square[:, 1])
        rms = max(float(_down(np.sqrt(square[0]))), mean[0]), float(_up(np.sqrt(square[1])))
        mean = mean[0], min(mean[1], rms[1])
        scores = np.zeros(len(weights.lower))
        for ends, values, bounds, unit in (
            (mean, over.mean, mean, 1.0),
            (rms, over.square, square, 2 * max(rms[0], self._allowed(rms[1]))),
        ):
            goal = self._allowed(ends[1])
            if not self._closed(ends):
                scores += _left_open(weights, values, bounds) / (unit * goal)
        level = (0.0, 0.0)
        if self._share is not None:
            level = quantile_bounds(weights, table.values, self._share)
            level = level[0], min(level[1], self._most)
            if not self._closed(level):
                # Distances that may lie on either side of the level.
                across = np.minimum(over.upper, level[1]) - np.maximum(over.lower, level[0])
                across = np.minimum(across, np.max(over.ends[..., 1] - over.ends[..., 0], axis=1))
                scores += np.maximum(across, 0.0) * weights.upper / (self._allowed(level[1]) * np.sum(weights.upper))
        width = np.max(np.abs(table.cells.high - table.cells.low), axis=1, initial=0.0)
        scores = np.where(width > _THIN, np.nan_to_num(scores, nan=0.0, posinf=_UNKNOWN), 0.0)
        full = len(scores) >= self._max_cells
        result = RESULTS.capacity_reached if full else RESULTS.gap_not_closed
        if self._closed(mean) and self._closed(rms) and self._closed(level):
            result = RESULTS.successful
        elif not np.isfinite(mean[1]):
            result = RESULTS.existence_not_certified
        found = Distribution(*mean, rms, result, table, state.steps)
        return found, np.zeros_like(scores) if result == RESULTS.successful else scores

    def _closed(self, ends: tuple[float, float]) -> bool:
        return bool(np.isfinite(ends[1]) and ends[1] - ends[0] <= self._allowed(ends[1]))

    def _goes_on(self, found: Distribution, scores: np.ndarray) -> bool:
        closed = found.result == RESULTS.successful
        return not closed and self._source.dimension > 0 and len(scores) < self._max_cells and bool(np.any(scores))

    def _step(self, state: _DistributionState, scores: np.ndarray) -> _DistributionState:
        """Cut the cells that contribute most to the gaps."""
        order = np.argsort(-scores, kind="stable")
        shares = np.cumsum(scores[order]) / np.sum(scores)
        count = min(max(int(np.searchsorted(shares, _MOST_OF)) + 1, _LEAST), _BATCH, np.count_nonzero(scores))
        table = state.table
        taken, rest = table.take(order[:count]), table.take(order[count:])
        cells, parent = self._source.cut(taken.cells, taken.flat, taken.over.parting)
        parts = self._bounded(cells, taken.over.take(parent))
        return _DistributionState(joined([rest, parts]), state.steps + 1)


def _left_open(weights: Weights, values: np.ndarray, bounds: tuple[float, float]) -> np.ndarray:
    """Return the gap of the mean that each cell causes: by its own bounds, and by the bounds of its weight."""
    middle = 0.5 * (bounds[0] + bounds[1])
    off = np.maximum(np.abs(values[:, 1] - middle), np.abs(values[:, 0] - middle))
    with np.errstate(invalid="ignore"):
        open_ = weights.upper * (values[:, 1] - values[:, 0]) + (weights.upper - weights.lower) * off
    return open_ / max(float(np.sum(weights.upper)), smallest_normal(np.float64))


def _down(x: Any) -> Any:
    return x * (1 - _FEW)


def _up(x: Any) -> Any:
    return x * (1 + _FEW)
