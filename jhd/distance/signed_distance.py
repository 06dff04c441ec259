"""Signed distances to triangle meshes: negative inside, by winding number or by normals at the nearest point.

The winding number needs no closed mesh and forgives self-intersections and wrong triangles; it is the default. The
pseudonormal at the foot is exact for closed meshes without self-intersections, and wrong for others. The published
average of the normals at the foot, without weights, is wrong at some sharp vertices too, and there for comparison.

Sources: Jacobson et al. 2013 and Barill et al. 2018 (see jhd.triangles.winding); Baerentzen & Aanaes, Signed distance
computation using the angle weighted pseudonormal (2005); the average: Lin03 ("3-D signed Euclidean distance transform
and its applications", 2003), section 3, detail 3.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._results.solution import Projection
from jhd._runtime.arrays import is_traced, undifferentiated
from jhd.arithmetic.scaling import common_exponent, ldexp
from jhd.distance.nearest.meshes import checked_points
from jhd.distance.published.vertex_voxels import VertexVoxels
from jhd.distance.witness.mesh_feet import project_on_mesh
from jhd.shapes.as_shape import check_rows_first, taken_as
from jhd.shapes.checks import Numbers
from jhd.shapes.mesh import TriangleMesh, check_mesh
from jhd.triangles.closest_point import ClosestPoints
from jhd.triangles.pseudonormal import is_behind
from jhd.triangles.winding import is_inside, summed_angles

_SIGNS = ("winding", "pseudonormal", "average")


def signed_distance(
    points: Numbers, mesh: Any, sign: str | None = None, *, method: VertexVoxels | None = None
) -> Array:
    """Distances to the surface of a mesh, negative inside; differentiable in the points and in the vertices, twice.

    The sign is certain where the point is off the surface by more than rounding: the winding number is recomputed
    until its error cannot change the answer. Under jit the number is summed over all triangles, without a bound.

    Args:
        points: queries (..., 3); the batch shape is kept.
        mesh: the surface, or what jhd.as_shape takes for it. Which way round its triangles run does not matter where
            all agree.
        sign: "winding": inside is where the winding number is at least 1/2 in absolute value, also for meshes with
            holes; "pseudonormal": the side of the angle-weighted normal at the nearest point, for closed meshes
            without self-intersections, which are not looked for; not under jit; "average": the same with all triangles
            at a vertex counted alike, as published, so that it can be wrong where the nearest point is a vertex. By
            default "winding", with VertexVoxels "average".
        method: None for the exact search; VertexVoxels() for the published one, whose distances can be too large, and
            whose signs rest on the point found.

    Raises:
        TypeError: points that are not real numbers, another shape than a mesh, another method, or normals of a traced
            mesh.
        ValueError: points that are not finite, empty, or not in space; an unknown sign; normals at the nearest point of
            a mesh that is not closed and consistently oriented; a grid of VertexVoxels beyond its capacity.
    """
    check_rows_first("signed_distance", points)
    mesh = taken_as("mesh", mesh)
    check_mesh("mesh", mesh)
    sign = ("winding" if method is None else "average") if sign is None else sign
    if sign not in _SIGNS:
        raise ValueError(f"sign is {sign!r}; needs one of {', '.join(map(repr, _SIGNS))}.")
    queries = checked_points(points)
    found = project_on_mesh(queries, mesh, method)
    fixed, still, foot = undifferentiated((queries, mesh, found))
    if sign != "winding":
        inside = _beyond(fixed, foot, still, sign)
    elif is_traced(fixed, still):
        inside = _wound(fixed.reshape(-1, 3), still)
    else:
        # Points of which no distance is proven are decided one by one.
        near = _flat(foot, fixed.ndim - 1) if method is None else None
        inside = is_inside(still, np.asarray(fixed).reshape(-1, 3), near)
    inside = jnp.asarray(inside).reshape(queries.shape[:-1])
    return jnp.where(inside, -found.distance, found.distance)


def _flat(found: Projection, axes: int) -> ClosestPoints:
    """The same nearest points in one row, on the host."""
    fields = (found.distance, found.lower, found.upper, found.foot, found.segment, found.t)
    return ClosestPoints(*(np.asarray(x).reshape(-1, *x.shape[axes:]) for x in fields))


def _wound(points: Array, mesh: TriangleMesh) -> Array:
    corners = mesh.corners if is_traced(mesh) else np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    power = common_exponent(corners, points)
    return jnp.abs(summed_angles(ldexp(corners, -power), ldexp(points, -power))) >= 0.5


def _beyond(points: Array, found: Projection, mesh: TriangleMesh, sign: str) -> np.ndarray:
    """Whether each point is on the inner side of the normal at its foot.

    Raises:
        TypeError: traced points or a traced mesh.
        ValueError: a mesh that is not closed, or not consistently oriented.
    """
    if is_traced(points, mesh):
        raise TypeError(f"sign={sign!r} needs known points and a known mesh; under jit take sign='winding'.")
    triangle, t = np.asarray(found.segment).reshape(-1), np.asarray(found.t).reshape(-1, 3)
    return is_behind(mesh, np.asarray(points).reshape(-1, 3), triangle, t, sign)
