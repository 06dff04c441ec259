"""Polynomials in two variables on [-1, 1]^2, truncated at a degree, with bounds of the rest: Taylor models.

A truncated polynomial stands for every function that differs from its terms by at most `rest` on the square. Products
are truncated again; the terms that they lose, and all roundings, go into the rest. So a polynomial in three variables
is composed with a surface piece (x(s, t), y(s, t), z(s, t)) at a cost that does not grow with its degree: with the size
h of the piece the rest is of the order h^(degree + 1).

Rounding. A coefficient of a product is a sum of at most N products, N the number of terms, so the roundings of all of
them together are below gamma(N + 2) times the product of the sizes; rests are sums of at most 4 N numbers that are not
negative, each a product of a few.

Source: Makino & Berz, Taylor models and other validated functional inclusion methods, IJPAM 4 (2003).
"""

import math
from functools import cache
from itertools import product as cartesian
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.trivariate import bernstein_conversion
from jhd._runtime.arrays import varying

# The degree at which polynomials are truncated. With moving feet, concentric spheres close with 7 in a third of the
# time for 5.
DEGREE = 7
# Exponents of the terms, by degree.
EXPONENTS = sorted(((i, j) for i, j in cartesian(range(DEGREE + 1), repeat=2) if i + j <= DEGREE), key=sum)
_COUNT = len(EXPONENTS)
# Roundings of a coefficient of a product, and of the sums of its rest.
_ROUNDINGS = 4 * _COUNT + 16


class _Tables(NamedTuple):
    """Constant arrays for polynomials truncated at one degree."""

    degree: int  # the degree
    # Row m, entry k: the number of the term whose product with term m is term k, or the number of terms.
    factor: np.ndarray
    # Masks of the terms, and last of the rest, of each degree; the rest counts as one degree above.
    of_degree: np.ndarray
    beyond: np.ndarray  # mask of the products of two degrees that belong to the rest
    to_bernstein: np.ndarray  # Bernstein coefficients on the square of all terms


@cache
def _tables(count: int) -> _Tables:
    """Return the tables for polynomials with this number of terms."""
    exponents = EXPONENTS[:count]
    degree = sum(exponents[-1])
    row = {powers: k for k, powers in enumerate(exponents)}
    factor = np.array([[row.get((k[0] - m[0], k[1] - m[1]), count) for k in exponents] for m in exponents])
    degrees = np.append([i + j for i, j in exponents], degree + 1)
    orders = np.arange(degree + 2)
    matrix = bernstein_conversion(degree)
    to_bernstein = np.stack([np.outer(*(matrix[:, power] for power in powers)).ravel() for powers in exponents], axis=1)
    return _Tables(degree, factor, degrees == orders[:, None], np.add.outer(orders, orders) > degree, to_bernstein)


class Truncated(NamedTuple):
    """Functions on the square: coefficients of s^i t^j in the order of EXPONENTS, and a bound of their error.

    The terms are all terms up to some degree, at most DEGREE.
    """

    terms: Array  # (terms, ...)
    rest: Array  # (...)

    @property
    def size(self) -> Array:
        """A bound of the absolute values, without the roundings of this sum."""
        return jnp.sum(jnp.abs(self.terms), axis=0) + self.rest


def product(x: Truncated, y: Truncated) -> Truncated:
    """The product of functions with as many terms."""
    padded = jnp.concatenate([y.terms, jnp.zeros_like(y.terms[:1])])
    count = len(x.terms)
    factor = _tables(count).factor

    # A loop compiles five times as fast as the sum written out.
    def add(m: Array, total: Array) -> Array:
        return total + x.terms[m] * padded[jnp.asarray(factor)[m]]

    terms = jax.lax.fori_loop(0, count, add, varying(jnp.zeros_like(x.terms + y.terms), x, y))
    return Truncated(jnp.asarray(terms), _rest_of_product(x, y))


def _rest_of_product(x: Truncated, y: Truncated) -> Array:
    """Bound of the terms beyond the degree and of all roundings, by the sizes of the terms of each degree."""
    first, second = _sizes(x), _sizes(y)
    room = gamma(_ROUNDINGS, first.dtype)
    # x may hold more functions than y, side by side.
    second = second.reshape(len(second), *(1,) * (first.ndim - second.ndim), *second.shape[1:])
    shares = np.where(_tables(len(x.terms)).beyond, 1 + 2 * room, room).astype(first.dtype)
    shares = shares.reshape(*shares.shape, *(1,) * (second.ndim - 1))
    return _known(jnp.sum(shares * first[:, None] * second, axis=(0, 1)))


def _known(rest: Array) -> Array:
    """The rest plus a bound of flushed numbers; infinite if it is NaN (zero times infinity)."""
    return jnp.where(jnp.isnan(rest), jnp.inf, rest + 4 * _COUNT**2 * smallest_normal(rest.dtype))


def _sizes(x: Truncated) -> Array:
    """The sums of the sizes of the terms of each degree, and last the rest."""
    rows = jnp.concatenate([jnp.abs(x.terms), x.rest[None]])
    return jnp.tensordot(_tables(len(x.terms)).of_degree.astype(rows.dtype), rows, 1, precision="highest")


def plus(x: Truncated, y: Truncated) -> Truncated:
    """The sum."""
    terms, dtype = x.terms + y.terms, x.terms.dtype
    rest = (x.rest + y.rest) * (1 + gamma(4, dtype)) + gamma(2, dtype) * jnp.sum(jnp.abs(terms), axis=0)
    return Truncated(terms, rest + 16 * smallest_normal(dtype))


def summed(x: Truncated) -> Truncated:
    """The sum of functions along their first axis."""
    found = Truncated(x.terms[:, 0], x.rest[0])
    for k in range(1, x.rest.shape[0]):
        found = plus(found, Truncated(x.terms[:, k], x.rest[k]))
    return found


def dot(x: Truncated, y: Truncated) -> Truncated:
    """Scalar products along the first axis."""
    return summed(product(x, y))


def scaled(x: Truncated, factor: Array | float) -> Truncated:
    """The functions times numbers."""
    dtype, size = x.terms.dtype, jnp.abs(jnp.asarray(factor))
    rest = x.rest * size * (1 + gamma(4, dtype)) + gamma(2, dtype) * size * jnp.sum(jnp.abs(x.terms), axis=0)
    return Truncated(x.terms * factor, rest + 16 * smallest_normal(dtype))


def reciprocal(x: Truncated) -> Truncated:
    """One over functions; the rest is infinite if they may vanish.

    With m the first term, d = x / m - 1 and n the degree it is (1 - d + .. + (-d)^n + (-d)^(n + 1) / (1 + d)) / m.
    """
    dtype = x.terms.dtype
    middle = x.terms[0]
    safe = jnp.where(middle != 0, middle, 1.0)
    less = scaled(Truncated(-x.terms.at[0].set(0.0), x.rest), 1 / safe)
    # The factor is rounded.
    less = less._replace(rest=less.rest + gamma(4, dtype) * (1 + less.size))
    size = less.size * (1 + gamma(_ROUNDINGS, dtype))
    one = Truncated(jnp.zeros_like(x.terms).at[0].set(1.0), jnp.zeros_like(x.rest))
    step = lambda _, total: plus(one, product(less, total))  # noqa: E731
    degree = _tables(len(x.terms)).degree
    total = jax.lax.fori_loop(0, degree, step, varying(one, x))
    near = (size < 1) & (middle != 0)
    left = size ** (degree + 1) / jnp.where(near, 1 - size, 1.0) * (1 + gamma(16, dtype))
    found = scaled(total._replace(rest=total.rest + left), 1 / safe)
    rest = found.rest + gamma(4, dtype) * found.size * (1 + gamma(_ROUNDINGS, dtype))
    return Truncated(found.terms, jnp.where(near, rest, jnp.inf))


def composed(form: Array, variables: Truncated) -> Truncated:
    """Compose the polynomial of x^i y^j .., form (i, j, .., ...), with functions of absolute value at most one.

    Terms of a total degree beyond DEGREE go into the rest, which suits forms whose coefficients fall with the degree.

    Args:
        form: the coefficients.
        variables: the functions side by side, (terms, functions, ...).
    """
    count = variables.rest.shape[0]
    dtype, shape = form.dtype, form.shape[:count]
    flat = form.reshape(-1, *form.shape[count:])
    degrees = np.sum(np.indices(shape), axis=0).ravel()
    plan = _monomials(shape)
    each = [Truncated(variables.terms[:, k], variables.rest[k]) for k in range(count)]
    # A product with a variable is one with a matrix, made once.
    matrices = [jnp.concatenate([y.terms, jnp.zeros_like(y.terms[:1])])[_tables(_COUNT).factor] for y in each]
    last = jnp.moveaxis(variables.terms, 1, 0), variables.rest
    known = [last]
    for groups in plan.groups:
        parts = []
        for axis, lower in groups:
            x, rest = (z[lower] for z in last)
            terms = jnp.einsum("nm...,mk...->nk...", x, matrices[axis], precision="highest")
            parts.append((terms, _rest_of_product(Truncated(jnp.moveaxis(x, 0, 1), rest), each[axis])))
        last = _joined(parts)
        known.append(last)
    terms, rests = _joined(known)
    # The constant one has no row; a variable of degree zero has a coefficient of zero.
    factors = jnp.concatenate([flat, jnp.zeros_like(flat[:1])])[plan.entry]
    sizes, beyond = jnp.abs(factors), jnp.abs(flat[np.flatnonzero(degrees > DEGREE)])
    size = jnp.sum(sizes * jnp.sum(jnp.abs(terms), axis=1), axis=0)
    terms = jnp.sum(factors[:, None] * terms, axis=0).at[0].add(flat[0])
    rest = jnp.sum(sizes * rests, axis=0)
    size = rest + size + jnp.abs(flat[0])
    rest, room = rest + jnp.sum(beyond, axis=0), gamma(degrees.size + _ROUNDINGS, dtype)
    return Truncated(terms, _known(rest * (1 + room) + room * size))


def _joined(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Terms and rests of functions side by side."""
    terms, rests = zip(*parts, strict=True)
    return jnp.concatenate(terms), jnp.concatenate(rests)


class _Monomials(NamedTuple):
    """A plan to compute all monomials, each from one of one degree less, starting with the variables."""

    # For each degree from 2 on, pairs of a variable and the monomials of one degree less to multiply it with.
    groups: list[list[tuple[int, np.ndarray]]]
    # Flat index of the coefficient of each monomial, variables first; one behind the last if it has none.
    entry: np.ndarray


@cache
def _monomials(shape: tuple[int, ...]) -> _Monomials:
    """The plan for the monomials with powers below a shape, up to DEGREE."""
    count, none = len(shape), math.prod(shape)
    entry = {powers: k for k, powers in enumerate(np.ndindex(*shape))}
    before = [tuple(int(j == axis) for j in range(count)) for axis in range(count)]
    units, entries, plan = before, [entry.get(unit, none) for unit in before], []
    for degree in range(2, min(DEGREE, sum(shape) - count) + 1):
        groups, after = [], []
        for axis, unit in enumerate(units):
            # Multiples of the first variable that they hold.
            powers = [p for p in entry if sum(p) == degree and p[axis] and not any(p[:axis])]
            if powers:
                groups.append((axis, np.array([before.index(tuple(np.subtract(p, unit).tolist())) for p in powers])))
                after += powers
        plan.append(groups)
        entries += [entry[p] for p in after]
        before = after
    return _Monomials(plan, np.array(entries))


def composed_on_graph(form: Array, height: Truncated, loose: Array | float) -> Truncated:
    """The polynomial of s^i t^j z^k, form (i, j, k, ...), at s, t and functions z of absolute value at most one.

    It takes one product for each power of z; `composed` takes one for every monomial.

    Args:
        form: the coefficients.
        height: the functions z, (terms, ...).
        loose: largest error of the values of s and t, much less than one.
    """
    dtype, (m, n, count) = form.dtype, form.shape[:3]
    degrees = np.add.outer(np.arange(m), np.arange(n))
    zero, sizes = jnp.zeros_like(form[0, 0]), jnp.abs(form)
    shaped = lambda x: jnp.asarray(x.reshape(m, n, *[1] * (form.ndim - 2)), dtype)  # noqa: E731
    terms = jnp.stack([form[i, j] if i < m and j < n else zero for i, j in EXPONENTS], axis=1)
    # Terms beyond the degree, and slopes in s and t, which multiply the errors of their values.
    beyond, slopes = (jnp.sum(shaped(x) * sizes, axis=(0, 1)) for x in (degrees > DEGREE, degrees))
    rows = Truncated(terms, _known((beyond + loose * slopes) * (1 + 1e-3)))

    def step(k: Array, total: Truncated) -> Truncated:
        return plus(product(total, height), jax.tree_util.tree_map(lambda x: x[count - 1 - k], rows))

    start = varying(jax.tree_util.tree_map(lambda x: x[count - 1], rows), form, height)
    return jax.lax.fori_loop(1, count, step, start)


def derivative(form: Array, axis: int) -> Array:
    """The derivative of the polynomial of x^i y^j .. in one of its variables, with the shape of `form`."""
    count = form.shape[axis]
    powers = np.arange(1, count).reshape([-1 if k == axis else 1 for k in range(form.ndim)])
    rows = jax.lax.slice_in_dim(form, 1, count, axis=axis) * powers
    return jnp.pad(rows, [(0, 1 if k == axis else 0) for k in range(form.ndim)])


def bernstein_form(terms: Array) -> Array:
    """Bernstein coefficients on the square, (degree + 1, degree + 1, ...), of terms (terms, ...)."""
    tables = _tables(len(terms))
    values = jnp.tensordot(tables.to_bernstein.astype(terms.dtype), terms, 1, precision="highest")
    return values.reshape(tables.degree + 1, tables.degree + 1, *terms.shape[1:])


def largest(x: Truncated) -> Array:
    """An upper bound of the values on the square, by Bernstein coefficients."""
    dtype = x.terms.dtype
    values = bernstein_form(x.terms)
    return jnp.max(values, axis=(0, 1)) + (x.rest * (1 + gamma(4, dtype)) + gamma(_ROUNDINGS, dtype) * x.size)


def extremes(x: Truncated) -> tuple[Array, Array]:
    """Lower and upper bounds of the values on the square."""
    return -largest(scaled(x, -1.0)), largest(x)
