"""Proven bounds of the Hausdorff distance of two curves in NumPy, for fits that end without a compiled search.

A piece of one curve lies in the hull of its control points, and the distance to any point y of the opposite curve is
convex. So it is at most the largest distance of a control point from y, here a foot of the middle: the bound is of
second order in the length of the piece at the largest distance. Pieces with too large bounds are halved. The lower
bound is the distance of a point from balls that contain the control points of the pieces of the opposite curve.

The compiled search of `hausdorff` is faster and closes the gap; it takes half a minute of a slow processor to compile.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic.rounding import unit_roundoff
from jhd._fitting.sampled import SampledCurve, lengths_of
from jhd._runtime.clock import Clock
from jhd._shapes.curve import BezierSegments

# Most pieces of a curve, and most halvings of one piece: parameters need the digits.
_PIECES, _HALVINGS = 1 << 15, 30
# Gap at which the bounds are final, as a fraction of the upper bound.
_CLOSED = 1e-6
# Sizes whose squares are normal numbers, also of small fractions of them; other sizes get no bounds.
_SMALLEST, _LARGEST = 1e-100, 1e100
# Roundings of a distance in the plane or in space.
_MEASURED = 16

FloatArray = Any


class HostBounds(NamedTuple):
    """Bounds: lower <= exact value <= upper."""

    lower: float
    upper: float


class _HullPieces(NamedTuple):
    """Parts of a curve: homogeneous control points (pieces, points, width), and the depth of the halvings."""

    points: FloatArray
    depth: int

    def halved(self) -> "_HullPieces":
        left, right, row = [self.points[:, 0]], [self.points[:, -1]], self.points
        while row.shape[1] > 1:
            row = 0.5 * (row[:, :-1] + row[:, 1:])
            left.append(row[:, 0])
            right.append(row[:, -1])
        both = np.stack([np.stack(left, axis=1), np.stack(right[::-1], axis=1)], axis=1)
        return _HullPieces(both.reshape(-1, *self.points.shape[1:]), self.depth + 1)


class _Hulled:
    """A curve to be divided into pieces; its largest number bounds the rounding."""

    def __init__(self, segments: BezierSegments):
        self.points, self.rational = np.asarray(segments.homogeneous, dtype=float), segments.weights is not None
        self._following = np.asarray(segments.next_segment)
        weights = self.points[..., -1] if self.rational else np.ones(1)
        self.largest = float(np.max(np.abs(self.points)) / np.min(weights))
        if self.rational:
            # The relative error of the denominator adds to a quotient.
            self.largest *= 2 * float(np.max(weights) / np.min(weights))

    @cached_property
    def sampled(self) -> SampledCurve:
        """The curve with samples from which feet are searched."""
        length = float(np.sum(lengths_of(self.points, self.rational)))
        # Samples from which feet are searched.
        spacing = length / (1 << 13) if length > 0 else 1.0
        return SampledCurve(self.points, self._following, self.rational, spacing)

    def affine(self, points: FloatArray) -> FloatArray:
        """Points from homogeneous coordinates."""
        return points[..., :-1] / points[..., -1:] if self.rational else points

    def off(self, depth: int) -> float:
        """Bound of the error of control points by rounding after `depth` halvings."""
        # Roundings of a control point by one halving, for each degree.
        return 4 * (depth + 2) * (self.points.shape[1] + 1) * unit_roundoff(float) * self.largest


def host_bounds(a: BezierSegments, b: BezierSegments, clock: Clock) -> HostBounds:
    """Bounds of the Hausdorff distance of two curves, as near to each other as the time of the proof allows."""
    first, second = _Hulled(a), _Hulled(b)
    if not _SMALLEST < max(first.largest, second.largest) < _LARGEST:
        return HostBounds(0.0, np.inf)
    there, back = _directed(first, second, clock), _directed(second, first, clock)
    return HostBounds(max(there.lower, back.lower), max(there.upper, back.upper))


def _directed(a: _Hulled, b: _Hulled, clock: Clock) -> HostBounds:
    """Bounds of the distance from a to b."""
    pieces, lower, settled = _HullPieces(a.points, 0), 0.0, 0.0
    while True:
        # The middle of the segment from the first to the last control point is near the piece; feet may be any.
        hull = a.affine(pieces.points)
        middle = 0.5 * (hull[:, 0] + hull[:, -1])
        feet = b.sampled.feet(middle).point
        off = a.off(pieces.depth) + b.off(0)
        rounded = 1 + _MEASURED * unit_roundoff(float)
        above = np.max(_distance(hull, feet[:, None]), axis=1) * rounded + off
        far = int(np.argmax(np.max(_distance(hull[:, [0, -1]], feet[:, None]), axis=1)))
        end = max((hull[far, k] for k in (0, -1)), key=lambda x: float(_distance(x, feet[far])))
        lower = max(lower, _from_balls(end, b) - a.off(pieces.depth))
        # Pieces with a bound below this are settled.
        wanted = above > lower * (1 + _CLOSED)
        settled = max(settled, float(np.max(above[~wanted], initial=0.0)))
        count = int(np.sum(wanted))
        # Halvings done regardless of the time: some milliseconds each.
        ended = pieces.depth >= 8 and clock.is_closed()
        if count == 0 or 2 * count > _PIECES or pieces.depth >= _HALVINGS or ended:
            return HostBounds(lower, max(settled, float(np.max(above[wanted], initial=0.0))))
        pieces = _HullPieces(pieces.points[wanted], pieces.depth).halved()


def _from_balls(point: FloatArray, b: _Hulled) -> float:
    """Lower bound of the distance of the point from b."""
    pieces, nearest = _HullPieces(b.points, 0), np.inf
    while True:
        hull = b.affine(pieces.points)
        center = 0.5 * (hull[:, 0] + hull[:, -1])
        radius = np.max(_distance(hull, center[:, None]), axis=1)
        away, off = _distance(center, point), b.off(pieces.depth)
        below = away - radius - _MEASURED * unit_roundoff(float) * (away + radius) - off
        nearest = min(nearest, float(np.min(_distance(hull[:, [0, -1]], point))))
        least = float(np.min(below))
        if nearest - least <= _CLOSED * _CLOSED * nearest or pieces.depth >= _HALVINGS:
            return max(least, 0.0)
        # The piece with the least bound is always among the halved pieces.
        near = below <= nearest + off
        if 2 * np.sum(near) > _PIECES:
            return max(least, 0.0)
        pieces = _HullPieces(pieces.points[near], pieces.depth).halved()


def _distance(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.sqrt(np.sum((x - y) ** 2, axis=-1))
