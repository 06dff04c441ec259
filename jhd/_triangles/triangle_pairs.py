"""Distances of many pairs of triangles at once: proven bounds, whatever the triangles' shapes are.

Two points p, q of the triangles are found as the nearest of fifteen candidates: on nine pairs of edges, and six
vertices with their feet on the other face. The bounds do not depend on how they are found:

- **upper**: p and q are points of the triangles up to rounding, so |p - q| is an upper bound;
- **lower**: for any vector n of length one, min over a of n.x less max over b of n.x is a lower bound, and of convex
  sets the minimum or maximum is at a corner. Tried are the direction of p - q, both normals and the normal of the
  nearest pair of edges. If triangles do not meet, one of these is the direction of the nearest points up to rounding,
  even if p - q has few digits because they are close. If triangles meet, the bound is negative.

Degenerate triangles are the convex hulls of their corners, like all others.

Rounding. All is computed about one corner o of the second triangle, with coordinates of at most `size` in either
triangle, which are rounded once. A scalar product with n rounds each of its three terms six times at most, and the
length of n is off by gamma(10); so the gap is off by gamma(48) size + gamma(16) of itself. A point
o + x + r u + s v with r, s >= 0, r + s <= 1 up to a rounding is off by gamma(12) size in each coordinate, so both
together by gamma(48) size in length. Underflow takes off at most `absolute_floor`.

Source: Ericson, Real-Time Collision Detection (2005), sections 5.1.5 and 5.1.9, for the points; the bounds are ours.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._triangles.point_triangle import absolute_floor


class PairBounds(NamedTuple):
    """Bounds for pairs of triangles."""

    lower: Float[Array, " pairs"]  # proven lower bounds of the distances
    upper: Float[Array, " pairs"]  # proven upper bounds
    gap: Float[Array, " pairs"]  # the largest gap along a direction; negative if triangles meet or may meet


def lower_bounds(a: Float[Array, "corners 3 pairs"], b: Float[Array, "corners 3 pairs"]) -> Float[Array, " pairs"]:
    """Proven lower bounds of the distances, computed fast along the lines that join the triangles' middles."""
    s, t = a - b[0], b - b[0]
    gap = _gap(jnp.sum(s, axis=0) - jnp.sum(t, axis=0), s, t)
    return _proven(gap, _size(s, t))


def pair_bounds(a: Float[Array, "corners 3 pairs"], b: Float[Array, "corners 3 pairs"]) -> PairBounds:
    """Bounds of the distances of the triangles; coordinates of at most one."""
    s, t = a - b[0], b - b[0]
    size, dtype = _size(s, t), a.dtype
    best, across = _nearest(s, t)
    square = _dot(best, best)
    directions = [best, _normal(s), _normal(t), across]
    gap = jnp.stack([_gap(n, s, t) for n in directions]).max(axis=0)
    upper = jnp.sqrt(square) * (1 + gamma(16, dtype)) + gamma(48, dtype) * size + absolute_floor(dtype)
    return PairBounds(_proven(gap, size), upper, gap)


def _proven(gap: Array, size: Array) -> Array:
    dtype = gap.dtype
    lower = (gap - gamma(48, dtype) * size) * (1 - gamma(16, dtype)) - 64 * smallest_normal(dtype)
    return jnp.where(lower > 0, lower, 0.0)


def _size(s: Array, t: Array) -> Array:
    return jnp.maximum(jnp.max(jnp.abs(s), axis=(0, 1)), jnp.max(jnp.abs(t), axis=(0, 1)))


def _gap(direction: Array, s: Array, t: Array) -> Array:
    """The gap between the triangles along a direction or its opposite; zero for a zero direction."""
    most = jnp.max(jnp.abs(direction), axis=0)
    n = direction / jnp.where(most > 0, most, 1.0)
    length = jnp.sqrt(_dot(n, n))
    n = n / jnp.where(most > 0, length, 1.0)
    first, second = _dot(s, n), _dot(t, n)
    return jnp.maximum(jnp.min(first, 0) - jnp.max(second, 0), jnp.min(second, 0) - jnp.max(first, 0))


def _nearest(s: Array, t: Array) -> tuple[Array, Array]:
    """The difference of the nearest pair of points found, and the normal of the nearest pair of edges."""
    turned = [jnp.roll(x, -1, axis=0) for x in (s, t)]
    start = (jnp.full(s.shape[1:], jnp.inf, s.dtype), jnp.zeros(s.shape[1:], s.dtype))
    pairs = [(i, j) for i in range(3) for j in range(3)]
    best, across = start
    for i, j in pairs:
        best, across = _nearer(*_of_edges(s[i], turned[0][i] - s[i], t[j], turned[1][j] - t[j]), best, across)
    for first, second, sign in ((s, t, 1), (t, s, -1)):
        for corner in first:
            best, across = _nearer(sign * _foot(corner, second), across, best, across)
    return best, across


def _nearer(difference: Array, normal: Array, best: Array, across: Array) -> tuple[Array, Array]:
    shorter = _dot(difference, difference) < _dot(best, best)
    return jnp.where(shorter, difference, best), jnp.where(shorter, normal, across)


def _of_edges(p: Array, u: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """The difference of nearest points of the edges p + [0, 1] u and q + [0, 1] v, and their common normal."""
    w = p - q
    a, b, c, d, e = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, w), _dot(v, w)
    # The best parameter on the first edge, then on the second, then on the first again as the second may be clipped.
    first = _share(b * e - c * d, a * c - b * b)
    second = _share(b * first + e, c)
    first = _share(b * second - d, a)
    return w + first * u - second * v, _cross(u, v)


def _foot(p: Array, t: Array) -> Array:
    """The difference of a point and its foot on the face of t; infinite if the foot is not inside."""
    u, v, w = t[1] - t[0], t[2] - t[0], p - t[0]
    normal = _cross(u, v)
    square = _dot(normal, normal)
    safe = jnp.where(square > 0, square, 1.0)
    second, third = _dot(_cross(w, v), normal) / safe, _dot(_cross(u, w), normal) / safe
    inside = (second >= 0) & (third >= 0) & (second + third <= 1) & (square > 0)
    return jnp.where(inside, w - second * u - third * v, jnp.inf)


def _share(part: Array, whole: Array) -> Array:
    return jnp.clip(part / jnp.where(whole > 0, whole, jnp.inf), 0.0, 1.0)


def _normal(t: Array) -> Array:
    return _cross(t[1] - t[0], t[2] - t[0])


def _dot(x: Array, y: Array) -> Array:
    """Scalar products of vectors (..., 3, pairs)."""
    return x[..., 0, :] * y[..., 0, :] + x[..., 1, :] * y[..., 1, :] + x[..., 2, :] * y[..., 2, :]


def _cross(x: Array, y: Array) -> Array:
    return jnp.stack([x[i] * y[j] - x[j] * y[i] for i, j in ((1, 2), (2, 0), (0, 1))])
