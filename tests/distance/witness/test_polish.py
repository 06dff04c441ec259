"""Local maxima of the distance on implicit surfaces: against the table, and where the equations are hard to solve."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.witness.polish import polish
from jhd._runtime.compiled import compiled
from tests.surface_cases import BY_NAME, CASES, X, Y, Z, sphere, surface

# Newton's method ends at rounding; the values of the table are of size one.
_ROUNDING = 1e-13
_LANES = 64
_polish = compiled(jax.vmap(polish))


def padded(coefficients, size):
    return np.pad(coefficients, [(0, size - n) for n in coefficients.shape])


def solved(size):
    """Both directions of all cases with a known place, whose coefficients fit."""
    found = []
    for case in CASES:
        for a, b, maximum in ((case.a, case.b, case.ab), (case.b, case.a, case.ba)):
            fits = max(a.coefficients.shape + b.coefficients.shape) <= size
            if maximum.point is not None and fits and "far" not in case.tags:
                found.append((case, a, b, maximum))
    return found


def polished(problems, size, disturbed=0.0):
    """All problems at once; the starts are that share of the box away from the maximum, those on faces along them."""
    generator = np.random.default_rng(3)
    rows = []
    for a, b, point, feet in problems:
        places = np.array([point, *feet, *[feet[0]] * (4 - len(feet))], float)
        corners = [np.array([corner_a, *[corner_b] * 4]) for corner_a, corner_b in zip(a[1:], b[1:], strict=True)]
        step = disturbed * np.max(corners[1] - corners[0]) * generator.uniform(-1, 1, (5, 3))
        places = np.clip(np.where((places == corners[0]) | (places == corners[1]), places, places + step), *corners)
        box_a, box_b = a[1:], b[1:]
        used = np.arange(4) < len(feet)
        row = padded(a[0], size), box_a, padded(b[0], size), box_b, places[0], places[1:], used
        rows.append(jax.tree_util.tree_map(np.asarray, row, is_leaf=lambda x: isinstance(x, tuple) and len(x) == 3))
    # One size of batch, so that one program serves all tests.
    rows += [rows[0]] * (_LANES - len(rows))
    found = _polish(*jax.tree_util.tree_map(lambda *x: jnp.asarray(np.stack(x)), *rows))
    return jax.tree_util.tree_map(lambda x: x[: len(problems)], found)


def check_table(size):
    problems = solved(size)
    found = polished([(a, b, m.point, m.feet) for _, a, b, m in problems], size, 1e-3)
    for i, (case, _, _, maximum) in enumerate(problems):
        exact = float(maximum.value)
        assert bool(found.converged[i]), case.name
        assert abs(float(found.distance[i]) - exact) <= _ROUNDING * max(exact, 1e-3), case.name
        assert np.sum(np.asarray(found.multipliers[i]) > 0) == len(maximum.feet), case.name
        np.testing.assert_allclose(np.sum(found.multipliers[i]), 1, atol=1e-12)


@pytest.mark.exhaustive
def test_maxima_of_quadrics_are_those_of_the_table():
    check_table(3)


@pytest.mark.slow
def test_maxima_of_all_degrees_are_those_of_the_table():
    check_table(5)


BALL, HALF_BALL = surface(sphere(1), 2), surface(sphere(1.5), 2)
CONES = BY_NAME["paper_cones"]


@pytest.mark.slow
def test_hard_maxima():
    saddle = (1.36 * 4 / 3, 0.0, 1.36)
    ab = CONES.ab
    sign = np.sign(ab.point)
    sign = np.where(sign == 0, 1, sign)
    flat = surface(Z - 0.25, 1), surface(Z + 0.5, 1)
    found = polished(
        [
            # A family of maximizers: any member.
            (BALL, HALF_BALL, (0.61, 0.01, 0.8), [(0.9, 0, 1.2)]),
            # A foot that is a saddle of the distance does not count beside others.
            (CONES.a, CONES.b, ab.point, [tuple(sign * saddle), *ab.feet]),
            # The same foot three times.
            (CONES.b, CONES.a, CONES.ba.point, [CONES.ba.feet[0]] * 3),
            # Both feet of a plane between planes, of which one is nearer: its multiplier alone stays.
            (surface(X + Y + 0.25, 1), surface(X**2 - 1, 2), (0.5, -0.75, 0.1), [(1, -0.75, 0.1), (-1, -0.75, 0.1)]),
            # Parallel planes, cut by boxes.
            (*flat, (0.3, 1, 1), [(0.3, 1, -0.5)]),
            # A corner that is not on the surface.
            (BALL, HALF_BALL, (2, 2, 2), [(0.8, 0.8, 0.8)]),
        ],
        3,
    )
    assert np.asarray(found.converged)[[0, 1, 2]].all() and not found.converged[5]
    assert all(np.isfinite(np.asarray(x)).all() for x in found)
    np.testing.assert_allclose(found.distance[:3], [0.5, float(ab.value), float(CONES.ba.value)], atol=_ROUNDING)
    assert found.multipliers[1, 0] == 0 and np.isclose(found.multipliers[1, 1:3].sum(), 1)


@pytest.mark.slow
def test_maxima_scale_with_the_surfaces():
    case = BY_NAME["sphere_ellipsoid"]
    problems = []
    for scale in (2.0**-30, 1.0, 2.0**30):
        powers = sum(np.indices((3, 3, 3)))
        surfaces = [
            (
                padded(s.coefficients, 3) / scale**powers,
                tuple(scale * np.array(s.lower)),
                tuple(scale * np.array(s.upper)),
            )
            for s in (case.a, case.b)
        ]
        place = [tuple(scale * np.array(x)) for x in (case.ab.point, *case.ab.feet)]
        problems.append((*surfaces, place[0], place[1:]))
    found = polished(problems, 3)
    assert np.asarray(found.converged).all()
    np.testing.assert_allclose(found.distance / found.distance[1], [2.0**-30, 1, 2.0**30], rtol=1e-13)
