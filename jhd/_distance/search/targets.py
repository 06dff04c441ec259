"""Nearest points of surfaces as functions of the query and the surface."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.nearest.target import ProvenFeet
from jhd._distance.normalization.host_callback import from_host
from jhd._distance.search.bodies import body_of, target_of
from jhd._results.solution import RESULTS, Projection, on_device, unchecked
from jhd._runtime.arrays import is_traced, is_tracing, undifferentiated
from jhd._shapes.as_shape import Shape
from jhd._shapes.checks import Numbers, checked_points
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.patch import AbstractPatch
from jhd._shapes.prepared import working

# How an answer from the host ended.
_ENDS = (
    RESULTS.successful,
    RESULTS.many_nearest_points,
    RESULTS.existence_not_certified,
    RESULTS.nonfinite_value,
    RESULTS.empty_surface,
)


def project_on_surface(points: Numbers, shape: AbstractPatch | ImplicitSurface) -> Projection:
    """Return the nearest points of a parametric or implicit surface; see jhd.project.

    Raises:
        TypeError: points that are not real numbers.
        ValueError: points that are not finite, empty, or not in space; a surface without points in its box.
    """
    queries = checked_points(points)
    batch, still = queries.shape[:-1], undifferentiated((queries, shape))
    # Inside jit all operations are traced, also on known numbers.
    if is_tracing(still):
        found = _traced(still[0].reshape(-1, 3), working(still[1]))
    else:
        found = _projection(*_ended(target_of(still[1]).nearest(np.asarray(still[0]).reshape(-1, 3))))
    found = _with_derivatives(found, queries, shape)
    return on_device(jax.tree_util.tree_map(lambda x: x.reshape((*batch, *x.shape[1:])), found))


def _with_derivatives(found: Projection, points: Array, shape: Shape) -> Projection:
    if not is_traced(points, shape):
        return found
    return body_of(working(shape)).with_foot_derivatives(on_device(found), points.reshape(-1, points.shape[-1]))


def proven_with_derivatives(found: Any, points: Array, shape: Shape) -> Array:
    """Return the distances found, differentiable in the points and in the shape."""
    return _with_derivatives(on_device(_projection(*_ended(found))), points, shape).distance


def _traced(points: Array, surface: Any) -> Projection:
    """Return `_answer` from inside a compiled function."""
    count, dtype = points.shape[0], points.dtype
    numbers = jax.ShapeDtypeStruct((count,), dtype)
    wide = lambda *n: jax.ShapeDtypeStruct((count, *n), dtype)  # noqa: E731
    whole = jax.ShapeDtypeStruct((count,), jnp.int32)
    t = wide(*body_of(surface).parameters)
    like = (numbers, numbers, numbers, wide(3), whole, t, whole)
    return _projection(*from_host(_answer, like, points, surface, rows=True))


def _projection(*parts: Any) -> Projection:
    """Return the projection from its fields; the last field is a number for the result of each query.

    Known numbers stay on the host.
    """
    *numbers, end = parts
    xp: Any = jnp if is_traced(parts) else np
    result = jax.tree_util.tree_map(lambda *x: xp.stack(x)[end], *_ENDS)
    numbers[4] = numbers[4].astype(jnp.result_type(int))
    names = "distance", "lower", "upper", "foot", "element", "t", "result"
    return unchecked(Projection, dict(zip(names, (*numbers, result), strict=True)))


def _ended(found: ProvenFeet) -> tuple[np.ndarray, ...]:
    """Return the fields of the feet, and a number for the result of each query."""
    return *found[:6], np.where(found.closed, 0, np.where(np.isfinite(found.upper), 1, 2))


def _answer(points: np.ndarray, surface: Any) -> tuple[np.ndarray, ...]:
    """Return the fields of a projection, and a number for the result of each query."""
    count, dtype = len(points), points.dtype
    nothing, end = np.zeros(count, dtype), np.full(count, 3)
    sizes = body_of(surface).parameters
    t = np.full((count, *sizes), 0.0 if sizes else np.nan, dtype)
    unknown = (nothing + np.inf, nothing, nothing + np.inf, np.full((count, 3), np.nan, dtype), np.full(count, -1), t)
    if not usable(surface):
        return *unknown, end
    try:
        target = target_of(surface)
    except ValueError:
        return *unknown, np.full(count, 4)
    good = np.all(np.isfinite(points), axis=1)
    found = target.nearest(np.where(good[:, None], points, 0.0))
    *known, end = _ended(found)
    wide = [np.where(good.reshape(-1, *[1] * (np.ndim(x) - 1)), x, y) for x, y in zip(known, unknown, strict=True)]
    return *wide, np.where(good, end, 3)


def usable(surface: Any) -> bool:
    """Return whether the numbers of a shape are valid."""
    return body_of(surface).is_usable()
