"""Point sets as degenerate triangles, and the points of a set that may be nearest to a shape."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jhd._distance.search.closest_triangles import as_mesh
from jhd._distance.search.targets import target_of
from jhd._runtime.arrays import undifferentiated
from jhd._shapes.curve import BezierSegments


def is_points(shape: Any) -> bool:
    """Return whether a shape is a set of points."""
    return isinstance(shape, BezierSegments) and shape.degree == 0


def point_mesh(points: BezierSegments) -> Any:
    """Return a set of points as degenerate triangles; points of the plane lie at height zero."""
    rows = points.control_points
    rows = rows if points.dim == 3 else jnp.concatenate([rows, jnp.zeros_like(rows[..., :1])], axis=-1)
    return as_mesh(BezierSegments(rows))


def nearest_points(points: Any, shape: Any) -> Any:
    """Return the points that may be nearest to a shape: all others are proven to be farther than one of them.

    Args:
        points: a set of points, its numbers known; it may be differentiated.
        shape: points, a TriangleMesh, BezierPatches or an ImplicitSurface, its numbers known as well.
    """
    rows = np.asarray(undifferentiated(points).control_points)[:, 0]
    target: Any = target_of(undifferentiated(shape))
    if target.sharp:
        found = target.nearest(rows)
        return BezierSegments(points.control_points[np.flatnonzero(found.lower <= found.upper.min())])
    upper = float(np.min(target.feet(rows)))
    near = np.flatnonzero(target.within(rows, upper)) if np.isfinite(upper) else np.arange(len(rows))
    return BezierSegments(points.control_points[near])
