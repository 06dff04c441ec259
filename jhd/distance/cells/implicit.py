"""Implicit surfaces in the search for minimum distances: values over cells and at points, and points proven on them.

A cell of an implicit surface is a part of its box. A point is proven by signs: where the polynomial is positive at one
float of the box and negative at another one, the surface has a point on the segment between them. In floating point the
signs are those of enclosures, which err by far more than an ulp of the point; in integers they are exact.

Rounding: polynomials by `jhd.arithmetic.trivariate`, all else in balls; coordinates are the user's.
"""

import math
from fractions import Fraction
from itertools import product
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic import exact_polynomials, trivariate
from jhd.arithmetic.balls import Ball
from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.distance.cells.pairs import length
from jhd.distance.frame.net_jets import Net, enclosed, eta, jet, point_error

# Steps of Newton's method back onto a surface.
_BACK = 3
# Steps of signs in integers, as powers of two of the roundoff of the largest coordinate.
_RADII = (-2, 1, 4, 8)
# A direction within the faces serves unless the gradient is this much longer.
_TANGENT = 0.1
# Second derivatives xx, yy, zz, xy, xz, yz as a matrix.
_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


class Implicit(NamedTuple):
    """An implicit surface: its polynomial with the first and second derivatives, (10, i, j, k), and its box."""

    table: Array
    lower: Array
    upper: Array


def implicit(coefficients: Array, lower: Array, upper: Array) -> Implicit:
    """The surface with the derivatives of its polynomial, whose coefficients are rounded twice at most."""

    def derived(c: Array, axis: int) -> Array:
        n = c.shape[axis]
        factors = np.arange(n).reshape([-1 if i == axis else 1 for i in range(3)])
        moved = jnp.roll(c * factors, -1, axis=axis)
        return moved

    first = [derived(coefficients, axis) for axis in range(3)]
    second = [derived(first[i], j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return Implicit(jnp.stack([coefficients, *first, *second]), lower, upper)


def parameters(shape: Net | Implicit) -> int:
    """The number of parameters of a cell."""
    return 3 if isinstance(shape, Implicit) else shape.parameters


def size_of(shape: Net | Implicit) -> Array:
    """The largest coordinate."""
    if isinstance(shape, Implicit):
        return jnp.maximum(jnp.max(jnp.abs(shape.lower)), jnp.max(jnp.abs(shape.upper)))
    return jnp.max(jnp.abs(shape.points))


def error_of(shape: Net | Implicit) -> Array:
    """Bound on the error of the length of a computed point."""
    size = size_of(shape)
    if isinstance(shape, Implicit):
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


def values(shape: Implicit, x: Array) -> tuple[Array, Array, Array]:
    """Value, gradient and second derivatives at a point, not enclosed."""
    c = shape.table
    for axis in range(3):
        t, rows = x[axis], jnp.moveaxis(c, 1, 0)
        c = rows[-1]
        for row in rows[-2::-1]:
            c = c * t + row
    return c[0], c[1:4], c[4:][_SYMMETRIC]


def shape_at(shape: Net | Implicit, part: Any, low: Array, width: Array, x: Array) -> At:
    """A shape at a place x of [0, 1]^n in the cell from `low` on, not enclosed."""
    if not isinstance(shape, Implicit):
        j = jet(part, x)
        return At(j.point, j.first, j.second, None, None, None)
    point = low + x * width
    value, gradient, bent = values(shape, point)
    zero = jnp.zeros((3, 3, 3), width.dtype)
    return At(point, jnp.diag(width), zero, value, gradient * width, bent * width[:, None] * width)


def shape_over(shape: Net | Implicit, part: Any, low: Array, high: Array) -> Local:
    """A shape over a cell."""
    if not isinstance(shape, Implicit):
        size = size_of(shape)
        j = enclosed(part, eta(shape) * size, eta(shape))
        return Local(j.point, j.first, j.second, None, None, None)
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    # Wider by the roundings of both.
    half = half * (1 + gamma(4, half.dtype)) + gamma(6, half.dtype) * jnp.maximum(jnp.abs(low), jnp.abs(high))
    ranges = jax.vmap(lambda c: trivariate.enclose(c, centre[:, None], half[:, None]))(shape.table)
    balls = between(ranges.lower[:, 0], ranges.upper[:, 0])
    # What the rounding of the derivatives' coefficients adds: a share of the sum of the sizes of their terms.
    sizes = jnp.abs(shape.table)
    for axis in range(3):
        far, rows = jnp.maximum(jnp.abs(low[axis]), jnp.abs(high[axis])), jnp.moveaxis(sizes, 1, 0)
        sizes = rows[-1]
        for row in rows[-2::-1]:
            sizes = sizes * far + row
    balls = Ball(balls.mid, balls.rad + jnp.where(np.arange(len(sizes)) > 0, gamma(8, sizes.dtype) * sizes, 0.0))
    width, zero = high - low, jnp.zeros((3, 3, 3), low.dtype)
    first = Ball(jnp.diag(width), gamma(4, width.dtype) * jnp.diag(width))
    take = lambda rows: jax.tree_util.tree_map(lambda x: x[rows], balls)  # noqa: E731
    return Local(Ball(centre, half), first, Ball(zero, zero), take(0), take(np.arange(1, 4)), take(4 + _SYMMETRIC))


def between(lower: Array, upper: Array) -> Ball:
    """The ball of an interval."""
    mid = 0.5 * lower + 0.5 * upper
    size = jnp.maximum(jnp.abs(lower), jnp.abs(upper))
    return Ball(mid, (0.5 * upper - 0.5 * lower) + gamma(8, mid.dtype) * size + 16 * smallest_normal(mid.dtype))


def proven_point(shape: Implicit, x: Array) -> tuple[Array, Array]:
    """A point of the box near x, and a radius within which the surface is proven to have one; infinite where not.

    A few steps of Newton's method along the gradient, within the faces that x lies on. Both ends of the segment along
    it are floats of the box where the polynomial is proven to have different signs.
    """
    dtype = x.dtype

    def direction(x: Array, gradient: Array) -> Array:
        within = jnp.where((x <= shape.lower) | (x >= shape.upper), 0.0, gradient)
        enough = jnp.sum(within**2) > _TANGENT**2 * jnp.sum(gradient**2)
        return jnp.where(enough, within, gradient)

    def step(_: Any, x: Array) -> Array:
        value, gradient, _ = values(shape, x)
        along = direction(x, gradient)
        move = value * along / jnp.where(jnp.sum(along**2) > 0, jnp.sum(along**2), jnp.inf)
        return jnp.clip(x - jnp.where(jnp.isfinite(move), move, 0.0), shape.lower, shape.upper)

    x = jax.lax.fori_loop(0, _BACK, step, jnp.clip(x, shape.lower, shape.upper))
    value, gradient, _ = values(shape, x)
    along = direction(x, gradient)
    slope = jnp.sqrt(jnp.sum(along**2))
    slope = jnp.where(slope > 0, slope, jnp.inf)
    here = trivariate.evaluate(shape.table[0], x[:, None])
    error = (here.upper - here.lower)[0]
    # At the ends the value is larger than what it may err by, which is half of `error`, and the rounding of the ends.
    reach = (error + 1.25 * jnp.abs(value)) / slope + 4 * jnp.finfo(dtype).eps * jnp.max(jnp.abs(x))
    ends = [jnp.clip(x + sign * reach * along / slope, shape.lower, shape.upper) for sign in (-1, 1)]
    signs = trivariate.evaluate(shape.table[0], jnp.stack(ends, axis=1))
    lower, upper = signs.lower, signs.upper
    proven = ((lower[0] > 0) & (upper[1] < 0)) | ((upper[0] < 0) & (lower[1] > 0))
    far = jnp.maximum(*(length(end - x) for end in ends)) * (1 + gamma(16, dtype))
    return x, jnp.where(proven, far, jnp.inf)


def exact_radius(shape: Implicit, x: np.ndarray) -> float:
    """A radius about a point of the box within which the surface is proven to have one, by signs in integers.

    The signs are those at the places x + h w of the box, w of zeros, ones and minus ones, for a few steps h from some
    ulps on: between two places of different signs there is a point of the surface. Infinite where all have one sign,
    zero where x is on the surface.
    """
    polynomial = exact_polynomials.integers(np.asarray(shape.table[0], np.float64))
    lower, upper = (np.asarray(end, np.float64).tolist() for end in (shape.lower, shape.upper))
    centre = [Fraction(c) for c in np.asarray(x, np.float64).tolist()]
    info = np.finfo(np.asarray(x).dtype)
    size = float(max(np.max(np.abs(np.asarray(end))) for end in (shape.lower, shape.upper)))
    for power in _RADII:
        step = Fraction(max(size * float(info.eps), float(info.tiny))) * Fraction(2) ** power
        inside = [
            [w for w in (0, -1, 1) if low <= c + w * step <= high]
            for c, low, high in zip(centre, lower, upper, strict=True)
        ]
        places = np.array(list(product(*inside)), dtype=int).reshape(-1, 3).T
        found = exact_polynomials.signs(exact_polynomials.substituted(polynomial, centre, [step] * 3), places)
        if places.size and found[0] == 0:
            return 0.0
        if places.size and found.min() <= 0 <= found.max():
            return math.sqrt(3) * float(step) * (1 + 1e-15)
    return math.inf
