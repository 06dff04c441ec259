"""Proven bounds of distances between close surfaces, from changes of sign.

If f_b(p + v) - l f_a(p) and f_b(p - w) - m f_a(p) have opposite signs for all p of a cell, every p of a in the cell has
a point of b on the segment from p - w to p + v. So b is within the length of the longer vector. Any real l and m will
do, since f_a is zero on a. The remaining slack of second order is the difference of the curvatures of both surfaces:
nothing if they are parallel, however long the segments.

Source: ours; for the Bernstein form see jhd._distance.cells.surfaces.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jhd._arithmetic.polynomials import slopes
from jhd._arithmetic.rounding import smallest_normal, unit_roundoff
from jhd._distance.nearest.forms import Boxes, Form, form, multiples
from jhd._distance.normalization.surfaces import Side

# Room above the value that is expected to suffice, and errors of both ends in it.
_ROOM, _ERRORS = 1.1, 3.0


def sign_bounds(
    form_a: Form,
    b: Side,
    cells: Boxes,
    free: Bool[Array, "3 cells"],
    place: Float[Array, "3 cells"],
    foot: Float[Array, "3 cells"],
    least: Float[Array, ""],
) -> Float[Array, " cells"]:
    """Upper bounds of d(p, b) over the points p of a in cells; infinite if none is proven.

    Args:
        form_a: the polynomial of a on the cells.
        b: the other surface.
        cells: the cells.
        free: whether a cell does not touch the box of a in each coordinate.
        place: a point close to the cell.
        foot: its foot on b.
        least: smaller bounds are not needed.
    """
    unit, reach = _direction(b, cells, place, foot, least)
    value, gradient = slopes(b.coefficients, place + reach * unit)
    rate = jnp.sum(gradient * unit, axis=0)
    sign = jnp.where(rate < 0, -1.0, 1.0)
    steep = jnp.where(rate != 0, jnp.abs(rate), jnp.inf)
    expected = jnp.maximum(reach - sign * value / steep, 0.0)
    # The bound found must not exceed the sufficient one, rounding included.
    least = least * (1 - 64 * unit_roundoff(least.dtype))
    back = -jnp.minimum(2 * jnp.max(cells.half, axis=0), jnp.maximum(expected, least)) * unit
    back = jnp.where(_inside(b, cells, back), back, 0.0)
    ends, error = _ends(form_a, form(b, _moved(cells, back)), sign, free)
    below = jnp.any(ends[1] < -1.01 * error, axis=0)
    needed = jnp.min(_ROOM * (ends[2] - ends[0]) + _ERRORS * error, axis=0) / steep
    ahead = jnp.maximum(least, expected + needed)
    ahead = jnp.where(ahead < 4.0, ahead, 0.0)
    front = ahead * unit
    ends, error = _ends(form_a, form(b, _moved(cells, front)), sign, free)
    above = jnp.any(ends[0] > 1.01 * error, axis=0)
    inside = jnp.all(_inside(b, cells, back) & _inside(b, cells, front), axis=0)
    lengths = jnp.sqrt(jnp.maximum(jnp.sum(back**2, axis=0), jnp.sum(front**2, axis=0)))
    lengths = lengths * (1 + 8 * unit_roundoff(lengths.dtype)) + smallest_normal(lengths.dtype) ** 0.5
    return jnp.where(below & above & inside & jnp.isfinite(lengths), lengths, jnp.inf)


def _direction(b: Side, cells: Boxes, place: Array, foot: Array, least: Array) -> tuple[Array, Array]:
    """Unit normals of b, pointing to b, along the faces of its box that cells would cross, and distances along them."""
    _, gradient = slopes(b.coefficients, foot)
    apart = foot - place
    reach = jnp.maximum(jnp.sqrt(jnp.sum(apart**2, axis=0)), least)
    vector = jnp.where(jnp.sum(gradient * apart, axis=0) < 0, -gradient, gradient)
    vector = jnp.where(_inside(b, cells, 1.1 * reach * _unit(vector)), vector, 0.0)
    unit = _unit(vector)
    return unit, jnp.abs(jnp.sum(unit * apart, axis=0))


def _unit(vector: Array) -> Array:
    length = jnp.sqrt(jnp.sum(vector**2, axis=0))
    return vector / jnp.where(length > 0, length, jnp.inf)


def _ends(form_a: Form, form_b: Form, sign: Array, free: Array) -> tuple[tuple[Array, Array, Array], Array]:
    """Smallest, largest and middle values of sign (f_b - l f_a) for some l, (trials, cells), and their errors."""
    factors = multiples(form_b.slope, form_a.slope, free)
    values = sign * (form_b.terms - factors[:, None] * form_a.terms)
    middle = sign * (form_b.value - factors * form_a.value)
    error = form_b.error + jnp.abs(factors) * form_a.error
    return (jnp.min(values, axis=1), jnp.max(values, axis=1), middle), error


def _moved(cells: Boxes, by: Array) -> Boxes:
    """The cells moved; the rounding of the center is a part of the error of a form."""
    return cells._replace(center=cells.center + by)


def _inside(side: Side, cells: Boxes, by: Array) -> Array:
    """Return in which coordinates the moved cells are proven to lie in the box.

    A rounded sum below a float proves that the exact one is.
    """
    low, high = jnp.asarray(side.lower)[:, None], jnp.asarray(side.upper)[:, None]
    still = (by == 0) & (cells.upper <= high) & (cells.lower >= low)
    return still | ((cells.upper + by < high) & (cells.lower + by > low))
