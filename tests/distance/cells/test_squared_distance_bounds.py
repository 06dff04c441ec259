"""Bounds of distances by Bernstein coefficients of squares, against exact arithmetic and dense samples."""

from fractions import Fraction
from math import comb

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._arithmetic.trivariate import bernstein_conversion
from jhd._distance.cells.squared_distance_bounds import distances_by_squares
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.nets import net_of
from jhd._distance.search import on_patches
from jhd._distance.search.on_patches import NetTarget
from tests.distance.test_nonisolated_maxima import cylinder, revolved, sphere, torus
from tests.sweeps import swept

GRID = np.linspace(0.0, 1.0, 33)


def sampled(points, weights, low, high, place):
    """The smallest distance of a place from a grid of points of a part."""

    def basis(t, n):
        t = t[:, None]
        k = np.arange(n)
        choose = np.array([float(np.prod(np.arange(n - i, n)) / np.prod(np.arange(1, i + 1))) for i in k])
        return choose * t**k * (1 - t) ** (n - 1 - k)

    u, v = (basis(a + (b - a) * GRID, n) for a, b, n in zip(low, high, points.shape, strict=False))
    w = np.einsum("ui,vj,ij->uv", u, v, weights)
    at = np.einsum("ui,vj,ij,ijd->uvd", u, v, weights, points) / w[..., None]
    return float(np.min(np.linalg.norm(at - place, axis=-1)))


@pytest.mark.parametrize("ratio", [1.0, 10.0, 1e4])
@pytest.mark.parametrize("shape", [(4, 4), (3, 2), (2, 5)])
def test_bounds_are_below_dense_samples_and_near_them_on_small_parts(shape, ratio):
    rng = np.random.default_rng(sum(shape))
    points = rng.normal(size=(1, *shape, 3))
    weights = ratio ** rng.uniform(-1, 0, (1, *shape))
    weights /= weights.max()
    places = np.concatenate([rng.normal(size=(20, 3)), 1e3 * rng.normal(size=(4, 3)), points[0, :1, 0]])
    net = Net(jnp.asarray(points), jnp.asarray(weights))
    for size in (1.0, 0.25, 0.01):
        low = rng.uniform(0, 1 - size, (len(places), 2))
        low[-1] = 0.0
        found = distances_by_squares(net, places, np.zeros(len(places), int), low, low + size)[0]
        for k, place in enumerate(places):
            near = sampled(points[0], weights[0], low[k], low[k] + size, place)
            assert 0 <= found[k] <= near * (1 + 1e-12) + 1e-12
            assert size > 0.1 or ratio > 100 or found[k] >= near * 0.99 - 0.01


@pytest.mark.parametrize("degrees", [(20, 20), (33, 1), (40, 2)])
def test_binomials_of_high_degrees_do_not_overflow(degrees):
    u, v = np.meshgrid(*(np.linspace(0, 1, n + 1) for n in degrees), indexing="ij")
    net = Net(jnp.asarray(np.stack([u, v, 0 * u], axis=-1)[None]), None)
    places = np.array([[0.5, 0.5, 0.25], [2.0, 0.5, 0.0], [0.5, -1.0, 0.0]])
    ends = np.zeros((3, 2))
    found = distances_by_squares(net, places, np.zeros(3, int), ends, ends + 1)[0]
    assert np.all(found <= [0.25, 1.0, 1.0])
    small = distances_by_squares(net, places[:1], np.zeros(1, int), ends[:1] + 0.45, ends[:1] + 0.55)[0]
    assert 0.24 < small[0] <= 0.25


def bowl(power):
    """The graph of (x^2 + y^2)^power above [-1, 1]^2, for powers up to two."""
    n = 2 * power
    rows = bernstein_conversion(n)
    coefficients = np.zeros((n + 1, n + 1))
    for k in range(power + 1):
        coefficients[2 * k, n - 2 * k] = comb(power, k)
    x, y = np.meshgrid(*[np.linspace(-1, 1, n + 1)] * 2, indexing="ij")
    return jhd.BezierPatch(np.stack([x, y, rows @ coefficients @ rows.T], axis=-1))


def squared_distance_of_bowl(power, height):
    """The squared distance of (0, 0, height) from a bowl: the least value of r + (r^power - height)^2 for r >= 0."""
    powers = np.zeros(2 * power + 1)
    powers[[0, power]] = 1, -2 * height
    powers[-1] = height**2
    powers[-2] += 1
    roots = np.roots(np.polyder(powers))
    return min(np.polyval(powers, r.real) for r in roots if abs(r.imag) < 1e-9 and r.real >= 0)


@pytest.mark.parametrize("power", [1, 2])
def test_across_a_curve_of_nearest_points_bounds_are_short_by_the_fourth_power_of_the_size(power):
    # From (0, 0, 1) a circle is nearest, which crosses the cells at all angles.
    net, place = net_of(bowl(power)), np.array([0, 0, 1.0])
    exact = np.sqrt(squared_distance_of_bowl(power, 1.0))
    radius = {1: np.sqrt(0.5), 2: np.sqrt(np.max(np.roots([1, 0, -1, 0.25])))}[power]
    angles = np.random.default_rng(2).uniform(0, 2 * np.pi, 40)
    middle = 0.5 + 0.5 * radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    short = []
    for half in (2.0**-6, 2.0**-8):
        found = distances_by_squares(net, np.tile(place, (40, 1)), np.zeros(40, int), middle - half, middle + half)[0]
        assert np.all(found <= exact * (1 + 1e-15))
        short.append(np.max(exact - found))
    # By the third power it would be 1/64. Of a paraboloid the square is exact.
    assert short[0] < 1e-5 and short[1] < short[0] / 128 + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("power", "height"), [(1, 1.0), (1, 0.75), (1, 0.6), (2, 1.0), (2, 1.2)])
def test_from_the_axis_of_a_bowl_a_circle_across_its_parameters_is_proven_to_be_nearest(power, height):
    found = jhd.project(np.array([0, 0, height]), bowl(power))  # raises if the bounds stay open
    exact = np.sqrt(squared_distance_of_bowl(power, height))
    assert float(found.lower) <= exact * (1 + 1e-15) and exact * (1 - 1e-15) <= float(found.upper)


def test_nothing_is_above_the_distance_of_a_corner_in_rational_numbers():
    rng = np.random.default_rng(5)
    points, weights = rng.normal(size=(1, 3, 3, 3)), rng.uniform(0.1, 1, (1, 3, 3))
    net = Net(jnp.asarray(points), jnp.asarray(weights))
    for scale in (1e-12, 1e-6, 1.0):
        places = points[0, 0, 0] + scale * rng.normal(size=(40, 3))
        low = np.zeros((40, 2))
        found = distances_by_squares(net, places, np.zeros(40, int), low, low + 2.0**-40)[0]
        for place, lower in zip(places, found, strict=True):
            exact = sum((Fraction(x) - Fraction(y)) ** 2 for x, y in zip(place, points[0, 0, 0], strict=True))
            assert Fraction(float(lower)) ** 2 <= exact


def test_subnormal_distances_are_not_rounded_upward():
    rng = np.random.default_rng(0)
    halves = np.array([[2, 0], [1, 1], [0, 2]])
    for _ in range(200):
        corners, place = rng.integers(-3, 4, (2, 2, 3)), rng.integers(-3, 4, 3)
        net = Net(jnp.asarray(np.ldexp(corners[None].astype(float), -1074)), None)
        lower = distances_by_squares(
            net, np.ldexp(place[None].astype(float), -1074), np.zeros(1, int), np.zeros((1, 2)), np.ones((1, 2))
        )[0]
        # Four times the offsets of corners, middles of sides, and the middle.
        offsets = np.einsum("ui,vj,ijd->uvd", halves, halves, corners - place)
        assert (4 * float(np.ldexp(lower[0], 1074))) ** 2 <= np.min(np.sum(offsets**2, axis=-1))


@pytest.mark.parametrize("power", swept([-600, 0, 600], slow=[600]))
def test_centers_of_spheres_and_tori_are_proven_with_few_cells(power):
    for surface, exact in ((sphere(1.0), 1.0), (torus(0.25), 0.75)):
        net = surface.patches()
        scaled = jhd.BezierPatches(np.asarray(net.control_points) * 2.0**power, net.weights)
        found = jhd.directed_hausdorff(jhd.point_set(np.zeros((1, 3))), scaled)
        # What rounding of the control points moves.
        assert float(found.lower) <= exact * 2.0**power * (1 + 1e-15)
        assert exact * 2.0**power * (1 - 1e-15) <= float(found.upper) <= exact * 2.0**power * (1 + 1e-12)


# Surfaces of revolution, the height of a point on the axis, and its distance.
REVOLVED = {
    "torus": (torus(0.25), 1.0, np.sqrt(2) - 0.25),
    "cylinder": (cylinder(1.0), 0.7, 1.0),
    "cone": (revolved([np.array([[1.0, -1.0], [0, 1]])], np.ones(2)), -0.5, 1.5 / np.sqrt(5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", swept(REVOLVED, 1, 2))
def test_from_an_axis_whole_circles_are_proven_to_be_the_nearest_points(name):
    surface, height, exact = REVOLVED[name]
    found = jhd.project(np.array([0.0, 0.0, height]), surface)  # raises if the bounds stay open
    assert float(found.lower) <= exact * (1 + 4e-16) and exact * (1 - 4e-16) <= float(found.upper)


@pytest.mark.slow
def test_the_distances_of_points_on_the_axis_of_a_cone_close_at_all_heights():
    height = np.random.default_rng(0).uniform(-1, 0.99, 40)
    found = NetTarget(net_of(REVOLVED["cone"][0])).nearest(np.stack([0 * height, 0 * height, height], axis=1))
    exact = (1 - height) / np.sqrt(5)
    assert np.all(found.closed)
    assert np.all(found.lower <= exact * (1 + 1e-15)) and np.all(exact * (1 - 1e-15) <= found.upper)


@pytest.mark.slow
def test_places_near_a_center_take_hundreds_of_cells_at_most(monkeypatch):
    counted = []
    target = NetTarget(net_of(sphere(1.0)))
    bounded = on_patches.in_blocks

    def counting(program, net, points, *rest):
        counted.append(len(points))
        return bounded(program, net, points, *rest)

    monkeypatch.setattr(on_patches, "in_blocks", counting)
    for away in (0.0, 1e-9, 1e-6, 1e-3):
        counted.clear()
        found = target.nearest(np.array([[away, 0.0, 0.0]]))
        assert found.closed[0] and found.lower[0] <= 1 - away + 1e-15 <= found.upper[0] + 3e-15
        assert sum(counted) < 250
