"""Distances to one shape at points along another, scaled so that their squares are normal numbers."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import smallest_normal
from jhd._arithmetic.scaling import common_exponent, scale_of
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.nets import net_of
from jhd._distance.project import project
from jhd._distance.search.bodies import body_of
from jhd._distance.search.body import dtype_of
from jhd._distance.statistics.pointwise import Sight, told_from_zero
from jhd._distance.statistics.quadrature import along, nodes_of, resolved
from jhd._distance.statistics.surface_quadrature import resolved_on_surface
from jhd._runtime.arrays import array_of, is_traced, undifferentiated


class Along(NamedTuple):
    """Distances to `b` at points along `a`."""

    distance: Array  # the distances, differentiable in both shapes
    weight: Array  # the weight of each point, differentiable in `a`
    off: float  # bound of the relative error of derivatives of sums


def distances_along(a: Any, b: Any, weights: Any, nodes: int | None) -> tuple[float, Along]:
    """Return distances at points along a, times a power of two so that squares are normal numbers, and this power."""
    scale = common_scale(a, b)
    if body_of(a).dimension == 0:
        points = a.segments().control_points[:, 0]
        counts = jnp.ones(len(points)) if weights is None else jnp.asarray(weights / np.max(undifferentiated(weights)))
        found = project(points, b, throw=False)
        distance = jnp.where(told_from_zero(found, scale), found.distance * scale, 0.0)
        return scale, Along(distance, counts, 0.0)
    net, sight = scaled_net(a, scale), Sight(b, scale, is_traced(a, b))
    known = undifferentiated(net)
    found = None
    if nodes is None and net.parameters == 2:
        found = resolved_on_surface(known, sight)
    if found is None:
        cells, count, left = resolved(known, sight.at, nodes)
        found = nodes_of(cells, count), left if net.parameters == 1 else np.inf
    rule, off = found
    points, density, _ = along(net, rule)
    return scale, Along(sight.moving(points, b), jnp.asarray(rule.factor) * density, off)


def scaled_net(a: Any, scale: float) -> Net:
    """Return the pieces of a times the power of two, differentiable."""
    net = net_of(a)
    return Net(array_of(net.points * scale), None if net.weights is None else array_of(net.weights))


def common_scale(a: Any, b: Any) -> float:
    """Return the power of two that brings the coordinates of both shapes to about one."""
    boxes = [np.asarray(end) for shape in undifferentiated((a, b)) for end in shape.bounds]
    return float(scale_of(common_exponent(*boxes), boxes[0].dtype))


def check_size(a: Any, b: Any) -> None:
    """Raise ValueError if subnormal numbers, which compiled functions take for zero, would affect an estimate."""
    largest = max(float(np.max(np.abs(np.asarray(end)))) for x in undifferentiated((a, b)) for end in x.bounds)
    # The largest coordinate is at least this many times the smallest normal number: flushed numbers are then below a
    # ten-millionth of it, less than the error of estimates.
    least = 2**24 * smallest_normal(dtype_of(a))
    if 0 < largest < least:
        raise ValueError(f"coordinates are at most {largest:.2g}, too small for an estimate; scale both shapes.")
