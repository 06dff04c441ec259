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
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from jhd._results.solution import DIRECTIONS, EVENTS, HausdorffSolution, Projection, Witness, on_device, with_answers
from jhd._runtime.arrays import is_traced, is_tracing
from jhd._runtime.compiled import compiled
from jhd.arithmetic.scaling import common_exponent, scale_of, unit_weights
from jhd.distance.frame.attach import attached
from jhd.distance.frame.coordinates import Frame
from jhd.distance.frame.curves import elevation_matrix
from jhd.distance.frame.jets import jet
from jhd.distance.frame.pieces import Piece
from jhd.distance.nearest.feet import is_held
from jhd.distance.witness import active
from jhd.shapes.curve import BezierSegments


class _Answer(NamedTuple):
    """What is differentiable of a solution."""

    value: Array
    t: Array
    point: Array
    feet: Array
    foot_params: Array

    def vector(self) -> Array:
        """All numbers in a row."""
        return jnp.concatenate([x.ravel() for x in self])

    def of_vector(self, numbers: Array) -> "_Answer":
        """The inverse of `vector`; the shapes are those of this answer."""
        ends = np.cumsum([x.size for x in self])
        return _Answer(*(numbers[end - x.size : end].reshape(x.shape) for x, end in zip(self, ends, strict=True)))


class _Constants(NamedTuple):
    """What is constant of a witness."""

    segment: Array
    foot_segments: Array
    multipliers: Array
    event: Any
    direction: Any


class _Rows(NamedTuple):
    """Control points and weights: of a curve, or of those of its segments that a witness touches."""

    points: Any
    weights: Any


class _Touched(NamedTuple):
    """The three segments of each curve that an answer touches, their numbers, and which of them are looked at on b."""

    rows: tuple[_Rows, _Rows]
    segments: tuple[Array, Array]
    of_b: Array


def with_derivatives(solution: HausdorffSolution, a: BezierSegments, b: BezierSegments, frame: Frame) -> Any:
    """The solution and its directions, with values and witnesses differentiable in both curves.

    All lengths and places are in the user's coordinates.
    """
    if not is_traced(a, b):
        return solution
    solution = on_device(solution)
    # Whatever is asked for: all in one, as each call under a derivative costs a millisecond.
    each = (solution, *(solution.directions or ()))
    return with_answers(solution, _found([(s.value, s.witness) for s in each], a, b, frame))


def moving(value: Array, witness: Witness, a: BezierSegments, b: BezierSegments, frame: Frame) -> tuple[Array, Witness]:
    """A distance and its witness, the same numbers, as functions of both curves; in the user's coordinates."""
    value, *places = _found([(value, witness)], a, b, frame)[0]
    return value, replace(witness, **dict(zip(_Answer._fields[1:], places, strict=True)))


def _found(
    given: list[tuple[Array, Witness]], a: BezierSegments, b: BezierSegments, frame: Frame
) -> tuple[_Answer, ...]:
    """The answers as functions of both curves."""
    answers = tuple(_Answer(value, w.t, w.point, w.feet, w.foot_params) for value, w in given)
    kinds = tuple(_Constants(w.segment, w.foot_segments, w.multipliers, w.event, w.direction) for _, w in given)
    curves = _Rows(a.control_points, a.weights), _Rows(b.control_points, b.weights)
    return _moving(answers, curves, kinds, frame)


@jax.custom_jvp
def _moving(
    answers: tuple[_Answer, ...], curves: tuple[_Rows, _Rows], kinds: tuple[_Constants, ...], frame: Frame
) -> tuple[_Answer, ...]:
    """The same answers, with the derivatives of the active system of their witnesses."""
    return answers


def _moving_rule(primals: tuple, tangents: tuple) -> tuple[tuple[_Answer, ...], tuple[_Answer, ...]]:
    answers, curves, kinds, frame = primals
    touched = _touched(curves, kinds)
    moves = [_Rows(*(None if isinstance(x, SymbolicZero) else x for x in change)) for change in tangents[1]]
    if is_tracing():
        # Only what is asked for remains of it.
        return answers, _changed_there(answers, touched, moves, kinds, frame)
    # All slopes by a program of its own, which is kept for curves of any length: where the curves are known the rest is
    # a few sums.
    slopes = _slopes(answers, touched.rows, touched.of_b, kinds, frame)
    moved = [
        (slope, segments, x)
        for rows, segments, change in zip(slopes, touched.segments, moves, strict=True)
        for slope, x in zip(rows, change, strict=True)
        if x is not None
    ]
    return answers, _changed(answers, moved)


_moving.defjvp(_moving_rule, symbolic_zeros=True)


@compiled
def _changed(answers: tuple[_Answer, ...], moved: list[tuple[Array, Array, Array]]) -> tuple[_Answer, ...]:
    """The changes of the answers where control points and weights change."""
    total = jnp.zeros((len(answers), answers[0].vector().size), answers[0].value.dtype)
    for slope, segments, x in moved:
        # Sums keep the batch axis of vmap in front, where a matrix product may move it.
        total = total + jnp.sum(slope * x[segments][:, None], axis=range(2, slope.ndim))
    return tuple(answer.of_vector(row) for answer, row in zip(answers, total, strict=True))


@compiled
def _touched(curves: tuple[_Rows, _Rows], kinds: tuple[_Constants, ...]) -> _Touched:
    """What each of several answers touches, stacked."""
    kind = _stacked(kinds)
    turned = kind.direction == DIRECTIONS.b_to_a
    of_b = jnp.stack([turned, ~turned, ~turned], axis=1)
    touched = jnp.concatenate([kind.segment[:, None], kind.foot_segments], axis=1)
    # The curve that does not carry it lends its first segment, which is not looked at.
    segments = jnp.where(of_b, 0, touched), jnp.where(of_b, touched, 0)
    a, b = (jax.tree_util.tree_map(lambda x, k=k: x[k], curve) for curve, k in zip(curves, segments, strict=True))
    return _Touched((a, b), segments, of_b)


@compiled
def _slopes(
    answers: tuple[_Answer, ...],
    rows: tuple[_Rows, _Rows],
    of_b: Array,
    kinds: tuple[_Constants, ...],
    frame: Frame,
) -> tuple[_Rows, _Rows]:
    """The derivatives of all numbers of each answer in the rows that it touches."""

    def one(answer: _Answer, rows: tuple[_Rows, _Rows], of_b: Array, kind: _Constants) -> tuple[_Rows, _Rows]:
        def change(moved: tuple[_Rows, _Rows]) -> Array:
            return _moved_by(answer, rows, moved, of_b, kind, frame).vector()

        # It is linear: its slopes anywhere are those of the answer.
        return jax.jacrev(change)(jax.tree_util.tree_map(jnp.zeros_like, rows))

    return jax.vmap(one)(_stacked(answers), rows, of_b, _stacked(kinds))


def _changed_there(
    answers: tuple[_Answer, ...], touched: _Touched, moves: list[_Rows], kinds: tuple[_Constants, ...], frame: Frame
) -> tuple[_Answer, ...]:
    """The changes of the answers where control points and weights change, without the slopes; None does not change."""

    def taken(row: Any, change: Any, segments: Array) -> Any:
        return None if row is None else jnp.zeros_like(row) if change is None else change[segments]

    moved = tuple(
        _Rows(taken(rows.points, change.points, segments), taken(rows.weights, change.weights, segments))
        for rows, change, segments in zip(touched.rows, moves, touched.segments, strict=True)
    )

    def one(k: int, answer: _Answer, kind: _Constants) -> _Answer:
        rows, change, of_b = jax.tree_util.tree_map(lambda x: x[k], (touched.rows, moved, touched.of_b))
        return _moved_by(answer, rows, change, of_b, kind, frame)

    return tuple(one(k, answer, kind) for k, (answer, kind) in enumerate(zip(answers, kinds, strict=True)))


def _moved_by(
    answer: _Answer,
    rows: tuple[_Rows, _Rows],
    moved: tuple[_Rows, _Rows],
    of_b: Array,
    kind: _Constants,
    frame: Frame,
) -> _Answer:
    """How an answer changes where the rows that it touches change."""
    pieces, pieces_dot = jax.jvp(lambda rows: _pieces(rows, of_b, frame), (rows,), (moved,))
    return _change(answer, pieces, pieces_dot, frame.scale(answer.value.dtype), kind)


def _stacked(each: tuple) -> Any:
    return jax.tree_util.tree_map(lambda *x: jnp.stack(x), *each)


def _pieces(rows: tuple[_Rows, _Rows], of_b: Array, frame: Frame) -> active.Pieces:
    """The segments of the witness and of its feet, of one degree and in common coordinates."""
    degree = max(x.points.shape[1] for x in rows) - 1
    rational = any(x.weights is not None for x in rows)

    def piece(k: int) -> Piece:
        first, second = (
            _piece(x.points[k], None if x.weights is None else x.weights[k], degree, rational) for x in rows
        )
        points, weights = jax.tree_util.tree_map(lambda x, y: jnp.where(of_b[k], y, x), first, second)
        return Piece(frame.moved(points), weights)

    return piece(0), piece(1), piece(2)


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
    scale, weights = scale_of(exponent, queries.dtype), curve.weights

    def one(query: Array, segment: Array, t: Array) -> tuple[Array, Array, Array]:
        own = None if weights is None else weights[segment]
        points, own = _piece(curve.control_points[segment], own, curve.degree, own is not None)
        piece, point = Piece(points * scale, own), query * scale
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


def _piece(points: Array, weights: Array | None, degree: int, rational: bool) -> Piece:
    """One segment, written in this degree."""
    if not rational:
        return Piece(_raised(points, degree), None)
    own: Any = jnp.ones(points.shape[:-1], points.dtype) if weights is None else unit_weights(weights)
    if degree == points.shape[0] - 1:
        return Piece(points, own)
    raised = _raised(own[:, None], degree)
    return Piece(_raised(points * own[:, None], degree) / raised, raised[:, 0])


def _raised(rows: Array, degree: int) -> Array:
    if degree == rows.shape[0] - 1:
        return rows
    raising = jnp.asarray(elevation_matrix(rows.shape[0] - 1, degree), rows.dtype)
    # Sums keep the batch axis of vmap in front, where a matrix product may move it; see jhd.distance.witness.active.
    return jnp.sum(raising[:, :, None] * rows, axis=1)


def _change(answer: _Answer, pieces: active.Pieces, moved: active.Pieces, scale: Array, kind: _Constants) -> _Answer:
    """How an answer moves with the pieces by the active system of its kind."""
    a, first, second = pieces
    start = jax.lax.stop_gradient(jnp.concatenate([answer.t[None], answer.foot_params]))
    given = jax.lax.stop_gradient(active.active(a, first, second, start, kind.event, kind.multipliers))
    held, two = given.held, given.two
    # At distance zero all derivatives are zero by convention; there they need not exist.
    apart = kind.event != EVENTS.coincident
    y, y_dot = jax.jvp(lambda p: active.solution(start, p, held, two), (pieces,), (moved,))
    system = active.Active(a, first, second, held, two)
    jets = [jet(*piece, s) for piece, s in zip(pieces, y, strict=True)]
    # How the three points move at fixed parameters.
    at_rest = [
        jax.jvp(lambda p, s=s: jet(*p, s).point, (piece,), (change,))[1]
        for piece, s, change in zip(pieces, y, moved, strict=True)
    ]
    stretch = jnp.stack([unit @ (at_rest[0] - at_rest[i]) for i, unit in enumerate(active.units(y, system), 1)])
    points = [still + j.first * s for still, j, s in zip(at_rest, jets, y_dot, strict=True)]
    # A single foot is given twice.
    feet = jnp.where(two, jnp.stack(points[1:]), points[1])
    change = _Answer(
        value=active.multipliers(y, system, kind.multipliers) @ stretch / scale,
        t=y_dot[0],
        point=points[0] / scale,
        feet=feet / scale,
        foot_params=jnp.where(two, y_dot[1:], y_dot[1]),
    )
    return jax.tree_util.tree_map(lambda x: jnp.where(apart, x, 0.0), change)
