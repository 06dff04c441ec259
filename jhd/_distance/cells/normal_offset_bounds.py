"""Bounds of mean distances to fourth order, from the heights of a cell above pieces of a curved shape.

A cell is a segment or triangle of parameters u of one piece of a. On a piece of b, which may be continued a little, let
sigma follow the feet (jhd._distance.cells.foot_maps), e = a - b(sigma), n a unit vector across b near the cell, s = n.e
the height of a point, and t = e - s n. All are polynomials; the mean of each is the mean of its Bernstein coefficients.

**Above.** If sigma stays on the piece, d <= |e| <= |s| + min(|t|, |t|^2 / (2 |s|)).

**Below.** Let F(v) = |a(u) - b(v)|^2 / 2 on a box of parameters v that holds sigma and the whole part of the piece that
may be nearest. In coordinates y in which its second derivatives are at least mu > 0, for all u of the cell,

    F(v) >= F(sigma) + F'(sigma).(v - sigma) + mu |v - sigma|^2 / 2 >= F(sigma) - |F'(sigma)|^2 / (2 mu),

so the distance to that part of the piece is at least sqrt(s^2 - l) with l = |F'(sigma)|^2 / mu, which is at least
|s| - min(sqrt(l), l / |s|). Here F' = -b'.e, so |F'| <= A |t| + theta |s| with A >= |b'| and theta >= |n.b'| on the
box, both in the coordinates y. The loss is the square of the angle between n and the normal, times the height, plus the
square of the mismatch of sigma. For several pieces, the smallest coefficients belong to a polynomial below all of them.

On rational shapes e = E / w. With l a polynomial of degree one close to w and c about their middle,

    e = E (2 c - l) / c^2 + e ((1 - l / c)^2 - (w - l) (2 c - l) / c^2),

a polynomial and an error of second order relative to e.

Rounding, for coordinates of at most one: E and w are off by the errors in jhd._distance.cells.foot_maps, times
`growth` if parameters are up to x beyond the sides: then the factors 1 - v and v of a level have the sum 1 + 2 x of
absolute values, and so have the terms. Balls enclose the rest.
"""

import math
from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._arithmetic.balls import Ball, dot, minus, normalized, product
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.simplices import (
    LEVEL,
    coefficients_of,
    lattice,
    lowering,
    multiply,
    raising,
    scaled,
)
from jhd._distance.cells.foot_maps import Simplex, difference
from jhd._distance.cells.pairs import expand
from jhd._distance.normalization.net_jets import Net, enclosed, eta, jet, part_of, point_error, skew


class Heights(NamedTuple):
    """Components of the vector from a piece of b to a over cells, (indices, cells) or (cells,)."""

    height: Array  # coefficients of s
    aside: Array  # bound of |t|
    aside_sq: Array  # bound of the mean of |t|^2
    error: Array  # bound of the error of both


class Valley(NamedTuple):
    """The squared distance from a cell over a box of parameters, in the coordinates that its second derivatives scale.

    Args:
        steep: bound of the first derivatives of b.
        tilt: bound of their components along n, near sigma.
        modulus: a lower bound of the second derivatives of half the squared distance; not positive if none is known.
    """

    steep: Array
    tilt: Array
    modulus: Array


class HeightBounds(NamedTuple):
    """Bounds over cells, for points that are spread evenly over their parameters; infinite if unknown."""

    least: Float[np.ndarray, " cells"]  # lower bound of the distance everywhere
    most: Float[np.ndarray, " cells"]  # upper bound of the distance everywhere
    least_mean: Float[np.ndarray, " cells"]  # lower bound of its mean
    most_mean: Float[np.ndarray, " cells"]  # upper bound of its mean
    least_square: Float[np.ndarray, " cells"]  # lower bound of the mean of its square
    most_square: Float[np.ndarray, " cells"]  # upper bound of the mean of its square

    def narrowed(self, other: "HeightBounds") -> "HeightBounds":
        """Return the tighter of both bounds."""
        pairs = zip(self, other, strict=True)
        return HeightBounds(*(np.fmin(x, y) if k % 2 else np.fmax(x, y) for k, (x, y) in enumerate(pairs)))


def unknown_bounds(cells: int) -> HeightBounds:
    """Bounds of `cells` cells about which nothing is known."""
    return HeightBounds(*([np.zeros(cells), np.full(cells, np.inf)] * 3))


@cache
def means_of_products(k: int, n: int) -> np.ndarray:
    """Return a matrix with the means of the products of two Bernstein polynomials of degree n on a simplex."""
    at = lattice(k, n)
    counts = np.array(
        [[math.prod(math.comb(int(x + y), int(x)) for x, y in zip(i, j, strict=True)) for j in at] for i in at]
    )
    return counts / (math.comb(2 * n, n) * math.comb(2 * n + k, k))


def heights_between(k: int, part: Simplex, other: Simplex, levels: int, growth: Array, normal: Array) -> Heights:
    """Heights of `part` above `other` at equal parameters of the cells.

    Args:
        k: dimension of the cells.
        part: the part of a.
        other: the part of b.
        levels: number of levels in which both are composed.
        growth: factor by which sums of absolute values grow beyond the sides (cells,).
        normal: approximate unit vectors (3, cells).
    """
    e, w = difference(k, part, other)
    dtype = e.dtype
    roundings = LEVEL * levels + 2 * len(lattice(k, e.shape[0] - 1)) + 16
    off = 2 * math.sqrt(3) * gamma(roundings, dtype) * growth
    if w is not None:
        e, off = _divided(k, e, w, off)
    n = e.shape[0] - 1
    rows = coefficients_of(k, e)
    most = jnp.max(jnp.sqrt(jnp.sum(rows * rows, axis=1)), axis=0)
    height = jnp.sum(rows * normal, axis=1)
    aside = rows - height[:, None] * normal
    tiny = 1e3 * smallest_normal(dtype)
    squares = jnp.max(jnp.sum(aside * aside, axis=1), axis=0)
    seen = jnp.tensordot(means_of_products(k, n).astype(dtype), aside, 1, precision="highest")
    square = jnp.sum(jnp.sum(seen * aside, axis=1), axis=0) + gamma(2 * len(rows) + 16, dtype) * squares + tiny
    return Heights(height, jnp.sqrt(squares + tiny) * (1 + gamma(8, dtype)), square, off + gamma(32, dtype) * most)


def _divided(k: int, e: Array, w: Array, off: Array) -> tuple[Array, Array]:
    """Return a polynomial close to E / w, and a bound of its error; infinite if weights are too small."""
    dtype, m = e.dtype, w.shape[0] - 1
    rows, weights = coefficients_of(k, e), coefficients_of(k, w)
    least, most = jnp.min(weights, axis=0), jnp.max(weights, axis=0)
    good = least - 4 * off > smallest_normal(dtype) ** 0.25
    least = jnp.where(good, least - off, 1.0)
    center = jnp.where(good, 0.5 * (least + most), 1.0)
    line = jnp.tensordot(lowering(k, m, 1).astype(dtype), weights, 1)
    raised = jnp.tensordot(raising(k, 1, m).astype(dtype), line, 1, precision="highest")
    bent = jnp.max(jnp.abs(weights - raised), axis=0) + gamma(16, dtype) * most + off
    ratio = (2 * center - line) / center**2
    uneven = jnp.max(jnp.abs(1 - line / center), axis=0) + gamma(8, dtype)
    size, factor = jnp.max(jnp.sqrt(jnp.sum(rows * rows, axis=1)), axis=0), jnp.max(jnp.abs(ratio), axis=0)
    left = uneven**2 + bent * factor
    error = (size + off) / least * left + off * factor + gamma(128, dtype) * size * factor
    found = multiply(k, jnp.expand_dims(scaled(k, 1, ratio), k), e)
    return found, jnp.where(good, error * (1 + gamma(32, dtype)), jnp.inf)


def growth_beyond(net: Net, low: Array, high: Array) -> Array:
    """Return the factor by which sums of absolute values grow if parameters are between these ends."""
    beyond = jnp.maximum(jnp.maximum(-low, high - 1), 0.0)
    degrees = np.array(net.degrees[: net.parameters], float)
    # The numbers take two roundings, their powers as many for each degree.
    room = gamma(2 * sum(net.degrees) + 64, low.dtype)
    return jnp.prod((1 + 2 * beyond) ** degrees.astype(low.dtype)) * (1 + room)


def valley(piece: Net, low: Array, high: Array, feet: Array, normal: Array, cell: Ball) -> Valley:
    """Describe the squared distance from a cell over a box of parameters.

    Args:
        piece: a piece of b.
        low: lower ends of the box (parameters,), which may be beyond the sides.
        high: upper ends of the box (parameters,), which may be beyond the sides.
        feet: coefficients (indices, parameters) of sigma, within the box.
        normal: the unit vector n.
        cell: a ball with all points of the cell.
    """
    n, dtype = piece.parameters, low.dtype
    part = part_of(piece, low, high)
    least = 1.0 if part.weights is None else jnp.min(part.weights)
    # If weights are small compared with the largest one, the points lose as many digits.
    wide = jnp.where(least > 0, growth_beyond(piece, low, high) / jnp.where(least > 0, least, 1.0), jnp.inf)
    ball = enclosed(part, 2 * eta(piece) * wide, eta(piece) * wide)
    apart = minus(cell, ball.point)
    bends = dot(ball.second, Ball(apart.mid[None, None], apart.rad[None, None]))
    turn, modulus = normalized(minus(dot(expand(ball.first, 1), expand(ball.first, 0)), bends), jnp.zeros(n, bool))
    steep = jnp.abs(product(turn, ball.first.mid)) + product(jnp.abs(turn), ball.first.rad)
    local = (feet - low) / (high - low)
    middle = 0.5 * (jnp.min(local, axis=0) + jnp.max(local, axis=0))
    reach = jnp.max(jnp.abs(local - middle), axis=0) + gamma(16, dtype) * (1 + jnp.max(jnp.abs(local), axis=0))
    at = jet(part, middle).first
    wrong = 16.0 * max(1, *piece.degrees) * point_error(piece) * wide * skew(part)
    curved = jnp.sum(
        dot(ball.second, Ball(normal[None, None], jnp.zeros_like(normal)[None, None])).size * reach, axis=1
    )
    slope = jnp.sum(at * normal, axis=1)
    loose = curved + wrong + gamma(16, dtype) * jnp.sum(jnp.abs(at), axis=1)
    tilt = jnp.abs(jnp.sum(turn * slope, axis=1)) + jnp.sum(jnp.abs(turn) * loose, axis=1)
    room = 1 + gamma(64, dtype)
    return Valley(_length(steep) * room, (_length(tilt) + gamma(16, dtype) * _length(slope)) * room, modulus)


def _length(x: Array) -> Array:
    return jnp.sqrt(jnp.sum(x * x))
