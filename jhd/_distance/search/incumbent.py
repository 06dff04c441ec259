"""Proposals of points of a source that are farther from a target than the best point so far, with active feet.

A proposal is measured before it is accepted: its distance is proven like the distance of any other point. The active
feet of a point are about equally near to it, and balance there.
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

# A point counts as farther unless it is nearer by more than this many units of roundoff, of distance and coordinates.
_AS_FAR = 32
# Additional feet of the farthest point that polishing may find.
_MISSED = 2
# A point is proven at any cost, and fixed feet are tried, if this multiple of the allowed gap is open.
_OPEN_PROOF = 16
# Largest number of moves with all feet; each has to close more than half of the gap.
_TIMES = 8
# Distance of the points sampled around the farthest point, and the margin within which they count as nearest; fractions
# of the distance.
_RING, _EQUAL = 1e-6, 1e-8
# Fraction of this margin that bounds of distances around the point may leave open.
_SURE = 0.1
_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
# By how much the gap may be too small.
_OPEN = 4


class PlaceFound(NamedTuple):
    """The farthest point found: piece, parameters, point and its error, foot (one row), proven bound, distance."""

    piece: int
    x: np.ndarray
    point: np.ndarray
    foot: FootRows
    lower: float
    distance: float
    radius: float


class FartherPlaces:
    """Moves a point to a maximum of its distance.

    Args:
        source: the shape of the point.
        target: the shape that distances are taken to.
        about: returns the point on pieces, on which its feet are followed.
    """

    def __init__(self, source: AbstractSource, target: AbstractTarget, about: About):
        self._source, self._target, self._on_pieces = source, target, about

    def with_its_foot(self, best: PlaceFound, close: float) -> PlaceFound:
        """Return the point moved to its maximum, as long as the same foot is the nearest.

        Args:
            best: the point.
            close: gap that bounds of its distance may have.
        """
        places = self._about(best)
        return self._balanced(places[0], best, best.foot, np.ones(1), close, missed=0) if places else best

    def with_all_feet(self, best: PlaceFound, gap: float, close: float) -> PlaceFound:
        """Return the point to full precision, with all feet that count, for maxima at which feet are equally near.

        Args:
            best: the point.
            gap: gap between the bounds.
            close: gap that bounds of its distance may have.
        """
        for _ in range(_TIMES):
            found = self._with_feet(best, gap, close)
            gained = found.lower - best.lower
            best, gap = found, max(gap - gained, 0.0)
            if not gained > gap:
                break
        return best

    def _with_feet(self, best: PlaceFound, gap: float, close: float) -> PlaceFound:
        """Return the point balanced with the first set of active feet that makes it farther, or `best`."""
        places = self._about(best)
        if not places or best.lower <= 0 or not np.isfinite(gap):
            return best
        # First the feet that count wherever the maximum may be, then the feet that are about equally near at the point.
        reach = _reach_of(best.point, best.foot, gap, self._rays(best)[1])
        for far in (reach, 0.0):
            feet, shares, _ = self.active(best, gap, far)
            found = self._first_balanced(places, best, feet, shares, close)
            left = gap - (found.lower - best.lower)
            if left > _OPEN_PROOF * close and np.count_nonzero(shares) > 2 and places[0].shapes[1] is not None:
                # Along a curve of nearest points all feet would move to one of them, so here the feet are fixed.
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
        """Return the first point that is farther when balanced with some feet, or `best`."""
        every = (self._balanced(place, best, feet, shares, close) for place in places)
        return next((found for found in every if found is not best), best)

    def active(self, place: PlaceFound, gap: float, reach: float = 0.0) -> tuple[FootRows, np.ndarray, bool]:
        """Return the feet that count at a point or within `reach`, their multipliers, and whether it is on a border."""
        free, into = self._rays(place)
        places = self._about(place)
        follow = places[0].moved if places else None
        feet, shares = _active_feet(self._target, place.point, place.foot, gap, (free, into), follow, reach)
        return feet, shares, len(into) < len(free)

    def _rays(self, place: PlaceFound) -> tuple[np.ndarray, np.ndarray]:
        """Return directions along the source without borders, and directions into it; none for an unknown point."""
        nowhere = np.zeros((0, 3))
        return self._source.rays(place.piece, place.x) if np.all(np.isfinite(place.x)) else (nowhere, nowhere)

    def _about(self, place: PlaceFound) -> list[PlaceOnPiece]:
        """Return the point on parametric pieces, on which its feet are followed."""
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
        """Return the point balanced with some feet, and with at most `missed` nearer feet that it meets."""
        for _ in range(1 + missed):
            tried = self._measured(best, polished(place, feet, shares), close)
            found = _farther(best, tried)
            if tried is None or found is not best:
                return found
            feet = joined([feet, tried.foot])
            shares = np.append(0.5 * shares, 0.5)
        return best

    def _measured(self, best: PlaceFound, found: SharpenedPlace | None, close: float) -> PlaceFound | None:
        """Return a point on the same piece with its distance, which may be smaller."""
        if found is None:
            return None
        found, radius = self._source.proven(found, best.radius)
        there = self._target.nearest(found.point[None], close=close, hasty=True)
        if there.lower[0] < there.distance[0] - close and there.distance[0] > best.lower + _OPEN_PROOF * close:
            # The point may have many nearest points.
            there = self._target.nearest(found.point[None], close=close)
        lower, foot = (float(there.lower[0]) - radius) * (1 - 4e-16), self._target.rows_of(there)
        return PlaceFound(best.piece, found.x, found.point, foot, lower, float(there.distance[0]), radius)


def _farther(best: PlaceFound, tried: PlaceFound | None) -> PlaceFound:
    """Return the point tried, unless it is nearer by more than rounding, with the better bound of both."""
    if tried is None or not np.isfinite(tried.radius):
        return best
    missing = _AS_FAR * unit_roundoff(best.point.dtype) * (1 + best.distance)
    if not tried.distance >= best.distance - missing:
        return best
    return tried._replace(lower=max(tried.lower, best.lower))


def _reach_of(place: np.ndarray, foot: FootRows, gap: float, into: np.ndarray) -> float:
    """Bound how far the farthest point can be from a point: on the way the distance rises by at most the gap."""
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
    """Return the feet (FEET,) that are about nearest to a point or within `reach`, and multipliers that balance them.

    The `rays` are directions along the source without borders, and directions into it. Multipliers that balance all of
    the former serve as well. `follow` moves feet of neighboring points to the point; None uses approximate feet.
    """
    free, into = rays
    size = _size(place, foot)
    if follow is None:
        found = target.rows_of(target.near((place + _RING * size * _CUBE).astype(place.dtype)))
    else:
        # On either side of a tie another foot is the nearest. Next to flat pieces that meet at a small angle, the gap
        # leaves the point farther from the tie than a small fraction of the distance.
        around = (place + max(_RING * size, np.sqrt(gap * size), reach) * _CUBE).astype(place.dtype)
        found = follow(target.rows_of(target.nearest(around, close=_SURE * _EQUAL * size)))
    every = joined([foot, found])
    distance = np.linalg.norm(place.astype(np.float64) - every.point, axis=1)
    equal = max(_OPEN * gap, _EQUAL * size, 2 * reach)
    # Feet of neighboring points move with these points.
    directions = (free, into) if len(into) < len(free) else (free,)
    rows, shares = balanced_feet(place, every.point, distance, (equal, target.same * size), directions)
    return every.take(rows), shares
