"""Polynomials on simplices: parts of them, and means of their products."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from jhd._arithmetic.simplices import dividing, lattice, multinomials

# Twice the barycentric coordinates of the corners of halves and quarters.
PARTS = {
    1: [[(2, 0), (1, 1)], [(1, 1), (0, 2)]],
    2: [
        [(2, 0, 0), (1, 1, 0), (1, 0, 1)],
        [(1, 1, 0), (0, 2, 0), (0, 1, 1)],
        [(1, 0, 1), (0, 1, 1), (0, 0, 2)],
        [(0, 1, 1), (1, 0, 1), (1, 1, 0)],
    ],
}


def value(k, n, coefficients, place):
    """The polynomial at barycentric coordinates, exactly."""
    total = Fraction(0)
    for c, index in zip(coefficients, lattice(k, n), strict=True):
        term = Fraction(float(c)) * int(multinomials(k, n)[tuple(index[1:])])
        for x, i in zip(place, index, strict=True):
            term *= x ** int(i)
        total += term
    return total


@pytest.mark.parametrize("k, n", [(1, 1), (1, 4), (2, 1), (2, 3), (2, 4)])
def test_parts_of_a_simplex_hold_the_same_polynomial_exactly(k, n):
    coefficients = np.random.default_rng(n).integers(-8, 8, len(lattice(k, n))).astype(float)
    shares = (Fraction(0), Fraction(1, 3), Fraction(1, 2), Fraction(1))
    places = [x for x in product(shares, repeat=k + 1) if sum(x) == 1]
    for corners, matrix in zip(PARTS[k], dividing(k, n), strict=True):
        assert np.all(np.sum(matrix, axis=1) == 1) and np.all(matrix >= 0)
        for place in places:
            outer = [sum(t * Fraction(c[m], 2) for t, c in zip(place, corners, strict=True)) for m in range(k + 1)]
            assert value(k, n, matrix @ coefficients, place) == value(k, n, coefficients, outer)
