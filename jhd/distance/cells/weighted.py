"""Means, shares and quantiles of values that are known within bounds, with weights that are known within bounds.

Of a mean sum w_i x_i / sum w_i with w_i in [a_i, b_i] the least value is attained with w_i = b_i where x_i is below
some level and a_i above it; all levels are tried, in the order of the values. Shares and quantiles are such means of
zeros and ones.

Rounding: sums of n positive terms err by gamma(n) relative to themselves, one after the other or not.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jhd.arithmetic.rounding import gamma

# What the share of a quantile may be off by as a float, and some roundings of its products.
_ROUNDED = 2.0**-50


class Weights(NamedTuple):
    """Lower and upper bounds of weights, neither negative; some upper one is positive."""

    lower: Float[np.ndarray, " cells"]
    upper: Float[np.ndarray, " cells"]


def mean_bounds(weights: Weights, lower: np.ndarray, upper: np.ndarray) -> tuple[float, float]:
    """Bounds of the mean of values between bounds that are not negative."""
    room = gamma(2 * len(lower) + 16, np.float64)
    least = _least_mean(weights, lower)
    if not np.all(np.isfinite(upper[weights.upper > 0])):
        return least * (1 - room), np.inf
    # The largest mean of x is what the least mean of top - x leaves.
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


def share_bounds(weights: Weights, surely: np.ndarray, maybe: np.ndarray) -> tuple[float, float]:
    """Bounds of the share of the weight where something holds: where it surely does, and where it may."""
    room = gamma(len(surely) + 16, np.float64)
    rest = 1.0 - _share(weights, ~maybe) * (1 - room)
    # The difference rounds as a number of about one does.
    return _share(weights, surely) * (1 - room), min(rest + room, 1.0)


def _share(weights: Weights, where: np.ndarray) -> float:
    """The least share that some of the weight can have."""
    inside, outside = np.sum(weights.lower[where]), np.sum(weights.upper[~where])
    return float(inside / (inside + outside)) if inside > 0 else 0.0


def quantile_bounds(weights: Weights, lower: np.ndarray, upper: np.ndarray, q: float) -> tuple[float, float]:
    """Bounds of the least value that a share q of the weight does not exceed, of values between bounds.

    The share is as good as reached within its own rounding: nine of ten points are a share of 0.9.
    """
    q = q * (1 - _ROUNDED)
    a, b = weights
    # Sums of whole numbers are exact.
    whole = bool(np.all(a == b)) and bool(np.all(a == np.round(a))) and float(np.sum(b)) < 2.0**53
    room = 0.0 if whole else gamma(len(lower) + 16, np.float64)
    order = np.argsort(lower)
    a, b = weights.lower[order], weights.upper[order]
    inside, outside = np.cumsum(b), np.append(np.cumsum(a[::-1])[::-1][1:], 0.0)
    # The largest share with values up to each lower bound.
    enough = inside * (1 + room) >= q * (inside + outside)
    low = float(lower[order][np.argmax(enough)]) if np.any(enough) else float(np.max(lower))
    order = np.argsort(upper)
    a, b = weights.lower[order], weights.upper[order]
    inside, outside = np.cumsum(a), np.append(np.cumsum(b[::-1])[::-1][1:], 0.0)
    enough = inside * (1 - room) >= q * (inside + outside)
    high = float(upper[order][np.argmax(enough)]) if np.any(enough) else float(np.max(upper))
    return low, high
