"""Queries of curves: the nearest point and all stationary points of many points, on known and on traced numbers.

Known queries are scaled in NumPy. A kept compiled function takes them in blocks, which all cores share. Traced queries
on CPUs call the host. On other devices, and for curves of very many segments, one compiled function takes all queries
of a block.

The stationary parameters are the roots of f(s) = (P - B).B', in Bernstein form of degree 2 n - 1, or 3 n - 2 for
rational curves.

Source: Cao et al. 2014, equation (10), with its indices corrected.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap
from jaxtyping import Array

from jhd._arithmetic.scaling import length, unit_weights
from jhd._distance.nearest.blocks import blocks_of, in_groups, is_long, nearest_in_blocks, places
from jhd._distance.nearest.curves import NearestOnCurve, repeated
from jhd._distance.nearest.feet import is_held
from jhd._distance.nearest.stationarity import roots_on
from jhd._distance.normalization.coordinates import (
    Frame,
    common_points,
    extremes,
    frame_of,
    origin,
    user_length,
    user_place,
)
from jhd._distance.normalization.curves import padded_count, replaced, usable
from jhd._distance.normalization.host_callback import by_kept_program, from_host, like_result, of_known_rows
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import piece_of
from jhd._distance.project_methods import AbstractProjectionMethod, BestFirstProjection, failed, how_closed
from jhd._distance.witness.active import stationary
from jhd._distance.witness.derivative import projection_with_derivatives, stationary_with_derivatives
from jhd._results.solution import RESULTS, Projection, StationaryPoints, on_device, result_where, unchecked
from jhd._runtime.arrays import bound, in_chunks, is_tracing, module_of, on_host, undifferentiated
from jhd._runtime.compiled import calls_host, compiled, optimized
from jhd._runtime.sharding import is_partitioned
from jhd._shapes.checks import usable_numbers
from jhd._shapes.curve import BezierSegments
from jhd._shapes.joints import followed
from jhd._shapes.unchecked import trusted

# Numbers of queries that other executables are compiled for; more queries are done in blocks of the last size.
_BLOCKS = (1, 16, 128, 1024)
# Up to this number of queries, all curves of few segments share one size. More queries look at every segment so often
# that repeated segments double the time.
_FEW = 16


def projected_on_curve(method: AbstractProjectionMethod, queries: Array, curve: BezierSegments) -> Projection:
    """Return the nearest points of a curve to queries (..., dim), differentiable in both."""
    found = _for_each(_nearest_to, _form_of_projection(curve), method, *undifferentiated((queries, curve)))
    return projection_with_derivatives(found, queries, curve)


def stationary_on_curve(capacity: int, queries: Array, curve: BezierSegments) -> StationaryPoints:
    """Return the stationary points of the distances from queries (..., dim), differentiable in both."""
    one = _StationaryTo(capacity)
    found = _for_each(one, _form_of_stationary(capacity, curve), (), *undifferentiated((queries, curve)))
    return stationary_with_derivatives(found, queries, curve)


def _for_each(one: Callable[..., Any], answer: Any, option: Any, queries: Array, curve: BezierSegments) -> Any:
    """Return results for all queries, in the user's coordinates.

    Args:
        one: computes a result from the option, the curve padded by repetition, its number of segments without padding,
            and a query, all scaled by a power of two; a function of this module, or a callable named tuple.
        answer: shapes and types of a result, as jax.ShapeDtypeStruct.
        option: a pytree of constants.
        queries: (..., dim).
        curve: the curve.
    """
    batch, flat = queries.shape[:-1], on_host(queries)[0].reshape(-1, curve.dim)
    if not is_tracing(flat, curve):
        found = _of_known(one, answer, option, *jax.tree_util.tree_map(np.asarray, (flat, curve)))
    elif calls_host() and not is_partitioned((flat, curve)):
        found = _on_host(one, answer, option)(*bound((flat, jax.lax.stop_gradient(curve))))
    else:
        found = _in_program(one, answer, option, flat, curve)
    return on_device(jax.tree_util.tree_map(lambda x: x.reshape((*batch, *x.shape[1:])), found))


def _on_host(one: Callable[..., Any], answer: Any, option: Any) -> Callable[..., Any]:
    """Return a function of traced queries in rows and a curve that computes results on the host.

    The queries of a batch with one curve are joined. If each member has a curve of its own and few queries, the host
    gets each query with its curve.
    """

    def call(flat: Array, curve: BezierSegments) -> Any:
        like = jax.tree_util.tree_map(lambda s: jax.ShapeDtypeStruct((len(flat), *s.shape), s.dtype), answer)
        return from_host(partial(_of_known, one, answer, option), like, flat, curve, rows=True)

    found = custom_vmap(call)

    @found.def_vmap
    def batch(size: int, batched: Any, flat: Array, curve: BezierSegments) -> Any:
        if any(jax.tree_util.tree_leaves(batched[1])):
            leaves, tree = jax.tree_util.tree_flatten((flat, curve))
            axes = tuple(0 if x else None for x in jax.tree_util.tree_leaves(batched))
            function = partial(_in_program, one, answer, option) if flat.shape[-2] <= _FEW else call
            result = jax.vmap(lambda *x: function(*tree.unflatten(x)), axes, axis_size=size)(*leaves)
        else:
            joined = _on_host(one, answer, option)(flat.reshape(-1, flat.shape[-1]), curve)
            result = jax.tree_util.tree_map(lambda x: x.reshape(size, -1, *x.shape[1:]), joined)
        return result, jax.tree_util.tree_map(lambda _: True, result)

    return found


def _in_program(one: Callable[..., Any], answer: Any, option: Any, flat: Array, curve: BezierSegments) -> Any:
    """Return results for traced queries in rows, which are scaled inside the compiled function."""
    good = usable(curve) & jnp.all(jnp.isfinite(flat), axis=-1)
    host = calls_host() and not is_partitioned((flat, curve))
    count = padded_count(curve.count, small=True) if host else curve.count
    queries, padded, frame = _scaled(jnp.where(good[:, None], flat, 0.0), replaced(curve, usable(curve)), count)
    used = np.asarray(curve.count)
    if host and not _in_groups(option, padded):
        found = jax.vmap(lambda query: by_kept_program(one, answer, (padded, used, query), (option,)))(queries)
    else:
        found = _block(one, option, queries, padded, used)
    return _finite(_unscaled(found, frame), good)


def _of_known(one: Callable[..., Any], answer: Any, option: Any, flat: np.ndarray, curve: BezierSegments) -> Any:
    """Return results for known queries in rows. Queries far beyond others have a scale of their own."""
    size = np.max(np.abs(flat), axis=1, initial=np.max(np.abs(curve.control_points)))
    exponent = np.frexp(np.where(np.isfinite(size), size, 0.0))[1]
    # Binary orders of magnitude that queries may differ by to be scaled together.
    apart = (exponent - exponent.min()) // 64
    if len(groups := np.unique(apart)) == 1:
        return _of_similar(one, answer, option, flat, curve)
    out = jax.tree_util.tree_map(lambda s: np.empty((len(flat), *s.shape), s.dtype), answer)
    for group in groups:
        rows = np.flatnonzero(apart == group)
        found = _of_similar(one, answer, option, flat[rows], curve)
        for whole, part in zip(*map(jax.tree_util.tree_leaves, (out, found)), strict=True):
            whole[rows] = part
    return out


def _of_similar(one: Callable[..., Any], answer: Any, option: Any, flat: np.ndarray, curve: BezierSegments) -> Any:
    """Return results for known queries in rows, scaled together."""
    good = usable_numbers(curve.control_points, curve.weights) & np.all(np.isfinite(flat), axis=-1)
    if not np.any(good):
        return _finite(jax.tree_util.tree_map(lambda s: np.zeros((len(flat), *s.shape), s.dtype), answer), good)
    flat = np.where(good[:, None], flat, 0.0)
    flat, padded, frame = _scaled(flat, curve, padded_count(curve.count, small=len(flat) > _FEW))
    used = np.asarray(curve.count)
    if calls_host() and not _in_groups(option, padded):
        # Queries of a block that a CPU takes one by one: it may as well be filled in part.
        found = of_known_rows(one, answer, flat, (option, padded, used), 256)
    else:
        found = _by_blocks(one, option, used, flat, padded)
    return _finite(_unscaled(found, frame), good)


def _scaled(queries: Any, curve: BezierSegments, count: int) -> tuple[Any, BezierSegments, Frame]:
    """Return queries and curve (padded by repetition) scaled by a power of two, and the frame that leads back."""
    points = module_of(queries).asarray(curve.control_points)
    frame = frame_of([extremes(queries), extremes(points)], center=origin)
    queries, points = common_points(frame, queries), common_points(frame, points)
    index = np.minimum(np.arange(count), curve.count - 1)
    weights = None if curve.weights is None else unit_weights(curve.weights)[index]
    links = module_of(queries).asarray(followed(curve.links))[index]
    return queries, trusted(points[index], weights, links), frame


def _in_groups(option: Any, curve: BezierSegments) -> bool:
    """Return whether queries that lie near each other are searched together."""
    return isinstance(option, BestFirstProjection) and is_long(curve)


def _by_blocks(one: Callable[..., Any], option: Any, used: Any, queries: Any, curve: BezierSegments) -> Any:
    """Return results for known queries, padded by repetition to blocks of a few sizes."""
    together = _in_groups(option, curve)
    order: Any = _order(queries) if together else slice(None)
    # Block size for long curves, which are prepared for each block.
    size = next((b for b in _BLOCKS if b >= len(queries)), 4096 if together else _BLOCKS[-1])
    rows = queries[order][np.minimum(np.arange(-(-len(queries) // size) * size), len(queries) - 1)]
    found = [_block(one, option, block, curve, used) for block in rows.reshape(-1, size, curve.dim)]
    joined = jax.tree_util.tree_map(lambda *parts: np.concatenate(parts)[: len(queries)], *found)
    return jax.tree_util.tree_map(lambda x: x[np.argsort(order)], joined) if together else joined


def _finite(found: Any, good: Any) -> Any:
    """Return results in which queries that were not finite have trivial bounds and their own result code."""
    xp = module_of(good)
    if xp is np and np.all(good):
        return found
    result = jax.tree_util.tree_map(lambda x, y: xp.where(good, x, y), found.result, RESULTS.nonfinite_value)
    if isinstance(found, StationaryPoints):
        return _changed(found, valid=found.valid & good[:, None], result=result)
    ends = ((found.distance, np.inf), (found.lower, 0.0), (found.upper, np.inf))
    distance, lower, upper = (xp.where(good, x, y) for x, y in ends)
    return _changed(found, distance=distance, lower=lower, upper=upper, result=result)


def _unscaled(found: Any, frame: Frame) -> Any:
    distance = user_length(frame, found.distance, None)
    if isinstance(found, StationaryPoints):
        return _changed(found, distance=distance)
    lower, upper = user_length(frame, found.lower, 0.0), user_length(frame, found.upper, math.inf)
    return _changed(found, distance=distance, lower=lower, upper=upper, foot=user_place(frame, found.foot))


def _changed(found: Any, **fields: Any) -> Any:
    return unchecked(type(found), vars(found) | fields)


def _form_of_projection(curve: BezierSegments) -> Projection:
    """Return shapes and types of the result for one query."""
    number, whole, result = _forms(curve)
    fields = {name: number() for name in ("distance", "lower", "upper", "t")}
    return unchecked(Projection, fields | {"foot": number(curve.dim), "element": whole(), "result": result})


def _form_of_stationary(capacity: int, curve: BezierSegments) -> StationaryPoints:
    number, whole, result = _forms(curve)
    fields = {name: number(capacity) for name in ("distance", "lower", "upper", "t")}
    fields |= {"segment": whole(capacity), "valid": jax.ShapeDtypeStruct((capacity,), bool), "result": result}
    return unchecked(StationaryPoints, fields)


def _forms(curve: BezierSegments) -> tuple[Any, Any, Any]:
    number = lambda *shape: jax.ShapeDtypeStruct(shape, curve.control_points.dtype)  # noqa: E731
    whole = lambda *shape: jax.ShapeDtypeStruct(shape, jnp.result_type(int))  # noqa: E731
    return number, whole, like_result()


_places = compiled(places)


def _order(points: Any) -> np.ndarray:
    """Return an order of the points in which neighbors follow each other.

    Its length is a power of two, so that few functions are compiled.
    """
    count = len(points)
    rows = points[np.minimum(np.arange(1 << (count - 1).bit_length()), count - 1)]
    return np.argsort(np.asarray(_places(rows))[:count])


@partial(optimized, static=(0,))
def _block(one: Callable[..., Any], option: Any, queries: Array, curve: BezierSegments, used: Any) -> Any:
    """Return results for some queries."""
    if not _in_groups(option, curve):
        # Queries searched in one batch: more wait for the slowest query, fewer leave vector units idle.
        return in_chunks(lambda query: one(option, curve, used, query), queries, 128)
    blocks = blocks_of(curve)

    def of_group(points: Array) -> Projection:
        found = nearest_in_blocks(blocks, points)
        return jax.vmap(partial(_projection, curve))(points, found, jax.vmap(how_closed)(found))

    return in_groups(of_group, queries)


def _nearest_to(method: AbstractProjectionMethod, curve: BezierSegments, _: Any, query: Array) -> Projection:
    return _projection(curve, query, *method._one(query, curve, repeated(curve.control_points, curve.weights)))


def _projection(curve: BezierSegments, point: Array, found: NearestOnCurve, result: Any) -> Projection:
    piece = piece_of(curve, found.segment)
    # Distances are accurate when the parameter is off by the root of the roundoff; one step corrects the parameter.
    t = stationary(found.t, point, piece, is_held(point, piece, found.t))
    # A larger change of the parameter by one more Newton step is no correction: the local methods may stop anywhere.
    t = jnp.where(jnp.abs(t - found.t) < 1e-6, jnp.clip(t, 0.0, 1.0), found.t)
    return Projection(found.distance, found.lower, found.upper, jet(*piece, t).point, found.segment, t, result)


class _StationaryTo(NamedTuple):
    """Compute the stationary points of a query, at most `capacity` of them."""

    capacity: int

    def __call__(self, _: Any, curve: BezierSegments, used: Any, query: Array) -> StationaryPoints:
        # A segment that repeats the one before it has stationary parameters of its own; only padding has none.
        return _stationary_of(query, curve, jnp.arange(curve.count) >= used, self.capacity)


def _stationary_of(point: Array, curve: BezierSegments, skip: Array, capacity: int) -> StationaryPoints:
    """Return the first `capacity` stationary parameters of one query over all segments."""
    per_segment = min(capacity, 4 * (curve.degree + 1)) if curve.degree else 2
    roots = jax.vmap(lambda k: roots_on(point, curve, k, max(per_segment, 16)))(jnp.arange(curve.count))
    valid = (roots.valid & ~skip[:, None]).ravel()
    order = jnp.argsort(~valid, stable=True)[:capacity]
    segment = jnp.repeat(jnp.arange(curve.count), roots.valid.shape[1])
    lower, upper = roots.lower.ravel(), roots.upper.ravel()
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
