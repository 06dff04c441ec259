"""Every range of a polynomial over a box against exact rational arithmetic, at all sizes that floats have."""

import itertools
import math
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pytest

from jhd._arithmetic import rounding, trivariate
from jhd._arithmetic.trivariate import affine_range, local_form, modified_affine_range
from jhd._runtime.compiled import compiled
from tests.sweeps import swept

ENCLOSE = compiled(trivariate.enclose, (3,))
CORNERS = compiled(trivariate.corner_values)
EVALUATE = compiled(trivariate.evaluate)
BOXES = 6
SHAPE = (3, 2, 4)
# Roundings that the module's docstring allows each kind, for degrees 2, 1, 3 and 24 coefficients.
ROUNDINGS = {"bernstein": 36, "modified_affine": 48, "centered": 48, "horner": 18, "interval": 39}


def value(a, x):
    """The exact value at a point of fractions."""
    return sum(
        (Fraction(float(a[i])) * math.prod(t**n for t, n in zip(x, i, strict=True)) for i in np.ndindex(*a.shape)),
        Fraction(0),
    )


def points_of(c, h, rng):
    """Corners, the center and some points of a box, exact."""
    c, h = ([Fraction(float(x)) for x in v] for v in (c, h))
    inside = [[Fraction(float(x)) for x in rng.uniform(-1, 1, 3)] for _ in range(4)]
    places = [*itertools.product((-1, 1), repeat=3), (0, 0, 0), *inside]
    return [[x + s * y for x, s, y in zip(c, e, h, strict=True)] for e in places]


def assert_holds(interval, index, exact):
    lower, upper = float(interval.lower[index]), float(interval.upper[index])
    assert lower == -math.inf or Fraction(lower) <= exact, (lower, float(exact))
    assert upper == math.inf or exact <= Fraction(upper), (float(exact), upper)


def boxes(size, width, rng):
    return rng.uniform(-1, 1, (3, BOXES)) * size, rng.uniform(0, 1, (3, BOXES)) * width


SIZES = {
    "ordinary": (1.0, 0.3, 1.0),
    "far away": (1e8, 1e-3, 1.0),
    "a point": (1.0, 0.0, 1.0),
    "huge": (1e150, 1e149, 1e-300),
    "larger than a square root": (1e200, 1e200, 1e-300),
    "largest": (1.7e308, 1e292, 1e-300),
    "tiny": (1e-150, 1e-151, 1.0),
    "at the smallest normal number": (1e-305, 3e-308, 1.0),
    "subnormal": (1e-310, 1e-312, 1e5),
    "tiny coefficients": (1.0, 0.5, 1e-307),
    "wide": (0.0, 3.0, 1.0),
}


# Each overflows, vanishes or cancels in another way.
QUICK = ["ordinary", "largest", "subnormal", "wide"]


@pytest.mark.parametrize("case", swept([*QUICK, *(name for name in SIZES if name not in QUICK)], 4, len(SIZES)))
def test_ranges_and_values_hold_every_exact_value(case):
    size, width, factor = SIZES[case]
    rng = np.random.default_rng(3)
    a = rng.uniform(-1, 1, SHAPE) * (rng.random(SHAPE) < 0.8) * factor
    c, h = boxes(size, width, rng)
    check_all(a, c, h, rng)


@pytest.mark.parametrize("seed", swept(range(25), 0, 3))
def test_ranges_hold_where_every_number_has_a_size_of_its_own(seed):
    rng = np.random.default_rng(seed)
    a = rng.uniform(-1, 1, SHAPE) * 10.0 ** rng.uniform(-300, 300, SHAPE)
    c, h = (rng.uniform(-1, 1, (3, BOXES)) * 10.0 ** rng.uniform(-120, 120, (3, BOXES)) for _ in range(2))
    check_all(a, c, np.abs(h), rng)


def check_all(a, c, h, rng):
    found = {kind: ENCLOSE(a, c, h, kind) for kind in trivariate.RANGES}
    at_corners, at_centers = CORNERS(a, c, h), EVALUATE(a, c)
    for box in range(BOXES):
        exact = [value(a, x) for x in points_of(c[:, box], h[:, box], rng)]
        for kind in trivariate.RANGES:
            for z in exact:
                assert_holds(found[kind], box, z)
        for corner in range(8):
            assert_holds(at_corners, (corner, box), exact[corner])
        assert_holds(at_centers, box, exact[8])


def exact_form(a, c, h):
    """The coefficients of e -> f(c + h e), by the binomial theorem."""
    c, h = ([Fraction(float(x)) for x in v] for v in (c, h))
    form = np.full(a.shape, Fraction(0))
    for i in np.ndindex(*a.shape):
        for d in np.ndindex(*(n + 1 for n in i)):
            terms = (math.comb(n, k) * x ** (n - k) * y**k for n, k, x, y in zip(i, d, c, h, strict=True))
            form[d] += Fraction(float(a[i])) * math.prod(terms)
    return form


def exact_ends(form, kind):
    """The exact ends of the centered, the modified affine and the Bernstein range."""
    if kind == "bernstein":
        for axis in range(3):
            # x^i of e in [-1, 1] has blossoms that are means of products of signs.
            n = form.shape[axis] - 1
            rows = np.moveaxis(form, axis, 0)
            columns = []
            for j in range(n + 1):
                signs = [1] * j + [-1] * (n - j)
                means = [
                    Fraction(sum(math.prod(s) for s in itertools.combinations(signs, k)), math.comb(n, k))
                    for k in range(n + 1)
                ]
                columns.append(sum(m * row for m, row in zip(means, rows, strict=True)))
            form = np.moveaxis(np.stack(columns), 0, axis)
        return min(form.flat), max(form.flat)
    lower = upper = form[0, 0, 0]
    for i in list(np.ndindex(*form.shape))[1:]:
        even = kind == "modified_affine" and all(n % 2 == 0 for n in i)
        lower += min(form[i], 0) if even else -abs(form[i])
        upper += max(form[i], 0) if even else abs(form[i])
    return lower, upper


@pytest.mark.parametrize("kind", ["bernstein", "modified_affine", "centered"])
def test_a_range_is_its_exact_one_but_for_the_rounding_that_is_allowed(kind):
    rng = np.random.default_rng(5)
    for _ in range(3):
        a = rng.uniform(-1, 1, SHAPE)
        c, h = boxes(1.0, 0.5, rng)
        found = ENCLOSE(a, c, h, kind)
        for box in range(BOXES):
            lower, upper = exact_ends(exact_form(a, c[:, box], h[:, box]), kind)
            m = value(np.abs(a), [Fraction(float(x)) for x in np.abs(c[:, box]) + h[:, box]])
            allowed = 2 * Fraction(rounding.gamma(ROUNDINGS[kind] + 9, float)) * m
            assert lower - allowed <= Fraction(float(found.lower[box])) <= lower
            assert upper <= Fraction(float(found.upper[box])) <= upper + allowed


@pytest.mark.parametrize("kind", trivariate.RANGES)
def test_coefficients_may_be_off_by_one_rounding(kind):
    rng = np.random.default_rng(6)
    a = rng.uniform(-1, 1, SHAPE)
    # A single box that is a point shows the whole error and nothing else.
    c, h = np.full((3, BOXES), 0.75), np.zeros((3, BOXES))
    found, exact = ENCLOSE(a, c, h, kind), [Fraction(3, 4)] * 3
    for sign in (1, -1):
        off = value(np.abs(a), exact) * sign / 2**53
        assert_holds(found, 0, value(a, exact) + off)


def test_single_precision_has_its_own_bounds():
    rng = np.random.default_rng(7)
    a = rng.uniform(-1, 1, SHAPE).astype(np.float32)
    c, h = (x.astype(np.float32) for x in boxes(1.0, 0.5, rng))
    found = ENCLOSE(jnp.asarray(a), jnp.asarray(c), jnp.asarray(h), "bernstein")
    assert found.lower.dtype == np.float32
    for box in range(BOXES):
        for x in points_of(c[:, box], h[:, box], rng):
            assert_holds(found, box, value(a, x))


def test_even_powers_are_not_negative_in_the_modified_form():
    square = np.zeros((3, 1, 1))
    square[2] = 1

    def both(a, c, h):
        form = local_form(a, c, h)
        return modified_affine_range(form), affine_range(form)

    modified, plain = compiled(both)(jnp.asarray(square), jnp.zeros((3, 1)), jnp.ones((3, 1)))
    assert [float(x[0]) for x in modified] == [0, 1]
    assert [float(x[0]) for x in plain] == [-1, 1]


@pytest.mark.parametrize("kind", trivariate.RANGES)
def test_a_square_over_zero_reaches_zero(kind):
    square = np.zeros(SHAPE)
    square[2, 0, 0] = 1
    found = ENCLOSE(square, np.full((3, BOXES), 0.25), np.ones((3, BOXES)), kind)
    assert np.all(found.lower <= 0) and np.all(found.upper >= 1.25**2)


@pytest.mark.parametrize("kind", trivariate.RANGES)
def test_what_overflows_is_not_bounded(kind):
    a = np.zeros(SHAPE)
    a[2, 1, 3] = 1e300
    found = ENCLOSE(a, np.full((3, BOXES), 1e150), np.ones((3, BOXES)), kind)
    assert np.all(np.isinf(found.upper))


def test_a_constant_and_a_single_variable_are_polynomials_too():
    constant = ENCLOSE(jnp.full((1, 1, 1), 2.5), jnp.zeros((3, 2)), jnp.ones((3, 2)), "bernstein")
    assert np.all((constant.lower <= 2.5) & (constant.upper >= 2.5) & (constant.upper - constant.lower < 1e-13))
    line = ENCLOSE(jnp.array([[[0.0, 1.0]]]), jnp.zeros((3, 2)), jnp.ones((3, 2)), "bernstein")
    assert np.all((line.lower <= -1) & (line.upper >= 1) & (line.upper - line.lower < 2 + 1e-13))


def test_an_unknown_range_is_refused():
    with pytest.raises(ValueError, match="kind is 'taylor'; needs one of 'bernstein', 'modified_affine', 'centered'"):
        trivariate.enclose(jnp.zeros((1, 1, 1)), jnp.zeros((3, 1)), jnp.zeros((3, 1)), "taylor")
