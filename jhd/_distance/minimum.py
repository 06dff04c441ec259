"""Entry points for the minimum distance of two shapes."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from jhd._arithmetic.rounding import smallest_normal
from jhd._distance.decisions import checked_limit, decided
from jhd._distance.normalization.method import check_serves
from jhd._distance.normalization.stopping import default_tolerance
from jhd._distance.project import project
from jhd._distance.published.voxel_pairs import VoxelPairs
from jhd._distance.search.bodies import PointBody, body_of, diagonal_of
from jhd._distance.search.body import AbstractBody
from jhd._distance.search.branch_and_bound import BranchAndBound, chosen_method, limited, sized_by_method
from jhd._distance.search.closest_triangles import of_meshes
from jhd._distance.search.implicit_minimum import with_surface
from jhd._distance.search.nets import of_nets
from jhd._distance.search.points import nearest_points
from jhd._distance.witness.balance import apart
from jhd._results.solution import RESULTS, Decision, MinimumSolution, throw_unless_successful
from jhd._runtime.arrays import is_traced, is_tracing, undifferentiated
from jhd._shapes.as_shape import ShapeLike, check_shape, taken_as
from jhd._shapes.checks import Numbers, check_same_dim
from jhd._shapes.curve import BezierSegments
from jhd._shapes.prepared import working
from jhd.progress import Callback


@sized_by_method
def minimum_distance(
    a: ShapeLike,
    b: ShapeLike,
    method: BranchAndBound | VoxelPairs | None = None,
    *,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    throw: bool = True,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> MinimumSolution:
    """Minimum distance of two shapes, min |p - q| over p in a and q in b, with certified bounds.

    The result refers to the stored arrays, taken as real numbers. Shapes that meet have distance zero: `lower` is then
    0, and `upper` is the rounding error between the two points found, at most the tolerance.

    The value and both points are differentiable in both shapes. If several pairs are equally near, the derivative
    belongs to the pair that is returned. At distance zero the derivative is zero by convention. Works under jit, vmap
    and grad. There, checks of values are skipped and `throw` is ignored: read `result`.

    If the nearest pairs form a surface (equidistant or coincident patches), the cost grows like diagonal / gap. The
    bounds are then true but wider, with RESULTS.nonisolated_maxima. Outside jit, the cost grows far more slowly for
    shapes that do not meet: for curves, parametric surfaces, and implicit surfaces with shapes of up to 64 pieces.

    Method: pairs of cells are bounded by the hulls of their control points along the line that joins them. A pair is
    discarded if the gradient of the distance excludes a minimum, and closed if the distance is convex on it.

    - Points are projected one by one onto curves and surfaces outside jit, up to rounding and without reporting
      progress.
    - A mesh is a surface, not the solid that it may bound. For a mesh inside another one, the result is the distance of
      the surfaces.
    - Two meshes, or a mesh with points or a polyline, use a host search. It measures the relevant pairs of triangles in
      rational arithmetic: the bounds are adjacent floats, and meshes that meet have `upper` 0. The tolerance applies
      only if very many pairs are equally near. Under jit and vmap this search runs on the host on all devices.
    - Next to other shapes, triangles are handled as patches. Next to an implicit surface, the triangles that may be
      nearest are selected first, so thousands of pieces are possible. If an edge of a large mesh crosses the surface,
      `upper` is 0 up to the smallest floats.

    >>> import jhd
    >>> found = jhd.minimum_distance(jhd.circle([0, 0], 3.0), jhd.circle([0, 7], 2.0))
    >>> bool(found.lower <= 2.0 <= found.upper), bool(found.upper - found.lower < 1e-8)
    (True, True)

    Args:
        a: points (`jhd.point_set`), a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an
            ImplicitSurface (clipped to its box), a TriangleMesh, or an object that `jhd.as_shape` accepts.
        b: a shape of any of these kinds and of the same dimension.
        method: BranchAndBound(...), the default, or VoxelPairs(...) for surfaces and meshes, whose result is
            RESULTS.not_certified and never raises. A step is sixteen pairs of cells; for meshes, a block of pairs or
            one exact pair. `queue_size` is the initial size of the queue of pairs.
        rtol: tolerance on `upper - lower`, relative to `upper`; by default 0. The search ends when the gap is at
            most the larger of both tolerances.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; the default is described at
            BranchAndBound.
        throw: whether to raise NotProvenError if the bounds do not close; by default True.
        max_seconds: wall time in seconds after which the search ends with the bounds reached (RESULTS.out_of_time); by
            default no limit. It does not end a compilation or the projection of points, and is ignored under jit.
        progress: a function that is called with a Progress from time to time; ignored under jit. Ctrl-C ends the search
            with the bounds reached and RESULTS.interrupted.

    Returns:
        A MinimumSolution: the distance, its bounds and the nearest points.

    Raises:
        TypeError: `a` or `b` is not a shape, the method does not serve this pair of shapes, or a tolerance is given
            twice, or together with a published method.
        ValueError: the dimensions differ, a surface is certified to be empty in its box, or a tolerance is negative.
        NotProvenError: the bounds did not close, and `throw` is True. The exception carries the solution.

    Source: Lin & Wang, 3-D signed Euclidean distance transform and its applications, section on the minimum distance
    (the problem; their method is VoxelPairs, which certifies nothing).
    """
    first, second = taken_as("a", a), taken_as("b", b)
    for name, shape in (("a", first), ("b", second)):
        check_shape(name, shape)
    method = chosen_method(method, rtol, atol)
    check_serves(method, first, second, (BranchAndBound, VoxelPairs))
    check_same_dim(first.dim, second.dim)
    hears = limited(method, progress, max_seconds)
    if isinstance(method, VoxelPairs):
        solution = method._minimum(first, second)
    else:
        solution = _searched(first, second, method, hears)
    if throw:
        throw_unless_successful(solution)
    return solution


def minimum_at_most(
    a: ShapeLike,
    b: ShapeLike,
    threshold: Numbers,
    method: BranchAndBound | None = None,
    *,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> Decision:
    """Whether the minimum distance is at most a threshold: certified yes, certified no, or undecided.

    This is the search of `minimum_distance`. Outside jit it stops once both bounds are on one side of the threshold.
    Under jit it runs to its end.

    >>> import jhd
    >>> bool(jhd.minimum_at_most(jhd.circle([0, 0], 3.0), jhd.circle([0, 7], 2.0), 1.5))
    False

    Args:
        a: points (`jhd.point_set`), a curve, a parametric surface, an ImplicitSurface, a TriangleMesh, or an object
            that `jhd.as_shape` accepts.
        b: a shape of any of these kinds and of the same dimension.
        threshold: a length of at least 0, in the unit of the coordinates.
        method: options of the search, a BranchAndBound. The search gives up (undecided) when its tolerance is reached.
        rtol: relative tolerance at which the search gives up; see `minimum_distance`.
        atol: absolute tolerance at which the search gives up; see `minimum_distance`.
        max_seconds: wall time in seconds after which the search ends with the bounds reached; see `minimum_distance`.
        progress: a function that is called with a Progress from time to time; see `minimum_distance`.

    Returns:
        A Decision: the answer with the bounds reached. If it is undecided, `result` tells why.

    Raises:
        TypeError: `a` or `b` is not a shape, the method is not BranchAndBound, or a tolerance is given twice.
        ValueError: the dimensions differ, a surface is certified to be empty in its box, or the threshold is negative
            or not one number.
    """
    limit, method = checked_limit(threshold), chosen_method(method, rtol, atol)
    check_serves(method, a, b, (BranchAndBound,))
    hears = limited(method, progress, max_seconds, None if is_traced(limit) else float(limit))
    return decided(minimum_distance(a, b, method, throw=False, progress=hears), limit)


def _searched(a: Any, b: Any, method: BranchAndBound, progress: Callback | None) -> MinimumSolution:
    first, second = body_of(a), body_of(b)
    if second.dimension == 0 and first.dimension != 0:
        return _turned(_searched(b, a, method, progress))
    if first.dimension == 0 and not is_tracing(undifferentiated((a, b)), method):
        return _of_points(first, second, method, progress)
    if 2 in (first.dimension, second.dimension):
        p, q = first.triangles(), second.triangles()
        if p is not None and q is not None:
            return of_meshes(p, q, method, progress)
    return _of_pieces(first, second, method, progress)


def _of_pieces(a: AbstractBody, b: AbstractBody, method: BranchAndBound, progress: Callback | None) -> MinimumSolution:
    """Return the minimum distance by searches over pairs of pieces.

    Both orders of the shapes use one compiled function.
    """
    if a.order() > b.order():
        return _turned(_of_pieces(b, a, method, progress))
    engine = with_surface if a.exact or b.exact else of_nets
    return engine(a.shape, b.shape, method, progress)


def _turned(found: MinimumSolution) -> MinimumSolution:
    return replace(found, point_a=found.point_b, point_b=found.point_a)


def _of_points(a: AbstractBody, b: AbstractBody, method: BranchAndBound, progress: Callback | None) -> MinimumSolution:
    """Return the minimum distance of known points; from points and meshes it is a distance of meshes."""
    points = _thinned(a, b)
    first, second = points.triangles(), None if b.dimension == 1 else _thinned(b, points).triangles()
    if first is None or second is None:
        return _nearest_of(points.shape, b.shape, method)
    found = of_meshes(first, second, method, progress)
    return replace(found, point_a=found.point_a[: a.shape.dim], point_b=found.point_b[: b.shape.dim])


def _nearest_of(points: Any, shape: Any, method: BranchAndBound) -> MinimumSolution:
    """Return the minimum distance of points from a shape, by projecting each point."""
    rows = points.control_points[:, 0]
    found = project(rows, shape, throw=False)
    lower, upper = (np.asarray(undifferentiated(x)) for x in (found.lower, found.upper))
    k, least = int(np.argmin(upper)), np.min(lower)
    size = diagonal_of(*undifferentiated((points, shape)))
    default = default_tolerance(size, lower.dtype, 0.0)
    allowed = max(float(default if method.atol is None else method.atol), float(method.rtol * upper[k]))
    # Some of the points that may be nearer may have wider bounds than they could have.
    ends = np.asarray(found.result._value)[lower <= upper[k]]
    closed = np.all(ends == int(RESULTS.successful._value)) or upper[k] - least <= allowed
    ended = RESULTS.gap_not_closed if np.isfinite(upper[k]) else RESULTS.existence_not_certified
    ended = RESULTS.successful if closed else ended
    stats = {"steps": jnp.array(1), "pairs": jnp.array(len(rows)), "waiting": jnp.array(0)}
    bounds = jnp.asarray(least), jnp.asarray(upper[k])
    solution = MinimumSolution(found.distance[k], *bounds, rows[k], found.foot[k], ended, stats)
    told = apart(undifferentiated(solution), undifferentiated(solution.value) / max(size, smallest_normal(lower.dtype)))
    return replace(solution, value=jnp.where(told, solution.value, undifferentiated(solution.value)))


def _thinned(points: AbstractBody, other: AbstractBody) -> AbstractBody:
    """Return the points of a large set that may be nearest to a shape; other shapes and small sets as they are.

    For a curve they are found by `project`, without duplicates.
    """
    # A set of at least this many points is searched by a tree, or thinned out before the search.
    if points.dimension != 0 or points.shape.count <= 256:
        return points
    if other.dimension != 1:
        return PointBody(nearest_points(points.shape, body_of(working(undifferentiated(other.shape))).target()))
    rows = np.asarray(undifferentiated(points.shape).control_points)[:, 0]
    found = project(rows, undifferentiated(other.shape), throw=False)
    near = np.flatnonzero(np.asarray(found.lower) <= np.min(np.asarray(found.upper)))
    first = np.unique(rows[near], axis=0, return_index=True)[1]
    return PointBody(BezierSegments(points.shape.control_points[near[np.sort(first)]]))
