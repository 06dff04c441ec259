"""Nearest points of implicit surfaces, proven, for many queries at once; see jhd._distance.nearest.surfaces.

If a query is so far away that the whole box is one point compared with the distance, the box and a proven point in it
give the answer.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._arithmetic.rounding import gamma, round_up, unit_roundoff
from jhd._distance.cells.flat_pieces import beside_surface, of_points
from jhd._distance.cells.pairs import Cell
from jhd._distance.cells.tracked_feet import moving_bound
from jhd._distance.cells.tracked_feet_surfaces import narrowed
from jhd._distance.nearest.surface_points import local_feet, proven_radius, reach, with_singular_radius
from jhd._distance.nearest.surfaces import CAPACITY, NearestOnSurface, nearest, nearest_places, proven_distances
from jhd._distance.nearest.target import AbstractTarget, Flats, FootRows, ProvenFeet
from jhd._distance.normalization.coordinates import Frame, common_points, moved_by, user_place
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.surfaces import Side, prepare_surfaces
from jhd._distance.search.candidates import Target
from jhd._distance.search.row_batches import each, in_blocks, in_groups
from jhd._distance.search.surface_source import eighths, looked_at
from jhd._runtime.compiled import compiled
from jhd._shapes.checks import empty_surface
from jhd._shapes.implicit import ImplicitSurface
from jhd._triangles.closest_point import outward

# Points of the cloud from which feet are searched, Newton steps for feet, and queries in one batch.
_STARTS, _FOOT_STEPS, _LANES = 4, 6, 64
# The gap at which a query is done, as a fraction of the box, or in units of roundoff of its distance if that is larger.
_CLOSE, _ULPS = 1e-12, 64
# Queries whose distances to all cells of a cover are formed at once.
_ROWS = 1024
# A hasty query with more open cells is given up; if it is alone, at most this number of graphs bounds it.
_MANY, _GRAPHS = 512, 1 << 12
# A query this many boxes away takes the box for a point.
_FAR = {8: 2.0**56, 4: 2.0**26}


class SurfaceTarget(AbstractTarget):
    """An implicit surface in coordinates of its own, or in common ones.

    Raises:
        ValueError: the surface is proven to have no point in its box.
    """

    block = 64
    sharp = False

    def __init__(self, surface: ImplicitSurface | Side):
        if isinstance(surface, Side):
            side, zero = surface, np.asarray(0)
            self.frame = Frame(np.zeros_like(np.asarray(side.lower)), zero, zero)
        else:
            side, _, self.frame = prepare_surfaces(surface, surface)
        self.target, empty = looked_at(side)
        if bool(empty):
            raise empty_surface()
        cloud = self.target.cloud
        radius = np.asarray(cloud.radius)
        self.proven = bool(np.any(np.isfinite(radius)))
        best = int(np.argmin(radius))
        self._point, self._radius = np.asarray(cloud.points)[:, best], radius[best]

    @property
    def exponent(self) -> int:
        """The power of two that the common coordinates are divided by."""
        return int(self.frame.first) + int(self.frame.second)

    @override
    def rounding(self, distance: float) -> float:
        u = unit_roundoff(self._point.dtype)
        return float(np.ldexp(8 * max(_CLOSE, _ULPS * u), self.exponent)) + 8 * max(_CLOSE, _ULPS * u) * distance

    @override
    def feet(self, points: np.ndarray) -> np.ndarray:
        """Return upper bounds of the distances by feet; infinite if no point of the surface is proven."""
        x, far = self._scaled(points)
        upper = in_blocks(_feet, self.target, x)[0].astype(np.float64)
        upper = outward(upper + moved_by(x), self.exponent, points.dtype, 1)
        return np.where(far, self._from_afar(points)[1], upper)

    @override
    def near(self, points: np.ndarray) -> ProvenFeet:
        x, far = self._scaled(points)
        upper, foot = in_blocks(_feet, self.target, x)
        distance = np.sqrt(np.sum((foot - x) ** 2, axis=1))
        upper = outward(upper.astype(np.float64) + moved_by(x), self.exponent, points.dtype, 1)
        known = np.isfinite(upper) & ~far
        nothing = np.zeros_like(upper)
        return ProvenFeet(
            distance=np.where(known, np.minimum(np.ldexp(distance, self.exponent), upper), np.inf),
            lower=nothing,
            upper=np.where(far, self._from_afar(points)[1], upper),
            foot=np.where(known[:, None], user_place(self.frame, foot), np.nan),
            segment=np.full(len(x), -1),
            t=np.full(len(x), np.nan, points.dtype),
            closed=nothing > 0,
        )

    @override
    def error(self, found: ProvenFeet) -> np.ndarray:
        """Bound the distance of each foot from the surface.

        In the common unit let r <= 1 be the length within which the surface is proven to have a point of a foot, R the
        `reach` of the foot from the query, and F >= R + r the proven distance by it. A foot is taken if
        F <= upper + 8 u (1 + F), and the distance d to it, computed in six roundings, is at most R (1 + 6 u). So

            r <= F - R <= upper - d + 8 u (1 + F) + 6 u d,  F <= (d + r) (1 + 32 u),

        also if d is cut off at `upper`. Placing the foot rounds each coordinate once, relative to the largest one of
        the box, M. With the roundings of this sum r is below upper - d + 20 u (d + 1 + M). If the box counts as one
        point, 32 u d alone is larger than r.
        """
        info, u = np.finfo(found.distance.dtype), unit_roundoff(found.distance.dtype)
        known = np.isfinite(found.upper) & np.isfinite(found.distance)
        upper, distance = (np.where(known, x, 0.0) for x in (found.upper, found.distance))
        corners = user_place(self.frame, np.stack([self.target.side.lower, self.target.side.upper]))
        size = np.ldexp(1.0, self.exponent) + np.max(np.abs(corners))
        slack = 32 * u * (distance + size) + 4 * info.smallest_subnormal
        return np.where(known, np.maximum(upper - distance, 0.0) + slack, np.inf)

    @override
    def flats(self, feet: FootRows, corners: np.ndarray) -> Flats:
        """Return parallelograms in tangent planes, and the feet themselves; in common coordinates."""
        point, error = np.where(np.isfinite(feet.point), feet.point, 0.0), feet.error
        return in_blocks(_beside, self.target, point, error, corners)

    @override
    def parameters(self, t: np.ndarray) -> np.ndarray:
        """Return NaN: an implicit surface has no parameters."""
        return np.full(len(t), np.nan)

    @override
    def nearest(
        self, points: np.ndarray, enough: float | np.ndarray = -np.inf, close: float = 0.0, hasty: bool = False
    ) -> ProvenFeet:
        x, far = self._scaled(points)
        least, apart = np.ldexp(enough, -self.exponent), float(np.ldexp(close, -self.exponent))
        leasts, most = np.broadcast_to(least, len(x)), np.full(len(x), _MANY if hasty else CAPACITY)
        lower, upper, foot = in_blocks(_nearest, self.target, x, leasts.astype(x.dtype), most)
        lower, upper = lower.astype(np.float64) - moved_by(x), upper.astype(np.float64) + moved_by(x)
        distance = np.sqrt(np.sum((foot - x) ** 2, axis=1))
        u = unit_roundoff(x.dtype)
        share = 4 * max(_CLOSE, _ULPS * u)
        allowed = np.maximum(share * (1 + np.where(np.isfinite(upper), upper, 0.0)), apart)
        open_ = (upper - lower > allowed) & (upper > leasts) & np.isfinite(upper) & ~far
        if hasty and len(x) == 1 and open_[0]:
            found = self._by_graphs(x[0], upper[0], 0.5 * allowed[0]) - moved_by(x)[0]
            lower[0] = max(lower[0], min(found, upper[0]))
        # The distance is still the distance of the foot: `error` derives from it how near the surface is to the foot.
        lower = np.minimum(lower, distance)
        closed = (upper - lower <= allowed) | (upper <= least)
        low, high = (outward(end, self.exponent, points.dtype, sign) for end, sign in ((lower, -1), (upper, 1)))
        places = user_place(self.frame, foot)
        own, other = self._from_afar(points)
        low, high = np.where(far, own, low), np.where(far, other, high)
        places = np.where(far[:, None], user_place(self.frame, self._point), places)
        known = np.isfinite(high)
        # For a far query the box is one point, at the distance given by the bounds.
        closed = np.where(far, (high - low <= share * high) | (high <= enough), closed)
        distance = np.where(far, 0.5 * low + 0.5 * high, np.ldexp(distance, self.exponent))
        distance = np.where(known, np.clip(distance, low, high), np.inf)
        return ProvenFeet(
            distance=distance,
            lower=low,
            upper=high,
            foot=np.where(known[:, None], places, np.nan),
            segment=np.full(len(x), -1),
            t=np.full(len(x), np.nan, points.dtype),
            closed=closed & known,
        )

    def _by_graphs(self, point: np.ndarray, upper: float, close: float) -> float:
        """Return a lower bound of the distance of a query for which a whole curve or region may be nearest.

        Cells that are crossed in one sheet are bounded by their graphs, to the eighth order of their size.
        """
        side, cover, most = self.target.side, self.target.cover, _GRAPHS
        low, high = (np.asarray(end).T[np.asarray(cover.alive)] for end in cover[:2])
        goal, settled = upper - close, np.inf
        while True:
            apart = np.maximum(np.maximum(low - point, point - high), 0.0).astype(np.float64)
            lower = np.sqrt(np.sum(apart**2, axis=1)) * (1 - gamma(8, point.dtype))
            near = lower < goal
            most -= np.count_nonzero(near)
            if most >= 0 and np.any(near):
                lower[near] = np.fmax(lower[near], in_blocks(_from_graphs, (side, point), low[near], high[near]))
            left = lower < goal
            settled = min(settled, np.min(lower[~left], initial=np.inf))
            if most < 0 or not np.any(left):
                return float(min(settled, np.min(lower, initial=np.inf)))
            low, high, _ = eighths(side, low[left], high[left])

    def within(self, points: np.ndarray, upper: float) -> np.ndarray:
        """Return a mask of the points that may be within `upper` of the surface, by the cover."""
        x, far = self._scaled(points)
        cover = self.target.cover
        low, high = (np.asarray(end, np.float64).T[np.asarray(cover.alive)] for end in cover[:2])
        room = gamma(64, points.dtype)
        with np.errstate(over="ignore"):
            wanted = float(np.ldexp(float(upper), -self.exponent)) * (1 + room)
        least = wanted + room * (1 + np.max(np.abs(x), axis=1).astype(np.float64))
        # Every query that is not far away is nearer; larger numbers have no square.
        least = np.minimum(least, 1e150)
        found = [
            np.any(np.sum(np.maximum(np.maximum(low - p, p - high), 0.0) ** 2, axis=-1) <= r**2, axis=1)
            for p, r in (
                (x[k : k + _ROWS, None].astype(np.float64), least[k : k + _ROWS, None]) for k in range(0, len(x), _ROWS)
            )
        ]
        return np.where(far, self._from_afar(points)[0] <= upper, np.concatenate(found))

    def _scaled(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the queries in common coordinates, with zeros for far queries, and a mask of the far queries."""
        with np.errstate(over="ignore"):
            x = common_points(self.frame, points)
        far = ~np.all(np.abs(x) <= _FAR[points.dtype.itemsize], axis=1)
        return np.where(far[:, None], 0.0, x).astype(points.dtype), far

    def _from_afar(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bound the distances by the box and by one proven point, in the unit of the points.

        Each query has a power of two of its own, by which no coordinate is above one. Losses below the normal numbers,
        and the roundings in double precision, are a small part of the slack.
        """
        dtype = points.dtype
        side = self.target.side
        low, high, foot = (user_place(self.frame, np.asarray(x)).astype(np.float64) for x in (*side[2:4], self._point))
        p = points.astype(np.float64)
        power = np.frexp(np.maximum(np.max(np.abs(p), axis=1), max(np.max(np.abs(low)), np.max(np.abs(high)))))[1]
        p, low, high, foot = (np.ldexp(x, -power[:, None]) for x in (p, low, high, foot))
        # Corners and the point are placed with two roundings each.
        slack = gamma(8, dtype) * (1 + np.max(np.abs(np.stack([low, high])), axis=(0, 2)))
        apart = np.maximum(np.maximum(low - p, p - high) - slack[:, None], 0.0)
        lower = np.sqrt(np.sum(apart**2, axis=1)) * (1 - gamma(8, np.float64)) - 2 * slack
        upper = np.sqrt(np.sum((p - foot) ** 2, axis=1)) * (1 + gamma(8, np.float64)) + 4 * slack
        with np.errstate(over="ignore"):
            upper = upper + np.ldexp(float(self._radius), self.exponent - power)
        return outward(lower, power, dtype, -1), outward(upper, power, dtype, 1)


def _mended(target: Target, point: Array, known: NearestOnSurface) -> tuple[Array, Array]:
    """Return a foot after some more Newton steps, and the smaller one of its proven distance and the known one.

    If both are equally near up to rounding, the new foot is returned: the distance hardly changes when the foot does.
    """
    found = local_feet(target.side, point[:, None], known.foot[:, None], _FOOT_STEPS)
    mended, upper = proven_distances(target.side, point, found)[0], known.upper
    room = 8 * unit_roundoff(point.dtype) * (1 + upper)
    return jnp.minimum(mended, upper), jnp.where(mended <= upper + room, found[:, 0], known.foot)


@compiled
def _feet(target: Target, count: Array, points: Array) -> Any:
    """Return feet of all points as one long row, which is twice as fast as many short rows."""

    def group(points: Array) -> tuple[Array, Array]:
        starts = jax.vmap(lambda point: nearest_places(target.cloud, point, _STARTS))(points)
        lanes = starts.transpose(1, 0, 2).reshape(3, -1)
        queries = jnp.repeat(points.T, _STARTS, axis=1)
        found = local_feet(target.side, queries, lanes, _FOOT_STEPS)
        places = jnp.concatenate([found, lanes], axis=1)
        radius = proven_radius(target.side, places)
        far = reach(places - jnp.tile(queries, 2))

        def nearest_of(far: Array) -> tuple[Array, Array]:
            each_of = lambda x: x.reshape(2, len(points), _STARTS).transpose(1, 0, 2).reshape(len(points), -1)  # noqa: E731
            far = each_of(jnp.where(jnp.isnan(far), jnp.inf, round_up(far)))
            best = jnp.argmin(far, axis=1)[:, None]
            place = [jnp.take_along_axis(each_of(x), best, axis=1)[:, 0] for x in places]
            return jnp.min(far, axis=1), jnp.stack(place, axis=1)

        upper, foot = nearest_of(far + radius)
        # If no point is proven, a longer search for signs follows.
        again = lambda: nearest_of(far + with_singular_radius(target.side, places, radius))  # noqa: E731
        return jax.lax.cond(jnp.any(jnp.isinf(upper)), again, lambda: (upper, foot))

    return in_groups(group, count, (points,), _LANES)


@compiled
def _nearest(target: Target, count: Array, points: Array, least: Array, most: Array) -> Any:
    """Return bounds and feet, one query after the other."""
    close = jnp.asarray(max(_CLOSE, _ULPS * unit_roundoff(points.dtype)), points.dtype)

    def one(point: Array, least: Array, most: Array) -> Any:
        starts = nearest_places(target.cloud, point, _STARTS)
        found = nearest(target.side, target.cover, point, starts, least, close, most=most)
        # Distances are accurate when feet are off by the root of the roundoff; some steps correct the feet.
        return found.lower, *_mended(target, point, found)

    return each(one, count, (points, least, most), 1)


@compiled
def _from_graphs(shapes: tuple[Side, Array], count: Array, low: Array, high: Array) -> Array:
    """Return lower bounds of the distance from a point to the surface in cells, by graphs of the surface."""
    side, point = shapes
    net, first, zero = Net(point[None, None, None], None), jnp.zeros((), int), jnp.zeros(1, low.dtype)

    def one(low: Array, high: Array) -> Array:
        low, high = narrowed(side, low, high)
        cell = Cell(first, first, jnp.append(low, zero), jnp.append(high, zero))
        return moving_bound(side, net, cell, zero).lower

    return each(one, count, (low, high), _LANES)


@compiled
def _beside(target: Target, count: Array, point: Array, error: Array, corners: Array) -> Flats:
    """Return flat pieces near cells: in tangent planes, then the feet themselves."""

    def one(point: Array, error: Array, corners: Array) -> Flats:
        flat, feet = beside_surface(target.side, point, error, corners), of_points(point, error)
        return jax.tree_util.tree_map(lambda x, y: jnp.concatenate([x, y]), flat, feet)

    return each(one, count, (point, error, corners), _LANES)
