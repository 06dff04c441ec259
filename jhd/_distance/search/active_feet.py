"""The active feet of the farthest point: feet at about equal distances that balance there."""

from collections.abc import Callable

import numpy as np

from jhd._arithmetic.rounding import smallest_normal
from jhd._distance.nearest.target import AbstractTarget, FootRows
from jhd._distance.witness.multipliers import balanced_feet
from jhd._runtime.arrays import joined

# Points are looked for around the place this far away, and count as nearest within this much; shares of the distance.
_RING, _EQUAL = 1e-6, 1e-8
# Of the latter the share that bounds of distances around the place may leave open.
_SURE = 0.1
_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
# By how much the gap may be too small.
_OPEN = 4


def reach_of(place: np.ndarray, foot: FootRows, gap: float, into: np.ndarray) -> float:
    """How far from a place the farthest one can be.

    The distance to its foot rises on the way, and no more than the gap.

    Args:
        place: the place found.
        foot: its nearest point.
        gap: upper - lower.
        into: unit vectors along the shape of the place.
    """
    apart = place.astype(np.float64) - foot.point[0]
    steep = float(np.max(into @ apart, initial=0.0)) / max(float(np.linalg.norm(apart)), smallest_normal(np.float64))
    return min(_OPEN * gap / steep, _size(place, foot)) if steep > 0 else 0.0


def _size(place: np.ndarray, foot: FootRows) -> float:
    return max(float(np.max(np.abs(place - foot.point[0]))), smallest_normal(place.dtype))


def active_feet(
    target: AbstractTarget,
    place: np.ndarray,
    foot: FootRows,
    gap: float,
    rays: tuple[np.ndarray, np.ndarray],
    follow: Callable[[FootRows], FootRows] | None,
    reach: float = 0.0,
) -> tuple[FootRows, np.ndarray]:
    """The feet (FEET,) that are about nearest to a place and balance there, and their multipliers.

    Args:
        target: the shape that they lie on.
        place: the farthest place of the other one.
        foot: its nearest point.
        gap: upper - lower, which the distances of active feet may differ by.
        rays: directions along the other shape as if it had no border, and those into it; multipliers that balance all
            of the former serve as well.
        follow: moves feet of places around to the place; None where feet about nearest have to do.
        reach: how far from the place the farthest one may be; feet that count there count as well.
    """
    free, into = rays
    size = _size(place, foot)
    if follow is None:
        found = target.rows_of(target.near((place + _RING * size * _CUBE).astype(place.dtype)))
    else:
        # On either side of a tie another foot is the nearest. Beside flat pieces that meet at a small angle the gap
        # leaves the place farther from it than a small share of the distance.
        around = (place + max(_RING * size, np.sqrt(gap * size), reach) * _CUBE).astype(place.dtype)
        found = follow(target.rows_of(target.nearest(around, close=_SURE * _EQUAL * size)))
    every = joined([foot, found])
    distance = np.linalg.norm(place.astype(np.float64) - every.point, axis=1)
    equal = max(_OPEN * gap, _EQUAL * size, 2 * reach)
    # Feet around move with the places that they belong to.
    directions = (free, into) if len(into) < len(free) else (free,)
    rows, shares = balanced_feet(place, every.point, distance, (equal, target.same * size), directions)
    return every.take(rows), shares
