"""No root is lost: systems with known rational roots, whose coefficients are rounded by a known amount."""

import math
from fractions import Fraction
from functools import cache, reduce
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Array

from jhd._arithmetic import polynomial_systems
from jhd._arithmetic.polynomial_systems import Roots, solve
from jhd._results.solution import name_of
from tests.sweeps import swept

ATTEMPTS = settings(max_examples=20, deadline=None, derandomize=True)
# Well separated simple roots of systems of size one: some fifty rounding bounds of 1e-14 each.
SIMPLE = 2e-12
# Rounding hides a root of multiplicity m in a box of about the m-th root of its bound, 1e-14.
DOUBLE, TRIPLE = 1e-6, 2e-4
ONE, HALF, THIRD = Fraction(1), Fraction(1, 2), Fraction(1, 3)


def tensor(terms: dict[tuple[int, ...], Fraction], degrees: tuple[int, ...]) -> np.ndarray:
    """Exact Bernstein coefficients of a polynomial given by its monomials."""
    result = np.full([d + 1 for d in degrees], Fraction(0), dtype=object)
    for index in product(*(range(d + 1) for d in degrees)):
        for powers, factor in terms.items():
            rows = zip(index, powers, degrees, strict=True)
            result[index] += factor * math.prod(Fraction(math.comb(i, p), math.comb(d, p)) for i, p, d in rows)
    return result


def multiplied(f: dict, g: dict) -> dict:
    result: dict = {}
    for (p, a), (q, b) in product(f.items(), g.items()):
        powers = tuple(i + j for i, j in zip(p, q, strict=True))
        result[powers] = result.get(powers, Fraction(0)) + a * b
    return result


def with_roots(*roots: Fraction, degree: int) -> np.ndarray:
    factors = [{(1,): Fraction(1), (0,): -Fraction(r)} for r in roots]
    return tensor(reduce(multiplied, factors, {(0,): Fraction(1)}), (degree,))


def ball(center: tuple[Fraction, ...], through: tuple[Fraction, ...]) -> np.ndarray:
    """Circle or sphere with a rational point on it, of degree two in each variable."""
    n, terms = len(center), {}
    for k, c in enumerate(center):
        terms[tuple(2 * (j == k) for j in range(n))] = Fraction(1)
        terms[tuple(int(j == k) for j in range(n))] = -2 * c
    terms[(0,) * n] = sum((c * c - (p - c) ** 2 for c, p in zip(center, through, strict=True)), Fraction(0))
    return tensor(terms, (2,) * n)


def value(c: np.ndarray, point: tuple[Fraction, ...]) -> Fraction:
    for t in point:
        while len(c) > 1:
            c = (1 - t) * c[:-1] + t * c[1:]
        c = c[0]
    return Fraction(c)  # pyright: ignore[reportCallIssue, reportArgumentType]


def exactly(floats: np.ndarray) -> np.ndarray:
    return np.vectorize(Fraction, otypes=[object])(np.asarray(floats, float))


def rounded(*equations: np.ndarray, dtype: type = np.float64) -> tuple[Array, Array]:
    """Coefficients as floats, and for each equation a bound of what that changed."""
    floats = np.array([c.astype(dtype) for c in equations])
    worst = [np.max(np.abs(exactly(a) - c)) for a, c in zip(floats, equations, strict=True)]
    return jnp.asarray(floats), jnp.asarray([np.nextafter(dtype(float(w)), dtype(np.inf)) for w in worst])


def boxes(roots: Roots) -> list[tuple[np.ndarray, np.ndarray]]:
    valid = np.asarray(roots.valid)
    return list(zip(np.asarray(roots.lower)[valid], np.asarray(roots.upper)[valid], strict=True))


def held(roots: Roots, point: tuple[Fraction, ...]) -> int:
    """In how many boxes the exact point lies."""
    return sum(
        all(Fraction(float(a)) <= z <= Fraction(float(b)) for a, z, b in zip(lower, point, upper, strict=True))
        for lower, upper in boxes(roots)
    )


def width(roots: Roots) -> float:
    return max((float(np.max(upper - lower)) for lower, upper in boxes(roots)), default=0.0)


def tenths(*values: int) -> list[Fraction]:
    return [Fraction(v, 10) for v in values]


UNIVARIATE = {
    "none": ([], 0.0),
    "outside the box": ([Fraction(-1, 10), Fraction(11, 10)], 0.0),
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


@pytest.mark.parametrize("name", UNIVARIATE)
def test_each_root_in_one_variable_lies_in_one_narrow_box(name):
    points, widest = UNIVARIATE[name]
    roots = solve(*rounded(with_roots(*points, degree=6)))
    inside = {p for p in points if 0 <= p <= 1}
    assert name_of(roots.result) == "successful"
    assert [held(roots, (p,)) for p in inside] == [1] * len(inside)
    assert len(boxes(roots)) == len(inside)
    assert width(roots) <= widest


def test_roots_1e_9_apart_at_an_end_stay_apart():
    floats, _ = rounded(with_roots(Fraction(1, 10**9), Fraction(2, 10**9), HALF, degree=6))
    roots = solve(floats)
    ends = [[value(exactly(np.asarray(floats[0])), (Fraction(float(x[0])),)) for x in box] for box in boxes(roots)]
    assert [(low > 0) - (low < 0) == (high < 0) - (high > 0) for low, high in ends] == [True] * 3
    assert width(roots) <= SIMPLE


def test_twenty_roots_of_degree_twenty_are_told_apart():
    points = [Fraction(k, 21) for k in range(1, 21)]
    roots = solve(*rounded(with_roots(*points, degree=20)))
    assert [held(roots, (p,)) for p in points] == [1] * 20 and len(boxes(roots)) == 20
    assert name_of(roots.result) == "successful"


@ATTEMPTS
@given(points=st.lists(st.fractions(-1, 2, max_denominator=50), min_size=1, max_size=6))
def test_no_planted_root_in_one_variable_is_lost(points):
    roots = solve(*rounded(with_roots(*points, degree=6)))
    assert all(held(roots, (p,)) == 1 for p in points if 0 <= p <= 1)
    assert name_of(roots.result) == "successful"


@ATTEMPTS
@given(points=st.lists(st.fractions(0, 1, max_denominator=9), min_size=1, max_size=6))
def test_no_planted_root_is_lost_in_single_precision(points):
    floats, errors = rounded(with_roots(*points, degree=6), dtype=np.float32)
    roots = solve(floats, errors)
    assert roots.lower.dtype == jnp.float32
    assert all(held(roots, (p,)) == 1 for p in points)


@ATTEMPTS
@given(points=st.lists(st.fractions(0, 1, max_denominator=50), min_size=1, max_size=6), power=st.integers(-1000, 900))
def test_the_scale_of_an_equation_does_not_lose_roots(points, power):
    scale = Fraction(2) ** power
    roots = solve(*rounded(with_roots(*points, degree=6) * scale))
    assert all(held(roots, (p,)) == 1 for p in points)


def test_coefficients_that_are_flushed_say_nothing():
    roots = solve(jnp.array([[-1e-310, 2e-310, -1e-310, 1e-310, 1e-310, 0.0, 0.0]]))
    assert width(roots) == 1.0


def test_the_error_of_the_coefficients_is_counted():
    shifted = with_roots(THIRD, degree=6) + Fraction(1, 1000)
    assert held(solve(jnp.asarray(shifted.astype(float))[None], 1.1e-3), (THIRD,)) == 1
    assert held(solve(jnp.asarray(shifted.astype(float))[None]), (THIRD,)) == 0


def test_an_equation_that_vanishes_identically_leaves_the_whole_box():
    roots = solve(jnp.zeros((1, 7)))
    assert len(boxes(roots)) == 1 and width(roots) == 1.0 and int(roots.boxes) == 1


def test_a_root_common_to_two_equations_in_one_variable_is_found_alone():
    first, second = with_roots(*tenths(2, 5), degree=6), with_roots(*tenths(5, 8), degree=6)
    roots = solve(*rounded(first, second))
    assert held(roots, (HALF,)) == 1 and len(boxes(roots)) == 1


P, Q = (Fraction(1, 4), HALF), (Fraction(3, 4), HALF)
AWAY = (Fraction(1, 4) + Fraction(3, 10), HALF + Fraction(4, 10))
PLANE = {
    "two points": ([ball((HALF, Fraction(1, 5)), P), ball((HALF, Fraction(4, 5)), P)], [P, Q], 2, SIMPLE),
    "tangent from outside": ([ball((Fraction(0), HALF), P), ball((HALF, HALF), P)], [P], 1, DOUBLE),
    "tangent and oblique": ([ball((Fraction(-1, 20), Fraction(1, 10)), P), ball(AWAY, P)], [P], 1, DOUBLE),
    "tangent from inside": ([ball((Fraction(2, 5), HALF), P), ball((Fraction(3, 5), HALF), P)], [P], 1, DOUBLE),
    "apart": ([ball((Fraction(0), Fraction(0)), P), ball((Fraction(1), Fraction(1)), (Fraction(1), HALF))], [], 0, 0.0),
    "at a corner": ([tensor({(1, 0): k, (0, 1): ONE}, (2, 2)) for k in (ONE, -ONE)], [(ONE - 1, ONE - 1)], 1, SIMPLE),
}


@pytest.mark.parametrize("name", PLANE)
def test_each_root_in_two_variables_lies_in_one_narrow_box(name):
    equations, points, count, widest = PLANE[name]
    roots = solve(*rounded(*equations))
    assert [held(roots, p) for p in points] == [1] * len(points)
    assert len(boxes(roots)) == count and width(roots) <= widest
    assert name_of(roots.result) == "successful"


@pytest.mark.parametrize("second", ("the same circle", "zero"))
def test_a_curve_of_roots_is_covered_coarsely_and_says_so(second):
    center = (HALF, HALF)
    circle = ball(center, P)
    roots = solve(*rounded(circle, circle * (second != "zero")))
    assert name_of(roots.result) == "capacity_reached"
    assert int(roots.boxes) < 500
    for a, b, c in ((3, 4, 5), (-5, 12, 13), (8, -15, 17), (-1, 0, 1)):
        assert held(roots, (HALF + Fraction(a, 4 * c), HALF + Fraction(b, 4 * c))) == 1


def test_fewer_equations_than_variables_cover_a_curve():
    roots = solve(*rounded(ball((HALF, HALF), P)))
    assert held(roots, P) == 1 and name_of(roots.result) == "capacity_reached"


def test_nothing_is_lost_when_the_table_is_full():
    points = tenths(1, 2, 4, 5, 7, 9)
    roots = solve(*rounded(with_roots(*points, degree=6)), capacity=3)
    assert name_of(roots.result) == "capacity_reached"
    # A box that finds no room for its half is final.
    assert int(roots.boxes) <= 32
    assert all(held(roots, (p,)) == 1 for p in points)


@pytest.mark.parametrize("steps", swept([0, 5, 1, 9], 2, 2))
def test_nothing_is_lost_when_the_steps_are_spent(steps):
    points = tenths(1, 2, 4, 5, 7, 9)
    roots = solve(*rounded(with_roots(*points, degree=6)), max_steps=steps)
    assert name_of(roots.result) == "gap_not_closed" and int(roots.boxes) == steps
    assert all(held(roots, (p,)) == 1 for p in points)


def test_what_is_not_finite_gives_the_whole_box_and_a_code():
    for bad in (np.nan, np.inf):
        roots = solve(jnp.array([[1.0, bad, -1.0, 0.0, 0.0, 0.0, 1.0]]))
        assert name_of(roots.result) == "nonfinite_value" and width(roots) == 1.0


SPHERES = [ball(tuple(tenths(*center)), (HALF, HALF, HALF)) for center in ((3, 4, 5), (6, 3, 4), (5, 8, 3))]


def test_three_spheres_meet_in_their_points():
    roots = solve(*rounded(*SPHERES))
    assert held(roots, (HALF, HALF, HALF)) == 1 and 1 <= len(boxes(roots)) <= 2
    assert width(roots) <= SIMPLE and name_of(roots.result) == "successful"


def test_two_spheres_that_meet_in_a_circle_are_covered():
    roots = solve(*rounded(SPHERES[0], SPHERES[1], SPHERES[0] + SPHERES[1]))
    assert held(roots, (HALF, HALF, HALF)) == 1 and name_of(roots.result) == "capacity_reached"


def planted(seed: int, degrees: tuple[int, ...]) -> tuple[list[np.ndarray], tuple[Fraction, ...]]:
    """Random equations, one for each variable, that vanish at a random rational point."""
    rng = np.random.default_rng(seed)
    point = tuple(Fraction(int(k), 64) for k in rng.integers(0, 65, len(degrees)))
    shape = [d + 1 for d in degrees]
    equations = [
        np.array([Fraction(int(k), 97) for k in rng.integers(-97, 98, math.prod(shape))], dtype=object).reshape(shape)
        for _ in degrees
    ]
    return [c - value(c, point) for c in equations], point


@cache
def find_planted(degrees: tuple[int, ...], seeds: range, capacity: int) -> Roots:
    """All systems at once, each checked for its planted root."""
    systems = [planted(seed, degrees) for seed in seeds]
    coefficients, errors = zip(*(rounded(*equations) for equations, _ in systems), strict=True)
    roots = jax.jit(jax.vmap(lambda c, e: solve(c, e, capacity=capacity)))(jnp.array(coefficients), jnp.array(errors))
    roots = jax.tree.map(np.asarray, roots)
    for k, (_, point) in enumerate(systems):
        assert held(jax.tree.map(lambda x, k=k: x[k], roots), point) == 1
    return roots


@pytest.mark.parametrize("degrees", swept([((5,),), ((3, 2),), ((2, 2, 2),)], 2, 1))
def test_no_planted_root_of_a_random_system_is_lost(degrees):
    roots = find_planted(degrees, range(60), capacity=128)
    assert np.all(np.asarray(roots.result._value) == 0)


@pytest.mark.parametrize("degrees", swept([(x,) for x in ((28,), (6, 6), (3, 4, 2), (1,), (9,), (5, 1))], 0, 1))
def test_no_planted_root_of_many_random_systems_is_lost(degrees):
    find_planted(degrees, range(100, 500), capacity=64)


def test_boxes_are_disjoint_and_in_order():
    roots = find_planted((3, 2), range(60), capacity=128)
    for lower, upper, valid in zip(roots.lower, roots.upper, roots.valid, strict=True):
        count = int(valid.sum())
        assert not np.any(valid[count:])
        corners = [tuple(map(float, x)) for x in lower[:count]]
        assert corners == sorted(corners)
        for i, j in product(range(count), range(count)):
            assert i == j or np.any((lower[i] > upper[j]) | (lower[j] > upper[i]))
        assert np.all(lower[count:] > upper[count:])


@pytest.mark.parametrize(("degrees", "most"), (((5,), 8), ((3, 2), 20)))
def test_a_simple_root_takes_few_boxes(degrees, most):
    roots = find_planted(degrees, range(60), capacity=128)
    assert np.sum(roots.boxes) / np.sum(roots.valid) < most


def random_polynomials(*shape: int) -> Array:
    return jnp.asarray(np.random.default_rng(7).uniform(-1, 1, (*shape, 1, 7)))


def test_blocks_of_lanes_give_what_one_block_gives(monkeypatch):
    together = find_planted((5,), range(60), capacity=128)
    monkeypatch.setattr(polynomial_systems, "BLOCK_NUMBERS", 0)
    polynomial_systems._solver.cache_clear()
    in_blocks = find_planted.__wrapped__((5,), range(60), capacity=128)
    polynomial_systems._solver.cache_clear()
    np.testing.assert_array_equal(in_blocks.valid, together.valid)
    np.testing.assert_allclose(in_blocks.lower, together.lower, atol=SIMPLE)


def test_nested_maps_give_what_single_calls_give():
    coefficients = random_polynomials(3, 4)
    mapped = jax.jit(jax.vmap(jax.vmap(lambda c: solve(c)), in_axes=1, out_axes=1))(coefficients)
    for i, j in product(range(3), range(4)):
        alone = solve(coefficients[i, j])
        np.testing.assert_array_equal(mapped.valid[i, j], alone.valid)
        np.testing.assert_allclose(mapped.lower[i, j], alone.lower, atol=1e-12)


def test_boxes_are_as_narrow_as_asked_for_or_as_rounding_allows():
    coefficients = random_polynomials()
    coarse, fine = (solve(coefficients, atol=atol) for atol in (1e-2, 0.0))
    assert np.array_equal(coarse.valid, fine.valid)
    assert width(coarse) <= 1e-2 and width(fine) <= SIMPLE and int(coarse.boxes) < int(fine.boxes)


def test_roots_are_constants_to_derivatives():
    slope = jax.grad(lambda c: jnp.sum(solve(c).lower))(random_polynomials())
    assert not np.any(slope)


@pytest.mark.parametrize("shape", ((3,), (0, 3), (1, 0)))
def test_coefficients_need_equations_and_variables(shape):
    with pytest.raises(ValueError, match="coefficients"):
        solve(jnp.zeros(shape))


def test_an_empty_table_is_refused():
    with pytest.raises(ValueError, match="capacity"):
        solve(jnp.zeros((1, 3)), capacity=0)
