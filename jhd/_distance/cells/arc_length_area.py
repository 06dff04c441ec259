"""Parts of curves and surfaces as flat pieces, with proven lengths and areas, for many at once, in NumPy.

A part with control points p_ij is compared with the affine map L that agrees with its corners as far as it can: with
L_ij = L(i / p, j / q) both are sums of the same Bernstein polynomials, so |a(u, v) - L(u, v)| <= max |p_ij - L_ij|. For
rational parts the bound is the largest |coefficient| of w (a - L), divided by the smallest weight.

**Measure.** Let N be a' of a curve, or a_u x a_v of a surface, a polynomial with Bernstein coefficients n_k. All
Bernstein polynomials of a degree have equal integrals, so |mean of n_k| <= length or area <= mean of |n_k|, which
leaves a gap of second order. For rational parts the density is |M| / w^k with k = 2 or 3 and a polynomial M. With
t = w / w_0,

    t^-k = (k + 1) - k t + phi(t),   0 <= phi(t) <= max of phi at the ends of the range of t,

since phi is convex and zero with its slope at one; so M ((k + 1) - k t) replaces N, up to phi |M|.

The coefficients over a part are the piece's coefficients on the box of its parameters, times the sides of the box, so
errors stay relative to the size of the part.

**Evenness.** How far the density |N| is from constant: `uneven` bounds the integral of | |N| / mean - 1 | over the unit
square, which is at most two.

Rounding. Control points of a part are off by `off` in each coordinate, weights by as much relative to them; a
difference by twice that. A coefficient of a product of two forms is a sum of products: along each parameter at most as
many as the smaller form has coefficients. Each of the T terms takes three roundings of its factor, at most three of the
product, and T - 1 of the sum. The sizes of the terms add up to at most the product of the sizes of the forms, times
sqrt(2) for cross products. So products err by less than gamma(2 T + 16) of the product of the sizes. A mean of n
coefficients errs by less than gamma(n + 16) of the largest one. All else takes fewer than 64 roundings, in every
degree: products with flat pieces sum up four terms at most.

Source: Bernstein products: Farouki & Rajan, CAGD 5 (1988). The bounds are ours.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jhd._arithmetic.bernstein import product_weights
from jhd._arithmetic.rounding import gamma
from jhd._runtime.arrays import taken

_ROUNDINGS = gamma(64, np.float64)
# A length, and a few products and sums of positive numbers.
_UP, _DOWN = 1 + gamma(16, np.float64), 1 - gamma(16, np.float64)


class FlatCells(NamedTuple):
    """Cells and flat pieces near them: a point of a cell is within `slack` of the piece's at equal parameters."""

    # Corners of the pieces: a point, a segment, a triangle, or a parallelogram in the order of its parameters.
    corners: Float[np.ndarray, "cells corners 3"]
    # Bound of the distance between points of the cell and of the piece at equal parameters.
    slack: Float[np.ndarray, " cells"]
    lower: Float[np.ndarray, " cells"]  # lower bounds of the length or area of each cell; 1 for a point
    upper: Float[np.ndarray, " cells"]  # upper bounds of the length or area of each cell
    uneven: Float[np.ndarray, " cells"]  # bound of the integral of |density / mean density - 1|
    # Control points of each cell. The polynomial with the values of a convex function there as coefficients is at least
    # that function; for a concave function it is at most that function. If no such points are known, they are the
    # corners.
    controls: Float[np.ndarray, "cells controls 3"]
    # Bound of the distance of points of the cell to the polynomial with these coefficients; the slack for corners.
    off: Float[np.ndarray, " cells"]

    take = taken


class _Sized(NamedTuple):
    """Coefficients (cells, rows, columns, width), a bound of their sizes, and a bound of their errors."""

    values: np.ndarray
    size: Any
    error: Any


def restricted(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Coefficients (cells, rows, columns, width) on the boxes of parameters between the ends (cells, parameters)."""
    for axis in range(low.shape[1]):
        values = np.moveaxis(values, 1 + axis, 0)
        a, b = (x[:, axis].reshape(-1, *[1] * (values.ndim - 2)) for x in (low, high))
        values = _blossomed(values, a, b)
        values = np.moveaxis(values, 0, 1 + axis)
    return values


def _blossomed(c: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the coefficients on [a, b], along the first axis: restrict to [0, b], then drop the part before a."""
    some, safe = b > 0, np.where(b > 0, b, 1.0)
    # For b = 0 both ends are equal.
    return _before(_before(c, 1 - b, b)[::-1], a / safe, np.where(some, (b - a) / safe, 1.0))[::-1]


def _before(c: np.ndarray, rest: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Coefficients on [0, t], along the first axis, given 1 - t too."""
    rows = [c[0]]
    while len(c) > 1:
        c = rest * c[:-1] + t * c[1:]
        rows.append(c[0])
    return np.stack(rows)


def off_by(degrees: tuple[int, int]) -> float:
    """Bound the error of `restricted` for control points of at most one.

    Three roundings a level for the part before the upper end, and four for its rest: both factors there are quotients.
    All of them are relative to terms with non-negative factors, so those of weights are relative to the weights.
    """
    return gamma(7 * sum(degrees) + 16, np.float64)


def flat_parts(
    points: np.ndarray, weights: np.ndarray | None, off: float
) -> tuple[Float[np.ndarray, "cells corners 3"], Float[np.ndarray, " cells"]]:
    """Return the corners of flat pieces near parts of curves (one column) or surfaces, and how far the parts are off.

    Args:
        points: control points (cells, rows, columns, 3), at most one; multiplied by the weights for rational parts.
        weights: (cells, rows, columns, 1), positive, of at most one; None for polynomial parts.
        off: bound of the errors of the points; for the weights, relative to them.
    """
    w = np.ones_like(points[..., :1]) if weights is None else weights
    at = points / w
    center = np.mean(at[:, [0, 0, -1, -1], [0, -1, 0, -1]], axis=1)[:, None, None]
    homogeneous = (at - center) * w
    # Means of two opposite sides; for a curve both sides are one.
    first = 0.5 * np.sum(at[:, -1, [0, -1]] - at[:, 0, [0, -1]], axis=1)
    second = 0.5 * np.sum(at[:, [0, -1], -1] - at[:, [0, -1], 0], axis=1)
    shift, slack = _beside(homogeneous, weights, first, second)
    signs = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]])
    signs = signs if points.shape[2] > 1 else np.array([[-0.5, 0.0], [0.5, 0.0]])
    corners = (center[:, 0, 0] + shift)[:, None] + signs[:, :1] * first[:, None] + signs[:, 1:] * second[:, None]
    # The rounding of the corners above, and the errors of the control points.
    slack = slack * _UP + 4 * math.sqrt(3) * (off + _ROUNDINGS)
    return corners, slack


def _beside(
    homogeneous: np.ndarray, weights: np.ndarray | None, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the best shift of the affine map with these sides, and the distance of the part from the shifted map."""
    if weights is None:
        values = homogeneous - _affine(first, second, *homogeneous.shape[1:3])
        shift = _middle(values)
        return shift, np.max(_length(values - shift[:, None, None]), axis=(1, 2))
    flat = _affine(first, second, 2, min(homogeneous.shape[2], 2))
    one = np.ones((*flat.shape[:3], 1))
    values = _product(homogeneous, one, np.multiply) - _product(weights, flat, np.multiply)
    # Divided by the mean weight these are about a - L.
    shift = _middle(values / np.mean(weights, axis=(1, 2), keepdims=True))
    values = values - _product(weights, shift[:, None, None] * one, np.multiply)
    return shift, np.max(_length(values), axis=(1, 2)) / np.min(weights, axis=(1, 2))[:, 0]


def _affine(first: np.ndarray, second: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Coefficients (cells, rows, columns, 3) of the map that is zero in the middle and has these sides."""
    u, v = (np.linspace(-0.5, 0.5, n) if n > 1 else np.zeros(1) for n in (rows, columns))
    return u[:, None, None] * first[:, None, None] + v[:, None] * second[:, None, None]


def _middle(values: np.ndarray) -> np.ndarray:
    return 0.5 * (np.max(values, axis=(1, 2)) + np.min(values, axis=(1, 2)))


def _length(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.sum(values**2, axis=-1))


class NormalForm(NamedTuple):
    """A form whose length, divided by a power of the weight, is the density of length or area, for each piece."""

    values: np.ndarray  # its coefficients (pieces, rows, columns, 3)
    size: Any  # bound of their lengths (pieces,)
    error: Any  # bound of their errors (pieces,)
    power: int  # power of the weight in the denominator, 0 for polynomial pieces


def normal_form(points: np.ndarray, weights: np.ndarray | None, off: float) -> NormalForm:
    """Return the form of pieces, given like the parts in `flat_parts`."""
    surface = points.shape[2] > 1
    w = np.ones_like(points[..., :1]) if weights is None else weights
    at = points / w
    wide = 4 * math.sqrt(3) * off + _ROUNDINGS  # of homogeneous coordinates about a center
    position = _form((at - np.mean(at, axis=(1, 2), keepdims=True)) * w, wide)
    along = [_derived(position, axis) for axis in range(2 if surface else 1)]
    if weights is None:
        return NormalForm(*(_multiplied(along[0], along[1], np.cross) if surface else along[0]), 0)
    weight = _form(weights, off)
    slopes = [_derived(weight, axis) for axis in range(len(along))]
    if surface:
        terms = [_multiplied(weight, _multiplied(along[0], along[1], np.cross), np.multiply)]
        terms.append(_multiplied(slopes[1], _multiplied(along[0], position, np.cross), np.multiply))
        terms.append(_multiplied(slopes[0], _multiplied(position, along[1], np.cross), np.multiply))
    else:
        terms = [_multiplied(weight, along[0], np.multiply), _multiplied(slopes[0], position, np.multiply)]
    size = sum(x.size for x in terms)
    values = terms[0].values - sum(x.values for x in terms[1:])
    return NormalForm(values, size, sum(x.error for x in terms) + _ROUNDINGS * size, 3 if surface else 2)


def measured_parts(
    form: NormalForm, piece: np.ndarray, ends: tuple[np.ndarray, np.ndarray], weights: np.ndarray | None, off: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper bounds of the measures of parts, and their unevenness.

    Args:
        form: the form of the pieces.
        piece: index of the piece that contains each part.
        ends: lower and upper ends of the parameters (cells, parameters).
        weights: weights of the parts (cells, rows, columns, 1), or None.
        off: bound of the relative errors of the weights.
    """
    low, high = ends
    degrees = form.values.shape[1] - 1, form.values.shape[2] - 1
    error = form.error[piece] + off_by(degrees) * form.size[piece]
    whole = _Sized(restricted(form.values[piece], low, high), form.size[piece], error)
    sides = np.prod(high - low, axis=1)
    if weights is None:
        found = _measured(whole.values, whole.error)
    else:
        found = _measured(*_divided(whole, weights, off, form.power))
    return found[0] * sides * _DOWN, found[1] * sides * _UP, found[2]


def _divided(whole: _Sized, weights: np.ndarray, off: float, power: int) -> tuple[np.ndarray, np.ndarray]:
    """Divide the form by a power of the weight; return coefficients and an error that includes the remainder."""
    low, high = np.min(weights, axis=(1, 2))[:, 0] * (1 - 2 * off), np.max(weights, axis=(1, 2))[:, 0] * (1 + 2 * off)
    middle = 0.5 * (low + high)
    t = weights / middle[:, None, None, None]
    most = high / middle
    factor = _Sized((power + 1) - power * t, (power + 1) + power * most, power * (off + _ROUNDINGS) * most)
    product = _multiplied(factor, whole, np.multiply)
    rest = np.maximum(*(x**-power - (power + 1) + power * x for x in (low / middle, most))) * _UP + _ROUNDINGS
    scale = middle**power
    # A bound over the part, not over the piece: it is far smaller near a pole.
    largest = np.max(_length(whole.values), axis=(1, 2)) * _UP + whole.error
    error = (product.error + rest * largest + _ROUNDINGS * product.size) / scale * _UP
    return product.values / scale[:, None, None, None], error


def _form(values: np.ndarray, error: float) -> _Sized:
    return _Sized(values, np.max(_length(values), axis=(1, 2)) * _UP, np.full(len(values), error))


def _derived(form: _Sized, axis: int) -> _Sized:
    degree = form.values.shape[1 + axis] - 1
    values = degree * np.diff(form.values, axis=1 + axis)
    return _Sized(
        values, np.max(_length(values), axis=(1, 2)) * _UP, 2 * degree * (form.error + _ROUNDINGS * form.size)
    )


def _multiplied(f: _Sized, g: _Sized, combine: Any) -> _Sized:
    values = _product(f.values, g.values, combine)
    room = gamma(2 * math.prod(map(min, f.values.shape[1:3], g.values.shape[1:3])) + 16, np.float64)
    error = f.error * g.size + f.size * g.error + f.error * g.error + room * f.size * g.size
    return _Sized(values, f.size * g.size * (1 + room), error * _UP)


def _product(f: np.ndarray, g: np.ndarray, combine: Any) -> np.ndarray:
    """The product of two forms, by a product of their coefficients."""
    (n, m), (k, j) = f.shape[1:3], g.shape[1:3]
    tables = product_weights(n - 1, k - 1), product_weights(m - 1, j - 1)
    total = np.zeros((len(f), n + k - 1, m + j - 1, max(f.shape[3], g.shape[3])))
    for x in range(n):
        for y in range(m):
            weight = tables[0][x][:, None, None] * tables[1][y][:, None]
            total[:, x : x + k, y : y + j] += weight * combine(f[:, x : x + 1, y : y + 1], g)
    return total


def _measured(normal: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper bounds of the integral of the lengths of forms over the unit square, and their unevenness."""
    sizes = _length(normal)
    mean = np.mean(normal, axis=(1, 2))
    length = _length(mean)
    error = error + gamma(sizes[0].size + 16, np.float64) * np.max(sizes, axis=(1, 2))
    lower = np.maximum(length * _DOWN - error, 0.0)
    upper = np.mean(sizes, axis=(1, 2)) * _UP + error
    unit = mean / np.where(length > 0, length, 1.0)[:, None]
    most = np.max(sizes, axis=(1, 2)) * _UP + error
    # The unit vector is one to within some roundings, which count in the error.
    least = np.maximum(np.min(np.sum(normal * unit[:, None, None], axis=-1), axis=(1, 2)) - error, 0.0)
    return lower, upper, uneven_of(least, most, lower)


def uneven_of(least: np.ndarray, most: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Bound the unevenness from the range of a density and a lower bound of its mean."""
    known = mean > 0
    return np.where(known, np.minimum((most - least) / np.where(known, mean, 1.0) * _UP, 2.0), 2.0)


def flat_triangles(corners: np.ndarray, off: float | np.ndarray) -> FlatCells:
    """Return triangles as cells, exact up to the error `off` of each coordinate, a number or one for each triangle."""
    u, v = (corners[:, k] - corners[:, 0] for k in (1, 2))
    size = np.max(_length(np.stack([u, v], axis=1)), axis=1) * _UP
    wide = 2 * math.sqrt(3) * off + _ROUNDINGS * size
    error = (2 * wide * size + wide**2) * _UP + _ROUNDINGS * size**2
    doubled = _length(np.cross(u, v))
    lower, upper = np.maximum(doubled * _DOWN - error, 0.0), doubled * _UP + error
    nothing = np.zeros(len(corners))
    slack = nothing + math.sqrt(3) * off
    return FlatCells(corners, slack, 0.5 * lower, 0.5 * upper, nothing, corners, slack)


def single_points(points: np.ndarray, counts: np.ndarray, off: float) -> FlatCells:
    """Return points as cells; point k counts `counts[k]` times."""
    nothing = np.zeros(len(points))
    slack = nothing + math.sqrt(3) * off
    return FlatCells(points[:, None], slack, counts, counts, nothing, points[:, None], slack)
