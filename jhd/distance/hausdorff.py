"""The entries: directed and two-sided Hausdorff distances of two shapes."""

from collections.abc import Callable
from typing import Any

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
from jhd.distance.method import AbstractHausdorffMethod, Aim
from jhd.distance.prepare import Frame, prepare
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.shapes.implicit import ImplicitSurface, check_surface
from jhd.solution import (
    ANSWERS,
    DIRECTIONS,
    RESULTS,
    Decision,
    HausdorffSolution,
    result_where,
    throw_unless_successful,
)


def directed_hausdorff(
    a: AbstractCurve | ImplicitSurface,
    b: AbstractCurve | ImplicitSurface,
    method: AbstractHausdorffMethod | None = None,
    *,
    throw: bool = True,
    progress: Callable[[Any], object] | None = None,
) -> HausdorffSolution:
    """Directed Hausdorff distance: the maximum over a of the minimum over b of the distance.

    The distance is that of the stored Bezier segments taken as real numbers. Works under jit and vmap, where checks of
    values are left out and `throw` is ignored: read `result`.

    Args:
        a: the curve whose farthest point is looked for, or an implicit surface.
        b: the curve that distances are taken to, of the same dimension, or an implicit surface.
        method: how; by default BranchAndBound() for curves, CubeIntervals() for surfaces (not under jit).
        throw: whether to raise where the method did not reach what it promises.
        progress: called with a Progress now and then while the search lasts (for surfaces with a VoxelProgress); not
            under jit. Ctrl-C ends the search with the bounds reached, as RESULTS.interrupted.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: a shape or a method of another kind.
        ValueError: curves of different dimensions.
        NotProvenError: the method failed or was interrupted and throw is True; it carries the solution.
    """
    if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        cells, surfaces = _by_cells(method, a, b)
        return _finish(cells.directed_surfaces(*surfaces, progress=progress), throw and cells.rule != "paper")
    method, curves, (p, q, frame) = _prepared(a, b, method)
    there = Host(frame, progress).run(method, p, q, _everything(p), DIRECTIONS.a_to_b)
    return _finish(with_derivatives(frame.solution(there), *curves, frame), throw)


def hausdorff(
    a: AbstractCurve | ImplicitSurface,
    b: AbstractCurve | ImplicitSurface,
    method: AbstractHausdorffMethod | None = None,
    *,
    throw: bool = True,
    progress: Callable[[Any], object] | None = None,
) -> HausdorffSolution:
    """Hausdorff distance: the larger of both directed distances; the witness's `direction` says which, a_to_b at a tie.

    Args:
        a: a curve, or an implicit surface.
        b: a curve of the same dimension, or an implicit surface.
        method: how; by default BranchAndBound() for curves, CubeIntervals() for surfaces (not under jit).
        throw: whether to raise where the method did not reach what it promises.
        progress: as for `directed_hausdorff`.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: a shape or a method of another kind.
        ValueError: curves of different dimensions.
        NotProvenError: the method failed or was interrupted and throw is True; it carries the solution.
    """
    if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        cells, surfaces = _by_cells(method, a, b)
        return _finish(cells.surfaces(*surfaces, progress=progress), throw and cells.rule != "paper")
    method, curves, (p, q, frame) = _prepared(a, b, method)
    host = Host(frame, progress)
    there = host.run(method, p, q, _everything(p), DIRECTIONS.a_to_b)
    # In the other direction only what exceeds the first one's lower bound matters.
    back = host.run(method, q, p, _everything(p)._replace(level=there.lower), DIRECTIONS.b_to_a)
    return _finish(with_derivatives(frame.solution(_larger(there, back)), *curves, frame), throw)


def hausdorff_at_most(
    a: AbstractCurve,
    b: AbstractCurve,
    threshold: Numbers,
    method: AbstractHausdorffMethod | None = None,
    *,
    progress: Callable[[Progress], object] | None = None,
) -> Decision:
    """Whether the Hausdorff distance is at most the threshold: proven yes, proven no, or undecided at the tolerance.

    The same search as for the distance, ended as soon as the bounds are on one side of the threshold, which takes a few
    steps where the threshold is not close to the distance.

    Args:
        a: a curve.
        b: a curve of the same dimension.
        threshold: a length of at least 0, in the unit of the coordinates.
        method: options of the search; its tolerance says when it gives up.
        progress: as for `directed_hausdorff`.

    Returns:
        The answer with the bounds of the distance that were reached; `result` says why where it is undecided.

    Raises:
        TypeError: a shape of another kind, or another method than BranchAndBound.
        ValueError: curves of different dimensions, or a threshold that is no length.
    """
    method, _, (p, q, frame) = _prepared(a, b, method)
    if not isinstance(method, BranchAndBound):
        raise TypeError(f"method must be BranchAndBound(), which proves both bounds; got {type(method).__name__}.")
    limit = real_array("threshold", threshold)
    if limit.shape != () or (not is_traced(limit) and float(limit) < 0):
        raise ValueError(f"threshold is {limit}; needs one number of at least 0.")
    aim, host = Aim(*(frame.common(limit),) * 2), Host(frame, progress)
    there = host.run(method, p, q, aim, DIRECTIONS.a_to_b)
    back = host.run(method, q, p, aim, DIRECTIONS.b_to_a)
    return _decided(frame.solution(_larger(there, back)), limit)


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


def _by_cells(method: object, a: Any, b: Any) -> tuple[CubeIntervals, tuple[Any, Any]]:
    """The checked method for implicit surfaces, and both."""
    method = CubeIntervals() if method is None else method
    if not isinstance(method, CubeIntervals):
        raise TypeError(f"method must be CubeIntervals() for implicit surfaces; got {type(method).__name__}.")
    check_surface("a", a)
    check_surface("b", b)
    return method, (a, b)


def _finish(solution: HausdorffSolution, throw: bool) -> HausdorffSolution:
    if throw:
        throw_unless_successful(solution)
    return solution
