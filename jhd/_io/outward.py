"""Conversion of shapes to objects of SciPy, geomdl, shapely and matplotlib; `jhd.as_shape` converts back.

Numbers that the other package can hold are kept bit for bit. Degrees and weights that it cannot hold are approximated
by lines or cubics within a given tolerance, with a certified deviation.
"""

from typing import Any

import numpy as np

from jhd._io.contours import Contour, contours_of
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd._shapes.foreign import BSpline, Geometry, Path
from jhd._shapes.knots import unrolled
from jhd._shapes.patch import AbstractPatch, BezierPatch

# Codes of matplotlib's paths by the degree of a segment.
_CODES = {1: 2, 2: 3, 3: 4}
_MOVETO, _CLOSEPOLY = 1, 79


def to_scipy(shape: AbstractCurve | AbstractPatch, *, homogeneous: bool = False) -> BSpline:
    """A `scipy.interpolate.BSpline` of a curve or an `NdBSpline` of a surface, with the same numbers bit for bit.

    Parameters are kept. BezierSegments become one spline in which segment k has the parameters [k, k + 1]. A periodic
    curve gets extrapolate="periodic".

    >>> import jhd
    >>> jhd.io.to_scipy(jhd.BezierCurve([[0, 0], [1, 2], [2, 0]])).t.tolist()
    [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]

    Args:
        shape: a BezierCurve, a BSplineCurve, BezierSegments, a BezierPatch or a BSplineSurface.
        homogeneous: whether the coefficients are homogeneous: points times weights, then the weights. A rational shape
            is the quotient of the first values by the last one.

    Returns:
        The spline of SciPy.

    Raises:
        TypeError: another shape, for example BezierPatches, which are not a single spline.
        ValueError: a rational shape without `homogeneous`; splines of SciPy have no weights.
    """
    from scipy.interpolate import BSpline, NdBSpline

    if not isinstance(shape, AbstractCurve | AbstractPatch):
        raise TypeError(f"shape must be a curve or a parametric surface; got {type(shape).__name__}.")
    if shape.weights is not None and not homogeneous:
        raise ValueError(
            "the shape is rational, and SciPy's splines have no weights; pass homogeneous=True to append them."
        )
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
    if not isinstance(shape, BezierCurve | BezierSegments):
        kinds = "a BSplineCurve, a BezierCurve or BezierSegments"
        raise TypeError(f"shape must be {kinds}; got {type(shape).__name__}: pass its segments().")
    count = points.shape[-2]
    flat = points.reshape(-1, points.shape[-1])
    return BSpline(np.repeat(np.arange(len(flat) // count + 1.0), count), flat, count - 1)


def _surface_knots(surface: AbstractPatch) -> tuple[np.ndarray, np.ndarray]:
    """The knots in u and in v; 0 and 1 for a patch."""
    if isinstance(surface, BSplineSurface):
        return np.asarray(surface.knots_u, np.float64), np.asarray(surface.knots_v, np.float64)
    if not isinstance(surface, BezierPatch):
        raise TypeError(f"surface must be a BSplineSurface or a BezierPatch; got {type(surface).__name__}.")
    p, q = surface.degrees
    return np.repeat([0.0, 1.0], p + 1), np.repeat([0.0, 1.0], q + 1)


def to_geomdl(surface: AbstractPatch) -> dict[str, object]:
    """A dictionary of the attributes of a `geomdl.NURBS.Surface`, as plain numbers, with points along v first.

    Set them in the order of the dictionary, but `ctrlpts_size_u` and `ctrlpts_size_v` before `ctrlpts`. Weights are
    separate, not multiplied into the points.

    >>> import jhd
    >>> jhd.io.to_geomdl(jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]]))["knotvector_u"]
    [0.0, 0.0, 1.0, 1.0]

    Args:
        surface: a BSplineSurface or a BezierPatch.

    Returns:
        Values by the names of the attributes of geomdl.

    Raises:
        TypeError: another shape.
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


def to_shapely(curve: AbstractCurve, tolerance: float | None = None, *, filled: bool = False) -> Geometry:
    """A shapely LineString or MultiLineString of a curve; with `filled`, the Polygon or MultiPolygon that it bounds.

    The geometry is a polyline within a certified Hausdorff distance of `tolerance` of the curve. Straight segments are
    kept bit for bit. Closed contours become closed lines. A filled curve bounds the points inside an odd number of its
    contours; open contours are then refused.

    >>> import jhd
    >>> jhd.io.to_shapely(jhd.polyline([[0, 0], [1, 0], [1, 1]], closed=True), filled=True).area
    0.5

    Args:
        curve: a curve; in the plane if `filled`.
        tolerance: largest deviation, a positive length in the unit of the coordinates; None only for curves of straight
            segments.
        filled: whether to return the area instead of the lines.

    Returns:
        The shapely geometry.

    Raises:
        ImportError: shapely is not installed.
        ValueError: curved segments without `tolerance`, a point set, or `filled` contours that are open or cross.
        TypeError: not a curve.
    """
    check_curve("curve", curve)
    shapely = _shapely()
    segments = curve.segments()
    if segments.degree != 1:
        if tolerance is None:
            raise ValueError(f"the curve has degree {segments.degree}; give tolerance for a polyline.")
        segments = segments.to_polyline(tolerance).shape
    chains = _chains(np.asarray(segments.control_points, np.float64), np.asarray(segments.next_segment))
    if filled:
        return _area(shapely, chains)
    lines = [shapely.LineString(chain) for chain in chains]
    return lines[0] if len(lines) == 1 else shapely.MultiLineString(lines)


def _shapely() -> Any:
    try:
        import shapely
    except ImportError as error:
        raise ImportError("to_shapely needs shapely: pip install jhd[geometry].") from error
    return shapely


def _chains(points: np.ndarray, next_segment: np.ndarray) -> list[np.ndarray]:
    """The points of straight segments (segments, 2, dim); consecutive joined segments form one row."""
    chains, start = [], 0
    for k in range(len(points)):
        if next_segment[k] != k + 1 or k + 1 == len(points) or np.any(points[k, 1] != points[k + 1, 0]):
            chain = np.concatenate([points[start : k + 1, 0], points[k : k + 1, 1]])
            # A joint within rounding closes the contour.
            chain[-1] = chain[0] if next_segment[k] == start and k > start else chain[-1]
            chains.append(chain)
            start = k + 1
    return chains


def _area(shapely: Any, chains: list[np.ndarray]) -> Any:
    for chain in chains:
        if chain.shape[1] != 2 or len(chain) < 4 or np.any(chain[0] != chain[-1]):
            raise ValueError("a filled curve needs closed contours in the plane with at least three sides.")
    if len(chains) == 1:
        area = shapely.Polygon(chains[0])
    else:
        area = shapely.build_area(shapely.MultiLineString([shapely.LineString(chain) for chain in chains]))
    kept = area.boundary.length if area.geom_type.endswith("Polygon") else 0.0
    lost = abs(kept - sum(shapely.LineString(chain).length for chain in chains))
    # Sums of lengths in different orders differ by less.
    if not area.is_valid or lost > 1e-9 * kept:
        raise ValueError("the contours cross each other or themselves, so they bound no area.")
    return area


def to_path(curve: AbstractCurve, tolerance: float | None = None) -> Path:
    """A matplotlib Path of a plane curve: polynomial segments of degree 1 to 3 bit for bit, others as cubics.

    >>> import jhd
    >>> jhd.io.to_path(jhd.polyline([[0, 0], [1, 0], [1, 1]])).vertices.tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]

    Args:
        curve: a curve in the plane.
        tolerance: largest deviation, certified, a positive length in the unit of the coordinates; None only if all
            segments are kept.

    Returns:
        The path.

    Raises:
        ValueError: a curve in space, a point set, or rational segments or degrees above 3 without `tolerance`.
        TypeError: not a curve.
    """
    from matplotlib.path import Path

    check_curve("curve", curve)
    contours = cubic_contours("curve", curve.segments(), tolerance)
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


def cubic_contours(name: str, segments: BezierSegments, tolerance: float | None) -> list[Contour]:
    """Contours of polynomial segments of degree 1 to 3: the segments themselves, or cubics within tolerance of them.

    Raises:
        ValueError: a curve in space, points, or tolerance is None and needed.
    """
    if segments.dim != 2:
        raise ValueError(f"{name} has {segments.dim} coordinates a point; a path needs 2.")
    if segments.degree == 0:
        raise ValueError(f"{name} has degree 0; paths hold degrees 1 to 3.")
    if segments.weights is not None or segments.degree > 3:
        if tolerance is None:
            what = "is rational" if segments.weights is not None else f"has degree {segments.degree}"
            raise ValueError(
                f"{name} {what}; paths hold polynomial segments of degree 1 to 3: give tolerance for cubics."
            )
        segments = segments.to_cubics(tolerance).shape
    return contours_of(segments)
