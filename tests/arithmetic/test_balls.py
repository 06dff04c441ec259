"""Balls hold all numbers they stand for, when every operation is rounded to nearest or all of them one way."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._arithmetic import balls
from jhd._arithmetic.balls import Ball
from tests.rounding.interpreter import evaluate
from tests.rounding.numbers import Rounded, exactly

WAYS = ("nearest", "down", "up", "zero", "away")
COUNT = 60


def numbers(seed, *shape):
    """Numbers of several sizes; the first third of a pair of arrays are exact, the next third are about zero."""
    rng = np.random.default_rng(seed)
    return (rng.uniform(-1, 1, shape) * 2.0 ** rng.integers(-3, 3, shape)).astype(np.float32)


def two_balls(seed):
    """Two rows of balls: a third with radius zero, a third with their mid-points at zero."""
    found = []
    for k in range(2):
        mid, rad = numbers([seed, k], COUNT), np.abs(numbers([seed, k, 1], COUNT))
        mid[COUNT // 3 : 2 * COUNT // 3], rad[: COUNT // 3] = 0.0, 0.0
        found += [mid, rad]
    return found


def rounded(function, way, *inputs):
    """The middle and the radius that a function of arrays computes in 24 bits, as fractions."""
    found = evaluate(function, Rounded(24, way, 2.0**-126), inputs, [None] * len(inputs))
    return [exactly(x) for x in found]


@pytest.mark.parametrize("way", WAYS)
def test_sums_differences_and_products_hold_those_of_all_their_numbers(way):
    inputs = two_balls(0)
    a, r, b, s = (exactly(x) for x in inputs)
    operations = {
        balls.plus: (a + b, r + s),
        balls.minus: (a - b, r + s),
        balls.times: (a * b, abs(a) * s + r * (abs(b) + s)),
    }
    for operation, (mid, rad) in operations.items():
        middle, radius = rounded(lambda a, r, b, s, f=operation: f(Ball(a, r), Ball(b, s)), way, *inputs)
        assert np.all(abs(mid - middle) + rad <= radius)


def test_the_least_eigenvalue_is_bounded_closely_if_a_matrix_is_singular():
    rng = np.random.default_rng(5)
    bound = jax.jit(jax.vmap(lambda mid, rad: balls.least_eigenvalue(Ball(mid, rad))))
    # Whole numbers: the products are exact, and so is the eigenvalue 0.
    rows = rng.integers(-8, 9, (COUNT, 6, 4)).astype(float)
    mid = rows @ rows.transpose(0, 2, 1)
    found = bound(mid, 0 * mid)
    assert np.all((found <= 0) & (found > -1e-9))
    # Matrices of the ball whose eigenvalue is less than that of its middle.
    other = rng.normal(size=mid.shape)
    moved = other + other.transpose(0, 2, 1)
    least = np.linalg.eigvalsh(mid + moved)[:, 0]
    found = bound(mid, np.abs(moved))
    assert np.all((found <= least + 1e-9) & np.isfinite(found))
    assert bound(np.full((1, 6, 6), np.nan), 0 * mid[:1]) == -np.inf


@pytest.mark.parametrize("way", WAYS)
def test_scalar_products_hold_those_of_all_their_numbers(way):
    inputs = [x.reshape(-1, 4) for x in two_balls(1)]
    a, r, b, s = (exactly(x) for x in inputs)
    middle, radius = rounded(lambda a, r, b, s: balls.dot(Ball(a, r), Ball(b, s)), way, *inputs)
    rad = np.sum(abs(a) * s + r * (abs(b) + s), axis=-1)
    assert np.all(abs(np.sum(a * b, axis=-1) - middle) + rad <= radius)


@pytest.mark.parametrize("way", WAYS)
def test_the_hull_of_values_holds_each_with_its_error(way):
    values = numbers(2, COUNT, 2)
    values[: COUNT // 3] *= 2.0**-30
    error = np.abs(numbers(3, COUNT))
    error[COUNT // 3 :] = 0.0
    # Numbers that differ in the last digits have a middle that is rounded by as much as they are apart.
    values[2 * COUNT // 3 :, 1] = np.nextafter(values[2 * COUNT // 3 :, 0], np.float32(9))
    middle, radius = rounded(lambda x, e: balls.hull(x, (1,), e), way, values, error)
    apart = abs(exactly(values) - middle[:, None]) + exactly(error)[:, None]
    assert np.all(apart <= radius[:, None])


@pytest.mark.parametrize("way", WAYS)
def test_the_ends_of_balls_lie_outside(way):
    mid, rad = two_balls(4)[:2]
    tiny = np.array([1.0, -1.0, 1.5], np.float32) * np.float32(2.0**-126)
    mid, rad = np.append(mid, tiny), np.append(rad, np.abs(tiny[[2, 2, 0]]))
    lower, upper = rounded(lambda m, r: (Ball(m, r).lower, Ball(m, r).upper), way, mid, rad)
    assert np.all(lower <= exactly(mid) - exactly(rad)) and np.all(exactly(mid) + exactly(rad) <= upper)


@pytest.mark.parametrize("way", WAYS)
def test_reciprocals_hold_those_of_all_their_numbers(way):
    mid = np.abs(numbers(5, COUNT)) + np.float32(0.5)
    rad = mid * np.abs(numbers(6, COUNT)).clip(max=0.9)
    rad[: COUNT // 2] = 0.0
    middle, radius = rounded(lambda m, r: balls.reciprocal(Ball(m, r)), way, mid, rad)
    for end in (exactly(mid) - exactly(rad), exactly(mid) + exactly(rad)):
        assert np.all(abs(1 / end - middle) <= radius)


def test_no_reciprocal_of_a_ball_with_zero_is_bounded():
    one = np.ones(1, np.float32)
    assert evaluate(lambda m, r: balls.reciprocal(Ball(m, r)).rad, Rounded(24), [one, one], [None] * 2) == np.inf


def nearly_singular():
    """Matrices [[a, b], [b, c]] with a determinant that is less than rounding away from zero."""
    rng = np.random.default_rng(7)
    a, c = (rng.uniform(0.5, 1, 400).astype(np.float32) for _ in range(2))
    b = np.sqrt(a.astype(float) * c).astype(np.float32)
    return np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -2)


def taken_for_semidefinite(way, matrices, radii):
    function = jax.vmap(lambda h, r: balls.semidefinite(Ball(h, r), jnp.zeros(2, bool)))
    return evaluate(function, Rounded(24, way), [matrices, radii], [None] * 2)


@pytest.mark.parametrize("way", WAYS)
def test_no_indefinite_matrix_is_taken_for_a_semidefinite_one(way):
    matrices = nearly_singular()
    h = exactly(matrices)
    indefinite = (h[:, 0, 0] * h[:, 1, 1] < h[:, 0, 1] ** 2).astype(bool)
    assert 100 < np.sum(indefinite) < 300
    assert not np.any(taken_for_semidefinite(way, matrices, np.zeros_like(matrices))[indefinite])
    # Away from the singular ones they are recognized.
    assert np.all(taken_for_semidefinite(way, matrices + np.eye(2, dtype=np.float32), np.zeros_like(matrices)))


@pytest.mark.parametrize("way", WAYS)
def test_no_ball_with_an_indefinite_matrix_is_taken_for_a_semidefinite_one(way):
    rng = np.random.default_rng(8)
    matrices = np.eye(2, dtype=np.float32) * rng.uniform(0.5, 1, (200, 2, 1)).astype(np.float32)
    # The first diagonal element reaches below zero, by the last digit.
    radii = np.zeros_like(matrices)
    radii[:, 0, 0] = np.nextafter(matrices[:, 0, 0], np.float32(2))
    assert not np.any(taken_for_semidefinite(way, matrices, radii))
