"""Bounds in decimal digits, rounded outward: a lower bound down and an upper bound up, so the printed bounds are true.

Without a format, the number of digits is the smallest that reads back as the same floating-point number.
"""

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal, localcontext
from typing import Any

import numpy as np

# The shortest digits that are read back as a float64 may lie on its wrong side. 18 digits are enough on either side:
# their step is at most 1e-17 of the number, and numbers read as other floats differ from it by at least 2^-54 of it.
_DIGITS = ".17g", ".18g"


def lower_text(bound: Any, spec: str = "") -> str:
    """A lower bound in decimal digits, rounded down.

    >>> lower_text(2 / 3, ".3f"), lower_text(0.1), lower_text(0.3)
    ('0.666', '0.1', '0.29999999999999998')

    Args:
        bound: one number.
        spec: format specification of a decimal number, for example ".3f". By default all digits are written.
    """
    return _text(float(bound), spec, ROUND_FLOOR)


def upper_text(bound: Any, spec: str = "") -> str:
    """An upper bound in decimal digits, rounded up.

    >>> upper_text(2 / 3, ".3f"), upper_text(0.1), upper_text(0.3)
    ('0.667', '0.10000000000000001', '0.3')

    Args:
        bound: one number.
        spec: format specification of a decimal number, for example ".3f". By default all digits are written.
    """
    return _text(float(bound), spec, ROUND_CEILING)


def interval_text(lower: Any, upper: Any, spec: str = "") -> str:
    """Both bounds of a number as `[lower, upper]`, rounded outward.

    Args:
        lower: lower bound.
        upper: upper bound; infinite if none is proven.
        spec: format specification of a decimal number, for example ".3f". By default all digits are written.
    """
    return f"[{lower_text(lower, spec)}, {upper_text(upper, spec)}]"


def point_text(point: Any) -> str:
    """The coordinates of a point to six digits, `(x, y)`; coordinates at rounding level are printed as zero.

    >>> point_text([-1e-16, 2.0])
    '(0, 2)'

    Args:
        point: coordinates, (dim,).
    """
    known = np.asarray(point)
    known = known.astype(np.result_type(known, np.float32))
    least = 4 * np.finfo(known.dtype).eps * np.abs(known).max()
    return f"({', '.join(f'{0.0 if abs(x) < least else x:.6g}' for x in known)})"


def _text(x: float, spec: str, rounding: str) -> str:
    if not math.isfinite(x):
        return format(x, spec)
    exact, shortest = Decimal(x), repr(x)
    with localcontext(rounding=rounding):
        if spec:
            return format(exact, spec)
        off = Decimal(shortest).compare(exact)
        if off == 0 or (off > 0) == (rounding == ROUND_CEILING):
            return shortest
        return next(text for text in (format(exact, digits) for digits in _DIGITS) if float(text) == x)
