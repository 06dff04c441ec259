"""Lengths and unit vectors: of every size, of what is no number, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._arithmetic.scaling import frexp, ldexp, length, scale_of, times_two_to, unit


@pytest.mark.parametrize("exponent", [-1000, -600, 0, 600, 1020])
def test_lengths_neither_overflow_nor_vanish(exponent):
    vectors = np.ldexp([[0.375, 0.5, 0.0], [0.0, 0.0, 0.0]], exponent)
    for found in (length(vectors), jax.jit(length)(vectors)):
        assert np.asarray(found).tolist() == [float(np.ldexp(0.625, exponent)), 0.0]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_length_of_what_is_no_number_is_none(bad):
    with np.errstate(invalid="ignore"):
        assert np.isnan(length(np.array([bad, 1.0]))) and np.isnan(jax.jit(length)(np.array([bad, 1.0])))


def test_a_length_has_its_derivatives_and_none_at_zero():
    x = jnp.array([3.0, 4.0])
    np.testing.assert_allclose(jax.jit(jax.grad(length))(x), [0.6, 0.8], rtol=1e-15)
    np.testing.assert_allclose(jax.jit(jax.hessian(length))(x), np.array([[16, -12], [-12, 9]]) / 125, rtol=1e-14)
    assert jax.jit(jax.grad(length))(jnp.zeros(2)).tolist() == [0.0, 0.0]


def test_units_have_length_one_and_zero_stays():
    assert unit(np.array([[3.0, 4.0], [0.0, 0.0]])).tolist() == [[0.6, 0.8], [0.0, 0.0]]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_powers_of_two_are_exact_from_end_to_end_of_the_normal_numbers(dtype):
    info = np.finfo(dtype)
    powers = np.array([info.minexp, info.minexp + 1, -100, -1, 0, 1, 100, info.maxexp - 1])
    x = np.asarray(0.7, dtype)
    for power in powers:
        # Neither factor leaves the range where the product does not.
        for start in (x, np.ldexp(x, -power // 2)):
            exact = np.ldexp(start, power)
            if info.tiny <= exact < np.inf:
                assert jax.jit(times_two_to)(start, int(power)) == exact
    # As far as products with them are normal numbers.
    most = info.maxexp - 24
    scales = [float(scale_of(jnp.asarray(int(k)), dtype)) for k in (most + 9, most, 3, 0, -most, -most - 9)]
    assert scales == [2.0**-most, 2.0**-most, 0.125, 1.0, 2.0**most, 2.0**most]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_compiled_mantissas_and_exponents_are_those_of_numpy(dtype):
    info = np.finfo(dtype)
    x = np.random.default_rng(1).integers(0, 256, (4096, info.bits // 8), np.uint8).view(dtype)[:, 0]
    ends = np.array([0.0, 1.0, 0.5, info.max, info.tiny, info.smallest_subnormal], dtype)
    few = np.nextafter(ends, dtype(0))
    x = np.concatenate([x[np.isfinite(x)], ends, -ends, few, -few, 3 * ends[-1:]])
    for found, exact in zip(jax.jit(frexp)(x), np.frexp(x), strict=True):
        np.testing.assert_array_equal(np.asarray(found), exact, strict=True)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_compiled_scaling_is_that_of_numpy_where_results_are_normal(dtype):
    info = np.finfo(dtype)
    x = np.array([0.7, -1.5, info.max, info.tiny, info.smallest_subnormal, 0.0, np.inf, -np.inf, np.nan], dtype)
    powers = np.array([0, 1, -1, 37, -37, *np.array([1, -1, 2, -2, 3, -3]) * info.maxexp])[:, None]
    with np.errstate(over="ignore"):
        exact = np.ldexp(x, powers)
    exact = np.where(np.abs(exact) < info.tiny, np.copysign(0.0, exact), exact)
    program = jax.jit(ldexp)
    np.testing.assert_array_equal(program(x, powers), exact)
    # It is not exact on GPUs.
    assert "stablehlo.power" not in program.lower(x, powers).as_text()
    slopes = jax.jit(jax.vmap(jax.grad(ldexp), (None, 0)))(x[0], powers[:5, 0])
    np.testing.assert_array_equal(slopes, np.ldexp(np.ones((), dtype), powers[:5, 0]))
