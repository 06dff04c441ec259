"""Heights of cells above pieces: in single precision beside double, and the distances that they bound from below."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._arithmetic.balls import Ball
from jhd._arithmetic.bernstein import basis
from jhd._arithmetic.simplices import lattice, multinomials
from jhd._distance.cells.foot_maps import part_over
from jhd._distance.cells.normal_offset_bounds import growth_beyond, heights_between, valley
from jhd._distance.normalization.net_jets import Net
from tests.sweeps import swept

CELLS, PLACES = 16, 200
# Of patches, and of a curve.
DEGREES = [(3, 3), (2, 2), (3, 0)]


def values(k, n, coefficients, places):
    """Polynomials (indices, cells) at barycentric coordinates (places, k + 1)."""
    at = lattice(k, n)
    table = np.prod(places[:, None] ** at[None], axis=2) * [multinomials(k, n)[tuple(i[1:])] for i in at]
    return table @ coefficients


def points(net, x):
    """Points (cells, places, 3) of one piece for each cell at parameters (cells, places, parameters)."""
    rows, weights = np.asarray(net.points, float), np.ones(net.points.shape[:3])
    if net.weights is not None:
        weights = np.asarray(net.weights, float)
    p, q = net.degrees
    u = basis(p, x[..., 0])
    v = basis(q, x[..., 1]) if q else np.ones((*x.shape[:2], 1))
    w = np.einsum("ncp,ncq,npq->nc", u, v, weights)
    return np.einsum("ncp,ncq,npq,npqd->ncd", u, v, weights, rows) / w[..., None]


def piece(random, degrees, rational, dtype):
    """Gently curved pieces, one for each cell, the largest weight of each in [1/2, 1)."""
    p, q = degrees
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, p + 1), np.linspace(-0.5, 0.5, q + 1) if q else [0.0], indexing="ij")
    rows = np.stack([x, y, 0.3 * x * x - 0.2 * y * y], axis=-1) + 0.05 * random.normal(size=(CELLS, p + 1, q + 1, 3))
    weights = random.uniform(0.4, 0.99, rows.shape[:3]) if rational else None
    return Net(rows.astype(dtype), None if weights is None else weights.astype(dtype))


def cells_and_maps(random, k, n, dtype):
    """Corners of small simplices of parameters, and maps of them that go a little beyond the sides."""
    size = 10.0 ** random.uniform(-2, -0.7, (CELLS, 1, 1))
    corners = random.uniform(0.2, 0.8, (CELLS, 1, k)) + size * random.uniform(-1, 1, (CELLS, k + 1, k))
    middle = random.uniform(-0.1, 1.1, (CELLS, 1, n))
    sigma = middle + size * random.uniform(-1, 1, (CELLS, len(lattice(k, 2)), n))
    return corners.astype(dtype), sigma.astype(dtype)


@pytest.mark.parametrize(
    ("degrees", "rational", "source"),
    swept(
        itertools.product(DEGREES, [False, True], [(1, 1), (2, 0)]),
        quick=[((3, 3), True, (1, 1))],
        slow=[((2, 2), False, (2, 0)), ((3, 0), False, (1, 1))],
    ),
)
def test_heights_in_single_precision_are_within_their_errors(degrees, rational, source):
    random, dtype = np.random.default_rng(sum(degrees) + 10 * rational), np.float32
    a, b = piece(random, source, rational, dtype), piece(random, degrees, rational, dtype)
    k, n = a.parameters, b.parameters
    corners, sigma = cells_and_maps(random, k, n, dtype)
    normal = np.array([0.1, -0.2, 1.0]) / np.sqrt(1.05) + 0.1 * random.normal(size=(CELLS, 3))
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(dtype)

    def heights(a, b, corners, sigma, normal):
        growth = jax.vmap(lambda net, x: growth_beyond(net, jnp.min(x, axis=0), jnp.max(x, axis=0)))(b, sigma)
        inner, complement, feet = (jnp.moveaxis(x, 0, -1) for x in (corners, 1 - corners, sigma))
        parts = part_over(k, a, inner, complement), part_over(k, b, feet, 1 - feet)
        return heights_between(k, *parts, sum(a.degrees) + sum(b.degrees), growth, normal.T)

    found = jax.tree_util.tree_map(np.asarray, jax.jit(heights)(a, b, corners, sigma, normal))
    degree = next(n for n in range(40) if len(lattice(k, n)) == len(found.height))
    places = random.dirichlet(np.ones(k + 1), PLACES)
    u = np.einsum("sk,ckp->csp", places, corners.astype(float))
    v = np.moveaxis(values(k, 2, sigma.astype(float).transpose(1, 0, 2).reshape(-1, CELLS * n), places), 0, 1)
    e = points(a, u) - points(b, v.reshape(CELLS, n, PLACES).transpose(0, 2, 1))
    height = np.einsum("csd,cd->cs", e, normal.astype(float))
    aside = np.linalg.norm(e - height[..., None] * normal[:, None], axis=2)
    error = found.error.astype(float)[:, None]
    off = np.abs(height - values(k, degree, found.height.astype(float), places).T)
    assert np.all(off <= error) and np.all(aside <= found.aside.astype(float)[:, None] + error)
    assert np.all(np.isfinite(error)) and np.median(off / error) > 1e-5
    # The mean of samples is within some standard errors.
    spread = 6 * np.std(aside**2, axis=1) / PLACES**0.5
    assert np.all(np.mean(aside**2, axis=1) <= found.aside_sq + spread + error[:, 0] * (2 * found.aside + error[:, 0]))


@pytest.mark.parametrize(
    ("degrees", "rational"),
    swept(itertools.product(DEGREES, [False, True]), quick=[((3, 3), True)], slow=[((3, 0), False)]),
)
def test_no_point_of_a_valley_is_nearer_than_its_slope_at_the_feet_allows(degrees, rational):
    random = np.random.default_rng(5)
    b = piece(random, degrees, rational, float)
    n = b.parameters
    middle = random.uniform(0.2, 0.8, (CELLS, n))
    half = 10.0 ** random.uniform(-2, -0.7, (CELLS, 1))
    low, high = middle - half, middle + half
    # Points beside the middle, and parameters that are no feet of theirs, quite.
    cell = points(b, middle[:, None])[:, 0] + 0.3 * half * random.normal(size=(CELLS, 3))
    wide = 0.1 * half * np.ones(3)
    feet = middle[:, None] + 0.3 * half[:, None] * random.uniform(-1, 1, (CELLS, 3, n))
    normal = random.normal(size=(CELLS, 3)) * [0.1, 0.1, 0] + [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = jax.jit(jax.vmap(valley))(b, low, high, feet, normal, Ball(jnp.asarray(cell), jnp.asarray(wide)))
    steep, tilt, modulus = (np.asarray(x) for x in found)
    known = np.flatnonzero(modulus > 0)
    assert len(known) > CELLS / 4
    place = cell[:, None] + wide[:, None] * random.uniform(-1, 1, (CELLS, PLACES, 3))
    shares = random.dirichlet(np.ones(3), (CELLS, PLACES))
    e = place - points(b, np.einsum("csk,ckn->csn", shares, feet))
    height = np.einsum("csd,cd->cs", e, normal)
    aside = np.linalg.norm(e - height[..., None] * normal[:, None], axis=2)
    loss = (steep[:, None] * aside + tilt[:, None] * np.abs(height)) ** 2 / np.maximum(modulus, 1e-300)[:, None]
    squares = np.full((CELLS, PLACES), np.inf)
    for _ in range(40):
        x = low[:, None] + (high - low)[:, None] * random.uniform(0, 1, (CELLS, PLACES, n))
        squares = np.minimum(squares, np.sum((place - points(b, x)) ** 2, axis=2))
    assert np.all(squares[known] >= (np.sum(e**2, axis=2) - loss)[known] - 1e-12)
    # It is no bound that says nothing: at some places more than nothing is known.
    assert np.any((np.sum(e**2, axis=2) - loss)[known] > 0.5 * squares[known])
