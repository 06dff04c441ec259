"""Polynomial surfaces as what distances are maximised over; see jhd.distance.search.sources."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic.polynomials import slopes
from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.compiled import compiled
from jhd.distance.cells.flats import Hulls
from jhd.distance.cells.surfaces import upper_bounds
from jhd.distance.nearest.forms import boxes, form
from jhd.distance.nearest.places import projected, thorough_radius
from jhd.distance.nearest.surfaces import halved, inner
from jhd.distance.nearest.target import AbstractTarget, FootRows, PointTarget
from jhd.distance.search.candidates import Target
from jhd.distance.search.rows import each, in_blocks
from jhd.distance.search.sources import AbstractSource, CellRows, PlaceOfCut, PlacesOfCells, over_hulls, units

# Cells done side by side.
_LANES = 64
# Newton steps for the points of cells of a polynomial surface.
_STEPS_OF_POINTS = 6
# The twelve edges of a box, by the axis and the signs of the other two coordinates.
_EDGES = [(axis, (-1.0, 1.0)[k & 1], (-1.0, 1.0)[k >> 1]) for axis in range(3) for k in range(4)]


class SurfaceSource(AbstractSource):
    """A polynomial surface, with its cover; cells are boxes."""

    def __init__(self, target: Target):
        self._target = target

    def cover(self) -> CellRows:
        """See AbstractSource."""
        alive = np.asarray(self._target.cover.alive)
        low, high = (np.asarray(x).T[alive] for x in self._target.cover[:2])
        return CellRows(np.full(len(low), -1), low, high)

    def cut(self, cells: CellRows, at: PlaceOfCut | None = None) -> tuple[CellRows, np.ndarray]:
        """See AbstractSource: each into eight."""
        low, high, alive = in_blocks(_eighths, self._target, cells.low, cells.high)
        parent = np.repeat(np.arange(len(cells.piece)), 8)
        rows = np.flatnonzero(alive.ravel())
        parts = CellRows(np.full(8 * len(cells.piece), -1), low.reshape(-1, 3), high.reshape(-1, 3))
        return parts.take(rows), parent[rows]

    def places(self, cells: CellRows) -> PlacesOfCells:
        """See AbstractSource: one inside, one on the faces that the cell touches, and four about it, not proven."""
        points, radius = in_blocks(_places_of_boxes, self._target, cells.low, cells.high)
        return PlacesOfCells(points, radius, points)

    def over(self, cells: CellRows, target: AbstractTarget, feet: FootRows) -> np.ndarray:
        """See AbstractSource."""
        point = np.where(np.isfinite(feet.point), feet.point, 0.0)
        found = in_blocks(_over_boxes, self._target, cells.low, cells.high, point, feet.error)
        if isinstance(target, PointTarget):
            return found
        hulls = Hulls(*in_blocks(_hulls_of_boxes, self._target, cells.low, cells.high))
        return np.fmin(found, over_hulls(hulls, target, feet))

    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See AbstractSource; at an edge of the box the directions along its faces, of which one may leave."""
        side = self._target.side
        low, high = x <= np.asarray(side.lower), x >= np.asarray(side.upper)
        slope = np.asarray(_slope(self._target, x), np.float64)
        if not np.any(low | high):
            frame = np.linalg.svd(slope[None])[2][1:]
            return np.concatenate([frame, -frame]), np.concatenate([frame, -frame])
        axis = int(np.argmax(low | high))
        along = units(np.cross(slope, np.eye(3)[axis])[None])
        inward = units(np.cross(along, slope))
        inward = inward * np.sign(inward[0, axis] or 1.0) * (1 if low[axis] else -1)
        free = np.concatenate([along, -along, inward, -inward])
        leaving = np.any((low & (free < -1e-9)) | (high & (free > 1e-9)), axis=1)
        return free, free[~leaving]

    def parameters(self, x: np.ndarray) -> np.ndarray:
        """See AbstractSource: there are none."""
        return np.asarray(np.nan)


@compiled
def _slope(target: Target, x: Array) -> Array:
    return slopes(jnp.asarray(target.side.coefficients), x)[1]


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
        radius = jnp.where(near, thorough_radius(side, found), jnp.inf)
        # Beside the first of them, for feet alone: on both sides along the surface.
        slope = slopes(jnp.asarray(side.coefficients), found[:, 0])[1]
        along = jnp.cross(slope, jnp.eye(3, dtype=low.dtype)[jnp.argmin(jnp.abs(slope))])
        across = jnp.cross(slope, along)
        size = 0.5 * jnp.max(high - low)
        steps = [size * x / jnp.maximum(jnp.max(jnp.abs(x)), smallest_normal(low.dtype)) for x in (along, across)]
        beside = jnp.stack([found[:, 0] + sign * x for x in steps for sign in (-1.0, 1.0)])
        return jnp.concatenate([found.T, beside]), jnp.concatenate([radius, jnp.full(4, jnp.inf, radius.dtype)])

    return each(one, count, (low, high), _LANES)


@compiled
def _over_boxes(target: Target, count: Array, low: Array, high: Array, feet: Array, radius: Array) -> Array:
    def one(low: Array, high: Array, feet: Array, radius: Array) -> Array:
        cells = boxes(low[:, None], high[:, None])
        free = inner(target.side, low[:, None], high[:, None])
        return upper_bounds(form(target.side, cells), cells, feet[:, :, None], radius[:, None], free)[0]

    return each(one, count, (low, high, feet, radius), _LANES)


@compiled
def _hulls_of_boxes(target: Target, count: Array, low: Array, high: Array) -> Any:
    """What is left of boxes where |f| = |value + slope.e + rest| may vanish, by the ends of their edges there."""

    def one(low: Array, high: Array) -> Any:
        cells = boxes(low[:, None], high[:, None])
        f = form(target.side, cells)
        value, slope, centre, half = f.value[0], f.slope[:, 0], cells.centre[:, 0], cells.half[:, 0]
        size = jnp.abs(value) + jnp.sum(jnp.abs(slope)) + f.rest[0]
        most = (f.rest[0] + f.error[0] + gamma(32, low.dtype) * size) * (1 + gamma(8, low.dtype))
        ends = [_ends_on_edge(value, slope, most, *edge) for edge in _EDGES]
        places, there = (jnp.concatenate(x) for x in zip(*ends, strict=True))
        # Ends that are not there stand where another one does, or anywhere where the box holds no point.
        places = jnp.where(there[:, None], places, places[jnp.argmax(there)])
        corners = jnp.where(jnp.any(there), centre + half * places, centre + half * jnp.sign(places))
        slack = gamma(16, low.dtype) * jnp.max(jnp.abs(centre) + half)
        least = jnp.argmin(jnp.abs(slope / half))
        along = jnp.cross(slope / half, jnp.eye(3, dtype=low.dtype)[least])
        return Hulls(corners, slack, jnp.stack([along, jnp.cross(slope / half, along)]))

    return each(one, count, (low, high), _LANES)


def _ends_on_edge(
    value: Array, slope: Array, most: Array, axis: int, first: float, second: float
) -> tuple[Array, Array]:
    """Both ends (2, 3) of where |value + slope.e| <= most on an edge of [-1, 1]^3, and whether there are any."""
    others = [k for k in range(3) if k != axis]
    rest = value + first * slope[others[0]] + second * slope[others[1]]
    along = slope[axis]
    safe = jnp.where(along != 0, along, 1.0)
    ends = jnp.stack([(-most - rest) / safe, (most - rest) / safe])
    within = jnp.abs(rest) <= most
    ends = jnp.where(along != 0, ends, jnp.where(within, jnp.asarray([-1.0, 1.0], ends.dtype), 2.0))
    low, high = jnp.min(ends), jnp.max(ends)
    room = 1 + gamma(8, ends.dtype)
    there = (low <= room) & (high >= -room)
    clipped = jnp.clip(jnp.stack([low, high]), -1.0, 1.0)
    rows = jnp.zeros((2, 3), ends.dtype).at[:, axis].set(clipped)
    rows = rows.at[:, others[0]].set(first).at[:, others[1]].set(second)
    return rows, jnp.stack([there, there])
