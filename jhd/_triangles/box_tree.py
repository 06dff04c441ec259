"""A tree of boxes over triangles as flat arrays, and a grid that names a near triangle for every point.

The triangles are sorted so that any 8^k consecutive ones, from a multiple of 8^k on, lie close together: ranges are
halved at the median of the longest side of their centers, at multiples of the next block. Node i of level k then covers
the eight nodes 8 i to 8 i + 7 of the level below, so no links are stored and no node but the last of a level has room
to spare.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

WIDTH = 8


class Level(NamedTuple):
    """Start and number of the nodes of a level in the array of all nodes."""

    start: int
    count: int


class BoxTree(NamedTuple):
    """Boxes of the children of every node."""

    order: Int[np.ndarray, " triangles"]  # the triangles as sorted
    # Lower and upper corners (6) of the eight children of each node; absent children lie at infinity.
    boxes: Float[np.ndarray, "nodes 6 8"]
    levels: tuple[Level, ...]  # the nodes whose children are triangles, then those above, up to a single root


def box_tree(corners: Float[np.ndarray, "triangles corners 3"]) -> BoxTree:
    """The tree over triangles, or over other parts by their control points; boxes are exact."""
    lower, upper = corners.min(axis=1), corners.max(axis=1)
    order = _sorted(0.5 * lower + 0.5 * upper)
    ends = np.concatenate([lower, upper], axis=1)[order]
    parts, levels, start = [], [], 0
    while True:
        count = -(-len(ends) // WIDTH)
        absent = np.concatenate([np.full((count * WIDTH - len(ends), 3), end) for end in (np.inf, -np.inf)], axis=1)
        children = np.concatenate([ends, absent]).reshape(count, WIDTH, 6)
        parts.append(children.transpose(0, 2, 1))
        levels.append(Level(start, count))
        start += count
        if count == 1:
            return BoxTree(order, np.concatenate(parts), tuple(levels))
        ends = np.concatenate([children[:, :, :3].min(axis=1), children[:, :, 3:].max(axis=1)], axis=1)


def _sorted(centers: Float[np.ndarray, "triangles 3"]) -> Int[np.ndarray, " triangles"]:
    """An order in which blocks of powers of eight are compact."""
    count = len(centers)
    order, starts = np.arange(count), np.array([0])
    block = WIDTH ** max(0, int(np.ceil(np.log(max(count, 2)) / np.log(WIDTH) - 1e-9)) - 1)
    while block >= WIDTH:
        sizes = np.diff(np.append(starts, count))
        blocks = -(-sizes // block)
        if np.all(blocks <= 1):
            block //= WIDTH
            continue
        order = _sorted_within(centers, order, starts, sizes)
        wide = blocks > 1
        middles = starts[wide] + block * (blocks[wide] // 2)
        starts = np.sort(np.concatenate([starts, middles]))
    return order


def _sorted_within(centers: np.ndarray, order: np.ndarray, starts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The order with every range sorted along the longest side of its centers."""
    rows = centers[order]
    lower, upper = np.minimum.reduceat(rows, starts), np.maximum.reduceat(rows, starts)
    axis = np.argmax(upper - lower, axis=1)
    index = np.arange(len(starts))
    low, side = lower[index, axis], (upper - lower)[index, axis]
    along = rows[np.arange(len(rows)), np.repeat(axis, sizes)] - np.repeat(low, sizes)
    # One float orders ranges and positions: positions fill half of the unit of a range.
    keys = np.repeat(index, sizes) + 0.5 * along / np.repeat(np.where(side > 0, side, 1.0), sizes)
    return order[np.argsort(keys, kind="stable")]


class Hints(NamedTuple):
    """A near triangle for the middle of every cell of a grid, not always the nearest."""

    lower: Float[np.ndarray, "3"]  # the corner of the grid
    side: float  # side of a cell
    triangle: Int[np.ndarray, "x y z"]  # the triangle for each cell

    def at(self, points: Float[np.ndarray, "points 3"]) -> Int[np.ndarray, " points"]:
        """The hint for each point; points outside get the hint of the border."""
        shape = np.array(self.triangle.shape)
        # If the mesh is tiny the quotients may overflow, to the border too.
        with np.errstate(over="ignore"):
            cells = np.clip((points - self.lower) / self.side, 0, shape - 1).astype(np.int64)
        return self.triangle[cells[:, 0], cells[:, 1], cells[:, 2]]


def hints(corners: Float[np.ndarray, "triangles 3 3"]) -> Hints:
    """The grid of a mesh: each cell gets the triangle of the nearest sample point, of which each cell keeps one."""
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    # Cells along the longest side of the grid of hints.
    cells = min(64, int(np.ceil(2 * len(corners) ** (1 / 3))) + 1)
    side = float(np.max(upper - lower)) / cells or 1.0
    samples, owners = _samples(corners, side)
    shape = np.maximum(1, np.ceil((upper - lower) / side - 1e-9).astype(int))
    places = np.minimum(((samples - lower) / side).astype(int), shape - 1)
    nearest = np.full(shape, -1)
    nearest[places[:, 0], places[:, 1], places[:, 2]] = np.arange(len(samples))
    middles = [(np.arange(n) + 0.5) * side for n in shape]
    for axis in range(3):
        nearest = _nearest_along(nearest, samples - lower, middles, axis)
    return Hints(lower, side, owners[nearest].astype(np.int32))


def _samples(corners: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of the triangles with a spacing of about one cell, and the triangle of each."""
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    # Sample points of a long triangle along an edge: hints far from all of them are only slow.
    parts = np.clip(np.ceil(edges / side), 1, 32).astype(int)
    points, owners = [], []
    for n in np.unique(parts):
        own = np.flatnonzero(parts == n)
        # Middles of the n^2 parts of a triangle, first the parts that point up, then the parts that point down.
        up = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
        down = [(3 * i + 2, 3 * j + 2) for i in range(n - 1) for j in range(n - 1 - i)]
        s, r = np.array(up + down).T / (3 * n)
        weights = np.stack([1 - s - r, s, r], axis=1)
        points.append((weights @ corners[own]).reshape(-1, 3))
        owners.append(np.repeat(own, len(weights)))
    return np.concatenate(points), np.concatenate(owners)


def _nearest_along(nearest: np.ndarray, samples: np.ndarray, middles: list[np.ndarray], axis: int) -> np.ndarray:
    """The nearest sample to each cell among the samples of cells in its row along the axis; -1 for none.

    Applied to one axis after the other, it gives the nearest of all samples that their cells kept.
    """
    nearest = np.ascontiguousarray(np.moveaxis(nearest, axis, 0))
    first, second = (middles[i] for i in range(3) if i != axis)
    # Number -1, no sample, is the last row, far away from everything.
    columns = np.concatenate([samples, np.full((1, 3), 1e9)])
    place = columns[:, axis][nearest]
    u, v = (columns[:, i][nearest] for i in range(3) if i != axis)
    across = (u - first[:, None]) ** 2 + (v - second) ** 2
    middle = middles[axis][:, None, None]
    best, index, count = across + (place - middle) ** 2, nearest.copy(), len(nearest)
    side = middles[axis][0] * 2
    for step in range(1, count):
        # A sample is at most half a cell away from the middle of its own.
        if ((step - 0.5) * side) ** 2 > best.max():
            break
        for to, of in ((slice(step, None), slice(0, -step)), (slice(0, -step), slice(step, None))):
            offer = across[of] + (place[of] - middle[to]) ** 2
            better = offer < best[to]
            np.copyto(best[to], offer, where=better)
            np.copyto(index[to], nearest[of], where=better)
    return np.moveaxis(index, 0, axis)
