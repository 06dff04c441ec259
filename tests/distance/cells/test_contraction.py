"""Narrowed cells hold every point of the surface that the cell held, to the last bit, and are as small as its part."""

import jax
import numpy as np
import pytest

from jhd._distance.cells.tracked_feet_surfaces import narrowed
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._shapes import ImplicitSurface

CASES = 2000


def side(coefficients, dtype):
    """A surface in a box that needs no scaling."""
    ends = [np.full(3, end, dtype) for end in (-1.0, 1.0)]
    first, _, frame = prepare_surfaces(*[ImplicitSurface(coefficients.astype(dtype), *ends, reduced=False)] * 2)
    scale = 2.0 ** float(frame.first + frame.second)
    return first, scale


@jax.jit
def narrow(surface, coefficients, low, high):
    one = lambda c, x, y: narrowed(surface._replace(coefficients=c), x, y)  # noqa: E731
    return jax.vmap(one)(coefficients, low, high)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_plane_through_an_edge_of_a_cell_is_kept_and_nothing_beyond(dtype):
    """All numbers are of few bits, so that the planes hold their points exactly; these are ends of what is left."""
    rng = np.random.default_rng(5)
    normal = rng.integers(1, 16, (CASES, 3)) / 16.0
    low = rng.integers(-64, 32, (CASES, 3)) / 64.0
    high = low + rng.integers(2, 32, (CASES, 3)) / 64.0
    # Two coordinates are those of a corner: with a normal that points away from it no point of the plane has more.
    place = low + (high - low) * rng.integers(1, 64, (CASES, 3)) / 64.0
    axis = rng.integers(0, 3, CASES)
    place = np.where(np.arange(3) == axis[:, None], place, low)
    coefficients = np.zeros((CASES, 3, 3, 3))
    coefficients[:, 1, 0, 0], coefficients[:, 0, 1, 0], coefficients[:, 0, 0, 1] = normal.T
    coefficients[:, 0, 0, 0] = -np.sum(normal * place, axis=1)
    surface, scale = side(coefficients[0], dtype)
    # In the unit of the surface, to which its coefficients have moved too: the same polynomial times a number.
    powers = scale ** np.indices((3, 3, 3)).sum(axis=0)
    exact = (coefficients * powers).astype(dtype)
    first, last = narrow(surface, exact, (low / scale).astype(dtype), (high / scale).astype(dtype))
    first, last = np.asarray(first, float) * scale, np.asarray(last, float) * scale
    assert np.all(first <= place) and np.all(place <= last)
    end = np.take_along_axis(last - place, axis[:, None], axis=1)
    assert np.max(end) < 1e4 * np.finfo(dtype).eps
    # Stored with errors that are known of, they hold the same points.
    known = np.zeros((3, 3, 3))
    known[0, 0, 0] = 2.0**-12
    wrong = (exact + known * rng.choice([-1, 1], (CASES, 1, 1, 1))).astype(dtype)
    known = np.asarray(surface.error) + known.astype(dtype)
    ends = (low / scale).astype(dtype), (high / scale).astype(dtype)
    first, last = narrow(surface._replace(error=known), wrong, *ends)
    assert np.all(np.asarray(first, float) * scale <= place) and np.all(place <= np.asarray(last, float) * scale)


@pytest.mark.parametrize("at_inner_corner", [True, False])
def test_a_part_of_a_sphere_at_a_corner_leaves_little_and_holds_all_of_its_points(at_inner_corner):
    ball = np.zeros((3, 3, 3))
    ball[2, 0, 0] = ball[0, 2, 0] = ball[0, 0, 2] = 1.0
    ball[0, 0, 0] = -0.25
    surface, scale = side(ball, np.float64)
    rng = np.random.default_rng(6)
    points = rng.normal(size=(40, 3))
    points *= 0.5 / np.linalg.norm(points, axis=1, keepdims=True)
    size = 10 ** rng.uniform(-4, -0.5, (40, 1))
    # The corner nearest to the origin is just inside of the sphere, or the farthest one just outside.
    away = np.sign(points)
    inner, outer = points * (1 - 0.02 * size), points + size * away
    if not at_inner_corner:
        inner, outer = points - size * away, points * (1 + 0.02 * size)
    low, high = np.minimum(inner, outer), np.maximum(inner, outer)
    many = np.broadcast_to(np.asarray(surface.coefficients), (40, *surface.coefficients.shape))
    first, last = (np.asarray(x) * scale for x in narrow(surface, many, low / scale, high / scale))
    for k in range(40):
        near = points[k] + size[k] * rng.uniform(-1, 1, (20000, 3))
        near *= 0.5 / np.linalg.norm(near, axis=1, keepdims=True)
        inside = near[np.all((near > low[k]) & (near < high[k]), axis=1)]
        # These points are within some roundings of the sphere.
        assert np.all(inside >= first[k] - 1e-15) and np.all(inside <= last[k] + 1e-15)
    small = size[:, 0] < 0.05
    share = np.prod((last - first) / (high - low), axis=1)
    assert np.median(share[small]) < 0.05


def test_cells_without_a_slope_or_without_the_surface_stay_as_they_are():
    flat = np.zeros((3, 3, 3))
    flat[2, 0, 0] = flat[0, 2, 0] = flat[0, 0, 2] = 1.0
    flat[0, 0, 0] = -0.25
    surface, _ = side(flat, np.float64)
    low, high = np.array([[-0.125] * 3, [0.03125] * 3]), np.array([[0.125] * 3, [0.0625] * 3])
    many = np.broadcast_to(np.asarray(surface.coefficients), (2, *surface.coefficients.shape))
    first, last = narrow(surface, many, low, high)
    np.testing.assert_array_equal(first, low)
    np.testing.assert_array_equal(last, high)
