"""Polynomials in three variables in plain floating point, at one point or at many: values and first two derivatives.

Entry [i, j, k] of the coefficients belongs to x^i y^j z^k. Points have their coordinates in the first axis, then any
axes or none. Nothing is enclosed here; see `jhd._arithmetic.trivariate` for ranges and `horner` for roundings.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._arithmetic.scaling import frexp, scale_of
from jhd._runtime.arrays import module_of

# Second derivatives xx, yy, zz, xy, xz, yz as a matrix.
SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


# Orders of the derivatives along x, y, z in the order of a jet: the value, the gradient, then as SYMMETRIC counts.
ORDERS = np.array(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [0, 2, 0], [0, 0, 2], [1, 1, 0], [1, 0, 1], [0, 1, 1]]
)
_VALUE, _SLOPE = 1, 4


class PolynomialJet(NamedTuple):
    """Value, gradient (3, ...) and second derivatives (3, 3, ...) of a polynomial at points."""

    value: Array
    gradient: Array
    hessian: Array


def jets(coefficients: Float[Array, "i j k"], points: Float[Array, "3 ..."]) -> PolynomialJet:
    """Values and first two derivatives, from the powers of the coordinates."""
    found = _derivatives_at(coefficients, points, 2)
    return PolynomialJet(found[0], found[_VALUE:_SLOPE], found[_SLOPE + SYMMETRIC])


def slopes(coefficients: Float[Array, "i j k"], points: Float[Array, "3 ..."]) -> tuple[Array, Array]:
    """Values and gradients (3, ...) alone."""
    found = _derivatives_at(coefficients, points, 1)
    return found[0], found[_VALUE:]


def _derivatives_at(coefficients: Array, points: Array, order: int) -> Array:
    """The derivatives up to an order in the first axis, by sums along z, then y, then x, for all of them at once."""
    shape = coefficients.shape
    along = powers(points, max(shape), order)
    x, y, z = (along[:, : shape[axis], axis] for axis in range(3))
    wanted = ORDERS[ORDERS.sum(axis=1) <= order]
    planes, plane = np.unique(wanted[:, 1:], axis=0, return_inverse=True)
    # Sums keep the batch axis of vmap in front; a matrix product may move it; see jhd._distance.witness.active.
    rows = coefficients.reshape(*shape, *(1,) * (points.ndim - 1))
    along_z = jnp.sum(rows * z[:, None, None], axis=3)
    along_y = jnp.sum(along_z[planes[:, 1]] * y[planes[:, 0]][:, None], axis=2)
    return jnp.sum(along_y[plane.reshape(-1)] * x[wanted[:, 0]], axis=1)


def powers(x: Any, count: int, order: int) -> Any:
    """The powers and their derivatives up to an order, (order + 1, count, ...): products of squares of squares."""
    xp = module_of(x)
    exponent = np.arange(count) - np.arange(order + 1)[:, None]
    factor = np.ones(exponent.shape)
    for below in range(order):
        factor[below + 1 :] *= (np.arange(count) - below).clip(0)
    shape = (*exponent.shape, *(1,) * x.ndim)
    result = xp.broadcast_to(xp.asarray(factor.reshape(shape), x.dtype), (*exponent.shape, *x.shape))
    for bit in range(int(exponent.max()).bit_length()):
        result = result * xp.where((exponent.clip(0) >> bit & 1).astype(bool).reshape(shape), x, 1.0)
        x = x * x
    return result


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


def rescaled(coefficients: Float[Array, "i j k"], scale: Array) -> Array:
    """The polynomial in coordinates multiplied by a power of two, with a largest coefficient in [1/2, 1).

    All factors are powers of two. Their exponents are reduced by the largest one of the results before the powers are
    formed, and each factor is applied in two halves. So no factor leaves the range of the numbers.
    """
    degrees = np.sum(np.indices(coefficients.shape), axis=0)
    power = degrees * (1 - frexp(scale)[1])
    mantissa, own = frexp(jax.lax.stop_gradient(coefficients))
    power = power - jnp.max(jnp.where(mantissa != 0, own + power, jnp.iinfo(power.dtype).min))
    half = power // 2
    return coefficients * scale_of(-half, scale.dtype) * scale_of(half - power, scale.dtype)
