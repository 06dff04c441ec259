"""The nearest point of a mesh for many points at once: exact, with proven bounds, in bounded memory.

A point keeps the least squared distance found so far, at first the distance to a near triangle named by a grid. Pairs
of a point and a node wait on a stack. A compiled function expands a block of them at a time: it compares the boxes of
the eight children with these distances, and the host gathers the remaining pairs. The deepest pairs go first, so the
stack is short whatever the points are, and their results shorten the rest. Pairs come in blocks of a few sizes, so few
functions are compiled.

A node is left out if its box is farther away than a distance found, by more than the error of both. So the distances
of its triangles are not below the computed distance. The distances of the other triangles are known up to
`error_factor` (see jhd._triangles.point_triangle), which gives the lower bound; the upper bound is the distance to the
triangle found.

Source: the problem is posed in "3-D signed Euclidean distance transform and its applications" (Lin03, 2003), whose
search around the nearest vertex can miss the nearest triangle; the search is ours.
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jhd._arithmetic.rounding import gamma, smallest_normal, unit_roundoff
from jhd._runtime.arrays import array_of
from jhd._runtime.compiled import compiled
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.prepared import prepared
from jhd._triangles.box_tree import BoxTree, Hints, Level, box_tree, hints
from jhd._triangles.point_triangle import LENGTHS, absolute_floor, barycentric, error_factor, frames, squared_distances
from jhd._triangles.unit import in_unit

# Numbers of pairs, and of points, for which functions are compiled.
BLOCKS = (512, 4096, 32768)


class TriangleTree(NamedTuple):
    """A mesh prepared for searches, with coordinates divided by 2^exponent, so that they are at most one."""

    # The sorted triangles in their frames, repeated up to a length for which functions are compiled.
    table: Float[Array, "padded columns"]
    turn: Int[np.ndarray, " triangles"]  # the first corner of each frame
    boxes: Float[Array, "nodes 6 8"]  # as in BoxTree, padded in length like the table
    levels: tuple[Level, ...]  # as in BoxTree
    order: Int[np.ndarray, " triangles"]  # the number in the mesh of each sorted triangle
    hints: Hints  # a near sorted triangle for each point
    exponent: int  # the power of two
    longest: float  # the longest edge
    factor: float  # error_factor of the table

    def error(self, distance: Any) -> Any:
        """Bound on the error of computed distances, in the tree's unit, rounded up."""
        distance = np.asarray(distance, np.float64)
        bound = self.factor * (distance + 2 * self.longest) + absolute_floor(self.table.dtype)
        return bound * (1 + 8 * unit_roundoff(np.float64))


class Nearest(NamedTuple):
    """The nearest triangle of each point, in the unit of a tree."""

    square: Float[np.ndarray, " points"]  # computed squared distances
    triangle: Int[np.ndarray, " points"]  # numbers in the sorted order


class ClosestPoints(NamedTuple):
    """The nearest points of a mesh, in the unit of the coordinates."""

    distance: Float[np.ndarray, " points"]  # computed distances
    lower: Float[np.ndarray, " points"]  # proven lower bounds of the distances to the whole mesh
    upper: Float[np.ndarray, " points"]  # proven upper bounds
    foot: Float[np.ndarray, "points 3"]  # the nearest points
    triangle: Int[np.ndarray, " points"]  # the triangles that hold them
    # Barycentric coordinates of the nearest points in these triangles; exactly 0 off a face.
    t: Float[np.ndarray, "points 3"]


class AbstractMeshSearch(eqx.Module):
    """Search for the nearest points of a mesh other than the exact one; its fields are options."""

    @abstractmethod
    def _search(self, points: np.ndarray, mesh: TriangleMesh) -> ClosestPoints:
        """The points found for queries (points, 3), all numbers known."""


def triangle_tree(mesh: TriangleMesh) -> TriangleTree:
    """The tree of a mesh whose numbers are known."""
    return prepared(mesh)._part(_tree)


def _tree(mesh: TriangleMesh) -> TriangleTree:
    unit, power = in_unit(mesh)
    return _built(mesh) if power == 0 else triangle_tree(unit)._replace(exponent=power)


def _built(mesh: TriangleMesh) -> TriangleTree:
    """The tree of a mesh returned by `in_unit`."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    dtype = corners.dtype
    tree: BoxTree = box_tree(corners)
    corners = corners[tree.order]
    stored = frames(corners.astype(np.float64), dtype)
    return TriangleTree(
        table=array_of(_padded(stored.table, _length(len(stored.table)))),
        turn=stored.turn,
        boxes=array_of(_padded(tree.boxes.astype(dtype), _length(len(tree.boxes)))),
        levels=tree.levels,
        order=tree.order,
        hints=hints(corners.astype(np.float64)),
        exponent=0,
        longest=float(stored.longest),
        factor=float(error_factor(stored.defect, dtype)),
    )


def _length(count: int) -> int:
    """The next power of two, at least 16: lengths of tables for which functions are compiled."""
    return max(16, 1 << (count - 1).bit_length())


def point_tree(points: Float[np.ndarray, "points 3"]) -> TriangleTree:
    """The tree of a set of points, treated as triangles: its table has only their coordinates.

    A squared distance then errs by five roundings, and the root by one more; no length but the distance counts.
    """
    # The origin alone has no size; queries near it may have the smallest.
    exponent = int(np.frexp(max(np.max(np.abs(points)), np.finfo(points.dtype).smallest_subnormal))[1])
    points = np.ldexp(points, -exponent)
    corners = np.broadcast_to(points[:, None], (len(points), 3, 3))
    tree = box_tree(corners)
    points = points[tree.order]
    return TriangleTree(
        table=array_of(_padded(points, _length(len(points)))),
        turn=np.zeros(len(points), int),
        boxes=array_of(_padded(tree.boxes, _length(len(tree.boxes)))),
        levels=tree.levels,
        order=tree.order,
        hints=hints(np.repeat(points[:, None], 3, axis=1).astype(np.float64)),
        exponent=exponent,
        longest=0.0,
        factor=gamma(8, points.dtype),
    )


def _padded(rows: np.ndarray, length: int) -> np.ndarray:
    return rows[np.minimum(np.arange(length), len(rows) - 1)]


def closest_points(mesh: TriangleMesh, points: Float[np.ndarray, "points 3"]) -> ClosestPoints:
    """The nearest points of a mesh, for finite points of the mesh's precision; all numbers known.

    Args:
        mesh: the mesh; its tree is built, or found again.
        points: in the unit of the mesh.
    """
    tree = triangle_tree(mesh)
    far = _excess(tree, np.max(np.abs(points), axis=1)) > 0
    if far.any() and not far.all():
        # By themselves, lest the others lose the digits of the mesh.
        return _joined(far, closest_points(mesh, points[far]), closest_points(mesh, points[~far]))
    tree, scaled = in_unit_of(tree, points)
    found = nearest_triangles(tree, scaled)
    t = barycentric_of(tree, scaled, found.triangle)
    distance = np.sqrt(found.square)
    error, dtype = tree.error(distance), points.dtype
    triangle = tree.order[found.triangle]
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)[triangle]]
    foot = np.einsum("nk,nkd->nd", t, np.ldexp(corners, -tree.exponent))
    return ClosestPoints(
        distance=in_unit_again(distance, tree.exponent),
        lower=outward(distance.astype(np.float64) - error, tree.exponent, dtype, -1),
        upper=outward(distance.astype(np.float64) + error, tree.exponent, dtype, 1),
        foot=np.ldexp(foot, tree.exponent),
        triangle=triangle,
        t=t,
    )


def _joined(which: np.ndarray, first: ClosestPoints, second: ClosestPoints) -> ClosestPoints:
    """The rows of both parts in one: of the first if `which` is true, else of the second."""
    rows = np.empty(len(which), int)
    rows[which], rows[~which] = np.arange(which.sum()), which.sum() + np.arange((~which).sum())
    return ClosestPoints(*(np.concatenate(pair)[rows] for pair in zip(first, second, strict=True)))


def _excess(tree: TriangleTree, size: Any) -> Any:
    """The powers of two by which coordinates of such sizes are too large for the tree's unit, if positive."""
    far = 400 if size.dtype.itemsize == 8 else 40
    return np.where(size > 0, np.frexp(size)[1] - tree.exponent, 0) - far


def in_unit_of(tree: TriangleTree, points: np.ndarray) -> tuple[TriangleTree, np.ndarray]:
    """The points in the tree's unit, and the tree itself unless they are so far away that squares would overflow."""
    excess = int(_excess(tree, np.max(np.abs(points))))
    if excess > 0:
        tree = _shrunk(tree, excess)
    return tree, np.ldexp(points, -tree.exponent)


def _shrunk(tree: TriangleTree, power: int) -> TriangleTree:
    """The tree in a unit larger by 2^power; lengths that underflow are below `absolute_floor`."""
    table = np.array(tree.table)
    # A table of points has three columns.
    lengths = [k for k in LENGTHS if k < table.shape[1]]
    table[:, lengths] = np.ldexp(table[:, lengths], -power)
    boxes = np.asarray(tree.boxes)
    boxes = np.where(np.isfinite(boxes), np.ldexp(boxes, -power), boxes)
    grid = Hints(
        np.ldexp(tree.hints.lower, -power), float(np.ldexp(tree.hints.side, -power)) or 1.0, tree.hints.triangle
    )
    return tree._replace(
        table=array_of(table),
        boxes=array_of(boxes),
        hints=grid,
        exponent=tree.exponent + power,
        longest=float(np.ldexp(tree.longest, -power)),
    )


def in_unit_again(length: np.ndarray, exponent: int) -> np.ndarray:
    """Lengths in the user's unit; infinite if they exceed all floats."""
    with np.errstate(over="ignore"):
        return np.ldexp(length, exponent)


def outward(length: np.ndarray, exponent: int, dtype: Any, sign: int) -> np.ndarray:
    """Convert bounds in double precision to the user's unit and precision, rounded to `sign`; zero if not positive."""
    with np.errstate(over="ignore", under="ignore"):
        scaled = np.nextafter(np.ldexp(length, exponent).astype(dtype), dtype.type(sign * np.inf))
    most = np.finfo(dtype).max if sign < 0 else np.inf
    # NaN stays NaN: it bounds nothing.
    return np.where(np.asarray(length) <= 0, 0.0, np.clip(scaled, 0.0, most)).astype(dtype)


def nearest_triangles(
    tree: TriangleTree,
    points: Float[np.ndarray, "points 3"],
    near: Int[np.ndarray, " points"] | None = None,
) -> Nearest:
    """The nearest triangles of points in the unit of the tree.

    Args:
        tree: the tree.
        points: as returned by `in_unit_of`.
        near: a near triangle for each point, in the sorted order; by default the hints.
    """
    order = np.argsort(curve_places(tree, points), kind="stable")
    square, triangle = np.empty(len(points), points.dtype), np.empty(len(points), np.int32)
    for start in range(0, len(points), BLOCKS[-1]):
        rows = order[start : start + BLOCKS[-1]]
        part = points[rows]
        guess = tree.hints.at(part) if near is None else near[rows]
        guess = guess.astype(np.int32)
        square[rows], triangle[rows] = _searched(tree, part, pair_squares(tree.table, part, guess), guess)
    return Nearest(square, triangle)


def _searched(tree: TriangleTree, points: np.ndarray, square: np.ndarray, triangle: np.ndarray) -> Nearest:
    """Run the search from distances to known triangles."""
    # A box errs by five roundings of its square, a triangle by its own roundings; see the module's docstring.
    room = 1 + gamma(64, points.dtype)
    tiny = 64 * smallest_normal(points.dtype)
    square, triangle = square.copy(), triangle.copy()
    bound = square * room + tiny
    everyone = np.arange(len(points), dtype=np.int32)
    stack = [(len(tree.levels) - 1, everyone, np.zeros(len(points), np.int32))]
    while stack:
        level, who, node = popped(stack)
        if level < 0:
            _improve(tree, points, who, node, square, triangle)
            bound[who] = square[who] * room + tiny
            continue
        left = np.flatnonzero(_in_reach(tree, points[who], bound[who], node + tree.levels[level].start))
        if len(left):
            pair = left >> 3
            stack.append((level - 1, who[pair], node[pair] * 8 + (left & 7).astype(np.int32)))
    return Nearest(square, triangle)


def triangles_within(
    tree: TriangleTree, points: Float[np.ndarray, "points 3"], bound: Float[np.ndarray, " points"], most: int
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Pairs of a point and a sorted triangle whose box is within the point's bound, in the unit of the tree.

    Points with more than `most` triangles, or nodes of a level, have none.
    """
    room = 1 + gamma(64, points.dtype)
    square = (bound * room) ** 2 * room + 64 * smallest_normal(points.dtype)
    who, node = np.arange(len(points), dtype=np.int32), np.zeros(len(points), np.int32)
    for level in reversed(tree.levels):
        left = np.flatnonzero(_in_reach(tree, points[who], square[who], node + level.start))
        who, node = who[left >> 3], node[left >> 3] * 8 + (left & 7).astype(np.int32)
        few = np.bincount(who, minlength=len(points))[who] <= most
        who, node = who[few], node[few]
        if len(who) == 0:
            break
    return who, node


def popped(stack: list[tuple[int, np.ndarray, np.ndarray]]) -> tuple[int, np.ndarray, np.ndarray]:
    """Remove and return the last pairs of points and nodes, with their level: at most a block; the others stay."""
    level, who, node = stack.pop()
    if len(who) > BLOCKS[-1]:
        stack.append((level, who[BLOCKS[-1] :], node[BLOCKS[-1] :]))
    return level, who[: BLOCKS[-1]], node[: BLOCKS[-1]]


def _improve(
    tree: TriangleTree, points: np.ndarray, who: np.ndarray, node: np.ndarray, square: np.ndarray, triangle: np.ndarray
) -> None:
    """Update distances and triangles in place by pairs of points and triangles, grouped by point, that are nearer."""
    found = pair_squares(tree.table, points[who], node)
    starts = np.flatnonzero(np.concatenate([[True], who[1:] != who[:-1]]))
    least = np.minimum.reduceat(found, starts)
    best = np.flatnonzero(found == np.repeat(least, np.diff(np.append(starts, len(who)))))
    first = best[np.searchsorted(best, starts)]
    better = least < square[who[starts]]
    owner = who[starts[better]]
    square[owner], triangle[owner] = least[better], node[first[better]]


def pair_squares(table: Array, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Squared distances of points to triangles, one sorted triangle for each."""
    return in_blocks(lambda p, i: _squares(table, p, i), points, rows)


def in_blocks(program: Any, *arrays: np.ndarray) -> Any:
    """Call a compiled function on arrays of any common length, padded to a few sizes by repeating the last row."""
    return in_blocks_of(BLOCKS, lambda _, *part: program(*part), arrays)


def in_blocks_of(sizes: tuple[int, ...], program: Any, arrays: tuple[np.ndarray, ...]) -> Any:
    """`in_blocks` with blocks of these sizes; the first argument of the function is the number of rows not padded."""
    parts, count = [], len(arrays[0])
    for start in range(0, max(count, 1), sizes[-1]):
        part = [x[start : start + sizes[-1]] for x in arrays]
        size = len(part[0])
        length = next(b for b in sizes if b >= size)
        if length > size:
            part = [_repeated(x, length) for x in part]
        found = program(np.asarray(size), *part)
        parts.append(jax.tree_util.tree_map(lambda x, size=size: np.asarray(x)[:size], found))
    return parts[0] if len(parts) == 1 else jax.tree_util.tree_map(lambda *x: np.concatenate(x), *parts)


def _repeated(rows: np.ndarray, length: int) -> np.ndarray:
    """The rows padded to a length by repeating the last one; faster than concatenation."""
    out = np.zeros((length, *rows.shape[1:]), rows.dtype)
    out[: len(rows)], out[len(rows) :] = rows, rows[-1:]
    return out


def _in_reach(tree: TriangleTree, points: np.ndarray, bound: np.ndarray, node: np.ndarray) -> np.ndarray:
    """Mask (pairs, 8) of the children whose boxes are within the bounds."""
    return in_blocks(lambda p, b, n: _reach(tree.boxes, p, b, n), points, bound, node)


def barycentric_of(tree: TriangleTree, points: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of the nearest points of sorted triangles, in the unit of the tree."""
    turn = tree.turn[triangle].astype(np.int32)
    return in_blocks(lambda p, i, k: _coordinates(tree.table, p, i, k), points, triangle, turn)


@compiled
def _squares(table: Array, points: Array, rows: Array) -> Array:
    return squared_distances(points, table[rows])


@compiled
def _coordinates(table: Array, points: Array, rows: Array, turn: Array) -> Array:
    return barycentric(points, table[rows], turn)


@compiled
def _reach(boxes: Array, points: Array, bound: Array, node: Array) -> Bool[Array, "pairs 8"]:
    box, square = boxes[node], 0.0
    for axis in range(3):
        p = points[:, axis, None]
        step = jnp.maximum(jnp.maximum(box[:, axis] - p, p - box[:, axis + 3]), 0.0)
        square = square + step * step
    return square <= bound[:, None]


def curve_places(tree: TriangleTree, points: np.ndarray) -> np.ndarray:
    """Positions of points along a space-filling curve, so that consecutive points share nodes."""
    scale = tree.hints.side * max(tree.hints.triangle.shape)
    with np.errstate(over="ignore"):
        cells = np.clip((points - tree.hints.lower) / scale * 1023, 0, 1023).astype(np.int64)
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        cells = (cells | cells << shift) & mask
    return cells[:, 0] | cells[:, 1] << 1 | cells[:, 2] << 2
