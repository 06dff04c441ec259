"""Means, fractions and quantiles of values that are known within bounds, with weights that are known within bounds.

The least value of sum w_i x_i / sum w_i for w_i in [a_i, b_i] is attained with w_i = b_i for x_i below some level and
w_i = a_i above it; all levels are tried, in the order of the values. Fractions and quantiles are such means of zeros
and ones. If affine functions bound a value, they are means of the fractions of cells in which the value is at most a
level.

**Affine functions.** Over a simplex with k corners, with its points spread evenly, the mean of the square of an affine
function with the values v_i is (sum v_i^2 + (sum v_i)^2) / (k (k + 1)). With sorted values, the function is at most t
over the fraction (t - v_0) / (v_1 - v_0) of a segment, and over the following fraction of a triangle:

    (t - v_0)^2 / ((v_1 - v_0) (v_2 - v_0))       if t is between v_0 and v_1,
    1 - (v_2 - t)^2 / ((v_2 - v_0) (v_2 - v_1))   if t is between v_1 and v_2.

Rounding: sums of n positive terms err by gamma(n) relative to themselves, whatever the order of the terms. Weights that
are known exactly, for example weights of points, have exact sums and quantiles, in whole numbers. A difference of two
floats has one rounding, and underflows only to zero. A quotient of two such differences that is at most one is formed
first, so a fraction is off by gamma(8) of at most one. Numbers below the smallest normal number are far less than that.
"""

from bisect import bisect_left
from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jhd._arithmetic.rounding import gamma
from jhd._runtime.arrays import taken

# Rounding error of the fraction of a quantile as a float.
_ROUNDED = Fraction(1, 2**50)
# Roundings of means of squares and of fractions of simplices.
_ROUNDINGS = gamma(32, np.float64)
# Bisection steps for the level of a quantile between the levels of whole cells.
_HALVINGS = 24


class Weights(NamedTuple):
    """Lower and upper bounds of weights, none negative; at least one upper bound is positive."""

    lower: Float[np.ndarray, " cells"]
    upper: Float[np.ndarray, " cells"]


def mean_bounds(weights: Weights, lower: np.ndarray, upper: np.ndarray) -> tuple[float, float]:
    """Bounds of the mean of values between non-negative bounds."""
    room = gamma(2 * len(lower) + 16, np.float64)
    least = _least_mean(weights, lower)
    if not np.all(np.isfinite(upper[weights.upper > 0])):
        return least * (1 - room), np.inf
    # The largest mean of x is top minus the least mean of top - x.
    top = float(np.max(upper))
    most = top - _least_mean(weights, top - upper)
    return least * (1 - room), min(most + room * top, top)


def _least_mean(weights: Weights, values: np.ndarray) -> float:
    order = np.argsort(values)
    x, a, b = values[order], weights.lower[order], weights.upper[order]
    below = np.cumsum(b), np.cumsum(b * x)
    above = [np.append(np.cumsum(y[::-1])[::-1][1:], 0.0) for y in (a, a * x)]
    total = below[0] + above[0]
    known = total > 0
    return float(np.min((below[1] + above[1])[known] / total[known]))


def greatest_square(values: Float[np.ndarray, "cells corners"]) -> Float[np.ndarray, " cells"]:
    """Upper bounds of the means of the squares."""
    count = values.shape[1]
    return (np.sum(values**2, axis=1) + np.sum(values, axis=1) ** 2) / (count * (count + 1)) * (1 + _ROUNDINGS)


def least_square(values: Float[np.ndarray, "cells corners"]) -> Float[np.ndarray, " cells"]:
    """Lower bounds of the means of max(f, 0)^2: nowhere is f more negative than at a corner."""
    count = values.shape[1]
    whole = (np.sum(values**2, axis=1) + np.sum(values, axis=1) ** 2) / (count * (count + 1))
    negative = np.maximum(-np.min(values, axis=1), 0.0)
    return np.maximum(whole - negative**2 - _ROUNDINGS * np.max(values**2, axis=1), 0.0)


def shares_below(
    values: Float[np.ndarray, "cells corners"], level: float
) -> tuple[Float[np.ndarray, " cells"], Float[np.ndarray, " cells"]]:
    """Lower and upper bounds of the fractions of the simplices on which the functions are at most `level`."""
    ordered = np.sort(values, axis=1)
    first, last = ordered[:, 0], ordered[:, -1]
    low, high = (last <= level).astype(np.float64), (first <= level).astype(np.float64)
    rows = np.flatnonzero(low != high)
    if not len(rows):
        return low, high
    v, first, last = ordered[rows], first[rows], last[rows]
    if values.shape[1] == 2:
        share = (level - first) / (last - first)
    else:
        middle = v[:, 1]
        left = level < middle
        end, apart = np.where(left, first, last), np.abs(level - np.where(left, first, last))
        corner = apart / (last - first) * (apart / np.where(apart > 0, np.abs(middle - end), 1.0))
        share = np.where(left, corner, 1 - corner)
    low[rows], high[rows] = np.clip(share - _ROUNDINGS, 0.0, 1.0), np.clip(share + _ROUNDINGS, 0.0, 1.0)
    return low, high


class Values(NamedTuple):
    """Bounds of values over cells."""

    lower: Float[np.ndarray, " cells"]  # lower bound everywhere
    upper: Float[np.ndarray, " cells"]  # upper bound everywhere
    # Values at the corners of two affine functions, which bound the values from below and above.
    ends: Float[np.ndarray, "cells corners 2"]

    take = taken

    def within(self, level: float) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds of the fraction of each cell on which values are at most `level`."""
        surely, maybe = (shares_below(self.ends[..., k], level)[1 - k] for k in (1, 0))
        return np.where(self.upper <= level, 1.0, surely), np.where(self.lower <= level, maybe, 0.0)


def share_bounds(weights: Weights, surely: np.ndarray, maybe: np.ndarray) -> tuple[float, float]:
    """Bounds of the fraction of the weight with a property, by the fractions of cells that surely and maybe have it."""
    room = gamma(len(surely) + 16, np.float64)
    rest = 1.0 - _share(weights, 1.0 - maybe) * (1 - room)
    # The difference rounds as a number of about one does.
    return _share(weights, surely) * (1 - room), min(rest + room, 1.0)


def _share(weights: Weights, where: np.ndarray) -> float:
    """Smallest fraction that the weight with this property can have."""
    inside, outside = np.sum(weights.lower * where), np.sum(weights.upper * (1.0 - where))
    return float(inside / (inside + outside)) if inside > 0 else 0.0


def quantile_bounds(weights: Weights, values: Values, q: float) -> tuple[float, float]:
    """Bounds of the least value that a fraction q of the weight does not exceed, for values between bounds.

    The fraction counts as reached within its own rounding: nine of ten points are a fraction of 0.9.
    """
    low, high = _of_cells(weights, values.lower, values.upper, q)
    # The fraction, a product with it and a sum are rounded too.
    q = q * (1 - float(_ROUNDED))
    open_ = (values.upper > low) & (values.lower < high)
    affine = np.max(values.ends, axis=1) > np.min(values.ends, axis=1)
    if not (np.isfinite(high) and np.any(affine[open_])):
        return low, high
    # All others are below the levels between, or above.
    room = gamma(len(open_) + 16, np.float64)
    rest = [
        (np.sum(weights.lower[rows]) * (1 - room), np.sum(weights.upper[rows]) * (1 + room))
        for rows in (values.upper <= low, ~open_ & (values.upper > low))
    ]
    some = Weights(*(np.append(x[open_], y) for x, y in zip(weights, np.transpose(rest), strict=True)))
    held = values.take(open_)

    def reached(level: float) -> tuple[bool, bool]:
        """Return whether surely, and whether maybe, a fraction q of the values is at most `level`."""
        shares = share_bounds(some, *(np.append(x, (1.0, 0.0)) for x in held.within(level)))
        return shares[0] >= q, shares[1] >= q

    most = _switch(low, high, lambda level: reached(level)[0])[1]
    return _switch(low, most, lambda level: reached(level)[1])[0], most


def _switch(low: float, high: float, holds: Callable[[float], bool]) -> tuple[float, float]:
    """Bisect between `low` and `high`; return neighboring numbers of which only the upper one satisfies `holds`."""
    for _ in range(_HALVINGS):
        level = 0.5 * low + 0.5 * high
        if not low < level < high:
            break
        low, high = (low, level) if holds(level) else (level, high)
    return low, high


def _of_cells(weights: Weights, lower: np.ndarray, upper: np.ndarray, q: float) -> tuple[float, float]:
    """Bounds of a quantile by the bounds of whole cells alone."""
    a, b = weights
    if np.all(a == b):
        least, most = (np.sort(x)[first_reaching(b[np.argsort(x)], q)] for x in (lower, upper))
        return float(least), float(most)
    # The fraction, a product with it and a sum are rounded too.
    q, room = q * (1 - float(_ROUNDED)), gamma(len(lower) + 16, np.float64)
    found = []
    # The largest fraction with values up to each lower bound, and the smallest one up to each upper bound.
    for values, within, beyond, factor in ((lower, b, a, 1 + room), (upper, a, b, 1 - room)):
        order = np.argsort(values)
        inside = np.cumsum(within[order])
        outside = np.append(np.cumsum(beyond[order][::-1])[::-1][1:], 0.0)
        enough = inside * factor >= q * (inside + outside)
        found.append(float(values[order][np.argmax(enough)] if np.any(enough) else np.max(values)))
    return found[0], found[1]


def first_reaching(weights: np.ndarray, q: float) -> int:
    """Index of the first point, in the order of the values, up to which a fraction q of the weights lies; exact.

    Args:
        weights: exact weights in the order of the values, not negative, some positive.
        q: the fraction, which counts as reached within its own rounding.
    """
    inside = np.cumsum(_multiples(weights)[0])
    wanted = Fraction(float(q)) * (1 - _ROUNDED) * inside[-1]
    return bisect_left(inside.tolist(), -(-wanted.numerator // wanted.denominator))


def exact_sum(weights: np.ndarray) -> Fraction:
    """Return the exact sum of finite weights."""
    whole, power = _multiples(weights)
    return np.sum(whole) * Fraction(2) ** power


def _multiples(weights: np.ndarray) -> tuple[np.ndarray, int]:
    """Return weights as integers of any length times a power of two, and its exponent."""
    mantissa, power = np.frexp(np.asarray(weights, np.float64))
    power = np.where(mantissa != 0, power, np.max(power))
    whole = np.ldexp(mantissa, 53).astype(np.int64).astype(object)
    return whole << (power - np.min(power)).astype(object), int(np.min(power)) - 53
