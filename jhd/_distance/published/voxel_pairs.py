"""The minimum distance of two surfaces by voxels, as published: fast, and without any certified bound.

Both surfaces are put on one grid of cubes. Of the cubes that they meet, the nearest pair is taken. The surfaces in
these two cubes are sampled along lines, and the nearest samples are the answer. The nearest points of the surfaces need
not lie in the nearest cubes, so the error can exceed the step of the samples. If several pairs of cubes are equally
near, the answer depends on the choice.

For implicit surfaces, the samples are roots of the polynomial on the lines. Meshes are intersected triangle by
triangle. Parametric surfaces are replaced by a mesh within a given tolerance.

Source: Lin & Wang, 3-D signed Euclidean distance transform and its applications (2003), section 4.
"""

import math
from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from jhd._distance.normalization.method import AbstractMethod
from jhd._fields.distance_transform import distance_transform
from jhd._fields.octree import voxelize
from jhd._results.solution import RESULTS, MinimumSolution
from jhd._runtime.arrays import check_whole, is_traced
from jhd._shapes.as_shape import ShapeLike
from jhd._shapes.checks import optional_array
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch

# Points count as inside up to this fraction of the spacing.
_SLACK = 1e-12
# Largest number of cubes along an axis.
_MOST = 1 << 10
_SERVED = (ImplicitSurface, TriangleMesh, AbstractPatch)


class AbstractCubeSide(eqx.Module):
    """A surface of the pair, in the form for cubes.

    Args:
        lower: the lower corner of a box around it.
        upper: its upper corner.
    """

    lower: eqx.AbstractVar[np.ndarray]
    upper: eqx.AbstractVar[np.ndarray]

    @abstractmethod
    def occupied(self, origin: Float[np.ndarray, "3"], spacing: float, cells: int) -> Int[np.ndarray, "cubes 3"]:
        """Return the indices of the cubes that the surface may meet, of `cells` along each axis from the origin."""

    @abstractmethod
    def met(self, lines: np.ndarray, axis: int, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        """Return where lines along an axis meet the surface: indices of lines, and coordinates from `low` to `high`."""


def cube_side(shape: Any, tolerance: float) -> AbstractCubeSide:
    """Return the side of a shape; a parametric surface is replaced by a mesh within the tolerance."""
    if isinstance(shape, ImplicitSurface):
        return _ImplicitCubes(np.asarray(shape.lower, float), np.asarray(shape.upper, float), shape)
    mesh = shape.to_mesh(tolerance).shape if isinstance(shape, AbstractPatch) else shape
    corners = np.asarray(mesh.corners, float)
    return _MeshCubes(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)), corners)


def samples_in(
    side: AbstractCubeSide, low: Float[np.ndarray, "3"], spacing: float, count: int
) -> Float[np.ndarray, "samples 3"]:
    """Return points of a surface in a cube, on count x count lines along the axis of its largest projection.

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
        rows = np.asarray(voxelize(surface, cells).cells)
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
            # Pairs of a triangle and a cube that are tested together.
            stop = max(start + 1, int(np.searchsorted(ends, ends[start] - count[start] + (1 << 18), side="right")))
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
    """Return the triangles, with long ones cut into quarters."""
    # Triangles are cut until they span at most this many cubes.
    while np.any(long := np.ptp(corners, axis=1).max(axis=1, initial=0.0) > 8):
        a, b, c = np.moveaxis(corners[long], 1, 0)
        d, e, f = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = [np.stack(x, axis=1) for x in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))]
        corners = np.concatenate([corners[~long], *parts])
    return corners


def _meet(corners: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return whether triangles meet cubes of side one: no axis of 10 separates them; boxes are known to meet."""
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


class TiedPairs(NamedTuple):
    """The nearest pairs of cubes of two surfaces, all equally near, with the nearest samples in each pair.

    Args:
        cells_a: grid indices of the cubes of `a`, sorted together with `cells_b`.
        cells_b: grid indices of the cubes of `b`.
        distance: distance of the nearest samples, infinite if a surface has none in its cube.
        points_a: the nearest samples on `a`, NaN if there are none.
        points_b: the nearest samples on `b`, NaN if there are none.
    """

    cells_a: Int[np.ndarray, "pairs 3"]
    cells_b: Int[np.ndarray, "pairs 3"]
    distance: Float[np.ndarray, " pairs"]
    points_a: Float[np.ndarray, "pairs 3"]
    points_b: Float[np.ndarray, "pairs 3"]


class VoxelPairs(AbstractMethod):
    """Minimum distance of two surfaces from samples in the nearest pair of cubes, as published; without bounds.

    The result is RESULTS.not_certified. The method serves implicit surfaces, meshes, parametric surfaces, and mixed
    pairs of these, outside jit.

    Changes to the source, Lin & Wang, 3-D signed Euclidean distance transform and its applications (2003), section 4:

     - The exact distance transform finds all nearest pairs of cubes, and `ties` says which are sampled.
     - The axis of the lines is chosen by the projected area. This area is measured by the number of lines that meet the
       surface in the cube.
     - A parametric surface is sampled on a mesh within 1/100 of the spacing of the lines.

    The paper uses spacing = (samples - 1) eps for an error of eps; it does not reach this error in general.

    Use it as `jhd.minimum_distance(a, b, jhd.published.VoxelPairs(spacing=0.1, samples=11))`.

    Args:
        spacing: side of the cubes, in the unit of the coordinates, positive.
        samples: number of lines along each of two axes, both faces included; at least 2.
        ties: "first" takes the first pair in the order of the cubes, "all" the best of all nearest pairs.
        origin: the lower corner of the grid, of shape (3,); by default the lower corner of the joint bounding box. It
            affects the answer.

    Raises:
        ValueError: a number out of range, or an unknown value of `ties`.
    """

    spacing: float = eqx.field(static=True)
    samples: int = eqx.field(static=True, default=10)
    ties: str = eqx.field(static=True, default="first")
    origin: Array | None = eqx.field(default=None, converter=optional_array("origin"))

    def __check_init__(self) -> None:
        if not (isinstance(self.spacing, int | float) and 0 < self.spacing < math.inf):
            raise ValueError(f"spacing is {self.spacing!r}; needs a positive number.")
        check_whole("samples", self.samples, 2)
        if self.ties not in ("first", "all"):
            raise ValueError(f"ties is {self.ties!r}; needs 'first' or 'all'.")
        if self.origin is not None and self.origin.shape != (3,):
            raise ValueError(f"origin has shape {self.origin.shape}; needs (3,).")

    @classmethod
    def serves(cls, a: object, b: object) -> bool:
        """Whether both shapes are surfaces."""
        return isinstance(a, _SERVED) and isinstance(b, _SERVED)

    def _minimum(self, a: ShapeLike, b: ShapeLike) -> MinimumSolution:
        """The distance of the nearest samples, as a solution without bounds; called by `jhd.minimum_distance`."""
        found = self.pairs(a, b)
        best = int(np.argmin(found.distance)) if self.ties == "all" else 0
        if not np.isfinite(found.distance[best]):
            raise ValueError("the nearest cubes hold no sample of one of the surfaces; raise samples.")
        value, points = jnp.asarray(found.distance[best]), (found.points_a[best], found.points_b[best])
        stats = {"ties": jnp.asarray(len(found.distance))}
        point_a, point_b = (jnp.asarray(point) for point in points)
        zero, infinite = jnp.zeros_like(value), jnp.full_like(value, jnp.inf)
        return MinimumSolution(value, zero, infinite, point_a, point_b, RESULTS.not_certified, stats)

    def pairs(self, a: ShapeLike, b: ShapeLike) -> TiedPairs:
        """All pairs of cubes that are equally near, each with its nearest samples.

        Args:
            a: an implicit surface, a parametric surface or a mesh.
            b: a surface of any of these kinds.

        Returns:
            A TiedPairs: cubes, distances and samples.

        Raises:
            TypeError: a shape of another kind, or a call under tracing.
            ValueError: a surface without points in its box, or too many cubes.
        """
        for name, shape in (("a", a), ("b", b)):
            if not isinstance(shape, _SERVED):
                raise TypeError(
                    f"{name} must be an implicit or parametric surface or a mesh; got {type(shape).__name__}."
                )
        if is_traced(a, b, self):
            raise TypeError("VoxelPairs runs on the host, not under jit: the grid depends on the surfaces.")
        # Meshes of parametric surfaces are off by at most this fraction of the distance of two lines.
        sides = [cube_side(shape, 0.01 * self.spacing / (self.samples - 1)) for shape in (a, b)]
        origin, cells = self._grid(sides)
        occupied = [side.occupied(origin, self.spacing, cells) for side in sides]
        if not all(len(rows) for rows in occupied):
            raise ValueError("a or b is a surface without points in its box; check the box.")
        near = _nearest_cells(*occupied)
        tables = [self._samples_in(side, origin, rows) for side, rows in zip(sides, near, strict=True)]
        rows = [_nearest(tables[0][tuple(p)], tables[1][tuple(q)]) for p, q in zip(*near, strict=True)]
        distance, points_a, points_b = (np.array(column) for column in zip(*rows, strict=True))
        return TiedPairs(*near, distance, points_a, points_b)

    def _grid(self, sides: list[AbstractCubeSide]) -> tuple[np.ndarray, int]:
        low, high = np.min([x.lower for x in sides], axis=0), np.max([x.upper for x in sides], axis=0)
        origin = low if self.origin is None else np.asarray(self.origin, float)
        if np.any(origin > low):
            raise ValueError(f"origin is {origin.tolist()}; needs to be at most {low.tolist()}.")
        count = math.ceil(float(((high - origin) / self.spacing).max()) * (1 + 1e-12))
        if count > _MOST:
            raise ValueError(f"spacing is {self.spacing:g}; needs at most {_MOST} cubes along an axis, not {count}.")
        return origin, 1 << max(count - 1, 0).bit_length()

    def _samples_in(self, side: AbstractCubeSide, origin: np.ndarray, rows: np.ndarray) -> dict[Any, np.ndarray]:
        """Return for each of the cubes its samples."""
        cells = np.unique(rows, axis=0)
        return {tuple(x): samples_in(side, origin + x * self.spacing, self.spacing, self.samples) for x in cells}


def _nearest_cells(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of cubes at the least distance, sorted: the distances of b's cubes from the transform of a's."""
    low = np.minimum(a.min(axis=0), b.min(axis=0))
    features = np.zeros(np.maximum(a.max(axis=0), b.max(axis=0)) - low + 1, bool)
    features[tuple((a - low).T)] = True
    distance = np.asarray(distance_transform(features).distance)[tuple((b - low).T)]
    near = b[distance <= distance.min() * (1 + 1e-9)]
    least = round(float(distance.min()) ** 2)
    pairs = []
    for cell in near:
        same = a[np.sum((a - cell) ** 2, axis=1) == least]
        pairs.append(np.concatenate([same, np.broadcast_to(cell, same.shape)], axis=1))
    rows = np.unique(np.concatenate(pairs), axis=0)
    return rows[:, :3], rows[:, 3:]


def _nearest(first: np.ndarray, second: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    if not len(first) or not len(second):
        return math.inf, np.full(3, np.nan), np.full(3, np.nan)
    apart = np.sqrt(np.sum((first[:, None] - second[None]) ** 2, axis=-1))
    i, j = np.unravel_index(np.argmin(apart), apart.shape)
    return float(apart[i, j]), first[i], second[j]
