"""The search for the nearest triangles of two meshes: pairs of boxes of two trees, then pairs of triangles.

Pairs of nodes wait on a stack; a compiled function expands a block of them to the pairs of their children, and the host
keeps the pairs that are not farther apart than two points found. The deepest and nearest go first, so the stack is
short. The few pairs of triangles that bounds do not exclude are settled in rational arithmetic
(jhd._triangles.exact_triangles). A pair that seems to meet is settled at once, which ends the search.

No pair left out has a distance below the upper bound: boxes are exact, their gap rounds six times at most, and bounds
of triangles are proven (jhd._triangles.triangle_pairs).
"""

from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._arithmetic.rationals import float_above, float_below, root_between
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._runtime.arrays import taken
from jhd._runtime.compiled import compiled
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.box_tree import WIDTH, Level, box_tree
from jhd._triangles.closest_point import BLOCKS, in_blocks
from jhd._triangles.exact_triangles import NearestPair, exact_pair, is_behind, planes
from jhd._triangles.triangle_pairs import PairBounds, lower_bounds, pair_bounds
from jhd._triangles.unit import in_unit

# Pairs kept of every level in the quick descent that gives the first upper bound.
_BEAM = 512
# Pairs of one block that are examined in rational arithmetic because they seem to meet.
_PROBES = 4
# This many pairs are always settled in rational arithmetic: it takes a tenth of a second.
_SETTLED = 64
# Up to this many pairs are tested with the planes of the nearest pair, which takes some microseconds for a triangle.
_PARTED = 1 << 14


class MeshBoxes(NamedTuple):
    """A mesh prepared for searches, its coordinates divided by 2^exponent, which leaves at most one."""

    corners: Float[np.ndarray, "triangles corners 3"]  # of the triangles as sorted
    boxes: Float[np.ndarray, "nodes 6 8"]  # boxes of the nodes, as in BoxTree
    levels: tuple[Level, ...]  # levels of the tree, as in BoxTree
    order: Int[np.ndarray, " triangles"]  # the number in the mesh of each sorted triangle
    exponent: int  # the power of two


def mesh_boxes(mesh: TriangleMesh) -> MeshBoxes:
    """Return the tree of boxes of a mesh whose numbers are known."""
    unit, exponent = in_unit(mesh)
    corners = stored_corners(unit)
    tree = box_tree(corners)
    return MeshBoxes(corners[tree.order], tree.boxes, tree.levels, tree.order, exponent)


def stored_corners(mesh: TriangleMesh) -> Float[np.ndarray, "triangles corners 3"]:
    """Return the corners of the triangles of a mesh whose numbers are known."""
    return np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]


def in_one_unit(a: MeshBoxes, b: MeshBoxes) -> tuple[MeshBoxes, MeshBoxes]:
    """Return both sides in the larger unit, with trees of equal height: single nodes are added on top."""
    exponent, height = max(a.exponent, b.exponent), max(len(a.levels), len(b.levels))
    first, second = (_raised(_shrunk(side, exponent - side.exponent), height) for side in (a, b))
    return first, second


def _shrunk(side: MeshBoxes, power: int) -> MeshBoxes:
    if power == 0:
        return side
    return side._replace(
        corners=np.ldexp(side.corners, -power),
        boxes=np.where(np.isfinite(side.boxes), np.ldexp(side.boxes, -power), side.boxes),
        exponent=side.exponent + power,
    )


def _raised(side: MeshBoxes, height: int) -> MeshBoxes:
    """Return a tree with levels of single nodes on top, up to `height` levels."""
    missing = height - len(side.levels)
    if missing == 0:
        return side
    top = side.levels[-1]
    root, count = side.boxes[top.start], top.start + top.count
    single = np.where(np.arange(6) < 3, np.inf, -np.inf)[:, None] * np.ones(WIDTH)
    single[:, 0] = np.concatenate([root[:3].min(axis=1), root[3:].max(axis=1)])
    chain = np.broadcast_to(single.astype(root.dtype), (missing, 6, WIDTH))
    levels = tuple(Level(count + k, 1) for k in range(missing))
    return side._replace(boxes=np.concatenate([side.boxes[:count], chain]), levels=(*side.levels, *levels))


class Pairs(NamedTuple):
    """Pairs of nodes of one level, or of sorted triangles, with proven lower bounds in the common unit."""

    a: Int[np.ndarray, " pairs"]
    b: Int[np.ndarray, " pairs"]
    lower: Float[np.ndarray, " pairs"]

    take = taken


class Settled(NamedTuple):
    """A pair of triangles that rational arithmetic has measured, and bounds of its distance."""

    triangles: tuple[int, int]  # their numbers in the meshes
    nearest: NearestPair  # nearest points, in the unit of the meshes
    lower: float  # proven lower bound in the common unit
    upper: float  # proven upper bound in that unit

    @property
    def weights(self) -> tuple[tuple[Fraction, ...], ...]:
        """Barycentric coordinates of both points."""
        return self.nearest.weights_a, self.nearest.weights_b


class PairSearch:
    """A running search; its bounds are in the common unit of both sides, and proven at any time.

    Args:
        a: one mesh.
        b: the second mesh, in the same unit and with as many levels.
        meshes: the stored corners of the triangles of both meshes, which are measured exactly.
    """

    def __init__(self, a: MeshBoxes, b: MeshBoxes, meshes: tuple[np.ndarray, np.ndarray]):
        self._sides, self._meshes = (a, b), meshes
        root = np.zeros(1, np.int32)
        top = len(a.levels) - 1
        self._near: list[Pairs] = []
        self._stack = [(top, Pairs(root, root, np.zeros(1)))]
        self.upper, self.steps, self.exact, self.tried, self.is_settled = np.inf, 0, 0, 0, False
        self._settled: dict[tuple[int, int], Settled] = {}
        # The nearest pair settled; the descent settles one.
        self.best: Settled
        self._descend(top)

    @property
    def lower(self) -> float:
        """The proven lower bound reached."""
        parts = [pairs.lower.min(initial=np.inf) for _, pairs in self._stack]
        parts += [pairs.lower.min(initial=np.inf) for pairs in self._near]
        parts += [pair.lower for pair in self._settled.values()]
        return min(self.upper, *parts) if parts else self.upper

    @property
    def is_waiting(self) -> bool:
        """Whether there are open pairs of boxes."""
        return bool(self._stack) and self.upper > 0

    @property
    def waiting(self) -> int:
        """The number of open pairs of boxes or of triangles."""
        return sum(len(pairs.a) for _, pairs in self._stack) + sum(len(pairs.a) for pairs in self._near)

    def advance(self) -> None:
        """Process the next block of pairs. The remaining work is stored last, so an interruption does no harm."""
        level, waiting = self._stack[-1]
        waiting = waiting.take(np.flatnonzero(waiting.lower <= self.upper))
        pairs, rest = waiting.take(slice(-BLOCKS[-1], None)), waiting.take(slice(None, -BLOCKS[-1]))
        left = [(level, rest)] if len(rest.a) else []
        if len(pairs.a):
            self.steps += 1
            if level < 0:
                self._measure(pairs)
            else:
                children = self._children(level, pairs, self.upper)
                # The nearest ones are on top.
                left.append((level - 1, children.take(np.argsort(-children.lower, kind="stable"))))
        self._stack[-1:] = left

    def settle(self, allowed: Callable[[float], float], most: int) -> None:
        """Measure the remaining triangles in rational arithmetic, the nearest first, until it `is_settled`.

        Args:
            allowed: the gap that may stay at an upper bound if more than a few pairs are left.
            most: largest total number of pairs.
        """
        known = None
        while not self.is_settled and self.tried < most:
            left = self._left()
            if self.best is not known:
                known, left = self.best, self._beyond(left)
            self._near = [left]
            near_enough = self.tried >= _SETTLED and self.upper - self.lower <= allowed(self.upper)
            self.is_settled = self.upper == 0 or not len(left.a) or near_enough
            if not self.is_settled:
                self._settle(int(left.a[0]), int(left.b[0]))
                self._near = [left.take(slice(1, None))]
                self.tried += 1

    def _left(self) -> Pairs:
        """Return the pairs of triangles that may be nearer than the upper bound, the nearest first."""
        none = np.zeros(0, np.int32)
        parts = [Pairs(none, none, np.zeros(0)), *self._near]
        a, b, lower = (np.concatenate([part[k] for part in parts]) for k in range(3))
        every = Pairs(a, b, lower)
        every = every.take(np.flatnonzero(every.lower < self.upper))
        return every.take(np.argsort(every.lower, kind="stable"))

    def _beyond(self, pairs: Pairs) -> Pairs:
        """Return the pairs that may be nearer: the planes through the nearest points do not separate them."""
        if not 0 < len(pairs.a) <= _PARTED:
            return pairs
        i, j = self.best.triangles
        found = planes(self._meshes[0][i], self._meshes[1][j], self.best.nearest)
        behind = []
        for places, side, rows, sign in zip(pairs[:2], self._sides, self._meshes, (1, -1), strict=True):
            used, index = np.unique(places, return_inverse=True)
            behind.append(np.array([is_behind(found, sign, rows[k]) for k in side.order[used]])[index])
        return pairs.take(np.flatnonzero(~(behind[0] & behind[1])))

    def _descend(self, level: int) -> None:
        """Find a first upper bound from a few pairs of every level with the nearest middles of boxes."""
        pairs = self._stack[0][1]
        for k in range(level, -1, -1):
            squares = in_blocks(_middles, *self._boxes(k, pairs)).reshape(-1)
            near = np.argpartition(squares, min(_BEAM, squares.size) - 1)[:_BEAM]
            near = near[squares[near] < np.inf]
            pairs = _chosen(pairs, near, np.zeros(len(near)))
        self._measure(pairs, keeping=False)

    def _boxes(self, level: int, pairs: Pairs) -> list[np.ndarray]:
        return [side.boxes[x + side.levels[level].start] for x, side in zip(pairs[:2], self._sides, strict=True)]

    def _corners(self, pairs: Pairs) -> list[np.ndarray]:
        return [side.corners[x] for x, side in zip(pairs[:2], self._sides, strict=True)]

    def _children(self, level: int, pairs: Pairs, upper: float) -> Pairs:
        squares = in_blocks(_gaps, *self._boxes(level, pairs)).reshape(-1)
        dtype = squares.dtype
        limit = upper**2 * (1 + gamma(64, dtype)) + 64 * smallest_normal(dtype)
        near = np.flatnonzero(squares <= limit)
        lower = np.sqrt(squares[near].astype(np.float64)) * (1 - gamma(16, dtype)) - 16 * smallest_normal(dtype)
        return _chosen(pairs, near, np.maximum(lower, 0.0))

    def _measure(self, pairs: Pairs, keeping: bool = True) -> None:
        """Bound pairs of triangles, keep the open ones, and settle the most promising ones."""
        quick = in_blocks(_quick, *self._corners(pairs))
        pairs = pairs.take(np.flatnonzero(quick <= self.upper))
        if not len(pairs.a):
            return
        found = in_blocks(_thorough, *self._corners(pairs))
        probed = np.argsort(found.gap, kind="stable")[:_PROBES]
        probed = probed[found.gap[probed] < 0]
        least = int(np.argmin(found.upper))
        if found.upper[least] < self.upper:
            self.upper, probed = float(found.upper[least]), np.append(probed, least)
        pairs = pairs._replace(lower=np.maximum(np.asarray(found.lower, np.float64), pairs.lower))
        if keeping:
            self._near.append(pairs.take(np.flatnonzero(pairs.lower <= self.upper)))
        for k in probed:
            if self.upper > 0:
                self._settle(int(pairs.a[k]), int(pairs.b[k]))

    def _settle(self, i: int, j: int) -> None:
        if (i, j) in self._settled:
            return
        first, second = self._sides
        triangles = int(first.order[i]), int(second.order[j])
        nearest = exact_pair(self._meshes[0][triangles[0]], self._meshes[1][triangles[1]])
        dtype = np.dtype(np.float64)
        low, high = (x / Fraction(2) ** first.exponent for x in root_between(nearest.square))
        pair = Settled(triangles, nearest, float(float_below(low, dtype)), float(float_above(high, dtype)))
        self._settled[i, j] = pair
        self.exact += 1
        if self.exact == 1 or nearest.square < self.best.nearest.square:
            self.best = pair
        self.upper = min(self.upper, pair.upper)


def _chosen(pairs: Pairs, rows: np.ndarray, lower: np.ndarray) -> Pairs:
    """Return the pairs of children at these flat indices into (pairs, children, children)."""
    pair, first, second = rows >> 6, (rows >> 3) & 7, rows & 7
    children = [x[pair] * WIDTH + y.astype(np.int32) for x, y in zip(pairs[:2], (first, second), strict=True)]
    return Pairs(children[0], children[1], lower)


@compiled
def _gaps(a: Array, b: Array) -> Float[Array, "pairs 8 8"]:
    """Return squared distances of the boxes of all children; infinite for missing children."""
    square = jnp.zeros(())
    for axis in range(3):
        over = a[:, axis, :, None] - b[:, axis + 3, None, :]
        under = b[:, axis, None, :] - a[:, axis + 3, :, None]
        step = jnp.maximum(jnp.maximum(over, under), 0.0)
        square = square + step * step
    return square


@compiled
def _middles(a: Array, b: Array) -> Float[Array, "pairs 8 8"]:
    """Return squared distances of the middles of the boxes of all children; infinite for missing children."""
    x, y = ((box[:, :3] + box[:, 3:]) / 2 for box in (a, b))
    step = x[:, :, :, None] - y[:, :, None, :]
    square = jnp.sum(step * step, axis=1)
    return jnp.where(jnp.isfinite(square), square, jnp.inf)


@compiled
def _quick(a: Array, b: Array) -> Array:
    return lower_bounds(*(jnp.moveaxis(x, 0, -1) for x in (a, b)))


@compiled
def _thorough(a: Array, b: Array) -> PairBounds:
    return pair_bounds(*(jnp.moveaxis(x, 0, -1) for x in (a, b)))
