"""Shapes whose points are counted by length, area or number: cells that cover each point as often as the shape does.

Where a shape covers a place twice (a curve that is run through again, triangles on top of each other) it counts twice.
"""

from abc import ABC, abstractmethod

import numpy as np

from jhd.distance.cells.measures import (
    FlatCells,
    flat_parts,
    flat_triangles,
    measured_parts,
    normal_form,
    off_by,
    restricted,
    single_points,
)
from jhd.distance.frame.net_jets import Net
from jhd.distance.search.mesh_source import MeshSource
from jhd.distance.search.sources import CellRows, cut_along

# A cell is cut along the parameters along which it is at least this share as long as along the longest.
_LONG = 0.6


class AbstractMeasured(ABC):
    """A shape as cells with measures, in common coordinates.

    Args:
        dimension: of the measure: 0 for a number, 1 for a length, 2 for an area.
    """

    dimension: int

    @abstractmethod
    def cover(self) -> CellRows:
        """Cells that are all of it."""

    @abstractmethod
    def cut(self, cells: CellRows, flat: FlatCells) -> tuple[CellRows, np.ndarray]:
        """Parts that are the same, and which cell each is of."""

    @abstractmethod
    def flat(self, cells: CellRows) -> FlatCells:
        """The cells beside flat pieces, with their measures."""


class MeasuredPoints(AbstractMeasured):
    """A set of points, each of which counts one, or what is said.

    Args:
        points: (points, 3).
        off: bound of the errors of their coordinates.
        counts: what each counts, (points,), or None.
    """

    dimension = 0

    def __init__(self, points: np.ndarray, off: float, counts: np.ndarray | None = None):
        self._points, self._off = points, off
        self._counts = np.ones(len(points)) if counts is None else counts

    def cover(self) -> CellRows:
        """See AbstractMeasured."""
        nothing = np.zeros((len(self._points), 0))
        return CellRows(np.arange(len(nothing)), nothing, nothing)

    def cut(self, cells: CellRows, flat: FlatCells) -> tuple[CellRows, np.ndarray]:
        """See AbstractMeasured: a point stays as it is."""
        return cells, np.arange(len(cells.piece))

    def flat(self, cells: CellRows) -> FlatCells:
        """See AbstractMeasured."""
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

    def cover(self) -> CellRows:
        """See AbstractMeasured."""
        ends = np.zeros((len(self._rows), self.dimension))
        return CellRows(np.arange(len(ends)), ends, ends + 1)

    def cut(self, cells: CellRows, flat: FlatCells) -> tuple[CellRows, np.ndarray]:
        """See AbstractMeasured: at the middles of those parameters along which the flat pieces are long."""
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

    def flat(self, cells: CellRows) -> FlatCells:
        """See AbstractMeasured."""
        rows = restricted(self._rows[cells.piece], cells.low, cells.high)
        weights = None if self._weights is None else rows[..., 3:]
        beside = flat_parts(rows[..., :3], weights, self._off)
        measured = measured_parts(self._form, cells.piece, (cells.low, cells.high), weights, self._off)
        controls = beside
        if weights is None:
            # Each coordinate of a coefficient is off by so much.
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
        self._source = MeshSource(corners.astype(np.float64))
        self._off = off + off_by((1, 1))

    def cover(self) -> CellRows:
        """See AbstractMeasured."""
        return self._source.cover()

    def cut(self, cells: CellRows, flat: FlatCells) -> tuple[CellRows, np.ndarray]:
        """See AbstractMeasured: each into four."""
        return self._source.cut(cells)

    def flat(self, cells: CellRows) -> FlatCells:
        """See AbstractMeasured."""
        return flat_triangles(self._source.places(cells).points[:, 1:], self._off)
