"""Breakpoints on lines: a function changes there between smooth branches, as a distance does between feet.

At a point of a line the value, the slope, and a label of the branch are known. The tangents of both branches meet
within the squared distance from the breakpoint, so a bracket of this width about their meeting point holds it. If it
does not, or if the branches touch without a breakpoint, the bracket is halved.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

# Times that a bracket is narrowed by two places: as its square, an eighth becomes nothing in half as many.
_ROUNDS = 7
# Half of the next bracket over the square of one, in lines, and by how much more it is where that missed the kink.
_SHARE, _WIDER = 0.125, 8.0


class OnLines(NamedTuple):
    """What is known at places of lines, one on each."""

    place: Float[np.ndarray, " lines"]
    value: Float[np.ndarray, " lines"]
    slope: Float[np.ndarray, " lines"]
    label: Int[np.ndarray, " lines"]


class Kinks(NamedTuple):
    """Places where branches meet, and the labels seen nearest on both sides."""

    place: Float[np.ndarray, " lines"]
    before: Int[np.ndarray, " lines"]
    behind: Int[np.ndarray, " lines"]


def kinks(look: Callable[[np.ndarray], OnLines], low: np.ndarray, high: np.ndarray) -> Kinks:
    """Where the branch at one end of each line passes into that at the other end; anywhere where there is one branch.

    Where there is a third one between, one of its ends is found.

    Args:
        look: what is seen at a place of each line.
        low: where the lines start.
        high: where they end.
    """
    first, last = look(low), look(high)
    share = np.full(len(low), _SHARE) / np.where(high > low, high - low, 1.0)
    for _ in range(_ROUNDS):
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
    """Both ends after a look at a place between them, or at the middle, and whether that place lies before the kink."""
    inside = (place > first.place) & (place < last.place)
    at = look(np.where(inside, place, 0.5 * (first.place + last.place)))
    by_slope = np.abs(at.slope - first.slope) < np.abs(at.slope - last.slope)
    as_first, as_last = at.label == first.label, at.label == last.label
    before = np.where(as_first != as_last, as_first, by_slope)
    return chosen(before, at, first), chosen(before, last, at), before


def chosen(which: np.ndarray, x: OnLines, y: OnLines) -> OnLines:
    """What is known of one place of each line: the first where `which` is true."""
    return OnLines(*(np.where(which, *pair) for pair in zip(x, y, strict=True)))


def meeting(first: OnLines, last: OnLines) -> tuple[np.ndarray, np.ndarray]:
    """Where the tangents at both ends meet, or the middle, and the value of that at the first end there."""
    bend, width = first.slope - last.slope, last.place - first.place
    place = first.place + (last.value - first.value - last.slope * width) / np.where(bend != 0, bend, 1.0)
    inside = (bend != 0) & (place > first.place) & (place < last.place)
    place = np.where(inside, place, 0.5 * (first.place + last.place))
    return place, first.value + first.slope * (place - first.place)
