"""The conditions at a farthest place and its feet, for shapes of any two kinds, as functions of both shapes.

The place x_0 on a, the feet x_k on b, their multipliers m_k and s = h^2 / 2 are a stationary point of

    L = s + sum m_k (|p(x_0) - q_k(x_k)|^2 / 2 - s) - sum mu_j c_j(x_j)

with the points p and q_k of the coordinates x, and one constraint c_j = 0 for a place on an implicit surface (its
polynomial) or on a triangle (barycentric coordinates have the sum one). Coordinates at a border, an edge or a face of a
box that presses are held there. The derivative of the distance is that of the points at fixed x (the envelope theorem);
how x and m move follows from the conditions by implicit differentiation. This gives second and higher derivatives.

Source: Karush-Kuhn-Tucker conditions of the maximum of a minimum; sensitivity of their solutions: Fiacco, Introduction
to Sensitivity and Stability Analysis in Nonlinear Programming, Academic Press 1983, chapter 3.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jhd._results.solution import Witness
from jhd.arithmetic.polynomials import slopes
from jhd.arithmetic.rounding import like_double, smallest_normal
from jhd.arithmetic.scaling import common_exponent, length, scale_of
from jhd.distance.frame.following import MovingNumbers
from jhd.distance.frame.net_jets import Net, jet

# Singular values below this fraction of the largest are zero: no move along non-isolated places.
_FLAT = 1e-9
# A border presses if the slope towards it is at least this fraction of the length of the derivative.
_PRESSING = 1e-7
# Barycentric coordinates below this put a place on an edge.
_ON_EDGE = 1e-9
# Newton steps before the conditions are differentiated.
_STEPS = 2


class NetRows(NamedTuple):
    """Segments or patches, of which each has one set of control points, and of weights where there are any."""

    points: Any
    weights: Any

    @property
    def net(self) -> Net:
        """One piece, with one column if it is a piece of a curve."""
        if self.points.ndim == 3:
            return Net(self.points, self.weights)
        return Net(self.points[:, None], None if self.weights is None else self.weights[:, None])


class PointRows(NamedTuple):
    """Points of a set."""

    points: Any


class CornerRows(NamedTuple):
    """Corners of triangles."""

    corners: Any


class Polynomial(NamedTuple):
    """A polynomial surface."""

    coefficients: Any
    lower: Any
    upper: Any


# Those whose coordinates satisfy an equation.
Bound = Polynomial | CornerRows


class State(NamedTuple):
    """All unknowns: the place, its feet, and the multipliers.

    Args:
        x: coordinates (1 + feet, 3), the first row of the place: parameters, barycentric coordinates or those in space.
        multipliers: those of the feet.
        constraints: the multipliers of the constraints (1 + feet,).
        half_sq: half the squared distance.
    """

    x: Array
    multipliers: Array
    constraints: Array
    half_sq: Array


class _Fixed(NamedTuple):
    """Which coordinates are held, whether at the lower face of a box, and which feet count."""

    held: Array
    low: Array
    at: Array
    used: Array


def started(rows: tuple[Any, Any], t: tuple[Array, Array], at: tuple[Array, Array], m: Array, far: Array) -> State:
    """What a search found as unknowns.

    Args:
        rows: those of a and of b.
        t: parameters of the place and of the feet.
        at: their points.
        m: multipliers of the feet.
        far: the distance.
    """
    x = [_coordinates(*place) for place in zip(rows, (t[0][None], t[1]), (at[0][None], at[1]), strict=True)]
    half_sq = 0.5 * jnp.where(jnp.isfinite(far), far, 0.0) ** 2
    return State(jnp.concatenate(x), m, jnp.zeros(1 + m.size, m.dtype), half_sq)


def _coordinates(rows: Any, t: Array, at: Array) -> Array:
    """The three coordinates (places, 3) of places with parameters t at points."""
    if isinstance(rows, Polynomial):
        return at
    t = jnp.zeros((len(at), 0), at.dtype) if isinstance(rows, PointRows) else t.reshape(len(at), -1)
    return jnp.pad(t, ((0, 0), (0, 3 - t.shape[1])))


def moving_point(rows: Any, still: Any, x: Array) -> Array:
    """A point at fixed coordinates as a function of the rows that it depends on.

    On an implicit surface the point moves along the normal and with the faces of the box that hold it.

    Args:
        rows: the rows that move.
        still: the same rows; they tell the normal and the faces.
        x: the coordinates of the place.
    """
    if isinstance(rows, Polynomial):
        at_low, at_high = x <= still.lower, x >= still.upper
        moving = jnp.where(at_low, rows.lower, jnp.where(at_high, rows.upper, x))
        free = jnp.where(at_low | at_high, 0.0, slopes(still.coefficients, x)[1])
        square = jnp.sum(free**2)
        return moving - slopes(rows.coefficients, moving)[0] / jnp.where(square > 0, square, jnp.inf) * free
    return _point(rows, x)


def _point(rows: Any, x: Array) -> Array:
    if isinstance(rows, Polynomial):
        return x
    if isinstance(rows, CornerRows):
        return jnp.sum(x[:, None] * rows.corners, axis=0)
    if isinstance(rows, PointRows):
        return rows.points[0]
    net = rows.net
    return jet(net, x[: net.parameters]).point


def _constraint(rows: Any, x: Array) -> Array:
    if isinstance(rows, Polynomial):
        value, gradient = slopes(rows.coefficients, x)
        steep = jax.lax.stop_gradient(length(gradient))
        return value / jnp.where(steep > 0, steep, 1.0)
    return jnp.sum(x) - 1 if isinstance(rows, CornerRows) else jnp.zeros((), x.dtype)


def at_places(function: Callable[..., Any], x: Array, *rows: tuple[Any, Any]) -> Any:
    """A function of rows and coordinates at the place and at each foot, stacked.

    Args:
        function: takes the rows of one place, as often as `rows` are given, and its coordinates.
        x: the coordinates of all places.
        rows: those of a, and those of b with one row a foot; an implicit surface has one for all.
    """
    (carriers, targets), first = zip(*rows, strict=True), x[0]
    axes = [None if isinstance(target, Polynomial) else 0 for target in targets]
    feet = jax.vmap(function, in_axes=(*axes, 0))(*targets, x[1:])
    return jax.tree_util.tree_map(lambda y, z: jnp.concatenate([y[None], z]), function(*carriers, first), feet)


def _scaled_distance(start: State, rows: tuple[Any, Any], found: Array) -> Array:
    """The distance as a function of the rows, in a unit in which squares of lengths are numbers.

    Implicit surfaces keep their unit: their coefficients hang on it.
    """
    if any(isinstance(part, Polynomial) for part in rows):
        return distance(balance(start, rows, True), rows, rows)
    size = jnp.maximum(
        jnp.max(jnp.abs(jax.lax.stop_gradient(rows[0][0]))), jnp.abs(jnp.where(jnp.isfinite(found), found, 0.0))
    )
    scale = scale_of(common_exponent(size), size.dtype)
    scaled = tuple(part._replace(**{part._fields[0]: part[0] * scale}) for part in rows)
    start = start._replace(half_sq=0.5 * (jnp.where(jnp.isfinite(found), found, 0.0) * scale) ** 2)
    return distance(balance(start, scaled, True), scaled, scaled) / scale


def from_place(rows: tuple[Any, Any], constants: tuple[Array, Witness]) -> MovingNumbers:
    """Value, point and feet of a directed distance with its witness as functions of the rows of both shapes."""
    found, w = constants
    # Where nothing is proven there is no place; its derivatives are not used, but they must be numbers.
    point, feet, t, params, multipliers = (
        jnp.where(jnp.isfinite(x), x, 0.0) for x in (w.point, w.feet, w.t, w.foot_params, w.multipliers)
    )
    start = started(rows, (t, params), (point, feet), multipliers, found)
    value = _scaled_distance(start, rows, found)
    moving = at_places(moving_point, start.x, rows, jax.lax.stop_gradient(rows))
    return MovingNumbers(
        {"value": value, "point": moving[0], "feet": moving[1:]}, {"value": found > 0, "point": True, "feet": True}
    )


@jax.custom_jvp
def distance(state: State, rows: tuple[Any, Any], still: tuple[Any, Any]) -> Array:
    """The sum of the distances to the feet, weighted by the multipliers, at fixed coordinates as the rows move.

    Args:
        state: the coordinates and the multipliers, from `balance`.
        rows: the rows of a and of b that move.
        still: the same rows; they tell the directions to the feet, and are differentiated from the second order on.
    """
    return _distance(state, rows, still)


def _distance(state: State, rows: tuple[Any, Any], still: tuple[Any, Any]) -> Array:
    at = at_places(_point, state.x, still)
    moving = at_places(moving_point, state.x, rows, still)
    apart = at[0] - at[1:]
    far = length(apart)[:, None]
    unit = apart / jnp.where(far > 0, far, 1.0)
    return jnp.sum(state.multipliers[:, None] * unit * (moving[0] - moving[1:]))


@distance.defjvp
def _distance_rule(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    state, rows, still = primals
    return jax.jvp(lambda moving: _distance(state, moving, still), (rows,), (tangents[1],))


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def balance(start: State, rows: tuple[Any, Any], farthest: bool) -> State:
    """The solution of the conditions next to the start, as a function of the rows; its value is the start.

    Args:
        start: the coordinates and multipliers found; those of the constraints are not needed.
        rows: the rows of a and of b.
        farthest: whether the place on a is the farthest one, or the nearest.
    """
    return start


@balance.defjvp
def _balance_rule(farthest: bool, primals: tuple, tangents: tuple) -> tuple[State, State]:
    start, rows = primals
    state, constant = jax.lax.stop_gradient((start, rows))
    fixed = _fixed(state, constant, farthest)
    state = _with_multipliers(state, constant, fixed)
    for _ in range(_STEPS):
        step = _solved(state, constant, fixed, _conditions(state, constant, fixed))
        state = jax.tree_util.tree_map(jnp.subtract, state, step)
    state = balance(state, rows, farthest)
    _, change = jax.jvp(lambda moving: _conditions(state, moving, fixed), (rows,), (tangents[1],))
    return balance(start, rows, farthest), jax.tree_util.tree_map(jnp.negative, _solved(state, rows, fixed, change))


def _lagrangian(state: State, rows: tuple[Any, Any], used: Array) -> Array:
    points = at_places(_point, state.x, rows)
    apart_sq = jnp.sum((points[0] - points[1:]) ** 2, axis=-1)
    constraints = at_places(_constraint, state.x, rows)
    gaps = jnp.where(used, state.multipliers * (0.5 * apart_sq - state.half_sq), 0.0)
    return state.half_sq + jnp.sum(gaps) - jnp.sum(state.constraints * constraints)


def _conditions(state: State, rows: tuple[Any, Any], fixed: _Fixed) -> State:
    """What is left of each condition."""
    left = jax.grad(_lagrangian)(state, rows, fixed.used)
    walls = [
        jnp.where(low, part.lower, part.upper) if isinstance(part, Polynomial) else at
        for part, low, at in ((rows[0], fixed.low[0], fixed.at[0]), (rows[1], fixed.low[1:], fixed.at[1:]))
    ]
    bound = jnp.append(isinstance(rows[0], Bound), fixed.used & isinstance(rows[1], Bound))
    return State(
        jnp.where(fixed.held, state.x - jnp.concatenate([walls[0][None], walls[1]]), left.x),
        jnp.where(fixed.used, left.multipliers, state.multipliers),
        jnp.where(bound, left.constraints, state.constraints),
        left.half_sq,
    )


def _fixed(state: State, rows: tuple[Any, Any], farthest: bool) -> _Fixed:
    """What is held: coordinates at a border that presses, those that a place does not have, and feet without weight."""
    used = state.multipliers > 0
    pulls = jax.grad(_lagrangian)(state._replace(constraints=jnp.zeros_like(state.constraints)), rows, used).x
    # Downhill is uphill at the place that is farthest.
    pulls = pulls.at[0].set(-pulls[0] if farthest else pulls[0])
    far = jnp.sqrt(2 * state.half_sq)
    both = jnp.stack([state.x, pulls], axis=1)
    held, low = at_places(lambda part, pair: _held(part, pair[0], pair[1], far), both, rows)
    return _Fixed(held.at[1:].set(held[1:] | ~used[:, None]), low, state.x, used)


def _held(rows: Any, x: Array, pull: Array, far: Array) -> tuple[Array, Array]:
    """Which coordinates of a place are held, and which at their lower border; the pull is the slope."""
    if isinstance(rows, Polynomial):
        return (x <= rows.lower) | (x >= rows.upper), x <= rows.lower
    if isinstance(rows, PointRows):
        return jnp.ones(3, bool), jnp.ones(3, bool)
    if isinstance(rows, CornerRows):
        inside = x > _ON_EDGE
        pull = pull - jnp.sum(jnp.where(inside, pull, 0.0)) / jnp.maximum(jnp.sum(inside), 1)
        size = jnp.max(length(rows.corners - _point(rows, x)))
        return ~inside & (pull > _PRESSING * far * size), ~inside
    net = rows.net
    n = net.parameters
    size = far * length(jet(net, x[:n]).first)
    size = jnp.concatenate([size, jnp.zeros(3 - n, x.dtype)])
    presses = (x <= 0) & (pull > _PRESSING * size) | (x >= 1) & (pull < -_PRESSING * size)
    return presses | (jnp.arange(3) >= n), x <= 0


def _with_multipliers(state: State, rows: tuple[Any, Any], fixed: _Fixed) -> State:
    """The state with the multipliers of the constraints that fit best."""
    state = state._replace(constraints=jnp.zeros_like(state.constraints))
    pulls = jax.grad(_lagrangian)(state, rows, fixed.used).x
    normals = at_places(jax.grad(_constraint, 1), state.x, rows)
    free = jnp.where(fixed.held, 0.0, normals)
    square = jnp.sum(free**2, axis=-1)
    return state._replace(constraints=jnp.sum(free * pulls, axis=-1) / jnp.where(square > 0, square, 1.0))


def _solved(state: State, rows: tuple[Any, Any], fixed: _Fixed, right: State) -> State:
    """The solution of the linearized conditions, of least norm where they are singular."""
    flat, form = ravel_pytree(state)
    matrix = jax.jacfwd(lambda x: ravel_pytree(_conditions(form(x), rows, fixed))[0])(flat)
    still = jax.lax.stop_gradient(matrix)
    by_row = 1 / jnp.maximum(jnp.max(jnp.abs(still), axis=1), smallest_normal(still.dtype))
    by_column = 1 / jnp.maximum(jnp.max(jnp.abs(still * by_row[:, None]), axis=0), smallest_normal(still.dtype))
    scaled = matrix * by_row[:, None] * by_column
    inverse = jnp.linalg.pinv(scaled, rtol=like_double(_FLAT, flat.dtype))
    return form(by_column * (inverse @ (by_row * ravel_pytree(right)[0])))
