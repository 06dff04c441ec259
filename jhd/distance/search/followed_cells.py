"""Bounds over cells by feet that are followed over them, from the host; see jhd.distance.cells.followed.

A box of parameters of a patch is two triangles, that of a curve a segment, and the cells of meshes are triangles. Of
the pieces that the feet of a cell lie on one after the other is tried, until the bound is good enough. Where the foot
leaves its piece within the cell, this is cut along the line through the places on its edges where that happens, and the
parts are bounded one by one, and cut again where that is needed, about a corner of several pieces: without cuts the
bound would be off by the square of the cell's size there.

The new corners divide edges in shares whose sum is exactly one, so the parts cover the cell. Shares of parts of parts
are sums of products of those, all non-negative, so each is off by a factor of gamma(2) a cut, which counts with the
roundings of what is composed with them (jhd.arithmetic.simplices).
"""

from copy import copy
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic.simplices import inner_lattice
from jhd.compiled import compiled, optimised
from jhd.distance.cells.followed import bound_between, levels_of, part_over
from jhd.distance.cells.foot_maps import (
    BEYOND,
    INSET,
    Triangles,
    beyond_sides,
    distance_to,
    foot_map,
    place_on,
    share_on_side,
    weighted,
)
from jhd.distance.frame.curves import padded_count
from jhd.distance.frame.net_jets import Net
from jhd.distance.frame.nets import repeated
from jhd.distance.nearest.target import AbstractTarget, FootRows
from jhd.distance.search.polished_place import moved_feet
from jhd.distance.search.rows import each, in_blocks, in_groups
from jhd.distance.search.sources import CellRows

# Cells done side by side: few, since often there are no more; of polynomials over them some more.
_LANES, _LANES_OF_PARTS = 8, 16
# Feet of one piece belong to different maps where their parameters are farther apart than this.
_APART = 0.5
# Feet of a cell that are tried.
_MOST = 4
# A cell is cut where it goes beyond a side by this share of what it is long, where the foot of its middle is as far
# from the mean of those of its corners as this share of that, and where it is at most so many pieces long.
_LEAST, _BENT, _LONG = 1e-7, 0.3, {Net: 0.9, Triangles: 2.0}
# How often cells are cut, and then their parts: about a corner of patches two lines meet, of triangles three.
_CUTS = {Net: 2, Triangles: 3}
# A piece that is farther from a corner of a cell than the goal by this factor does not help.
_HOPELESS = 1.5
# Parts of a triangle of which one corner is on the one side of a cut and two are on the other: corners by their
# numbers from the first on, and the ends 3 and 4 of the cut, which lie towards the second and the third.
_PARTS_OF_TRIANGLE = np.array([[0, 3, 4], [3, 1, 2], [3, 2, 4]])
_PARTS_OF_SEGMENT = np.array([[0, 2], [2, 1]])


class _Simplices(NamedTuple):
    """Segments or triangles of parameters: the piece, its corners, and the corners of the part that counts in it.

    Args:
        piece: of a.
        corners: parameters of the corners (cells, corners, parameters of a).
        shares: rows of non-negative numbers whose sum is one, (cells, corners, corners); see the module.
    """

    piece: np.ndarray
    corners: np.ndarray
    shares: np.ndarray

    def take(self, rows: Any) -> "_Simplices":
        """Some of them."""
        return _Simplices(*(x[rows] for x in self))

    @property
    def places(self) -> np.ndarray:
        """The parameters of the corners of the parts, about."""
        return self.shares @ self.corners


class _FeetOfParts(NamedTuple):
    """Feet of each part: their pieces (parts, feet), -1 for none, and parameters there."""

    segment: np.ndarray
    t: np.ndarray

    def take(self, rows: Any) -> "_FeetOfParts":
        """Those of some of the parts."""
        return _FeetOfParts(self.segment[rows], self.t[rows])


class FollowedFeet:
    """Bounds between two shapes in common coordinates.

    Args:
        a: the shape whose cells are bounded: a net, or the corners of triangles.
        b: the other one, likewise.
        target: its nearest points.
    """

    def __init__(self, a: Net | Triangles, b: Net | Triangles, target: AbstractTarget):
        self._target, self.shapes = target, (_padded(a), _padded(b))
        self._long, self._most_cuts = _LONG[type(b)], _CUTS[type(b)]

    def instead(self, a: Net) -> "FollowedFeet":
        """The same for cells of other pieces, which are as many as programs are compiled for."""
        found = copy(self)
        found.shapes = (a, self.shapes[1])
        return found

    def over(self, cells: CellRows, feet: FootRows, goal: float | np.ndarray) -> np.ndarray:
        """Proven upper bounds of the distances of all points in cells, from their feet.

        Args:
            cells: of a.
            feet: of each, on pieces of b, in the order in which they are tried.
            goal: what is below it need not be any better; of all cells, or of each.
        """
        corners = self._corners(cells)
        many, count = corners.shape[1:3]
        whole = np.broadcast_to(np.eye(count, dtype=corners.dtype), (len(corners) * many, count, count))
        parts = _Simplices(np.repeat(cells.piece, many), corners.reshape(-1, *corners.shape[2:]), whole)
        goals = np.repeat(np.broadcast_to(goal, len(corners)), many)
        every = _FeetOfParts(feet.segment, feet.t).take(np.repeat(np.arange(len(corners)), many))
        bound = self._bounded(parts, every, goals)
        return np.max(bound.reshape(-1, many), axis=1)

    def moved(self, place: Any, feet: FootRows) -> FootRows:
        """Feet on the pieces where they are, as those of a place of a."""
        known = feet.segment >= 0
        new = moved_feet(self.shapes, place.piece, place.x, feet.map(lambda x: x[known]))
        feet = feet.map(np.array)
        for held, rows in zip(feet, new, strict=True):
            held[known] = rows
        return feet

    def _bounded(self, parts: _Simplices, feet: _FeetOfParts, goal: np.ndarray, cuts: int = 0) -> np.ndarray:
        """Bounds of parts, which are cut so often already."""
        tried = _worth_trying(feet, isinstance(self.shapes[1], Triangles))
        bound = self._by_any(parts, feet, self._hopeful(parts, feet, tried, goal), goal)
        rows = np.flatnonzero(bound > goal)
        if len(rows) and cuts < self._most_cuts:
            by_cuts = self._by_cuts(parts.take(rows), feet.take(rows), tried[rows], goal[rows], cuts)
            bound[rows] = np.fmin(bound[rows], by_cuts)
        return bound

    def _hopeful(self, parts: _Simplices, feet: _FeetOfParts, tried: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Which feet are tried: of triangles not those that are too far from a corner of the part."""
        if not isinstance(self.shapes[1], Triangles) or not np.all(goal > 0):
            return tried
        rows, k = np.nonzero(tried)
        far = in_blocks(_farthest_corner, self.shapes, parts.piece[rows], parts.places[rows], feet.segment[rows, k])
        hopeful = np.zeros_like(tried)
        hopeful[rows, k] = far <= _HOPELESS * goal[rows]
        return hopeful

    def _by_any(self, parts: _Simplices, feet: _FeetOfParts, tried: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Bounds by one foot after the other."""
        bound = np.full(len(parts.piece), np.inf)
        for k in range(tried.shape[1]):
            rows = np.flatnonzero(tried[:, k] & (bound > goal))
            if len(rows):
                found = self._bounds(parts.take(rows), feet.segment[rows, k], feet.t[rows, k])
                bound[rows] = np.fmin(bound[rows], found)
        return bound

    def _corners(self, cells: CellRows) -> np.ndarray:
        """The corners (cells, simplices, corners, parameters) of what cells are made of."""
        low, high = cells.low, cells.high
        if low.shape[1] == 1:
            return np.stack([low, high], axis=1)[:, None]
        mixed = [np.stack([low[:, 0], high[:, 1]], axis=1), np.stack([high[:, 0], low[:, 1]], axis=1)]
        first = np.stack([low, mixed[1], mixed[0]], axis=1)
        if isinstance(self.shapes[0], Triangles):
            # Multiples of a power of two, so that the third coordinate is exact.
            return np.concatenate([1 - np.sum(first, axis=-1, keepdims=True), first], axis=-1)[:, None]
        return np.stack([first, np.stack([high, *mixed], axis=1)], axis=1)

    def _start(self, t: np.ndarray, like: np.ndarray) -> np.ndarray:
        return t[:, : self.shapes[1].parameters].astype(like.dtype)

    def _bounds(self, parts: _Simplices, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        start = self._start(t, parts.corners)
        return in_blocks(_bounds_of, self.shapes, *parts, segment, start).astype(np.float64)

    def _by_cuts(
        self, parts: _Simplices, feet: _FeetOfParts, tried: np.ndarray, goal: np.ndarray, cuts: int
    ) -> np.ndarray:
        """Bounds of cells that are cut where the foot leaves a piece; infinite where none are."""
        bound = np.full(len(parts.piece), np.inf)
        cut = self._cuts(parts, feet, tried)
        rows = np.flatnonzero(cut.score > _LEAST)
        if len(rows):
            smaller = self._divided(parts.take(rows), _Cuts(*(x[rows] for x in cut)))
            many = len(smaller.piece) // len(rows)
            new = self._target.rows_of(self._target.near(self._middles(smaller)))
            both = zip((new.segment[:, None], new.t[:, None]), feet.take(np.repeat(rows, many)), strict=True)
            every = _FeetOfParts(*(np.concatenate(x, axis=1) for x in both))
            goals = np.repeat(goal[rows], many)
            bound[rows] = np.max(self._bounded(smaller, every, goals, cuts + 1).reshape(-1, many), axis=1)
        return bound

    def _middles(self, parts: _Simplices) -> np.ndarray:
        x = np.mean(parts.places, axis=1)
        return in_blocks(_places_of, self.shapes[0], parts.piece, x)

    def _cuts(self, parts: _Simplices, feet: _FeetOfParts, tried: np.ndarray) -> "_Cuts":
        """For each cell the side that divides it best, of the pieces its feet lie on."""
        count, corners, places = len(parts.piece), parts.corners.shape[1], parts.places
        best = _Cuts(
            np.zeros(count),
            np.zeros(count, int),
            np.zeros(count, feet.segment.dtype),
            np.zeros_like(self._start(feet.t[:, 0], parts.corners)),
            np.zeros((count, corners), parts.corners.dtype),
        )
        for k in range(tried.shape[1]):
            rows = np.flatnonzero(tried[:, k])
            if not len(rows):
                continue
            segment, start = feet.segment[rows, k], self._start(feet.t[rows, k], parts.corners)
            sides = in_blocks(_beyond, self.shapes, parts.piece[rows], places[rows], segment, start)
            score, side = self._scores(sides)
            values = np.take_along_axis(sides[:, :-1], side[:, None, None], axis=2)[:, :, 0]
            better = score > best.score[rows]
            for held, new in zip(best, (score, side, segment, start, values), strict=True):
                held[rows[better]] = new[better]
        return best

    def _scores(self, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How well the best side divides each cell, a share of its length, and which one it is."""
        corners = sides[:, :-1]
        low, high = np.min(corners, axis=1), np.max(corners, axis=1)
        bent, less = np.abs(sides[:, -1] - np.mean(corners, axis=1)), np.minimum(-low, high)
        span = high - low
        apt = (bent < _BENT * less) & (span < self._long) & (span > 1e-9)
        score = np.where(apt, less / np.where(span > 0, span, 1.0), 0.0)
        if isinstance(self.shapes[1], Net):
            # The foot was not followed any farther, or is around a side that is a single point.
            score[np.any(np.abs(sides - 0.5) > 0.5 + 0.99 * BEYOND, axis=(1, 2))] = 0.0
        side = np.argmax(score, axis=1)
        return score[np.arange(len(side)), side], side

    def _divided(self, parts: _Simplices, cut: "_Cuts") -> _Simplices:
        """The parts of each cell, one after the other."""
        count, corners = parts.corners.shape[:2]
        index, places = np.arange(count), parts.places
        below = cut.values < 0
        # The corner that is alone on its side comes first.
        alone = np.argmax(below == (np.sum(below, axis=1, keepdims=True) == 1), axis=1)
        turned = (alone[:, None] + np.arange(corners)) % corners
        rows = [parts.shares[index, turned[:, k]] for k in range(corners)]
        for k in range(1, corners):
            ends = np.stack([places[index, turned[:, j]] for j in (0, k)], axis=1)
            values = np.stack([cut.values[index, turned[:, j]] for j in (0, k)], axis=1)
            share = in_blocks(_shares, self.shapes, parts.piece, ends, cut.segment, cut.start, cut.side, values)
            # Their sum is exactly one: this difference is a multiple of the unit of roundoff.
            rest = 1 - share
            share = 1 - rest
            rows.append(rest[:, None] * rows[0] + share[:, None] * rows[k])
        every = np.stack(rows, axis=1)
        of = _PARTS_OF_TRIANGLE if corners == 3 else _PARTS_OF_SEGMENT
        shares = every[:, of].reshape(-1, corners, corners)
        return _Simplices(np.repeat(parts.piece, len(of)), np.repeat(parts.corners, len(of), axis=0), shares)


class _Cuts(NamedTuple):
    """Where cells are cut: how good that is, side of which piece, a place near, and how far corners are beyond it."""

    score: np.ndarray
    side: np.ndarray
    segment: np.ndarray
    start: np.ndarray
    values: np.ndarray


def _padded(shape: Net | Triangles) -> Net | Triangles:
    """The shape with as many pieces as programs are compiled for."""
    if isinstance(shape, Net):
        return repeated(shape)
    count = len(shape.corners)
    return Triangles(np.asarray(shape.corners)[np.minimum(np.arange(padded_count(count, small=False)), count - 1)])


def _worth_trying(feet: _FeetOfParts, flat: bool) -> np.ndarray:
    """Which feet are on a piece, or a place of it where it is not flat, that none before are; not more than some."""
    columns = [feet.segment[:, 0] >= 0]
    for k in range(1, feet.segment.shape[1]):
        new = feet.segment[:, k] >= 0
        for j in range(k):
            other = feet.segment[:, k] != feet.segment[:, j]
            new &= other if flat else other | (np.max(np.abs(feet.t[:, k] - feet.t[:, j]), axis=1) > _APART)
        columns.append(new)
    tried = np.stack(columns, axis=1)
    return tried & (np.cumsum(tried, axis=1) <= _MOST)


@optimised
def _bounds_of(
    shapes: Any, count: Array, piece: Array, corners: Array, shares: Array, segment: Array, start: Array
) -> Array:
    a, b = shapes
    # Graphs of surfaces may leave the box of these a little.
    size = jnp.maximum(jnp.max(jnp.abs(a.points)), 1.0) if isinstance(a, Net) else 1.0

    def one(k: Array, corners: Array, segment: Array, start: Array) -> Array:
        at = weighted(jnp.asarray(inner_lattice(corners.shape[0] - 1, 2, INSET), corners.dtype), corners)
        return foot_map(jax.vmap(lambda x: place_on(a.piece(k), x))(at), b.piece(segment), start)

    def group(piece: Array, corners: Array, shares: Array, segment: Array, start: Array) -> Array:
        # Sums of non-negative numbers, so that relative errors are those of a few roundings.
        inner, complement = (jax.vmap(weighted)(shares, x) for x in (corners, 1 - corners))
        sigma = jax.vmap(one)(piece, inner, segment, start)
        inner, complement, sigma = (jnp.moveaxis(x, 0, -1) for x in (inner, complement, sigma))
        k = corners.shape[1] - 1
        part = part_over(k, a.piece(piece), inner, complement)
        other = part_over(k, b.piece(segment), sigma, 1 - sigma)
        return bound_between(k, part, other, levels_of(a) + levels_of(b), size)

    return in_groups(group, count, (piece, corners, shares, segment, start), _LANES_OF_PARTS)


@optimised
def _farthest_corner(shapes: Any, count: Array, piece: Array, corners: Array, segment: Array) -> Array:
    a, b = shapes

    def one(k: Array, corners: Array, segment: Array) -> Array:
        return jnp.max(jax.vmap(lambda x: distance_to(b.piece(segment), place_on(a.piece(k), x)))(corners))

    return each(one, count, (piece, corners, segment), _LANES)


@compiled
def _beyond(shapes: Any, count: Array, piece: Array, corners: Array, segment: Array, start: Array) -> Array:
    a, b = shapes

    def one(k: Array, corners: Array, segment: Array, start: Array) -> Array:
        return beyond_sides(a.piece(k), b.piece(segment), corners, start)

    return each(one, count, (piece, corners, segment, start), _LANES)


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
    return each(lambda k, x: place_on(a.piece(k), x), count, (piece, x), _LANES)
