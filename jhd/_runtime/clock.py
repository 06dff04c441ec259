"""A time limit for iterations."""

import math
import time
from collections.abc import Callable
from typing import Any


class OutOfTimeError(Exception):
    """The time is up; the iteration keeps the best point so far."""


class TimeLimit(KeyboardInterrupt):
    """The time is up; a search ends with the bounds reached, as at Ctrl-C."""


# Additional time for the proof at the end, as a fraction of the time.
_FOR_PROOF = 0.1


class Clock:
    """A time limit, checked before each evaluation and during long ones.

    Args:
        seconds: of wall time from now on; None for no limit.

    Raises:
        TypeError: seconds that are no number.
        ValueError: seconds that are not positive.
    """

    def __init__(self, seconds: float | None = None):
        try:
            limit = math.inf if seconds is None else math.fsum([seconds])
        except (TypeError, ValueError, OverflowError) as error:
            raise TypeError(f"max_seconds must be a number; got {seconds!r}.") from error
        if not limit > 0:
            raise ValueError(f"max_seconds is {seconds}; needs a positive number.")
        now = time.monotonic() if math.isfinite(limit) else 0.0
        self._end, self._last = now + limit, now + (1 + _FOR_PROOF) * limit

    def is_over(self) -> bool:
        """Whether the time is up."""
        return self._end < math.inf and time.monotonic() > self._end

    def check(self) -> None:
        """Raise OutOfTimeError if the time is up."""
        if self.is_over():
            raise OutOfTimeError

    def is_closed(self) -> bool:
        """Whether the additional time for the proof is up, too."""
        return self._last < math.inf and time.monotonic() > self._last

    def compiling(self) -> None:
        """Check that there is time to compile a search, which cannot be interrupted; see jhd._runtime.compiled.asking.

        Raises:
            OutOfTimeError: there is no time for it.
        """
        # Ten seconds are twice the time to compile the functions of a search on a slow core.
        if self._last < math.inf and time.monotonic() + 10.0 > self._last:
            raise OutOfTimeError

    def heard(self, progress: object) -> None:
        """Progress callback of the searches of an evaluation: ends them when the time is up; see check."""
        del progress
        self.check()

    def closing(self, progress: object) -> None:
        """Progress callback of the search for the final proof: ends it with its bounds so far; see is_closed.

        Raises:
            TimeLimit: ends a search with the bounds reached.
        """
        del progress
        if self.is_closed():
            raise TimeLimit


def with_time_limit(progress: Callable[[Any], object] | None, seconds: float | None) -> Callable[[Any], object] | None:
    """The progress callback of a call without partial results.

    It calls `progress`, and raises TimeoutError once the seconds have passed; without a limit it is `progress` itself.
    """
    if seconds is None:
        return progress
    clock = Clock(seconds)

    def report(reached: Any) -> None:
        if progress is not None:
            progress(reached)
        if clock.is_over():
            limit = f"max_seconds = {float(seconds):g}"
            raise TimeoutError(f"the call takes longer than {limit}. Raise it, or choose a coarser result.")

    return report
