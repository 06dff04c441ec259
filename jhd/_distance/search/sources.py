"""Sources of distances: curves, parametric surfaces, meshes and implicit surfaces, cut into cells.

A cell lies in the hull of some points, and is bounded by flat pieces of the opposite shape
(jhd._distance.cells.flat_pieces). For a curve or patch these points are the control points of a part, and for a
triangle its corners. For an implicit surface they are the corners of the part of a box between two planes that enclose
the surface. Implicit surfaces also use the bound of jhd._distance.cells.surfaces, by points of the opposite shape,
because it takes the curvature into account.

Rounding. Coordinates are at most one (those of far points may be larger, by |q|): a control point of a part is off by
eta (see jhd._distance.normalization.net_jets) in each coordinate, which moves a distance by at most sqrt(3) eta; a
corner of a part of a triangle by at most gamma(16) in each.
"""

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.flat_pieces import Hulls, bound_of
from jhd._distance.nearest.target import AbstractTarget, Flats, FootRows
from jhd._distance.normalization.net_jets import Net, eta, jet, part_of, point_error
from jhd._distance.search.polished_place import SharpenedPlace
from jhd._distance.search.row_batches import each, in_blocks
from jhd._results.solution import EVENTS
from jhd._runtime.arrays import joined, taken
from jhd._runtime.compiled import compiled

# Cells processed in one batch: few, since often there are no more.
_LANES = 8
# A cell is cut along each parameter along which its length is at least this fraction of the largest, unless its width
# there is below this many units of roundoff.
_LONG, _THIN = 0.6, 16
# Smallest fraction of a cell for each part when it is cut at a given point.
_INSET = 0.05
# Borders of pieces are compared at this number of points; they are equal if these agree to this many units of roundoff
# of the largest coordinate. A point on such a border is not a corner if the vector to its foot is normal to the surface
# within this tolerance.
_COMPARED, _JOINT_ULPS, _NORMAL = 5, 64, 1e-6


class CellRows(NamedTuple):
    """Cells of a source: the index of the piece of each, and its lower and upper ends in each parameter."""

    piece: Int[np.ndarray, " cells"]
    low: Float[np.ndarray, "cells parameters"]
    high: Float[np.ndarray, "cells parameters"]

    take = taken


class PlacesOfCells(NamedTuple):
    """Points close to a source, the first of them in the middle of each cell, and their proven errors."""

    points: Float[np.ndarray, "cells places 3"]  # some for each cell
    # Length within which the source is proven to have a point; infinite if there may be none.
    radius: Float[np.ndarray, "cells places"]
    # Parameters of the points; for an implicit surface, the points themselves.
    parameters: Float[np.ndarray, "cells places parameters"]


class PlaceOfCut(NamedTuple):
    """A point at which cells are best cut: its piece and parameters."""

    piece: int
    x: np.ndarray


class AbstractSource(ABC):
    """A shape that distances are maximized over, in common coordinates.

    Its cells have parameters, which are coordinates for an implicit surface.
    """

    @abstractmethod
    def cover(self) -> CellRows:
        """Return cells that cover the whole shape."""

    @abstractmethod
    def cut(self, cells: CellRows, at: PlaceOfCut | None = None) -> tuple[CellRows, np.ndarray]:
        """Return parts that cover the cells, without provably empty ones, and the index of the cell of each part.

        Args:
            cells: the cells to cut.
            at: a point that becomes a corner of the parts around it, if possible.
        """

    @abstractmethod
    def places(self, cells: CellRows) -> PlacesOfCells:
        """Return points of the shape in the cells."""

    @abstractmethod
    def over(self, cells: CellRows, target: AbstractTarget, feet: FootRows) -> np.ndarray:
        """Return proven upper bounds of the distances of cells to a target, from feet (cells, FEET)."""

    @abstractmethod
    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return unit vectors at a point: all directions along the shape without borders, and the ones into it."""

    def proven(self, place: SharpenedPlace, radius: float) -> tuple[SharpenedPlace, float]:
        """Return a point of the shape near the given one, with its error; by default both unchanged."""
        return place, radius

    def border_event(self, piece: int, x: np.ndarray, apart: np.ndarray) -> EVENTS:
        """Return the event of a maximum on a border of a piece, given the vector from the foot to the point."""
        return EVENTS.a_end

    @abstractmethod
    def parameters(self, x: np.ndarray) -> np.ndarray:
        """Return the parameters of a point as a Witness stores them."""


class NetSource(AbstractSource):
    """A parametric surface, or a curve in space.

    Args:
        net: its pieces in common coordinates.
        count: number of pieces without repetitions.
    """

    def __init__(self, net: Net, count: int):
        self._net, self._count = net, count

    @override
    def cover(self) -> CellRows:
        ends = np.zeros((self._count, self._net.parameters), np.asarray(self._net.points).dtype)
        return CellRows(np.arange(self._count), ends, ends + 1)

    @override
    def cut(self, cells: CellRows, at: PlaceOfCut | None = None) -> tuple[CellRows, np.ndarray]:
        """Cut at the given point, or at the middles of the parameters along which a cell is long."""
        parent, middle = np.arange(len(cells.piece)), 0.5 * (cells.low + cells.high)
        about = np.zeros(len(parent), bool)
        if at is not None:
            room = _INSET * (cells.high - cells.low)
            apt = (at.x - cells.low > room) & (cells.high - at.x > room) & (cells.piece == at.piece)[:, None]
            about = np.all(apt, axis=1)
            middle = np.where(about[:, None], at.x, middle)
        if cells.low.shape[1] == 1:
            return cut_along(cells, parent, 0, parent >= 0, middle[:, 0])
        # Next to a side that is a single point, cells stay as long as they are wide.
        corners = self.places(cells).points[:, 1:].reshape(-1, 2, 2, 3)
        along = [np.sqrt(np.max(np.sum(np.diff(corners, axis=k) ** 2, axis=-1), axis=(1, 2))) for k in (1, 2)]
        along = np.stack(along, axis=1)
        wide = cells.high - cells.low > _THIN * np.finfo(cells.low.dtype).eps
        which = wide & ((along >= _LONG * np.max(along, axis=1, keepdims=True)) | ~np.any(along > 0, axis=1)[:, None])
        which |= ~np.any(which, axis=1)[:, None] | about[:, None]
        for axis in range(2):
            cells, parent = cut_along(cells, parent, axis, which[parent, axis], middle[parent, axis])
        return cells, parent

    @override
    def places(self, cells: CellRows) -> PlacesOfCells:
        """Return the middle and the corners of each cell."""
        n = cells.low.shape[1]
        shares = np.concatenate([np.full((1, n), 0.5), np.indices((2,) * n).reshape(n, -1).T]).astype(cells.low.dtype)
        x = cells.low[:, None] + shares * (cells.high - cells.low)[:, None]
        x = np.minimum(x, cells.high[:, None])
        piece = np.repeat(cells.piece, len(shares))
        points = self._points_at(piece, x.reshape(-1, n)).reshape(*x.shape[:2], 3)
        return PlacesOfCells(points, np.full(x.shape[:2], point_error(self._net)), x)

    @override
    def over(self, cells: CellRows, target: AbstractTarget, feet: FootRows) -> np.ndarray:
        return over_hulls(Hulls(*in_blocks(_hulls_of_parts, self._net, *cells)), target, feet)

    @override
    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        along = units(np.asarray(_tangents(self._net, piece, x), np.float64))
        return np.concatenate([along, -along]), np.concatenate([along[x < 1], -along[x > 0]])

    @override
    def border_event(self, piece: int, x: np.ndarray, apart: np.ndarray) -> EVENTS:
        """Return the event: a free end, a corner, or, if pieces join smoothly, the event inside a piece."""
        if not self._is_joint(piece, x):
            return EVENTS.a_end
        pulls = self.rays(piece, x)[0] @ units(apart[None])[0]
        return EVENTS.b_end if bool(np.all(np.abs(pulls) <= _NORMAL)) else EVENTS.corner

    def _is_joint(self, piece: int, x: np.ndarray) -> bool:
        """Return whether another border of a piece lies along each border through a point.

        Borders are compared at some points. A border that is a single point, as at a pole, does not count.
        """
        borders, n = self._borders(), len(x)
        near = _JOINT_ULPS * np.finfo(borders.dtype).eps * np.max(np.abs(borders))
        apart = lambda points, others: np.max(np.abs(points - others), axis=(-2, -1))  # noqa: E731
        if n == 1:
            here = borders[2 * piece + int(x[0] > 0)]
            return bool(np.count_nonzero(apart(here, borders) <= near) > 1)
        long = apart(borders, borders[:, :1]) > near
        own = 4 * piece + np.array([2 * k + int(x[k] > 0) for k in range(n) if x[k] in (0.0, 1.0)])
        through = own
        if len(own) > 1 or not np.all(long[own]):
            point = self._points_at(piece, x[None])
            ends = np.minimum(apart(point, borders[:, :1]), apart(point, borders[:, -1:]))
            through = np.flatnonzero(long & (ends <= near))
        same = [(apart(borders[k], borders) <= near) | (apart(borders[k][::-1], borders) <= near) for k in through]
        return all(np.count_nonzero(row) > 1 for row in same)

    def _borders(self) -> np.ndarray:
        """Return points along the borders of all pieces: first parameter 0 and 1, then second parameter 0 and 1."""
        n = self._net.parameters
        shares = np.linspace(0, 1, _COMPARED if n == 2 else 1)
        x = np.empty((self._count, 2 * n, len(shares), n), np.asarray(self._net.points).dtype)
        for side in range(2 * n):
            x[:, side] = shares[:, None]
            x[:, side, :, side // 2] = side % 2
        piece = np.repeat(np.arange(self._count), 2 * n * len(shares))
        return self._points_at(piece, x.reshape(-1, n)).reshape(-1, len(shares), 3)

    def _points_at(self, piece: Any, x: np.ndarray) -> np.ndarray:
        return in_blocks(_points, self._net, np.broadcast_to(piece, len(x)), x)

    @override
    def parameters(self, x: np.ndarray) -> np.ndarray:
        return x if len(x) == 2 else np.asarray(x[0])


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
        """Cut each cell into four at the middles of its sides, so that all numbers are exact."""
        half, count = 0.5 * (cells.high - cells.low), len(cells.piece)
        zero = np.zeros_like(half[:, 0])
        steps = [np.stack(x, axis=1) for x in ((zero, zero), (half[:, 0], zero), (zero, half[:, 1]))]
        low = np.concatenate([cells.low + s for s in (*steps, half)])
        size = np.concatenate([half, half, half, -half])
        return CellRows(np.tile(cells.piece, 4), low, low + size), np.tile(np.arange(count), 4)

    @override
    def places(self, cells: CellRows) -> PlacesOfCells:
        """Return the middle and the corners of each cell."""
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
        """Return directions along the sides, and from each corner with positive weight to another."""
        v, weights = self._corners[piece].astype(np.float64), self.parameters(x)
        pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
        along = units(np.stack([v[i] - v[j] for i, j in pairs]))
        return along, along[[weights[j] > 0 for _, j in pairs]]

    @override
    def border_event(self, piece: int, x: np.ndarray, apart: np.ndarray) -> EVENTS:
        return EVENTS.corner

    @override
    def parameters(self, x: np.ndarray) -> np.ndarray:
        return np.array([1 - x[0] - x[1], x[0], x[1]])


def over_hulls(hulls: Hulls, target: AbstractTarget, feet: FootRows) -> np.ndarray:
    """Return proven upper bounds over cells in hulls."""
    program = _over_triangles if target.triangles else _over_parallelograms
    return in_blocks(program, None, *hulls, *target.flats(feet, hulls.corners))


def cut_along(
    cells: CellRows, parent: np.ndarray, axis: int, which: np.ndarray, middle: np.ndarray
) -> tuple[CellRows, np.ndarray]:
    """Cut the cells selected by `which` at a value of one parameter, and return the index of the cell of each part."""
    first, second = cells.high.copy(), cells.low.copy()
    first[which, axis], second[which, axis] = middle[which], middle[which]
    rows = np.flatnonzero(which)
    parts = [cells._replace(high=first), cells._replace(low=second).take(rows)]
    return joined(parts), np.concatenate([parent, parent[rows]])


@compiled
def _tangents(net: Net, piece: Array, x: Array) -> Array:
    return jet(net.piece(piece), x).first


@compiled
def _points(net: Net, count: Array, piece: Array, x: Array) -> Array:
    return each(lambda k, x: jet(net.piece(k), x).point, count, (piece, x), _LANES)


@compiled
def _hulls_of_parts(net: Net, count: Array, piece: Array, low: Array, high: Array) -> Any:
    def one(k: Array, low: Array, high: Array) -> Any:
        part = part_of(net.piece(k), low, high)
        along = jet(part, jnp.full(low.shape, 0.5, low.dtype)).first
        corners = part.points.reshape(-1, 3)
        slack = jnp.asarray(math.sqrt(3) * 1.01 * eta(net), corners.dtype)
        return Hulls(corners, slack, jnp.concatenate([along, jnp.zeros((2 - len(along), 3), along.dtype)]))

    return each(one, count, (piece, low, high), _LANES)


@compiled
def _over_parallelograms(_: None, count: Array, *rows: Array) -> Array:
    return each(lambda *x: bound_of(x[:3], Flats(*x[3:]), False), count, rows, _LANES)


@compiled
def _over_triangles(_: None, count: Array, *rows: Array) -> Array:
    return each(lambda *x: bound_of(x[:3], Flats(*x[3:]), True), count, rows, _LANES)


def units(rows: np.ndarray) -> np.ndarray:
    """Return the directions of vectors; zero for zero."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(length > 0, length, 1.0)
