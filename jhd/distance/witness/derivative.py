"""Derivatives of a Hausdorff distance and of its witness, and of nearest points, in all arrays they depend on.

The search is not differentiated: its answer is a function of both curves by the active system
(jhd.distance.witness.active), and its derivatives are those of that function, in forward and reverse mode, of first and
higher order.

Where several places are equally far the derivative is that of the witness named, one of the generalised derivatives of
the maximum. Where several feet are equally near at an end or corner of a it lies between the one-sided derivatives in
every direction (jhd.distance.witness.multipliers). Where the distance is zero it is not differentiable, and zero is
taken.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic.scaling import common_exponent, scale_of, unit_weights
from jhd.arrays import is_traced
from jhd.compiled import compiled
from jhd.distance.frame.attach import attached
from jhd.distance.frame.coordinates import Frame
from jhd.distance.frame.curves import elevation_matrix
from jhd.distance.frame.jets import jet
from jhd.distance.frame.pieces import Piece
from jhd.distance.nearest.feet import is_held
from jhd.distance.witness import active
from jhd.shapes.curve import BezierSegments
from jhd.solution import DIRECTIONS, EVENTS, HausdorffSolution, Projection, Witness, on_device


class _Answer(NamedTuple):
    """What is differentiable of a solution."""

    value: Array
    t: Array
    point: Array
    feet: Array
    foot_params: Array

    def scalars(self) -> tuple[Array, ...]:
        """All numbers one by one; see jhd.distance.witness.active on why."""
        return self.value, self.t, *self.foot_params, *self.point, *self.feet.ravel()

    @classmethod
    def of_scalars(cls, scalars: tuple[Array, ...]) -> "_Answer":
        """The inverse of `scalars`."""
        value, t, first, second, *coordinates = scalars
        rows = jnp.stack(coordinates).reshape(3, -1)
        return cls(value, t, rows[0], rows[1:], jnp.stack([first, second]))


def with_derivatives(solution: HausdorffSolution, a: BezierSegments, b: BezierSegments, frame: Frame) -> Any:
    """The solution, its value and witness differentiable in both curves; all in the user's coordinates."""
    if not is_traced(a, b):
        return solution
    solution = on_device(solution)
    value, witness = moving(solution.value, solution.witness, a, b, frame)
    return replace(solution, value=value, witness=witness)


def moving(value: Array, witness: Witness, a: BezierSegments, b: BezierSegments, frame: Frame) -> tuple[Array, Witness]:
    """A distance and its witness, the same numbers, as functions of both curves; in the user's coordinates."""
    w = witness
    answer = _attached(_Answer(value, w.t, w.point, w.feet, w.foot_params), a, b, frame, w)
    places = {name: getattr(answer, name) for name in ("t", "point", "feet", "foot_params")}
    return answer.value, replace(witness, **places)


def projection_with_derivatives(found: Projection, queries: Array, curve: BezierSegments) -> Projection:
    """Nearest points, their distances and parameters differentiable in the queries and in the curve."""
    if not is_traced(queries, curve):
        return found
    distance, foot, t = _feet(found, queries, curve)
    return attached(attached(found, found.distance > 0, distance=distance), foot=foot, t=t)


@compiled
def _feet(found: Projection, queries: Array, curve: BezierSegments) -> tuple[Array, Array, Array]:
    """Distances, feet and parameters as functions of the queries and the curve."""
    exponent = common_exponent(*jax.lax.stop_gradient((queries, curve.control_points)))
    scale = scale_of(exponent, queries.dtype)
    rational = curve.weights is not None

    def one(query: Array, segment: Array, t: Array) -> tuple[Array, Array, Array]:
        points, weights = _piece(curve, segment, curve.degree, rational)
        piece, point = Piece(points * scale, weights), query * scale
        held, s = jax.lax.stop_gradient((is_held(point, piece, t), t))
        # Two steps carry the first two derivatives of the parameter.
        for _ in range(2):
            s = active.stationary(s, point, piece, held)
        b = jet(*piece, s)
        c = point - b.point
        return c @ active.direction(c, b.first, held) / scale, b.point / scale, s

    batch = queries.shape[:-1]
    flat = (x.reshape(-1, *x.shape[len(batch) :]) for x in (queries, found.segment, found.t))
    return jax.tree_util.tree_map(lambda x: x.reshape(*batch, *x.shape[1:]), jax.vmap(one)(*flat))


@compiled
def _attached(answer: _Answer, a: BezierSegments, b: BezierSegments, frame: Frame, witness: Witness) -> _Answer:
    """The same numbers, with the derivatives of the active system of the witness."""
    turned = witness.direction == DIRECTIONS.b_to_a
    degree = max(a.degree, b.degree)
    rational = a.weights is not None or b.weights is not None

    def piece(k: Array, of_b: Array) -> Piece:
        # The curve that does not carry it lends its first segment, which is not looked at.
        pieces = [_piece(c, jnp.where(of_b == own, k, 0), degree, rational) for c, own in ((a, False), (b, True))]
        points, weights = (
            jax.tree_util.tree_map(lambda x, y: jnp.where(of_b, y, x), *xs) for xs in zip(*pieces, strict=True)
        )
        return Piece(frame.moved(points), weights)

    pieces = (
        piece(witness.segment, turned),
        piece(witness.foot_segments[0], ~turned),
        piece(witness.foot_segments[1], ~turned),
    )
    return _with_rule(answer, pieces, frame.scale(answer.value.dtype), (witness.event, witness.multipliers))


def _piece(curve: BezierSegments, k: Array, degree: int, rational: bool) -> Piece:
    """One segment, written in this degree."""
    points = curve.control_points[k]
    weights = jnp.ones(points.shape[:-1], points.dtype) if curve.weights is None else unit_weights(curve.weights[k])
    if not rational:
        return Piece(_raised(points, degree), None)
    if degree == curve.degree:
        return Piece(points, weights)
    raised = _raised(weights[:, None], degree)
    return Piece(_raised(points * weights[:, None], degree) / raised, raised[:, 0])


def _raised(rows: Array, degree: int) -> Array:
    if degree == rows.shape[0] - 1:
        return rows
    raising = jnp.asarray(elevation_matrix(rows.shape[0] - 1, degree), rows.dtype)
    # Sums keep the batch axis of vmap in front, where a matrix product may move it; see jhd.distance.witness.active.
    return jnp.sum(raising[:, :, None] * rows, axis=1)


def _with_rule(answer: _Answer, pieces: active.Pieces, scale: Array, kind: tuple[Any, Array]) -> _Answer:
    """The same answer, with the derivatives of the active system of the kind: its event and multipliers."""
    return _Answer.of_scalars(_scalars_with_rule(answer.scalars(), pieces, scale, kind))


@jax.custom_jvp
def _scalars_with_rule(scalars: tuple, pieces: active.Pieces, scale: Array, kind: tuple[Any, Array]) -> tuple:
    return scalars


@_scalars_with_rule.defjvp
def _rule(primals: tuple, tangents: tuple) -> tuple[tuple, tuple]:
    scalars, pieces, scale, (event, multipliers) = primals
    answer = _Answer.of_scalars(scalars)
    a, first, second = pieces
    start = jax.lax.stop_gradient(jnp.concatenate([answer.t[None], answer.foot_params]))
    held, two = jax.lax.stop_gradient(active.active(a, first, second, start, event, multipliers)[3:])
    # At distance zero all derivatives are zero by convention; there they need not exist.
    apart = event != EVENTS.coincident
    y, y_dot = jax.jvp(lambda p: active.solution(start, p, held, two), (pieces,), (tangents[1],))
    system = active.Active(a, first, second, held, two)
    jets = [jet(*piece, s) for piece, s in zip(pieces, y, strict=True)]
    # How the three points move at fixed parameters.
    at_rest = [
        jax.jvp(lambda p, s=s: jet(*p, s).point, (piece,), (moved,))[1]
        for piece, s, moved in zip(pieces, y, tangents[1], strict=True)
    ]
    stretch = jnp.stack([unit @ (at_rest[0] - at_rest[i]) for i, unit in enumerate(active.units(y, system), 1)])
    points = [still + j.first * s for still, j, s in zip(at_rest, jets, y_dot, strict=True)]
    # A single foot is given twice.
    feet = jnp.where(two, jnp.stack(points[1:]), points[1])
    change = _Answer(
        value=active.multipliers(y, system, multipliers) @ stretch / scale,
        t=y_dot[0],
        point=points[0] / scale,
        feet=feet / scale,
        foot_params=jnp.where(two, y_dot[1:], y_dot[1]),
    )
    return scalars, tuple(jnp.where(apart, x, 0.0) for x in change.scalars())
