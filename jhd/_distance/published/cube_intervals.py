"""Distances of implicit surfaces from cells: the published interval, and a certified one.

Both surfaces are voxelized. Two cells have an interval of distances of their points. For each cell of a, the smallest
ends over the cells of b are taken; then the largest of these over the cells of a. The paper uses all kept cells
throughout. A kept cell need not hold a point of the surface, and then its interval can miss the distance: a cell of b
without a point makes the upper end too small, a cell of a without a point makes the lower end too large. The safe rule
uses only certified cells for these two ends. With A the kept cells and V the cells certified to hold a point,

    lower = max over V(a) of min over A(b) of the smallest distance of two cells,
    upper = max over A(a) of min over V(b) of the largest distance of two cells.

A certified point of a lies in its cell, and the points of b lie in kept cells, so it is at least `lower` away from b. A
point of a lies in a kept cell, which has points of b within `upper`.

On one grid of cubes both squared distances are sums over the axes of max(d - 1, 0)^2 and (d + 1)^2, with d the
difference of the cell indices. So the minima over all pairs are taken axis by axis (exactly, in integers); otherwise in
tiles of pairs.

Source: AlgSurf (modified affine arithmetic, octree, intervals of cubes), section 2; the safe rule is ours.
"""

import math
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from jhd._arithmetic import rounding
from jhd._arithmetic.rationals import float_above, float_below, root_between
from jhd._distance.normalization.directions import larger
from jhd._distance.normalization.method import AbstractHausdorffMethod
from jhd._fields.boxes import squared_distances, squared_vertex_distances
from jhd._fields.octree import Voxels, voxelize
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness
from jhd._runtime.arrays import whole_between
from jhd._runtime.compiled import optimized
from jhd._shapes.implicit import ImplicitSurface, check_surface
from jhd.progress import Callback

# Cells of a that are compared at once with a tile of cells of b: 2 MB of numbers.
_CHUNK, _TILE = 1024, 256
# Number of cells of a whose lines are processed together.
_PLACES = 4096


class CubeIntervals(AbstractHausdorffMethod):
    """Hausdorff distance of implicit surfaces from intervals of cells, up to about the size of a cell; not under jit.

    - rule="safe": lower <= exact <= upper. If no cell of a surface is certified to hold a point, a bound is missing,
      the value is NaN and the result RESULTS.existence_not_certified. Ranges of polynomials come from Bernstein
      coefficients.
    - rule="paper": the published interval and its midpoint, with RESULTS.not_certified. It can miss the distance.
      Ranges come from modified affine arithmetic.

    Changes to the source, AlgSurf, section 2:

     - The number of cells is given. The source gives their largest edge.
     - Minima are taken of squared distances, axis by axis if this is exact.

    `value` is the midpoint of the interval and has no derivatives. The witness is the center of the cell with the
    largest upper end, and its foot point is the center of the nearest cell. The event is a_end or b_end if one of them
    is at the border of its box, otherwise antipodal. Segments are -1 and parameters NaN.

    Use it as `jhd.hausdorff(a, b, jhd.published.CubeIntervals(64))`.

    Args:
        cells: number of cells along each axis of each box, up to 2^20. The paper's 1/64 of the side is 64.
        rule: "safe" or "paper", as above.
        pairs: "separable" takes the minima axis by axis if both surfaces have the same cubic box and at most 256 cells.
            "tiles" compares all pairs of cells; "separable" does the same in all other cases.
        ends: how the interval of the distances between two cells is found (step 4 of the source). "cells" bounds the
            distances of all their points by interval arithmetic. "vertices" uses the 64 distances between their
            vertices, for rule="paper" only. Its lower end can exceed the minimum distance if cells of different grids
            overlap. On one grid both give the same interval.

    Raises:
        TypeError: `cells` is not a whole number.
        ValueError: `cells` is out of range, an option has an unknown value, or ends="vertices" with the safe rule.
    """

    cells: int = eqx.field(static=True, default=64)
    rule: str = eqx.field(static=True, default="safe")
    pairs: str = eqx.field(static=True, default="separable")
    ends: str = eqx.field(static=True, default="cells")

    def __check_init__(self) -> None:
        whole_between("cells", self.cells, 1, 1 << 20)
        options = ("rule", ("safe", "paper")), ("pairs", ("separable", "tiles")), ("ends", ("cells", "vertices"))
        for name, allowed in options:
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} is {getattr(self, name)!r}; needs {' or '.join(map(repr, allowed))}.")
        if self.ends == "vertices" and self.rule == "safe":
            raise ValueError("ends is 'vertices', which certifies no bound; use it with rule='paper'.")

    @classmethod
    def serves(cls, a: object, b: object) -> bool:
        """Whether both shapes are implicit surfaces."""
        return isinstance(a, ImplicitSurface) and isinstance(b, ImplicitSurface)

    def _directed_surfaces(
        self, a: ImplicitSurface, b: ImplicitSurface, *, progress: Callback | None = None
    ) -> HausdorffSolution:
        """The directed distance, max over a of min over b; called by `jhd.directed_hausdorff`."""
        return self._measured(*self._cells(a, b, progress), DIRECTIONS.a_to_b)

    def _surfaces(
        self, a: ImplicitSurface, b: ImplicitSurface, *, progress: Callback | None = None
    ) -> HausdorffSolution:
        """The larger of both directed distances, with the larger of both bounds; called by `jhd.hausdorff`."""
        p, q, scale = self._cells(a, b, progress)
        return larger_interval(
            self._measured(p, q, scale, DIRECTIONS.a_to_b), self._measured(q, p, scale, DIRECTIONS.b_to_a)
        )

    def _cells(
        self, a: ImplicitSurface, b: ImplicitSurface, progress: Callback | None
    ) -> tuple["_GridCells", "_GridCells", "_Scale"]:
        """The cells of `a` and of `b` in common coordinates, and the scale of these; both surfaces are concrete.

        Raises:
            TypeError: shapes of another kind, or traced ones.
            ValueError: a surface that is certified to be empty in its box.
        """
        check_surface("a", a)
        check_surface("b", b)
        ranges = "bernstein" if self.rule == "safe" else "modified_affine"
        voxels = [voxelize(surface, self.cells, ranges=ranges, progress=progress) for surface in (a, b)]
        # Largest grid whose cells are all held in one array, 64 MB.
        common = _on_one_grid if _same_cube(a, b) and self.cells <= 256 else _on_two_grids
        return common((a, b), voxels, self.cells)

    def _measured(self, p: "_GridCells", q: "_GridCells", scale: "_Scale", direction: DIRECTIONS) -> HausdorffSolution:
        """The directed distance from the surface of the cells p to the surface of the cells q."""
        safe = self.rule == "safe"
        proven = q.proven if safe else np.ones_like(q.proven)
        by_axes = self.pairs == "separable" and scale.exact
        vertices = self.ends == "vertices"
        least, most = _by_axes(p, q, proven, self.cells) if by_axes else _by_tiles(p, q, proven, vertices)
        # If nothing is proven, the lower end is 0 and the upper one infinite.
        lower_sq = np.max(least[p.proven] if safe else least, initial=0.0)
        upper_sq = np.max(most)
        lower, upper = scale.lengths(float(lower_sq), float(upper_sq), outward=safe)
        verified = bool(p.proven.any() and q.proven.any())
        result = (
            (RESULTS.successful if verified else RESULTS.existence_not_certified) if safe else RESULTS.not_certified
        )
        place = int(np.argmax(most)) if np.isfinite(upper_sq) else int(np.argmax(least))
        return HausdorffSolution(
            value=_value(lower, upper, result),
            lower=lower,
            upper=upper,
            witness=_witness(p, q, place, proven, self.cells, direction),
            result=result,
            stats={
                "cells_a": jnp.asarray(p.count),
                "cells_b": jnp.asarray(q.count),
                "proven_a": jnp.asarray(int(p.proven.sum())),
                "proven_b": jnp.asarray(int(q.proven.sum())),
                "pairs": jnp.asarray(min(p.count * q.count, int(jnp.iinfo(jnp.result_type(int)).max))),
            },
        )


def larger_interval(there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
    """Return the larger of both directions; its value is the midpoint of its own interval."""
    found = larger(there, back)
    return replace(found, value=_value(found.lower, found.upper, found.result))


class _GridCells(NamedTuple):
    """Cells of one surface: their corners (3, cells) in common coordinates, and their indices in its grid."""

    lower: np.ndarray
    upper: np.ndarray
    places: np.ndarray
    proven: np.ndarray
    grid: Voxels

    @property
    def count(self) -> int:
        return self.lower.shape[1]

    def center(self, index: int) -> np.ndarray:
        """Return the middle of a cell in the user's coordinates."""
        return np.asarray(self.grid.lower) + np.asarray(self.grid.spacing) * (self.places[index] + 0.5)

    def at_border(self, index: int, cells: int) -> bool:
        """Return whether a cell touches the border of its box."""
        return bool(np.any((self.places[index] == 0) | (self.places[index] == cells - 1)))


class _Scale(NamedTuple):
    """Unit of the common coordinates in the user's, and whether squared lengths are exact: whole numbers."""

    unit: Fraction
    exact: bool

    def lengths(self, lower_sq: float, upper_sq: float, outward: bool) -> tuple[Array, Array]:
        """Return lengths from squared lengths, rounded outward or to the nearest; inf for an infinite one."""
        dtype = np.dtype(jnp.result_type(float))
        # Five roundings, see squared_distances, and underflow of three squares.
        slack = Fraction(0) if self.exact or not outward else Fraction(rounding.gamma(8, dtype))
        lost = Fraction(12 * rounding.smallest_normal(dtype)) if slack else Fraction(0)
        low, high = Fraction(lower_sq) * (1 - slack), None
        if math.isfinite(upper_sq):
            high = Fraction(upper_sq) * (1 + slack) + lost
        lower = root_between(low * self.unit**2)
        upper = None if high is None else root_between(high * self.unit**2)
        if not outward:
            return jnp.asarray(float(lower[0]), dtype), jnp.asarray(float(upper[0]) if upper else np.inf, dtype)
        return jnp.asarray(float_below(lower[0], dtype)), jnp.asarray(
            float_above(upper[1], dtype) if upper else np.inf, dtype
        )


def _same_cube(a: ImplicitSurface, b: ImplicitSurface) -> bool:
    ends = [np.asarray(end, float) for surface in (a, b) for end in surface.bounds]
    sides = {Fraction(float(u)) - Fraction(float(v)) for v, u in zip(ends[0], ends[1], strict=True)}
    return bool(np.all(ends[0] == ends[2]) and np.all(ends[1] == ends[3])) and len(sides) == 1


def _on_one_grid(
    surfaces: tuple[ImplicitSurface, ImplicitSurface], voxels: list[Voxels], cells: int
) -> tuple[_GridCells, _GridCells, _Scale]:
    """Return corners in units of a cell: whole numbers."""
    lower, upper = (Fraction(float(end[0])) for end in surfaces[0].bounds)
    corners = [np.asarray(v.cells).T.astype(np.float32) for v in voxels]
    p, q = (_cells_of(v, corner, corner + 1) for v, corner in zip(voxels, corners, strict=True))
    return p, q, _Scale((upper - lower) / cells, True)


def _on_two_grids(
    surfaces: tuple[ImplicitSurface, ImplicitSurface], voxels: list[Voxels], cells: int
) -> tuple[_GridCells, _GridCells, _Scale]:
    """Return corners from the lower corner of the first box, in units of a power of two about as large as both."""
    boxes = [[[Fraction(float(x)) for x in np.asarray(end)] for end in surface.bounds] for surface in surfaces]
    origin = boxes[0][0]
    size = max(abs(x - o) for box in boxes for end in box for x, o in zip(end, origin, strict=True))
    exponent = math.floor(math.log2(size.numerator)) - math.floor(math.log2(size.denominator))
    unit, dtype = Fraction(2) ** exponent, np.dtype(jnp.result_type(float))
    result = []
    for v, (lower, upper) in zip(voxels, boxes, strict=True):
        places, ends = np.asarray(v.cells), ([], [])
        for axis, (low, high, o) in enumerate(zip(lower, upper, origin, strict=True)):
            used, index = np.unique(places[:, axis], return_inverse=True)
            for shift, rounded, rows in ((0, float_below, ends[0]), (1, float_above, ends[1])):
                lines = [(low - o + (high - low) * (int(i) + shift) / cells) / unit for i in used]
                rows.append(np.array([rounded(x, dtype) for x in lines], dtype)[index])
        result.append(_cells_of(v, np.stack(ends[0]), np.stack(ends[1])))
    return (*result, _Scale(unit, False))


def _cells_of(voxels: Voxels, lower: np.ndarray, upper: np.ndarray) -> _GridCells:
    return _GridCells(lower, upper, np.asarray(voxels.cells), np.asarray(voxels.proven), voxels)


def _by_axes(p: _GridCells, q: _GridCells, proven: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Return for each cell of p the smallest ends over the cells of q, the upper ones over proven cells only."""
    steps = np.arange(cells, dtype=np.float32)
    tables = np.maximum(steps - 1, 0) ** 2, (steps + 1) ** 2
    ends = []
    for table, some in zip(tables, (np.ones_like(proven), proven), strict=True):
        taken = np.zeros((cells,) * 3, bool)
        taken[tuple(q.places[some].T)] = True
        grid = _two_axes(jnp.asarray(taken), jnp.asarray(table))
        parts = (p.places[first : first + _PLACES].T for first in range(0, p.count, _PLACES))
        parts = (np.pad(part, [(0, 0), (0, _PLACES - part.shape[1])]) for part in parts)
        found = [_third_axis(grid, jnp.asarray(table), jnp.asarray(part)) for part in parts]
        ends.append(np.concatenate([np.asarray(part) for part in found])[: p.count])
    return ends[0], ends[1]


@optimized
def _two_axes(taken: Array, table: Array) -> Array:
    """Return for every cell the minimum of table(step in x) + table(step in y) over the taken cells of its plane in z.

    Along x the nearest one is the best. Along y everything is tried, a plane at a time, which stays in the cache.
    """
    count = taken.shape[0]
    places = jnp.arange(count)
    index = places[:, None, None]
    before = lax.cummax(jnp.where(taken, index, -count), axis=0)
    after = lax.cummin(jnp.where(taken, index, 2 * count), axis=0, reverse=True)
    steps = jnp.minimum(index - before, after - index)
    along_x = jnp.where(steps < count, table[jnp.minimum(steps, count - 1)], jnp.inf)

    def along_y(plane: Array) -> Array:
        def body(j: Array, best: Array) -> Array:
            return jnp.minimum(best, plane[j][None] + table[jnp.abs(places - j)][:, None])

        return lax.fori_loop(0, count, body, jnp.full_like(plane, jnp.inf))

    return lax.map(along_y, along_x)


@optimized
def _third_axis(grid: Array, table: Array, places: Array) -> Array:
    """Return the minimum of grid + table(step in z) for the cells with the indices `places` (3, cells)."""
    x, y, z = places
    steps = jnp.abs(z[:, None] - jnp.arange(grid.shape[0]))
    return jnp.min(grid[x, y] + table[steps], axis=-1)


def _by_tiles(p: _GridCells, q: _GridCells, proven: np.ndarray, vertices: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends as `_by_axes` does, from all pairs of cells, a chunk of p against one tile of q at a time."""
    # Repeated cells change no minimum; lengths in powers of four keep the number of compiled functions small.
    length = max(_TILE, 4 ** -(-(q.count - 1).bit_length() // 2))
    b = [jnp.asarray(np.pad(x, [(0, 0), (0, length - q.count)], mode="edge")) for x in (q.lower, q.upper)]
    penalty = np.where(proven, 0.0, np.inf).astype(q.lower.dtype)
    penalty = jnp.asarray(np.pad(penalty, (0, length - q.count), mode="edge"))
    tiles = jnp.asarray(-(-q.count // _TILE))
    found = []
    for first in range(0, p.count, _CHUNK):
        part = [x[:, first : first + _CHUNK] for x in (p.lower, p.upper)]
        part = [jnp.asarray(np.pad(x, [(0, 0), (0, _CHUNK - x.shape[1])], mode="edge")) for x in part]
        found.append(_tiled(vertices, *part, *b, penalty, tiles))
    least, most = (np.concatenate([np.asarray(pair[i]) for pair in found])[: p.count] for i in (0, 1))
    return least, most


@partial(optimized, static=(0,))
def _tiled(
    vertices: bool, a_lower: Array, a_upper: Array, b_lower: Array, b_upper: Array, penalty: Array, tiles: Array
) -> tuple[Array, Array]:
    """Return the smallest ends for a chunk of cells of a over all cells of b, one tile of b at a time."""
    # The cells of b in front: a minimum over the leading axis runs in vectors, over the last one it does not.
    a = a_lower[:, None], a_upper[:, None]
    distances = squared_vertex_distances if vertices else squared_distances

    def body(tile: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        def part(x: Array) -> Array:
            return lax.dynamic_slice_in_dim(x, tile * _TILE, _TILE, axis=-1)[..., None]

        least, most = distances(a, (part(b_lower), part(b_upper)))
        return jnp.minimum(best[0], least.min(0)), jnp.minimum(best[1], (most + part(penalty)).min(0))

    start = jnp.full(a_lower.shape[1:], jnp.inf, a_lower.dtype)
    return lax.fori_loop(0, tiles, body, (start, start))


def _witness(p: _GridCells, q: _GridCells, place: int, proven: np.ndarray, cells: int, direction: Any) -> Witness:
    """Return the center of a cell of p and the center of the nearest cell of q, a proven one if there is any."""
    # As in squared_distances; in NumPy, since the number of cells is another one each time.
    before, after = p.lower[:, place, None] - q.upper, q.lower - p.upper[:, place, None]
    most = np.sum(np.minimum(before, after) ** 2, axis=0)
    foot = int(np.argmin(np.where(proven | ~proven.any(), most, np.inf)))
    ends = EVENTS.b_end if q.at_border(foot, cells) else EVENTS.antipodal
    return Witness(
        element=jnp.asarray(-1, int),
        t=jnp.asarray(np.nan),
        point=jnp.asarray(p.center(place)),
        feet=jnp.asarray(np.repeat(q.center(foot)[None], 4, axis=0)),
        feet_elements=jnp.asarray([-1] * 4),
        feet_params=jnp.asarray([np.nan] * 4),
        multipliers=jnp.asarray([1.0, 0.0, 0.0, 0.0]),
        event=EVENTS.a_end if p.at_border(place, cells) else ends,
        direction=direction,
    )


def _value(lower: Array, upper: Array, result: Any) -> Array:
    return jnp.where(
        result == RESULTS.existence_not_certified, jnp.nan, jnp.clip(0.5 * lower + 0.5 * upper, lower, upper)
    )
