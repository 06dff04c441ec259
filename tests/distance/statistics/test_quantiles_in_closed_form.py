"""Quantiles of the distance over a plane patch beside what meets it: areas in closed form, slopes by their differences.

From a parallelogram the distances to a line, a plane and a cylinder lie below a level where a quadratic form of both
parameters does between two numbers, or a linear one. Along a line of one parameter that is an interval in closed form,
and between the places where such intervals begin, end or leave the patch rules with doubled ends integrate it to
rounding, so that differences of levels tell derivatives to ten digits.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd

NODES, FACTORS = np.polynomial.legendre.leggauss(40)
# Both ends are doubled: intervals begin with the root of the distance from there.
SHARES = np.sin(np.pi * (NODES + 1) / 4) ** 2
WEIGHTS = np.pi / 4 * FACTORS * np.sin(np.pi * (NODES + 1) / 2)
HALVINGS, STEP, CENTRAL = 60, 1e-4, {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
# Of the derivative, beside differences that hold to 1e-11.
CLOSE = 1e-8

CORNER, FIRST, SECOND = np.array([-0.7, -0.6, 0.15]), np.array([1.3, -0.1, 0.15]), np.array([0.08, 1.26, 0.25])
CORNER_MOVES, FIRST_MOVES, SECOND_MOVES = np.array([[0.3, -0.2, 0.5], [-0.2, 0.8, -0.8], [-0.7, 0.3, -0.3]])
CENTER, CENTER_MOVES = np.array([0.0, 0.05, -0.6]), np.array([0.0, 0.3, 0.4])
NORMAL = np.array([0.2, 0.3, 1.0]) / np.linalg.norm([0.2, 0.3, 1.0])
ACROSS = np.eye(3)[1:]


def roots(a, b, c):
    """Real roots of a x^2 + b x + c."""
    if abs(a) <= 1e-14 * max(abs(b), abs(c)):
        return [-c / b] if b else []
    inside = b * b - 4 * a * c
    half = -0.5 * (b + np.copysign(np.sqrt(max(inside, 0.0)), b))
    return [] if inside < 0 else [half / a, c / half]


def area(form, level):
    """Of the unit square, where a u^2 + b u v + c v^2 + d u + e v + f, with a >= 0, is at most the level."""
    a, b, c, d, e, f = form[:5] + (form[5] - level,)
    ends = [
        0,
        1,
        *roots(c, e, f),
        *roots(c, e + b, f + a + d),
        *roots(b * b - 4 * a * c, 2 * b * d - 4 * a * e, d * d - 4 * a * f),
    ]
    ends = np.array(sorted(x for x in ends if 0 <= x <= 1))
    size = np.diff(ends)
    v, factor = (ends[:-1, None] + size[:, None] * SHARES).ravel(), (size[:, None] * WEIGHTS).ravel()
    slope, rest = b * v + d, c * v * v + e * v + f
    if a == 0:
        at = np.clip(-rest / slope, 0, 1)
        return factor @ np.where(slope > 0, at, 1 - at)
    inside = slope**2 - 4 * a * rest
    root = np.sqrt(np.maximum(inside, 0))
    low, high = (np.clip((-slope + sign * root) / (2 * a), 0, 1) for sign in (-1, 1))
    return factor @ (high - low)


def form_of(x, across, center):
    """The squared length of what a matrix takes of the way from a center to the places of the patch."""
    edges = FIRST + x * FIRST_MOVES, SECOND + x * SECOND_MOVES
    at, u, v = (across @ way for way in (CORNER + x * CORNER_MOVES - center, *edges))
    return u @ u, 2 * u @ v, v @ v, 2 * at @ u, 2 * at @ v, at @ at


def plane_form(x, height):
    edges = FIRST + x * FIRST_MOVES, SECOND + x * SECOND_MOVES
    return 0, 0, 0, *(NORMAL @ edge for edge in edges), NORMAL @ (CORNER + x * CORNER_MOVES) - height


def level_of(below, share):
    low, high = 0.0, 8.0
    for _ in range(HALVINGS):
        level = 0.5 * (low + high)
        low, high = (level, high) if below(level) < share else (low, level)
    return low


def patch(x):
    corner, first, second = (
        a + x * b for a, b in ((CORNER, CORNER_MOVES), (FIRST, FIRST_MOVES), (SECOND, SECOND_MOVES))
    )
    return jhd.BezierPatch(jnp.array([[corner, corner + second], [corner + first, corner + first + second]]))


def line(x):
    center = CENTER + np.array([0, 0, 0.85]) + x * CENTER_MOVES
    return jhd.polyline(jnp.array([center - 3 * jnp.eye(3)[0], center + 3 * jnp.eye(3)[0]]))


def below_line(x):
    form = form_of(x, ACROSS, CENTER + np.array([0, 0, 0.85]) + x * CENTER_MOVES)
    return lambda level: area(form, level**2)


def tilted(x):
    """Two large triangles, of which one passes through the patch."""
    beside = np.cross(NORMAL, [1, 0.2, 0.3])
    other = np.cross(NORMAL, beside)
    corners = np.array([-beside - other, 3 * beside - other, 3 * other - beside]) * 8
    return jhd.TriangleMesh(jnp.asarray(corners) + (0.3 + x) * NORMAL, np.array([[0, 1, 2]]))


def below_plane(x):
    form = plane_form(x, 0.3 + x)
    return lambda level: area(form, level) - area(form, -level)


def cylinder(x):
    """The upper half of one about the first axis, which cuts the patch along a curve."""
    quarter = jnp.array([(1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    rows = jnp.stack([quarter, jnp.stack([-quarter[:, 1], quarter[:, 0]], axis=1)]) * (0.95 + 0.5 * x)
    ends = [jnp.concatenate([jnp.full((2, 3, 1), end), rows], axis=2) for end in (-3.0, 3.0)]
    weights = np.broadcast_to([1, np.sqrt(0.5), 1], (2, 2, 3))
    return jhd.BezierPatches(jnp.stack(ends, axis=1) + (CENTER + x * CENTER_MOVES), weights)


def below_cylinder(x):
    form, radius = form_of(x, ACROSS, CENTER + x * CENTER_MOVES), 0.95 + 0.5 * x
    return lambda level: area(form, (radius + level) ** 2) - (level < radius) * area(form, (radius - level) ** 2)


def test_areas_below_quadratic_forms_are_those_of_discs():
    assert area((1, 0, 1, -1, -1, 0.5), 0.16) == pytest.approx(np.pi * 0.16, rel=1e-14)
    assert area((0, 0, 0, 1, 2, 0), 1) == pytest.approx(0.25, rel=1e-14)


@pytest.mark.parametrize(
    ("other", "below", "q"),
    [
        pytest.param(line, below_line, 0.7, marks=pytest.mark.exhaustive, id="line"),
        pytest.param(tilted, below_plane, 0.7, marks=pytest.mark.exhaustive, id="mesh"),
        pytest.param(cylinder, below_cylinder, 0.7, marks=pytest.mark.exhaustive, id="rational patches"),
    ],
)
def test_quantiles_beside_what_meets_a_patch_are_those_in_closed_form_and_so_are_derivatives(other, below, q):
    def exact(x):
        return level_of(below(x), q)

    value, slope = jax.value_and_grad(lambda x: jhd.QuantileDistance(q, True).estimate(patch(x), other(x)))(0.0)
    assert float(value) == pytest.approx(exact(0.0), rel=1e-12)
    differences = sum(factor * (exact(k * STEP) - exact(-k * STEP)) for k, factor in CENTRAL.items()) / STEP
    assert float(slope) == pytest.approx(differences, abs=CLOSE)
