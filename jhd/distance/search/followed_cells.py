"""Bounds over cells by feet that are followed over them, from the host; see jhd.distance.cells.followed.

A box of parameters of a patch is two triangles, that of a curve a segment, and the cells of meshes are triangles. Of
the pieces that the feet of a cell lie on one after the other is tried, until the bound is good enough.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic.simplices import inner_lattice
from jhd.compiled import compiled
from jhd.distance.cells.followed import INSET, bound_between, foot_map, part_over, weighted
from jhd.distance.frame.net_jets import Net, jet
from jhd.distance.frame.nets import repeated
from jhd.distance.nearest.target import FootRows
from jhd.distance.search.rows import in_blocks, in_groups
from jhd.distance.search.sources import CellRows

# Cells done side by side.
_LANES = 32
# Feet of one piece belong to different maps where their parameters are farther apart than this.
_APART = 0.5


class _Simplices(NamedTuple):
    """Segments or triangles of parameters: the piece, its corners, and the corners of the part that counts in it.

    Args:
        piece: of a.
        corners: parameters of the corners (cells, corners, parameters of a).
        shares: rows of non-negative numbers of sum one, exactly, (cells, corners, corners).
    """

    piece: np.ndarray
    corners: np.ndarray
    shares: np.ndarray

    def take(self, rows: Any) -> "_Simplices":
        """Some of them."""
        return _Simplices(*(x[rows] for x in self))


class FollowedFeet:
    """Bounds between two nets in common coordinates.

    Args:
        a: the net whose cells are bounded.
        b: the other one.
    """

    def __init__(self, a: Net, b: Net):
        self._nets = repeated(a), repeated(b)

    def over(self, cells: CellRows, feet: FootRows, goal: float) -> np.ndarray:
        """Proven upper bounds of the distances of all points in cells, from their feet.

        Args:
            cells: of a.
            feet: of each, on pieces of b; the first one is tried first.
            goal: what is below it need not be any better.
        """
        corners = _simplices(cells)
        many = corners.shape[1]
        parts = _Simplices(
            np.repeat(cells.piece, many),
            corners.reshape(-1, *corners.shape[2:]),
            np.broadcast_to(
                np.eye(corners.shape[2], dtype=corners.dtype), (corners.shape[0] * many, *(corners.shape[2],) * 2)
            ),
        )
        feet = feet.map(lambda x: np.repeat(x, many, axis=0))
        bound = np.full(len(parts.piece), np.inf)
        tried = _worth_trying(feet)
        for k in range(tried.shape[1]):
            rows = np.flatnonzero(tried[:, k] & (bound > goal))
            if len(rows):
                found = self._bounds(parts.take(rows), feet.segment[rows, k], feet.t[rows, k])
                bound[rows] = np.fmin(bound[rows], found)
        return np.max(bound.reshape(-1, many), axis=1)

    def _bounds(self, parts: _Simplices, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        start = t[:, : self._nets[1].parameters].astype(parts.corners.dtype)
        return in_blocks(_bounds_of, self._nets, *parts, segment, start).astype(np.float64)


def _simplices(cells: CellRows) -> np.ndarray:
    """The corners (cells, simplices, corners, parameters) of what cells of nets are made of."""
    low, high = cells.low, cells.high
    if low.shape[1] == 1:
        return np.stack([low, high], axis=1)[:, None]
    mixed = [np.stack([low[:, 0], high[:, 1]], axis=1), np.stack([high[:, 0], low[:, 1]], axis=1)]
    return np.stack([np.stack([low, mixed[1], mixed[0]], axis=1), np.stack([high, *mixed], axis=1)], axis=1)


def _worth_trying(feet: FootRows) -> np.ndarray:
    """Which feet are on a piece, or a place of it, that none before them are."""
    count = feet.segment.shape[1]
    columns = [feet.segment[:, 0] >= 0]
    for k in range(1, count):
        new = feet.segment[:, k] >= 0
        for j in range(k):
            near = np.max(np.abs(feet.t[:, k] - feet.t[:, j]), axis=1) <= _APART
            new &= (feet.segment[:, k] != feet.segment[:, j]) | ~near
        columns.append(new)
    return np.stack(columns, axis=1)


@compiled
def _bounds_of(
    nets: tuple[Net, Net], count: Array, piece: Array, corners: Array, shares: Array, segment: Array, start: Array
) -> Array:
    a, b = nets

    def one(k: Array, corners: Array, segment: Array, start: Array) -> Array:
        middles = weighted(jnp.asarray(inner_lattice(corners.shape[0] - 1, 2, INSET), corners.dtype), corners)
        places = jax.vmap(lambda x: jet(a.piece(k), x).point)(middles)
        return foot_map(places, b.piece(segment), start)

    def group(piece: Array, corners: Array, shares: Array, segment: Array, start: Array) -> Array:
        # Sums of non-negative numbers, so that relative errors are those of a few roundings.
        inner, complement = (jax.vmap(weighted)(shares, x) for x in (corners, 1 - corners))
        sigma = jax.vmap(one)(piece, inner, segment, start)
        maps = (jnp.moveaxis(x, 0, -1) for x in (inner, complement, sigma))
        inner, complement, sigma = maps
        k = corners.shape[1] - 1
        part = part_over(k, a.piece(piece), inner, complement)
        other = part_over(k, b.piece(segment), sigma, 1 - sigma)
        return bound_between(k, part, other, sum(a.degrees) + sum(b.degrees))

    return in_groups(group, count, (piece, corners, shares, segment, start), _LANES)
