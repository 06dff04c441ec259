"""The entries: directed and two-sided Hausdorff distances of two shapes."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arrays import is_traced, real_array
from jhd.compiled import compiled
from jhd.distance.branch_and_bound import BranchAndBound
from jhd.distance.cube_intervals import CubeIntervals
from jhd.distance.derivative import with_derivatives
from jhd.distance.driver import Host, Progress
from jhd.distance.mesh_search import mesh_directed
from jhd.distance.method import AbstractHausdorffMethod, Aim
from jhd.distance.prepare import Frame, prepare
from jhd.distance.surface_candidates import Target
from jhd.distance.surface_derivative import with_surface_derivatives
from jhd.distance.surface_prepare import Side, prepare_surfaces
from jhd.distance.surface_solution import Pair, target
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.shapes.implicit import ImplicitSurface, check_surface
from jhd.shapes.mesh import TriangleMesh, check_mesh
from jhd.solution import (
    ANSWERS,
    DIRECTIONS,
    RESULTS,
    Decision,
    HausdorffSolution,
    result_where,
    throw_unless_successful,
)

Shape = AbstractCurve | ImplicitSurface | TriangleMesh


def directed_hausdorff(
    a: Shape,
    b: Shape,
    method: AbstractHausdorffMethod | None = None,
    *,
    throw: bool = True,
    progress: Callable[[Any], object] | None = None,
) -> HausdorffSolution:
    """Directed Hausdorff distance: the maximum over a of the minimum over b of the distance.

    The distance is that of the stored numbers (Bezier segments, coefficients, triangles) taken as real. Works under jit
    and vmap, where checks of values are left out and `throw` is ignored: read `result`. Meshes must be known numbers;
    the value is differentiable in their vertices, too.

    Args:
        a: the shape whose farthest point is looked for: a curve, an implicit surface or a mesh.
        b: the shape that distances are taken to, of the same kind and dimension.
        method: how; by default BranchAndBound(). CubeIntervals() serves surfaces, not under jit.
        throw: whether to raise where the method did not reach what it promises.
        progress: called with a Progress now and then while the search lasts (by CubeIntervals with a VoxelProgress);
            not under jit. Ctrl-C ends the search with the bounds reached, as RESULTS.interrupted.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: a shape or a method of another kind.
        ValueError: curves of different dimensions, or a surface proven empty in its box.
        NotProvenError: the method failed or was interrupted and throw is True; it carries the solution.
    """
    if isinstance(a, TriangleMesh) or isinstance(b, TriangleMesh):
        method, meshes = _of_meshes(method, a, b)
        return _finish(mesh_directed(*meshes, method, progress=progress), throw)
    if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        method, surfaces = _of_surfaces(method, a, b)
        if isinstance(method, CubeIntervals):
            return _finish(method.directed_surfaces(*surfaces, progress=progress), throw and method.rule != "paper")
        targets, frame = _targets(*surfaces)
        there = Host(frame, progress).run_surfaces(method, targets.pair(), _plain(frame), DIRECTIONS.a_to_b)
        return _finish(with_surface_derivatives(frame.solution(there), *surfaces), throw)
    method, curves, (p, q, frame) = _prepared(a, b, method)
    there = Host(frame, progress).run(method, p, q, _everything(p), DIRECTIONS.a_to_b)
    return _finish(with_derivatives(frame.solution(there), *curves, frame), throw)


def hausdorff(
    a: Shape,
    b: Shape,
    method: AbstractHausdorffMethod | None = None,
    *,
    throw: bool = True,
    progress: Callable[[Any], object] | None = None,
) -> HausdorffSolution:
    """Hausdorff distance: the larger of both directed distances; the witness's `direction` says which, a_to_b at a tie.

    Args:
        a: a curve, an implicit surface or a mesh.
        b: a shape of the same kind and dimension.
        method: how; by default BranchAndBound(). CubeIntervals() serves surfaces, not under jit.
        throw: whether to raise where the method did not reach what it promises.
        progress: as for `directed_hausdorff`.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: a shape or a method of another kind.
        ValueError: curves of different dimensions, or a surface proven empty in its box.
        NotProvenError: the method failed or was interrupted and throw is True; it carries the solution.
    """
    if isinstance(a, TriangleMesh) or isinstance(b, TriangleMesh):
        method, meshes = _of_meshes(method, a, b)
        return _finish(_larger(*_both_ways(*meshes, method, None, progress)), throw)
    if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        method, surfaces = _of_surfaces(method, a, b)
        if isinstance(method, CubeIntervals):
            return _finish(method.surfaces(*surfaces, progress=progress), throw and method.rule != "paper")
        targets, frame = _targets(*surfaces)
        host, aim = Host(frame, progress), _plain(frame)
        there = host.run_surfaces(method, targets.pair(), aim, DIRECTIONS.a_to_b)
        back = host.run_surfaces(method, targets.turned(), aim._replace(level=there.lower), DIRECTIONS.b_to_a)
        return _finish(with_surface_derivatives(frame.solution(_larger(there, back)), *surfaces), throw)
    method, curves, (p, q, frame) = _prepared(a, b, method)
    host = Host(frame, progress)
    there = host.run(method, p, q, _everything(p), DIRECTIONS.a_to_b)
    # In the other direction only what exceeds the first one's lower bound matters.
    back = host.run(method, q, p, _everything(p)._replace(level=there.lower), DIRECTIONS.b_to_a)
    return _finish(with_derivatives(frame.solution(_larger(there, back)), *curves, frame), throw)


def hausdorff_at_most(
    a: Shape,
    b: Shape,
    threshold: Numbers,
    method: AbstractHausdorffMethod | None = None,
    *,
    progress: Callable[[Progress], object] | None = None,
) -> Decision:
    """Whether the Hausdorff distance is at most the threshold: proven yes, proven no, or undecided at the tolerance.

    The same search as for the distance, ended as soon as the bounds are on one side of the threshold, which takes a few
    steps where the threshold is not close to the distance.

    Args:
        a: a curve, an implicit surface or a mesh.
        b: a shape of the same kind and dimension.
        threshold: a length of at least 0, in the unit of the coordinates.
        method: options of the search; its tolerance says when it gives up.
        progress: as for `directed_hausdorff`.

    Returns:
        The answer with the bounds of the distance that were reached; `result` says why where it is undecided.

    Raises:
        TypeError: a shape of another kind, or another method than BranchAndBound.
        ValueError: curves of different dimensions, a surface proven empty in its box, or a threshold that is no length.
    """
    if isinstance(a, TriangleMesh) or isinstance(b, TriangleMesh):
        (method, meshes), limit = _of_meshes(method, a, b), _checked_limit(threshold)
        return _decided(_larger(*_both_ways(*meshes, method, float(limit), progress)), limit)
    if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        method, surfaces = _of_surfaces(method, a, b)
        method, limit = _proving(method), _checked_limit(threshold)
        targets, frame = _targets(*surfaces)
        aim, host = Aim(*(frame.common(limit),) * 2), Host(frame, progress)
        there = host.run_surfaces(method, targets.pair(), aim, DIRECTIONS.a_to_b)
        back = host.run_surfaces(method, targets.turned(), aim, DIRECTIONS.b_to_a)
        return _decided(frame.solution(_larger(there, back)), limit)
    method, _, (p, q, frame) = _prepared(a, b, method)
    method, limit = _proving(method), _checked_limit(threshold)
    aim, host = Aim(*(frame.common(limit),) * 2), Host(frame, progress)
    there = host.run(method, p, q, aim, DIRECTIONS.a_to_b)
    back = host.run(method, q, p, aim, DIRECTIONS.b_to_a)
    return _decided(frame.solution(_larger(there, back)), limit)


def _proving(method: AbstractHausdorffMethod) -> BranchAndBound:
    if not isinstance(method, BranchAndBound):
        raise TypeError(f"method must be BranchAndBound(), which proves both bounds; got {type(method).__name__}.")
    return method


def _checked_limit(threshold: Numbers) -> Array:
    limit = real_array("threshold", threshold)
    if limit.shape != () or (not is_traced(limit) and float(limit) < 0):
        raise ValueError(f"threshold is {limit}; needs one number of at least 0.")
    return limit


@compiled
def _decided(solution: HausdorffSolution, limit: Array) -> Decision:
    below, above = solution.upper <= limit, solution.lower > limit
    answer = ANSWERS.where(below, ANSWERS.yes, ANSWERS.where(above, ANSWERS.no, ANSWERS.undecided))
    ended = result_where(solution.result == RESULTS.successful, RESULTS.gap_not_closed, solution.result)
    result = result_where(below | above, RESULTS.successful, ended)
    return Decision(answer, solution.lower, solution.upper, result, solution.stats)


def _everything(curve: BezierSegments) -> Aim:
    """The aim of a plain distance."""
    infinity = np.asarray(np.inf, curve.control_points.dtype)
    return Aim(-infinity, infinity)


@compiled
def _larger(there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
    back = eqx.tree_at(lambda s: s.witness.direction, back, DIRECTIONS.b_to_a)
    turned = back.value > there.value
    larger = jax.tree_util.tree_map(lambda x, y: jnp.where(turned, x, y), back, there)
    stats = {f"{name}_{key}": x for name, s in (("a_to_b", there), ("b_to_a", back)) for key, x in s.stats.items()}
    return HausdorffSolution(
        value=larger.value,
        lower=jnp.maximum(there.lower, back.lower),
        upper=jnp.maximum(there.upper, back.upper),
        witness=larger.witness,
        result=result_where(there.result == RESULTS.successful, back.result, there.result),
        stats=stats,
        directed=False,
    )


def _prepared(
    a: AbstractCurve, b: AbstractCurve, method: object
) -> tuple[
    AbstractHausdorffMethod,
    tuple[BezierSegments, BezierSegments],
    tuple[BezierSegments, BezierSegments, Frame],
]:
    """The checked method, both curves, and both in common coordinates, where nothing is differentiated."""
    check_curve("a", a)
    check_curve("b", b)
    method = BranchAndBound() if method is None else method
    if not isinstance(method, AbstractHausdorffMethod):
        known = "BranchAndBound(), TwoStep(), BiarcTrimming() or AlgebraicEvents()"
        raise TypeError(f"method must be {known}; got {type(method).__name__}.")
    pair = a.segments(), b.segments()
    if pair[0].dim != pair[1].dim:
        raise ValueError(f"a has {pair[0].dim} coordinates a point and b has {pair[1].dim}; needs the same.")
    # The two-step method takes fewer samples of a segment where there are more of them.
    sharing = isinstance(method, BranchAndBound)
    return method, pair, prepare(*jax.lax.stop_gradient(pair), sharing=sharing)


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


def _of_surfaces(method: object, a: Any, b: Any) -> tuple[BranchAndBound | CubeIntervals, tuple[Any, Any]]:
    """The checked method for implicit surfaces, and both."""
    method = BranchAndBound() if method is None else method
    if not isinstance(method, BranchAndBound | CubeIntervals):
        known = "BranchAndBound() or CubeIntervals()"
        raise TypeError(f"method must be {known} for implicit surfaces; got {type(method).__name__}.")
    check_surface("a", a)
    check_surface("b", b)
    return method, (a, b)


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


def _of_meshes(method: object, a: Any, b: Any) -> tuple[BranchAndBound, tuple[TriangleMesh, TriangleMesh]]:
    """The checked method for meshes, and both."""
    method = BranchAndBound() if method is None else method
    if not isinstance(method, BranchAndBound):
        raise TypeError(f"method must be BranchAndBound() for meshes; got {type(method).__name__}.")
    check_mesh("a", a)
    check_mesh("b", b)
    return method, (a, b)


def _both_ways(
    a: TriangleMesh,
    b: TriangleMesh,
    method: BranchAndBound,
    threshold: float | None,
    progress: Callable[[Any], object] | None,
) -> tuple[HausdorffSolution, HausdorffSolution]:
    """Both directions; the second one above the lower bound of the first, or both about a threshold."""
    level, ceiling = (-np.inf, np.inf) if threshold is None else (threshold, threshold)
    there = mesh_directed(a, b, method, level, ceiling, progress)
    known = float(jax.lax.stop_gradient(there.lower)) if threshold is None else threshold
    return there, mesh_directed(b, a, method, known, ceiling, progress, "b_to_a")


def _plain(frame: Frame) -> Aim:
    """The aim of a plain distance of surfaces."""
    infinity = np.asarray(np.inf, frame.centre.dtype)
    return Aim(-infinity, infinity)


def _finish(solution: HausdorffSolution, throw: bool) -> HausdorffSolution:
    if throw:
        throw_unless_successful(solution)
    return solution
