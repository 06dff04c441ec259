"""The cells of an implicit surface and the pieces of another shape that may hold the nearest points of both.

Two points, one proven on each shape, give an upper bound; alternating projections find them. Pairs of boxes that are
farther apart hold no nearest points. The cells of the surface are cut until they are about as large as the remaining
pieces, so that a search begins with few and small pairs, not with the whole box for each piece.
"""

from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma
from jhd._distance.nearest.forms import signed_values
from jhd._distance.nearest.target import AbstractTarget, MeshTarget
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.on_patches import NetTarget
from jhd._distance.search.on_surfaces import SurfaceTarget
from jhd._distance.search.row_batches import BLOCK
from jhd._distance.search.surface_source import eighths
from jhd._runtime.compiled import compiled
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.closest_point import in_blocks_of

# Points from which feet are followed to and fro, and how often; each time reduces the excess by a fraction.
_STARTS, _ROUNDS = 32, 12
# Pieces that are examined around a point.
_AROUND = 64
# Times that cells are cut at most, and pairs from which on they are not cut any more.
_CUTS, _MANY = 12, 1 << 18
# Times that an edge which crosses the surface is halved.
_HALVINGS = 60
# Rounding errors of boxes, lengths and control points are far below this many units of roundoff.
_SLACK = 1e4


class NearPairs(NamedTuple):
    """Pairs of cells of a surface and pieces, sorted by a lower bound of their distance."""

    lower: Any  # proven lower bounds
    low: Any  # lower corners of the cells, (pairs, 3)
    high: Any  # upper corners of the cells
    piece: Any  # the piece of each pair

    def part(self, start: int, count: int) -> "NearPairs":
        """Return `count` pairs from `start` on, padded with copies of the last pair with an infinite bound."""
        index = np.arange(start, start + count)
        rows = NearPairs(*(x[np.minimum(index, len(self.lower) - 1)] for x in self))
        return rows._replace(lower=np.where(index < len(self.lower), rows.lower, np.inf))


class Crossing(NamedTuple):
    """A crossing of an edge of a triangle and a surface: triangle, parameters as a bilinear patch, and point."""

    piece: int
    x: np.ndarray
    place: np.ndarray

    @property
    def pairs(self) -> NearPairs:
        """The pair of this triangle with the surface, cut down to the point."""
        place = self.place[None]
        return NearPairs(np.zeros(1, place.dtype), place, place, np.array([self.piece]))


def crossing(side: Side, net: Net, count: int) -> Crossing | None:
    """Return a crossing of a triangle edge inside the box, from different signs at its ends; None without one.

    As the edge is straight and the box convex, a zero lies between the ends: then the shapes are proven to meet.
    """
    corners = np.asarray(net.points)[:count][:, np.array([0, 0, 1]), np.array([0, 1, 1])]
    inside = np.all((corners >= np.asarray(side.lower)) & (corners <= np.asarray(side.upper)), axis=-1)
    sign = np.where(inside, _signs(side, corners.reshape(-1, 3)).reshape(-1, 3), 0)
    piece, edge = np.nonzero(sign * np.roll(sign, -1, axis=1) < 0)
    if not len(piece):
        return None
    k, i = int(piece[0]), int(edge[0])
    ends = corners[k, i], corners[k, (i + 1) % 3]
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = _signs(side, (ends[0] + middle * (ends[1] - ends[0]))[None])[0] == sign[k, i]
        low, high = (middle, high) if same else (low, middle)
    # The first corner is one side of the patch, the other two are the ends of the opposite one.
    x = {0: (0.0, low), 1: (low, 1.0), 2: (1.0, 1.0 - low)}[i]
    place = np.clip(ends[0] + low * (ends[1] - ends[0]), np.asarray(side.lower), np.asarray(side.upper))
    return Crossing(k, np.array(x, corners.dtype), place)


def _signs(side: Side, points: np.ndarray) -> np.ndarray:
    """Return the signs of the polynomial at points (points, 3), 0 if rounding leaves them open."""
    return in_blocks_of((1, BLOCK), partial(_signs_of, side), (points,))


@compiled
def _signs_of(side: Side, count: Array, points: Array) -> Array:
    value, error = signed_values(side, points.T)
    return jnp.where(jnp.abs(value) > error, jnp.sign(value), 0.0)


def near_pairs(side: Side, net: Net, count: int, is_mesh: bool) -> tuple[NearPairs, NearPairs] | None:
    """Return the pairs that may hold nearest points, and a few near pieces, each with the whole box.

    None if no point of the surface is proven.

    Args:
        side: the surface, its numbers known.
        net: the pieces in the same coordinates, of at most one.
        count: the number of pieces; further ones repeat the last.
        is_mesh: whether the pieces are triangles.

    Raises:
        ValueError: the surface is proven to have no point in its box.
    """
    points: Any = np.asarray(net.points)[:count]
    surface = SurfaceTarget(side)
    weights = None if net.weights is None else net.weights[:count]
    upper, near = _upper(surface, _target(Net(points, weights), is_mesh))
    if not np.isfinite(upper):
        return None
    ends = points.min(axis=(1, 2)), points.max(axis=(1, 2))
    cover, slack = surface.target.cover, _SLACK * float(np.finfo(points.dtype).eps)
    alive = np.asarray(cover.alive)
    low, high = np.asarray(cover.lower).T[alive], np.asarray(cover.upper).T[alive]
    cell, piece, lower = _within(low, high, *ends, upper + slack)
    for _ in range(_CUTS):
        used, cell = np.unique(cell, return_inverse=True)
        low, high = low[used], high[used]
        small = np.median(np.max(ends[1][piece] - ends[0][piece], axis=1)) if len(piece) else np.inf
        if np.max(high - low, initial=0.0) <= small or len(piece) > _MANY:
            break
        low, high, parent = eighths(side, low, high)
        cell, piece, lower = _of_children(low, high, parent, cell, piece, *ends, upper + slack)
    order = np.argsort(lower, kind="stable")
    cell, piece = cell[order], piece[order]
    lower = np.maximum(lower[order] * (1 - gamma(32, low.dtype)) - slack, 0.0)
    return NearPairs(lower, low[cell], high[cell], piece), _whole(side, near)


def around(side: Side, net: Net, count: int, place: np.ndarray) -> NearPairs:
    """Return some pieces next to a point, each with the whole box of the surface."""
    points: Any = np.asarray(net.points)[:count]
    gap = _gap(place, place, points.min(axis=(1, 2)), points.max(axis=(1, 2)))
    return _whole(side, np.argsort(gap, kind="stable")[:_AROUND])


def _whole(side: Side, pieces: np.ndarray) -> NearPairs:
    low, high = (np.tile(np.asarray(end), (len(pieces), 1)) for end in (side.lower, side.upper))
    return NearPairs(np.zeros(len(pieces), low.dtype), low, high, pieces)


def _target(net: Net, is_mesh: bool) -> AbstractTarget:
    if not is_mesh:
        return NetTarget(net)
    corners: Any = net.points[:, np.array([0, 0, 1]), np.array([0, 1, 1])]
    return MeshTarget(TriangleMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)))


def _upper(surface: SurfaceTarget, other: AbstractTarget) -> tuple[float, np.ndarray]:
    """Bound the minimum distance from above (infinite if no point is proven), and return the pieces of the feet."""
    cloud = surface.target.cloud
    radius = np.asarray(cloud.radius, np.float64)
    known = np.isfinite(radius)
    if not known.any():
        return np.inf, np.empty(0, int)
    found = other.near(np.asarray(cloud.points).T[known])
    uppers = found.upper + radius[known]
    best, found = float(uppers.min()), found.take(np.argsort(uppers)[:_STARTS])
    for _ in range(_ROUNDS):
        there = surface.near(found.foot)
        best = min(best, float((there.upper + other.error(found)).min()))
        found = other.near(np.where(np.isfinite(there.upper)[:, None], there.foot, found.foot))
        # If no foot is proven the error is infinite, and so is the sum.
        best = min(best, float((found.upper + surface.error(there)).min()))
    return best * (1 + gamma(16, radius.dtype)), np.unique(found.segment)


def _within(
    low: np.ndarray, high: np.ndarray, least: np.ndarray, most: np.ndarray, upper: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs of cells and pieces whose boxes are at most `upper` apart, with the gaps of the boxes."""
    cells, pieces, gaps = [np.empty(0, int)], [np.empty(0, int)], [np.empty(0)]
    for k in range(len(low)):
        gap = _gap(low[k], high[k], least, most)
        near = np.flatnonzero(gap <= upper)
        cells.append(np.full(len(near), k))
        pieces.append(near)
        gaps.append(gap[near])
    return np.concatenate(cells), np.concatenate(pieces), np.concatenate(gaps)


def _of_children(
    low: np.ndarray,
    high: np.ndarray,
    parent: np.ndarray,
    cell: np.ndarray,
    piece: np.ndarray,
    least: np.ndarray,
    most: np.ndarray,
    upper: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs of parts of cells and pieces, from pairs of their parents, that are at most `upper` apart."""
    order = np.argsort(parent, kind="stable")
    first = np.searchsorted(parent[order], np.arange(cell.max(initial=-1) + 2))
    numbers = (first[1:] - first[:-1])[cell]
    pieces = np.repeat(piece, numbers)
    within = np.arange(len(pieces)) - np.repeat(np.cumsum(numbers) - numbers, numbers)
    cells = order[np.repeat(first[cell], numbers) + within]
    gap = _gap(low[cells], high[cells], least[pieces], most[pieces])
    near = gap <= upper
    return cells[near], pieces[near], gap[near]


def _gap(low: np.ndarray, high: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return the distances of boxes."""
    apart = np.maximum(np.maximum(low - most, least - high), 0.0)
    return np.sqrt(np.sum(apart * apart, axis=-1))
