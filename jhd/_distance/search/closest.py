"""The search for the minimum distance: pairs of cells; pairs with the smallest bounds are cut first.

The table of pairs is sorted by lower bound. A step takes the first pairs, cuts each in two where it is longest in
space, bounds the halves, and sorts them in. A pair is closed when its bound is within the tolerance of the smallest
distance found. If a pair does not fit into the table, it is left out and its bound is kept, so the bounds are always
true.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import length
from jhd._distance.cells.pairs import BestPair, Cell, PairBound, Parametric
from jhd._distance.cells.tracked_feet import PairProblem
from jhd._distance.normalization.coordinates import Frame, diagonal, user_length, user_place
from jhd._distance.normalization.host_callback import like_result
from jhd._distance.normalization.net_jets import Net, eta, point_error
from jhd._distance.normalization.stopping import default_tolerance
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._results.solution import RESULTS, MinimumSolution, on_device, result_where
from jhd._runtime.arrays import is_traced, module_of, varying

# Pairs that are cut in one step.
WIDTH = 16
# How the table grows.
_GROWTH = 4
# A table beyond this length is not exchanged for a longer one: it would fill the memory.
_LONGEST = 1 << 20
# Pairs are closed below the tolerance, so that the errors of the ends cannot exceed it.
_CLOSE = 0.9
# If this many pairs are left when a search ends, the nearest pairs are not isolated.
_FAMILY = 400
# A search may be given up after half of its steps, and at least the first number of steps, if it seems to need more
# than the second number times the remaining steps.
_LATE, _HOPELESS = 1024, 8


class WantedGap(NamedTuple):
    """Tolerances in common coordinates, whether atol was given, and the most steps.

    If atol was given, no wider gap counts as closed.
    """

    atol: Array
    rtol: Array
    given: Array
    most: Array


def wanted_gap(corners: Sequence[tuple[Any, Any]], frame: Frame, method: BranchAndBound, floor: Any) -> WantedGap:
    """Return the tolerances of a method; the default fits shapes with these corners and is at least the floor."""
    xp: Any = jnp if is_traced(corners, frame, method) else np
    dtype = corners[0][0].dtype
    default = method.atol is None
    absolute = default_tolerance(diagonal(corners), dtype, floor) if default else frame.common(method.atol)
    numbers = xp.asarray(absolute, dtype), xp.asarray(method.rtol, dtype)
    return WantedGap(*numbers, xp.asarray(not default), xp.asarray(method.max_steps))


class ClosestState(NamedTuple):
    """A table of pairs sorted by lower bound (infinite for free slots), with the best pair and counts."""

    lower: Array
    cell: Cell
    axis: Array
    best: BestPair
    settled: Array
    lost: Array
    steps: Array
    pairs: Array


class Reached(NamedTuple):
    """Bounds and best pair that a search has reached, and the number of waiting pairs."""

    best: BestPair  # the nearest pair of points found
    lower: Array  # the proven lower bound
    waiting: Array  # the number of pairs that are still open
    lost: Array  # whether a pair was left out because it did not fit into the table
    steps: Array  # steps taken
    pairs: Array  # pairs bounded


class Outcome(NamedTuple):
    """The outcome of a search, in common coordinates."""

    best: BestPair
    lower: Array
    upper: Array
    point_a: Array
    point_b: Array
    result: Any
    stats: dict[str, Array]

    @classmethod
    def like(cls, dtype: Any, parameters: int, dim: int) -> "Outcome":
        """Return shapes and types of the outcome for nets with this total number of parameters."""
        number: Any = lambda *shape: jax.ShapeDtypeStruct(shape, dtype)  # noqa: E731
        whole: Any = jax.ShapeDtypeStruct((), jnp.result_type(int))
        best = BestPair(number(), number(), whole, whole, number(parameters))
        stats = {name: whole for name in ("steps", "pairs", "waiting")}
        return cls(best, number(), number(), number(dim), number(dim), like_result(), stats)

    def solution(self, frame: Frame) -> MinimumSolution:
        """Return the solution in the user's coordinates, to which the frame leads back."""
        value, lower = user_length(frame, self.best.distance, None), user_length(frame, self.lower, 0.0)
        upper, result = user_length(frame, self.upper, np.inf), self.result
        if is_traced(frame.usable):
            good = frame.usable
            value, upper = jnp.where(good, value, jnp.inf), jnp.where(good, upper, jnp.inf)
            lower, result = jnp.where(good, lower, 0.0), result_where(good, result, RESULTS.nonfinite_value)
        points = user_place(frame, self.point_a), user_place(frame, self.point_b)
        value, lower, upper, point_a, point_b = on_device((value, lower, upper, *points))
        return MinimumSolution(value, lower, upper, point_a, point_b, result, self.stats)


def pairs_of(counts: tuple[int, ...]) -> np.ndarray:
    """Return all pairs of indices of pieces, in rows; `counts` are the numbers of pieces."""
    return np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 2)


def begin(problem: Parametric, pairs: Array, valid: Array, capacity: int) -> ClosestState:
    """Return the table with some pairs of whole pieces, and a first distance, between corners of pieces."""
    a, b = problem[:2]
    n = a.parameters + b.parameters
    k, m = pairs[:, 0], pairs[:, 1]
    dtype = a.points.dtype

    def extents(net: Net) -> Array:
        sizes = []
        for axis in (-3, -2)[: net.parameters]:
            steps = jnp.max(jnp.abs(jnp.diff(net.points, axis=axis)), axis=(-3, -2, -1), initial=0.0)
            sizes.append(steps * (net.points.shape[axis] - 1))
        return jnp.stack(sizes, axis=-1)

    axis = jnp.argmax(jnp.concatenate([extents(a)[k], extents(b)[m]], axis=-1), axis=-1)
    lower = jnp.where(valid, gaps(a, b, k, m), jnp.inf)
    e = a.points[k, 0, 0] - b.points[m, 0, 0]
    distance = jnp.where(valid, jax.vmap(length)(e), jnp.inf)
    i = jnp.argmin(distance)
    # The corner is a point of the shape; the difference is rounded once.
    upper = distance[i] * (1 + gamma(16, dtype)) + point_error(a)
    best = BestPair(upper, distance[i], k[i], m[i], jnp.zeros((n,), dtype))
    zeros, ones = jnp.zeros((len(pairs), n), dtype), jnp.ones((len(pairs), n), dtype)
    return table_of(lower, Cell(k, m, zeros, ones), axis, best, capacity)


def table_of(lower: Array, cell: Cell, axis: Array, best: BestPair, capacity: int) -> ClosestState:
    """Return the table with these pairs of cells."""
    count, dtype = lower.shape[0], lower.dtype
    lower, cell, axis = jax.tree_util.tree_map(partial(_padded, capacity), (lower, cell, axis))
    lower = jnp.where(np.arange(lower.size) < count, lower, jnp.inf)
    order = jnp.argsort(lower)
    cell, axis = jax.tree_util.tree_map(lambda x: x[order], (cell, axis))
    zero = jnp.array(0)
    infinite = jnp.full((), jnp.inf, dtype)
    return ClosestState(lower[order], cell, axis, best, infinite, jnp.array(False), zero, zero)


def _padded(capacity: int, x: Array) -> Array:
    return jnp.pad(x, [(0, max(capacity - x.shape[0], 0)), *[(0, 0)] * (x.ndim - 1)])


def gaps(a: Net, b: Net, k: Array, m: Array) -> Array:
    """Return lower bounds of the distances of whole pieces, by the boxes of their control points."""
    lows = [jnp.min(net.points, axis=(-3, -2)) for net in (a, b)]
    highs = [jnp.max(net.points, axis=(-3, -2)) for net in (a, b)]
    apart = jnp.maximum(jnp.maximum(lows[0][k] - highs[1][m], lows[1][m] - highs[0][k]), 0.0)
    found = jax.vmap(length)(apart) * (1 - gamma(16, apart.dtype))
    return jnp.maximum(found - eta(a) - eta(b), 0.0)


def room_for(pairs: int, capacity: int) -> int:
    """Return the length of a table that holds `pairs` pairs and the halves that a step adds."""
    return max(capacity, 4 * WIDTH, 1 << (2 * pairs - 1).bit_length())


def reached_by(state: ClosestState) -> Reached:
    """Return the bounds and the best pair that a table has reached."""
    lower = jnp.minimum(jnp.minimum(state.lower[0], state.settled), state.best.upper)
    return Reached(state.best, lower, jnp.sum(jnp.isfinite(state.lower)), state.lost, state.steps, state.pairs)


def tolerance_of(problem: PairProblem, wanted: WantedGap, best: BestPair) -> Array:
    """Return the gap that closes the search: the requested gap, or the rounding error if that is larger."""
    found = jnp.where(jnp.isfinite(best.upper), best.upper, 0.0)
    return jnp.maximum(jnp.maximum(wanted.atol, wanted.rtol * found), problem.floor)


def is_open(problem: PairProblem, wanted: WantedGap, state: ClosestState) -> Array:
    """Return whether there are pairs that may hold a distance smaller by more than the tolerance."""
    return state.lower[0] < close_enough(problem, wanted, state.best)


def is_hopeless(
    problem: PairProblem, wanted: WantedGap, reached: Reached, power: float = 0.5, factor: float = _HOPELESS
) -> Array:
    """Return whether non-isolated nearest pairs need far more steps than are left.

    The number of pairs grows like a power of the inverse of the gap. With bounds of second order in the size of the
    cells it grows at least like the root, which is the case of a curve of nearest pairs.

    Args:
        problem: the pair of shapes.
        wanted: tolerances, and the most steps.
        reached: what the search has reached.
        power: exponent of this growth.
        factor: the search is hopeless if it seems to need more than this multiple of the remaining steps.
    """
    late, upper = reached.steps >= jnp.maximum(wanted.most // 2, _LATE), reached.best.upper
    gap = jnp.where(jnp.isfinite(upper), upper - reached.lower, 0.0)
    pairs = reached.waiting * (gap / tolerance_of(problem, wanted, reached.best)) ** power
    return late & (pairs > factor * WIDTH * (wanted.most - reached.steps))


def is_full(state: ClosestState) -> Array:
    """Return whether the next step may find no room."""
    return jnp.isfinite(state.lower[state.lower.size - WIDTH])


def _is_going(problem: PairProblem, wanted: WantedGap, state: ClosestState) -> Array:
    return is_open(problem, wanted, state) & ~is_hopeless(problem, wanted, reached_by(state))


def advance(
    problem: PairProblem, wanted: WantedGap, state: ClosestState, limit: Array | int, growing: Array | bool = False
) -> ClosestState:
    """Advance until the gap is closed or `limit` steps are taken; `growing` stops before the table is full."""

    def going_on(state: ClosestState) -> Array:
        return _is_going(problem, wanted, state) & (state.steps < limit) & ~(jnp.asarray(growing) & is_full(state))

    start = varying(state, problem, wanted)
    return jax.lax.while_loop(going_on, lambda state: _step(problem, wanted, state), start)


def _step(problem: PairProblem, wanted: WantedGap, state: ClosestState) -> ClosestState:
    """Cut the first WIDTH pairs in two, bound the halves, and merge the open ones into the sorted table."""
    capacity = state.lower.size
    taken, lower, axis = jax.tree_util.tree_map(lambda x: x[:WIDTH], (state.cell, state.lower, state.axis))
    halves, before = halves_of(taken, axis), jnp.concatenate([lower, lower])
    found = jax.vmap(problem.bound)(halves)
    best, lowers = raised(found, halves, before, state.best)
    state = state._replace(best=best, steps=state.steps + 1, pairs=state.pairs + jnp.sum(jnp.isfinite(before)))
    closed = (lowers >= close_enough(problem, wanted, best)) | found.thin
    settled = jnp.minimum(state.settled, jnp.min(jnp.where(closed, lowers, jnp.inf)))
    lowers = jnp.where(closed, jnp.inf, lowers)
    every = jnp.concatenate([lowers, jnp.where(np.arange(capacity) < WIDTH, jnp.inf, state.lower)])
    order = jnp.argsort(every)
    kept = every[order]
    settled, lost = jnp.minimum(settled, kept[capacity]), state.lost | jnp.isfinite(kept[capacity])

    def merged(new: Array, old: Array) -> Array:
        return jnp.concatenate([new, old])[order[:capacity]]

    cell = jax.tree_util.tree_map(merged, found.cell, state.cell)
    return state._replace(
        lower=kept[:capacity],
        cell=cell,
        axis=merged(jnp.argmax(found.extent, axis=-1), state.axis),
        settled=settled,
        lost=lost,
    )


def halves_of(taken: Cell, axis: Any) -> Cell:
    """Return the first halves of cells, each cut along its axis, followed by the second halves."""
    xp: Any = module_of(axis)
    middle = 0.5 * (taken.low + taken.high)
    cut = np.arange(taken.low.shape[-1]) == axis[:, None]
    return Cell(
        xp.concatenate([taken.piece_a, taken.piece_a]),
        xp.concatenate([taken.piece_b, taken.piece_b]),
        xp.concatenate([taken.low, xp.where(cut, middle, taken.low)]),
        xp.concatenate([xp.where(cut, middle, taken.high), taken.high]),
    )


def raised(found: PairBound, halves: Cell, before: Any, best: BestPair) -> tuple[BestPair, Any]:
    """Return the nearest pair found so far, and lower bounds of halves, raised to the bounds of the whole cells.

    Args:
        found: the bounds of the halves.
        halves: the halves.
        before: the lower bounds of the whole cells; infinite for a free slot of a table.
        best: the nearest pair before.
    """
    xp: Any = module_of(before)
    valid = xp.isfinite(before)
    upper = xp.where(valid & (found.upper >= 0), found.upper, xp.inf)
    i = xp.argmin(upper)
    new = BestPair(upper[i], found.distance[i], halves.piece_a[i], halves.piece_b[i], found.x[i])
    better = upper[i] < best.upper
    best = BestPair(*(xp.where(better, x, y) for x, y in zip(new, best, strict=True)))
    # If something overflowed, only the bound of the whole cell is known.
    lowers = xp.where(xp.isnan(found.lower), before, xp.maximum(found.lower, before))
    return best, xp.where(valid, lowers, xp.inf)


def news_of(problem: PairProblem, wanted: WantedGap, state: ClosestState, growing: Array) -> Array:
    """Return four numbers: whether it goes on, whether it stopped for lack of room, steps, and waiting pairs."""
    going_on = _is_going(problem, wanted, state)
    full = going_on & jnp.asarray(growing) & is_full(state)
    return jnp.stack([going_on, full, state.steps, jnp.sum(jnp.isfinite(state.lower))])


def outcome(
    wanted: WantedGap, reached: Reached, best: BestPair, ends: tuple[Any, Any], points: tuple[Any, Any], floor: Any
) -> Outcome:
    """Return the outcome of the search as it stands; `floor` is the gap that rounding leaves."""
    lower, upper = ends
    relative = wanted.rtol * jnp.where(jnp.isfinite(upper), upper, 0.0)
    granted = jnp.maximum(jnp.maximum(wanted.atol, relative), jnp.where(wanted.given, 0.0, 2 * floor))
    many = reached.waiting >= _FAMILY
    failed = result_where(many, RESULTS.nonisolated_maxima, RESULTS.gap_not_closed)
    failed = result_where(reached.lost, RESULTS.capacity_reached, failed)
    failed = result_where(jnp.isfinite(upper), failed, RESULTS.existence_not_certified)
    result = result_where(upper - lower <= granted, RESULTS.successful, failed)
    stats = {"steps": reached.steps, "pairs": reached.pairs, "waiting": reached.waiting}
    best = best._replace(distance=jnp.clip(best.distance, lower, upper))
    return Outcome(best, lower, upper, *points, result, stats)


def in_one_go(
    begun: Callable[[Any], ClosestState],
    ended: Callable[[Any, WantedGap, Reached], Outcome],
    problem: PairProblem,
    wanted: WantedGap,
    max_steps: int,
) -> Outcome:
    """Run the search in one compiled function; a batch runs sequentially on a CPU, in parallel elsewhere."""

    def search(problem: PairProblem, wanted: WantedGap) -> Outcome:
        return ended(problem, wanted, reached_by(advance(problem, wanted, begun(problem), max_steps)))

    if jax.default_backend() == "cpu":
        search = sequential_vmap(search)
    return search(problem, wanted)


def may_grow(state: ClosestState) -> bool:
    """Return whether a longer table would not fill the memory."""
    return state.lower.size < _LONGEST


def longer(state: ClosestState) -> ClosestState:
    """Return the table with more room."""
    size = _GROWTH * state.lower.size
    lower = jnp.pad(state.lower, (0, size - state.lower.size), constant_values=jnp.inf)
    cell, axis = jax.tree_util.tree_map(partial(_padded, size), (state.cell, state.axis))
    return state._replace(lower=lower, cell=cell, axis=axis)


def close_enough(problem: PairProblem, wanted: WantedGap, best: BestPair) -> Array:
    """Return the bound from which on pairs cannot hold a distance smaller by more than the tolerance."""
    return best.upper - _CLOSE * tolerance_of(problem, wanted, best)
