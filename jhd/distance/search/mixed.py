"""Minimum distances where a shape is an implicit surface: the search, and derivatives of its answer.

All of it is in common coordinates, to which surfaces and control points move without rounding where they are known.
From the host the nearest points found are made sharp between the stretches of the search: the Lagrange system is solved
about them, and signs in integers prove the surface to be within an ulp or two, where those of enclosures need hundreds.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.arithmetic.scaling import length
from jhd.arrays import array_of, is_traced, is_tracing
from jhd.compiled import compiled
from jhd.distance.cells.implicit import error_of, parameters, size_of
from jhd.distance.cells.lagrange import WithSurface, joined_upper, stationary
from jhd.distance.cells.pairs import BestPair, Cell
from jhd.distance.frame.aim import default_tolerance
from jhd.distance.frame.attach import attached
from jhd.distance.frame.coordinates import Frame, diagonal, extremes
from jhd.distance.frame.net_jets import Net, jet
from jhd.distance.frame.nets import net_of, repeated
from jhd.distance.frame.surfaces import Side, prepare_surfaces
from jhd.distance.nearest.places import exact_radius
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.closest import (
    FIRST_STEPS,
    GROWTH,
    LONGEST,
    ClosestState,
    Outcome,
    advance,
    is_open,
    longer,
    lower_of,
    news_of,
    room_for,
    table_of,
)
from jhd.distance.search.search import AbstractSearch, Listener, Progress, Standing, drive
from jhd.distance.witness.surface_projection import moving_point
from jhd.shapes.implicit import ImplicitSurface
from jhd.solution import RESULTS, MinimumSolution, result_where

# The room for rounding where points are made sharp; the half side, as a share of the size, of the cells for that, and
# steps there.
_ROOM, _ABOUT, _STEPS = 4.0, 1e-4, 24


class _WantedGap(NamedTuple):
    atol: Array
    rtol: Array


def with_surface(
    a: Any, b: Any, method: BranchAndBound, progress: Callable[[Progress], object] | None
) -> MinimumSolution:
    """Minimum distance of two shapes of which one at least is an implicit surface.

    Raises:
        ValueError: a surface that is proven to have no point in its box (not under jit).
    """
    shapes = tuple(shape if isinstance(shape, ImplicitSurface) else net_of(shape) for shape in (a, b))
    still = jax.lax.stop_gradient(shapes)
    known = not is_tracing(still, method)
    # Repeated to a few sizes that programs are compiled for; what repeats is not searched.
    still = tuple(repeated(shape) if known and isinstance(shape, Net) else shape for shape in still)
    *sides, frame = prepare_surfaces(*still)
    problem = WithSurface(*sides)
    wanted = _wanted(problem, frame, method)
    if not known:
        found = _in_one_go(problem, wanted, method)
    else:
        count = max(_count(shape) for shape in shapes)
        search = MixedSearch(_Known(still, frame), problem, count, wanted, method)
        found = drive(search, Listener(progress, frame.length))
        if np.isinf(np.asarray(found.lower)):
            raise ValueError("a or b is a surface without points in its box: its polynomial is proven to have no zero.")
    solution = found.solution(frame)
    if not is_traced(shapes):
        return solution
    moving = _moving(shapes, *jax.lax.stop_gradient((found, solution)))
    return attached(solution, solution.value > 0, value=moving)


class _Known(NamedTuple):
    """Shapes of which all numbers are known, in the user's coordinates, and their frame."""

    shapes: tuple[Any, ...]
    frame: Frame


def _count(shape: ImplicitSurface | Side | Net) -> int:
    """The number of its pieces."""
    return shape.points.shape[0] if isinstance(shape, Net) else 1


def _pairs(problem: WithSurface) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of pieces; one of the shapes has a single one."""
    first, second = (np.arange(_count(side)) for side in problem[:2])
    count = max(first.size, second.size)
    return np.broadcast_to(first, count), np.broadcast_to(second, count)


def _wanted(problem: WithSurface, frame: Frame, method: BranchAndBound) -> _WantedGap:
    if method.atol is not None:
        return _WantedGap(array_of(frame.common(method.atol)), method.rtol)
    corners = [side[2:4] if isinstance(side, Side) else extremes(side.points) for side in problem[:2]]
    # What rounding leaves counts in the search, where it is known how far the nearest points are out.
    size = diagonal(corners)
    return _WantedGap(array_of(default_tolerance(size, size.dtype, 0.0)), method.rtol)


def _begin(problem: WithSurface, pieces: Any, capacity: int) -> ClosestState:
    """The table with the pairs of so many first pieces; further ones repeat the last."""
    first, second = _pairs(problem)
    low, high = (jnp.concatenate(ends) for ends in zip(*(_ends(side) for side in problem[:2]), strict=True))
    count = len(first)
    cells = Cell(jnp.asarray(first), jnp.asarray(second), *(jnp.broadcast_to(x, (count, x.size)) for x in (low, high)))
    zero, infinite = jnp.array(0), jnp.full((), jnp.inf, low.dtype)
    best = BestPair(infinite, infinite, zero, zero, 0.5 * (low + high))
    # Every first cut is along the longest side of a box: the pieces of a net are small already.
    sides = [side.upper - side.lower if isinstance(side, Side) else jnp.zeros(parameters(side)) for side in problem[:2]]
    axis = jnp.full((count,), jnp.argmax(jnp.concatenate(sides)))
    lower = jnp.where(np.arange(count) < pieces, jnp.zeros((), low.dtype), jnp.inf)
    return table_of(lower, cells, axis, best, capacity)


def _ends(side: Net | Side) -> tuple[Array, Array]:
    """The ends of the parameters."""
    if isinstance(side, Side):
        return side.lower, side.upper
    return jnp.zeros(parameters(side), side.points.dtype), jnp.ones(parameters(side), side.points.dtype)


def _outcome(problem: WithSurface, wanted: _WantedGap, state: ClosestState) -> Outcome:
    best, n, dtype = state.best, parameters(problem.a), state.lower.dtype
    point_a, point_b = _point(problem.a, best.piece_a, best.x[:n]), _point(problem.b, best.piece_b, best.x[n:])
    best = best._replace(distance=jnp.where(jnp.isfinite(best.upper), length(point_a - point_b), jnp.inf))
    # What flushing of coordinates below the smallest normal number moves.
    flushed = 16 * smallest_normal(dtype)
    lower, upper = jnp.maximum(lower_of(state) * (1 - gamma(6, dtype)) - flushed, 0.0), best.upper + flushed
    best = best._replace(distance=jnp.clip(best.distance, lower, upper))
    relative = wanted.rtol * jnp.where(jnp.isfinite(upper), upper, 0.0)
    granted = jnp.maximum(jnp.maximum(wanted.atol, relative), 2 * problem.floor)
    failed = result_where(state.lost, RESULTS.capacity_reached, RESULTS.gap_not_closed)
    failed = result_where(jnp.isfinite(upper), failed, RESULTS.unverified)
    result = result_where(upper - lower <= granted, RESULTS.successful, failed)
    stats = {"steps": state.steps, "pairs": state.pairs, "waiting": jnp.sum(jnp.isfinite(state.lower))}
    return Outcome(best, lower, upper, point_a, point_b, result, stats)


def _point(side: Net | Side, k: Array, x: Array) -> Array:
    return x if isinstance(side, Side) else jet(side.piece(k), x).point


_begun = compiled(_begin, (2,))


_advanced = compiled(advance)


class MixedSearch(AbstractSearch):
    """The search of jhd.distance.search.closest where a shape is an implicit surface; nearest points are made sharp.

    Args:
        known: both shapes.
        problem: the same in common coordinates.
        count: the number of pieces that are not repetitions.
        wanted: what is asked for.
        method: the options.
    """

    first_steps = FIRST_STEPS

    def __init__(self, known: _Known, problem: WithSurface, count: int, wanted: _WantedGap, method: BranchAndBound):
        self._known, self._problem, self._count, self._wanted = known, problem, count, wanted
        self._capacity, self.max_steps = method.capacity, method.max_steps

    def begin(self) -> ClosestState:
        """See AbstractSearch."""
        room = room_for(_pairs(self._problem)[0].size, self._capacity)
        return _begun(self._problem, np.asarray(self._count), room)

    def advance(self, state: ClosestState, limit: int, growing: bool) -> tuple[ClosestState, Standing]:
        """See AbstractSearch."""
        problem, grows = self._with_room(state), np.asarray(growing and state.lower.size < LONGEST)
        state = _advanced(problem, *self._wanted, state, np.asarray(limit), grows)
        state = state._replace(best=_sharp(self._known, problem, state.best))
        found, news = _standing(self._with_room(state), self._wanted, state, grows)
        return state, Standing(found, *np.asarray(news))

    def longer(self, state: ClosestState) -> ClosestState:
        """See AbstractSearch."""
        return longer(state, GROWTH)

    def _with_room(self, state: ClosestState) -> WithSurface:
        return WithSurface(self._problem.a, self._problem.b, _room(self._problem, state.best))


@compiled
def _room(problem: WithSurface, best: BestPair) -> Array:
    """The room for rounding about the nearest points found, which may be far smaller than the boxes are; else none."""
    n = parameters(problem.a)
    point_a, point_b = _point(problem.a, best.piece_a, best.x[:n]), _point(problem.b, best.piece_b, best.x[n:])
    reach = jnp.maximum(jnp.max(jnp.abs(point_a)), jnp.max(jnp.abs(point_b)))
    size = jnp.maximum(size_of(problem.a), size_of(problem.b))
    return jnp.where(jnp.isfinite(best.upper), _ROOM * reach / jnp.where(size > 0, size, 1.0), 0.0)


@compiled
def _standing(problem: WithSurface, wanted: _WantedGap, state: ClosestState, growing: Array) -> tuple[Outcome, Array]:
    """The outcome as it stands, and how the search stands in four numbers."""
    going_on = is_open(problem, wanted.atol, wanted.rtol, state)
    return _outcome(problem, wanted, state), news_of(state, going_on, growing)


def _sharp(known: _Known, problem: WithSurface, best: BestPair) -> BestPair:
    """The nearest points where the Lagrange system is solved, if they are proven to be nearer than those found."""
    if not np.isfinite(np.asarray(best.upper)):
        return best
    n = parameters(problem.a)
    for x in (_solved(problem, best), best.x):
        radii = [
            exact_radius(shape, side, known.frame, np.asarray(part))
            if isinstance(side, Side)
            else float(error_of(side))
            for shape, side, part in zip(known.shapes, problem[:2], (x[:n], x[n:]), strict=True)
        ]
        best = _nearer(problem, best, x, np.asarray(radii, x.dtype))
    return best


@compiled
def _solved(problem: WithSurface, best: BestPair) -> Array:
    lows, highs = (jnp.concatenate(ends) for ends in zip(*(_ends(side) for side in problem[:2]), strict=True))
    half = _ABOUT * jnp.max(highs - lows)
    cell = Cell(best.piece_a, best.piece_b, jnp.maximum(best.x - half, lows), jnp.minimum(best.x + half, highs))
    width = cell.high - cell.low
    start = (best.x - cell.low) / jnp.where(width > 0, width, 1.0)
    z = stationary(problem.a, problem.b, cell, start, _STEPS).z
    # Sides of the cell are met exactly: they may be faces of the box.
    return jnp.where(z >= 1, cell.high, jnp.clip(cell.low + z * width, cell.low, cell.high))


@compiled
def _nearer(problem: WithSurface, best: BestPair, x: Array, radii: Array) -> BestPair:
    n = parameters(problem.a)
    distance = length(_point(problem.a, best.piece_a, x[:n]) - _point(problem.b, best.piece_b, x[n:]))
    upper = joined_upper(distance, radii)
    new = BestPair(upper, distance, best.piece_a, best.piece_b, x)
    return BestPair(*(jnp.where(upper < best.upper, y, z) for y, z in zip(new, best, strict=True)))


def _in_one_go(problem: WithSurface, wanted: _WantedGap, method: BranchAndBound) -> Outcome:
    def search(problem: WithSurface, wanted: _WantedGap) -> Outcome:
        count = _pairs(problem)[0].size
        state = _begin(problem, count, room_for(count, method.capacity))
        return _outcome(problem, wanted, advance(problem, wanted.atol, wanted.rtol, state, method.max_steps))

    if jax.default_backend() == "cpu":
        search = sequential_vmap(search)
    return search(problem, wanted)


@compiled
def _moving(shapes: tuple[Any, Any], found: Outcome, solution: MinimumSolution) -> Array:
    """A function of both shapes with the first derivatives of the distance, from the outcome in both coordinates.

    With u = (p - q) / |p - q| it is that of u.(p - q) at fixed parameters, a point of a polynomial surface moving along
    its normal. At distance zero, and where nothing was found, all derivatives are zero.
    """
    n = shapes[0].parameters if isinstance(shapes[0], Net) else 3
    usable = (solution.value > 0) & jnp.isfinite(solution.value)
    e = jnp.where(usable, found.point_a - found.point_b, 1.0)
    unit = e / length(e)
    total = jnp.zeros_like(solution.value)
    for shape, point, sign, k, x in (
        (shapes[0], solution.point_a, 1.0, found.best.piece_a, found.best.x[:n]),
        (shapes[1], solution.point_b, -1.0, found.best.piece_b, found.best.x[n:]),
    ):
        known = isinstance(shape, Net)
        at = jet(shape.piece(k), x).point if known else moving_point(shape.coefficients, jnp.stack(shape.box()), point)
        total += sign * jnp.sum(unit * at)
    return total
