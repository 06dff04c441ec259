"""Construction of an adaptively sampled distance field: an octree over a mesh, refined level by level.

At 19 points of a cell (the midpoints of its edges and faces, and its center) the distance is compared with the
trilinear interpolation of the corner values. A cell is split if one of them is off by more than the tolerance. Points
have integer names, so points common to several cells are computed once: a point of one level is no point of a coarser
level, and the points of a cell that is split are the corners of its children. In the band, cells that are proven to
miss the surface are neither compared nor split.

All coordinates are multiples of powers of two that fit into a float, so the position of every sample is exact.

Source: "3-D signed Euclidean distance transform and its applications" (Lin03, 2003), algorithm 1, for the test of a
cell; Frisken et al., Adaptively sampled distance fields (2000). The order by levels and the band are ours.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jhd._arithmetic.rounding import gamma
from jhd._fields.adaptive_samples import CellNeighbors, Samples, Surface, decide, lift, spread, unsigned
from jhd._fields.boxes import CORNERS, children
from jhd._runtime.arrays import joined
from jhd._shapes.mesh import TriangleMesh
from jhd.progress import Callback, Progress

MODES = ("band", "full")
# Halvings for which positions in the grid have room: three positions fit into 63 bits.
DEEPEST, _BITS = 15, 21

# The 27 points of a cell in half sides, x slowest; numbers of the corners, of the compared points, and of the middle.
_POINTS = np.array(list(np.ndindex(3, 3, 3)))
_CORNER = np.flatnonzero(np.all(_POINTS != 1, axis=1))
_TESTED = np.flatnonzero(np.any(_POINTS == 1, axis=1))
_MIDDLE = int(np.flatnonzero(np.all(_POINTS == 1, axis=1))[0])
# Weights of the corners at the compared points, and the numbers among the 27 of each corner of each child.
_WEIGHTS = np.prod(np.where(CORNERS[None], _POINTS[_TESTED, None] / 2, 1 - _POINTS[_TESTED, None] / 2), axis=2)
_CHILD = np.array([[int((child + corner) @ [9, 3, 1]) for corner in CORNERS] for child in CORNERS])
# Distances between the 27 points in half sides.
_APART = np.linalg.norm(_POINTS[:, None] - _POINTS[None], axis=2)


class Grid(NamedTuple):
    """The cells of the first level: cubes whose side is a power of two, at multiples of it."""

    start: Int[np.ndarray, "3"]  # the lower corner, in sides
    shape: tuple[int, ...]  # number of cells along each axis
    side: float  # of a cell
    deepest: int  # halvings after which corners and middles are still floats
    origin: Float[np.ndarray, "3"] = np.zeros(3)  # the point from which positions are counted

    @property
    def lower(self) -> Float[np.ndarray, "3"]:
        """The lower corner of the first cell."""
        return self.origin + self.start * self.side

    def scaled(self, power: int) -> "Grid":
        """The grid with lengths multiplied by 2^power."""
        return self._replace(side=float(np.ldexp(self.side, power)), origin=np.ldexp(self.origin, power))

    def points(self, places: np.ndarray, level: int, dtype: Any) -> np.ndarray:
        """Coordinates of positions counted in half sides of cells of a level; exact if the origin is zero."""
        half = np.ldexp(self.side, -level - 1)
        return (self.origin + (places + (self.start.astype(np.int64) << (level + 1))) * half).astype(dtype)


class Octree(NamedTuple):
    """A constructed octree; widths and positions are counted in the finest cells."""

    depth: int  # halvings of the finest cells
    values: Float[np.ndarray, " samples"]  # signed distances at the samples that are corners of leaves
    corners: Int[np.ndarray, "leaves 8"]  # the samples of each leaf, in the order of CORNERS
    leaf_corners: Int[np.ndarray, "leaves 3"]  # lower corners of the leaves
    widths: Int[np.ndarray, " leaves"]  # of the leaves
    # The children of each split cell: the number of a split cell, or -1 - the number of a leaf.
    nodes: Int[np.ndarray, "nodes 8"]
    roots: Int[np.ndarray, "x y z"]  # these numbers for the cells of the first level
    unresolved: int  # leaves off by more than the tolerance, due to max_depth or max_cells


class _OctreeLevel(NamedTuple):
    """Cells of one level, the samples at their corners, and a mask of the split cells."""

    cells: np.ndarray
    corners: np.ndarray
    split: np.ndarray


class Task(NamedTuple):
    """The arguments of AdaptiveDistanceField.build, all in the unit of the surface."""

    surface: Surface
    grid: Grid
    tolerance: float
    mode: str
    max_depth: int
    max_cells: int
    progress: Callback | None


def may_meet(distance: Float[np.ndarray, "cells 8"], side: float) -> Bool[np.ndarray, " cells"]:
    """Mask of the cells not proven to miss the surface by lower bounds of the distances at their corners.

    A point of the surface in a cell is at least as far from every corner as the corner is from the surface. The squares
    of its distances from two opposite corners have a sum of at most 3 side^2, and the nearest corner is not farther
    than half the diagonal.
    """
    unit = distance / (side * (1 + gamma(32, distance.dtype)))
    pairs = unit * unit
    opposite = np.max(pairs[:, :4] + pairs[:, :3:-1], axis=1)
    return (opposite <= 3) & (np.min(pairs, axis=1) <= 0.75)


def build_octree(task: Task) -> Octree:
    """The octree of a mesh whose numbers are known."""
    grid = task.grid
    samples, level = _begin(task, grid)
    levels: list[_OctreeLevel] = []
    unresolved, cells = 0, len(level.cells)
    last = min(task.max_depth, grid.deepest)
    for depth in range(last + 1):
        samples, level, index = _compared(task, grid, samples, level, depth)
        room = depth < last and cells + 8 * int(level.split.sum()) <= task.max_cells
        if not room:
            unresolved = int(level.split.sum())
            level = level._replace(split=np.zeros(len(level.cells), bool))
        levels.append(level)
        split = level.split
        if task.progress is not None:
            details = {"tested": len(index), "split": int(split.sum()), "samples": len(samples.distance)}
            task.progress(Progress("levels", depth, last, details=details))
        if not split.any():
            break
        level = _OctreeLevel(children(level.cells[split]), index[:, _CHILD].reshape(-1, 8), np.zeros(0, bool))
        cells += len(level.cells)
    return _assembled(grid, levels, samples, unresolved)


def first_grid(mesh: TriangleMesh, tolerance: float) -> Grid:
    """The first level for a mesh: a box with a margin, so that its sides are outside of a closed mesh.

    Raises:
        ValueError: a box that leaves the range of floats.
    """
    lower, upper = (np.asarray(end, np.float64) for end in mesh.bounds)
    info = np.finfo(np.asarray(mesh.vertices).dtype)
    size, reach = float(np.max(upper - lower)), float(np.max(np.abs([lower, upper])))
    # The box of a mesh that is a single point can still be divided in floats.
    # Least margin in units in the last place of the largest coordinate.
    least = 64 * max(reach * float(info.eps), float(info.smallest_normal) / float(info.eps))
    # The margin between the mesh and the sides of the box: this fraction of its size, and this many tolerances.
    margin = max(size / 16, 2 * tolerance, least)
    if not reach + 2 * (size + 2 * margin) < float(info.max):
        raise ValueError(
            f"the box of the field has coordinates of {reach:g} and a margin; needs less than {info.max:g}."
        )
    # Cells along the longest side of the first grid: more than half as many, and at most this many.
    side = float(2.0 ** np.ceil(np.log2((size + 2 * margin) / 16)))
    start, end = np.floor((lower - margin) / side), np.ceil((upper + margin) / side)
    room = (1 << info.nmant) / np.max(np.abs([start, end]))
    deepest = int(np.clip(np.floor(np.log2(room)) - 1, 0, DEEPEST))
    return Grid(start.astype(np.int64), tuple(int(n) for n in end - start), side, deepest)


def bounding_cube(mesh: TriangleMesh) -> Grid:
    """The published first level: the one cube about the box of a mesh, from its lower corner."""
    lower, upper = (np.asarray(end, np.float64) for end in mesh.bounds)
    side, reach = float(np.max(upper - lower)) or 1.0, float(np.max(np.abs([lower, upper])))
    room = side / (max(reach, side) * float(np.finfo(np.asarray(mesh.vertices).dtype).eps))
    deepest = int(np.clip(np.floor(np.log2(room)) - 2, 0, DEEPEST))
    return Grid(np.zeros(3, np.int64), (1, 1, 1), side, deepest, lower)


def _begin(task: Task, grid: Grid) -> tuple[Samples, _OctreeLevel]:
    """The samples and cells of the first grid."""
    shape = tuple(n + 1 for n in grid.shape)
    corners = np.indices(shape).reshape(3, -1).T
    points = grid.points(2 * corners, 0, task.surface.dtype)
    samples = unsigned(task.surface, points)
    decide(task.surface, samples, np.arange(len(points)), points)
    cells = np.indices(grid.shape).reshape(3, -1).T
    x, y, z = np.moveaxis(cells[:, None] + CORNERS, -1, 0)
    numbers = ((x * shape[1] + y) * shape[2] + z).astype(np.int32)
    return samples, _OctreeLevel(cells, numbers, np.zeros(0, bool))


def _compared(
    task: Task, grid: Grid, samples: Samples, level: _OctreeLevel, depth: int
) -> tuple[Samples, _OctreeLevel, Int[np.ndarray, "cells 27"]]:
    """The samples, the level with its cells to be split marked, and the 27 samples of each marked cell."""
    side = float(np.ldexp(grid.side, -depth))
    band, which = task.mode == "band", np.arange(len(level.cells))
    if band:
        which = which[may_meet(samples.clearance[level.corners], side)]
    index = np.zeros((len(which), len(_POINTS)), np.int32)
    index[:, _CORNER] = level.corners[which]
    batch = _Batch(task, grid, depth, side)
    first = len(samples.distance)
    if band and len(which):
        samples, places = batch.sampled(samples, level.cells[which], index, np.array([_MIDDLE]))
        near = samples.clearance[index[:, _MIDDLE]] <= side * np.sqrt(0.75) * (1 + gamma(8, samples.clearance.dtype))
        which, index = which[near], index[near]
    else:
        places = np.zeros((0, 3), np.int64)
    split = np.zeros(len(level.cells), bool)
    if not len(which):
        return samples, level._replace(split=split), index
    rest = _TESTED[_TESTED != _MIDDLE] if band else _TESTED
    samples, others = batch.sampled(samples, level.cells[which], index, rest)
    _take_sides(batch, samples, level.cells[which], index, np.concatenate([places, others]), first)
    signed = samples.signed
    off = np.abs(signed[index[:, _CORNER]] @ _WEIGHTS.T - signed[index[:, _TESTED]])
    worse = np.any(off > task.tolerance, axis=1)
    split[which] = worse
    return samples, level._replace(split=split), index[worse]


class _Batch(NamedTuple):
    """The samples of one level."""

    task: Task
    grid: Grid
    depth: int
    side: float

    def points(self, places: np.ndarray) -> np.ndarray:
        """Coordinates of positions in half sides."""
        return self.grid.points(places, self.depth, self.task.surface.dtype)

    def sampled(
        self, samples: Samples, cells: np.ndarray, index: np.ndarray, which: np.ndarray
    ) -> tuple[Samples, np.ndarray]:
        """Add samples at points `which` of the 27 of each cell, with numbers in `index`; also new positions."""
        places = 2 * cells[:, None].astype(np.int64) + _POINTS[which]
        keys = (places[..., 0] << 2 * _BITS) | (places[..., 1] << _BITS) | places[..., 2]
        _, first, number = np.unique(keys.ravel(), return_index=True, return_inverse=True)
        index[:, which] = len(samples.distance) + number.reshape(keys.shape)
        new = places.reshape(-1, 3)[first]
        owner, point = np.divmod(first, len(which))
        corners = index[owner][:, _CORNER]
        apart = _APART[which[point]][:, _CORNER] * (0.5 * self.side)
        # The triangle of the corner with the smallest sum of its distance and the distance to the point.
        best = np.argmin(samples.distance[corners] + apart, axis=1)
        near = samples.triangle[corners[np.arange(len(corners)), best]]
        found = unsigned(self.task.surface, self.points(new), near)
        base = len(samples.distance)
        samples = joined([samples, found])
        if self.task.surface.linked and self.task.surface.sign == "winding":
            spread(samples, base + np.arange(len(new)), corners, apart)
        return samples, new


def _take_sides(
    batch: _Batch, samples: Samples, cells: np.ndarray, index: np.ndarray, places: np.ndarray, first: int
) -> None:
    """Determine the sides of all samples of the cells; samples from number `first` on are new, at `places`."""
    surface = batch.task.surface
    if surface.linked:
        cell, point = _open(samples, index)
        # Rounds in which points pass their sides to others of their cells; remaining points get their own winding
        # numbers.
        for _ in range(4):
            spread(samples, index[cell, point], index[cell], _APART[point] * (0.5 * batch.side))
            before, (cell, point) = len(cell), _open(samples, index)
            if len(cell) in (0, before):
                break
        who, one = np.unique(index[cell, point], return_index=True)
        others = batch.points(2 * cells[cell[one], None] + _POINTS)
        lift(surface, samples, who, batch.points(places[who - first]), CellNeighbors(index[cell[one]], others))
    left = np.unique(index[_open(samples, index)])
    decide(surface, samples, left, batch.points(places[left - first]))


def _open(samples: Samples, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cell and point indices of the samples whose side is not known."""
    cell, point = np.nonzero(samples.side[index] == 0)
    return cell, point


def _assembled(grid: Grid, levels: list[_OctreeLevel], samples: Samples, unresolved: int) -> Octree:
    """The octree of all levels, with only the samples that leaves use."""
    depth, leaves, nodes = len(levels) - 1, 0, 0
    codes, leaf_corners, corners, widths = [], [], [], []
    for k, level in enumerate(levels):
        leaf = ~level.split
        code = np.empty(len(level.cells), np.int32)
        code[leaf] = -1 - (leaves + np.arange(leaf.sum()))
        code[level.split] = nodes + np.arange(level.split.sum())
        codes.append(code)
        leaf_corners.append(level.cells[leaf].astype(np.int32) << (depth - k))
        corners.append(level.corners[leaf])
        widths.append(np.full(leaf.sum(), 1 << (depth - k), np.int32))
        leaves, nodes = leaves + int(leaf.sum()), nodes + int(level.split.sum())
    used, number = np.unique(np.concatenate(corners), return_inverse=True)
    below = np.concatenate([np.zeros(0, np.int32), *codes[1:]]).reshape(-1, 8)
    return Octree(
        depth=depth,
        values=samples.signed[used],
        corners=number.reshape(-1, 8).astype(np.int32),
        leaf_corners=np.concatenate(leaf_corners),
        widths=np.concatenate(widths),
        nodes=below,
        roots=codes[0].reshape(grid.shape),
        unresolved=unresolved,
    )
