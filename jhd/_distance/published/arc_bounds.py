"""Bounds of the distance from pieces of one curve to another, both replaced by circular arcs.

Arcs live on the host, in NumPy, the last axis counting them; points are complex numbers in common coordinates.

Source: Kim et al. 2010, section 4.2, whose test of an arc by its control polygon, condition (5), is unsafe; the test in
`arc_reach` is exact and costs no more.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic.rounding import gamma
from jhd._runtime.arrays import taken
from jhd._shapes.deviation import HostArcs

# How far outside of a wedge (in radians) a direction still counts as inside.
_ABOUT = 1e-9
# Arcs of b that are tried for each of three points of an arc of a.
_TRIED = 3


class Arcs(NamedTuple):
    """Arcs for distances, in common coordinates."""

    start: np.ndarray  # start of each arc
    end: np.ndarray  # end of each arc
    apex: np.ndarray  # intersection of the tangents at both ends; the arc lies in the triangle of the three points
    center: np.ndarray  # center of its circle
    radius: np.ndarray  # radius of its circle; 0 for points, whose center is the point
    bulge: np.ndarray  # tan(sweep / 4), positive to the left; 0 for points only
    # Largest distance of any point of the curve piece from the arc, and (except for `chords`) of any point of the arc
    # from the curve.
    deviation: np.ndarray
    segment: np.ndarray  # the segment of the curve
    t0: np.ndarray  # parameter at the start of the piece
    t1: np.ndarray  # parameter at the end of the piece

    @property
    def turn(self) -> np.ndarray:
        """1 to the left, -1 to the right."""
        return np.sign(self.bulge)

    @property
    def middle(self) -> np.ndarray:
        """Return the middle of each arc."""
        return 0.5 * (self.start + self.end) - 0.5j * self.bulge * (self.end - self.start)

    def quarters(self) -> "Arcs":
        """Return the first, third, second and fourth quarters of all arcs, in this order, with the whole pieces."""
        return self._halves()._halves()

    def _halves(self) -> "Arcs":
        bulge, middle = self.bulge / (1 + np.hypot(1, self.bulge)), self.middle
        start, end = np.concatenate([self.start, middle]), np.concatenate([middle, self.end])
        both = Arcs(*(np.concatenate([x, x]) for x in self._replace(bulge=bulge)))
        return both._replace(start=start, end=end, apex=_apex(start, end, both.bulge))

    take = taken


def arcs_of(arcs: HostArcs) -> Arcs:
    """Return arcs with centers that keep their digits: radii of at most a million, whose change counts as deviation.

    Arcs of one chord and one side lie within the larger sagitta of each other, |b| L / 2 with the bulge b and the
    chord L; a line becomes the flattest arc to its left.
    """
    start, end, b = arcs.start, arcs.end, arcs.bulge
    chord = end - start
    length = np.abs(chord)
    # Shorter chords are points.
    point = length < 1e-150
    # Radii above 1e6 are cut down to it, which moves an arc by less than its sagitta: centers then lose few digits.
    flattest = length / 4e6
    flat = np.abs(b) < flattest
    deviation = np.where(flat, arcs.deviation + 0.5 * flattest * length, arcs.deviation)
    b = np.where(flat, np.copysign(flattest, b), b)
    safe = np.where(point, 1.0, b)
    center = np.where(point, start, 0.5 * (start + end) + 1j * chord * ((1 - safe) * (1 + safe) / (4 * safe)))
    radius = np.where(point, 0.0, length * (1 + b * b) / (4 * np.abs(safe)))
    return Arcs(start, end, _apex(start, end, b), center, radius, b, deviation, arcs.segment, arcs.t0, arcs.t1)


def chords(segment: np.ndarray, t0: np.ndarray, t1: np.ndarray, points: np.ndarray) -> Arcs:
    """Return pieces of a curve as chords; deviations are distances of the pieces from the chords, not the reverse.

    The distance to a chord is a convex function, so its largest value at the control points bounds its values on the
    piece.

    Args:
        segment: the segments of the pieces.
        t0: parameter at the start of each piece.
        t1: parameter at the end of each piece.
        points: control points of the pieces, complex (points, pieces), off by gamma(9 n) in each coordinate.
    """
    start, end = points[0], points[-1]
    chord, offsets = end - start, points - start
    square = np.abs(chord) ** 2
    share = np.real(offsets * chord.conj()) / np.where(square > 0, square, 1.0)
    off = np.abs(offsets - np.clip(share, 0.0, 1.0) * chord).max(axis=0)
    # Rounding: twice the error of the points, and ten of the arithmetic on coordinates of at most two.
    slack = gamma(26 * len(points) + 40, np.float64)
    return arcs_of(HostArcs(segment, t0, t1, start, end, np.zeros(len(t0)), off + slack))


def _apex(start: np.ndarray, end: np.ndarray, bulge: np.ndarray) -> np.ndarray:
    return 0.5 * (start + end) - 1j * (end - start) * (bulge / ((1 - bulge) * (1 + bulge)))


def cross(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the cross product of complex numbers as vectors."""
    return np.imag(x.conj() * y)


def _in_wedge(arcs: Arcs, offset: np.ndarray) -> np.ndarray:
    """Return whether offsets from the centers point into the wedges of the arcs, or next to them; true for 0."""
    first, last = arcs.start - arcs.center, arcs.end - arcs.center
    least = -_ABOUT * arcs.radius * np.abs(offset)
    return (arcs.turn * cross(first, offset) >= least) & (arcs.turn * cross(offset, last) >= least)


def _largest(arcs: Arcs, point: np.ndarray) -> np.ndarray:
    """Largest distance of the points of each arc from a point: on the line to the center, or at an end."""
    between = point - arcs.center
    high = np.maximum(np.abs(arcs.start - point), np.abs(arcs.end - point))
    return np.where(_in_wedge(arcs, -between), np.maximum(high, np.abs(between) + arcs.radius), high)


def _smallest(arcs: Arcs, point: np.ndarray) -> np.ndarray:
    """Smallest distance of the points of each arc from a point, up to gamma(200) (1 + radius).

    A point that only rounding or `_ABOUT` puts into the wedge gets less than its distance.
    """
    between = point - arcs.center
    low = np.minimum(np.abs(arcs.start - point), np.abs(arcs.end - point))
    return np.where(_in_wedge(arcs, between), np.minimum(low, np.abs(np.abs(between) - arcs.radius)), low)


def arc_reach(d: Arcs, c: Arcs) -> np.ndarray:
    """Bound the largest distance of the curve piece of each arc d to the curve piece of the arc c in the same column.

    Let x be a point of the arc d. Its distance to c is | |x - o| - r | if x lies in the wedge of c, and always at most
    the distance to either end of c. The wedge is convex, for arcs turn by less than half a circle, so d lies in it with
    its control triangle; then the largest | |x - o| - r | is taken at the smallest or at the largest |x - o|. The
    distance along a circle is extreme on the line of the centers; on an arc, there or at its ends. Elsewhere the
    largest |x - p| for an end p of c is the same formula with another center. A point of the piece of d is within its
    deviation of the arc, and a point of the arc c within its deviation of b. So the distance to b of the whole piece is
    at most the sum. (Any pair of arcs gives a bound, so the choice needs no proof.)

    Rounding: ends, centers and distances are right up to gamma(64) (1 + r_c + r_d), for coordinates of at most one. A
    point that only rounding puts into the wedge is as near to it, and the arc as near to the radial foot. Points next
    to the wedge of d only enlarge the range. The slack of gamma(200) (1 + r_c + r_d) covers the sum.
    """
    bound = np.minimum(_largest(d, c.start), _largest(d, c.end))
    first, last = c.start - c.center, c.end - c.center
    inside = c.radius > 0
    for x in (d.start, d.end, d.apex):
        offset = x - c.center
        inside &= (c.turn * cross(first, offset) >= 0) & (c.turn * cross(offset, last) >= 0)
    rows = np.flatnonzero(inside)
    e, f = d.take(rows), c.take(rows)
    radial = np.maximum(_largest(e, f.center) - f.radius, f.radius - _smallest(e, f.center))
    bound[rows] = np.minimum(bound[rows], radial)
    return bound + gamma(200, np.float64) * (1 + c.radius + d.radius) + c.deviation + d.deviation


class ArcTarget:
    """The arcs of b, with a search tree of their ends and middles.

    Args:
        arcs: at least one.
    """

    def __init__(self, arcs: Arcs):
        from scipy.spatial import KDTree

        self.arcs, self.largest_deviation = arcs, float(np.max(arcs.deviation))
        self._tree: Any = KDTree(_plane(np.concatenate([arcs.start, arcs.middle, arcs.end])))

    def near(self, x: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the distances of points to the nearest of all ends and middles, and their arcs, (places, count).

        A point is no farther from the arc than this; the arcs need not differ.
        """
        distance, index = self._tree.query(_plane(x), k=np.arange(1, count + 1))
        return distance, index % len(self.arcs.t0)

    def distance(self, x: np.ndarray) -> np.ndarray:
        """Return distances of points to arcs, for ranking."""
        beside = self.near(x, _TRIED)[1]
        return _smallest(self.arcs.take(beside.T), x).min(axis=0)

    def reach(self, d: Arcs) -> np.ndarray:
        """Bound the distance to b for the piece of each arc of a, by some arcs near its ends and its middle."""
        number = len(d.t0)
        if not number:
            return np.zeros(0)
        beside = self.near(np.concatenate([d.start, d.middle, d.end]), _TRIED)[1].reshape(3, number, -1)
        beside = np.moveaxis(beside, 1, -1).reshape(-1, number)
        bounds = arc_reach(d.take(np.tile(np.arange(number), len(beside))), self.arcs.take(beside.ravel()))
        return bounds.reshape(beside.shape).min(axis=0)

    def reach_by_quarters(self, d: Arcs) -> np.ndarray:
        """Bound the distance as `reach` does, by the largest of the bounds of the quarters.

        A long arc lies next to several arcs of b, but each quarter next to one. Every point of the piece is within the
        deviation of a point of one of the quarters.
        """
        return self.reach(d.quarters()).reshape(4, len(d.t0)).max(axis=0)

    def coarse_reach(self, d: Arcs) -> np.ndarray:
        """Bound the distance as `reach` does, by the nearest of b's arc ends and middles to the middle of each arc.

        No point of an arc is farther from its middle than its ends are, as arcs turn by less than half a circle.
        """
        middle = d.middle
        distance, beside = (x[:, 0] for x in self.near(middle, 1))
        c_radius, c_deviation = self.arcs.radius[beside], self.arcs.deviation[beside]
        slack = gamma(200, np.float64) * (1 + c_radius + d.radius)
        return distance + np.abs(d.start - middle) + slack + c_deviation + d.deviation

    def within(self, center: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return disc indices in order, and arcs whose pieces of b may meet them: none is missed, rounding included."""
        discs, arcs = [], []
        # Distances of discs to arcs that are formed together.
        step = max(1, 2**16 // len(self.arcs.t0))
        slack = gamma(200, np.float64) * (2 + self.arcs.radius) + self.arcs.deviation
        for start in range(0, len(center), step):
            rows = slice(start, start + step)
            met = _smallest(self.arcs, center[rows, None]) <= radius[rows, None] + slack
            disc, arc = np.nonzero(met)
            discs.append(start + disc)
            arcs.append(arc)
        return (np.concatenate(discs), np.concatenate(arcs)) if discs else (np.zeros(0, int), np.zeros(0, int))


def _plane(x: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(x).view(np.float64).reshape(-1, 2)
