"""Meshes of implicit surfaces with a proven deviation, on a grid as fine as the proof requires.

Let f be the polynomial in coordinates of the box, which run from 0 to 1, and L the piecewise linear function with the
values of f at the nodes of a grid: every cell is cut into six tetrahedra with its long diagonal. In a cell with sides
h_a

    |f - L| <= (1/8) sum over a, b of h_a h_b max |f_ab| = delta,

as for the triangles in `jhd._shapes.patch_cells`: half of a mean of second differences, whose variances are at most
h_a^2 / 4. Every tetrahedron has an edge along each axis, so the slope of L along an axis is a mean slope of f over
such an edge. Let f have a slope of at least g along one direction of an axis (in the user's unit of length) over the
cell and its neighbor in this direction, and tau = delta / g be no more than the side h of a cell. From a zero of L in
the cell, where |f| <= delta, f reaches zero within tau, if it has to rise; and from a zero of f so does L. A cell that
has such a direction for rising and one for falling, both of which stay in the box, has every zero of either function
within its tau of a zero of the other, in the box. Cells with neither have a range without zero. So the largest tau
bounds the distance of both sets in both directions. As L takes both signs near each of its zeros, these zeros are the
triangles of all tetrahedra with both signs, and no more.

Rounding: f is known exactly, as a multiple with Bernstein coefficients over the box that are at most one. These are
rounded once; a restriction costs four roundings for each degree and one for each axis of terms that add up to at most
one. So all coefficients and values are off by at most `error` = gamma(4 n + 12), n the sum of the degrees, and k-th
differences by 2^k times that. Values at nodes no larger than this are taken for zero.

Source: Kuhn, Some combinatorial lemmas in topology (1960), for the tetrahedra; Doi & Koide, An efficient method of
triangulating equi-valued surfaces by using tetrahedral cells (1991). The bound by slopes along axes is ours; small
variation of normals as in Plantinga & Vegter, Isotopic approximation of implicit curves and surfaces (2004), is not
needed for distances.
"""

from fractions import Fraction
from functools import cache
from itertools import permutations
from math import comb
from typing import NamedTuple

import numpy as np

from jhd._arithmetic import exact_polynomials
from jhd._arithmetic.bernstein import blossoms
from jhd._arithmetic.rounding import gamma, unit_roundoff
from jhd._arithmetic.scaling import common_exponent
from jhd._shapes.approximation import check_count, chunks
from jhd._shapes.checks import empty_surface

# Growth of cells beyond the square root of the missing factor, so that one step suffices; most growth in one step.
_GROWTH = (1.02, 4.0)


class BoxedPolynomial(NamedTuple):
    """A positive multiple of a polynomial over its box."""

    coefficients: np.ndarray  # in Bernstein form over the box, at most one
    error: float  # bound of the error of each coefficient, here and after restriction
    sides: np.ndarray  # sides of the box, in any unit

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
        # Values within rounding count as zero, so that surfaces through nodes have their vertices there.
        return np.where(np.abs(values) <= self.error, 0.0, values)


def near_zero(polynomial: BoxedPolynomial, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Mask of the boxes that may hold a zero of the polynomial, or nodes whose computed values differ in sign."""
    found = [polynomial.over(low[rows], high[rows]).reshape(len(low[rows]), -1) for rows in chunks(len(low))]
    ends = [(x.min(axis=1), x.max(axis=1)) for x in found]
    least, most = (np.concatenate(x) for x in zip(*ends, strict=True)) if ends else (np.zeros(0),) * 2
    return (least <= 3 * polynomial.error) & (most >= -3 * polynomial.error)


def deviations(polynomial: BoxedPolynomial, cells: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The tau of cells (cells, 3) of a grid with these numbers of cells; infinite if nothing is proven."""
    return np.concatenate([_deviations(polynomial, cells[rows], counts) for rows in chunks(len(cells))])


def _deviations(polynomial: BoxedPolynomial, cells: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """`deviations` of one chunk of cells: the larger of the steps that a rise and a fall by delta take at most."""
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
        # Error of the slopes of the polynomial, and of the slopes of the linear function from rounded values.
        room = 2 * degree * error / width + 4 * error / step
        least, most = slopes.min(axis=1) / width - room, slopes.max(axis=1) / width + room
        can_go_up, can_go_down = cells[:, axis] + 1 < counts[axis], cells[:, axis] > 0
        for may, up, down in ((can_go_up, least, -most), (can_go_down, -most, least)):
            rising = np.minimum(rising, _reach(delta, up, step, may))
            falling = np.minimum(falling, _reach(delta, down, step, may))
    # For a few dozen roundings of positive numbers.
    return np.maximum(rising, falling) * (1 + 1e-13)


def _reach(delta: np.ndarray, slope: np.ndarray, step: np.ndarray, may: np.ndarray) -> np.ndarray:
    """Largest step along an axis for a change by delta; infinite if not allowed, not rising or beyond `step`."""
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


class MarchedSurface(NamedTuple):
    """The zeros of a piecewise linear function, without cells in which it has one sign."""

    low: np.ndarray  # the node at one end of the edge on which each vertex lies, as integer coordinates in the grid
    high: np.ndarray  # the node at the other end; equal to `low` if the function is zero there
    share: np.ndarray  # fraction of the edge from `low` to the vertex
    triangles: np.ndarray  # numbers of three vertices, counter-clockwise seen from the side of positive values


def nodes_of(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners of cells (cells, 3), each once, and their numbers (cells, 8) in the order of `ndindex`."""
    size = int(cells.max(initial=0)) + 2
    corners = cells[:, None] + np.array(list(np.ndindex(2, 2, 2)))
    names, number = np.unique((corners[..., 0] * size + corners[..., 1]) * size + corners[..., 2], return_inverse=True)
    nodes = np.stack([names // size**2, names // size % size, names % size], axis=1)
    return nodes, number.reshape(-1, 8)


def march(nodes: np.ndarray, corners: np.ndarray, values: np.ndarray) -> MarchedSurface:
    """The zeros in the cells with these corners; zero counts as positive, and triangles without area are left out.

    Args:
        nodes: integer coordinates of the nodes (nodes, 3).
        corners: numbers of the corners of each cell (cells, 8).
        values: the function at the nodes.
    """
    tetrahedra = corners[:, _tetrahedra()].reshape(-1, 4)
    case = (values[tetrahedra] < 0) @ np.array([1, 2, 4, 8])
    mixed = (case > 0) & (case < 15)
    edges = _cases()[case[mixed]]
    ends = np.take_along_axis(tetrahedra[mixed], edges.reshape(len(edges), 12), axis=1).reshape(-1, 3, 2)
    # A vertex at a node with value zero is that node, whatever edge it came from.
    zero = values[ends] == 0
    at_zero = np.where(zero[..., :1], ends[..., :1], ends[..., 1:])
    ends = np.where(np.any(zero, axis=-1, keepdims=True), at_zero, ends)
    ends.sort(axis=-1)
    names, number = np.unique(ends[..., 0] * len(nodes) + ends[..., 1], return_inverse=True)
    low, high = names // len(nodes), names % len(nodes)
    triangles = number.reshape(-1, 3)
    proper = np.all(triangles != np.roll(triangles, 1, axis=1), axis=1)
    below, above = values[low], values[high]
    apart = below - above
    share = np.where(apart != 0, below / np.where(apart != 0, apart, 1.0), 0.0)
    return MarchedSurface(nodes[low], nodes[high], share, triangles[proper])


@cache
def _tetrahedra() -> np.ndarray:
    """The six tetrahedra as numbers of corners, all of positive volume: paths along the axes from corner 0 to 7."""
    found = []
    for order in permutations(range(3)):
        path = np.cumsum([0, *(4 >> axis for axis in order)])
        odd = sum(order[i] > order[j] for i in range(3) for j in range(i + 1, 3)) % 2
        found.append(path[[0, 1, 3, 2]] if odd else path)
    return np.array(found)


@cache
def _cases() -> np.ndarray:
    """The edges (16, 2 triangles, 3 vertices, 2 ends) by which corners are negative; one triangle is given twice.

    The second copy of a lone triangle is shrunk to a vertex, which is left out.
    """
    table = np.zeros((16, 2, 3, 2), int)
    places = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    for case in range(1, 15):
        below = [k for k in range(4) if case >> k & 1]
        above = [k for k in range(4) if k not in below]
        if len(below) == 2:
            (a, b), (c, d) = below, above
            loop = [(a, c), (a, d), (b, d), (b, c)]
            triangles = [[loop[0], loop[1], loop[2]], [loop[0], loop[2], loop[3]]]
        else:
            loop = [(a, b) for a in below for b in above]
            triangles = [loop, [loop[0]] * 3]
        middle = np.array([0.5 * (places[a] + places[b]) for a, b in triangles[0]])
        normal = np.cross(middle[1] - middle[0], middle[2] - middle[0])
        outwards = normal @ (places[above].mean(axis=0) - places[below].mean(axis=0)) > 0
        table[case] = triangles if outwards else [t[::-1] for t in triangles]
    return table


class NotRegularError(ValueError):
    """An implicit surface could not be proven regular near `point`: singular there, or tangent to its box."""

    def __init__(self, point: np.ndarray):
        shown = ", ".join(f"{x:g}" for x in point)
        super().__init__(
            f"the surface could not be proven regular near ({shown}): its gradient may vanish there, or the "
            "surface may be tangent to a face of its box, or meet only an edge or a corner. Try another box."
        )
        self.point = point


class HostTriangles(NamedTuple):
    """Vertices and triangles, and a bound of their distance from the surface in both directions."""

    vertices: np.ndarray
    triangles: np.ndarray
    deviation: float


class _Box(NamedTuple):
    """The box on the host: local coordinates are the user's divided by 2^power."""

    lower: np.ndarray
    upper: np.ndarray
    power: int
    sides: np.ndarray
    off: float  # bound of the error of stored vertices, local

    @classmethod
    def of(cls, lower: np.ndarray, upper: np.ndarray) -> "_Box":
        power, low, high = int(common_exponent(lower, upper)), lower.astype(np.float64), upper.astype(np.float64)
        sides = np.ldexp(high, -power) - np.ldexp(low, -power)
        # Sixteen roundings of numbers of order one, and the spacing of subnormal numbers in the user's unit.
        least = np.ldexp(float(np.finfo(lower.dtype).smallest_subnormal), -power)
        off = np.sqrt(3.0) * (16 * unit_roundoff(np.float64) + 2 * unit_roundoff(lower.dtype) + 2 * least)
        return cls(lower, upper, power, sides, float(off))

    def places(self, points: np.ndarray) -> np.ndarray:
        """Points with coordinates from 0 to 1, as they are stored."""
        found = np.ldexp(np.ldexp(self.lower.astype(np.float64), -self.power) + self.sides * points, self.power)
        return np.clip(found.astype(self.lower.dtype), self.lower, self.upper)

    def in_user_units(self, length: float) -> float:
        """A local length, rounded up."""
        with np.errstate(over="ignore"):
            return float(np.nextafter(np.ldexp(length * (1 + 1e-15), self.power), np.inf))


def triangulate(
    coefficients: np.ndarray, lower: np.ndarray, upper: np.ndarray, tolerance: float, most: int
) -> HostTriangles:
    """Triangles within tolerance of the zeros of a polynomial in a box, both ways.

    Raises:
        NotRegularError: the surface is not proven regular.
        ValueError: more than `most` triangles are needed, rounding alone may exceed tolerance, or there are no zeros.
    """
    box = _Box.of(lower, upper)
    polynomial = BoxedPolynomial.of(coefficients, lower, upper, box.sides)
    # Cells along the longest side at the start of a search.
    longest, counts = box.sides.max(), _counts(box.sides, 8.0)
    while True:
        cells = _cells(polynomial, counts)
        if len(cells) == 0:
            raise empty_surface()
        if not box.in_user_units(box.off) <= tolerance:
            raise ValueError(f"tolerance is {tolerance:g}, below the rounding of the vertices; raise it.")
        check_count(len(cells), "max_triangles", most, tolerance)
        tau = deviations(polynomial, cells, counts)
        worst = float(tau.max())
        if box.in_user_units(worst + box.off) <= tolerance:
            return _marched(polynomial, box, cells, counts, worst, most)
        if np.isfinite(worst):
            lacking = box.in_user_units(worst + box.off) / tolerance
            growth = float(np.clip(np.sqrt(lacking) * _GROWTH[0], *_GROWTH))
        else:
            _check_regular(polynomial, box, cells[np.isinf(tau)], counts)
            growth = 2.0
        counts = _counts(box.sides, growth * counts[np.argmax(box.sides == longest)])


def _counts(sides: np.ndarray, longest: float) -> np.ndarray:
    """Numbers of cells along the sides, cells that are nearly cubes."""
    return np.ceil(np.maximum(longest * (sides / sides.max()), 1)).astype(int)


def _cells(polynomial: BoxedPolynomial, counts: np.ndarray) -> np.ndarray:
    """The cells that may hold zeros: boxes of cells, bisected along all axes."""
    low, high = np.zeros((1, 3), int), counts[None].astype(int)
    while True:
        near = near_zero(polynomial, low / counts, high / counts)
        low, high = low[near], high[near]
        if np.all(high - low == 1):
            return low
        for axis in range(3):
            middle = (low[:, axis] + high[:, axis]) // 2
            two = middle > low[:, axis]
            left, right = high.copy(), low[two]
            left[two, axis], right[:, axis] = middle[two], middle[two]
            low, high = np.concatenate([low, right]), np.concatenate([left, high[two]])


def _check_regular(polynomial: BoxedPolynomial, box: _Box, cells: np.ndarray, counts: np.ndarray) -> None:
    """Raise NotRegularError unless a finer grid proves the cells that this grid leaves unproven."""
    while len(cells):
        # A regular surface whose features are a thousandth of the box is proven with 4096 cells along a side. Very many
        # unproven cells are refused at once: a curve of singular points, for example.
        if counts.max() >= 4096 or len(cells) > 50_000:
            raise NotRegularError(box.places((cells[0] + 0.5) / counts))
        counts = 2 * counts
        cells = (2 * cells[:, None] + np.array(list(np.ndindex(2, 2, 2)))).reshape(-1, 3)
        cells = cells[near_zero(polynomial, cells / counts, (cells + 1) / counts)]
        cells = cells[np.isinf(deviations(polynomial, cells, counts))] if len(cells) else cells


def _marched(
    polynomial: BoxedPolynomial, box: _Box, cells: np.ndarray, counts: np.ndarray, worst: float, most: int
) -> HostTriangles:
    nodes, corners = nodes_of(cells)
    found = march(nodes, corners, polynomial.at(nodes / counts))
    if len(found.triangles) == 0:
        raise empty_surface()
    if len(found.triangles) > most:
        raise ValueError(f"max_triangles is {most}; needs at least {len(found.triangles)}.")
    low, high = found.low / counts, found.high / counts
    vertices = box.places(low + found.share[:, None] * (high - low))
    return HostTriangles(vertices, found.triangles, box.in_user_units(worst + box.off))
