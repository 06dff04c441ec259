"""A search for the minimum distance by two kinds of bounds in turn, where it is not known which of them closes it.

The first kind closes most pairs; the second takes longer to compile and to compute, and closes families of nearest
pairs. Each has a table of its own, gets as much time as the other, and is told what the other has found. Turns double,
so beyond the first one a search takes at most some three times as long as with the better kind alone.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jhd.arrays import array_of
from jhd.distance.search.closest import ClosestState, longer, lower_of, may_grow
from jhd.distance.search.search import AbstractSearch, Standing

# Steps of the first turn, and how many of these take as long as one of the second kind.
_FIRST_TURN, _WORTH = 512, 2


class _Turns(NamedTuple):
    """The table of the turn, that of the other kind (None before it has had one), and the number of turns before."""

    table: ClosestState
    other: ClosestState | None
    turn: int


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
        self,
        begun: Callable[[], ClosestState],
        first: Callable[..., Any],
        second: Callable[..., Any],
        max_steps: int,
    ):
        self._begun, self._kinds, self.max_steps = begun, (first, second), max_steps

    def begin(self) -> _Turns:
        """See AbstractSearch."""
        return _Turns(self._begun(), None, 0)

    def advance(self, state: _Turns, limit: int, growing: bool) -> tuple[_Turns, Standing]:
        """See AbstractSearch."""
        end = _end(state.turn)
        if end <= int(state.table.steps) < limit:
            other = self._begun() if state.other is None else state.other
            state = _Turns(_told(other, state.table), state.table, state.turn + 1)
            end = _end(state.turn)
        room = np.asarray(growing and may_grow(state.table))
        stretch = self._kinds[state.turn % 2]
        table, found, news = stretch(state.table, np.asarray(min(limit, end)), room)
        return state._replace(table=table), Standing(found, *np.asarray(news))

    def longer(self, state: _Turns) -> _Turns:
        """See AbstractSearch."""
        return state._replace(table=longer(state.table))


def _end(turn: int) -> int:
    """The steps up to the end of a turn: 512 of the first kind, 256 of the second, 512, 256, 1024, 512, ..."""
    turns = np.arange(turn + 1)
    lengths = _FIRST_TURN << np.maximum(turns // 2 - 1, 0)
    return int(np.sum(np.where(turns % 2, lengths // _WORTH, lengths)))


def _told(table: ClosestState, other: ClosestState) -> ClosestState:
    """A table that goes on from where another one stands: no pair in it has a bound below what is known."""
    known = np.asarray(lower_of(other))
    lower = np.asarray(table.lower)
    lower = array_of(np.where(np.isfinite(lower), np.maximum(lower, known), lower))
    settled = array_of(np.maximum(np.asarray(table.settled), known))
    best = other.best if other.best.upper < table.best.upper else table.best
    return table._replace(lower=lower, settled=settled, best=best, steps=other.steps, pairs=other.pairs)
