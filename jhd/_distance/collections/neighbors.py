"""The nearest shapes of each query, from a small fraction of all distances.

Proven bounds of all pairs come from pivot distances. A shape whose lower bound is above the k-th smallest upper bound
of a query is not among its k nearest. The remaining shapes are measured, the smallest lower bounds first, up to the
best bound so far: the search of a larger distance ends early.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jhd._distance.collections.pivots import PivotBounds
from jhd._distance.collections.shapes import Collection
from jhd._distance.collections.tasks import measured, pairs_between
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.search import ended_by
from jhd._results.batches import AbstractOutcome
from jhd._results.outcomes import RESULTS


class Standings(NamedTuple):
    """Bounds and results of the distances from some queries to all shapes."""

    lower: np.ndarray  # proven lower bounds (queries, shapes)
    upper: np.ndarray  # proven upper bounds
    value: np.ndarray  # the measured distances, else NaN
    result: np.ndarray  # numbers of RESULTS if measured, else -1


class Neighbors(AbstractOutcome):
    """The nearest shapes of each query by Hausdorff distance, in the order of `value`.

    The k nearest shapes of a query are among the shapes in its row and in its `ties`. The order of two shapes whose
    bounds overlap is not certified.

    Args:
        index: indices of the shapes, (queries, k).
        value: their Hausdorff distances, (queries, k); NaN if the call was interrupted first.
        lower: certified lower bounds of these distances, (queries, k).
        upper: certified upper bounds of these distances, (queries, k).
        result: a member of RESULTS for each query; RESULTS.interrupted if some shapes were not examined.
        ties: for each query, an array of the indices of other shapes that are not certified to be farther than the
            last shape in its row.
        computed: number of distances that were searched.
    """

    index: Int[np.ndarray, "queries neighbors"]
    value: Float[np.ndarray, "queries neighbors"]
    lower: Float[np.ndarray, "queries neighbors"]
    upper: Float[np.ndarray, "queries neighbors"]
    result: RESULTS
    ties: tuple[np.ndarray, ...]
    computed: int

    @property
    def tied(self) -> Bool[np.ndarray, " queries"]:
        """Whether each query has ties."""
        return np.array([len(tie) > 0 for tie in self.ties])

    def __repr__(self) -> str:
        count, k = self.index.shape
        return f"Neighbors({k} of each of {count} queries, {int(self.tied.sum())} tied, {self.computed} computed)"


def standings_of(bounds: PivotBounds, rows: np.ndarray, count: int, same: bool) -> Standings:
    """Return the bounds by pivot distances; the distance of a shape to itself is zero."""
    lower, upper = bounds.between(rows, np.arange(count))
    value, result = np.full(lower.shape, np.nan), np.full(lower.shape, -1, np.int8)
    if same:
        own = np.arange(len(rows)), rows
        lower[own] = upper[own] = value[own] = 0.0
        result[own] = int(RESULTS.successful._value)
    return Standings(lower, upper, value, result)


def nearest_of(
    executor: Executor,
    collections: tuple[Collection, Collection],
    rows: np.ndarray,
    k: int,
    known: Standings,
    method: BranchAndBound,
    report: Callable[[int, int], None],
) -> Neighbors:
    """Return the k nearest shapes of the queries `rows`, or the state so far after an interrupt."""
    done, width, unfinished = 0, k, RESULTS.interrupted
    try:
        while True:
            open_ = _open(known, k)
            query, shape = _first_of_each(open_, known.lower, width)
            if not len(query):
                break
            total = done + int(np.sum(open_))
            report(done, total)
            pairs = pairs_between(rows[query], shape, ceiling=_reach(known, k)[query])
            for index, found in measured(executor, *collections, pairs, method):
                at = query[index], shape[index]
                known.lower[at] = np.maximum(known.lower[at], found.lower)
                known.upper[at] = np.minimum(known.upper[at], found.upper)
                known.value[at], known.result[at] = found.value, found.result
                done += len(index)
                report(done, total)
            # Shapes of each query that are measured in one round, at most: later rounds know better bounds.
            width = min(2 * width, max(8, k))
    except KeyboardInterrupt as stop:
        unfinished = ended_by(stop)
    return _named(known, k, done, unfinished)


def _reach(known: Standings, k: int) -> np.ndarray:
    """Return for each query a length within which k shapes are proven to be."""
    return np.partition(known.upper, k - 1, axis=1)[:, k - 1]


def _open(known: Standings, k: int) -> np.ndarray:
    """Return the pairs that may be among the nearest and were not measured."""
    return (known.lower <= _reach(known, k)[:, None]) & (known.result < 0)


def _first_of_each(open_: np.ndarray, lower: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return for each query the few open shapes of smallest lower bound, as two lists of indices."""
    query, shape = np.nonzero(open_)
    order = np.lexsort((shape, lower[query, shape], query))
    query, shape = query[order], shape[order]
    place = np.arange(len(query)) - np.searchsorted(query, query)
    return query[place < width], shape[place < width]


def _named(known: Standings, k: int, done: int, unfinished: Any) -> Neighbors:
    # A copy: a view would keep the whole order of all shapes.
    index = np.argsort(known.upper, axis=1, kind="stable")[:, :k].copy()
    each = np.arange(len(index))[:, None]
    codes, least = known.result[each, index].astype(int), int(RESULTS.successful._value)
    # The first of the k results that is not successful, if any.
    worst = codes[np.arange(len(codes)), np.argmax(codes != least, axis=1)]
    result = np.where(np.any(_open(known, k), axis=1), int(unfinished._value), worst)
    near = known.lower <= known.upper[each, index].max(axis=1)[:, None]
    near[each, index] = False
    ties = tuple(np.flatnonzero(row) for row in near)
    value, lower, upper = (x[each, index] for x in (known.value, known.lower, known.upper))
    return Neighbors(index, value, lower, upper, results_of(result), ties, done)


def together(parts: list[Neighbors]) -> Neighbors:
    """Return the findings of all queries, in order."""
    rows = [(part.index, part.value, part.lower, part.upper, part.result._value) for part in parts]
    index, value, lower, upper, result = (np.concatenate(x) for x in zip(*rows, strict=True))
    ties = tuple(tie for part in parts for tie in part.ties)
    return Neighbors(index, value, lower, upper, results_of(result), ties, sum(part.computed for part in parts))


def results_of(numbers: np.ndarray) -> Any:
    """Return members of RESULTS from their numbers."""
    return eqx.tree_at(lambda x: x._value, RESULTS.successful, numbers)
