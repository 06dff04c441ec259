"""Least squares with non-negative unknowns, on the host.

Source: Lawson & Hanson, Solving least squares problems (1974), chapter 23: the positive unknowns form a basis. One
unknown at a time is added to it, and unknowns that would become negative leave it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from jhd._arithmetic.rounding import smallest_normal


def non_negative(matrix: Float[np.ndarray, "rows columns"], right: Float[np.ndarray, " rows"]) -> Any:
    """The x >= 0 for which |matrix x - right| is least; the columns of its positive entries are independent.

    It may be all zeros, and it is all zeros if an entry is not finite.
    """
    start = np.zeros(matrix.shape[1])
    # LAPACK would write errors about these to standard error.
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
        return start
    # Of many columns the basis is first searched by the normal equations.
    if matrix.shape[1] > 24:
        # For many columns the basis is first searched by the normal equations, which lose digits but take little time.
        products, sums = matrix.T @ matrix, matrix.T @ right
        found = _entering(matrix, right, start, lambda basic: np.linalg.solve(products[basic][:, basic], sums[basic]))
        start = start if found is None else found
    found = _entering(matrix, right, start, lambda basic: np.linalg.lstsq(matrix[:, basic], right, rcond=None)[0])
    return start if found is None else found


def _entering(
    matrix: np.ndarray, right: np.ndarray, x: np.ndarray, solved: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray | None:
    """Solve by the active-set method from the start x; None if `solved`, the solver for a basis, fails."""
    count = matrix.shape[1]
    basic = x > 0
    try:
        if basic.any():
            x = _within(x, basic, solved)
        for _ in range(3 * count):
            pull = matrix.T @ (right - matrix @ x)
            pull[basic] = -np.inf
            new = int(np.argmax(pull))
            # Equations are of order one; an unknown with a smaller pull does not enter.
            if basic.all() or pull[new] <= 1e-14:
                break
            basic[new] = True
            x = _within(x, basic, solved)
            if not basic.any():
                break
    except np.linalg.LinAlgError:
        return None
    return x if np.all(np.isfinite(x)) else None


def _within(x: np.ndarray, basic: np.ndarray, solved: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The solution on the basis; unknowns that would become negative leave the basis, which changes in place."""
    while True:
        z = np.zeros(len(x))
        z[basic] = solved(basic)
        low = basic & (z <= 0)
        if not low.any():
            return z
        share = np.min(x[low] / np.maximum(x[low] - z[low], smallest_normal(x.dtype)))
        x = x + share * (z - x)
        # Smaller values are zero.
        basic &= x > 1e-15
        x[~basic] = 0.0
        if not basic.any():
            return x
