"""A search for the minimum distance by two kinds of bounds: the second starts if the first does not soon close.

The first kind closes most pairs. The second kind also closes non-isolated nearest pairs, but takes longer to compile
and to compute; it starts after some hundred steps, or when the table of the first kind is full. It has different cells,
so it begins with all pairs again and with the distance that the first kind has found. Its pairs wait on the host, which
hands them to one compiled function in blocks: their number is not limited, and nothing is compiled again when it grows.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._arithmetic.polynomials import jets
from jhd._arithmetic.truncated import Truncated
from jhd._distance.cells.lagrange import WithSurface
from jhd._distance.cells.pairs import BestPair, Cell, PairBound, Parametric
from jhd._distance.cells.tracked_feet import MovingBound, WithFeetOnFirst, WithMovingFeet
from jhd._distance.cells.tracked_feet_minimum import MovingPoint
from jhd._distance.normalization.net_jets import Net, jet
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.closest import (
    WIDTH,
    ClosestState,
    Outcome,
    Reached,
    WantedGap,
    close_enough,
    halves_of,
    is_full,
    is_hopeless,
    longer,
    raised,
    reached_by,
)
from jhd._distance.search.row_batches import each, in_blocks
from jhd._distance.search.search import AbstractSearch, Standing
from jhd._runtime.compiled import compiled

# Steps of the first kind, and pairs in its longest table: each length compiles for seconds.
_FIRST_TURN, _LONGEST = 512, 2048
# Pairs that are cut at once, and pairs that are bounded in one batch.
_TAKEN, _LANES = 256, 32
# The number of pairs near a surface of nearest pairs grows like this power of the inverse of the gap, as bounds are
# short by the eighth power of the size of the cells. This predicts the steps within a factor of two for small gaps.
_POWER, _TOO_MANY = 0.25, 2.0
# Feet move on the first shape if the second derivative along the second is below this fraction of that along the first.
_FLATTER = 0.125


class FollowedPairs(NamedTuple):
    """The waiting pairs of cells, as NumPy arrays, with the best pair and counts; see ClosestState."""

    kind: type[WithMovingFeet]  # the shape on which feet move
    lower: np.ndarray  # the lower bounds of the pairs
    cell: Cell  # the pairs
    axis: np.ndarray  # the parameter along which each is cut
    best: BestPair  # the nearest pair of points found
    settled: Any  # the least lower bound of the pairs that are closed
    steps: int  # steps taken, of as many pairs as the first kind cuts in one
    pairs: int  # pairs bounded

    def reached(self) -> Reached:
        """Return the bounds and the best pair so far."""
        lower = np.minimum(np.minimum(np.min(self.lower, initial=np.inf), self.settled), self.best.upper)
        counts = len(self.lower), False, self.steps, self.pairs
        return Reached(self.best, *map(np.asarray, (lower, *counts)))  # pyright: ignore[reportArgumentType]


class InTurn(AbstractSearch):
    """The search by two kinds of bounds, from the host.

    Args:
        begun: makes the first table of the first kind.
        stretch: advances a table up to a limit of steps, growing or not; returns the table, its outcome and `news_of`.
        follow: returns the shapes as the second kind bounds them, from the nearest pair found.
        sharper: returns this pair, or a pair that is proven to be nearer.
        shown: returns the outcome of the bounds that the second kind has reached.
        wanted: tolerances and the most steps of both.
    """

    first_steps = 64

    def __init__(
        self,
        begun: Callable[[], ClosestState],
        stretch: Callable[..., Any],
        follow: Callable[[BestPair], Any],
        sharper: Callable[[BestPair], BestPair],
        shown: Callable[[Reached], Outcome],
        wanted: WantedGap,
    ):
        self._begun, self._stretch, self._shapes, self._sharper, self._shown = begun, stretch, follow, sharper, shown
        self._wanted, self.max_steps = wanted, int(wanted.most)

    @override
    def begin(self) -> ClosestState | FollowedPairs:
        return self._begun()

    @override
    def advance(
        self, state: ClosestState | FollowedPairs, limit: int, growing: bool
    ) -> tuple[ClosestState | FollowedPairs, Standing]:
        if isinstance(state, ClosestState):
            steps, full = int(state.steps), state.lower.size >= _LONGEST and bool(is_full(state))
            if not ((full or steps >= _FIRST_TURN) and steps < limit):
                state, found, news = self._stretch(state, np.asarray(min(limit, _FIRST_TURN)), np.asarray(growing))
                return state, Standing(found, *np.asarray(news))
            state = self._followed(state)
        return self._follow(state, limit)

    @override
    def longer(self, state: ClosestState | FollowedPairs) -> ClosestState | FollowedPairs:
        return longer(state) if isinstance(state, ClosestState) and state.lower.size < _LONGEST else state

    def _followed(self, before: ClosestState) -> FollowedPairs:
        """Return all pairs again, with bounds of at least the bound proven by the first kind."""
        known, table = reached_by(before), jax.tree_util.tree_map(np.asarray, self._begun())
        there = np.isfinite(table.lower)
        best = known.best if known.best.upper < table.best.upper else table.best
        kind = _with_feet(self._shapes(best), best)
        cell = Cell(*(x[there] for x in table.cell))
        lower, settled = (np.maximum(x, np.asarray(known.lower)) for x in (table.lower[there], table.settled))
        best = jax.tree_util.tree_map(np.asarray, best)
        return FollowedPairs(kind, lower, cell, table.axis[there], best, settled, int(known.steps), int(known.pairs))

    def _follow(self, state: FollowedPairs, limit: int) -> tuple[FollowedPairs, Standing]:
        problem = state.kind(self._shapes(state.best))
        while going := self._is_going(problem, state):
            if state.steps >= limit:
                break
            state = _cut(problem, self._wanted, state, min(_TAKEN, WIDTH * (limit - state.steps)))
        state = state._replace(best=jax.tree_util.tree_map(np.asarray, self._sharper(state.best)))
        return state, Standing(self._shown(state.reached()), going, False, state.steps, len(state.lower))

    def _is_going(self, problem: WithMovingFeet, state: FollowedPairs) -> bool:
        closed = close_enough(problem, self._wanted, state.best)
        is_open = np.min(state.lower, initial=np.inf) < closed
        return bool(is_open and not is_hopeless(problem, self._wanted, state.reached(), _POWER, _TOO_MANY))


def _cut(problem: WithMovingFeet, wanted: WantedGap, state: FollowedPairs, most: int) -> FollowedPairs:
    """Cut the pairs with the smallest bounds, `most` of them, in two and bound the halves."""
    # Pairs closed because the best pair is nearer leave the list, and their bounds count.
    still = state.lower < float(close_enough(problem, wanted, state.best))
    settled = np.minimum(state.settled, np.min(state.lower[~still], initial=np.inf))
    order = np.flatnonzero(still)[np.argsort(state.lower[still], kind="stable")]
    taken, rest = order[:most], order[most:]
    lower, cell, axis = _rows((state.lower, state.cell, state.axis), taken)
    halves: Any = halves_of(cell, axis)
    found: Any = PairBound(*jax.tree_util.tree_map(np.asarray, in_blocks(_bounds, problem, *halves)))
    before: Any = np.concatenate([lower, lower])
    best, lowers = raised(found, halves, before, state.best)
    closed = float(close_enough(problem, wanted, best))
    left = np.flatnonzero((lowers < closed) & ~found.thin)
    followed, extent = _followed(problem, _rows(found, left))
    lowers[left] = np.maximum(lowers[left], followed)
    open_ = lowers[left] < closed
    left, axis = left[open_], np.argmax(extent[open_], axis=1)
    settled = min(settled, np.min(np.delete(lowers, left), initial=np.inf))
    new: Any = lowers[left], _rows(found.cell, left), axis
    old = _rows((state.lower, state.cell, state.axis), rest)
    lower, cell, axis = jax.tree_util.tree_map(lambda x, y: np.concatenate([x, y]), new, old)
    steps, pairs = state.steps + -(-len(taken) // WIDTH), state.pairs + len(lowers)
    return FollowedPairs(state.kind, lower, cell, axis, best, settled, steps, pairs)


def _rows(x: Any, rows: np.ndarray) -> Any:
    """Return some rows of arrays."""
    return jax.tree_util.tree_map(lambda x: x[rows], x)


def _followed(problem: WithMovingFeet, pairs: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return lower bounds of pairs of cells by feet that move (zero if unknown), and the extents to cut."""
    x, cell = pairs.x, pairs.cell
    lower, convex = np.zeros(len(x), x.dtype), np.zeros(len(x), bool)
    if not len(x):
        return lower, pairs.extent
    on_a, promising = in_blocks(_moving_points, problem, *cell, x)
    graph = np.isfinite(on_a.beside)
    k = np.flatnonzero(graph & promising)
    if k.size:
        lower[k], convex[k] = in_blocks(_moving_bounds, problem, *jax.tree_util.tree_leaves(_rows((on_a, cell, x), k)))
    return lower, problem.to_cut(pairs.extent, MovingBound(lower, graph, convex, on_a.bent))


@compiled
def _bounds(problem: WithMovingFeet, count: Array, *rows: Array) -> PairBound:
    """Return bounds over pairs of cells."""
    return each(lambda *cell: problem.bound(Cell(*cell)), count, rows, _LANES)


@compiled
def _moving_points(problem: WithMovingFeet, count: Array, *rows: Array) -> tuple[MovingPoint, Array]:
    return each(lambda *row: problem.moving_points(Cell(*row[:-1]), row[-1]), count, rows, _LANES)


@compiled
def _moving_bounds(problem: WithMovingFeet, count: Array, *rows: Array) -> tuple[Array, Array]:
    def one(terms: Array, rest: Array, beside: Array, bent: Array, *row: Array) -> tuple[Array, Array]:
        on_a = MovingPoint(Truncated(terms, rest), beside, bent)
        return problem.moving_bound(on_a, Cell(*row[:-1]), row[-1])

    return each(one, count, rows, _LANES)


def _with_feet(problem: Parametric | WithSurface, best: BestPair) -> type[WithMovingFeet]:
    """Return the kind of bounds with moving feet: on the shape with the larger second derivative."""
    of_a, of_b = np.asarray(_bends(problem, best))
    return WithFeetOnFirst if of_b < _FLATTER * of_a else WithMovingFeet


@compiled
def _bends(problem: Parametric | WithSurface, best: BestPair) -> Array:
    """Return the least second derivative of half the squared distance along each shape, in lengths; at most one."""
    n = problem.a.parameters
    sides = (problem.a, best.piece_a, best.x[:n]), (problem.b, best.piece_b, best.x[n:])
    points = [shape.piece(k).point(x) for shape, k, x in sides]
    e = points[0] - points[1]
    return jnp.stack([_bend(*sides[0], e), _bend(*sides[1], -e)])


def _bend(shape: Net | Side, piece: Array, x: Array, e: Array) -> Array:
    """Return the entry of `_bends` for one shape; `e` leads to its point from the other point."""
    if isinstance(shape, Side):
        # The Lagrangian along the tangent plane; the matrix has a one across it.
        _, slope, bent = jets(jnp.asarray(shape.coefficients), x)
        square = slope @ slope
        unit = slope / jnp.sqrt(jnp.where(square > 0, square, jnp.inf))
        along = jnp.eye(3, dtype=e.dtype) - unit[:, None] * unit
        bent = along @ bent @ along * (e @ slope / jnp.where(square > 0, square, jnp.inf))
        return jnp.minimum(1 - jnp.linalg.eigvalsh(bent)[-1], 1.0)
    at = jet(shape.piece(piece), x)
    speeds = jnp.linalg.norm(at.first, axis=-1)
    speeds = jnp.where(speeds > 0, speeds, 1.0)
    bent = (jnp.sum(at.first[:, None] * at.first, -1) + jnp.sum(at.second * e, -1)) / (speeds[:, None] * speeds)
    # Of one or two parameters.
    first, last = bent[0, 0], bent[-1, -1]
    least = 0.5 * (first + last) - jnp.hypot(0.5 * (first - last), bent[0, -1] if len(bent) > 1 else 0.0)
    return jnp.minimum(least, 1.0)
