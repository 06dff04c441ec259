"""Derivatives of a Hausdorff distance and of its witness, and of nearest points, in all arrays they depend on.

The search is not differentiated. Its result is a function of both curves by the active system
(jhd._distance.witness.active), and the derivatives of this function are used, in forward and reverse mode, of first and
higher order.

If several points are equally far, the derivative belongs to the witness returned; it is one of the generalized
derivatives of the maximum. If several feet are equally near at an end or corner of a, it lies between the one-sided
derivatives in every direction (jhd._distance.witness.multipliers). At distance zero the distance is not differentiable,
and the derivative is taken as zero.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from jhd._arithmetic.scaling import common_exponent, scale_of, unit_weights
from jhd._distance.nearest.feet import is_held
from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.curves import elevation_matrix
from jhd._distance.normalization.custom_derivatives import at_rest
from jhd._distance.normalization.implicit_derivatives import MovingNumbers, TouchedRows, following
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import Piece, piece_of
from jhd._distance.witness import active
from jhd._results.solution import (
    DIRECTIONS,
    EVENTS,
    HausdorffSolution,
    Projection,
    StationaryPoints,
    Witness,
    on_device,
    with_answers,
)
from jhd._runtime.arrays import bound, is_traced, undifferentiated
from jhd._runtime.compiled import compiled
from jhd._runtime.sharding import is_partitioned
from jhd._shapes.curve import BezierSegments


class _Answer(NamedTuple):
    """The differentiable numbers of a solution."""

    value: Array
    t: Array
    point: Array
    feet: Array
    feet_params: Array


class _Rows(NamedTuple):
    """Control points and weights of some segments of a curve."""

    points: Any
    weights: Any


class _Touched(NamedTuple):
    """Rows of a curve at the segments of a witness and of both feet, for those of them that lie on it."""

    carrier: _Rows
    feet: _Rows


class WitnessState(NamedTuple):
    """A witness as the solution of its active system, in common coordinates."""

    y: Array  # parameters of the witness and of both feet
    pulls: Array  # unit vectors from the feet to the witness, times the multipliers
    held: Array  # mask of the held parameters
    two: Array  # whether both feet count

    @classmethod
    def like(cls, dtype: Any, dim: int, *batch: int) -> "WitnessState":
        """Return shapes and types of a state, or of a batch of states."""
        form: Any = lambda kind, *shape: jax.ShapeDtypeStruct((*batch, *shape), kind)  # noqa: E731
        return cls(form(dtype, 3), form(dtype, 2, dim), form(bool, 3), form(bool))


def state_of(witness: Witness, a: BezierSegments, b: BezierSegments) -> WitnessState:
    """Return the state of a witness on a, both curves in common coordinates."""
    first, second = witness.feet_elements
    return _state((piece_of(a, witness.element), piece_of(b, first), piece_of(b, second)), witness)


def with_derivatives(
    solution: HausdorffSolution, a: BezierSegments, b: BezierSegments, frame: Frame, states: Any = None
) -> Any:
    """The solution and its directions, with values and witnesses differentiable in both curves.

    All lengths and points are in the user's coordinates.

    Args:
        solution: the result of the search.
        a: the first curve.
        b: the second curve.
        frame: frame of the common coordinates.
        states: states of the witnesses if known, with keys False (from a to b) and True (from b to a).
    """
    if not is_traced(a, b):
        return solution
    solution = on_device(solution)
    numbers = tuple((s.value, s.witness) for s in (solution, *(solution.directions or ())))
    # If one of two explicitly sharded arrays is chosen, JAX loses the mesh (0.12.0.1).
    if not states or is_partitioned((a, b)):
        # Everything at once, even if not needed: each call under a derivative costs a millisecond.
        return with_answers(solution, _found(numbers, a, b, frame))
    if solution.directions is None:
        own = tuple(states.values())
        return with_answers(solution, _found(numbers, a, b, frame, own))
    others = states[False], states[True]
    turned = solution.direction == DIRECTIONS.b_to_a
    own = (jax.tree_util.tree_map(lambda x, y: jnp.where(turned, y, x), *others),)
    # Separately, since the directions are seldom needed, and only needed outputs are compiled.
    return with_answers(solution, (*_found(numbers[:1], a, b, frame, own), *_found(numbers[1:], a, b, frame, others)))


def moving(value: Array, witness: Witness, a: BezierSegments, b: BezierSegments, frame: Frame) -> tuple[Array, Witness]:
    """Return a distance and its witness, unchanged, as functions of both curves; in the user's coordinates."""
    value, *places = _found(((value, witness),), a, b, frame)[0]
    return value, replace(witness, **dict(zip(_Answer._fields[1:], places, strict=True)))


def _found(
    given: tuple[tuple[Array, Witness], ...], a: BezierSegments, b: BezierSegments, frame: Frame, states: Any = None
) -> tuple[_Answer, ...]:
    """Return the answers as functions of both curves; the states of their witnesses may be known."""
    answers = tuple(_Answer(value, w.t, w.point, w.feet, w.feet_params) for value, w in given)
    parts = tuple(
        tuple(_Touched(_rows(curve, w.element), _rows(curve, w.feet_elements)) for curve in (a, b)) for _, w in given
    )
    return following(_moving, answers, parts, (tuple(w for _, w in given), frame, states))


def _rows(curve: BezierSegments, segments: Array) -> _Rows:
    weights = None if curve.weights is None else TouchedRows(curve.weights, segments)
    return _Rows(TouchedRows(curve.control_points, segments), weights)


def _moving(
    rows: tuple[tuple[_Touched, _Touched], ...], constants: tuple[tuple[Witness, ...], Frame, Any]
) -> MovingNumbers:
    """Return the answers as functions of the rows that they depend on."""
    witnesses, frame, states = constants
    given: Any = (rows, witnesses) if states is None else (rows, witnesses, states)
    one: Any = partial(_answer, frame)
    if len(rows) == 1:
        return MovingNumbers(*((x,) for x in one(*(each[0] for each in given))))
    # In one batch: one after the other would take as many times as long to compile.
    found = jax.vmap(one)(*(jax.tree_util.tree_map(lambda *x: jnp.stack(x), *each) for each in given))
    each = [jax.tree_util.tree_map(lambda x, k=k: x[k], found) for k in range(len(rows))]
    return MovingNumbers(*zip(*each, strict=True))


def _pieces(rows: tuple[_Touched, _Touched], turned: Array, frame: Frame) -> active.Pieces:
    """Return the segments of the witness and of its feet, of one degree and in common coordinates."""
    each = [part for curve in rows for part in curve]
    degree = max(part.points.shape[-2] for part in each) - 1
    rational = any(part.weights is not None for part in each)
    one = partial(_piece, degree=degree, rational=rational)
    (a, feet_on_a), (b, feet_on_b) = ((one(*curve.carrier), jax.vmap(one)(*curve.feet)) for curve in rows)
    first, feet = (
        jax.tree_util.tree_map(lambda x, y: jnp.where(turned, y, x), *pair) for pair in ((a, b), (feet_on_b, feet_on_a))
    )
    first, feet = (piece._replace(control_points=frame.moved(piece.control_points)) for piece in (first, feet))
    return first, *(jax.tree_util.tree_map(lambda x, k=k: x[k], feet) for k in range(2))


def projection_with_derivatives(found: Projection, queries: Array, curve: BezierSegments) -> Projection:
    """Return nearest points, distances and parameters, differentiable in the queries and in the curve."""
    if not is_traced(queries, curve):
        return found
    known = _FootNumbers(found.distance, found.foot, found.t)
    numbers = queries, curve.control_points, curve.weights
    distance, foot, t = _moving_feet(known, numbers, found.element)
    return replace(found, distance=distance, foot=foot, t=t)


def stationary_with_derivatives(found: StationaryPoints, queries: Array, curve: BezierSegments) -> StationaryPoints:
    """Return stationary points, distances and parameters, differentiable in queries and curve."""
    if not is_traced(queries, curve):
        return found
    rows = jnp.broadcast_to(queries[..., None, :], (*found.t.shape, curve.dim))
    known = _FootNumbers(found.distance, jnp.zeros_like(undifferentiated(rows)), found.t)
    distance, _, t = _moving_feet(known, (rows, curve.control_points, curve.weights), found.segment)
    return replace(found, distance=distance, t=t)


class _FootNumbers(NamedTuple):
    """The differentiable fields of a projection."""

    distance: Array
    foot: Array
    t: Array


def _moving_feet(known: _FootNumbers, numbers: Any, segment: Array) -> _FootNumbers:
    """Return known feet, with the derivatives of `_feet` in queries, control points and weights."""
    return _bound_feet(*bound((known, numbers, segment)))


@jax.custom_jvp
def _bound_feet(known: _FootNumbers, numbers: Any, segment: Array) -> _FootNumbers:
    return known


def _moving_feet_rule(primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    known, numbers, segment = primals
    leaves, form = jax.tree_util.tree_flatten(numbers)
    moves = jax.tree_util.tree_leaves(tangents[1], is_leaf=lambda x: isinstance(x, SymbolicZero))
    where = [k for k, x in enumerate(moves) if not isinstance(x, SymbolicZero)]

    def feet(moving: list[Any]) -> _FootNumbers:
        rows = list(leaves)
        for k, x in zip(where, moving, strict=True):
            rows[k] = x
        return _feet(known.t, segment, *form.unflatten(rows))

    here, change = jax.jvp(feet, ([leaves[k] for k in where],), ([moves[k] for k in where],))
    usable = jax.tree_util.tree_map(lambda x, y: jnp.isfinite(x - y), known, here)
    usable = usable._replace(distance=usable.distance & (known.distance > 0))
    # Further derivatives are derivatives of these numbers as functions, too.
    again = _moving_feet(known, numbers, segment) if is_traced(numbers) else known
    return again, jax.tree_util.tree_map(lambda x, good: jnp.where(good, x, 0.0), change, usable)


_bound_feet.defjvp(_moving_feet_rule, symbolic_zeros=True)


@compiled
def _feet(t: Array, segment: Array, queries: Array, control_points: Array, weights: Array | None) -> _FootNumbers:
    """Return distances, feet and parameters as functions of the queries and the curve."""
    exponent = common_exponent(*jax.lax.stop_gradient((queries, control_points)))
    scale, degree = scale_of(exponent, queries.dtype), control_points.shape[1] - 1

    def one(query: Array, segment: Array, t: Array) -> _FootNumbers:
        points, own = _piece(
            control_points[segment], None if weights is None else weights[segment], degree, weights is not None
        )
        piece, point = Piece(points * scale, own), query * scale
        held, s = jax.lax.stop_gradient((is_held(point, piece, t), t))
        # Two steps carry the first two derivatives of the parameter.
        for _ in range(2):
            s = active.stationary(s, point, piece, held)
        return _FootNumbers(at_rest(_distance_at, (s, held), (point, piece)) / scale, jet(*piece, s).point / scale, s)

    batch = queries.shape[:-1]
    flat = (x.reshape(-1, *x.shape[len(batch) :]) for x in (queries, segment, t))
    return jax.tree_util.tree_map(lambda x: x.reshape(*batch, *x.shape[1:]), jax.vmap(one)(*flat))


def _distance_at(state: tuple[Array, Array], shapes: tuple[Array, Piece]) -> Array:
    """Return the distance of a point from a piece at a parameter, and whether the parameter is held."""
    (s, held), (point, piece) = state, shapes
    b = jet(*piece, s)
    c = point - b.point
    return c @ active.direction(c, b.first, held)


def _piece(points: Array, weights: Array | None, degree: int, rational: bool) -> Piece:
    """Return one segment, elevated to this degree."""
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
    # Sums keep the batch axis of vmap in front; a matrix product may move it, see jhd._distance.witness.active.
    return jnp.sum(raising[:, :, None] * rows, axis=1)


def _answer(
    frame: Frame, rows: tuple[_Touched, _Touched], w: Witness, known: WitnessState | None = None
) -> tuple[_Answer, Array]:
    """Return an answer by the active system of its witness, and whether it has derivatives."""
    pieces = _pieces(rows, w.direction == DIRECTIONS.b_to_a, frame)
    state = _state(pieces, w) if known is None else WitnessState(*_known_state(known[:2], pieces, w), *known[2:])
    y, two = state.y, state.two
    value = at_rest(_value, (y, state.pulls), pieces)
    point, feet = active.places(y, pieces)
    scale = frame.scale(point.dtype)
    # A single foot is given twice.
    feet, params = jnp.where(two, feet, feet[0]), jnp.where(two, y[1:], y[1])
    # At distance zero all derivatives are zero by convention; there they need not exist.
    apart = w.event != EVENTS.coincident
    return _Answer(value / scale, y[0], point / scale, feet / scale, params), apart


def _state(pieces: active.Pieces, w: Witness) -> WitnessState:
    """Return the state of a witness, from the numbers found."""
    start, still = jnp.append(w.t, w.feet_params), jax.lax.stop_gradient(pieces)
    _, _, _, held, two = active.active(*still, start, w.event, w.multipliers)
    y = active.solution(start, pieces, held, two)
    multipliers, units = active.balance(y, active.Active(*pieces, held, two), w.multipliers)
    return WitnessState(y, multipliers[:, None] * units, held, two)


@jax.custom_jvp
def _known_state(known: tuple[Array, Array], pieces: active.Pieces, w: Witness) -> tuple[Array, Array]:
    """Return known parameters and pulls, which move like the results of `_state`, computed only if needed."""
    return known


@_known_state.defjvp
def _(primals: Any, tangents: Any) -> Any:
    _, pieces, w = primals
    return _known_state(*primals), jax.jvp(lambda pieces: _state(pieces, w)[:2], (pieces,), (tangents[1],))[1]


def _value(state: tuple[Array, Array], pieces: active.Pieces) -> Array:
    """Return the distance at fixed parameters, multipliers and directions to the feet."""
    y, pulls = state
    point, feet = active.places(y, pieces)
    return jnp.sum(pulls * (point - feet))
