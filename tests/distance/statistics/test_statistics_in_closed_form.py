"""Measures between shapes of every kind whose distances have closed forms, and their derivatives beside these forms.

Rational arcs, implicit surfaces as targets, and meshes beside meshes, with a kink of the distance across them.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from tests.sweeps import swept

# Of values and derivatives; differences of closed forms hold to 1e-11.
CLOSE, STEP, CENTRAL = 1e-7, 1e-3, {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
SHARE = 0.7
STATISTICS = {
    "mean": jhd.MeanDistance(True),
    "rms": jhd.RMSDistance(True),
    "quantile": jhd.QuantileDistance(SHARE, True),
}


def difference(function):
    return sum(share * (function(k * STEP) - function(-k * STEP)) for k, share in CENTRAL.items()) / STEP


def of_linear(low, high):
    """The measures of a distance that is spread evenly between two numbers, the lower one first."""
    mean = 0.5 * (low + high)
    return {
        "mean": mean,
        "rms": math.sqrt(mean**2 + (high - low) ** 2 / 12),
        "quantile": low + SHARE * (high - low),
    }


def check(pair, exact, names=tuple(STATISTICS)):
    """Values between their bounds, and derivatives, are those of the closed forms of a parameter at zero."""
    for name in names:
        statistic = STATISTICS[name]
        found, value = statistic(*pair(0.0)), exact(0.0)[name]
        assert float(found.lower) <= value * (1 + 1e-14) and value * (1 - 1e-14) <= float(found.upper)
        assert float(found.upper) - float(found.lower) <= 1.1e-3 * value
        assert float(found.value) == pytest.approx(value, rel=CLOSE)
        slope = jax.grad(lambda x, statistic=statistic: statistic.estimate(*pair(x)))(0.0)
        assert float(slope) == pytest.approx(difference(lambda x, name=name: exact(x)[name]), rel=CLOSE)


# Half a circle about the origin, to a point at a distance from there: angles 0 to pi are seen from it.
ARC = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [-1.0, 1.0], [-1.0, 0.0]])
WEIGHTS = np.array([1.0, math.sqrt(0.5), 1.0])
RADIUS, AWAY = (0.8, 0.3), (0.5, -0.7)
NODES, FACTORS = np.polynomial.legendre.leggauss(60)


def arcs(x):
    points = (RADIUS[0] + RADIUS[1] * x) * jnp.asarray(ARC)
    weights = jnp.asarray(np.stack([WEIGHTS, WEIGHTS]))
    center = jnp.stack([AWAY[0] + AWAY[1] * x, jnp.zeros(())])
    return jhd.BezierSegments(jnp.stack([points[:3], points[2:]]), weights), jhd.point_set(center[None])


def from_an_arc(x):
    r, c = RADIUS[0] + RADIUS[1] * x, AWAY[0] + AWAY[1] * x
    angle = 0.5 * math.pi * (NODES + 1)
    return {
        "mean": 0.5 * FACTORS @ np.sqrt(r * r + c * c - 2 * r * c * np.cos(angle)),
        "rms": math.sqrt(r * r + c * c),
        "quantile": math.sqrt(r * r + c * c - 2 * r * c * math.cos(math.pi * SHARE)),
    }


@pytest.mark.exhaustive
def test_a_rational_arc_beside_a_point():
    check(arcs, from_an_arc)


def sphere(radius):
    rows = jnp.zeros((3, 3, 3)).at[2, 0, 0].set(1.0).at[0, 2, 0].set(1.0).at[0, 0, 2].set(1.0)
    return jhd.ImplicitSurface(rows.at[0, 0, 0].set(-(radius**2)), [-3.0] * 3, [3.0] * 3)


def spoke(x):
    ends = jnp.stack([jnp.stack([1.3 + x, 0.0 * x, 0.0 * x]), jnp.stack([2.1 - 0.4 * x, 0.0 * x, 0.0 * x])])
    return jhd.polyline(ends), sphere(0.9 + 0.6 * x)


@pytest.mark.exhaustive
def test_a_segment_towards_the_center_of_a_polynomial_sphere():
    check(spoke, lambda x: of_linear(0.4 + 0.4 * x, 1.2 - x))


@pytest.mark.exhaustive
def test_weighted_points_beside_a_polynomial_sphere():
    rows, counts = np.random.default_rng(0).normal(size=(9, 3)), np.random.default_rng(1).uniform(size=9)
    moves = 0.3 * np.random.default_rng(2).normal(size=(9, 3))

    def pair(x):
        return jhd.point_set(rows + x * moves), sphere(0.9 + 0.6 * x)

    def exact(x):
        d = np.abs(np.linalg.norm(rows + x * moves, axis=1) - (0.9 + 0.6 * x))
        order = np.argsort(d)
        reached = np.searchsorted(np.cumsum(counts[order]), SHARE * np.sum(counts))
        return {
            "mean": np.average(d, weights=counts),
            "rms": math.sqrt(np.average(d**2, weights=counts)),
            "quantile": d[order[reached]],
        }

    for name, statistic in STATISTICS.items():
        found = statistic(*pair(0.0), weights=counts)
        assert float(found.lower) <= exact(0.0)[name] * (1 + 1e-14)
        assert exact(0.0)[name] * (1 - 1e-14) <= float(found.upper) <= float(found.lower) * (1 + 1e-12)
        slope = jax.grad(lambda x, statistic=statistic: statistic.estimate(*pair(x), weights=counts))(0.0)
        assert float(slope) == pytest.approx(difference(lambda x, name=name: exact(x)[name]), rel=1e-9)


FACES = np.array([[0, 1, 2], [0, 2, 3]])
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def mesh(corners, heights):
    return jhd.TriangleMesh(jnp.concatenate([jnp.asarray(corners), jnp.stack(heights)[:, None]], axis=1), FACES)


def over_a_plane(x):
    # Tilted along one side by what its corners rise.
    low, high = 0.3 + 0.5 * x, 0.5 - 0.2 * x
    wide = 6 * SQUARE - 2.5
    return mesh(SQUARE, [low, high, high, low]), mesh(wide, [0.0 * x] * 4)


@pytest.mark.parametrize("name", swept(STATISTICS))
def test_a_tilted_mesh_over_a_flat_one(name):
    check(over_a_plane, lambda x: of_linear(0.3 + 0.5 * x, 0.5 - 0.2 * x), [name])


def under_a_roof(x):
    """A square, and two planes that meet above its middle and fall to both sides."""
    height, fall = 0.9 + 0.4 * x, 0.3 + 0.2 * x
    ridge, low = height, height - 2 * fall
    corners = np.array([[0.5, -2.0], [0.5, 3.0], [2.5, 3.0], [2.5, -2.0], [-1.5, -2.0], [-1.5, 3.0]])
    heights = jnp.stack([ridge, ridge, low, low, low, low])
    roof = jnp.concatenate([jnp.asarray(corners), heights[:, None]], axis=1)
    return mesh(SQUARE, [0.0 * x] * 4), jhd.TriangleMesh(roof, np.array([[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 1]]))


def roofed(x):
    # Beside the middle at |x - 1/2| the distance to a plane that falls so much: twice the same spread.
    height, fall = 0.9 + 0.4 * x, 0.3 + 0.2 * x
    down = 1 / math.sqrt(1 + fall**2)
    return of_linear((height - 0.5 * fall) * down, height * down)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", STATISTICS)
def test_a_mesh_under_a_roof_of_which_it_sees_both_sides(name):
    check(under_a_roof, roofed, [name])


def quarter_cylinder(x):
    """About the z-axis, and a polynomial plane beside which its height falls with the sine of an angle."""
    radius, away = 0.8 + 0.3 * x, 0.2 + 0.5 * x
    rows = [jnp.concatenate([radius * jnp.asarray(ARC[:3]), jnp.full((3, 1), z)], axis=1) for z in (-0.5, 0.6)]
    plane = jnp.zeros((2, 2, 2)).at[0, 1, 0].set(1.0).at[0, 0, 0].set(away)
    return jhd.BezierPatch(jnp.stack(rows), np.stack([WEIGHTS, WEIGHTS])), jhd.ImplicitSurface(
        plane, [-2.0] * 3, [2.0] * 3
    )


def above_a_plane(x):
    radius, away = 0.8 + 0.3 * x, 0.2 + 0.5 * x
    return {
        "mean": 2 * radius / math.pi + away,
        "rms": math.sqrt(0.5 * radius**2 + 4 * radius * away / math.pi + away**2),
        "quantile": radius * math.sin(0.5 * math.pi * SHARE) + away,
    }


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["mean", "rms"])
def test_a_rational_cylinder_above_a_polynomial_plane(name):
    check(quarter_cylinder, above_a_plane, [name])
