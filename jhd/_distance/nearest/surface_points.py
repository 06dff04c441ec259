"""Points of implicit surfaces in boxes, many at once: near a location, nearest to a point, and their proof.

Points and feet are found by a few steps of Newton's method within the box. No proof depends on them: a point is proven
if the polynomial has two signs on a short segment of the closed box about it, or if it lies on a face, an edge or a
corner on which the polynomial is known to be zero. In floating point, enclosures give the signs, and err by far more
than an ulp of the point; in integers the signs are exact.
"""

import math
from fractions import Fraction
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jhd._arithmetic import exact_polynomials
from jhd._arithmetic.polynomials import jets, slopes
from jhd._arithmetic.rounding import like_double, round_up, smallest_normal, unit_roundoff
from jhd._distance.nearest.forms import positive, signed_values
from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.isolated import isolated_radius, snapped
from jhd._distance.normalization.surfaces import Side, exact_polynomial
from jhd._runtime.arrays import varying
from jhd._shapes.implicit import ImplicitSurface

# The longest step, as a fraction of the box, and how far from singular the system of a foot has to be.
_LONGEST, _DEFINITE = 0.3, 0.1
# Steps of signs in integers, as powers of two of the roundoff of the largest coordinate.
_RADII = (-2, 1, 4, 8)
# If the gradient vanishes, changes of sign are searched at these distances.
_DISTANCES = [2.0**power for power in (-48, -40, -32, -28, -26, -24, -22, -20, -17, -14, -11)]


def projected(
    side: Side, points: Float[Array, "3 points"], fixed: Bool[Array, "3 points"], steps: int
) -> Float[Array, "3 points"]:
    """Return points of the surface near the given points of the box, with the `fixed` coordinates unchanged."""
    lower, upper = jnp.asarray(side.lower)[:, None], jnp.asarray(side.upper)[:, None]

    def step(_: Any, x: Array) -> Array:
        value, gradient = slopes(jnp.asarray(side.coefficients), x)
        return jnp.clip(x + _back(value, jnp.where(fixed, 0.0, gradient), x, lower, upper), lower, upper)

    found = jax.lax.fori_loop(0, steps, step, varying(points, side))
    return snapped(side.isolated, found, points)


def _back(value: Array, gradient: Array, x: Array, lower: Array, upper: Array) -> Array:
    """Return the Newton step along the gradient; coordinates at a face that it would leave stay."""
    move = -value * gradient / positive(jnp.sum(gradient**2, axis=0))
    for _ in range(2):
        leaving = ((x <= lower) & (move < 0)) | ((x >= upper) & (move > 0))
        gradient = jnp.where(leaving, 0.0, gradient)
        move = -value * gradient / positive(jnp.sum(gradient**2, axis=0))
    return _short(move, lower, upper)


def _short(move: Array, lower: Array, upper: Array) -> Array:
    length, most = jnp.sqrt(jnp.sum(move**2, axis=0)), _LONGEST * jnp.max(upper - lower)
    return jnp.where(jnp.isfinite(length), move * jnp.minimum(1.0, most / positive(length)), 0.0)


def local_feet(
    side: Side, points: Float[Array, "3 points"], starts: Float[Array, "3 points"], steps: int
) -> Float[Array, "3 points"]:
    """Return points of the surface near the starts, approximately nearest on their part of it.

    A step solves (1 + mu T) s = t for the move s along the surface, with t the tangential part of point - q, mu the
    multiplier of the gradient, and T the tangential part of the second derivatives. If 1 + mu T is not positive
    definite, only its non-positive direction is damped; if neither direction is clearly positive, both are. Faces that
    the move would leave hold their coordinate for this step.
    """
    lower, upper = jnp.asarray(side.lower)[:, None], jnp.asarray(side.upper)[:, None]

    def step(_: Any, q: Array) -> Array:
        value, gradient, hessian = jets(jnp.asarray(side.coefficients), q)

        def hold(_: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
            move = _tangential(points - q, gradient, hessian, state[0])
            return state[0] | ((q <= lower) & (move < 0)) | ((q >= upper) & (move > 0)), move

        held, move = jax.lax.fori_loop(0, 3, hold, (q > q, q - q))
        move = _short(jnp.where(held, 0.0, move), lower, upper)
        there = jnp.clip(q + move, lower, upper)
        # The value at the new point, to second order, gives the way back.
        value = value + jnp.sum(gradient * move, axis=0) + 0.5 * jnp.sum(hessian * move * move[:, None], axis=(0, 1))
        slope = gradient + jnp.sum(hessian * move, axis=1)
        return jnp.clip(there + _back(value, jnp.where(held, 0.0, slope), there, lower, upper), lower, upper)

    found = returned(side, jax.lax.fori_loop(0, steps, step, varying(starts, side, points)), 2)
    return snapped(side.isolated, found, starts)


def returned(side: Side, points: Float[Array, "3 points"], steps: int) -> Float[Array, "3 points"]:
    """Return points of the surface near the given points, within their faces unless the surface only touches these."""
    lower, upper = jnp.asarray(side.lower)[:, None], jnp.asarray(side.upper)[:, None]

    def back(_: Any, q: Array) -> Array:
        value, gradient = slopes(jnp.asarray(side.coefficients), q)
        return jnp.clip(q + _back(value, _within(q, gradient, lower, upper), q, lower, upper), lower, upper)

    return snapped(side.isolated, jax.lax.fori_loop(0, steps, back, varying(points, side)), points)


def _within(q: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """Return the part of the gradient within the faces that hold a point; all of it if that part is negligible."""
    within = jnp.where((q <= lower) | (q >= upper), 0.0, gradient)
    # A direction within a face serves unless the gradient is this much longer.
    enough = jnp.sum(within**2, axis=0) > 0.1**2 * jnp.sum(gradient**2, axis=0)
    return jnp.where(enough, within, gradient)


def _tangential(apart: Array, gradient: Array, hessian: Array, held: Array) -> Array:
    """Return the damped Newton step along the surface of `local_feet`; held coordinates do not move."""
    n = jnp.where(held, 0.0, gradient)
    e = jnp.where(held, 0.0, apart)
    square = positive(jnp.sum(n**2, axis=0))
    mu = jnp.sum(e * n, axis=0) / square
    t = e - mu * n
    unit = n / jnp.sqrt(square)
    h = jnp.where(held[:, None] | held[None], 0.0, hessian)
    along = jnp.sum(h * unit, axis=1)
    h = h - unit[:, None] * along[None] - along[:, None] * unit[None]
    h = mu * (h + jnp.sum(along * unit, axis=0) * unit[:, None] * unit[None])
    size = jnp.sqrt(jnp.sum(h**2, axis=(0, 1)))
    # In the plane of the surface the eigenvalues of 1 + h have this sum and product.
    trace = h[0, 0] + h[1, 1] + h[2, 2]
    minor = 0.5 * (trace**2 - jnp.sum(h**2, axis=(0, 1)))
    definite = (1 + trace + minor > _DEFINITE) & (2 + trace > 2 * _DEFINITE)
    # If the distance grows along only one direction, the step along it stays Newton's.
    eye = jnp.eye(3, dtype=h.dtype)[..., None]
    root = jnp.sqrt(jnp.maximum(0.25 * trace**2 - minor, 0.0))
    first, second = 0.5 * trace + root, 0.5 * trace - root
    across = (first * (eye - unit[:, None] * unit) - h) / positive(first - second)
    # The distance grows along a direction if this second derivative of half the squared distance is exceeded.
    h = jnp.where(definite, h, jnp.where(1 + first > 0.5, h + (size - second) * across, size * eye))
    return _solved(h + eye, t)


def _solved(matrix: Array, right: Array) -> Array:
    """Return solutions of 3 x 3 systems, by Cramer's rule."""
    rows = [_cross(matrix[i], matrix[j]) for i, j in ((1, 2), (2, 0), (0, 1))]
    determinant = jnp.sum(matrix[0] * rows[0], axis=0)
    found = sum(right[i] * rows[i] for i in range(3)) / jnp.where(determinant != 0, determinant, jnp.inf)
    return jnp.where(jnp.isfinite(found), found, 0.0)


def _cross(x: Array, y: Array) -> Array:
    return jnp.stack([x[j] * y[k] - x[k] * y[j] for j, k in ((1, 2), (2, 0), (0, 1))])


def proven_radius(side: Side, points: Float[Array, "3 points"]) -> Float[Array, " points"]:
    """Return lengths within which a point of the surface, in its box, is proven; infinite if none is.

    Both ends of a short segment along the gradient are floats in the box, and the signs there hold for the exact
    polynomial. At a face the segment stays in it, unless the surface nearly touches it.
    """
    lower, upper = jnp.asarray(side.lower)[:, None], jnp.asarray(side.upper)[:, None]
    value, gradient = slopes(jnp.asarray(side.coefficients), points)
    error = signed_values(side, points)[1]
    within = _within(points, gradient, lower, upper)
    slope = positive(jnp.sqrt(jnp.sum(within**2, axis=0)))
    u = unit_roundoff(points.dtype)
    step = 2 * (2 * error + jnp.abs(value)) / slope + 8 * u * jnp.max(jnp.abs(points), axis=0)
    ends = [jnp.clip(points + sign * step * within / slope, lower, upper) for sign in (-1, 1)]
    count = points.shape[1]
    values, errors = signed_values(side, jnp.concatenate(ends, axis=1))
    first, second, wrong, off = values[:count], values[count:], errors[:count], errors[count:]
    proven = ((first > wrong) & (second < -off)) | ((first < -wrong) & (second > off))
    far = [reach(end - points) for end in ends]
    inside = jnp.all((points >= lower) & (points <= upper), axis=0)
    radius = round_up(jnp.maximum(*far))
    radius = jnp.where(proven & inside, radius, jnp.inf)
    radius = jnp.minimum(radius, isolated_radius(side.isolated, points))
    # A change of sign farther away than this proves nothing about the point itself; near singular points it is about
    # the root of the roundoff.
    radius = jnp.where(radius <= like_double(1e-6, points.dtype), radius, jnp.inf)
    return jnp.where(inside & _on_vanishing(side, points, lower, upper), 0.0, radius)


def reach(offsets: Float[Array, "3 ..."]) -> Array:
    """Bound the lengths of vectors from above, including a few roundings and the underflow of squares."""
    dtype = offsets.dtype
    lost = 2 * smallest_normal(dtype) ** 0.5
    return (jnp.sqrt(jnp.sum(offsets**2, axis=0)) + lost) * (1 + 8 * unit_roundoff(dtype))


def thorough_radius(side: Side, points: Float[Array, "3 points"]) -> Float[Array, " points"]:
    """Return `proven_radius`, but also prove points at which the gradient vanishes, such as the apex of a cone."""
    return with_singular_radius(side, points, proven_radius(side, points))


def with_singular_radius(side: Side, points: Float[Array, "3 points"], radius: Array) -> Float[Array, " points"]:
    """Return `thorough_radius`, given the result of `proven_radius`."""

    def both(radius: Array) -> Array:
        return jnp.minimum(radius, _singular_radius(side, points))

    return jax.lax.cond(jnp.any(jnp.isinf(radius)), both, lambda radius: radius, radius)


def _singular_radius(side: Side, points: Float[Array, "3 points"]) -> Float[Array, " points"]:
    """Return lengths within which two of six neighbors along the axes, in the box, have different signs.

    The segment between both keeps to the box, and to the ball about the point that holds them.
    """
    lower, upper = jnp.asarray(side.lower)[:, None], jnp.asarray(side.upper)[:, None]
    units = jnp.asarray(np.concatenate([np.eye(3), -np.eye(3)]).T[:, :, None], points.dtype)
    inside = jnp.all((points >= lower) & (points <= upper), axis=0)

    def within(distance: Array, radius: Array) -> Array:
        ends = jnp.clip(points[:, None] + distance * units, lower[:, None], upper[:, None])
        values, errors = (x.reshape(6, -1) for x in signed_values(side, ends.reshape(3, -1)))
        proven = jnp.any(values > errors, axis=0) & jnp.any(values < -errors, axis=0)
        far = round_up(jnp.max(reach(ends - points[:, None]), axis=0))
        return jnp.where(proven & inside, jnp.minimum(far, radius), radius)

    start = varying(jnp.full(points.shape[1], jnp.inf, points.dtype), side, points)
    distances = jnp.asarray([like_double(x, points.dtype) for x in _DISTANCES], points.dtype)
    return jax.lax.fori_loop(0, len(_DISTANCES), lambda i, radius: within(distances[i], radius), start)


def exact_radius(surface: ImplicitSurface, side: Side, frame: Frame, x: np.ndarray) -> float:
    """A length within which a known surface, in its box, has a point, proven by signs in integers; else infinite.

    The polynomial is evaluated at x + h w in the box, with entries of w in {0, 1, -1}, for a few steps h from some ulps
    on. Between two points of different signs there is a point of the surface. The length is zero for x on it.
    """
    polynomial = exact_polynomial(surface, frame)
    lower, upper = (np.asarray(end, np.float64).tolist() for end in (side.lower, side.upper))
    center, info = [Fraction(c) for c in np.asarray(x, np.float64).tolist()], np.finfo(np.asarray(x).dtype)
    size = max(*np.abs(lower), *np.abs(upper))
    for power in _RADII:
        step = Fraction(max(size * float(info.eps), float(info.tiny))) * Fraction(2) ** power
        inside = [
            [w for w in (0, -1, 1) if low <= c + w * step <= high]
            for c, low, high in zip(center, lower, upper, strict=True)
        ]
        places = np.array(list(product(*inside)), dtype=int).reshape(-1, 3).T
        found = exact_polynomials.signs(exact_polynomials.substituted(polynomial, center, [step] * 3), places)
        if places.size and found[0] == 0:
            return 0.0
        if places.size and found.min() <= 0 <= found.max():
            return math.sqrt(3) * float(step) * (1 + 1e-15)
    return math.inf


def _on_vanishing(side: Side, points: Array, lower: Array, upper: Array) -> Array:
    place = jnp.where(points == lower, 0, jnp.where(points == upper, 2, 1))
    return jnp.asarray(side.vanishing).ravel()[place[0] * 9 + place[1] * 3 + place[2]]
