"""Polynomials in three variables in plain floating point, at one point or at many: values and first two derivatives.

Entry [i, j, k] of the coefficients belongs to x^i y^j z^k. Points have their coordinates in the first axis, then any
axes or none. Nothing is enclosed here; see `jhd.arithmetic.trivariate` for ranges and `horner` for roundings.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# Second derivatives xx, yy, zz, xy, xz, yz as a matrix.
SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


class PolynomialJet(NamedTuple):
    """Value, gradient (3, ...) and second derivatives (3, 3, ...) of a polynomial at points."""

    value: Array
    gradient: Array
    hessian: Array


def jets(coefficients: Float[Array, "i j k"], points: Float[Array, "3 ..."]) -> PolynomialJet:
    """Values and first two derivatives, from the powers of the coordinates."""
    shape = coefficients.shape
    # One program for the powers of all coordinates, and for the sums along z: in parts it is much longer.
    powers = _powers(points, max(shape))
    x, y, z = (powers[:, : shape[axis], axis] for axis in range(3))
    # Sums keep the batch axis of vmap in front, where a matrix product may move it; see jhd.distance.witness.active.
    rows = coefficients.reshape(*shape, *(1,) * (points.ndim - 1))
    along_z = jnp.sum(rows * z[:, None, None], axis=3)
    plane = {(b, c): jnp.sum(along_z[c] * y[b], axis=1) for b, c in _upto(2)}
    found = {(a, b, c): jnp.sum(plane[b, c] * x[a], axis=0) for b, c in _upto(2) for a in range(3 - b - c)}
    gradient = jnp.stack([found[1, 0, 0], found[0, 1, 0], found[0, 0, 1]])
    own = [found[2, 0, 0], found[0, 2, 0], found[0, 0, 2]]
    second = [*own, found[1, 1, 0], found[1, 0, 1], found[0, 1, 1]]
    hessian = jnp.stack([jnp.stack([second[k] for k in row]) for row in SYMMETRIC.tolist()])
    return PolynomialJet(found[0, 0, 0], gradient, hessian)


def _upto(degree: int) -> list[tuple[int, int]]:
    return [(b, c) for b in range(degree + 1) for c in range(degree + 1 - b)]


def _powers(x: Array, count: int) -> Array:
    """The powers, their first and their second derivatives: (3, count, ...)."""
    rows = [jnp.ones_like(x)]
    for _ in range(count - 1):
        rows.append(rows[-1] * x)
    zero = jnp.zeros_like(x)
    first = [i * rows[i - 1] if i else zero for i in range(count)]
    second = [i * (i - 1) * rows[i - 2] if i > 1 else zero for i in range(count)]
    return jnp.stack([jnp.stack(rows), jnp.stack(first), jnp.stack(second)])


def horner(coefficients: Float[Array, "... i j k"], points: Float[Array, "3 points"]) -> Float[Array, "... points"]:
    """Values by Horner's rule, in at most twice the sum of the degrees of roundings each."""
    result = coefficients[..., None]
    for axis in (2, 1, 0):
        rows = result
        result = jnp.broadcast_to(rows[..., -1, :], (*rows.shape[:-2], points.shape[-1]))
        for power in range(rows.shape[-2] - 2, -1, -1):
            result = result * points[axis] + rows[..., power, :]
    return result


def derivatives(coefficients: Float[Array, "i j k"]) -> Float[Array, "10 i j k"]:
    """The polynomial with its derivatives x, y, z, xx, yy, zz, xy, xz, yz; entries are rounded twice at most."""

    def derived(c: Array, axis: int) -> Array:
        factors = np.arange(c.shape[axis]).reshape([-1 if i == axis else 1 for i in range(3)])
        return jnp.roll(c * factors, -1, axis=axis)

    first = [derived(coefficients, axis) for axis in range(3)]
    second = [derived(first[i], j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return jnp.stack([coefficients, *first, *second])
