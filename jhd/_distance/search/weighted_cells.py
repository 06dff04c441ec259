"""Shapes whose points are counted by length, area or number: cells that cover each point as often as the shape does.

A point that a shape covers twice (a curve that is traversed again, triangles on top of each other) counts twice.
"""

import math
from abc import ABC, abstractmethod

import numpy as np
from typing_extensions import override

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.arc_length_area import (
    FlatCells,
    flat_parts,
    flat_triangles,
    measured_parts,
    normal_form,
    off_by,
    restricted,
    single_points,
)
from jhd._distance.normalization.net_jets import Net
from jhd._distance.search.sources import CellRows, MeshSource, cut_along
from jhd._runtime.arrays import joined

# A cut that ends this close to a corner, as a fraction of a side, ends at the corner.
_AT_END = 2.0**-30
# Exceeds the roundings of a point between two others, with coordinates of at most one.
_ROUNDINGS = gamma(16, np.float64)
# A cell is cut along each parameter along which its length is at least this fraction of the largest.
_LONG = 0.6


class AbstractMeasured(ABC):
    """A shape as cells with measures, in common coordinates.

    Args:
        dimension: dimension of the measure: 0 for a number, 1 for a length, 2 for an area.
    """

    dimension: int

    @abstractmethod
    def cover(self) -> CellRows:
        """Return cells that form the whole shape."""

    @abstractmethod
    def cut(self, cells: CellRows, flat: FlatCells, parting: np.ndarray | None = None) -> tuple[CellRows, np.ndarray]:
        """Return parts that form the cells, and the index of the cell of each part.

        Args:
            cells: the cells to cut.
            flat: flat pieces close to them.
            parting: values of affine functions at the corners; a triangle is best cut along a zero line of one.
        """

    @abstractmethod
    def flat(self, cells: CellRows) -> FlatCells:
        """Return flat pieces close to the cells, with the measures of the cells."""


class MeasuredPoints(AbstractMeasured):
    """A set of points with weights, by default one each.

    Args:
        points: (points, 3).
        off: bound of the errors of their coordinates.
        counts: weights of the points, (points,), or None.
    """

    dimension = 0

    def __init__(self, points: np.ndarray, off: float, counts: np.ndarray | None = None):
        self._points, self._off = points, off
        self._counts = np.ones(len(points)) if counts is None else counts

    @override
    def cover(self) -> CellRows:
        nothing = np.zeros((len(self._points), 0))
        return CellRows(np.arange(len(nothing)), nothing, nothing)

    @override
    def cut(self, cells: CellRows, flat: FlatCells, parting: np.ndarray | None = None) -> tuple[CellRows, np.ndarray]:
        """Return the points unchanged."""
        return cells, np.arange(len(cells.piece))

    @override
    def flat(self, cells: CellRows) -> FlatCells:
        points = self._points[cells.piece].astype(np.float64)
        return single_points(points, self._counts[cells.piece], self._off)


class MeasuredNet(AbstractMeasured):
    """A curve or a parametric surface.

    Args:
        net: its pieces, without repetitions.
        off: bound of the errors of its coordinates and, relative to them, of its weights.
    """

    def __init__(self, net: Net, off: float):
        self.dimension = net.parameters
        points = np.asarray(net.points, np.float64)
        self._weights = None if net.weights is None else np.asarray(net.weights, np.float64)[..., None]
        # Both are restricted together.
        rows = points if self._weights is None else np.concatenate([points * self._weights, self._weights], axis=-1)
        self._rows, self._off = rows, off + off_by(net.degrees)
        self._form = normal_form(rows[..., :3], self._weights, off)

    @override
    def cover(self) -> CellRows:
        ends = np.zeros((len(self._rows), self.dimension))
        return CellRows(np.arange(len(ends)), ends, ends + 1)

    @override
    def cut(self, cells: CellRows, flat: FlatCells, parting: np.ndarray | None = None) -> tuple[CellRows, np.ndarray]:
        """Cut at the middles of the parameters along which the flat pieces are long."""
        corners = flat.corners
        sides = [corners[:, -1] - corners[:, 0]]
        if self.dimension == 2:
            sides = [corners[:, 2] - corners[:, 0], corners[:, 1] - corners[:, 0]]
        along = np.stack([np.sum(x**2, axis=1) for x in sides], axis=1)
        which = along >= _LONG**2 * np.max(along, axis=1, keepdims=True)
        parent = np.arange(len(cells.piece))
        for axis in range(self.dimension):
            middle = 0.5 * (cells.low[:, axis] + cells.high[:, axis])
            cells, parent = cut_along(cells, parent, axis, which[parent, axis], middle)
        return cells, parent

    @override
    def flat(self, cells: CellRows) -> FlatCells:
        rows = restricted(self._rows[cells.piece], cells.low, cells.high)
        weights = None if self._weights is None else rows[..., 3:]
        beside = flat_parts(rows[..., :3], weights, self._off)
        measured = measured_parts(self._form, cells.piece, (cells.low, cells.high), weights, self._off)
        controls = beside
        if weights is None:
            # Error of each coordinate of a coefficient.
            controls = rows.reshape(len(rows), -1, 3), np.full(len(rows), 2 * self._off)
        return FlatCells(*beside, *measured, *controls)


class MeasuredMesh(AbstractMeasured):
    """A triangle mesh.

    Args:
        corners: of the triangles (triangles, 3, 3).
        off: bound of the errors of their coordinates.
    """

    dimension = 2

    def __init__(self, corners: np.ndarray, off: float):
        self._corners = corners.astype(np.float64)
        self._off = np.full(len(corners), off)

    @override
    def cover(self) -> CellRows:
        return MeshSource(self._corners).cover()

    @override
    def cut(self, cells: CellRows, flat: FlatCells, parting: np.ndarray | None = None) -> tuple[CellRows, np.ndarray]:
        """Cut each cell into four, or along the parting into two or three, which become triangles of a.

        A corner of such a part divides a side of its cell in a ratio that is a float. So the parts are all of the cell.
        The corner is off by as much as the ends of the side, and by a few roundings of coordinates of at most one.
        """
        parting = np.zeros(flat.corners.shape[:2]) if parting is None else parting
        parted = (np.min(parting, axis=1) < 0) & (np.max(parting, axis=1) > 0)
        whole, rows = np.flatnonzero(~parted), np.flatnonzero(parted)
        halves, parent = MeshSource(self._corners).cut(cells.take(whole))
        corners, of = _parts_along(flat.corners[rows], parting[rows])
        piece = len(self._corners) + np.arange(len(of))
        self._corners = np.concatenate([self._corners, corners])
        off = (flat.slack / math.sqrt(3) + _ROUNDINGS)[rows[of]] * (1 + _ROUNDINGS)
        self._off = np.concatenate([self._off, off])
        ends = np.zeros((len(of), 2))
        parts = CellRows(piece, ends, ends + 1)
        return joined([halves, parts]), np.concatenate([whole[parent], rows[of]])

    @override
    def flat(self, cells: CellRows) -> FlatCells:
        places = MeshSource(self._corners).places(cells).points[:, 1:]
        return flat_triangles(places, self._off[cells.piece] + off_by((1, 1)))


def _parts_along(corners: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts of triangles above and below zero of the heights of their corners, and their triangles."""
    signs = np.sign(heights)
    # The corner that is alone on its side; of two, the first.
    alone = np.argmax(signs * np.sign(np.sum(signs, axis=1, keepdims=True) - 0.5) < 0, axis=1)
    turned = (alone[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, turned[..., None], axis=1), 1, 0)
    h = np.abs(np.take_along_axis(heights, turned, axis=1))
    share = h[:, :1] / (h[:, :1] + h[:, 1:])
    whole = share > 1 - _AT_END
    ends = np.stack([b, c], axis=1)
    cuts = np.where(whole[..., None], ends, a[:, None] + share[..., None] * (ends - a[:, None]))
    x, y = cuts[:, 0], cuts[:, 1]
    parts = np.stack([np.stack(p, axis=1) for p in ((a, x, y), (x, b, c), (x, c, y))], axis=1)
    # If a cut ends in a corner, one part is missing.
    kept = np.concatenate([np.ones((len(a), 1), bool), ~whole], axis=1)
    of, _ = np.nonzero(kept)
    return parts[kept], of
