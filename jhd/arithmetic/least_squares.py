"""Least squares with non-negative unknowns, on the host.

Source: Lawson & Hanson, Solving least squares problems (1974), chapter 23: the unknowns that are positive form a basis,
to which one is added at a time and from which those leave that would become negative.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from jhd.arithmetic.rounding import smallest_normal

# The pull on an unknown below which it does not enter, of equations of order one; values below the second are zero.
_PULL = 1e-14
_VANISHING = 1e-15


def non_negative(matrix: Float[np.ndarray, "rows columns"], right: Float[np.ndarray, " rows"]) -> Any:
    """The x >= 0 for which |matrix x - right| is least; the columns of its positive entries are independent.

    It may be all zeros.
    """
    count = matrix.shape[1]
    x, basic = np.zeros(count), np.zeros(count, bool)
    for _ in range(3 * count):
        pull = matrix.T @ (right - matrix @ x)
        pull[basic] = -np.inf
        new = int(np.argmax(pull))
        if basic.all() or pull[new] <= _PULL:
            break
        basic[new] = True
        while True:
            z = np.zeros(count)
            z[basic] = np.linalg.lstsq(matrix[:, basic], right, rcond=None)[0]
            low = basic & (z <= 0)
            if not low.any():
                break
            share = np.min(x[low] / np.maximum(x[low] - z[low], smallest_normal(x.dtype)))
            x = x + share * (z - x)
            basic &= x > _VANISHING
            x[~basic] = 0.0
            if not basic.any():
                return x
        x = z
    return x
