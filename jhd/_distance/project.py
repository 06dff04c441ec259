"""Nearest points of shapes of every kind, and all stationary points of curves.

Curves use jhd._distance.curve_queries, with the methods in jhd._distance.project_methods. Meshes use
jhd._distance.nearest.meshes; parametric and implicit surfaces use jhd._distance.search.targets.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.curve_queries import projected_on_curve, stationary_on_curve
from jhd._distance.project_methods import AbstractProjectionMethod, BestFirstProjection
from jhd._distance.published.vertex_voxels import VertexVoxels
from jhd._distance.search.targets import project_on_surface
from jhd._distance.witness.mesh_feet import project_on_mesh
from jhd._results.solution import RESULTS, Projection, StationaryPoints, throw_unless_successful
from jhd._runtime.arrays import check_whole, is_traced, real_array
from jhd._runtime.clock import Clock
from jhd._shapes.as_shape import ShapeLike, check_rows_first, check_shape, taken_as
from jhd._shapes.checks import Numbers, checked_points
from jhd._shapes.curve import BezierSegments, check_curve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch
from jhd._shapes.prepared import working

# Queries between two looks at the clock.
_AT_ONCE = 4096


def project(
    points: Numbers,
    shape: ShapeLike,
    method: AbstractProjectionMethod | VertexVoxels | None = None,
    *,
    throw: bool = True,
    max_seconds: float | None = None,
) -> Projection:
    """Nearest points of a shape to query points, with certified bounds of the distances.

    Distance, foot point and parameter are differentiable twice in the points and in the shape, except at poles:

    - If several points are equally near, the derivative refers to the foot point returned.
    - At distance zero, the derivative is zero by convention.
    - If the foot point is an end or a corner of the shape, its parameter has derivative zero. A foot point stays on the
      face, edge or vertex of a mesh that holds it, and on the face of the box of an implicit surface.
    - At a pole of a parametric surface, an edge of a patch is one point. There derivatives of the foot point and second
      derivatives of the distance are NaN. They can also be NaN if the foot point is so near to a pole that rounding
      leaves its patch undecided: within 1e-7 of the size of the patch, or 1e-6 for points a hundred sizes away.
      There the gradient of the distance can have a relative error of up to 1e-7, or 1e-6.

    Works under jit and vmap. There, checks of values are skipped and `throw` is ignored: read `result`. On CPUs the
    compiled function calls the search on the host (see `inline_searches`). Surfaces are searched on the host on all
    devices.

    >>> import jhd
    >>> found = jhd.project([(1, 2), (5, 0)], jhd.polyline([(0, 0), (2, 0)]))
    >>> found.distance.round(9).tolist(), found.foot.round(9).tolist()
    ([2.0, 3.0], [[1.0, 0.0], [2.0, 0.0]])

    Args:
        points: query points (..., dim). The result keeps the batch shape; one point has none.
        shape: points (`jhd.point_set`), a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an
            ImplicitSurface (clipped to its box), a mesh, or an object that `jhd.as_shape` accepts. Under tracing, every
            query is compared with every triangle of a mesh.
        method: for curves BestFirstProjection() (default) or ProjectedPolyhedronProjection(), which are certified, or a
            local method; for meshes None (exact search) or VertexVoxels(), which is local; for surfaces None.
        throw: whether to raise NotProvenError if the bounds of a query do not close; by default True.
        max_seconds: wall time in seconds, checked after every 4096 queries; by default no limit. Queries that are not
            reached have the bounds 0 and inf, foot points of NaN, and the result RESULTS.out_of_time.

    Returns:
        A Projection: distances with bounds, foot points, elements and parameters. Local methods certify no lower bound:
        it is 0. If no point of an implicit surface can be certified, `upper` is infinite.

    Raises:
        TypeError: points that are not real numbers, a shape or a method of another kind, or VertexVoxels or
            `max_seconds` under tracing.
        ValueError: points that are not finite, no points, or points whose dimension is not the one of the shape; a
            VertexVoxels whose capacity is too small; an implicit surface without points in its box; or `max_seconds`
            that is not positive.
        NotProvenError: the bounds did not close, and `throw` is True. The exception carries the solution.
    """
    check_rows_first("project", points)
    shape = taken_as("shape", shape)
    check_shape("shape", shape)
    if max_seconds is not None:
        return _finished(_in_time(points, shape, method, Clock(max_seconds)), throw)
    if isinstance(shape, TriangleMesh):
        return project_on_mesh(points, shape, method)
    if isinstance(shape, AbstractPatch | ImplicitSurface):
        if method is not None:
            raise TypeError(f"method must be None for surfaces; got {type(method).__name__}.")
        return _finished(project_on_surface(points, shape), throw)
    method = BestFirstProjection() if method is None else method
    if not isinstance(method, AbstractProjectionMethod):
        accepted = ("BestFirst", "ProjectedPolyhedron", "IntervalHalving", "Newton", "Hybrid")
        names = ", ".join(f"{name}Projection" for name in accepted)
        raise TypeError(f"method must be one of {names} for curves; got {type(method).__name__}.")
    queries, curve = _checked(points, shape)
    return _finished(projected_on_curve(method, queries, curve), throw)


def _in_time(points: Numbers, shape: Any, method: Any, clock: Clock) -> Projection:
    """The projection of some points after the other, as far as the time allows."""
    if is_traced(points, shape):
        raise TypeError("max_seconds cannot be combined with jit, vmap or grad: leave it out there.")
    rows = jnp.atleast_1d(real_array("points", points))
    queries, parts = rows.reshape(-1, rows.shape[-1]), []
    for start in range(0, max(len(queries), 1), _AT_ONCE):
        parts.append(project(queries[start : start + _AT_ONCE], shape, method, throw=False))
        if clock.is_over():
            break
    # What is not reached looks like the last query, without an answer.
    left = len(queries) - sum(part.distance.shape[0] for part in parts)
    if left > 0:
        last = jax.tree_util.tree_map(lambda x: jnp.repeat(x[-1:], left, axis=0), parts[-1])
        far, no = jnp.full_like(last.distance, jnp.inf), jnp.nan
        late = jax.tree_util.tree_map(jnp.full_like, last.result, RESULTS.out_of_time)
        parts.append(Projection(far, 0 * last.lower, far, no * last.foot, 0 * last.element - 1, no * last.t, late))
    found = jax.tree_util.tree_map(lambda *x: jnp.concatenate(x), *parts)
    return jax.tree_util.tree_map(lambda x: x.reshape(*rows.shape[:-1], *x.shape[1:]), found)


def _finished(projection: Projection, throw: bool) -> Projection:
    if throw:
        throw_unless_successful(projection)
    return projection


def stationary_points(points: Numbers, curve: ShapeLike, *, capacity: int = 32, throw: bool = True) -> StationaryPoints:
    """All parameters at which the distance from a point to a curve is stationary, in certified enclosures.

    These are the roots of (P - B).B', sorted along the curve. A multiple root is one entry; a stretch of constant
    distance is one interval. A root at a joint is listed for both segments. No root is missing. If rounding cannot
    separate an enclosure from one with a root, it is kept, although it may hold none.

    Distances and parameters are differentiable twice in the points and in the curve; `lower` and `upper` are constants.
    On GPUs and in `inline_searches`, queries are scaled together: enclosures become wide if another query is 1e150
    times as far away.

    >>> import jhd
    >>> found = jhd.stationary_points((1, 2), jhd.polyline([(0, 0), (2, 0)]))
    >>> found.t[found.valid].round(9).tolist(), found.distance[found.valid].round(9).tolist()
    ([0.5], [2.0])

    Args:
        points: query points (..., dim). The result keeps the batch shape.
        curve: the curve, or an object that `jhd.as_shape` accepts.
        capacity: largest number of stationary parameters of one query on the whole curve; by default 32.
        throw: whether to raise NotProvenError if `capacity` is too small; by default True.

    Returns:
        A StationaryPoints: segments, parameters, enclosures and distances, padded to `capacity` entries and masked.

    Raises:
        TypeError: points that are not real numbers, or a shape that is not a curve.
        ValueError: points that are not finite, no points, or points whose dimension is not the dimension of the curve.
        NotProvenError: `capacity` is too small, and `throw` is True. The exception carries the points that fit.
    """
    check_rows_first("stationary_points", points)
    check_whole("capacity", capacity, 1)
    queries, segments = _checked(points, curve)
    found = stationary_on_curve(capacity, queries, segments)
    if throw:
        throw_unless_successful(found)
    return found


def _checked(points: Numbers, shape: Any) -> tuple[Array, BezierSegments]:
    shape = taken_as("shape", shape)
    check_curve("shape", shape)
    curve = working(shape)
    return checked_points(points, curve.dim), curve
