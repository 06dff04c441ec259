"""Test of points for the inside of a closed mesh, by the angle-weighted normal at their nearest point.

Right for closed meshes without self-intersections, wrong for others. A face has its own normal. An edge has the sum of
the normals of its two triangles. A vertex has the sum of the normals of all its triangles, weighted by their angles at
the vertex. The published average, without weights, is also wrong at some sharp vertices; it is for comparison.

Sources: Baerentzen & Aanaes, Signed distance computation using the angle weighted pseudonormal (2005); the average:
Lin03 ("3-D signed Euclidean distance transform and its applications", 2003), section 3, detail 3.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jhd._shapes.mesh import TriangleMesh, edges_of
from jhd._shapes.prepared import prepared
from jhd._triangles.unit import in_unit, scaled_down


class Pseudonormals(NamedTuple):
    """Outward normals, not normalized, of the faces, edges and corners of every triangle."""

    face: Float[np.ndarray, "triangles 3"]  # of the triangles
    edge: Float[np.ndarray, "triangles corners 3"]  # of the edges opposite to each corner
    corner: Float[np.ndarray, "triangles corners 3"]  # of the corners


def pseudonormals(mesh: TriangleMesh, sign: str = "pseudonormal") -> Pseudonormals:
    """The normals of a mesh whose numbers are known.

    Args:
        mesh: the mesh.
        sign: "pseudonormal"; or "average", which weights all triangles at a vertex equally.

    Raises:
        ValueError: a mesh that is not closed, or not consistently oriented.
    """
    return prepared(in_unit(mesh)[0])._part(_weighted if sign == "pseudonormal" else _averages)


def _weighted(mesh: TriangleMesh) -> Pseudonormals:
    return _normals(mesh, "pseudonormal")


def _averages(mesh: TriangleMesh) -> Pseudonormals:
    return _normals(mesh, "average")


def _angles(mesh: TriangleMesh) -> np.ndarray:
    """The angles of each triangle at its corners."""
    corners = np.asarray(mesh.corners, np.float64)
    sides = np.roll(corners, -1, axis=1) - corners
    size = np.max(np.abs(sides), axis=(1, 2), keepdims=True)
    sides = sides / np.where(size > 0, size, 1.0)
    before = -np.roll(sides, 1, axis=1)
    crossed = np.linalg.norm(np.cross(sides, before), axis=2)
    return np.arctan2(crossed, np.sum(sides * before, axis=2))


def _normals(mesh: TriangleMesh, sign: str) -> Pseudonormals:
    """The `pseudonormals` of a closed mesh, computed on the host; ValueError for any other mesh."""
    if not (mesh.is_closed and mesh.is_manifold):
        needed = "a closed mesh in which two triangles run along each edge, in opposite directions"
        raise ValueError(f"sign={sign!r} needs {needed}; use sign='winding'.")
    weights = _angles(mesh) if sign == "pseudonormal" else np.ones((mesh.count, 3))
    edges, normals = edges_of(mesh), np.asarray(mesh.normals, np.float64)
    at_edge, at_place = np.zeros((len(edges.count), 3)), np.zeros((int(edges.places.max()) + 1, 3))
    proper = edges.proper
    for k in range(3):
        np.add.at(at_edge, edges.edge[proper, k], normals[proper])
        np.add.at(at_place, edges.places[proper, k], weights[proper, k, None] * normals[proper])
    # Triangles without three corners have the normals of the edge or vertex they lie on only at their corners.
    opposite = np.where(proper[:, None, None], at_edge[np.roll(edges.edge, -1, axis=1)], at_place[edges.places])
    outward = 1.0 if float(mesh.volume) >= 0 else -1.0
    return Pseudonormals(outward * normals, outward * opposite, outward * at_place[edges.places])


def is_behind(
    mesh: TriangleMesh,
    points: Float[np.ndarray, "points 3"],
    triangle: Int[np.ndarray, " points"],
    t: Float[np.ndarray, "points 3"],
    sign: str = "pseudonormal",
) -> Bool[np.ndarray, " points"]:
    """Whether points are on the inner side of the normal at their nearest point.

    Args:
        mesh: the mesh.
        points: in the unit of the mesh.
        triangle: the triangle that holds the nearest point.
        t: barycentric coordinates of the nearest point, exactly 0 off a face.
        sign: as for `pseudonormals`.

    Raises:
        ValueError: as `pseudonormals`.
    """
    mesh, power = in_unit(mesh)
    points, near = scaled_down(points, power)
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.triangles)[triangle]]
    offset = points - np.einsum("nk,nkd->nd", t, corners)
    normals, active = pseudonormals(mesh, sign), np.count_nonzero(t > 0, axis=1)
    edge = normals.edge[triangle, np.argmin(t, axis=1)]
    corner = normals.corner[triangle, np.argmax(t, axis=1)]
    normal = np.where(active[:, None] == 3, normals.face[triangle], np.where(active[:, None] == 2, edge, corner))
    size = np.max(np.abs(offset), axis=1, keepdims=True)
    behind = np.zeros(len(points), bool)
    behind[near] = (np.sum(offset / np.where(size > 0, size, 1.0) * normal, axis=1) < 0)[near]
    return behind
