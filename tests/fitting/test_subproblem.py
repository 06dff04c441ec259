"""The model step and the multipliers against solutions found by hand and by sampling."""

import numpy as np
import pytest

from jhd._fitting.subproblem import model_step, multipliers

TOLERANCE = 1e-8


def model(d, value, gradient, hessian):
    return np.max(value + gradient @ d + 0.5 * (hessian @ d) @ d)


def test_two_lines_meet_in_the_middle():
    step = model_step(np.array([2.0, 1.0]), np.array([[1.0], [-1.0]]), np.zeros((1, 0, 1)), np.array([10.0]))
    np.testing.assert_allclose(step, [-0.5], atol=TOLERANCE)


def test_the_radius_bounds_each_parameter():
    step = model_step(np.array([2.0]), np.array([[1.0, -1.0]]), np.zeros((1, 0, 2)), np.array([0.1, 0.3]))
    np.testing.assert_allclose(step, [-0.1, 0.3], atol=TOLERANCE)
    # The best step of a larger radius, (3, 9), cut off to this one is (1, 1), where the model is 10 and not 8.
    gradient = np.array([[-3.0, -1.0], [3.0, -3.0]])
    step = model_step(np.array([10.0, 10.0]), gradient, np.zeros((1, 0, 2)), np.ones(2))
    np.testing.assert_allclose(step, [1 / 3, 1.0], atol=TOLERANCE)


def test_curvature_ends_the_step():
    step = model_step(np.array([1.0]), np.array([[1.0]]), np.full((1, 1, 1), 2.0), np.array([1.0]))
    np.testing.assert_allclose(step, [-0.25], atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [1.0, 1e-9])
def test_no_sampled_step_is_better(seed, scale):
    rng = np.random.default_rng(seed)
    value, gradient = scale * rng.uniform(0.5, 1.0, 7), rng.normal(size=(7, 3))
    roots, radius = rng.normal(size=(7, 2, 3)) / np.sqrt(scale), scale * rng.uniform(0.1, 1.0, 3)
    lazy = scale * rng.uniform(0.0, 0.1)
    hessian = np.swapaxes(roots, 1, 2) @ roots + lazy * np.diag(1 / radius**2)
    best = model(model_step(value, gradient, roots, radius, lazy), value, gradient, hessian)
    others = [model(radius * rng.uniform(-1, 1, 3), value, gradient, hessian) for _ in range(2000)]
    assert best <= min(others) + TOLERANCE * scale


def test_multipliers_of_opposite_gradients_cancel_them():
    gradient = np.array([[1.0, 0.0], [-3.0, 0.0], [0.0, 5.0]])
    np.testing.assert_allclose(multipliers(gradient, np.zeros(3)), [0.75, 0.25, 0.0], atol=TOLERANCE)


def test_a_price_keeps_multipliers_away():
    gradient = np.array([[1.0], [-1.0], [-1.0]])
    # In either order: without prices both solutions are as good.
    for dear in (1, 2):
        mu = multipliers(gradient, 10.0 * (np.arange(3) == dear))
        np.testing.assert_allclose(mu, np.where(np.arange(3) == dear, 0.0, 0.5), atol=1e-2)
        assert np.sum(mu) == pytest.approx(1.0)


def test_one_gradient_has_all():
    np.testing.assert_allclose(multipliers(np.array([[2.0, 1.0]]), np.zeros(1)), [1.0])
