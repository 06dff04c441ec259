"""Polynomials in Bernstein form.

A polynomial of degree n on [0, 1] is the array of its n + 1 coefficients along one axis of an array; every function
takes that axis, so a vector-valued polynomial has one more axis (points, dim), and a polynomial in two or three
variables is treated one variable after the other. All of it is written with static degrees and works under jit, vmap
and differentiation.

Rounding: restriction, splitting and evaluation are chains of convex combinations (1 - t) a + t b. Each level costs at
most three roundings of numbers whose weights are non-negative and sum to one (1 - t, the products, the sum), so after k
levels the error of a result is at most `rounding.absolute_error(3 k, m)`, m the largest |coefficient| that it was
computed from. A product costs 3 + min(n, m) roundings of terms whose weights sum to one. That holds for t in [0, 1] and
as long as nothing overflows; subnormal coefficients count as zero.

Source: Farouki & Rajan, Algorithms for polynomials in Bernstein form, CAGD 5 (1988); Ramshaw, Blossoms are polar forms,
CAGD 6 (1989).
"""

import math
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jhd._runtime.arrays import varying


@cache
def binomials(degree: int) -> np.ndarray:
    """Binomial coefficients C(degree, 0..degree) as float64; exact up to degree 56."""
    return np.array([math.comb(degree, i) for i in range(degree + 1)], dtype=float)


def basis(degree: int, t: ArrayLike) -> np.ndarray:
    """Values (..., degree + 1) of the Bernstein polynomials at the parameters t (...,), in NumPy.

    >>> basis(2, 0.5).tolist()
    [0.25, 0.5, 0.25]
    """
    x, k = np.asarray(t)[..., None], np.arange(degree + 1)
    return binomials(degree) * x**k * (1 - x) ** (degree - k)


def blossoms(t0: np.ndarray, t1: np.ndarray, degree: int) -> np.ndarray:
    """The matrices (count, degree + 1, degree + 1) that restrict coefficients to [t0, t1], in NumPy.

    Row j holds the weights of the blossom with degree - j arguments t0 and j arguments t1: three roundings a degree.

    >>> blossoms(np.array([0.0]), np.array([0.5]), 2)[0].tolist()
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.25, 0.5, 0.25]]
    """
    rows = np.zeros((len(t0), degree + 1, degree + 1))
    for j in range(degree + 1):
        row = rows[:, j]
        row[:, 0] = 1.0
        for k in range(degree):
            t = (t0 if k < degree - j else t1)[:, None]
            before = row[:, : k + 1].copy()
            row[:, : k + 1] *= 1 - t
            row[:, 1 : k + 2] += t * before
    return rows


@cache
def product_weights(n: int, m: int) -> np.ndarray:
    """The (n + 1, m + 1) table C(n,i) C(m,j) / C(n+m,i+j) of the product rule, each entry rounded once."""
    return np.array(
        [[math.comb(n, i) * math.comb(m, j) / math.comb(n + m, i + j) for j in range(m + 1)] for i in range(n + 1)]
    )


def degree(coefficients: Array, axis: int = -1) -> int:
    """Degree of the form: one less than the number of coefficients along `axis`."""
    return coefficients.shape[axis] - 1


def evaluate(coefficients: Float[Array, "..."], t: ArrayLike, axis: int = -1) -> Array:
    """Value at the scalar t, by de Casteljau's algorithm; the coefficient axis is gone from the result.

    Args:
        coefficients: any array; `axis` holds the coefficients.
        t: scalar; the form is defined for every t, its hull property holds for t in [0, 1].
        axis: the coefficient axis.
    """
    c = jnp.moveaxis(coefficients, axis, 0)
    while c.shape[0] > 1:
        c = (1 - t) * c[:-1] + t * c[1:]
    return c[0]


def derivative(coefficients: Float[Array, "..."], axis: int = -1) -> Array:
    """Coefficients of the derivative, n (c_{i+1} - c_i), one degree lower; a constant gives the constant zero."""
    n = degree(coefficients, axis)
    if n == 0:
        return jnp.zeros_like(coefficients)
    return n * jnp.diff(coefficients, axis=axis)


def multiply(f: Float[Array, "..."], g: Float[Array, "..."]) -> Array:
    """Coefficients of the product f g along the last axis; leading axes broadcast.

    (f g)_k = sum over i + j = k of C(n,i) C(m,j) / C(n+m,k) f_i g_j: non-negative weights that sum to one. The weight
    is applied last, so that an underflow is not enlarged; the error is at most
    absolute_error(3 + min(n, m), max|f| max|g|), plus nu (max|f| + max|g|) if coefficients are subnormal.

    >>> [float(x) for x in multiply(jnp.array([0.0, 1.0]), jnp.array([1.0, 0.0]))]  # t (1 - t)
    [0.0, 0.5, 0.0]

    Source: Farouki & Rajan 1988, equation (44).
    """
    n, m = degree(f), degree(g)
    weights = product_weights(n, m).astype(jnp.result_type(f, g))
    return shifted_sum((f[..., :, None] * g[..., None, :]) * weights)


def shifted_sum(rows: Float[Array, "... rows columns"]) -> Array:
    """The sum of the rows after row k is shifted k entries to the right."""
    *lead, count, length = rows.shape
    # Rows are padded and flattened; reading them back with rows one entry shorter shifts row k by k.
    wide = jnp.pad(rows, [(0, 0)] * (rows.ndim - 1) + [(0, count)]).reshape(*lead, -1)
    places = length + count - 1
    return jnp.sum(wide[..., : count * places].reshape(*lead, count, places), axis=-2)


def dot(f: Float[Array, "..."], g: Float[Array, "..."]) -> Array:
    """Coefficients of the scalar product of two vector-valued polynomials, arrays (..., points, dim)."""
    return jnp.sum(multiply(jnp.swapaxes(f, -1, -2), jnp.swapaxes(g, -1, -2)), axis=-2)


def elevate(coefficients: Float[Array, "..."], target: int, axis: int = -1) -> Array:
    """Write a polynomial in degree `target`: the product with the constant one of degree target - n.

    Raises:
        ValueError: target is below the degree.
    """
    n = degree(coefficients, axis)
    if target < n:
        raise ValueError(f"degree is {n}; cannot elevate to {target}.")
    if target == n:
        return coefficients
    c = jnp.moveaxis(coefficients, axis, -1)
    return jnp.moveaxis(multiply(jnp.ones((target - n + 1,), c.dtype), c), -1, axis)


def restrict(coefficients: Float[Array, "..."], t0: ArrayLike, t1: ArrayLike, axis: int = -1) -> Array:
    """Coefficients of t -> f(t0 + t (t1 - t0)), from the original coefficients.

    Coefficient j is the blossom of f with n - j arguments t0 and j arguments t1; all of them are computed together, one
    argument a level, so the error does not depend on how the interval [t0, t1] was reached.

    Args:
        coefficients: any array; `axis` holds the coefficients.
        t0: left end, in [0, 1] for the rounding bound of the module to hold.
        t1: right end, in [0, 1] too. t1 < t0 reverses.
        axis: the coefficient axis.
    """
    c = jnp.moveaxis(coefficients, axis, 0)
    n = c.shape[0] - 1
    j = jnp.arange(n + 1)
    rows = jnp.broadcast_to(c[None], (n + 1, *c.shape))
    for level in range(1, n + 1):
        u = jnp.where(level <= n - j, t0, t1).reshape((n + 1,) + (1,) * c.ndim)
        rows = (1 - u) * rows[:, :-1] + u * rows[:, 1:]
    return jnp.moveaxis(rows[:, 0], 0, axis)


def split(coefficients: Float[Array, "..."], t: ArrayLike, axis: int = -1) -> tuple[Array, Array]:
    """Coefficients of the parts on [0, t] and [t, 1], by one pass of de Casteljau's algorithm.

    The right part is the left part of the reversed coefficients. A loop keeps the compiled code small in any degree.
    """
    c = jnp.moveaxis(coefficients, axis, 0)
    number = jnp.arange(c.shape[0]).reshape(-1, *[1] * (c.ndim - 1))
    weights = jnp.stack([jnp.asarray(t), 1 - jnp.asarray(t)]).astype(c.dtype).reshape(2, *[1] * c.ndim)

    def level(k: int, both: Array) -> Array:
        before = jnp.concatenate([both[:, :1], both[:, :-1]], axis=1)
        return jnp.where(number > k, weights[::-1] * before + weights * both, both)

    start = varying(jnp.stack([c, c[::-1]]), weights)
    left, right = jax.lax.fori_loop(0, c.shape[0] - 1, level, start)
    return jnp.moveaxis(left, 0, axis), jnp.moveaxis(right[::-1], 0, axis)
