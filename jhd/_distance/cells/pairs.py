"""Bounds of the distance over one pair of cells of two parametric shapes, and the nearest pair of points in them.

A shape is a union of tensor-product pieces; a curve is one whose second parameter has degree zero. A cell is a box of
parameters of one piece of each shape, x in [0, 1]^n over the box, with e(x) = a - b and F = |e|^2 / 2. Lower bounds:

- the gap of the boxes of the control points, and the gap along the direction of the nearest pair found;
- **convexity**: if the second derivatives of F over the cell are proven to be positive semidefinite,
  F(x) >= F(z) + sum g_i (x_i - z_i) with the gradient g at any z. If a positive definite form bounds them from below,
  half of its value at x - z is added. At the minimum z over the cell this is exact but for the residual of z. The
  first bound holds of psi = n.(a - b) <= |e| too, with a fixed unit vector n; its second derivatives do not fade as the
  shapes come close;
- **exclusion**: if dF/dx_i > 0 over a cell that does not start at the border of its piece, the cell holds no
  minimum of the distance between the two pieces. If it starts there, all of its minima are on that border, and the cell
  shrinks to it. The same holds for dF/dx_i < 0 at the opposite end. The parts left out hold no nearest pair of the two
  pieces, hence the smallest bound of the remaining cells is a bound of the distance.

Rounding: see `jhd._distance.normalization.net_jets` for points and derivatives; balls enclose the rest.

Source: the hull property as in Farouki & Rajan, CAGD 5 (1988); exclusion by gradients and convexity as in Hansen &
Walster, Global Optimization Using Interval Analysis (2004), chapter 12; psi is ours.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic.balls import Ball, dot, factors, minus, normalized, plus
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.scaling import length
from jhd._distance.normalization.net_jets import Net, NetJet, enclosed, eta, jet, part_of, point_error, skew

# Steps of Newton's method towards the nearest pair of a cell; the cells that count are entered near it.
_STEPS = 5
# Cells thinner than this many units of roundoff are not cut.
_THINNEST = 16
# A squared speed along a parameter below this fraction of the largest counts as zero.
_STILL = 1e-20


class Cell(NamedTuple):
    """A box of parameters: the pieces of both shapes, and the ends of the n = n_a + n_b parameters.

    If the first shape is a point set, it may have no parameter, instead of one without effect.
    """

    piece_a: Array
    piece_b: Array
    low: Array
    high: Array


class PairBound(NamedTuple):
    """Result for a cell: bounds, a pair of points, the part of the cell that remains, and where to cut it.

    The extent holds approximate lengths along its parameters, negative for parameters that are not to be cut.
    """

    lower: Array
    upper: Array
    distance: Array
    x: Array
    cell: Cell
    extent: Array
    thin: Array


class BestPair(NamedTuple):
    """The nearest pair of points found: a bound of its distance, the distance, the pieces and the parameters."""

    upper: Array
    distance: Array
    piece_a: Array
    piece_b: Array
    x: Array


def _joined(a: Any, b: Any) -> Array:
    """The first derivatives of e = a - b in all parameters."""
    return jnp.concatenate([a.first, -b.first])


def derivatives(a: Any, b: Any) -> tuple[Array, Array, Array]:
    """The vector e, the gradient of |e|^2 / 2 and its matrix of second derivatives."""
    e, first = a.point - b.point, _joined(a, b)
    bent = blocks(jnp.sum(a.second * e, axis=-1), -jnp.sum(b.second * e, axis=-1))
    return e, jnp.sum(first * e, axis=-1), jnp.sum(first[:, None] * first[None], axis=-1) + bent


def blocks(a: Array, b: Array) -> Array:
    """The matrix with two blocks on its diagonal."""
    n, m = a.shape[0], b.shape[0]
    above = jnp.concatenate([a, jnp.zeros((n, m), a.dtype)], axis=1)
    return jnp.concatenate([above, jnp.concatenate([jnp.zeros((m, n), b.dtype), b], axis=1)])


def newton_step(gradient: Array, hessian: Array, fixed: Array) -> Array:
    """Return a step downhill: Newton's if the second derivatives are positive, else one with their absolute pivots."""
    held = fixed[:, None] | fixed[None, :]
    n = gradient.shape[0]
    matrix = jnp.where(held, jnp.eye(n, dtype=hessian.dtype), hessian)
    lower, pivots = factors(matrix)
    # A pivot that is no more than rounding would send the step anywhere.
    least = 1e-12 * jnp.max(jnp.abs(jnp.diagonal(matrix))) + smallest_normal(hessian.dtype)
    right = jnp.where(fixed, 0.0, -gradient)
    rows: list[Array] = []
    for k in range(n):
        rows.append(right[k] - sum((lower[k, j] * rows[j] for j in range(k)), jnp.zeros((), right.dtype)))
    scaled = [y / jnp.maximum(jnp.abs(pivots[k]), least) for k, y in enumerate(rows)]
    out: list[Array] = [jnp.zeros((), right.dtype)] * n
    for k in reversed(range(n)):
        out[k] = scaled[k] - sum((lower[j, k] * out[j] for j in range(k + 1, n)), jnp.zeros((), right.dtype))
    return jnp.stack(out)


def _stands_still(at: NetJet) -> Array:
    """Return the parameters along which a point does not move, compared with the fastest parameter."""
    speeds = jnp.sum(at.first**2, axis=-1)
    return speeds <= _STILL * jnp.max(speeds, initial=0.0)


def nearest_in(
    part_a: Net, part_b: Net, start: Array, fixed: Array, steps: int = _STEPS, mending: int = 0, mended: float = 0.0
) -> Array:
    """Parameters in [0, 1]^n that approximately minimize the distance of two parts; nothing is proven.

    Args:
        part_a: the first part.
        part_b: the second part.
        start: parameters at which the steps begin.
        fixed: parameters that are not moved.
        steps: number of Newton steps, after which the nearest pair so far is taken.
        mending: further steps from that pair. Distances are exact to rounding if the parameters are off by the root of
            the roundoff.
        mended: largest length of a further step that is taken.
    """
    n = len(start) - part_b.parameters

    def step(k: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, best, least = state
        jets = jet(part_a, x[:n]), jet(part_b, x[n:])
        e, g, h = derivatives(*jets)
        square = e @ e
        # At a tie the later one, which the step has improved beyond what squares can tell.
        nearer = square <= least
        best, least = jnp.where(nearer, x, best), jnp.where(nearer, square, least)
        # On a collapsed edge the step leads away from it: the parameter along it has no slope there.
        still = jnp.concatenate([_stands_still(x) for x in jets])
        held = fixed | still | ((x <= 0) & (g > 0)) | ((x >= 1) & (g < 0))
        moved = newton_step(g, h, held)
        ahead = jnp.clip(x + moved, 0.0, 1.0)
        if not mending:
            return ahead, best, least
        short = jnp.where(jnp.max(jnp.abs(moved)) < mended, ahead, x)
        x = jnp.where(k < steps, ahead, jnp.where(k == steps, best, short))
        return x, best, least

    first = (start, start, jnp.full_like(start[0], jnp.inf))
    x, best, _ = jax.lax.fori_loop(0, steps + 1 + mending, step, first)
    return x if mending else best


class _Sides(NamedTuple):
    """Both parts of a cell: control points, balls of the derivatives of a - b, and error bounds."""

    whole_a: Net  # the piece of a
    whole_b: Net  # the piece of b
    a: Net  # the part of the piece of a
    b: Net  # the part of the piece of b
    first: Ball  # the first derivatives of a - b over the cell
    apart: Ball  # a - b over the cell
    of_f: Ball  # the second derivatives of F over the cell
    ball_a: NetJet  # point and derivatives of a, as in `enclosed`
    ball_b: NetJet  # point and derivatives of b
    fixed: Array  # parameters that have one value only
    off: float  # bound on the error of the length of a computed difference of points
    # Error bounds of a component of its derivatives in each parameter of the cell, if taken from whole pieces: they
    # shrink with the cell, the errors of derivatives from parts do not.
    wrong: Any


def _parameters_of_first(b: Net, cell: Cell) -> int:
    return len(cell.low) - b.parameters


def _sides(a: Net, b: Net, cell: Cell) -> _Sides:
    n = _parameters_of_first(b, cell)
    whole_a, whole_b = a.piece(cell.piece_a), b.piece(cell.piece_b)
    part_a = part_of(whole_a, cell.low[:n], cell.high[:n]) if n else whole_a
    part_b = part_of(whole_b, cell.low[n:], cell.high[n:])
    ball_a, ball_b = enclosed(part_a, eta(a), eta(a), n), enclosed(part_b, eta(b), eta(b))
    first = joined(ball_a.first, ball_b.first)
    apart = minus(ball_a.point, ball_b.point)
    of_f = plus(dot(expand(first, 1), expand(first, 0)), bends(ball_a.second, ball_b.second, apart))
    off = point_error(a) + point_error(b)
    wrong = 16.0 * max(1, *a.degrees, *b.degrees) * off * skew(whole_a) * skew(whole_b) * (cell.high - cell.low)
    fixed = cell.high <= cell.low
    return _Sides(whole_a, whole_b, part_a, part_b, first, apart, of_f, ball_a, ball_b, fixed, off, wrong)


class _PairAt(NamedTuple):
    """A pair of points with the derivatives in the parameters of the cell, and its relative position in the cell."""

    e: Array  # the difference of the points
    slopes: Array  # its derivatives
    before: Array  # the fraction of the cell before the parameters
    after: Array  # the fraction behind them

    @classmethod
    def at(cls, sides: _Sides, cell: Cell, x: Array) -> "_PairAt":
        """Return the pair at parameters of the pieces within the cell."""
        n, width = len(x) - sides.b.parameters, cell.high - cell.low
        at_a, at_b = jet(sides.whole_a, x[:n]), jet(sides.whole_b, x[n:])
        whole = jnp.where(width > 0, width, 1.0)
        slopes = _joined(at_a, at_b) * width[:, None]
        return cls(at_a.point - at_b.point, slopes, (x - cell.low) / whole, (cell.high - x) / whole)


def bound(a: Net, b: Net, cell: Cell) -> PairBound:
    """Return the bounds over one pair of cells; see the module."""
    dtype, low, high = cell.low.dtype, cell.low, cell.high
    sides, middle = _sides(a, b, cell), jnp.full(low.shape, 0.5, dtype)
    z = nearest_in(sides.a, sides.b, middle, sides.fixed)
    # The same values for points and for their position in the cell, however products and sums are contracted.
    x = jax.lax.optimization_barrier(jnp.clip(low + jnp.stack([z, middle]) * (high - low), low, high))
    found = jax.vmap(lambda x: _PairAt.at(sides, cell, x))(x)
    at_z, at_middle = (jax.tree_util.tree_map(lambda y, k=k: y[k], found) for k in (0, 1))
    distance = length(at_z.e)
    upper = distance * (1 + gamma(12, dtype)) + sides.off
    lower = jnp.maximum(_by_gaps(sides, at_z), _by_convexity(sides, at_z))
    lower = jnp.maximum(lower * (1 - gamma(6, dtype)) - 64 * smallest_normal(dtype), 0.0)
    rising, falling = _monotone(sides, at_middle)
    excluded = jnp.any((rising & (low > 0)) | (falling & (high < 1)))
    left = Cell(cell.piece_a, cell.piece_b, jnp.where(falling, high, low), jnp.where(rising, low, high))
    wide = left.high - left.low > _THINNEST * jnp.finfo(dtype).eps
    extent = jnp.where(wide, jnp.max(sides.first.size, axis=-1), -1.0)
    lower = jnp.where(excluded, jnp.inf, lower)
    # A cell that has only now shrunk to a point is bounded once more, as that point.
    thin = ~jnp.any(high - low > _THINNEST * jnp.finfo(dtype).eps)
    return PairBound(lower, upper, distance, x[0], left, extent, thin)


def _unit(e: Array) -> Array:
    """The direction of a vector; the zero vector if it has none."""
    distance = length(e)
    return e / jnp.where(distance > 0, distance, 1.0)


def _by_gaps(sides: _Sides, at_z: _PairAt) -> Array:
    """Lower bound by the gap of the boxes and the gap along the line that joins the points."""
    apart, dtype, unit = sides.apart, sides.apart.mid.dtype, _unit(at_z.e)
    gaps = jnp.maximum(jnp.maximum(apart.lower, -apart.upper), 0.0)
    along = jnp.min(jnp.sum(sides.a.points * unit, -1)) - jnp.max(jnp.sum(sides.b.points * unit, -1))
    return jnp.maximum(length(gaps) * (1 - gamma(12, dtype)), along * (1 - gamma(12, dtype)) - sides.off)


def _by_convexity(sides: _Sides, at_z: _PairAt) -> Array:
    """Lower bounds: F and psi at z, minus the largest decrease by the gradient within the cell, if they are convex.

    With S and `least` from `normalized`, F(x) >= F(z) + g.(x - z) + least |S^-1 (x - z)|^2 / 2, which is at least
    F(z) - |S^T g|^2 / (2 least). At a foot this takes off next to nothing, whatever the size of the cell.
    """
    off, wrong, fixed = sides.off, sides.wrong, sides.fixed
    e, slopes, before, after = at_z
    distance, unit, dtype = length(e), _unit(e), e.dtype
    of_psi = bends(sides.ball_a.second, sides.ball_b.second, Ball(unit, jnp.zeros_like(unit)))
    both = jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), sides.of_f, of_psi)
    roots, least = jax.vmap(lambda h: normalized(h, fixed))(both)
    convex = least >= 0
    size = jnp.sum(jnp.abs(slopes), axis=-1) + wrong
    f_slope, psi_slope = jnp.sum(slopes * e, axis=-1), jnp.sum(slopes * unit, axis=-1)
    loose = wrong * (jnp.sum(jnp.abs(e)) + off) + off * size

    def falls(slope: Array, loose: Array) -> tuple[Array, Array]:
        """Largest decrease per unit from z towards either end of each parameter; zero if z is that end."""

        def towards(room: Array, slope: Array) -> Array:
            return jnp.where(fixed | (room <= 0), 0.0, jnp.maximum(slope + loose, 0.0))

        return towards(before, slope), towards(after, -slope)

    def taken(down: Array, up: Array) -> Array:
        return jnp.sum(jnp.maximum(down * before, up * after)) * (1 + gamma(12, dtype))

    near = jnp.maximum(distance * (1 - gamma(24, dtype)) - off, 0.0)
    # |e|^2 >= near^2 - 2 t is |e| >= near - 2 t / (near + sqrt(near^2 - 2 t)): no cancellation of squares.
    down, up = falls(f_slope, loose)
    pulled = jnp.sum(jnp.abs(roots[0]) * (jnp.maximum(down, up) + smallest_normal(dtype)), axis=-1)
    some = least[0] > 0
    by_curvature = (jnp.sum(pulled * pulled) + 64 * smallest_normal(dtype)) / jnp.where(some, least[0], 1.0)
    by_curvature = jnp.where(some, by_curvature * (1 + gamma(24, dtype)), jnp.inf)
    less = jnp.minimum(2 * taken(down, up), by_curvature)
    rest = jnp.maximum(near * near * (1 - gamma(8, dtype)) - less, 0.0)
    divisor = near + jnp.sqrt(rest) * (1 - gamma(8, dtype))
    by_f = near - less / jnp.where(divisor > 0, divisor, 1.0) * (1 + gamma(12, dtype))
    by_psi = near - off - taken(*falls(psi_slope, 2 * wrong)) * (1 + gamma(12, dtype))
    by_f = jnp.where(convex[0] & (rest > 0), by_f, 0.0)
    return jnp.maximum(by_f, jnp.where(convex[1] & (distance > 0), by_psi, 0.0))


def _monotone(sides: _Sides, middle: _PairAt) -> tuple[Array, Array]:
    """Return the parameters in which F is proven to rise, and to fall, over the cell, by two enclosures."""
    off, wrong, fixed = sides.off, sides.wrong, sides.fixed
    naive = dot(sides.first, Ball(sides.apart.mid[None], sides.apart.rad[None]))
    e, slopes, before, after = middle
    gradient, size, dtype = jnp.sum(slopes * e, axis=-1), jnp.sum(jnp.abs(slopes), axis=-1) + wrong, e.dtype
    loose = wrong * (jnp.sum(jnp.abs(e)) + off) + off * size + gamma(12, dtype) * size
    reach = jnp.where(fixed, 0.0, jnp.maximum(before, after))
    spread = jnp.sum(sides.of_f.size * reach, axis=-1) * (1 + gamma(12, dtype)) + loose
    low = jnp.maximum(naive.lower, gradient - spread * (1 + gamma(6, dtype)))
    high = jnp.minimum(naive.upper, gradient + spread * (1 + gamma(6, dtype)))
    return (low > 0) & ~fixed, (high < 0) & ~fixed


def expand(ball: Ball, axis: int) -> Ball:
    """Return the ball with an additional axis of length one."""
    return Ball(jnp.expand_dims(ball.mid, axis), jnp.expand_dims(ball.rad, axis))


def joined(a: Ball, b: Ball) -> Ball:
    """Return the derivatives of a - b in the parameters of both shapes."""
    return Ball(jnp.concatenate([a.mid, -b.mid]), jnp.concatenate([a.rad, b.rad]))


def bends(a: Ball, b: Ball, vector: Ball) -> Ball:
    """Return the second derivatives of a - b times a vector."""
    row = Ball(vector.mid[None, None], vector.rad[None, None])
    bent_a, bent_b = dot(a, row), dot(b, row)
    return Ball(blocks(bent_a.mid, -bent_b.mid), blocks(bent_a.rad, bent_b.rad))


class Parametric(NamedTuple):
    """A pair of parametric shapes in common coordinates, and what preparing them may have changed."""

    a: Net
    b: Net
    error: Any

    def bound(self, cell: Cell) -> PairBound:
        """Return the bounds over one pair of cells."""
        return bound(self.a, self.b, cell)

    @property
    def floor(self) -> float:
        """The gap that rounding leaves, in common coordinates."""
        return 16 * (point_error(self.a) + point_error(self.b))
