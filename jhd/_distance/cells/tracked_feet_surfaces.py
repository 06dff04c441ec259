"""Proven lower bounds of the distance of two implicit surfaces by feet and multipliers that move with the point.

In a cell that a = {f = 0} crosses in one sheet, a is near a polynomial P(s, t) (jhd._distance.cells.graphs). With it go
polynomials Q(s, t) and v(s, t): approximately a nearest point of b = {g = 0}, which need not be in the cell D of b, and
the multiplier there. For every fixed (s, t) and any number r >= 0 the function

    L(q) = |P - q|^2 + v g(q) + r g(q)^2

is |P - q|^2 on b. If its second derivatives are at least 2 m > 0 on a box E that holds D and Q, for all q in D

    L(q) >= L(Q) + R.(q - Q) + m |q - Q|^2,   R = 2 (Q - P) + (v + 2 r g(Q)) grad g(Q),

and each coordinate of the last two terms subtracts at most R_i^2 / 4 m, or less if R_i points to D
(jhd._distance.cells.tracked_feet_minimum). The distance of Q from the true foot enters through R, and so counts
squared. With h the size of the cell, the bound

    min (|P - Q|^2 + v g(Q)) - sum max R_i^2 / 4 m

is short by h^8 if the distance is constant along a: no cell of b has to be small, and only few cells of a. If the
distance is not constant, a square (w.(s, t) - c)^2 is subtracted before Bernstein coefficients bound the minimum. It is
close to the parabola that the distance follows, and nowhere negative.

Rounding: P, Q and v are their floating-point coefficients. The errors of all that is computed from them are in
jhd._arithmetic.truncated, in the errors of forms (jhd._distance.nearest.forms), and in balls.

Cells that a surface crosses near a corner are narrowed first. With e in [-1, 1]^3 the polynomial is c + s.e + r(e) with
|r(e)| <= R, so at its zeros

    s_i e_i is within sum over j other than i of |s_j|, and R, of -c.

The part that remains is as small as the part of the surface, up to the square of the size of the cell. Feet are then
near the middle, and a surface that leaves the cell through a corner is a graph over the whole box.

Source: ours; the quadratic term in g as in Bertsekas, Constrained Optimization and Lagrange Multiplier Methods (1982);
narrowing is known as hull consistency in interval computation (Benhamou et al., Revising hull and box consistency,
ICLP 1999).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.balls import Ball, plus, semidefinite, times
from jhd._arithmetic.polynomials import slopes
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.truncated import Truncated, composed, derivative, dot, extremes, largest, product, scaled
from jhd._arithmetic.truncated import plus as added
from jhd._distance.cells.graphs import S, T, at_nodes, beside_graph, fitted, graph_over, values_on_graph
from jhd._distance.cells.implicit import between, shape_over
from jhd._distance.cells.tracked_feet_minimum import MovingPoint, MovingSquare, least, least_of_rest, less
from jhd._distance.cells.tracked_feet_upper import piece_about
from jhd._distance.nearest.forms import boxes, form, slope_changes
from jhd._distance.nearest.surface_points import local_feet
from jhd._distance.normalization.surfaces import Side

# Newton steps for the foot of the middle, and from there for the feet of the nodes.
_FIRST, _STEPS_OF_FEET = 6, 3
# Factors of the quadratic term, relative to the slope of g, and moduli of convexity 2 m, that are tried.
_HEAVY = (0.0, 4.0)
_MODULI = (1.0, 0.1, 0.01)
# The shortest side of the narrowed box, as a fraction of the longest, if the cell has room: across thinner boxes the
# polynomial changes by less than its rounding.
_THINNEST = 2.0**-8


class _MovingFoot(NamedTuple):
    """Q - P, the polynomial of b at Q, its gradient and the multiplier; the range of Q."""

    apart: Truncated
    value: Truncated
    gradient: Truncated
    multiplier: Truncated
    low: Array
    high: Array


def points_of_surface(a: Side, low: Array, high: Array) -> MovingPoint:
    """Return the graph near a in a cell."""
    cells = boxes(low[:, None], high[:, None])
    form_a = form(a, cells)
    graph, on = graph_over(form_a, a, cells)[1:]
    zero = jnp.zeros_like(graph.height)
    terms = jnp.stack([zero.at[S].set(1.0), zero.at[T].set(1.0), graph.height], axis=1) * graph.half
    size = jnp.abs(graph.center) + jnp.sum(jnp.abs(terms), axis=0)
    terms, back = terms.at[0].add(graph.center), jnp.argsort(graph.order, axis=0)
    terms, rest = jnp.take_along_axis(terms, back[None], axis=1), jnp.take_along_axis(size, back, axis=0)
    point = Truncated(terms[..., 0], gamma(8, low.dtype) * rest[:, 0])
    return MovingPoint(point, beside_graph(graph, on, values_on_graph(on))[0], slope_changes(form_a)[:, 0])


def square_to_surface(b: Side, point: Truncated, low: Array, high: Array, start: Array) -> MovingSquare:
    """Lower bound of the squared distance of moving points from the part of b in a cell."""
    places = at_nodes(point.terms).T
    first = _first_foot(b, point.terms[0], start, low, high)
    feet = local_feet(b, places, jnp.broadcast_to(first, places.shape), _STEPS_OF_FEET)
    moving = _moving(b, point, feet, _multipliers(b, places, feet))
    ends = jnp.minimum(low, moving.low), jnp.maximum(high, moving.high)
    v = between(*extremes(moving.multiplier))
    modulus, heavy = _convexity(b, *ends, v, moving.gradient.terms[0])
    square, rest = least(_square(moving)), _rest(moving, modulus, heavy, low, high)
    return MovingSquare(square + rest - gamma(4, low.dtype) * (jnp.abs(square) + jnp.abs(rest)), modulus > 0)


def distance_to_surface(b: Side, point: Truncated, start: Array) -> Array:
    """Upper bound of the distances of all moving points from b; infinite if none is proven.

    A point of b is within |g| divided by the least slope along one direction n from Q(s, t), if a box about Q has room
    for it: within this length the polynomial changes its sign along n.

    Args:
        b: the surface.
        point: the moving point.
        start: a point of b at which the search for feet starts.
    """
    dtype = start.dtype
    places = at_nodes(point.terms).T
    feet = local_feet(b, places, jnp.broadcast_to(start[:, None], places.shape), _FIRST)
    moving = _moving(b, point, feet, jnp.zeros_like(feet[0]))
    far = jnp.sqrt(jnp.maximum(largest(_square(moving)), 0.0)) * (1 + gamma(4, dtype))
    least_value, most_value = extremes(moving.value)
    value = jnp.maximum(most_value, -least_value)
    slope = moving.gradient.terms[0]
    size = jnp.sqrt(jnp.sum(slope**2))
    unit = slope / jnp.where(size > 0, size, 1.0)
    reach = 4 * value / jnp.where(size > 0, size, 1.0)
    # With the rounding of the ends of the box.
    room = reach + gamma(8, dtype) * jnp.maximum(jnp.abs(moving.low), jnp.abs(moving.high))
    low, high = moving.low - room, moving.high + room
    over: Any = shape_over(b, None, low, high)
    least_slope = jnp.sum(unit * over.slope.mid) - jnp.sum(jnp.abs(unit) * over.slope.rad)
    least_slope -= gamma(8, dtype) * jnp.sum(jnp.abs(unit) * (jnp.abs(over.slope.mid) + over.slope.rad))
    off = value / jnp.where(least_slope > 0, least_slope, 1.0) * (1 + gamma(16, dtype))
    inside = jnp.all((low >= jnp.asarray(b.lower)) & (high <= jnp.asarray(b.upper)))
    total = (far + off) * (1 + gamma(4, dtype))
    proven = (least_slope > 0) & (off * (1 + gamma(8, dtype)) <= reach) & inside & jnp.isfinite(total)
    return jnp.where(proven, total, jnp.inf)


def _first_foot(b: Side, place: Array, start: Array, low: Array, high: Array) -> Array:
    """Return a foot (3, 1) of a point: the nearer to a box of two, found from a start and from the point itself."""
    own = jnp.clip(place, jnp.asarray(b.lower), jnp.asarray(b.upper))
    places = jnp.stack([place, place], axis=1)
    found = local_feet(b, places, jnp.stack([own, start], axis=1), _FIRST)
    value, gradient = slopes(jnp.asarray(b.coefficients), found)
    slope = jnp.sqrt(jnp.sum(gradient**2, axis=0))
    off = jnp.abs(value) / jnp.where(slope > 0, slope, jnp.inf) + jnp.where(slope > 0, 0.0, jnp.inf)
    far = jnp.sqrt(jnp.sum((found - places) ** 2, axis=0)) + off
    apart = jnp.maximum(jnp.maximum(low[:, None] - found, found - high[:, None]), 0.0)
    out = jnp.sqrt(jnp.sum(apart**2, axis=0)) + off
    nearer = jnp.where(out[0] == out[1], far[0] <= far[1], out[0] < out[1])
    return jnp.where(nearer, found[:, :1], found[:, 1:])


def _multipliers(b: Side, places: Array, feet: Array) -> Array:
    """Approximate multipliers for which L is stationary at the feet, in the coordinates inside the box."""
    _, gradient = slopes(jnp.asarray(b.coefficients), feet)
    lower, upper = jnp.asarray(b.lower)[:, None], jnp.asarray(b.upper)[:, None]
    free = jnp.where((feet > lower) & (feet < upper), gradient, 0.0)
    square = jnp.sum(free**2, axis=0)
    return 2 * jnp.sum((places - feet) * free, axis=0) / jnp.where(square > 0, square, jnp.inf)


def _moving(b: Side, point: Truncated, feet: Array, multipliers: Array) -> _MovingFoot:
    """Return polynomials through the given feet and multipliers of the nodes, with the polynomial of b along them."""
    q, v = fitted(feet.T), fitted(multipliers)
    ranges, on = piece_about(b, q[..., None])
    dtype = q.dtype
    # The polynomial and its derivatives in the three sides, side by side.
    forms = jnp.stack([on.local, *(derivative(on.local, k) for k in range(3))], axis=3)
    variables = Truncated(on.variables.terms[:, :, None], on.variables.rest[:, None])
    four = composed(forms, variables)
    error = on.form.error * np.array([1.0, *[sum(on.local.shape[:3])] * 3])[:, None]
    four = Truncated(four.terms[..., 0], (four.rest + error * (1 + gamma(4, dtype)))[:, 0])
    gradient = scaled(Truncated(four.terms[:, 1:], four.rest[1:]), 1 / ranges.half[:, 0])
    gradient = Truncated(gradient.terms, gradient.rest * (1 + gamma(8, dtype)) + gamma(8, dtype) * gradient.size)
    apart = less(Truncated(q, jnp.zeros_like(q[0])), point)
    value = Truncated(four.terms[:, 0], four.rest[0])
    slack = ranges.reach * (1 + gamma(8, dtype)) + gamma(8, dtype) * jnp.abs(ranges.center)
    ends = ranges.center - slack, ranges.center + slack
    return _MovingFoot(apart, value, gradient, Truncated(v, jnp.zeros_like(v[0])), *(end[:, 0] for end in ends))


def seems_convex(b: Side, place: Array, low: Array, high: Array, start: Array) -> Array:
    """Return whether L is convex over a cell and the foot of one point; if not, other points are not tried.

    Nothing is proven by that: it decides which bounds are computed.
    """
    foot = _first_foot(b, place, start, low, high)
    multiplier = _multipliers(b, place[:, None], foot)[0]
    slope, foot = slopes(jnp.asarray(b.coefficients), foot)[1][:, 0], foot[:, 0]
    v = Ball(multiplier, jnp.zeros_like(multiplier))
    return _convexity(b, jnp.minimum(low, foot), jnp.maximum(high, foot), v, slope, _MODULI[-1:])[0] > 0


def _convexity(
    b: Side, low: Array, high: Array, v: Ball, slope: Array, moduli: tuple[float, ...] = _MODULI
) -> tuple[Array, Array]:
    """Return a lower bound 2 m of the second derivatives of L, zero if none is proven, and r."""
    over: Any = shape_over(b, None, low, high)
    dtype = low.dtype
    square = jnp.sum(slope**2)
    heavies = jnp.asarray(_HEAVY, dtype) / jnp.where(square > 0, square, jnp.inf)
    eye = jnp.eye(3, dtype=dtype)
    column, row = (Ball(*(jnp.expand_dims(x, i) for x in over.slope)) for i in (1, 0))
    outer = times(column, row)

    def proven(heavy: Array, modulus: Array) -> Array:
        twice = Ball(2 * heavy, jnp.zeros_like(heavy))
        factor = plus(v, times(twice, over.value))
        h = plus(times(over.bent, factor), times(outer, twice))
        h = plus(h, Ball((2 - modulus) * eye, gamma(4, dtype) * eye))
        return semidefinite(h, jnp.zeros(3, bool))

    trials = [(h, m) for m in moduli for h in range(len(_HEAVY))]
    each = heavies[np.array([h for h, _ in trials])], jnp.asarray([m for _, m in trials], dtype)
    found = jax.vmap(proven)(*each)
    first = jnp.argmax(found)
    return jnp.where(found[first], each[1][first], 0.0), each[0][first]


def _square(moving: _MovingFoot) -> Truncated:
    """Return |P - Q|^2 + v g(Q)."""
    return added(dot(moving.apart, moving.apart), product(moving.multiplier, moving.value))


def _rest(moving: _MovingFoot, modulus: Array, heavy: Array, low: Array, high: Array) -> Array:
    """Lower bound of R.(q - Q) + m |q - Q|^2."""
    dtype = low.dtype
    factor = added(moving.multiplier, scaled(moving.value, 2 * heavy))
    pull = product(Truncated(factor.terms[:, None], factor.rest[None]), moving.gradient)
    rest = added(pull, scaled(moving.apart, 2.0))
    size = gamma(4, dtype) * (jnp.abs(low) + jnp.abs(high) + jnp.abs(moving.low) + jnp.abs(moving.high))
    # With 2 m the modulus.
    bent = 0.5 * jnp.where(modulus > 0, modulus, 1.0)
    found = least_of_rest(rest, bent, low - moving.high - size, high - moving.low + size)
    return jnp.sum(found - gamma(8, dtype) * jnp.abs(found))


def narrowed(side: Side, low: Array, high: Array) -> tuple[Array, Array]:
    """Corners (3,) of a box within a cell that holds the surface there; the cell itself if there is none."""
    dtype = low.dtype
    cells = boxes(low[:, None], high[:, None])
    f = form(side, cells)
    slope, value = f.slope[:, 0], f.value[0]
    size = jnp.abs(slope)
    total = jnp.sum(size)
    # Sums of non-negative terms, with the rounding of the numbers they are compared with; their underflow is in the
    # error.
    others = total - size + gamma(8, dtype) * total
    loose = (others + f.rest[0] + f.error[0] + gamma(8, dtype) * jnp.abs(value)) * (1 + gamma(8, dtype))
    steep = jnp.where(slope != 0, slope, 1.0)
    middle, reach = -value / steep, loose / size
    slack = gamma(8, dtype) * (jnp.abs(middle) + reach)
    center, half = cells.center[:, 0], cells.half[:, 0]
    ends = [center + half * (middle + sign * (reach + slack)) for sign in (-1, 1)]
    room = gamma(8, dtype) * (jnp.abs(center) + half * (jnp.abs(middle) + reach + slack)) + 8 * smallest_normal(dtype)
    # If nothing is known, for example if a slope is zero, NaN or infinite, an end is the end of the cell.
    first = jnp.where(size > 0, jnp.maximum(low, ends[0] - room), low)
    last = jnp.where(size > 0, jnp.minimum(high, ends[1] + room), high)
    usable = jnp.all(first <= last)
    extent = last - first
    short = jnp.maximum(_THINNEST * jnp.max(extent) - extent, 0.0)
    first, last = jnp.maximum(first - short, low), jnp.minimum(last + short, high)
    return jnp.where(usable, first, low), jnp.where(usable, last, high)
