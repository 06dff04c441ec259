"""Splines that other packages hold: SciPy's, geomdl's and splinepy's, by their attributes. No package is imported."""

from typing import Any

import numpy as np

from jhd.shapes.bezier import BezierCurve
from jhd.shapes.bspline import BSplineCurve
from jhd.shapes.bspline_surface import BSplineSurface
from jhd.shapes.patch import BezierPatch

Spline = BezierCurve | BSplineCurve | BezierPatch | BSplineSurface


def spline_of(value: Any) -> Spline | None:
    """The curve or surface that an object holds: t, c, k of SciPy, or what geomdl and splinepy have; None for others.

    Raises:
        ValueError: a spline in more than two parameters, one that is trimmed, or as for our classes.
        TypeError: as for our classes.
    """
    if _has(value, "t", "c", "k"):
        return _of_scipy(value) if isinstance(value.t, tuple | list) else BSplineCurve.from_scipy(value)
    if _has(value, "degrees", "knot_vectors", "control_points", "control_mesh_resolutions"):
        return _of_splinepy(value)
    if _has(value, "degree_w", "knotvector_w"):
        raise ValueError("a volume of splines is no shape; take the surfaces that bound it.")
    if _has(value, "degree_u", "degree_v", "knotvector_u", "knotvector_v", "ctrlpts"):
        return _of_geomdl(value)
    if _has(value, "degree", "knotvector", "ctrlpts"):
        return BSplineCurve(np.asarray(value.ctrlpts, float), value.knotvector, _weights(value))
    return None


def _has(value: Any, *names: str) -> bool:
    return all(hasattr(value, name) for name in names)


def _weights(value: Any) -> np.ndarray | None:
    """The weights in one row; None where there are none."""
    weights = getattr(value, "weights", None)
    return None if weights is None else np.asarray(weights, float).ravel()


def _of_scipy(spline: Any) -> Spline:
    """The curve or surface of a scipy.interpolate.NdBSpline, whose coefficients are points."""
    knots = [np.asarray(t, float) for t in spline.t]
    degrees = [int(k) for k in np.broadcast_to(spline.k, len(knots))]
    # Coefficients beyond the number that the knots ask for are ignored, as SciPy does.
    counts = [slice(len(t) - k - 1) for t, k in zip(knots, degrees, strict=True)]
    points = np.asarray(spline.c)[tuple(counts)]
    if len(knots) == 1:
        return BSplineCurve(points, knots[0])
    if len(knots) == 2:
        return BSplineSurface(points, knots[0], knots[1])
    raise ValueError(f"the spline has {len(knots)} parameters; needs one (a curve) or two (a surface).")


def _of_geomdl(surface: Any) -> BSplineSurface:
    """A surface of geomdl: its points run along v first; weights are beside them, not multiplied in."""
    if len(getattr(surface, "trims", ())):
        raise ValueError("the surface is trimmed, which is not supported; take it without its trimming curves.")
    shape = int(surface.ctrlpts_size_u), int(surface.ctrlpts_size_v)
    weights = _weights(surface)
    points = np.asarray(surface.ctrlpts, float).reshape(*shape, -1)
    weights = None if weights is None else weights.reshape(shape)
    return BSplineSurface(points, surface.knotvector_u, surface.knotvector_v, weights)


def _of_splinepy(spline: Any) -> Spline:
    """A spline of splinepy: its points run along the first parameter first; Bezier ones have no knots."""
    points, weights = np.asarray(spline.control_points, float), _weights(spline)
    knots = None if spline.knot_vectors is None else [np.asarray(list(t), float) for t in spline.knot_vectors]
    sizes = [int(n) for n in spline.control_mesh_resolutions]
    if len(sizes) == 1:
        return BezierCurve(points, weights) if knots is None else BSplineCurve(points, knots[0], weights)
    if len(sizes) > 2:
        raise ValueError(f"the spline has {len(sizes)} parameters; needs one (a curve) or two (a surface).")
    points = points.reshape(*sizes[::-1], -1).swapaxes(0, 1)
    weights = None if weights is None else weights.reshape(sizes[::-1]).T
    return BezierPatch(points, weights) if knots is None else BSplineSurface(points, knots[0], knots[1], weights)
