"""Nearest points of a mesh as functions of the queries and of the vertices.

The foot is differentiated on the face, edge or corner that holds it: the distance to a plane, a line or a point is a
function of the query and of the corners. So derivatives are right to any order if the foot stays on that feature.
"""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jhd._arithmetic.scaling import common_exponent, length, scale_of
from jhd._distance.nearest.meshes import nearest_on_mesh
from jhd._distance.normalization.custom_derivatives import attached
from jhd._results.solution import Projection
from jhd._runtime.arrays import is_traced
from jhd._runtime.compiled import compiled
from jhd._shapes.checks import Numbers, checked_points
from jhd._shapes.mesh import TriangleMesh


def project_on_mesh(points: Numbers, mesh: TriangleMesh, method: object = None) -> Projection:
    """Return the nearest points of a mesh, differentiable in points and vertices, twice; see jhd.project.

    Args:
        points: queries (..., 3).
        mesh: the mesh.
        method: None for the exact search, or the published one.

    Raises:
        TypeError: points that are not real numbers, another method, or VertexVoxels under tracing.
        ValueError: points that are not finite, empty, or not in space; a grid of more voxels than the capacity.
    """
    queries = checked_points(points)
    found = nearest_on_mesh(queries, mesh, method)
    return with_mesh_derivatives(found, queries, mesh) if is_traced(queries, mesh) else found


def with_mesh_derivatives(found: Projection, queries: Array, mesh: TriangleMesh) -> Projection:
    """Return nearest points of a mesh, differentiable in the queries and in the vertices."""
    distance, foot, t = _feet(queries, mesh.vertices[mesh.triangles[found.element]], found.t > 0)
    return attached(attached(found, found.distance > 0, distance=distance), foot=foot, t=t)


@compiled
def _feet(queries: Array, corners: Array, active: Array) -> tuple[Array, Array, Array]:
    return jnp.vectorize(foot_on, signature="(d),(c,d),(c)->(),(d),(c)")(queries, corners, active)


def foot_on(
    point: Float[Array, "3"], corners: Float[Array, "corners 3"], active: Array
) -> tuple[Float[Array, ""], Float[Array, "3"], Float[Array, " corners"]]:
    """Return distance, foot and barycentric coordinates on the plane, line or point of the active corners.

    The distance is a smooth function of point and corners unless it is zero. On a plane it is the product with the
    normal, which keeps its digits if the point is close; at zero its derivative is one-sided.

    Args:
        point: the query.
        corners: corners of a triangle.
        active: mask of the positive barycentric coordinates of the foot; three of them for a face.
    """
    offsets = lax.stop_gradient((point - corners, corners - corners[0]))
    scale = scale_of(common_exponent(*offsets), point.dtype)
    p, sides = (point - corners[0]) * scale, (corners - corners[0]) * scale
    face = jnp.all(active)
    on_face = _on_plane(p, jnp.where(face, sides, jnp.asarray(np.eye(3)[:, :3] - np.eye(3)[0], p.dtype)))
    on_edge = _on_line(p, sides, jnp.argmax(active), 2 - jnp.argmax(active[::-1]))
    face = face & on_face[0]
    distance, foot, t = (jnp.where(face, x, y) for x, y in zip(on_face[1:], on_edge, strict=True))
    return distance / scale, corners[0] + foot / scale, t


def _on_plane(p: Array, corners: Array) -> tuple[Array, Array, Array, Array]:
    """Return whether there is a plane; and distance, foot and coordinates there. The first corner is the origin."""
    u, v = corners[1], corners[2]
    normal = jnp.cross(u, v)
    square = jnp.sum(normal * normal)
    sound = square > 0
    square = jnp.where(sound, square, 1.0)
    unit = normal / jnp.sqrt(square)
    height = jnp.sum(p * unit)
    second, third = jnp.sum(jnp.cross(p, v) * normal) / square, jnp.sum(jnp.cross(u, p) * normal) / square
    t = jnp.stack([1 - second - third, second, third])
    return sound, jnp.where(lax.stop_gradient(height) < 0, -height, height), p - height * unit, t


def _on_line(p: Array, corners: Array, first: Array, last: Array) -> tuple[Array, Array, Array]:
    """Return distance, foot and coordinates on the line through two corners, which may be equal."""
    a, side = corners[first], corners[last] - corners[first]
    square = jnp.sum(side * side)
    share = jnp.where(square > 0, jnp.sum((p - a) * side) / jnp.where(square > 0, square, 1.0), 0.0)
    foot = a + share * side
    index = np.arange(3)
    t = jnp.where(index == last, share, 0.0) + jnp.where(index == first, 1 - share, 0.0)
    return length(p - foot), foot, jnp.where(first == last, jnp.where(index == first, 1.0, 0.0), t)
