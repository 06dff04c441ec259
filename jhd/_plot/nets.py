"""Quadrilaterals of surfaces, for pictures; an implicit surface has one vertex in each cell of both signs.

Source: surface nets, Gibson, Constrained elastic surface nets, MICCAI 1998. Ours: layers of flat cells on the faces of
the box, which make the quadrilaterals end on them, and the step of the vertices onto the surface.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.polynomial.polynomial import polyder, polygrid3d, polyval3d

from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.patch import AbstractPatch


def quadrilaterals(surface: ImplicitSurface, cells: int) -> Float[np.ndarray, "cells corners 3"]:
    """Quadrilaterals of a surface from a grid of `cells` cells along each axis, with corners in cyclic order.

    Parts of the surface without a change of sign on the grid are missed.
    """
    coefficients = np.asarray(surface.coefficients, float)
    low, high = (np.asarray(end, float) for end in surface.bounds)
    # The first and the last layer of cells are flat.
    x, y, z = lines = [np.pad(np.linspace(low[k], high[k], cells + 1), 1, mode="edge") for k in range(3)]
    values = polygrid3d(x, y, z, coefficients)
    owner, crossing, quads = _crossings(lines, values)
    used, index = np.unique(owner, return_inverse=True)
    share = np.bincount(index)[:, None]
    middle = np.stack([np.bincount(index, crossing[:, axis]) for axis in range(3)], axis=-1) / share
    place = np.unravel_index(used, np.array(values.shape) - 1)
    box = (np.stack([line[i + k] for line, i in zip(lines, place, strict=True)], axis=-1) for k in (0, 1))
    return _onto(coefficients, middle, *box)[np.searchsorted(used, quads)]


def quadrilaterals_of_patches(shape: AbstractPatch, cells: int) -> Float[np.ndarray, "cells corners 3"]:
    """Quadrilaterals of a parametric surface, about `cells` along each side, with corners in cyclic order."""
    patches = shape.patches()
    # Least number of quadrilaterals along each side of a patch.
    n = int(np.clip(np.ceil(cells / np.sqrt(patches.count)), 4, cells))
    t = np.linspace(0.0, 1.0, n + 1)
    piece: Any = np.arange(patches.count)[:, None, None]
    points = np.asarray(patches.point(piece, t[:, None], t), float)
    sides = points[:, :-1, :-1], points[:, 1:, :-1], points[:, 1:, 1:], points[:, :-1, 1:]
    return np.stack([side.reshape(-1, 3) for side in sides], axis=1)


def _crossings(lines: list[np.ndarray], values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells and points on edges of the grid at which the sign changes, and the four cells about each such edge.

    A point appears once for each of its cells; four cells are listed only for inner edges. Cells are flat indices.
    """
    shape = np.array(values.shape) - 1
    owners, points, quads = [], [], []
    for axis in range(3):
        first, second = (np.delete(values, end, axis=axis) for end in (-1, 0))
        edges = np.argwhere((first > 0) != (second > 0))
        f, g = (part[tuple(edges.T)] for part in (first, second))
        point = np.stack([line[i] for line, i in zip(lines, edges.T, strict=True)], axis=-1)
        here, line = edges[:, axis], lines[axis]
        point[:, axis] += f / (f - g) * (line[here + 1] - line[here])
        u, v = np.delete(np.eye(3, dtype=int), axis, axis=0)
        # In cyclic order.
        around = np.stack([edges - step for step in (0 * u, u, u + v, v)], axis=1)
        inside = np.all((around >= 0) & (around < shape), axis=-1)
        flat = around @ [shape[1] * shape[2], shape[2], 1]
        owners.append(flat[inside])
        points.append(np.repeat(point[:, None], 4, axis=1)[inside])
        quads.append(flat[inside.all(axis=1)])
    return np.concatenate(owners), np.concatenate(points), np.concatenate(quads)


def _onto(coefficients: np.ndarray, points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """The points after some steps of Newton's method along the gradient, each within its cell."""
    slopes = [polyder(coefficients, axis=axis) for axis in range(3)]
    for _ in range(3):
        x, y, z = points.T
        gradient = np.stack([polyval3d(x, y, z, slope) for slope in slopes], axis=-1) * (lower < upper)
        square = np.sum(gradient**2, axis=-1, keepdims=True)
        value = polyval3d(x, y, z, coefficients)[:, None]
        step = np.where(square > 0, value / np.where(square > 0, square, 1.0), 0.0) * gradient
        points = np.clip(points - step, lower, upper)
    return points
