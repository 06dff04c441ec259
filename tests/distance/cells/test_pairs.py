"""Bounds over pairs of cells in single precision, where rounding is as large as cells are narrow."""

import jax
import jax.numpy as jnp
import numpy as np

from jhd._distance.cells import pairs
from jhd._distance.cells.pairs import Cell
from jhd._distance.normalization.net_jets import Net

CELLS, DEGREES = 400, (3, 3)


def random_nets(rng, dtype):
    """Pieces within the cube from -1 to 1, weighted little."""
    points = rng.uniform(-1, 1, (CELLS, DEGREES[0] + 1, DEGREES[1] + 1, 3)).astype(np.float32)
    weights = rng.uniform(0.9, 1, points.shape[:-1])
    weights = (weights / weights.max(axis=(1, 2), keepdims=True)).astype(np.float32)
    return Net(jnp.asarray(points, dtype), jnp.asarray(weights, dtype))


def narrow_cells(rng, dtype):
    width = 2.0 ** -rng.integers(0, 16, (CELLS, 1))
    low = np.floor(rng.uniform(0, 1, (CELLS, 4)) / width) * width
    pieces = jnp.arange(CELLS)
    return Cell(pieces, pieces, jnp.asarray(low, dtype), jnp.asarray(low + width, dtype))


@jax.jit
def slopes_in(a, b, cells):
    """The derivatives at the middles of cells, and the bounds of what is wrong in a component of each."""

    def one(cell):
        sides = pairs._sides(a, b, cell)
        return pairs._PairAt.at(sides, cell, 0.5 * (cell.low + cell.high)).slopes, sides.wrong

    return jax.vmap(one)(cells)


def test_derivatives_over_cells_are_as_exact_as_their_bound_says_however_narrow_these_are():
    found = []
    for dtype in (np.float32, np.float64):
        rng = np.random.default_rng(3)
        found.append(slopes_in(random_nets(rng, dtype), random_nets(rng, dtype), narrow_cells(rng, dtype)))
    (slopes, wrong), (exact, _) = found
    off = np.max(np.abs(np.asarray(slopes, np.float64) - exact), axis=-1)
    assert np.all(off <= wrong)
    # Relative to its bound the error is as large in narrow cells as in wide ones.
    assert np.quantile(off / wrong, 0.1) > 1e-6


@jax.jit
def bounds_by_convexity(point, plane, cells, x):
    def one(k, x):
        cell = Cell(0 * k, k, cells.low[k], cells.high[k])
        sides = pairs._sides(point, plane, cell)
        return pairs._by_convexity(sides, pairs._PairAt.at(sides, cell, x))

    return jax.vmap(one)(cells.piece_b, x)


def test_the_bound_by_convexity_is_the_distance_from_rectangles_wherever_it_is_taken():
    rng = np.random.default_rng(6)
    angle, height = rng.uniform(0, 2 * np.pi, CELLS), 0.75
    along = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    across = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    # The point is above the middles, which all cells hold.
    sides = rng.uniform(0.1, 0.5, (CELLS, 2, 1)) * np.stack([along, across], axis=1)
    fractions = np.stack(np.meshgrid([-1, 1], [-1, 1], indexing="ij"), axis=-1) / 2
    plane = Net(jnp.asarray(np.einsum("ijs,ksd->kijd", fractions, sides)), None)
    point = Net(jnp.asarray(np.array([[[[0.0, 0.0, height]]]])), None)
    low, high = rng.uniform(0, 0.4, (CELLS, 2)), rng.uniform(0.6, 1, (CELLS, 2))
    x = low + (high - low) * rng.choice([0.0, 0.3, 0.5, 1.0], (CELLS, 2))
    cells = Cell(jnp.arange(CELLS), jnp.arange(CELLS), jnp.asarray(low), jnp.asarray(high))
    found = np.asarray(bounds_by_convexity(point, plane, cells, jnp.asarray(x)))
    assert np.all(found <= height) and np.all(found >= height - 1e-9)
