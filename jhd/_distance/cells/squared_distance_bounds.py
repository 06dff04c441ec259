"""Lower bounds of the distance of points to parts of curved pieces, by Bernstein coefficients of squares; on the host.

With n = w (b - p), homogeneous, the squared distance along a piece is |n|^2 / w^2, so it is at least the smallest ratio
of the coefficients of |n|^2 and w^2. On a rational sphere, circle or torus seen from its center both are the same
polynomial up to a factor, and nothing is lost, however large the part; near the center little is lost.

Across a curve of nearest points the squared distance rises like a parabola. For any k and any sum of squares q

    |n|^2 / w^2 >= k + min_i (|n|^2 - k w^2 - q)_i / (w^2)_i,

so with q close to the parabola the bound is short by the third power of the size of the part, not by the second.

Rounding, with r the largest |b - p| of the piece: restriction moves n / r and w, which are at most one, by at most
off_by; a coefficient of a square is a sum of as many products as the piece has coordinates of control points at most,
with positive factors of a few roundings, whose sizes sum up to at most max |n_i|^2 / w_i^2 times the coefficient of
w^2. As k is a quotient of two coefficients, this holds for k w^2 and for the difference too. The linear functions of q
are their floating-point coefficients; a coefficient of their squares is a sum of six products. If one is large compared
with the others, the bound is negative.

Source: the hull property as in Farouki & Rajan, CAGD 5 (1988).
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.cells.arc_length_area import off_by, restricted
from jhd._distance.normalization.net_jets import Net


def distances_by_squares(
    net: Net,
    points: Float[np.ndarray, "cells 3"],
    piece: Int[np.ndarray, " cells"],
    low: Float[np.ndarray, "cells parameters"],
    high: Float[np.ndarray, "cells parameters"],
) -> tuple[Float[np.ndarray, " cells"], Int[np.ndarray, " cells"]]:
    """Lower bounds of the distances of points to parts of pieces, and the parameter along which to cut each part.

    It is the parameter along which the coefficients differ most. Along a circle whose points are all equally near, as
    seen from the axis of a surface of revolution, they do not differ.
    """
    held = np.asarray(net.points, np.float64)[piece]
    apart = held - points[:, None, None].astype(np.float64)
    size = np.max(np.abs(apart), axis=(1, 2, 3))
    apart = apart / np.where(size > 0, size, 1.0)[:, None, None, None]
    weights = np.ones(held.shape[:-1]) if net.weights is None else np.asarray(net.weights, np.float64)[piece]
    rows = np.concatenate([apart * weights[..., None], weights[..., None]], axis=-1)
    rows = restricted(rows, low.astype(np.float64), high.astype(np.float64))
    n, w = rows[..., :3], rows[..., 3:]
    squares, weighed = _square(n), _square(w)
    least = np.min(w, axis=(1, 2, 3))
    off = off_by(net.degrees)
    good = least > 4 * off
    least = np.where(good, least, 1.0)
    ratios = np.where(weighed > 0, squares / np.where(weighed > 0, weighed, 1.0), 0.0)
    share = gamma(3 * rows[0, ..., 0].size + 32, np.float64)
    most = np.max(np.sum(n * n, axis=-1) / np.where(w > 0, w, np.inf)[..., 0] ** 2, axis=(1, 2))
    bent, loose = _less_squares(squares, weighed)
    square = np.fmax(np.min(ratios, axis=(1, 2)) - 2 * share * most, bent - 6 * share * most - loose)
    root = np.sqrt(np.maximum(square, 0.0))
    room = share + off / least
    # Differences and their division by the size are off by two roundings, as that is.
    lost = 2 * math.sqrt(3) * (off + gamma(4, np.float64)) / least
    lower = np.maximum(root * (1 - room) - lost, 0.0) * size * (1 - gamma(8, np.float64))
    # Below the normal numbers a product rounds by a unit of its own.
    lower = np.maximum(lower - smallest_normal(np.float64), 0.0)
    moves = [np.max(np.abs(np.diff(ratios, axis=k)), axis=(1, 2), initial=0.0) for k in range(1, 1 + low.shape[1])]
    return np.where(good & np.isfinite(lower), lower, 0.0), np.argmax(moves, axis=0)


def _less_squares(squares: np.ndarray, weighed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower bounds of |n|^2 / w^2 by sums of squares q, and bounds of their rounding errors; -inf if none applies.

    Args:
        squares: Bernstein coefficients (cells, i, j) of |n|^2.
        weighed: Bernstein coefficients of w^2.
    """
    degrees = [count - 1 for count in squares.shape[1:]]
    axes = [k for k, degree in enumerate(degrees) if degree > 1]
    if not axes:
        return np.full(len(squares), -np.inf), np.zeros(len(squares))
    i, j = (degree // 2 for degree in degrees)
    divisor = np.where(weighed > 0, weighed, 1.0)
    middle = squares[:, i, j] / divisor[:, i, j]
    rest = squares - middle[:, None, None] * weighed

    def mean(*along: int) -> np.ndarray:
        """Return the mean over the part of a derivative of the rest."""
        found = rest
        for axis in along:
            found = (found.shape[1 + axis] - 1) * np.diff(found, axis=1 + axis)
        return np.mean(found, axis=(1, 2))

    # The parabola: its slopes and bends in the middle, along the directions in which the rest is bent most and least.
    slope = np.stack([mean(k) for k in axes], axis=1)
    bends, frame = np.linalg.eigh(np.stack([np.stack([mean(m, k) for k in axes], axis=1) for m in axes], axis=1))
    rates = np.maximum(bends, 0.0)
    reach = 0.5 * np.sum(np.abs(frame), axis=1)
    lowest = -np.einsum("nkm,nk->nm", frame, slope) / np.where(rates > 0, rates, np.inf)
    # q is the sum over these directions of (constant + linear.x)^2, with the parameters x from 0 to 1.
    root = np.sqrt(0.5 * rates)
    linear = root[:, None] * frame
    constant = -root * np.clip(lowest, -reach, reach) - 0.5 * np.sum(linear, axis=1)
    index = [np.arange(degrees[0] + 1)[:, None], np.arange(degrees[1] + 1)[None]]
    q = np.sum(constant**2, axis=1)[:, None, None] * np.ones_like(rest)
    for m, k in enumerate(axes):
        # Bernstein coefficients of x, of x^2, and of the product with another parameter.
        x = index[k] / degrees[k]
        q += (2 * np.sum(constant * linear[:, m], axis=1))[:, None, None] * x
        q += np.sum(linear[:, m] ** 2, axis=1)[:, None, None] * (x * (index[k] - 1) / (degrees[k] - 1))
        for other, y in enumerate(axes[:m]):
            q += (2 * np.sum(linear[:, m] * linear[:, other], axis=1))[:, None, None] * (x * index[y] / degrees[y])
    found = middle + np.min((rest - q) / divisor, axis=(1, 2))
    size = np.sum((np.abs(constant) + np.sum(np.abs(linear), axis=1)) ** 2, axis=1)
    loose = gamma(64, np.float64) * size / np.min(divisor, axis=(1, 2))
    return np.where(np.isfinite(found), found, -np.inf), loose


def _square(rows: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (cells, 2 m - 1, 2 n - 1) of the sum of squares of columns (cells, m, n, columns)."""
    orders = rows.shape[1:3]
    single, double = _binomials(orders), _binomials([2 * k - 1 for k in orders])
    scaled = rows * single[..., None]
    total = np.zeros((len(rows), *double.shape))
    for i in range(orders[0]):
        for j in range(orders[1]):
            total[:, i : i + orders[0], j : j + orders[1]] += np.einsum("cx,cijx->cij", scaled[:, i, j], scaled)
    return total / double


def _binomials(orders: Sequence[int]) -> np.ndarray:
    """Products of the binomial coefficients of Bernstein polynomials of two orders."""
    first, second = ([math.comb(k - 1, i) for i in range(k)] for k in orders)
    return np.outer(first, second)
