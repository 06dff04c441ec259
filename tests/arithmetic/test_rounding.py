"""The rounding bounds against exact rational arithmetic, in both precisions, at zeros, subnormals and overflow."""

import math
from collections.abc import Callable
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jhd._arithmetic import rounding

ATTEMPTS = settings(max_examples=25, deadline=None, derandomize=True)
DTYPES = (np.float64, np.float32)
COUNT = 24


def floats(dtype: type) -> st.SearchStrategy[np.ndarray]:
    """Arrays of COUNT finite floats, special ones and every exponent among them."""
    width = 64 if dtype is np.float64 else 32
    info = np.finfo(dtype)
    special = [0.0, info.smallest_normal, info.smallest_subnormal, info.max, 1.0, 1 + info.eps, 1 - info.epsneg, 3.0]
    one = st.sampled_from([float(x) for x in special]) | st.floats(width=width, allow_nan=False, allow_infinity=False)
    signed = st.builds(lambda x, negative: -x if negative else x, one, st.booleans())
    return st.lists(signed, min_size=COUNT, max_size=COUNT).map(lambda x: np.array(x, dtype))


def exact_root(x: Fraction) -> tuple[Fraction, Fraction]:
    """Fractions on both sides of the square root, 2^-1200 apart."""
    shift = 1 << 1200
    below = math.isqrt(x.numerator * shift * shift // x.denominator)
    return Fraction(below, shift), Fraction(below + 1, shift)


def bounds(operation: Callable) -> Callable:
    """Compiled: both bounds of an operation on normal operands."""

    def of(x, y):
        result = operation(x, y)
        return rounding.round_down(result), rounding.round_up(result)

    return jax.jit(of)


OPERATIONS = {
    "sum": (bounds(jnp.add), lambda x, y: x + y),
    "difference": (bounds(jnp.subtract), lambda x, y: x - y),
    "product": (bounds(jnp.multiply), lambda x, y: x * y),
    "quotient": (bounds(rounding.quotient), lambda x, y: x / y),
}
CONSTANT_QUOTIENTS = {
    d: bounds(lambda x, y, d=d: rounding.quotient(x, jnp.asarray(d, x.dtype))) for d in (3.0, -0.1, 3e38)
}
FLUSHED_DOWN, FLUSHED_UP = jax.jit(rounding.flush_down), jax.jit(rounding.flush_up)
WIDENED, POWER = jax.jit(rounding.widen), jax.jit(rounding.power_of_two)
HUGE_QUOTIENT = bounds(lambda x, y: rounding.quotient(x, 1.5e308))
SQUARE_ROOT = bounds(lambda x, y: jnp.sqrt(x))


def assert_between(lower, exact, upper) -> None:
    for low, z, high in zip(np.asarray(lower), exact, np.asarray(upper), strict=True):
        assert low == -np.inf or (low < np.inf and Fraction(float(low)) <= z), (low, float(z))
        assert high == np.inf or (high > -np.inf and z <= Fraction(float(high))), (float(z), high)


def fractions(x: np.ndarray) -> list[Fraction]:
    return [Fraction(float(v)) for v in x]


@pytest.mark.parametrize("dtype", DTYPES)
@ATTEMPTS
@given(data=st.data())
def test_widening_one_operation_encloses_the_exact_result(dtype, data):
    x, y = (np.array(FLUSHED_DOWN(data.draw(floats(dtype)))) for _ in range(2))
    for name, (compiled, exact) in OPERATIONS.items():
        if name == "quotient":
            y[y == 0] = 1
        lower, upper = compiled(x, y)
        assert_between(lower, [exact(a, b) for a, b in zip(fractions(x), fractions(y), strict=True)], upper)


@pytest.mark.parametrize("dtype", DTYPES)
@ATTEMPTS
@given(data=st.data())
def test_a_constant_divisor_may_become_its_reciprocal(dtype, data):
    x = np.array(FLUSHED_UP(data.draw(floats(dtype))))
    for divisor, compiled in CONSTANT_QUOTIENTS.items():
        lower, upper = compiled(x, x)
        assert_between(lower, [a / Fraction(float(dtype(divisor))) for a in fractions(x)], upper)


def test_a_huge_constant_divisor_keeps_its_quotient():
    x = np.array([1e308, -1.7e308, 3.0, 0.0])
    lower, upper = HUGE_QUOTIENT(x, x)
    assert_between(lower, [a / Fraction(1.5e308) for a in fractions(x)], upper)
    assert float(upper[0]) < 0.67


@pytest.mark.parametrize("dtype", DTYPES)
@ATTEMPTS
@given(data=st.data())
def test_widening_a_square_root_encloses_it(dtype, data):
    x = np.abs(np.array(FLUSHED_UP(data.draw(floats(dtype)))))
    lower, upper = (np.asarray(end) for end in SQUARE_ROOT(x, x))
    for low, z, high in zip(lower, fractions(x), upper, strict=True):
        below, above = exact_root(z)
        assert Fraction(float(low)) <= below and above <= Fraction(float(high))


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_ends_of_the_number_line(dtype):
    info = np.finfo(dtype)
    x = np.array([0, info.max, -info.max, np.inf, -np.inf, np.nan, info.smallest_normal], dtype)
    lower, upper = np.asarray(rounding.round_down(x)), np.asarray(rounding.round_up(x))
    assert lower[0] < 0 < upper[0]
    assert upper[1] == np.inf and lower[2] == -np.inf
    assert np.isfinite(lower[3]) and upper[3] == np.inf
    assert lower[4] == -np.inf and np.isfinite(upper[4])
    assert lower[5] == -np.inf and upper[5] == np.inf
    assert lower[6] <= 0


@pytest.mark.parametrize("dtype", DTYPES)
@ATTEMPTS
@given(data=st.data())
def test_flushing_moves_outward_to_the_nearest_number_that_survives(dtype, data):
    x, nu = data.draw(floats(dtype)), Fraction(rounding.smallest_normal(dtype))
    down, up = FLUSHED_DOWN(x), FLUSHED_UP(x)
    for z, low, high in zip(fractions(x), fractions(np.asarray(down)), fractions(np.asarray(up)), strict=True):
        assert low <= z <= high
        assert (low == z == high) if abs(z) >= nu or z == 0 else (high - low == nu and 0 in (low, high))


@pytest.mark.parametrize("dtype", DTYPES)
@ATTEMPTS
@given(data=st.data())
def test_the_power_of_two_leaves_a_number_between_one_and_two(dtype, data):
    x = np.array(FLUSHED_DOWN(data.draw(floats(dtype))))
    for z, power in zip(fractions(x), fractions(np.asarray(POWER(x))), strict=True):
        assert power == 1 if z == 0 else power <= abs(z) < 2 * power


@pytest.mark.parametrize("dtype", DTYPES)
@ATTEMPTS
@given(data=st.data())
def test_a_priori_bounds_are_widened_by_at_least_what_is_asked(dtype, data):
    lower, upper = (np.array(FLUSHED_DOWN(data.draw(floats(dtype)))) for _ in range(2))
    error = np.abs(data.draw(floats(dtype)))
    down, up = WIDENED(lower, upper, error)
    rows = zip(fractions(lower), fractions(upper), fractions(error), strict=True)
    exact = [(a - w, b + w) for a, b, w in rows]
    assert_between(down, [low for low, _ in exact], np.full(COUNT, np.inf))
    assert_between(np.full(COUNT, -np.inf), [high for _, high in exact], up)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("operations", (0, 1, 7, 100))
def test_gamma_is_above_its_formula(operations, dtype):
    ku = operations * Fraction(rounding.unit_roundoff(dtype))
    assert Fraction(rounding.gamma(operations, dtype)) >= ku / (1 - ku)
    magnitude = np.array([0.0, 1e-30, 1.0, 1e30], dtype)
    for m, bound in zip(fractions(magnitude), rounding.absolute_error(operations, magnitude), strict=True):
        assert Fraction(float(bound)) >= ku / (1 - ku) * m + 2 * operations * Fraction(rounding.smallest_normal(dtype))


@pytest.mark.parametrize("operations", (-1, 1e6))
def test_gamma_refuses_counts_outside_its_proof(operations):
    with pytest.raises(ValueError, match="operations"):
        rounding.gamma(operations, np.float32)


def test_single_precision_is_coarser_where_division_is_an_approximation(monkeypatch):
    found = []
    for backend in ("cpu", "gpu"):
        monkeypatch.setattr(jax, "default_backend", lambda backend=backend: backend)
        found.append([rounding.unit_roundoff(dtype) for dtype in (np.float32, np.float64)])
    fine, coarse = found
    # A division, two roundings of the model, is off by 2.03 units in the last place, a square root by 0.94.
    assert 2 * coarse[0] > 2.03 * 2.0**-23 and coarse[0] > 0.94 * 2.0**-23
    assert fine == [2.0**-24, 2.0**-53] and coarse[1] == 2.0**-53
