"""An adaptively sampled distance field as values at points, and its zero set as a mesh.

For values, cells are found by integer arithmetic in units of the finest cells. The first grid gives a cell, and each
lower binary digit of the position selects one of its children. The values at the corners of the leaf are interpolated
trilinearly.

The mesh comes from marching cubes on a regular grid. Only blocks of the grid that meet leaves of both signs are
evaluated: everywhere else the field has one sign. The blocks are stored side by side in one volume, so time and memory
grow with the surface and not with the grid. Blocks repeat the samples between them. Their vertices are merged by the
grid edges on which they lie, and recomputed in full precision, as zeros of the field along these edges.

Source: marching cubes by Lewiner et al. (2003), as implemented in scikit-image.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jhd._arithmetic.scaling import length
from jhd._runtime.arrays import is_traced
from jhd._runtime.compiled import optimized
from jhd._runtime.memory import check_memory
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.closest_point import in_blocks

# Cells along the side of a block, and samples.
_SIDE = 8
_WIDE = _SIDE + 1
# Blocks along the side of the volume that marching cubes is given; single precision has 7e-6 of a cell there.
_TILES = 12


class LeafCells(NamedTuple):
    """The leaves of an octree and the way to them; see AdaptiveDistanceField for the fields."""

    lower: Float[Array, "3"]
    spacing: Float[Array, ""]
    roots: Int[Array, "x y z"]
    nodes: Int[Array, "nodes 8"]
    leaf_corners: Int[Array, "leaves 3"]
    widths: Int[Array, " leaves"]
    corners: Int[Array, "leaves 8"]
    values: Float[Array, " samples"]


def interpolated(values: Array, w: Array) -> Array:
    """Trilinear interpolation of values at the corners (..., 8) of a cell, at w in [0, 1]^3 (..., 3)."""
    for axis in range(3):
        half = values.shape[-1] // 2
        along = w[..., axis, None]
        values = values[..., :half] * (1 - along) + values[..., half:] * along
    return values[..., 0]


def value_at(cells: LeafCells, point: Float[Array, "3"], depth: int) -> Float[Array, ""]:
    """The field at one point; outside the box, the value at the nearest point of the box plus the distance to it."""
    count = np.array(cells.roots.shape) << depth
    upper = cells.lower + cells.spacing * count
    inside = jnp.where(point < cells.lower, cells.lower, jnp.where(point > upper, upper, point))
    u = (inside - cells.lower) / cells.spacing
    # Which cell holds the point has no derivative.
    cell = jnp.clip(jnp.floor(lax.stop_gradient(u)).astype(jnp.int32), 0, jnp.asarray(count - 1, jnp.int32))
    leaf = _leaf(cells, cell, depth)
    w = (u - cells.leaf_corners[leaf]) / cells.widths[leaf]
    offset = point - inside
    return interpolated(cells.values[cells.corners[leaf]], w) + length(offset)


def _leaf(cells: LeafCells, cell: Array, depth: int) -> Array:
    """The leaf that holds a finest cell."""
    root = cell >> depth
    node = cells.roots[root[0], root[1], root[2]]

    # The eight corners and parts are numbered 4 x + 2 y + z.
    def down(step: Any, node: Array) -> Array:
        part = jnp.sum(((cell >> (depth - 1 - step)) & 1) * np.array([4, 2, 1]))
        return jnp.where(node >= 0, cells.nodes[jnp.maximum(node, 0), part], node)

    if cells.nodes.shape[0]:
        node = lax.fori_loop(0, depth, down, node)
    return -1 - node


def values_at(cells: LeafCells, points: Float[Array, "points 3"], depth: int) -> Float[Array, " points"]:
    """The field at many points; if all numbers are known, in blocks of a few sizes."""
    if is_traced(cells, points):
        return _values(cells, points, depth)
    return jnp.asarray(in_blocks(lambda p: _values(cells, p, depth), np.asarray(points)))


def _values_of(cells: LeafCells, points: Array, depth: int) -> Array:
    return jax.vmap(lambda point: value_at(cells, point, depth))(points)


_values = optimized(_values_of, (2,))


class Leaves(NamedTuple):
    """Leaves, with corners and widths counted in finest cells, `count` of which fill the box along each axis."""

    leaf_corners: Int[np.ndarray, "leaves 3"]  # lower corners of the leaves
    widths: Int[np.ndarray, " leaves"]  # of the leaves
    least: Float[np.ndarray, " leaves"]  # the smallest value at the corners of each leaf
    most: Float[np.ndarray, " leaves"]  # the largest value at the corners of each leaf
    count: Int[np.ndarray, "3"]  # finest cells along each axis


class _Lattice(NamedTuple):
    """A regular grid over the box: sample i lies at lower + step i, i from 0 to cells."""

    lower: np.ndarray
    step: np.ndarray
    cells: np.ndarray
    field: Callable[[np.ndarray], np.ndarray]

    def values(self, nodes: np.ndarray) -> np.ndarray:
        """The field at samples (..., 3); samples beyond the last count as the last."""
        points = self.lower + self.step * np.minimum(nodes, self.cells)
        return self.field(points.reshape(-1, 3)).reshape(nodes.shape[:-1])

    def key(self, node: np.ndarray, kind: np.ndarray) -> np.ndarray:
        """One number for the edge from a sample along axis `kind`, or for the inside of its cell if that is 3."""
        x, y, z = np.moveaxis(node, -1, 0)
        return ((x * (self.cells[1] + 1) + y) * (self.cells[2] + 1) + z) * 4 + kind

    def node_of(self, key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The sample and the kind from which `key` was made."""
        rest, kind = np.divmod(key, 4)
        rest, z = np.divmod(rest, self.cells[2] + 1)
        return np.stack([*np.divmod(rest, self.cells[1] + 1), z], axis=-1), kind


class _ExtractedPart(NamedTuple):
    """Triangles of some blocks."""

    triangles: Int[np.ndarray, "triangles 3"]  # keys of their corners
    inner: Int[np.ndarray, " vertices"]  # keys of corners that are inside of cells
    places: Float[np.ndarray, "vertices 3"]  # coordinates of the inner corners, counted in cells


def extracted(
    leaves: Leaves,
    lower: Float[np.ndarray, "3"],
    upper: Float[np.ndarray, "3"],
    resolution: int,
    field: Callable[[np.ndarray], np.ndarray],
) -> TriangleMesh:
    """The mesh of the zero set.

    Args:
        leaves: leaves of the field.
        lower: the lower corner of the box.
        upper: the upper corner of the box.
        resolution: cells of the grid along the longest side of the box.
        field: values at points (points, 3).

    Raises:
        ImportError: scikit-image is not installed.
        ValueError: no cell of the grid has corners of both signs.
        MemoryError: the mesh would take more than the free memory.
    """
    sides = upper - lower
    cells = np.maximum(2, np.round(resolution * sides / np.max(sides))).astype(np.int64)
    lattice = _Lattice(lower, sides / cells, cells, field)
    met = _blocks(leaves, cells)
    work = f"a mesh of resolution {resolution} would take about"
    # Bytes for each block, as measured on forty thousand blocks.
    check_memory(8_000 * len(met), work, "a lower resolution takes less")
    parts = [_marched(lattice, blocks) for blocks in _batches(met)]
    found = [part for part in parts if part is not None]
    if not found:
        raise ValueError(f"no zero was found with a resolution of {resolution}; try a larger one.")
    keys, triangles = np.unique(np.concatenate([part.triangles for part in found]), return_inverse=True)
    inner = np.concatenate([part.inner for part in found])
    places = np.concatenate([part.places for part in found])[np.argsort(inner)]
    node, kind = lattice.node_of(keys)
    vertices = np.empty((len(keys), 3))
    vertices[kind < 3] = _on_edges(lattice, node[kind < 3], kind[kind < 3])
    vertices[kind == 3] = lower + lattice.step * places
    return TriangleMesh(vertices, triangles.reshape(-1, 3))


def _blocks(leaves: Leaves, cells: np.ndarray) -> Int[np.ndarray, "blocks 3"]:
    """The blocks that touch leaves of both signs."""
    shape = -(-cells // _SIDE)
    marks = np.zeros((2, *shape), bool)
    # Ends are moved by one, since samples are rounded.
    below, above = leaves.leaf_corners * cells - 1, (leaves.leaf_corners + leaves.widths[:, None]) * cells + 1
    first = np.maximum(-(-below // (_SIDE * leaves.count)) - 1, 0)
    last = np.minimum(above // (_SIDE * leaves.count), shape - 1)
    for mark, which in zip(marks, (leaves.most >= 0, leaves.least <= 0), strict=True):
        for blocks in _spanned(first[which], last[which] - first[which] + 1):
            mark[tuple(blocks.T)] = True
    return np.argwhere(marks[0] & marks[1])


def _spanned(first: np.ndarray, spans: np.ndarray) -> Iterator[np.ndarray]:
    """The blocks in boxes of blocks, in batches of boxes."""
    counts = np.prod(spans, axis=1)
    # Pairs of a leaf and a block in one batch.
    batch = np.cumsum(counts) // (1 << 20)
    for rows in np.split(np.arange(len(counts)), np.flatnonzero(np.diff(batch)) + 1):
        count, span = counts[rows], spans[rows]
        owner = np.repeat(np.arange(len(rows)), count)
        left = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        left, z = np.divmod(left, span[owner, 2])
        yield first[rows][owner] + np.stack([*np.divmod(left, span[owner, 1]), z], axis=1)


def _batches(blocks: np.ndarray) -> Iterator[np.ndarray]:
    step = _TILES**3
    for start in range(0, len(blocks), step):
        yield blocks[start : start + step]


def _marched(lattice: _Lattice, blocks: np.ndarray) -> _ExtractedPart | None:
    """The triangles of up to _TILES^3 blocks, or None."""
    try:
        from skimage.measure import marching_cubes
    except ImportError as error:
        raise ImportError("to_mesh needs scikit-image: pip install jhd[mesh].") from error
    nodes = _SIDE * blocks[:, None] + np.indices((_WIDE,) * 3).reshape(3, -1).T
    values = _off_zero(lattice.values(nodes), float(np.max(lattice.step)))
    # marching_cubes omits a cell if the mask is false at its last corner.
    whole = np.all((nodes > _SIDE * blocks[:, None]) & (nodes <= lattice.cells), axis=2)
    if not np.any(values < 0) or not np.any(values > 0):
        return None
    try:
        found = marching_cubes(_tiled(values, 1.0), 0.0, gradient_direction="descent", mask=_tiled(whole, False))
    except RuntimeError:  # the signs are of different blocks
        return None
    tile, local = np.divmod(found[0].astype(np.float64), _WIDE)
    tile = tile.astype(np.int64)
    block = blocks[(tile[:, 0] * _TILES + tile[:, 1]) * _TILES + tile[:, 2]]
    off = np.abs(local - np.round(local)) > 2e-4
    inside = np.count_nonzero(off, axis=1) > 1
    node = _SIDE * block + np.where(off, np.floor(local), np.round(local)).astype(np.int64)
    key = lattice.key(node, np.where(inside, 3, np.argmax(off, axis=1)))
    return _ExtractedPart(key[found[1]], key[inside], (_SIDE * block + local)[inside])


def _off_zero(values: np.ndarray, step: float) -> np.ndarray:
    """The values with their signs, their sizes between bounds that keep zeros off the samples.

    So marching cubes gives vertices off the samples, and each is recognized to lie on an edge, and on which edge.
    """
    return np.where(values < 0, -1.0, 1.0) * np.clip(np.abs(values), 2e-3 * step, 2 * step)


def _tiled(rows: np.ndarray, rest: Any) -> np.ndarray:
    """The samples of blocks (blocks, samples), side by side in one volume."""
    volume = np.full((_TILES**3, rows.shape[1]), rest, rows.dtype)
    volume[: len(rows)] = rows
    side = _TILES * _WIDE
    return volume.reshape((_TILES,) * 3 + (_WIDE,) * 3).transpose(0, 3, 1, 4, 2, 5).reshape(side, side, side)


def _on_edges(lattice: _Lattice, node: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Zeros of the field on edges of the grid: the linear guess, then the Illinois form of regula falsi."""
    start = lattice.lower + lattice.step * node
    along = np.zeros(start.shape)
    along[np.arange(len(axis)), axis] = lattice.step[axis]
    ends, at = (np.zeros(len(node)), np.ones(len(node))), (lattice.field(start), lattice.field(start + along))
    (low, high), (first, second) = ends, at
    sign = np.where(first < 0, -1.0, 1.0)
    # The zero stays within the bracket, whatever the rounding of values near zero.
    first, second = np.maximum(sign * first, 0.0), np.minimum(sign * second, 0.0)
    # Steps of the search for the zero on an edge after the linear guess, each with one value of the field.
    for _ in range(2):
        middle = _between(low, high, first, second)
        value = sign * lattice.field(start + middle[:, None] * along)
        before = value >= 0
        low, first, second = (
            np.where(before, middle, low),
            np.where(before, value, first / 2),
            np.where(before, second / 2, value),
        )
        high = np.where(before, high, middle)
    return start + _between(low, high, first, second)[:, None] * along


def _between(low: np.ndarray, high: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The zero of the line through values first >= 0 and second <= 0; the middle if both are zero."""
    size = first - second
    share = np.where(size > 0, first / np.where(size > 0, size, 1.0), 0.5)
    return low + share * (high - low)
