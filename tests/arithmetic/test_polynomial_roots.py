"""No root is lost: polynomials with known rational roots, whose coefficients are rounded by a known amount."""

import math
from fractions import Fraction
from functools import cache
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Array

from jhd._arithmetic import polynomial_roots
from jhd._arithmetic.polynomial_roots import Roots, solve
from jhd._results.solution import name_of
from tests.sweeps import swept

ATTEMPTS = settings(max_examples=20, deadline=None, derandomize=True)
# Well separated simple roots of polynomials of size one: some fifty rounding bounds of 1e-14 each.
SIMPLE = 2e-12
# Rounding hides a root of multiplicity m in an interval of about the m-th root of its bound, 1e-14.
DOUBLE, TRIPLE = 1e-6, 2e-4
HALF, THIRD = Fraction(1, 2), Fraction(1, 3)


def with_roots(*roots: Fraction, degree: int) -> np.ndarray:
    """Exact Bernstein coefficients of the monic polynomial with these roots."""
    powers = [Fraction(1)]
    for root in roots:
        powers = [low - root * high for low, high in zip([Fraction(0), *powers], [*powers, Fraction(0)], strict=True)]
    rows = [
        sum((Fraction(math.comb(i, k), math.comb(degree, k)) * x for k, x in enumerate(powers)), Fraction(0))
        for i in range(degree + 1)
    ]
    return np.array(rows, dtype=object)


def value(c: np.ndarray, t: Fraction) -> Fraction:
    while len(c) > 1:
        c = (1 - t) * c[:-1] + t * c[1:]
    return Fraction(c[0])


def exactly(floats: np.ndarray) -> np.ndarray:
    return np.vectorize(Fraction, otypes=[object])(np.asarray(floats, float))


def rounded(c: np.ndarray, dtype: type = np.float64) -> tuple[Array, Array]:
    """Coefficients as floats, and a bound of what that changed."""
    floats = c.astype(dtype)
    worst = np.max(np.abs(exactly(floats) - c))
    return jnp.asarray(floats), jnp.asarray(np.nextafter(dtype(float(worst)), dtype(np.inf)))


def intervals(roots: Roots) -> list[tuple[float, float]]:
    valid = np.asarray(roots.valid)
    return list(zip(np.asarray(roots.lower)[valid].tolist(), np.asarray(roots.upper)[valid].tolist(), strict=True))


def held(roots: Roots, point: Fraction) -> int:
    """In how many intervals the exact point lies."""
    return sum(Fraction(lower) <= point <= Fraction(upper) for lower, upper in intervals(roots))


def width(roots: Roots) -> float:
    return max((upper - lower for lower, upper in intervals(roots)), default=0.0)


def tenths(*values: int) -> list[Fraction]:
    return [Fraction(v, 10) for v in values]


CASES = {
    "none": ([], 0.0),
    "outside the interval": ([Fraction(-1, 10), Fraction(11, 10)], 0.0),
    "one": ([THIRD], SIMPLE),
    "both ends": ([Fraction(0), Fraction(1)], SIMPLE),
    "on the lines of halving": ([HALF, Fraction(1, 4), Fraction(7, 8)], SIMPLE),
    "double": ([THIRD, THIRD], DOUBLE),
    "double at an end": ([Fraction(0), Fraction(0), HALF], DOUBLE),
    "double on the line of halving": ([HALF, HALF], DOUBLE),
    "triple": ([THIRD] * 3, TRIPLE),
    "two doubles": (tenths(3, 3, 7, 7), DOUBLE),
    "triple and three simple": (tenths(2, 5, 5, 5, 8, 9), TRIPLE),
    "as many as the degree": (tenths(1, 2, 4, 5, 7, 9), SIMPLE),
    "clustered": ([HALF + Fraction(k, 10000) for k in range(3)], 1e-6),
}


@pytest.mark.parametrize("name", CASES)
def test_each_root_lies_in_one_narrow_interval(name):
    points, widest = CASES[name]
    roots = solve(*rounded(with_roots(*points, degree=6)))
    inside = {p for p in points if 0 <= p <= 1}
    assert name_of(roots.result) == "successful"
    assert [held(roots, p) for p in inside] == [1] * len(inside)
    assert len(intervals(roots)) == len(inside)
    assert width(roots) <= widest


def test_roots_1e_9_apart_at_an_end_stay_apart():
    floats, _ = rounded(with_roots(Fraction(1, 10**9), Fraction(2, 10**9), HALF, degree=6))
    roots = solve(floats)
    ends = [[value(exactly(np.asarray(floats)), Fraction(x)) for x in ends] for ends in intervals(roots)]
    assert [(low > 0) - (low < 0) == (high < 0) - (high > 0) for low, high in ends] == [True] * 3
    assert width(roots) <= SIMPLE


def test_twenty_roots_of_degree_twenty_are_told_apart():
    points = [Fraction(k, 21) for k in range(1, 21)]
    roots = solve(*rounded(with_roots(*points, degree=20)))
    assert [held(roots, p) for p in points] == [1] * 20 and len(intervals(roots)) == 20
    assert name_of(roots.result) == "successful"


@ATTEMPTS
@given(points=st.lists(st.fractions(-1, 2, max_denominator=50), min_size=1, max_size=6))
def test_no_planted_root_is_lost(points):
    roots = solve(*rounded(with_roots(*points, degree=6)))
    assert all(held(roots, p) == 1 for p in points if 0 <= p <= 1)
    assert name_of(roots.result) == "successful"


@ATTEMPTS
@given(points=st.lists(st.fractions(0, 1, max_denominator=9), min_size=1, max_size=6))
def test_no_planted_root_is_lost_in_single_precision(points):
    floats, error = rounded(with_roots(*points, degree=6), dtype=np.float32)
    roots = solve(floats, error)
    assert roots.lower.dtype == jnp.float32
    assert all(held(roots, p) == 1 for p in points)


@ATTEMPTS
@given(points=st.lists(st.fractions(0, 1, max_denominator=50), min_size=1, max_size=6), power=st.integers(-1000, 900))
def test_the_scale_of_a_polynomial_does_not_lose_roots(points, power):
    scale = Fraction(2) ** power
    roots = solve(*rounded(with_roots(*points, degree=6) * scale))
    assert all(held(roots, p) == 1 for p in points)


def test_coefficients_that_are_flushed_say_nothing():
    roots = solve(jnp.array([-1e-310, 2e-310, -1e-310, 1e-310, 1e-310, 0.0, 0.0]))
    assert width(roots) == 1.0


def test_the_error_of_the_coefficients_is_counted():
    shifted = jnp.asarray((with_roots(THIRD, degree=6) + Fraction(1, 1000)).astype(float))
    assert held(solve(shifted, 1.1e-3), THIRD) == 1
    assert held(solve(shifted), THIRD) == 0


def test_a_polynomial_that_vanishes_identically_leaves_the_whole_interval():
    roots = solve(jnp.zeros(7))
    assert len(intervals(roots)) == 1 and width(roots) == 1.0 and int(roots.boxes) == 1


def test_nothing_is_lost_when_the_table_is_full():
    points = tenths(1, 2, 4, 5, 7, 9)
    roots = solve(*rounded(with_roots(*points, degree=6)), capacity=3)
    assert name_of(roots.result) == "capacity_reached"
    # An interval that finds no room for its half is final.
    assert int(roots.boxes) <= 32
    assert all(held(roots, p) == 1 for p in points)


@pytest.mark.parametrize("steps", swept([0, 5, 1, 9], 2, 2))
def test_nothing_is_lost_when_the_steps_are_spent(steps):
    points = tenths(1, 2, 4, 5, 7, 9)
    roots = solve(*rounded(with_roots(*points, degree=6)), max_steps=steps)
    assert name_of(roots.result) == "gap_not_closed" and int(roots.boxes) == steps
    assert all(held(roots, p) == 1 for p in points)


def test_what_is_not_finite_gives_the_whole_interval_and_a_code():
    for bad in (np.nan, np.inf):
        roots = solve(jnp.array([1.0, bad, -1.0, 0.0, 0.0, 0.0, 1.0]))
        assert name_of(roots.result) == "nonfinite_value" and width(roots) == 1.0


def planted(seed: int, degree: int) -> tuple[np.ndarray, Fraction]:
    """A random polynomial that vanishes at a random rational point."""
    rng = np.random.default_rng(seed)
    point = Fraction(int(rng.integers(0, 65)), 64)
    c = np.array([Fraction(int(k), 97) for k in rng.integers(-97, 98, degree + 1)], dtype=object)
    return c - value(c, point), point


@cache
def find_planted(degree: int, seeds: range, capacity: int) -> Roots:
    """All polynomials at once, each checked for its planted root."""
    cases = [planted(seed, degree) for seed in seeds]
    coefficients, errors = zip(*(rounded(c) for c, _ in cases), strict=True)
    roots = jax.jit(jax.vmap(lambda c, e: solve(c, e, capacity=capacity)))(jnp.array(coefficients), jnp.array(errors))
    roots = jax.tree.map(np.asarray, roots)
    for k, (_, point) in enumerate(cases):
        assert held(jax.tree.map(lambda x, k=k: x[k], roots), point) == 1
    return roots


@pytest.mark.parametrize("degree", swept([28, 1, 9], 0, 1))
def test_no_planted_root_of_many_random_polynomials_is_lost(degree):
    find_planted(degree, range(100, 500), capacity=64)


def test_intervals_are_disjoint_and_in_order():
    roots = find_planted(5, range(60), capacity=128)
    assert np.all(np.asarray(roots.result._value) == 0)
    for lower, upper, valid in zip(roots.lower, roots.upper, roots.valid, strict=True):
        count = int(valid.sum())
        assert not np.any(valid[count:])
        assert np.all(lower[:count] <= upper[:count]) and np.all(upper[: count - 1] < lower[1:count])
        assert np.all(lower[count:] == 1.0) and np.all(upper[count:] == 0.0)


def test_intervals_that_touch_are_merged():
    lower = jnp.array([[0.5], [0.0], [0.75], [0.25], [0.1], [0.0]])
    upper = jnp.array([[0.75], [0.3], [0.8], [0.4], [0.2], [1.0]])
    found = polynomial_roots._merged(lower, upper, jnp.array([[True]] * 5 + [[False]]))
    lower, upper, valid = (x[:, 0].tolist() for x in found)
    assert (lower, upper) == ([0.0, 0.5, 1, 1, 1, 1], [0.4, 0.8, 0, 0, 0, 0])
    assert valid == [True, True, False, False, False, False]


def test_a_simple_root_takes_few_intervals():
    roots = find_planted(5, range(60), capacity=128)
    assert np.sum(roots.boxes) / np.sum(roots.valid) < 8


def random_polynomials(*shape: int) -> Array:
    return jnp.asarray(np.random.default_rng(7).uniform(-1, 1, (*shape, 7)))


def test_blocks_of_lanes_give_what_one_block_gives(monkeypatch):
    together = find_planted(5, range(60), capacity=128)
    monkeypatch.setattr(polynomial_roots, "BLOCK_NUMBERS", 0)
    polynomial_roots._solver.cache_clear()
    in_blocks = find_planted.__wrapped__(5, range(60), capacity=128)
    polynomial_roots._solver.cache_clear()
    np.testing.assert_array_equal(in_blocks.valid, together.valid)
    np.testing.assert_allclose(in_blocks.lower, together.lower, atol=SIMPLE)


def test_nested_maps_give_what_single_calls_give():
    coefficients = random_polynomials(3, 4)
    mapped = jax.jit(jax.vmap(jax.vmap(lambda c: solve(c)), in_axes=1, out_axes=1))(coefficients)
    for i, j in product(range(3), range(4)):
        alone = solve(coefficients[i, j])
        np.testing.assert_array_equal(mapped.valid[i, j], alone.valid)
        np.testing.assert_allclose(mapped.lower[i, j], alone.lower, atol=1e-12)


def test_roots_are_constants_to_derivatives():
    slope = jax.grad(lambda c: jnp.sum(solve(c).lower))(random_polynomials())
    assert not np.any(slope)


def test_an_empty_table_is_refused():
    with pytest.raises(ValueError, match="capacity"):
        solve(jnp.zeros(3), capacity=0)
