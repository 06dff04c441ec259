"""Lower bounds by feet that move over parametric shapes: true against minimized samples, and close for families."""

from functools import partial
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.cells.pairs import Cell, nearest_in
from jhd._distance.cells.tracked_feet import moving_bound
from jhd._distance.normalization.net_jets import Net, jet, part_of
from tests.distance.test_nonisolated_maxima import torus
from tests.sweeps import swept

CELLS = 64
# Samples along each parameter, from which pairs are minimized.
SAMPLES = 6


@jax.jit
def bounds(a, b, cells):
    n = a.parameters
    start = 0.5 * (cells.low + cells.high)[:, n:]
    return jax.vmap(partial(moving_bound, a, b))(cells, jnp.clip(start, 0.0, 1.0))


def lattice(n):
    return jnp.stack(jnp.meshgrid(*[jnp.linspace(0.0, 1.0, SAMPLES)] * n, indexing="ij"), axis=-1).reshape(-1, n)


@jax.jit
def minimized(a, b, cells):
    """The least distance found of the points of pairs of cells."""
    n = a.parameters

    def one(cell):
        parts = (
            part_of(a.piece(cell.piece_a), cell.low[:n], cell.high[:n]),
            part_of(b.piece(cell.piece_b), cell.low[n:], cell.high[n:]),
        )
        points = [jax.vmap(partial(jet, part))(lattice(part.parameters)).point for part in parts]
        far = jnp.sum((points[0][:, None] - points[1][None]) ** 2, axis=-1)
        i, j = jnp.unravel_index(jnp.argmin(far), far.shape)
        start = jnp.concatenate([lattice(n)[i], lattice(b.parameters)[j]])
        x = nearest_in(*parts, start, jnp.zeros(start.shape, bool), 12)
        apart = jet(parts[0], x[:n]).point - jet(parts[1], x[n:]).point
        return jnp.sqrt(jnp.minimum(jnp.min(far), jnp.sum(apart**2)))

    return jax.vmap(one)(cells)


def wavy(rng, pieces, degrees, height, rational, dtype):
    """Random pieces above the unit square, of coordinates below one."""
    u, v = (np.linspace(0, 0.5, d + 1) if d else np.array([0.25]) for d in degrees)
    x, y = np.broadcast_arrays(u[:, None], v[None])
    plane = np.stack([x, y, np.full_like(x, height)], axis=-1)
    points = plane + rng.uniform(-0.06, 0.06, (pieces, *plane.shape))
    weights = rng.uniform(0.4, 1.0, points.shape[:-1]) if rational else None
    return Net(jnp.asarray(points, dtype), None if weights is None else jnp.asarray(weights, dtype))


def random_cells(rng, n, m, sizes, dtype):
    """Pairs of cells about the same parameters, those of b larger; some meet sides of their pieces."""
    middle = rng.uniform(0, 1, (CELLS, max(n, m)))
    size = rng.choice(sizes, CELLS)[:, None]
    a = np.clip(middle[:, None, :n] + size[..., None] * [[-0.5], [0.5]], 0, 1)
    b = np.clip(middle[:, None, :m] + rng.normal(0, 0.1, (CELLS, 1, m)) + 2 * size[..., None] * [[-0.5], [0.5]], 0, 1)
    ends = np.concatenate([a, b], axis=-1).astype(dtype)
    first, second = jnp.asarray(rng.integers(0, 2, (2, CELLS)))
    return Cell(first, second, jnp.asarray(ends[:, 0]), jnp.asarray(ends[:, 1]))


KINDS = {
    "bicubic": ((3, 3), (3, 3), False),
    "rational": ((2, 3), (3, 2), True),
    "of high degree": ((6, 4), (2, 7), True),
    "ruled": ((3, 1), (1, 3), False),
    "curve and surface": ((3, 0), (2, 2), True),
    "surface and curve": ((2, 2), (4, 0), False),
    "curves": ((3, 0), (3, 0), True),
}


# Each kind of nets has a large program, which takes a quarter of a minute to compile.
@pytest.mark.parametrize(
    ("name", "dtype"), swept(product(KINDS, [np.float64, np.float32]), slow=[("surface and curve", np.float64)])
)
def test_bounds_are_below_what_samples_are_minimized_to(name, dtype):
    first, second, rational = KINDS[name]
    rng = np.random.default_rng(len(name))
    useful = 0
    for height in (0.2, 0.05):
        a, b = (wavy(rng, 2, d, z, rational, dtype) for d, z in ((first, height), (second, 0.0)))
        cells = random_cells(rng, a.parameters, b.parameters, (0.5, 0.2, 0.05, 1e-2), dtype)
        found = bounds(a, b, cells)
        wide = [
            jax.tree_util.tree_map(lambda x: jnp.asarray(x, float) if x.dtype == dtype else x, y) for y in (a, b, cells)
        ]
        exact = np.asarray(minimized(*wide))
        # The samples' own roundings.
        assert np.all(np.asarray(found.lower, float) <= exact * (1 + 1e-14) + 1e-15)
        useful += np.sum(np.asarray(found.lower, float) > 0.9 * exact)
    # In single precision the errors of second derivatives leave few of them.
    assert useful > CELLS / 2 or dtype is np.float32


def constant(size, dtype: Any = np.float64):
    """Bounds over cells of tori whose distance is 0.1, and of a part of b about four times as large."""
    nets = [
        Net(jnp.asarray(x.control_points / 2, dtype), jnp.asarray(x.weights, dtype)) for x in (torus(0.3), torus(0.4))
    ]
    rng = np.random.default_rng(7)
    middle = rng.uniform(0.1, 0.9, (CELLS, 2))
    half = 0.5 * size
    ends = [np.clip(np.concatenate([middle + s * half, middle + s * (0.02 + half)], axis=1), 0, 1) for s in (-1, 1)]
    pieces = jnp.asarray(rng.integers(0, 16, CELLS))
    cells = Cell(pieces, pieces, jnp.asarray(ends[0], dtype), jnp.asarray(ends[1], dtype))
    return 2 * np.asarray(bounds(*nets, cells).lower, np.float64)


@pytest.mark.exhaustive
def test_a_constant_distance_is_bounded_to_the_sixth_order():
    short = []
    for size in (0.1, 0.025):
        found = constant(size)
        # Stored arcs are off by their roundings.
        assert np.all(found <= 0.1 + 1e-14)
        short.append(np.median(0.1 - found))
    assert short[1] < short[0] / 1000


@pytest.mark.parametrize("dtype", swept([np.float64, np.float32], slow=1))
def test_where_nothing_is_lost_but_rounding_bounds_are_true_and_close(dtype):
    for size in (1e-2, 1e-3, 1e-4):
        found = constant(size, dtype)
        # Stored in this precision the arcs are off by some of its roundings.
        assert np.all(found <= 0.1 + 8 * np.finfo(dtype).eps)
        # In single precision no cell of b of this size is proven to be one where the distance is convex.
        assert np.median(0.1 - found) < 2e4 * np.finfo(dtype).eps or dtype is np.float32
