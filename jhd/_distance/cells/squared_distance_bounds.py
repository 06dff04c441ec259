"""Lower bounds of the distance of points to parts of curved pieces, by Bernstein coefficients of squares; on the host.

With n = w (b - p), homogeneous, the squared distance along a piece is |n|^2 / w^2, so it is at least the smallest ratio
of the coefficients of |n|^2 and w^2. On a rational sphere, circle or torus seen from its center both are the same
polynomial up to a factor, and nothing is lost, however large the part; near the center little is lost.

Across a curve of nearest points the squared distance rises like a parabola. For any k and any sum of squares q

    |n|^2 / w^2 >= k + min_i (|n|^2 - k w^2 - q)_i / (w^2)_i,

so with q close to the left side less its minimum the bound is short by the fourth power of the size of the part, not by
the second. With quadratic functions of the parameters q is a square of one, and that of a linear one. If the surface
is linear in a parameter, so is q's root, and the bound is short by the third power.

Rounding, with r the largest |b - p| of the piece: restriction moves n / r and w, which are at most one, by at most
off_by; a coefficient of a square is a sum of as many products as the piece has coordinates of control points at most,
with positive factors of a few roundings, whose sizes sum up to at most max |n_i|^2 / w_i^2 times the coefficient of
w^2. As k is a quotient of two coefficients, this holds for k w^2 and for the difference too. The two functions whose
squares are added to q are their floating-point Bernstein coefficients, of the degree of the piece; a coefficient of q
is a sum of at most as many products as two pieces have control points, with positive factors whose sum is one for each
function.

Source: the hull property as in Farouki & Rajan, CAGD 5 (1988).
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jhd._arithmetic.bernstein import binomials
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.cells.arc_length_area import off_by, restricted
from jhd._distance.normalization.net_jets import Net

# Steps towards the linear term of the quadratic function: each gains one power of the size of the part.
_CORRECTIONS = 2


def distances_by_squares(
    net: Net,
    points: Float[np.ndarray, "cells 3"],
    piece: Int[np.ndarray, " cells"],
    low: Float[np.ndarray, "cells parameters"],
    high: Float[np.ndarray, "cells parameters"],
    enough: Float[np.ndarray, " cells"] | float = np.inf,
) -> tuple[Float[np.ndarray, " cells"], Int[np.ndarray, " cells"]]:
    """Lower bounds of the distances of points to parts of pieces, and the parameter along which to cut each part.

    Sums of squares are tried on parts whose bounds without them are below `enough`.

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
    room = share + off / least
    # Differences and their division by the size are off by two roundings, as that is.
    lost = 2 * math.sqrt(3) * (off + gamma(4, np.float64)) / least

    def distance(square: np.ndarray) -> np.ndarray:
        root = np.sqrt(np.maximum(square, 0.0))
        lower = np.maximum(root * (1 - room) - lost, 0.0) * size * (1 - gamma(8, np.float64))
        # Below the normal numbers a product rounds by a unit of its own.
        return np.maximum(lower - smallest_normal(np.float64), 0.0)

    square = np.min(ratios, axis=(1, 2)) - 2 * share * most
    left = np.flatnonzero(~(distance(square) >= enough))
    bent, loose = _less_squares(squares[left], weighed[left])
    square[left] = np.fmax(square[left], bent - 6 * share * most[left] - loose)
    lower = distance(square)
    moves = [np.max(np.abs(np.diff(ratios, axis=k)), axis=(1, 2), initial=0.0) for k in range(1, 1 + low.shape[1])]
    return np.where(good & np.isfinite(lower), lower, 0.0), np.argmax(moves, axis=0)


def _less_squares(squares: np.ndarray, weighed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower bounds, or -inf, of |n|^2 / w^2 by sums of squares q, and bounds of their errors, from (cells, i, j)."""
    i, j = (count // 2 for count in squares.shape[1:])
    divisor = np.where(weighed > 0, weighed, 1.0)
    middle = squares[:, i, j] / divisor[:, i, j]
    rest = squares - middle[:, None, None] * weighed
    roots = _roots(rest)
    found = middle + np.min((rest - _square(roots)) / divisor, axis=(1, 2))
    size = np.sum(np.max(np.abs(roots), axis=(1, 2)) ** 2, axis=-1)
    loose = gamma(4 * (i + 1) * (j + 1) + 64, np.float64) * size / np.min(divisor, axis=(1, 2))
    return np.where(np.isfinite(found), found, -np.inf), loose


def _roots(rest: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (cells, m, n, 2) of two functions whose squares sum up to about a function less a number.

    The function (cells, 2 m - 1, 2 n - 1) is expanded about the middle of the part. The first root follows the
    direction in which it is bent most and is quadratic, so that its square has the right terms of third degree; the
    second one is linear.
    """
    slope = np.stack([_middle_derivative(rest, k) for k in range(2)], axis=1)
    bent = np.stack([np.stack([_middle_derivative(rest, k, m) for k in range(2)], axis=1) for m in range(2)], axis=1)
    third = [[[_middle_derivative(rest, k, m, n) for n in range(2)] for m in range(2)] for k in range(2)]
    third = np.moveaxis(np.array(third), -1, 0)
    bends, frame = np.linalg.eigh(bent)
    # Along the first axis of the frame, and across it.
    bends, frame = bends[:, ::-1], frame[:, :, ::-1]
    first, across = frame[:, :, 0], frame[:, :, 1]
    pull = np.einsum("nk,nki->ni", slope, frame)
    reach = 0.5 * np.sum(np.abs(frame), axis=1)
    third = np.einsum("nkml,nki,nmj,nl->nij", third, frame, frame, first)
    cubic = np.stack([third[:, 0, 0] / 12, third[:, 0, 1] / 4, third[:, 1, 1] / 4], axis=1)
    # On a part so large that these terms do not fall they are left out.
    rate = np.sqrt(0.5 * np.maximum(bends[:, 0], 0.0))
    cubic *= (np.sum(np.abs(cubic), axis=1) <= rate**2)[:, None]

    def terms(rate: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the quadratic terms of the first root and its value in the middle, given its slope."""
        return *(cubic.T / np.where(rate > 0, rate, np.inf)), _start(pull[:, 0], rate, reach[:, 0])

    for _ in range(_CORRECTIONS):
        own, _, _, start = terms(rate)
        rate = np.sqrt(np.maximum(0.5 * bends[:, 0] - 2 * start * own, 0.0))
    own, mixed, other, start = terms(rate)
    tilt = -start * mixed / np.where(rate > 0, rate, np.inf)
    left = np.sqrt(np.maximum(0.5 * bends[:, 1] - 2 * start * other - tilt**2, 0.0))
    linear = np.stack([rate[:, None] * first + tilt[:, None] * across, left[:, None] * across], axis=-1)
    constant = np.stack([start, _start(pull[:, 1] - 2 * start * tilt, left, reach[:, 1])], axis=-1)
    products = np.einsum("nk,nm->nkm", first, across)
    square = own[:, None, None] * np.einsum("nk,nm->nkm", first, first)
    square += other[:, None, None] * np.einsum("nk,nm->nkm", across, across)
    square += 0.5 * mixed[:, None, None] * (products + np.swapaxes(products, 1, 2))
    (x, xx), (y, yy) = (_powers_about_middle(count // 2) for count in rest.shape[1:])
    x, xx, y, yy = x[:, None], xx[:, None], y[None], yy[None]
    found = constant[:, None, None] + linear[:, None, None, 0] * x[..., None] + linear[:, None, None, 1] * y[..., None]
    a, b, c = (square[:, k, m][:, None, None] for k, m in ((0, 0), (0, 1), (1, 1)))
    found[..., 0] += a * xx + 2 * b * x * y + c * yy
    return found


def _start(slope: np.ndarray, rate: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Return the value in the middle of a linear function whose square has this slope there and vanishes nearby."""
    return rate * np.clip(slope / np.where(rate > 0, 2 * rate**2, np.inf), -reach, reach)


def _powers_about_middle(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Bernstein coefficients of x - 1/2 and, from degree two on, of its square; else zeros."""
    i, zero = np.arange(degree + 1.0), np.zeros(degree + 1)
    linear = i / degree - 0.5 if degree else zero
    # The mean product of two of the `degree` arguments of the polar form, of which i are 1/2 and the others -1/2.
    return linear, ((degree - 2 * i) ** 2 - degree) / (4 * degree * (degree - 1)) if degree > 1 else zero


def _middle_derivative(rows: np.ndarray, *along: int) -> np.ndarray:
    """Derivatives along some parameters, in the middle, of functions with Bernstein coefficients (cells, i, j)."""
    for axis in along:
        degree = rows.shape[1 + axis] - 1
        rows = degree * np.diff(rows, axis=1 + axis) if degree else np.zeros_like(rows)
    orders = rows.shape[1:]
    shares = _binomials(orders) * 0.5 ** (sum(orders) - 2)
    return np.sum(rows * shares, axis=(1, 2))


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
    return np.outer(*(binomials(k - 1) for k in orders))
