"""Exact rational numbers: square roots between two of them, and the floats next to one on either side."""

import math
from fractions import Fraction
from typing import Any

import numpy as np

from jhd._arithmetic.rounding import smallest_normal


def root_between(x: Fraction, bits: int = 64) -> tuple[Fraction, Fraction]:
    """Bounds of the square root, less than 2^(1 - bits) of it apart; equal if the root has few bits."""
    if x == 0:
        return x, x
    shift = bits + (x.denominator.bit_length() - x.numerator.bit_length()) // 2
    whole = x * Fraction(4) ** shift
    root = math.isqrt(whole.numerator // whole.denominator)
    low = Fraction(root) / Fraction(2) ** shift
    return low, low if low * low == x else Fraction(root + 1) / Fraction(2) ** shift


def float_below(x: Fraction, dtype: np.dtype) -> Any:
    """The largest float that is not above x and zero or normal; -inf below all, the largest float above all."""
    near = float_near(x, dtype)
    nu = smallest_normal(dtype)
    if 0 < abs(x) < nu:
        return np.asarray(-nu if x < 0 else 0.0, dtype)[()]
    if np.isposinf(near):
        return np.finfo(dtype).max
    above = np.isfinite(near) and Fraction(float(near)) > x
    return np.nextafter(near, np.asarray(-np.inf, dtype)) if above else near


def float_above(x: Fraction, dtype: np.dtype) -> Any:
    """The smallest float that is not below x and zero or normal; inf above all."""
    # Not minus, which would make a zero negative.
    return 0 - float_below(-x, dtype)


def float_near(x: Fraction, dtype: np.dtype) -> Any:
    """The float nearest to x, up to a second rounding to a shorter type; infinite if x is beyond all floats."""
    try:
        with np.errstate(over="ignore", under="ignore"):
            return np.asarray(float(x), dtype)[()]
    except OverflowError:
        return np.asarray(math.inf if x > 0 else -math.inf, dtype)[()]
