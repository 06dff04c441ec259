"""Proven upper bounds of the distance over parts of implicit surfaces by feet that move with the point.

In a cell that a crosses in one sheet, a is the graph of a function of the two coordinates (s, t) in which the cell
extends across it. With polynomials P(s, t) near a and Q(s, t) near b, every point of a in the cell has

    d(p, b) <= max |P - Q| + max |p - P| + max d(Q, b).

P and Q pass through points of a and approximately through their nearest points of b at some nodes. So the order of all
three in the size of the cell is one above the degree of the polynomials. This holds also if the distance is constant
along a: for surfaces and their offsets, concentric and coaxial ones. The distances of P and Q from the surfaces are
proven by the values of the polynomials on them and by their slopes in one coordinate: if |f(Q)| <= B and f rises or
falls in that coordinate at a rate of at least m, f is zero within B / m of Q. A Q that leaves the box of b, by rounding
for one, counts as moved to its border. A zero beyond the border in that coordinate is not on b. But if f is zero on the
whole face that the way to it crosses, the way meets b at the face, which is no farther.

Rounding: polynomials P and Q are their floating-point coefficients; all else is in jhd._arithmetic.truncated and in
the errors of forms (jhd._distance.nearest.forms).

Source: ours.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jhd._arithmetic.rounding import gamma, round_up, smallest_normal
from jhd._arithmetic.truncated import Truncated, largest, product
from jhd._distance.cells.graphs import (
    NODES,
    Graph,
    OnPiece,
    S,
    T,
    beside_graph,
    fitted,
    graph_over,
    rates,
    values_on_graph,
    values_over,
)
from jhd._distance.nearest.forms import Boxes, Form, form
from jhd._distance.nearest.surface_points import local_feet
from jhd._distance.normalization.surfaces import Side

# Newton steps for the feet of the nodes.
_STEPS_OF_FEET = 3
# The room for the motion to b around the range of Q, as fractions of its sides and of the largest side.
_WIDER, _LEAST = 1.25, 0.125


def moving_bounds(
    form_a: Form, a: Side, b: Side, cells: Boxes, foot: Float[Array, "3 cells"]
) -> Float[Array, " cells"]:
    """Upper bounds of d(p, b) over the points p of a in cells; infinite if none is proven."""
    over = graph_over(form_a, a, cells)
    count = NODES.shape[1]
    feet = local_feet(b, over.places, jnp.repeat(foot, count, axis=1).reshape(3, -1), _STEPS_OF_FEET)
    q = fitted(feet.reshape(3, -1, count).transpose(2, 0, 1))
    graph, on_a = over.graph, over.on
    ranges, on_b = piece_about(b, q)
    dtype = q.dtype
    most_a, most_b = values_on_graph(on_a), values_over(on_b)
    beside = beside_graph(graph, on_a, most_a)
    moved, off = _off(b, ranges, on_b, most_b)
    apart = jnp.sqrt(jnp.maximum(_apart(graph, q), 0.0)) * (1 + gamma(4, dtype)) + smallest_normal(dtype) ** 0.5
    total = round_up((apart + beside + moved + off) * (1 + gamma(8, dtype)))
    return jnp.where(jnp.isfinite(total), total, jnp.inf)


def displacement(graph: Graph, q: Array) -> Truncated:
    """Return Q - P in the order of the graph's coordinates, for Q (terms, 3, cells) in the order of the axes."""
    dtype = q.dtype
    sides = jnp.take_along_axis(q, graph.order[None], axis=1)
    zero = jnp.zeros_like(graph.height)
    steps = jnp.stack([zero.at[S].set(1.0), zero.at[T].set(1.0), graph.height], axis=1) * graph.half
    terms = (sides - steps).at[0].set(sides[0] - graph.center - steps[0])
    size = jnp.sum(jnp.abs(sides), axis=0) + jnp.abs(graph.center) + jnp.sum(jnp.abs(steps), axis=0)
    return Truncated(terms, gamma(16, dtype) * size)


def _apart(graph: Graph, q: Array) -> Array:
    """Upper bound of |P - Q|^2, for q (terms, 3, cells) in the order of the coordinates."""
    w = displacement(graph, q)
    square = product(w, w)
    rest = jnp.sum(square.rest, axis=0) + gamma(8, q.dtype) * jnp.sum(w.size**2, axis=0)
    return largest(Truncated(jnp.sum(square.terms, axis=1), rest))


class Ranges(NamedTuple):
    """Boxes that hold Q, (3, cells), and half the sides of larger boxes about the same centers."""

    center: Array
    reach: Array
    half: Array


def piece_about(b: Side, q: Array) -> tuple[Ranges, OnPiece]:
    """Return the range of Q, with room to move, and the polynomial of b there."""
    dtype = q.dtype
    center, reach = q[0], jnp.sum(jnp.abs(q[1:]), axis=0) * (1 + gamma(64, dtype))
    least = jnp.maximum(_LEAST * jnp.max(reach, axis=0), gamma(2**16, dtype))
    half = jnp.maximum(_WIDER * reach, reach + least)
    cells = Boxes(center - half, center + half, center, half)
    f = form(b, cells)
    exact = Truncated((q / half).at[0].set(0.0), jnp.full_like(half, gamma(8, dtype)))
    return Ranges(center, reach, half), OnPiece(f, f.local, exact, *rates(f, cells))


def _off(b: Side, ranges: Ranges, on: OnPiece, most: Array) -> tuple[Array, Array]:
    """Return how far Q leaves the box of b, and bounds of the distance from within it to b, if |f(Q)| <= `most`."""
    center, reach, half = ranges
    dtype = center.dtype
    lower, upper = jnp.asarray(b.lower)[:, None], jnp.asarray(b.upper)[:, None]
    slack = gamma(8, dtype) * (jnp.abs(center) + reach)
    low, high = center - reach - slack, center + reach + slack
    outside = jnp.maximum(jnp.maximum(lower - low, high - upper), 0.0)
    # If b is zero on all of a face, a zero behind it counts as one on it; see the module.
    below, above = (faces[:, None] for faces in b.vanishing_faces)
    below, above = jnp.where(below, jnp.inf, low - lower), jnp.where(above, jnp.inf, upper - high)
    inside = jnp.maximum(jnp.minimum(jnp.minimum(below, above), half - reach), 0.0)
    # A point moved to the border has a different value there.
    most = (most + jnp.sum(on.fastest * outside, axis=0)) * (1 + gamma(16, dtype))
    away = most / jnp.where(on.slowest > 0, on.slowest, 1.0) * (1 + gamma(16, dtype))
    away = jnp.where((on.slowest > 0) & (away < inside * (1 - gamma(8, dtype))), away, jnp.inf)
    within = jnp.all(outside <= 0.5 * (half - reach), axis=0)
    moved = jnp.sqrt(jnp.sum(outside**2, axis=0)) * (1 + gamma(8, dtype))
    return jnp.where(within, moved, jnp.inf), jnp.min(away, axis=0)
