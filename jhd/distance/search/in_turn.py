"""A search for the minimum distance by two kinds of bounds, the second where the first does not soon close it.

The first kind closes most pairs. The second does what the first one does and closes families of nearest pairs too, but
takes longer to compile and to compute. It begins with a table of its own, since its cells are others, is told what the
first kind has found, and goes on to the end.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from typing_extensions import override

from jhd._runtime.arrays import array_of
from jhd.distance.search.closest import ClosestState, longer, lower_of, may_grow
from jhd.distance.search.search import AbstractSearch, Standing

# Steps of the first kind.
_FIRST_TURN = 512
# How often the table of the second kind is made longer at once: its program compiles for seconds for each length.
_LONGER = 2


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
