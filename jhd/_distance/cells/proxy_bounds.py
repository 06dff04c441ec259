"""Upper bounds of the distance over cells of any shape, from flat pieces close to the opposite shape.

A cell lies in the convex hull of some points c_i, up to a slack. Near it lie flat pieces F_k (points, segments,
parallelograms, triangles), each of whose points has a point of the opposite shape b within sag_k. Then for x in the
cell

    d(x, b) <= f_k(x) = d(x, F_k) + sag_k,

which is a convex function, as F_k is a convex set. So for all weights w of the simplex the sum of w_k f_k^2, which is
at least the smallest of all f_k^2, is largest at a c_i. The weights that are tried make its gradient along a vanish at
the middle of the cell, as far as possible, which leaves a slack of second order at maxima of every kind.

**Cuts.** If a cell lies near two pieces that meet at an angle or in one plane, no weights serve. Let h_i be any
numbers. The points x = sum l_i c_i of the hull with sum l_i h_i <= 0 are combinations of the c_i with h_i <= 0 and of
the points x_ij at which h vanishes on the lines from these c_i to the others. The same holds for the remaining points,
with h_i > 0. So the larger of f_j^2 at the c_i with h_i <= 0 and f_k^2 at the others, and both at all x_ij, bounds
min(f_j^2, f_k^2). With h the signed root of the difference of the squares it is exact if j and k lie in one plane: the
root is the distance to the wall between them.

Rounding. A point of F_k is computed within gamma(8) of the sum of the sizes of its terms, and so are a difference and
its length; gamma(64) of the largest such sum is more than all of these errors. Sums of weighted squares have positive
terms, relative to which gamma(16) is enough.

Source: convexity as for meshes (jhd._distance.cells.triangles); weights and cuts are ours.
"""

from itertools import combinations
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._arithmetic.rounding import gamma, round_up, smallest_normal
from jhd._distance.cells.surfaces import FEET
from jhd._distance.nearest.target import Flats
from jhd._runtime.arrays import module_of

_PAIRS, _TRIPLES = (np.array(list(combinations(range(FEET), k))) for k in (2, 3))


class Hulls(NamedTuple):
    """Enclosures of cells: convex hulls of points, widened by a slack, and directions along the cells."""

    corners: Any  # the points (cells, corners, 3)
    slack: Any  # largest distance of a point of each cell from the hull
    tangents: Any  # two directions along each cell (cells, 2, 3), zero for none; no proof depends on them


def bound_of(hull: Any, flats: Flats, triangles: bool) -> Array:
    """Upper bound over one cell: corners (corners, 3), slack, tangents (2, 3), and its pieces."""
    corners, slack, tangents = hull
    groups = flats.sag.shape[0] // FEET
    size = jnp.max(jnp.sum(jnp.abs(corners), axis=-1)) + jnp.max(
        jnp.sum(jnp.abs(flats.origin) + jnp.abs(flats.first) + jnp.abs(flats.second), axis=-1)
    )
    apart = vectors_from(flats, jnp.concatenate([corners, jnp.mean(corners, axis=0, keepdims=True)]), triangles)
    squares = _squares(apart[:, :-1], flats)

    def least(apart: Array, squares: Array) -> Array:
        weights = trials(apart, tangents)
        # A piece without a proof counts for nothing, unless its weight is zero.
        terms = jnp.where(weights[:, :, None] > 0, weights[:, :, None] * squares[None], 0.0)
        return jnp.min(jnp.max(jnp.sum(terms, axis=1), axis=1))

    grouped = apart[:, -1].reshape(groups, FEET, 3), squares.reshape(groups, FEET, -1)
    best = jnp.minimum(jnp.min(jax.vmap(least)(*grouped)), _by_a_cut(corners, flats, squares, triangles))
    dtype = best.dtype
    length = jnp.sqrt(best * (1 + gamma(16, dtype)) + 16 * smallest_normal(dtype)) * (1 + gamma(4, dtype))
    return round_up(length + slack + 1.01 * gamma(64, dtype) * size)


def _squares(apart: Array, flats: Flats) -> Array:
    """Squares of f (flats, points); infinite instead of NaN."""
    far = (jnp.sqrt(jnp.sum(apart**2, axis=-1)) + flats.sag[:, None]) ** 2
    return jnp.where(jnp.isnan(far), jnp.inf, far)


def vectors_from(flats: Flats, points: Any, triangles: bool) -> Any:
    """Vectors (.., flats, points, 3) from approximate nearest points of pieces to points (.., points, 3).

    The nearest points are inside a piece, or on the best of its sides. Works in NumPy and in JAX.
    """
    xp = module_of(points)
    a, b = flats.first[..., None, :], flats.second[..., None, :]
    apart = points[..., None, :, :] - flats.origin[..., None, :]
    aa, bb, ab, xa, xb = (xp.sum(x * y, axis=-1) for x, y in ((a, a), (b, b), (a, b), (apart, a), (apart, b)))

    def share(along: Any, square: Any) -> Any:
        return xp.clip(along / xp.where(square > 0, square, 1.0), 0.0, 1.0)

    zero, one, along_a, along_b = xp.zeros_like(xa), xp.ones_like(xa), share(xa, aa), share(xb, bb)
    if triangles:
        # On the side from the end of `a` to the end of `b`.
        over = share(xb - xa - ab + aa, aa + bb - 2 * ab)
        sides = [(along_a, zero), (zero, along_b), (1 - over, over)]
    else:
        sides = [(along_a, zero), (zero, along_b), (share(xa - ab, aa), one), (one, share(xb - ab, bb))]
    area = aa * bb - ab * ab
    safe = xp.where(area > 0, area, 1.0)
    s, t = (xa * bb - xb * ab) / safe, (xb * aa - xa * ab) / safe
    within = (area > 0) & (s >= 0) & (t >= 0) & ((s + t <= 1) if triangles else (s <= 1) & (t <= 1))
    best = apart - xp.where(within, s, 0.0)[..., None] * a - xp.where(within, t, 0.0)[..., None] * b
    for s, t in sides:
        left = apart - s[..., None] * a - t[..., None] * b
        best = xp.where(xp.sum(left**2, axis=-1, keepdims=True) < xp.sum(best**2, axis=-1, keepdims=True), left, best)
    return best


def _by_a_cut(corners: Array, flats: Flats, squares: Array, triangles: bool) -> Array:
    """Upper bound by the best two pieces, with the cell cut where both are equally far."""
    both = jnp.max(jnp.minimum(squares[_PAIRS[:, 0]], squares[_PAIRS[:, 1]]), axis=1)
    j, k = jnp.asarray(_PAIRS)[jnp.argmin(both)]
    difference = squares[j] - squares[k]
    h = jnp.sign(difference) * jnp.sqrt(jnp.abs(difference))
    first, second = np.array(list(combinations(range(corners.shape[0]), 2))).T
    apart = (h[first] > 0) != (h[second] > 0)
    share = jnp.where(apart, h[first] / jnp.where(apart, h[first] - h[second], 1.0), 0.0)
    places = corners[first] + share[:, None] * (corners[second] - corners[first])
    two = jax.tree_util.tree_map(lambda x: x[jnp.stack([j, k])], flats)
    there = jnp.max(jnp.where(apart, _squares(vectors_from(two, places, triangles), two), -jnp.inf))
    found = jnp.maximum(both[jnp.argmin(both)], there)
    return jnp.where(jnp.isnan(found), jnp.inf, found)


def trials(apart: Float[Array, "feet 3"], tangents: Float[Array, "parameters 3"]) -> Float[Array, "trials feet"]:
    """Weights of feet to try, with a sum of at least one: one foot, two or three that balance.

    Two feet are balanced along each parameter, and as well as possible along both; three feet along both.
    """
    tiny = smallest_normal(apart.dtype)
    first = tangents / jnp.sqrt(jnp.maximum(jnp.sum(tangents**2, axis=1, keepdims=True), tiny))
    second = first[1] - jnp.sum(first[0] * first[1]) * first[0]
    first = jnp.stack([first[0], second / jnp.sqrt(jnp.maximum(jnp.sum(second**2), tiny))])
    along = jnp.concatenate([tangents, first])
    pulls = jnp.sum(apart[:, None] * along, axis=-1)  # along u, along v, and in an orthonormal frame
    x, y = pulls[_PAIRS[:, 0]], pulls[_PAIRS[:, 1]]
    change = x[:, :2] - y[:, :2]
    single = -y[:, :2] / jnp.where(change != 0, change, 1.0)
    apart_sq = jnp.sum((x[:, 2:] - y[:, 2:]) ** 2, axis=1)
    both = jnp.sum(y[:, 2:] * (y[:, 2:] - x[:, 2:]), axis=1) / jnp.where(apart_sq > 0, apart_sq, 1.0)
    share = jnp.clip(jnp.concatenate([single[:, 0], single[:, 1], both]), 0.0, 1.0)
    pairs = jnp.asarray(np.tile(_PAIRS, (3, 1)))
    a, b, c = (pulls[_TRIPLES[:, k], 2:] for k in range(3))
    areas = jnp.stack([_turn(b, c), _turn(c, a), _turn(a, b)], axis=1)
    areas = jnp.maximum(areas * jnp.sign(jnp.sum(areas, axis=1, keepdims=True)), 0.0)
    areas = areas / jnp.maximum(jnp.sum(areas, axis=1, keepdims=True), tiny)
    eye = jnp.eye(FEET, dtype=apart.dtype)
    two = share[:, None] * eye[pairs[:, 0]] + (1 - share)[:, None] * eye[pairs[:, 1]]
    three = jnp.sum(areas[:, :, None] * eye[jnp.asarray(_TRIPLES)], axis=1)
    found = jnp.concatenate([eye, two, three])
    # Below a sum of one they would bound too little; a few units of roundoff above it cost as little.
    total = jnp.sum(found, axis=1, keepdims=True)
    sound = jnp.all(jnp.isfinite(found), axis=1, keepdims=True) & (total > 0.5)
    return jnp.where(sound, found / jnp.where(sound, total, 1.0), eye[0]) * (1 + gamma(8, found.dtype))


def _turn(x: Array, y: Array) -> Array:
    return x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]
