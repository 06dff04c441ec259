"""The proven distance from a point to an implicit surface in its box, and the start of every search on a surface.

A best-first search over boxes: boxes in which the polynomial has no zero are dropped, the lower bounds of
jhd._distance.cells.surfaces of the others are kept, and the nearest box is cut into eight. The smallest of these bounds
is a bound of the distance at every moment; a proven foot at this distance ends the search.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jhd._arithmetic.isolated_zeros import strata
from jhd._arithmetic.rounding import gamma, like_double, round_up, smallest_normal, unit_roundoff
from jhd._distance.nearest.forms import Boxes, Form, box_distances, boxes, finite_or_zero, form, lower_bounds, positive
from jhd._distance.nearest.surface_points import local_feet, projected, proven_radius, reach, thorough_radius
from jhd._distance.normalization.surfaces import Side
from jhd._runtime.arrays import module_of, varying

# Cells along each axis that every search starts from, and points along each axis for a cloud.
_GRID, _PLACES = 8, 12
CLOUD_STEPS = 7
# Smallest capacity of open cells of a search, and cells cut in a step.
CAPACITY, _LANES = 2048, 16
# Points of a cloud from which feet are searched, and Newton steps for feet.
_STARTS, _FOOT_STEPS = 8, 5
# Half sides of the cubes about a foot in which it may be proven to be the nearest point, as fractions of the box.
_CUBES = 2.0 ** -np.arange(1.0, 9.0)


class Cover(NamedTuple):
    """Boxes that cover a surface: their corners, and which of them may hold a point of the surface."""

    lower: Float[Array, "3 cells"]
    upper: Float[Array, "3 cells"]
    alive: Bool[Array, " cells"]


class SurfaceCloud(NamedTuple):
    """Points close to a surface: each has a surface point within its radius, which is infinite if none is proven."""

    points: Float[Array, "3 points"]
    radius: Float[Array, " points"]


class NearestOnSurface(NamedTuple):
    """Bounds of a distance and a proven foot, whose distance is `upper` but for its radius and rounding."""

    lower: Float[Array, ""]
    upper: Float[Array, ""]
    foot: Float[Array, "3"]
    steps: Int[Array, ""]


def cover(side: Side) -> Cover:
    """Return a grid over the box."""
    low, high = (jnp.asarray(x) for x in grid(side))
    return Cover(low, high, form(side, boxes(low, high)).may_vanish)


def grid(side: Side) -> tuple[Any, Any]:
    """Return lower and upper corners (3, cells) of cells of the box; neighbors share the floats of common ends.

    The corners are NumPy arrays if the box is.
    """
    xp = module_of(side.lower)
    lower, upper = xp.asarray(side.lower)[:, None], xp.asarray(side.upper)[:, None]
    shares = (np.arange(_GRID + 1) / _GRID).astype(lower.dtype)
    inside = xp.clip(lower + (upper - lower) * shares, lower, upper)
    cuts = xp.where(shares == 0, lower, xp.where(shares == 1, upper, inside))
    index = np.indices((_GRID,) * 3).reshape(3, -1)
    low, high = (xp.stack([cuts[i][index[i] + k] for i in range(3)]) for k in (0, 1))
    return low, high


def cloud(side: Side) -> SurfaceCloud:
    """Return points of the surface inside the box, on its faces and on its edges, and isolated points."""
    starts, fixed = starts_of_cloud(side)
    found = projected(side, jnp.asarray(starts), jnp.asarray(fixed), CLOUD_STEPS)
    return SurfaceCloud(found, proven_radius(side, found))


def starts_of_cloud(side: Side) -> tuple[Any, Any]:
    """Return start points (3, points) of a cloud, and a mask of their fixed coordinates; in NumPy if the box is."""
    xp = module_of(side.lower)
    lower, upper = xp.asarray(side.lower)[:, None], xp.asarray(side.upper)[:, None]
    shares, fixed = strata(_PLACES)
    shares = shares.astype(lower.dtype)
    starts = xp.where(shares == 0, lower, xp.where(shares == 1, upper, lower + (upper - lower) * shares))
    known = xp.asarray(side.isolated.center).T
    return xp.concatenate([starts, known], axis=1), np.concatenate([fixed, np.ones(known.shape, bool)], axis=1)


def halved(lower: Float[Any, "3 cells"], upper: Float[Any, "3 cells"]) -> tuple[Any, Any]:
    """Return the eight parts of each cell, arrays (3, 8 cells); neighboring parts share the floats of common ends."""
    xp = module_of(lower)
    middle = xp.clip(0.5 * (lower + upper), lower, upper)
    corners = np.indices((2, 2, 2)).reshape(3, 8, 1)
    low = xp.where(corners == 0, lower[:, None], middle[:, None])
    high = xp.where(corners == 0, middle[:, None], upper[:, None])
    return low.reshape(3, -1), high.reshape(3, -1)


def inner(side: Side, lower: Any, upper: Any) -> Any:
    """Return a mask of the coordinates in which cells do not touch the box."""
    xp = module_of(lower)
    return (lower > xp.asarray(side.lower)[:, None]) & (upper < xp.asarray(side.upper)[:, None])


class _SurfaceQuery(NamedTuple):
    rows: Array  # (capacity, 6)
    bound: Array  # inf where free
    closed: Array  # smallest bound of the cells dropped
    upper: Array
    foot: Array
    steps: Array


def nearest(
    side: Side,
    cover: Cover,
    point: Float[Array, "3"],
    starts: Float[Array, "3 points"],
    least: Float[Array, ""],
    close: Float[Array, ""],
    capacity: int = CAPACITY,
    most: Array | int | None = None,
) -> NearestOnSurface:
    """Return bounds of the distance from a point to the surface.

    From the axis of a torus a whole circle is equally near; more capacity then leaves a smaller gap.

    Args:
        side: the surface.
        cover: boxes that cover it.
        point: the point.
        starts: points near which feet are searched.
        least: the search ends as soon as the distance is proven to be at most this.
        close: the search also ends as soon as the bounds differ by at most this, or by the rounding error.
        capacity: largest number of open cells; the number of steps is proportional to it.
        most: number of open cells beyond which the search stops with valid, wider bounds; None means never.
    """
    # Largest number of steps for CAPACITY open cells, and in proportion for more.
    max_steps = 300 * capacity // CAPACITY
    most = capacity if most is None else most
    u = unit_roundoff(point.dtype)

    def better(state: _SurfaceQuery, places: Array) -> tuple[Array, Array]:
        found = local_feet(side, jnp.broadcast_to(point[:, None], places.shape), places, _FOOT_STEPS)
        # If the gradient vanishes Newton's method leads away, and a cell itself is near the surface.
        far, foot = nearest_proven(side, point, jnp.concatenate([found, places], axis=1))
        # Of two feet that are equally near up to rounding the later one counts: proofs need more digits of it.
        nearer = jnp.isfinite(far) & (far <= state.upper + 8 * u * (1 + far))
        return jnp.minimum(far, state.upper), jnp.where(nearer, foot, state.foot)

    def target(state: _SurfaceQuery) -> Array:
        upper = state.upper
        # Least gap, in units of roundoff.
        least_gap = jnp.maximum(close, 16 * u * (1 + jnp.where(jnp.isfinite(upper), upper, 0.0)))
        return jnp.minimum(upper - least_gap, state.closed)

    def open_(state: _SurfaceQuery) -> Array:
        lowest = jnp.min(state.bound)
        few = jnp.sum(state.bound < target(state)) <= most
        return (lowest < target(state)) & (state.upper > least) & (state.steps < max_steps) & few

    def step(state: _SurfaceQuery) -> _SurfaceQuery:
        _, index = jax.lax.top_k(-state.bound.astype(jnp.float32), _LANES)
        taken, parents = state.rows[index].T, state.bound[index]
        live = parents < target(state)
        # Cells of this width are not cut any more: a few units of roundoff of the coordinates.
        narrow = jnp.max(taken[3:] - taken[:3], axis=0) < like_double(2.0**-48, taken.dtype)
        # Cells that are close enough, or too narrow to cut, leave the table but count. Single precision orders the
        # table too coarsely to tell them from the others, so they must not stay there.
        closed = jnp.minimum(state.closed, jnp.min(jnp.where(live & ~narrow, jnp.inf, parents)))
        low, high = halved(taken[:3], taken[3:])
        cells = boxes(low, high)
        part = form(side, cells)
        bound = lower_bounds(part, cells, point, inner(side, low, high))
        bound = jnp.fmax(bound, jnp.tile(parents, 8))  # a NaN bounds nothing
        about, least_about = _convex_about(side, point, state.foot)
        within = jnp.all((low[:, None] >= about.lower[..., None]) & (high[:, None] <= about.upper[..., None]), axis=0)
        bound = jnp.maximum(bound, jnp.max(jnp.where(within, least_about[:, None], 0.0), axis=0))
        bound = jnp.where(part.may_vanish & jnp.tile(live & ~narrow, 8), bound, jnp.inf)
        _, lowest = jax.lax.top_k(-bound.astype(jnp.float32), starts.shape[1])
        places = jnp.where(state.steps == 0, starts, cells.center[:, lowest])
        upper, foot = better(state, places)
        bound = jnp.where(bound < upper, bound, jnp.inf)
        rows, kept, dropped = pushed(
            state.rows,
            state.bound.at[index].set(jnp.inf),
            jnp.concatenate([low, high]).T,
            bound,
        )
        return _SurfaceQuery(rows, kept, jnp.minimum(closed, dropped), upper, foot, state.steps + 1)

    infinity = jnp.asarray(jnp.inf, point.dtype)
    first = jnp.where(cover.alive, box_distances(boxes(cover.lower, cover.upper), point)[0], jnp.inf)
    room = capacity - first.size
    rows = jnp.pad(jnp.concatenate([cover.lower, cover.upper]).T, ((0, room), (0, 0)))
    start = _SurfaceQuery(
        rows, jnp.pad(first, (0, room), constant_values=jnp.inf), infinity, infinity, starts[:, 0], jnp.zeros((), int)
    )
    end = jax.lax.while_loop(open_, step, varying(start, side, point))
    lower = jnp.minimum(jnp.minimum(jnp.min(end.bound), end.closed), end.upper)
    return NearestOnSurface(lower, end.upper, end.foot, end.steps)


def _convex_about(side: Side, point: Array, foot: Array) -> tuple[Boxes, Array]:
    """Return cubes about a foot, (3, cubes), and lower bounds of the distance to the surface in each, or zero.

    With l so that the gradient of L = |q - p|^2 - l f(q) is about zero at the foot, L lies above its tangent plane
    there in every cube in which its second derivatives are proven positive definite: the pivots of their middle, less
    all that the terms of higher degree and rounding can change. On the surface L is the squared distance.
    """
    dtype = foot.dtype
    half = jnp.asarray(_CUBES, dtype) * jnp.max(jnp.asarray(side.upper) - jnp.asarray(side.lower))
    center = jnp.broadcast_to(foot[:, None], (3, half.size))
    sides = jnp.broadcast_to(half, center.shape)
    inner_half = half - gamma(8, dtype) * (jnp.abs(center) + half)
    cells = Boxes(center - inner_half, center + inner_half, center, sides)
    f = form(side, cells)
    apart, slope = foot - point, f.slope
    pull = 2 * apart[:, None] * half
    factor = finite_or_zero(jnp.sum(pull * slope, axis=0) / positive(jnp.sum(slope**2, axis=0)))
    size = jnp.sum((jnp.abs(apart)[:, None] + half) ** 2, axis=0)
    error = gamma(24, dtype) * size + 1.01 * jnp.abs(factor) * f.error
    value = jnp.sum(apart**2) - factor * f.value
    tilt = jnp.sum(jnp.abs(pull - factor * slope), axis=0) * (1 + gamma(16, dtype))
    # The errors of all coefficients together are within the first; the errors of slopes are within this times the
    # degree.
    degree = max(f.local.shape[:3])
    least = value - tilt - (4 * degree + 4) * error
    convex = _definite(f, factor, half, error * degree**2)
    root = jnp.sqrt(jnp.maximum(least, 0.0)) * (1 - 8 * unit_roundoff(dtype)) - smallest_normal(dtype) ** 0.5
    return cells, jnp.where(convex & (root > 0), root, 0.0)


def _definite(f: Form, factor: Array, half: Array, error: Array) -> Array:
    """Return whether the second derivatives of |half e|^2 - factor f(e) are positive definite for all |e| <= 1."""
    local, dtype = f.local, half.dtype
    powers = np.indices(local.shape[:3])
    total = np.sum(powers, axis=0)
    # Total change of the entries of a row by terms beyond the second degree.
    rows = [powers[k] * (total - 1) for k in range(3)]
    sizes = [
        jnp.sum(jnp.where((total > 2)[..., None], r[..., None] * jnp.abs(local), 0.0), axis=(0, 1, 2)) for r in rows
    ]
    loose = jnp.abs(factor) * jnp.max(jnp.stack(sizes), axis=0) + 3 * error
    own = [2 * half**2 - 2 * factor * x for x in (local[2, 0, 0], local[0, 2, 0], local[0, 0, 2])]
    xy, xz, yz = (-factor * x for x in (local[1, 1, 0], local[1, 0, 1], local[0, 1, 1]))
    scale = sum(jnp.abs(x) for x in (*own, xy, xz, yz)) + half**2
    loose = loose * (1 + gamma(local[..., 0].size + 16, dtype)) + gamma(64, dtype) * scale
    x, y, z = (entry - loose for entry in own)
    first = jnp.where(x > 0, x, jnp.inf)
    second = y - xy**2 / first
    cross = yz - xy * xz / first
    third = z - xz**2 / first - cross**2 / jnp.where(second > 0, second, jnp.inf)
    return (x > 0) & (second > 0) & (third > 0)


def nearest_proven(side: Side, point: Array, places: Array) -> tuple[Array, Array]:
    """Return an upper bound of the distance to the surface, and the point near the surface that proves it.

    The bound is infinite if none of the points is proven to be near the surface.
    """
    far = proven_distances(side, point, places)
    return jnp.min(far), places[:, jnp.argmin(far)]


def proven_distances(side: Side, point: Array, places: Array) -> Array:
    """Return upper bounds of the distance to the surface by points near it; infinite for unproven points."""
    far = round_up(reach(places - point[:, None]) + thorough_radius(side, places))
    return jnp.where(jnp.isnan(far), jnp.inf, far)


def pushed(rows: Array, bound: Array, new: Array, new_bound: Array) -> tuple[Array, Array, Array]:
    """Return a table with new rows in its free slots, and the smallest bound of the rows dropped; inf means free.

    If slots are missing, the rows with the largest bounds are dropped: they matter least for the smallest bound.
    """
    count = new_bound.size
    wanted, free = jnp.sum(jnp.isfinite(new_bound)), jnp.sum(jnp.isinf(bound))
    bound, left = jax.lax.cond(
        wanted > free, _without_largest, lambda b, _: (b, jnp.full_like(b[0], jnp.inf)), bound, new_bound
    )
    used = jnp.nonzero(jnp.isfinite(new_bound), size=count, fill_value=count)[0]
    slots = jnp.nonzero(jnp.isinf(bound), size=count, fill_value=bound.size)[0]
    # Rows beyond the end are dropped.
    there = jnp.where(used < count, slots, bound.size)
    rows = rows.at[there].set(new[jnp.minimum(used, count - 1)], mode="drop")
    values = jnp.append(new_bound, jnp.inf)[used]
    dropped = jnp.min(jnp.where(there == bound.size, values, jnp.inf))
    return rows, bound.at[there].set(values, mode="drop"), jnp.minimum(dropped, left)


def _without_largest(bound: Array, new_bound: Array) -> tuple[Array, Array]:
    """Return the bounds with slots freed among the largest for all new rows, and the smallest bound dropped."""
    key = jnp.where(jnp.isinf(bound), -jnp.inf, bound)
    _, index = jax.lax.top_k(key.astype(jnp.float32), new_bound.size)
    return bound.at[index].set(jnp.inf), jnp.min(bound[index])


def nearest_places(cloud: SurfaceCloud, point: Float[Array, "3"], count: int = _STARTS) -> Float[Array, "3 points"]:
    """Return the `count` proven points of a cloud nearest to a point; unproven points if these are too few."""
    far = jnp.sum((cloud.points - point[:, None]) ** 2, axis=0) + jnp.where(jnp.isfinite(cloud.radius), 0.0, 100.0)
    _, index = jax.lax.top_k(-far.astype(jnp.float32), count)
    return cloud.points[:, index]
