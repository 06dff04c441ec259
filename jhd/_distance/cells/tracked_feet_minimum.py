"""Lower bounds of functions of a point of a cell of a and a point of b that are convex in the point of b.

Let L(u, x) have second derivatives in x of at least 2 diag(k), k > 0, on a box that holds the points x in question and
the values of a map Q(u), and let R(u) be its first derivatives at Q. Then for all such x

    L(u, x) >= L(u, Q(u)) + sum R_i (x_i - Q_i) + k_i (x_i - Q_i)^2,

so L is bounded by the least value of the first term over u, and of each of the other terms over the ranges of R_i and
of x_i - Q_i.

The distance of Q from the foot enters through R, and so counts squared. With h the size of the cell of a, the bound is
short by h^8 if the distance is constant along a: the cell of b may be as large as L is convex.

Source: ours.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.truncated import EXPONENTS, Truncated, dot, extremes, largest, scaled
from jhd._arithmetic.truncated import plus as added

# Steps from side to side towards the least value of a parabola.
_DESCENTS = 8
_S, _T, _SS, _ST, _TT = (EXPONENTS.index(powers) for powers in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2)))


class MovingPoint(NamedTuple):
    """Points of a shape over a cell, as polynomials of one or two numbers in [-1, 1]."""

    point: Truncated  # the points (terms, 3)
    beside: Array  # largest distance of the shape from them; infinite if it is not known to be near
    # Deviation of the polynomial of an implicit surface from a linear one, along each coordinate; else zero.
    bent: Array


class MovingSquare(NamedTuple):
    """A lower bound of the squared distance of moving points from b, and whether L is proven convex on b."""

    lower: Array
    convex: Array


def less(x: Truncated, y: Truncated) -> Truncated:
    """Return x - y."""
    return added(x, scaled(y, -1.0))


def least(total: Truncated) -> Array:
    """Lower bound of a function over the square: the better of its own range and the range minus a sum of squares."""
    below = scaled(total, -1.0)
    return jnp.maximum(-largest(below), -largest(added(below, _parabola(total.terms))))


def _parabola(terms: Array) -> Truncated:
    """Sum of squares of linear functions, close to the rise of a polynomial above its minimum."""
    a, b, c = 2 * terms[_SS], terms[_ST], 2 * terms[_TT]
    mean, root = 0.5 * (a + c), jnp.hypot(0.5 * (a - c), b)
    angle = 0.5 * jnp.arctan2(2 * b, a - c)
    rates = jnp.maximum(jnp.stack([mean + root, mean - root]), 0.0)
    along = jnp.stack([jnp.stack([jnp.cos(angle), jnp.sin(angle)]), jnp.stack([-jnp.sin(angle), jnp.cos(angle)])])

    def descend(_: int, z: tuple[Array, Array]) -> tuple[Array, Array]:
        s = jnp.clip(-(terms[_S] + b * z[1]) / jnp.where(a > 0, a, jnp.inf), -1.0, 1.0)
        return s, jnp.clip(-(terms[_T] + b * s) / jnp.where(c > 0, c, jnp.inf), -1.0, 1.0)

    z = jax.lax.fori_loop(0, _DESCENTS, descend, (jnp.zeros_like(a), jnp.zeros_like(a)))
    factors = along * jnp.sqrt(0.5 * rates)[:, None]
    shift = factors[:, 0] * z[0] + factors[:, 1] * z[1]
    zero = jnp.zeros((terms.shape[0], *shift.shape), terms.dtype)
    # These numbers may be chosen freely, so nothing that they are computed with counts as an error.
    lines = Truncated(zero.at[_S].set(factors[:, 0]).at[_T].set(factors[:, 1]).at[0].set(-shift), jnp.zeros_like(shift))
    return dot(lines, lines)


def least_of_rest(rest: Truncated, bent: Array, low: Array, high: Array) -> Array:
    """A lower bound of r t + k t^2 for each of some functions r over the square, and all t of a range.

    Args:
        rest: the functions r.
        bent: the numbers k > 0, of any shape that fits.
        low: the least t, proven.
        high: the largest t.
    """
    dtype = low.dtype
    # Of positive t the least slope counts, of negative t the largest.
    ends = extremes(rest)
    ranges = (jnp.maximum(low, 0.0), jnp.maximum(high, 0.0)), (jnp.minimum(low, 0.0), jnp.minimum(high, 0.0))

    def over(slope: Array, first: Array, last: Array) -> Array:
        t = jnp.clip(-slope / (2 * bent), first, last)
        # Off the minimum by its roundings, the value is off by their square.
        size = jnp.abs(slope * t) + bent * t * t
        return slope * t + bent * t * t - gamma(16, dtype) * size - 16 * smallest_normal(dtype)

    found = [over(slope, *span) for slope, span in zip(ends, ranges, strict=True)]
    # A part without a t of this sign has the value at zero, or, on the opposite side, does not exist.
    return jnp.where(low > 0, found[0], jnp.where(high < 0, found[1], jnp.minimum(*found)))
