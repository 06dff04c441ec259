"""Point, velocity and acceleration against rational arithmetic."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.normalization.jets import jet
from tests.distance import exact

# The second derivative sums degree^2 terms of the size of the control points, each rounded a few times.
ROUNDING = 1e-13
PARAMETERS = np.array([0.0, 1.0, 0.5, 0.25, 1 / 3, 1e-9, 1 - 1e-9])


def expected(points, weights):
    rows = [exact.jet(points, weights, t) for t in PARAMETERS]
    return [np.array([[float(x) for x in row[k]] for row in rows]) for k in range(3)]


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 7, 10])
@pytest.mark.parametrize("rational", [False, True])
def test_jets_are_those_of_rational_arithmetic(degree, rational):
    rng = np.random.default_rng(degree)
    points = rng.normal(size=(degree + 1, 3))
    weights = 2.0 ** rng.integers(-3, 4, size=degree + 1) if rational else None
    found = jax.jit(jax.vmap(jet, (None, None, 0)))(points, weights, jnp.array(PARAMETERS))
    for derivative, want in zip(found, expected(points, weights), strict=True):
        np.testing.assert_allclose(derivative, want, rtol=0, atol=ROUNDING * max(1.0, np.abs(want).max()))


def test_ends_are_the_control_points_to_the_last_bit():
    points = np.random.default_rng(5).normal(size=(4, 2))
    for t, k in ((0.0, 0), (1.0, -1)):
        np.testing.assert_array_equal(jet(jnp.array(points), None, jnp.array(t)).point, points[k])


def test_derivatives_of_a_point_and_of_a_line():
    here = jet(jnp.array([[1.0, 2.0]]), None, jnp.array(0.5))
    np.testing.assert_array_equal(jnp.stack([here.first, here.second]), np.zeros((2, 2)))
    here = jet(jnp.array([[1.0, 2.0], [4.0, 6.0]]), None, jnp.array(0.25))
    np.testing.assert_array_equal(here.first, [3.0, 4.0])
    np.testing.assert_array_equal(here.second, [0.0, 0.0])


def test_first_and_second_are_the_derivatives_of_point():
    points, weights = jnp.array([[0.0, 0.0], [1.0, 3.0], [4.0, -1.0]]), jnp.array([1.0, 3.0, 0.5])
    slope = jax.jacfwd(lambda t: jet(points, weights, t).point)
    bend = jax.jacfwd(lambda t: jet(points, weights, t).first)
    here = jet(points, weights, jnp.array(0.3))
    np.testing.assert_allclose(slope(0.3), here.first, rtol=1e-12)
    np.testing.assert_allclose(bend(0.3), here.second, rtol=1e-12)
