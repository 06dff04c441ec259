"""Checks of knots, knot spans and blossoms: the kernels of B-spline curves.

On a non-empty span every step is a combination (1 - a) x + a y with a = (u - left) / (right - left) and left < right,
convex for u in the span. An empty span has no polynomial of its own; it uses the polynomial of the last non-empty span
before it, which makes it a point of the curve.

Source: Ramshaw, Blossoms are polar forms, CAGD 6 (1989); Boehm, Inserting new knots into B-spline curves, CAD 12
(1980).
"""

import operator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jhd._runtime.arrays import is_traced, module_of


def checked_degree(degree: Any) -> int:
    """The degree as an integer of at least 0."""
    try:
        value = operator.index(degree)
    except TypeError as error:
        raise TypeError(f"degree must be an integer; got {degree!r}.") from error
    if value < 0:
        raise ValueError(f"degree is {value}; needs at least 0.")
    return value


def clamped_knots(count: int, degree: Any) -> np.ndarray:
    """The knots 0, 1, ... for so many points, of which the first and the last have multiplicity degree + 1."""
    p = checked_degree(degree)
    return np.clip(np.arange(count + p + 1.0) - p, 0, max(count - p, 0))


def check_knots(name: str, knots: Any, axis: str, count: int, periodic: bool = False) -> None:
    """Raise ValueError unless knots suit `count` points, named `axis`, and if known, rise, span a length and repeat."""
    if len(knots.shape) != 1:
        raise ValueError(f"{name} has shape {knots.shape}; needs ({name},).")
    number = knots.shape[0]
    degree = number - count - 1
    if degree < 0:
        raise ValueError(f"{name} has {number} entries; {count} {axis} need at least {count + 1}.")
    kind, needed = ("periodic degree", max(degree, 1)) if periodic else ("degree", degree + 1)
    if count < needed:
        raise ValueError(
            f"control_points has {count} {axis}; {kind} {degree} ({number} knots) needs at least {needed}."
        )
    if is_traced(knots):
        return
    known = np.asarray(knots)
    for k in np.flatnonzero(np.diff(known) < 0)[:1]:
        raise ValueError(f"{name}[{k + 1}] is {known[k + 1]:g}; needs at least {name}[{k}] = {known[k]:g}.")
    last = number - 1 if periodic else count
    if known[degree] == known[last]:
        raise ValueError(f"{name}[{degree}] and {name}[{last}] are both {known[last]:g}; the domain has length zero.")
    loose, wanted = not_repeated(known, degree) if periodic else ((), known)
    for k in np.flatnonzero(loose)[:1]:
        came, needs = f"{name}[{count + k}] is {known[count + k]:g}", f"{name}[{k}] + period = {wanted[k]:g}"
        raise ValueError(f"{came}; a periodic spline needs {needs}.")


def blossom(
    points: Float[Any, "*#rows points width"],
    knots: Float[Any, "*#rows knots"],
    arguments: Float[Any, "*#rows arguments"],
) -> Any:
    """The blossom of the polynomial on one knot span; with all arguments equal to u, its value at u (de Boor).

    Leading axes broadcast. NumPy arrays give NumPy arrays.

    Args:
        points: the p + 1 control points d_{i-p}, ..., d_i of the span [t_i, t_{i+1}].
        knots: the 2 p knots t_{i-p+1}, ..., t_{i+p}, with t_i < t_{i+1}.
        arguments: p parameters; every step is convex if they are in the span.
    """
    p = arguments.shape[-1]
    for r in range(p):
        left, right = knots[..., r:p], knots[..., p : 2 * p - r]
        a = ratio(arguments[..., r : r + 1] - left, right - left)[..., None]
        points = (1 - a) * points[..., :-1, :] + a * points[..., 1:, :]
    return points[..., 0, :]


def ratio(numerator: Any, width: Any) -> Any:
    """Numerator over width, zero if the width is not positive: no NaN in the value or in its derivatives."""
    xp = module_of(width)
    positive = width > 0
    return xp.where(positive, numerator / xp.where(positive, width, 1.0), 0.0)


def local_arrays(h: Any, knots: Any, p: int, spans: Int[Any, "*rows"]) -> tuple[Any, Any]:
    """The p + 1 points and 2 p knots of spans, counted from the first of the domain."""
    return h[spans[..., None] + np.arange(p + 1)], knots[spans[..., None] + np.arange(1, 2 * p + 1)]


def bezier_points(points: Any, knots: Any, lower: Any, upper: Any) -> Any:
    """Bezier points of spans' polynomials between two parameters: blossoms at p - j times lower, j times upper."""
    p = points.shape[-2] - 1
    first = np.arange(p)[None] < p - np.arange(p + 1)[:, None]
    arguments = module_of(lower).where(first, lower[..., None, None], upper[..., None, None])
    return blossom(points[..., None, :, :], knots[..., None, :], arguments)


def unrolled(knots: Any, p: int, periodic: bool) -> Any:
    """Knots of the open spline over the same domain; NumPy knots give a NumPy array."""
    if not periodic:
        return knots
    xp = module_of(knots)
    # Relative to the last knot, so that rounding cannot make the knots decrease.
    return xp.concatenate([knots, knots[-1] + (knots[p + 1 : 2 * p + 1] - knots[p])])


def not_repeated(knots: Any, p: int) -> tuple[Any, Any]:
    """Mask of the last knots of a periodic spline that are not the first ones plus a period, and these sums."""
    xp, n = module_of(knots), knots.shape[0] - p - 1
    wanted = knots[: p + 1] + (knots[n] - knots[0])
    return xp.abs(knots[n:] - wanted) > tolerance(knots), wanted


def tolerance(values: Any) -> Any:
    """Largest difference of numbers that count as equal when points or knots repeat."""
    xp = module_of(values)
    # Knots of a periodic spline repeat to this many ulp of the largest knot: one subtraction and one addition each way.
    return 8 * float(np.finfo(values.dtype).eps) * xp.max(xp.abs(values))


def spans(knots: Any, p: int, periodic: bool) -> tuple[Any, Any, Any]:
    """For each piece of the domain the non-empty span that carries it, and the parameters of its ends.

    An empty span is carried by the last non-empty one before it, at whose upper end it sits. If there is none before
    it, a periodic curve takes its last non-empty span, and an open curve its first.
    """
    xp = module_of(knots)
    pieces = knots.shape[0] - 1 - 2 * p
    lower, upper = knots[p : p + pieces], knots[p + 1 : p + 1 + pieces]
    full = upper > lower
    marks = xp.where(full, np.arange(pieces), -1)
    before = np.maximum.accumulate(marks) if xp is np else lax.cummax(marks)
    leading = before < 0
    span = xp.where(leading, xp.max(marks) if periodic else xp.argmax(full), before)
    point = xp.where(leading & (not periodic), lower[span], upper[span])
    return span, xp.where(full, lower, point), xp.where(full, upper, point)


def evaluate(h: Array, knots: Array, p: int, periodic: bool, t: Float[Array, " samples"]) -> Array:
    """Points of an unrolled spline at parameters t; before and after the domain the end polynomials are extended."""
    span = spans(knots, p, periodic)[0]
    piece = jnp.searchsorted(knots[p : p + span.shape[0]], t, side="right") - 1
    local = span[jnp.clip(piece, 0, span.shape[0] - 1)]
    return blossom(*local_arrays(h, knots, p, local), jnp.broadcast_to(t[:, None], (*t.shape, p)))


def bezier_pieces(h: Any, knots: Any, p: int, periodic: bool) -> tuple[Any, Any]:
    """Bezier points of all pieces of an unrolled spline, and a mask of the pieces before which it may jump.

    A jump is possible if the multiplicity of the knot exceeds p; the first piece of an open curve is marked, too.
    Any other piece starts with the end of the piece before it, so that rounding leaves no gap. NumPy arrays give
    NumPy arrays. If knots decrease or do not repeat, as after a step of an optimizer, or the domain has no
    length, there is no spline: points are NaN.
    """
    xp = module_of(h)
    span, lower, upper = spans(knots, p, periodic)
    pieces = bezier_points(*local_arrays(h, knots, p, span), lower, upper)
    count = span.shape[0]
    jumps = (knots[p : p + count] == knots[:count]) | ((np.arange(count) == 0) & (not periodic))
    valid = xp.all(knots[1:] >= knots[:-1]) & (knots[p + count] > knots[p])
    if periodic:
        valid = valid & ~xp.any(not_repeated(knots[: knots.shape[0] - p], p)[0])
    pieces = xp.where(valid, pieces, xp.nan)
    starts = xp.where(jumps[:, None], pieces[:, 0], xp.roll(pieces[:, -1], 1, axis=0))
    return xp.concatenate([starts[:, None], pieces[:, 1:]], axis=1), jumps


def insert(h: Array, knots: Array, p: int, u: Array) -> tuple[Array, Array]:
    """Points and knots of an open spline after one more knot at u inside the domain, by Boehm's algorithm."""
    left, right = knots[: h.shape[0] + 1], knots[p : p + h.shape[0] + 1]
    a = jnp.where(right <= u, 1.0, jnp.where(left >= u, 0.0, ratio(u - left, right - left)))[:, None]
    points = (1 - a) * jnp.concatenate([h[:1], h]) + a * jnp.concatenate([h, h[-1:]])
    return points, jnp.sort(jnp.append(knots, u))


@partial(jax.jit, static_argnames=("p", "below", "present"))
def _parted(h: Array, knots: Array, u: Array, p: int, below: int, present: int) -> tuple[Array, Array]:
    for _ in range(p - present):
        h, knots = insert(h, knots, p, u)
    return h[:below], h[below + max(p, present) - 1 - p :]


def parted(h: Array, knots: np.ndarray, p: int, t: Any) -> tuple[tuple[Array, np.ndarray], tuple[Array, np.ndarray]]:
    """Points and knots of an open spline before and after t, strictly inside the domain; both clamped at the cut.

    Knots and t are known numbers, on which the numbers of points of the parts depend.
    """
    place = np.asarray(t, dtype=knots.dtype)
    below, present = int(np.sum(knots < place)), int(np.sum(knots == place))
    before, after = _parted(h, jnp.asarray(knots), jnp.asarray(place), p, below, present)
    cut = np.full(p + 1, place)
    return (before, np.append(knots[:below], cut)), (after, np.append(cut, knots[below + present :]))
