"""Meshes in place of parametric and implicit surfaces, for building and checking adaptive distance fields.

If a mesh is within d of a surface in both directions, their distances differ by at most d. The side of a point is its
side of the mesh; for points farther than d from the surface this is also their side of the surface.
"""

from typing import Any

import numpy as np

from jhd._arithmetic.scaling import common_exponent
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch

# Fraction of the tolerance of a field for its mesh, which gives about as many triangles as cells.
MESH_SHARE = 0.25


def meshed(shape: Any, tolerance: float, sign: str = "none") -> tuple[Any, float]:
    """The mesh of a curved surface and its deviation, at most MESH_SHARE * tolerance; any other shape and 0.

    Closed meshes are turned so that they face outward: a polynomial may be negative or positive inside.

    Raises:
        ValueError: as `to_mesh` of the surface, or a sign is asked for and the surface is open.
        TypeError: the surface is traced.
    """
    if not isinstance(shape, AbstractPatch | ImplicitSurface):
        return shape, 0.0
    mesh, deviation = shape.to_mesh(MESH_SHARE * tolerance)
    if sign != "none" and not mesh.is_closed:
        raise ValueError("the surface is open, so it has no inside; the sign 'none' gives unsigned distances.")
    if mesh.is_closed and _signed_volume(mesh) < 0:
        mesh = TriangleMesh(mesh.vertices, np.asarray(mesh.triangles)[:, [0, 2, 1]])
    return mesh, deviation


def _signed_volume(mesh: TriangleMesh) -> float:
    """A positive multiple of the enclosed volume, on the host."""
    vertices = np.asarray(mesh.vertices, np.float64)
    near = np.ldexp(vertices, -int(common_exponent(vertices)))
    low = near.min(axis=0)
    a, b, c = np.moveaxis((near - low)[np.asarray(mesh.triangles)], 1, 0)
    return float(np.sum(a * np.cross(b, c)))
