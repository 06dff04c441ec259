"""The conditions at a farthest point and its feet, for shapes of any two kinds, as functions of both shapes.

The farthest point x_0 on a, the feet x_k on b, their multipliers m_k and s = h^2 / 2 are a stationary point of

    L = s + sum m_k (|p(x_0) - q_k(x_k)|^2 / 2 - s) - sum mu_j c_j(x_j)

with the points p and q_k of the coordinates x, and one constraint c_j = 0 for a point on an implicit surface (its
polynomial) or on a triangle (barycentric coordinates have the sum one). Coordinates at a border, an edge or a face of a
box that presses are held there. The derivative of the distance is taken at fixed x (the envelope theorem). Implicit
differentiation of the conditions gives the derivatives of x and m, and so second and higher derivatives.

The direction from a foot to the farthest point is the difference of both points. On an implicit surface it is the
normal if rounding turns the normal less. At distance zero derivatives are zero by convention.

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

from jhd._arithmetic.polynomials import slopes
from jhd._arithmetic.rounding import like_double, smallest_normal, unit_roundoff
from jhd._arithmetic.scaling import common_exponent, length, scale_of, unit
from jhd._distance.normalization.implicit_derivatives import MovingNumbers
from jhd._distance.witness.rows import NOISE
from jhd._results.solution import MinimumSolution, Witness
from jhd._runtime.arrays import varying

# Singular values below this fraction of the largest are zero: non-isolated maximizers do not move along themselves.
_FLAT = 1e-10


class _State(NamedTuple):
    """All unknowns: coordinates of the farthest point and its feet, and the multipliers."""

    x: Array  # coordinates (1 + feet, 3), the farthest point first: parameters, barycentric coordinates or position
    multipliers: Array  # the multipliers of the feet
    constraints: Array  # the multipliers of the constraints (1 + feet,)
    half_sq: Array  # half the squared distance


class _Fixed(NamedTuple):
    """Data that stay constant while the conditions are solved."""

    held: Array  # mask of the coordinates (1 + feet, 3) that a border holds, or that a point does not have
    low: Array  # mask of the coordinates at the lower border
    at: Array  # initial coordinates
    used: Array  # mask of the feet that count
    along: Array  # mask of the feet whose normals give the directions


def _at_places(function: Callable[..., Any], x: Any, *rows: tuple[Any, Any]) -> Any:
    """Apply a function of rows and coordinates to the farthest point and to each foot, and stack the results.

    Args:
        function: takes the rows of one point, one argument for each of `rows`, and its coordinates.
        x: the coordinates of all points, and further arrays with a row for each.
        rows: the rows of a, and the rows of b with one row a foot; an implicit surface has one for all.
    """
    carriers, targets = zip(*rows, strict=True)
    first, others = (jax.tree_util.tree_map(lambda y, k=k: y[k], x) for k in (0, slice(1, None)))
    axes = [None if target.has_normals else 0 for target in targets]
    feet = jax.vmap(function, in_axes=(*axes, 0))(*targets, others)
    return jax.tree_util.tree_map(lambda y, z: jnp.concatenate([y[None], z]), function(*carriers, first), feet)


def from_place(rows: tuple[Any, Any], constants: tuple[Array, Witness]) -> MovingNumbers:
    """Return value, point and feet of a directed distance as functions of the rows of both shapes.

    The point and the feet move with the shapes at fixed coordinates.
    """
    rows, (found, w) = finite((rows, constants))
    scale, rows = in_one_unit(rows, found)
    points = scale * w.point[None], scale * w.feet
    start = _started(rows, (w.t[None], w.feet_params), points, w.multipliers, found * scale)
    fixed = _fixed(*jax.lax.stop_gradient((start, rows)), True)
    moving = _moving(start, fixed, rows, jax.lax.stop_gradient(rows))
    numbers = {"value": _distance(start, rows, fixed) / scale, "point": moving[0] / scale, "feet": moving[1:] / scale}
    return MovingNumbers(numbers, {"value": found > 0, "point": True, "feet": True})


def from_pair(rows: tuple[Any, Any], constants: tuple[MinimumSolution, Array, Array]) -> MovingNumbers:
    """Return the value of a minimum distance as a function of the rows of both shapes.

    Args:
        rows: the rows of a and of b.
        constants: the solution, the coordinates of both points one after the other, and the distance in a unit in
            which both shapes have about the size one.
    """
    rows, (solution, x, distance) = finite((rows, constants))
    n = 3 if rows[0].has_normals else x.size - 3
    rows = rows[0], rows[1] if rows[1].has_normals else jax.tree_util.tree_map(lambda y: y[None], rows[1])
    scale, rows = in_one_unit(rows, solution.value)
    points = scale * solution.point_a[None], scale * solution.point_b[None]
    start = _started(rows, (x[None, :n], x[None, n:]), points, jnp.ones(1, x.dtype), solution.value * scale)
    fixed = _fixed(*jax.lax.stop_gradient((start, rows)), False)
    return MovingNumbers({"value": _distance(start, rows, fixed) / scale}, apart(solution, distance))


def finite(found: Any) -> Any:
    """Return the arrays with zeros in place of numbers that are not finite, which mark missing results.

    Derivatives of missing results are not used, but zeros are propagated through them: they must be numbers.
    """
    return jax.tree_util.tree_map(lambda x: jnp.where(jnp.isfinite(x), x, 0), found)


def apart(solution: MinimumSolution, distance: Array) -> Array:
    """Return whether the shapes are proven to be apart, or their nearest points by more than rounding.

    Otherwise the direction from one point to the other is noise, and derivatives are zero, as for shapes that meet.

    Args:
        solution: the distance with its bounds.
        distance: its value in common coordinates, in which both shapes have about the size one.
    """
    told = (solution.lower > 0) | (distance > NOISE * unit_roundoff(solution.value.dtype))
    return told & (solution.value > 0)


def _started(rows: tuple[Any, Any], t: tuple[Array, Array], at: tuple[Array, Array], m: Array, far: Array) -> _State:
    """Return the unknowns found by a search, from parameters, points (points, ...), multipliers and the distance."""
    params = [jnp.pad(x.reshape(len(x), -1), ((0, 0), (0, 3 - x[0].size))) for x in t]
    x = jnp.concatenate([y if part.has_normals else x for part, x, y in zip(rows, params, at, strict=True)])
    return _State(x, m, jnp.zeros(1 + m.size, m.dtype), 0.5 * far**2)


def in_one_unit(rows: tuple[Any, Any], far: Array) -> tuple[Array, tuple[Any, Any]]:
    """Return a power of two, and the rows in a unit in which lengths are at most about one.

    Unknowns differ by powers of the size of the shapes: lengths, their squares and parameters. Dividing the rows and
    then the columns of the linearized conditions by their largest entries does not undo this if the size is large.

    Control points count from a point of a. Implicit surfaces keep the origin: their coefficients depend on it.
    """
    still = jax.lax.stop_gradient(rows)
    boxes = [part.upper - part.lower for part in still if part.has_normals]
    origin = jnp.zeros(3, far.dtype) if boxes else still[0].points.reshape(-1, still[0].points.shape[-1])[0]
    scale = scale_of(common_exponent(*(boxes or [still[0].points - origin]), far), far.dtype)
    return scale, tuple(part.in_unit(origin, scale) for part in rows)


@jax.custom_jvp
def _distance(start: _State, rows: tuple[Any, Any], fixed: _Fixed) -> Array:
    """Return the sum of the distances to the feet, weighted by the multipliers, as a function of the rows.

    The derivative of the state matters from the second order on, and is not computed before.
    """
    return _pulled(start, rows, fixed, rows)


@_distance.defjvp
def _distance_rule(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    start, rows, fixed = primals
    balanced = _balance(start, rows, fixed)
    return _distance(*primals), jax.jvp(partial(_pulled, balanced, rows, fixed), (rows,), (tangents[1],))[1]


def _pulled(state: _State, still: tuple[Any, Any], fixed: _Fixed, rows: tuple[Any, Any]) -> Array:
    moving = _moving(state, fixed, rows, still)
    return jnp.sum(state.multipliers[:, None] * _directions(state, still, fixed.along) * (moving[0] - moving[1:]))


def _moving(state: _State, fixed: _Fixed, rows: tuple[Any, Any], still: tuple[Any, Any]) -> Array:
    """Return the points as functions of the rows, at fixed coordinates."""

    def moved(part: Any, still: Any, place: tuple[Array, Array, Array]) -> Array:
        return part.moving_point(still, *place) if part.has_normals else part.point(place[0])

    return _at_places(moved, (state.x, fixed.held, fixed.low), rows, still)


def _directions(state: _State, rows: tuple[Any, Any], along: Array) -> Array:
    """Return the unit vectors from the feet to the farthest point; normals for the feet in `along`."""
    points = _at_places(lambda part, x: part.point(x), state.x, rows)
    apart = points[0] - points[1:]
    if not rows[1].has_normals:
        return unit(apart)
    gradients = jax.vmap(lambda x: slopes(rows[1].coefficients, x)[1])(state.x[1:])
    turned = jnp.sum(gradients * apart, axis=-1) < 0
    normals = jnp.where(turned[:, None], -gradients, gradients) / jnp.where(along, length(gradients), 1.0)[:, None]
    return jnp.where(along[:, None], normals, unit(apart))


@jax.custom_jvp
def _balance(start: _State, rows: tuple[Any, Any], fixed: _Fixed) -> _State:
    """Return the solution of the conditions next to the start, as a function of the rows; its value is the start.

    The multipliers of the constraints of the start are not needed.
    """
    return start


@_balance.defjvp
def _balance_rule(primals: tuple, tangents: tuple) -> tuple[_State, _State]:
    start, rows, fixed = primals
    state, constant = jax.lax.stop_gradient((start, rows))
    rounding = _at_places(lambda part, x: part.rounding(x), state.x, constant)

    def newton(_: Any, state: _State) -> _State:
        left = _conditions(state, constant, fixed)
        known = jnp.abs(left.constraints) > rounding
        step = _solved(state, constant, fixed, left._replace(constraints=jnp.where(known, left.constraints, 0.0)))
        return jax.tree_util.tree_map(jnp.subtract, state, step)

    state = _with_multipliers(state, constant, fixed)
    # The search has solved the conditions of two implicit surfaces already.
    if not all(part.has_normals for part in rows):
        # Newton steps before the conditions are differentiated.
        state = jax.lax.fori_loop(0, 2, newton, varying(state, constant, fixed))
    state = _balance(state, rows, fixed)
    _, change = jax.jvp(lambda moving: _conditions(state, moving, fixed), (rows,), (tangents[1],))
    return _balance(start, rows, fixed), jax.tree_util.tree_map(jnp.negative, _solved(state, rows, fixed, change))


def _free_lagrangian(state: _State, rows: tuple[Any, Any], used: Array) -> Array:
    """Return the Lagrange function without constraints."""
    points = _at_places(lambda part, x: part.point(x), state.x, rows)
    apart_sq = jnp.sum((points[0] - points[1:]) ** 2, axis=-1)
    return state.half_sq + jnp.sum(jnp.where(used, state.multipliers * (0.5 * apart_sq - state.half_sq), 0.0))


def _slopes(state: _State, rows: tuple[Any, Any], fixed: _Fixed) -> tuple[_State, Array]:
    """Return the derivatives of the Lagrange function, and the gradients of the constraints.

    At the farthest point they are derivatives of distances, not of squares, to implicit surfaces. If the surfaces are
    close, the normals at the feet determine how the point moves, while the vectors to it are too inexact.
    """
    left, x = jax.grad(_free_lagrangian)(state, rows, fixed.used), state.x
    values, normals = _at_places(lambda part, x: part.constraint(x), x, rows)
    pulls = left.x
    if rows[1].has_normals:
        weights = jnp.where(fixed.used, state.multipliers, 0.0)[:, None]
        combined = jnp.sum(weights * _directions(state, rows, fixed.along), axis=0)
        pulls = pulls.at[0].set(jax.grad(lambda x: jnp.sum(combined * rows[0].point(x)))(x[0]))
    return left._replace(x=pulls - state.constraints[:, None] * normals, constraints=-values), normals


def _conditions(state: _State, rows: tuple[Any, Any], fixed: _Fixed) -> _State:
    """Return the residual of each condition."""
    left, (held, low, at, used, _) = _slopes(state, rows, fixed)[0], fixed
    wall = lambda part, x: jnp.where(x[0], part.lower, part.upper) if part.has_normals else x[1]  # noqa: E731
    counts = jnp.append(True, used)
    # At a corner of a box no coordinate is left to satisfy an equation.
    bound = jnp.append(rows[0].has_constraint, used & rows[1].has_constraint) & ~jnp.all(held, axis=-1)
    x = jnp.where(held, state.x - _at_places(wall, (low, at), rows), left.x)
    return _State(
        jnp.where(counts[:, None], x, state.x - at),
        jnp.where(used, left.multipliers, state.multipliers),
        jnp.where(bound, left.constraints, state.constraints),
        left.half_sq,
    )


def _fixed(state: _State, rows: tuple[Any, Any], farthest: bool) -> _Fixed:
    """Return the coordinates held by borders or missing, and the feet that count."""
    used = state.multipliers > 0
    pulls = jax.grad(_free_lagrangian)(state, rows, used).x
    # The farthest point is a maximum, so its slope is reversed.
    pulls = pulls.at[0].set(-pulls[0] if farthest else pulls[0])
    far = jnp.sqrt(2 * state.half_sq) * jnp.append(1.0, state.multipliers)
    held, low = _at_places(lambda part, place: part.held(*place), (state.x, pulls, far), rows)
    along = jnp.zeros_like(used)
    if rows[1].has_normals:
        along = jax.vmap(partial(rows[1].is_along_normal, place=rows[0].point(state.x[0])))(state.x[1:])
    return _Fixed(held, low, state.x, used, along & ~jnp.any(held[1:], axis=-1))


def _with_multipliers(state: _State, rows: tuple[Any, Any], fixed: _Fixed) -> _State:
    """Return the state with the multipliers of the constraints that fit best."""
    left, normals = _slopes(state._replace(constraints=jnp.zeros_like(state.constraints)), rows, fixed)
    free = jnp.where(fixed.held, 0.0, normals)
    square = jnp.sum(free**2, axis=-1)
    return state._replace(constraints=jnp.sum(free * left.x, axis=-1) / jnp.where(square > 0, square, 1.0))


def _solved(state: _State, rows: tuple[Any, Any], fixed: _Fixed, right: _State) -> _State:
    """Return the solution of the linearized conditions, of least norm if they are singular."""
    flat, form = ravel_pytree(state)
    matrix = jax.jacfwd(lambda x: ravel_pytree(_conditions(form(x), rows, fixed))[0])(flat)
    still = jax.lax.stop_gradient(matrix)
    by_row = 1 / jnp.maximum(jnp.max(jnp.abs(still), axis=1), smallest_normal(still.dtype))
    by_column = 1 / jnp.maximum(jnp.max(jnp.abs(still * by_row[:, None]), axis=0), smallest_normal(still.dtype))
    scaled = matrix * by_row[:, None] * by_column
    inverse = jnp.linalg.pinv(scaled, rtol=like_double(_FLAT, flat.dtype))
    return form(by_column * (inverse @ (by_row * ravel_pytree(right)[0])))
