"""Minimum distances of implicit surfaces to shapes of any kind: the search, and derivatives of its result.

The search runs in common coordinates, to which surfaces and control points move without rounding if they are known.
Between the stretches of the search, the host refines the nearest points found: it solves the Lagrange system about
them, and signs in integers prove that the surface is within an ulp or two; signs of enclosures need hundreds.
"""

from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.scaling import length
from jhd._distance.cells.implicit import error_of, size_of
from jhd._distance.cells.lagrange import WithSurface, joined_upper, stationary
from jhd._distance.cells.pairs import BestPair, Cell
from jhd._distance.nearest.surface_points import exact_radius
from jhd._distance.normalization.coordinates import Frame, extremes
from jhd._distance.normalization.host_callback import from_program
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.nets import net_of, repeated
from jhd._distance.normalization.surfaces import Side, prepare_surfaces
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.closest import (
    ClosestState,
    Outcome,
    Reached,
    WantedGap,
    advance,
    close_enough,
    in_one_go,
    news_of,
    outcome,
    pairs_of,
    reached_by,
    room_for,
    table_of,
    wanted_gap,
)
from jhd._distance.search.near_pairs import Crossing, NearPairs, around, crossing, near_pairs
from jhd._distance.search.on_surfaces import SurfaceTarget
from jhd._distance.search.pair_queue import PART, QueuedSearch
from jhd._distance.search.search import AbstractSearch, Listener, drive
from jhd._distance.search.surface_source import looked_at
from jhd._distance.search.targets import usable
from jhd._distance.search.two_phase_minimum import InTurn
from jhd._distance.witness.mixed_derivatives import with_pair_derivatives
from jhd._results.solution import RESULTS, MinimumSolution
from jhd._runtime.arrays import is_tracing, undifferentiated
from jhd._runtime.compiled import compiled
from jhd._shapes.checks import empty_surface
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd.progress import Callback

# Slack for rounding when points are sharpened; half side of the cells for this, as a fraction of the size; steps.
_ROOM, _ABOUT, _STEPS = 4.0, 1e-4, 24
# Up to this many pieces all pairs are searched, each over the whole surface; more are thinned out before the search.
_FEW = 64
# A number of steps that no search takes.
_ENDLESS = 1 << 30
# Steps over a few near pieces, for a first distance.
_FIRST = 32
# How often the first pairs are replaced, while this reduces the distance at least to this fraction.
_TIMES, _NEARER = 12, 0.99


def with_surface(a: Any, b: Any, method: BranchAndBound, progress: Callback | None) -> MinimumSolution:
    """Return the minimum distance of two shapes, at least one of them an implicit surface.

    Raises:
        ValueError: a surface that is proven to have no point in its box (not under jit).
    """
    shapes = tuple(shape if isinstance(shape, ImplicitSurface) else net_of(shape) for shape in (a, b))
    still: Any = undifferentiated(shapes)
    is_mesh = isinstance(a, TriangleMesh)
    if not is_tracing(still, method):
        found = _from_here(still, method, is_mesh, progress)
    elif max(map(_count, shapes)) > _FEW:
        found = _from_program(still, method, is_mesh)
    else:
        found = _in_program(still, method)
    outcome, solution = undifferentiated(found)
    best = outcome.best
    return with_pair_derivatives(solution, shapes, (best.piece_a, best.piece_b), best.x, best.distance)


class _FoundBoth(NamedTuple):
    """The result of a search, in common coordinates and in the user's."""

    outcome: Outcome
    solution: MinimumSolution


def _in_program(shapes: tuple[Any, Any], method: BranchAndBound) -> _FoundBoth:
    """Run the search in one compiled function."""
    task = _task_of(shapes, method)
    pieces = np.asarray(max(map(_count, shapes)))
    begun = lambda problem: _begin(problem, pieces, method.queue_size)  # noqa: E731
    found = in_one_go(begun, _outcome, task.problem, task.wanted, method.max_steps)
    return _FoundBoth(found, found.solution(task.frame))


def _from_here(
    shapes: tuple[Any, Any], method: BranchAndBound, is_mesh: bool, progress: Callback | None = None
) -> _FoundBoth:
    """Return the result of the search from the host, for known numbers; `is_mesh` tells whether the net is a mesh."""
    pieces = max(map(_count, shapes))
    # Repeated up to a few sizes that functions are compiled for; repetitions are not searched.
    task = _task_of(tuple(repeated(shape) if isinstance(shape, Net) else shape for shape in shapes), method)
    found = drive(_search(task, pieces, method, is_mesh), Listener(progress, task.frame))
    if np.isinf(np.asarray(found.lower)):
        raise empty_surface(_empty_of(task.problem))
    return _FoundBoth(found, found.solution(task.frame))


def _empty_of(problem: WithSurface) -> str:
    """Return the name of the shape without points if both are surfaces, else an empty string."""
    sides = [side for side in problem[:2] if isinstance(side, Side)]
    return next((name for name, side in zip("ab", sides, strict=True) if looked_at(side)[1]), "") if sides[1:] else ""


def _search(task: "_SurfaceTask", pieces: int, method: BranchAndBound, is_mesh: bool) -> AbstractSearch:
    """Return the search over all pairs of pieces; for many pieces only over pairs that may be nearest."""
    problem, capacity = task.problem, method.queue_size
    first: Any = problem.a
    surface: Any = problem.b
    room = room_for(PART, capacity)
    meeting = crossing(surface, first, pieces) if pieces > _FEW and is_mesh else None
    near = near_pairs(surface, first, pieces, is_mesh) if pieces > _FEW and meeting is None else None
    if meeting is not None:
        pairs, best = meeting.pairs, _met(meeting)
    elif near is not None:
        pairs, best = near[0], _first(task, pieces, near[1], room)
    else:
        begun = partial(_begun, problem, np.asarray(pieces), capacity)
        if isinstance(first, Side):
            known = _isolated_pairs(problem)
            task, problem = task._replace(problem=known.problem), known.problem
            begun = lambda: known.told(_begun(known.problem, np.asarray(pieces), capacity))  # noqa: E731
        return InTurn(
            begun,
            partial(_stretch, task),
            partial(_with_room, problem),
            partial(_sharp, task),
            lambda reached: _shown(_with_room(problem, reached.best), task.wanted, reached),
            task.wanted,
        )

    def filled(start: int) -> ClosestState:
        return _filled(problem, pairs.part(start, PART), best, room)

    def closed(table: ClosestState) -> float:
        return float(close_enough(_with_room(problem, table.best), task.wanted, table.best))

    # The table is replaced by the next pairs when it makes no more progress, so it must not be given up.
    going = task._replace(wanted=task.wanted._replace(most=np.asarray(_ENDLESS)))
    return QueuedSearch(pairs.lower, filled, partial(_stretch, going), closed, method.max_steps)


def _first(task: "_SurfaceTask", pieces: int, few: NearPairs, room: int) -> BestPair:
    """Return a pair of near points before the search, improved by pairs around it while the distance decreases.

    The whole box is used: if both shapes nearly touch, small cells lose feet.
    """
    problem, best = task.problem, _unknown(task.problem)
    net: Any = problem.a
    surface: Any = problem.b
    for _ in range(_TIMES):
        table = _filled(problem, few.part(0, PART), best, room)
        found = _stretch(task, table, np.asarray(_FIRST), np.asarray(False))[0].best
        if not found.upper < _NEARER * best.upper:
            return found
        best = found
        few = around(surface, net, pieces, np.asarray(best.x[net.parameters :]))
    return best


def _met(meeting: Crossing) -> BestPair:
    """Return a pair at distance zero."""
    zero: Any = np.zeros((), meeting.place.dtype)
    x: Any = np.concatenate([meeting.x, meeting.place])
    piece: Any = np.asarray(meeting.piece)
    return BestPair(zero, zero, piece, jnp.array(0), x)


def _from_program(shapes: tuple[Any, Any], method: BranchAndBound, is_mesh: bool) -> _FoundBoth:
    """Run the search from the host, called from a compiled function."""
    dtype, n = shapes[0].points.dtype, shapes[0].parameters + 3

    def refused(result: Any = RESULTS.nonfinite_value) -> _FoundBoth:
        number = lambda x, *shape: jnp.full(shape, x, dtype)  # noqa: E731
        zero, infinite = jnp.array(0), number(jnp.inf)
        best = BestPair(infinite, infinite, zero, zero, number(0.0, n))
        stats = {"steps": zero, "pairs": zero, "waiting": zero}
        parts = infinite, number(0.0), infinite, number(jnp.nan, 3), number(jnp.nan, 3), result, stats
        return _FoundBoth(Outcome(best, *parts[1:]), MinimumSolution(*parts))

    def search(shapes: Any, method: BranchAndBound) -> _FoundBoth:
        if not usable(shapes[1]):
            return refused()
        try:
            return _from_here(shapes, method, is_mesh)
        except ValueError:
            return refused(RESULTS.empty_surface)

    return from_program(search, refused, shapes, method)


class _SurfaceTask(NamedTuple):
    """Shapes in the user's and in common coordinates, the frame that leads back, and the tolerances."""

    shapes: tuple[Any, ...]
    problem: WithSurface
    frame: Frame
    wanted: WantedGap


def _task_of(shapes: tuple[Any, ...], method: BranchAndBound) -> _SurfaceTask:
    *sides, frame = prepare_surfaces(*shapes)
    corners = [side[2:4] if isinstance(side, Side) else extremes(side.points) for side in sides]
    # Rounding counts in the search, which knows how far out the nearest points are.
    return _SurfaceTask(shapes, WithSurface(*sides), frame, wanted_gap(corners, frame, method, 0.0))


def _count(shape: ImplicitSurface | Side | Net) -> int:
    """Return the number of pieces of a shape."""
    return shape.points.shape[0] if isinstance(shape, Net) else 1


def _begin(problem: WithSurface, pieces: Any, capacity: int) -> ClosestState:
    """Return the table with the pairs of the first `pieces` pieces; further pieces repeat the last.

    One shape has one piece.
    """
    first, second = pairs_of((_count(problem.a), _count(problem.b))).T
    low, high = (jnp.concatenate(ends) for ends in zip(*(_ends(side) for side in problem[:2]), strict=True))
    count = len(first)
    cells = Cell(jnp.asarray(first), jnp.asarray(second), *(jnp.broadcast_to(x, (count, x.size)) for x in (low, high)))
    # Every first cut is along the longest side of a box: the pieces of a net are small already. Of two surfaces the
    # first one is cut: the second may do whole.
    sides = [jnp.zeros(side.parameters) for side in problem[:2]]
    k = 0 if isinstance(problem.a, Side) else 1
    cut: Any = problem[k]
    sides[k] = cut.upper - cut.lower
    axis = jnp.full((count,), jnp.argmax(jnp.concatenate(sides)))
    lower = jnp.where(np.arange(count) < pieces, jnp.zeros((), low.dtype), jnp.inf)
    return table_of(lower, cells, axis, _unknown(problem), room_for(count, capacity))


def _unknown(problem: WithSurface) -> BestPair:
    """Return the initial pair, with an infinite distance."""
    low, high = (jnp.concatenate(ends) for ends in zip(*(_ends(side) for side in problem[:2]), strict=True))
    zero, infinite = jnp.array(0), jnp.full((), jnp.inf, low.dtype)
    return BestPair(infinite, infinite, zero, zero, 0.5 * (low + high))


def _ends(side: Net | Side) -> tuple[Array, Array]:
    """Return the ends of the parameters."""
    if isinstance(side, Side):
        return side.lower, side.upper
    return jnp.zeros(side.parameters, side.points.dtype), jnp.ones(side.parameters, side.points.dtype)


def _outcome(problem: WithSurface, wanted: WantedGap, reached: Reached) -> Outcome:
    best, n, dtype = reached.best, problem.a.parameters, reached.lower.dtype
    point_a, point_b = problem.a.piece(best.piece_a).point(best.x[:n]), problem.b.piece(best.piece_b).point(best.x[n:])
    best = best._replace(distance=jnp.where(jnp.isfinite(best.upper), length(point_a - point_b), jnp.inf))
    # Change by flushing coordinates below the smallest normal number.
    flushed = 16 * smallest_normal(dtype)
    lower, upper = jnp.maximum(reached.lower * (1 - gamma(6, dtype)) - flushed, 0.0), best.upper + flushed
    return outcome(wanted, reached, best, (lower, upper), (point_a, point_b), problem.floor)


_begun = compiled(_begin, (2,))


@partial(compiled, static=(3,))
def _filled(problem: WithSurface, pairs: NearPairs, best: BestPair, capacity: int) -> ClosestState:
    """Return the table with pairs of cells of the surface and whole pieces."""
    n, count, dtype = problem.a.parameters, pairs.lower.shape[0], pairs.lower.dtype
    ends = jnp.zeros((count, n), dtype), jnp.ones((count, n), dtype)
    low, high = (jnp.concatenate(x, axis=1) for x in zip(ends, (pairs.low, pairs.high), strict=True))
    cells = Cell(jnp.asarray(pairs.piece), jnp.zeros(count, int), low, high)
    return table_of(pairs.lower, cells, n + jnp.argmax(pairs.high - pairs.low, axis=1), best, capacity)


_advanced = compiled(advance)


def _stretch(
    task: _SurfaceTask, state: ClosestState, limit: np.ndarray, growing: np.ndarray, waiting: Any = np.inf
) -> tuple[ClosestState, Outcome, Array]:
    """Run some steps, then sharpen the nearest points; pairs with bound `waiting` wait outside the table."""
    problem, wanted = task.problem, task.wanted
    state = _advanced(_with_room(problem, state.best), wanted, state, limit, growing)
    state = state._replace(best=_sharp(task, state.best))
    shown = state._replace(settled=jnp.minimum(state.settled, waiting))
    return state, *_standing(_with_room(problem, state.best), wanted, shown, growing)


def _with_room(problem: WithSurface, best: BestPair) -> WithSurface:
    return problem._replace(room=_room(problem, best))


@compiled
def _room(problem: WithSurface, best: BestPair) -> Array:
    """Return the room for rounding about the nearest points found, which may be far smaller than the boxes."""
    n = problem.a.parameters
    point_a, point_b = problem.a.piece(best.piece_a).point(best.x[:n]), problem.b.piece(best.piece_b).point(best.x[n:])
    reach = jnp.maximum(jnp.max(jnp.abs(point_a)), jnp.max(jnp.abs(point_b)))
    size = jnp.maximum(size_of(problem.a), size_of(problem.b))
    return jnp.where(jnp.isfinite(best.upper), _ROOM * reach / jnp.where(size > 0, size, 1.0), 0.0)


@compiled
def _standing(problem: WithSurface, wanted: WantedGap, state: ClosestState, growing: Array) -> tuple[Outcome, Array]:
    """Return the outcome as it stands, and the progress of the search in four numbers."""
    return _outcome(problem, wanted, reached_by(state)), news_of(problem, wanted, state, growing)


_shown = compiled(_outcome)


def _sharp(task: _SurfaceTask, best: BestPair) -> BestPair:
    """Return the nearest points at a solution of the Lagrange system, if these are proven to be nearer."""
    problem = task.problem
    if not np.isfinite(np.asarray(best.upper)):
        return best
    n = problem.a.parameters
    for x in (_solved(problem, best), best.x):
        radii = [
            exact_radius(shape, side, task.frame, np.asarray(part)) if isinstance(side, Side) else float(error_of(side))
            for shape, side, part in zip(task.shapes, problem[:2], (x[:n], x[n:]), strict=True)
        ]
        best = _nearer(problem, best, x, np.asarray(radii, x.dtype))
    return best


@compiled
def _solved(problem: WithSurface, best: BestPair) -> Array:
    """Return the coordinates of the pair after solving the Lagrange system in a small cell about it."""
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
    n = problem.a.parameters
    distance = length(problem.a.piece(best.piece_a).point(x[:n]) - problem.b.piece(best.piece_b).point(x[n:]))
    upper = joined_upper(distance, radii)
    new = BestPair(upper, distance, best.piece_a, best.piece_b, x)
    return BestPair(*(jnp.where(upper < best.upper, y, z) for y, z in zip(new, best, strict=True)))


# ---- isolated points -----------------------------------------------------------------------------
# About such a point no sign of the polynomial proves anything and no part of the surface is a graph. So cells that
# hold the point get smaller and smaller, and so do nearby cells of the opposite surface; these are many if all of it
# is about equally near. The nearest points to a known point are found at once (jhd._distance.nearest.surfaces). The
# rest of the surface has no such point.


class _IsolatedPairs(NamedTuple):
    """A pair of surfaces without their isolated points, and the distances of these points."""

    problem: WithSurface  # the pair without these points
    lower: float  # a lower bound of their distances from the other surface; infinite if there are no such points
    best: BestPair | None  # the nearest of these points with its foot, or None

    def told(self, table: ClosestState) -> ClosestState:
        """Return a table that begins with the known bound and pair."""
        best = table.best if self.best is None or not self.best.upper < table.best.upper else self.best
        return table._replace(settled=jnp.minimum(table.settled, self.lower).astype(table.settled.dtype), best=best)


def _isolated_pairs(problem: WithSurface) -> _IsolatedPairs:
    """Return both surfaces with their isolated points measured.

    Raises:
        ValueError: one has such a point, and the other is proven to have no point in its box.
    """
    sides: Any = problem[:2]
    found = [_without_isolated(own, other) for own, other in zip(sides, sides[::-1], strict=True)]
    pairs = [(upper, np.concatenate(x if k == 0 else x[::-1])) for k, (_, _, upper, *x) in enumerate(found) if x]
    best = None
    if pairs:
        upper, x = min(pairs, key=lambda pair: pair[0])
        zero: Any = jnp.array(0)
        apart: Any = np.sqrt(np.sum((x[:3] - x[3:]) ** 2))
        best = BestPair(jnp.asarray(upper), jnp.asarray(np.minimum(apart, upper)), zero, zero, jnp.asarray(x))
    left = problem._replace(a=found[0][0], b=found[1][0])
    return _IsolatedPairs(left, min(found[0][1], found[1][1]), best)


def _without_isolated(own: Side, other: Side) -> tuple[Any, ...]:
    """Return a surface without its isolated points, bounds of their distances, and the nearest with its foot."""
    points = own.isolated
    known = (np.asarray(points.half) > 0) & (np.asarray(points.radius) >= 0) & np.asarray(points.there)
    if not known.any():
        return own, np.inf, np.inf
    center, radius = np.asarray(points.center)[known], np.asarray(points.radius)[known]
    found = SurfaceTarget(other).nearest(center)
    room = gamma(4, center.dtype)
    # Differences round towards either side by less than this fraction of the larger number.
    lower = np.maximum(found.lower - radius - room * found.lower, 0.0)
    upper = (found.upper + radius) * (1 + room)
    left = points._replace(radius=np.where(known, -np.inf, points.radius), there=np.asarray(points.there) & ~known)
    k = int(np.argmin(upper))
    ends = (center[k], found.foot[k]) if np.isfinite(upper[k]) else ()
    return own._replace(isolated=left), float(np.min(lower)), upper[k], *ends
