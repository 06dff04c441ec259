"""Polynomials in three variables in exact integer arithmetic, on the host.

A polynomial is a NumPy array of Python integers: entry [i, j, k] is the coefficient of x^i y^j z^k. Only its zeros
matter here, so everything is known up to a positive factor, which avoids fractions.

The square-free part follows from lines. On a line whose direction b is not a zero of the form of highest degree, every
factor of f keeps its degree. So if f has no repeated root on such a line modulo a prime, it has no repeated factor.
Otherwise f / gcd(f, D_b f), with D_b the derivative along b, is the product of its distinct factors: none of them has
D_b q = 0. It is found by linear algebra modulo primes, and the result is verified in integers.

Source: von zur Gathen & Gerhard, Modern Computer Algebra (2013), sections 5.10, 6.2 and 14.6.
"""

import math
import random
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

# Both are Mersenne primes: the first lets products fit in 64 bits, the second leaves room for fractions of 250 bits.
_SMALL, _LARGE = 2**31 - 1, 2**521 - 1
# Lines that are tried before a repeated factor is assumed, and most unknowns of the linear system for it.
_LINES, _UNKNOWNS = 4, 400


def integers(coefficients: Any) -> np.ndarray:
    """A positive multiple of the polynomial with integer coefficients that have no common divisor.

    Args:
        coefficients: array (i, j, k) of floats or fractions, taken as exact.
    """
    given = np.asarray(coefficients)
    exact = [Fraction(x) for x in given.ravel().tolist()]
    common = math.lcm(*(x.denominator for x in exact))
    return _primitive(_array([int(x * common) for x in exact], given.shape))


def floats(polynomial: np.ndarray, scaled: bool = True) -> np.ndarray:
    """The coefficients rounded to the nearest double; scaled by a power of two so that the largest is in [1/2, 1).

    Args:
        polynomial: integers, not all zero.
        scaled: False keeps the integers, exactly if they are at most 2^53.
    """
    length = max(abs(x) for x in polynomial.flat).bit_length()
    divisor = 1 << length if scaled or length > 53 else 1
    return np.array([x / divisor for x in polynomial.flat]).reshape(polynomial.shape)


def total_degree(polynomial: np.ndarray) -> int:
    """Largest i + j + k of a coefficient that is not zero; -1 for the zero polynomial."""
    return max((sum(index) for index, x in np.ndenumerate(polynomial) if x != 0), default=-1)


def trimmed(polynomial: np.ndarray) -> np.ndarray:
    """The polynomial in the smallest array that holds its coefficients."""
    used = np.argwhere(polynomial != 0)
    return polynomial[tuple(slice(n + 1) for n in used.max(axis=0))]


def values(polynomial: np.ndarray, points: np.ndarray, modulus: int = 0) -> np.ndarray:
    """Values at integer points, an array (3, count), by Horner's rule; modulo a prime if `modulus` is not 0."""
    result = polynomial[..., None]
    for point in points[::-1]:
        rows, result = result, result[..., -1, :]
        for k in range(rows.shape[-2] - 2, -1, -1):
            result = result * point + rows[..., k, :]
            result = result % modulus if modulus else result
    return np.broadcast_to(result, points.shape[1:])


def signs(polynomial: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Signs -1, 0, 1 of the values at integer points, an array (3, count)."""
    reach = max(2, int(np.max(np.abs(points), initial=0)))
    largest = sum(abs(x) for x in polynomial.flat) * reach ** total_degree(polynomial)
    kind = np.int64 if largest < 1 << 62 else object
    result = values(polynomial.astype(kind), points.astype(np.int64).astype(kind))
    return (result > 0).astype(int) - (result < 0).astype(int)


def substituted(polynomial: np.ndarray, center: Sequence[Fraction], scale: Sequence[Fraction]) -> np.ndarray:
    """A positive multiple of w -> f(center + scale w), the scales positive."""
    for axis, (m, s) in enumerate(zip(center, scale, strict=True)):
        rows = list(np.moveaxis(polynomial, axis, 0))
        n, common = len(rows) - 1, math.lcm(m.denominator, s.denominator)
        shift, factor = int(m * common), int(s * common)
        rows = [row * common ** (n - i) for i, row in enumerate(rows)]
        for first in range(n):
            for i in range(n - 1, first - 1, -1):
                rows[i] = rows[i] + shift * rows[i + 1]
        polynomial = np.moveaxis(np.stack([row * factor**i for i, row in enumerate(rows)]), 0, axis)
    return _primitive(polynomial)


def square_free_part(polynomial: np.ndarray) -> np.ndarray:
    """The product of the distinct factors: the polynomial itself if no factor is repeated.

    If a factor is repeated but the system has too many unknowns, the polynomial itself is returned, too. This
    does not occur up to degree 10.
    """
    degree, draw = total_degree(polynomial), random.Random(0)
    if degree < 2:
        return polynomial
    found: list[tuple[int, list[int]]] = []
    modular = np.mod(polynomial, _SMALL).astype(np.int64)
    for _ in range(8 * _LINES):
        origin, direction = ([draw.randrange(1, 1 << 15) for _ in range(3)] for _ in range(2))
        row = _on_line(modular, origin, direction, degree)
        if row[degree] == 0:
            continue
        distinct = degree - (len(_common(row, _derivative(row))) - 1)
        if distinct == degree:
            return polynomial
        found.append((distinct, direction))
        if len(found) == _LINES:
            break
    return _without_repetition(polynomial, *max(found)) if found else polynomial


def product(f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The product of two polynomials."""
    result = _zero(tuple(n + m - 1 for n, m in zip(f.shape, g.shape, strict=True)))
    for index, x in np.ndenumerate(g):
        if x != 0:
            place = tuple(slice(i, i + n) for i, n in zip(index, f.shape, strict=True))
            result[place] = result[place] + x * f
    return result


def _array(entries: list[int], shape: tuple[int, ...]) -> np.ndarray:
    result = np.empty(len(entries), dtype=object)
    result[:] = entries
    return result.reshape(shape)


def _zero(shape: tuple[int, ...]) -> np.ndarray:
    return _array([0] * math.prod(shape), shape)


def _primitive(polynomial: np.ndarray) -> np.ndarray:
    common = math.gcd(*polynomial.flat)
    return polynomial // common if common > 1 else polynomial


def _on_line(modular: np.ndarray, origin: list[int], direction: list[int], degree: int) -> list[int]:
    """Coefficients of t -> f(origin + t direction) modulo the small prime, by Newton's interpolation at 0..degree."""
    t = np.arange(degree + 1)
    points = (np.array(origin)[:, None] + np.array(direction)[:, None] * t) % _SMALL
    table = [int(x) for x in values(modular, points, _SMALL)]
    for level in range(1, degree + 1):
        inverse = pow(level, -1, _SMALL)
        for i in range(degree, level - 1, -1):
            table[i] = (table[i] - table[i - 1]) * inverse % _SMALL
    row = [table[degree]]
    for i in range(degree - 1, -1, -1):
        # row (t - i) + table[i]
        row = [(b - i * a) % _SMALL for a, b in zip([*row, 0], [0, *row], strict=True)]
        row[0] = (row[0] + table[i]) % _SMALL
    return row


def _derivative(row: list[int]) -> list[int]:
    return [i * x % _SMALL for i, x in enumerate(row)][1:]


def _common(f: list[int], g: list[int]) -> list[int]:
    """The greatest common divisor modulo the small prime, coefficients in ascending order."""
    while g := _stripped(g):
        inverse = pow(g[-1], -1, _SMALL)
        f = f[:]
        while len(f) >= len(g):
            factor, shift = f[-1] * inverse % _SMALL, len(f) - len(g)
            for i, x in enumerate(g):
                f[shift + i] = (f[shift + i] - factor * x) % _SMALL
            f = f[:-1]
        f, g = g, f
    return f


def _stripped(row: list[int]) -> list[int]:
    while row and row[-1] == 0:
        row = row[:-1]
    return row


def _without_repetition(f: np.ndarray, degree: int, direction: list[int]) -> np.ndarray:
    """The quotient f / gcd(f, D_b f), proven, or f itself if there is no proof.

    It is S if f T = S D_b f has one solution up to a factor, with S of the given degree and T of one less.
    Another pair (S h, T h) would make the space of solutions larger, and S, T without common factor are f and D_b f
    divided by their greatest common divisor. A prime can only enlarge the space; so one dimension modulo it, and the
    identity in integers, prove S.
    """
    slope = _along(f, direction)
    s = [index for index in np.ndindex(*f.shape) if sum(index) <= degree]
    t = [index for index in np.ndindex(*f.shape) if sum(index) <= degree - 1]
    if len(s) + len(t) > _UNKNOWNS:
        return f
    support = list(range(len(s) + len(t)))
    for prime in (_SMALL, _LARGE):
        solution = _only_solution(_system(f, slope, s, t, support, prime), prime)
        if solution is None:
            return f
        support = [index for index, x in zip(support, solution, strict=True) if x != 0]
    fractions = [_fraction(x) for x in solution if x != 0]
    common = math.lcm(*(x.denominator for x in fractions))
    pair = _zero(f.shape), _zero(f.shape)
    for index, x in zip(support, fractions, strict=True):
        part, place = (0, s[index]) if index < len(s) else (1, t[index - len(s)])
        pair[part][place] = int(x * common)
    proven = bool(np.all(product(f, pair[1]) == product(slope, pair[0])))
    return trimmed(_primitive(pair[0])) if proven and np.any(pair[0] != 0) else f


def _along(f: np.ndarray, direction: list[int]) -> np.ndarray:
    """The derivative along a direction, in an array of the same shape."""
    result = _zero(f.shape)
    for axis, b in enumerate(direction):
        rows, out = np.moveaxis(f, axis, 0), np.moveaxis(result, axis, 0)
        for i in range(1, len(rows)):
            out[i - 1] += b * i * rows[i]
    return result


def _system(
    f: np.ndarray, slope: np.ndarray, s: list[tuple], t: list[tuple], support: list[int], prime: int
) -> np.ndarray:
    """Rows D_b f(p) p^s, -f(p) p^t at random points p: some more than there are unknowns."""
    draw = random.Random(prime)
    count, kind = len(support) + 8, np.int64 if prime == _SMALL else object
    points = _array([draw.randrange(prime) for _ in range(3 * count)], (3, count)).astype(kind)
    ends = [values(np.mod(g, prime).astype(kind), points, prime) for g in (slope, f)]
    powers = [np.ones_like(points)]
    for _ in range(max(f.shape) - 1):
        powers.append(powers[-1] * points % prime)
    columns = []
    for index in support:
        place, end = (s[index], ends[0]) if index < len(s) else (t[index - len(s)], prime - ends[1])
        monomial = powers[place[0]][0] * powers[place[1]][1] % prime * powers[place[2]][2] % prime
        columns.append(monomial * end % prime)
    return np.stack(columns, axis=1)


def _only_solution(matrix: np.ndarray, prime: int) -> list[int] | None:
    """The vector that spans the kernel modulo the prime, its free entry one; None unless the kernel is a line.

    The elimination stops as soon as there are two free columns.
    """
    matrix, pivots, free = matrix.copy(), [], []
    for column in range(matrix.shape[1]):
        row = len(pivots)
        nonzero = np.flatnonzero(matrix[row:, column])
        if not len(nonzero):
            free.append(column)
            if len(free) > 1:
                return None
            continue
        matrix[[row, row + nonzero[0]]] = matrix[[row + nonzero[0], row]]
        matrix[row] = matrix[row] * pow(int(matrix[row, column]), -1, prime) % prime
        below = row + 1 + np.flatnonzero(matrix[row + 1 :, column])
        # Entries left of this column are zero in all rows from the pivot on.
        step = matrix[below, column][:, None] * matrix[row, column:] % prime
        matrix[below, column:] = (matrix[below, column:] - step) % prime
        pivots.append(column)
    if len(free) != 1:
        return None
    solution = [0] * matrix.shape[1]
    solution[free[0]] = 1
    for row, column in reversed(list(enumerate(pivots))):
        known = zip(matrix[row, column + 1 :].tolist(), solution[column + 1 :], strict=True)
        solution[column] = -sum(x * y for x, y in known) % prime
    return solution


def _fraction(x: int) -> Fraction:
    """The fraction n / d with |n| and d at most 2^260 that x stands for modulo the large prime (section 5.10)."""
    a, b, u, v = _LARGE, x, 0, 1
    while b >> 260:
        a, b, u, v = b, a % b, v, u - a // b * v
    return Fraction(b, v)
