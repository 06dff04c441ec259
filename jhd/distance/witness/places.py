"""Derivatives of directed distances of shapes of any two kinds, of first order.

From a set of points the farthest one has one foot, and the derivative is that of its nearest point. Else the value is
sum m_k |p - q_k| for the farthest place p, its feet q_k and their multipliers m_k, and by the envelope theorem its
derivative is that of the points p and q_k at fixed parameters; those of a polynomial surface move along the normal with
the polynomial, and with the faces of the box that hold them.
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


def with_place_derivatives(solution: HausdorffSolution, a: Any, b: Any) -> HausdorffSolution:
    """A distance from a to b, its value, point and feet differentiable in both.

    Args:
        solution: the distance; its witness lies on a.
        a: points, BezierSegments, BezierPatches, an ImplicitSurface or a TriangleMesh.
        b: likewise.
    """
    if not is_traced(a, b):
        return solution
    if isinstance(a, BezierSegments) and a.degree == 0 and not _is_curve(b):
        return _from_points(solution, a.control_points[:, 0], b)
    w = solution.witness
    # Where nothing is proven there is no place; its derivatives are not used, but they must be numbers.
    point, feet, t, params, multipliers = (
        jnp.where(jnp.isfinite(x), x, 0.0) for x in (w.point, w.feet, w.t, w.foot_params, w.multipliers)
    )
    apart = jax.lax.stop_gradient(point - feet)
    distance = length(apart)[:, None]
    unit = apart / jnp.where(distance > 0, distance, 1.0)
    place = _moving(a, w.segment, t, point)
    moving = jax.vmap(lambda k, s, x: _moving(b, k, s, x))(w.foot_segments, params, feet)
    value = jnp.sum(multipliers[:, None] * unit * (place - moving))
    return _with(solution, value, place, moving)


def _is_curve(shape: Any) -> bool:
    return isinstance(shape, BezierSegments) and shape.degree > 0


def _moving(shape: Any, segment: Array, t: Array, at: Array) -> Array:
    """A point of a shape as a function of the shape."""
    index = jnp.maximum(segment, 0)
    if isinstance(shape, ImplicitSurface):
        return moving_point(shape.coefficients, jnp.stack(shape.box()), at)
    if isinstance(shape, TriangleMesh):
        return jnp.sum(t[:, None] * shape.vertices[shape.triangles[index]], axis=0)
    if isinstance(shape, BezierPatches):
        return jet(Net(shape.control_points, shape.weights).piece(index), t).point
    weights = None if shape.weights is None else shape.weights[:, :, None]
    return jet(Net(shape.control_points[:, :, None], weights).piece(index), t[None]).point


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


def _with(solution: HausdorffSolution, value: Array, point: Array, feet: Array) -> HausdorffSolution:
    """The same numbers, with the derivatives of these."""
    solution = replace(solution, witness=attached(solution.witness, point=point, feet=feet))
    return attached(solution, solution.value > 0, value=value)
