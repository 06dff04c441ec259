"""Parts of implicit surfaces as graphs: polynomials P(s, t) near a surface in a cell that it crosses in one sheet.

Such a part is the graph of a function of the two coordinates (s, t) in which the cell extends across the surface. P
passes through points of the surface at some nodes, so its error is of one order above its degree in the size of the
cell. The error is proven by the values of the polynomial f of the surface on P and by the slope of f in the third
coordinate: if |f(P)| <= B and f rises or falls in that coordinate at a rate of at least m, then f is zero within B / m
of P.

Rounding: P is its floating-point coefficients; all else is in jhd._arithmetic.truncated and in the errors of forms
(jhd._distance.nearest.forms). Control points are sums of products of these with numbers of at most one, off by less
than gamma(64) times the sizes of the terms.

Source: ours.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.polynomials import jets
from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.truncated import DEGREE, EXPONENTS, Truncated, bernstein_form, composed, composed_on_graph
from jhd._distance.nearest.forms import Boxes, Form, form, slope_changes
from jhd._distance.normalization.surfaces import Side
from jhd._runtime.arrays import varying

# Newton steps for the nodes.
_STEPS_OF_NODES = 3
# Graphs that leave their cells by more than this many half sides are not used.
_TALLEST = 4.0


def _nodes() -> tuple[np.ndarray, np.ndarray]:
    """Return as many nodes (2, nodes) of the square as there are terms, and the values of all terms at them.

    They are Padua points, with which interpolation is about as good as any (Caliari, De Marchi & Vianello 2005).
    """
    pairs = [(j, k) for j in range(DEGREE + 1) for k in range(DEGREE + 2) if (j + k) % 2 == 0]
    s, t = np.cos(np.pi * np.array(pairs) / [DEGREE, DEGREE + 1]).T
    return np.stack([s, t]), np.stack([s**i * t**j for i, j in EXPONENTS], axis=1)


NODES, _VALUES = _nodes()
_FIT = np.linalg.inv(_VALUES)
S, T = EXPONENTS.index((1, 0)), EXPONENTS.index((0, 1))


class OnPiece(NamedTuple):
    """A polynomial over boxes, and polynomials (terms, 3, cells) that stay in [-1, 1]^3, to be put into it."""

    form: Form
    local: Array
    variables: Truncated
    slowest: Array  # (3, cells), least and largest absolute values of its derivatives
    fastest: Array


class Graph(NamedTuple):
    """P over cells: centers and half sides in the order (s, t, height), and the height in half sides."""

    order: Array  # (3, cells), the coordinates s, t and height
    center: Array  # (3, cells)
    half: Array
    height: Array  # (terms, cells)
    tall: Array  # (cells,)


class GraphOver(NamedTuple):
    """Points (3, cells * nodes) near a at the nodes, its graph, and its polynomial on the graph."""

    places: Array
    graph: Graph
    on: OnPiece


def graph_over(form_a: Form, a: Side, cells: Boxes) -> GraphOver:
    """The graph of a over cells."""
    order = (jnp.argmax(jnp.abs(form_a.slope), axis=0) + np.array([1, 2, 3])[:, None]) % 3
    places, height = _places(form_a, a, cells, order)
    return GraphOver(places.reshape(3, -1), *_graph(a, cells, order, height))


def values_on_graph(on: OnPiece) -> Array:
    """Bounds as in `values_over` for the piece of a graph, whose first two variables are s and t."""
    height = jax.tree_util.tree_map(lambda x: x[..., 2, :], on.variables)
    found = composed_on_graph(on.local, height, jnp.max(on.variables.rest[:2], axis=0))
    return found.size * (1 + gamma(64, on.local.dtype)) + on.form.error


def values_over(on: OnPiece) -> Array:
    """Bounds (cells,) of the absolute values of a polynomial composed with the polynomials of its variables."""
    return composed(on.local, on.variables).size * (1 + gamma(64, on.local.dtype)) + on.form.error


def control_points(over: GraphOver) -> tuple[Array, Array]:
    """Control points (degree + 1, degree + 1, 3, cells) of P over the square, and how far off they are, as lengths.

    Parameters of zero and one are the ends of s and t.
    """
    graph = over.graph
    zero = jnp.zeros_like(graph.height)
    terms = jnp.stack([zero.at[S].set(1.0), zero.at[T].set(1.0), graph.height], axis=1)
    points = graph.center + graph.half * bernstein_form(terms)
    back = jnp.argsort(graph.order, axis=0)[None, None]
    size = jnp.max(jnp.abs(graph.center) + graph.half * graph.tall, axis=0)
    return jnp.take_along_axis(points, back, axis=2), math.sqrt(3) * gamma(64, size.dtype) * size


def at_nodes(terms: Array) -> Array:
    """Values (nodes, ...) from coefficients (terms, ...)."""
    return jnp.tensordot(_VALUES.astype(terms.dtype), terms, 1, precision="highest")


def fitted(values: Array) -> Array:
    """Coefficients (terms, ...) from values (nodes, ...)."""
    return jnp.tensordot(_FIT.astype(values.dtype), values, 1, precision="highest")


def _sorted(x: Array, order: Array) -> Array:
    return jnp.take_along_axis(x, order, axis=0)


def _places(form_a: Form, a: Side, cells: Boxes, order: Array) -> tuple[Array, Array]:
    """Approximate points of a over the nodes, (3, cells, nodes), and coefficients of their heights in half sides."""
    center, half, slope = (_sorted(x, order)[..., None] for x in (cells.center, cells.half, form_a.slope))
    s, t = NODES.astype(half.dtype)
    axis = order[2][:, None]
    steep = jnp.where(slope[2] != 0, slope[2], jnp.inf)
    start = jnp.clip(-(form_a.value[:, None] + slope[0] * s + slope[1] * t) / steep, -_TALLEST, _TALLEST)
    back = jnp.argsort(order, axis=0)[..., None]

    def points(z: Array) -> Array:
        sides = jnp.stack([center[0] + half[0] * s, center[1] + half[1] * t, center[2] + half[2] * z])
        return jnp.take_along_axis(sides, back, axis=0)

    def step(_: int, z: Array) -> Array:
        at = jets(jnp.asarray(a.coefficients), points(z))
        rate = jnp.take_along_axis(at.gradient, axis[None], axis=0)[0] * half[2]
        move = at.value / jnp.where(rate != 0, rate, jnp.inf)
        return jnp.clip(z - move, -_TALLEST, _TALLEST)

    z = jax.lax.fori_loop(0, _STEPS_OF_NODES, step, varying(start, a, cells))
    return points(z), fitted(z.T)


def _graph(a: Side, cells: Boxes, order: Array, height: Array) -> tuple[Graph, OnPiece]:
    """The graph, and a over boxes as tall as it is, so that both of them are in these."""
    center, half = _sorted(cells.center, order), _sorted(cells.half, order)
    dtype = half.dtype
    tall = jnp.maximum(jnp.sum(jnp.abs(height), axis=0), 1.0) * (1 + gamma(64, dtype))
    wide = cells._replace(half=jnp.where(jnp.arange(3)[:, None] == order[2], tall * cells.half, cells.half))
    f = form(a, wide)
    local = jnp.stack([jnp.moveaxis(f.local, k, 2) for k in range(3)])
    # After one axis moves to the end, the others keep their order: s and t, except for the middle axis.
    local = local.at[1].set(jnp.swapaxes(local[1], 0, 1))
    local = jnp.take_along_axis(local, order[2].reshape(1, 1, 1, 1, -1), axis=0)[0]
    zero = jnp.zeros_like(height)
    share = half[2] / _sorted(wide.half, order)[2]
    variables = jnp.stack([zero.at[S].set(1.0), zero.at[T].set(1.0), height * share], axis=1)
    exact = Truncated(variables, jnp.full_like(variables[0], gamma(8, dtype)))
    return Graph(order, center, half, height, tall), OnPiece(f, local, exact, *rates(f, wide))


def rates(f: Form, cells: Boxes) -> tuple[Array, Array]:
    """Lower bounds, at least 0, and upper bounds (3, cells) of the absolute derivatives over cells."""
    dtype = f.slope.dtype
    size = jnp.abs(f.slope)
    loose = slope_changes(f) + f.error * sum(f.local.shape[:3]) + gamma(16, dtype) * size
    room = gamma(8, dtype)
    return jnp.maximum((size - loose) * (1 - room) / cells.half, 0.0), (size + loose) * (1 + room) / cells.half


def beside_graph(graph: Graph, on: OnPiece, most: Array) -> Array:
    """Bound the distance of points of a in cells from P, if |f(P)| is at most `most`."""
    least = jnp.take_along_axis(on.slowest, graph.order[2][None], axis=0)[0]
    away = most / jnp.where(least > 0, least, 1.0) * (1 + gamma(8, most.dtype))
    return jnp.where((least > 0) & (graph.tall <= _TALLEST), away, jnp.inf)
