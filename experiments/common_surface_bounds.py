"""Upper bounds of the distance from a part of a polynomial patch to another patch, by usual methods, in NumPy.

A patch is an array of coefficients [i, j, axis] of u^i v^j. Cells are rectangles of parameters of the first patch.
Bernstein coefficients are computed from values at even nodes, which costs some digits: they are good to 1e-11.
"""

from collections.abc import Callable
from functools import lru_cache
from math import comb
from typing import NamedTuple

import numpy as np

# Newton steps for a foot, and starts along each parameter.
_STEPS, _STARTS = 10, 5
# If a step is shorter than this, it is the last one.
_SHORT = 1e-9
# Weights of the first branch that are tried in combinations of two branches.
_SHARES = np.linspace(0.0, 1.0, 17)


class Patch(NamedTuple):
    """A patch: coefficients (n, m, 3), parameters from 0 to 1."""

    rows: np.ndarray

    def at(self, u: np.ndarray, v: np.ndarray, du: int = 0, dv: int = 0) -> np.ndarray:
        """Evaluate points or derivatives at arrays of parameters."""
        first, second = (_powers(x, n, d) for x, n, d in ((u, len(self.rows), du), (v, self.rows.shape[1], dv)))
        return np.einsum("...i,...j,ijk->...k", first, second, self.rows)


class Rectangle(NamedTuple):
    """A cell: its lower and upper parameters."""

    low: np.ndarray
    high: np.ndarray

    def places(self, shares: np.ndarray) -> np.ndarray:
        """Return parameters at fractions (..., 2) of the sides."""
        return self.low + shares * (self.high - self.low)

    def halves(self) -> list["Rectangle"]:
        """Split the rectangle across its longer side."""
        axis = int(np.argmax(self.high - self.low))
        middle = 0.5 * (self.low[axis] + self.high[axis])
        high, low = self.high.copy(), self.low.copy()
        high[axis] = low[axis] = middle
        return [Rectangle(self.low, high), Rectangle(low, self.high)]


def _powers(x: np.ndarray, count: int, order: int) -> np.ndarray:
    rows = [x**i * 0 for i in range(min(order, count))]
    rows += [np.prod(np.arange(i - order + 1, i + 1)) * x ** (i - order) for i in range(order, count)]
    return np.stack(rows, axis=-1)


def foot(b: Patch, point: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """Return the parameters of a near point of b, found from `start`; if it is None, from a grid of starts."""
    if start is None:
        grid = np.stack(np.meshgrid(*[np.linspace(0, 1, _STARTS)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
        far = np.sum((b.at(grid[:, 0], grid[:, 1]) - point) ** 2, axis=1)
        start = grid[np.argmin(far)]
    s = np.array(start, float)
    for _ in range(_STEPS):
        e, first, second = b.at(*s) - point, b.at(*s, 1, 0), b.at(*s, 0, 1)
        slope = np.array([e @ first, e @ second])
        own = [first @ first + e @ b.at(*s, 2, 0), second @ second + e @ b.at(*s, 0, 2)]
        mixed = first @ second + e @ b.at(*s, 1, 1)
        held = ((s <= 0) & (slope > 0)) | ((s >= 1) & (slope < 0))
        matrix = np.array([[own[0], mixed], [mixed, own[1]]])
        if not (own[0] > 0 and np.linalg.det(matrix) > 0):
            matrix = np.diag([first @ first, second @ second])
        matrix = np.where(held[:, None] | held, np.eye(2), matrix)
        before, s = s, np.clip(s - np.linalg.solve(matrix, np.where(held, 0.0, slope)), 0.0, 1.0)
        if np.max(np.abs(s - before)) < _SHORT:
            break
    return s


def lipschitz(a: Patch, b: Patch, cell: Rectangle) -> float:
    """Bound the distance by its value in the middle plus half of the largest possible length of the cell."""
    middle = 0.5 * (cell.low + cell.high)
    point = a.at(*middle)
    half = 0.5 * (cell.high - cell.low)
    speeds = [np.sqrt(np.max(_coefficients(lambda u, v, d=d: np.sum(a.at(u, v, *d) ** 2, axis=-1), cell, 6)))
              for d in ((1, 0), (0, 1))]  # fmt: skip
    return float(np.linalg.norm(point - b.at(*foot(b, point))) + half @ np.array(speeds))


def constant_foot(a: Patch, b: Patch, cell: Rectangle) -> float:
    """Bound the distance from one point of b, the foot of the middle."""
    point = a.at(*(0.5 * (cell.low + cell.high)))
    there = b.at(*foot(b, point))
    return _root(np.max(_coefficients(lambda u, v: np.sum((a.at(u, v) - there) ** 2, axis=-1), cell, 6)))


def affine_foot(a: Patch, b: Patch, cell: Rectangle) -> float:
    """Bound the distance from feet that move affinely with the parameters, near the foot of the middle."""
    middle = 0.5 * (cell.low + cell.high)
    branch = _branch(a, b, cell, foot(b, a.at(*middle)))
    return min(_root(np.max(branch)), constant_foot(a, b, cell))


def two_branches(a: Patch, b: Patch, cell: Rectangle) -> float:
    """Return the smallest bound by convex combinations of two branches (two corners' feet), or by affine_foot."""
    corners = [cell.places(np.array(x, float)) for x in ((0, 0), (1, 0), (0, 1), (1, 1))]
    feet = [foot(b, a.at(*x)) for x in corners]
    apart = [float(np.linalg.norm(x - feet[0])) for x in feet]
    branches = [_branch(a, b, cell, feet[k]) for k in (0, int(np.argmax(apart)))]
    best = min(float(np.max(s * branches[0] + (1 - s) * branches[1])) for s in _SHARES)
    return min(_root(best), affine_foot(a, b, cell))


FAMILIES: dict[str, Callable[[Patch, Patch, Rectangle], float]] = {
    "Lipschitz": lipschitz,
    "one foot": constant_foot,
    "moving foot": affine_foot,
    "two branches": two_branches,
}


def _branch(a: Patch, b: Patch, cell: Rectangle, start: np.ndarray) -> np.ndarray:
    """Coefficients of the squared distance from affinely moving feet, fitted to the corners' feet near one branch."""
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], float)
    feet = np.array([foot(b, a.at(*cell.places(x)), start) for x in corners])
    map_, *_ = np.linalg.lstsq(np.column_stack([np.ones(4), corners]), feet, rcond=None)
    # Inside the other patch at the corners, and so everywhere.
    ends = np.column_stack([np.ones(4), corners]) @ map_
    middle = np.clip(np.mean(ends, axis=0), 0.0, 1.0)
    reach = np.max(np.abs(ends - middle), axis=0)
    room = np.minimum(middle, 1 - middle)
    shrink = np.where(reach > room, room / np.where(reach > 0, reach, 1.0), 1.0) * (1 - 1e-12)

    def squared(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        share = (np.stack([u, v], axis=-1) - cell.low) / (cell.high - cell.low)
        s = middle + shrink * (map_[0] + share @ map_[1:] - middle)
        return np.sum((a.at(u, v) - b.at(s[..., 0], s[..., 1])) ** 2, axis=-1)

    return _coefficients(squared, cell, 10)


@lru_cache
def _to_bernstein(degree: int) -> np.ndarray:
    nodes = np.linspace(0, 1, degree + 1)
    k = np.arange(degree + 1)
    basis = np.array([[comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in k] for t in nodes])
    return np.linalg.inv(basis)


def _coefficients(function: Callable[..., np.ndarray], cell: Rectangle, degree: int) -> np.ndarray:
    """Bernstein coefficients over a cell of a polynomial of at most this degree in either parameter."""
    nodes = np.linspace(0, 1, degree + 1)
    u, v = (low + nodes * (high - low) for low, high in zip(cell.low, cell.high, strict=True))
    values = function(*np.meshgrid(u, v, indexing="ij"))
    matrix = _to_bernstein(degree)
    return matrix @ values @ matrix.T


def _root(x: float) -> float:
    return float(np.sqrt(max(x, 0.0)))
