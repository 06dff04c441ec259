"""Polynomials over the cells of a grid in their box, and how far the zeros of a piecewise linear one are from theirs.

Let f be the polynomial in coordinates of the box, which run from 0 to 1, and L linear on each tetrahedron of
`jhd.shapes.marching` with the values of f at the nodes. In a cell with sides h_a

    |f - L| <= (1/8) sum over a, b of h_a h_b max |f_ab| = delta,

as for the triangles in `jhd.shapes.patch_cells`: half of a mean of second differences, whose variances are at most
h_a^2 / 4. Every tetrahedron has an edge along each axis, so the slope of L along an axis is a mean of that of f over
such an edge. Let f have a slope of at least g along one direction of an axis (in the user's unit of length) over the
cell and its neighbour in this direction, and tau = delta / g be no more than the side h of a cell. From a zero of L in
the cell, where |f| <= delta, f reaches zero within tau, if it has to rise; and from a zero of f so does L. A cell that
has such a direction for rising and one for falling, both of which stay in the box, has every zero of either function
within its tau of a zero of the other, in the box. Cells with neither have a range without zero. So the largest tau
bounds the distance of both sets in both directions. As L takes both signs near each of its zeros, these zeros are the
triangles of all tetrahedra with both signs, and no more.

Rounding: f is known exactly, as a multiple with Bernstein coefficients over the box that are at most one. These are
rounded once; a restriction costs four roundings for each degree and one for each axis of terms that add up to at most
one. So all coefficients and values are off by at most `error` = gamma(4 n + 12), n the sum of the
degrees, and k-th differences by 2^k times that. Values at nodes no larger than this are taken for zero.

Source: the bound by slopes along axes is ours; small variation of normals as in Plantinga & Vegter, Isotopic
approximation of implicit curves and surfaces (2004), is not needed for distances.
"""

from fractions import Fraction
from math import comb
from typing import NamedTuple

import numpy as np

from jhd.arithmetic import exact_polynomials
from jhd.arithmetic.bernstein import blossoms
from jhd.arithmetic.rounding import gamma

# Cells measured together: few enough for their numbers to stay close to the processor.
_CHUNK = 4096
# For a few dozen roundings of positive numbers.
_SLACK = 1 + 1e-13


class BoxedPolynomial(NamedTuple):
    """A positive multiple of a polynomial over its box.

    Args:
        coefficients: in Bernstein form over the box, at most one.
        error: what each is off by, here and after restriction.
        sides: sides of the box, in any unit.
    """

    coefficients: np.ndarray
    error: float
    sides: np.ndarray

    @classmethod
    def of(cls, coefficients: np.ndarray, lower: np.ndarray, upper: np.ndarray, sides: np.ndarray) -> "BoxedPolynomial":
        """The polynomial with these power coefficients, from exact arithmetic."""
        low, high = ([Fraction(float(x)) for x in end] for end in (lower, upper))
        exact = exact_polynomials.trimmed(exact_polynomials.integers(coefficients))
        exact = exact_polynomials.substituted(exact, low, [b - a for a, b in zip(low, high, strict=True)])
        for axis, n in enumerate(np.array(exact.shape) - 1):
            rows = [
                [Fraction(comb(j, i), comb(n, i)) if i <= j else Fraction(0) for i in range(n + 1)]
                for j in range(n + 1)
            ]
            exact = np.moveaxis(np.tensordot(np.array(rows, object), exact, (1, axis)), 0, axis)
        rounded = exact_polynomials.floats(exact_polynomials.integers(exact))
        return cls(rounded, gamma(4 * (sum(rounded.shape) - 3) + 12, np.float64), sides)

    def over(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Coefficients over boxes with these corners (boxes, 3), in coordinates from 0 to 1."""
        shape = self.coefficients.shape
        x, y, z = (blossoms(low[:, a], high[:, a], n - 1) for a, n in enumerate(shape))
        along = np.matmul(x, self.coefficients.reshape(shape[0], -1)).reshape(-1, *shape)
        return np.matmul(z[:, None], np.matmul(y[:, None], along).swapaxes(2, 3)).swapaxes(2, 3)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Values at points (points, 3), off by twice the error at most."""
        rows = [blossoms(points[:, a], points[:, a], n - 1)[:, 0] for a, n in enumerate(self.coefficients.shape)]
        values = self.coefficients[..., None]
        for row in rows:
            values = np.sum([x * weight for x, weight in zip(values, row.T, strict=True)], axis=0)
        # What is no more than rounding is zero, so that surfaces through nodes have their vertices there.
        return np.where(np.abs(values) <= self.error, 0.0, values)


def chunks(count: int) -> list[slice]:
    """Some rows at a time."""
    return [slice(k, k + _CHUNK) for k in range(0, count, _CHUNK)]


def near_zero(polynomial: BoxedPolynomial, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Which boxes may hold a zero of the polynomial, or a node whose computed value has another sign than another."""
    found = [polynomial.over(low[rows], high[rows]).reshape(len(low[rows]), -1) for rows in chunks(len(low))]
    ends = [(x.min(axis=1), x.max(axis=1)) for x in found]
    least, most = (np.concatenate(x) for x in zip(*ends, strict=True)) if ends else (np.zeros(0),) * 2
    return (least <= 3 * polynomial.error) & (most >= -3 * polynomial.error)


def deviations(polynomial: BoxedPolynomial, cells: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The tau of cells (cells, 3) of a grid with these numbers of cells; infinite where nothing is proven."""
    return np.concatenate([_deviations(polynomial, cells[rows], counts) for rows in chunks(len(cells))])


def _deviations(polynomial: BoxedPolynomial, cells: np.ndarray, counts: np.ndarray) -> np.ndarray:
    error = polynomial.error
    low, high = cells / counts, (cells + 1) / counts
    delta = _bend(polynomial, low, high) + 2 * error
    rising, falling = np.full((2, len(cells)), np.inf)
    for axis in range(3):
        first, last = low.copy(), high.copy()
        first[:, axis] = np.maximum(cells[:, axis] - 1, 0) / counts[axis]
        last[:, axis] = np.minimum(cells[:, axis] + 2, counts[axis]) / counts[axis]
        side = polynomial.sides[axis]
        degree = polynomial.coefficients.shape[axis] - 1
        if degree == 0:
            continue
        slopes = degree * np.diff(polynomial.over(first, last), axis=axis + 1).reshape(len(cells), -1)
        width = (last - first)[:, axis] * side
        step = (high - low)[:, axis] * side
        # The slopes of the polynomial, and those of the linear function from rounded values.
        room = 2 * degree * error / width + 4 * error / step
        least, most = slopes.min(axis=1) / width - room, slopes.max(axis=1) / width + room
        can_go_up, can_go_down = cells[:, axis] + 1 < counts[axis], cells[:, axis] > 0
        for may, up, down in ((can_go_up, least, -most), (can_go_down, -most, least)):
            rising = np.minimum(rising, _reach(delta, up, step, may))
            falling = np.minimum(falling, _reach(delta, down, step, may))
    return np.maximum(rising, falling) * _SLACK


def _reach(delta: np.ndarray, slope: np.ndarray, step: np.ndarray, may: np.ndarray) -> np.ndarray:
    """How far a change by delta takes at most; infinite where a direction may not be taken or is left too early."""
    good = may & (slope > 0)
    reach = delta / np.where(good, slope, 1.0)
    return np.where(good & (reach <= step * (1 - 1e-9)), reach, np.inf)


def _bend(polynomial: BoxedPolynomial, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """An eighth of the sum of the sizes of all second derivatives, in units of the cells."""
    rows, degrees = polynomial.over(low, high), np.array(polynomial.coefficients.shape) - 1
    total = np.zeros(len(rows))
    for a in range(3):
        for b in range(a + 1):
            factor = degrees[a] * (degrees[a] - 1) if a == b else 2 * degrees[a] * degrees[b]
            if factor:
                second = np.diff(np.diff(rows, axis=a + 1), axis=b + 1)
                total += factor * (np.abs(second).max(axis=(1, 2, 3)) + 4 * polynomial.error)
    return total / 8
