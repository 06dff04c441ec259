"""The interface of a search, and the one loop that runs it from the host.

A search runs in stretches of a bounded number of steps. Between two stretches Python can handle Ctrl-C, progress is
reported, and a queue that is nearly full is replaced by a longer one. The bounds are true at every stage, so an
interrupted call returns the bounds reached. The other direction, which the call would search next, returns its initial
bounds.
"""

import time
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from jhd._distance.normalization.coordinates import Frame
from jhd._results.solution import RESULTS, name_of, with_result
from jhd._runtime.clock import Clock, TimeLimit
from jhd.progress import Callback, Progress

# Target duration of stretches after the first two, in seconds, and how much longer the next one may be.
_SECONDS, _LONGER = 0.2, 4.0
# Shortest duration of a stretch: a coarse clock may not have moved in it.
_TICK = 1e-9


class Standing(NamedTuple):
    """Progress of a search."""

    solution: Any  # the solution so far, in the coordinates of the search: a HausdorffSolution or a MinimumSolution
    going_on: bool  # whether more steps would improve the requested bounds
    full: bool  # whether it stopped because its table is full; then `longer` helps
    steps: int  # steps taken in all
    waiting: int  # cells, or pairs of cells, that are still open


class AbstractSearch(ABC):
    """A search for bounds that get closer with each step. Its state is passed and returned, so it can be resumed.

    Args:
        max_steps: most steps in all.
        first_steps: steps of the first stretch, which hold all but hard cases; 0 for the bounds it begins with.
    """

    max_steps: int
    first_steps: int

    @abstractmethod
    def begin(self) -> Any:
        """Return the state in which no step has been taken."""

    @abstractmethod
    def advance(self, state: Any, limit: int, growing: bool) -> tuple[Any, Standing]:
        """Advance the search until the goal or a limit is reached.

        Args:
            state: state of the search.
            limit: largest total number of steps since the search began.
            growing: whether to stop before the table is full.
        """

    def longer(self, state: Any) -> Any:
        """Return the state with more room; by default unchanged, for searches that are never full."""
        return state


class Watch:
    """A progress callback that ends a search when its time is up, or when both bounds are on one side of a length.

    Args:
        progress: another callback for the progress, or None.
        clock: the time limit.
        limit: the length, in the unit of the coordinates, or None.
    """

    def __init__(self, progress: Callback | None, clock: Clock, limit: float | None = None):
        self._progress, self.clock, self._limit, self.passed = progress, clock, limit, False

    def __call__(self, progress: Progress) -> None:
        """Record the bounds, and pass the progress on.

        Raises:
            TimeLimit: the time is up.
        """
        lower, upper = progress.lower or 0.0, np.inf if progress.upper is None else progress.upper
        self.passed = self._limit is not None and (upper <= self._limit or lower > self._limit)
        if self._progress is not None:
            self._progress(progress)
        if self.clock.is_over():
            raise TimeLimit


class Listener:
    """Receiver of the progress of all searches in one call; records whether they were interrupted.

    Args:
        progress: called with a Progress after each stretch, or None.
        frame: leads to the user's unit; None if lengths are in this unit.
        stage: name of the stage of searches without a direction.
    """

    def __init__(self, progress: Callback | None = None, frame: Frame | None = None, stage: str = "minimum"):
        self._progress, self._frame, self._stage = progress, frame, stage
        self.interrupted, self.late = False, False

    @property
    def satisfied(self) -> bool:
        """Whether tighter bounds are not needed."""
        return isinstance(self._progress, Watch) and self._progress.passed

    def is_over(self) -> bool:
        """Return whether the call was interrupted or its time is up, also in the middle of a step."""
        return self.interrupted or (isinstance(self._progress, Watch) and self._progress.clock.is_over())

    def report(self, direction: Any, standing: Standing) -> None:
        """Report the progress of a search; the direction is a member of DIRECTIONS, or None."""
        if self._progress is None:
            return
        ends = standing.solution.lower, standing.solution.upper
        if self._frame is not None:
            ends = self._frame.length(ends[0], 0.0), self._frame.length(ends[1], np.inf)
        stage, steps = self._stage if direction is None else name_of(direction), int(standing.steps)
        self._progress(Progress(stage, steps, steps + int(standing.waiting), float(ends[0]), float(ends[1])))


def drive(search: AbstractSearch, listener: Listener, direction: Any = None) -> Any:
    """Return the solution of a search run to its end, or as it stands when interrupted.

    Raises:
        KeyboardInterrupt: it was interrupted before it had any bounds.
    """
    state: Any = None
    standing: Standing | None = None
    taken, stretch = 0, search.first_steps
    while True:
        limit = 0 if listener.interrupted else min(taken + stretch, search.max_steps)
        began = time.perf_counter()
        try:
            fresh = state is None
            state, standing = search.advance(search.begin() if fresh else state, limit, not listener.interrupted)
            listener.report(direction, standing)
        except KeyboardInterrupt as stop:
            if standing is None:
                raise
            listener.late = isinstance(stop, TimeLimit) and (listener.late or not listener.interrupted)
            listener.interrupted = True
        over = listener.satisfied or not standing.going_on or standing.steps >= search.max_steps
        if listener.interrupted or over:
            return _ended(standing, listener)
        # The first stretch may have been compiled in it.
        if not fresh:
            stretch = max(1, int(stretch * min(_LONGER, _SECONDS / max(time.perf_counter() - began, _TICK))))
        stretch, taken = max(1, stretch), int(standing.steps)
        if standing.full:
            state = search.longer(state)


def ended_by(stop: KeyboardInterrupt) -> Any:
    """Return the member of RESULTS for a call that its time limit or Ctrl-C ended."""
    return RESULTS.out_of_time if isinstance(stop, TimeLimit) else RESULTS.interrupted


def _ended(standing: Standing, listener: Listener) -> Any:
    solution = standing.solution
    if listener.interrupted and name_of(solution.result) != "successful":
        return with_result(solution, RESULTS.out_of_time if listener.late else RESULTS.interrupted)
    return solution
