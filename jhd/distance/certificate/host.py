"""Curves on the host, in NumPy and in integers at once: what is proposed in the one is checked in the other.

Everything is written for arrays of segments and parameters of one shape; nothing is proven here.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd.arithmetic.scaling import unit_weights
from jhd.distance.certificate.verification.pieces import ExactPiece, pieces_of
from jhd.distance.certificate.verification.structure import digest
from jhd.distance.frame.coordinates import Frame, common_points
from jhd.distance.frame.jets import CurveJet, polynomial_jet, quotient
from jhd.distance.nearest.feet import equation_of, foot_speed, gauss_newton
from jhd.shapes.curve import AbstractCurve, BezierSegments
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh

# Feet nearer than this to an end of their segment are put on it.
SNAP = 1e-15


class Host(NamedTuple):
    """A curve on the host: homogeneous coordinates in float64, in common coordinates, and its segments in integers."""

    rows: np.ndarray
    rational: bool
    exact: list[ExactPiece]


def host(curve: BezierSegments, frame: Frame) -> Host:
    """The stored curve for both kinds of work: floating point in common coordinates, integers in its own."""
    points = np.asarray(curve.control_points, np.float64)
    weights = None if curve.weights is None else np.asarray(curve.weights, np.float64)
    plain = plain_shape(curve)
    points = np.asarray(common_points(frame, points))
    weights = np.ones(points.shape[:-1]) if weights is None else weights
    # Weights of one size, as in the common coordinates: their products must not overflow.
    weights = unit_weights(weights)[..., None]
    rows = np.concatenate([points * weights, weights], axis=-1)
    return Host(rows, curve.weights is not None, pieces_of(plain))


def plain_shape(shape: Any) -> dict[str, Any]:
    """The arrays of a shape in the form in which certificates hold them, with their hash."""
    if isinstance(shape, ImplicitSurface):
        plain = {"kind": "surface", "coefficients": _rows(shape.coefficients)}
        plain |= {"lower": _rows(shape.lower), "upper": _rows(shape.upper)}
    elif isinstance(shape, TriangleMesh):
        plain = {"kind": "mesh", "vertices": _rows(shape.vertices), "triangles": _rows(shape.triangles)}
    else:
        is_curve = isinstance(shape, AbstractCurve)
        working = shape.segments() if is_curve else shape.patches()
        weights = None if working.weights is None else _rows(working.weights)
        kind = "curve" if is_curve else "patches"
        plain = {"kind": kind, "control_points": _rows(working.control_points), "weights": weights}
    return {**plain, "sha256": digest(plain)}


def _rows(numbers: Any) -> list[Any]:
    return np.asarray(numbers).tolist()


def jets(curve: Host, segment: np.ndarray, t: np.ndarray) -> CurveJet:
    """Points, velocities and accelerations at the parameters, arrays (*t.shape, dim)."""
    rows = polynomial_jet(np.moveaxis(curve.rows[segment], -2, 0), t[..., None])
    return quotient(CurveJet(*(x[..., :-1] for x in rows)), CurveJet(*(x[..., -1:] for x in rows)))


def local_feet(b: Host, foot: np.ndarray, s: np.ndarray, points: Any, steps: int) -> np.ndarray:
    """Parameters near s where (B - P).B' is small: Newton's method, Gauss-Newton where it is not convex."""
    for _ in range(steps):
        s = gauss_newton(s, equation_of(points, jets(b, foot, s)))
    return np.where(s < SNAP, 0.0, np.where(s > 1 - SNAP, 1.0, s))


def speed_of_feet(b: Host, foot: np.ndarray, s: np.ndarray, a: CurveJet, width: np.ndarray) -> np.ndarray:
    """ds/dt of the feet of moving points, which run along cells of this width."""
    return foot_speed(s, equation_of(a.point, jets(b, foot, s)), a.first, width)
