"""Nearest points of shapes of every kind, and all stationary points of curves.

Methods for curves are in jhd._distance.project_methods. Meshes use jhd._distance.nearest.meshes; parametric and
implicit surfaces use jhd._distance.search.targets.

The stationary parameters are the roots of f(s) = (P - B).B', in Bernstein form of degree 2 n - 1, or 3 n - 2 for
rational curves.

Source: Cao et al. 2014, equation (10), with its indices corrected.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.scaling import length, unit_weights
from jhd._distance.nearest.blocks import blocks_of, in_groups, is_long, nearest_in_blocks, places
from jhd._distance.nearest.curves import NearestOnCurve, in_chunks, repeated
from jhd._distance.nearest.feet import is_held
from jhd._distance.nearest.stationarity import roots_on
from jhd._distance.normalization.coordinates import Frame, common_points, extremes, frame_of, origin
from jhd._distance.normalization.curves import padded_count, replaced, trusted, usable
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import piece_of
from jhd._distance.project_methods import AbstractProjectionMethod, BestFirstProjection, failed, how_closed
from jhd._distance.published.vertex_voxels import VertexVoxels
from jhd._distance.search.targets import project_on_surface
from jhd._distance.witness.active import stationary
from jhd._distance.witness.derivative import projection_with_derivatives
from jhd._distance.witness.mesh_feet import project_on_mesh
from jhd._results.solution import RESULTS, Projection, StationaryPoints, result_where, throw_unless_successful
from jhd._runtime.arrays import array_of, check_whole, is_traced, real_array, undifferentiated
from jhd._runtime.compiled import compiled, optimized
from jhd._shapes.as_shape import ShapeLike, check_rows_first, check_shape, taken_as
from jhd._shapes.checks import Numbers
from jhd._shapes.curve import BezierSegments, check_curve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch

# Numbers of queries that programs are compiled for; more are done in blocks of the last size.
_BLOCKS = (1, 16, 128, 1024)
# The same of long curves, which are prepared for each block.
_LONG_BLOCK = 4096
# Up to so many queries all curves of few segments share one size; more of them look at every segment so often that
# repeated ones double the time.
_FEW = 16
# A larger change of the parameter by one more Newton step is no mending: the local methods stop where they please.
_MENDED = 1e-6
# Queries that are searched side by side: more wait for the slowest of them, fewer leave vector units idle.
_CHUNK = 128


def project(
    points: Numbers,
    shape: ShapeLike,
    method: AbstractProjectionMethod | VertexVoxels | None = None,
    *,
    throw: bool = True,
) -> Projection:
    """Nearest points of a shape to query points, with certified bounds of the distances.

    Distance, foot point and parameter are differentiable twice in the points and in the shape:

    - If several points are equally near, the derivative refers to the foot point returned.
    - At distance zero, the derivative is zero by convention.
    - If the foot point is an end or a corner of the shape, its parameter does not move. A foot point stays on the face,
      edge or vertex of a mesh that holds it, and on the face of the box of an implicit surface.
    - At a pole of a parametric surface, an edge of a patch is one point. There derivatives of the foot point and second
      derivatives of the distance are NaN. They can also be NaN if the foot point is so near to a pole that rounding
      leaves its patch open: within 1e-7 of the size of the patch, or 1e-6 for points a hundred sizes away. Gradients
      can be off by as much there.

    Works under jit and vmap. There, checks of values are skipped and `throw` is ignored: read `result`. Surfaces are
    searched by a host call, also under jit.

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

    Returns:
        A Projection: distances with bounds, foot points, segments and parameters. Local methods certify no lower bound:
        it is 0. If no point of an implicit surface can be certified, `upper` is infinite.

    Raises:
        TypeError: points that are not real numbers, a shape or a method of another kind, or VertexVoxels under tracing.
        ValueError: points that are not finite, that are empty, or whose dimension is not the dimension of the shape; a
            VertexVoxels whose capacity is too small; an implicit surface without points in its box.
        NotProvenError: the bounds did not close, and `throw` is True. The exception carries the solution.
    """
    check_rows_first("project", points)
    shape = taken_as("shape", shape)
    check_shape("shape", shape)
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
    projection = _in_blocks(_project_block, method, *undifferentiated((queries, curve)))
    return _finished(projection_with_derivatives(projection, queries, curve), throw)


def _finished(projection: Projection, throw: bool) -> Projection:
    if throw:
        throw_unless_successful(projection)
    return projection


def stationary_points(points: Numbers, curve: ShapeLike, *, capacity: int = 32, throw: bool = True) -> StationaryPoints:
    """All parameters at which the distance from a point to a curve is stationary, in certified enclosures.

    These are the roots of (P - B).B', sorted along the curve. A multiple root is one entry; a stretch of constant
    distance is one interval. A root at a joint is listed for both segments. No root is missing. If rounding cannot
    separate an enclosure from one with a root, it is kept, although it may hold none.

    Queries are scaled together: enclosures become wide if another query is 1e150 times as far away.

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
        ValueError: points that are not finite, that are empty, or whose dimension is not the dimension of the curve.
        NotProvenError: `capacity` is too small, and `throw` is True. The exception carries the points that fit.
    """
    check_rows_first("stationary_points", points)
    check_whole("capacity", capacity, 1)
    queries, segments = _checked(points, curve)
    found = _in_blocks(_stationary_block, capacity, queries, segments)
    if throw:
        throw_unless_successful(found)
    return found


def _checked(points: Numbers, shape: Any) -> tuple[Array, BezierSegments]:
    shape = taken_as("shape", shape)
    check_curve("shape", shape)
    curve = shape.segments()
    queries = real_array("points", points)
    if queries.ndim == 0 or queries.shape[-1] != curve.dim:
        raise ValueError(f"points has shape {queries.shape}; needs (..., {curve.dim}).")
    if queries.size == 0:
        raise ValueError(f"points is empty: its shape is {queries.shape}.")
    return queries, curve


def _in_blocks(kernel: Callable[..., Any], option: Any, queries: Array, curve: BezierSegments) -> Any:
    """Results of a jitted kernel for all queries: scaled by a power of two, in blocks of a few sizes when concrete.

    The kernel takes the option, queries, the curve padded by repetition, and how many of its segments are not padding.
    """
    batch, traced = queries.shape[:-1], is_traced(queries, curve)
    xp = jnp if traced else np
    good = usable(curve)
    curve = replaced(curve, good)
    flat, points = xp.asarray(queries).reshape(-1, curve.dim), xp.asarray(curve.control_points)
    if traced:
        good = good & jnp.all(jnp.isfinite(flat), axis=-1)
        flat = jnp.where(good[:, None], flat, 0.0)
    frame = frame_of([extremes(flat), extremes(points)], center=origin)
    flat, points = common_points(frame, flat), common_points(frame, points)
    count = curve.count if traced else padded_count(curve.count, small=len(flat) > _FEW)
    index = np.minimum(np.arange(count), curve.count - 1)
    weights = None if curve.weights is None else unit_weights(curve.weights)[index]
    scaled = trusted(points[index], weights, xp.asarray(curve.next_segment)[index])
    if traced:
        found = [kernel(option, flat, scaled, curve.count)]
    else:
        # In blocks of a long curve neighbors are searched together.
        order: Any = _order(flat) if is_long(scaled) else slice(None)
        flat = flat[order]
        size = next((b for b in _BLOCKS if b >= len(flat)), _LONG_BLOCK if is_long(scaled) else _BLOCKS[-1])
        padded = flat[np.minimum(np.arange(-(-len(flat) // size) * size), len(flat) - 1)]
        used = np.asarray(curve.count)
        found = [kernel(option, rows, scaled, used) for rows in padded.reshape(-1, size, curve.dim)]
    joined = jax.tree_util.tree_map(lambda *parts: xp.concatenate(parts)[: len(flat)], *found)
    if traced:
        joined = _marked(joined, good)
    elif is_long(scaled):
        back = np.argsort(order)
        joined = jax.tree_util.tree_map(lambda x: x[back], joined)
    joined = jax.tree_util.tree_map(lambda x: x.reshape((*batch, *x.shape[1:])), joined)
    return jax.tree_util.tree_map(array_of, _unscaled(joined, frame))


def _marked(found: Any, good: Array) -> Any:
    """Results with distances that claim nothing, and their own code, for queries that were no numbers."""
    result = jax.vmap(lambda g, r: result_where(g, r, RESULTS.nonfinite_value))(good, found.result)
    if isinstance(found, StationaryPoints):
        valid = found.valid & good[:, None]
        return eqx.tree_at(lambda p: (p.valid, p.result), found, (valid, result))
    numbers = ((found.distance, jnp.inf), (found.lower, 0.0), (found.upper, jnp.inf))
    chosen = tuple(jnp.where(good, x, y) for x, y in numbers)
    return eqx.tree_at(lambda p: (p.distance, p.lower, p.upper, p.result), found, (*chosen, result))


def _unscaled(found: Any, frame: Frame) -> Any:
    if isinstance(found, StationaryPoints):
        return eqx.tree_at(lambda s: s.distance, found, frame.length(found.distance))
    lengths = (frame.length(found.distance), frame.length(found.lower, 0.0), frame.length(found.upper, math.inf))
    where = lambda p: (p.distance, p.lower, p.upper, p.foot)  # noqa: E731
    return eqx.tree_at(where, found, (*lengths, frame.place(found.foot)))


_places = compiled(places)


def _order(points: Any) -> np.ndarray:
    """An order in which neighbors follow each other; of lengths that are powers of two, for which programs are few."""
    count = len(points)
    rows = points[np.minimum(np.arange(1 << (count - 1).bit_length()), count - 1)]
    return np.argsort(np.asarray(_places(rows))[:count])


@optimized
def _project_block(method: AbstractProjectionMethod, queries: Array, curve: BezierSegments, _: Any) -> Projection:
    skip = repeated(curve.control_points, curve.weights)

    def at(point: Array, found: NearestOnCurve, result: Any) -> Projection:
        piece = piece_of(curve, found.segment)
        # Distances are as good as they get where the parameter is off by the root of that; one step mends it.
        t = stationary(found.t, point, piece, is_held(point, piece, found.t))
        t = jnp.where(jnp.abs(t - found.t) < _MENDED, jnp.clip(t, 0.0, 1.0), found.t)
        return Projection(found.distance, found.lower, found.upper, jet(*piece, t).point, found.segment, t, result)

    def of_group(points: Array) -> Projection:
        found = nearest_in_blocks(blocks, points)
        return jax.vmap(at)(points, found, jax.vmap(how_closed)(found))

    if isinstance(method, BestFirstProjection) and is_long(curve):
        blocks = blocks_of(curve)
        return in_groups(of_group, queries)
    return in_chunks(lambda point: at(point, *method.one(point, curve, skip)), queries, _CHUNK)


@partial(optimized, static=(0,))
def _stationary_block(capacity: int, queries: Array, curve: BezierSegments, used: Any) -> StationaryPoints:
    # A segment that repeats the one before it has stationary parameters of its own; only padding has none.
    skip = jnp.arange(curve.count) >= used
    return in_chunks(lambda p: _stationary_of(p, curve, skip, capacity), queries, _CHUNK)


def _stationary_of(point: Array, curve: BezierSegments, skip: Array, capacity: int) -> StationaryPoints:
    """Stationary parameters of one query over all segments, the first `capacity` of them."""
    per_segment = min(capacity, 4 * (curve.degree + 1)) if curve.degree else 2
    roots = jax.vmap(lambda k: roots_on(point, curve, k, max(per_segment, 16)))(jnp.arange(curve.count))
    valid = (roots.valid & ~skip[:, None]).ravel()
    order = jnp.argsort(~valid, stable=True)[:capacity]
    segment = jnp.repeat(jnp.arange(curve.count), roots.valid.shape[1])
    lower, upper = roots.lower[..., 0].ravel(), roots.upper[..., 0].ravel()
    pick = lambda x, fill: _padded(jnp.where(valid[order], x[order], fill), capacity)  # noqa: E731
    middle = pick(0.5 * (lower + upper), 0.0)
    chosen = pick(segment, 0)
    at = jax.vmap(lambda k, s: jet(*piece_of(curve, k), s).point)(chosen, middle)
    distance = jnp.where(_padded(valid[order], capacity), length(at - point), jnp.inf)
    full = (jnp.sum(valid) > capacity) | jnp.any(failed(roots.result))
    result = result_where(full, RESULTS.capacity_reached, RESULTS.successful)
    return StationaryPoints(
        chosen, middle, pick(lower, 1.0), pick(upper, 0.0), distance, _padded(valid[order], capacity), result
    )


def _padded(x: Array, capacity: int) -> Array:
    return jnp.pad(x, (0, capacity - x.shape[0]))
