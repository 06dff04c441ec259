"""Cells of the search for the point of a mesh that is farthest from another mesh: parts of its triangles.

The distance to a triangle is a convex function, since a triangle is a convex set; so on a cell it is largest at a
corner, and for any triangles T_k of b

    max over the cell of d(x, b) <= min over k of max over the corners c_i of d(c_i, T_k).

Good T_k are the nearest triangles of the corners and of the points at which the cell was split off. The bound is exact
if one triangle is nearest to all corners, so cells are split where the nearest triangle changes. An edge whose ends
have the nearest triangles S and T is split at the point with d(x, S) = d(x, T), other edges in the middle.

If a part of a lies in b, corners have many nearest triangles, and ties carry little information. Then the triangle T
nearest to the middle of the cell is used: the cell is cut along a wall of the prism over T, so that the part inside,
which remains after at most three cuts, is bounded exactly. So the cells become the pieces of the overlay of both
triangulations.

Rounding. With coordinates of at most s, a point v0 + w1 (v1 - v0) + w2 (v2 - v0) is computed within gamma(32) s. Its
weights are convex combinations of the weights of the parent's corners; rounding moves them off the triangle, and off
the edge that is split, by at most 16 u s a level. `slack` is the sum.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jhd._arithmetic.rounding import gamma
from jhd._runtime.arrays import taken
from jhd._runtime.compiled import compiled
from jhd._triangles.closest_point import TriangleTree, in_blocks, nearest_triangles
from jhd._triangles.point_triangle import squared_distances

# Of this many rounds one splits in the middle, so that cells shrink whatever the nearest triangles are.
_PERIOD = 4
_SECANTS = 12
_NEXT = np.array([1, 2, 0])
# The six points of a cell are its corners 0, 1, 2 and on the edges behind them 3, 4, 5. The parts by points, and how
# many there are: four by points on all edges, three by cutting off a corner, two by a cut through a corner.
_WHOLE = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
_OFF = [
    [[i, 3 + i, 3 + k], [3 + i, j, k], [3 + i, k, 3 + k], [i, i, i]] for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
]
_THROUGH = [[[i, j, 3 + j], [i, 3 + j, k], [i, i, i], [i, i, i]] for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))]
_PARTS, _NUMBER = np.array([_WHOLE, *_OFF, *_THROUGH]), np.array([4, 3, 3, 3, 2, 2, 2])


class TriangleCells(NamedTuple):
    """Triangular parts of the triangles of a."""

    owner: Int[np.ndarray, " cells"]  # the triangle of a
    weights: Float[np.ndarray, "cells corners 3"]  # barycentric coordinates of the three corners
    # Computed squared distances of the corners to b, in the unit of the tree.
    square: Float[np.ndarray, "cells corners"]
    nearest: Int[np.ndarray, "cells corners"]  # their nearest triangles, as sorted in the tree
    upper: Float[np.ndarray, " cells"]  # proven bound of the largest distance of a point of the cell to b
    depth: Int[np.ndarray, " cells"]  # number of splits
    middle: Int[np.ndarray, " cells"]  # a nearest triangle of the middle of the cell, -1 if it was not computed

    take = taken

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.owner)


class MeshSide(NamedTuple):
    """The mesh a in the unit of the tree of b."""

    corners: Float[np.ndarray, "triangles corners 3"]  # corners of the triangles of a
    size: float  # largest coordinate
    tree: TriangleTree  # the tree of b
    b_corners: Float[np.ndarray, "others corners 3"]  # corners of the triangles of b, in the order of the mesh

    def slack(self, depth: Any) -> Any:
        """Bound the errors of a computed point, and of the union of a cell's parts, relative to the exact cell."""
        return np.asarray(self.size * (gamma(40, self.corners.dtype) + depth * gamma(16, self.corners.dtype)))

    def points(self, owner: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return the points at barycentric coordinates (cells, points, 3) of the triangles."""
        v = self.corners[owner]
        first, second = (weights[:, :, [k]] * (v[:, [k]] - v[:, [0]]) for k in (1, 2))
        return v[:, [0]] + first + second

    def reach(self, squares: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Proven upper bounds of distances from computed squares."""
        distance = np.sqrt(squares.astype(np.float64))
        return (distance + self.tree.error(distance) + self.slack(depth)) * (1 + 4e-16)


def first_cells(side: MeshSide, triangles: np.ndarray, places: np.ndarray) -> tuple[TriangleCells, np.ndarray]:
    """Return the whole triangles of a as cells, and the numbers of their distinct corners."""
    used, index = np.unique(triangles, return_inverse=True)
    found = nearest_triangles(side.tree, places[used])
    index = index.reshape(triangles.shape)
    square, nearest = found.square[index], found.triangle[index]
    squares = _matrix(side, side.corners, nearest)
    count = len(triangles)
    weights = np.broadcast_to(np.eye(3, dtype=places.dtype), (count, 3, 3))
    depth = np.zeros(count, np.int64)
    upper = side.reach(squares.max(axis=1).min(axis=1), depth)
    return TriangleCells(np.arange(count), weights, square, nearest, upper, depth, np.full(count, -1, np.int32)), used


def split(side: MeshSide, cells: TriangleCells, round_: int, clipping: bool) -> TriangleCells:
    """Return the parts of each cell; `clipping` cuts along walls of prisms instead of splitting at ties."""
    corners = side.points(cells.owner, cells.weights)
    share, way = np.full((cells.count, 3), 0.5, cells.weights.dtype), np.zeros(cells.count, int)
    if clipping:
        middle = np.where(cells.middle < 0, _middles(side, corners, cells.nearest[:, 0]), cells.middle)
        share, way = in_blocks(lambda p, t: _cuts(side.tree.table, p, t), corners, middle)
        cells = cells._replace(middle=middle)
    elif round_ % _PERIOD != _PERIOD - 1:
        share = _tied(side, cells, corners, share)
    step = cells.weights[:, _NEXT] - cells.weights
    weights = np.concatenate([cells.weights, cells.weights + share[:, :, None] * step], axis=1)
    points = side.points(cells.owner, weights)
    # A triangle near a corner is also near the points next to it.
    found = nearest_triangles(side.tree, points[:, 3:].reshape(-1, 3), cells.nearest.reshape(-1))
    square = np.concatenate([cells.square, found.square.reshape(-1, 3)], axis=1)
    nearest = np.concatenate([cells.nearest, found.triangle.reshape(-1, 3)], axis=1)
    index = np.arange(cells.count)[:, None, None], _PARTS[way]
    known, middles = nearest, np.full(4 * cells.count, -1, np.int32)
    if clipping:
        middles = _middles(side, points[index].reshape(-1, 3, 3), np.repeat(cells.middle, 4))
        known = np.concatenate([nearest, middles.reshape(-1, 4), cells.middle[:, None]], axis=1)
    owner, depth = np.repeat(cells.owner, 4), np.repeat(cells.depth + 1, 4)
    least = _matrix(side, points, known)[index].max(axis=2).min(axis=2).reshape(-1)
    upper = np.minimum(side.reach(least, depth), np.repeat(cells.upper, 4))
    weights, square, nearest = (x[index].reshape(-1, 3, *x.shape[2:]) for x in (weights, square, nearest))
    parts = TriangleCells(owner, weights, square, nearest, upper, depth, middles)
    return parts.take(np.flatnonzero((np.arange(4) < _NUMBER[way][:, None]).ravel()))


def _middles(side: MeshSide, corners: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return nearest triangles of the middles of cells."""
    return nearest_triangles(side.tree, corners.mean(axis=1), near).triangle


def _tied(side: MeshSide, cells: TriangleCells, corners: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the fractions at which to split edges: at a tie if the nearest triangle changes, else as given."""
    row, edge = np.nonzero(cells.nearest != cells.nearest[:, _NEXT])
    if not len(row):
        return share
    ends = [(row, edge), (row, _NEXT[edge])]
    (p, s), (q, t) = ((corners[i], cells.nearest[i]) for i in ends)
    share = share.copy()
    share[row, edge] = in_blocks(lambda *x: _ties(side.tree.table, *x), p, q, s, t)
    return share


def _matrix(side: MeshSide, points: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """Squared distances (cells, points, triangles) of the points of each cell to the triangles of its row."""
    return in_blocks(lambda p, k: _all_squares(side.tree.table, p, k), points, nearest)


@compiled
def _all_squares(table: Array, points: Array, triangles: Array) -> Array:
    # One triangle after the other: one gather of rows serves all points.
    rows = table[triangles]
    return lax.map(lambda row: squared_distances(points, row[:, None, :]), jnp.moveaxis(rows, 1, 0)).transpose(1, 2, 0)


@compiled
def _cuts(table: Array, corners: Array, triangles: Array) -> tuple[Array, Array]:
    """Return where to cut the edges of cells, and into which parts: along the wall of a prism that halves them best.

    A point is in the prism over a triangle if y, x s1 - y c1 and y c2 - (x - L) s2 are not negative (see
    jhd._triangles.point_triangle). Cells that no wall cuts are split in the middles of their edges.
    """
    row = table[triangles][:, None, :]
    w = corners - row[..., 0:3]
    x, y = jnp.sum(w * row[..., 3:6], axis=-1), jnp.sum(w * row[..., 6:9], axis=-1)
    walls = jnp.stack([y, x * row[..., 11] - y * row[..., 10], y * row[..., 13] - (x - row[..., 9]) * row[..., 14]])
    # A point this close to a wall is on it: it was cut there.
    least = 2.0**-41 if walls.dtype == np.float64 else 2.0**-14
    walls = jnp.where(jnp.abs(walls) <= least, 0.0, walls)
    balance = jnp.minimum(jnp.max(walls, axis=-1), -jnp.min(walls, axis=-1))
    best = jnp.argmax(balance, axis=0)
    g = jnp.take_along_axis(walls, best[None, :, None], axis=0)[0]
    sign = jnp.sign(g).astype(int)
    opposite = g * g[:, _NEXT] < 0
    step = jnp.where(opposite, g - g[:, _NEXT], 1.0)
    share = jnp.where(opposite, jnp.clip(g / step, 0.0, 1.0), 0.5)
    zero = jnp.any(sign == 0, axis=1)
    # The corner on the wall, or the one whose sign no other has.
    alone = jnp.argmax(jnp.where(zero[:, None], sign == 0, sign * jnp.sum(sign, axis=1, keepdims=True) < 0), axis=1)
    way = jnp.where(zero, 4, 1) + alone
    cut = jnp.max(balance, axis=0) > 0
    return jnp.where(cut[:, None], share, 0.5), jnp.where(cut, way, 0)


@compiled
def _ties(table: Array, p: Array, q: Array, s: Array, t: Array) -> Array:
    """Fractions of the way from p to q at which both triangles are equally far, by the Illinois method.

    At p the triangle s is nearer, at q the triangle t; any fraction is valid, a better one only saves splits.
    """
    first, second = table[s], table[t]

    def difference(share: Array) -> Array:
        x = p + share[:, None] * (q - p)
        return jnp.sqrt(squared_distances(x, first)) - jnp.sqrt(squared_distances(x, second))

    def step(_: int, state: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, at_low, at_high = state
        gap = at_high - at_low
        share = jnp.where(gap > 0, (low * at_high - high * at_low) / jnp.where(gap > 0, gap, 1.0), 0.5 * (low + high))
        share = jnp.clip(share, low, high)
        here = difference(share)
        left = here <= 0
        return (
            jnp.where(left, share, low),
            jnp.where(left, high, share),
            jnp.where(left, here, 0.5 * at_low),
            jnp.where(left, 0.5 * at_high, here),
        )

    zero, one = jnp.zeros(p.shape[0], p.dtype), jnp.ones(p.shape[0], p.dtype)
    start = (zero, one, jnp.minimum(difference(zero), 0.0), jnp.maximum(difference(one), 0.0))
    low, high, at_low, at_high = jax.lax.fori_loop(0, _SECANTS, step, start)
    share = jnp.where(-at_low < at_high, low, high)
    # At an end there is nothing to split off.
    return jnp.where((share > 0) & (share < 1), share, 0.5)
