"""Every function on Bernstein forms against exact rational arithmetic, within the error that its docstring proves."""

import math
from fractions import Fraction
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jhd._arithmetic import bernstein, rounding

ATTEMPTS = settings(max_examples=25, deadline=None, derandomize=True)
DEGREES = (0, 1, 3, 6)
PRECISIONS = ("float64", "float32")
NUMBERS = st.floats(-1e3, 1e3, width=32) | st.sampled_from([0.0, 1e-310, -1e-310, 1e-40, 2.3e-308, 1e15, -1e15, 1 / 3])
UNIT = st.floats(0, 1, width=32) | st.sampled_from([0.0, 1.0, 1 / 3, 1e-300, 1 - 2**-53])


def forms(degree: int) -> st.SearchStrategy[list[float]]:
    return st.lists(NUMBERS, min_size=degree + 1, max_size=degree + 1)


def exactly(values) -> list[Fraction]:
    return [Fraction(float(x)) for x in np.ravel(np.asarray(values))]


def value(c: list[Fraction], t: Fraction) -> Fraction:
    while len(c) > 1:
        c = [(1 - t) * a + t * b for a, b in zip(c[:-1], c[1:], strict=True)]
    return c[0]


def blossoms(c: list[Fraction], t0: Fraction, t1: Fraction) -> list[Fraction]:
    n, result = len(c) - 1, []
    for j in range(n + 1):
        row = c
        for t in [t0] * (n - j) + [t1] * j:
            row = [(1 - t) * a + t * b for a, b in zip(row[:-1], row[1:], strict=True)]
        result.append(row[0])
    return result


def product(f: list[Fraction], g: list[Fraction]) -> list[Fraction]:
    n, m = len(f) - 1, len(g) - 1
    result = [Fraction(0)] * (n + m + 1)
    for i, a in enumerate(f):
        for j, b in enumerate(g):
            result[i + j] += Fraction(math.comb(n, i) * math.comb(m, j), math.comb(n + m, i + j)) * a * b
    return result


def assert_within(computed, exact: list[Fraction], bound) -> None:
    for x, z in zip(exactly(computed), exact, strict=True):
        assert abs(x - z) <= bound, (float(x), float(z), float(bound))


def bound_of(operations: int, magnitude, dtype) -> Fraction:
    """The proven bound, with nu for a subnormal coefficient."""
    m = max([abs(x) for x in magnitude], default=Fraction(0))
    k, nu = operations + 1, Fraction(rounding.smallest_normal(dtype))
    return Fraction(rounding.gamma(k, dtype)) * m + (2 * k + 1) * nu


@cache
def compiled(name: str, *static: int):
    function = getattr(bernstein, name)
    return jax.jit(lambda *args: function(*args, *static))


@pytest.mark.parametrize("dtype", PRECISIONS)
@pytest.mark.parametrize("degree", DEGREES)
@ATTEMPTS
@given(data=st.data(), t0=UNIT, t1=UNIT)
def test_values_parts_and_halves_are_within_their_bound(degree, dtype, data, t0, t1):
    c, (t0, t1) = np.array(data.draw(forms(degree)), dtype), np.array([t0, t1], dtype)
    exact, t, bound = exactly(c), Fraction(float(t0)), bound_of(3 * degree, exactly(c), dtype)
    assert_within(compiled("evaluate")(c, t0), [value(exact, t)], bound)
    assert_within(compiled("restrict")(c, t0, t1), blossoms(exact, t, Fraction(float(t1))), bound)
    left, right = compiled("split")(c, t0)
    assert_within(left, blossoms(exact, Fraction(0), t), bound)
    assert_within(right, blossoms(exact, t, Fraction(1)), bound)


@pytest.mark.parametrize("dtype", PRECISIONS)
@pytest.mark.parametrize("degree", DEGREES)
@ATTEMPTS
@given(data=st.data())
def test_products_and_elevated_forms_are_within_their_bound(degree, dtype, data):
    f, g = np.array(data.draw(forms(degree)), dtype), np.array(data.draw(forms(3)), dtype)
    largest = [max(map(abs, exactly(f))), max(map(abs, exactly(g)))]
    subnormal = Fraction(rounding.smallest_normal(dtype)) * sum(largest)
    bound = bound_of(3 + min(degree, 3), [largest[0] * largest[1]], dtype) + subnormal
    assert_within(compiled("multiply")(f, g), product(exactly(f), exactly(g)), bound)
    elevated = product(exactly(f), [Fraction(1)] * 3)
    assert_within(compiled("elevate", degree + 2)(f), elevated, bound_of(5, exactly(f), dtype))


@pytest.mark.parametrize("dtype", PRECISIONS)
@pytest.mark.parametrize("degree", DEGREES)
@ATTEMPTS
@given(data=st.data())
def test_derivatives_are_within_two_roundings(degree, dtype, data):
    c = np.array(data.draw(forms(degree)), dtype)
    exact = exactly(c)
    slopes = [degree * (b - a) for a, b in zip(exact[:-1], exact[1:], strict=True)] or [Fraction(0)]
    nu = Fraction(rounding.smallest_normal(dtype))
    assert_within(compiled("derivative")(c), slopes, bound_of(2, slopes, dtype) + 2 * (degree + 1) * nu)


def test_the_tables_of_binomials_are_exact_as_far_as_promised():
    for degree in (0, 1, 30, 56):
        assert exactly(bernstein.binomials(degree)) == [math.comb(degree, i) for i in range(degree + 1)]
    table = bernstein.product_weights(7, 5)
    assert table[3, 2] == math.comb(7, 3) * math.comb(5, 2) / math.comb(12, 5)


def test_axes_are_those_asked_for():
    c = np.random.default_rng(3).uniform(-1, 1, (4, 4, 4))
    for axis in (-3, -2, -1):
        last = np.moveaxis(c, axis, -1)
        for name, args in (("evaluate", (0.3,)), ("derivative", ()), ("elevate", (5,)), ("restrict", (0.2, 0.7))):
            function = getattr(bernstein, name)
            found, expected = jax.jit(lambda c, last, f=function, a=args, k=axis: (f(c, *a, axis=k), f(last, *a)))(
                c, last
            )
            np.testing.assert_allclose(
                found, expected if name == "evaluate" else np.moveaxis(expected, -1, axis), rtol=1e-14
            )
        assert bernstein.degree(jnp.asarray(c), axis) == c.shape[axis] - 1


def test_the_scalar_product_is_the_sum_of_products_of_coordinates():
    f, g = (np.random.default_rng(k).uniform(-1, 1, (3 + k, 2)) for k in (0, 1))
    expected = sum(np.asarray(compiled("multiply")(f[:, k], g[:, k])) for k in range(2))
    np.testing.assert_allclose(compiled("dot")(f, g), expected, rtol=1e-14)


def test_a_form_is_not_elevated_downward():
    with pytest.raises(ValueError, match="degree is 3"):
        bernstein.elevate(jnp.zeros(4), 2)


def test_mixed_precisions_keep_the_finer_one():
    f, g = np.array([1, 2, 3], np.float32), np.array([1 / 3, 1 / 7])
    assert_within(compiled("multiply")(f, g), product(exactly(f), exactly(g)), Fraction(1e-15))
