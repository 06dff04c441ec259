"""Derivatives of polynomials in three variables, beside those of NumPy's polynomials."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.polynomial import polyder, polyval3d

from jhd._arithmetic.polynomials import jets, slopes


def derivative(coefficients, point, *axes):
    for axis in axes:
        coefficients = polyder(coefficients, axis=axis)
    return polyval3d(point[0], point[1], point[2], coefficients)


@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 1, 3), (5, 4, 3), (9, 2, 6)])
def test_values_gradients_and_second_derivatives_at_many_points_and_at_one(shape):
    rng = np.random.default_rng(len(shape) + sum(shape))
    coefficients, points = rng.normal(size=shape), rng.uniform(-1.5, 1.5, (3, 7))
    points[:, 0], points[1, 1] = 0.0, 0.0
    value = derivative(coefficients, points)
    gradient = np.stack([derivative(coefficients, points, i) for i in range(3)])
    hessian = np.stack([[derivative(coefficients, points, i, j) for j in range(3)] for i in range(3)])
    for found, wanted in zip(jax.jit(jets)(coefficients, points), (value, gradient, hessian), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
    for found, wanted in zip(jax.jit(slopes)(coefficients, points), (value, gradient), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
    for found, wanted in zip(jax.jit(jets)(coefficients, points[:, 2]), (value, gradient, hessian), strict=True):
        np.testing.assert_allclose(found, wanted[..., 2], rtol=1e-12, atol=1e-12 * np.abs(wanted).max())


def test_where_powers_overflow_that_do_not_occur_derivatives_are_finite():
    coefficients = np.zeros((3, 1, 1))
    coefficients[:, 0, 0] = 1.0, 2.0, 3.0
    far = jnp.array([1e150, 1e150, 1e150])
    slope, bent = jax.jit(jax.value_and_grad(lambda x: slopes(jnp.asarray(coefficients), x)[1][0]))(far)
    np.testing.assert_allclose(slope, 6e150)
    np.testing.assert_array_equal(bent, [6.0, 0.0, 0.0])
