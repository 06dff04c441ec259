"""Bounds over pairs of cells in single precision, where rounding is as large as cells are narrow."""

import jax
import jax.numpy as jnp
import numpy as np

from jhd.distance.cells import pairs
from jhd.distance.cells.pairs import Cell
from jhd.distance.normalization.net_jets import Net

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
