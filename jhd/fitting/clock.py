"""A limit of time for iterations that evaluate again and again."""

import math
import time


class OutOfTimeError(Exception):
    """The time is up; whoever iterates keeps the best so far."""


class Clock:
    """Asked before each evaluation.

    Args:
        seconds: of wall time from now on; None for no limit.

    Raises:
        ValueError: seconds that are no positive number.
    """

    def __init__(self, seconds: float | None = None):
        if seconds is not None and not seconds > 0:
            raise ValueError(f"max_seconds is {seconds}; needs a positive number.")
        self._end = math.inf if seconds is None else time.monotonic() + seconds

    def is_over(self) -> bool:
        """Whether the end has come."""
        return time.monotonic() > self._end

    def check(self) -> None:
        """Raises OutOfTimeError after the end."""
        if self.is_over():
            raise OutOfTimeError
