"""Implicit surfaces from the host: cells that may hold their points, points near given points, and their source.

There is one compiled function for any number of cells, and one for any number of points; starts of searches need no
others. For sources see jhd._distance.search.sources.
"""

from itertools import product
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from jhd._arithmetic.polynomials import slopes
from jhd._arithmetic.rounding import gamma, smallest_normal, unit_roundoff
from jhd._distance.cells.flat_pieces import Hulls
from jhd._distance.cells.surfaces import upper_bounds
from jhd._distance.nearest.forms import Boxes, Form, boxes, form
from jhd._distance.nearest.surface_points import projected, proven_radius, with_singular_radius
from jhd._distance.nearest.surfaces import CLOUD_STEPS, Cover, SurfaceCloud, grid, halved, inner, starts_of_cloud
from jhd._distance.nearest.target import AbstractTarget, FootRows, PointTarget
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.candidates import Target
from jhd._distance.search.polished_place import SharpenedPlace
from jhd._distance.search.row_batches import each, in_blocks, in_groups
from jhd._distance.search.solutions import with_some_point
from jhd._distance.search.sources import AbstractSource, CellRows, PlaceOfCut, PlacesOfCells, over_hulls, units
from jhd._results.solution import on_device
from jhd._runtime.compiled import compiled
from jhd._shapes.prepared import prepared

# Cells or points processed in one batch.
_LANES = 64
# A point this many roundings from a face of the box is on the face.
_ROUNDED = 64
# The twelve edges of a box: the axis of each, and the other two coordinates, as rows with a zero at the axis.
_AXIS = np.repeat(np.arange(3), 4)
_OTHERS = np.array([np.insert(signs, axis, 0) for axis in range(3) for signs in product((-1, 1), repeat=2)])


class PlacesNear(NamedTuple):
    """Points of a surface near given points, if proven."""

    points: Any  # the points, (places, 3)
    radius: Any  # lengths within which the surface has a point, (places,); infinite if nothing is proven
    slope: Any  # gradients at the points, (places, 3)


def looked_at(side: Side) -> tuple[Target, Any]:
    """Return a side with cover and cloud, and whether it provably has no point in its box; stored with the side."""
    return prepared(side)._part(_looked_at)


def _looked_at(side: Side) -> tuple[Target, Any]:
    """Compute `looked_at`; the search for a point anywhere is compiled only if no point of the cloud is proven."""
    side = jax.tree_util.tree_map(np.asarray, side)
    low, high = grid(side)
    alive = may_vanish(side, low.T, high.T)
    starts, fixed = starts_of_cloud(side)
    found = places_near(side, starts.T, fixed.T, thorough=False)
    side, cover, cloud = on_device((side, (low, high, alive), (found.points.T, found.radius)))
    target = Target(side, Cover(*cover), SurfaceCloud(*cloud))
    return (target, np.asarray(False)) if np.any(np.isfinite(found.radius)) else _with_some_point(target)


_with_some_point = compiled(with_some_point)


def may_vanish(
    side: Side, low: Float[np.ndarray, "cells 3"], high: Float[np.ndarray, "cells 3"]
) -> Bool[np.ndarray, " cells"]:
    """Return a mask of the cells that may hold a point of the surface."""
    return in_blocks(_may_vanish, side, low, high)


def eighths(
    side: Side, low: Float[np.ndarray, "cells 3"], high: Float[np.ndarray, "cells 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ends of the eighths of cells that may hold a point of the surface, and the cell of each."""
    low, high = (x.reshape(3, 8, -1).T.reshape(-1, 3) for x in halved(low.T, high.T))
    rows = np.flatnonzero(may_vanish(side, low, high))
    return low[rows], high[rows], rows // 8


def places_near(
    side: Side, starts: Float[np.ndarray, "places 3"], fixed: Bool[np.ndarray, "places 3"], thorough: bool
) -> PlacesNear:
    """Return points of the surface near points of the box, which keep the coordinates that are fixed."""
    return PlacesNear(*in_blocks(_places_near, (side, np.asarray(thorough)), starts, fixed))


class SurfaceSource(AbstractSource):
    """An implicit surface, with its cover; cells are boxes."""

    def __init__(self, target: Target):
        self._target = target
        self._side: Any = jax.tree_util.tree_map(np.asarray, target.side)

    @override
    def cover(self) -> CellRows:
        alive = np.asarray(self._target.cover.alive)
        low, high = (np.asarray(x).T[alive] for x in self._target.cover[:2])
        return CellRows(np.full(len(low), -1), low, high)

    @override
    def cut(self, cells: CellRows, at: PlaceOfCut | None = None) -> tuple[CellRows, np.ndarray]:
        """Cut each cell into eight."""
        low, high, parent = eighths(self._side, cells.low, cells.high)
        return CellRows(np.full(len(parent), -1), low, high), parent

    @override
    def places(self, cells: CellRows) -> PlacesOfCells:
        """Return points: one inside, one on the faces that the cell touches, and four about it, not proven."""
        side, low, high = self._side, cells.low, cells.high
        middle, free = 0.5 * (low + high), inner(side, low.T, high.T).T
        face = np.where(free, middle, np.where(low <= side.lower, low, high))
        starts, fixed = np.stack([middle, face], axis=1), np.stack([np.zeros_like(free), ~free], axis=1)
        found = places_near(side, starts.reshape(-1, 3), fixed.reshape(-1, 3), thorough=True)
        points, size = found.points.reshape(starts.shape), np.max(high - low, axis=1)
        # A point far from the cell belongs to another one.
        near = np.all(np.abs(points - middle[:, None]) <= 3 * size[:, None, None], axis=2)
        points = np.where(near[..., None], points, middle[:, None])
        radius = np.where(near, found.radius.reshape(near.shape), np.inf)
        # Next to the first point, on both sides along the surface, only to find feet.
        slope = found.slope[::2]
        along = np.cross(slope, np.eye(3, dtype=low.dtype)[np.argmin(np.abs(slope), axis=1)])
        steps = np.stack([along, np.cross(slope, along)], axis=1)
        longest = np.maximum(np.max(np.abs(steps), axis=2, keepdims=True), smallest_normal(low.dtype))
        steps = 0.5 * size[:, None, None] * steps / longest
        beside = points[:, :1] + np.concatenate([-steps, steps], axis=1)
        points = np.concatenate([points, beside], axis=1)
        return PlacesOfCells(points, np.pad(radius, ((0, 0), (0, 4)), constant_values=np.inf), points)

    @override
    def over(self, cells: CellRows, target: AbstractTarget, feet: FootRows) -> np.ndarray:
        point = np.where(np.isfinite(feet.point), feet.point, 0.0)
        rows = cells.low, cells.high, point, feet.error
        if isinstance(target, PointTarget):
            return in_blocks(_over_boxes, self._side, *rows)
        found, *hulls = in_blocks(_over_boxes_in_hulls, self._side, *rows)
        return np.fmin(found, over_hulls(Hulls(*hulls), target, feet))

    @override
    def rays(self, piece: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return directions along the faces at an edge of the box, one of which may leave."""
        side = self._side
        low, high = x <= np.asarray(side.lower), x >= np.asarray(side.upper)
        slope = places_near(side, x[None], np.ones((1, 3), bool), thorough=False).slope[0].astype(np.float64)
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

    @override
    def proven(self, place: SharpenedPlace, radius: float) -> tuple[SharpenedPlace, float]:
        """Return a nearby point of the surface, proven if possible, on the same faces of the box."""
        lower, upper, point = self._side.lower, self._side.upper, place.point
        near = _ROUNDED * unit_roundoff(point.dtype)
        point = np.where(point <= lower + near, lower, np.where(point >= upper - near, upper, point))
        fixed = (point <= lower) | (point >= upper)
        found = places_near(self._side, point[None], fixed[None], thorough=True)
        return SharpenedPlace(found.points[0], found.points[0]), float(found.radius[0])

    @override
    def parameters(self, x: np.ndarray) -> np.ndarray:
        """Return NaN: an implicit surface has no parameters."""
        return np.asarray(np.nan)


@compiled
def _may_vanish(side: Side, count: Array, low: Array, high: Array) -> Array:
    return in_groups(lambda low, high: form(side, boxes(low.T, high.T)).may_vanish, count, (low, high), _LANES)


@compiled
def _places_near(how: tuple[Side, Array], count: Array, starts: Array, fixed: Array) -> Any:
    side, thorough = how

    def group(starts: Array, fixed: Array) -> PlacesNear:
        found = projected(side, starts.T, fixed.T, CLOUD_STEPS)
        radius = proven_radius(side, found)
        radius = jax.lax.cond(thorough, lambda r: with_singular_radius(side, found, r), lambda r: r, radius)
        slope = slopes(jnp.asarray(side.coefficients), found)[1]
        return PlacesNear(found.T, radius, slope.T)

    return in_groups(group, count, (starts, fixed), _LANES)


@compiled
def _over_boxes(side: Side, count: Array, low: Array, high: Array, feet: Array, radius: Array) -> Array:
    one = lambda *row: _over_box(side, *row)[0]  # noqa: E731
    return each(one, count, (low, high, feet, radius), _LANES)


@compiled
def _over_boxes_in_hulls(side: Side, count: Array, low: Array, high: Array, feet: Array, radius: Array) -> Any:
    def one(*row: Array) -> Any:
        bound, f, cells = _over_box(side, *row)
        return bound, *_hull_of_box(f, cells)

    return each(one, count, (low, high, feet, radius), _LANES)


def _over_box(side: Side, low: Array, high: Array, feet: Array, radius: Array) -> tuple[Array, Form, Boxes]:
    """Return the bound over a cell, and its polynomial there."""
    cells = boxes(low[:, None], high[:, None])
    free = inner(side, low[:, None], high[:, None])
    f = form(side, cells)
    return upper_bounds(f, cells, feet[:, :, None], radius[:, None], free)[0], f, cells


def _hull_of_box(f: Form, cells: Boxes) -> Hulls:
    """Bound the part of a box on which |f| = |value + slope.e + rest| may vanish, by interval ends on the edges."""
    value, rest, error = f.value[0], f.rest[0], f.error[0]
    slope, center, half = f.slope[:, 0], cells.center[:, 0], cells.half[:, 0]
    size, dtype = jnp.abs(value) + jnp.sum(jnp.abs(slope)) + rest, half.dtype
    most = (rest + error + gamma(32, dtype) * size) * (1 + gamma(8, dtype))
    places, there = _ends_on_edges(value, slope, most)
    # Missing ends repeat another end, or have any value if the box holds no point.
    places = jnp.where(there[:, None], places, places[jnp.argmax(there)])
    corners = jnp.where(jnp.any(there), center + half * places, center + half * jnp.sign(places))
    slack = gamma(16, dtype) * jnp.max(jnp.abs(center) + half)
    least = jnp.argmin(jnp.abs(slope / half))
    along = jnp.cross(slope / half, jnp.eye(3, dtype=dtype)[least])
    return Hulls(corners, slack, jnp.stack([along, jnp.cross(slope / half, along)]))


def _ends_on_edges(value: Array, slope: Array, most: Array) -> tuple[Array, Array]:
    """Return both ends of |value + slope.e| <= most on each edge of [-1, 1]^3, (24, 3), and which ones exist."""
    others = _OTHERS.astype(slope.dtype)
    rest = value + jnp.sum(others * slope, axis=1)
    along = slope[_AXIS]
    safe = jnp.where(along != 0, along, 1.0)
    ends = jnp.stack([(-most - rest) / safe, (most - rest) / safe])
    whole = jnp.where(jnp.abs(rest) <= most, np.array([[-1.0], [1.0]], slope.dtype), 2.0)
    ends = jnp.where(along != 0, ends, whole)
    low, high = jnp.min(ends, axis=0), jnp.max(ends, axis=0)
    room = 1 + gamma(8, ends.dtype)
    there = (low <= room) & (high >= -room)
    clipped = jnp.clip(jnp.stack([low, high], axis=1), -1.0, 1.0)
    rows = jnp.where(others[:, None] == 0, clipped[..., None], others[:, None])
    return rows.reshape(-1, 3), jnp.repeat(there, 2)
