"""Lower bounds by feet and multipliers that move, against shapes whose distance is known at every point."""

from functools import partial
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.cells import tracked_feet_surfaces
from jhd._distance.cells.pairs import Cell
from jhd._distance.cells.tracked_feet import moving_bound
from jhd._distance.cells.tracked_feet_nets import points_of_net
from jhd._distance.cells.tracked_feet_surfaces import distance_to_surface
from jhd._distance.normalization.net_jets import jet
from jhd._distance.normalization.nets import net_of
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._shapes import BezierPatches, BezierSegments, ImplicitSurface
from tests.distance.test_nonisolated_maxima import sphere as rational_sphere
from tests.sweeps import swept

CELLS = 32
SIZES = (0.2, 0.05)


@jax.jit
def bounds(a, b, low, high, start):
    none = jnp.zeros(CELLS, int)
    return jax.vmap(partial(moving_bound, a, b))(Cell(none, none, low, high), start)


@jax.jit
def mixed_bounds(a, b, cells, start):
    return jax.vmap(partial(moving_bound, a, b))(cells, start).lower


def sphere(radius, center=(0.0, 0.0, 0.0)):
    x, y, z = center
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


def to_a_sphere(size, dtype):
    """Bounds over cells of a rational sphere of radius 1, against all of an implicit one of radius 1.5."""
    rows: Any = rational_sphere(1.0)
    net = net_of(BezierPatches(rows.control_points.astype(dtype), rows.weights.astype(dtype)))
    a, b, frame = prepare_surfaces(net, two(sphere(1.5), sphere(1), dtype)[0])
    rng = np.random.default_rng(9)
    low = rng.uniform(0, 1 - size, (CELLS, 2))
    ends = [
        np.concatenate([x, np.broadcast_to(y, (CELLS, 3))], axis=1) for x, y in ((low, b.lower), (low + size, b.upper))
    ]
    pieces: Any = rng.integers(0, 8, CELLS)
    cells = Cell(pieces, jnp.zeros(CELLS, int), *(jnp.asarray(x, dtype) for x in ends))
    return cells, np.zeros((CELLS, 3), dtype), a, b, frame, 0.5


def to_an_axis(size, dtype):
    """Bounds over cells of an implicit cylinder, against all of its axis."""
    axis = net_of(BezierSegments(np.array([[(0, 0, -2.0), (0, 0, 2)]], dtype)))
    b, a, frame = prepare_surfaces(axis, two("x**2 + y**2 - 1", sphere(1), dtype)[0])
    scale, rng = 2.0 ** float(frame.first + frame.second), np.random.default_rng(9)
    x = tube(1.0, *rng.uniform(0, 2 * np.pi, (2, CELLS)))
    ends = [
        np.append((x + s * size * rng.uniform(0.25, 0.75, x.shape)) / scale, np.full((CELLS, 1), s > 0), 1)
        for s in (-1, 1)
    ]
    none = jnp.zeros(CELLS, int)
    cells = Cell(none, none, *(jnp.asarray(x, dtype) for x in ends))
    return cells, np.full((CELLS, 1), 0.5, dtype), a, b, frame, 1.0


MIXED = list(product([to_a_sphere, to_an_axis], [np.float64, np.float32]))


@pytest.mark.parametrize(("made", "dtype"), swept(MIXED, slow=MIXED[::2]))
def test_bounds_between_parametric_and_implicit_shapes_are_true_and_of_the_sixth_order(made, dtype):
    short = {}
    for size in (0.2, 0.05, 1e-2, 1e-3):
        cells, start, a, b, frame, exact = made(size, dtype)
        cells, start, a, b = jax.tree_util.tree_map(jnp.asarray, (cells, start, a, b))
        found = np.asarray(mixed_bounds(a, b, cells, start), np.float64) * 2.0 ** float(frame.first + frame.second)
        # Stored arcs are off by some roundings of their precision.
        assert np.all(found <= exact + 8 * np.finfo(dtype).eps)
        short[size] = np.median(exact - found)
    assert short[1e-2] < 2e4 * np.finfo(dtype).eps and short[1e-3] < 2e4 * np.finfo(dtype).eps
    assert dtype is np.float32 or short[0.05] < short[0.2] / 500


def farthest(a, b, cells):
    """Upper bounds over cells of a parametric shape, with feet looked for from the points in the middle."""

    def one(piece, low, high):
        point = points_of_net(a.piece(piece), low, high).point
        return distance_to_surface(b, point, point.terms[0])

    return jax.vmap(one)(cells.piece_a, cells.low[:, :2], cells.high[:, :2])


@pytest.mark.parametrize("dtype", swept([np.float64, np.float32], slow=2))
def test_upper_bounds_on_an_implicit_surface_are_true_and_of_the_sixth_order(dtype):
    over = {}
    for size in (0.2, 0.05, 1e-3):
        cells, _, a, b, frame, exact = to_a_sphere(size, dtype)
        cells, a, b = jax.tree_util.tree_map(jnp.asarray, (cells, a, b))
        found = np.asarray(jax.jit(farthest)(a, b, cells), np.float64) * 2.0 ** float(frame.first + frame.second)
        assert np.all(found >= exact - 8 * np.finfo(dtype).eps) and np.all(np.isfinite(found))
        over[size] = np.median(found - exact)
    assert over[1e-3] < 2e4 * np.finfo(dtype).eps
    assert dtype is np.float32 or over[0.05] < over[0.2] / 500


def from_a_cut_sphere(points, center):
    """Distances from a sphere of radius 1.5 about (center, 0, 0), of which only the part below x = 2 is there."""
    apart = points - np.array([center, 0, 0])
    far = np.linalg.norm(apart, axis=-1)
    beside = np.hypot(points[..., 1], points[..., 2]) - np.sqrt(max(1.5**2 - (2 - center) ** 2, 0))
    above = 1.5 * apart[..., 0] > (2 - center) * far
    return np.where(above, np.hypot(points[..., 0] - 2, beside), np.abs(far - 1.5))


@pytest.mark.slow
@pytest.mark.parametrize(("center", "missed"), list(product([0.0, 1.0], [None, 0.0, 0.02])))
def test_upper_bounds_of_wavy_pieces_hold_all_sampled_distances_or_are_none(center, missed, monkeypatch):
    # Pieces through the sphere, near its center, and out of the box of the surface, which cuts the second one.
    rng = np.random.default_rng(4)
    plane = np.stack(np.meshgrid(*[[-1.5, -0.5, 0.5, 1.5]] * 2, indexing="ij"), axis=-1)
    heights = (-1.9, -1.2, -0.2, 0.0, 0.3, 0.9, 1.4, 2.1)
    rows = np.stack([np.append(plane, np.full((4, 4, 1), z), axis=-1) for z in heights])
    net = net_of(BezierPatches(rows + rng.normal(0, 0.2, rows.shape) + np.array([center, 0, 0])))
    a, b, frame = prepare_surfaces(net, two(sphere(1.5, (center, 0, 0)), sphere(1))[0])
    a, b, unit = *jax.tree_util.tree_map(jnp.asarray, (a, b)), 2.0 ** float(frame.first + frame.second)

    def feet(side, points, starts, steps):
        """Feet that are off the surface, and on what the box has cut off."""
        apart = points - jnp.array([[center], [0], [0]]) / unit
        return points - apart * (1 - (1.5 - missed) / unit / jnp.linalg.norm(apart, axis=0))

    if missed is not None:
        monkeypatch.setattr(tracked_feet_surfaces, "local_feet", feet)
    bounds_of = jax.jit(lambda *shapes: farthest(*shapes))
    pieces, shares = jnp.arange(CELLS) % len(rows), rng.uniform(0, 1, (64, 2))
    for size in (0.3, 0.1, 0.01):
        low = jnp.asarray(rng.uniform(0, 1 - size, (CELLS, 2)))
        found = np.asarray(bounds_of(a, b, Cell(pieces, pieces, low, low + size))) * unit
        places = jax.vmap(lambda k, x: jax.vmap(lambda u, k=k: jet(a.piece(k), u).point)(x))
        points = np.asarray(places(pieces, low[:, None] + size * shares)) * unit
        assert np.all(found >= np.max(from_a_cut_sphere(points, center), axis=1) - 1e-14)
    assert np.mean(np.isfinite(found)) > (0.5 if center else 0.8)
