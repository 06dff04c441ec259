"""Bounds over cells by feet that are followed over them, from the host; see jhd._distance.cells.foot_maps.

A box of parameters of a patch is two triangles, an interval of a curve is a segment, and the cells of meshes are
triangles. The pieces on which the feet of a cell lie are tried one after the other, until the bound is good enough. If
the foot leaves its piece within the cell, the cell is cut along the line through the points on its edges at which this
happens. The parts are bounded one by one, and cut again if necessary, about a corner of several pieces: without cuts
the bound would be off by the square of the cell's size there.

The new corners divide edges in fractions whose sum is exactly one, so the parts cover the cell. Fractions of parts of
parts are sums of products of these, all non-negative, so each is off by a factor of gamma(2) a cut. This counts with
the roundings of the later compositions (jhd._arithmetic.simplices).
"""

from copy import copy
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.simplices import inner_lattice
from jhd._distance.cells.foot_maps import (
    BEYOND,
    INSET,
    Triangles,
    beyond_sides,
    bound_between,
    distance_to,
    foot_map,
    part_over,
    share_on_side,
    weighted,
)
from jhd._distance.nearest.target import AbstractTarget, FootRows
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.nets import repeated
from jhd._distance.search.row_batches import each, in_blocks, in_groups
from jhd._distance.search.sources import CellRows
from jhd._runtime.arrays import taken
from jhd._runtime.compiled import compiled, optimized

# Cells processed in one batch: few, since often there are no more; polynomials over them allow some more.
_LANES, _LANES_OF_PARTS = 8, 16
# Feet of one piece belong to different maps if their parameters differ by more than this.
_APART = 0.5
# Feet of a cell that are tried.
_MOST = 4
# A cell is cut if it extends beyond a side by this fraction of its length, if the foot of its middle differs from the
# mean of the feet of its corners by at most this fraction of that excess, and if it is at most this many pieces long.
_LEAST, _BENT, _LONG = 1e-7, 0.3, {Net: 0.9, Triangles: 2.0}
# Number of cuts of cells and then their parts: about a corner of patches two lines meet, of triangles three.
_CUTS = {Net: 2, Triangles: 3}
# A piece that is farther from a corner of a cell than the goal by this factor does not help.
_HOPELESS = 1.5
# Parts of a triangle with one corner on one side of a cut and two on the other: numbers of the corners, starting at the
# single corner, and 3 and 4 for the ends of the cut towards the second and the third.
_PARTS_OF_TRIANGLE = np.array([[0, 3, 4], [3, 1, 2], [3, 2, 4]])
_PARTS_OF_SEGMENT = np.array([[0, 2], [2, 1]])


class Simplices(NamedTuple):
    """Segments or triangles of parameters: the piece, its corners, and the corners of the part that counts."""

    piece: np.ndarray  # index of the piece of a
    corners: np.ndarray  # parameters of the corners (cells, corners, parameters of a)
    shares: np.ndarray  # rows of non-negative numbers whose sum is one, (cells, corners, corners); see the module
    # Approximate points of a at the corners of the part and, last, in its middle, (cells, corners + 1, 3).
    points: np.ndarray

    take = taken

    @property
    def places(self) -> np.ndarray:
        """Approximate parameters of the corners of the parts."""
        return self.shares @ self.corners


class FeetOfParts(NamedTuple):
    """Feet of each part: their pieces (parts, feet), -1 for none, and parameters there."""

    segment: np.ndarray
    t: np.ndarray

    take = taken


class FollowedFeet:
    """Bounds over cells between two shapes in common coordinates, by feet followed over the cells.

    Args:
        a: the shape whose cells are bounded: a net, or the corners of triangles.
        b: the shape that distances are taken to: a net, or the corners of triangles.
        target: finds nearest points of `b`.
    """

    def __init__(self, a: Net | Triangles, b: Net | Triangles, target: AbstractTarget):
        self._target, self.shapes = target, (repeated(a), repeated(b))
        self._long, self.most_cuts = _LONG[type(b)], _CUTS[type(b)]

    def instead(self, a: Net) -> "FollowedFeet":
        """Return a copy for cells of the net `a`, whose number of pieces is one that functions are compiled for."""
        found = copy(self)
        found.shapes = (a, self.shapes[1])
        return found

    def over(self, cells: CellRows, feet: FootRows, goal: float | np.ndarray) -> np.ndarray:
        """Return proven upper bounds of the distances of all points in cells, from their feet.

        Args:
            cells: cells of a.
            feet: feet of each cell on pieces of b, in the order in which they are tried.
            goal: bounds below it need not be improved; one number, or one for each cell.
        """
        corners = corners_of(cells, self.shapes[0].flat)
        many, count = corners.shape[1:3]
        whole = np.broadcast_to(np.eye(count, dtype=corners.dtype), (len(corners) * many, count, count))
        parts = self.parts(np.repeat(cells.piece, many), corners.reshape(-1, *corners.shape[2:]), whole)
        goals = np.repeat(np.broadcast_to(goal, len(corners)), many)
        every = FeetOfParts(feet.segment, feet.t).take(np.repeat(np.arange(len(corners)), many))
        bound = self._bounded(parts, every, goals)
        return np.max(bound.reshape(-1, many), axis=1)

    def _bounded(self, parts: Simplices, feet: FeetOfParts, goal: np.ndarray, cuts: int = 0) -> np.ndarray:
        """Return bounds of parts; `cuts` counts the cuts so far."""
        tried = _worth_trying(feet, self.shapes[1].flat)
        bound = self._by_any(parts, feet, self._hopeful(parts, feet, tried, goal), goal)
        rows = np.flatnonzero(bound > goal)
        if len(rows) and cuts < self.most_cuts:
            by_cuts = self._by_cuts(parts.take(rows), feet.take(rows), tried[rows], goal[rows], cuts)
            bound[rows] = np.fmin(bound[rows], by_cuts)
        return bound

    def _hopeful(self, parts: Simplices, feet: FeetOfParts, tried: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Return the feet to try, without triangles that are too far from a corner of the part."""
        if not self.shapes[1].flat or not np.all(goal > 0):
            return tried
        rows, k = np.nonzero(tried)
        far = in_blocks(_farthest_corner, self.shapes[1], parts.points[rows], feet.segment[rows, k])
        hopeful = np.zeros_like(tried)
        hopeful[rows, k] = far <= _HOPELESS * goal[rows]
        return hopeful

    def _by_any(self, parts: Simplices, feet: FeetOfParts, tried: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Return bounds by one foot after the other, by several at once if lanes are free."""
        bound, left = np.full(len(parts.piece), np.inf), tried.copy()
        while True:
            rows, k = np.nonzero(left & (bound > goal)[:, None])
            if not len(rows):
                return bound
            # As many feet as there are lanes for these parts.
            groups = -(-np.count_nonzero(np.diff(rows, prepend=-1)) // _LANES_OF_PARTS)
            some = np.argsort(k, kind="stable")[: groups * _LANES_OF_PARTS]
            rows, k = rows[some], k[some]
            left[rows, k] = False
            np.fmin.at(bound, rows, self._bounds(parts.take(rows), feet.segment[rows, k], feet.t[rows, k]))

    def _start(self, t: np.ndarray, like: np.ndarray) -> np.ndarray:
        return t[:, : self.shapes[1].parameters].astype(like.dtype)

    def _bounds(self, parts: Simplices, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        start = self._start(t, parts.corners)
        return in_blocks(_bounds_of, self.shapes, *parts[:3], segment, start).astype(np.float64)

    def _by_cuts(
        self, parts: Simplices, feet: FeetOfParts, tried: np.ndarray, goal: np.ndarray, cuts: int
    ) -> np.ndarray:
        """Return bounds of cells that are cut at the side of a piece; infinite for cells that are not cut."""
        bound = np.full(len(parts.piece), np.inf)
        rows, smaller, every = self.cut(parts, feet, tried)
        if len(rows):
            many = len(smaller.piece) // len(rows)
            found = self._bounded(smaller, every, np.repeat(goal[rows], many), cuts + 1)
            bound[rows] = np.max(found.reshape(-1, many), axis=1)
        return bound

    def cut(self, parts: Simplices, feet: FeetOfParts, tried: np.ndarray) -> tuple[np.ndarray, Simplices, FeetOfParts]:
        """Return the rows of cells cut at a side of a piece, their parts one after the other, and feet of the parts."""
        cut = self._cuts(parts, feet, tried)
        rows = np.flatnonzero(cut.score > _LEAST)
        if not len(rows):
            return rows, parts.take(rows), feet.take(rows)
        smaller = self._divided(parts.take(rows), taken(cut, rows))
        new = self._target.rows_of(self._target.near(smaller.points[:, -1]))
        held = feet.take(np.repeat(rows, len(smaller.piece) // len(rows)))
        both = zip((new.segment[:, None], new.t[:, None]), held, strict=True)
        return rows, smaller, FeetOfParts(*(np.concatenate(x, axis=1) for x in both))

    def parts(self, piece: np.ndarray, corners: np.ndarray, shares: np.ndarray) -> Simplices:
        """Return parts of cells with their points."""
        places = shares @ corners
        x = np.concatenate([places, np.mean(places, axis=1, keepdims=True)], axis=1)
        many = x.shape[1]
        points = in_blocks(_places_of, self.shapes[0], np.repeat(piece, many), x.reshape(-1, x.shape[2]))
        return Simplices(piece, corners, shares, points.reshape(-1, many, 3))

    def _cuts(self, parts: Simplices, feet: FeetOfParts, tried: np.ndarray) -> "_Cuts":
        """Return for each cell the side that divides it best, of the pieces its feet lie on."""
        # A cell without feet takes part with arbitrary numbers; its score stays zero.
        scores, index = np.zeros(tried.shape), np.zeros(tried.shape, int)
        tried = tried | (np.arange(tried.shape[1]) == 0)
        rows, k = np.nonzero(tried)
        segment, start = feet.segment[rows, k], self._start(feet.t[rows, k], parts.corners)
        sides = in_blocks(_beyond, self.shapes[1], parts.points[rows], segment, start)
        score, side = self._scores(sides)
        scores[rows, k], index[rows, k] = np.where(segment >= 0, score, 0.0), np.arange(len(rows))
        best = index[np.arange(len(index)), np.argmax(scores, axis=1)]
        values = np.take_along_axis(sides[best, :-1], side[best, None, None], axis=2)[:, :, 0]
        return _Cuts(np.max(scores, axis=1), side[best], segment[best], start[best], values)

    def _scores(self, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how evenly the best side divides each cell, as a fraction of its length, and the index of the side."""
        corners = sides[:, :-1]
        low, high = np.min(corners, axis=1), np.max(corners, axis=1)
        bent, less = np.abs(sides[:, -1] - np.mean(corners, axis=1)), np.minimum(-low, high)
        span = high - low
        apt = (bent < _BENT * less) & (span < self._long) & (span > 1e-9)
        score = np.where(apt, less / np.where(span > 0, span, 1.0), 0.0)
        if not self.shapes[1].flat:
            # The foot was not followed any farther, or is around a side that is a single point.
            score[np.any(np.abs(sides - 0.5) > 0.5 + 0.99 * BEYOND, axis=(1, 2))] = 0.0
        side = np.argmax(score, axis=1)
        return score[np.arange(len(side)), side], side

    def _divided(self, parts: Simplices, cut: "_Cuts") -> Simplices:
        """Return the parts of each cell, one after the other."""
        count, corners = parts.corners.shape[:2]
        index, places = np.arange(count), parts.places
        below = cut.values < 0
        # First the corner that is alone on its side.
        alone = np.argmax(below == (np.sum(below, axis=1, keepdims=True) == 1), axis=1)
        turned = (alone[:, None] + np.arange(corners)) % corners
        # Both ends of each edge from that corner.
        edges = turned[:, [[0, k] for k in range(1, corners)]]
        ends, values = places[index[:, None, None], edges], cut.values[index[:, None, None], edges]
        of_edges = (np.repeat(x, corners - 1, axis=0) for x in (parts.piece, cut.segment, cut.start, cut.side))
        piece, *where = of_edges
        rows = (piece, ends.reshape(-1, *ends.shape[2:]), *where, values.reshape(-1, 2))
        share = in_blocks(_shares, self.shapes, *rows).reshape(count, corners - 1, 1)
        # Their sum is exactly one: this difference is a multiple of the unit of roundoff.
        rest = 1 - share
        share = 1 - rest
        shares = parts.shares[index[:, None], turned]
        every = np.concatenate([shares, rest * shares[:, :1] + share * shares[:, 1:]], axis=1)
        of = _PARTS_OF_TRIANGLE if corners == 3 else _PARTS_OF_SEGMENT
        shares = every[:, of].reshape(-1, corners, corners)
        return self.parts(np.repeat(parts.piece, len(of)), np.repeat(parts.corners, len(of), axis=0), shares)


class _Cuts(NamedTuple):
    """Cuts of cells: score, side, its piece, parameters near it, and signed distances of the corners beyond it."""

    score: np.ndarray
    side: np.ndarray
    segment: np.ndarray
    start: np.ndarray
    values: np.ndarray


def corners_of(cells: CellRows, flat: bool) -> np.ndarray:
    """Return the corners (cells, simplices, corners, parameters) of cells; `flat` for cells of meshes."""
    low, high = cells.low, cells.high
    if low.shape[1] == 1:
        return np.stack([low, high], axis=1)[:, None]
    mixed = [np.stack([low[:, 0], high[:, 1]], axis=1), np.stack([high[:, 0], low[:, 1]], axis=1)]
    first = np.stack([low, mixed[1], mixed[0]], axis=1)
    if flat:
        # Multiples of a power of two, so that the third coordinate is exact.
        return np.concatenate([1 - np.sum(first, axis=-1, keepdims=True), first], axis=-1)[:, None]
    return np.stack([first, np.stack([high, *mixed], axis=1)], axis=1)


def _worth_trying(feet: FeetOfParts, flat: bool) -> np.ndarray:
    """Return a mask of at most _MOST feet of each cell: on new pieces or, if not `flat`, at new parameters."""
    columns = [feet.segment[:, 0] >= 0]
    for k in range(1, feet.segment.shape[1]):
        new = feet.segment[:, k] >= 0
        for j in range(k):
            other = feet.segment[:, k] != feet.segment[:, j]
            new &= other if flat else other | (np.max(np.abs(feet.t[:, k] - feet.t[:, j]), axis=1) > _APART)
        columns.append(new)
    tried = np.stack(columns, axis=1)
    return tried & (np.cumsum(tried, axis=1) <= _MOST)


@optimized
def _bounds_of(
    shapes: Any, count: Array, piece: Array, corners: Array, shares: Array, segment: Array, start: Array
) -> Array:
    """Return upper bounds of the distances over parts of cells, by foot maps into pieces of b."""
    a, b = shapes
    # Graphs of surfaces may slightly leave the box of the surfaces.
    size = 1.0 if a.flat else jnp.maximum(jnp.max(jnp.abs(a.points)), 1.0)

    def one(k: Array, corners: Array, segment: Array, start: Array) -> Array:
        at = weighted(jnp.asarray(inner_lattice(corners.shape[0] - 1, 2, INSET), corners.dtype), corners)
        return foot_map(jax.vmap(lambda x: a.piece(k).point(x))(at), b.piece(segment), start)

    def group(piece: Array, corners: Array, shares: Array, segment: Array, start: Array) -> Array:
        # Sums of non-negative numbers, so that relative errors are those of a few roundings.
        inner, complement = (jax.vmap(weighted)(shares, x) for x in (corners, 1 - corners))
        sigma = jax.vmap(one)(piece, inner, segment, start)
        inner, complement, sigma = (jnp.moveaxis(x, 0, -1) for x in (inner, complement, sigma))
        k = corners.shape[1] - 1
        part = part_over(k, a.piece(piece), inner, complement)
        other = part_over(k, b.piece(segment), sigma, 1 - sigma)
        return bound_between(k, part, other, sum(a.degrees) + sum(b.degrees), size)

    return in_groups(group, count, (piece, corners, shares, segment, start), _LANES_OF_PARTS)


@optimized
def _farthest_corner(b: Any, count: Array, points: Array, segment: Array) -> Array:
    def one(points: Array, segment: Array) -> Array:
        return jnp.max(jax.vmap(lambda p: distance_to(b.piece(segment), p))(points[:-1]))

    return each(one, count, (points, segment), _LANES)


@compiled
def _beyond(b: Any, count: Array, points: Array, segment: Array, start: Array) -> Array:
    return each(lambda p, k, x: beyond_sides(b.piece(k), p, x), count, (points, segment, start), _LANES)


@compiled
def _shares(
    shapes: Any, count: Array, piece: Array, ends: Array, segment: Array, start: Array, side: Array, values: Array
) -> Array:
    a, b = shapes

    def one(k: Array, ends: Array, segment: Array, start: Array, side: Array, values: Array) -> Array:
        return share_on_side(a.piece(k), b.piece(segment), ends, start, side, values)

    return each(one, count, (piece, ends, segment, start, side, values), _LANES)


@compiled
def _places_of(a: Any, count: Array, piece: Array, x: Array) -> Array:
    return each(lambda k, x: a.piece(k).point(x), count, (piece, x), _LANES)
