"""Derivatives of distances of implicit surfaces: against differences of references in many digits, and exact laws."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf

from jhd._distance.witness.mixed_derivatives import with_place_derivatives
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness
from jhd._shapes.implicit import ImplicitSurface
from tests.surface_cases import BY_NAME, Surface
from tests.surface_reference import solve
from tests.sweeps import swept

# The places of the table are rounded to doubles, and the equations amplify that a little.
_ROUNDING = 1e-11
# Digits of the references, and the step of their differences, of which the square is lost.
_DIGITS, _STEP = 36, mpf(10) ** -9

QUICK = ["paper_cones", "sphere_ellipsoid", "plane_at_a_corner", "spheres_in_other_boxes"]
# Cubics and more; solved in padded arrays of the same shape.
FURTHER = [
    *(
        "spheres_apart",
        "saddle_plane",
        "plane_across_an_ellipsoid",
        "quadrics",
        "other_quadrics",
        "tiny_sphere_ellipsoid",
    ),
    *("genus_two_sphere", "plane_in_a_prism", "tanglecube_sphere", "cubics"),
]


class Directed(NamedTuple):
    """A direction of a case: both surfaces, where the distance is attained, and whether it was turned."""

    a: Surface
    b: Surface
    point: tuple
    feet: tuple
    turned: bool


def directions(name, size=3):
    """Both directions of a case, its coefficients in arrays of one shape."""
    case = BY_NAME[name]
    a, b = (
        s._replace(coefficients=np.pad(s.coefficients, [(0, size - n) for n in s.coefficients.shape]))
        for s in (case.a, case.b)
    )
    return Directed(a, b, *case.ab[1:], False), Directed(b, a, *case.ba[1:], True)


def solution(d):
    """The answer that a search would give."""
    known = solve(d.a, d.b, d.point, d.feet, _DIGITS)
    feet = np.array([*d.feet, *[d.feet[0]] * (4 - len(d.feet))])
    weights = np.zeros(4)
    weights[: len(d.feet)] = [float(w) for w in known.weights]
    value = jnp.asarray(float(known.value))
    witness = Witness(
        element=jnp.asarray(-1),
        t=jnp.asarray(np.nan),
        point=jnp.asarray(d.point),
        feet=jnp.asarray(feet),
        feet_elements=jnp.full(4, -1),
        feet_params=jnp.full(4, np.nan),
        multipliers=jnp.asarray(weights),
        event=EVENTS.antipodal,
        direction=DIRECTIONS.b_to_a if d.turned else DIRECTIONS.a_to_b,
    )
    return HausdorffSolution(value, value, value, witness, RESULTS.successful, {})


def changes(d, seed):
    """A random change of all coefficients that are not zero, and of both boxes."""
    generator = np.random.default_rng(seed)
    return [
        Surface(
            np.where(s.coefficients != 0, generator.uniform(-1, 1, s.coefficients.shape), 0.0) * _size(s.coefficients),
            *(generator.uniform(-1, 1, 3) * (s.upper[0] - s.lower[0]) for _ in range(2)),
        )
        for s in (d.a, d.b)
    ]


def _size(coefficients):
    """Coefficients of a small surface are of many sizes; each changes by a share of its own."""
    return np.abs(coefficients)


def value_along(t, found, given, change):
    """The distance of two surfaces that move with t, in the order in which the user gave them."""
    surfaces = [
        ImplicitSurface(s[0] + t * c[0], s[1] + t * c[1], s[2] + t * c[2], reduced=False)
        for s, c in zip(given, change, strict=True)
    ]
    return with_place_derivatives(found, *surfaces).value


_first = jax.jit(jax.grad(value_along))
_second = jax.jit(jax.grad(jax.grad(value_along)))


def reference(d, change):
    """First and second derivative, by differences in many digits."""

    def at(t):
        moved: Any = [
            Surface(*(np.asarray(x, object) + t * np.asarray(y, object) for x, y in zip(s, c, strict=True)))
            for s, c in zip((d.a, d.b), change, strict=True)
        ]
        exact: Any = [Surface(*(np.vectorize(mpf, otypes=[object])(x) for x in s)) for s in moved]
        return solve(exact[0], exact[1], d.point, d.feet, _DIGITS).value

    with mp.workdps(_DIGITS):
        before, here, after = (at(i * _STEP) for i in (-1, 0, 1))
        return float((after - before) / (2 * _STEP)), float((after - 2 * here + before) / _STEP**2)


def arguments(d, change):
    """What the compiled derivatives take: the user's order is the other one for the direction b_to_a."""
    given, change = (
        [jax.tree_util.tree_map(jnp.asarray, tuple(map(np.asarray, s))) for s in pair] for pair in ((d.a, d.b), change)
    )
    return (solution(d), *((x[::-1] if d.turned else x) for x in (given, change)))


def check(name, size, second):
    for d in directions(name, size):
        change = changes(d, 11)
        slope, curvature = reference(d, change)
        found = arguments(d, change)
        assert abs(float(_first(0.0, *found)) - slope) <= _ROUNDING * max(1, abs(slope)), (name, d.turned)
        if second:
            assert abs(float(_second(0.0, *found)) - curvature) <= 1e-8 * max(1, abs(curvature)), (name, d.turned)


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_first_derivatives_in_coefficients_and_boxes(name):
    check(name, 3, second=False)


@pytest.mark.parametrize("name", swept([*QUICK, *FURTHER], slow=["cubics"]))
def test_first_and_second_derivatives_in_coefficients_and_boxes(name):
    shapes = [n for s in (BY_NAME[name].a, BY_NAME[name].b) for n in s.coefficients.shape]
    check(name, 3 if max(shapes) <= 3 else 5, second=True)


def pull(found):
    """sum w_k u_k: how fast the distance grows when the point moves and the feet do not."""
    w = found.witness
    apart = w.point - w.feet
    return np.asarray(w.multipliers @ (apart / jnp.linalg.norm(apart, axis=1, keepdims=True)))


def transformed(parameters, found, a, b):
    """The distance after a translation and a linear map of a alone, in the order of the direction."""
    matrix, offset = parameters
    a, b = (ImplicitSurface(*s, reduced=False) for s in (a, b))
    return with_place_derivatives(found, a.transform(matrix, offset), b).value


_transformed = jax.jit(jax.grad(transformed))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_cones", "sphere_ellipsoid"])
def test_moving_a_surface_with_its_box_moves_the_distance_by_the_pull_of_its_feet(name):
    """Exact laws: a translation o of a changes the distance by o.u, clipped or not, a rotation about w by w.(p x u)."""
    d = directions(name)[0]
    found = solution(d)
    surfaces = [tuple(map(jnp.asarray, map(np.asarray, s))) for s in (d.a, d.b)]
    matrix, offset = _transformed((jnp.eye(3), jnp.zeros(3)), found, *surfaces)
    u = pull(found)
    np.testing.assert_allclose(offset, u, atol=_ROUNDING)
    if "smooth" in BY_NAME[name].tags:
        turning = np.asarray(matrix) - np.asarray(matrix).T
        np.testing.assert_allclose(turning, np.outer(u, d.point) - np.outer(d.point, u), atol=_ROUNDING)


def test_numbers_stay_and_nothing_is_done_without_a_derivative():
    d = directions("sphere_ellipsoid")[0]
    found = solution(d)
    surfaces = [ImplicitSurface(*s) for s in (d.a, d.b)]
    assert with_place_derivatives(found, *surfaces) is found
    given = arguments(d, changes(d, 1))
    assert float(jax.jit(value_along)(0.0, *given)) == float(found.value)


def test_distance_zero_has_derivative_zero_and_missing_directions_are_no_nan():
    """On itself a sphere has no derivative; at the apex of a cone the surface has none."""
    d = directions("sphere_ellipsoid")[0]
    found, given, change = arguments(d, changes(d, 2))
    w = found.witness
    zero = found.value * 0
    at_zero = HausdorffSolution(zero, zero, zero, w, found.result, {})
    assert float(_first(0.0, at_zero, given, change)) == 0.0
    cone = directions("paper_cones")[0]
    found, given, change = arguments(cone, changes(cone, 2))
    apex = Witness(
        **{
            **{name: getattr(found.witness, name) for name in found.witness.__dataclass_fields__},
            "point": found.witness.point * 0,
        }
    )
    moved = HausdorffSolution(found.value, found.value, found.value, apex, found.result, {})
    assert np.isfinite(float(_first(0.0, moved, given, change)))
