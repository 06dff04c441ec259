"""What searches prepare of a mesh: trees, boxes, moments, each made when it is first asked for and kept with its mesh.

Whoever holds a PreparedMesh keeps what was made. The last few are held here too, so that asking again about the same
numbers costs no more than to compare them.
"""

import hashlib
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar
from weakref import WeakValueDictionary

import numpy as np

from jhd.shapes.mesh import TriangleMesh

_R = TypeVar("_R")

# Meshes that are held here: the two of a pair, and as many before them. One of a million triangles takes 300 MB a tree.
_HELD = 4


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
