"""What searches prepare of a mesh: trees, boxes, moments, each made when it is first asked for and kept with its mesh.

Whoever holds a PreparedMesh keeps what was made. The last few are held here too, so that asking again about the same
numbers costs no more than to compare them.

Whatever depends on squares of coordinates is made of the mesh `in_unit`, and so is shared by meshes of all sizes.
"""

import hashlib
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar
from weakref import WeakValueDictionary

import equinox as eqx
import numpy as np

from jhd.arithmetic.scaling import common_exponent
from jhd.arrays import array_of
from jhd.shapes.mesh import TriangleMesh

_R = TypeVar("_R")

# Meshes that are held here: the two of a pair, and as many before them, each as it is and in its unit. One of a million
# triangles takes 300 MB a tree.
_HELD = 8


class PreparedMesh:
    """A mesh whose numbers are known, with what searches have made of it so far.

    Args:
        mesh: the mesh.
    """

    def __init__(self, mesh: TriangleMesh):
        self.mesh = mesh
        self._parts: dict[Callable[[TriangleMesh], Any], Any] = {}

    def part(self, build: Callable[[TriangleMesh], _R]) -> _R:
        """What a function makes of the mesh, made once."""
        if build not in self._parts:
            self._parts[build] = build(self.mesh)
        return self._parts[build]

    def __repr__(self) -> str:
        return f"PreparedMesh({self.mesh.count} triangles, {len(self._parts)} parts made)"


_known: WeakValueDictionary[bytes, PreparedMesh] = WeakValueDictionary()
_last: deque[PreparedMesh] = deque(maxlen=_HELD)


def prepared(mesh: TriangleMesh) -> PreparedMesh:
    """What is prepared of a mesh with these numbers; hold it for as long as the mesh will be asked about again.

    >>> mesh = TriangleMesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> prepared(mesh) is prepared(TriangleMesh(mesh.vertices, mesh.triangles))
    True
    """
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    hashed = hashlib.blake2b(vertices.dtype.char.encode() + b"|" + str(vertices.shape).encode())
    for array in (vertices, triangles):
        hashed.update(np.ascontiguousarray(array).data)
    key = hashed.digest()
    found = _known.get(key)
    if found is None:
        found = _known[key] = PreparedMesh(mesh)
    if found in _last:
        _last.remove(found)
    _last.append(found)
    return found


class _InUnit(NamedTuple):
    """A mesh divided by a power of two, held with what is made of it; None where that is the mesh itself."""

    held: PreparedMesh | None
    power: int


def in_unit(mesh: TriangleMesh) -> tuple[TriangleMesh, int]:
    """The mesh, its numbers known, divided by the power of two that brings its coordinates to [1/2, 1); and the power.

    Nothing that is worked out about it has squares that underflow or overflow, but for triangles that are tiny in it.
    """
    held, power = prepared(mesh).part(_in_unit)
    return (mesh if held is None else held.mesh), power


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
    """Points divided by 2^power, and which of them that leaves in the range of floats.

    The others, put at the origin here, are so far from a mesh that `in_unit` divided by it that they are outside.
    """
    with np.errstate(over="ignore"):
        scaled = np.ldexp(points, -power)
    near = np.all(np.isfinite(scaled), axis=1)
    return np.where(near[:, None], scaled, 0.0).astype(points.dtype), np.flatnonzero(near)
