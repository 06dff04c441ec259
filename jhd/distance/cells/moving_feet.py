"""Proven upper bounds of the distance over parts of polynomial surfaces by feet that move with the place.

In a cell that is crossed by a in one sheet, a is the graph of a function of the two coordinates (s, t) in which the
cell extends across it. With polynomials P(s, t) near a and Q(s, t) near b, every point of a in the cell has

    d(p, b) <= max |P - Q| + max |p - P| + max d(Q, b).

P and Q pass through points of a and about their nearest points of b at some nodes, so that all three are of an order of
the size of the cell that is one above the degree of the polynomials, where the distance is constant along a as well:
surfaces and their offsets, concentric and coaxial ones. How far P and Q are from the surfaces is proven by the values
of the polynomials on them and by their slopes in one coordinate: where |f(Q)| <= B and f rises or falls in that
coordinate at a rate of m at least, f is zero within B / m of Q. A Q that leaves the box of b, by rounding for one,
counts as moved to its border.

Rounding: polynomials P and Q are their floating-point coefficients; all else is in jhd.arithmetic.truncated and in
the errors of forms (jhd.distance.nearest.forms).

Source: ours.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd.arithmetic.polynomials import jets
from jhd.arithmetic.rounding import gamma, round_up, smallest_normal
from jhd.arithmetic.truncated import DEGREE, EXPONENTS, Truncated, composed, largest, product
from jhd.arrays import varying
from jhd.distance.frame.surfaces import Side
from jhd.distance.nearest.forms import Boxes, Form, form, slope_changes
from jhd.distance.nearest.places import local_feet

# Newton steps for the nodes on a, and for their feet.
_STEPS_OF_NODES, _STEPS_OF_FEET = 3, 3
# Graphs that leave their cells by more than so many half sides are not looked at.
_TALLEST = 4.0
# The room for the motion to b about the range of Q, as shares of its sides and of the largest of them.
_WIDER, _LEAST = 1.25, 0.125


def _nodes() -> tuple[np.ndarray, np.ndarray]:
    """As many nodes (2, nodes) of the square as there are terms, and the matrix from values there to coefficients.

    They are Padua points, with which interpolation is about as good as any (Caliari, De Marchi & Vianello 2005).
    """
    pairs = [(j, k) for j in range(DEGREE + 1) for k in range(DEGREE + 2) if (j + k) % 2 == 0]
    s, t = np.cos(np.pi * np.array(pairs) / [DEGREE, DEGREE + 1]).T
    return np.stack([s, t]), np.linalg.inv(np.stack([s**i * t**j for i, j in EXPONENTS], axis=1))


_NODES, _FIT = _nodes()
_S, _T = EXPONENTS.index((1, 0)), EXPONENTS.index((0, 1))


class _OnPiece(NamedTuple):
    """A polynomial over boxes, and polynomials (terms, 3, cells) that stay in [-1, 1]^3, to be put into it."""

    form: Form
    local: Array
    variables: Truncated
    slowest: Array  # (3, cells), least and largest absolute values of its derivatives
    fastest: Array


class _Graph(NamedTuple):
    """P over cells: centres and half sides in the order (s, t, height), and the height in half sides."""

    order: Array  # (3, cells), the coordinates s, t and height
    centre: Array  # (3, cells)
    half: Array
    height: Array  # (terms, cells)
    tall: Array  # (cells,)


def moving_bounds(
    form_a: Form, a: Side, b: Side, cells: Boxes, foot: Float[Array, "3 cells"]
) -> Float[Array, " cells"]:
    """Upper bounds of d(p, b) over the points p of a in cells; infinite where there are none.

    Args:
        form_a: the polynomial of a on the cells.
        a: the surface.
        b: the other one, in the same degrees.
        cells: the cells.
        foot: a point close to b for each, near which feet are looked for.
    """
    order = (jnp.argmax(jnp.abs(form_a.slope), axis=0) + np.array([1, 2, 3])[:, None]) % 3
    places, height = _places(form_a, a, cells, order)
    count = _NODES.shape[1]
    feet = local_feet(b, places.reshape(3, -1), jnp.repeat(foot, count, axis=1).reshape(3, -1), _STEPS_OF_FEET)
    q = _fitted(feet.reshape(3, -1, count).transpose(2, 0, 1))
    graph, on_a = _graph(a, cells, order, height)
    ranges, on_b = _piece(b, q)
    # In one go, which takes half as long to compile.
    both = jax.tree_util.tree_map(lambda x, y: jnp.concatenate([x, y], axis=-1), on_a, on_b)
    dtype = q.dtype
    most = composed(both.local, both.variables).size * (1 + gamma(64, dtype)) + both.form.error
    most_a, most_b = jnp.split(most, 2)
    beside = _beside_graph(graph, on_a, most_a)
    moved, off = _off(b, ranges, on_b, most_b)
    apart = jnp.sqrt(jnp.maximum(_apart(graph, q), 0.0)) * (1 + gamma(4, dtype)) + smallest_normal(dtype) ** 0.5
    total = round_up((apart + beside + moved + off) * (1 + gamma(8, dtype)))
    return jnp.where(jnp.isfinite(total), total, jnp.inf)


def _fitted(values: Array) -> Array:
    """Coefficients (terms, ...) from values (nodes, ...)."""
    matrix = _FIT.astype(values.dtype).reshape(*_FIT.shape, *[1] * (values.ndim - 1))
    return jnp.sum(matrix * values, axis=1)


def _sorted(x: Array, order: Array) -> Array:
    return jnp.take_along_axis(x, order, axis=0)


def _places(form_a: Form, a: Side, cells: Boxes, order: Array) -> tuple[Array, Array]:
    """About points of a over the nodes, (3, cells, nodes), and the coefficients of their heights in half sides."""
    centre, half, slope = (_sorted(x, order)[..., None] for x in (cells.centre, cells.half, form_a.slope))
    s, t = _NODES.astype(half.dtype)
    axis = order[2][:, None]
    steep = jnp.where(slope[2] != 0, slope[2], jnp.inf)
    start = jnp.clip(-(form_a.value[:, None] + slope[0] * s + slope[1] * t) / steep, -_TALLEST, _TALLEST)
    back = jnp.argsort(order, axis=0)[..., None]

    def points(z: Array) -> Array:
        sides = jnp.stack([centre[0] + half[0] * s, centre[1] + half[1] * t, centre[2] + half[2] * z])
        return jnp.take_along_axis(sides, back, axis=0)

    def step(_: int, z: Array) -> Array:
        at = jets(jnp.asarray(a.coefficients), points(z))
        rate = jnp.take_along_axis(at.gradient, axis[None], axis=0)[0] * half[2]
        move = at.value / jnp.where(rate != 0, rate, jnp.inf)
        return jnp.clip(z - move, -_TALLEST, _TALLEST)

    z = jax.lax.fori_loop(0, _STEPS_OF_NODES, step, varying(start, a, cells))
    return points(z), _fitted(z.T)


def _graph(a: Side, cells: Boxes, order: Array, height: Array) -> tuple[_Graph, _OnPiece]:
    """The graph, and a over boxes as tall as it is, so that both of them are in these."""
    centre, half = _sorted(cells.centre, order), _sorted(cells.half, order)
    dtype = half.dtype
    tall = jnp.maximum(jnp.sum(jnp.abs(height), axis=0), 1.0) * (1 + gamma(64, dtype))
    wide = cells._replace(half=jnp.where(jnp.arange(3)[:, None] == order[2], tall * cells.half, cells.half))
    f = form(a, wide)
    local = jnp.stack([jnp.moveaxis(f.local, k, 2) for k in range(3)])
    # Moving one axis to the end leaves the order of the others, which is that of s and t but for the middle axis.
    local = local.at[1].set(jnp.swapaxes(local[1], 0, 1))
    local = jnp.take_along_axis(local, order[2].reshape(1, 1, 1, 1, -1), axis=0)[0]
    zero = jnp.zeros_like(height)
    share = half[2] / _sorted(wide.half, order)[2]
    variables = jnp.stack([zero.at[_S].set(1.0), zero.at[_T].set(1.0), height * share], axis=1)
    exact = Truncated(variables, jnp.full_like(variables[0], gamma(8, dtype)))
    return _Graph(order, centre, half, height, tall), _OnPiece(f, local, exact, *_rates(f, wide))


def _rates(f: Form, cells: Boxes) -> tuple[Array, Array]:
    """Bounds (3, cells) of the absolute values of the derivatives over cells: least, zero at least, and most."""
    dtype = f.slope.dtype
    size = jnp.abs(f.slope)
    loose = slope_changes(f) + f.error * sum(f.local.shape[:3]) + gamma(16, dtype) * size
    room = gamma(8, dtype)
    return jnp.maximum((size - loose) * (1 - room) / cells.half, 0.0), (size + loose) * (1 + room) / cells.half


def _beside_graph(graph: _Graph, on: _OnPiece, most: Array) -> Array:
    """How far points of a in cells are from P, where |f(P)| is at most so large."""
    least = jnp.take_along_axis(on.slowest, graph.order[2][None], axis=0)[0]
    away = most / jnp.where(least > 0, least, 1.0) * (1 + gamma(8, most.dtype))
    return jnp.where((least > 0) & (graph.tall <= _TALLEST), away, jnp.inf)


def _apart(graph: _Graph, q: Array) -> Array:
    """An upper bound of |P - Q|^2, q (terms, 3, cells) in the order of the coordinates."""
    dtype = q.dtype
    sides = jnp.take_along_axis(q, graph.order[None], axis=1)
    zero = jnp.zeros_like(graph.height)
    steps = jnp.stack([zero.at[_S].set(1.0), zero.at[_T].set(1.0), graph.height], axis=1) * graph.half
    terms = (sides - steps).at[0].set(sides[0] - graph.centre - steps[0])
    size = jnp.sum(jnp.abs(sides), axis=0) + jnp.abs(graph.centre) + jnp.sum(jnp.abs(steps), axis=0)
    w = Truncated(terms, gamma(16, dtype) * size)
    square = product(w, w)
    rest = jnp.sum(square.rest, axis=0) + gamma(8, dtype) * jnp.sum(w.size**2, axis=0)
    return largest(Truncated(jnp.sum(square.terms, axis=1), rest))


class _Ranges(NamedTuple):
    """Boxes that hold Q, (3, cells), and half the sides of larger ones about the same centres."""

    centre: Array
    reach: Array
    half: Array


def _piece(b: Side, q: Array) -> tuple[_Ranges, _OnPiece]:
    """Where Q is, with room to move, and b there."""
    dtype = q.dtype
    centre, reach = q[0], jnp.sum(jnp.abs(q[1:]), axis=0) * (1 + gamma(32, dtype))
    least = jnp.maximum(_LEAST * jnp.max(reach, axis=0), gamma(2**16, dtype))
    half = jnp.maximum(_WIDER * reach, reach + least)
    cells = Boxes(centre - half, centre + half, centre, half)
    f = form(b, cells)
    exact = Truncated((q / half).at[0].set(0.0), jnp.full_like(half, gamma(8, dtype)))
    return _Ranges(centre, reach, half), _OnPiece(f, f.local, exact, *_rates(f, cells))


def _off(b: Side, ranges: _Ranges, on: _OnPiece, most: Array) -> tuple[Array, Array]:
    """How far Q leaves the box of b, and how far b is from what is within, where |f(Q)| is at most so large."""
    centre, reach, half = ranges
    dtype = centre.dtype
    lower, upper = jnp.asarray(b.lower)[:, None], jnp.asarray(b.upper)[:, None]
    slack = gamma(8, dtype) * (jnp.abs(centre) + reach)
    low, high = centre - reach - slack, centre + reach + slack
    outside = jnp.maximum(jnp.maximum(lower - low, high - upper), 0.0)
    inside = jnp.where(outside > 0, 0.0, jnp.minimum(jnp.minimum(low - lower, upper - high), half - reach))
    # What is moved to the border has another value there.
    most = (most + jnp.sum(on.fastest * outside, axis=0)) * (1 + gamma(16, dtype))
    away = most / jnp.where(on.slowest > 0, on.slowest, 1.0) * (1 + gamma(16, dtype))
    away = jnp.where((on.slowest > 0) & (away < inside * (1 - gamma(8, dtype))), away, jnp.inf)
    within = jnp.all(outside <= 0.5 * (half - reach), axis=0)
    moved = jnp.sqrt(jnp.sum(outside**2, axis=0)) * (1 + gamma(8, dtype))
    return jnp.where(within, moved, jnp.inf), jnp.min(away, axis=0)
