"""Triangle meshes for several experiments: smooth ones, parts as from CAD, and meshes of files."""

from pathlib import Path

import numpy as np

import jhd
from jhd.io import load_mesh


def load(file: Path) -> jhd.TriangleMesh:
    """Load a mesh from any format that jhd reads, or from arrays V (vertices) and F (triangles) in an .npz file."""
    if file.suffix != ".npz":
        return load_mesh(file)
    with np.load(file) as stored:
        return jhd.TriangleMesh(stored["V"], stored["F"])


def bumpy_sphere(n: int, height: float = 0.12) -> jhd.TriangleMesh:
    """Return a unit sphere with bumps, from a cube of n x n squares on each side: 12 n^2 triangles of similar size."""
    places, triangles = _cube(n)
    along = np.tan((2 * places / n - 1) * (np.pi / 4))
    unit = along / np.linalg.norm(along, axis=1, keepdims=True)
    bumps = np.sin(5 * unit[:, 0] + 1) * np.sin(4 * unit[:, 1]) * np.sin(6 * unit[:, 2] + 0.5)
    return jhd.TriangleMesh(unit * (1 + height * bumps)[:, None], triangles)


def torus(rows: int, columns: int, width: float = 0.4) -> jhd.TriangleMesh:
    """Return a torus: circles of radius `width` about the unit circle; 2 rows columns triangles."""
    u, v = np.meshgrid(_turn(rows), _turn(columns), indexing="ij")
    reach = 1 + width * np.cos(v)
    points = np.stack([reach * np.cos(u), reach * np.sin(u), width * np.sin(v)], axis=-1)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = ((i + 1) % rows) * columns + j, ((i + 1) % rows) * columns + (j + 1) % columns
    return jhd.TriangleMesh(points.reshape(-1, 3), np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3))


def rounded_box(sides: tuple[float, float, float], radius: float, steps: int) -> jhd.TriangleMesh:
    """Return a box with rounded edges: two triangles for each side, and `steps` strips of triangles along each edge."""
    n = 2 * steps + 1
    places, triangles = _cube(n)
    # Both middle planes coincide on a sphere; here they become the ends of the flat sides.
    upper = places > steps
    along = np.tan(((places - upper) / steps - 1) * (np.pi / 4))
    unit = along / np.linalg.norm(along, axis=1, keepdims=True)
    inner = np.array(sides) / 2 - radius
    return jhd.TriangleMesh(radius * unit + np.where(upper, inner, -inner), triangles)


def plate(columns: int, rows: int, steps: int, thickness: float = 0.25) -> jhd.TriangleMesh:
    """Return a plate of unit squares of the given thickness, each with a round hole of radius 0.3 and 4 steps edges."""
    circle = 0.3 * np.stack([np.cos(_turn(4 * steps)), np.sin(_turn(4 * steps))], axis=1)
    square = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    i = np.arange(4 * steps)
    after, corner = (i + 1) % (4 * steps), 4 * steps + i // steps
    bent = np.arange(4)
    between = np.stack([bent * steps, 4 * steps + (bent + 3) % 4, 4 * steps + bent], axis=1)
    flat = np.concatenate([np.stack([i, corner, after], axis=1), between])
    cells = [(np.concatenate([circle, square]) + [x, y], flat) for x in range(columns) for y in range(rows)]
    return jhd.TriangleMesh(*_extruded(*_joined(cells), thickness))


def profile(length: float, legs: tuple[float, float], thickness: float, radius: float, steps: int) -> jhd.TriangleMesh:
    """Return a length of L-shaped steel profile, its inner corner rounded by `steps` steps."""
    angle = np.pi + np.linspace(0, np.pi / 2, steps + 1)[::-1]
    arc = thickness + radius * (1 + np.stack([np.cos(angle), np.sin(angle)], axis=1))
    section = np.array([[0, 0], [legs[0], 0], [legs[0], thickness], *arc, [thickness, legs[1]], [0, legs[1]]])
    i = np.arange(1, len(section) - 1)
    return jhd.TriangleMesh(*_extruded(section, np.stack([0 * i, i, i + 1], axis=1), length))


def _turn(count: int) -> np.ndarray:
    return np.linspace(0, 2 * np.pi, count, endpoint=False)


def _cube(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return integer coordinates from 0 to n on the surface of a cube, and the triangles of its squares."""
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    sides = []
    for axis in range(3):
        for end in (0, n):
            square = np.empty((n * n, 4, 3), int)
            square[:, :, axis] = end
            for k, (di, dj) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                square[:, k, (axis + 1) % 3], square[:, k, (axis + 2) % 3] = i + di, j + dj
            sides.append(square if end else square[:, ::-1])
    places, index = np.unique(np.concatenate(sides).reshape(-1, 3), axis=0, return_inverse=True)
    return places, index.reshape(-1, 4)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def _extruded(points: np.ndarray, flat: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Extrude a flat, counter-clockwise triangulation to a solid: two copies, and walls along its borders."""
    count = len(points)
    edges = {(a, b) for t in flat.tolist() for a, b in zip(t, t[1:] + t[:1], strict=True)}
    border = np.array(sorted(edge for edge in edges if edge[::-1] not in edges))
    a, b = border.T
    walls = np.concatenate([np.stack([a, b, b + count], axis=1), np.stack([a, b + count, a + count], axis=1)])
    solid = [np.pad(points, ((0, 0), (0, 1)), constant_values=z) for z in (0.0, height)]
    return np.concatenate(solid), np.concatenate([flat[:, ::-1], flat + count, walls])


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Join flat parts, and merge vertices with equal coordinates."""
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = np.round(np.concatenate([points for points, _ in parts]), 12)
    triangles = np.concatenate([triangles + start for (_, triangles), start in zip(parts, starts, strict=False)])
    points, index = np.unique(points, axis=0, return_inverse=True)
    return points, index.reshape(-1)[triangles]
