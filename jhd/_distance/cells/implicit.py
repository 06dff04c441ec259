"""Implicit surfaces in the search for minimum distances: a cell of one is a part of its box.

Rounding: polynomials by `jhd._arithmetic.trivariate`, to which the errors of the coefficients are added here, all else
in balls. Coordinates and coefficients are at most one (jhd._distance.normalization.surfaces).
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic import trivariate
from jhd._arithmetic.balls import Ball
from jhd._arithmetic.interval import Interval
from jhd._arithmetic.polynomials import SYMMETRIC, derivatives, horner, jets
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.nearest.forms import underflow
from jhd._distance.normalization.net_jets import Net, enclosed, eta, jet, point_error
from jhd._distance.normalization.surfaces import Side


def size_of(shape: Net | Side) -> Array:
    """Largest absolute coordinate of the shape or of its box."""
    if isinstance(shape, Side):
        return jnp.maximum(jnp.max(jnp.abs(shape.lower)), jnp.max(jnp.abs(shape.upper)))
    return jnp.max(jnp.abs(shape.points))


def error_of(shape: Net | Side) -> Array:
    """Bound on the error of the length of a computed point."""
    size = size_of(shape)
    if isinstance(shape, Side):
        return 2 * math.sqrt(3) * gamma(12, size.dtype) * size
    return point_error(shape) * size


class Local(NamedTuple):
    """One shape over a cell: balls of the point and its derivatives, and of its polynomial in the parameters."""

    point: Ball
    first: Ball
    second: Ball
    value: Ball | None
    slope: Ball | None  # in space
    bent: Ball | None


class At(NamedTuple):
    """One shape at a point, not enclosed: point and derivatives, polynomial and derivatives in the parameters."""

    point: Array
    first: Array
    second: Array
    value: Array | None
    slope: Array | None
    bent: Array | None


def shape_at(shape: Any, part: Net | None, low: Array, width: Array, x: Array) -> At:
    """Evaluate a shape, of which a net has a part, at x of [0, 1]^n in the cell that starts at `low`; not enclosed."""
    if part is not None:
        j = jet(part, x)
        return At(j.point, j.first, j.second, None, None, None)
    point = low + x * width
    value, gradient, bent = jets(jnp.asarray(shape.coefficients), point)
    zero = jnp.zeros((3, 3, 3), width.dtype)
    return At(point, jnp.diag(width), zero, value, gradient * width, bent * width[:, None] * width)


def shape_over(shape: Any, part: Net | None, low: Array, high: Array) -> Local:
    """Enclose a shape, of which a net has a part, over a cell."""
    if part is not None:
        size = size_of(shape)
        j = enclosed(part, eta(shape) * size, eta(shape))
        return Local(j.point, j.first, j.second, None, None, None)
    center, half = 0.5 * (low + high), 0.5 * (high - low)
    # Wider by the roundings of both.
    half = half * (1 + gamma(4, half.dtype)) + gamma(6, half.dtype) * jnp.maximum(jnp.abs(low), jnp.abs(high))
    table = derivatives(jnp.asarray(shape.coefficients))
    ranges = jax.vmap(lambda c: trivariate.enclose(c, center[:, None], half[:, None]))(table)
    balls = _with_errors(shape, ranges, jnp.maximum(jnp.abs(low), jnp.abs(high)))
    width, zero = high - low, jnp.zeros((3, 3, 3), low.dtype)
    first = Ball(jnp.diag(width), gamma(4, width.dtype) * jnp.diag(width))
    take = lambda rows: jax.tree_util.tree_map(lambda x: x[rows], balls)  # noqa: E731
    return Local(Ball(center, half), first, Ball(zero, zero), take(0), take(np.arange(1, 4)), take(4 + SYMMETRIC))


def polynomial_at(shape: Side, x: Array) -> tuple[Ball, Ball]:
    """Balls of the exact polynomial and of its gradient at a point."""
    table = derivatives(jnp.asarray(shape.coefficients))[:4]
    balls = _with_errors(shape, jax.vmap(lambda c: trivariate.evaluate(c, x[:, None]))(table), jnp.abs(x))
    return Ball(balls.mid[0], balls.rad[0]), Ball(balls.mid[1:], balls.rad[1:])


def _with_errors(shape: Side, ranges: Interval, far: Array) -> Ball:
    """Balls of the first rows of the table of derivatives, from ranges (rows, 1) for its computed coefficients.

    The errors of the coefficients, and the roundings of the derivatives' coefficients, move a value by at most the sum
    of their terms at the largest coordinates.
    """
    balls = between(ranges.lower[:, 0], ranges.upper[:, 0])
    rounded = gamma(8, far.dtype) * jnp.abs(jnp.asarray(shape.coefficients))
    moved = horner(derivatives(1.01 * jnp.asarray(shape.error) + rounded)[: len(balls.mid)], far[:, None])[:, 0]
    return Ball(balls.mid, balls.rad + moved + underflow(far.dtype))


def between(lower: Array, upper: Array) -> Ball:
    """Return the ball of an interval."""
    mid = 0.5 * lower + 0.5 * upper
    size = jnp.maximum(jnp.abs(lower), jnp.abs(upper))
    return Ball(mid, (0.5 * upper - 0.5 * lower) + gamma(8, mid.dtype) * size + 16 * smallest_normal(mid.dtype))
