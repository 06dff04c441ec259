"""Upper bounds of the distance over a cell of a curve, patch or triangle by feet that follow the points of the cell.

A cell is a segment or triangle of parameters u of one piece of a. For every map sigma of the cell into the parameters
of one piece of b, the distance of a(u) is at most |a(u) - b(sigma(u))|. Here sigma is the quadratic polynomial through
the feet of six points close to the corners and the middles of the sides (of three on a segment), its coefficients
clipped to the domain, which is convex and so holds all of its values. The feet need not be the nearest ones. If sigma
follows the feet to third order, the bound is off by the square of this error. So it closes also at shapes that are
equally far from each other along whole regions. The foot of a corner itself may have many parameters, if a side of b is
a single point.

In Bernstein form over the cell let e = w_b a - w_a b(sigma) and w = w_a w_b, both of degree n. With any polynomial l of
degree two close to e, and r = e - l,

    |e|^2 = l.(2 e - l) + |r|^2 <= max (l.(2 e - l))_i + max |r_i|^2,

and w^2 >= min (s (2 w - s))_i with any s of degree two close to w. Quotients of coefficients bound the quotient. On
large cells max |e_i| / w_i is less.

Rounding, for coordinates of at most one; for larger ones, all errors grow in proportion. With K the roundings of
composing and multiplying (jhd._arithmetic.simplices), e_i is off by at most 2 sqrt(3) gamma(K) w_i, as all of its terms
have the signs and sizes of the terms of w_i, and w_i by gamma(K) w_i. So |e| / w is off by 2 sqrt(3) gamma(K) and a
factor 1 + gamma(2 K). With m the largest |e_i| or |l_i| the coefficients of l.(2 e - l) are at most 3 m^2 in size and
off by less than gamma(64) 4 m^2, and |r_i|^2, of which l is raised by six terms, by gamma(64) m^2; the coefficients for
w equally. Weights whose squares might be flushed are refused; digits of e that are flushed count as the root of nu.

All functions take many cells at once, along the last axis. Feet and maps come from jhd._distance.cells.foot_maps.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma, round_up, smallest_normal
from jhd._arithmetic.simplices import (
    LEVEL,
    coefficients_of,
    composed,
    constant,
    dot,
    lowering,
    multiply,
    raising,
    scaled,
)
from jhd._distance.cells.foot_maps import Triangles
from jhd._distance.normalization.net_jets import Net


class Simplex(NamedTuple):
    """A part of a shape over cells: homogeneous points (*entries, 3, cells), weights (*entries, cells) or None."""

    points: Array
    weights: Array | None


def part_over(k: int, shape: Net | Triangles, inner: Array, complement: Array) -> Simplex:
    """Return the parts of pieces over cells, given maps of the cells into the parameters of the pieces.

    Args:
        k: dimension of the cells.
        shape: one piece for each cell, along the first axis.
        inner: coefficients of the maps (indices, parameters, cells), of degree one or two; for triangles, barycentric
            coordinates whose sums are one up to eight roundings.
        complement: coefficients of one minus the maps; not used for triangles.
    """
    degree = 1 if inner.shape[0] == k + 1 else 2
    if isinstance(shape, Triangles):
        corners = jnp.moveaxis(shape.corners, 0, -1)
        return Simplex(scaled(k, degree, jnp.sum(inner[:, :, None] * corners[None], axis=1)), None)
    points = shape.points
    if shape.weights is not None:
        points = jnp.concatenate([points * shape.weights[..., None], shape.weights[..., None]], axis=-1)
    rows = jnp.moveaxis(points, 0, -1)
    rows = rows.reshape(*rows.shape[:2], *(1,) * k, *rows.shape[2:])
    # (*entries, 2, parameters, cells), looked up at once.
    both = scaled(k, degree, jnp.stack([inner, complement], axis=1))
    for axis in range(shape.parameters):
        rows = composed(k, rows, *(both[(*(slice(None),) * k, i, axis)] for i in range(2)))
    if shape.parameters == 1:
        rows = rows[0]
    if shape.weights is None:
        return Simplex(rows, None)
    at = (slice(None),) * k
    return Simplex(rows[(*at, slice(3))], rows[(*at, 3)])


def bound_between(k: int, part: Simplex, other: Simplex, levels: int, size: Array | float = 1.0) -> Array:
    """Bound the distances (cells,) between two parts at equal parameters of the cells."""
    e, w = difference(k, part, other)
    e, w = _of_degree_two(k, e), None if w is None else _of_degree_two(k, w)
    n = e.shape[0] - 1
    e = coefficients_of(k, e)
    dtype = e.dtype
    roundings = LEVEL * levels + 2 * len(e) + 16
    off = 2 * math.sqrt(3) * gamma(roundings, dtype) * size
    # Flushed digits move the distance by at most the root of this.
    flushed = 1e3 * math.sqrt(smallest_normal(dtype))
    sizes = jnp.sum(e * e, axis=1)
    close = jnp.tensordot(lowering(k, n, 2).astype(dtype), e, 1)
    line = jnp.tensordot(raising(k, 2, n).astype(dtype), close, 1, precision="highest")
    most = jnp.maximum(jnp.max(sizes, axis=0), jnp.max(jnp.sum(close * close, axis=1), axis=0))
    rest = jnp.max(jnp.sum((e - line) ** 2, axis=1), axis=0)
    square = coefficients_of(k, dot(k, scaled(k, 2, close), scaled(k, n, 2 * e - line)))
    square = square + rest + gamma(64, dtype) * 5 * most
    if w is None:
        found = jnp.minimum(jnp.max(square, axis=0), jnp.max(sizes, axis=0) * (1 + gamma(8, dtype)))
        return _length(found + flushed, off, 0.0)
    w = coefficients_of(k, w)
    hull = jnp.max(sizes / (w * w), axis=0) * (1 + gamma(16, dtype))
    close = jnp.tensordot(lowering(k, n, 2).astype(dtype), w, 1)
    line = jnp.tensordot(raising(k, 2, n).astype(dtype), close, 1, precision="highest")
    most = jnp.maximum(jnp.max(w, axis=0), jnp.max(jnp.abs(close), axis=0))
    below = coefficients_of(k, multiply(k, scaled(k, 2, close), scaled(k, n, 2 * w - line)))
    below = below - gamma(64, dtype) * 5 * most**2
    good = jnp.min(below, axis=0) > 0
    quotient = jnp.max(jnp.maximum(square, 0.0) / jnp.where(good, below, 1.0), axis=0) * (1 + gamma(8, dtype))
    found = jnp.minimum(jnp.where(good, quotient, jnp.inf), hull)
    found = jnp.where(jnp.min(w, axis=0) > smallest_normal(dtype) ** 0.25, found, jnp.inf)
    return _length(found + flushed, off, gamma(2 * roundings, dtype))


def _of_degree_two(k: int, x: Array) -> Array:
    """Return the polynomials in a degree of at least two."""
    return x if x.shape[0] > 2 else multiply(k, x, constant(k, 3 - x.shape[0], x))


def _length(square: Array, off: Array | float, relative: float) -> Array:
    length = jnp.sqrt(square) * (1 + relative) * (1 + gamma(8, square.dtype)) + off
    return round_up(jnp.where(jnp.isnan(length), jnp.inf, length))


def difference(k: int, a: Simplex, b: Simplex) -> tuple[Array, Array | None]:
    """E = w_b a - w_a b and w = w_a w_b in one degree, scaled."""
    n, m = a.points.shape[0] - 1, b.points.shape[0] - 1
    if a.weights is None and b.weights is None:
        degree = max(n, m)
        first, second = (multiply(k, constant(k, degree - x.shape[0] + 1, x), x) for x in (a.points, b.points))
        return first - second, None
    like_weights = a.points[(*(slice(None),) * k, 0)]
    v = constant(k, n, like_weights) if a.weights is None else a.weights
    w = constant(k, m, like_weights) if b.weights is None else b.weights
    wide = [jnp.expand_dims(x, k) for x in (v, w)]
    return multiply(k, a.points, wide[1]) - multiply(k, wide[0], b.points), multiply(k, v, w)
