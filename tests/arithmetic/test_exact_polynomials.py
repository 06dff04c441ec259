"""Exact polynomials: square-free parts of products that are known, substitutions, values and signs."""

import math
import random
from fractions import Fraction

import numpy as np
import pytest

from jhd._arithmetic import exact_polynomials as exact


def made(terms, shape):
    result = np.zeros(shape, dtype=object)
    for index, x in terms.items():
        result[index] = x
    return result


def dense(degree, bits, seed):
    draw = random.Random(seed)
    indices = [i for i in np.ndindex(*(degree + 1,) * 3) if sum(i) <= degree]
    return made({i: draw.randrange(-(2**bits), 2**bits) for i in indices}, (degree + 1,) * 3)


SPHERE = made({(2, 0, 0): 1, (0, 2, 0): 1, (0, 0, 2): 1, (0, 0, 0): -1}, (3, 3, 3))
PLANE = made({(0, 0, 1): 10, (0, 0, 0): -1}, (1, 1, 2))
X, Y = made({(1, 0, 0): 1}, (2, 1, 1)), made({(0, 1, 0): 1}, (1, 2, 1))
QUADRIC, SLANTED = dense(2, 50, 3), dense(1, 50, 4)


def times(*factors):
    result = factors[0]
    for factor in factors[1:]:
        result = exact.product(result, factor)
    return result


def proportional(f, g):
    """Whether two arrays of integers are multiples of each other."""
    place = next(index for index, x in np.ndenumerate(g) if x != 0)
    return f.shape == g.shape and bool(np.all(f * g[place] == g * f[place]))


REPEATED = {
    "the square of a sphere": ([SPHERE, SPHERE], [SPHERE]),
    "the cube of a plane": ([PLANE, PLANE, PLANE], [PLANE]),
    "a plane twice and a sphere": ([PLANE, PLANE, SPHERE], [PLANE, SPHERE]),
    "axes": ([X, X, Y, Y, Y, PLANE], [X, Y, PLANE]),
    "long coefficients": ([QUADRIC, QUADRIC, SLANTED, SLANTED], [QUADRIC, SLANTED]),
    "a sixth power": ([SLANTED] * 6, [SLANTED]),
}


@pytest.mark.parametrize("case", REPEATED)
def test_repeated_factors_are_kept_once(case):
    factors, distinct = REPEATED[case]
    part = exact.square_free_part(exact.integers(times(*factors)))
    assert proportional(part, exact.trimmed(times(*distinct)))


@pytest.mark.parametrize("f", [SPHERE, PLANE, times(SPHERE, PLANE, X), dense(6, 50, 2), X + 0])
def test_a_polynomial_without_repeated_factors_is_itself(f):
    assert exact.square_free_part(f) is f


def test_a_system_that_is_too_large_leaves_the_polynomial_alone(monkeypatch):
    monkeypatch.setattr(exact, "_UNKNOWNS", 3)
    square = times(SPHERE, SPHERE)
    assert exact.square_free_part(square) is square


def test_integers_and_floats_are_the_same_polynomial():
    given = np.array([[[0.1, 3.0], [-1e-300, 0.0]]])
    f = exact.integers(given)
    assert math.gcd(*f.flat) == 1
    assert Fraction(f[0, 0, 0], f[0, 0, 1]) == Fraction(0.1) / 3
    scaled = exact.floats(f)
    assert 0.5 <= np.abs(scaled).max() < 1
    # The ratios are kept but for one rounding each.
    assert np.allclose(scaled / scaled[0, 0, 1] * 3, given, rtol=1e-15, atol=0)
    assert exact.floats(SPHERE, scaled=False).tolist() == SPHERE.astype(float).tolist()


def test_a_substitution_keeps_the_zeros_and_the_sign():
    center, scale = [Fraction(1, 3), Fraction(-2), Fraction(10**20)], [Fraction(1, 7), Fraction(5), Fraction(1, 2)]
    f = dense(3, 20, 1)
    g = exact.substituted(f, center, scale)
    ratios = set()
    for w in ((0, 0, 0), (1, 2, -3), (5, -1, 4)):
        x = [m + s * v for m, s, v in zip(center, scale, w, strict=True)]
        z = sum(Fraction(int(f[i])) * math.prod(t**n for t, n in zip(x, i, strict=True)) for i in np.ndindex(*f.shape))
        ratios.add(Fraction(int(exact.values(g, np.array(w, dtype=object)[:, None])[0])) / z)
    assert len(ratios) == 1 and ratios.pop() > 0


def test_signs_are_those_of_the_values_for_short_and_long_integers():
    points = np.array([[0, 1, 2, 3], [1, 0, 0, 1], [0, 0, 1, -1]])
    assert exact.signs(SPHERE, points).tolist() == [0, 0, 1, 1]
    long = times(SPHERE, made({(0, 0, 0): -(10**40)}, (1, 1, 1)))
    assert exact.signs(long, points).tolist() == [0, 0, -1, -1]
