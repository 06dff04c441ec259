"""Signed distances to triangle meshes: negative inside, by winding number or by normals at the nearest point.

The winding number is the default: it needs no closed mesh, and tolerates self-intersections and wrong triangles.

Sources: Jacobson et al. 2013 and Barill et al. 2018 (see jhd._triangles.winding); Baerentzen & Aanaes, Signed distance
computation using the angle weighted pseudonormal (2005); the average: Lin03 ("3-D signed Euclidean distance transform
and its applications", 2003), section 3, detail 3.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.scaling import common_exponent, ldexp
from jhd._distance.published.vertex_voxels import VertexVoxels
from jhd._distance.witness.mesh_feet import project_on_mesh
from jhd._results.solution import Projection
from jhd._runtime.arrays import is_traced, one_of, undifferentiated
from jhd._shapes.as_shape import ShapeLike, check_rows_first, taken_as
from jhd._shapes.checks import Numbers, checked_points
from jhd._shapes.mesh import TriangleMesh, check_mesh
from jhd._triangles.closest_point import ClosestPoints
from jhd._triangles.pseudonormal import is_behind
from jhd._triangles.winding import is_inside, summed_angles

_SIGNS = ("winding", "pseudonormal", "average")


def signed_distance(
    points: Numbers, mesh: ShapeLike, sign: str | None = None, *, method: VertexVoxels | None = None
) -> Array:
    """Signed distances from points to a mesh, negative inside; differentiable twice in the points and in the vertices.

    The sign is certain if the point is off the surface by more than rounding: the winding number is recomputed until
    its error cannot change the answer. Under jit the winding number is summed over all triangles, without an error
    bound.

    >>> import jhd
    >>> corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    >>> mesh = jhd.TriangleMesh(corners, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])
    >>> jhd.signed_distance([(0.25, 0.25, 0.125), (0.25, 0.25, -2)], mesh).round(9).tolist()
    [-0.125, 2.0]

    Args:
        points: query points (..., 3). The result keeps the batch shape.
        mesh: the surface, or an object that `jhd.as_shape` accepts. The orientation does not matter if all triangles
            agree.
        sign: how the sign is found; by default "winding", with VertexVoxels "average".
            "winding": inside if the winding number is at least 1/2 in absolute value, also for meshes with holes.
            "pseudonormal": the side of the angle-weighted normal at the nearest point, outside jit, for closed meshes
            without self-intersections (not checked).
            "average": like "pseudonormal" without weights at a vertex, as published; it can be wrong at vertices.
        method: None for the exact search. VertexVoxels() is the published search: its distances can be too large, and
            its signs rest on the point found.

    Returns:
        The signed distances (...), in the unit of the coordinates.

    Raises:
        TypeError: points that are not real numbers, a shape that is not a mesh, another method, or normals of a traced
            mesh.
        ValueError: points that are not finite, that are empty, or not in space; an unknown sign; normals of a mesh that
            is not closed and consistently oriented; a grid of VertexVoxels above its capacity.
    """
    check_rows_first("signed_distance", points)
    target = taken_as("mesh", mesh)
    check_mesh("mesh", target)
    sign = ("winding" if method is None else "average") if sign is None else sign
    one_of("sign", sign, _SIGNS)
    queries = checked_points(points)
    found = project_on_mesh(queries, target, method)
    fixed, still, foot = undifferentiated((queries, target, found))
    if sign != "winding":
        inside = _beyond(fixed, foot, still, sign)
    elif is_traced(fixed, still):
        inside = _wound(fixed.reshape(-1, 3), still)
    else:
        # Points without a proven distance are decided one by one.
        near = _flat(foot, fixed.ndim - 1) if method is None else None
        inside = is_inside(still, np.asarray(fixed).reshape(-1, 3), near)
    inside = jnp.asarray(inside).reshape(queries.shape[:-1])
    return jnp.where(inside, -found.distance, found.distance)


def _flat(found: Projection, axes: int) -> ClosestPoints:
    """Return the nearest points in one row, on the host."""
    fields = (found.distance, found.lower, found.upper, found.foot, found.element, found.t)
    return ClosestPoints(*(np.asarray(x).reshape(-1, *x.shape[axes:]) for x in fields))


def _wound(points: Array, mesh: TriangleMesh) -> Array:
    corners = mesh.corners if is_traced(mesh) else np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    power = common_exponent(corners, points)
    return jnp.abs(summed_angles(ldexp(corners, -power), ldexp(points, -power))) >= 0.5


def _beyond(points: Array, found: Projection, mesh: TriangleMesh, sign: str) -> np.ndarray:
    """Return whether each point is on the inner side of the normal at its foot.

    Raises:
        TypeError: traced points or a traced mesh.
        ValueError: a mesh that is not closed, or not consistently oriented.
    """
    if is_traced(points, mesh):
        raise TypeError(f"sign={sign!r} needs concrete points and a concrete mesh; under jit use sign='winding'.")
    triangle, t = np.asarray(found.element).reshape(-1), np.asarray(found.t).reshape(-1, 3)
    return is_behind(mesh, np.asarray(points).reshape(-1, 3), triangle, t, sign)
