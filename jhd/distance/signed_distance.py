"""Signed distances to triangle meshes: negative inside, by winding number or by pseudonormals.

The winding number needs no closed mesh and forgives self-intersections and wrong triangles; it is the default. The
pseudonormal at the foot is exact for closed meshes without self-intersections, and wrong for others.

Sources: Jacobson et al. 2013 and Barill et al. 2018 (see jhd.fields.winding); Baerentzen & Aanaes, Signed distance
computation using the angle weighted pseudonormal (2005).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from jhd.arrays import is_traced
from jhd.distance.mesh_projection import checked_points, project_on_mesh
from jhd.fields.closest_point import ClosestPoints, kept
from jhd.fields.winding import is_inside, summed_angles
from jhd.shapes.checks import Numbers
from jhd.shapes.mesh import TriangleMesh, check_mesh, edges_of
from jhd.solution import Projection

_SIGNS = ("winding", "pseudonormal")


def signed_distance(points: Numbers, mesh: TriangleMesh, sign: str = "winding") -> Array:
    """Distances to the surface of a mesh, negative inside; differentiable in the points and in the vertices, twice.

    The sign is certain where the point is off the surface by more than rounding: the winding number is recomputed
    until its error cannot change the answer. Under jit the number is summed over all triangles, without a bound.

    Args:
        points: queries (..., 3); the batch shape is kept.
        mesh: the surface. Which way round its triangles run does not matter where all agree.
        sign: "winding": inside is where the winding number is at least 1/2 in absolute value, also for meshes with
            holes; "pseudonormal": the side of the angle-weighted normal at the nearest point, for closed meshes
            without self-intersections, which are not looked for; not under jit.

    Raises:
        TypeError: points that are not real numbers, another shape than a mesh, or pseudonormals of a traced mesh.
        ValueError: points that are not finite, empty, or not in space; an unknown sign; pseudonormals of a mesh that is
            not closed and consistently oriented.
    """
    check_mesh("mesh", mesh)
    if sign not in _SIGNS:
        raise ValueError(f"sign is {sign!r}; needs one of {', '.join(map(repr, _SIGNS))}.")
    queries = checked_points(points)
    found = project_on_mesh(queries, mesh)
    fixed, still, foot = lax.stop_gradient((queries, mesh, found))
    if sign == "pseudonormal":
        inside = _beyond(fixed, foot, still)
    elif is_traced(fixed, still):
        inside = _wound(fixed.reshape(-1, 3), still)
    else:
        inside = is_inside(still, np.asarray(fixed).reshape(-1, 3), _flat(foot, fixed.ndim - 1))
    inside = jnp.asarray(inside).reshape(queries.shape[:-1])
    return jnp.where(inside, -found.distance, found.distance)


def _flat(found: Projection, axes: int) -> ClosestPoints:
    """The same nearest points in one row, on the host."""
    fields = (found.distance, found.lower, found.upper, found.foot, found.segment, found.t)
    return ClosestPoints(*(np.asarray(x).reshape(-1, *x.shape[axes:]) for x in fields))


def _wound(points: Array, mesh: TriangleMesh) -> Array:
    corners = mesh.corners if is_traced(mesh) else np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    size = jnp.maximum((jnp if is_traced(mesh) else np).max(abs(corners)), jnp.max(jnp.abs(points)))
    scale = jnp.where(jnp.isfinite(size) & (size > 0), size, 1.0)
    return jnp.abs(summed_angles(jnp.asarray(corners) / scale, points / scale)) >= 0.5


class _Pseudonormals(NamedTuple):
    """Normals of the faces, edges and corners of every triangle, as long as they happen to be.

    Args:
        face: (triangles, 3).
        edge: of the edges opposite to each corner, (triangles, 3, 3).
        corner: (triangles, 3, 3).
    """

    face: np.ndarray
    edge: np.ndarray
    corner: np.ndarray


def _pseudonormals(mesh: TriangleMesh) -> _Pseudonormals:
    """Sums of the unit normals at each edge, and of those weighted by the angles at each vertex.

    Raises:
        ValueError: a mesh that is not closed, or not consistently oriented.
    """
    if not (mesh.is_closed and mesh.is_manifold):
        needed = "a closed mesh whose triangles run along each edge once either way"
        raise ValueError(f"sign='pseudonormal' needs {needed}; take sign='winding'.")
    edges, normals = edges_of(mesh), np.asarray(mesh.normals, np.float64)
    corners = np.asarray(mesh.corners, np.float64)
    corners = corners / (np.max(np.abs(corners)) or 1.0)
    sides = np.roll(corners, -1, axis=1) - corners
    before = -np.roll(sides, 1, axis=1)
    crossed = np.linalg.norm(np.cross(sides, before), axis=2)
    angles = np.arctan2(crossed, np.sum(sides * before, axis=2))
    at_edge, at_place = np.zeros((len(edges.count), 3)), np.zeros((int(edges.places.max()) + 1, 3))
    proper = edges.proper
    for k in range(3):
        np.add.at(at_edge, edges.edge[proper, k], normals[proper])
        np.add.at(at_place, edges.places[proper, k], angles[proper, k, None] * normals[proper])
    # Triangles without three corners have the normals of the edge or vertex they lie on only at their corners.
    opposite = np.where(proper[:, None, None], at_edge[np.roll(edges.edge, -1, axis=1)], at_place[edges.places])
    outward = 1.0 if float(mesh.volume) >= 0 else -1.0
    return _Pseudonormals(outward * normals, outward * opposite, outward * at_place[edges.places])


def _beyond(points: Array, found: Projection, mesh: TriangleMesh) -> np.ndarray:
    """Whether each point is on the inner side of the pseudonormal at its foot."""
    if is_traced(points, mesh):
        raise TypeError("sign='pseudonormal' needs known points and a known mesh; under jit take sign='winding'.")
    normals = kept(_pseudonormals, mesh)
    t, triangle = (np.asarray(x) for x in (found.t, found.segment))
    active = np.count_nonzero(t > 0, axis=-1)
    at_edge, at_corner = normals.edge[triangle], normals.corner[triangle]
    zero, largest = np.argmin(t, axis=-1), np.argmax(t, axis=-1)
    edge, corner = (_chosen(rows, k) for rows, k in ((at_edge, zero), (at_corner, largest)))
    normal = np.where(
        (active == 3)[..., None], normals.face[triangle], np.where((active == 2)[..., None], edge, corner)
    )
    offset = np.asarray(points, np.float64) - np.asarray(found.foot, np.float64)
    size = np.max(np.abs(offset), axis=-1, keepdims=True)
    return np.sum(offset / np.where(size > 0, size, 1.0) * normal, axis=-1) < 0


def _chosen(rows: Any, k: np.ndarray) -> np.ndarray:
    return np.take_along_axis(rows, k[..., None, None], axis=-2)[..., 0, :]
