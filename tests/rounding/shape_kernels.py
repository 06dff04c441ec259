"""Kernels of surfaces, their numbers, and what each claims: bounds with room for rounding, and errors that are told."""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jhd._arithmetic import bernstein, truncated
from jhd._arithmetic.rounding import absolute_error, gamma
from jhd._distance.cells import flat_pieces, foot_maps, graphs, lagrange, tracked_feet_upper
from jhd._distance.cells import surfaces as upper
from jhd._distance.nearest import chords, forms, stationarity, surface_points
from jhd._distance.nearest.forms import Boxes, Form
from jhd._distance.nearest.target import Flats
from jhd._distance.normalization import isolated, net_jets
from jhd._distance.normalization import surfaces as preparation
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.surfaces import Side

COUNT = 24
DTYPE = np.float32


def uniform(seed: int, *shape: int, low: float = -1.0) -> np.ndarray:
    """Numbers between an end and one; along a long last axis every third one is at an end."""
    found = np.random.default_rng([seed, *shape]).uniform(low, 1, shape).astype(DTYPE)
    if shape[-1] >= COUNT:
        found[..., ::3] = np.where(found[..., ::3] > 0.5 * (low + 1), 1.0, low)
    return found


def side(coefficients: Any) -> Side:
    """An implicit surface in [-1, 1]^3 whose coefficients are exact."""
    ends = np.ones(3, DTYPE)
    zeros = np.zeros(coefficients.shape, DTYPE)
    return Side(coefficients, zeros, -ends, ends, np.zeros((3, 3, 3), bool), isolated.none_known(DTYPE))


def boxes(center: Any, half: Any) -> Boxes:
    """Cells by floats."""
    return Boxes(center - half, center + half, center, half)


def chosen(module: Any, name: str, values: Any, function: Callable, *arguments: Any) -> Any:
    """The result of a function, while another one gives these: numbers that may be chosen freely are floats."""
    kept = getattr(module, name)
    setattr(module, name, lambda *_: values)
    try:
        return function(*arguments)
    finally:
        setattr(module, name, kept)


def _cells(degree: int) -> list[np.ndarray]:
    """Coefficients, centers and half sides of cells within the box."""
    half = uniform(1, 3, COUNT, low=0.001) * DTYPE(0.2)
    return [uniform(2, *(degree + 1,) * 3), uniform(3, 3, COUNT) * DTYPE(0.8), half]


def lower_bounds(a, c, h, point, factors):
    free = jnp.ones((3, COUNT), bool)
    return chosen(
        forms, "multiples", factors, forms.lower_bounds, forms.form(side(a), boxes(c, h)), boxes(c, h), point, free
    )


def upper_bounds(a, c, h, feet, weights, factors):
    form, free = forms.form(side(a), boxes(c, h)), jnp.ones((3, COUNT), bool)
    radius = jnp.zeros(feet[:, 0].shape, feet.dtype)
    return chosen(upper, "_trials", (weights, factors), upper.upper_bounds, form, boxes(c, h), feet, radius, free)


def _weights() -> np.ndarray:
    shares = uniform(4, 3, 4, COUNT, low=0.0)
    return shares / np.sum(shares, axis=1, keepdims=True)


def _factors(seed: int, trials: int) -> np.ndarray:
    """Factors of polynomials, none for half of the cells: there the roundings of distances show."""
    return uniform(seed, trials, COUNT) * (np.arange(COUNT) < COUNT // 2).astype(DTYPE)


def _near_feet() -> list[np.ndarray]:
    """Cells and feet; half of the cells are small and lie beside feet that are close to each other."""
    a, center, half = _cells(3)
    feet, small = uniform(7, 4, 3, COUNT), np.arange(COUNT) >= COUNT // 2
    feet[..., small] = DTYPE(0.75) + DTYPE(0.01) * feet[..., small]
    center[:, small], half[:, small] = feet[0][:, small], DTYPE(2.0**-8)
    return [a, center, half, feet, _weights(), _factors(8, 3)]


def rates(side_of_them: int) -> Callable:
    return lambda a, c, h: graphs.rates(forms.form(side(a), boxes(c, h)), boxes(c, h))[side_of_them]


def rest_of(local):
    return Form(local, local, local, local).rest


def slope_changes(local):
    return forms.slope_changes(Form(local, local, local, local))


def isolated_radius(places_of, center):
    points = isolated.none_known(DTYPE)._replace(center=center, there=np.ones(len(center), bool))
    return isolated.isolated_radius(points, places_of)


def bound_between(a, b):
    simplex = foot_maps.Simplex
    return foot_maps.bound_between(2, simplex(a, None), simplex(b, None), 4)


def bound_between_rational(a, b, v, w):
    simplex = foot_maps.Simplex
    return foot_maps.bound_between(2, simplex(a * v[:, :, None], v), simplex(b * w[:, :, None], w), 4)


def _on_piece(a, variables):
    nothing = jnp.zeros(a.shape[-1], a.dtype)
    functions = truncated.Truncated(variables, jnp.zeros(variables.shape[1:], a.dtype))
    return graphs.OnPiece(Form(a, a, nothing, nothing), a, functions, nothing, nothing)


def values_over(a, variables):
    return graphs.values_over(_on_piece(a, variables))


def values_on_graph(a, height):
    return graphs.values_on_graph(_on_piece(a, jnp.stack([height] * 3, axis=1)))


def apart(height, center, half, q):
    order = jnp.broadcast_to(jnp.arange(3)[:, None], center.shape)
    graph = graphs.Graph(order, center, half, height, jnp.sum(jnp.abs(height), axis=0))
    return tracked_feet_upper._apart(graph, q)


def sag(a, origin, first, second):
    normal = jnp.broadcast_to(jnp.array([0, 0, 1], origin.dtype), origin.shape)
    thickness = jnp.full(origin.shape[:1], 0.5, origin.dtype)
    return flat_pieces._sag(side(a), Flats(origin, first, second, thickness), normal, thickness)


def _about_a_plane() -> np.ndarray:
    """Coefficients of z / 2 and of small terms."""
    a = uniform(40, 4, 4, 4) * DTYPE(0.002)
    a[0, 0, 1] = 0.5
    return a


def _triangular(seed: int, *values: int, low: float = -1.0) -> np.ndarray:
    """Scaled coefficients of degree two over triangles."""
    table = np.array([[1, 2, 1], [2, 2, 0], [1, 0, 0]], DTYPE).reshape(3, 3, *[1] * len(values))
    return uniform(seed, 3, 3, *values, low=low) * table


# How many terms truncated polynomials have.
TERMS = len(truncated.EXPONENTS)
# Those that take seconds to trace.
SLOW = ("followed", "followed rational", "values over", "values on graph", "apart")
# Bounds: a function, its numbers, the modules whose constants are in it, and the side.
BOUNDS: dict[str, tuple[Callable, list[np.ndarray], tuple, int]] = {
    "lower bounds": (lower_bounds, [*_cells(3), uniform(5, 3), _factors(6, 6)], (forms,), -1),
    "upper bounds": (
        upper_bounds,
        _near_feet(),
        (forms, upper),
        1,
    ),
    "nearest of boxes": (
        lambda c, h, p: forms.box_distances(boxes(c, h), p)[0],
        [*_cells(1)[1:], uniform(9, 3)],
        (forms,),
        -1,
    ),
    "farthest of boxes": (
        lambda c, h, p: forms.box_distances(boxes(c, h), p)[1],
        [*_cells(1)[1:], uniform(9, 3)],
        (forms,),
        1,
    ),
    "rest": (rest_of, [uniform(10, 9, 9, 9, 4)], (forms,), 1),
    "slope changes": (slope_changes, [uniform(11, 9, 9, 9, 4)], (forms,), 1),
    "slowest": (rates(0), _cells(2), (forms, graphs), -1),
    "fastest": (rates(1), _cells(2), (forms, graphs), 1),
    "reach": (surface_points.reach, [uniform(12, 3, COUNT)], (surface_points,), 1),
    "isolated": (
        isolated_radius,
        [uniform(13, 3, COUNT), uniform(14, len(isolated.none_known(DTYPE).half), 3) / 3],
        (isolated,),
        1,
    ),
    "values over": (
        values_over,
        [uniform(41, 4, 4, 4, COUNT) * DTYPE(0.3), uniform(42, TERMS, 3, COUNT) / DTYPE(TERMS)],
        (graphs, truncated),
        1,
    ),
    "values on graph": (
        values_on_graph,
        [uniform(41, 4, 4, 4, COUNT) * DTYPE(0.3), uniform(42, TERMS, COUNT) / DTYPE(TERMS)],
        (graphs, truncated),
        1,
    ),
    "apart": (
        apart,
        [uniform(43, TERMS, COUNT) * DTYPE(0.3), *_cells(1)[1:], uniform(44, TERMS, 3, COUNT) * DTYPE(0.1)],
        (tracked_feet_upper, truncated),
        1,
    ),
    "sag": (
        sag,
        [
            _about_a_plane(),
            uniform(45, 8, 3) * DTYPE(0.2),
            *(uniform(k, 8, 3) * np.array([0.05, 0.05, 0], DTYPE) for k in (46, 47)),
        ],
        (flat_pieces, forms),
        1,
    ),
    "joined": (lagrange.joined_upper, [np.array(0.7, DTYPE), uniform(48, 2, low=0.0)], (lagrange,), 1),
    "followed": (bound_between, [_triangular(15, 3, COUNT), _triangular(16, 3, COUNT)], (foot_maps,), 1),
    "followed rational": (
        bound_between_rational,
        [_triangular(15, 3, COUNT), _triangular(16, 3, COUNT)]
        + [_triangular(17, COUNT, low=0.1), _triangular(18, COUNT, low=0.1)],
        (foot_maps,),
        1,
    ),
}


def form_of(a, c, h):
    form = forms.form(side(a), boxes(c, h))
    return form.terms, form.error


def restricted(c, t):
    part = bernstein.restrict(c, t[0], t[1], axis=0)
    return part, absolute_error(3 * (len(c) - 1), jnp.max(jnp.abs(c)))


def stationary(points, weights):
    return stationarity.stationarity(points[-1], points[:-1], weights)


def shifted(a, by):
    rows, sizes = a, jnp.abs(a)
    for axis in range(3):
        rows, sizes = (preparation._shifted(x, y, axis) for x, y in ((rows, by[axis]), (sizes, jnp.abs(by[axis]))))
    return rows, gamma(4 * (sum(a.shape) - 3) + 8, a.dtype) * sizes


def control_points(height, center, half):
    order = jnp.broadcast_to(jnp.arange(3)[:, None], center.shape)
    tall = jnp.sum(jnp.abs(height), axis=0)
    graph = graphs.Graph(order, center, half, height, tall)
    unused: Any = None
    points, off = graphs.control_points(graphs.GraphOver(unused, graph, unused))
    return points, off / math.sqrt(3)


def on_chord(start, end, point):
    def one(s, e, p):
        chord = e - s
        return jnp.sqrt(chords.square_and_parameter(p, s, chord, 1 / jnp.sum(chord * chord))[0])

    return jax.vmap(one)(start, end, point), jnp.asarray(chords.chord_error(start.shape[1], start.dtype), start.dtype)


# Errors that are told: a function that gives numbers and a bound of the error of each, and its numbers.
TOLD: dict[str, tuple[Callable, list[np.ndarray]]] = {
    "form": (form_of, _cells(4)),
    "values": (lambda a, c: forms.signed_values(side(a), c), _cells(4)[:2]),
    "restriction": (restricted, [uniform(20, 6, COUNT), np.array([0.3, 0.9], DTYPE)]),
    "stationarity": (lambda x: stationary(x, None), [uniform(21, 5, 2)]),
    "rational stationarity": (stationary, [uniform(22, 5, 2), uniform(23, 4, low=0.1)]),
    "coefficients": (shifted, [uniform(24, 4, 4, 4), uniform(25, 3)]),
    "graph": (control_points, [uniform(26, TERMS, COUNT), *_cells(1)[1:]]),
    "chord in the plane": (on_chord, [uniform(k, COUNT, 2) for k in (27, 28, 29)]),
    "chord in space": (on_chord, [uniform(k, COUNT, 3) for k in (27, 28, 29)]),
}


def net_points(of_part: bool, degrees: tuple[int, int], rational: bool) -> tuple[Callable, list[np.ndarray], Net]:
    """Points of a piece, or control points of its part, with the numbers they are computed from."""
    shape = tuple(n + 1 for n in degrees)
    points, ends = uniform(30, COUNT, *shape, 3), np.sort(uniform(31, COUNT, 2, 2, low=0.0), axis=1)
    points[::2] = 1.0
    weights = [uniform(32, COUNT, *shape, low=0.05)] if rational else []
    inputs = [points, ends, uniform(33, COUNT, 2, low=0.0), *weights]

    def one(points, ends, x, w=None):
        part = net_jets.part_of(Net(points, w), ends[0], ends[1])
        return part.points if of_part else net_jets.jet(part, x).point

    return lambda *x: jax.vmap(one)(*x), inputs, Net(jnp.asarray(points[0]), weights[0][0] if rational else None)
