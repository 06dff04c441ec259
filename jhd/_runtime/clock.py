"""A time limit for iterations."""

import math
import time


class OutOfTimeError(Exception):
    """The time is up; whoever iterates keeps the best so far."""


class TimeLimit(KeyboardInterrupt):
    """The time is up; a search ends with the bounds reached, as at Ctrl-C."""


# What the proof at the end may take beyond the time, as a share of it.
_FOR_PROOF = 0.1
# Seconds that the programs of a search may take to be compiled: twice what a slow core takes.
_TO_COMPILE = 10.0


class Clock:
    """Asked before each evaluation, and in long ones.

    Args:
        seconds: of wall time from now on; None for no limit.

    Raises:
        TypeError: seconds that are no number.
        ValueError: seconds that are not positive.
    """

    def __init__(self, seconds: float | None = None):
        if seconds is not None and not hasattr(seconds, "__float__"):
            raise TypeError(f"max_seconds must be a number; got {seconds!r}.")
        if seconds is not None and not seconds > 0:
            raise ValueError(f"max_seconds is {seconds}; needs a positive number.")
        limit = math.inf if seconds is None else seconds
        now = time.monotonic() if math.isfinite(limit) else 0.0
        self._end, self._last = now + limit, now + (1 + _FOR_PROOF) * limit

    def is_over(self) -> bool:
        """Whether the end has come."""
        return self._end < math.inf and time.monotonic() > self._end

    def check(self) -> None:
        """Raises OutOfTimeError after the end."""
        if self.is_over():
            raise OutOfTimeError

    def is_closed(self) -> bool:
        """Whether the time for the proof is over as well."""
        return self._last < math.inf and time.monotonic() > self._last

    def compiling(self) -> None:
        """Asked before the programs of a search are compiled, which nothing ends; see jhd._runtime.compiled.asking.

        Raises:
            OutOfTimeError: there is no time for it.
        """
        if self._last < math.inf and time.monotonic() + _TO_COMPILE > self._last:
            raise OutOfTimeError

    def heard(self, progress: object) -> None:
        """A listener of searches that ends those of an evaluation when the time is up; see check."""
        del progress
        self.check()

    def closing(self, progress: object) -> None:
        """A listener of the search for the proof at the end: after some time more it is ended with its bounds so far.

        Raises:
            TimeLimit: ends a search with the bounds reached.
        """
        del progress
        if self.is_closed():
            raise TimeLimit
