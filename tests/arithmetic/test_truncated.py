"""Truncated polynomials against exact rational arithmetic."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

from jhd._arithmetic.truncated import (
    EXPONENTS,
    Truncated,
    composed,
    composed_on_graph,
    largest,
    product,
    reciprocal,
)

CASES = 8
PRODUCT, COMPOSED, LARGEST, RECIPROCAL = (jax.jit(f) for f in (product, composed, largest, reciprocal))


def random_polynomials(rng, *shape):
    """Coefficients that fall with the degree, by a factor for each case, and of absolute values below one."""
    fall = 2.0 ** -rng.integers(1, 12, CASES)
    degrees = np.array([sum(powers) for powers in EXPONENTS]).reshape(-1, *[1] * (len(shape) + 1))
    terms = rng.uniform(-1, 1, (len(EXPONENTS), *shape, CASES)) * fall**degrees
    return terms / (1.01 * np.sum(np.abs(terms), axis=0))


def value(terms, s, t):
    return sum(Fraction(float(c)) * s**i * t**j for c, (i, j) in zip(terms, EXPONENTS[: len(terms)], strict=True))


def places(rng):
    """Corners and inner points of the square."""
    inner = [Fraction(float(x)) for x in rng.uniform(-1, 1, 4)]
    return [(Fraction(1), Fraction(-1)), (Fraction(-1), Fraction(-1)), inner[:2], inner[2:]]


def holds(found, case, exact, s, t):
    return abs(exact - value(np.asarray(found.terms)[:, case], s, t)) <= Fraction(float(found.rest[case]))


def test_products_and_compositions_stay_within_their_rests():
    rng = np.random.default_rng(3)
    x = random_polynomials(rng, 3)
    powers = list(np.ndindex(4, 4, 4))
    form = rng.normal(size=(4, 4, 4, CASES))
    nothing = jnp.zeros((3, CASES))
    square = PRODUCT(*(Truncated(jnp.asarray(x[:, k]), nothing[k]) for k in (0, 1)))
    whole = COMPOSED(form, Truncated(jnp.asarray(x), nothing))
    for case in range(CASES):
        for s, t in places(rng):
            first, second, third = (value(x[:, k, case], s, t) for k in range(3))
            assert holds(square, case, first * second, s, t)
            parts = [first**i * second**j * third**k for i, j, k in powers]
            numbers = [Fraction(float(form[(*p, case)])) for p in powers]
            exact = sum(number * part for number, part in zip(numbers, parts, strict=True))
            assert holds(whole, case, exact, s, t)
    # Rests fall with the size: what is lost is beyond the degree.
    assert float(np.min(square.rest)) < 1e-12


def test_compositions_of_two_functions_stay_within_their_rests():
    rng = np.random.default_rng(4)
    x = random_polynomials(rng, 2)
    # One of the degrees is zero in the last form.
    for shape in ((4, 4), (2, 3), (7, 5), (3, 1)):
        form = rng.normal(size=(*shape, CASES))
        whole = COMPOSED(form, Truncated(jnp.asarray(x), jnp.zeros((2, CASES))))
        for case in range(CASES):
            for s, t in places(rng):
                first, second = (value(x[:, k, case], s, t) for k in range(2))
                exact = sum(Fraction(float(form[i, j, case])) * first**i * second**j for i, j in np.ndindex(*shape))
                assert holds(whole, case, exact, s, t)


def test_compositions_on_a_graph_stay_within_their_rests():
    rng = np.random.default_rng(6)
    z = random_polynomials(rng)
    rest, loose = rng.choice([0.0, 1e-9], CASES), 1e-9
    # The form has terms beyond the degree.
    form = rng.normal(size=(8, 5, 4, CASES))
    found = jax.jit(composed_on_graph)(form, Truncated(jnp.asarray(z), jnp.asarray(rest)), loose)
    for case in range(CASES):
        for s, t in places(rng):
            for sign in (-1, 0, 1):
                x, y = (v - sign * Fraction(loose) * (1 if v > 0 else -1) for v in (s, t))
                height = value(z[:, case], s, t) + sign * Fraction(float(rest[case]))
                exact = sum(
                    Fraction(float(form[(*p, case)])) * x ** p[0] * y ** p[1] * height ** p[2]
                    for p in np.ndindex(8, 5, 4)
                )
                assert holds(found, case, exact, s, t)
    # Without terms beyond the degree little is lost on a flat graph but for places that are off.
    flat = Truncated(jnp.asarray(z * 1e-6), jnp.zeros(CASES))
    assert np.all(jax.jit(composed_on_graph)(form[:3, :3], flat, 0.0).rest < 1e-4)
    found = jax.jit(composed_on_graph)(form[:3, :3], flat, 1e-2)
    for case in range(CASES):
        for s, t in places(rng):
            x, y = (v * (1 - Fraction(1, 100)) for v in (s, t))
            height = value(z[:, case] * 1e-6, s, t)
            parts = [x ** p[0] * y ** p[1] * height ** p[2] for p in np.ndindex(3, 3, 4)]
            numbers = [Fraction(float(form[(*p, case)])) for p in np.ndindex(3, 3, 4)]
            assert holds(found, case, sum(u * v for u, v in zip(numbers, parts, strict=True)), s, t)


def test_reciprocals_stay_within_their_rests_and_know_nothing_beside_a_zero():
    rng = np.random.default_rng(5)
    x = random_polynomials(rng)
    x[0] = rng.choice([-1.0, 1.0], CASES) * rng.uniform(0.2, 3.0, CASES)
    x[1:] *= 0.999 * np.abs(x[0]) / np.sum(np.abs(x[1:]), axis=0) * 10.0 ** -np.linspace(0, 3, CASES)
    rest = rng.choice([0.0, 1e-12], CASES)
    found = RECIPROCAL(Truncated(jnp.asarray(x), jnp.asarray(rest)))
    assert np.all(np.isfinite(found.rest)) and np.min(found.rest) < 1e-10
    for case in range(CASES):
        for s, t in places(rng):
            for sign in (-1, 1):
                exact = 1 / (value(x[:, case], s, t) + sign * Fraction(float(rest[case])))
                assert holds(found, case, exact, s, t)
    zero = jnp.asarray(x).at[1].set(jnp.asarray(x)[0])
    assert np.all(np.isinf(RECIPROCAL(Truncated(zero, jnp.asarray(rest))).rest))


def test_polynomials_of_a_lower_degree_stay_within_their_rests():
    rng = np.random.default_rng(7)
    # All terms up to the fourth degree; a value of the last function is at least a half.
    x = random_polynomials(rng, 3)[:15]
    x[0, 2] = 1.5
    nothing = jnp.zeros(CASES)
    first, second, third = (Truncated(jnp.asarray(x[:, k]), nothing) for k in range(3))
    square, inverse, most = PRODUCT(first, second), RECIPROCAL(third), LARGEST(first)
    assert len(square.terms) == len(inverse.terms) == 15
    for case in range(CASES):
        for s, t in places(rng):
            values = [value(x[:, k, case], s, t) for k in range(3)]
            assert holds(square, case, values[0] * values[1], s, t)
            assert holds(inverse, case, 1 / values[2], s, t)
            assert values[0] <= Fraction(float(most[case]))
    assert np.all(np.isfinite(inverse.rest)) and float(np.min(square.rest)) < 1e-9


def test_the_largest_value_is_bounded_and_attained_at_corners():
    rng = np.random.default_rng(4)
    x = random_polynomials(rng)
    rest = jnp.asarray(rng.uniform(0, 1e-3, CASES))
    most = LARGEST(Truncated(jnp.asarray(x), rest))
    for case in range(CASES):
        values = [value(x[:, case], s, t) for s, t in places(rng)]
        assert max(values) + Fraction(float(rest[case])) <= Fraction(float(most[case]))
    rising = np.zeros_like(x)
    rising[:3] = 0.25
    assert np.allclose(LARGEST(Truncated(jnp.asarray(rising), 0 * rest)), 0.75, atol=1e-14)
