"""Lower bounds by feet and multipliers that move, against surfaces whose distance is known at every point."""

import jax
import numpy as np
import pytest

from jhd.distance.cells.moving_pairs import moving_bound
from jhd.distance.frame.surfaces import prepare_surfaces
from jhd.shapes import ImplicitSurface
from tests.sweeps import swept

CELLS = 32
SIZES = (0.2, 0.05)


@jax.jit
def bounds(a, b, low, high, start):
    return jax.vmap(moving_bound, in_axes=(None, None, 0, 0, 0))(a, b, low, high, start)


def sphere(radius, centre=(0.0, 0.0, 0.0)):
    x, y, z = centre
    return f"(x-{x})**2 + (y-{y})**2 + (z-{z})**2 - {radius**2}"


def torus(tube):
    return f"(x**2 + y**2 + z**2 + {1 - tube**2})**2 - 4*(x**2 + y**2)"


# Surfaces a and b, places of a from two angles, the distance of all points of a from b, and half a box about a foot.
FAMILIES = {
    "spheres": (sphere(1), sphere(1.5), lambda s, t: ball(1.0, s, t), 0.5, 0.75),
    "spheres inwards": (sphere(1.5), sphere(1), lambda s, t: ball(1.5, s, t), 0.5, 0.75),
    "cylinders": ("x**2 + y**2 - 1", "x**2 + y**2 - 2.25", lambda s, t: tube(1.0, s, t), 0.5, 0.75),
    "tori": (torus(0.25), torus(0.375), lambda s, t: ring(0.25, s, t), 0.125, 0.15),
}


def ball(radius, s, t):
    return radius * np.stack([np.cos(s) * np.sin(t), np.sin(s) * np.sin(t), np.cos(t)], axis=-1)


def tube(radius, s, t):
    return np.stack([radius * np.cos(s), radius * np.sin(s), np.cos(t)], axis=-1)


def ring(radius, s, t):
    far = 1 + radius * np.cos(t)
    return np.stack([far * np.cos(s), far * np.sin(s), radius * np.sin(t)], axis=-1)


def two(first, second, dtype=np.float64):
    ends = [np.full(3, end, dtype) for end in (-2.0, 2.0)]
    surfaces = [ImplicitSurface.parse(text, *ends) for text in (first, second)]
    return [ImplicitSurface(x.coefficients.astype(dtype), *ends) for x in surfaces]


def bounded(name, size, dtype=np.float64):
    """Bounds over cells of a size about places of a, against b in boxes about their feet, in the unit of the user."""
    first, second, places, exact, wide = FAMILIES[name]
    rng = np.random.default_rng(8)
    x = places(*rng.uniform(0, 2 * np.pi, (2, CELLS)))
    a, b, frame = prepare_surfaces(*two(first, second, dtype))
    scale = 2.0 ** float(frame.first + frame.second)
    low, high = x - size * rng.uniform(0.25, 0.75, x.shape), x + size * rng.uniform(0.25, 0.75, x.shape)
    low, high = np.concatenate([low, x - wide], axis=1), np.concatenate([high, x + wide], axis=1)
    low, high = (np.clip(end, -2.0, 2.0).astype(dtype) / dtype(scale) for end in (low, high))
    return np.asarray(bounds(a, b, low, high, x.astype(dtype) / dtype(scale)).lower, np.float64) * scale, exact


# Each degree and precision has a large program, which takes a quarter of a minute to compile.
@pytest.mark.parametrize("name", swept(FAMILIES))
def test_a_constant_distance_is_bounded_to_the_sixth_order(name):
    short = []
    for size in SIZES:
        found, exact = bounded(name, size)
        assert np.all(found <= exact)
        short.append(np.median(exact - found))
    assert short[1] < short[0] / 500


@pytest.mark.parametrize("dtype", swept([np.float64, np.float32], slow=1))
def test_where_nothing_is_lost_but_rounding_bounds_are_true_and_close(dtype):
    """Cells so small that what is cut off is far below an ulp, so the exact distance leaves no room."""
    for size in (1e-2, 1e-3, 1e-4):
        found, exact = bounded("spheres", size, dtype)
        assert np.all(found <= exact)
        assert np.median(exact - found) < 2e4 * np.finfo(dtype).eps
