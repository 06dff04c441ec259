"""The entries: directed and two-sided Hausdorff distances of two shapes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arrays import is_traced, real_array
from jhd.distance.branch_and_bound import BranchAndBound
from jhd.distance.method import AbstractHausdorffMethod, Aim
from jhd.distance.prepare import Frame, prepare
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
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
    a: AbstractCurve, b: AbstractCurve, method: AbstractHausdorffMethod | None = None, *, throw: bool = True
) -> HausdorffSolution:
    """Directed Hausdorff distance: the maximum over a of the minimum over b of the distance.

    The distance is that of the stored Bezier segments taken as real numbers. Works under jit and vmap, where checks of
    values are left out and `throw` is ignored: read `result`.

    Args:
        a: the curve whose farthest point is looked for.
        b: the curve that distances are taken to, of the same dimension.
        method: how; by default BranchAndBound().
        throw: whether to raise where the method did not reach what it promises.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: a shape or a method of another kind.
        ValueError: curves of different dimensions.
        NotProvenError: the method failed and throw is True; it carries the solution.
    """
    method = _checked(a, b, method)
    p, q, frame = prepare(a.segments(), b.segments())
    return _finish(frame.solution(_directed(method, p, q, frame, _everything(p))), throw)


def hausdorff(
    a: AbstractCurve, b: AbstractCurve, method: AbstractHausdorffMethod | None = None, *, throw: bool = True
) -> HausdorffSolution:
    """Hausdorff distance: the larger of both directed distances; the witness's `direction` says which, a_to_b at a tie.

    Args:
        a: a curve.
        b: a curve of the same dimension.
        method: how; by default BranchAndBound().
        throw: whether to raise where the method did not reach what it promises.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: a shape or a method of another kind.
        ValueError: curves of different dimensions.
        NotProvenError: the method failed and throw is True; it carries the solution.
    """
    method = _checked(a, b, method)
    p, q, frame = prepare(a.segments(), b.segments())
    there = _directed(method, p, q, frame, _everything(p))
    # In the other direction only what exceeds the first one's lower bound matters.
    back = _directed(method, q, p, frame, _everything(p)._replace(level=there.lower))
    return _finish(frame.solution(_larger(there, back)), throw)


def hausdorff_at_most(
    a: AbstractCurve, b: AbstractCurve, threshold: Numbers, method: AbstractHausdorffMethod | None = None
) -> Decision:
    """Whether the Hausdorff distance is at most the threshold: proven yes, proven no, or undecided at the tolerance.

    The same search as for the distance, ended as soon as the bounds are on one side of the threshold, which takes a few
    steps where the threshold is not close to the distance.

    Args:
        a: a curve.
        b: a curve of the same dimension.
        threshold: a length of at least 0, in the unit of the coordinates.
        method: options of the search; its tolerance says when it gives up.

    Returns:
        The answer with the bounds of the distance that were reached; `result` says why where it is undecided.

    Raises:
        TypeError: a shape of another kind, or another method than BranchAndBound.
        ValueError: curves of different dimensions, or a threshold that is no length.
    """
    method = _checked(a, b, method)
    if not isinstance(method, BranchAndBound):
        raise TypeError(f"method must be BranchAndBound(), which proves both bounds; got {type(method).__name__}.")
    limit = real_array("threshold", threshold)
    if limit.shape != () or (not is_traced(limit) and float(limit) < 0):
        raise ValueError(f"threshold is {limit}; needs one number of at least 0.")
    p, q, frame = prepare(a.segments(), b.segments())
    aim = Aim(*(frame.common(limit),) * 2)
    there = _directed(method, p, q, frame, aim)
    back = _directed(method, q, p, frame, aim)
    return _decided(frame.solution(_larger(there, back)), limit)


@eqx.filter_jit
def _decided(solution: HausdorffSolution, limit: Array) -> Decision:
    below, above = solution.upper <= limit, solution.lower > limit
    answer = ANSWERS.where(below, ANSWERS.yes, ANSWERS.where(above, ANSWERS.no, ANSWERS.undecided))
    ended = result_where(solution.result == RESULTS.successful, RESULTS.gap_not_closed, solution.result)
    result = result_where(below | above, RESULTS.successful, ended)
    return Decision(answer, solution.lower, solution.upper, result)


def _everything(curve: BezierSegments) -> Aim:
    """The aim of a plain distance."""
    infinity = np.asarray(np.inf, curve.control_points.dtype)
    return Aim(-infinity, infinity)


@eqx.filter_jit
def _directed(
    method: AbstractHausdorffMethod, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim
) -> HausdorffSolution:
    return method.directed(a, b, frame, aim)


@eqx.filter_jit
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
    )


def _checked(a: AbstractCurve, b: AbstractCurve, method: object) -> AbstractHausdorffMethod:
    check_curve("a", a)
    check_curve("b", b)
    method = BranchAndBound() if method is None else method
    if not isinstance(method, AbstractHausdorffMethod):
        raise TypeError(f"method must be BranchAndBound() or TwoStep(); got {type(method).__name__}.")
    dims = [shape.segments().dim for shape in (a, b)]
    if dims[0] != dims[1]:
        raise ValueError(f"a has {dims[0]} coordinates a point and b has {dims[1]}; needs the same.")
    return method


def _finish(solution: HausdorffSolution, throw: bool) -> HausdorffSolution:
    if throw:
        throw_unless_successful(solution)
    return solution
