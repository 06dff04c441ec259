"""Proven bounds of the directed Hausdorff distance of two implicit surfaces, closed by branch and bound.

Cells are boxes that cover a; each waits in a table with an upper bound of the distance of its points from b. A step
takes the cells with the largest bounds, finds feet of b for each, and bounds them (jhd._distance.cells.surfaces, signs
and tracked_feet_upper). Cells whose bounds are still too large are cut into eight; parts without a point of a are
dropped. The most promising point of a in a step is polished to a local maximum and measured: its distance from all of
b, proven from below, raises the lower bound.

At every moment each point of a lies in a cell whose bound holds, so the largest bound is a bound of the distance. If a
cell does not fit into the table, its bound is kept, and cells with smaller bounds need no more work.

Source: the search and the bounds are ours; AlgSurf gives the problem and the octree.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from jhd._arithmetic.polynomials import slopes
from jhd._arithmetic.rounding import like_double, unit_roundoff
from jhd._distance.cells.signs import sign_bounds
from jhd._distance.cells.surfaces import FEET, upper_bounds
from jhd._distance.cells.tracked_feet_upper import moving_bounds
from jhd._distance.nearest.forms import Boxes, box_distances, boxes, form
from jhd._distance.nearest.surface_points import local_feet, projected, thorough_radius
from jhd._distance.nearest.surfaces import CAPACITY, SurfaceCloud, halved, inner, pushed
from jhd._distance.normalization.coordinates import diagonal
from jhd._distance.normalization.isolated import on_isolated
from jhd._distance.normalization.stopping import Wanted, default_tolerance
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.candidates import HINTS, NOISE, FarthestPlace, SurfacePlace, Target, improved
from jhd._runtime.arrays import varying

# Cells bounded in one step.
_LANES = 32
# Newton steps for the feet and for the points of a cell.
_STEPS_OF_FEET, _STEPS_OF_POINTS = 3, 4
# Cells of this width are not cut any more; points this near to a surface count as on it. For double precision.
_NARROW, _ON = 2.0**-46, 1e-9
# Rows of the table for each open cell of the search for the distance of a point.
_ROWS_OF_MEASURE = 8
# Points whose nearest points of a cloud are searched in one batch.
_BLOCK = 256
# Feet count together if their distances agree to this many half diagonals of a cell.
_TOGETHER = 4.0
# Most steps between two measured points.
_LONGEST_WAIT = 16
# Least gap in units of roundoff of the common coordinates.
_FLOOR = 256


class SurfaceTable(NamedTuple):
    """Waiting cells: lower and upper corner and four feet in each row, and the bounds, -inf if free."""

    rows: Array  # (capacity, 18)
    bound: Array


class SurfaceState(NamedTuple):
    """State of a search: its cells, and the bounds and points found so far."""

    table: SurfaceTable
    best: FarthestPlace
    closed: Array  # largest bound of the cells that were closed or dropped
    folded: Array  # largest bound of the cells that were dropped, or are too narrow to be cut
    full: Array  # whether any was dropped
    steps: Array
    cells: Array
    patience: Array  # (2,), the step at which a point may be measured again, and the last wait

    @property
    def upper(self) -> Array:
        """Proven bound of the whole distance; minus infinity if a is proven to be empty."""
        return jnp.maximum(jnp.max(self.table.bound), self.closed)

    @property
    def waiting(self) -> Array:
        """Number of cells in the table."""
        return jnp.sum(self.table.bound > -jnp.inf)


def tolerance(a: Side, b: Side, wanted: Wanted, distance: Array) -> Array:
    """Return the tolerance at a distance."""
    size = diagonal([(side.lower, side.upper) for side in (a, b)])
    default = default_tolerance(size, distance.dtype, _FLOOR * unit_roundoff(distance.dtype))
    atol = jnp.where(wanted.atol < 0, default, wanted.atol)
    return jnp.maximum(atol, wanted.rtol * distance)


def goal(a: Side, b: Side, wanted: Wanted, state: SurfaceState) -> Array:
    """Return the bound up to which cells are closed, at least the bound of the folded cells."""
    u = unit_roundoff(state.best.lower.dtype)
    # A little less than the requested gap, so that rounding of the last comparison does not exceed it.
    room = jnp.maximum(0.99 * tolerance(a, b, wanted, state.best.lower), 8 * u)
    return jnp.maximum(jnp.maximum(wanted.aim.level, state.best.lower + room), state.folded)


def unfinished(a: Target, b: Target, wanted: Wanted, state: SurfaceState) -> Array:
    """Return whether more steps would improve the requested bounds."""
    above = jnp.max(state.table.bound) > goal(a.side, b.side, wanted, state)
    return above & (state.best.lower <= wanted.aim.ceiling)


def blank(capacity: int, dtype: str) -> SurfaceState:
    """Return a state of the right shapes to begin in, in NumPy arrays."""
    zeros: Any = np.zeros
    number, count = zeros((), dtype), zeros((), int)
    vector, feet, hints = (zeros(shape, dtype) for shape in ((3,), (FEET, 3), (HINTS, 3)))
    best = FarthestPlace(number, number, SurfacePlace(vector, feet, zeros((FEET,), dtype)), hints, count)
    table = SurfaceTable(zeros((capacity, 6 + 3 * FEET), dtype), zeros((capacity,), dtype))
    return SurfaceState(table, best, number, number, zeros((), bool), count, count, zeros((2,), int))


def begin(a: Target, b: Target, capacity: int) -> SurfaceState:
    """Return the cover of a with first bounds; the cloud point of a farthest from the cloud of b is the candidate."""
    dtype = jnp.asarray(a.side.lower).dtype
    low, high = a.cover.lower, a.cover.upper
    cells = boxes(low, high)
    index = _nearest_of(b.cloud, cells.center)
    near, radius = b.cloud.points[:, index], b.cloud.radius[index]
    bound = box_distances(cells, near)[1] + 2 * radius
    bound = jnp.where(a.cover.alive, bound, -jnp.inf)
    rows = jnp.concatenate([low, high, *[near] * FEET]).T
    room = capacity - bound.size
    table = SurfaceTable(jnp.pad(rows, ((0, room), (0, 0))), jnp.pad(bound, (0, room), constant_values=-jnp.inf))
    none, zero = jnp.asarray(-jnp.inf, dtype), jnp.zeros((), dtype)
    points = a.cloud.points
    feet = b.cloud.points[:, _nearest_of(b.cloud, points)]
    far = jnp.where(jnp.isfinite(a.cloud.radius), jnp.sum((points - feet) ** 2, axis=0), -jnp.inf)
    best = jnp.argmax(far)
    place = SurfacePlace(points[:, best], jnp.tile(feet[:, best], (FEET, 1)), jnp.eye(FEET, dtype=dtype)[0])
    count = jnp.zeros((), int)
    nothing = FarthestPlace(zero, none, place, jnp.tile(feet[:, best], (HINTS, 1)), count)
    return SurfaceState(table, nothing, none, none, jnp.array(False), count, count, jnp.array([0, 1]))


def advance(
    a: Target, b: Target, wanted: Wanted, state: SurfaceState, limit: ArrayLike, following: bool
) -> SurfaceState:
    """Advance until the goal or the limit of steps is reached; `following` adds bounds by feet that move.

    The additional bounds make steps a third longer, and compiling too. They are needed only if surfaces are equally far
    from each other along whole regions.
    """

    def open_(state: SurfaceState) -> Array:
        return unfinished(a, b, wanted, state) & (state.steps < limit)

    return jax.lax.while_loop(open_, lambda s: _step(a, b, wanted, s, following), varying(state, a, b))


class _Lanes(NamedTuple):
    """Cells that are bounded in a step, their bounds and feet, and their best point of a with its distance."""

    cells: Boxes
    bound: Array
    feet: Array  # (4, 3, lanes)
    alive: Array
    point: Array  # (3, lanes)
    promise: Array


def _step(a: Target, b: Target, wanted: Wanted, state: SurfaceState, following: bool) -> SurfaceState:
    limit = goal(a.side, b.side, wanted, state)
    # Cells that cannot matter any more make room.
    idle = state.table.bound <= limit
    closed = jnp.maximum(state.closed, jnp.max(jnp.where(idle, state.table.bound, -jnp.inf)))
    bound = jnp.where(idle, -jnp.inf, state.table.bound)
    _, index = jax.lax.top_k(bound.astype(jnp.float32), _LANES)
    rows, parents = state.table.rows[index].T, bound[index]
    state = state._replace(
        table=SurfaceTable(state.table.rows, bound.at[index].set(-jnp.inf)), closed=closed, steps=state.steps + 1
    )
    lanes = _bounded(a.side, b, state, rows, parents, limit, following)
    best = jnp.argmax(lanes.promise)
    place = SurfacePlace(lanes.point[:, best], lanes.feet[:, :, best], jnp.full(FEET, 1 / FEET, limit.dtype))
    # The first one is the farthest point of the cloud.
    first = state.steps == 1
    place = jax.tree_util.tree_map(lambda x, y: jnp.where(first, x, y), state.best.place, place)
    noise = NOISE * unit_roundoff(limit.dtype)
    gain = jnp.maximum(0.1 * tolerance(a.side, b.side, wanted, state.best.lower), noise)
    hoped = lanes.promise[best] > jnp.maximum(state.best.lower, wanted.aim.level) + gain
    # After points that promised too much, some steps go by before the next point is measured.
    asked = first | (hoped & (state.steps >= state.patience[0]))
    capacity = max(CAPACITY, bound.size // _ROWS_OF_MEASURE)
    found = improved(a, b, state.best, place, asked, 0.1 * gain, capacity)
    wait = jnp.where(found.lower > state.best.lower + gain, 1, jnp.minimum(2 * state.patience[1], _LONGEST_WAIT))
    patience = jnp.where(asked, jnp.stack([state.steps + wait, wait]), state.patience)
    state = state._replace(best=found, patience=patience)
    return _cut(a.side, state, lanes, goal(a.side, b.side, wanted, state))


def _bounded(
    a: Side, b: Target, state: SurfaceState, rows: Array, parents: Array, limit: Array, following: bool
) -> _Lanes:
    """Return bounds, feet and the best point of a for the cells of a step, given the bounds of their parents."""
    cells = boxes(rows[:3], rows[3:6])
    form_a = form(a, cells)
    alive = (parents > -jnp.inf) & form_a.may_vanish
    free = inner(a, cells.lower, cells.upper)
    place, points, near = _points(a, cells, free)
    feet, distance = _feet(b, state, place, rows[6:].reshape(FEET, 3, -1), cells)
    radius = thorough_radius(b.side, feet.transpose(1, 0, 2).reshape(3, -1)).reshape(FEET, -1)
    first = jnp.argmin(jnp.where(jnp.isfinite(radius), distance, jnp.inf), axis=0)
    proven = jnp.isfinite(radius)
    feet = jnp.where(proven[:, None], feet, jnp.take_along_axis(feet, first[None, None], axis=0))
    radius = jnp.where(proven, radius, jnp.take_along_axis(radius, first[None], axis=0))
    bound = jnp.minimum(parents, upper_bounds(form_a, cells, feet, radius, free))
    bound = jnp.minimum(bound, sign_bounds(form_a, b.side, cells, free, place, feet[0], limit))
    if following:
        bound = jax.lax.cond(
            jnp.any(alive & (bound > limit)),
            lambda bound: jnp.minimum(bound, moving_bounds(form_a, a, b.side, cells, feet[0])),
            lambda bound: bound,
            bound,
        )
    # Of the points of a that a cell offers, the one farthest from all feet is chosen.
    far = jnp.sqrt(jnp.min(jnp.sum((points[:, None] - feet) ** 2, axis=2), axis=1))
    far = jnp.where(near & alive & (bound > limit), jnp.minimum(far, bound), -jnp.inf)
    which = jnp.argmax(far, axis=0)
    point = jnp.take_along_axis(points, which[None, None], axis=0)[0]
    return _Lanes(cells, jnp.where(alive, bound, -jnp.inf), feet, alive, point, jnp.max(far, axis=0))


def _points(a: Side, cells: Boxes, free: Array) -> tuple[Array, Array, Array]:
    """Return starts for feet, points (2, 3, lanes) of a inside a cell and on the faces it touches, and which count."""
    lower, upper = jnp.asarray(a.lower)[:, None], jnp.asarray(a.upper)[:, None]
    at_face = jnp.where(cells.lower <= lower, lower, upper)
    start = jnp.concatenate([cells.center, jnp.where(free, cells.center, at_face)], axis=1)
    fixed = jnp.concatenate([jnp.zeros_like(free), ~free], axis=1)
    found = projected(a, start, fixed, _STEPS_OF_POINTS)
    value, gradient = slopes(a.coefficients, found)
    on = jnp.abs(value) <= like_double(_ON, found.dtype) * jnp.sqrt(
        jnp.sum(jnp.where(fixed, 0.0, gradient) ** 2, axis=0)
    )
    on = on | on_isolated(a.isolated, found)
    half = jnp.tile(jnp.maximum(cells.half, 0.0), (1, 2))
    near = on & jnp.all(jnp.abs(found - jnp.tile(cells.center, (1, 2))) <= 3 * jnp.max(half, axis=0), axis=0)
    points = jnp.stack(jnp.split(found, 2, axis=1))
    both = near.reshape(2, -1)
    return jnp.where(both[0], points[0], cells.center), points, both


def _feet(b: Target, state: SurfaceState, place: Array, parents: Array, cells: Boxes) -> tuple[Array, Array]:
    """Return four feet (4, 3, lanes) of points: the nearest, and the most distant of about equally near feet."""
    lanes = place.shape[1]
    reach = _TOGETHER * jnp.sqrt(jnp.sum(cells.half**2, axis=0))
    near = _spread_seeds(b.cloud, place, reach)
    hints = jnp.broadcast_to(state.best.hints[:, :, None], (HINTS, 3, lanes))
    starts = jnp.concatenate([parents, near, hints])
    count = starts.shape[0]
    flat = starts.transpose(1, 0, 2).reshape(3, -1)
    found = local_feet(b.side, jnp.tile(place, (1, count)), flat, _STEPS_OF_FEET)
    value, gradient = slopes(b.side.coefficients, found)
    off = jnp.abs(value) / jnp.sqrt(jnp.sum(gradient**2, axis=0))
    off = jnp.where(on_isolated(b.side.isolated, found), 0.0, off)
    found = found.reshape(3, count, lanes).transpose(1, 0, 2)
    distance = jnp.sqrt(jnp.sum((found - place) ** 2, axis=1))
    distance = jnp.where(off.reshape(count, lanes) < like_double(_ON, off.dtype), distance, jnp.inf)
    chosen = [jnp.argmin(distance, axis=0)]
    least = jnp.min(distance, axis=0)
    first = jnp.take_along_axis(found, chosen[0][None, None], axis=0)
    apart = jnp.sum((found - first) ** 2, axis=1)
    for _ in range(FEET - 1):
        chosen.append(jnp.argmax(jnp.where(distance <= least + reach, apart, -1.0), axis=0))
        new = jnp.take_along_axis(found, chosen[-1][None, None], axis=0)
        apart = jnp.minimum(apart, jnp.sum((found - new) ** 2, axis=1))
    index = jnp.stack(chosen)
    feet = jnp.take_along_axis(found, index[:, None], axis=0)
    return feet, jnp.take_along_axis(distance, index, axis=0)


def _spread_seeds(cloud: SurfaceCloud, places: Array, reach: Array) -> Array:
    """Return two cloud points for each point: the nearest, and of about equally near ones the most distant from it."""
    far = sum((cloud.points[i][:, None] - places[i]) ** 2 for i in range(3))
    far = jnp.where(jnp.isfinite(cloud.radius)[:, None], far, jnp.inf)
    first = jnp.argmin(far, axis=0)
    least = jnp.sqrt(jnp.min(far, axis=0))
    near = cloud.points[:, first]
    apart = sum((cloud.points[i][:, None] - near[i]) ** 2 for i in range(3))
    # A cloud's points are apart by about a tenth of the box.
    wide = 0.1 * (jnp.max(cloud.points) - jnp.min(cloud.points))
    second = jnp.argmax(jnp.where(far <= (least + jnp.minimum(reach, wide) + 0.5 * wide) ** 2, apart, -1.0), axis=0)
    return jnp.stack([near, cloud.points[:, second]])


def _cut(a: Side, state: SurfaceState, lanes: _Lanes, limit: Array) -> SurfaceState:
    """Cut the cells, and put the parts that are above the limit into the table."""
    live = lanes.alive & (lanes.bound > limit)
    narrow = jnp.max(lanes.cells.upper - lanes.cells.lower, axis=0) < like_double(_NARROW, limit.dtype)
    closed = jnp.max(jnp.where(lanes.alive & ~(live & ~narrow), lanes.bound, -jnp.inf))
    folded = jnp.max(jnp.where(live & narrow, lanes.bound, -jnp.inf))
    low, high = halved(lanes.cells.lower, lanes.cells.upper)
    kept = form(a, boxes(low, high)).may_vanish & jnp.tile(live & ~narrow, 8)
    bound = jnp.where(kept, jnp.tile(lanes.bound, 8), -jnp.inf)
    rows = jnp.concatenate([low, high, jnp.tile(lanes.feet.reshape(3 * FEET, -1), (1, 8))]).T
    # The table keeps the smallest numbers, so signs are inverted.
    table, negative, dropped = pushed(state.table.rows, -state.table.bound, rows, -bound)
    folded = jnp.maximum(folded, -dropped)
    return state._replace(
        table=SurfaceTable(table, -negative),
        closed=jnp.maximum(jnp.maximum(state.closed, closed), folded),
        folded=jnp.maximum(state.folded, folded),
        full=state.full | (dropped < jnp.inf),
        cells=state.cells + jnp.sum(lanes.bound > -jnp.inf),
    )


def _nearest_of(cloud: SurfaceCloud, points: Array) -> Array:
    """Return the index of the nearest proven point of a cloud for each of the points (3, count), in blocks."""
    count = points.shape[1]
    blocks = jnp.pad(points, ((0, 0), (0, -count % _BLOCK))).T.reshape(-1, _BLOCK, 3)
    penalty = jnp.where(jnp.isfinite(cloud.radius), 0.0, jnp.inf)[:, None]

    def one(block: Array) -> Array:
        far = sum((cloud.points[i][:, None] - block[:, i]) ** 2 for i in range(3)) + penalty
        return jnp.argmin(far, axis=0)

    return jax.lax.map(one, blocks).ravel()[:count]
