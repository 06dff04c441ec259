"""Shapes as other packages hold them: SciPy, geomdl, shapely and matplotlib.

What is exact stays bit for bit; what the other side cannot hold (degrees, weights) is drawn by lines or cubics within
a tolerance that is asked for, with a proven deviation. The way back is `jhd.as_shape`.
"""

from typing import Any

import numpy as np

from jhd.io.contours import Contour, contours_of
from jhd.shapes.bezier import BezierCurve
from jhd.shapes.bspline import BSplineCurve
from jhd.shapes.bspline_surface import BSplineSurface
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.shapes.knots import unrolled
from jhd.shapes.patch import AbstractPatch, BezierPatch

# Codes of matplotlib's paths by the degree of a segment.
_CODES = {1: 2, 2: 3, 3: 4}
_MOVETO, _CLOSEPOLY = 1, 79


def to_scipy(shape: AbstractCurve | AbstractPatch, *, homogeneous: bool = False) -> Any:
    """The polynomial spline as a `scipy.interpolate.BSpline`, a surface as an `NdBSpline`; bit for bit.

    Parameters are those of the shape: segments are one spline in which segment k carries [k, k + 1]. A periodic curve
    gets extrapolate="periodic".

    Args:
        shape: a curve, a patch or a B-spline surface.
        homogeneous: whether the coefficients are the points times their weights, and the weights as one more
            coordinate: a rational shape is the quotient of the values by the last one.

    Raises:
        TypeError: another shape; or several patches, which are no one spline.
        ValueError: a rational shape and not `homogeneous`; SciPy's splines have no weights.
    """
    from scipy.interpolate import BSpline, NdBSpline

    if not isinstance(shape, AbstractCurve | AbstractPatch):
        raise TypeError(f"shape is a {type(shape).__name__}; SciPy's splines are curves and parametric surfaces.")
    if shape.weights is not None and not homogeneous:
        raise ValueError("the shape is rational, and SciPy's splines have no weights; homogeneous=True appends them.")
    points = np.asarray(shape.control_points, np.float64)
    if homogeneous:
        weights = np.ones(points.shape[:-1]) if shape.weights is None else np.asarray(shape.weights, np.float64)
        points = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
    if isinstance(shape, AbstractPatch):
        knots = _surface_knots(shape)
        return NdBSpline(knots, points, tuple(len(t) - m - 1 for t, m in zip(knots, points.shape, strict=False)))
    check_curve("shape", shape)
    if isinstance(shape, BSplineCurve):
        p, knots = shape.degree, np.asarray(shape.knots, np.float64)
        if not shape.periodic:
            return BSpline(knots, points, p)
        wrapped: Any = "periodic"
        return BSpline(unrolled(knots, p, True), np.concatenate([points, points[:p]]), p, extrapolate=wrapped)
    rows = points if isinstance(shape, BezierCurve) else _segment_rows(shape, points)
    count = rows.shape[-2]
    flat = rows.reshape(-1, rows.shape[-1])
    return BSpline(np.repeat(np.arange(len(flat) // count + 1.0), count), flat, count - 1)


def _segment_rows(shape: AbstractCurve, points: np.ndarray) -> np.ndarray:
    if not isinstance(shape, BezierSegments):
        raise TypeError(f"shape is a {type(shape).__name__}; take its segments().")
    return points


def _surface_knots(surface: AbstractPatch) -> tuple[np.ndarray, np.ndarray]:
    """The knots in u and in v; those of a patch are 0 and 1."""
    if isinstance(surface, BSplineSurface):
        return np.asarray(surface.knots_u, np.float64), np.asarray(surface.knots_v, np.float64)
    if not isinstance(surface, BezierPatch):
        raise TypeError(f"surface is a {type(surface).__name__}; needs a BSplineSurface or a BezierPatch.")
    p, q = surface.degrees
    return np.repeat([0.0, 1.0], p + 1), np.repeat([0.0, 1.0], q + 1)


def to_geomdl(surface: AbstractPatch) -> dict[str, Any]:
    """The surface as a dictionary of plain numbers under the names of geomdl's attributes, points along v first.

    Its entries are set on a `geomdl.NURBS.Surface` in their order, with `ctrlpts_size_u` and `_v` before `ctrlpts`;
    weights stand beside the points, not multiplied in.

    Raises:
        TypeError: something else than a BSplineSurface or a BezierPatch.
    """
    knots_u, knots_v = _surface_knots(surface)
    points = np.asarray(surface.control_points, np.float64)
    weights = np.ones(points.shape[:2]) if surface.weights is None else np.asarray(surface.weights, np.float64)
    return {
        "degree_u": len(knots_u) - len(points) - 1,
        "degree_v": len(knots_v) - points.shape[1] - 1,
        "ctrlpts_size_u": len(points),
        "ctrlpts_size_v": points.shape[1],
        "ctrlpts": points.reshape(-1, 3).tolist(),
        "weights": weights.ravel().tolist(),
        "knotvector_u": knots_u.tolist(),
        "knotvector_v": knots_v.tolist(),
    }


def to_shapely(curve: AbstractCurve, atol: float | None = None, *, filled: bool = False) -> Any:
    """The curve as a shapely LineString or MultiLineString, filled as a Polygon or MultiPolygon.

    The geometry is a polyline within a Hausdorff distance of atol of the curve, proven; straight segments are kept bit
    for bit. Closed contours are closed lines. Filled, they bound the area inside of an odd number of them, and open
    ones are refused.

    Args:
        curve: a curve; filled ones in the plane.
        atol: see `to_polyline`; None for curves of straight segments.
        filled: whether the area is meant.

    Raises:
        ImportError: shapely is not installed.
        ValueError: no atol for a curve that is not straight, points, or contours that cross or are open and `filled`.
        TypeError: not a curve.
    """
    check_curve("curve", curve)
    shapely = _shapely()
    segments = curve.segments()
    if segments.degree != 1:
        if atol is None:
            raise ValueError(f"the curve has degree {segments.degree}; give atol for a polyline.")
        segments = segments.to_polyline(atol).curve
    chains = _chains(np.asarray(segments.control_points, np.float64), np.asarray(segments.following))
    if filled:
        return _area(shapely, chains)
    lines = [shapely.LineString(chain) for chain in chains]
    return lines[0] if len(lines) == 1 else shapely.MultiLineString(lines)


def _shapely() -> Any:
    try:
        import shapely
    except ImportError as error:
        raise ImportError("to_shapely needs shapely: pip install shapely") from error
    return shapely


def _chains(points: np.ndarray, following: np.ndarray) -> list[np.ndarray]:
    """The points of straight segments (segments, 2, dim), those that hang together in one row."""
    chains, start = [], 0
    for k in range(len(points)):
        if following[k] != k + 1 or k + 1 == len(points) or np.any(points[k, 1] != points[k + 1, 0]):
            chain = np.concatenate([points[start : k + 1, 0], points[k : k + 1, 1]])
            # A joint within rounding closes the contour.
            chain[-1] = chain[0] if following[k] == start and k > start else chain[-1]
            chains.append(chain)
            start = k + 1
    return chains


def _area(shapely: Any, chains: list[np.ndarray]) -> Any:
    for chain in chains:
        if chain.shape[1] != 2 or len(chain) < 4 or np.any(chain[0] != chain[-1]):
            raise ValueError("a filled curve needs closed contours in the plane; this one has another.")
    if len(chains) == 1:
        area = shapely.Polygon(chains[0])
    else:
        area = shapely.build_area(shapely.MultiLineString([shapely.LineString(chain) for chain in chains]))
    kept = area.boundary.length if area.geom_type.endswith("Polygon") else 0.0
    lost = abs(kept - sum(shapely.LineString(chain).length for chain in chains))
    if not area.is_valid or lost > _LENGTH * kept:
        raise ValueError("the contours cross each other or themselves; they bound no area.")
    return area


# The share of the length that sums of lengths in another order may differ by.
_LENGTH = 1e-9


def to_path(curve: AbstractCurve, atol: float | None = None) -> Any:
    """The plane curve as a matplotlib Path: polynomial segments of degree 1 to 3 bit for bit, others by cubics.

    Args:
        curve: a curve in the plane.
        atol: the most that the path may be away from the curve anywhere, proven; None where all segments are kept.

    Raises:
        ValueError: a curve in space, points, or rational segments and degrees above 3 without atol.
        TypeError: not a curve.
    """
    from matplotlib.path import Path

    check_curve("curve", curve)
    contours = cubic_contours("curve", curve.segments(), atol)
    vertices: list[complex] = []
    codes: list[int] = []
    for contour in contours:
        vertices.append(contour.start)
        codes.append(_MOVETO)
        for points, _ in contour.segments:
            vertices += points[1:]
            codes += [_CODES[len(points) - 1]] * (len(points) - 1)
        if contour.closed:
            vertices.append(contour.start)
            codes.append(_CLOSEPOLY)
    return Path(np.array([(p.real, p.imag) for p in vertices]), np.array(codes, np.uint8))


def cubic_contours(name: str, segments: BezierSegments, atol: float | None) -> list[Contour]:
    """Contours of polynomial segments of degree 1 to 3: the segments themselves, or cubics within atol of them.

    Raises:
        ValueError: a curve in space, points, or atol is None and needed.
    """
    if segments.dim != 2:
        raise ValueError(f"{name} has {segments.dim} coordinates a point; a path needs 2.")
    if segments.degree == 0:
        raise ValueError(f"{name} has degree 0; paths hold degrees 1 to 3.")
    if segments.weights is not None or segments.degree > 3:
        if atol is None:
            what = "is rational" if segments.weights is not None else f"has degree {segments.degree}"
            raise ValueError(f"{name} {what}; paths hold polynomial segments of degree 1 to 3: give atol for cubics.")
        segments = segments.to_cubics(atol).curve
    return contours_of(segments)
