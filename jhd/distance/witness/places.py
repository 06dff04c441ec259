"""Derivatives of directed distances of shapes of any two kinds, of first order.

From a set of points the farthest one has one foot, and the derivative is that of its nearest point. Else the value is
sum m_k |p - q_k| for the farthest place p, its feet q_k and their multipliers m_k, and by the envelope theorem its
derivative is that of the points p and q_k at fixed parameters; those of a polynomial surface move along the normal with
the polynomial, and with the faces of the box that hold them.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic.scaling import length
from jhd.arrays import is_traced
from jhd.distance.frame.following import MovingNumbers, TouchedRows, following
from jhd.distance.frame.net_jets import Net, jet
from jhd.distance.witness.mesh_feet import foot_on
from jhd.distance.witness.surface_projection import distance_from_surface, distances_from_patches, moving_point
from jhd.shapes.curve import BezierSegments
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.solution import HausdorffSolution, Witness


class NetRows(NamedTuple):
    """Segments or patches, of which each has one set of control points, and of weights where there are any."""

    points: Any
    weights: Any


class PointRows(NamedTuple):
    """Points of a set."""

    points: Any


class CornerRows(NamedTuple):
    """Corners of triangles."""

    corners: Any


class Polynomial(NamedTuple):
    """A polynomial surface."""

    coefficients: Any
    lower: Any
    upper: Any


def with_place_derivatives(solution: HausdorffSolution, a: Any, b: Any) -> HausdorffSolution:
    """A distance from a to b, its value, point and feet differentiable in both.

    Args:
        solution: the distance; its witness lies on a.
        a: points, BezierSegments, BezierPatches, an ImplicitSurface or a TriangleMesh.
        b: likewise.
    """
    if not is_traced(a, b):
        return solution
    w = solution.witness
    from_points = _is_points(a) and not (isinstance(b, BezierSegments) and b.degree > 0)
    parts = parts_of(a, w.segment), parts_of(b, w.foot_segments)
    found = {"value": solution.value, "point": w.point, "feet": w.feet}
    moved = following(_from_point if from_points else _from_place, found, parts, (solution.value, w))
    return replace(solution, value=moved["value"], witness=replace(w, point=moved["point"], feet=moved["feet"]))


def _is_points(shape: Any) -> bool:
    return isinstance(shape, BezierSegments) and shape.degree == 0


def parts_of(shape: Any, index: Array) -> Any:
    """What a place, or several of them, hang on."""
    if isinstance(shape, ImplicitSurface):
        return Polynomial(TouchedRows(shape.coefficients), *map(TouchedRows, shape.box()))
    if isinstance(shape, TriangleMesh):
        return CornerRows(TouchedRows(shape.vertices, index, shape.triangles))
    if _is_points(shape):
        return PointRows(TouchedRows(shape.control_points, index))
    return NetRows(
        TouchedRows(shape.control_points, index), None if shape.weights is None else TouchedRows(shape.weights, index)
    )


def _from_place(rows: tuple[Any, Any], constants: tuple[Array, Witness]) -> MovingNumbers:
    """Value, point and feet by the envelope theorem."""
    (carrier, target), (found, w) = rows, constants
    # Where nothing is proven there is no place; its derivatives are not used, but they must be numbers.
    point, feet, t, params, multipliers = (
        jnp.where(jnp.isfinite(x), x, 0.0) for x in (w.point, w.feet, w.t, w.foot_params, w.multipliers)
    )
    apart = point - feet
    distance = length(apart)[:, None]
    unit = apart / jnp.where(distance > 0, distance, 1.0)
    place = moving_place(carrier, t, point)
    if isinstance(target, Polynomial):
        moving = jax.vmap(lambda x: moving_place(target, None, x))(feet)
    else:
        moving = jax.vmap(moving_place)(target, params, feet)
    value = jnp.sum(multipliers[:, None] * unit * (place - moving))
    return MovingNumbers({"value": value, "point": place, "feet": moving}, {"value": found > 0})


def moving_place(rows: Any, t: Any, at: Array) -> Array:
    """A point of a shape as a function of the rows that it hangs on."""
    if isinstance(rows, Polynomial):
        return moving_point(rows.coefficients, jnp.stack([rows.lower, rows.upper]), at)
    if isinstance(rows, CornerRows):
        return jnp.sum(t[:, None] * rows.corners, axis=0)
    if isinstance(rows, PointRows):
        return rows.points[0]
    return jet(_net(rows), jnp.atleast_1d(t)).point


def _net(rows: NetRows) -> Net:
    """The piece, with one column where it is that of a curve."""
    if rows.points.ndim == 3:
        return Net(rows.points, rows.weights)
    return Net(rows.points[:, None], None if rows.weights is None else rows.weights[:, None])


def _from_point(rows: tuple[PointRows, Any], constants: tuple[Array, Witness]) -> MovingNumbers:
    """The same from a point, whose distance and foot are those of its nearest point."""
    (carrier, target), (found, w) = rows, constants
    query = carrier.points[0]
    if isinstance(target, CornerRows):
        distance, foot, _ = foot_on(query, target.corners[0], w.foot_params[0] > 0)
    elif isinstance(target, Polynomial):
        box = jnp.stack([target.lower, target.upper])
        distance, foot = (x[0] for x in distance_from_surface(query[None], w.feet[:1], target.coefficients, box))
    elif isinstance(target, NetRows):
        net, first = Net(target.points, target.weights), jnp.zeros(1, int)
        distance, foot, _ = (x[0] for x in distances_from_patches(query[None], first, w.foot_params[:1], net))
    else:
        foot = target.points[0, 0]
        distance = length(query - foot)
    feet = jnp.broadcast_to(foot, w.feet.shape)
    return MovingNumbers({"value": distance, "point": query, "feet": feet}, {"value": found > 0})
