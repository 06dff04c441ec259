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

**Pieces.** The part of a parametric shape to which the cell projects, a box of parameters, is compared with the linear
map L that fits its control points b_ij best. Since b(u, v) = sum w_ij b_ij for non-negative w_ij of sum one that depend
on u and v, with (s, t) = sum w_ij (i / p, j / q)

    |b(u, v) - L(s, t)| = |sum w_ij (b_ij - L(i / p, j / q))| <= max |b_ij - L(i / p, j / q)|,

and (s, t) takes all values in [0, 1]^2, as sides go to sides. So each point of the parallelogram L has a point of b
within this bound.

For an implicit surface f = 0 the piece is a parallelogram in the tangent plane at the foot. On a box about it, with n
the normal, let m > 0 bound the slope of f along n from below and let |f| <= e on the parallelogram. Then f has both
signs on the line along n through each of its points, within e / m, as long as this stays within the box. Next to a face
of the box the lines run along the part of n in the face, so they never leave the box there. If f is zero on all of the
face, they may cross it, since a zero beyond it is no nearer than the face. Points that are outside the box by rounding
count as moved to its border.

Rounding. A point of F_k is computed within gamma(8) of the sum of the sizes of its terms, and so are a difference and
its length; gamma(64) of the largest such sum is more than all of these errors. Sums of weighted squares have positive
terms, relative to which gamma(16) is enough. Control points of a part are off by eta
(jhd._distance.normalization.net_jets) in each coordinate, the fit needs no proof, and a residual takes three roundings;
forms have their own bounds (jhd._distance.nearest.forms).

Source: convexity as for meshes (jhd._distance.cells.triangles); weights and cuts are ours.
"""

import math
from itertools import combinations
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._arithmetic.polynomials import slopes
from jhd._arithmetic.rounding import gamma, round_up, smallest_normal
from jhd._distance.cells.surfaces import FEET
from jhd._distance.nearest.forms import boxes, form, slope_changes
from jhd._distance.nearest.target import Flats
from jhd._distance.normalization.net_jets import Net, eta, jet, part_of
from jhd._distance.normalization.surfaces import Side
from jhd._runtime.arrays import module_of

_PAIRS, _TRIPLES = (np.array(list(combinations(range(FEET), k))) for k in (2, 3))
# Room for the curvature of the surface near the parallelogram, as a multiple of the first estimate.
_ROOM = 2.0
# The least room, as a fraction of the parallelogram, and in roundings of a coordinate of one.
_MARGIN, _THICK = 2.0**-6, 2**10


def of_points(points: Array, error: Any) -> Flats:
    """The feet (feet, 3) themselves, off by an error each."""
    nothing = jnp.zeros_like(points)
    return Flats(points, nothing, nothing, jnp.broadcast_to(jnp.asarray(error, points.dtype), points.shape[:1]))


def beside_net(net: Net, piece: Array, x: Array, corners: Array) -> Flats:
    """Return the flat piece near the part of a piece, around parameters x, onto which the cell's corners project."""
    part = net.piece(piece)
    at = jet(part, x)
    apart = corners - at.point
    n = net.parameters
    a = at.first[0]
    b = at.first[1] if n == 2 else jnp.zeros_like(a)
    steps = jnp.stack(_coordinates(apart, a, b)[:n], axis=-1)
    steps = jnp.where(jnp.isfinite(steps), steps, 0.0)
    low, high = (jnp.clip(x + f(steps, axis=0), 0.0, 1.0) for f in (jnp.min, jnp.max))
    points = part_of(part, low, high).points
    p, q = net.degrees
    # In degree zero there is one parameter, in the middle.
    shares = [((np.arange(k + 1) - 0.5 * k) / max(k, 1)).astype(points.dtype)[:, None] for k in (p, q)]
    u, v = shares[0][:, :, None], shares[1][None]
    first, second = (jnp.sum(s * points, axis=(0, 1)) / _sum_of_squares(s, points) for s in (u, v))
    rest = points - (u * first + v * second)
    most, least = jnp.max(rest, axis=(0, 1)), jnp.min(rest, axis=(0, 1))
    center = 0.5 * (most + least)
    rest = jnp.sqrt(jnp.max(jnp.sum((rest - center) ** 2, axis=-1)))
    size = jnp.max(jnp.abs(points)) + jnp.max(jnp.abs(first)) + jnp.max(jnp.abs(second))
    dtype = points.dtype
    sag = rest * (1 + gamma(16, dtype)) + math.sqrt(3) * (1.01 * eta(net) + gamma(16, dtype) * size)
    return Flats(center - 0.5 * first - 0.5 * second, first, second, round_up(sag))


def _sum_of_squares(shares: np.ndarray, points: Array) -> Any:
    """Sum of squares over as many rows as there are control points; one if that is zero."""
    return np.sum(np.broadcast_to(shares, (*points.shape[:2], 1)) ** 2) or 1.0


def _coordinates(apart: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Coordinates of vectors (points, 3) along two others; one by one if these are nearly parallel."""
    aa, bb, ab = (jnp.sum(x * y) for x, y in ((a, a), (b, b), (a, b)))
    xa, xb = jnp.sum(apart * a, axis=-1), jnp.sum(apart * b, axis=-1)
    determinant = aa * bb - ab * ab
    apt = determinant > 1e-12 * aa * bb
    safe = jnp.where(apt, determinant, 1.0)
    single = (xa / jnp.where(aa > 0, aa, 1.0), xb / jnp.where(bb > 0, bb, 1.0))
    both = ((xa * bb - xb * ab) / safe, (xb * aa - xa * ab) / safe)
    return jnp.where(apt, both[0], single[0]), jnp.where(apt, both[1], single[1])


def beside_surface(side: Side, feet: Array, radius: Array, corners: Array) -> Flats:
    """Parallelograms in the tangent planes at feet (feet, 3) onto which a cell's corners (corners, 3) project."""
    slope = jnp.moveaxis(slopes(jnp.asarray(side.coefficients), feet.T)[1], -1, 0).reshape(feet.shape)
    square = jnp.sum(slope**2, axis=-1, keepdims=True)
    # If the gradient vanishes there is no tangent plane; any direction is valid, and proves nothing.
    some = square > 0
    normal = jnp.where(some, slope / jnp.sqrt(jnp.where(some, square, 1.0)), jnp.eye(3, dtype=feet.dtype)[0])
    least = jnp.eye(3, dtype=feet.dtype)[jnp.argmin(jnp.abs(normal), axis=-1)]
    along = jnp.cross(normal, least)
    along = along / jnp.sqrt(jnp.sum(along**2, axis=-1, keepdims=True))
    across = jnp.cross(normal, along)
    apart = corners[None] - feet[:, None]
    ends = [jnp.sum(apart * e[:, None], axis=-1) for e in (along, across)]
    (s0, s1), (t0, t1) = ((jnp.min(x, axis=1)[:, None], jnp.max(x, axis=1)[:, None]) for x in ends)
    flats = Flats(feet + s0 * along + t0 * across, (s1 - s0) * along, (t1 - t0) * across, radius)
    sag = _sag(side, flats, normal, jnp.zeros_like(radius))
    # If the parallelogram leaves the box, a larger one need not be tried.
    sag = _sag(side, flats, normal, _ROOM * jnp.where(jnp.isfinite(sag), sag, 0.0))
    return flats._replace(sag=sag)


def _sag(side: Side, flats: Flats, normal: Array, thickness: Array) -> Array:
    """Distance within which the pieces are proven to have surface points; infinite if it exceeds `thickness`."""
    o, a, b = flats.origin, flats.first, flats.second
    vertices = jnp.stack([o, o + a, o + b, o + a + b], axis=1)
    dtype = o.dtype
    off = gamma(32, dtype) * (1 + jnp.max(jnp.abs(vertices), axis=1))
    # In a box that is too thin the errors of the polynomial are more than its slope.
    wide = _MARGIN * jnp.max(jnp.abs(a) + jnp.abs(b), axis=1, keepdims=True) + gamma(_THICK, dtype)
    room = thickness[:, None] * (1 + gamma(8, dtype)) + 2 * off + wide
    bottom, top = jnp.min(vertices, axis=1), jnp.max(vertices, axis=1)
    lower, upper = jnp.asarray(side.lower), jnp.asarray(side.upper)
    low, high = bottom - room, top + room
    below, above = side.vanishing_faces
    held = ((low < lower) & ~below) | ((high > upper) & ~above)
    # Rounding of the vertices included.
    outside = jnp.maximum(jnp.maximum(lower - bottom, top - upper) + 0.5 * off, 0.0)
    inside = jnp.all(outside <= off, axis=-1)
    cells = boxes(low.T, high.T)
    f = form(side, cells)
    half = cells.half.T
    local = (vertices - cells.center.T[:, None]) / half[:, None]
    size = jnp.sum(jnp.abs(f.slope), axis=0) + jnp.abs(f.value) + f.rest
    values = jnp.max(jnp.abs(f.value[:, None] + jnp.sum(f.slope.T[:, None] * local, axis=-1)), axis=1)
    slopes, change = f.slope.T / half, slope_changes(f).T + 4 * f.error[:, None] * sum(f.local.shape[:3])
    loose = change / half + gamma(64, dtype) * jnp.abs(slopes)
    moved = outside * (jnp.abs(slopes) + loose)
    most = values + f.rest + f.error + gamma(64, dtype) * size + jnp.sum(moved, axis=-1) * (1 + gamma(16, dtype))
    along = jnp.where(held, 0.0, normal)
    least = jnp.sum(along * slopes, axis=-1) - jnp.sum(jnp.abs(along) * loose, axis=-1) * (1 + gamma(16, dtype))
    away = most / jnp.where(least > 0, least, 1.0) * (1 + gamma(32, dtype))
    first_look = thickness == 0
    good = inside & (least > 0) & (first_look | (away <= thickness))
    sag = round_up(away + jnp.sum(outside, axis=-1) * (1 + gamma(8, dtype)))
    return jnp.where(good & jnp.isfinite(sag), sag, jnp.inf)


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
