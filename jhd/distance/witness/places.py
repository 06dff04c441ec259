"""Derivatives of directed distances of shapes of any two kinds.

From a set of points the farthest one has one foot, and the derivative is that of its nearest point. All others are
those of jhd.distance.witness.balance.
"""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from jhd._results.solution import HausdorffSolution, Witness
from jhd._runtime.arrays import is_traced
from jhd.arithmetic.scaling import length
from jhd.distance.frame.following import MovingNumbers, TouchedRows, following
from jhd.distance.frame.net_jets import Net
from jhd.distance.witness.balance import (
    CornerRows,
    NetRows,
    PointRows,
    Polynomial,
    from_place,
)
from jhd.distance.witness.mesh_feet import foot_on
from jhd.distance.witness.surface_projection import distance_from_surface, distances_from_patches
from jhd.shapes.curve import BezierSegments
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh


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
    moved = following(_from_point if from_points else from_place, found, parts, (solution.value, w))
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
    return MovingNumbers(
        {"value": distance, "point": query, "feet": feet}, {"value": found > 0, "point": True, "feet": True}
    )
