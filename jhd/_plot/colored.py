"""Shapes as pieces for pictures: triangles of a surface, lines of a curve, small enough for colors along them."""

from typing import Any, NamedTuple

import numpy as np

from jhd._distance.deviation_solution import DistanceSamples
from jhd._distance.project import project
from jhd._plot.nets import quadrilaterals
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh

# Approximate number of triangles of a picture; more take many seconds to draw.
_TRIANGLES = 16_000


class DrawnPieces(NamedTuple):
    """Points, and rows of their numbers: one number is a point, two are a line, three a triangle."""

    points: np.ndarray
    rows: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        """The points of each piece (pieces, corners, dim)."""
        return self.points[self.rows]


def pieces_of(shape: Any) -> DrawnPieces:
    """Points of a shape in pieces that look like it."""
    if isinstance(shape, TriangleMesh):
        return _of_mesh(shape)
    if isinstance(shape, ImplicitSurface):
        # Cells along each axis of an implicit surface.
        quads = quadrilaterals(shape, 48)
        rows = np.arange(4 * len(quads)).reshape(-1, 4)
        return DrawnPieces(quads.reshape(-1, 3), np.concatenate([rows[:, [0, 1, 2]], rows[:, [0, 2, 3]]]))
    if isinstance(shape, AbstractCurve):
        return _of_curve(shape)
    return _of_patches(shape.patches())


def distances_at(points: np.ndarray, b: Any, top: float, samples: DistanceSamples | None = None) -> np.ndarray:
    """The distances of drawn points to a shape, exact to the resolution of the colors.

    Distances are 1-Lipschitz, so the distance of a nearby sample is used if it determines the color.

    Args:
        points: points on the shape that is colored, (points, dim).
        b: the shape to which distances are taken.
        top: the largest distance.
        samples: known distances, if any.
    """
    values, known = np.empty(len(points)), np.zeros(len(points), bool)
    if samples is not None:
        from scipy.spatial import KDTree

        away, nearest = KDTree(samples.point).query(points)
        width = samples.upper[nearest] - samples.lower[nearest]
        # Distinguishable colors between zero and the largest distance.
        known = away + 0.5 * width <= top / 256
        values[known] = (samples.lower[nearest] + 0.5 * width)[known]
    if not known.all():
        values[~known] = np.asarray(project(points[~known], b, throw=False).distance)
    return values


def _of_mesh(mesh: TriangleMesh) -> DrawnPieces:
    """The triangles; if there are few, each is cut into equal parts."""
    corners = np.asarray(mesh.corners, float)
    n = int(np.clip(np.sqrt(_TRIANGLES / len(corners)), 1, 32))
    if n == 1:
        return DrawnPieces(np.asarray(mesh.vertices, float), np.asarray(mesh.triangles))
    places = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    number = {place: k for k, place in enumerate(places)}
    up = [[number[i, j], number[i + 1, j], number[i, j + 1]] for i, j in places if i + j < n]
    down = [[number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]] for i, j in places if i + j < n - 1]
    shares = np.array(places) / n
    sides = corners[:, 1:] - corners[:, :1]
    points = corners[:, None, 0] + np.einsum("ki,tid->tkd", shares, sides)
    return _joined(points, np.array(up + down))


def _of_patches(patches: Any) -> DrawnPieces:
    n = int(np.clip(np.sqrt(0.5 * _TRIANGLES / patches.count), 4, 48))
    t = np.linspace(0.0, 1.0, n + 1)
    points = np.asarray(patches.point(np.arange(patches.count)[:, None, None], t[:, None], t), float)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    rows = np.stack([first, first + n + 1, first + n + 2], axis=1), np.stack([first, first + n + 2, first + 1], axis=1)
    return _joined(points.reshape(patches.count, -1, 3), np.concatenate(rows))


def _of_curve(curve: AbstractCurve) -> DrawnPieces:
    segments = curve.segments()
    if segments.degree == 0:
        points = np.asarray(segments.control_points, float)[:, 0]
        return DrawnPieces(points, np.arange(len(points))[:, None])
    # Approximate number of lines of a picture; more take many seconds to draw.
    n = int(np.clip(3_000 / segments.count, 8, 256))
    t = np.linspace(0.0, 1.0, n + 1)
    points = np.asarray(segments.point(np.arange(segments.count)[:, None], t), float)
    return _joined(points, np.stack([np.arange(n), np.arange(n) + 1], axis=1))


def _joined(points: np.ndarray, rows: np.ndarray) -> DrawnPieces:
    """The pieces `rows` repeated for each of several groups of points (groups, points, dim)."""
    count, size, dim = points.shape
    every = np.arange(count)[:, None, None] * size + rows
    return DrawnPieces(points.reshape(-1, dim), every.reshape(-1, rows.shape[1]))


def section(pieces: DrawnPieces, origin: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The lines (lines, 2, 3) in which triangles meet a plane."""
    corners = pieces.corners
    height = (corners - origin) @ normal
    # A corner in the plane counts as above it.
    above = height >= 0
    cut = np.any(above, axis=1) & ~np.all(above, axis=1)
    corners, height, above = corners[cut], height[cut], above[cut]
    # The corner that lies alone on its side comes first.
    alone = np.argmax(above == (np.sum(above, axis=1) == 1)[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    corners, height = np.take_along_axis(corners, order[..., None], axis=1), np.take_along_axis(height, order, axis=1)
    share = height[:, :1] / (height[:, :1] - height[:, 1:])
    return corners[:, :1] + share[..., None] * (corners[:, 1:] - corners[:, :1])
