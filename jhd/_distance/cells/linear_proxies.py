"""Flat pieces close to surfaces and curves, near feet of a cell: the proxies of jhd._distance.cells.proxy_bounds.

The part of a parametric shape to which the cell projects, a box of parameters, is compared with the linear map L that
fits its control points b_ij best. Since b(u, v) = sum w_ij b_ij for non-negative w_ij of sum one that depend on u and
v, with (s, t) = sum w_ij (i / p, j / q)

    |b(u, v) - L(s, t)| = |sum w_ij (b_ij - L(i / p, j / q))| <= max |b_ij - L(i / p, j / q)|,

and (s, t) takes all values in [0, 1]^2, as sides go to sides. So each point of the parallelogram L has a point of b
within this bound.

For an implicit surface f = 0 the proxy is a parallelogram in the tangent plane at the foot. On a box about it, with n
the normal, let m > 0 bound the slope of f along n from below and let |f| <= e on the parallelogram. Then f has both
signs on the line along n through each of its points, within e / m, as long as this stays within the box. Next to a face
of the box the lines run along the part of n in the face, so they never leave the box there. If f is zero on all of the
face, they may cross it, since a zero beyond it is no nearer than the face. Points that are outside the box by rounding
count as moved to its border.

Rounding: control points of a part are off by eta (jhd._distance.normalization.net_jets) in each coordinate, the fit
needs no proof, and a residual takes three roundings; forms have their own bounds (jhd._distance.nearest.forms).
"""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.polynomials import slopes
from jhd._arithmetic.rounding import gamma, round_up
from jhd._distance.nearest.forms import boxes, form, slope_changes
from jhd._distance.nearest.target import Flats
from jhd._distance.normalization.net_jets import Net, eta, jet, part_of
from jhd._distance.normalization.surfaces import Side

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
