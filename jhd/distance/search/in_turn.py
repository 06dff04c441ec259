"""A search for the minimum distance in two turns.

The first has the bounds that close most pairs; where it does not, the second begins afresh with others that take longer
to compile and to compute, and with what is known by then.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jhd.distance.search.closest import ClosestState, longer, may_grow
from jhd.distance.search.search import AbstractSearch, Standing

# Steps of the first turn, and how many of these take as long as one of the second.
_FIRST_TURN, _WORTH = 512, 2


class _Turn(NamedTuple):
    """The table, and whether it is that of the second turn."""

    table: ClosestState
    second: bool


class InTurn(AbstractSearch):
    """The search from the host.

    Args:
        begun: makes the table in which it begins.
        first: goes on from a table until a limit of steps, growing or not; to the table, its outcome and `news_of`.
        afresh: makes the table in which the second turn begins, from that of the first one.
        second: as `first`.
        max_steps: most steps, as long as those of the first turn.
    """

    first_steps = 64

    def __init__(
        self,
        begun: Callable[[], ClosestState],
        first: Callable[..., Any],
        afresh: Callable[[ClosestState], ClosestState],
        second: Callable[..., Any],
        max_steps: int,
    ):
        self._begun, self._first, self._afresh, self._second = begun, first, afresh, second
        self.max_steps = min(max_steps, _FIRST_TURN + max(max_steps - _FIRST_TURN, 0) // _WORTH)

    def begin(self) -> _Turn:
        """See AbstractSearch."""
        return _Turn(self._begun(), False)

    def advance(self, state: _Turn, limit: int, growing: bool) -> tuple[_Turn, Standing]:
        """See AbstractSearch."""
        table, second = state
        if not second and int(table.steps) >= _FIRST_TURN and limit > _FIRST_TURN:
            table, second = self._afresh(table), True
        stretch, limit = (self._second, limit) if second else (self._first, min(limit, _FIRST_TURN))
        room = np.asarray(growing and may_grow(table))
        table, found, news = stretch(table, np.asarray(limit), room)
        return _Turn(table, second), Standing(found, *np.asarray(news))

    def longer(self, state: _Turn) -> _Turn:
        """See AbstractSearch."""
        return state._replace(table=longer(state.table))
