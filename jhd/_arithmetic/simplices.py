"""Polynomials on segments and triangles, by scaled coefficients in Bernstein form.

A polynomial of degree n on a simplex with k + 1 corners (k is 1 or 2) is an array of n + 1 entries along each of its
first k axes. Entry i is the coefficient at the multi-index (n - |i|, i), times the multinomial coefficient; it is zero
if |i| exceeds n. So a product is a plain convolution, and the constant one of degree n is the array of its multinomial
coefficients. Further axes belong to the values; the last axis should be long, as compiled functions run along it.

Rounding. In terms of Bernstein coefficients, all operations here are sums of terms with non-negative factors of sum
one. A product costs one rounding of each term and one for every term of a coefficient except the first; a coefficient
has at most as many terms as the smaller operand has coefficients. Composing costs at most 24 roundings a level, if the
inner coordinate and its complement are off by a factor of at most gamma(10): one product, a sum of at most 12 terms,
those ten, and one for multinomial coefficients.

Source: Farin, Triangular Bernstein-Bezier patches, CAGD 3 (1986); DeRose et al., Functional composition algorithms via
blossoming, ACM TOG 12 (1993), of which ours is de Casteljau's algorithm on polynomials.
"""

import functools
import math
from functools import cache
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

# Roundings of one level of a composition with an inner map of degree two at most.
LEVEL = 24


@cache
def lattice(k: int, n: int) -> np.ndarray:
    """The multi-indices of degree n, (indices, k + 1); the corners come first, in their order."""
    rows = [(n - sum(i), *i) for i in product(range(n + 1), repeat=k) if sum(i) <= n]
    corners = [tuple(row) for row in n * np.eye(k + 1, dtype=int)] if n else []
    return np.array([*corners, *(row for row in rows if row not in corners)])


def _places(k: int, n: int) -> tuple[np.ndarray, ...]:
    """Index arrays that select the coefficients of the lattice in an array."""
    return tuple(lattice(k, n)[:, 1:].T)


@cache
def multinomials(k: int, n: int) -> np.ndarray:
    """The constant one of degree n: multinomial coefficients, zero outside the lattice."""
    table = np.zeros((n + 1,) * k)
    table[_places(k, n)] = [math.factorial(n) / math.prod(math.factorial(int(x)) for x in i) for i in lattice(k, n)]
    return table


def like(k: int, table: np.ndarray, values: Array) -> Array:
    """The table of numbers for all entries, with axes added to broadcast against the values of an array."""
    return jnp.asarray(table.reshape(*table.shape, *(1,) * (values.ndim - k)), values.dtype)


def constant(k: int, n: int, values: Array) -> Array:
    """The constant one of degree n, with axes added to broadcast against the values of an array."""
    return like(k, multinomials(k, n), values)


def scaled(k: int, n: int, coefficients: Array) -> Array:
    """A polynomial of degree n from its coefficients at the lattice, (indices, *values)."""
    # Entries outside the lattice are the first coefficient times zero.
    index = np.zeros((n + 1,) * k, int)
    index[_places(k, n)] = np.arange(len(lattice(k, n)))
    table = coefficients[index]
    return table * like(k, multinomials(k, n), table)


def coefficients_of(k: int, f: Array) -> Array:
    """The coefficients at the lattice, (indices, *values); each is divided, two roundings."""
    n = f.shape[0] - 1
    counts = multinomials(k, n)[_places(k, n)]
    return f[_places(k, n)] / counts.reshape(-1, *(1,) * (f.ndim - k)).astype(f.dtype)


def multiply(k: int, f: Array, g: Array) -> Array:
    """The product; axes of values broadcast."""
    if f.shape[0] > g.shape[0]:
        return multiply(k, g, f)
    n = f.shape[0] - 1
    return _sum([f[at] * part for at, part in _moved(k, n, g)])


def dot(k: int, f: Array, g: Array) -> Array:
    """The scalar product of two polynomials whose values are vectors along the next axis."""
    return jnp.sum(multiply(k, f, g), axis=k)


def composed(k: int, rows: Array, inner: Array, complement: Array) -> Array:
    """Compose a polynomial in Bernstein form (first axis) with its variable, a polynomial on the simplex.

    Args:
        k: dimension of the simplex.
        rows: coefficients (degree + 1, ..., *entries, values, last), already composed in the variables done before;
            else entries of one.
        inner: the variable (*entries, last), its values in [0, 1].
        complement: one minus `inner`.
    """
    g = inner.shape[0] - 1
    while rows.shape[0] > 1:
        every = _moved(k, g, rows, rows.ndim - 2 - k)
        rows = _sum([complement[at] * x[:-1] + inner[at] * x[1:] for at, x in every])
    return rows[0]


def _moved(k: int, n: int, x: Array, first: int = 0) -> list[tuple[Any, Array]]:
    """Pairs of each multi-index of degree n and x moved by it along its axes of entries, with room for the degree.

    All moved arrays are slices of one zero-padded array, so the sum of all terms is one loop.
    """
    axes = range(first, first + k)
    wide = jnp.pad(x, [(n, n) if axis in axes else (0, 0) for axis in range(x.ndim)])
    size = [length + n if axis in axes else length for axis, length in enumerate(x.shape)]
    found = []
    for at in zip(*_places(k, n), strict=True):
        start = [0] * first + [n - int(i) for i in at] + [0] * (x.ndim - first - k)
        found.append((at, jax.lax.slice(wide, start, [a + b for a, b in zip(start, size, strict=True)])))
    return found


def _sum(terms: list[Array]) -> Array:
    return functools.reduce(jnp.add, terms)


@cache
def raising(k: int, n: int, to: int) -> np.ndarray:
    """The matrix that raises coefficients at the lattice from degree n to degree `to`; its rows sum to one."""
    high, low = lattice(k, to), lattice(k, n)
    counts = [math.prod(math.comb(int(a), int(b)) for a, b in zip(i, j, strict=True)) for i in high for j in low]
    return np.reshape(counts, (len(high), len(low))) / math.comb(to, n)


@cache
def lowering(k: int, to: int, n: int) -> np.ndarray:
    """A matrix that takes coefficients of degree `to` to a polynomial of degree n close to the original."""
    return np.linalg.pinv(raising(k, n, to))


@cache
def inner_lattice(k: int, n: int, inset: float) -> np.ndarray:
    """Barycentric coordinates of the lattice, moved by the fraction `inset` towards the middle, (indices, k + 1)."""
    return (1 - inset) * lattice(k, n) / n + inset / (k + 1)


@cache
def fitting(k: int, n: int, inset: float) -> np.ndarray:
    """The matrix that takes values at the inner lattice to the coefficients of the polynomial through them."""
    places, index = inner_lattice(k, n, inset), lattice(k, n)
    basis = np.prod(places[:, None] ** index[None], axis=-1) * multinomials(k, n)[_places(k, n)]
    return np.linalg.inv(basis)


# Corners of the halves of a segment and of the quarters of a triangle, as twice their barycentric coordinates.
_PARTS = {
    1: np.array([[[2, 0], [1, 1]], [[1, 1], [0, 2]]]),
    2: np.array(
        [
            [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
            [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
            [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
            [[0, 1, 1], [1, 0, 1], [1, 1, 0]],
        ]
    ),
}


@cache
def dividing(k: int, n: int) -> np.ndarray:
    """The matrices (parts, indices, indices) that restrict coefficients at the lattice to halves or quarters.

    They come from products of linear forms, one for each corner. All entries are sums of multiples of 2^-n, and each
    row sums to one.
    """
    places = _places(k, n)
    return np.array([[_forms(k, corners / 2, index)[places] for index in lattice(k, n)] for corners in _PARTS[k]])


def _forms(k: int, corners: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """Coefficients of a product of powers of linear forms."""
    out = np.ones((1,) * k)
    for form, power in zip(corners, powers, strict=True):
        for _ in range(power):
            wide = np.zeros(tuple(m + 1 for m in out.shape))
            wide[tuple(slice(0, m) for m in out.shape)] += form[0] * out
            for axis in range(k):
                at = tuple(slice(int(j == axis), m + int(j == axis)) for j, m in enumerate(out.shape))
                wide[at] += form[axis + 1] * out
            out = wide
    return out
