"""Derivatives of distances of shapes of any two kinds, by the conditions of jhd._distance.witness.balance."""

from dataclasses import replace
from functools import singledispatch
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.normalization.implicit_derivatives import MovingNumbers, TouchedRows, following
from jhd._distance.normalization.net_jets import Net
from jhd._distance.witness.balance import finite, from_pair, from_place
from jhd._distance.witness.nets import from_nets
from jhd._distance.witness.rows import CornerRows, NetRows, Polynomial
from jhd._results.solution import DIRECTIONS, HausdorffSolution, MinimumSolution, Witness
from jhd._runtime.arrays import is_traced
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh


def with_place_derivatives(solution: HausdorffSolution, a: Any, b: Any) -> HausdorffSolution:
    """Return a distance from a to b with value, point and feet differentiable in both shapes, twice.

    If several points are equally far, the derivative belongs to the witness returned: it is one of the generalized
    derivatives of the maximum. At distance zero all derivatives are zero by convention.

    Args:
        solution: the distance. Its witness lies on a, or on either of two meshes or of two implicit surfaces.
        a: points, BezierSegments, BezierPatches, an ImplicitSurface or a TriangleMesh.
        b: a shape of these kinds.
    """
    if not is_traced(a, b):
        return solution
    w, function = solution.witness, from_place
    parts = _rows_of(a, w.element), _rows_of(b, w.feet_elements)
    if parts[0].axes == 0 and parts[1].axes != 1:
        function = _from_point
    if type(a) is type(b) and parts[0].has_constraint:
        parts, function = (parts, (_rows_of(b, w.element), _rows_of(a, w.feet_elements))), _from_either
    found = {"value": solution.value, "point": w.point, "feet": w.feet}
    moved = following(function, found, parts, (solution.value, w))
    return replace(solution, value=moved["value"], witness=replace(w, point=moved["point"], feet=moved["feet"]))


def _from_either(rows: tuple[tuple[Any, Any], tuple[Any, Any]], constants: tuple[Array, Witness]) -> MovingNumbers:
    """Return the numbers of the distance from a to b or from b to a, depending on the witness."""
    turned = constants[1].direction == DIRECTIONS.b_to_a

    def chosen(x: Array, y: Array) -> Array:
        shape = [max(sizes) for sizes in zip(x.shape, y.shape, strict=True)]
        x, y = (jnp.pad(z, [(0, n - m) for n, m in zip(shape, z.shape, strict=True)]) for z in (x, y))
        return jnp.where(turned, y, x)

    return from_place(jax.tree_util.tree_map(chosen, *rows), constants)


def _from_point(rows: tuple[NetRows, Any], constants: tuple[Array, Witness]) -> MovingNumbers:
    """Return the numbers of `from_place` for a point: the distance and foot of its nearest point."""
    (carrier, target), (found, w) = finite((rows, constants))
    query = carrier.points[0]
    distance, foot = target.nearest(query, w)
    numbers = {"value": distance, "point": query, "feet": jnp.broadcast_to(foot, w.feet.shape)}
    return MovingNumbers(numbers, {"value": found > 0, "point": True, "feet": True})


def with_pair_derivatives(
    solution: MinimumSolution, shapes: tuple[Any, ...], pieces: tuple[Any, Any], x: Any, distance: Any
) -> MinimumSolution:
    """Return a minimum distance with value and, for nets, nearest points differentiable in both shapes, twice.

    Args:
        solution: the distance.
        shapes: nets or implicit surfaces.
        pieces: the pieces that hold the nearest points.
        x: the coordinates of both points, one after the other.
        distance: the value in common coordinates, see jhd._distance.witness.balance.apart.
    """
    if not is_traced(shapes):
        return solution
    found, function = {"value": solution.value}, from_pair
    parts = _rows_of(shapes[0], pieces[0]), _rows_of(shapes[1], pieces[1])
    if not any(part.has_normals for part in parts):
        found, function = found | {"point_a": solution.point_a, "point_b": solution.point_b}, from_nets
    return replace(solution, **following(function, found, parts, (solution, x, distance)))


@singledispatch
def _rows_of(shape: Any, index: Array) -> Any:
    """Return the rows of a shape that one or several of its points depend on."""
    return _rows_of(Net(shape.control_points, shape.weights), index)


@_rows_of.register
def _(shape: Net, index: Array) -> NetRows:
    points, weights = (None if x is None else TouchedRows(x, index) for x in shape)
    sizes = shape.points.shape[1:-1]
    return NetRows(points, weights, 0 if sizes == (1,) else len(sizes))


_rows_of.register(TriangleMesh, lambda shape, index: CornerRows(TouchedRows(shape.vertices, index, shape.triangles)))
_rows_of.register(
    ImplicitSurface, lambda shape, _: Polynomial(TouchedRows(shape.coefficients), *map(TouchedRows, shape.bounds))
)
