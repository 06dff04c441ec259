"""Cells that a polynomial surface crosses near a corner, narrowed to where it may be.

With e in [-1, 1]^3 the polynomial is c + s.e + r(e) with |r(e)| <= R, so where it is zero

    s_i e_i is within sum over j other than i of |s_j|, and R, of -c.

What is left is as small as the part of the surface, up to the square of the size of the cell: feet are then near the
middle, and a surface that leaves the cell through a corner is a graph over all of it.

Source: ours; known as hull consistency in interval computation (Benhamou et al., Revising hull and box consistency,
ICLP 1999).
"""

import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.distance.frame.surfaces import Side
from jhd.distance.nearest.forms import boxes, form

# The shortest side of what is left, as a share of the longest, where the cell has room: across thinner ones the
# polynomial changes by less than its rounding.
_THINNEST = 2.0**-8


def narrowed(side: Side, low: Array, high: Array) -> tuple[Array, Array]:
    """The corners (3,) of a box within a cell that holds the part of a surface there; the cell where there is none."""
    dtype = low.dtype
    cells = boxes(low[:, None], high[:, None])
    f = form(side, cells)
    slope, value = f.slope[:, 0], f.value[0]
    size = jnp.abs(slope)
    total = jnp.sum(size)
    # Sums of what is positive, and the rounding of what they are compared with; their underflow is in the error.
    others = total - size + gamma(8, dtype) * total
    loose = (others + f.rest[0] + f.error[0] + gamma(8, dtype) * jnp.abs(value)) * (1 + gamma(8, dtype))
    steep = jnp.where(slope != 0, slope, 1.0)
    middle, reach = -value / steep, loose / size
    slack = gamma(8, dtype) * (jnp.abs(middle) + reach)
    centre, half = cells.centre[:, 0], cells.half[:, 0]
    ends = [centre + half * (middle + sign * (reach + slack)) for sign in (-1, 1)]
    room = gamma(8, dtype) * (jnp.abs(centre) + half * (jnp.abs(middle) + reach + slack)) + 8 * smallest_normal(dtype)
    # Where nothing is known, as where a slope is zero, NaN or infinite, an end is that of the cell.
    first = jnp.where(size > 0, jnp.maximum(low, ends[0] - room), low)
    last = jnp.where(size > 0, jnp.minimum(high, ends[1] + room), high)
    usable = jnp.all(first <= last)
    extent = last - first
    short = jnp.maximum(_THINNEST * jnp.max(extent) - extent, 0.0)
    first, last = jnp.maximum(first - short, low), jnp.minimum(last + short, high)
    return jnp.where(usable, first, low), jnp.where(usable, last, high)
