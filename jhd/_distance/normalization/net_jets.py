"""Pieces of parametric shapes: parts of them, points with derivatives, and balls of these over a part.

A shape is a union of tensor-product pieces; a curve is one whose second parameter has degree zero.

Rounding, for coordinates of at most one. Let p, q be the degrees. Restriction forms convex combinations, three
roundings a level: a control point of the part is off by at most eta = gamma(3 (p + q) + 8) in each coordinate, and so
is any point that they stand for. The derivatives are differences of these points, off by 2 p eta, 4 p (p - 1) eta and
so on; on rational parts the ratio of the weights enlarges these errors. A point that is computed from the control
points takes three roundings a level for the Bernstein polynomials and (p + 1) + (q + 1) for the sums, so it is off by
gamma(7 (p + q) + 24) in each coordinate.

On rational pieces all this is done in homogeneous form, so that errors are relative to the weight. Numerator and weight
are rounded apart, each as often, with a product before and a division of two roundings after it: eta is
gamma(6 (p + q) + 8). For a point from a part, whose weights are off by gamma(3 (p + q)), both take 7 (p + q) + 3
roundings more than its control points have: gamma(20 (p + q) + 24) in all.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic import bernstein
from jhd._arithmetic.balls import Ball, hull, minus, plus, reciprocal, times
from jhd._arithmetic.rounding import gamma
from jhd._shapes.checks import usable_numbers


class Net(NamedTuple):
    """Pieces in common coordinates: control points (pieces, rows, columns, dim), and weights of at most one or None."""

    points: Array
    weights: Array | None
    flat = False

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees in both parameters."""
        return self.points.shape[-3] - 1, self.points.shape[-2] - 1

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return self.points.shape[-1]

    @property
    def parameters(self) -> int:
        """Number of parameters: one for a curve."""
        return 1 if self.points.shape[-2] == 1 else 2

    def piece(self, k: Array) -> "Net":
        """Return one piece, without the first axis."""
        return Net(self.points[k], None if self.weights is None else self.weights[k])

    def point(self, x: Array) -> Array:
        """Return the point of one piece at its parameters."""
        return jet(self, x).point


def usable_net(net: Net) -> Array:
    """Return whether all control points are finite and all weights finite and positive."""
    return usable_numbers(net.points, net.weights)


class NetJet(NamedTuple):
    """Point, first derivatives (parameters, dim) and second derivatives (parameters, parameters, dim) of a shape."""

    point: Any
    first: Any
    second: Any


def eta(net: Net) -> float:
    """Bound the error of every coordinate of the control points of a part."""
    return gamma((3 if net.weights is None else 6) * sum(net.degrees) + 8, net.points.dtype)


def point_error(net: Net) -> float:
    """Bound the error, as a length, of a point that is computed from a part, or from the piece itself."""
    roundings = (7 if net.weights is None else 20) * sum(net.degrees) + 24
    return math.sqrt(net.dim) * gamma(roundings, net.points.dtype)


def part_of(net: Net, low: Array, high: Array) -> Net:
    """Return the control points and weights of the part of one piece between these parameters."""

    def restricted(values: Array) -> Array:
        values = bernstein.restrict(values, low[0], high[0], axis=0)
        return values if net.parameters == 1 else bernstein.restrict(values, low[1], high[1], axis=1)

    if net.weights is None:
        return Net(restricted(net.points), None)
    rows = restricted(_homogeneous(net.points, net.weights))
    return Net(rows[..., :-1] / rows[..., -1:], rows[..., -1])


def _homogeneous(points: Array, weights: Array) -> Array:
    return jnp.concatenate([points * weights[..., None], weights[..., None]], axis=-1)


@cache
def _terms(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return terms of the derivatives of orders 0, 1, 2 of Bernstein polynomials, as sums of f t^i (1 - t)^j.

    Arrays of f, i and j, (differences, orders, degree + 1): derivatives of order k are the k-th differences of
    polynomials of a degree lower by k.
    """
    factors = np.zeros((3, 3, degree + 1))
    powers, rest = (np.zeros(factors.shape, int) for _ in range(2))
    for k, order, i in np.ndindex(*factors.shape):
        below, at = degree - order, i - k
        if k <= order and 0 <= at <= below:
            times = math.comb(order, k) * math.perm(degree, order)
            factors[k, order, i] = (-1) ** (order - k) * times * math.comb(below, at)
            powers[k, order, i], rest[k, order, i] = at, below - at
    return factors, powers, rest


def _basis(degree: int, t: Array) -> Array:
    """Return values, first and second derivatives of the Bernstein polynomials, in fewer than 3 degree roundings each.

    One sum of products of powers: it compiles to one loop; a recurrence would compile to one loop for each step.
    """
    factors, powers, rest = _terms(degree)
    terms = factors.astype(t.dtype) * _power(t, powers) * _power(1 - t, rest)
    return terms[0] + terms[1] + terms[2]


def _power(x: Array, exponents: np.ndarray) -> Array:
    """Return powers of a number by repeated squaring, with one rounding less than the exponent."""
    result = jnp.ones(exponents.shape, x.dtype)
    for bit in range(int(np.max(exponents)).bit_length()):
        result = result * jnp.where((exponents >> bit & 1).astype(bool), x, 1.0)
        x = x * x
    return result


def jet(net: Net, x: Array) -> NetJet:
    """Return point and derivatives of one piece at its parameters, not enclosed; a point may have no parameters."""
    p, q = net.degrees
    n = net.parameters
    if not len(x):
        return NetJet(net.points[0, 0], *_no_derivatives(net.points))
    h = net.points if net.weights is None else _homogeneous(net.points, net.weights)
    along = jnp.sum(_basis(p, x[0])[:, :, None, None] * h[None], axis=1)
    if n == 1:
        table = along[:, :1]  # (order in u, 1, width)
    else:
        table = jnp.sum(_basis(q, x[1])[None, :, :, None] * along[:, None], axis=2)
    orders = [(1, 0), (0, 1)][:n]
    value = table[0, 0]
    first = jnp.stack([table[i, j] for i, j in orders])
    second = jnp.stack([jnp.stack([table[i + k, j + m] for k, m in orders]) for i, j in orders])
    if net.weights is None:
        return NetJet(value, first, second)
    w, dw, ddw = value[-1], first[:, -1], second[..., -1]
    point = value[:-1] / w
    du = (first[:, :-1] - point * dw[:, None]) / w
    cross = du[:, None] * dw[None, :, None]
    return NetJet(point, du, (second[..., :-1] - cross - jnp.swapaxes(cross, 0, 1) - point * ddw[..., None]) / w)


def _no_derivatives(points: Array) -> tuple[Array, Array]:
    """Return empty first and second derivatives."""
    return jnp.zeros((0, points.shape[-1]), points.dtype), jnp.zeros((0, 0, points.shape[-1]), points.dtype)


def enclosed(part: Net, error: Any, relative: Any, n: int | None = None) -> NetJet:
    """Return balls of the point and of its derivatives over a part.

    Args:
        part: the control points and weights.
        error: bound of the error of each control point.
        relative: bound of the relative error of each weight.
        n: the number of parameters; zero for a point.
    """
    if n == 0:
        none = [Ball(x, x) for x in _no_derivatives(part.points)]
        return NetJet(hull(part.points, (0, 1), jnp.asarray(error, part.points.dtype)), *none)
    if part.weights is None:
        return _nets(part.points, jnp.asarray(error, part.points.dtype))
    # Relative to a point of the part, so that the numbers that the weights multiply are small.
    center = hull(part.points, (0, 1), jnp.zeros(())).mid
    rows = _homogeneous(part.points - center, part.weights)
    most = jnp.max(part.weights)
    errors = jnp.append(jnp.full(center.shape, 4 * error * most), relative * most)
    whole = _nets(rows, errors)
    w, dw, ddw = (jax.tree_util.tree_map(lambda x: x[..., -1:], ball) for ball in whole)
    n, dn, ddn = (jax.tree_util.tree_map(lambda x: x[..., :-1], ball) for ball in whole)
    inverse = reciprocal(w)
    about = hull(part.points - center, (0, 1), jnp.asarray(error, center.dtype))
    first = times(minus(dn, times(about, dw)), inverse)
    f, d = (jax.tree_util.tree_map(lambda x: x[:, None], ball) for ball in (first, dw))
    cross = times(f, jax.tree_util.tree_map(lambda x: x[None], dw))
    crossed = plus(cross, times(jax.tree_util.tree_map(lambda x: x[None], first), d))
    second = times(minus(minus(ddn, crossed), times(about, ddw)), inverse)
    return NetJet(hull(part.points, (0, 1), jnp.asarray(error, center.dtype)), first, second)


def _nets(rows: Array, error: Array) -> NetJet:
    """Return balls of the polynomial with these control points and of its derivatives."""
    p, q = rows.shape[0] - 1, rows.shape[1] - 1
    n = 1 if q == 0 else 2

    def derived(orders: tuple[int, ...]) -> Ball:
        net, factor = rows, 1
        for axis, degree in ((0, p), (1, q)):
            for k in range(orders[axis]):
                factor *= max(degree - k, 0)
                net = jnp.diff(net, axis=axis) if net.shape[axis] > 1 else jnp.zeros_like(net)
        margin = error * factor * 2 ** sum(orders) * (1 + 1e-3)
        return hull(net * factor, (0, 1), margin) if factor else Ball(*(jnp.zeros((rows.shape[-1],), rows.dtype),) * 2)

    units = [(1, 0), (0, 1)][:n]
    first = [derived(unit) for unit in units]
    second = [[derived((i + k, j + m)) for k, m in units] for i, j in units]
    stacked = jax.tree_util.tree_map(lambda *x: jnp.stack(x), *first)
    matrix = [jax.tree_util.tree_map(lambda *x: jnp.stack(x), *row) for row in second]
    return NetJet(derived((0, 0)), stacked, jax.tree_util.tree_map(lambda *x: jnp.stack(x), *matrix))


def skew(part: Net) -> Array | float:
    """Return the ratio of the weights, by which the errors of derivatives grow."""
    return 1.0 if part.weights is None else jnp.max(part.weights) / jnp.min(part.weights)
