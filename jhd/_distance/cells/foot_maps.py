"""Upper bounds of the distance over a cell of a curve, patch or triangle by feet that follow the points of the cell.

A cell is a segment or triangle of parameters u of one piece of a. For every map sigma of the cell into the parameters
of one piece of b, the distance of a(u) is at most |a(u) - b(sigma(u))|. Here sigma is the quadratic polynomial through
the feet of six points close to the corners and the middles of the sides (of three on a segment), its coefficients
clipped to the domain, which is convex and so holds all of its values. Nothing is proven about the feet, which need not
be the nearest ones. If sigma follows the feet to third order, the bound is off by the square of this error. So it
closes also at shapes that are equally far from each other along whole regions. The foot of a corner itself may have
many parameters, if a side of b is a single point.

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

A piece of a shape is a piece of a net, or a triangle, whose parameters are its three barycentric coordinates. On its
sides one parameter is zero, or, for a net, one. Functions of parts take many cells at once, along the last axis.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma, round_up, smallest_normal
from jhd._arithmetic.simplices import (
    LEVEL,
    coefficients_of,
    composed,
    constant,
    dot,
    fitting,
    lowering,
    multiply,
    raising,
    scaled,
)
from jhd._distance.cells.pairs import newton_step
from jhd._distance.normalization.net_jets import Net, NetJet, jet

# How far towards the middle of a cell the points lie whose feet are followed.
INSET = 0.125
# Newton steps towards the foot of the middle, and from there towards the feet of the other points.
_FIRST, _STEPS = 4, 4
# How far feet are followed beyond the sides of a piece.
BEYOND = 0.5
# Steps of the method of false position towards a point whose foot is on a side, and Newton steps in each.
_ROOT_STEPS, _STEPS_IN_ROOTS = 7, 3


class Triangles(NamedTuple):
    """The corners (triangles, 3, 3) of triangles."""

    corners: Any
    # Feet take no steps; points have three barycentric coordinates; the degrees cover fewer than 20 roundings of parts.
    flat, parameters, degrees = True, 3, (1, 0)

    def piece(self, k: Array) -> "Triangles":
        """Return the triangle with index `k`, or the triangles with an array of indices."""
        return Triangles(self.corners[k])

    def point(self, x: Array) -> Array:
        """Return the point of one triangle at its barycentric coordinates."""
        return jnp.sum(x[:, None] * self.corners, axis=0)


def weighted(shares: Array, rows: Array) -> Array:
    """Return the sums of `rows` weighted by `shares`."""
    return jnp.sum(shares[:, :, None] * rows[None], axis=1)


def foot_map(places: Array, b: Net | Triangles, start: Array, beyond: Array | float = 0.0) -> Array:
    """Coefficients (indices, parameters of b) of a quadratic foot map into the domain of the piece b.

    Args:
        places: points of a at the inner lattice of the cell, (indices, 3).
        b: the piece.
        start: parameters of b near the foot of the middle.
        beyond: how far a net is continued beyond its sides.
    """
    matrix = fitting(1 if len(places) == 3 else 2, 2, INSET).astype(places.dtype)
    if b.flat:
        feet = jax.vmap(lambda p: foot_near(b, p, start))(places)
        found = jnp.maximum(jnp.sum(matrix[:, :, None] * feet[None], axis=1), 0.0)
        return found / jnp.sum(found, axis=1, keepdims=True)
    feet = _followed(b, places, jnp.mean(places, axis=0), start, beyond)
    return jnp.clip(jnp.sum(matrix[:, :, None] * feet[None], axis=1), -beyond, 1 + beyond)


def foot_near(
    b: Net | Triangles, place: Array, start: Array, steps: int = _FIRST + _STEPS, beyond: float = 0.0
) -> Array:
    """Return the parameters of the foot of `place` on a piece, or `beyond` its sides, searched from `start`."""
    if isinstance(b, Triangles):
        return (_in_plane if beyond else _on_triangle)(b.corners, place)
    return foot_between(b, place, start, steps, -beyond, 1 + beyond)


def foot_between(b: Net, place: Array, start: Array, steps: int, low: Array | float, high: Array | float) -> Array:
    """Return the parameters of b between `low` and `high` at about the foot of `place`, searched from `start`."""
    return jax.lax.fori_loop(0, steps, lambda _, x: _nearer(b, place, x, low, high), start)


def _nearer(b: Net, place: Array, x: Array, low: Array | float, high: Array | float) -> Array:
    """Return x after one step of Newton's method, kept between `low` and `high`."""
    return stepped(jet(b, x), place, x, low, high)


def stepped(at: NetJet, place: Array, x: Array, low: Array | float, high: Array | float) -> Array:
    """Return x after one step of Newton's method towards the foot of `place`, given the point and derivatives at x."""
    e = at.point - place
    slope = jnp.sum(at.first * e, axis=-1)
    bent = jnp.sum(at.first[:, None] * at.first[None], axis=-1) + jnp.sum(at.second * e, axis=-1)
    held = ((x <= low) & (slope > 0)) | ((x >= high) & (slope < 0))
    moved = x + newton_step(slope, bent, held)
    return jnp.clip(jnp.where(jnp.isfinite(moved), moved, x), low, high)


def _followed(b: Any, places: Array, middle: Array, start: Array, beyond: Array | float) -> Array:
    """Return the parameters of the feet of `places`, found from `start` by way of the foot of `middle`.

    All first go to the foot of the middle, side by side: one loop compiles in half the time of two.
    """

    def step(k: Array, x: Array) -> Array:
        towards = jnp.where(k < _FIRST, middle, places)
        return jax.vmap(lambda p, x: _nearer(b, p, x, -beyond, 1 + beyond))(towards, x)

    return jax.lax.fori_loop(0, _FIRST + _STEPS, step, jnp.broadcast_to(start, (len(places), len(start))))


def _in_plane(corners: Array, place: Array) -> Array:
    """The barycentric coordinates of the foot in the plane of a triangle."""
    a, b, p = corners[1] - corners[0], corners[2] - corners[0], place - corners[0]
    aa, bb, ab, pa, pb = (jnp.sum(x * y) for x, y in ((a, a), (b, b), (a, b), (p, a), (p, b)))
    area = jnp.maximum(aa * bb - ab * ab, smallest_normal(place.dtype))
    s, t = (pa * bb - pb * ab) / area, (pb * aa - pa * ab) / area
    return jnp.stack([1 - s - t, s, t])


def _on_triangle(corners: Array, place: Array) -> Array:
    """Return barycentric coordinates of a triangle's nearest point: the foot in its plane, or on the nearest side."""
    inside = _in_plane(corners, place)
    ends = np.array([[0, 1], [1, 2], [2, 0]])

    def on_side(i: Array, j: Array) -> tuple[Array, Array]:
        along, p = corners[j] - corners[i], place - corners[i]
        square = jnp.sum(along * along)
        share = jnp.clip(jnp.sum(p * along) / jnp.where(square > 0, square, 1.0), 0.0, 1.0)
        eye = jnp.eye(3, dtype=place.dtype)
        return (1 - share) * eye[i] + share * eye[j], jnp.sum((p - share * along) ** 2)

    rows, squares = jax.vmap(on_side)(jnp.asarray(ends[:, 0]), jnp.asarray(ends[:, 1]))
    return jnp.where(jnp.all(inside >= 0), inside, rows[jnp.argmin(squares)])


def distance_to(triangle: Triangles, place: Array) -> Array:
    """Return the distance of the point `place` from a triangle."""
    return jnp.sqrt(jnp.sum((triangle.point(_on_triangle(triangle.corners, place)) - place) ** 2))


def _sides(b: Net | Triangles, x: Array) -> Array:
    """Return one number for each side: positive inside the piece and zero on that side."""
    return x if b.flat else jnp.concatenate([x, 1 - x])


def beyond_sides(b: Net | Triangles, points: Array, start: Array) -> Array:
    """Return how far inside each side of a piece the feet of points are, (points, sides); negative beyond it."""
    if b.flat:
        return jax.vmap(lambda p: _sides(b, foot_near(b, p, start, beyond=BEYOND)))(points)
    return jax.vmap(partial(_sides, b))(_followed(b, points, points[-1], start, BEYOND))


def share_on_side(
    a: Net | Triangles, b: Net | Triangles, ends: Array, start: Array, side: Array, values: Array
) -> Array:
    """Return the fraction of the way between two points of a at which the foot reaches a side of b.

    Args:
        a: the piece with the points.
        b: the piece with the feet.
        ends: parameters of the two points, (2, parameters).
        start: parameters of b near the feet.
        side: index of the side.
        values: `beyond_sides` of both ends at this side, of different signs.
    """

    def value(share: Array) -> Array:
        x = ends[0] + share * (ends[1] - ends[0])
        return _sides(b, foot_near(b, a.point(x), start, _FIRST + _STEPS_IN_ROOTS, BEYOND))[side]

    def step(_: Any, state: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, first, second, last, _ = state
        share = low + (high - low) * first / (first - second)
        share = jnp.where(jnp.isfinite(share), share, 0.5 * (low + high))
        found = value(share)
        # The end that stays counts half (the Illinois variant).
        left = found * first > 0
        first_again = jnp.where(~left & (last < 0), 0.5, 1.0) * first
        second_again = jnp.where(left & (last > 0), 0.5, 1.0) * second
        ends = jnp.where(left, share, low), jnp.where(left, high, share)
        return (
            *ends,
            jnp.where(left, found, first_again),
            jnp.where(left, second_again, found),
            jnp.where(left, 1.0, -1.0),
            share,
        )

    zero = jnp.zeros_like(values[0])
    state = (zero, zero + 1, values[0], values[1], zero, zero + 0.5)
    share = jax.lax.fori_loop(0, _ROOT_STEPS, step, state)[-1]
    return jnp.clip(jnp.where(jnp.isfinite(share), share, 0.5), 0.0, 1.0)


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
