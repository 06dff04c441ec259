"""Directed distances of shapes of any two kinds: the search that serves them, common coordinates, and tolerances.

A point set needs no cells. All points get a proven upper bound at once, from a point of the target near them; then the
farthest points are measured, until the largest distance proven reaches the next upper bound.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.foot_maps import Triangles
from jhd._distance.cells.surfaces import FEET
from jhd._distance.nearest.target import AbstractTarget, MeshTarget, PointTarget, ProvenFeet
from jhd._distance.normalization.coordinates import Frame, common_points, diagonal, extremes
from jhd._distance.normalization.host_callback import AnswerForm, from_program
from jhd._distance.normalization.net_jets import Net, eta, point_error
from jhd._distance.normalization.nets import hull_of, net_of, prepare_nets, repeated
from jhd._distance.normalization.stopping import Aim, AllowedGap, default_tolerance
from jhd._distance.normalization.surfaces import Side, prepare_surfaces
from jhd._distance.search import farthest_place
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.cell_heights import CellHeights
from jhd._distance.search.closest_triangles import as_mesh
from jhd._distance.search.farthest_place import FarthestSearch
from jhd._distance.search.followed_cells import FollowedFeet, padded_pieces
from jhd._distance.search.followed_graphs import FollowedGraphs, FollowedOnSurface, places_on_graphs
from jhd._distance.search.meshes import mesh_directed
from jhd._distance.search.on_patches import NetTarget
from jhd._distance.search.on_surfaces import SurfaceTarget
from jhd._distance.search.points import is_points
from jhd._distance.search.polished_place import About, place_of
from jhd._distance.search.search import AbstractSearch, Listener, Standing, drive
from jhd._distance.search.sources import AbstractSource, MeshSource, NetSource
from jhd._distance.search.surface_candidates import looked_at
from jhd._distance.search.surface_source import SurfaceSource
from jhd._distance.search.targets import target_of, usable
from jhd._distance.witness.mixed_derivatives import with_place_derivatives
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness
from jhd._runtime.arrays import is_tracing, taken, undifferentiated
from jhd._shapes.checks import empty_surface
from jhd._shapes.curve import BezierSegments
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import BezierPatches
from jhd._shapes.prepared import prepared

# Resolution of the search over an implicit surface, in units of roundoff of the common coordinates.
_ULPS = 512
# The size of points, in units of a surface, from which on their common box is the unit; by the bytes of a number.
_FAR = {8: 2.0**400, 4: 2.0**40}
# Points of the first step; each step takes twice as many, up to the best number for the target.
_FIRST = 32
# Counts: steps, points, and points that were measured.
_POINT_COUNTS = "steps", "points", "measured"
# Steps of the first stretch.
_FIRST_STEPS = 16


def mixed_directed(
    a: Any, b: Any, method: BranchAndBound, aim: Aim, listener: Listener, direction: Any
) -> HausdorffSolution:
    """The directed distance of two shapes of any kinds, in their own coordinates.

    The value is differentiable in both, twice.

    Args:
        a: points, BezierSegments, BezierPatches, an ImplicitSurface or a TriangleMesh; in space unless both are points.
        b: a shape of these kinds.
        method: the options.
        aim: range of distances that matter.
        listener: listener of the call; not under tracing.
        direction: a member of DIRECTIONS.

    Raises:
        ValueError: an implicit surface without points in its box (not under tracing).
    """
    other = as_mesh(b) if isinstance(b, TriangleMesh) or is_points(b) else None
    if isinstance(a, TriangleMesh) and other is not None:
        found = mesh_directed(*undifferentiated((a, other)), method, aim, listener, direction)
        return with_place_derivatives(found, a, other)
    found = _directed(*undifferentiated((a, b)), method, aim, listener, direction)
    return with_place_derivatives(found, a, b)


def _directed(
    a: Any, b: Any, method: BranchAndBound, aim: Aim, listener: Listener, direction: Any
) -> HausdorffSolution:
    # Inside jit all operations are traced, also on known numbers.
    if not is_tracing(a, b, method, aim):
        return drive(_search(a, b, method, aim), listener, direction)
    refused = _form(a, b).refused

    def search(shapes: Any, method: BranchAndBound, aim: Aim) -> HausdorffSolution:
        if not all(usable(x) for x in shapes):
            return refused()
        try:
            return drive(_search(shapes[0], shapes[1], method, aim), Listener(), direction)
        except ValueError:
            return refused(RESULTS.empty_surface)

    return from_program(search, refused, (a, b), method, aim)


def _search(a: Any, b: Any, method: BranchAndBound, aim: Aim) -> AbstractSearch:
    if not is_points(a):
        return _farthest(a, b, method, aim)
    points, target = np.asarray(a.control_points)[:, 0], target_of(b)
    # Targets whose bounds differ by rounding only need no tolerance.
    atol = 0.0 if target.sharp else float(default_tolerance(diagonal_of(a, b), points.dtype, 0.0))
    atol = atol if method.atol is None else float(method.atol)
    allowed = AllowedGap(atol, float(method.rtol), target.rounding, method.atol is not None)
    return PointSearch(points, target, allowed, aim, method.max_steps)


class Together(NamedTuple):
    """Two shapes in common coordinates: nets, sides of polynomials, or corners of triangles and points.

    Args:
        a: the first shape.
        b: the second shape.
        frame: leads back to the user's coordinates.
        moved: bound on the error of the coordinates of both.
    """

    a: Any
    b: Any
    frame: Frame
    moved: float


def _farthest(a: Any, b: Any, method: BranchAndBound, aim: Aim) -> FarthestSearch:
    pair = together(a, b)
    source, floor = _source(a, pair.a)
    target, size = target_in(b, pair.b)
    frame, moved = pair.frame, pair.moved
    dtype = np.asarray(frame.center).dtype
    floor = (floor + 16 * gamma(64, dtype)) * (1 + size) + 8 * moved
    atol = float(default_tolerance(float(frame.common(np.asarray(diagonal_of(a, b)))), dtype, 0.0))
    atol = atol if method.atol is None else float(frame.common(np.asarray(method.atol)))
    given = method.atol is not None
    allowed = AllowedGap(atol, float(method.rtol), lambda lower: floor + target.rounding(lower), given)
    followed = _followed(a, b, pair, target)
    return FarthestSearch(source, target, frame, moved, allowed, aim, method.max_steps, *followed)


def _followed(
    a: Any, b: Any, pair: Together, target: AbstractTarget
) -> tuple[About, FollowedFeet | None, FollowedGraphs | FollowedOnSurface | None]:
    """Return objects that follow feet: of a point, and over cells of pieces and of graphs (both may be None)."""
    first, second = _pieces(a, pair.a), _pieces(b, pair.b)
    feet_on = pair.b if isinstance(pair.b, Side) else None if second is None else padded_pieces(second)
    if first is None:
        graphs = None if second is None else FollowedGraphs(pair.a, second, target)
        return partial(places_on_graphs, pair.a, feet_on), None, graphs
    followed = None if second is None else FollowedFeet(first, second, target)
    first = padded_pieces(first)
    graphs = FollowedOnSurface(first, feet_on) if isinstance(first, Net) and isinstance(feet_on, Side) else None
    return partial(place_of, (first, feet_on)), followed, graphs


def heights_of(a: Any, b: Any, pair: Together, target: AbstractTarget) -> CellHeights | None:
    """Return bounds over cells of a by heights above b, or None if neither shape is curved."""
    first, second = _pieces(a, pair.a), _pieces(b, pair.b)
    curved = isinstance(first, Net) or isinstance(second, Net)
    return None if first is None or second is None or not curved else CellHeights(first, second, target)


def _pieces(shape: Any, moved: Any) -> Net | Triangles | None:
    if isinstance(shape, TriangleMesh):
        return Triangles(moved[np.asarray(shape.triangles)])
    return moved if isinstance(moved, Net) else None


def together(a: Any, b: Any) -> Together:
    """Return both shapes in common coordinates; with an implicit surface only points and vertices are rounded."""
    if not any(isinstance(x, ImplicitSurface) for x in (a, b)):
        p, q, frame, moved = prepare_nets(_net(a), _net(b))
        return Together(_common(a, p, frame), _common(b, q, frame), frame, moved)
    # Points so far away that their squares overflow next to the surface share its coordinates; it may vanish there.
    p, q, frame = prepare_surfaces(*(_net(x) for x in ((a, a) if is_points(b) else (a, b))))
    rows = [np.asarray(x.control_points) for x in (a, b) if is_points(x)]
    if rows and np.max(np.abs(common_points(frame, rows[0]))) > _FAR[rows[0].dtype.itemsize]:
        p, q, frame = prepare_surfaces(_net(a), _net(b))
    p, q = _common(a, p, frame), _common(b, q, frame)
    moved = max(
        (gamma(4, x.dtype) * 2 * float(np.max(np.abs(x))) for x in (p, q) if isinstance(x, np.ndarray)), default=0
    )
    return Together(p, q, frame, float(moved))


def _net(shape: Any) -> Any:
    """Return the shape that sets the frame: an implicit surface itself, boxes of points and meshes, else nets."""
    if isinstance(shape, ImplicitSurface):
        return shape
    if isinstance(shape, TriangleMesh):
        return hull_of(shape.vertices)
    return hull_of(shape.control_points) if is_points(shape) else net_of(shape)


def _common(shape: Any, moved: Any, frame: Frame) -> Any:
    """Return a shape in common coordinates: `moved` by the frame, or the moved points of a mesh or point set."""
    if isinstance(shape, TriangleMesh):
        return common_points(frame, np.asarray(shape.vertices))
    if is_points(shape):
        rows = np.asarray(shape.control_points)[:, 0]
        return common_points(frame, rows).astype(rows.dtype)
    if isinstance(shape, ImplicitSurface):
        return moved
    return Net(moved.points[: shape.count], None if moved.weights is None else moved.weights[: shape.count])


def _source(shape: Any, moved: Any) -> tuple[AbstractSource, float]:
    """Return a shape in common coordinates as a source, and the rounding error of its bounds."""
    if isinstance(moved, Side):
        return SurfaceSource(_known(moved)), _ULPS * float(np.finfo(np.asarray(moved.lower).dtype).eps)
    if isinstance(moved, Net):
        net = repeated(moved)
        return NetSource(net, shape.count), 16 * (point_error(net) + 2 * eta(net))
    return MeshSource(moved[np.asarray(shape.triangles)]), 0.0


def target_in(shape: Any, moved: Any) -> tuple[AbstractTarget, float]:
    """Return a shape in common coordinates as a target, and its largest coordinate."""
    if isinstance(moved, Side):
        return prepared(moved)._part(SurfaceTarget), 1.0
    if isinstance(moved, Net):
        return prepared(moved)._part(NetTarget), 1.0
    if isinstance(shape, TriangleMesh):
        return MeshTarget(TriangleMesh(moved, shape.triangles)), 1.0
    return PointTarget(BezierSegments(moved[:, None])), float(np.max(np.abs(moved)))


def _known(side: Side) -> Any:
    target, empty = looked_at(side)
    if bool(empty):
        raise empty_surface()
    return target


def dtype_of(shape: Any) -> np.dtype:
    """Return the type of a shape's real numbers."""
    types = [x.dtype for x in jax.tree_util.tree_leaves(shape) if jnp.issubdtype(x.dtype, jnp.floating)]
    return np.dtype(types[0])


def diagonal_of(*shapes: Any) -> float:
    """Return the length of the diagonal of the box of all shapes."""
    ends = [[np.asarray(end, np.float64) for end in _box(shape)] for shape in shapes]
    return float(diagonal([(low, high) for low, high in ends]))


def _box(shape: Any) -> tuple[Any, Any]:
    if isinstance(shape, TriangleMesh):
        return extremes(np.asarray(shape.vertices)[np.asarray(shape.triangles)])
    return shape.bounds


def _form(a: Any, b: Any) -> AnswerForm:
    """Return shapes and types of every answer about two shapes."""
    places: dict[type, tuple[int, ...]] = {TriangleMesh: (3,), BezierPatches: (2,)}
    t, params = places.get(type(a), ()), places.get(type(b), ())
    feet = 2 if is_points(a) and is_points(b) else FEET
    counts = _POINT_COUNTS if is_points(a) else farthest_place.COUNTS
    return AnswerForm(dtype_of(a), a.dim, feet, t, params, counts)


class _Farthest(NamedTuple):
    index: int
    foot: ProvenFeet  # one row
    lower: float


class _PointSearchState(NamedTuple):
    order: np.ndarray  # points from the farthest to the nearest, by their bounds
    bounds: np.ndarray
    measured: int
    settled: float  # largest upper bound of the measured points
    best: _Farthest | None
    steps: int


class PointSearch(AbstractSearch):
    """The search over points; its state holds the points in the order of their upper bounds.

    Args:
        points: (points, dim), known and finite.
        target: the shape that distances are taken to.
        allowed: the gap that may stay at a lower bound.
        aim: range of distances that matter.
        max_steps: most steps.
    """

    first_steps = _FIRST_STEPS

    def __init__(self, points: np.ndarray, target: AbstractTarget, allowed: AllowedGap, aim: Aim, max_steps: int):
        self._points, self._target, self._allowed = points, target, allowed
        self._level, self._ceiling, self.max_steps = float(aim.level), float(aim.ceiling), max_steps

    @override
    def begin(self) -> _PointSearchState:
        upper = self._target.feet(self._points)
        order = np.argsort(-upper, kind="stable")
        return _PointSearchState(order, upper[order], 0, -np.inf, None, 0)

    @override
    def advance(self, state: _PointSearchState, limit: int, growing: bool) -> tuple[_PointSearchState, Standing]:
        while self._going(state) and state.steps < limit:
            state = self._step(state)
        # Some point is always measured: the witness is the farthest measured point.
        state = self._step(state) if state.best is None else state
        going = self._going(state)
        return state, Standing(self._solution(state), going, False, state.steps, len(state.order) - state.measured)

    @override
    def longer(self, state: _PointSearchState) -> _PointSearchState:
        """Return the state unchanged: it is never full."""
        return state

    def _next(self, state: _PointSearchState) -> float:
        return float(state.bounds[state.measured]) if state.measured < len(state.bounds) else -np.inf

    def _going(self, state: _PointSearchState) -> bool:
        if state.best is None:
            return True
        lower = state.best.lower
        after = self._next(state)
        # Without a proven point of the target no bound can get finite.
        beyond = after > max(lower + self._allowed(lower), self._level)
        return bool(np.isfinite(after)) and beyond and lower <= self._ceiling

    def _step(self, state: _PointSearchState) -> _PointSearchState:
        size = min(_FIRST << min(state.steps, 20), self._target.block)
        rows = state.order[state.measured : state.measured + size]
        best = state.best
        enough = self._level if best is None else max(best.lower, self._level)
        found = self._target.nearest(self._points[rows], enough)
        top = int(np.argmax(found.lower))
        if best is None or found.lower[top] > best.lower:
            foot = taken(found, slice(top, top + 1))
            best = _Farthest(int(rows[top]), foot, float(found.lower[top]))
        settled = max(state.settled, float(np.max(found.upper)))
        return state._replace(measured=state.measured + len(rows), settled=settled, best=best, steps=state.steps + 1)

    def _solution(self, state: _PointSearchState) -> HausdorffSolution:
        best: Any = state.best  # some point is measured by now
        upper = max(state.settled, self._next(state), best.lower)
        closed = upper - max(best.lower, self._level) <= self._allowed.asked(best.lower) or best.lower > self._ceiling
        result = RESULTS.successful if closed else RESULTS.gap_not_closed
        counts = state.steps, len(state.order), state.measured
        dtype, foot, rows = self._points.dtype, best.foot, self._target.feet_named
        distance = foot.distance[0] if best.lower > 0 else 0.0
        witness = Witness(
            element=jnp.asarray(best.index),
            t=jnp.zeros((), dtype),
            point=jnp.asarray(self._points[best.index]),
            feet=jnp.asarray(np.repeat(foot.foot, rows, axis=0)),
            feet_elements=jnp.asarray(np.repeat(foot.segment.astype(int), rows)),
            feet_params=jnp.asarray(np.repeat(foot.t, rows, axis=0)),
            multipliers=jnp.asarray(np.eye(rows)[0], dtype),
            event=EVENTS.a_end if distance > 0 else EVENTS.coincident,
            direction=DIRECTIONS.a_to_b,
        )
        return HausdorffSolution(
            value=jnp.asarray(np.clip(distance, best.lower, upper), dtype),
            lower=jnp.asarray(best.lower, dtype),
            upper=jnp.asarray(upper, dtype),
            witness=witness,
            result=RESULTS.existence_not_certified if np.isinf(upper) else result,
            stats={name: jnp.asarray(count) for name, count in zip(_POINT_COUNTS, counts, strict=True)},
        )
