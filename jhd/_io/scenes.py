"""Parts of a scene, each with its transformation, joined to one triangle mesh."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jhd._io.errors import ParseError
from jhd._io.polygons import merged
from jhd._shapes.mesh import TriangleMesh

# Limits, as a file of some kilobytes can repeat a mesh again and again.
_MOST_PARTS, _MOST_TRIANGLES = 20_000, 20_000_000


class ScenePart(NamedTuple):
    """Triangles in a scene."""

    points: np.ndarray  # coordinates, (points, 3)
    triangles: np.ndarray  # indices of the points, (triangles, 3)
    matrix: np.ndarray  # map to the scene, (4, 4), which multiplies columns (x, y, z, 1)


def joined(file: object, parts: Iterable[ScenePart]) -> TriangleMesh:
    """The mesh of all parts; equal coordinates become one vertex, and mirrored triangles are turned.

    Raises:
        ParseError: no triangles, very many, an index without a point, or a coordinate that is not finite.
    """
    corners, count = [], 0
    for number, (points, triangles, matrix) in enumerate(parts):
        count += len(triangles)
        if number == _MOST_PARTS or count > _MOST_TRIANGLES:
            raise ParseError(f"has more than {_MOST_PARTS} parts or {_MOST_TRIANGLES} triangles.", file)
        bad = (triangles < 0) | (triangles >= len(points))
        if bad.any():
            message = f"a triangle names vertex {triangles[bad][0]}, counted from 0; there are {len(points)}."
            raise ParseError(message, file)
        with np.errstate(all="ignore"):
            mirrored = np.linalg.det(matrix[:3, :3]) < 0
            found = points[triangles[:, ::-1] if mirrored else triangles].reshape(-1, 3)
            # Left alone, coordinates keep their bits; column by column, equal ones stay equal.
            if not np.array_equal(matrix, np.eye(4)):
                found = sum(found[:, k, None] * matrix[:3, k] for k in range(3)) + matrix[:3, 3]
        if not np.isfinite(found).all():
            raise ParseError("a vertex is not finite.", file)
        corners.append(found)
    if not count:
        raise ParseError("holds no triangles.", file)
    vertices, numbers = merged(np.concatenate(corners))
    return TriangleMesh(vertices, numbers.reshape(-1, 3))
