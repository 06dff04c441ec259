"""Contours of outlines and path data, before they become one `BezierSegments` of one degree.

Readers append segments of any degree to contours. `assemble` elevates them to the largest degree and joins polynomial
and rational ones. It takes the order of segments from the contours, not from coordinates alone.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from jhd._io.errors import ParseError
from jhd._runtime.arrays import array_of
from jhd._shapes.curve import BezierSegments
from jhd._shapes.homogeneous import elevated
from jhd._shapes.joints import completed


class Segment(NamedTuple):
    """One segment: control points as complex numbers x + iy, and weights or None for a polynomial one."""

    points: tuple[complex, ...]
    weights: tuple[float, ...] | None = None


class Contour:
    """A connected run of segments that grows at its end.

    Args:
        start: the first point.
    """

    def __init__(self, start: complex):
        self.start = start
        self.end = start
        self.segments: list[Segment] = []
        self.closed = False

    def append(self, *points: complex, weights: tuple[float, ...] | None = None) -> None:
        """Append the segment from the end of the contour with these further control points."""
        self.segments.append(Segment((self.end, *points), weights))
        self.end = points[-1]

    def close(self) -> None:
        """Close the contour by moving its end over a rounding gap, or else by a line to the start."""
        self.closed = True
        if self.end == self.start:
            return
        size = max(max(abs(p.real), abs(p.imag)) for points, _ in self.segments for p in points)
        gap = self.end - self.start
        # The gap that is still rounding when a contour is closed, relative to its largest coordinate: relative commands
        # add up some thousand roundings.
        if math.hypot(gap.real, gap.imag) <= 1e-12 * size:
            points, weights = self.segments.pop()
            self.segments.append(Segment((*points[:-1], self.start), weights))
        else:
            self.append(self.start)
        self.end = self.start

    def transformed(self, matrix: np.ndarray) -> "Contour":
        """The image under x -> matrix[:, :2] x + matrix[:, 2]."""
        image = Contour(affine(self.start, matrix))
        for points, weights in self.segments:
            image.append(*(affine(p, matrix) for p in points[1:]), weights=weights)
        image.closed = self.closed
        return image


def affine(point: complex, matrix: np.ndarray) -> complex:
    """The image of x + iy under x -> matrix[:, :2] x + matrix[:, 2]."""
    x, y = (row[0] * point.real + row[1] * point.imag + row[2] for row in matrix.tolist())
    return complex(x, y)


def assemble(contours: Iterable[Contour]) -> BezierSegments | None:
    """The contours as one curve of the least common degree, or None if they hold no segment.

    Raising a line to degree 2 is exact if the midpoint is a float; to degree 3 it rounds by an ulp. End points stay
    bit for bit. Segments that stay at one point are left out unless the contour consists of nothing else. Open ends
    that meet a start are joined to it, as for every `BezierSegments`.
    """
    runs = [(_without_points(contour.segments), contour.closed) for contour in contours if contour.segments]
    if not runs:
        return None
    segments = [segment for run, _ in runs for segment in run]
    degree = max(len(points) for points, _ in segments) - 1
    # Points beyond the range of doubles are refused below.
    with np.errstate(over="ignore", invalid="ignore"):
        raised = [_raised(segment, degree) for segment in segments]
    points = np.array([points for points, _ in raised])
    if not np.isfinite(points).all():
        raise ParseError("draws points beyond the range of doubles.")
    control_points = array_of(points)
    weights = np.array([own for _, own in raised])
    rational = any(segment.weights is not None for segment in segments)
    following, first = np.arange(1, len(segments) + 1), 0
    for run, closed in runs:
        following[first + len(run) - 1] = first if closed else -1
        first += len(run)
    return BezierSegments(control_points, weights if rational else None, completed(following, control_points))


def _without_points(segments: Sequence[Segment]) -> Sequence[Segment]:
    return [segment for segment in segments if len(set(segment.points)) > 1] or segments[:1]


def _raised(segment: Segment, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Control points (degree + 1, 2) and weights of a segment written in this degree."""
    points = np.array([(p.real, p.imag) for p in segment.points])
    if segment.weights is None:
        return elevated(points, degree), np.ones(degree + 1)
    if len(points) == degree + 1:
        # Multiplying by weights and dividing again would round.
        return points, np.array(segment.weights)
    weights = np.array(segment.weights)[:, None]
    raised = elevated(np.concatenate([points * weights, weights], axis=1), degree)
    return raised[:, :2] / raised[:, 2:], raised[:, 2]


def contours_of(curve: BezierSegments) -> list[Contour]:
    """The segments as contours, cut wherever an end is not exactly the next start."""
    points = np.asarray(curve.control_points, dtype=float)
    following = np.asarray(curve.next_segment)
    weights = [None] * len(points) if curve.weights is None else map(tuple, np.asarray(curve.weights, float).tolist())
    contours: list[Contour] = []
    first = 0
    for index, (row, own) in enumerate(zip(points, weights, strict=True)):
        steps = [complex(x, y) for x, y in row.tolist()]
        if index == 0 or following[index - 1] != index or contours[-1].end != steps[0]:
            contours.append(Contour(steps[0]))
            first = index
        contours[-1].append(*steps[1:], weights=own)
        contours[-1].closed = bool(following[index] == first) and contours[-1].end == contours[-1].start
    return contours


def unit_direction(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle in degrees; exact at multiples of 90."""
    quarter = math.remainder(angle, 360.0) / 90.0
    if quarter == int(quarter):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    return math.cos(math.radians(angle)), math.sin(math.radians(angle))
