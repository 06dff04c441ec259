"""Breakpoints on lines: a function changes there between smooth branches, as a distance does between feet.

At a point of a line the value, the slope, and a label of the branch are known. The tangents of both branches meet
within the squared distance from the breakpoint, so a bracket of this width about their meeting point holds it. If it
does not, or if the branches touch without a breakpoint, the bracket is halved.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

# Half of the next bracket over the square of the current one, in lines, and the factor if it missed the breakpoint.
_SHARE, _WIDER = 0.125, 8.0


class OnLines(NamedTuple):
    """Value, slope and branch label at one point of each line."""

    place: Float[np.ndarray, " lines"]
    value: Float[np.ndarray, " lines"]
    slope: Float[np.ndarray, " lines"]
    label: Int[np.ndarray, " lines"]


class Kinks(NamedTuple):
    """Breakpoints, and the labels nearest to them on both sides."""

    place: Float[np.ndarray, " lines"]
    before: Int[np.ndarray, " lines"]
    behind: Int[np.ndarray, " lines"]


def kinks(look: Callable[[np.ndarray], OnLines], low: np.ndarray, high: np.ndarray) -> Kinks:
    """Return the breakpoint between the branches at both ends of each line; any point if there is one branch only.

    If there is a third branch between, one of its ends is found.

    Args:
        look: returns the value, slope and label at a point of each line.
        low: starts of the lines.
        high: ends of the lines.
    """
    first, last = look(low), look(high)
    share = np.full(len(low), _SHARE) / np.where(high > low, high - low, 1.0)
    # How often two points narrow a bracket: its width is squared, so an eighth vanishes after half as many.
    for _ in range(7):
        middle, width = meeting(first, last)[0], last.place - first.place
        half = np.minimum(share * width, 0.25) * width
        first, last, before = _narrowed(look, first, last, middle - half)
        second = np.where(before, middle + half, 0.5 * (first.place + last.place))
        first, last, _ = _narrowed(look, first, last, second)
        share = np.where(last.place - first.place <= 2.5 * half, share, _WIDER * share)
    return Kinks(meeting(first, last)[0], first.label, last.label)


def _narrowed(
    look: Callable[[np.ndarray], OnLines], first: OnLines, last: OnLines, place: np.ndarray
) -> tuple[OnLines, OnLines, np.ndarray]:
    """Evaluate at `place`, or the middle if it is outside; return the ends, and whether the breakpoint is behind it."""
    inside = (place > first.place) & (place < last.place)
    at = look(np.where(inside, place, 0.5 * (first.place + last.place)))
    by_slope = np.abs(at.slope - first.slope) < np.abs(at.slope - last.slope)
    as_first, as_last = at.label == first.label, at.label == last.label
    before = np.where(as_first != as_last, as_first, by_slope)
    return chosen(before, at, first), chosen(before, last, at), before


def chosen(which: np.ndarray, x: OnLines, y: OnLines) -> OnLines:
    """Return for each line the entry of x if `which` is true, else of y."""
    return OnLines(*(np.where(which, *pair) for pair in zip(x, y, strict=True)))


def meeting(first: OnLines, last: OnLines) -> tuple[np.ndarray, np.ndarray]:
    """Return where the tangents at both ends meet, or the middle, and the value of the first tangent there."""
    bend, width = first.slope - last.slope, last.place - first.place
    place = first.place + (last.value - first.value - last.slope * width) / np.where(bend != 0, bend, 1.0)
    inside = (bend != 0) & (place > first.place) & (place < last.place)
    place = np.where(inside, place, 0.5 * (first.place + last.place))
    return place, first.value + first.slope * (place - first.place)
