"""Intervals enclose exact rational arithmetic; they never hold a NaN."""

import operator
from fractions import Fraction

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jhd._arithmetic.interval import Interval

ATTEMPTS = settings(max_examples=40, deadline=None, derandomize=True)
# An operation widens by up to four units in the last place at each end; six of them, a cube among them, by no more.
ULPS = 64 * np.finfo(float).eps
SPECIAL = [0.0, -0.0, 1.0, 5e-324, -5e-324, 2.2250738585072014e-308, 1e308, -1e308]
NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from(SPECIAL)
PLACES = st.fractions(0, 1, max_denominator=8)
BINARY = {
    "sum": (operator.add, operator.add),
    "difference": (operator.sub, operator.sub),
    "product": (operator.mul, operator.mul),
    "quotient": (operator.truediv, operator.truediv),
    "minimum": (Interval.minimum, min),
    "maximum": (Interval.maximum, max),
}
UNARY = {
    "negative": (operator.neg, operator.neg),
    "absolute": (abs, abs),
    "square": (Interval.square, lambda x: x * x),
    "cube": (lambda x: x**3, lambda x: x**3),
    "fourth": (lambda x: x**4, lambda x: x**4),
    "reciprocal": (lambda x: x**-1, lambda x: 1 / x),
    "inverse square": (lambda x: x**-2, lambda x: 1 / x**2),
}
# All operations of a kind in one program.
ON_TWO, ON_ONE = (
    eqx.filter_jit(lambda *x, table=table: {name: f(*x) for name, (f, _) in table.items()}) for table in (BINARY, UNARY)
)


@st.composite
def intervals_with_a_point(draw) -> tuple[Interval, Fraction]:
    lower, upper = sorted((draw(NUMBERS), draw(NUMBERS)))
    a, b, place = Fraction(lower), Fraction(upper), draw(PLACES)
    return Interval(jnp.asarray(lower), jnp.asarray(upper)), a + place * (b - a)


def holds(interval: Interval, z: Fraction) -> bool:
    lower, upper = float(interval.lower), float(interval.upper)
    return (lower == -np.inf or Fraction(lower) <= z) and (upper == np.inf or z <= Fraction(upper))


@ATTEMPTS
@given(a=intervals_with_a_point(), b=intervals_with_a_point())
def test_an_operation_on_two_intervals_holds_the_exact_results(a, b):
    for name, result in ON_TWO(a[0], b[0]).items():
        if name == "quotient" and b[1] == 0:
            assert float(result.lower) == -np.inf and float(result.upper) == np.inf
        else:
            assert holds(result, BINARY[name][1](a[1], b[1])), name


@ATTEMPTS
@given(a=intervals_with_a_point())
def test_an_operation_on_one_interval_holds_the_exact_results(a):
    for name, result in ON_ONE(a[0]).items():
        if a[1] != 0 or not name.startswith(("reciprocal", "inverse")):
            assert holds(result, UNARY[name][1](a[1])), name


@ATTEMPTS
@given(a=intervals_with_a_point())
def test_a_square_root_squared_holds_the_number(a):
    root = a[0].sqrt()
    if a[1] >= 0:
        assert Fraction(float(root.lower)) ** 2 <= a[1]
        assert float(root.upper) == np.inf or a[1] <= Fraction(float(root.upper)) ** 2


@ATTEMPTS
@given(a=intervals_with_a_point(), b=intervals_with_a_point())
def test_hull_and_intersection_are_those_of_sets(a, b):
    assert holds(a[0].hull(b[0]), a[1]) and holds(a[0].hull(b[0]), b[1])
    assert holds(a[0].intersection(b[0]), a[1]) == (holds(a[0], a[1]) and holds(b[0], a[1]))


@ATTEMPTS
@given(a=intervals_with_a_point())
def test_the_midpoint_lies_inside_and_the_width_is_not_too_small(a):
    middle, width = float(a[0].midpoint), float(a[0].width)
    assert np.isfinite(middle) and bool(a[0].contains(middle))
    lower, upper = Fraction(float(a[0].lower)), Fraction(float(a[0].upper))
    assert width == np.inf or upper - lower <= Fraction(width)


@ATTEMPTS
@given(lower=NUMBERS, upper=NUMBERS, x=NUMBERS)
def test_contains_is_exact_for_subnormal_numbers_too(lower, upper, x):
    interval = Interval(jnp.asarray(lower), jnp.asarray(upper))
    assert bool(interval.contains(x)) == (float(interval.lower) <= x <= float(interval.upper))
    assert bool(interval.empty) == (float(interval.lower) > float(interval.upper))


def test_the_whole_line_and_zero_give_no_nan():
    ends = [-np.inf, -1.0, 0.0, 2.0, np.inf]
    pairs = np.array([(a, b) for a in ends for b in ends if a < b or a == b and np.isfinite(a)])
    everything = Interval(jnp.asarray(pairs[:, 0]), jnp.asarray(pairs[:, 1]))
    rows = jax.vmap(lambda a, b: [f(a, b) for f, _ in BINARY.values()], in_axes=(None, 0))
    table = jax.jit(jax.vmap(rows, in_axes=(0, None)))(everything, everything)
    powers = jax.jit(lambda a: [f(a) for f, _ in UNARY.values()])(everything)
    assert not any(np.isnan(x).any() for x in jax.tree.leaves((table, powers, everything.midpoint)))


def test_zero_times_the_whole_line_is_zero():
    product = Interval.whole() * 0.0
    assert bool(product.contains(0.0)) and float(product.width) < 1e-300


def test_division_by_an_interval_with_zero_as_an_end_is_the_whole_line():
    result = 1.0 / Interval(jnp.array(0.0), jnp.array(1.0))
    assert float(result.lower) == -np.inf and float(result.upper) == np.inf


def test_signs_that_are_known_are_kept():
    positive = Interval(jnp.array(0.0), jnp.array(2.0))
    assert float((positive * positive).lower) == 0.0
    assert float((positive * -positive).upper) == 0.0
    assert float(Interval(jnp.array(-3.0), jnp.array(2.0)).square().lower) == 0.0
    assert float(positive.sqrt().lower) == 0.0


def test_results_are_a_few_ulps_wide():
    third = Interval.exact(1.0) / 3.0
    value = (third * third + 2.0 - third) ** 3
    assert float(value.width) <= ULPS * float(value.upper)


@pytest.mark.parametrize("x", (2**53 + 1, 2**70 - 1, -(2**60) - 1, 5e-324, -1e-320, np.asarray(1e-310)))
def test_numbers_that_are_no_normal_floats_are_enclosed(x):
    z = Fraction(x if isinstance(x, int) else float(x))
    for interval in (Interval.exact(x), Interval(x, x), Interval(x, x) * 1.0):
        assert holds(interval, z) and float(interval.width) > 0 and bool(interval.contains(x))
    assert not bool(Interval(0, 0).contains(x))


def test_integer_arrays_are_enclosed():
    numbers = jnp.array([3, 2**60 + 1])
    interval = Interval.exact(numbers)
    assert float(interval.lower[0]) == float(interval.upper[0]) == 3.0
    assert holds(interval[1], Fraction(2**60 + 1))


def test_a_float_is_taken_as_it_is():
    tenth = Interval.exact(0.1)
    assert float(tenth.lower) == float(tenth.upper) == 0.1


def test_a_python_float_keeps_its_digits_beside_a_float32_array():
    tenth = Interval(jnp.float32([0.0]), jnp.float32([0.0])) + 0.1
    assert holds(tenth[0], Fraction(0.1)) and float(tenth.width[0]) < ULPS


@pytest.mark.parametrize("x", (np.nan, np.inf, -np.inf))
def test_what_is_no_number_gives_an_unbounded_interval(x):
    interval = Interval.exact(x)
    assert np.isinf(float(interval.width)) and not bool(interval.empty)


def test_intervals_pass_through_jit_and_vmap_as_pytrees():
    interval = Interval(jnp.arange(4.0), jnp.arange(4.0) + 1)
    mapped = jax.jit(jax.vmap(lambda x: (x * x - 1.0).maximum(0.5)))(interval)
    assert mapped.shape == (4,) and bool(jnp.all(mapped.upper >= (interval.upper**2 - 1)))


def test_a_power_needs_an_integer():
    with pytest.raises(TypeError, match="exponent"):
        _ = Interval.exact(2.0) ** 0.5  # pyright: ignore[reportOperatorIssue]


def test_ends_that_are_no_floats_move_outward_and_print_as_numbers():
    whole = Interval(2**53 + 1, 2**60 + 1)
    assert int(whole.lower) <= 2**53 + 1 and int(whole.upper) > 2**60
    assert repr(Interval(-1, 2) * 3) == repr(Interval(-3.0, 6.0) * 1) and repr(Interval(0, 1)) == "Interval(0.0, 1.0)"
    assert repr(Interval.exact(np.arange(2.0))) == "Interval(lower=[0, 1], upper=[0, 1])"
