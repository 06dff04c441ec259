"""Curves on the host, in NumPy and in integers at once: what is proposed in the one is checked in the other.

Everything is written for arrays of segments and parameters of one shape; nothing is proven here.
"""

from typing import NamedTuple

import numpy as np

from jhd.arithmetic.scaling import unit_weights
from jhd.distance.certificate import verification
from jhd.distance.frame.coordinates import Frame, common_points
from jhd.distance.nearest.feet import stays
from jhd.shapes.curve import BezierSegments

# Feet nearer than this to an end of their segment are put on it.
SNAP = 1e-15


class Host(NamedTuple):
    """A curve on the host: homogeneous coordinates in float64, in common coordinates, and its segments in integers."""

    rows: np.ndarray
    rational: bool
    exact: list[verification.Part]


def host(curve: BezierSegments, frame: Frame) -> Host:
    """The stored curve for both kinds of work: floating point in common coordinates, integers in its own."""
    points = np.asarray(curve.control_points, np.float64)
    weights = None if curve.weights is None else np.asarray(curve.weights, np.float64)
    plain = {"control_points": points.tolist(), "weights": None if weights is None else weights.tolist()}
    points = np.asarray(common_points(frame, points))
    weights = np.ones(points.shape[:-1]) if weights is None else weights
    # Weights of one size, as in the common coordinates: their products must not overflow.
    weights = unit_weights(weights)[..., None]
    rows = np.concatenate([points * weights, weights], axis=-1)
    return Host(rows, curve.weights is not None, verification.segments_of(plain))


def jets(curve: Host, segment: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, velocities and accelerations at the parameters, arrays (*t.shape, dim)."""
    c, t = curve.rows[segment], t[..., None, None]
    degree = c.shape[-2] - 1
    second = first = np.zeros_like(c[..., 0, :])
    for level in range(degree, 0, -1):
        if level == 2:
            second = degree * (degree - 1) * (c[..., 2, :] - 2 * c[..., 1, :] + c[..., 0, :])
        if level == 1:
            first = degree * (c[..., 1, :] - c[..., 0, :])
        c = (1 - t) * c[..., :-1, :] + t * c[..., 1:, :]
    n, w = c[..., 0, :-1], c[..., 0, -1:]
    point = n / w
    velocity = (first[..., :-1] - point * first[..., -1:]) / w
    return point, velocity, (second[..., :-1] - 2 * velocity * first[..., -1:] - point * second[..., -1:]) / w


def local_feet(b: Host, foot: np.ndarray, s: np.ndarray, points: np.ndarray, steps: int) -> np.ndarray:
    """Parameters near s where (B - P).B' is small: Newton's method, Gauss-Newton where it is not convex."""
    for _ in range(steps):
        place, first, second = jets(b, foot, s)
        e = place - points
        square = dot(first, first)
        slope = square + dot(e, second)
        slope = np.where(slope > 0.05 * square, slope, square)
        s = np.clip(s - dot(e, first) / np.where(slope > 0, slope, 1.0), 0.0, 1.0)
    return np.where(s < SNAP, 0.0, np.where(s > 1 - SNAP, 1.0, s))


def foot_speed(b: Host, foot: np.ndarray, s: np.ndarray, jet: tuple[np.ndarray, ...]) -> np.ndarray:
    """ds/dt of the foot of a moving point: A'.B' / (B'.B' + (B - P).B''); 0 where the foot is held at an end."""
    place, first, second = jets(b, foot, s)
    e = place - jet[0]
    square = dot(first, first)
    slope = square + dot(e, second)
    slope = np.where(slope > 1e-3 * square, slope, square)
    return np.where(stays(s, dot(e, first), square), 0.0, dot(jet[1], first) / np.where(slope > 0, slope, 1.0))


def dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Scalar products along the last axis."""
    return np.sum(x * y, axis=-1)
