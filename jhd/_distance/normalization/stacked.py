"""Ragged curves as one batch: raised to one degree and one number of segments, stacked along a leading axis."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jhd._arithmetic.scaling import unit_weights
from jhd._distance.normalization.curves import elevation_matrix, padded_count, raised
from jhd._runtime.arrays import array_of, is_traced, on_host
from jhd._shapes.as_shape import ShapeLike, check_several, taken_as
from jhd._shapes.curve import BezierSegments, check_curve
from jhd._shapes.joints import linked
from jhd._shapes.unchecked import trusted


def stack_curves(curves: Sequence[ShapeLike]) -> BezierSegments:
    """One batch of curves of any degrees and numbers of segments, for vmap and jit.

    Each curve is raised to the largest degree. This rounds its control points by a few units in the last place; curves
    of this degree are unchanged. The last segment is then repeated, which does not change the point set, to 4, 16, 48,
    96, ... segments, so that compiled functions serve more than one batch. If any curve is rational, all curves get
    weights (1 for polynomial ones).

    >>> import jhd
    >>> jhd.stack_curves([jhd.polyline([(0, 0), (1, 0)]), jhd.circle((0, 0), 1)]).control_points.shape
    (2, 4, 3, 2)

    Args:
        curves: a sequence of curves of one dimension, or of objects that `jhd.as_shape` accepts. Traced curves are
            allowed, and the batch is differentiable in them.

    Returns:
        BezierSegments with a leading axis: `control_points` (curves, segments, points, dim), `weights` and
        `next_segment`.

    Raises:
        TypeError: an object that is not a curve.
        ValueError: no curves, or curves of the plane and of space.
    """
    check_several("curves", curves)
    rows = [_segments(k, curve) for k, curve in enumerate(curves)]
    if not rows:
        raise ValueError("curves is empty; needs at least one.")
    other = next((k for k, row in enumerate(rows) if row.dim != rows[0].dim), None)
    if other is not None:
        raise ValueError(
            f"curves[{other}] has {rows[other].dim} coordinates a point and curves[0] has {rows[0].dim}; "
            "needs the same."
        )
    degree, count = max(row.degree for row in rows), padded_count(max(row.count for row in rows), small=True)
    rational = any(row.weights is not None for row in rows)
    traced = is_traced(rows)
    alike = [_alike(row, degree, count, rational, jnp if traced else np) for row in rows]
    stacked = jax.tree_util.tree_map(lambda *x: (jnp if traced else np).stack(x), *alike)
    return jax.tree_util.tree_map(array_of, stacked)


def _segments(k: int, curve: Any) -> BezierSegments:
    shape = taken_as(f"curves[{k}]", curve)
    check_curve(f"curves[{k}]", shape)
    return shape.segments()


def _alike(curve: BezierSegments, degree: int, count: int, rational: bool, xp: Any) -> BezierSegments:
    points = xp.asarray(curve.control_points)
    weights: Any = None
    if rational:
        weights = xp.ones(points.shape[:-1], points.dtype) if curve.weights is None else xp.asarray(curve.weights)
    if degree > curve.degree:
        # Scaled, so that products with coordinates neither overflow nor vanish.
        weights = None if weights is None else unit_weights(weights)
        points, weights = raised(elevation_matrix(curve.degree, degree).astype(points.dtype), points, weights)
    index = np.minimum(np.arange(count), curve.count - 1)
    (next_segment,) = on_host(curve.next_segment)
    return trusted(points[index], None if weights is None else weights[index], array_of(linked(next_segment[index])))
