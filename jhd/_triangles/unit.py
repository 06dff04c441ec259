"""Meshes divided by powers of two, so that squares of their coordinates neither underflow nor overflow.

Whatever depends on squares of coordinates is made of the mesh `in_unit`, and so is shared by meshes of all sizes.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from jhd._arithmetic.scaling import common_exponent
from jhd._runtime.arrays import array_of
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.prepared import Prepared, prepared


class _InUnit(NamedTuple):
    """A mesh divided by a power of two, prepared; None if the power is zero."""

    held: Prepared | None
    power: int


def in_unit(mesh: TriangleMesh) -> tuple[TriangleMesh, int]:
    """The mesh, its numbers known, divided by the power of two that brings its coordinates to [1/2, 1); and the power.

    Squares in computations with it neither underflow nor overflow, except for triangles that are tiny in it.
    """
    held, power = prepared(mesh)._part(_in_unit)
    return (mesh if held is None else held.shape), power


def _in_unit(mesh: TriangleMesh) -> _InUnit:
    vertices = np.asarray(mesh.vertices)
    power = int(common_exponent(vertices[np.asarray(mesh.triangles)]))
    if power == 0:
        return _InUnit(None, 0)
    # Vertices that no triangle has may overflow.
    with np.errstate(over="ignore"):
        scaled = np.ldexp(vertices, -power)
    return _InUnit(prepared(eqx.tree_at(lambda m: m.vertices, mesh, array_of(scaled))), power)


def scaled_down(points: np.ndarray, power: int) -> tuple[np.ndarray, np.ndarray]:
    """Points divided by 2^power, and the indices of points that stay in the range of floats.

    The others are set to the origin; they are so far from a mesh divided by `in_unit` that they are outside.
    """
    with np.errstate(over="ignore"):
        scaled = np.ldexp(points, -power)
    near = np.all(np.isfinite(scaled), axis=1)
    return np.where(near[:, None], scaled, 0.0).astype(points.dtype), np.flatnonzero(near)
