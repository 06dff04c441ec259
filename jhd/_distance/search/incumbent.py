"""Proposals of points of a source that are farther from a target than the best point so far, with active feet.

A proposal is measured before it is accepted: its distance is proven like the distance of any other point.
"""

from typing import NamedTuple

import numpy as np

from jhd._arithmetic.rounding import unit_roundoff
from jhd._distance.nearest.target import AbstractTarget, FootRows
from jhd._distance.search.active_feet import active_feet, reach_of
from jhd._distance.search.polished_place import About, PlaceOnPiece, SharpenedPlace, polished
from jhd._distance.search.sources import AbstractSource
from jhd._runtime.arrays import joined

# A place counts as farther unless more units of roundoff are missing, of the distance and of the coordinates.
_AS_FAR = 32
# Feet of the farthest place that polishing may find besides those that are known.
_MISSED = 2


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
        places = self._about(best)
        if not places or best.lower <= 0 or not np.isfinite(gap):
            return best
        # Those that count wherever the gap leaves the maximum, else those that are about equally near at the place.
        reach = reach_of(best.point, best.foot, gap, self._rays(best)[1])
        for far in (reach, 0.0):
            feet, shares, _ = self.active(best, gap, far)
            for place in places:
                found = self._balanced(place, best, feet, shares, close)
                if found is not best:
                    return found
        return best

    def active(self, place: PlaceFound, gap: float, reach: float = 0.0) -> tuple[FootRows, np.ndarray, bool]:
        """The feet that count at a place, or within reach of it, their multipliers, and whether it lies on a border."""
        free, into = self._rays(place)
        places = self._about(place)
        follow = places[0].moved if places else None
        feet, shares = active_feet(self._target, place.point, place.foot, gap, (free, into), follow, reach)
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
