"""Surfaces on a grid of cubes: which cubes each one meets, and where lines along an axis meet it in a cube.

Implicit surfaces are met where their polynomial has roots on the lines. Meshes are met triangle by triangle. Parametric
surfaces are replaced by a mesh within a given tolerance.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from jhd.fields.octree import voxelise
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.patch import AbstractPatch

# Places count as inside up to this share of the spacing.
_SLACK = 1e-12
# Triangles are cut until they are at most so many cubes long, and pairs of a triangle and a cube are tested together.
_LONG, _PAIRS = 8, 1 << 18


class AbstractCubeSide(eqx.Module):
    """One of both surfaces.

    Args:
        lower: the lower corner of a box that holds it.
        upper: its upper corner.
    """

    lower: eqx.AbstractVar[np.ndarray]
    upper: eqx.AbstractVar[np.ndarray]

    @abstractmethod
    def occupied(self, origin: Float[np.ndarray, "3"], spacing: float, cells: int) -> Int[np.ndarray, "cubes 3"]:
        """Places of the cubes that the surface may meet, of `cells` along each axis from the origin."""

    @abstractmethod
    def met(self, lines: np.ndarray, axis: int, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        """Where lines along an axis meet the surface: numbers of lines, and coordinates between two values.

        Args:
            lines: the other two coordinates of each, (lines, 2).
            axis: of their direction.
            low: the least coordinate along it.
            high: the largest one.
        """


def cube_side(shape: Any, tolerance: float) -> AbstractCubeSide:
    """The side of a shape; a parametric surface is replaced by a mesh within the tolerance."""
    if isinstance(shape, ImplicitSurface):
        return _ImplicitCubes(np.asarray(shape.lower, float), np.asarray(shape.upper, float), shape)
    mesh = shape.to_mesh(tolerance).mesh if isinstance(shape, AbstractPatch) else shape
    corners = np.asarray(mesh.corners, float)
    return _MeshCubes(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)), corners)


def samples_in(
    side: AbstractCubeSide, low: Float[np.ndarray, "3"], spacing: float, count: int
) -> Float[np.ndarray, "samples 3"]:
    """Points of a surface in a cube, on count x count lines along the axis in which its projection is the largest.

    The number of lines that meet the surface in the cube measures the area of its projection along them.
    """
    steps = np.linspace(0.0, spacing, count)
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    best, most = np.zeros((0, 3)), 0
    for axis in range(3):
        others = [i for i in range(3) if i != axis]
        slack = _SLACK * spacing
        line, along = side.met(grid + low[others], axis, low[axis] - slack, low[axis] + spacing + slack)
        if len(np.unique(line)) > most:
            most, best = len(np.unique(line)), np.empty((len(line), 3))
            best[:, others], best[:, axis] = (grid + low[others])[line], along
    return best


class _ImplicitCubes(AbstractCubeSide):
    """An implicit surface within its box."""

    lower: np.ndarray
    upper: np.ndarray
    surface: ImplicitSurface

    @override
    def occupied(self, origin: np.ndarray, spacing: float, cells: int) -> np.ndarray:
        surface = ImplicitSurface(
            self.surface.coefficients, origin, origin + cells * spacing, reduced=self.surface.reduced
        )
        rows = np.asarray(voxelise(surface, cells).cells)
        low, high = origin + rows * spacing, origin + (rows + 1) * spacing
        return rows[np.all((low <= self.upper) & (high >= self.lower), axis=1)]

    @override
    def met(self, lines: np.ndarray, axis: int, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        others = [i for i in range(3) if i != axis]
        c = np.moveaxis(np.asarray(self.surface.coefficients, float), axis, -1)
        powers = [lines[:, [i]] ** np.arange(c.shape[i]) for i in range(2)]
        numbers, found = [], []
        for k, rows in enumerate(np.einsum("ni,nj,ijk->nk", *powers, c)):
            roots = np.roots(rows[::-1])
            heights = roots.real[np.abs(roots.imag) <= 1e-12 * (1 + np.abs(roots))]
            heights = heights[(heights >= low) & (heights <= high)]
            numbers.append(np.full(len(heights), k))
            found.append(heights)
        line, along = np.concatenate(numbers), np.concatenate(found)
        inside = np.all((lines >= self.lower[others]) & (lines <= self.upper[others]), axis=1)[line]
        inside &= (along >= self.lower[axis]) & (along <= self.upper[axis])
        return line[inside], along[inside]


class _MeshCubes(AbstractCubeSide):
    """Triangles, by their corners (triangles, 3, 3)."""

    lower: np.ndarray
    upper: np.ndarray
    corners: np.ndarray

    @override
    def occupied(self, origin: np.ndarray, spacing: float, cells: int) -> np.ndarray:
        corners = _short((self.corners - origin) / spacing)
        first = np.clip(np.floor(corners.min(axis=1) - _SLACK).astype(int), 0, cells - 1)
        size = np.clip(np.floor(corners.max(axis=1) + _SLACK).astype(int), 0, cells - 1) - first + 1
        count = size.prod(axis=1)
        found, start = [], 0
        ends = np.cumsum(count)
        while start < len(count):
            stop = max(start + 1, int(np.searchsorted(ends, ends[start] - count[start] + _PAIRS, side="right")))
            rows = np.repeat(np.arange(start, stop), count[start:stop])
            number = np.arange(len(rows)) - np.repeat(ends[start:stop] - count[start:stop], count[start:stop])
            number += ends[start] - count[start]
            rest, z = np.divmod(number, size[rows, 2])
            x, y = np.divmod(rest, size[rows, 1])
            cubes = first[rows] + np.stack([x, y, z], axis=1)
            found.append(np.unique(cubes[_meet(corners[rows], cubes + 0.5)], axis=0))
            start = stop
        return np.unique(np.concatenate(found), axis=0)

    @override
    def met(self, lines: np.ndarray, axis: int, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        others = [i for i in range(3) if i != axis]
        near = (self.corners[:, :, axis].min(axis=1) <= high) & (self.corners[:, :, axis].max(axis=1) >= low)
        flat = self.corners[:, :, others]
        near &= np.all((flat.min(axis=1) <= lines.max(axis=0)) & (flat.max(axis=1) >= lines.min(axis=0)), axis=1)
        corners, flat = self.corners[near], flat[near]
        u, v = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        corners, flat, u, v, area = (x[area != 0] for x in (corners, flat, u, v, area))
        w = lines[:, None] - flat[:, 0]
        s = (w[..., 0] * v[:, 1] - w[..., 1] * v[:, 0]) / area
        t = (u[:, 0] * w[..., 1] - u[:, 1] * w[..., 0]) / area
        line, k = np.nonzero((s >= -_SLACK) & (t >= -_SLACK) & (s + t <= 1 + _SLACK))
        a, b, c = np.moveaxis(corners[k, :, axis], -1, 0)
        along = a + s[line, k] * (b - a) + t[line, k] * (c - a)
        inside = (along >= low) & (along <= high)
        return line[inside], along[inside]


def _short(corners: np.ndarray) -> np.ndarray:
    """The same triangles, long ones in quarters."""
    while np.any(long := np.ptp(corners, axis=1).max(axis=1, initial=0.0) > _LONG):
        a, b, c = np.moveaxis(corners[long], 1, 0)
        d, e, f = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = [np.stack(x, axis=1) for x in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))]
        corners = np.concatenate([corners[~long], *parts])
    return corners


def _meet(corners: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Whether triangles meet cubes of side one: no axis of 10 parts them; boxes are known to meet."""
    corners = corners - middle[:, None]
    sides = np.roll(corners, -1, axis=1) - corners
    units = np.eye(3)
    axes = [np.cross(sides[:, 0], sides[:, 1])] + [np.cross(sides[:, k], units[i]) for k in range(3) for i in range(3)]
    meet = np.ones(len(corners), bool)
    for axis in axes:
        along, reach = np.einsum("nkd,nd->nk", corners, axis), 0.5 * np.abs(axis).sum(axis=1)
        room = reach + _SLACK * (1 + np.abs(along).max(axis=1))
        meet &= (along.min(axis=1) <= room) & (along.max(axis=1) >= -room)
    return meet
