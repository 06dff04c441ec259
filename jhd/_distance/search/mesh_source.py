"""Triangle meshes as sources of distances; see jhd._distance.search.sources."""

import math

import numpy as np
from typing_extensions import override

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.proxy_bounds import Hulls
from jhd._distance.nearest.target import AbstractTarget, FootRows
from jhd._distance.search.sources import AbstractSource, CellRows, PlaceOfCut, PlacesOfCells, over_hulls, units


class MeshSource(AbstractSource):
    """A triangle mesh; a cell is the triangle with the corners p, (q_1, p_2) and (p_1, q_2) for its ends p and q.

    The second end may be below the first. Parameters are the last two barycentric coordinates, and all of them are
    multiples of a power of two, so they are exact.

    Args:
        corners: of the triangles, in common coordinates.
    """

    def __init__(self, corners: np.ndarray):
        self._corners = corners
        self._off = math.sqrt(3) * gamma(16, corners.dtype)

    @override
    def cover(self) -> CellRows:
        ends = np.zeros((len(self._corners), 2), self._corners.dtype)
        return CellRows(np.arange(len(ends)), ends, ends + 1)

    @override
    def cut(self, cells: CellRows, at: PlaceOfCut | None = None) -> tuple[CellRows, np.ndarray]:
        """Each into four at the middles of its sides, so that all numbers are exact."""
        half, count = 0.5 * (cells.high - cells.low), len(cells.piece)
        zero = np.zeros_like(half[:, 0])
        steps = [np.stack(x, axis=1) for x in ((zero, zero), (half[:, 0], zero), (zero, half[:, 1]))]
        low = np.concatenate([cells.low + s for s in (*steps, half)])
        size = np.concatenate([half, half, half, -half])
        return CellRows(np.tile(cells.piece, 4), low, low + size), np.tile(np.arange(count), 4)

    @override
    def places(self, cells: CellRows) -> PlacesOfCells:
        """The middle and the corners."""
        size = cells.high - cells.low
        shares = np.array([[0.25, 0.25], [0, 0], [1, 0], [0, 1]], size.dtype)
        x = cells.low[:, None] + shares * size[:, None]
        points = self._points(cells.piece, x)
        return PlacesOfCells(points, np.full(x.shape[:2], self._off), x)

    def _points(self, piece: np.ndarray, x: np.ndarray) -> np.ndarray:
        v = self._corners[piece][:, None]
        return v[:, :, 0] + x[..., :1] * (v[:, :, 1] - v[:, :, 0]) + x[..., 1:] * (v[:, :, 2] - v[:, :, 0])

    @override
    def over(self, cells: CellRows, target: AbstractTarget, feet: FootRows) -> np.ndarray:
        corners = self.places(cells).points[:, 1:]
        tangents = corners[:, 1:] - corners[:, :1]
        return over_hulls(Hulls(corners, np.full(len(corners), self._off, corners.dtype), tangents), target, feet)

    @override
    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Along the sides, and from a corner that has some weight to another."""
        v, weights = self._corners[piece].astype(np.float64), self.parameters(x)
        pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
        along = units(np.stack([v[i] - v[j] for i, j in pairs]))
        return along, along[[weights[j] > 0 for _, j in pairs]]

    @override
    def parameters(self, x: np.ndarray) -> np.ndarray:
        return np.array([1 - x[0] - x[1], x[0], x[1]])
