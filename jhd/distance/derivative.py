"""Derivatives of a Hausdorff distance and of its witness, in all arrays of both curves.

The search is not differentiated: its answer is a function of both curves by the active system (jhd.distance.active),
and its derivatives are those of that function, of all orders that two Newton steps carry, in forward and reverse mode.

Where several places are equally far the derivative is that of the witness named, one of the generalised derivatives of
the maximum. Where the distance is zero it is not differentiable, and zero is taken.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arrays import is_traced
from jhd.distance import active
from jhd.distance.events import Piece
from jhd.distance.jets import jet
from jhd.distance.prepare import Frame, elevation_matrix
from jhd.shapes.curve import BezierSegments
from jhd.solution import DIRECTIONS, EVENTS, HausdorffSolution, Witness


class _Answer(NamedTuple):
    """What is differentiable of a solution."""

    value: Array
    t: Array
    point: Array
    feet: Array
    foot_params: Array


def with_derivatives(solution: HausdorffSolution, a: BezierSegments, b: BezierSegments, frame: Frame) -> Any:
    """The solution, its value and witness differentiable in both curves; all in the user's coordinates."""
    if not is_traced(a, b):
        return solution
    value, witness = attached(solution.value, solution.witness, a, b, frame)
    return HausdorffSolution(
        value, solution.lower, solution.upper, witness, solution.result, solution.stats, solution.directed
    )


def attached(
    value: Array, witness: Witness, a: BezierSegments, b: BezierSegments, frame: Frame
) -> tuple[Array, Witness]:
    """A distance and its witness, the same numbers, as functions of both curves; in the user's coordinates."""
    w = witness
    answer = _attached(_Answer(value, w.t, w.point, w.feet, w.foot_params), a, b, frame, w)
    moving = Witness(
        segment=w.segment,
        t=answer.t,
        point=answer.point,
        feet=answer.feet,
        foot_segments=w.foot_segments,
        foot_params=answer.foot_params,
        multipliers=w.multipliers,
        event=w.event,
        direction=w.direction,
    )
    return answer.value, moving


@jax.jit
def _attached(answer: _Answer, a: BezierSegments, b: BezierSegments, frame: Frame, witness: Witness) -> _Answer:
    """The same numbers, with the derivatives of the active system of the witness."""
    turned = witness.direction == DIRECTIONS.b_to_a
    scale = jnp.ldexp(jnp.ones((), answer.value.dtype), -jnp.clip(frame.first + frame.second, -1000, 1000))
    centre = jnp.ldexp(jnp.asarray(frame.centre), frame.first)
    degree = max(a.degree, b.degree)
    rational = a.weights is not None or b.weights is not None

    def piece(k: Array, of_b: Array) -> Piece:
        # The curve that does not carry it lends its first segment, which is not looked at.
        pieces = [_piece(c, jnp.where(of_b == own, k, 0), degree, rational) for c, own in ((a, False), (b, True))]
        points, weights = (
            jax.tree_util.tree_map(lambda x, y: jnp.where(of_b, y, x), *xs) for xs in zip(*pieces, strict=True)
        )
        return Piece((points - centre) * scale, weights)

    pieces = (
        piece(witness.segment, turned),
        piece(witness.foot_segments[0], ~turned),
        piece(witness.foot_segments[1], ~turned),
    )
    return _with_rule(answer, pieces, scale, witness.event)


def _piece(curve: BezierSegments, k: Array, degree: int, rational: bool) -> Piece:
    """One segment, written in this degree."""
    points = curve.control_points[k]
    weights = jnp.ones(points.shape[:-1], points.dtype) if curve.weights is None else curve.weights[k]
    raising = jnp.asarray(elevation_matrix(curve.degree, degree), points.dtype)
    if not rational:
        return Piece(raising @ points if degree > curve.degree else points, None)
    if degree == curve.degree:
        return Piece(points, weights)
    raised = raising @ weights
    return Piece(raising @ (points * weights[:, None]) / raised[:, None], raised)


@jax.custom_jvp
def _with_rule(answer: _Answer, pieces: tuple[Piece, Piece, Piece], scale: Array, event: Any) -> _Answer:
    return answer


@_with_rule.defjvp
def _rule(primals: tuple, tangents: tuple) -> tuple[_Answer, _Answer]:
    answer, pieces, scale, event = primals
    a, first, second = pieces
    start = jax.lax.stop_gradient(jnp.concatenate([answer.t[None], answer.foot_params]))
    system = jax.lax.stop_gradient(active.active(a, first, second, start, event))
    # At distance zero all derivatives are zero by convention; there they need not exist.
    apart = event != EVENTS.coincident

    def solved(pieces: tuple[Piece, Piece, Piece]) -> _Answer:
        here = system._replace(a=pieces[0], first=pieces[1], second=pieces[2])
        y = active.newton(active.newton(start, here), here)
        point = jet(*pieces[0], y[0]).point
        feet = jnp.stack([jet(*piece, s).point for piece, s in zip(pieces[1:], y[1:], strict=True)])
        # With two feet y[0] follows the crossing; a single one is given twice.
        feet, params = jnp.where(system.two, feet, feet[:1]), jnp.where(system.two, y[1:], y[1])
        return _Answer(active.distance(y, here) / scale, y[0], point / scale, feet / scale, params)

    _, change = jax.jvp(solved, (pieces,), (tangents[1],))
    return answer, jax.tree_util.tree_map(lambda x: jnp.where(apart, x, 0.0), change)
