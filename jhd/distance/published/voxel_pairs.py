"""The minimum distance of two surfaces by voxels, as published: fast, and without any proof.

Both surfaces are put on one grid of cubes; of the cubes that the one and the other meet, the nearest pair is taken, the
surfaces in it are sampled along lines, and the nearest samples are the answer. Nothing makes the nearest points of the
surfaces lie in the nearest cubes, so the error can exceed the step of the samples, and where several pairs of cubes are
equally near the answer depends on which is taken.

Source: Lin & Wang, 3D signed Euclidean distance transform and its applications (2003), section 4.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._results.solution import RESULTS, MinimumSolution
from jhd._runtime.arrays import check_whole, is_traced, real_array
from jhd.distance.frame.method import AbstractMethod
from jhd.distance.published.cube_samples import AbstractCubeSide, cube_side, samples_in
from jhd.fields.distance_transform import distance_transform
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch

# Largest number of cubes along an axis.
_MOST = 1 << 10
# Meshes of parametric surfaces are off by at most this share of the distance of two lines.
_MESHED = 0.01
_SERVED = (ImplicitSurface, TriangleMesh, AbstractPatch)


class TiedPairs(NamedTuple):
    """The pairs of cubes that are equally near, and the nearest samples in each.

    Args:
        cells_a: places in the grid of the cubes of a, sorted with those of b.
        cells_b: those of b.
        distance: distance of the nearest samples, infinite where a surface has none in its cube.
        points_a: the samples on a, NaN where there are none.
        points_b: those on b.
    """

    cells_a: Int[np.ndarray, "pairs 3"]
    cells_b: Int[np.ndarray, "pairs 3"]
    distance: Float[np.ndarray, " pairs"]
    points_a: Float[np.ndarray, "pairs 3"]
    points_b: Float[np.ndarray, "pairs 3"]


class VoxelPairs(AbstractMethod):
    """The published method: samples in the nearest pair of cubes. Its answer is RESULTS.unproven, with no bounds.

    It serves implicit surfaces, meshes, parametric surfaces, and pairs of these.

    Changes to the source:

     - The nearest cubes come from the exact distance transform, all of them, and `ties` says which are sampled.
     - The projected area that the axis of the lines is chosen by is measured by the number of lines that meet the
       surface in the cube.
     - A parametric surface is sampled on a mesh that is within a hundredth of the distance of lines.

    The paper takes spacing = (samples - 1) eps for an error of eps, which it does not keep in general.

    Args:
        spacing: side of the cubes, in the unit of the coordinates.
        samples: number of lines along each of two axes, both faces included; at least 2.
        ties: "first" takes the first pair in the order of the cubes, "all" the best of all nearest pairs.
        origin: the lower corner of the grid; by default that of both boxes. It moves the answer.

    Raises:
        ValueError: numbers out of range, another name.
    """

    spacing: float = eqx.field(static=True)
    samples: int = eqx.field(static=True, default=10)
    ties: str = eqx.field(static=True, default="first")
    origin: Array | None = eqx.field(default=None, converter=lambda x: None if x is None else real_array("origin", x))

    def __check_init__(self) -> None:
        if not (isinstance(self.spacing, int | float) and 0 < self.spacing < math.inf):
            raise ValueError(f"spacing is {self.spacing!r}; needs a positive number.")
        check_whole("samples", self.samples, 2)
        if self.ties not in ("first", "all"):
            raise ValueError(f"ties is {self.ties!r}; needs 'first' or 'all'.")
        if self.origin is not None and self.origin.shape != (3,):
            raise ValueError(f"origin has shape {self.origin.shape}; needs (3,).")

    @classmethod
    def serves(cls, a: Any, b: Any) -> bool:
        """Whether both are surfaces."""
        return isinstance(a, _SERVED) and isinstance(b, _SERVED)

    def minimum(self, a: Any, b: Any) -> MinimumSolution:
        """The distance of the nearest samples, as a solution without bounds.

        Raises:
            TypeError: a shape of another kind, or under tracing.
            ValueError: a surface without points in its box, too many cubes, no sample in the cubes taken.
        """
        found = self.pairs(a, b)
        best = int(np.argmin(found.distance)) if self.ties == "all" else 0
        if not np.isfinite(found.distance[best]):
            raise ValueError("the nearest cubes hold no sample of one of the surfaces; needs more samples.")
        value, points = jnp.asarray(found.distance[best]), (found.points_a[best], found.points_b[best])
        stats = {"ties": jnp.asarray(len(found.distance))}
        point_a, point_b = (jnp.asarray(point) for point in points)
        zero, infinite = jnp.zeros_like(value), jnp.full_like(value, jnp.inf)
        return MinimumSolution(value, zero, infinite, point_a, point_b, RESULTS.unproven, stats)

    def pairs(self, a: Any, b: Any) -> TiedPairs:
        """All pairs of cubes that are equally near, each with its nearest samples.

        Raises:
            TypeError: a shape of another kind, or under tracing.
            ValueError: a surface without points in its box, or too many cubes.
        """
        for name, shape in (("a", a), ("b", b)):
            if not isinstance(shape, _SERVED):
                raise TypeError(
                    f"{name} must be an implicit or parametric surface or a mesh; got {type(shape).__name__}."
                )
        if is_traced(a, b, self):
            raise TypeError("VoxelPairs runs on the host: the numbers of cubes and samples depend on the surfaces.")
        sides = [cube_side(shape, _MESHED * self.spacing / (self.samples - 1)) for shape in (a, b)]
        origin, cells = self._grid(sides)
        occupied = [side.occupied(origin, self.spacing, cells) for side in sides]
        if not all(len(rows) for rows in occupied):
            raise ValueError("a or b is a surface without points in its box.")
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
        """For each of the cubes its samples."""
        cells = np.unique(rows, axis=0)
        return {tuple(x): samples_in(side, origin + x * self.spacing, self.spacing, self.samples) for x in cells}


def _nearest_cells(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of cubes at the least distance, sorted: the distances of b's cubes from the transform of a's."""
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
