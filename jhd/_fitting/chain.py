"""Chains of Bezier segments as linear functions of their free control points, and their first guess by least squares.

Source: least squares with repeated projection of the samples is in Hoschek & Lasser, Fundamentals of Computer Aided
Geometric Design (1993), chapter 4.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._arithmetic.bernstein import basis
from jhd._distance.nearest.feet import equation_of
from jhd._distance.normalization.jets import polynomial_jet
from jhd._fitting.sampled import CurvePlaces, SampledCurve, lengths_of
from jhd._shapes.curve import BezierSegments

# About the number of all samples of the target, unless there are more segments.
_ALL = 1 << 13
# Rounds of least squares with new feet.
_ROUNDS = 4

FloatArray = Any


class Chain(eqx.Module):
    """Segments, each starting at the end of the last one: control points = base + matrix @ free points.

    Args:
        base: the part that is fixed.
        matrix: factor of each free point in each control point, equal in all coordinates.
        next_segment: for each segment the next one, -1 at a free end.
    """

    base: Float[Array, "segments points dim"]
    matrix: Float[Array, "segments points free"]
    next_segment: Array

    def __call__(self, free: Float[Array, "free dim"]) -> BezierSegments:
        """The curve with these free points."""
        moved = jnp.sum(self.matrix[..., None] * free, axis=-2)
        return BezierSegments(self.base + moved, None, self.next_segment)


class Layout(NamedTuple):
    """Requested form of a chain: degree, number of segments, and constraints."""

    degree: int
    segments: int
    closed: bool
    fixed_ends: bool
    smooth: bool


def chain(layout: Layout, ends: FloatArray, ratios: FloatArray) -> Chain:
    """The chain of a layout.

    Args:
        layout: its sizes; with `smooth` the inner joints have one tangent.
        ends: (2, dim) first and last point, which are kept if the ends are fixed.
        ratios: (segments,) lengths of the segments relative to those before them, for smooth joints.
    """
    n, count = layout.degree, layout.segments
    total = n * count + (0 if layout.closed else 1)
    index = np.arange(count)[:, None] * n + np.arange(n + 1)
    points = np.eye(total)
    joints = range(0 if layout.closed else 1, count) if layout.smooth else range(0)
    for k in joints:
        # The point after the joint continues the line through the joint and the point before it.
        points[k * n + 1] = (1 + ratios[k]) * points[k * n] - ratios[k] * points[k * n - 1]
    base = np.zeros((total, ends.shape[1]))
    gone = {k * n + 1 for k in joints}
    if layout.fixed_ends and not layout.closed:
        gone |= {0, total - 1}
        base = points[:, [0, total - 1]] @ ends
    free = [k for k in range(total) if k not in gone]
    next_segment = np.append(np.arange(1, count), 0 if layout.closed else -1)
    rows = index % total
    return Chain(jnp.asarray(base[rows]), jnp.asarray(points[:, free][rows]), jnp.asarray(next_segment))


def samples(target: BezierSegments) -> tuple[FloatArray, FloatArray]:
    """Points of a connected target, evenly spaced, and the fraction of its length before each."""
    t, along, _ = _lengths(target)
    even = np.linspace(0.0, 1.0, min(len(t), _ALL + 1))
    return _points_at(target, np.interp(even, along, t)), even


def _points_at(target: BezierSegments, t: FloatArray) -> FloatArray:
    """Points (samples, dim) at parameters of all of the target, whose whole numbers are the joints."""
    segment = np.minimum(t.astype(int), target.count - 1)
    points, next_segment = np.asarray(target.homogeneous), np.asarray(target.next_segment)
    sampled = SampledCurve(points, next_segment, target.weights is not None, np.inf)
    return sampled.jets(CurvePlaces(segment, t - segment)).point


def _each(target: BezierSegments) -> int:
    """Samples of each segment."""
    # Most samples of each segment of the target.
    return min(64, max(1, -(-_ALL // target.count)))


def _lengths(target: BezierSegments) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parameters of samples, the fraction of the length before each, and the points."""
    t = np.linspace(0.0, target.count, _each(target) * target.count + 1)
    points = _points_at(target, t)
    steps = np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))
    along = np.append(0.0, np.cumsum(steps))
    return t, along / along[-1], points


def divided(target: BezierSegments, segments: int) -> FloatArray:
    """Ends of `segments` pieces of a connected target, as fractions of its length: corners, and evenly between them.

    If there are more corners than pieces, only corners at the scale of half a piece count. If these are too many as
    well, the pieces have equal lengths.
    """
    along = _lengths(target)[1]
    corners = 1 + np.flatnonzero(turns(target)[:-1])
    if len(corners) >= segments:
        corners = 1 + np.flatnonzero(turns(target, 0.5 / segments)[:-1])
    if len(corners) >= segments:
        return np.linspace(0.0, 1.0, segments + 1)
    breaks = np.concatenate([[0.0], along[corners * _each(target)], [1.0]])
    pieces = np.ones(len(breaks) - 1, int)
    while np.sum(pieces) < segments:
        pieces[np.argmax(np.diff(breaks) / pieces)] += 1
    inner = [np.linspace(breaks[k], breaks[k + 1], count, endpoint=False) for k, count in enumerate(pieces.tolist())]
    return np.append(np.concatenate(inner), 1.0)


def turns(target: BezierSegments, reach: float = 0.0) -> FloatArray:
    """Whether a connected target has a corner between each segment and the next (the last and the first).

    If corners are on average closer than the reach, a fraction of the length, they are noise. Then the corners are
    the sharpest turns between the parts within the reach before and after a joint.
    """
    ends = np.asarray(target.control_points)
    next_segment = np.roll(ends, -1, axis=0)
    if target.degree == 0:
        return np.ones(len(ends), bool)
    out, into = ends[:, -1] - ends[:, -2], next_segment[:, 1] - next_segment[:, 0]
    # Joints of the target that turn by more than this angle (radians) are corners.
    sharp = _cosine(out, into) < np.cos(0.2)
    if np.sum(sharp) * reach <= 1:
        return sharp
    cosine = _turned_within(target, reach)
    at = _lengths(target)[1][_each(target) :: _each(target)]
    corners = np.zeros(len(sharp), bool)
    for k in np.argsort(cosine):
        # If corners are closer than the reach, joints count that turn by more than this angle at the scale of the
        # reach.
        if cosine[k] >= np.cos(0.8):
            break
        apart = np.abs(at[corners] - at[k])
        corners[k] = not np.any(np.minimum(apart, 1 - apart) < reach)
    return corners


def _cosine(x: FloatArray, y: FloatArray) -> FloatArray:
    sizes = np.sqrt(np.sum(x**2, axis=1) * np.sum(y**2, axis=1))
    return np.where(sizes > 0, np.sum(x * y, axis=1) / np.where(sizes > 0, sizes, 1.0), 1.0)


def _turned_within(target: BezierSegments, reach: float) -> FloatArray:
    """The cosine of the angle at each joint between the parts within the reach before and after it.

    The direction of a part leads from the center of its first half to the center of its second half. The cosine is
    one at the ends of an open target.
    """
    _, along, points = _lengths(target)
    middles = 0.5 * (points[1:] + points[:-1]) * np.diff(along)[:, None]
    sums = np.concatenate([np.zeros((1, points.shape[1])), np.cumsum(middles, axis=0)])
    at = along[_each(target) :: _each(target)]
    closed = bool(np.asarray(target.next_segment)[-1] >= 0)

    def summed(s: FloatArray) -> FloatArray:
        turns, rest = np.divmod(s, 1.0) if closed else (np.zeros_like(s), np.clip(s, 0.0, 1.0))
        return np.stack([np.interp(rest, along, column) for column in sums.T], axis=1) + turns[:, None] * sums[-1]

    sides = [summed(at + k * 0.5 * reach) for k in range(-2, 3)]
    halves = [late - early for early, late in pairwise(sides)]
    cosine = _cosine(halves[1] - halves[0], halves[3] - halves[2])
    return cosine if closed else np.where((at < reach) | (at > 1 - reach), 1.0, cosine)


def longest_pieces(
    target: BezierSegments, degree: int, tolerance: float, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Joints along a connected target, in [0, 1], and segments (pieces, points, dim) between them by least squares.

    Each piece has the ends of its part of the target. It is as long as possible, found by halving, with samples of
    the part within the tolerance of their feet. Corners are joints.

    Args:
        target: the target.
        degree: degree of the pieces.
        tolerance: largest distance of the samples.
        reach: corners closer than this fraction of the length are noise, see turns.
    """
    _, along, points = _lengths(target)
    stops = np.append(np.flatnonzero(turns(target, reach)[:-1]) + 1, target.count) * _each(target)
    joints, pieces, first = [0], [], 0
    for stop in stops.tolist():
        while first < stop:
            good, bad = first + 1, stop + 1
            while bad - good > 1:
                tried = stop if bad > stop else (good + bad) // 2
                near = np.max(_piece(points[first : tried + 1], degree)[1]) <= tolerance
                good, bad = (tried, bad) if near else (good, tried)
            pieces.append(_piece(points[first : good + 1], degree)[0])
            first = good
            joints.append(first)
    return along[joints], np.array(pieces)


def _piece(points: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """The least-squares Bezier segment from the first to the last point, and its distance from each point."""
    along = np.append(0.0, np.cumsum(np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))))
    t = along / along[-1] if along[-1] > 0 else np.linspace(0.0, 1.0, len(points))
    fit, off = points[:1], np.zeros(len(points))
    for again in range(_ROUNDS + 1):
        values = basis(degree, t)
        held = values[:, [0, -1]] @ points[[0, -1]]
        inner = np.linalg.lstsq(values[:, 1:-1], points - held, rcond=None)[0]
        fit = np.concatenate([points[:1], inner, points[-1:]])
        here = equation_of(points, polynomial_jet(fit[:, None], t[:, None]))
        off = np.sqrt(here.distance_sq)
        if again < _ROUNDS:
            # A step of Newton's method towards the foot of each point.
            t = np.clip(t - here.residual / np.where(here.slope > 0, here.slope, np.inf), 0.0, 1.0)
    return fit, off


def least_squares(layout: Layout, target: BezierSegments, joints: FloatArray) -> tuple[Chain, FloatArray]:
    """A chain and free points near the target in the sense of least squares over its samples.

    Args:
        layout: the chain's sizes.
        target: connected segments in order.
        joints: (segments + 1,) ends of the segments of the chain along the target, in [0, 1].
    """
    points, along = samples(target)
    lengths = np.diff(joints)
    ratios = lengths / np.roll(lengths, 1)
    built = chain(layout, points[[0, -1]], ratios)
    base, matrix = np.asarray(built.base), np.asarray(built.matrix)
    segment = np.clip(np.searchsorted(joints, along, side="right") - 1, 0, layout.segments - 1)
    t = (along - joints[segment]) / lengths[segment]
    free = np.zeros((matrix.shape[-1], points.shape[1]))
    for again in range(_ROUNDS):
        values = basis(layout.degree, t)
        rows = np.einsum("kp,kpf->kf", values, matrix[segment])
        right = points - np.einsum("kp,kpd->kd", values, base[segment])
        free = np.linalg.lstsq(rows, right, rcond=None)[0]
        if again < _ROUNDS - 1:
            fit = base + np.einsum("spf,fd->spd", matrix, free)
            # Samples of each segment of the chain from which feet are searched.
            spacing = float(np.sum(lengths_of(fit, False))) / (64 * layout.segments)
            segment, t = SampledCurve(fit, np.asarray(built.next_segment), False, spacing or 1.0).feet(points).at
    return built, free


def points_of(build: Chain, control_points: FloatArray) -> FloatArray:
    """The free points for which the chain has these control points."""
    matrix = np.asarray(build.matrix).reshape(-1, build.matrix.shape[-1])
    return np.linalg.lstsq(matrix, control_points.reshape(len(matrix), -1), rcond=None)[0]


def from_a_corner(contour: BezierSegments, reach: float) -> BezierSegments:
    """A closed contour starting at its first corner; an open contour unchanged."""
    corners = np.flatnonzero(turns(contour, reach))
    if np.asarray(contour.next_segment)[-1] != 0 or len(corners) == 0:
        return contour
    shift = -(int(corners[0]) + 1)
    weights = None if contour.weights is None else jnp.roll(contour.weights, shift, axis=0)
    return BezierSegments(jnp.roll(contour.control_points, shift, axis=0), weights, contour.next_segment)


def contours(curve: BezierSegments) -> list[BezierSegments]:
    """The runs of segments that follow each other."""
    next_segment = np.asarray(curve.next_segment)
    starts = np.flatnonzero(np.append(True, next_segment[:-1] != np.arange(1, curve.count)))
    found = []
    for first, last in zip(starts, np.append(starts[1:], curve.count), strict=True):
        index = np.arange(1, last - first + 1)
        index[-1] = 0 if next_segment[last - 1] == first else -1
        weights = None if curve.weights is None else curve.weights[first:last]
        found.append(BezierSegments(curve.control_points[first:last], weights, index))
    return found
