"""The entry for minimum distances of two shapes."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from jhd._results.solution import RESULTS, Decision, MinimumSolution, throw_unless_successful
from jhd._runtime.arrays import is_traced, is_tracing, undifferentiated
from jhd.arithmetic.rounding import smallest_normal
from jhd.distance.decisions import checked_limit, decided
from jhd.distance.frame.aim import default_tolerance
from jhd.distance.frame.method import check_serves
from jhd.distance.frame.nets import net_of
from jhd.distance.project import project
from jhd.distance.published.voxel_pairs import VoxelPairs
from jhd.distance.search.branch_and_bound import BranchAndBound, default_method
from jhd.distance.search.closest_triangles import as_mesh, of_meshes
from jhd.distance.search.mixed import with_surface
from jhd.distance.search.mixes import diagonal_of
from jhd.distance.search.nets import of_nets
from jhd.distance.search.points import is_points, nearest_points, point_mesh
from jhd.distance.search.search import Progress, Threshold
from jhd.distance.witness.nets import apart
from jhd.shapes.as_shape import check_shape, taken_as
from jhd.shapes.checks import Numbers, check_same_dim
from jhd.shapes.curve import AbstractCurve, BezierSegments
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.prepared import working

# From this many points on a set of them is searched by a tree, or thinned out before the search.
_FEW = 256


def minimum_distance(
    a: Any,
    b: Any,
    method: BranchAndBound | VoxelPairs | None = None,
    *,
    atol: Numbers | None = None,
    rtol: Numbers | None = None,
    max_steps: int | None = None,
    capacity: int | None = None,
    throw: bool = True,
    progress: Callable[[Progress], object] | None = None,
) -> MinimumSolution:
    """Minimum distance of two shapes, min |p - q| over p on a and q on b, with proven bounds.

    Pairs of cells are bounded by the hulls of their control points along the line that joins them, left out where the
    gradient of the distance excludes a minimum, and closed where the distance is proven convex. The distance is that of
    the stored arrays taken as real numbers. Shapes that meet have distance zero: `upper` is then what rounding leaves
    between two points found, at most the tolerance, and `lower` is 0.

    The value and the points are differentiable in both shapes; where several pairs are equally near, as for the pair
    found, and at distance zero the derivative is zero by convention. Works under jit, vmap and grad, where checks of
    values are left out and `throw` is ignored: read `result`.

    Where nearest pairs form a surface (equidistant or coincident patches), the cost grows like diagonal / gap; bounds
    are then true and wider, as RESULTS.family_of_maxima. Outside jit it grows far more slowly between shapes that stay
    apart: curves, parametric surfaces and implicit surfaces, with these up to 64 pieces. Outside jit points are
    projected one by one onto curves and surfaces, without steps and progress, and as close as rounding leaves.

    A triangle mesh is a surface and not the solid that it may bound: of a mesh inside another one the distance of the
    surfaces is meant. Meshes, and a mesh with a point set or a polyline, have a search of their own from the host: the
    pairs of triangles that count are measured in rational arithmetic, so the bounds are next to each other and meshes
    that meet have `upper` 0; only where very many pairs are equally near is the tolerance used. Under jit and vmap this
    search is called from the program. With other shapes the triangles count as patches. Beside a polynomial surface
    those of many pieces that may be nearest are found first, so thousands of them are served; where an edge of a mesh
    of many triangles crosses the surface, `upper` is 0 but for the smallest numbers.

    >>> from jhd.shapes.curve import circle
    >>> found = minimum_distance(circle([0, 0], 3.0), circle([0, 7], 2.0))
    >>> bool(found.lower <= 2.0 <= found.upper), bool(found.upper - found.lower < 1e-8)
    (True, True)

    Args:
        a: points, a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an ImplicitSurface, which
            is clipped to its box, a TriangleMesh, or what jhd.as_shape takes for one.
        b: another of these, of the same dimension.
        method: BranchAndBound(...), by default with the options below; or VoxelPairs(...) for surfaces and meshes,
            whose answer is RESULTS.unproven and is never raised.
        atol: as for BranchAndBound, like the next three; not together with a method.
        rtol: tolerance relative to upper.
        max_steps: most steps, of sixteen pairs of cells each; of meshes, of a block of pairs or an exact pair.
        capacity: least length of the table of pairs.
        throw: whether to raise where the gap is not closed.
        progress: called with a Progress now and then; not under jit. Ctrl-C ends the search with the bounds reached, as
            RESULTS.interrupted.

    Returns:
        The distance with its bounds and the nearest points.

    Raises:
        TypeError: a shape of another kind, or a method that does not serve the shapes.
        ValueError: shapes of different dimensions, a surface that is proven empty in its box, tolerances that are no
            numbers of at least 0, counts too small, or options beside a method.
        NotProvenError: the gap was not closed and throw is True; it carries the solution.

    Source: Lin & Wang, 3D signed Euclidean distance transform and its applications, section on the minimum distance
    (the problem; their method is VoxelPairs, which proves nothing).
    """
    a, b = taken_as("a", a), taken_as("b", b)
    for name, shape in (("a", a), ("b", b)):
        check_shape(name, shape)
    method = _method(method, {"atol": atol, "rtol": rtol, "max_steps": max_steps, "capacity": capacity})
    check_serves(method, a, b, (BranchAndBound, VoxelPairs))
    check_same_dim(a.dim, b.dim)
    solution = method.minimum(a, b) if isinstance(method, VoxelPairs) else _searched(a, b, method, progress)
    if throw:
        throw_unless_successful(solution)
    return solution


def minimum_at_most(
    a: Any,
    b: Any,
    threshold: Numbers,
    method: BranchAndBound | None = None,
    *,
    progress: Callable[[Progress], object] | None = None,
) -> Decision:
    """Whether the minimum distance is at most the threshold: proven yes, proven no, or undecided at the tolerance.

    The search of `minimum_distance`, ended between two of its stretches when the bounds are on one side of the
    threshold. Under jit it runs to its end.

    >>> from jhd.shapes.curve import circle
    >>> bool(minimum_at_most(circle([0, 0], 3.0), circle([0, 7], 2.0), 1.5))
    False

    Args:
        a: as for `minimum_distance`.
        b: likewise.
        threshold: a length of at least 0, in the unit of the coordinates.
        method: options of the search; its tolerance says when it gives up.
        progress: as for `minimum_distance`.

    Returns:
        The answer with the bounds of the distance that were reached; `result` says why where it is undecided.

    Raises:
        TypeError: a shape of another kind, or another method than BranchAndBound.
        ValueError: shapes of different dimensions, a surface proven empty in its box, or a threshold that is no length.
    """
    limit, method = checked_limit(threshold), default_method() if method is None else method
    check_serves(method, a, b, (BranchAndBound,))
    hears = progress if is_traced(limit) else Threshold(float(limit), progress)
    return decided(minimum_distance(a, b, method, throw=False, progress=hears), limit)


def _method(method: BranchAndBound | VoxelPairs | None, options: dict[str, Any]) -> BranchAndBound | VoxelPairs:
    """The method, or the one that the options make."""
    given = {name: value for name, value in options.items() if value is not None}
    if method is None:
        return BranchAndBound(**given) if given else default_method()
    if given:
        raise ValueError(f"method is given, and so is {', '.join(given)}: options go to the method, or without it.")
    return method


def _searched(a: Any, b: Any, method: BranchAndBound, progress: Callable[[Progress], object] | None) -> MinimumSolution:
    if is_points(b) and not is_points(a):
        return _turned(_searched(b, a, method, progress))
    if is_points(a) and not is_tracing(undifferentiated((a, b)), method):
        return _of_points(a, b, method, progress)
    if isinstance(a, TriangleMesh) or isinstance(b, TriangleMesh):
        first, second = as_mesh(a), as_mesh(b)
        if first is not None and second is not None:
            return of_meshes(first, second, method, progress)
    return _of_pieces(a, b, method, progress)


def _of_pieces(
    a: Any, b: Any, method: BranchAndBound, progress: Callable[[Progress], object] | None
) -> MinimumSolution:
    """By the searches over pairs of pieces, one way round for both orders of the shapes: it is the same program."""
    if _order(a) > _order(b):
        return _turned(_of_pieces(b, a, method, progress))
    engine = with_surface if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface) else of_nets
    return engine(a, b, method, progress)


def _order(shape: Any) -> tuple[int, ...]:
    """The place of a shape's kind and sizes among those of others."""
    if isinstance(shape, ImplicitSurface):
        return (1,)
    net = net_of(shape)
    return (0, *net.points.shape[1:3], net.weights is not None, net.points.shape[0])


def _turned(found: MinimumSolution) -> MinimumSolution:
    return replace(found, point_a=found.point_b, point_b=found.point_a)


def _of_points(
    a: Any, b: Any, method: BranchAndBound, progress: Callable[[Progress], object] | None
) -> MinimumSolution:
    """Of known points: each by itself; among themselves and with meshes as a mesh of those that may be nearest."""
    large = [is_points(shape) and shape.count > _FEW for shape in (a, b)]
    first = _thinned(a, b) if large[0] else a
    if not is_points(b) and not isinstance(b, TriangleMesh):
        return _nearest_of(first, b, method)
    second = _thinned(b, first) if large[1] else b
    p, q = (shape if isinstance(shape, TriangleMesh) else point_mesh(shape) for shape in (first, second))
    found = of_meshes(p, q, method, progress)
    return replace(found, point_a=found.point_a[: a.dim], point_b=found.point_b[: b.dim])


def _nearest_of(points: Any, shape: Any, method: BranchAndBound) -> MinimumSolution:
    """The nearest of some points, each of which is projected."""
    rows = points.control_points[:, 0]
    found = project(rows, shape, throw=False)
    lower, upper = (np.asarray(undifferentiated(x)) for x in (found.lower, found.upper))
    k, least = int(np.argmin(upper)), np.min(lower)
    size = diagonal_of(*undifferentiated((points, shape)))
    default = default_tolerance(size, lower.dtype, 0.0)
    allowed = max(float(default if method.atol is None else method.atol), float(method.rtol * upper[k]))
    # Of those that may be nearer some may be proven less well than they could be.
    ends = np.asarray(found.result._value)[lower <= upper[k]]
    closed = np.all(ends == int(RESULTS.successful._value)) or upper[k] - least <= allowed
    ended = RESULTS.gap_not_closed if np.isfinite(upper[k]) else RESULTS.unverified
    ended = RESULTS.successful if closed else ended
    stats = {"steps": jnp.array(1), "pairs": jnp.array(len(rows)), "waiting": jnp.array(0)}
    bounds = jnp.asarray(least), jnp.asarray(upper[k])
    solution = MinimumSolution(found.distance[k], *bounds, rows[k], found.foot[k], ended, stats)
    told = apart(undifferentiated(solution), undifferentiated(solution.value) / max(size, smallest_normal(lower.dtype)))
    return replace(solution, value=jnp.where(told, solution.value, undifferentiated(solution.value)))


def _thinned(points: Any, shape: Any) -> Any:
    """The points that may be nearest to a shape; of a curve by its nearest points, each place once."""
    if not isinstance(shape, AbstractCurve) or is_points(shape):
        return nearest_points(points, working(shape))
    rows = np.asarray(undifferentiated(points).control_points)[:, 0]
    found = project(rows, undifferentiated(shape), throw=False)
    near = np.flatnonzero(np.asarray(found.lower) <= np.min(np.asarray(found.upper)))
    first = np.unique(rows[near], axis=0, return_index=True)[1]
    return BezierSegments(points.control_points[near[np.sort(first)]])
