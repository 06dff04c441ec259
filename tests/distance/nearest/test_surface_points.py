"""Points of implicit surfaces: local feet against dense samples, and where faces of the box hold them or let go."""

from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.nearest.surface_points import local_feet
from jhd._distance.normalization.surfaces import Side
from jhd._runtime.compiled import compiled
from tests.surface_cases import BY_NAME, X, Y, Z, surface
from tests.surface_reference import cloud, values

# Steps of Newton's method, enough from anywhere.
_STEPS = 16
# What so many halvings of steps of order one leave of a distance, which is of second order in them.
_CREPT = 4.0**-_STEPS * 100
_feet = compiled(partial(local_feet, steps=_STEPS))


def feet(b, points, starts):
    """The feet of points on b that are found from starts."""
    f = np.pad(b.coefficients, [(0, 5 - n) for n in b.coefficients.shape])
    side = Side(f, np.zeros_like(f), np.array(b.lower, float), np.array(b.upper, float), np.zeros((3, 3, 3), bool))
    return np.asarray(_feet(side, jnp.asarray(points.T), jnp.asarray(starts.T))).T


@pytest.mark.parametrize("name", ["paper_cones", "hyperboloid_cylinder"])
def test_feet_are_nearest_points(name):
    """No point of a dense sample is nearer than the foot that starts from the nearest one, and all feet are found."""
    generator = np.random.default_rng(5)
    for b in (BY_NAME[name].a, BY_NAME[name].b):
        sample = cloud(b, 24)
        points = generator.uniform(b.lower, b.upper, (256, 3))
        distances = np.linalg.norm(points[:, None] - sample, axis=2)
        foot = feet(b, points, sample[np.argmin(distances, axis=1)])
        assert np.all(np.linalg.norm(foot - points, axis=1) <= distances.min(axis=1) + 1e-12)
        assert np.max(np.abs(values(b.coefficients, foot))) <= 1e-12
        assert np.all((foot >= b.lower) & (foot <= b.upper))


def test_feet_at_a_face_that_the_surface_touches():
    """A cylinder with its face on x = 3/2, from points outside and inside, from starts on the face and off it.

    Steps along the face creep, halving what is left, so the distance is near its end long before the foot is.
    """
    b = surface(X**2 + Z**2 - 2.25, (-2, -2, -2), (1.5, 2, 2))
    starts = np.array([[1.2, 0.3, 0.9], [1.5, 0.01, 0.01], [1.5, 0.3, 0.2], [1.49, 0.0, 0.1], [0.3, 1, 1.47]])
    points = np.repeat([[2.0, 0.1, 0.0], [1.0, 0.1, 0.0]], 5, axis=0)
    found = feet(b, np.resize(points, (256, 3)), np.resize(np.tile(starts, (2, 1)), (256, 3)))
    distances = np.linalg.norm(found - np.resize(points, (256, 3)), axis=1)
    np.testing.assert_allclose(distances, 0.5, atol=_CREPT)
    assert np.all(found <= 1.5) and np.max(np.abs(values(b.coefficients, found))) <= 1e-12


def test_faces_hold_and_let_go():
    """Feet on a face, an edge and inside, from starts elsewhere on the box."""
    b = surface(Z - X * Y * 0.25, 1)
    points = np.array([[2.0, 0.2, 0.1], [1.5, 1.5, 0.5], [0.25, 0.25, 0.5], [-3.0, 0.5, 2.0]])
    starts = np.array([[-1.0, 1, -0.25], [1, -1, -0.25], [1, 1, 0.25], [1, 1, 0.25]])
    foot = feet(b, np.resize(points, (256, 3)), np.resize(starts, (256, 3)))[:4]
    assert foot[0, 0] == 1 and (foot[1, :2] == 1).all() and (np.abs(foot[2]) < 0.5).all() and foot[3, 0] == -1
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 401)] * 2, indexing="ij"), axis=-1)
    sample = np.concatenate([grid, grid[..., :1] * grid[..., 1:] / 4], axis=-1).reshape(-1, 3)
    for point, place in zip(points, foot, strict=True):
        assert np.linalg.norm(place - point) <= np.min(np.linalg.norm(sample - point, axis=1)) + 1e-12
