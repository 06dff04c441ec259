"""Polynomials on boxes in Bernstein form, and proven lower bounds of distances to an implicit surface in a box.

For a point p and a box C, the smallest Bernstein coefficient of |q - p|^2 - lambda f_b(q) over C bounds the squared
distance of p from the part of b in C, for every real lambda; the values tried make its gradient as small as possible.

Rounding. The terms of a form are off by at most `error` = gamma(7 N + 40) m + e(r), with N the sum of degrees, m the
size sum |a_ijk| r^(i, j, k) of the polynomial on the cell, r = |c| + h, and e the errors of its coefficients
(jhd._arithmetic.trivariate derives 5 N + 6, and N + 9 allow for the matrices here and for r above one by a few
roundings; N for a shift of the center whose sum is rounded, and what is left for the products and sums in which the
terms take part: each is at most m in size, so lambda times the terms, added to something, costs gamma(4) |lambda| m).
A squared distance |p - q|^2 on a cell is off by at most gamma(24) R with R = sum (|c_i - q_i| + h_i)^2: differences of
coordinates have one rounding each and everything after them is a sum of products of at most this size in all.

Coordinates and coefficients are at most one (jhd._distance.normalization.surfaces), so what underflow takes is below
2^-900 and 2^-110 in double and single precision.

Source: the bounds are ours. Bernstein form: Farouki & Rajan, CAGD 5 (1988).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jhd._arithmetic.polynomials import horner
from jhd._arithmetic.rounding import gamma, smallest_normal, unit_roundoff
from jhd._arithmetic.trivariate import bernstein_along, bernstein_conversion
from jhd._distance.normalization.isolated import cleared
from jhd._distance.normalization.surfaces import Side
from jhd._runtime.arrays import varying


class Boxes(NamedTuple):
    """Cells, and boxes |x - center| <= half that contain them."""

    lower: Float[Array, "3 cells"]
    upper: Float[Array, "3 cells"]
    center: Float[Array, "3 cells"]
    half: Float[Array, "3 cells"]


class Form(NamedTuple):
    """A polynomial on cells: its power form in e = (x - center) / half, its Bernstein coefficients, and their error.

    A cleared cell is known to have no zero, whatever the coefficients say.
    """

    local: Float[Array, "i j k cells"]
    terms: Float[Array, "terms cells"]
    error: Float[Array, " cells"]
    cleared: Bool[Array, " cells"]

    @property
    def value(self) -> Array:
        """The value at the center."""
        return self.local[0, 0, 0]

    @property
    def slope(self) -> Array:
        """The gradient at the center times the half widths."""
        return jnp.stack([self.local[1, 0, 0], self.local[0, 1, 0], self.local[0, 0, 1]])

    @property
    def rest(self) -> Array:
        """Sum of the sizes of all terms of degree two and more, rounded up."""
        terms = jnp.abs(self.local.reshape(-1, self.local.shape[-1]))
        sizes = jnp.sum(terms, axis=0)
        rest = jnp.maximum(sizes - jnp.abs(self.value) - jnp.sum(jnp.abs(self.slope), axis=0), 0.0)
        return rest + gamma(terms.shape[0] + 8, terms.dtype) * sizes

    @property
    def may_vanish(self) -> Array:
        """Whether the exact polynomial may be zero somewhere in the cell."""
        some = (jnp.min(self.terms, axis=0) <= self.error) & (jnp.max(self.terms, axis=0) >= -self.error)
        return some & ~self.cleared


def boxes(lower: Float[Array, "3 cells"], upper: Float[Array, "3 cells"]) -> Boxes:
    """Return centers and half widths of cells; the half widths are rounded up."""
    center = 0.5 * (lower + upper)
    half = jnp.maximum(center - lower, upper - center)
    half = half * (1 + 4 * unit_roundoff(half.dtype)) + smallest_normal(half.dtype)
    return Boxes(lower, upper, center, half)


def form(side: Side, cells: Boxes) -> Form:
    """Return the polynomial of a side on cells."""
    a = jnp.asarray(side.coefficients)
    whole = jnp.broadcast_to(a[..., None], (*a.shape, cells.center.shape[-1]))

    # One axis after the other, always the first: this compiles three times as fast as all axes at once.
    def about(axis: Array, x: Array) -> Array:
        return jnp.moveaxis(_shifted(x, cells.center[axis], cells.half[axis]), 0, 2)

    local = jax.lax.fori_loop(0, 3, about, varying(whole, side, cells))
    terms = jax.lax.fori_loop(0, 3, lambda _, x: jnp.moveaxis(bernstein_along(x, 0), 0, 2), local)
    sizes = gamma(7 * _degrees(a) + 40, a.dtype) * jnp.abs(a) + side.error
    error = horner(sizes, jnp.abs(cells.center) + cells.half) + underflow(a.dtype)
    known = cleared(side.isolated, cells.lower, cells.upper)
    return Form(local, terms.reshape(-1, terms.shape[-1]), error, known)


def signed_values(side: Side, points: Float[Array, "3 points"]) -> tuple[Array, Array]:
    """Return values of the polynomial at points, and error bounds: gamma(6 N) m + e for Horner's rule."""
    a = jnp.asarray(side.coefficients)
    sizes = gamma(6 * _degrees(a) + 8, a.dtype) * jnp.abs(a) + side.error
    return horner(a, points), horner(sizes, jnp.abs(points)) + underflow(a.dtype)


def lower_bounds(
    form_b: Form, cells: Boxes, point: Float[Array, "3"], free: Bool[Array, "3 cells"]
) -> Float[Array, " cells"]:
    """Return lower bounds of the distance of a point to the part of b in cells.

    Args:
        form_b: the polynomial of b on the cells.
        cells: the cells.
        point: the point, exact.
        free: mask of the coordinates in which a cell does not touch the box of b.
    """
    apart = cells.center - point[:, None]
    factors = multiples(2 * apart * cells.half, form_b.slope, free)
    quadratic = squares(jnp.broadcast_to(point[:, None], apart.shape)[None], cells, form_b.local.shape[0])
    size = jnp.sum((jnp.abs(apart) + cells.half) ** 2, axis=0)
    least = jnp.min(quadratic - factors[:, None] * form_b.terms, axis=1)
    error = gamma(24, size.dtype) * size + jnp.abs(factors) * form_b.error
    best = jnp.max(jnp.nan_to_num(least - 1.01 * error, nan=0.0, posinf=0.0, neginf=0.0), axis=0)
    gaps = jnp.maximum(jnp.abs(apart) - cells.half, 0.0)
    best = jnp.maximum(best, jnp.sum(gaps**2, axis=0) - gamma(24, size.dtype) * size)
    root = jnp.sqrt(jnp.maximum(best, 0.0)) * (1 - 8 * unit_roundoff(best.dtype)) - smallest_normal(best.dtype) ** 0.5
    return jnp.maximum(root, 0.0)


def slope_changes(f: Form) -> Float[Array, "3 cells"]:
    """Bound the change of the slopes by terms of degree two and more, times the half widths."""
    sizes = jnp.abs(f.local)
    powers = np.indices(sizes.shape[:3]).astype(sizes.dtype)
    for axis in range(3):
        powers[axis][tuple(1 if k == axis else 0 for k in range(3))] = 0
    return jnp.sum(powers[..., None] * sizes, axis=(1, 2, 3)) * (1 + gamma(sizes[..., 0].size + 16, sizes.dtype))


def box_distances(cells: Boxes, point: Array) -> tuple[Array, Array]:
    """Return the least and the largest distance from a point, or one point for each cell, to the points of cells."""
    apart = jnp.abs(cells.center - (point[:, None] if point.ndim == 1 else point))
    near, far = jnp.maximum(apart - cells.half, 0.0), apart + cells.half
    slack = gamma(12, apart.dtype) * jnp.sqrt(jnp.sum(far**2, axis=0)) + smallest_normal(apart.dtype) ** 0.5
    least, most = (jnp.sqrt(jnp.sum(x**2, axis=0)) for x in (near, far))
    return jnp.maximum(least - slack, 0.0), most + slack


def multiples(
    pull: Float[Array, "3 cells"], slope: Float[Array, "3 cells"], free: Bool[Array, "3 cells"]
) -> Float[Array, "trials cells"]:
    """Return factors for which pull - factor slope is zero in one coordinate, or least in all or in the free ones."""
    part = jnp.where(free, slope, 0.0)
    whole, some = (jnp.sum(pull * x, axis=0) / positive(jnp.sum(x**2, axis=0)) for x in (slope, part))
    single = pull / jnp.where(slope != 0, slope, jnp.inf)
    return finite_or_zero(jnp.stack([jnp.zeros_like(whole), whole, some, *single]))


def squares(points: Float[Array, "sets 3 cells"], cells: Boxes, size: int) -> Array:
    """Return the Bernstein coefficients (sets, terms, cells) of |x - point|^2."""
    first, second = (jnp.asarray(bernstein_conversion(size - 1)[:, k], points.dtype)[:, None] for k in (1, 2))
    apart = cells.center - points
    h = cells.half
    x, y, z = (
        (apart[:, i] ** 2)[:, None] + (2 * apart[:, i] * h[i])[:, None] * first + h[i] ** 2 * second for i in range(3)
    )
    total = x[:, :, None, None] + y[:, None, :, None] + z[:, None, None, :]
    return total.reshape(total.shape[0], size**3, -1)


def _shifted(form: Array, center: Array, half: Array) -> Array:
    """Return the coefficients in e of x = center + half e for the first variable, by synthetic division."""
    rows = list(form)
    n = len(rows) - 1
    for first in range(n):
        for i in range(n - 1, first - 1, -1):
            rows[i] = rows[i] + center * rows[i + 1]
    power = half
    for i in range(1, n + 1):
        rows[i] = rows[i] * power
        power = power * half
    return jnp.stack(rows)


def _degrees(a: Array) -> int:
    return sum(a.shape) - 3


def underflow(dtype: np.dtype) -> float:
    """Bound the underflow error of any value, if coordinates and coefficients are at most one."""
    return 2.0**-900 if np.dtype(dtype) == np.float64 else 2.0**-110


def positive(x: Array) -> Array:
    """Return the numbers as divisors: infinity replaces each number that is not positive."""
    return jnp.where(x > 0, x, jnp.inf)


def finite_or_zero(x: Array) -> Array:
    """Return the numbers, with zero for each number that is not finite."""
    return jnp.where(jnp.isfinite(x), x, 0.0)
