"""Rational arithmetic without any rounding: distances from a point to a curve, and proofs that a number is below them.

Every float is a rational number, so the curve of stored floats and its squared distances are exact here.
"""

from fractions import Fraction
from math import comb
from typing import Any

# Parameters are rounded to this many bits: the error of a minimum is its square.
BITS = 90


def fractions(rows) -> Any:
    """A nested sequence of floats as fractions."""
    return [fractions(row) for row in rows] if hasattr(rows, "__len__") else Fraction(float(rows))


def homogeneous(control_points, weights=None):
    """Rows (w b, w) of one segment, as fractions."""
    points = fractions(control_points)
    weights = [Fraction(1)] * len(points) if weights is None else fractions(weights)
    return [[w * x for x in p] + [w] for p, w in zip(points, weights, strict=True)]


def combined(rows, s):
    """The Bernstein combination of rows at the fraction s."""
    n, top, whole = len(rows) - 1, s.numerator, s.denominator
    basis = [comb(n, i) * top**i * (whole - top) ** (n - i) for i in range(n + 1)]
    return [sum(b * row[k] for b, row in zip(basis, rows, strict=True)) / whole**n for k in range(len(rows[0]))]


def point(control_points, weights, s):
    """The point of one segment at the parameter s."""
    *x, w = combined(homogeneous(control_points, weights), Fraction(s))
    return [c / w for c in x]


def distance_sq(query, control_points, weights, s):
    """The squared distance from the query to the point at the parameter s."""
    return sum((p - q) ** 2 for p, q in zip(point(control_points, weights, s), fractions(query), strict=True))


def derivative(rows):
    """Rows of the derivative, one degree lower."""
    n = len(rows) - 1
    return [[n * (q - p) for p, q in zip(u, v, strict=True)] for u, v in zip(rows[:-1], rows[1:], strict=True)] or [
        [Fraction(0)] * len(rows[0])
    ]


def jet(control_points, weights, s):
    """Point, first and second derivative of one segment at s, by the quotient rule."""
    rows, s = homogeneous(control_points, weights), Fraction(s)
    (*x, w), (*dx, dw), (*ddx, ddw) = (combined(r, s) for r in (rows, derivative(rows), derivative(derivative(rows))))
    place = [c / w for c in x]
    first = [(d - c * dw) / w for d, c in zip(dx, place, strict=True)]
    return place, first, [(d - 2 * f * dw - c * ddw) / w for d, f, c in zip(ddx, first, place, strict=True)]


def minimum_near(query, control_points, weights, s, steps=3):
    """The squared distance at a parameter refined by Newton's method from s: at least the distance to the segment."""
    query, s = fractions(query), Fraction(s)
    least = distance_sq(query, control_points, weights, s)
    for _ in range(steps):
        place, first, second = jet(control_points, weights, s)
        e = [p - q for p, q in zip(place, query, strict=True)]
        bend = sum(d * d + c * x for d, c, x in zip(first, e, second, strict=True))
        if bend <= 0:
            break
        s -= sum(c * d for c, d in zip(e, first, strict=True)) / bend
        s = min(max(Fraction(round(s * 2**BITS), 2**BITS), Fraction(0)), Fraction(1))
        least = min(least, distance_sq(query, control_points, weights, s))
    return least


def product(f, g):
    """Bernstein coefficients of the product of two polynomials."""
    n, m = len(f) - 1, len(g) - 1
    result = [Fraction(0)] * (n + m + 1)
    for i, a in enumerate(f):
        for j, b in enumerate(g):
            result[i + j] += Fraction(comb(n, i) * comb(m, j), comb(n + m, i + j)) * a * b
    return result


def excess(query, control_points, weights, bound):
    """Bernstein coefficients of |w (B - P)|^2 - w^2 bound^2, >= 0 where the segment is no nearer than `bound`."""
    rows, query = homogeneous(control_points, weights), fractions(query)
    columns = [[row[k] - row[-1] * query[k] for row in rows] for k in range(len(query))]
    squares = [product(column, column) for column in columns]
    weight = product([row[-1] for row in rows], [row[-1] for row in rows])
    bound = Fraction(float(bound)) ** 2
    return [sum(c) - bound * w for *c, w in zip(*squares, weight, strict=True)]


def split(coefficients, s):
    """Coefficients of both parts, by de Casteljau's algorithm."""
    left, right = [coefficients[0]], [coefficients[-1]]
    while len(coefficients) > 1:
        coefficients = [(1 - s) * a + s * b for a, b in zip(coefficients[:-1], coefficients[1:], strict=True)]
        left.append(coefficients[0])
        right.append(coefficients[-1])
    return left, right[::-1]


def is_nonnegative(coefficients, cut=Fraction(1, 2), depth=60):
    """Whether the polynomial is proven non-negative on [0, 1]: first cut at `cut`, near its minimum, then in halves."""
    if min(coefficients) >= 0:
        return True
    if depth == 0 or coefficients[0] < 0 or coefficients[-1] < 0:
        return False
    left, right = split(coefficients, cut)
    # Towards the first cut the polynomial nearly vanishes, so the pieces shrink towards it.
    return is_nonnegative(left, depth=depth - 1) and is_nonnegative(right, depth=depth - 1)


def is_below(bound, query, control_points, weights=None, near=0.5):
    """Whether `bound` is proven to be at most the distance to one segment; `near` is where the nearest point may be."""
    cut = Fraction(round(Fraction(float(near)) * 2**40), 2**40)
    cut = cut if 0 < cut < 1 else Fraction(1, 2)
    return bound <= 0 or is_nonnegative(excess(query, control_points, weights, bound), cut)
