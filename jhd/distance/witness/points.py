"""Derivatives of Hausdorff distances with a set of points on one side, of first order.

From a set of points the farthest one has one foot, and the derivative is that of its nearest point. To a set of points
the place on the surface keeps its parameters, or moves along the normal with the polynomial and with the faces of the
box that hold it, and the feet are weighted by the multipliers.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic.scaling import length
from jhd.arrays import is_traced
from jhd.distance.frame.attach import attached
from jhd.distance.frame.net_jets import Net, jet
from jhd.distance.witness.mesh_feet import foot_on
from jhd.distance.witness.surface_projection import moving_point, with_patch_derivatives, with_surface_derivatives
from jhd.shapes.curve import BezierSegments
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import BezierPatches
from jhd.solution import HausdorffSolution, Projection


def with_point_derivatives(solution: HausdorffSolution, a: Any, b: Any) -> HausdorffSolution:
    """A distance from a to b, its value, point and feet differentiable in both.

    Args:
        solution: the distance; its witness lies on a.
        a: points, or BezierPatches or an ImplicitSurface where b is points.
        b: any shape, or points.
    """
    if not is_traced(a, b):
        return solution
    if isinstance(a, BezierSegments):
        return _from_points(solution, a.control_points[:, 0], b)
    return _to_points(solution, a, b.control_points[:, 0])


def _from_points(solution: HausdorffSolution, points: Array, b: Any) -> HausdorffSolution:
    w = solution.witness
    query = points[jnp.maximum(w.segment, 0)]
    first = lambda x: x[:1]  # noqa: E731
    result = jax.tree_util.tree_map(lambda x: jnp.asarray(x)[None], solution.result)
    alone = solution.value[None]
    found = Projection(alone, alone, alone, first(w.feet), first(w.foot_segments), first(w.foot_params), result)
    if isinstance(b, TriangleMesh):
        corners = b.vertices[b.triangles[w.foot_segments[0]]]
        distance, foot, _ = foot_on(query, corners, w.foot_params[0] > 0)
        found = replace(found, distance=distance[None], foot=foot[None])
    elif isinstance(b, BezierPatches):
        found = with_patch_derivatives(found, query[None], Net(b.control_points, b.weights))
    elif isinstance(b, ImplicitSurface):
        found = with_surface_derivatives(found, query[None], b)
    else:
        foot = b.control_points[w.foot_segments[0], 0]
        distance = length(query - foot)
        found = replace(found, distance=distance[None], foot=foot[None])
    feet = jnp.broadcast_to(found.foot, w.feet.shape)
    return _with(solution, found.distance[0], query, feet)


def _to_points(solution: HausdorffSolution, a: Any, points: Array) -> HausdorffSolution:
    w = solution.witness
    feet = points[w.foot_segments]
    # Where nothing is proven there is no place; its derivatives are not used, but they must be numbers.
    t, at, multipliers = (jnp.where(jnp.isfinite(x), x, 0.0) for x in (w.t, w.point, w.multipliers))
    apart = jax.lax.stop_gradient(at - jnp.where(jnp.isfinite(w.feet), w.feet, 0.0))
    distance = length(apart)[:, None]
    unit = apart / jnp.where(distance > 0, distance, 1.0)
    if isinstance(a, BezierPatches):
        net = Net(a.control_points, a.weights)
        place = jet(net.piece(jnp.maximum(w.segment, 0)), t[: net.parameters]).point
    else:
        place = moving_point(a.coefficients, jnp.stack(a.box()), at)
    value = jnp.sum(multipliers[:, None] * unit * (place - feet))
    return _with(solution, value, place, feet)


def _with(solution: HausdorffSolution, value: Array, point: Array, feet: Array) -> HausdorffSolution:
    """The same numbers, with the derivatives of these."""
    solution = replace(solution, witness=attached(solution.witness, point=point, feet=feet))
    return attached(solution, solution.value > 0, value=value)
