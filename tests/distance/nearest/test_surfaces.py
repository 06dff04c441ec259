"""Nearest points of implicit surfaces against closed forms, and how soon they are proven."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.nearest.surfaces import cloud, cover, nearest, nearest_places
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._distance.search.on_surfaces import SurfaceTarget
from jhd._shapes import ImplicitSurface

TORUS = ImplicitSurface.parse("(x^2 + y^2 + z^2 + 0.9375)^2 - 4*x^2 - 4*y^2", [-2.0] * 3, [2.0] * 3)
# Places and distances by roots are off by some units of roundoff.
ROUNDING = 4e-15


def to_torus(x):
    return np.abs(np.hypot(np.hypot(x[..., 0], x[..., 1]) - 1, x[..., 2]) - 0.25)


def places(count):
    """Points anywhere in the box, close to the surface, and where its feet come together."""
    rng = np.random.default_rng(8)
    angle, turn = rng.uniform(0, 2 * np.pi, (2, count))
    out = 0.25 + 2.0 ** -rng.uniform(1, 40, count)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    close = ring * (1 + out * np.cos(turn))[:, None] + np.stack([0 * turn, 0 * turn, out * np.sin(turn)], axis=1)
    near_axis = rng.normal(size=(count, 3)) * 2.0 ** -rng.uniform(3, 30, (count, 1))
    return np.concatenate([rng.uniform(-1.9, 1.9, (count, 3)), close, ring + near_axis])


@pytest.mark.exhaustive
def test_distances_from_a_torus_hold_at_all_places():
    points = places(8)[:17]
    found = SurfaceTarget(TORUS).nearest(points)
    exact = to_torus(points)
    assert np.all(found.lower <= exact + ROUNDING) and np.all(found.upper >= exact - ROUNDING)
    assert np.all(found.closed[:16])


@pytest.mark.slow
def test_feet_are_bounds_and_mostly_nearest():
    points = places(40)
    upper, exact = SurfaceTarget(TORUS).feet(points), to_torus(points)
    assert np.all(upper >= exact - ROUNDING)
    assert np.count_nonzero(upper <= exact + 1e-9) > 80


@pytest.mark.slow
def test_a_foot_is_proven_to_be_the_nearest_before_cells_are_small():
    side, _, frame = prepare_surfaces(TORUS, TORUS)
    scale = 2.0 ** float(frame.first + frame.second)

    limits = jnp.asarray(-jnp.inf), jnp.asarray(1e-12)

    @jax.jit
    def steps(points):
        low, points_of = cover(side), cloud(side)
        one = lambda p: nearest(side, low, p, nearest_places(points_of, p), *limits)  # noqa: E731
        return jax.lax.map(one, points).steps

    # The cells that are cut by halves alone have sides below 1e-6 when they are that good, after 18 steps and more.
    assert int(np.max(steps(places(8)[:8] / scale))) <= 10


def cusp():
    """The surface z^2 = x^3, of which the y-axis is an edge."""
    coefficients = np.zeros((4, 1, 3))
    coefficients[3, 0, 0], coefficients[0, 0, 2] = -1, 1
    return ImplicitSurface(coefficients, (-2, -2, -2), (2, 2, 2))


@pytest.mark.slow
def test_the_surface_is_as_near_to_feet_as_they_say():
    # Beside the edge the foot that is taken need not be the place by which the distance is proven.
    target, heights = SurfaceTarget(cusp()), np.random.default_rng(1).normal(size=60) * 1e-3
    queries = np.stack([0 * heights, 0 * heights, heights], axis=1)
    for found in (target.nearest(queries), target.near(queries)):
        foot, root = found.foot, np.cbrt(found.foot[:, 2])
        # Of points (t^2, t^3) of the curve one is as near as this.
        roots = root, np.sign(root) * np.sqrt(np.abs(foot[:, 0])), 0 * root
        away = np.min([np.hypot(t**2 - foot[:, 0], t**3 - foot[:, 2]) for t in roots], axis=0)
        assert np.all(away <= target.error(found))
        assert np.all((found.lower <= found.distance) & (found.distance <= found.upper))


@pytest.mark.slow
def test_bounds_at_a_cuspidal_edge_are_as_near_as_signs_tell():
    # No gradient leads to the edge, and signs beside it are rounding up to about 1e-5.
    surface = cusp()
    found = jhd.project([(-1, 0.2, 0.3), (-0.5, 0.1, -0.7)], surface, throw=False)
    exact = np.hypot([1, 0.5], [0.3, 0.7])
    assert np.all(found.lower <= exact) and np.all(exact <= found.upper) and np.all(found.upper < found.lower + 1e-4)
