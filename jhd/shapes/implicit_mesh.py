"""Meshes of implicit surfaces with a proven deviation: a grid as fine as the proof of `implicit_cells` asks for."""

from typing import NamedTuple

import numpy as np

from jhd.arithmetic.rounding import unit_roundoff
from jhd.arithmetic.scaling import common_exponent
from jhd.shapes.checks import empty_surface
from jhd.shapes.implicit_cells import BoxedPolynomial, deviations, near_zero
from jhd.shapes.marching import march, nodes_of

# Cells along the longest side that a search begins with.
_FIRST = 8
# Cells along the longest side down to which cells are bisected that are not proven: a regular surface whose features
# are a thousandth of the box is proven there.
_FINEST = 4096
# More of these in one step, and the surface is refused at once: a curve of singular points, for example.
_MOST_UNPROVEN = 50_000
# More cells than the square root of what is lacking, so that one more step is enough; and the most in one step.
_GROWTH = (1.02, 4.0)


class NotRegularError(ValueError):
    """An implicit surface could not be proven regular near `place`: singular there, or tangent to a face of its box."""

    def __init__(self, place: np.ndarray):
        shown = ", ".join(f"{x:g}" for x in place)
        super().__init__(
            f"the surface could not be proven regular near ({shown}): its gradient may vanish there, or the "
            "surface may be tangent to a face of its box, or meet only an edge or a corner of it. Another box may help."
        )
        self.place = place


class HostTriangles(NamedTuple):
    """Vertices and triangles, and how far they are from the surface, and it from them, at most."""

    vertices: np.ndarray
    triangles: np.ndarray
    deviation: float


class _Box(NamedTuple):
    """The box on the host: local coordinates are the user's divided by 2^power."""

    lower: np.ndarray
    upper: np.ndarray
    power: int
    sides: np.ndarray
    off: float  # what the stored vertices are off by, local

    @classmethod
    def of(cls, lower: np.ndarray, upper: np.ndarray) -> "_Box":
        power, low, high = int(common_exponent(lower, upper)), lower.astype(np.float64), upper.astype(np.float64)
        sides = np.ldexp(high, -power) - np.ldexp(low, -power)
        # Sixteen roundings of numbers of order one, and what is subnormal in the user's unit.
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
    coefficients: np.ndarray, lower: np.ndarray, upper: np.ndarray, atol: float, most: int
) -> HostTriangles:
    """Triangles within atol of the zeros of a polynomial in a box, both ways.

    Raises:
        NotRegularError: the surface is not proven regular.
        ValueError: more than `most` triangles are needed, rounding alone may exceed atol, or there are no zeros.
    """
    box = _Box.of(lower, upper)
    polynomial = BoxedPolynomial.of(coefficients, lower, upper, box.sides)
    longest, counts = box.sides.max(), _counts(box.sides, float(_FIRST))
    while True:
        cells = _cells(polynomial, counts)
        if len(cells) == 0:
            raise empty_surface()
        if not box.in_user_units(box.off) <= atol:
            raise ValueError(f"atol is {atol:g}; the rounding of the vertices alone may be more.")
        if len(cells) > most:
            raise ValueError(f"atol is {atol:g}; more than max_triangles = {most} triangles would be needed.")
        tau = deviations(polynomial, cells, counts)
        worst = float(tau.max())
        if box.in_user_units(worst + box.off) <= atol:
            return _marched(polynomial, box, cells, counts, worst, most)
        if np.isfinite(worst):
            lacking = box.in_user_units(worst + box.off) / atol
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
    """Raises NotRegularError unless a finer grid proves what this one does not."""
    while len(cells):
        if counts.max() >= _FINEST or len(cells) > _MOST_UNPROVEN:
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
        raise ValueError(f"max_triangles is {most}; {len(found.triangles)} triangles are needed.")
    low, high = found.low / counts, found.high / counts
    vertices = box.places(low + found.share[:, None] * (high - low))
    return HostTriangles(vertices, found.triangles, box.in_user_units(worst + box.off))
