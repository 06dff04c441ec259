"""Polynomials in two variables on [-1, 1]^2, cut off at a degree, with bounds of what was cut: Taylor models.

A truncated polynomial stands for every function that differs from its terms by at most `rest` on the square. Products
are cut off again; what they lose, and all roundings, go into the rest. So a polynomial in three variables is put on a
surface piece (x(s, t), y(s, t), z(s, t)) at a cost that does not grow with its degree: with the size h of the piece the
rest is of the order h^(degree + 1).

Rounding. A coefficient of a product is a sum of at most N products, N the number of terms, so the roundings of all of
them together are below gamma(N + 2) times the product of the sizes; rests are sums of at most 4 N numbers that are not
negative, each a product of a few.

Source: Makino & Berz, Taylor models and other validated functional inclusion methods, IJPAM 4 (2003).
"""

from collections.abc import Iterator
from itertools import product as cartesian
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.arithmetic.trivariate import bernstein_conversion
from jhd.arrays import varying

# The degree at which polynomials are cut off.
DEGREE = 5
# Exponents of the terms, by degree.
EXPONENTS = sorted(((i, j) for i, j in cartesian(range(DEGREE + 1), repeat=2) if i + j <= DEGREE), key=sum)
_COUNT = len(EXPONENTS)
_DEGREES = np.array([i + j for i, j in EXPONENTS])
_ROW = {powers: k for k, powers in enumerate(EXPONENTS)}
# Row m, entry k: the term that times term m makes term k; the one after the last is zero.
_FACTOR = np.array([[_ROW.get((k[0] - m[0], k[1] - m[1]), _COUNT) for k in EXPONENTS] for m in EXPONENTS])
# The terms of each degree.
_OF_DEGREE = [np.flatnonzero(_DEGREES == degree) for degree in range(DEGREE + 1)]
# Roundings of a coefficient of a product, and of the sums of its rest.
_ROUNDINGS = 4 * _COUNT + 16
# Bernstein coefficients on the square of all terms.
_TO_BERNSTEIN = np.stack(
    [np.outer(*(bernstein_conversion(DEGREE)[:, power] for power in powers)).ravel() for powers in EXPONENTS], axis=1
)


class Truncated(NamedTuple):
    """Functions on the square: coefficients of s^i t^j in the order of EXPONENTS, and the most they are off by."""

    terms: Array  # (terms, ...)
    rest: Array  # (...)

    @property
    def size(self) -> Array:
        """A bound of the absolute values, but for the roundings of this sum."""
        return jnp.sum(jnp.abs(self.terms), axis=0) + self.rest


def product(x: Truncated, y: Truncated) -> Truncated:
    """The product."""
    dtype = x.terms.dtype
    padded = jnp.concatenate([y.terms, jnp.zeros_like(y.terms[:1])])

    # A loop compiles five times as fast as the sum written out.
    def add(m: Array, total: Array) -> Array:
        return total + x.terms[m] * padded[jnp.asarray(_FACTOR)[m]]

    terms = jax.lax.fori_loop(0, _COUNT, add, varying(jnp.zeros_like(x.terms + y.terms), x, y))
    # What is beyond the degree, by the sizes of the terms of each.
    first, second = (jnp.stack([jnp.sum(jnp.abs(z.terms[rows]), axis=0) for rows in _OF_DEGREE]) for z in (x, y))
    lost = sum(first[d] * jnp.sum(second[DEGREE + 1 - d :], axis=0) for d in range(1, DEGREE + 1))
    rest = lost + x.rest * y.size + jnp.sum(first, axis=0) * y.rest
    room = gamma(_ROUNDINGS, dtype)
    rest = rest * (1 + room) + room * x.size * y.size + 16 * smallest_normal(dtype)
    return Truncated(jnp.asarray(terms), rest)


def plus(x: Truncated, y: Truncated) -> Truncated:
    """The sum."""
    terms, dtype = x.terms + y.terms, x.terms.dtype
    rest = (x.rest + y.rest) * (1 + gamma(4, dtype)) + gamma(2, dtype) * jnp.sum(jnp.abs(terms), axis=0)
    return Truncated(terms, rest + 16 * smallest_normal(dtype))


def scaled(x: Truncated, factor: Array | float) -> Truncated:
    """The functions times numbers."""
    dtype, size = x.terms.dtype, jnp.abs(jnp.asarray(factor))
    rest = x.rest * size * (1 + gamma(4, dtype)) + gamma(2, dtype) * size * jnp.sum(jnp.abs(x.terms), axis=0)
    return Truncated(x.terms * factor, rest + 16 * smallest_normal(dtype))


def composed(form: Array, variables: Truncated) -> Truncated:
    """The polynomial of x^i y^j z^k, form (i, j, k, ...), at three functions of absolute value at most one.

    Terms of a total degree beyond DEGREE go into the rest, which suits forms whose coefficients fall with the degree.

    Args:
        form: the coefficients.
        variables: the functions side by side, (terms, 3, ...).
    """
    dtype, shape = form.dtype, form.shape[:3]
    flat = form.reshape(-1, *form.shape[3:])
    degrees = np.sum(np.indices(shape), axis=0).ravel()
    rest, size = jnp.sum(jnp.abs(flat[np.flatnonzero(degrees > DEGREE)]), axis=0), jnp.abs(flat[0])
    cells = jnp.broadcast_shapes(form.shape[3:], variables.rest.shape[1:])
    terms = jnp.zeros((_COUNT, *cells), dtype).at[0].set(flat[0])
    for degree, level in enumerate(_monomials(shape, variables), 1):
        factors = flat[np.flatnonzero(degrees == degree)]
        terms = terms + jnp.sum(factors * level.terms, axis=1)
        rest = rest + jnp.sum(jnp.abs(factors) * level.rest, axis=0)
        size = size + jnp.sum(jnp.abs(factors) * level.size, axis=0)
    room = gamma(degrees.size + _ROUNDINGS, dtype)
    return Truncated(terms, rest * (1 + room) + room * size + 16 * smallest_normal(dtype))


def _monomials(shape: tuple[int, ...], variables: Truncated) -> Iterator[Truncated]:
    """Those of degree 1, 2, .. DEGREE with powers below a shape, side by side in the order of np.ndindex."""
    powers = [(0, 0, 1), (0, 1, 0), (1, 0, 0)]
    level = Truncated(variables.terms[:, ::-1], variables.rest[::-1])
    yield level
    for degree in range(2, DEGREE + 1):
        below, powers = powers, [p for p in np.ndindex(*shape) if sum(p) == degree]
        axes = np.array([next(axis for axis in range(3) if p[axis]) for p in powers])
        lower = [below.index(tuple(np.subtract(p, np.eye(3, dtype=int)[k]))) for p, k in zip(powers, axes, strict=True)]
        level = product(
            *(Truncated(x.terms[:, k], x.rest[k]) for x, k in ((level, np.array(lower)), (variables, axes)))
        )
        yield level


def bernstein_form(terms: Array) -> Array:
    """Bernstein coefficients on the square, (DEGREE + 1, DEGREE + 1, ...), of terms (terms, ...)."""
    matrix = _TO_BERNSTEIN.astype(terms.dtype).reshape(*_TO_BERNSTEIN.shape, *[1] * (terms.ndim - 1))
    return jnp.sum(matrix * terms, axis=1).reshape(DEGREE + 1, DEGREE + 1, *terms.shape[1:])


def largest(x: Truncated) -> Array:
    """An upper bound of the values on the square, by Bernstein coefficients."""
    dtype = x.terms.dtype
    values = bernstein_form(x.terms)
    return jnp.max(values, axis=(0, 1)) + (x.rest * (1 + gamma(4, dtype)) + gamma(_ROUNDINGS, dtype) * x.size)
