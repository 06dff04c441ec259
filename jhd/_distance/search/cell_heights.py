"""Bounds over cells near a curve or parametric surface by heights (normal_offset_bounds), from the host.

Parts of the pieces of b whose boxes are near a cell may be nearest; for each piece one box of parameters holds them.
The cell has no lower bound if one of the pieces has no valley there, for example about a pole or an edge where sides
meet in a fold, or if too many pieces are near.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._arithmetic.balls import Ball
from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.simplices import dividing, inner_lattice, lattice
from jhd._distance.cells.arc_length_area import FlatCells, off_by, restricted
from jhd._distance.cells.foot_maps import INSET, Triangles, foot_map, part_over, weighted
from jhd._distance.cells.normal_offset_bounds import (
    HeightBounds,
    Valley,
    growth_beyond,
    heights_between,
    means_of_products,
    unknown_bounds,
    valley,
)
from jhd._distance.nearest.target import AbstractTarget, ProvenFeet
from jhd._distance.normalization.net_jets import Net, jet
from jhd._distance.search.followed_cells import FeetOfParts, FollowedFeet, Simplices, corners_of
from jhd._distance.search.row_batches import each, in_blocks, in_groups
from jhd._distance.search.sources import CellRows
from jhd._runtime.arrays import taken
from jhd._runtime.compiled import compiled, optimized

# Parts of all pieces, about, and most along a parameter of one.
_PARTS, _MOST_ALONG = 1 << 14, 32
# Most pieces near a cell, and how far they are continued beyond their sides.
_MOST_PIECES, _BEYOND = 6, 0.5
# How often simplices over which heights change their signs are divided.
_LEVELS = 2
# Cells processed in one batch.
_LANES, _LANES_OF_PARTS = 8, 16
# Pairs of cells and boxes that are formed at once.
_PAIRS = 1 << 20
_ROUNDINGS = gamma(512, np.float64)


class _NearPieces(NamedTuple):
    """Pairs of simplices and nearby pieces: indices of both, the box of parameters, and parameters near the foot."""

    who: Int[np.ndarray, " pairs"]
    segment: Int[np.ndarray, " pairs"]
    low: Float[np.ndarray, "pairs parameters"]
    high: Float[np.ndarray, "pairs parameters"]
    start: Float[np.ndarray, "pairs parameters"]

    take = taken


class _HeightsSeen(NamedTuple):
    """Heights and valleys of pairs; see jhd._distance.cells.normal_offset_bounds."""

    height: np.ndarray
    aside: np.ndarray
    aside_sq: np.ndarray
    error: np.ndarray
    steep: np.ndarray
    tilt: np.ndarray
    modulus: np.ndarray
    inside: np.ndarray


class _Hull(NamedTuple):
    """Boxes of cells."""

    mid: np.ndarray
    rad: np.ndarray

    take = taken


class _BoxesOfParts(NamedTuple):
    """Parts of pieces: boxes (pieces, parts, 3), parameters (parts, parameters), and boxes of pieces (2, pieces, 3)."""

    low: np.ndarray
    high: np.ndarray
    first: np.ndarray
    last: np.ndarray

    @property
    def of_pieces(self) -> tuple[np.ndarray, np.ndarray]:
        """The ends of the boxes of whole pieces."""
        return np.min(self.low, axis=1), np.max(self.high, axis=1)


class CellHeights:
    """Bounds by heights between two shapes in common coordinates.

    Args:
        a: the shape whose cells are bounded: a net, or the corners of triangles.
        b: the shape that distances are taken to, without repetitions; triangles get upper bounds only.
        target: finds nearest points of `b`.
    """

    def __init__(self, a: Net | Triangles, b: Net | Triangles, target: AbstractTarget):
        self._followed = FollowedFeet(a, b, target)
        self._shapes = self._followed.shapes
        # Parameters that feet come with.
        self._width = max(2, b.parameters)
        self._parts = _parts_of(b) if isinstance(b, Net) else None
        self._dtype, self._k = np.asarray(b[0]).dtype, min(a.parameters, 2)

    def over(self, cells: CellRows, flat: FlatCells, found: ProvenFeet, most: np.ndarray) -> HeightBounds:
        """Return bounds over cells."""
        corners = corners_of(cells, self._shapes[0].flat)
        count, many = corners.shape[:2]
        box = _hull_of(flat.corners, flat.slack, self._dtype)
        pairs, few = self._own(found) if self._parts is None else self._pairs(self._parts, box, found, most)
        if not len(pairs.who):
            return unknown_bounds(count)
        of = np.repeat(np.arange(count), many)
        whole = np.broadcast_to(np.eye(corners.shape[2], dtype=corners.dtype), (len(of), *corners.shape[2:3] * 2))
        parts = self._followed.parts(cells.piece[of], corners.reshape(-1, *corners.shape[2:]), whole)
        normal = self._normals(np.mean(flat.corners, axis=1), found)[of]
        pairs = _for_each(pairs, many)
        seen = self._seen(parts, pairs, normal, box.take(of), _BEYOND)
        below = _below(self._k, seen, pairs.who, few[of])
        above = self._above(parts, pairs, seen, normal)
        least, least_mean, least_square = (x.reshape(-1, many) for x in below)
        most, most_mean, most_square = (x.reshape(-1, many) for x in above)
        # Simplices of a cell are as large in its parameters.
        means = [np.mean(x, axis=1) for x in (least_mean, most_mean, least_square, most_square)]
        return HeightBounds(np.min(least, axis=1), np.max(most, axis=1), *means)

    def _above(self, parts: Simplices, pairs: _NearPieces, seen: _HeightsSeen, normal: np.ndarray) -> np.ndarray:
        """Return upper bounds (3, simplices): everywhere, of the mean, of the mean of squares."""
        bounds = np.full((3, len(parts.piece)), np.inf)
        np.minimum.at(bounds.T, pairs.who, np.where(seen.inside, _upper(self._k, seen), np.inf).T)
        missing = np.isinf(bounds[1])
        pairs = pairs.take(missing[pairs.who])
        rows, first, place = np.unique(pairs.who, return_index=True, return_inverse=True)
        if len(rows):
            column = np.arange(len(place)) - first[place]
            shape = len(rows), int(np.max(column)) + 1
            feet = FeetOfParts(np.full(shape, -1), np.zeros((*shape, self._width), self._dtype))
            feet.segment[place, column], feet.t[place, column, : pairs.start.shape[1]] = pairs.segment, pairs.start
            bounds[:, rows] = self._by_parts(parts.take(rows), feet, normal[rows])
        return bounds

    def _by_parts(self, parts: Simplices, feet: FeetOfParts, normal: np.ndarray, cuts: int = 0) -> np.ndarray:
        """Return `_above` for parts, cut if their feet leave a piece; `cuts` counts the cuts so far."""
        n, index = self._shapes[1].parameters, np.arange(len(parts.piece))
        sides = np.zeros((len(index), n)), np.ones((len(index), n))
        pairs = _NearPieces(index, feet.segment[:, 0], *sides, feet.t[:, 0, :n])
        box = _Hull(np.zeros((len(index), 3)), np.ones((len(index), 3)))
        bounds = _upper(self._k, self._seen(parts, pairs, normal, box, 0.0))
        if cuts < self._followed.most_cuts:
            rows, smaller, feet = self._followed.cut(parts, feet, feet.segment >= 0)
            if len(rows):
                many = len(smaller.piece) // len(rows)
                found = self._by_parts(smaller, feet, np.repeat(normal[rows], many, axis=0), cuts + 1)
                found = found.reshape(3, -1, many)
                sizes = np.abs(np.linalg.det(smaller.shares.astype(np.float64))).reshape(-1, many)
                # A part of size zero without a bound gives NaN, which replaces no bound.
                with np.errstate(invalid="ignore"):
                    shares = sizes / np.sum(sizes, axis=1, keepdims=True)
                    means = np.sum(shares * found[1:], axis=2) + _ROUNDINGS * np.max(found[1:], axis=2)
                joined = np.concatenate([np.max(found[:1], axis=2), means])
                bounds[:, rows] = np.fmin(bounds[:, rows], joined)
        return bounds

    def _seen(
        self, parts: Simplices, pairs: _NearPieces, normal: np.ndarray, box: _Hull, beyond: float
    ) -> _HeightsSeen:
        dtype, who = self._dtype, pairs.who
        rows = (*parts.take(who)[:3], pairs.segment, pairs.start, pairs.low, pairs.high)
        rows += (np.full(len(who), beyond), normal[who], box.mid[who], box.rad[who])
        rows = [x.astype(dtype) if np.issubdtype(x.dtype, np.floating) else x for x in rows]
        found = in_blocks(_heights_of, self._shapes, *rows)
        return _HeightsSeen(*(x.astype(np.float64) if np.issubdtype(x.dtype, np.floating) else x for x in found))

    def _normals(self, middle: np.ndarray, found: ProvenFeet) -> np.ndarray:
        """Return unit vectors across b at the feet, towards the middles of the cells."""
        b = self._shapes[1]
        if isinstance(b, Triangles):
            corners = np.asarray(b.corners, np.float64)[found.segment]
            return _units(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), np.eye(3)[2])
        known = np.all(np.isfinite(found.foot), axis=1)
        segment = np.where(known, found.segment, 0)
        t = np.where(known[:, None], found.t, 0.5)[:, : b.parameters].astype(self._dtype)
        first = in_blocks(_tangents, b, segment, t).astype(np.float64)
        away = middle - np.where(known[:, None], found.foot, middle)
        if b.parameters == 2:
            across = np.cross(first[:, 0], first[:, 1])
            across *= np.where(np.sum(across * away, axis=1) < 0, -1.0, 1.0)[:, None]
        else:
            along = _units(first[:, 0], np.eye(3)[0])
            across = away - np.sum(away * along, axis=1, keepdims=True) * along
        return _units(across, np.eye(3)[2])

    def _own(self, found: ProvenFeet) -> tuple[_NearPieces, np.ndarray]:
        """Return the triangles of the feet only, without others that may be nearest, and no cell as having few."""
        who = np.arange(len(found.segment))
        none = np.zeros_like(found.t)
        return _NearPieces(who, found.segment, none, none, found.t), np.zeros(len(who), bool)

    def _pairs(
        self, parts: _BoxesOfParts, cells: _Hull, found: ProvenFeet, most: np.ndarray
    ) -> tuple[_NearPieces, np.ndarray]:
        """Return the pieces that may be nearest to some point of each cell, and which cells have few."""
        n = self._shapes[1].parameters
        reach = np.where(np.isfinite(most), most, -1.0) * (1 + _ROUNDINGS)
        who, segment = _near(cells, reach, parts.of_pieces)
        counts = np.bincount(who, minlength=len(reach))
        few = np.logical_and(counts > 0, counts <= _MOST_PIECES)
        who, segment = who[few[who]], segment[few[who]]
        gaps = _gaps(cells.take(who), parts.low[segment], parts.high[segment])
        near = np.less_equal(gaps, reach[who, None])
        some = np.any(near, axis=1)
        who, segment, near, gaps = (x[some] for x in (who, segment, near, gaps))
        low = np.min(np.where(near[..., None], parts.first, np.inf), axis=1)
        high = np.max(np.where(near[..., None], parts.last, -np.inf), axis=1)
        start = 0.5 * (parts.first + parts.last)[np.argmin(gaps, axis=1)]
        own = segment == found.segment[who]
        start = np.where(own[:, None], found.t[who][:, :n], start)
        few &= np.bincount(who, minlength=len(few)) > 0
        # The piece of the foot comes first.
        order = np.lexsort((~own, who))
        return _NearPieces(who, segment, low, high, np.clip(start, 0.0, 1.0)).take(order), few


def _parts_of(b: Net) -> _BoxesOfParts:
    """Return the boxes of parts of all pieces."""
    points, n, count = np.asarray(b.points, np.float64), b.parameters, len(b.points)
    # A power of two, so that the ends are exact.
    along = 1 << int(np.log2(np.clip((_PARTS / count) ** (1 / n), 1, _MOST_ALONG)))
    first = np.stack([x.ravel() for x in np.meshgrid(*[np.arange(along) / along] * n, indexing="ij")], axis=1)
    last = first + 1 / along
    weights = None if b.weights is None else np.asarray(b.weights, np.float64)[..., None]
    rows = points if weights is None else np.concatenate([points * weights, weights], axis=-1)
    many = len(first)
    piece = np.repeat(np.arange(count), many)
    found = restricted(rows[piece], np.tile(first, (count, 1)), np.tile(last, (count, 1)))
    off = np.full(len(found), off_by(b.degrees))
    if weights is not None:
        off = 4 * off / np.min(found[..., 3], axis=(1, 2))
        found = found[..., :3] / found[..., 3:]
    off = (off + _ROUNDINGS)[:, None]
    low, high = np.min(found, axis=(1, 2)) - off, np.max(found, axis=(1, 2)) + off
    return _BoxesOfParts(low.reshape(count, many, 3), high.reshape(count, many, 3), first, last)


def _hull_of(corners: np.ndarray, slack: np.ndarray, dtype: np.dtype) -> _Hull:
    low, high = np.min(corners, axis=1), np.max(corners, axis=1)
    mid = 0.5 * (low + high)
    # In the format of the shapes the middle may be another one.
    room = (slack + gamma(64, dtype) * np.max(np.abs(corners), axis=(1, 2)))[:, None]
    return _Hull(mid, (np.maximum(high - mid, mid - low) + room) * (1 + gamma(16, dtype)))


def _gaps(cells: _Hull, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return lower bounds of the distances of boxes of cells from boxes of parts."""
    mid, rad = cells.mid[:, None], cells.rad[:, None]
    apart = np.maximum(np.maximum(low - mid, mid - high) - rad, 0.0)
    return np.sqrt(np.sum(apart**2, axis=-1)) * (1 - _ROUNDINGS)


def _near(cells: _Hull, reach: np.ndarray, boxes: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of cells and boxes within reach of them."""
    step = max(1, _PAIRS // len(boxes[0]))
    starts = range(0, len(reach), step)
    found = [np.nonzero(_gaps(cells.take(slice(k, k + step)), *boxes) <= reach[k : k + step, None]) for k in starts]
    rows = [row + k for k, (row, _) in zip(starts, found, strict=True)]
    return np.concatenate(rows), np.concatenate([piece for _, piece in found])


def _units(x: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    length = np.sqrt(np.sum(x**2, axis=1, keepdims=True))
    return np.where(length > 0, x / np.where(length > 0, length, 1.0), otherwise)


def _for_each(pairs: _NearPieces, many: int) -> _NearPieces:
    """Return the pairs of cells repeated for all simplices of each cell."""
    rows = np.repeat(np.arange(len(pairs.who)), many)
    who = pairs.who[rows] * many + np.tile(np.arange(many), len(pairs.who))
    return pairs.take(rows)._replace(who=who)


def _means(k: int, rows: np.ndarray) -> np.ndarray:
    """Return the means of squares of polynomials from their coefficients."""
    return np.sum((rows @ means_of_products(k, _degree(k, rows))) * rows, axis=1)


def _degree(k: int, rows: np.ndarray) -> int:
    """Return the degree of polynomials in `k` variables with as many coefficients as `rows` has columns."""
    return next(n for n in range(rows.shape[1]) if len(lattice(k, n)) == rows.shape[1])


def _below(k: int, seen: _HeightsSeen, who: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return lower bounds (3, simplices): everywhere, of the mean, of the mean of squares."""
    size = np.max(np.abs(seen.height), axis=1, initial=0.0) + seen.error
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scale = np.where(seen.modulus > 0, np.sqrt(seen.modulus), 0.0) * (1 - _ROUNDINGS)
        tilt, missed = seen.tilt / scale, seen.steep / scale * (seen.aside + seen.error) * (1 + _ROUNDINGS)
        nothing = missed / (1 - tilt) * (1 + _ROUNDINGS)
        lost = (tilt * size + missed) * (1 + _ROUNDINGS)
        chord = np.sqrt((size - lost) * (size + lost)) / (size - nothing) * (1 - _ROUNDINGS)
    useful = (tilt < 1) & (lost < size) & (nothing < size)
    rows = []
    for sign in (1.0, -1.0):
        with np.errstate(invalid="ignore"):
            # The amount subtracted last exceeds the roundings of differences, which may cancel.
            found = chord[:, None] * (sign * seen.height - (seen.error + nothing + _ROUNDINGS * size)[:, None])
        lowest = np.full((len(known), found.shape[1]), np.inf)
        np.minimum.at(lowest, who, np.where(useful[:, None], found, -np.inf))
        rows.append(np.where(known[:, None] & np.isfinite(lowest), lowest, -1.0))
    return np.max(np.stack([_of_positive(k, *pair) for pair in (rows, rows[::-1])]), axis=0)


def _of_positive(k: int, rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return lower bounds (3, simplices) of a function above two polynomials and zero, of its mean and mean square.

    If the first polynomial changes its sign, the function is bounded on parts, by the larger of both polynomials.
    """
    least, mean, share = np.min(rows, axis=1), np.mean(rows, axis=1), _of_sums(rows)
    room = share * np.max(np.abs(rows), axis=1)
    square = np.where(least > 0, _means(k, np.maximum(rows, 0.0)), np.maximum(mean - room, 0.0) ** 2)
    found = np.stack([least, mean - room, square * (1 - share)])
    mixed = np.flatnonzero((least < 0) & (np.max(rows, axis=1) > 0))
    if len(mixed):
        parts = [_divided(k, x[mixed]) for x in (rows, others)]
        means = np.maximum(*(np.mean(x, axis=-1) for x in parts)) - room[mixed, None]
        means = np.maximum(means, 0.0)
        found[1, mixed] = np.maximum(found[1, mixed], np.mean(means, axis=1) * (1 - share))
        found[2, mixed] = np.maximum(found[2, mixed], np.mean(means**2, axis=1) * (1 - share))
    return np.maximum(found, 0.0)


def _divided(k: int, rows: np.ndarray) -> np.ndarray:
    """Return coefficients (simplices, parts, indices) on repeated halves (segments) or quarters (triangles)."""
    parts = rows[:, None]
    matrices = dividing(k, _degree(k, rows))
    for _ in range(_LEVELS):
        parts = np.einsum("snj,pij->snpi", parts, matrices, optimize=True).reshape(len(rows), -1, rows.shape[1])
    return parts


def _upper(k: int, seen: _HeightsSeen) -> np.ndarray:
    """Return upper bounds (3, pairs) of heights, for maps sigma that stay on the piece."""
    sizes, share = np.abs(seen.height), _of_sums(seen.height)
    most, error = np.max(sizes, axis=1), seen.error
    aside, mean_sq = seen.aside + error, seen.aside_sq + error * (2 * seen.aside + error)
    more = _more(_least(seen.height) - error, aside, aside**2)
    mean = np.mean(sizes, axis=1) + _more(_least(seen.height) - error, aside, mean_sq)
    mixed = np.flatnonzero(_least(seen.height) < 0)
    if len(mixed):
        parts = _divided(k, seen.height[mixed])
        wide = [x[mixed, None] for x in (aside, error + share * most)]
        by_parts = np.mean(np.abs(parts), axis=-1) + _more(_least(parts) - wide[1], wide[0], wide[0] ** 2)
        mean[mixed] = np.minimum(mean[mixed], np.mean(by_parts, axis=1) + share * most[mixed])
    square = _means(k, seen.height) + seen.aside_sq
    square = square + error * (2 * (most + seen.aside) + error) + share * most**2
    found = np.stack([most + more + error, mean + error, square])
    return np.where(np.isnan(found), np.inf, found * (1 + share))


def _of_sums(rows: np.ndarray) -> float:
    """Bound the roundings of means of coefficients, of their products, and of parts: up to three sums over all."""
    return gamma(4 * rows.shape[1] + 64, np.float64)


def _least(rows: np.ndarray) -> np.ndarray:
    """Return lower bounds of the sizes of polynomials; negative if they may change their signs."""
    return np.maximum(np.min(rows, axis=-1), -np.max(rows, axis=-1))


def _more(least: np.ndarray, aside: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Bound sqrt(s^2 + t^2) - |s| from above for |s| >= least, |t| <= `aside` and t^2 of about `square`."""
    return np.where(least > 0, np.minimum(aside, square / np.where(least > 0, 2 * least, 1.0)), aside)


@optimized
def _heights_of(
    shapes: Any,
    count: Array,
    piece: Array,
    corners: Array,
    shares: Array,
    segment: Array,
    start: Array,
    low: Array,
    high: Array,
    beyond: Array,
    normal: Array,
    mid: Array,
    rad: Array,
) -> Any:
    """Return heights and valleys of pairs, and whether sigma stays on the piece."""
    a, b = shapes

    def one(k: Array, corners: Array, j: Array, start: Array, *rest: Array) -> Any:
        low, high, beyond, normal, mid, rad = rest
        at = weighted(jnp.asarray(inner_lattice(corners.shape[0] - 1, 2, INSET), corners.dtype), corners)
        feet = foot_map(jax.vmap(lambda x: a.piece(k).point(x))(at), b.piece(j), start, beyond)
        if b.flat:
            # Cells are cut at the boundary of triangles, so the map may do anything beyond.
            none = jnp.zeros_like(low[0])
            return feet, Valley(none, none, none), none + 1, jnp.zeros((), bool)
        ends = jnp.min(feet, axis=0), jnp.max(feet, axis=0)
        box = jnp.minimum(low, ends[0]), jnp.maximum(high, ends[1])
        found = valley(b.piece(j), *box, feet, normal, Ball(mid, rad))
        return feet, found, growth_beyond(b.piece(j), *ends), jnp.all((feet >= 0) & (feet <= 1))

    def group(piece: Array, corners: Array, shares: Array, segment: Array, *rest: Array) -> Any:
        # Sums of non-negative numbers, so that relative errors are those of a few roundings.
        inner, complement = (jax.vmap(weighted)(shares, x) for x in (corners, 1 - corners))
        sigma, found, growth, inside = jax.vmap(one)(piece, inner, segment, *rest)
        inner, complement, sigma = (jnp.moveaxis(x, 0, -1) for x in (inner, complement, sigma))
        k = corners.shape[1] - 1
        part = part_over(k, a.piece(piece), inner, complement)
        other = part_over(k, b.piece(segment), sigma, 1 - sigma)
        heights = heights_between(k, part, other, sum(a.degrees) + sum(b.degrees), growth, rest[4].T)
        return heights.height.T, *heights[1:], *found, inside

    rows = (piece, corners, shares, segment, start, low, high, beyond, normal, mid, rad)
    return in_groups(group, count, rows, _LANES_OF_PARTS)


@compiled
def _tangents(b: Net, count: Array, segment: Array, t: Array) -> Array:
    return each(lambda k, x: jet(b.piece(k), x).first, count, (segment, t), _LANES)
