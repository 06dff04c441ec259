"""Affine functions over points, segments and triangles, by their values at the corners: mean squares, and level sets.

Over a simplex with k corners, with its points spread evenly, the mean of the square of an affine function with the
values v_i is (sum v_i^2 + (sum v_i)^2) / (k (k + 1)). With sorted values, the function is at most t over the fraction
(t - v_0) / (v_1 - v_0) of a segment, and over the following fraction of a triangle:

    (t - v_0)^2 / ((v_1 - v_0) (v_2 - v_0))       if t is between v_0 and v_1,
    1 - (v_2 - t)^2 / ((v_2 - v_0) (v_2 - v_1))   if t is between v_1 and v_2.

Rounding: a difference of two floats has one rounding, and underflows only to zero. A quotient of two such differences
that is at most one is formed first, so a fraction is off by gamma(8) of at most one. Numbers below the smallest normal
number are far less than that.
"""

import numpy as np
from jaxtyping import Float

from jhd._arithmetic.rounding import gamma

_ROUNDINGS = gamma(32, np.float64)


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
