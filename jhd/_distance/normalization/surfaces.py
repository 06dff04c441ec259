"""Implicit surfaces in common coordinates, each with another shape: moved to the origin, scaled by a power of two.

The exact distance refers to the stored coefficients and boxes. The corners of the boxes move without rounding: an axis
is moved only if its coordinates lie so far from the origin, compared with their extent, that the difference to their
middle is exact (Sterbenz). The same holds for the control points of a parametric shape. Each coefficient comes with a
bound of its error. Known surfaces are written in the new coordinates in exact arithmetic and rounded once, so neither
size nor location costs digits. Under tracing the shift is rounded; far from the origin its errors are large, and the
bounds include them.

Coordinates below the smallest normal number count as zero.
"""

from fractions import Fraction
from itertools import product
from math import comb
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic import exact_polynomials, scaling
from jhd._arithmetic.isolated_zeros import isolated_zeros
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.normalization.coordinates import Frame, common_points, exact_middle, extremes, frame_of
from jhd._distance.normalization.isolated import IsolatedPoints, isolated_points, none_known
from jhd._distance.normalization.net_jets import Net, usable_net
from jhd._runtime.arrays import is_traced
from jhd._shapes.implicit import ImplicitSurface

# Degrees in each variable that are compiled; above the last one, each degree is compiled.
_DEGREES = (2, 3, 4, 6, 8)
# Powers of two below this one, relative to the largest coefficient, are nothing.
_LOWEST = -960


class Side(NamedTuple):
    """A surface in common coordinates, which are at most one.

    Args:
        coefficients: entry [i, j, k] belongs to x^i y^j z^k; the same degree in each variable, the largest one below 1.
        error: bounds of their errors as coefficients of a positive multiple of the exact polynomial.
        lower: the lower corner of the box.
        upper: the upper corner.
        vanishing: entry [i, j, k], with 0 for the lower end of a coordinate, 2 for the upper end and 1 for the whole
            range: whether the exact polynomial is known to be zero on the whole face, edge or corner.
        isolated: points at which it is zero without a change of sign.
    """

    coefficients: Any  # (n, n, n)
    error: Any  # (n, n, n)
    lower: Any  # (3,)
    upper: Any  # (3,)
    vanishing: Any  # (3, 3, 3)
    isolated: IsolatedPoints = none_known(np.float64)
    # A cell is a part of the box.
    parameters = 3

    def piece(self, k: Array) -> "Side":
        """Return the surface, which is its own only piece."""
        return self

    def point(self, x: Array) -> Array:
        """Return a point from its coordinates."""
        return x

    @property
    def vanishing_faces(self) -> tuple[Array, Array]:
        """Return whether the polynomial is known to be zero on the whole lower, and upper, face of each coordinate."""
        whole = jnp.asarray(self.vanishing)
        lower, upper = (jnp.stack([whole[end, 1, 1], whole[1, end, 1], whole[1, 1, end]]) for end in (0, 2))
        return lower, upper


def prepare_surfaces(a: Any, b: Any) -> tuple[Any, Any, Frame]:
    """Return both shapes in common coordinates of size at most one, and the frame that leads back to the user's.

    At least one is an ImplicitSurface, which becomes a Side; a Net stays a Net.
    """
    traced = is_traced(a, b)
    xp: Any = jnp if traced else np
    good = _usable(a) & _usable(b) if traced else True
    boxes = [_box(xp, shape) for shape in (a, b)]
    ends = [[xp.where(good, end, default) for end, default in zip(box, (-1.0, 1.0), strict=True)] for box in boxes]
    frame = frame_of([(low, high) for low, high in ends], good, exact_middle)
    ends = [[common_points(frame, end) for end in box] for box in ends]
    written = _rounded if traced else _exact
    known = [None if isinstance(s, Net) else written(s, frame, box) for s, box in zip((a, b), ends, strict=True)]
    size = padded(max(max(p[0].shape) - 1 for p in known if p is not None)) + 1
    sides = [
        _moved(xp, shape, frame) if p is None else _side(xp, p, box, size)
        for shape, p, box in zip((a, b), known, ends, strict=True)
    ]
    return sides[0], sides[1], frame


def _box(xp: Any, shape: ImplicitSurface | Net) -> tuple[Any, Any]:
    if isinstance(shape, ImplicitSurface):
        return shape.bounds
    return extremes(xp.asarray(shape.points))


def _moved(xp: Any, net: Net, frame: Frame) -> Net:
    """Return the net in common coordinates, without rounding."""
    points, weights = xp.asarray(net.points), net.weights
    if is_traced(frame.usable):
        points = jnp.where(frame.usable, points, 0.0)
        weights = None if weights is None else jnp.where(frame.usable, weights, 1.0)
    return Net(common_points(frame, points), weights)


def padded(degree: int) -> int:
    """Return the smallest compiled degree that is at least `degree`."""
    return next((bucket for bucket in _DEGREES if bucket >= degree), degree)


def _side(xp: Any, polynomial: tuple[Any, ...], box: list[Any], size: int) -> Side:
    coefficients, error, vanishing, isolated = polynomial
    room = [(0, size - n) for n in coefficients.shape]
    dtype = box[0].dtype
    a, e = (xp.pad(x, room).astype(dtype) for x in (coefficients, error))
    return Side(a, e, box[0], box[1], vanishing, isolated)


def _usable(surface: ImplicitSurface | Net) -> Any:
    if isinstance(surface, Net):
        return usable_net(surface)
    numbers = jnp.concatenate([surface.coefficients.ravel(), surface.lower, surface.upper])
    some = jnp.any(scaling.frexp(surface.coefficients)[0] != 0)
    return jnp.all(jnp.isfinite(numbers)) & some & jnp.all(surface.lower < surface.upper)


def _exact(surface: ImplicitSurface, frame: Frame, box: list[Any]) -> tuple[Any, ...]:
    """Return coefficients, their errors, the strata of zeros and isolated points, from exact arithmetic."""
    exact = exact_polynomial(surface, frame)
    dtype = np.asarray(surface.lower).dtype
    nu, u = smallest_normal(dtype), float(np.finfo(dtype).eps)
    floats = exact_polynomials.floats(exact)
    rounded = np.where(np.abs(floats) < nu, 0.0, floats).astype(dtype)
    error = np.where(exact == 0, 0.0, np.maximum(u * np.abs(floats), 2 * nu))
    return rounded, error, _vanishing(exact, floats, box), _isolated(exact, floats, frame, box)


def _isolated(exact: np.ndarray, floats: np.ndarray, frame: Frame, box: list[Any]) -> IsolatedPoints:
    lower, upper = (np.asarray(end) for end in box)
    unit = Fraction(2) ** int(frame.first + frame.second)
    middle = [Fraction(float(x)) * Fraction(2) ** int(frame.first) for x in np.asarray(frame.center)]

    def simple(place: np.ndarray) -> list[Fraction]:
        """Return a nearby point with short fractions in the user's coordinates."""
        there = [m + unit * Fraction(float(x)) for m, x in zip(middle, place, strict=True)]
        # The largest denominator of coordinates that are tried for an isolated point.
        return [(x.limit_denominator(1 << 12) - m) / unit for m, x in zip(middle, there, strict=True)]

    ends = lower.astype(np.float64), upper.astype(np.float64)
    return isolated_points(isolated_zeros(exact, floats, *ends, simple), lower, upper)


def exact_polynomial(surface: ImplicitSurface, frame: Frame) -> np.ndarray:
    """Return a positive multiple of the polynomial of a known surface in common coordinates, in integers."""
    two = Fraction(2)
    first, second = int(frame.first), int(frame.second)
    middle = [Fraction(float(x)) * two**first for x in np.asarray(frame.center)]
    exact = exact_polynomials.trimmed(exact_polynomials.integers(np.asarray(surface.coefficients)))
    return exact_polynomials.substituted(exact, middle, [two ** (first + second)] * 3)


def _vanishing(exact: np.ndarray, floats: np.ndarray, box: list[Any]) -> np.ndarray:
    """Return on which faces, edges and corners of the box the polynomial is zero."""
    found = np.zeros((3, 3, 3), bool)
    corners = [np.asarray(box[0], float), None, np.asarray(box[1], float)]
    for stratum in product(range(3), repeat=3):
        fixed = [(axis, corners[end][axis]) for axis, end in enumerate(stratum) if end != 1]
        if not fixed:
            continue
        near = floats
        for axis, x in reversed(fixed):
            near = np.tensordot(near, x ** np.arange(near.shape[axis]), axes=(axis, 0))
        # Rounding cannot make zero larger than this: the largest coefficient is below one.
        if np.max(np.abs(near), initial=0.0) > 1e-9 * floats.size:
            continue
        rest = exact
        for axis, x in reversed(fixed):
            rest = _restricted(rest, axis, Fraction(float(x)))
        found[stratum] = not np.any(rest != 0)
    return found


def _restricted(polynomial: np.ndarray, axis: int, x: Fraction) -> np.ndarray:
    """Return a positive multiple of the polynomial with a number for one variable."""
    rows, n = np.moveaxis(polynomial, axis, 0), polynomial.shape[axis] - 1
    total = np.zeros(rows.shape[1:], dtype=object)
    for i, row in enumerate(rows):
        total = total + row * (x.numerator**i * x.denominator ** (n - i))
    # The last variable leaves a plain number.
    return np.asarray(total, dtype=object)


def _rounded(surface: ImplicitSurface, frame: Frame, box: list[Any]) -> tuple[Any, ...]:
    """Return the results of `_exact`, computed in floating point.

    A coefficient of the shifted polynomial is a sum of terms a_i C(i, j) c^(i - j), each with at most four roundings
    for every degree of every variable. The bound counts them, relative to the sum of the sizes of the terms. Scalings
    are powers of two. If a term is flushed to zero, 2^-900 of the largest covers it.
    """
    a = jnp.where(frame.usable, surface.coefficients, 0.0)
    a = jnp.where(frame.usable, a, a.at[0, 0, 0].set(1.0))
    degrees = np.sum(np.indices(a.shape), axis=0)
    c = jnp.asarray(frame.center)
    a, flushed = _scaled(a, jnp.zeros_like(a), degrees * frame.first)
    magnitude = jnp.abs(a)
    for axis in range(3):
        a, magnitude, flushed = (
            _shifted(x, by[axis], axis) for x, by in ((a, c), (magnitude, abs(c)), (flushed, abs(c)))
        )
    error = gamma(4 * (sum(a.shape) - 3) + 8, a.dtype) * magnitude + 2 * flushed
    a, error = _scaled(a, error, degrees * frame.second)
    zero = (a == 0) & (error == 0)
    low, high = (jnp.asarray(end) == 0 for end in box)
    faces = jnp.zeros((3, 3, 3), bool)
    for axis in range(3):
        # Only if a coordinate ends at zero are the coefficients on the face known without rounding.
        free = jnp.all(jnp.take(zero, 0, axis=axis))
        place = [1, 1, 1]
        for end, at_zero in ((0, low), (2, high)):
            place[axis] = end
            faces = faces.at[tuple(place)].set(free & at_zero[axis])
    return a, error, faces, none_known(a.dtype)


def _scaled(a: Array, error: Array, exponents: Any) -> tuple[Array, Array]:
    """Return both times 2^exponents and a power of two that brings the largest coefficient to [1/2, 1).

    Coefficients below 2^-960 of the largest become zero, and their errors grow accordingly. Subnormal coefficients keep
    their values.
    """
    mantissa, own = scaling.frexp(a)
    some = mantissa != 0
    total = jnp.where(some, own + exponents, -(10**8))
    shift = total - jnp.max(total)
    kept = shift >= _LOWEST
    lost = jnp.where(some & ~kept, 2.0**_LOWEST if a.dtype == jnp.float64 else smallest_normal(a.dtype), 0.0)
    scaled = jnp.where(kept & some, scaling.ldexp(mantissa, jnp.where(kept, shift, 0)), 0.0)
    # Errors are rounded up to a power of two of their own.
    unit, power = scaling.frexp(error)
    power = power + exponents - jnp.max(total)
    grown = scaling.ldexp(unit, jnp.clip(power, _LOWEST, 1000))
    return scaled, jnp.where(error > 0, grown, 0.0) + lost


def _shifted(a: Array, by: Array, axis: int) -> Array:
    """Return the coefficients of w -> f(w + by) in one variable."""
    rows, n = [jnp.take(a, i, axis=axis) for i in range(a.shape[axis])], a.shape[axis] - 1
    powers = [jnp.ones_like(by)]
    for _ in range(n):
        powers.append(powers[-1] * by)
    return jnp.stack(
        [sum(comb(i, j) * powers[i - j] * rows[i] for i in range(j, n + 1)) for j in range(n + 1)], axis=axis
    )
