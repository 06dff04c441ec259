"""Entry points for many shapes: all pairs, the nearest shapes of each query, all pairs within a threshold.

Shapes can be of any kinds, also mixed, of one dimension. Curves, which may differ in degree and number of segments,
are measured in blocks by a few compiled functions; shapes of other kinds one after the other. The work runs on threads,
or on any executor.

Pivot distances find the pairs that may be within a threshold without visiting all pairs. Distances from one point,
sorted, give each shape a window of candidates; in this window all points are compared.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jhd._distance.collections.neighbors import Neighbors, nearest_of, results_of, standings_of, together
from jhd._distance.collections.pivots import (
    PivotBounds,
    PivotDistances,
    PointLattice,
    candidates,
    lattice_over,
    pivot_distances_of,
    reaches,
)
from jhd._distance.collections.shapes import Collection, both_collections
from jhd._distance.collections.store import Store, fingerprint_of
from jhd._distance.collections.table import DistanceTable
from jhd._distance.collections.tasks import measured, pairs_between, workers
from jhd._distance.decisions import checked_limit
from jhd._distance.normalization.method import AbstractHausdorffMethod, check_serves
from jhd._distance.pairs import METHODS
from jhd._distance.search.branch_and_bound import BranchAndBound, chosen_method, limited
from jhd._distance.search.search import ended_by
from jhd._results.batches import AbstractOutcome
from jhd._results.outcomes import RESULTS
from jhd._runtime.arrays import check_whole, real_array, same_arrays
from jhd._runtime.c_library import give_back
from jhd._runtime.clock import with_time_limit
from jhd._shapes.as_shape import ShapeLike
from jhd._shapes.checks import Numbers
from jhd.progress import Callback, Progress

Report = Callback | None

# Pairs that are sent out before their results are put away.
_PAIRS = 1 << 14


class Pairwise(AbstractOutcome):
    """All Hausdorff distances of two collections with their bounds; row i and column j belong to shapes[i], others[j].

    Args:
        value: the distances, (rows, columns); NaN if the call was interrupted first.
        lower: certified lower bounds, (rows, columns).
        upper: certified upper bounds, (rows, columns).
        result: members of RESULTS that tell how each search ended; RESULTS.interrupted if it did not begin.
        computed: number of searches. Within one collection each pair counts once, and no shape is compared with itself.
    """

    value: Float[np.ndarray, "rows columns"]
    lower: Float[np.ndarray, "rows columns"]
    upper: Float[np.ndarray, "rows columns"]
    result: RESULTS
    computed: int

    def __repr__(self) -> str:
        rows, columns = self.value.shape
        done = int(np.sum(~np.isnan(self.value)))
        return f"Pairwise({rows} x {columns} distances, {done} known, {self.computed} computed)"


class PairsWithin(AbstractOutcome):
    """The pairs of shapes that are certified to be at most a threshold apart, in the order of their indices.

    The search for a pair ends once it is decided, so its bounds may be far apart. Call `hausdorff` for the distance.

    Args:
        index: indices of the shapes of each pair, (pairs, 2).
        lower: certified lower bounds of their distances, (pairs,).
        upper: certified upper bounds of their distances, at most the threshold, (pairs,).
        undecided: the pairs without an answer, (others, 2): the threshold lies between their bounds, or the call was
            interrupted.
        result: RESULTS.successful if no pair is undecided, otherwise gap_not_closed or interrupted.
        computed: number of distances that were searched.
    """

    index: Int[np.ndarray, "pairs 2"]
    lower: Float[np.ndarray, " pairs"]
    upper: Float[np.ndarray, " pairs"]
    undecided: Int[np.ndarray, "others 2"]
    result: RESULTS
    computed: int

    def __repr__(self) -> str:
        return f"PairsWithin({len(self.index)} pairs, {len(self.undecided)} undecided, {self.computed} computed)"


def pairwise(
    shapes: Sequence[ShapeLike],
    others: Sequence[ShapeLike] | None = None,
    method: AbstractHausdorffMethod | None = None,
    *,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    executor: Executor | None = None,
    store: str | Path | None = None,
    max_seconds: float | None = None,
    progress: Report = None,
) -> Pairwise:
    """All two-sided Hausdorff distances of two collections, or within one, each with certified bounds.

    The result of a pair is bitwise identical, whatever its position, the executor and the other shapes. Ctrl-C ends the
    call with the finished distances. All devices of a process take part. Processes of jax.distributed can each measure
    some rows: `pairwise(shapes[rank::count], shapes)`.

    >>> import jhd
    >>> squares = [jhd.polyline([(0, 0), (s, 0), (s, s), (0, s)], closed=True) for s in (1, 2, 4)]
    >>> jhd.pairwise(squares).value.round(9).tolist()
    [[0.0, 1.414213562, 4.242640687], [1.414213562, 0.0, 2.828427125], [4.242640687, 2.828427125, 0.0]]

    Args:
        shapes: a sequence of shapes of any kinds and of one dimension, or of objects that `jhd.as_shape` accepts.
        others: a second sequence of shapes of this dimension; by default `shapes` itself, whose pairs are measured
            once.
        method: the method, as in `jhd.hausdorff`; by default BranchAndBound().
        rtol: tolerance on `upper - lower`, relative to `upper`; see `jhd.hausdorff`.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; see `jhd.hausdorff`.
        executor: any concurrent.futures.Executor; by default one thread for each processor.
        store: a folder that keeps finished parts, safe against kills and loss of power. A second call with the same
            shapes, options, versions and processor continues there and returns the same bits. Only one call may use it
            at a time.
        max_seconds: wall time in seconds after which no search begins (RESULTS.out_of_time); by default no limit.
        progress: a function that is called with a Progress from time to time.

    Returns:
        A Pairwise: tables of distances, bounds and results.

    Raises:
        TypeError: an object that is not a shape, traced shapes, or a method that does not serve the shapes.
        ValueError: an empty collection, shapes of the plane and of space, a surface that is certified to be empty in
            its box, or a store that belongs to other inputs or is not a folder.
        MemoryError: the table needs more than the free memory.
    """
    method = chosen_method(method, rtol, atol)
    a, b = both_collections("shapes", shapes, "others", others)
    if a is not b or len(a) > 1:
        _check_method(method, a, b)
    table, hears = DistanceTable(a, b, _PAIRS), limited(method, progress, max_seconds)
    kept = None if store is None else Store(store, fingerprint_of((a.shapes, b.shapes), method, _PAIRS, a is b))
    try:
        with workers(executor) as pool:
            table.fill(pool, method, kept, lambda done, total: _tell(hears, "distances", done, total))
    except KeyboardInterrupt as stop:
        table.result[np.isnan(table.value)] = int(ended_by(stop)._value)
    return Pairwise(table.value, table.lower, table.upper, results_of(table.result), table.computed)


def nearest_shapes(
    queries: Sequence[ShapeLike],
    shapes: Sequence[ShapeLike],
    k: int = 1,
    method: BranchAndBound | None = None,
    *,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    executor: Executor | None = None,
    max_seconds: float | None = None,
    progress: Report = None,
) -> Neighbors:
    """The k nearest shapes of each query by the two-sided Hausdorff distance, certified.

    Shapes are compared at their positions: nothing is aligned or scaled. If `queries` is `shapes`, each query is its
    own nearest shape; pass k + 1 to get k others. Shapes often tie, and ties are listed.

    Distances of all shapes from the points of a lattice bound the distances of all pairs. Pairs that these bounds do
    not exclude are searched, up to the best bound so far; they are a small fraction of all pairs. Ctrl-C ends the call
    with the results so far, once all pairs have bounds.

    >>> import jhd
    >>> squares = [jhd.polyline([(0, 0), (s, 0), (s, s), (0, s)], closed=True) for s in (1, 2, 4)]
    >>> found = jhd.nearest_shapes([jhd.polyline([(0, 0), (3, 0), (3, 3), (0, 3)], closed=True)], squares)
    >>> found.index.tolist(), found.ties, found.value.round(9).tolist()
    ([[1]], (array([2]),), [[1.414213562]])

    Args:
        queries: a sequence of shapes of any kinds and of one dimension, or of objects that `jhd.as_shape` accepts.
        shapes: the shapes to choose from, a sequence of the same dimension.
        k: number of shapes for each query, at least 1; by default 1.
        method: options of the search, a BranchAndBound.
        rtol: tolerance on `upper - lower`, relative to `upper`; see `jhd.hausdorff`.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; see `jhd.hausdorff`.
        executor: any concurrent.futures.Executor; by default one thread for each processor.
        max_seconds: wall time in seconds after which no further search begins, once all pairs have bounds.
        progress: a function that is called with a Progress from time to time.

    Returns:
        A Neighbors: indices, distances, bounds and ties.

    Raises:
        TypeError: an object that is not a shape, traced shapes, or a method that is not BranchAndBound.
        ValueError: an empty collection, k above the number of shapes, shapes of the plane and of space, or a surface
            that is certified to be empty in its box.
    """
    method = chosen_method(method, rtol, atol)
    a, b = both_collections("queries", queries, "shapes", None if queries is shapes else shapes)
    check_whole("k", k, 1)
    if k > len(b):
        raise ValueError(f"k is {k}; there are {len(b)} shapes.")
    _check_method(method, a, b, (BranchAndBound,))
    # Pairs whose bounds are held at once: a hundred bytes each while they are compared.
    step, parts, hears = max(1, 10**6 // len(b)), [], limited(method, progress, max_seconds)
    with workers(executor) as pool:
        bounds = PivotBounds(*_both_pivots(pool, a, b, progress))
        for start in range(0, len(a), step):
            rows, before = np.arange(start, min(start + step, len(a))), sum(part.computed for part in parts)
            report = lambda done, total, before=before: _tell(hears, "distances", before + done, before + total)  # noqa: E731
            known = standings_of(bounds, rows, len(b), a is b)
            parts.append(nearest_of(pool, (a, b), rows, k, known, method, report))
            del known
            give_back()
    return together(parts)


def pairs_within(
    shapes: Sequence[ShapeLike],
    others: Sequence[ShapeLike] | None = None,
    method: BranchAndBound | None = None,
    *,
    threshold: Numbers,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    executor: Executor | None = None,
    max_seconds: float | None = None,
    progress: Report = None,
) -> PairsWithin:
    """All pairs of shapes whose two-sided Hausdorff distance is at most `threshold`, each certified.

    Bounds by distances from a lattice of points leave few pairs. The search of each remaining pair ends as soon as its
    bounds are on one side of the threshold. Ctrl-C ends the call with the decisions so far, once the candidates are
    known.

    >>> import jhd
    >>> squares = [jhd.polyline([(0, 0), (s, 0), (s, s), (0, s)], closed=True) for s in (1, 1.01, 4)]
    >>> jhd.pairs_within(squares, threshold=0.1).index.tolist()
    [[0, 1]]

    Args:
        shapes: a sequence of shapes of any kinds and of one dimension, or of objects that `jhd.as_shape` accepts.
        others: a second sequence of shapes of this dimension. By default the pairs within `shapes` are listed, the
            smaller index first.
        method: options of the search, a BranchAndBound. A search gives up (undecided) when its tolerance is reached.
        threshold: a length of at least 0, in the unit of the coordinates.
        rtol: relative tolerance at which a search gives up; see `jhd.hausdorff`.
        atol: absolute tolerance at which a search gives up; see `jhd.hausdorff`.
        executor: any concurrent.futures.Executor; by default one thread for each processor.
        max_seconds: wall time in seconds after which no further search begins, once all pairs have bounds.
        progress: a function that is called with a Progress from time to time.

    Returns:
        A PairsWithin: the pairs with their bounds, and the undecided pairs.

    Raises:
        TypeError: an object that is not a shape, traced shapes, or a method that is not BranchAndBound.
        ValueError: an empty collection, a threshold that is negative or not one number, shapes of the plane and of
            space, or a surface that is certified to be empty in its box.
    """
    method = chosen_method(method, rtol, atol)
    limit = float(checked_limit(threshold))
    a, b = both_collections("shapes", shapes, "others", others)
    _check_method(method, a, b, (BranchAndBound,))
    computed, hears, unfinished = 0, limited(method, progress, max_seconds), RESULTS.gap_not_closed
    with workers(executor) as pool:
        some = candidates(*_both_pivots(pool, a, b, progress), limit, a is b)
        rows, columns, lower, upper = (np.concatenate(x) for x in zip(*some, *_no_pairs(), strict=True))
        order = np.lexsort((columns, rows))
        rows, columns, lower, upper = (x[order] for x in (rows, columns, lower, upper))
        open_ = np.flatnonzero(upper > limit)
        pairs = pairs_between(rows[open_], columns[open_], limit, limit)
        try:
            for index, found in measured(pool, a, b, pairs, method):
                at = open_[index]
                lower[at], upper[at] = np.maximum(lower[at], found.lower), np.minimum(upper[at], found.upper)
                computed += len(index)
                _tell(hears, "distances", computed, len(open_))
        except KeyboardInterrupt as stop:
            unfinished = ended_by(stop) if computed < len(open_) else unfinished
    # Rounding leaves the distance of a copy open; it is zero if the shape is proven to have a point.
    between = np.flatnonzero((lower <= limit) & (upper > limit) & np.isfinite(upper))
    copies = [k for k in between if same_arrays(a.shapes[rows[k]], b.shapes[columns[k]])]
    lower[copies] = upper[copies] = 0.0
    yes, no = upper <= limit, lower > limit
    index = np.stack([rows, columns], axis=1)
    result = RESULTS.successful if np.all(yes | no) else unfinished
    return PairsWithin(index[yes], lower[yes], upper[yes], index[~yes & ~no], result, computed)


def pivot_distances(
    shapes: Sequence[ShapeLike],
    points: Numbers | None = None,
    *,
    executor: Executor | None = None,
    max_seconds: float | None = None,
    progress: Report = None,
) -> PivotDistances:
    """Certified distances of shapes from fixed points.

    For every point p, |d(p, a) - d(p, b)| is at most the Hausdorff distance of a and b.

    >>> import jhd
    >>> found = jhd.pivot_distances([jhd.polyline([(0, 0), (1, 0)])], [(0, 2), (3, 0)])
    >>> found.lower.round(6).tolist(), found.upper.round(6).tolist()
    ([[2.0, 2.0]], [[2.0, 2.0]])

    Args:
        shapes: a sequence of shapes of any kinds and of one dimension, or of objects that `jhd.as_shape` accepts.
        points: the points, (points, dim); by default a lattice over the shapes.
        executor: any concurrent.futures.Executor; by default one thread for each processor.
        max_seconds: time limit in seconds, checked from time to time; by default none.
        progress: a function that is called with a Progress from time to time.

    Returns:
        A PivotDistances: the points, and certified bounds of the distances.

    Raises:
        TypeError: an object that is not a shape, traced shapes, or points that are not real numbers.
        ValueError: an empty collection, shapes of the plane and of space, points of another dimension, or `max_seconds`
            that is not positive.
        TimeoutError: the distances take longer than `max_seconds`, at a report of progress.
    """
    a, _ = both_collections("shapes", shapes, "others", None)
    report = with_time_limit(progress, max_seconds)
    lattice = None if points is not None else lattice_over(a)
    with workers(executor) as pool:
        return _signed(pool, a, lattice, points, report)


def _check_method(
    method: Any, a: Collection, b: Collection, known: tuple[type[AbstractHausdorffMethod], ...] | None = None
) -> None:
    """Raise TypeError unless the method serves all pairs of kinds."""
    kinds = [list({type(shape): shape for shape in collection.shapes}.values()) for collection in (a, b)]
    for x in kinds[0]:
        for y in kinds[1]:
            check_serves(method, x, y, METHODS if known is None else known)


def _both_pivots(
    pool: Executor, a: Collection, b: Collection, progress: Report
) -> tuple[PivotDistances, PivotDistances]:
    if a is b:
        found = _signed(pool, a, lattice_over(a), None, progress)
        return found, found
    lattice = lattice_over(a, b)
    return _signed(pool, a, lattice, None, progress), _signed(pool, b, lattice, None, progress)


def _signed(
    pool: Executor, a: Collection, lattice: PointLattice | None, points: Any, progress: Report
) -> PivotDistances:
    if lattice is not None:
        rows, reach = lattice.points, reaches(a, lattice)
    else:
        rows, reach = np.asarray(real_array("points", points)), np.full(len(a), np.inf)
        if rows.ndim != 2 or not len(rows) or rows.shape[1] != a.dim:
            raise ValueError(f"points has shape {rows.shape}; needs (points, {a.dim}).")
    return pivot_distances_of(a, rows, reach, pool, lambda done: _tell(progress, "pivot distances", done, len(a)))


def _tell(progress: Report, stage: str, done: int, total: int) -> None:
    if progress is not None:
        progress(Progress(stage, done, total))


def _no_pairs() -> list[tuple[np.ndarray, ...]]:
    nothing, none = np.zeros(0, int), np.zeros(0)
    return [(nothing, nothing, none, none)]
