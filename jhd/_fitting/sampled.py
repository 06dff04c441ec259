"""Curves with many samples, in NumPy: points and derivatives, and feet found with a tree of the samples.

Newton's method begins at the nearest samples of a query, so a foot takes one query of the tree, whatever the number of
segments. If two parts of the curve are about equally near, and nearer to each other than the spacing of the samples,
the wrong part can be taken; nothing is proven here.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from jhd._distance.nearest.feet import dot, equation_of, gauss_newton
from jhd._distance.normalization.jets import CurveJet, polynomial_jet, quotient
from jhd._runtime.arrays import joined, taken

FloatArray = Any


class CurvePlaces(NamedTuple):
    """Points on a curve of segments: indices and parameters in [0, 1]."""

    segment: FloatArray
    t: FloatArray

    take = taken


class SampledFeet(NamedTuple):
    """Feet of points: locations on the curve, coordinates, and distances."""

    at: CurvePlaces
    point: FloatArray
    distance: FloatArray


class SampledCurve:
    """A curve of Bezier segments with samples and a tree of them.

    Args:
        homogeneous: (segments, points, width) control points, times the weights and followed by them if there are any.
        next_segment: for each segment the next one, -1 at a free end.
        rational: whether the last coordinate is the weight.
        spacing: largest distance of samples along the curve.
    """

    def __init__(self, homogeneous: FloatArray, next_segment: FloatArray, rational: bool, spacing: float):
        self._coefficients = np.ascontiguousarray(np.swapaxes(homogeneous, 0, 1))
        self.next_segment, self.rational = np.asarray(next_segment), rational
        self.degree, self.count = homogeneous.shape[1] - 1, len(homogeneous)
        self.preceding = np.full(self.count, -1)
        held = self.next_segment >= 0
        self.preceding[self.next_segment[held]] = np.flatnonzero(held)
        lengths = lengths_of(homogeneous, rational)
        # Least samples of a curved segment, and most samples of a segment.
        least = 0 if self.degree == 0 else 8 if self.degree > 1 else 1
        self.steps = np.clip(np.ceil(lengths / spacing), least, 4096 if least else 0).astype(int)
        self.first = np.concatenate([[0], np.cumsum(self.steps + 1)])
        segment = np.repeat(np.arange(self.count), self.steps + 1)
        t = (np.arange(self.first[-1]) - self.first[segment]) / np.maximum(self.steps, 1)[segment]
        self.samples = CurvePlaces(segment, t)
        self.points = self.jets(self.samples).point

    @cached_property
    def tree(self) -> Any:
        """The samples as a tree."""
        # Heavy to import, and needed by fits only.
        from scipy.spatial import KDTree

        return KDTree(self.points)

    def jets(self, at: CurvePlaces) -> CurveJet:
        """Points with two derivatives, each (places, dim)."""
        jet = polynomial_jet(self._coefficients[:, at.segment], at.t[:, None])
        if not self.rational:
            return jet
        return quotient(CurveJet(*(x[:, :-1] for x in jet)), CurveJet(*(x[:, -1:] for x in jet)))

    def feet(self, points: FloatArray, *starts: CurvePlaces) -> SampledFeet:
        """The nearest of the feet reached from the nearest samples of each point (points, dim), and from the starts.

        A sample that is nearer than all feet is taken itself: at a cusp Newton's method leads anywhere.
        """
        # Nearest samples from which the foot of a query is searched.
        count = min(3, len(self.points))
        gaps, near = (x.reshape(len(points), count) for x in self.tree.query(points, k=count))
        begin = [self.samples.take(column) for column in near.T] + list(starts)
        many = np.tile(points, (len(begin), 1))
        found = self.followed(many, joined(begin))
        best = np.argmin(found.distance.reshape(len(begin), -1), axis=0) * len(points) + np.arange(len(points))
        # A sample nearer than all feet by this fraction replaces them.
        lost, sample = gaps[:, 0] < found.distance[best] * (1 - 1e-9), self.samples.take(near[:, 0])
        at = CurvePlaces(*(np.where(lost, x, y) for x, y in zip(sample, found.at.take(best), strict=True)))
        point = np.where(lost[:, None], self.points[near[:, 0]], found.point[best])
        return SampledFeet(at, point, np.where(lost, gaps[:, 0], found.distance[best]))

    def followed(self, points: FloatArray, at: CurvePlaces) -> SampledFeet:
        """The feet of the points (points, dim) that Newton's method reaches, across joints too."""
        # Steps of Newton's method, of which crossing a joint takes one.
        # On straight segments the first step is exact.
        for _ in range(0 if self.degree == 0 else 2 if self.degree == 1 else 6):
            here = equation_of(points, self.jets(at))
            t = gauss_newton(at.t, here)
            # If a step is held at a joint, it continues on the next segment.
            beyond = np.where(
                (at.t >= 1) & (here.residual < 0),
                self.next_segment[at.segment],
                np.where((at.t <= 0) & (here.residual > 0), self.preceding[at.segment], -1),
            )
            start = np.where(at.t >= 1, 0.0, 1.0)
            at = CurvePlaces(np.where(beyond >= 0, beyond, at.segment), np.where(beyond >= 0, start, t))
        point = self.jets(at).point
        return SampledFeet(at, point, np.sqrt(dot(point - points, point - points)))


def lengths_of(homogeneous: FloatArray, rational: bool) -> FloatArray:
    """The length of the control polygon of each segment."""
    points = homogeneous[..., :-1] / homogeneous[..., -1:] if rational else homogeneous
    return np.sum(np.sqrt(np.sum(np.diff(points, axis=1) ** 2, axis=-1)), axis=-1)
