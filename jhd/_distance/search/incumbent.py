"""Proposals of points of a source that are farther from a target than the best point so far, with active feet.

A proposal is measured before it is accepted: its distance is proven like the distance of any other point. The active
feet are those that are about equally near and balance there.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jhd._arithmetic.rounding import smallest_normal, unit_roundoff
from jhd._distance.nearest.target import AbstractTarget, FootRows
from jhd._distance.search.polished_place import About, PlaceOnPiece, SharpenedPlace, polished
from jhd._distance.search.sources import AbstractSource
from jhd._distance.witness.multipliers import balanced_feet
from jhd._runtime.arrays import joined

# A place counts as farther unless more units of roundoff are missing, of the distance and of the coordinates.
_AS_FAR = 32
# Feet of the farthest place that polishing may find besides those that are known.
_MISSED = 2
# A place is proven at any cost, and feet that stay are tried, if so many times what bounds may be apart is open.
_OPEN_PROOF = 16
# How often a place is moved with all feet, as long as each time closes more than half of the gap.
_TIMES = 8
# Points are looked for around the place this far away, and count as nearest within this much; shares of the distance.
_RING, _EQUAL = 1e-6, 1e-8
# Of the latter the share that bounds of distances around the place may leave open.
_SURE = 0.1
_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
# By how much the gap may be too small.
_OPEN = 4


class PlaceFound(NamedTuple):
    """The farthest place found: piece, parameters, point and its error, foot (one row), proven bound, distance."""

    piece: int
    x: np.ndarray
    point: np.ndarray
    foot: FootRows
    lower: float
    distance: float
    radius: float


class FartherPlaces:
    """What moves a place to where its distance is largest.

    Args:
        source: the shape that it is on.
        target: the shape that distances are taken to.
        about: leads from a place to what follows its feet.
    """

    def __init__(self, source: AbstractSource, target: AbstractTarget, about: About):
        self._source, self._target, self._on_pieces = source, target, about

    def with_its_foot(self, best: PlaceFound, close: float) -> PlaceFound:
        """The place moved to where it is farthest, as long as the same foot is the nearest.

        Args:
            best: the place.
            close: by how much bounds of its distance may be apart.
        """
        places = self._about(best)
        return self._balanced(places[0], best, best.foot, np.ones(1), close, missed=0) if places else best

    def with_all_feet(self, best: PlaceFound, gap: float, close: float) -> PlaceFound:
        """The place to full precision, with all feet that count, where the distances to some may be equal.

        Args:
            best: the place.
            gap: what is open between the bounds.
            close: by how much bounds of its distance may be apart.
        """
        for _ in range(_TIMES):
            found = self._with_feet(best, gap, close)
            gained = found.lower - best.lower
            best, gap = found, max(gap - gained, 0.0)
            if not gained > gap:
                break
        return best

    def _with_feet(self, best: PlaceFound, gap: float, close: float) -> PlaceFound:
        places = self._about(best)
        if not places or best.lower <= 0 or not np.isfinite(gap):
            return best
        # Those that count wherever the gap leaves the maximum, else those that are about equally near at the place.
        reach = _reach_of(best.point, best.foot, gap, self._rays(best)[1])
        for far in (reach, 0.0):
            feet, shares, _ = self.active(best, gap, far)
            found = self._first_balanced(places, best, feet, shares, close)
            left = gap - (found.lower - best.lower)
            if left > _OPEN_PROOF * close and np.count_nonzero(shares) > 2 and places[0].shapes[1] is not None:
                # Along a curve of nearest points all feet follow to one of them: they are left where they are.
                fixed = [place._replace(shapes=(place.shapes[0], None)) for place in places]
                other = self._first_balanced(fixed, best, feet, shares, close)
                if other.distance > found.distance:
                    found = other._replace(lower=max(other.lower, found.lower))
            if found is not best:
                return found
        return best

    def _first_balanced(
        self, places: list[PlaceOnPiece], best: PlaceFound, feet: FootRows, shares: np.ndarray, close: float
    ) -> PlaceFound:
        """The first place that is farther with some feet."""
        every = (self._balanced(place, best, feet, shares, close) for place in places)
        return next((found for found in every if found is not best), best)

    def active(self, place: PlaceFound, gap: float, reach: float = 0.0) -> tuple[FootRows, np.ndarray, bool]:
        """The feet that count at a place, or within reach of it, their multipliers, and whether it lies on a border."""
        free, into = self._rays(place)
        places = self._about(place)
        follow = places[0].moved if places else None
        feet, shares = _active_feet(self._target, place.point, place.foot, gap, (free, into), follow, reach)
        return feet, shares, len(into) < len(free)

    def _rays(self, place: PlaceFound) -> tuple[np.ndarray, np.ndarray]:
        """Directions along the source as if it had no border, and those into it; none where the place is not known."""
        nowhere = np.zeros((0, 3))
        return self._source.rays(place.piece, place.x) if np.all(np.isfinite(place.x)) else (nowhere, nowhere)

    def _about(self, place: PlaceFound) -> list[PlaceOnPiece]:
        """The place on parametric pieces, where its feet are followed."""
        return self._on_pieces(place) if np.all(np.isfinite(place.x)) else []

    def _balanced(
        self,
        place: PlaceOnPiece,
        best: PlaceFound,
        feet: FootRows,
        shares: np.ndarray,
        close: float,
        missed: int = _MISSED,
    ) -> PlaceFound:
        """The place with some feet, and with so many more that are nearer than they are where these lead to."""
        for _ in range(1 + missed):
            tried = self._measured(best, polished(place, feet, shares), close)
            found = _farther(best, tried)
            if tried is None or found is not best:
                return found
            feet = joined([feet, tried.foot])
            shares = np.append(0.5 * shares, 0.5)
        return best

    def _measured(self, best: PlaceFound, found: SharpenedPlace | None, close: float) -> PlaceFound | None:
        """A place on the same piece with its distance, which may be less."""
        if found is None:
            return None
        found, radius = self._source.proven(found, best.radius)
        there = self._target.nearest(found.point[None], close=close, hasty=True)
        if there.lower[0] < there.distance[0] - close and there.distance[0] > best.lower + _OPEN_PROOF * close:
            # It may have many nearest points.
            there = self._target.nearest(found.point[None], close=close)
        lower, foot = (float(there.lower[0]) - radius) * (1 - 4e-16), self._target.rows_of(there)
        return PlaceFound(best.piece, found.x, found.point, foot, lower, float(there.distance[0]), radius)


def _farther(best: PlaceFound, tried: PlaceFound | None) -> PlaceFound:
    """The place that was tried, unless it is nearer by more than rounding, with the bound of the better one."""
    if tried is None or not np.isfinite(tried.radius):
        return best
    missing = _AS_FAR * unit_roundoff(best.point.dtype) * (1 + best.distance)
    if not tried.distance >= best.distance - missing:
        return best
    return tried._replace(lower=max(tried.lower, best.lower))


def _reach_of(place: np.ndarray, foot: FootRows, gap: float, into: np.ndarray) -> float:
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


def _active_feet(
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
