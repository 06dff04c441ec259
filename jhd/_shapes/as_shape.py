"""Conversion of user objects to shapes: arrays, and objects of other packages by their attributes.

No other package is imported. Meshes: pairs (vertices, triangles), trimesh, Open3D (legacy and tensor), PyVista's
PolyData. Splines: SciPy, geomdl, splinepy. Outlines: shapely, matplotlib's paths. Points: arrays, point clouds of these
packages.
"""

from collections.abc import Mapping
from os import PathLike
from typing import Any, cast

import numpy as np
from typing_extensions import TypeAliasType

from jhd._runtime.arrays import bare_array, real_array
from jhd._runtime.forks import check_process
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.checks import Table
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.foreign import ForeignShape
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh, kind_of
from jhd._shapes.patch import AbstractPatch, BezierPatch
from jhd._shapes.simple_curves import point_set

Shape = AbstractCurve | AbstractPatch | ImplicitSurface | TriangleMesh
ShapeLike = TypeAliasType("ShapeLike", Shape | Table | tuple[Table, Table] | ForeignShape)
"""Any object that is accepted as a shape: see `jhd.as_shape`."""

_ACCEPTED = (
    "a shape of jhd, an array of points, a pair (vertices, triangles), a mesh or point cloud (trimesh, Open3D, "
    "PyVista), a spline (SciPy's BSpline or NdBSpline, geomdl, splinepy), a shapely geometry or a matplotlib path"
)
Spline = BezierCurve | BSplineCurve | BezierPatch | BSplineSurface


def as_shape(shape: ShapeLike) -> Shape:
    """Convert an array or an object of another package to a shape of jhd.

    You need not call it: every function that takes shapes converts them. A polygon is taken as its boundary rings, a
    mesh as its surface. These objects are accepted:

    - a shape of jhd, which is returned unchanged,
    - an array (count, 2) or (count, 3), or an object that converts to one: a point set,
    - a pair (vertices, triangles) of coordinates (count, 3) and integers (count, 3): a mesh,
    - an object with `vertices` and `faces` or `triangles` (trimesh, Open3D),
    - an object with `points` and `faces` or `lines` (PyVista, Open3D's LineSet and PointCloud),
    - a spline of SciPy (BSpline, NdBSpline), geomdl or splinepy,
    - a shapely geometry, or a matplotlib Path.

    >>> import jhd
    >>> jhd.as_shape([[0, 0], [3, 4]]).count, jhd.as_shape(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])).count
    (2, 1)

    Args:
        shape: an object of this list.

    Returns:
        The shape.

    Raises:
        TypeError: an object of another kind, or entries that are not numbers.
        ValueError: an object of these kinds that is not a valid shape: empty, not finite, trimmed, or with faces that
            are not triangles.
    """
    found = taken_as(None, shape)
    check_shape("shape", found)
    return found


def check_shape(name: str, value: object) -> None:
    """Raise TypeError unless the value is a shape of jhd."""
    if not isinstance(value, Shape):
        raise TypeError(f"{name} must be {_ACCEPTED}; got {kind_of(value)}.")


def check_several(name: str, shapes: object) -> None:
    """Raise TypeError if something else is passed instead of a list of shapes: one shape, a dictionary, an array."""
    if isinstance(shapes, Shape):
        raise TypeError(f"{name} must be a list of shapes; got a single {type(shapes).__name__}.")
    if isinstance(shapes, Mapping):
        raise TypeError(f"{name} must be a list of shapes; got {type(shapes).__name__}: pass list({name}.values()).")
    if getattr(shapes, "ndim", None) == 2:
        raise TypeError(f"{name} must be a list of shapes; got one array: for one set of points, pass [points].")
    if not hasattr(shapes, "__iter__") and not hasattr(shapes, "__getitem__"):
        raise TypeError(f"{name} must be a list of shapes; got {type(shapes).__name__}.")


def check_rows_first(entry: str, points: object) -> None:
    """Raise TypeError if a shape is passed instead of the points, which come first."""
    if isinstance(points, Shape):
        raise TypeError(f"points is a {type(points).__name__}; {entry} takes an array of points first, then the shape.")


def taken_as(name: str | None, value: Any) -> Any:
    """The shape that an object stands for; errors use the given name. An unknown object is returned as it is."""
    # Every entry comes here before it computes.
    check_process()
    if isinstance(value, Shape):
        return value
    try:
        return _converted(value)
    except (TypeError, ValueError) as error:
        if name is None:
            raise
        raise type(error)(f"{name}: {error}") from error


def _converted(value: Any) -> Any:
    """The shape that an object of another package, a pair of tables or rows of points stands for; else the object."""
    if isinstance(value, tuple | list) and any(isinstance(entry, Shape) for entry in value):
        raise TypeError(
            f"a {type(value).__name__} of {len(value)} shapes is not one shape; use jhd.pairwise, nearest_shapes or "
            "pairs_within for lists, or jhd.stack_curves for a batch of curves under vmap."
        )
    if isinstance(value, str | PathLike):
        raise TypeError(
            "text is not a shape: jhd.io.load_shape reads files, font:NAME:LETTER and SVG path data, "
            f"jhd.ImplicitSurface.parse reads polynomials; got {type(value).__name__}."
        )
    if _is_pair(value):
        return TriangleMesh(*value)
    if _is_rows(value):
        return point_set(value)
    spline = spline_of(value)
    if spline is not None:
        return spline
    if hasattr(value, "geom_type"):
        return BezierSegments.from_shapely(cast(Any, value))
    if hasattr(value, "vertices") and hasattr(value, "codes"):
        return BezierSegments.from_path(cast(Any, value))
    parts = _parts_of(value)
    return value if parts is None else _assembled(*parts)


def _is_pair(value: Any) -> bool:
    """Whether the value is a pair of tables, of vertices and of triangles; a list of two points is not."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        return False
    tables = [x if hasattr(x, "ndim") else np.asarray(x, object) for x in value]
    return all(x.ndim == 2 for x in tables)


def _is_rows(value: Any) -> bool:
    """Whether the value is an array of numbers, or converts to one."""
    if isinstance(value, tuple | list):
        return True
    # Objects of PyVista do not count as arrays, although NumPy converts them.
    return hasattr(value, "__array__") and not hasattr(value, "points") and np.ndim(value) > 0


def _array(value: Any) -> np.ndarray:
    """A NumPy array from an array of another package; tensors without `__array__` are converted by `numpy()`."""
    made = hasattr(value, "numpy") and not hasattr(value, "__array__")
    found = value.numpy() if made else value
    return bare_array("the array", found if isinstance(found, np.ndarray) else np.asarray(found))


def _parts_of(value: Any) -> tuple[Any, Any, Any] | None:
    """Points, faces and lines of a mesh, a set of lines or a point cloud; None for other objects."""
    if any(hasattr(value, name) for name in ("entities", "tetras")) or _is_grid(value):
        # Paths of trimesh and solids: their vertices are not the shape.
        return None
    if hasattr(value, "vertices"):
        return value.vertices, getattr(value, "faces", getattr(value, "triangles", None)), None
    for places, cells in (("vertex", "triangle"), ("point", "line")):
        # Open3D's tensors: tables by name.
        if hasattr(value, places) and hasattr(getattr(value, places), "positions"):
            table = getattr(getattr(value, cells, None), "indices", None)
            faces, lines = (table, None) if cells == "triangle" else (None, table)
            return getattr(value, places).positions, faces, lines
    if hasattr(value, "points") and not callable(value.points):
        if getattr(value, "n_strips", 0):
            raise ValueError("the mesh has strips of triangles; call its triangulate() first.")
        return value.points, getattr(value, "faces", None), getattr(value, "lines", None)
    return None


def _is_grid(value: Any) -> bool:
    """Whether the object has cells instead of faces, as grids of PyVista and meshes of meshio have."""
    return not hasattr(value, "faces") and (hasattr(value, "cells") or bool(getattr(value, "n_cells", 0)))


def _assembled(places: Any, faces: Any, lines: Any) -> Shape:
    """A mesh, segments, or a point set if nothing joins the points."""
    places = _array(places)
    none = np.empty((0, 3), int)
    triangles = none if faces is None else _triangles(_array(faces))
    segments = none if lines is None else _segments(_array(lines))
    if len(triangles) and len(segments):
        raise ValueError("the object has faces and lines; pass only one of them.")
    if len(triangles):
        return TriangleMesh(places, triangles)
    if len(segments):
        return BezierSegments(real_array("points", places)[segments])
    return point_set(places)


def _triangles(cells: np.ndarray) -> np.ndarray:
    """Triangles in rows, also from PyVista's flat list, in which the number of corners precedes each triangle."""
    if cells.ndim == 2:
        return cells
    if len(cells) % 4 == 0 and np.all(cells[::4] == 3):
        return cells.reshape(-1, 4)[:, 1:]
    rows = _chains(cells)
    wrong = next(k for k, row in enumerate(rows) if len(row) != 3)
    raise ValueError(f"faces[{wrong}] has {len(rows[wrong])} corners; needs triangles: call its triangulate() first.")


def _segments(cells: np.ndarray) -> np.ndarray:
    """Segments in rows, also from PyVista's chains of points."""
    if cells.ndim == 2 or not len(cells):
        return cells
    return np.concatenate([np.stack([row[:-1], row[1:]], axis=1) for row in _chains(cells)])


def _chains(cells: np.ndarray) -> list[np.ndarray]:
    """The rows of a flat list in which each row follows its length."""
    rows, start = [], 0
    while start < len(cells):
        stop = start + 1 + int(cells[start])
        if not start < stop <= len(cells):
            raise ValueError(
                f"entry {start} of a flat list of cells is {cells[start]}; it should be the number of points that "
                f"follow, of which there are {len(cells) - start - 1}."
            )
        rows.append(cells[start + 1 : stop])
        start = stop
    return rows


def spline_of(value: Any) -> Spline | None:
    """The curve or surface of a spline object of SciPy, geomdl or splinepy; None for other objects.

    Raises:
        ValueError: a spline in more than two parameters, a trimmed spline, or data that our classes refuse.
        TypeError: data of types that our classes refuse.
    """
    if _has(value, "t", "c", "k"):
        return _of_scipy(value) if isinstance(value.t, tuple | list) else BSplineCurve.from_scipy(value)
    if _has(value, "degrees", "knot_vectors", "control_points", "control_mesh_resolutions"):
        return _of_splinepy(value)
    if _has(value, "degree_w", "knotvector_w"):
        raise ValueError("a spline volume is not a shape; pass its boundary surfaces.")
    if _has(value, "degree_u", "degree_v", "knotvector_u", "knotvector_v", "ctrlpts"):
        return _of_geomdl(value)
    if _has(value, "degree", "knotvector", "ctrlpts"):
        return BSplineCurve(np.asarray(value.ctrlpts, float), value.knotvector, _weights(value))
    return None


def _has(value: Any, *names: str) -> bool:
    return all(hasattr(value, name) for name in names)


def _weights(value: Any) -> np.ndarray | None:
    """The weights in one row; None if there are none."""
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
    """A surface of geomdl: its points run along v first; weights are separate, not multiplied in."""
    if len(getattr(surface, "trims", ())):
        raise ValueError("the surface is trimmed, which is not supported; remove its trimming curves.")
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
