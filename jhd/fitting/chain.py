"""Chains of Bezier segments as linear functions of their free control points, and their first guess by least squares.

Source: least squares with repeated projection of the samples is in Hoschek & Lasser, Fundamentals of Computer Aided
Geometric Design (1993), chapter 4.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd.arithmetic.bernstein import basis
from jhd.distance.frame.jets import polynomial_jet
from jhd.distance.nearest.feet import equation_of
from jhd.distance.project import project
from jhd.shapes.curve import BezierSegments

# Samples of each segment of the target, and rounds of least squares with new feet.
_SAMPLES, _ROUNDS = 64, 4
# Joints of the target that turn by more than this angle (radians) are corners.
_CORNER = 0.2

FloatArray = Any


class Chain(eqx.Module):
    """Builds segments, each starting where the last one ended: control points = base + matrix @ free points.

    Args:
        base: the part that is fixed.
        matrix: what each free point adds, alike in all coordinates.
        following: for each segment the next one, -1 at a free end.
    """

    base: Float[Array, "segments points dim"]
    matrix: Float[Array, "segments points free"]
    following: Array

    def __call__(self, free: Float[Array, "free dim"]) -> BezierSegments:
        """The curve with these free points."""
        moved = jnp.sum(self.matrix[..., None] * free, axis=-2)
        return BezierSegments(self.base + moved, None, self.following)


class Layout(NamedTuple):
    """What a chain is to look like: number of segments and degree, and what is held."""

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
    following = np.append(np.arange(1, count), 0 if layout.closed else -1)
    rows = index % total
    return Chain(jnp.asarray(base[rows]), jnp.asarray(points[:, free][rows]), jnp.asarray(following))


def samples(target: BezierSegments) -> tuple[FloatArray, FloatArray]:
    """Points of a connected target, evenly spaced, and how far along it each is, from 0 to 1."""
    t, along = _lengths(target)
    even = np.linspace(0.0, 1.0, len(t))
    return np.asarray(target(np.interp(even, along, t))), even


def _lengths(target: BezierSegments) -> tuple[FloatArray, FloatArray]:
    """Parameters of samples, and the share of the length before each."""
    t = np.linspace(0.0, target.count, _SAMPLES * target.count + 1)
    steps = np.sqrt(np.sum(np.diff(np.asarray(target(t)), axis=0) ** 2, axis=1))
    along = np.append(0.0, np.cumsum(steps))
    return t, along / along[-1]


def divided(target: BezierSegments, segments: int) -> FloatArray:
    """Where `segments` pieces begin and end along a connected target: at its corners, and evenly between them.

    Where there are more corners than pieces the pieces have equal lengths.
    """
    corners = 1 + np.flatnonzero(turns(target)[:-1])
    if len(corners) >= segments:
        return np.linspace(0.0, 1.0, segments + 1)
    breaks = np.concatenate([[0.0], _lengths(target)[1][corners * _SAMPLES], [1.0]])
    pieces = np.ones(len(breaks) - 1, int)
    while np.sum(pieces) < segments:
        pieces[np.argmax(np.diff(breaks) / pieces)] += 1
    inner = [np.linspace(breaks[k], breaks[k + 1], count, endpoint=False) for k, count in enumerate(pieces.tolist())]
    return np.append(np.concatenate(inner), 1.0)


def turns(target: BezierSegments) -> FloatArray:
    """Whether there is a corner where each segment of a connected target goes on to the next, the last to the first."""
    ends = np.asarray(target.control_points)
    following = np.roll(ends, -1, axis=0)
    out, into = ends[:, -1] - ends[:, -2], following[:, 1] - following[:, 0]
    sizes = np.sqrt(np.sum(out**2, axis=1) * np.sum(into**2, axis=1))
    return np.sum(out * into, axis=1) < np.cos(_CORNER) * sizes


def longest_pieces(target: BezierSegments, degree: int, tolerance: float) -> tuple[FloatArray, FloatArray]:
    """Joints along a connected target, in [0, 1], and segments (pieces, points, dim) between them by least squares.

    Each piece has the ends of its part of the target and is as long as it can be, found by halving, where samples of
    the part are within the tolerance of their feet; corners are joints.
    """
    t, along = _lengths(target)
    points = np.asarray(target(t))
    stops = np.append(np.flatnonzero(turns(target)[:-1]) + 1, target.count) * _SAMPLES
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
    """The Bezier segment from the first to the last of the points nearest to them by least squares, and how far off."""
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
        joints: (segments + 1,) where each segment of the chain begins and ends along the target, in [0, 1].
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
            feet = project(points, built(jnp.asarray(free)), throw=False)
            segment, t = np.asarray(feet.segment), np.asarray(feet.t)
    return built, free
