"""Bounds by feet that move, against surfaces whose distance is known at every point."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._arithmetic.polynomials import jets
from jhd._distance.cells.tracked_feet_upper import moving_bounds
from jhd._distance.nearest.forms import boxes, form
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._shapes import ImplicitSurface
from tests.sweeps import swept

CELLS = 32
# Coefficients of the polynomials are rounded, and so are the places that they are measured at.
ROUNDING = 4e-15


@jax.jit
def bounds(a, b, low, high, foot):
    cells = boxes(low, high)
    return moving_bounds(form(a, cells), a, b, cells, foot)


def sphere(radius, center=(0.0, 0.0, 0.0)):
    x, y, z = center
    return f"(x-{x})**2 + (y-{y})**2 + (z-{z})**2 - {radius**2}"


def torus(tube):
    return f"(x**2 + y**2 + z**2 + {1 - tube**2})**2 - 4*(x**2 + y**2)"


def to_sphere(radius, center=(0.0, 0.0, 0.0)):
    return lambda x: np.abs(np.linalg.norm(x - np.array(center), axis=-1) - radius)


def to_torus(tube):
    return lambda x: np.abs(np.hypot(np.hypot(x[..., 0], x[..., 1]) - 1, x[..., 2]) - tube)


def to_square(x):
    """The plane z = 0 within |x|, |y| <= 1/2."""
    return np.linalg.norm(np.concatenate([np.maximum(np.abs(x[..., :2]) - 0.5, 0), x[..., 2:]], axis=-1), axis=-1)


@jax.jit
def on(coefficients, x):
    """Points of the surface near others."""

    def back(_, x):
        value, gradient, _ = jets(coefficients, x)
        return x - value * gradient / jnp.sum(gradient**2, axis=0)

    return jax.lax.fori_loop(0, 12, back, x.T).T


def measured(a, b, distance, size, rng):
    """Bounds over cells of a size, and the largest of the distances of some points of a in each."""
    start = np.asarray(on(a.coefficients, rng.uniform(-1, 1, (CELLS, 3))))
    low = start - size * rng.uniform(0, 1, (CELLS, 3))
    side_a, side_b, frame = prepare_surfaces(a, b)
    scale = 2.0 ** float(frame.first + frame.second)
    found = np.asarray(bounds(side_a, side_b, low.T / scale, (low + size).T / scale, start.T / scale)) * scale
    more = np.asarray(on(a.coefficients, rng.uniform(low, low + size, (40, CELLS, 3)).reshape(-1, 3)))
    x = np.concatenate([more.reshape(40, CELLS, 3), start[None]])
    inside = np.all((x >= low) & (x <= low + size), axis=-1)
    return found, np.max(np.where(inside, distance(x), 0.0), axis=0)


FAMILIES = {
    "torus": (torus(0.3), torus(0.4), to_torus(0.4)),
    "sphere": (sphere(1), sphere(1.25), to_sphere(1.25)),
    "close": (sphere(1), sphere(1 + 2**-20), to_sphere(1 + 2**-20)),
    "moved": (torus(0.25), sphere(1.5, (0.25, 0.0, -0.125)), to_sphere(1.5, (0.25, 0.0, -0.125))),
}


def two(name):
    first, second, distance = FAMILIES[name]
    a, b = (ImplicitSurface.parse(text, [-2.0] * 3, [2.0] * 3) for text in (first, second))
    return a, b, distance


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["sphere", "torus"])
def test_a_constant_distance_is_bounded_to_the_sixth_order(name):
    rng = np.random.default_rng(5)
    gaps = []
    for size in (0.1, 0.025):
        found, exact = measured(*two(name), size, rng)
        assert np.all(found >= exact - ROUNDING)
        gaps.append(np.median(found - exact))
    assert gaps[1] < gaps[0] / 500


@pytest.mark.parametrize("name", swept(FAMILIES, slow=["torus"]))
def test_bounds_are_true_at_all_sizes(name):
    rng = np.random.default_rng(7)
    for size in 2.0 ** -np.arange(2, 40, 3):
        found, exact = measured(*two(name), size, rng)
        assert np.all(found >= exact - ROUNDING)


@pytest.mark.slow
def test_feet_on_the_border_of_a_box_stay_in_it():
    a = ImplicitSurface.parse("z - 1 + 0.5*x**2", [-2.0] * 3, [2.0] * 3)
    b = ImplicitSurface.parse("z + 0*x**2", [-0.5, -0.5, -1.0], [0.5, 0.5, 1.0])
    rng = np.random.default_rng(6)
    known = 0
    for size in (0.1, 1e-3, 1e-6):
        found, exact = measured(a, b, to_square, size, rng)
        assert np.all(found >= exact - ROUNDING)
        known += np.count_nonzero(found < exact + 2 * size)
    assert known > CELLS


@pytest.mark.slow
def test_a_cell_that_a_crosses_twice_has_no_bound():
    a, b = (ImplicitSurface.parse(sphere(r), [-2.0] * 3, [2.0] * 3) for r in (0.25, 1.0))
    side_a, side_b, _ = prepare_surfaces(a, b)
    low = np.full((3, CELLS), -0.2)
    assert np.all(np.isinf(bounds(side_a, side_b, low, -low, low)))
