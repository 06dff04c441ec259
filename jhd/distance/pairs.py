"""Pairs of shapes of one kind: checked, prepared for a search, measured in either direction, and reported.

Each kind of pair answers the same few questions, so that the entries need not know of kinds. A pair measures in the
coordinates of its search; bounds handed from one direction to the other stay in them.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arrays import is_traced
from jhd.compiled import compiled
from jhd.distance.frame.method import AbstractHausdorffMethod, AbstractHostMethod, Aim
from jhd.distance.frame.prepare import Frame, prepare
from jhd.distance.frame.surfaces import Side, prepare_surfaces
from jhd.distance.published.cube_intervals import CubeIntervals
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.candidates import Target
from jhd.distance.search.farthest import CurveSearch, SurfaceSearch
from jhd.distance.search.meshes import mesh_directed
from jhd.distance.search.search import Session, Standing, drive
from jhd.distance.search.solutions import Pair, target
from jhd.distance.witness.derivative import with_derivatives
from jhd.distance.witness.surfaces import with_surface_derivatives
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.shapes.implicit import ImplicitSurface, check_surface
from jhd.shapes.mesh import TriangleMesh, check_mesh
from jhd.solution import DIRECTIONS, HausdorffSolution, name_of

Shape = AbstractCurve | ImplicitSurface | TriangleMesh
Report = Callable[[Any], object] | None


class AbstractPair(ABC):
    """Two checked shapes and the method for them."""

    @abstractmethod
    def length(self, value: Array) -> Any:
        """A length in the coordinates of the search."""

    @abstractmethod
    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        """The distance in one direction, in the coordinates of the search.

        Args:
            turned: from b to a instead of from a to b.
            level: nothing up to this length matters; None where everything does.
            ceiling: nothing more matters above this length.
        """

    @abstractmethod
    def reported(self, solution: HausdorffSolution) -> HausdorffSolution:
        """The solution in the unit of the shapes."""

    @abstractmethod
    def differentiable(self, solution: HausdorffSolution) -> HausdorffSolution:
        """The reported solution, its value with derivatives in both shapes."""


def pair_of(
    a: Shape, b: Shape, method: AbstractHausdorffMethod | CubeIntervals | None, progress: Report
) -> AbstractPair:
    """The pair of two shapes under a method that proves both bounds by a search.

    Raises:
        TypeError: shapes of different or unknown kinds, or a method that does not serve them.
        ValueError: curves of different dimensions, or a surface proven empty in its box.
    """
    method = BranchAndBound() if method is None else method
    if isinstance(a, TriangleMesh) or isinstance(b, TriangleMesh):
        return MeshPair(a, b, method, progress)
    if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        return SurfacePair(a, b, method, progress)
    return CurvePair(a, b, method, progress)


class CurvePair(AbstractPair):
    """Two curves in common coordinates, where nothing is differentiated."""

    def __init__(self, a: Any, b: Any, method: object, progress: Report):
        check_curve("a", a)
        check_curve("b", b)
        if not isinstance(method, AbstractHausdorffMethod):
            known = "BranchAndBound(), TwoStep(), BiarcTrimming() or AlgebraicEvents()"
            raise TypeError(f"method must be {known}; got {type(method).__name__}.")
        self._method = method
        self._given = a.segments(), b.segments()
        p, q = self._given
        if p.dim != q.dim:
            raise ValueError(f"a has {p.dim} coordinates a point and b has {q.dim}; needs the same.")
        # The two-step method takes fewer samples of a segment where there are more of them.
        sharing = isinstance(method, BranchAndBound)
        self._a, self._b, self._frame = prepare(*jax.lax.stop_gradient(self._given), sharing=sharing)
        self._session = Session(progress, self._frame.length)

    def length(self, value: Array) -> Any:
        """See AbstractPair."""
        return self._frame.common(value)

    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        """See AbstractPair."""
        a, b = (self._b, self._a) if turned else (self._a, self._b)
        aim, method = _aim(level, ceiling, self._a.control_points.dtype), self._method
        # Inside jit all operations are traced, those on known numbers too.
        if is_traced(a, b, method, aim, jnp.zeros(())):
            return method.directed(a, b, self._frame, aim)
        if isinstance(method, BranchAndBound):
            wanted = method.wanted(a, self._frame, aim)
            search = CurveSearch(a, b, wanted, method.length_of_table(a), method.max_steps)
            return drive(search, self._session, _direction(turned))
        run = method.directed if isinstance(method, AbstractHostMethod) else partial(_in_one_go, method)
        solution = run(a, b, self._frame, aim)
        self._session.report(_direction(turned), Standing(solution, False, False, 0, 0))
        return solution

    def reported(self, solution: HausdorffSolution) -> HausdorffSolution:
        """See AbstractPair."""
        return self._frame.solution(solution)

    def differentiable(self, solution: HausdorffSolution) -> HausdorffSolution:
        """See AbstractPair."""
        return with_derivatives(self.reported(solution), *self._given, self._frame)


class SurfacePair(AbstractPair):
    """Two implicit surfaces in common coordinates, where nothing is differentiated."""

    def __init__(self, a: Any, b: Any, method: object, progress: Report):
        if not isinstance(method, BranchAndBound):
            known = "BranchAndBound() or CubeIntervals()"
            raise TypeError(f"method must be {known} for implicit surfaces; got {type(method).__name__}.")
        self._method, self._given = method, surfaces_of(a, b)
        self._targets, self._frame = _targets(*self._given)
        self._session = Session(progress, self._frame.length)

    def length(self, value: Array) -> Any:
        """See AbstractPair."""
        return self._frame.common(value)

    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        """See AbstractPair."""
        pair = self._targets.turned() if turned else self._targets.pair()
        aim, method, direction = _aim(level, ceiling, self._frame.centre.dtype), self._method, _direction(turned)
        if is_traced(pair, method, aim, jnp.zeros(())):
            return method.directed_surfaces(pair, self._frame, aim, direction)
        wanted, capacity = method.wanted(pair.a, self._frame, aim), method.length_of_table(pair.a)
        return drive(SurfaceSearch(pair, wanted, direction, capacity, method.max_steps), self._session, direction)

    def reported(self, solution: HausdorffSolution) -> HausdorffSolution:
        """See AbstractPair."""
        return self._frame.solution(solution)

    def differentiable(self, solution: HausdorffSolution) -> HausdorffSolution:
        """See AbstractPair."""
        return with_surface_derivatives(self.reported(solution), *self._given)


class MeshPair(AbstractPair):
    """Two meshes, in their own coordinates; a measured distance has its derivatives already."""

    def __init__(self, a: Any, b: Any, method: object, progress: Report):
        if not isinstance(method, BranchAndBound):
            raise TypeError(f"method must be BranchAndBound() for meshes; got {type(method).__name__}.")
        check_mesh("a", a)
        check_mesh("b", b)
        self._method, self._meshes, self._progress = method, (a, b), progress

    def length(self, value: Array) -> Any:
        """See AbstractPair."""
        return value

    def measured(self, turned: bool = False, level: Any = None, ceiling: Any = None) -> HausdorffSolution:
        """See AbstractPair."""
        a, b = self._meshes[::-1] if turned else self._meshes
        low = -np.inf if level is None else _known(level)
        high = np.inf if ceiling is None else _known(ceiling)
        return mesh_directed(a, b, self._method, low, high, self._progress, name_of(_direction(turned)))

    def reported(self, solution: HausdorffSolution) -> HausdorffSolution:
        """See AbstractPair."""
        return solution

    def differentiable(self, solution: HausdorffSolution) -> HausdorffSolution:
        """See AbstractPair."""
        return solution


@compiled
def _in_one_go(
    method: AbstractHausdorffMethod, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim
) -> HausdorffSolution:
    return method.directed(a, b, frame, aim)


def surfaces_of(a: Any, b: Any) -> tuple[ImplicitSurface, ImplicitSurface]:
    """Both shapes, which must be implicit surfaces; TypeError where one is not."""
    check_surface("a", a)
    check_surface("b", b)
    return a, b


def _direction(turned: bool) -> Any:
    return DIRECTIONS.b_to_a if turned else DIRECTIONS.a_to_b


def _aim(level: Any, ceiling: Any, dtype: np.dtype) -> Aim:
    infinity = np.asarray(np.inf, dtype)
    return Aim(-infinity if level is None else level, infinity if ceiling is None else ceiling)


def _known(bound: Any) -> float:
    return float(jax.lax.stop_gradient(bound))


class _Targets(NamedTuple):
    """Both surfaces with what searches start from, and which of them are proven to have no point."""

    a: Target
    b: Target
    empty_a: Array
    empty_b: Array

    def pair(self) -> Pair:
        """The direction from a to b."""
        return Pair(self.a, self.b, self.empty_a | self.empty_b)

    def turned(self) -> Pair:
        """The direction from b to a."""
        return Pair(self.b, self.a, self.empty_a | self.empty_b)


def _targets(a: ImplicitSurface, b: ImplicitSurface) -> tuple[_Targets, Frame]:
    """Both surfaces in common coordinates, where nothing is differentiated, and the way back."""
    p, q, frame = prepare_surfaces(*jax.lax.stop_gradient((a, b)))
    targets = _looked_at(p, q)
    for name, empty in (("a", targets.empty_a), ("b", targets.empty_b)):
        if not is_traced(empty) and bool(empty):
            raise ValueError(f"{name}: the surface is empty: the polynomial is proven to have no zero in the box.")
    return targets, frame


@compiled
def _looked_at(p: Side, q: Side) -> _Targets:
    # One after the other in one program for both.
    sides = jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), p, q)
    (a, b), (empty_a, empty_b) = (
        [jax.tree_util.tree_map(lambda x, i=i: x[i], part) for i in range(2)] for part in jax.lax.map(target, sides)
    )
    return _Targets(a, b, empty_a, empty_b)
