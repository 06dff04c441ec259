"""A search for the minimum distance by two kinds of bounds: the second starts if the first does not soon close.

The first kind closes most pairs. The second kind also closes non-isolated nearest pairs, but takes longer to compile
and to compute. It has different cells, so it begins with a table of its own and with the distance that the first kind
has found.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._arithmetic.polynomials import jets
from jhd._distance.cells.implicit import parameters
from jhd._distance.cells.lagrange import WithSurface
from jhd._distance.cells.pairs import BestPair, Parametric
from jhd._distance.cells.tracked_feet import WithFeetOnFirst, WithMovingFeet
from jhd._distance.normalization.net_jets import Net, jet
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.closest import ClosestState, longer, lower_of, may_grow
from jhd._distance.search.search import AbstractSearch, Standing
from jhd._runtime.arrays import array_of
from jhd._runtime.compiled import compiled

# Steps of the first kind.
_FIRST_TURN = 512
# How often the table of the second kind is made longer at once: its program compiles for seconds for each length.
_LONGER = 2
# Feet move on the first shape if the distance is bent along the second one by less than this share of what it is there.
_FLATTER = 0.125


class _Turn(NamedTuple):
    """The table, and which kind it is of: 0 or 1."""

    table: ClosestState
    kind: int


class InTurn(AbstractSearch):
    """The search from the host.

    Args:
        begun: makes the table in which it begins, with either kind of bounds.
        first: goes on from a table until a limit of steps, growing or not; to the table, its outcome and `news_of`.
        second: as `first`, with the other kind.
        max_steps: most steps of both.
    """

    first_steps = 64

    def __init__(
        self, begun: Callable[[], ClosestState], first: Callable[..., Any], second: Callable[..., Any], max_steps: int
    ):
        self._begun, self._kinds, self.max_steps = begun, (first, second), max_steps

    @override
    def begin(self) -> _Turn:
        return _Turn(self._begun(), 0)

    @override
    def advance(self, state: _Turn, limit: int, growing: bool) -> tuple[_Turn, Standing]:
        if state.kind == 0 and _FIRST_TURN <= int(state.table.steps) < limit:
            state = _Turn(_told(self._second_table(), state.table), 1)
        end = limit if state.kind else min(limit, _FIRST_TURN)
        room = np.asarray(growing and may_grow(state.table))
        table, found, news = self._kinds[state.kind](state.table, np.asarray(end), room)
        return state._replace(table=table), Standing(found, *np.asarray(news))

    @override
    def longer(self, state: _Turn) -> _Turn:
        return state._replace(table=longer(state.table))

    def _second_table(self) -> ClosestState:
        table = self._begun()
        for _ in range(_LONGER):
            table = longer(table)
        return table


def _told(table: ClosestState, other: ClosestState) -> ClosestState:
    """A table that goes on from where another one stands: no pair in it has a bound below what is known."""
    known = np.asarray(lower_of(other))
    lower = np.asarray(table.lower)
    lower = array_of(np.where(np.isfinite(lower), np.maximum(lower, known), lower))
    settled = array_of(np.maximum(np.asarray(table.settled), known))
    best = other.best if other.best.upper < table.best.upper else table.best
    return table._replace(lower=lower, settled=settled, best=best, steps=other.steps, pairs=other.pairs)


def with_feet(problem: Parametric | WithSurface, best: BestPair) -> WithMovingFeet:
    """Bounds with feet that move, on the shape from which the distance is bent more at the nearest pair."""
    of_a, of_b = np.asarray(_bends(problem, best))
    return (WithFeetOnFirst if of_b < _FLATTER * of_a else WithMovingFeet)(problem)


@compiled
def _bends(problem: Parametric | WithSurface, best: BestPair) -> Array:
    """The least second derivative of half the squared distance along each shape, by lengths on it; at most one."""
    n = parameters(problem.a)
    sides = (problem.a, best.piece_a, best.x[:n]), (problem.b, best.piece_b, best.x[n:])
    points = [x if isinstance(shape, Side) else jet(shape.piece(k), x).point for shape, k, x in sides]
    e = points[0] - points[1]
    return jnp.stack([_bend(*sides[0], e), _bend(*sides[1], -e)])


def _bend(shape: Net | Side, piece: Array, x: Array, e: Array) -> Array:
    """That along one shape, where e leads to its point from the other one's."""
    if isinstance(shape, Side):
        # Of the Lagrangian along the tangent plane; the matrix has a one across it.
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
