"""Bounds by feet that are followed: above every distance in a cell, and close to it where shapes are offsets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._arithmetic import simplices
from jhd._distance.nearest.target import FootRows
from jhd._distance.normalization.net_jets import Net, jet
from jhd._distance.search.followed_cells import FollowedFeet
from jhd._distance.search.on_patches import NetTarget
from jhd._distance.search.sources import CellRows
from tests.sweeps import swept

RNG = np.random.default_rng(3)
ARC = np.array([1, np.sqrt(0.5), 1])
QUARTER = np.array([[1.0, 0], [1, 1], [0, 1]])


def net_of(points, weights):
    return Net(jnp.asarray(points), jnp.asarray(weights))


def quarter_of_a_cylinder(radius):
    """About the z axis, from z = -1 to 1, in a net with weights."""
    points = np.stack([np.append(radius * QUARTER, np.full((3, 1), z), axis=1) for z in (-1.0, 1.0)], axis=1)
    return net_of(points[None], np.stack([ARC, ARC], axis=1)[None])


def bounds(a, b, low, high, start):
    """The bound over one cell of the first pieces."""
    cells = CellRows(np.zeros(1, int), np.array([low], float), np.array([high], float))
    t = np.zeros((1, 1, 2))
    t[0, 0, : len(start)] = start
    feet = FootRows(np.zeros((1, 1, 3)), np.zeros((1, 1)), np.zeros((1, 1), int), t)
    # The first bound below the goal is enough, so that nothing is cut.
    return float(FollowedFeet(a, b, NetTarget(b)).over(cells, feet, 100.0)[0])


@pytest.mark.slow
@pytest.mark.parametrize("shares", [(0.0, 1.0), (0.25, 0.5)])
def test_cylinders_are_as_far_from_each_other_as_their_radii(shares):
    low, high = shares
    a, b = quarter_of_a_cylinder(0.5), quarter_of_a_cylinder(0.75)
    upper = bounds(a, b, [low] * 2, [high] * 2, [0.5, 0.5])
    # The exact distance is a quarter but for the rounding of the weights.
    assert 0.25 * (1 - 1e-15) <= upper
    assert upper - 0.25 < 0.02 * (high - low) ** 6 + 1e-13


def net_of_samples(net, low, high, count):
    """A grid of points (count, count, 3) of the first piece between two ends of its parameters."""
    share = np.linspace(0, 1, count)
    places = np.stack(
        np.meshgrid(*[a + (b - a) * share for a, b in zip(low, high, strict=True)], indexing="ij"), axis=-1
    )
    at = jax.vmap(lambda x: jet(net.piece(jnp.asarray(0)), x).point)
    return np.asarray(at(jnp.asarray(places.reshape(-1, 2)))).reshape(count, count, 3)


@pytest.mark.parametrize("scale", swept([1.0, 1e-3], slow=[1e-3]))
def test_no_distance_in_a_cell_is_above_its_bound(scale):
    flat = np.stack(np.broadcast_arrays(np.linspace(-1, 1, 3)[:, None], np.linspace(-1, 1, 2), 0.0), axis=-1)
    for _ in range(6):
        a, b = (
            net_of((flat + scale * RNG.uniform(-0.5, 0.5, (1, 3, 2, 3))) / 2, 10.0 ** RNG.uniform(-6, 0, (1, 3, 2)))
            for _ in range(2)
        )
        low = RNG.uniform(0, 0.8, 2)
        high = low + RNG.uniform(0, 1, 2) * (1 - low)
        upper = bounds(a, b, low, high, RNG.uniform(0, 1, 2))
        there, fine = net_of_samples(a, low, high, 8), net_of_samples(b, [0, 0], [1, 1], 100)
        near = np.max(np.min(np.linalg.norm(there.reshape(-1, 1, 3) - fine.reshape(1, -1, 3), axis=-1), axis=1))
        # No point of b is farther from a sample than both steps of the grid about it.
        steps = [np.max(np.linalg.norm(np.diff(fine, axis=k), axis=-1)) for k in range(2)]
        assert near - sum(steps) <= upper < 3


def test_products_and_maps_of_polynomials_have_the_values_of_their_parts():
    index, places = simplices.lattice(2, 2), RNG.dirichlet([1.0] * 3, 5)

    def value(f):
        n = f.shape[0] - 1
        at = np.prod(places[:, None] ** simplices.lattice(2, n)[None], axis=-1)
        return np.einsum(
            "pi,i...->p...",
            at * simplices.multinomials(2, n)[tuple(simplices.lattice(2, n)[:, 1:].T)],
            np.asarray(simplices.coefficients_of(2, f)),
        )

    f, g = (simplices.scaled(2, n, jnp.asarray(RNG.uniform(0, 1, (len(simplices.lattice(2, n)), 1)))) for n in (2, 3))
    np.testing.assert_allclose(value(simplices.multiply(2, f, g)), value(f) * value(g), rtol=1e-13)
    rows = RNG.uniform(-1, 1, (3, 1, 1, 1, 1))
    inner = value(f)
    expected = (1 - inner) ** 2 * rows[0, 0, 0] + 2 * inner * (1 - inner) * rows[1, 0, 0] + inner**2 * rows[2, 0, 0]
    one = simplices.constant(2, 2, f)
    np.testing.assert_allclose(
        value(simplices.composed(2, jnp.asarray(rows), f, one - f))[..., 0], expected, rtol=1e-12
    )
    raised = simplices.raising(2, 2, 4) @ np.asarray(simplices.coefficients_of(2, f))[:, 0]
    np.testing.assert_allclose(simplices.lowering(2, 4, 2) @ raised, simplices.coefficients_of(2, f)[:, 0], atol=1e-13)
    at = simplices.inner_lattice(2, 2, 0.125)
    values = np.prod(at[:, None] ** index[None], axis=-1) * [1, 1, 1, 2, 2, 2] @ np.arange(6.0)
    np.testing.assert_allclose(simplices.fitting(2, 2, 0.125) @ values, np.arange(6.0), atol=1e-12)
