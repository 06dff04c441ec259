"""Values of an adaptively sampled distance field: the kernel for one point, and its batches.

Cells are found by integer arithmetic in units of the finest cells. The first grid gives a cell, and each lower binary
digit of the position selects one of its children. The values at the corners of the leaf are interpolated trilinearly.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jhd._arithmetic.scaling import length
from jhd._runtime.arrays import is_traced
from jhd._runtime.compiled import optimized
from jhd._triangles.closest_point import in_blocks

# The eight corners and parts are numbered 4 x + 2 y + z.
_PLACES = np.array([4, 2, 1])


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

    def down(step: Any, node: Array) -> Array:
        part = jnp.sum(((cell >> (depth - 1 - step)) & 1) * _PLACES)
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
