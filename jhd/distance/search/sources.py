"""What distances to a set of points are maximised over: surfaces, cut into cells.

A cell is bounded by points q_k of the target: for all weights w of the simplex

    d(x, b)^2 <= min_k |x - q_k|^2 <= sum_k w_k |x - q_k|^2,

and the right side is convex in x, so over a cell of a patch it is at most as large as at one of its control points. The
weights that are tried make its gradient along the surface vanish at the middle of the cell, as far as they can, so what
the bound exceeds the distance by is of second order at smooth maxima and on ridges. On a polynomial surface it is the
bound of jhd.distance.cells.surfaces.

Rounding. Coordinates are at most one (those of far points may be larger, by |q|): a control point of a part is off by
eta (see jhd.distance.frame.net_jets) in each coordinate, which moves a distance by at most sqrt(3) eta; the sums of
squares are of positive terms, relative to which gamma(16) is enough.
"""

import math
from abc import ABC, abstractmethod
from itertools import combinations
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd.arithmetic.polynomials import jets
from jhd.arithmetic.rounding import gamma, round_up, smallest_normal
from jhd.compiled import compiled
from jhd.distance.cells.surfaces import FEET, upper_bounds
from jhd.distance.frame.net_jets import Net, eta, jet, part_of, point_error
from jhd.distance.nearest.forms import boxes, form
from jhd.distance.nearest.places import projected, thorough_radius
from jhd.distance.nearest.surfaces import halved, inner
from jhd.distance.search.candidates import Target
from jhd.distance.search.rows import each, in_blocks

# Cells done side by side.
_LANES = 64
# Newton steps for the points of cells of a polynomial surface.
_STEPS_OF_POINTS = 6
_PAIRS, _TRIPLES = (np.array(list(combinations(range(FEET), k))) for k in (2, 3))


class CellRows(NamedTuple):
    """Cells of a source: the piece that each is of, and its ends, lower and upper, in each parameter."""

    piece: Int[np.ndarray, " cells"]
    low: Float[np.ndarray, "cells parameters"]
    high: Float[np.ndarray, "cells parameters"]

    def take(self, rows: Any) -> "CellRows":
        """Some of the cells."""
        return CellRows(*(x[rows] for x in self))


class PlacesOfCells(NamedTuple):
    """Points close to a source, the first of them in the middle of the cell, and what is proven of them.

    Args:
        points: some for each cell.
        radius: length within which the source is proven to have a point; infinite where there may be none.
        parameters: of the points; of a polynomial surface, the points themselves.
    """

    points: Float[np.ndarray, "cells places 3"]
    radius: Float[np.ndarray, "cells places"]
    parameters: Float[np.ndarray, "cells places parameters"]


class AbstractSource(ABC):
    """A shape that distances to points are maximised over, in common coordinates."""

    @abstractmethod
    def cover(self) -> CellRows:
        """Cells that cover all of it."""

    @abstractmethod
    def cut(self, cells: CellRows) -> tuple[CellRows, np.ndarray]:
        """Parts that cover the same, and which cell each is of; what is proven to hold no point is left out."""

    @abstractmethod
    def places(self, cells: CellRows) -> PlacesOfCells:
        """Points of it in the cells."""

    @abstractmethod
    def over(self, cells: CellRows, feet: np.ndarray) -> np.ndarray:
        """Proven upper bounds of the distances of its points in the cells to some points (cells, FEET, 3)."""

    @abstractmethod
    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors at a place: those along it as if it had no border, and of these the ones into it."""


class PatchSource(AbstractSource):
    """A parametric surface.

    Args:
        net: its pieces in common coordinates.
        count: how many of these are not repetitions.
    """

    def __init__(self, net: Net, count: int):
        self._net, self._count = net, count

    def cover(self) -> CellRows:
        """See AbstractSource."""
        ends = np.zeros((self._count, self._net.parameters), np.asarray(self._net.points).dtype)
        return CellRows(np.arange(self._count), ends, ends + 1)

    def cut(self, cells: CellRows) -> tuple[CellRows, np.ndarray]:
        """See AbstractSource: each into two or four, at the middles of its parameters."""
        parent = np.arange(len(cells.piece))
        for axis in range(cells.low.shape[1]):
            middle = 0.5 * (cells.low[:, axis] + cells.high[:, axis])
            first, second = cells.high.copy(), cells.low.copy()
            first[:, axis], second[:, axis] = middle, middle
            parts = cells._replace(high=first), cells._replace(low=second)
            cells = CellRows(*(np.concatenate(x) for x in zip(*parts, strict=True)))
            parent = np.concatenate([parent, parent])
        return cells, parent

    def places(self, cells: CellRows) -> PlacesOfCells:
        """See AbstractSource: the middle and the corners."""
        n = cells.low.shape[1]
        shares = np.concatenate([np.full((1, n), 0.5), np.indices((2,) * n).reshape(n, -1).T]).astype(cells.low.dtype)
        x = cells.low[:, None] + shares * (cells.high - cells.low)[:, None]
        x = np.minimum(x, cells.high[:, None])
        piece = np.repeat(cells.piece, len(shares))
        points = in_blocks(_points, self._net, piece, x.reshape(-1, n)).reshape(*x.shape[:2], 3)
        return PlacesOfCells(points, np.full(x.shape[:2], point_error(self._net)), x)

    def over(self, cells: CellRows, feet: np.ndarray) -> np.ndarray:
        """See AbstractSource."""
        return in_blocks(_over_hulls, self._net, *cells, feet)

    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See AbstractSource."""
        along = _units(np.asarray(_tangents(self._net, piece, x), np.float64))
        return np.concatenate([along, -along]), np.concatenate([along[x < 1], -along[x > 0]])


class SurfaceSource(AbstractSource):
    """A polynomial surface, with its cover; cells are boxes."""

    def __init__(self, target: Target):
        self._target = target

    def cover(self) -> CellRows:
        """See AbstractSource."""
        alive = np.asarray(self._target.cover.alive)
        low, high = (np.asarray(x).T[alive] for x in self._target.cover[:2])
        return CellRows(np.full(len(low), -1), low, high)

    def cut(self, cells: CellRows) -> tuple[CellRows, np.ndarray]:
        """See AbstractSource: each into eight."""
        low, high, alive = in_blocks(_eighths, self._target, cells.low, cells.high)
        parent = np.repeat(np.arange(len(cells.piece)), 8)
        rows = np.flatnonzero(alive.ravel())
        parts = CellRows(np.full(8 * len(cells.piece), -1), low.reshape(-1, 3), high.reshape(-1, 3))
        return parts.take(rows), parent[rows]

    def places(self, cells: CellRows) -> PlacesOfCells:
        """See AbstractSource: one inside, and one on the faces that the cell touches."""
        points, radius = in_blocks(_places_of_boxes, self._target, cells.low, cells.high)
        return PlacesOfCells(points, radius, points)

    def over(self, cells: CellRows, feet: np.ndarray) -> np.ndarray:
        """See AbstractSource."""
        return in_blocks(_over_boxes, self._target, cells.low, cells.high, feet)

    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See AbstractSource; at an edge of the box the directions along its faces, of which one may leave."""
        side = self._target.side
        low, high = x <= np.asarray(side.lower), x >= np.asarray(side.upper)
        slope = np.asarray(_slope(self._target, x), np.float64)
        if not np.any(low | high):
            frame = np.linalg.svd(slope[None])[2][1:]
            return np.concatenate([frame, -frame]), np.concatenate([frame, -frame])
        axis = int(np.argmax(low | high))
        along = _units(np.cross(slope, np.eye(3)[axis])[None])
        inward = _units(np.cross(along, slope))
        inward = inward * np.sign(inward[0, axis] or 1.0) * (1 if low[axis] else -1)
        free = np.concatenate([along, -along, inward, -inward])
        leaving = np.any((low & (free < -1e-9)) | (high & (free > 1e-9)), axis=1)
        return free, free[~leaving]


def _units(rows: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(length > 0, length, 1.0)


@compiled
def _tangents(net: Net, piece: Array, x: Array) -> Array:
    return jet(net.piece(piece), x).first


@compiled
def _slope(target: Target, x: Array) -> Array:
    return jets(jnp.asarray(target.side.coefficients), x).gradient


@compiled
def _points(net: Net, count: Array, piece: Array, x: Array) -> Array:
    return each(lambda k, x: jet(net.piece(k), x).point, count, (piece, x), _LANES)


@compiled
def _over_hulls(net: Net, count: Array, piece: Array, low: Array, high: Array, feet: Array) -> Array:
    def one(k: Array, low: Array, high: Array, feet: Array) -> Array:
        part = part_of(net.piece(k), low, high)
        at = jet(part, jnp.full(low.shape, 0.5, low.dtype))
        weights = trials(at.point - feet, at.first)
        corners = part.points.reshape(-1, 3)
        squares = jnp.sum((corners[:, None] - feet) ** 2, axis=-1)
        most = jnp.min(jnp.max(jnp.sum(weights[:, None] * squares, axis=-1), axis=1))
        dtype = most.dtype
        length = jnp.sqrt(most * (1 + gamma(16, dtype)) + 16 * smallest_normal(dtype)) * (1 + gamma(4, dtype))
        return round_up(length + math.sqrt(3) * 1.01 * eta(net))

    return each(one, count, (piece, low, high, feet), _LANES)


def trials(apart: Float[Array, "feet 3"], tangents: Float[Array, "parameters 3"]) -> Float[Array, "trials feet"]:
    """Weights of feet, of sum one at least, that are worth trying: one alone, two and three that balance.

    Two are balanced along each parameter and as far as they can be along both; three along both.
    """
    tiny = smallest_normal(apart.dtype)
    first = tangents / jnp.sqrt(jnp.maximum(jnp.sum(tangents**2, axis=1, keepdims=True), tiny))
    if first.shape[0] == 2:
        second = first[1] - jnp.sum(first[0] * first[1]) * first[0]
        first = jnp.stack([first[0], second / jnp.sqrt(jnp.maximum(jnp.sum(second**2), tiny))])
        along = jnp.concatenate([tangents, first])
    else:
        along = jnp.concatenate([tangents] * 4)
    pulls = jnp.sum(apart[:, None] * along, axis=-1)  # along u, along v, and in an orthonormal frame
    x, y = pulls[_PAIRS[:, 0]], pulls[_PAIRS[:, 1]]
    single = -y[:, :2] / _nonzero(x[:, :2] - y[:, :2])
    apart_sq = jnp.sum((x[:, 2:] - y[:, 2:]) ** 2, axis=1)
    both = jnp.sum(y[:, 2:] * (y[:, 2:] - x[:, 2:]), axis=1) / jnp.where(apart_sq > 0, apart_sq, 1.0)
    share = jnp.clip(jnp.concatenate([single[:, 0], single[:, 1], both]), 0.0, 1.0)
    pairs = jnp.asarray(np.tile(_PAIRS, (3, 1)))
    a, b, c = (pulls[_TRIPLES[:, k], 2:] for k in range(3))
    areas = jnp.stack([_turn(b, c), _turn(c, a), _turn(a, b)], axis=1)
    areas = jnp.maximum(areas * jnp.sign(jnp.sum(areas, axis=1, keepdims=True)), 0.0)
    areas = areas / jnp.maximum(jnp.sum(areas, axis=1, keepdims=True), tiny)
    eye = jnp.eye(FEET, dtype=apart.dtype)
    two = share[:, None] * eye[pairs[:, 0]] + (1 - share)[:, None] * eye[pairs[:, 1]]
    three = jnp.sum(areas[:, :, None] * eye[jnp.asarray(_TRIPLES)], axis=1)
    found = jnp.concatenate([eye, two, three])
    # Below a sum of one they would bound too little; a few units of roundoff above it cost as little.
    total = jnp.sum(found, axis=1, keepdims=True)
    sound = jnp.all(jnp.isfinite(found), axis=1, keepdims=True) & (total > 0.5)
    return jnp.where(sound, found / jnp.where(sound, total, 1.0), eye[0]) * (1 + gamma(8, found.dtype))


def _turn(x: Array, y: Array) -> Array:
    return x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]


def _nonzero(x: Array) -> Array:
    return jnp.where(x != 0, x, 1.0)


@compiled
def _eighths(target: Target, count: Array, low: Array, high: Array) -> Any:
    def one(low: Array, high: Array) -> Any:
        lows, highs = halved(low[:, None], high[:, None])
        return lows.T, highs.T, form(target.side, boxes(lows, highs)).may_vanish

    return each(one, count, (low, high), _LANES)


@compiled
def _places_of_boxes(target: Target, count: Array, low: Array, high: Array) -> Any:
    side = target.side

    def one(low: Array, high: Array) -> Any:
        free = inner(side, low[:, None], high[:, None])
        middle = 0.5 * (low + high)[:, None]
        face = jnp.where(low[:, None] <= jnp.asarray(side.lower)[:, None], low[:, None], high[:, None])
        starts = jnp.concatenate([middle, jnp.where(free, middle, face)], axis=1)
        fixed = jnp.concatenate([jnp.zeros_like(free), ~free], axis=1)
        found = projected(side, starts, fixed, _STEPS_OF_POINTS)
        # A point far from the cell belongs to another one.
        near = jnp.all(jnp.abs(found - middle) <= 3 * jnp.max(high - low), axis=0)
        found = jnp.where(near, found, middle)
        return found.T, jnp.where(near, thorough_radius(side, found), jnp.inf)

    return each(one, count, (low, high), _LANES)


@compiled
def _over_boxes(target: Target, count: Array, low: Array, high: Array, feet: Array) -> Array:
    def one(low: Array, high: Array, feet: Array) -> Array:
        cells = boxes(low[:, None], high[:, None])
        free = inner(target.side, low[:, None], high[:, None])
        zero = jnp.zeros((FEET, 1), low.dtype)
        return upper_bounds(form(target.side, cells), cells, feet[:, :, None], zero, free)[0]

    return each(one, count, (low, high, feet), _LANES)
