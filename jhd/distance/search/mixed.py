"""Minimum distances where a shape is an implicit surface: the search, and derivatives of its answer.

All of it is in common coordinates, to which surfaces and control points move without rounding where they are known.
From the host the nearest points found are made sharp between the stretches of the search: the Lagrange system is solved
about them, and signs in integers prove the surface to be within an ulp or two, where those of enclosures need hundreds.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.arithmetic.scaling import length
from jhd.arrays import is_traced, is_tracing
from jhd.compiled import compiled
from jhd.distance.cells.implicit import error_of, parameters, size_of
from jhd.distance.cells.lagrange import WithSurface, joined_upper, stationary
from jhd.distance.cells.pairs import BestPair, Cell
from jhd.distance.frame.attach import attached
from jhd.distance.frame.coordinates import Frame, extremes
from jhd.distance.frame.net_jets import Net, jet
from jhd.distance.frame.nets import net_of, repeated
from jhd.distance.frame.surfaces import Side, prepare_surfaces
from jhd.distance.nearest.places import exact_radius
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.closest import (
    ClosestSearch,
    ClosestState,
    Outcome,
    WantedGap,
    advance,
    in_one_go,
    lower_of,
    news_of,
    outcome,
    pairs_of,
    room_for,
    table_of,
    wanted_gap,
)
from jhd.distance.search.search import Listener, Progress, drive
from jhd.distance.witness.surface_projection import moving_point
from jhd.shapes.implicit import ImplicitSurface
from jhd.solution import MinimumSolution

# The room for rounding where points are made sharp; the half side, as a share of the size, of the cells for that, and
# steps there.
_ROOM, _ABOUT, _STEPS = 4.0, 1e-4, 24


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
    corners = [side[2:4] if isinstance(side, Side) else extremes(side.points) for side in sides]
    # What rounding leaves counts in the search, where it is known how far the nearest points are out.
    wanted = wanted_gap(corners, frame, method, 0.0)
    pieces = np.asarray(max(_count(shape) for shape in shapes))
    if not known:
        begun = lambda problem: _begin(problem, pieces, method.capacity)  # noqa: E731
        found = in_one_go(begun, _outcome, problem, wanted, method.max_steps)
    else:
        stretch = partial(_stretch, _Known(still, frame), problem, wanted)
        search = ClosestSearch(partial(_begun, problem, pieces, method.capacity), stretch, method.max_steps)
        found = drive(search, Listener(progress, frame))
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


def _begin(problem: WithSurface, pieces: Any, capacity: int) -> ClosestState:
    """The table with the pairs of so many first pieces; further ones repeat the last. One shape has a single one."""
    first, second = pairs_of((_count(problem.a), _count(problem.b))).T
    low, high = (jnp.concatenate(ends) for ends in zip(*(_ends(side) for side in problem[:2]), strict=True))
    count = len(first)
    cells = Cell(jnp.asarray(first), jnp.asarray(second), *(jnp.broadcast_to(x, (count, x.size)) for x in (low, high)))
    zero, infinite = jnp.array(0), jnp.full((), jnp.inf, low.dtype)
    best = BestPair(infinite, infinite, zero, zero, 0.5 * (low + high))
    # Every first cut is along the longest side of a box: the pieces of a net are small already.
    sides = [side.upper - side.lower if isinstance(side, Side) else jnp.zeros(parameters(side)) for side in problem[:2]]
    axis = jnp.full((count,), jnp.argmax(jnp.concatenate(sides)))
    lower = jnp.where(np.arange(count) < pieces, jnp.zeros((), low.dtype), jnp.inf)
    return table_of(lower, cells, axis, best, room_for(count, capacity))


def _ends(side: Net | Side) -> tuple[Array, Array]:
    """The ends of the parameters."""
    if isinstance(side, Side):
        return side.lower, side.upper
    return jnp.zeros(parameters(side), side.points.dtype), jnp.ones(parameters(side), side.points.dtype)


def _outcome(problem: WithSurface, wanted: WantedGap, state: ClosestState) -> Outcome:
    best, n, dtype = state.best, parameters(problem.a), state.lower.dtype
    point_a, point_b = _point(problem.a, best.piece_a, best.x[:n]), _point(problem.b, best.piece_b, best.x[n:])
    best = best._replace(distance=jnp.where(jnp.isfinite(best.upper), length(point_a - point_b), jnp.inf))
    # What flushing of coordinates below the smallest normal number moves.
    flushed = 16 * smallest_normal(dtype)
    lower, upper = jnp.maximum(lower_of(state) * (1 - gamma(6, dtype)) - flushed, 0.0), best.upper + flushed
    return outcome(wanted, state, best, (lower, upper), (point_a, point_b), problem.floor)


def _point(side: Net | Side, k: Array, x: Array) -> Array:
    return x if isinstance(side, Side) else jet(side.piece(k), x).point


_begun = compiled(_begin, (2,))


_advanced = compiled(advance)


def _stretch(
    known: _Known, problem: WithSurface, wanted: WantedGap, state: ClosestState, limit: np.ndarray, growing: np.ndarray
) -> tuple[ClosestState, Outcome, Array]:
    """Goes on for some steps, then makes the nearest points sharp."""
    state = _advanced(_with_room(problem, state), wanted, state, limit, growing)
    state = state._replace(best=_sharp(known, problem, state.best))
    return state, *_standing(_with_room(problem, state), wanted, state, growing)


def _with_room(problem: WithSurface, state: ClosestState) -> WithSurface:
    return problem._replace(room=_room(problem, state.best))


@compiled
def _room(problem: WithSurface, best: BestPair) -> Array:
    """The room for rounding about the nearest points found, which may be far smaller than the boxes are; else none."""
    n = parameters(problem.a)
    point_a, point_b = _point(problem.a, best.piece_a, best.x[:n]), _point(problem.b, best.piece_b, best.x[n:])
    reach = jnp.maximum(jnp.max(jnp.abs(point_a)), jnp.max(jnp.abs(point_b)))
    size = jnp.maximum(size_of(problem.a), size_of(problem.b))
    return jnp.where(jnp.isfinite(best.upper), _ROOM * reach / jnp.where(size > 0, size, 1.0), 0.0)


@compiled
def _standing(problem: WithSurface, wanted: WantedGap, state: ClosestState, growing: Array) -> tuple[Outcome, Array]:
    """The outcome as it stands, and how the search stands in four numbers."""
    return _outcome(problem, wanted, state), news_of(problem, wanted, state, growing)


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
