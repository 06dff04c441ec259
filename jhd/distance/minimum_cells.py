"""Bounds of the distance over one pair of cells of two parametric shapes, and the nearest pair of points in them.

A shape is a union of tensor-product pieces; a curve is one whose second parameter has degree zero. A cell is a box of
parameters of one piece of each shape, x in [0, 1]^n over the box, with e(x) = a - b and F = |e|^2 / 2. Lower bounds:

- the gap of the boxes of the control points, and the gap along one direction, that of the nearest pair found;
- **convexity**: where the second derivatives of F over the cell are proven to be positive semidefinite,
  F(x) >= F(z) + sum g_i (x_i - z_i) with the gradient g at any z; at the minimum z over the cell this is exact but for
  the residual of z. The same holds of psi = n.(a - b) <= |e| with a fixed unit vector n, whose second derivatives do
  not fade as the shapes come close;
- **exclusion**: where dF/dx_i > 0 over a cell that does not start at the border of its piece, the cell holds no
  minimum of the distance between the two pieces. Where it does, all of its minima are on that border, and the cell
  shrinks to it. So with dF/dx_i < 0 at the other end. What is left out holds no nearest pair of the two pieces, hence
  the smallest bound of the cells that stay is a bound of the distance.

Rounding, for coordinates of at most one. Let p, q be the degrees and k = 3 (p + q) + 8. Restriction forms convex
combinations, three roundings a level (on rational pieces in homogeneous form, so that errors are relative to the
weight, with a product before and a division of two roundings after them): a control point of the part is off by at most
eta = gamma(k) in each coordinate, and so is any point that they stand for. The derivatives are differences of these
points, off by 2 p eta, 4 p (p - 1) eta and the like; on rational parts the ratio of the weights enlarges that. A point
that is computed from the control points takes three roundings a level for the Bernstein polynomials and
(p + 1) + (q + 1) for the sums, so it is off by gamma(2 k + p + q) in each coordinate. Balls enclose the rest.

Source: the hull property as in Farouki & Rajan, CAGD 5 (1988); exclusion by gradients and convexity as in Hansen &
Walster, Global Optimization Using Interval Analysis (2004), chapter 12; psi is ours.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic import bernstein
from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.distance.minimum_balls import Ball, dot, factors, hull, minus, plus, reciprocal, semidefinite, times

# Steps of Newton's method towards the nearest pair of a cell; the cells that count are entered near it.
_STEPS = 5
# Cells thinner than this many units of roundoff are not cut.
_THINNEST = 16


class Net(NamedTuple):
    """Pieces in common coordinates: control points (pieces, rows, columns, dim), and weights of at most one or None."""

    points: Array
    weights: Array | None

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
        """One piece, without the first axis."""
        return Net(self.points[k], None if self.weights is None else self.weights[k])


class Cell(NamedTuple):
    """A box of parameters: the pieces of both shapes, and the ends of the n = n_a + n_b parameters."""

    piece_a: Array
    piece_b: Array
    low: Array
    high: Array


class CellBound(NamedTuple):
    """What is known of a cell: bounds, a pair of points, what is left of the cell, and where to cut it."""

    lower: Array
    upper: Array
    distance: Array
    x: Array
    cell: Cell
    axis: Array
    thin: Array


class _Jet(NamedTuple):
    """Point, first derivatives (parameters, dim), second ones (parameters, parameters, dim) of a shape."""

    point: Any
    first: Any
    second: Any


def eta(net: Net) -> float:
    """Bound on the error of every coordinate of the control points of a part."""
    p, q = net.degrees
    return gamma(3 * (p + q) + 8, net.points.dtype)


def point_error(net: Net) -> float:
    """Bound on the error of the length of a point that is computed from a part, or from the piece itself."""
    p, q = net.degrees
    return math.sqrt(net.dim) * gamma(7 * (p + q) + 24, net.points.dtype)


def part_of(net: Net, low: Array, high: Array) -> Net:
    """The control points and weights of the part of one piece between these parameters."""

    def restricted(values: Array) -> Array:
        values = bernstein.restrict(values, low[0], high[0], axis=0)
        return values if net.parameters == 1 else bernstein.restrict(values, low[1], high[1], axis=1)

    if net.weights is None:
        return Net(restricted(net.points), None)
    rows = restricted(_homogeneous(net.points, net.weights))
    return Net(rows[..., :-1] / rows[..., -1:], rows[..., -1])


def _homogeneous(points: Array, weights: Array) -> Array:
    return jnp.concatenate([points * weights[..., None], weights[..., None]], axis=-1)


def _basis(degree: int, t: Array) -> Array:
    """Values, first and second derivatives of the Bernstein polynomials, each from those of one degree less."""

    def raised(row: Array, before: Array | float, after: Array | float) -> Array:
        return jnp.pad(row, (0, 1)) * before + jnp.pad(row, (1, 0)) * after

    rows = [jnp.ones((1,), t.dtype)]
    for _ in range(degree):
        rows.append(raised(rows[-1], 1 - t, t))
    zero = jnp.zeros((degree + 1,), t.dtype)
    first = raised(rows[-2], -degree, degree) if degree else zero
    if degree < 2:
        return jnp.stack([rows[-1], first, zero])
    second = raised(raised(rows[-3], 1 - degree, degree - 1), -degree, degree)
    return jnp.stack([rows[-1], first, second])


def jet(net: Net, x: Array) -> _Jet:
    """Point and derivatives of one piece at its parameters, not enclosed."""
    p, q = net.degrees
    n = net.parameters
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
        return _Jet(value, first, second)
    w, dw, ddw = value[-1], first[:, -1], second[..., -1]
    point = value[:-1] / w
    du = (first[:, :-1] - point * dw[:, None]) / w
    cross = du[:, None] * dw[None, :, None]
    return _Jet(point, du, (second[..., :-1] - cross - jnp.swapaxes(cross, 0, 1) - point * ddw[..., None]) / w)


def enclosed(part: Net, error: Any, relative: float) -> _Jet:
    """Balls of the point and of its derivatives over a part, for errors of its points and relative ones of weights."""
    if part.weights is None:
        return _nets(part.points, jnp.asarray(error, part.points.dtype))
    # About a point of the part, so that what the weights multiply is small.
    centre = hull(part.points, (0, 1), jnp.zeros(())).mid
    rows = _homogeneous(part.points - centre, part.weights)
    most = jnp.max(part.weights)
    errors = jnp.append(jnp.full(centre.shape, 4 * error * most), relative * most)
    whole = _nets(rows, errors)
    w, dw, ddw = (jax.tree_util.tree_map(lambda x: x[..., -1:], ball) for ball in whole)
    n, dn, ddn = (jax.tree_util.tree_map(lambda x: x[..., :-1], ball) for ball in whole)
    inverse = reciprocal(w)
    about = hull(part.points - centre, (0, 1), jnp.asarray(error, centre.dtype))
    first = times(minus(dn, times(about, dw)), inverse)
    f, d = (jax.tree_util.tree_map(lambda x: x[:, None], ball) for ball in (first, dw))
    cross = times(f, jax.tree_util.tree_map(lambda x: x[None], dw))
    crossed = plus(cross, times(jax.tree_util.tree_map(lambda x: x[None], first), d))
    second = times(minus(minus(ddn, crossed), times(about, ddw)), inverse)
    return _Jet(hull(part.points, (0, 1), jnp.asarray(error, centre.dtype)), first, second)


def _nets(rows: Array, error: Array) -> _Jet:
    """Balls of the polynomial with these control points and of its derivatives."""
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
    return _Jet(derived((0, 0)), stacked, jax.tree_util.tree_map(lambda *x: jnp.stack(x), *matrix))


def _joined(a: Any, b: Any) -> Array:
    """The first derivatives of e = a - b in all parameters."""
    return jnp.concatenate([a.first, -b.first])


def _derivatives(a: _Jet, b: _Jet) -> tuple[Array, Array, Array]:
    """The vector e, the gradient of |e|^2 / 2 and its matrix of second derivatives."""
    e, first = a.point - b.point, _joined(a, b)
    bent = _blocks(a.second @ e, -(b.second @ e))
    return e, jnp.sum(first * e, axis=-1), jnp.sum(first[:, None] * first[None], axis=-1) + bent


def _blocks(a: Array, b: Array) -> Array:
    n, m = a.shape[0], b.shape[0]
    above = jnp.concatenate([a, jnp.zeros((n, m), a.dtype)], axis=1)
    return jnp.concatenate([above, jnp.concatenate([jnp.zeros((m, n), b.dtype), b], axis=1)])


def newton_step(gradient: Array, hessian: Array, fixed: Array) -> Array:
    """A step downhill: Newton's where the second derivatives are positive, else one with their absolute pivots."""
    held = fixed[:, None] | fixed[None, :]
    n = gradient.shape[0]
    matrix = jnp.where(held, jnp.eye(n, dtype=hessian.dtype), hessian)
    lower, pivots = factors(matrix)
    # A pivot that is no more than rounding would send the step anywhere.
    least = 1e-12 * jnp.max(jnp.abs(jnp.diagonal(matrix)))
    right = jnp.where(fixed, 0.0, -gradient)
    rows: list[Array] = []
    for k in range(n):
        rows.append(right[k] - sum((lower[k, j] * rows[j] for j in range(k)), jnp.zeros((), right.dtype)))
    scaled = [y / jnp.maximum(jnp.abs(pivots[k]), least + 1e-300) for k, y in enumerate(rows)]
    out: list[Array] = [jnp.zeros((), right.dtype)] * n
    for k in reversed(range(n)):
        out[k] = scaled[k] - sum((lower[j, k] * out[j] for j in range(k + 1, n)), jnp.zeros((), right.dtype))
    return jnp.stack(out)


def nearest_in(part_a: Net, part_b: Net, start: Array, fixed: Array, steps: int = _STEPS) -> Array:
    """Parameters in [0, 1]^n where the distance of two parts is about smallest, from a start; nothing is proven."""
    n = part_a.parameters

    def step(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, best, least = state
        e, g, h = _derivatives(jet(part_a, x[:n]), jet(part_b, x[n:]))
        square = e @ e
        # At a tie the later one, which the step has improved beyond what squares can tell.
        nearer = square <= least
        best, least = jnp.where(nearer, x, best), jnp.where(nearer, square, least)
        held = fixed | ((x <= 0) & (g > 0)) | ((x >= 1) & (g < 0))
        return jnp.clip(x + newton_step(g, h, held), 0.0, 1.0), best, least

    first = (start, start, jnp.full_like(start[0], jnp.inf))
    x, best, least = jax.lax.fori_loop(0, steps, step, first)
    e = jet(part_a, x[:n]).point - jet(part_b, x[n:]).point
    return jnp.where(e @ e <= least, x, best)


def length(e: Array) -> Array:
    """The length of a vector, without underflow."""
    size = jnp.max(jnp.abs(e))
    safe = jnp.where(size > 0, size, 1.0)
    return size * jnp.sqrt(jnp.sum((e / safe) ** 2))


def bound(a: Net, b: Net, cell: Cell) -> CellBound:
    """Bounds over one pair of cells; see the module."""
    n, dtype = a.parameters, cell.low.dtype
    low, high = cell.low, cell.high
    part_a = part_of(a.piece(cell.piece_a), low[:n], high[:n])
    part_b = part_of(b.piece(cell.piece_b), low[n:], high[n:])
    error_a, error_b = eta(a), eta(b)
    off = point_error(a) + point_error(b)
    fixed = high <= low
    start = jnp.full(low.shape, 0.5, dtype)
    z = nearest_in(part_a, part_b, start, fixed)
    jets = (
        jax.vmap(lambda x: jet(part_a, x[:n]))(jnp.stack([z, start])),
        jax.vmap(lambda x: jet(part_b, x[n:]))(jnp.stack([z, start])),
    )
    at_z, middle = (tuple(jax.tree_util.tree_map(lambda x, k=k: x[k], j) for j in jets) for k in (0, 1))
    e = at_z[0].point - at_z[1].point
    distance = length(e)
    upper = distance * (1 + gamma(12, dtype)) + off
    unit = e / jnp.where(distance > 0, distance, 1.0)
    ball_a, ball_b = enclosed(part_a, error_a, error_a), enclosed(part_b, error_b, error_b)
    first = Ball(
        jnp.concatenate([ball_a.first.mid, -ball_b.first.mid]), jnp.concatenate([ball_a.first.rad, ball_b.first.rad])
    )
    apart = minus(ball_a.point, ball_b.point)

    # Gaps of the boxes and along the unit vector.
    gaps = jnp.maximum(jnp.maximum(apart.lower, -apart.upper), 0.0)
    by_box = length(gaps) * (1 - gamma(12, dtype))
    along = jnp.min(jnp.sum(part_a.points * unit, -1)) - jnp.max(jnp.sum(part_b.points * unit, -1))
    by_unit = along * (1 - gamma(12, dtype)) - off
    lower = jnp.maximum(by_box, by_unit)

    # Second derivatives over the cell, of F and of psi.
    products = dot(_expand(first, 1), _expand(first, 0))
    of_f = plus(products, _bends(ball_a, ball_b, apart))
    of_psi = _bends(ball_a, ball_b, Ball(unit, jnp.zeros_like(unit)))
    both = jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), of_f, of_psi)
    convex = jax.vmap(lambda h: semidefinite(h, fixed))(both)

    # Values at z less what the gradient may take off within the cell.
    wrong = 16.0 * max(1, *a.degrees, *b.degrees) * off * skew(part_a) * skew(part_b)
    slopes = _joined(*at_z)
    size = jnp.sum(jnp.abs(slopes), axis=-1) + wrong
    f_slope, psi_slope = jnp.sum(slopes * e, axis=-1), jnp.sum(slopes * unit, axis=-1)
    loose = wrong * (jnp.sum(jnp.abs(e)) + off) + off * size

    def taken(slope: Array, loose: Array) -> Array:
        up, down = jnp.maximum(slope + loose, 0.0) * z, jnp.maximum(-slope + loose, 0.0) * (1 - z)
        return jnp.sum(jnp.where(fixed, 0.0, jnp.maximum(up, down))) * (1 + gamma(12, dtype))

    near = jnp.maximum(distance * (1 - gamma(24, dtype)) - off, 0.0)
    # |e|^2 >= near^2 - 2 t is |e| >= near - 2 t / (near + sqrt(near^2 - 2 t)): no cancellation of squares.
    less = 2 * taken(f_slope, loose)
    rest = jnp.maximum(near * near * (1 - gamma(8, dtype)) - less, 0.0)
    divisor = near + jnp.sqrt(rest) * (1 - gamma(8, dtype))
    by_f = near - less / jnp.where(divisor > 0, divisor, 1.0) * (1 + gamma(12, dtype))
    by_f = jnp.where(rest > 0, by_f, 0.0)
    by_psi = near - off - taken(psi_slope, 2 * wrong + jnp.zeros_like(loose)) * (1 + gamma(12, dtype))
    lower = jnp.maximum(lower, jnp.where(convex[0], by_f, 0.0))
    lower = jnp.maximum(lower, jnp.where(convex[1] & (distance > 0), by_psi, 0.0))
    lower = jnp.maximum(lower * (1 - gamma(6, dtype)) - 64 * smallest_normal(dtype), 0.0)

    # The gradient over the cell, twice enclosed.
    naive = dot(first, Ball(apart.mid[None], apart.rad[None]))
    e_mid = middle[0].point - middle[1].point
    g_mid = jnp.sum(_joined(*middle) * e_mid, axis=-1)
    g_size = jnp.sum(jnp.abs(_joined(*middle)), axis=-1) + wrong
    g_wrong = wrong * (jnp.sum(jnp.abs(e_mid)) + off) + off * g_size + gamma(12, dtype) * g_size
    spread = 0.5 * jnp.sum(jnp.where(fixed[None], 0.0, of_f.size), axis=-1) * (1 + gamma(12, dtype)) + g_wrong
    g_low = jnp.maximum(naive.lower, g_mid - spread * (1 + gamma(6, dtype)))
    g_high = jnp.minimum(naive.upper, g_mid + spread * (1 + gamma(6, dtype)))
    rising, falling = (g_low > 0) & ~fixed, (g_high < 0) & ~fixed
    excluded = jnp.any((rising & (low > 0)) | (falling & (high < 1)))
    left = Cell(cell.piece_a, cell.piece_b, jnp.where(falling, high, low), jnp.where(rising, low, high))

    extent = jnp.max(first.size, axis=-1)
    wide = left.high - left.low > _THINNEST * jnp.finfo(dtype).eps
    extent = jnp.where(wide, extent, -1.0)
    axis = jnp.argmax(extent)
    x = low + z * (high - low)
    return CellBound(jnp.where(excluded, jnp.inf, lower), upper, distance, x, left, axis, ~jnp.any(wide))


def skew(part: Net) -> Array | float:
    """The ratio of the weights, by which the errors of derivatives grow."""
    return 1.0 if part.weights is None else jnp.max(part.weights) / jnp.min(part.weights)


def _expand(ball: Ball, axis: int) -> Ball:
    return Ball(jnp.expand_dims(ball.mid, axis), jnp.expand_dims(ball.rad, axis))


def _bends(a: _Jet, b: _Jet, vector: Ball) -> Ball:
    """The second derivatives of a - b times a vector."""
    row = Ball(vector.mid[None, None], vector.rad[None, None])
    bent_a, bent_b = dot(a.second, row), dot(b.second, row)
    return Ball(_blocks(bent_a.mid, -bent_b.mid), _blocks(bent_a.rad, bent_b.rad))
