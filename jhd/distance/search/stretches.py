"""The search for a minimum distance from the host: in stretches, between which it reports, stops and makes room."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from jhd.distance.search.closest import State, longer
from jhd.solution import RESULTS, name_of

# Steps of the first stretch, the seconds that later ones are made to last, and how the table grows.
_FIRST_STEPS, _SECONDS, _GROWTH = 64, 0.2, 4
# A table beyond this length is not exchanged for a longer one: it would fill the memory.
_LONGEST = 1 << 20


def in_stretches(
    go: Callable[[State, Any, Any], tuple[State, Any, Any]],
    state: State,
    max_steps: int,
    report: Callable[[Any], object] | None,
) -> Any:
    """The outcome of a search that `go` leads on: (state, limit, growing) to (state, outcome, open and full).

    Ctrl-C gives the outcome reached, whose result is then RESULTS.interrupted.
    """
    found, stretch = None, _FIRST_STEPS
    while True:
        done = int(state.steps)
        limit, growing = min(done + stretch, max_steps), state.lower.size < _LONGEST
        began = time.perf_counter()
        try:
            state, found, news = go(state, np.asarray(limit), np.asarray(growing))
            going_on, full = np.asarray(news)
            if report is not None:
                report(found)
        except KeyboardInterrupt:
            if found is None:
                raise
            return found if name_of(found.result) == "successful" else found._replace(result=RESULTS.interrupted)
        if not going_on or int(state.steps) >= max_steps:
            return found
        if growing and full:
            state = longer(state, _GROWTH)
        if done:
            stretch = max(1, int(stretch * min(4.0, _SECONDS / (time.perf_counter() - began))))
