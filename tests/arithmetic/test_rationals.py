"""Roots of rational numbers lie between their bounds, and floats next to a number are on the right side of it."""

from fractions import Fraction

import numpy as np
import pytest

from jhd._arithmetic.rationals import float_above, float_below, float_near, root_between

NU = {np.float64: 2.0**-1022, np.float32: 2.0**-126}


@pytest.mark.parametrize("x", [Fraction(2), Fraction(1, 3), Fraction(10) ** 400, Fraction(1, 7**300), Fraction(9, 4)])
def test_a_root_lies_between_its_bounds_which_are_close(x):
    low, high = root_between(x)
    assert low * low <= x <= high * high and (high - low) * 2**63 <= low


def test_roots_that_are_fractions_of_few_bits_are_exact():
    assert root_between(Fraction(9, 4)) == (Fraction(3, 2), Fraction(3, 2)) and root_between(Fraction(0)) == (0, 0)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("x", [Fraction(1, 3), Fraction(-1, 3), Fraction(1), Fraction(0), Fraction(1, 10**20)])
def test_the_floats_on_both_sides_are_neighbors_or_the_number_itself(x, dtype):
    low, high = float_below(x, np.dtype(dtype)), float_above(x, np.dtype(dtype))
    assert Fraction(float(low)) <= x <= Fraction(float(high)) and np.nextafter(low, dtype(np.inf)) >= high
    assert float_near(x, np.dtype(dtype)) in (low, high)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_what_is_below_the_smallest_and_above_the_largest_normal_number(dtype):
    tiny, huge, kind = Fraction(1, 10**400), Fraction(10) ** 400, np.dtype(dtype)
    assert float_below(tiny, kind) == 0 and float_above(tiny, kind) == NU[dtype]
    assert float_below(-tiny, kind) == -NU[dtype] and not np.signbit(float_above(-tiny, kind))
    assert float_below(huge, kind) == np.finfo(dtype).max and np.isposinf(float_above(huge, kind))
    assert np.isposinf(float_near(huge, kind)) and np.isneginf(float_below(-huge, kind))
