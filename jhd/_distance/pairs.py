"""Pairs of shapes of one kind, or of points and any kind: checked, prepared, measured in either direction, reported.

All kinds of pairs offer a few common operations, so that the entry points need not know the kinds. A pair measures in
the coordinates of its search. Bounds passed from one direction to the other stay in these coordinates.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._distance.cells.surfaces import FEET
from jhd._distance.normalization.coordinates import Frame, reported
from jhd._distance.normalization.curves import prepare
from jhd._distance.normalization.directions import TracedSearch, in_turn, larger, larger_of_forms, scanned
from jhd._distance.normalization.host_callback import AnswerForm, by_kept_program, from_program
from jhd._distance.normalization.method import (
    AbstractCurveMethod,
    AbstractHausdorffMethod,
    AbstractHostMethod,
    check_serves,
)
from jhd._distance.normalization.stopping import Aim, aim_at
from jhd._distance.normalization.surfaces import Side, prepare_surfaces
from jhd._distance.published.algebraic import AlgebraicEvents
from jhd._distance.published.cube_intervals import CubeIntervals, larger_interval
from jhd._distance.published.trimming import BiarcTrimming
from jhd._distance.published.two_step import TwoStep
from jhd._distance.search.bodies import body_of
from jhd._distance.search.body import dtype_of
from jhd._distance.search.branch_and_bound import BranchAndBound, default_method, length_of_table, wanted_of
from jhd._distance.search.candidates import Target
from jhd._distance.search.farthest import CurveSearch, SurfaceSearch
from jhd._distance.search.meshes import mesh_directed
from jhd._distance.search.search import Listener, Standing, drive
from jhd._distance.search.solutions import CoveredPair, target
from jhd._distance.search.surface_source import looked_at
from jhd._distance.witness.derivative import WitnessState, state_of, with_derivatives
from jhd._distance.witness.mixed_derivatives import with_place_derivatives
from jhd._results.solution import DIRECTIONS, RESULTS, HausdorffSolution, in_direction, on_device
from jhd._runtime.arrays import is_traced, is_tracing, taken, undifferentiated
from jhd._runtime.compiled import compiled
from jhd._shapes.as_shape import check_shape, taken_as
from jhd._shapes.checks import check_same_dim, empty_surface
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.prepared import working
from jhd.progress import Callback

Report = Callback | None


class AbstractPair(ABC):
    """Two checked shapes and the method for them."""

    # Leads from the coordinates of the search to the user's; None if they are equal.
    _frame: Any = None

    def __init__(self) -> None:
        # The second result of a traced search (see `in_turn`), by whether it was from b to a.
        self._told: dict[bool, Any] = {}

    def length(self, value: Array, toward: float | None = None) -> Any:
        """Return a length in the coordinates of the search."""
        return value if self._frame is None else self._frame.common(value, toward)

    @abstractmethod
    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        """The distance in one direction, in the coordinates of the search.

        Args:
            turned: from b to a instead of from a to b.
            level: distances up to this length do not matter; None if all matter.
            ceiling: the search may stop above this length.
        """

    def both(self, level: Any = None, ceiling: Any = None) -> tuple[HausdorffSolution, HausdorffSolution]:
        """Measure both directions, the second one only above the lower bound of the first.

        If this bound is above the ceiling, nothing matters of the second direction. A traced search with a level and a
        ceiling measures both directions alike.
        """
        search = self.traced_search(level, ceiling)
        if search is not None:
            (there, self._told[False]), (back, self._told[True]) = in_turn(search, level, ceiling)
            return there, back
        there = self.measured(level=level, ceiling=ceiling)
        xp = jnp if is_tracing(there.lower, level, ceiling) else np
        rest = there.lower if level is None else xp.maximum(level, there.lower)
        if ceiling is not None:
            ceiling = xp.where(there.lower > ceiling, -xp.ones_like(ceiling), ceiling)
        return there, self.measured(turned=True, level=rest, ceiling=ceiling)

    def traced_search(self, *numbers: Any) -> TracedSearch | None:
        """Return a search for traced shapes or numbers, with arguments of one form for both directions.

        Return None if each direction is measured separately.
        """
        return None

    def reported(self, solution: HausdorffSolution) -> HausdorffSolution:
        """Return the solution in the unit of the shapes, on the device."""
        return on_device(solution) if self._frame is None else reported(self._frame, solution)

    def differentiable(self, solution: HausdorffSolution) -> HausdorffSolution:
        """Return a reported solution with a value differentiable in both shapes."""
        return solution

    def larger(self, there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
        """Return the Hausdorff distance from both reported directions, differentiable in both shapes."""
        return larger(self.differentiable(there), self.differentiable(back))

    def finished(self, solution: HausdorffSolution) -> HausdorffSolution:
        """Return a measured solution in the form returned to the user."""
        return self.differentiable(self.reported(solution))


def pair_of(a: Any, b: Any, method: AbstractHausdorffMethod | None, progress: Report) -> AbstractPair:
    """Return the pair of two shapes under a method; by default BranchAndBound().

    Raises:
        TypeError: shapes of different or unknown kinds, or a method that does not serve them.
        ValueError: curves of different dimensions, or a surface proven empty in its box.
    """
    method = default_method() if method is None else method
    a, b = taken_as("a", a), taken_as("b", b)
    for name, shape in (("a", a), ("b", b)):
        check_shape(name, shape)
    check_serves(method, a, b, METHODS)
    return _pair_for(a, b, method)(a, b, method, progress)


class CurvePair(AbstractPair):
    """Two curves in common coordinates, undifferentiated."""

    def __init__(self, a: Any, b: Any, method: Any, progress: Report):
        super().__init__()
        self._method = method
        self._given = working(a), working(b)
        p, q = self._given
        check_same_dim(p.dim, q.dim)
        # The two-step method takes fewer samples of a segment if there are more segments.
        sharing = isinstance(method, BranchAndBound)
        self._a, self._b, self._frame = prepare(*undifferentiated(self._given), sharing=sharing)
        self._listener = Listener(progress, self._frame)

    @override
    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        a, b = (self._b, self._a) if turned else (self._a, self._b)
        aim = aim_at(level, ceiling, self._a.control_points.dtype)
        method, direction = self._method, _direction(turned)
        # Inside jit all operations are traced, also on known numbers.
        if is_tracing(a, b, method, aim):
            found = by_kept_program(_curve, self._answers(), ((method, self._frame), (a, b), aim))
            solution, self._told[turned] = found
            return in_direction(solution, direction)
        if isinstance(method, BranchAndBound):
            wanted = wanted_of(method, self._frame, aim)
            search = CurveSearch(a, b, wanted, direction, length_of_table(method, a), method.max_steps)
            return drive(search, self._listener, direction)
        run = method._directed if isinstance(method, AbstractHostMethod) else partial(_in_one_go, method)
        solution = in_direction(run(a, b, self._frame, aim), direction)
        self._listener.report(direction, Standing(solution, False, False, 0, 0))
        return solution

    @override
    def traced_search(self, *numbers: Any) -> TracedSearch | None:
        a, b, method, frame = self._a, self._b, self._method, self._frame
        alike = a.control_points.shape == b.control_points.shape
        if not (alike and is_tracing(a, b, method, numbers)):
            return None
        return TracedSearch(_curves, (method, frame), (a, b), (b, a), self._answers(2))

    def _answers(self, *batch: int) -> Any:
        """Return shapes and types of answers of the default method; None for other methods, which are traced."""
        if not isinstance(self._method, BranchAndBound):
            return None
        dtype, dim = self._a.control_points.dtype, self._a.dim
        return AnswerForm(dtype, dim, 2, (), (), ("steps", "cells")).like(*batch), WitnessState.like(dtype, dim, *batch)

    @override
    def differentiable(self, solution: HausdorffSolution) -> HausdorffSolution:
        return with_derivatives(solution, *self._given, self._frame, self._told)

    @override
    def larger(self, there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
        return self.differentiable(larger(there, back))


class SurfacePair(AbstractPair):
    """Two implicit surfaces in common coordinates, undifferentiated."""

    def __init__(self, a: Any, b: Any, method: Any, progress: Report):
        super().__init__()
        self._method, self._given = method, (a, b)
        self._pair, self._frame = _covered(*self._given)
        self._listener = Listener(progress, self._frame)

    @override
    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        pair = self._pair.turned() if turned else self._pair
        aim, method, direction = aim_at(level, ceiling, self._frame.center.dtype), self._method, _direction(turned)
        if is_tracing(pair, method, aim):
            found, _ = by_kept_program(_surface, self._answers(), ((method, self._frame), pair, aim))
            return in_direction(found, direction)
        wanted, capacity = wanted_of(method, self._frame, aim), length_of_table(method, pair.a)
        return drive(SurfaceSearch(pair, wanted, direction, capacity, method.max_steps), self._listener, direction)

    @override
    def traced_search(self, *numbers: Any) -> TracedSearch | None:
        there, back, method, frame = self._pair, self._pair.turned(), self._method, self._frame
        if not is_tracing(there, method, numbers):
            return None
        return TracedSearch(_surfaces, (method, frame), there, back, self._answers(2))

    def _answers(self, *batch: int) -> Any:
        counts = "steps", "cells", "waiting", "measured"
        return AnswerForm(self._frame.center.dtype, 3, FEET, (), (), counts).like(*batch), ()

    @override
    def differentiable(self, solution: HausdorffSolution) -> HausdorffSolution:
        return with_place_derivatives(solution, *self._given)


class MixedPair(AbstractPair):
    """Two shapes of any kinds, in their own coordinates; a measured distance has its derivatives already."""

    def __init__(self, a: Any, b: Any, method: Any, progress: Report):
        super().__init__()
        self._method, self._listener = method, Listener(progress)
        self._given = tuple(working(shape) for shape in (a, b))
        p, q = self._given
        check_same_dim(p.dim, q.dim)

    @override
    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        a, b = self._given[::-1] if turned else self._given
        aim = undifferentiated(aim_at(level, ceiling, dtype_of(a)))
        direction = _direction(turned)
        return in_direction(_mixed_directed(a, b, self._method, aim, self._listener, direction), direction)

    @override
    def larger(self, there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
        return larger_of_forms(there, back)


class CubePair(AbstractPair):
    """Two implicit surfaces as the cells of CubeIntervals, in their own coordinates."""

    def __init__(self, a: Any, b: Any, method: Any, progress: Report):
        super().__init__()
        self._method = method
        self._first, self._second, self._scale = method._cells(a, b, progress)

    @override
    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        """Measure the direction completely: level and ceiling are ignored."""
        cells = (self._second, self._first) if turned else (self._first, self._second)
        return self._method._measured(*cells, self._scale, _direction(turned))

    @override
    def larger(self, there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
        return larger_interval(there, back)


# Methods that serve some pair, in the order in which messages name them.
METHODS = BranchAndBound, TwoStep, BiarcTrimming, AlgebraicEvents, CubeIntervals
# Two shapes of one of these kinds have an engine of their own; all others are mixed.
_ENGINES: tuple[tuple[type, Callable[..., AbstractPair]], ...] = (
    (AbstractCurve, CurvePair),
    (ImplicitSurface, SurfacePair),
)


def _pair_for(a: Any, b: Any, method: Any) -> Callable[..., AbstractPair]:
    """Return the class of pairs that measures two shapes under a method that serves them."""
    if isinstance(method, CubeIntervals):
        return CubePair
    # Known points among themselves are searched by trees; traced points as curves in one compiled function.
    if body_of(a).dimension == body_of(b).dimension == 0 and isinstance(method, BranchAndBound):
        return CurvePair if is_tracing(undifferentiated((a, b)), method) else MixedPair
    return next((pair for kind, pair in _ENGINES if isinstance(a, kind) and isinstance(b, kind)), MixedPair)


def _mixed_directed(
    a: Any, b: Any, method: BranchAndBound, aim: Aim, listener: Listener, direction: Any
) -> HausdorffSolution:
    """The directed distance of two shapes of any kinds, in their own coordinates, differentiable in both, twice."""
    meshes = body_of(a).meshes_with(body_of(b))
    if meshes is not None:
        found = mesh_directed(*undifferentiated(meshes), method, aim, listener, direction)
        return with_place_derivatives(found, *meshes)
    found = _directed(*undifferentiated((a, b)), method, aim, listener, direction)
    return with_place_derivatives(found, a, b)


def _directed(
    a: Any, b: Any, method: BranchAndBound, aim: Aim, listener: Listener, direction: Any
) -> HausdorffSolution:
    # Inside jit all operations are traced, also on known numbers.
    if not is_tracing(a, b, method, aim):
        return drive(body_of(a).search(body_of(b), method, aim), listener, direction)
    refused = body_of(a).form(body_of(b)).refused

    def search(shapes: Any, method: BranchAndBound, aim: Aim) -> HausdorffSolution:
        first, second = map(body_of, shapes)
        if not (first.is_usable() and second.is_usable()):
            return refused()
        try:
            return drive(first.search(second, method, aim), Listener(), direction)
        except ValueError:
            return refused(RESULTS.empty_surface)

    return from_program(search, refused, (a, b), method, aim)


@compiled
def _in_one_go(
    method: AbstractCurveMethod, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim
) -> HausdorffSolution:
    return method._directed(a, b, frame, aim)


def _curve(common: Any, pair: Any, aim: Aim) -> tuple[HausdorffSolution, WitnessState]:
    method, frame = common
    found = method._directed(*pair, frame, aim)
    return found, state_of(found.witness, *pair)


def _curves(common: Any, given: Any, aim: Aim, rising: Array) -> tuple[HausdorffSolution, WitnessState]:
    return scanned(_curve, common, given, aim, rising)


def _surface(common: Any, pair: Any, aim: Aim) -> tuple[HausdorffSolution, tuple]:
    method, frame = common
    return method._directed_surfaces(pair, frame, aim, _direction(False)), ()


def _surfaces(common: Any, given: Any, aim: Aim, rising: Array) -> tuple[HausdorffSolution, tuple]:
    return scanned(_surface, common, given, aim, rising)


def _direction(turned: bool) -> Any:
    return DIRECTIONS.b_to_a if turned else DIRECTIONS.a_to_b


def _covered(a: ImplicitSurface, b: ImplicitSurface) -> tuple[CoveredPair, Frame]:
    """Return both surfaces in common coordinates, undifferentiated, and the frame that leads back."""
    p, q, frame = prepare_surfaces(*undifferentiated((a, b)))
    (first, empty_a), (second, empty_b) = _looked_at(p, q)
    for name, empty in (("a", empty_a), ("b", empty_b)):
        if not is_traced(empty) and bool(empty):
            raise empty_surface(name)
    return CoveredPair(first, second, empty_a | empty_b), frame


def _looked_at(p: Side, q: Side) -> list[tuple[Target, Any]]:
    """Return both surfaces as targets of a search, and whether each is proven to have no point."""
    if not is_tracing(p, q):
        return [looked_at(p), looked_at(q)]
    found = jax.lax.map(target, jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), p, q))
    return [taken(found, i) for i in range(2)]
