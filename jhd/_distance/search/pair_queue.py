"""A search for the minimum distance whose pairs are too many for one table: the nearest ones are searched first.

The pairs wait in a list sorted by lower bound. When the table has no relevant pair left, it is filled with the next
part of the list, until the bounds of the waiting pairs are no less than the smallest distance found. So tables have one
length, whatever the number of pairs, and functions are compiled once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from typing_extensions import override

from jhd._distance.search.closest import ClosestState, longer, may_grow
from jhd._distance.search.search import AbstractSearch, Standing

# Pairs that are handed to the table at once.
PART = 2048


class _Queue(NamedTuple):
    """The table, and the first pair of the list that it has not been handed."""

    table: ClosestState
    next: int


class QueuedSearch(AbstractSearch):
    """The search over queued pairs, from the host.

    Args:
        lower: the lower bounds of all pairs, sorted.
        filled: makes the table with the pairs from an index on.
        stretch: advances a table up to a limit of steps, growing or not, given a lower bound of the pairs outside the
            table; returns the table, the outcome and `news_of`.
        closed: returns the bound at which pairs are closed, for a table.
        max_steps: most steps.
    """

    first_steps = 64

    def __init__(
        self,
        lower: np.ndarray,
        filled: Callable[[int], ClosestState],
        stretch: Callable[..., Any],
        closed: Callable[[ClosestState], float],
        max_steps: int,
    ):
        self._lower, self._filled, self._stretch = lower, filled, stretch
        self._closed, self.max_steps = closed, max_steps

    @override
    def begin(self) -> _Queue:
        return _Queue(self._filled(0), PART)

    @override
    def advance(self, state: _Queue, limit: int, growing: bool) -> tuple[_Queue, Standing]:
        table, following = state
        while True:
            room = np.asarray(growing and may_grow(table))
            table, found, news = self._stretch(table, np.asarray(limit), room, self._bound(following))
            going, full, steps, waiting = (int(x) for x in np.asarray(news))
            more = self._bound(following) < self._closed(table)
            if going or not more or steps >= limit:
                waiting += max(len(self._lower) - following, 0)
                return _Queue(table, following), Standing(found, bool(going or more), bool(full), steps, waiting)
            table, following = self._next(table, following), following + PART

    @override
    def longer(self, state: _Queue) -> _Queue:
        return state._replace(table=longer(state.table))

    def _bound(self, following: int) -> np.ndarray:
        """Return the least bound of the waiting pairs; infinite if none waits."""
        known = following < len(self._lower)
        return np.asarray(self._lower[following] if known else np.inf, self._lower.dtype)

    def _next(self, table: ClosestState, following: int) -> ClosestState:
        """Return a table with the next pairs and the results so far."""
        fresh = self._filled(following)
        room = table.lower.size
        while fresh.lower.size < room:
            fresh = longer(fresh)
        known = {name: getattr(table, name) for name in ("best", "settled", "lost", "steps", "pairs")}
        return fresh._replace(**known)
