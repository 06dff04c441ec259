"""Ranges of polynomials in three variables over many boxes at once, five ways with one signature.

Rounding is proven once for each box. Let m = sum |a_ijk| r_x^i r_y^j r_z^k with r = |c| + h. Every way below is a sum
of products of coefficients with c, h and c +- h, and of minima and maxima of such sums, which pass errors on
unchanged. Each elementary term passes through at most k roundings, and the sizes of the terms behind any end of the
result add up to at most m; so a computed end is off by at most gamma(k) m (Higham 2002, Lemma 3.1). With n the sum of
the degrees and T the number of coefficients, k is at most

- "interval", the power form with x^i as the interval of the i-th powers: an end c +- h has one rounding, a power i ends
  and i - 1 products, so 2 i; three products with each other and the coefficient, and T for the sum: 2 n + 3 + T;
- "horner": in each step one rounding of c +- h, one of the product, one of the sum: 3 n;
- "centered" and "modified_affine": 4 n for the local form (`local_form`) and T for the sum: 4 n + T;
- "bernstein": 4 n, and in a variable of degree d one for the entry of the matrix, one for the product, d + 1 for the
  sum: 5 n + 6. The matrix takes the powers of e in [-1, 1] to Bernstein coefficients, means of products of ones and
  minus ones, so that its entries are at most one and the coefficients of a term at most the term.

Eight more cover coefficients that come rounded, the computation of m (in n + 3 roundings, far below the room that
`rounding.gamma` leaves) and r.

Underflow: the variables are scaled by powers of two so that r <= 1. Then an absolute error at any step of the chain
reaches the end with a factor of at most one; there are fewer than 6 T (n + 4) operations, each with an error of at
most nu. Scaled coefficients below nu are lost with an error that is followed exactly; an entry of c or h that is lost
moves f by at most nu times its slope, below 2 n sum |a|.

The local form: on the box |x - c| <= h a polynomial is f(c + h e) = sum D_ijk e_x^i e_y^j e_z^k with noise symbols e in
[-1, 1]. Affine arithmetic gives every term but the first the range [-|D|, |D|]; the modified form knows that a product
of even powers lies in [0, 1].

Arrays of forms have the boxes on the last axis, so that every operation runs along it: synthetic division on such
arrays is 5 to 20 times faster than sums of products that broadcast.

Source: Martin, Shou, Voiculescu, Bowyer & Wang, Comparison of interval methods for plotting algebraic curves, CAGD 19
(2002), section 3.3; Moore, Kearfott & Cloud, Introduction to Interval Analysis (2009), chapter 6; for the Bernstein
form Farouki & Rajan (as in jhd._arithmetic.bernstein). The proof of the rounding is ours.
"""

import math
from functools import cache

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jhd._arithmetic import rounding
from jhd._arithmetic.interval import Interval
from jhd._arithmetic.polynomials import horner
from jhd._runtime.arrays import one_of

Ends = tuple[Array, Array]


def local_form(
    coefficients: Float[Array, "i j k"], center: Float[Array, "3 boxes"], half_width: Float[Array, "3 boxes"]
) -> Float[Array, "i j k boxes"]:
    """The coefficients D of e -> f(c + h e) for every box, by synthetic division, one variable after the other.

    A coefficient of degree i in a variable of degree n reaches its entry through at most 3 n roundings (in each of n
    passes one for the sum in which it stays, and two for each of the at most n steps down that multiply by c), and i <=
    n more for the power of h and its product: 4 n in all. The paths from a_ijk have the sizes of the terms of
    |a_ijk| (|c_x| + h_x)^i (|c_y| + h_y)^j (|c_z| + h_z)^k.
    """
    form = jnp.broadcast_to(coefficients[..., None], (*coefficients.shape, center.shape[-1]))
    for axis in (2, 1, 0):
        rows = [lax.index_in_dim(form, i, axis, keepdims=False) for i in range(form.shape[axis])]
        n = len(rows) - 1
        for first in range(n):
            for i in range(n - 1, first - 1, -1):
                rows[i] = rows[i] + center[axis] * rows[i + 1]
        power = half_width[axis]
        for i in range(1, n + 1):
            rows[i] = rows[i] * power
            power = power * half_width[axis]
        # Without the barrier the loops of all three variables are fused, and everything is computed many times over.
        form = lax.optimization_barrier(jnp.stack(rows, axis))
    return form


def affine_range(form: Float[Array, "i j k boxes"]) -> tuple[Array, Array]:
    """Ends of D_000 +- sum |D|, not rounded outward: the centered form, which is plain affine arithmetic."""
    terms = form.reshape(-1, form.shape[-1])
    spread = jnp.sum(jnp.abs(terms[1:]), axis=0)
    return terms[0] - spread, terms[0] + spread


def modified_affine_range(form: Float[Array, "i j k boxes"]) -> tuple[Array, Array]:
    """Ends of the range with products of even powers in [0, 1], not rounded outward."""
    terms = form.reshape(-1, form.shape[-1])
    even = np.all(np.indices(form.shape[:3]) % 2 == 0, axis=0).ravel()
    even[0] = False
    odd = ~even
    odd[0] = False
    spread = jnp.sum(jnp.abs(terms[np.flatnonzero(odd)]), axis=0)
    squares = terms[np.flatnonzero(even)]
    below, above = jnp.sum(jnp.minimum(squares, 0.0), axis=0), jnp.sum(jnp.maximum(squares, 0.0), axis=0)
    return terms[0] - spread + below, terms[0] + spread + above


def enclose(
    coefficients: Float[Array, "i j k"],
    center: Float[Array, "3 boxes"],
    half_width: Float[Array, "3 boxes"],
    kind: str = "bernstein",
) -> Interval:
    """Interval that contains every value of the polynomial on each box |x - center| <= half_width.

    Args:
        coefficients: entry [i, j, k] belongs to x^i y^j z^k. They may be off by a relative rounding each, u |a|: the
            range covers the exact ones too.
        center: centers of the boxes.
        half_width: half of their sides, not negative.
        kind: "bernstein" (the narrowest), "modified_affine", "centered", "horner" or "interval".

    Returns:
        Bounds; infinite if something overflows.

    Raises:
        ValueError: another kind.
    """
    a, c, h, absolute = _scaled(coefficients, center, half_width)
    ends, roundings = _RANGES[one_of("kind", kind, RANGES)](a, c, h)
    return Interval(*rounding.widen(*ends, _error(a, c, h, roundings, absolute)))


def corner_values(
    coefficients: Float[Array, "i j k"], center: Float[Array, "3 boxes"], half_width: Float[Array, "3 boxes"]
) -> Interval:
    """Intervals that contain the values at the eight corners of each box, in the order of `np.ndindex(2, 2, 2)`.

    From the local form, in 4 n + T roundings: shape (8, boxes).
    """
    a, c, h, absolute = _scaled(coefficients, center, half_width)
    values = local_form(a, c, h)
    for axis in range(3):
        even = jnp.sum(values[(slice(None),) * axis + (slice(0, None, 2),)], axis=axis)
        odd = jnp.sum(values[(slice(None),) * axis + (slice(1, None, 2),)], axis=axis)
        values = jnp.stack([even - odd, even + odd], axis=axis)
    values = values.reshape(8, -1)
    error = _error(a, c, h, 4 * _degrees(a) + a.size, absolute)
    return Interval(*rounding.widen(values, values, error))


def evaluate(coefficients: Float[Array, "i j k"], points: Float[Array, "3 boxes"]) -> Interval:
    """Intervals that contain the values at points, by Horner's rule in 3 n roundings."""
    a, c, h, absolute = _scaled(coefficients, points, jnp.zeros_like(points))
    value = horner(a, c)
    return Interval(*rounding.widen(value, value, _error(a, c, h, 3 * _degrees(a), absolute)))


def _degrees(a: Array) -> int:
    return sum(a.shape) - 3


def _error(a: Array, c: Array, h: Array, roundings: int, absolute: Array) -> Array:
    magnitude = horner(jnp.abs(a), jnp.abs(c) + h)
    return rounding.absolute_error(roundings + 8, magnitude) + absolute


def _scaled(a: Array, c: Array, h: Array) -> tuple[Array, Array, Array, Array]:
    """The polynomial in variables divided by powers of two so that |c| + h <= 1, and error bounds for underflow.

    The error starts with nu for each coefficient, since a subnormal one counts as zero. It is enlarged with the
    coefficient, and grows by nu in each product with a power of two, which is exact otherwise.
    """
    nu = rounding.smallest_normal(a.dtype)
    # Twice, since the power of two may be just above half of the sum, which is rounded.
    scale = 4 * rounding.power_of_two(jnp.max(jnp.abs(c) + h, axis=1, initial=0.0))
    # The reciprocal of a larger one, by which XLA may divide, is flushed to zero.
    scale = jnp.where(scale * nu < 2.0**-8, scale, jnp.inf)
    error = jnp.full(a.shape, nu, a.dtype)
    for axis in range(3):
        shape = [-1 if i == axis else 1 for i in range(3)]
        for power in range(1, a.shape[axis]):
            factor = jnp.where(np.arange(a.shape[axis]) >= power, scale[axis], 1.0).reshape(shape)
            a, error = a * factor, error * factor + 2 * nu
    lost = jnp.sum(error) + 4 * nu * _degrees(a) * jnp.sum(jnp.abs(a))
    operations = 6 * a.size * (_degrees(a) + 4)
    c, h = c / scale[:, None], h / scale[:, None]
    return a, c, h, rounding.round_up(1.01 * lost + operations * nu)


def _centered(a: Array, c: Array, h: Array) -> tuple[Ends, int]:
    return affine_range(local_form(a, c, h)), 4 * _degrees(a) + a.size


def _modified_affine(a: Array, c: Array, h: Array) -> tuple[Ends, int]:
    return modified_affine_range(local_form(a, c, h)), 4 * _degrees(a) + a.size


def _bernstein(a: Array, c: Array, h: Array) -> tuple[Ends, int]:
    form = local_form(a, c, h)
    for axis in range(3):
        form = bernstein_along(form, axis)
    terms = form.reshape(-1, form.shape[-1])
    return (terms.min(0), terms.max(0)), 5 * _degrees(a) + 6


@cache
def bernstein_conversion(degree: int) -> np.ndarray:
    """Entry [j, k]: Bernstein coefficient j of e^k on [-1, 1], the mean over products of k of j ones and n - j -1s."""
    n = degree
    rows = [
        [sum((-1) ** (k - i) * math.comb(j, i) * math.comb(n - j, k - i) for i in range(k + 1)) for k in range(n + 1)]
        for j in range(n + 1)
    ]
    return np.array([[x / math.comb(n, k) for k, x in enumerate(row)] for row in rows])


def power_conversion(degree: int) -> np.ndarray:
    """Entry [k, j]: the coefficient of e^k in Bernstein polynomial j on [-1, 1]; each is rounded once."""
    n = degree
    rows = [
        [
            math.comb(n, j)
            * sum((-1) ** (k - i) * math.comb(j, i) * math.comb(n - j, k - i) for i in range(min(j, k) + 1))
            for j in range(n + 1)
        ]
        for k in range(n + 1)
    ]
    return np.array([[x / 2**n for x in row] for row in rows])


def bernstein_along(form: Array, axis: int) -> Array:
    """Convert power to Bernstein coefficients along one axis; j and n - j use one sum of even and one of odd powers."""
    rows = [form[(slice(None),) * axis + (i,)] for i in range(form.shape[axis])]
    n, matrix, zero = len(rows) - 1, bernstein_conversion(len(rows) - 1), jnp.zeros((), form.dtype)
    result = [rows[0]] * (n + 1)
    for j in range((n + 2) // 2):
        even, odd = (
            sum((float(matrix[j, k]) * rows[k] for k in range(first, n + 1, 2) if matrix[j, k]), zero)
            for first in (0, 1)
        )
        result[j], result[n - j] = even + odd, even - odd
    return jnp.stack(jnp.broadcast_arrays(*result), axis)


def _interval(a: Array, c: Array, h: Array) -> tuple[Ends, int]:
    """The sum of the terms, each the product of a coefficient and the intervals of three powers."""
    low, high = c - h, c + h
    x, y, z = (_powers(low[i], high[i], n) for i, n in enumerate(a.shape))
    xy = _product((x[0][:, None], x[1][:, None]), (y[0][None], y[1][None]))
    below, above = _product((xy[0][:, :, None], xy[1][:, :, None]), (z[0][None, None], z[1][None, None]))
    weight = a[..., None]
    lower, upper = jnp.minimum(weight * below, weight * above), jnp.maximum(weight * below, weight * above)
    boxes = (-1, c.shape[-1])
    return (jnp.sum(lower.reshape(boxes), axis=0), jnp.sum(upper.reshape(boxes), axis=0)), 2 * _degrees(a) + 3 + a.size


def _powers(low: Array, high: Array, count: int) -> Ends:
    """Intervals of x^0 .. x^(count - 1) for x in [low, high], stacked in front."""
    ends = [(jnp.ones_like(low), jnp.ones_like(low)), (low, high)]
    p, q = low, high
    for power in range(2, count):
        p, q = p * low, q * high
        least = jnp.where((low <= 0) & (high >= 0), 0.0, jnp.minimum(p, q))
        ends.append((p, q) if power % 2 else (least, jnp.maximum(p, q)))
    lower, upper = zip(*ends[:count], strict=True)
    return jnp.stack(lower), jnp.stack(upper)


def _interval_horner(a: Array, c: Array, h: Array) -> tuple[Ends, int]:
    low, high = c - h, c + h
    result = a[..., None], a[..., None]
    for axis in (2, 1, 0):
        rows, x = result, (low[axis], high[axis])
        result = rows[0][..., -1, :], rows[1][..., -1, :]
        for power in range(rows[0].shape[-2] - 2, -1, -1):
            lower, upper = _product(result, x)
            result = lower + rows[0][..., power, :], upper + rows[1][..., power, :]
    boxes = (c.shape[-1],)
    return (jnp.broadcast_to(result[0], boxes), jnp.broadcast_to(result[1], boxes)), 3 * _degrees(a)


def _product(x: Ends, y: Ends) -> Ends:
    products = [p * q for p in x for q in y]
    lower = jnp.minimum(jnp.minimum(*products[:2]), jnp.minimum(*products[2:]))
    upper = jnp.maximum(jnp.maximum(*products[:2]), jnp.maximum(*products[2:]))
    return lower, upper


_RANGES = {
    "bernstein": _bernstein,
    "modified_affine": _modified_affine,
    "centered": _centered,
    "horner": _interval_horner,
    "interval": _interval,
}
RANGES = tuple(_RANGES)
