"""Parametric shapes in lower bounds by feet that move with the point (jhd._distance.cells.tracked_feet).

Over a cell of a parametric shape its point is a polynomial of degree 7, up to a rest of the eighth order
(jhd._arithmetic.truncated). With feet on such a shape b, let P(u) be the moving point and Q(u) polynomials for the
parameters, approximately through the feet of some points. If the second derivatives of |P(u) - b(x)|^2 in x are at
least 2 diag(k) > 0 for all u of the cell and all x of a box E that holds the cell of b and Q, the squared distance is
bounded as in jhd._distance.cells.tracked_feet_minimum, with

    L(u, x) = |P(u) - b(x)|^2,   R = -2 (P(u) - b(Q)).b_x(Q).

The second derivatives are enclosed by polynomials of a lower degree: this takes a fifth of the time of degree 7.

Feet are followed beyond the cell of b, and beyond its piece, by about the size of the cell of a, so nothing has to be
cut at joints of smooth shapes.

Rounding: x is counted from -1 to 1 over E, whose ends are floats, and Q is its floating-point coefficients there. A
part between parameters beyond [0, 1] has control points that are sums of the given ones with factors of absolute sum at
most G, so its errors are G times those of jhd._distance.normalization.net_jets; on rational pieces these are errors of
numerators and weights, and `_part` gives the errors of points. A polynomial of degree n in Bernstein form with errors e
is off by e, its first derivative in x by n e, its second one by n^2 e. In single precision these errors are too large
for most second derivatives, so few bounds are of use.

Source: ours.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.balls import Ball, factors, plus, semidefinite
from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import length
from jhd._arithmetic.trivariate import power_conversion
from jhd._arithmetic.truncated import (
    DEGREE,
    EXPONENTS,
    Truncated,
    composed,
    derivative,
    dot,
    extremes,
    product,
    reciprocal,
    scaled,
    summed,
)
from jhd._arithmetic.truncated import plus as added
from jhd._distance.cells.foot_maps import foot_between, stepped
from jhd._distance.cells.graphs import at_nodes, fitted
from jhd._distance.cells.implicit import between
from jhd._distance.cells.tracked_feet_minimum import MovingPoint, MovingSquare, least, least_of_rest, less
from jhd._distance.normalization.net_jets import Net, eta, jet, part_of

# Newton steps for the foot of the middle, and from there for the feet of the nodes.
_FIRST, _STEPS = 4, 3
# How far feet are followed beyond a cell, in sizes of the cell of a: they move faster than a if a lies between b and
# its centers of curvature. And how far beyond a piece, at most.
_FARTHER, _BEYOND = 4.0, 0.25
# The degree at which enclosures of second derivatives are truncated. With 3, convexity is proven for fewer cells; with
# DEGREE, for as many as with 4, in five times the time.
_ROUGH = 4
# Fractions of |b_x|^2 that are tried as lower bounds of the second derivatives.
_MODULI = (0.5, 0.1, 0.01)
# The values of all terms at the corners of the square.
_AT_CORNERS = np.array([[float(s**i * t**j) for i, j in EXPONENTS] for s in (-1, 1) for t in (-1, 1)])


class _PartWithErrors(NamedTuple):
    """A part of a piece, bounds of the errors of its points, and bounds of the relative errors of its weights."""

    net: Net
    error: Array
    relative: Array


class _Powers(NamedTuple):
    """Rows (i, j, width) of powers of two numbers in [-1, 1], points about a center or homogeneous ones, and errors."""

    rows: Array
    error: Array
    center: Array


def points_of_net(piece: Net, low: Array, high: Array) -> MovingPoint:
    """Return the points of a part of a piece, as polynomials."""
    powers, n = _powers(_part(piece, low, high)), piece.parameters
    point = _quotients(_direct(_derivatives(powers, n, 0)), piece.weights is not None, n).point
    point = _shifted(point, powers.center)
    return MovingPoint(point, jnp.zeros_like(point.rest[0]), jnp.zeros(n, point.rest.dtype))


def square_to_net(piece: Net, point: Truncated, low: Array, high: Array, start: Array) -> MovingSquare:
    """Lower bound of the squared distance of moving points from a point, or from a piece between parameters."""
    m, dtype, rational = piece.parameters, low.dtype, piece.weights is not None
    if piece.degrees == (0, 0):
        apart = _shifted(point, -piece.points[0, 0])
        return MovingSquare(least(dot(apart, apart)), jnp.asarray(True))
    q = _feet(piece, point.terms, low, high, start)
    begin, end = _box(q, low, high)
    half = 0.5 * (end - begin)
    q = q.at[0].add(-0.5 * (begin + end)) / half
    inside = jnp.all(jnp.sum(jnp.abs(q), axis=0) * (1 + gamma(64, dtype)) <= 1)
    of_b = _derivatives(_powers(_part(piece, begin, end)), m, 2)
    there = _quotients(_along(of_b, q), rational, m)
    over = _quotients(_direct(of_b, _ROUGH), rational, m)
    point = _shifted(point, -of_b.center)
    bent = _convexity(point, over, jnp.sum(there.first.terms[0] ** 2, axis=0))
    apart = less(point, there.point)
    square = least(dot(apart, apart))
    apart = Truncated(apart.terms[:, :, None], apart.rest[:, None])
    rest = scaled(dot(apart, there.first), -2.0)
    # The location of the cell of b in E; E is large enough that the subtractions lose little.
    ends = [(x - begin) / half - 1 for x in (low, high)]
    size, slack = jnp.sum(jnp.abs(q), axis=0) - jnp.abs(q[0]), gamma(64, dtype) * jnp.ones_like(half)
    taken = least_of_rest(
        rest, jnp.where(bent > 0, bent, 1.0), ends[0] - q[0] - size - slack, ends[1] - q[0] + size + slack
    )
    taken = jnp.sum(taken - gamma(8, dtype) * jnp.abs(taken))
    lower = square + taken - gamma(4, dtype) * (jnp.abs(square) + jnp.abs(taken))
    return MovingSquare(lower, jnp.all(bent > 0) & inside)


def square_seems_convex(piece: Net, point: Truncated, low: Array, high: Array, start: Array) -> Array:
    """Return whether |P - b(x)|^2 is convex at the corners of E for the corners P of a cell of a.

    If not, its convexity is not tried. Nothing is proven by that: it decides which bounds are computed.
    """
    if piece.degrees == (0, 0):
        return jnp.asarray(True)
    places = jnp.tensordot(_AT_CORNERS.astype(low.dtype), point.terms, 1, precision="highest")
    feet = _near_feet(piece, places, point.terms, low, high, start)
    low, high = jnp.minimum(low, jnp.min(feet, axis=0)), jnp.maximum(high, jnp.max(feet, axis=0))
    ends = np.stack(np.meshgrid(*[[0.0, 1.0]] * piece.parameters, indexing="ij"), axis=-1).reshape(-1, piece.parameters)

    def at(share: Array) -> Array:
        found = jet(piece, low + share * (high - low))
        square = jnp.sum(found.first[:, None] * found.first, -1)
        apart = found.point - places
        bent = square + jnp.sum(found.second * apart[:, None, None], -1)
        return jnp.all(jax.vmap(lambda h: factors(h)[1])(bent) > 0)

    return jnp.all(jax.vmap(at)(jnp.asarray(ends, low.dtype)))


def _feet(piece: Net, terms: Array, low: Array, high: Array, start: Array) -> Array:
    """Coefficients (terms, parameters of b) of polynomials through approximate feet of the nodes of a cell of a."""
    return fitted(_near_feet(piece, at_nodes(terms), terms, low, high, start))


def _near_feet(piece: Net, places: Array, terms: Array, low: Array, high: Array, start: Array) -> Array:
    """Parameters of approximate feet of places on a cell of a with these coefficients, near a cell of b."""
    extent = 2 * length(jnp.sum(jnp.abs(terms[1:]), axis=0))
    rate = jax.vmap(length)(jet(piece, start).first)
    margin = jnp.minimum(_FARTHER * extent / jnp.where(rate > 0, rate, jnp.inf), _BEYOND)
    low, high = jnp.maximum(low - margin, -_BEYOND), jnp.minimum(high + margin, 1 + _BEYOND)
    middle = foot_between(piece, terms[0], jnp.clip(start, low, high), _FIRST, low, high)
    at = jet(piece, middle)

    def foot(place: Array) -> Array:
        # The first step is the same for all but the place.
        return foot_between(piece, place, stepped(at, place, middle, low, high), _STEPS - 1, low, high)

    return jax.vmap(foot)(places)


def _box(q: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the ends of E, with room for roundings."""
    room = math.sqrt(float(jnp.finfo(q.dtype).eps))
    reach = jnp.sum(jnp.abs(q[1:]), axis=0)
    low, high = jnp.minimum(low, q[0] - reach), jnp.maximum(high, q[0] + reach)
    room = room * (high - low) + 64 * jnp.finfo(q.dtype).eps * (1 + jnp.abs(low) + jnp.abs(high))
    return low - room, high + room


def _part(piece: Net, low: Array, high: Array) -> _PartWithErrors:
    """Return the part of one piece between parameters that may lie beyond [0, 1], and its errors."""
    part = part_of(piece, low, high)
    sizes = jnp.maximum(jnp.abs(low) + jnp.abs(1 - low), jnp.abs(high) + jnp.abs(1 - high))
    growth = jnp.prod(jnp.maximum(sizes, 1.0) ** np.array(piece.degrees[: piece.parameters])) * (1 + 1e-3)
    error = eta(piece) * growth
    if part.weights is None:
        return _PartWithErrors(part, error, jnp.zeros_like(error))
    # A weight w of more than 2 e, with an error of at most e, has a relative error of e / w, and of twice that relative
    # to the true weight; points are off by e (1 + |x|) over the true weight, and by the rounding of the division.
    lightest = jnp.min(part.weights)
    good, most = lightest > 4 * error, jnp.maximum(jnp.max(jnp.abs(part.points)), 1.0)
    safe = jnp.where(good, lightest, 1.0)
    found = 5 * error * most / safe, 2 * error / safe
    return _PartWithErrors(part, *(jnp.where(good, x, jnp.inf) for x in found))


def _powers(part: _PartWithErrors) -> _Powers:
    """Return a part in powers of its parameters, which run from -1 to 1."""
    points, weights = part.net
    dtype, error = points.dtype, jnp.broadcast_to(part.error, points.shape[-1:])
    center = 0.5 * (jnp.min(points, axis=(0, 1)) + jnp.max(points, axis=(0, 1)))
    rows = points - center
    if weights is not None:
        most = jnp.max(weights)
        rows = jnp.concatenate([rows * weights[..., None], weights[..., None]], axis=-1)
        error = jnp.append(4 * error * most, part.relative * most)
    sizes = jnp.abs(rows)
    for axis in range(part.net.parameters):
        matrix = jnp.asarray(power_conversion(rows.shape[axis] - 1), dtype)
        rows, sizes = (_applied(x, y, axis) for x, y in ((matrix, rows), (jnp.abs(matrix), sizes)))
    loose = gamma(2 * sum(part.net.degrees) + 12, dtype) * jnp.sum(sizes, axis=(0, 1))
    return _Powers(rows, (error + loose) * (1 + 1e-3), center)


def _applied(matrix: Array, rows: Array, axis: int) -> Array:
    moved = jnp.moveaxis(rows, axis, 0)
    return jnp.moveaxis(jnp.sum(matrix.reshape(*matrix.shape, *[1] * (rows.ndim - 1)) * moved, axis=1), 0, axis)


def _direct(powers: _Powers, degree: int = DEGREE) -> Truncated:
    """Return the powers as polynomials of both numbers, or of the first one, truncated at a degree."""
    rows = powers.rows
    shape, dtype, zero = rows.shape[:2], rows.dtype, jnp.zeros_like(rows[0, 0])
    within = [rows[i, j] if i < shape[0] and j < shape[1] else zero for i, j in EXPONENTS if i + j <= degree]
    beyond = (np.sum(np.indices(shape), axis=0) > degree).reshape(*shape, *[1] * (rows.ndim - 2))
    rest = jnp.sum(jnp.abs(rows) * beyond, axis=(0, 1)) * (1 + gamma(rows.size, dtype))
    return Truncated(jnp.stack(within), (rest + powers.error) * (1 + gamma(4, dtype)))


def _shifted(point: Truncated, by: Array) -> Truncated:
    """Points plus a vector."""
    rest = point.rest + gamma(4, by.dtype) * (jnp.abs(point.terms[0]) + jnp.abs(by) + point.rest)
    return Truncated(point.terms.at[0].add(by), rest)


class _Moved(NamedTuple):
    """Points of b at moving parameters, relative to the center of its part, and derivatives."""

    point: Truncated  # (terms, 3)
    first: Truncated  # (terms, 3, n)
    second: Truncated  # (terms, 3, n n), or empty


def _derivatives(powers: _Powers, n: int, order: int) -> _Powers:
    """A part and its derivatives up to an order, (.., width, derivatives)."""
    degrees = np.array(powers.rows.shape[:n]) - 1.0
    rows, factors = [powers.rows], [np.ones(1)]
    first = [derivative(powers.rows, k) for k in range(n)]
    if order > 0:
        rows, factors = [*rows, *first], [*factors, degrees]
    if order > 1:
        rows, factors = (
            [*rows, *(derivative(x, k) for x in first for k in range(n))],
            [*factors, np.outer(degrees, degrees).ravel()],
        )
    stacked = jnp.stack(rows, axis=-1)
    error = powers.error[:, None] * np.concatenate(factors).astype(stacked.dtype)
    return _Powers(stacked, error, powers.center)


def _along(powers: _Powers, q: Array) -> Truncated:
    """A part and its first derivatives at moving parameters (terms, parameters)."""
    n = q.shape[-1]
    rows = powers.rows[..., : 1 + n] if n == 2 else powers.rows[:, 0, :, : 1 + n]
    found = composed(rows, Truncated(q[..., None, None], jnp.zeros((n, 1, 1), q.dtype)))
    return Truncated(found.terms, (found.rest + powers.error[:, : 1 + n]) * (1 + gamma(4, q.dtype)))


def _quotients(x: Truncated, rational: bool, n: int) -> _Moved:
    """Return points and derivatives from homogeneous ones: quotients if a part is rational."""
    point, first, second = (_last(x, part) for part in (0, slice(1, 1 + n), slice(1 + n, None)))
    if not rational:
        return _Moved(point, first, second)
    weight, slope, bend = (_at(y, slice(-1, None)) for y in (point, first, second))
    point, first, second = (_at(y, slice(-1)) for y in (point, first, second))
    inverse = reciprocal(weight)
    point = product(point, inverse)
    inverse, wide = (Truncated(y.terms[..., None], y.rest[..., None]) for y in (inverse, point))
    first = product(less(first, product(wide, slope)), inverse)
    if not second.rest.size:
        return _Moved(point, first, second)
    k, m = np.divmod(np.arange(n * n), n)
    second = less(second, product(wide, bend))
    for i, j in ((k, m), (m, k)):
        second = less(second, product(_last(first, i), _last(slope, j)))
    return _Moved(point, first, product(second, inverse))


def _last(x: Truncated, part: Any) -> Truncated:
    return Truncated(x.terms[..., part], x.rest[..., part])


def _at(x: Truncated, part: slice) -> Truncated:
    return Truncated(x.terms[:, part], x.rest[part])


def _convexity(on_a: Truncated, over: _Moved, squares: Array) -> Array:
    """Lower bounds k of half the second derivatives of the squared distance, as a diagonal; zero if none is proven."""
    n, dtype = squares.size, squares.dtype
    k, m = np.divmod(np.arange(n * n), n)
    second = Truncated(over.second.terms[..., None], over.second.rest[..., None])
    # The middle of a, its motion in a plane, and the rest.
    plane = on_a.terms[:3].T[:, None]
    parts = summed(scaled(second, plane))
    around = Truncated(on_a.terms.at[:3].set(0.0), on_a.rest).size * (1 + gamma(64, dtype))
    low, high = extremes(parts)
    loose = jnp.sum(around[:, None] * over.second.size, axis=0) + jnp.sum(jnp.maximum(high, -low)[:, 1:], axis=-1)
    loose = loose * (1 + gamma(64, dtype))
    h = added(
        dot(_last(over.first, k), _last(over.first, m)),
        less(dot(Truncated(over.point.terms[..., None], over.point.rest[..., None]), over.second), _last(parts, 0)),
    )
    low, high = extremes(h)
    ranges = between(low - loose, high + loose)
    h = Ball(*(x.reshape(n, n) for x in ranges))
    free = jnp.zeros(squares.shape, bool)

    def proven(bent: Array) -> Array:
        less = jnp.diag(bent)
        return semidefinite(plus(h, Ball(-less, jnp.zeros_like(less))), free)

    trials = jnp.asarray(_MODULI, dtype)[:, None] * squares
    found = jax.vmap(proven)(trials)
    return jnp.where(jnp.any(found), trials[jnp.argmax(found)], 0.0)
