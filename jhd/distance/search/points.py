"""Hausdorff distances with a set of points on one side: which search serves, its frame and its tolerance."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax

from jhd.arithmetic.rounding import gamma
from jhd.arrays import is_tracing
from jhd.distance.cells.surfaces import FEET
from jhd.distance.frame.aim import Aim, default_tolerance
from jhd.distance.frame.coordinates import common_points, diagonal
from jhd.distance.frame.net_jets import Net, eta, point_error
from jhd.distance.frame.nets import prepare_nets
from jhd.distance.frame.surfaces import prepare_surfaces
from jhd.distance.search import from_points, to_points
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.closest_triangles import as_mesh
from jhd.distance.search.from_points import PointSearch
from jhd.distance.search.from_program import AnswerForm, from_program
from jhd.distance.search.meshes import mesh_directed
from jhd.distance.search.on_surfaces import looked_at
from jhd.distance.search.search import AbstractSearch, Listener, drive
from jhd.distance.search.sources import PatchSource, SurfaceSource
from jhd.distance.search.targets import target_of, usable
from jhd.distance.search.to_points import Cloud, ToPointsSearch
from jhd.distance.witness.meshes import with_mesh_derivatives
from jhd.distance.witness.points import with_point_derivatives
from jhd.shapes.curve import BezierSegments
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import BezierPatches
from jhd.solution import RESULTS, HausdorffSolution
from jhd.triangles.closest_point import point_tree

# What cannot be told in the search over a polynomial surface, in units of roundoff of the common coordinates.
_ULPS = 512
# The size of points, in units of a surface, from which on their common box is the unit; by the bytes of a number.
_FAR = {8: 2.0**400, 4: 2.0**40}


def is_points(shape: Any) -> bool:
    """Whether a shape is a set of points."""
    return isinstance(shape, BezierSegments) and shape.degree == 0


def points_directed(
    a: Any, b: Any, method: BranchAndBound, aim: Aim, listener: Listener, direction: Any
) -> HausdorffSolution:
    """The directed distance of two shapes of which one is a set of points, in their own coordinates.

    The value is differentiable in both, to first order.

    Args:
        a: points, BezierPatches, an ImplicitSurface or a TriangleMesh.
        b: likewise.
        method: the options.
        aim: what of the distance matters.
        listener: that of the call; not under tracing.
        direction: a member of DIRECTIONS.

    Raises:
        ValueError: a polynomial surface without points in its box (not under tracing).
    """
    if isinstance(a, TriangleMesh):
        points: Any = as_mesh(b)
        found = mesh_directed(*lax.stop_gradient((a, points)), method, aim, listener, direction)
        return with_mesh_derivatives(found, a, points)
    found = _directed(*lax.stop_gradient((a, b)), method, aim, listener, direction)
    return with_point_derivatives(found, a, b)


def _directed(
    a: Any, b: Any, method: BranchAndBound, aim: Aim, listener: Listener, direction: Any
) -> HausdorffSolution:
    # Inside jit all operations are traced, those on known numbers too.
    if not is_tracing(a, b, method, aim):
        return drive(_search(a, b, method, aim), listener, direction)
    refused = _form(a, b).refused

    def search(shapes: Any, method: BranchAndBound, aim: Aim) -> HausdorffSolution:
        if not all(is_points(x) or isinstance(x, TriangleMesh) or usable(x) for x in shapes):
            return refused()
        try:
            return drive(_search(shapes[0], shapes[1], method, aim), Listener(), direction)
        except ValueError:
            return refused(RESULTS.empty_surface)

    return from_program(search, refused, (a, b), method, aim)


def point_mesh(points: BezierSegments) -> Any:
    """A set of points as degenerate triangles; those of the plane lie at height zero."""
    rows = points.control_points
    rows = rows if points.dim == 3 else jnp.concatenate([rows, jnp.zeros_like(rows[..., :1])], axis=-1)
    return as_mesh(BezierSegments(rows))


def nearest_points(points: Any, shape: Any) -> Any:
    """The points that may be the nearest ones to a shape: the others are proven to be farther than one of them.

    Args:
        points: a set of points, its numbers known; it may be differentiated.
        shape: points, a TriangleMesh, BezierPatches or an ImplicitSurface, likewise.
    """
    rows = np.asarray(lax.stop_gradient(points).control_points)[:, 0]
    target: Any = target_of(lax.stop_gradient(shape))
    if target.sharp:
        found = target.nearest(rows)
        return BezierSegments(points.control_points[np.flatnonzero(found.lower <= found.upper.min())])
    upper = float(np.min(target.feet(rows)))
    near = np.flatnonzero(target.within(rows, upper)) if np.isfinite(upper) else np.arange(len(rows))
    return BezierSegments(points.control_points[near])


def _search(a: Any, b: Any, method: BranchAndBound, aim: Aim) -> AbstractSearch:
    if not is_points(a):
        return _to_points(a, b, method, aim)
    points, target = np.asarray(a.control_points)[:, 0], target_of(b)
    # Bounds that are always those of rounding need no tolerance.
    atol = 0.0 if target.sharp else float(default_tolerance(_diagonal(a, b), points.dtype, 0.0))
    atol = atol if method.atol is None else float(method.atol)

    def allowed(lower: float) -> float:
        return max(atol, float(method.rtol) * lower, target.rounding(lower))

    return PointSearch(points, target, allowed, aim, method.max_steps)


def _to_points(a: BezierPatches | ImplicitSurface, b: BezierSegments, method: BranchAndBound, aim: Aim) -> Any:
    rows = np.asarray(b.control_points)[:, 0]
    dtype, ends = rows.dtype, np.stack([rows.min(axis=0), rows.max(axis=0)])
    if isinstance(a, ImplicitSurface):
        # Points so far away that their squares overflow beside the surface share its coordinates; it may vanish there.
        side, _, frame = prepare_surfaces(a, a)
        if np.max(np.abs(common_points(frame, ends))) > _FAR[dtype.itemsize]:
            side, _, frame = prepare_surfaces(a, Net(jnp.asarray(ends)[:, None, None], None))
        target, empty = looked_at(side)
        if bool(empty):
            raise ValueError("the surface is empty: the polynomial is proven to have no zero in the box.")
        source, floor, moved = SurfaceSource(target), _ULPS * float(np.finfo(dtype).eps), 0.0
    else:
        far = Net(jnp.asarray(ends)[:, None, None], None)
        net, _, frame, moved = prepare_nets(Net(a.control_points, a.weights), far)
        source = PatchSource(net, a.count)
        floor = 16 * (point_error(net) + 2 * eta(net)) + 8 * moved
    rows = common_points(frame, rows).astype(dtype)
    moved = float(moved) + gamma(4, dtype) * 2 * float(np.max(np.abs(rows)))
    size = 1 + float(np.max(np.abs(rows)))
    atol = float(default_tolerance(float(frame.common(np.asarray(_diagonal(a, b)))), dtype, 0.0))
    atol = atol if method.atol is None else float(frame.common(np.asarray(method.atol)))

    def allowed(lower: float) -> float:
        return max(atol, float(method.rtol) * lower, floor * size + 8 * moved)

    return ToPointsSearch(source, Cloud(rows, point_tree(rows)), frame, moved, allowed, aim, method.max_steps)


def _diagonal(*shapes: Any) -> float:
    """Length of the diagonal of the box of all shapes."""
    ends = [[np.asarray(end, np.float64) for end in shape.box()] for shape in shapes]
    return float(diagonal([(low, high) for low, high in ends]))


def _form(a: Any, b: Any) -> AnswerForm:
    """The form of every answer about two shapes."""
    points = is_points(a)
    own = a if points else b
    places: dict[type, tuple[int, ...]] = {TriangleMesh: (3,), BezierPatches: (2,)}
    t, params = ((), places.get(type(b), ())) if points else (places.get(type(a), ()), ())
    feet, counts = 2 if points and is_points(b) else FEET, from_points.COUNTS if points else to_points.COUNTS
    return AnswerForm(own.control_points.dtype, own.dim, feet, t, params, counts)
