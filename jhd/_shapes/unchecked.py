"""Bezier segments from arrays of the right shapes and types, at less cost than by the constructor."""

from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jhd._runtime.arrays import check_finite, is_tracing
from jhd._runtime.jax_internals import to_device
from jhd._shapes.checks import check_control_points
from jhd._shapes.curve import BezierSegments
from jhd._shapes.joints import joints, linked


def segments_of(control_points: Any, weights: Any, next_segment: Any = None) -> BezierSegments:
    """The segments of a curve; see BezierSegments. Ends that agree are joined if `next_segment` is None.

    Raises:
        ValueError: a number is invalid, as after a step of an optimizer (not under tracing).
    """
    if is_tracing(control_points, weights, next_segment):
        return BezierSegments(control_points, weights, next_segment)
    # In the default precision, which may be another than when the curve was made.
    kind = jnp.result_type(float)
    control_points, weights = (None if x is None else np.asarray(x, kind) for x in (control_points, weights))
    check_finite("control_points", control_points)
    if weights is not None:
        check_finite("weights", weights)
        check_control_points(control_points, weights, ("segments", "points", "dim"))
    following = joints(control_points) if next_segment is None else next_segment
    leaves = [x for x in (control_points, weights, linked(following)) if x is not None]
    return jax.tree_util.tree_unflatten(_structure(weights is not None), to_device(leaves))


def trusted(control_points: Any, weights: Any, next_segment: Any) -> BezierSegments:
    """Segments from arrays that need no check; NumPy arrays and tracers are stored as they are, `next_segment` too."""
    leaves = [control_points, next_segment] if weights is None else [control_points, weights, next_segment]
    return jax.tree_util.tree_unflatten(_structure(weights is not None), leaves)


@lru_cache(maxsize=2)
def _structure(rational: bool) -> Any:
    # If first called inside a trace, its operations would become dead code of that trace.
    with jax.ensure_compile_time_eval():
        one = BezierSegments(np.zeros((1, 1, 2)), np.ones((1, 1)) if rational else None)
    return jax.tree_util.tree_structure(one)
