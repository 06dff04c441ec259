"""Winding numbers of triangle meshes, and the inside of a mesh by them, decided with proven errors.

The winding number of a point q is the sum of the signed solid angles of the triangles over 4 pi: an integer off a
closed mesh, and a smooth generalization elsewhere. Triangles far from q are taken together: with
K(x) = (x - q) / |x - q|^3 and a node of the tree about c, the integral of K.n over its triangles is to first order

    N.K(c) + tr(M) / |r|^3 - 3 r'M r / |r|^5,   r = c - q,   N = sum of n dA,   M = integral of (x - c) n' dA.

K is the gradient of -1 / |x - q|, whose third derivatives have the norm 6 / |x - q|^4. So the remainder is at most
3 S / (|r| - R)^4, where R is the largest |x - c| and S the integral of |x - c|^2. A node whose error is too large is
opened, in the end down to its triangles, whose solid angles are exact but for rounding. The sum of all errors is kept
for every point; if it leaves |w| >= 1/2 open, the point is done again with a smaller tolerance, at last with none.

If every edge of a mesh is traversed equally often in both directions, the number is constant off the mesh. Then two
points are on one side if the balls about them that are free of the mesh meet, and one evaluation serves both.

Sources: Jacobson, Kavan, Sorkine-Hornung, Robust inside-outside segmentation using generalized winding numbers (2013);
Barill, Dickson, Schmidt, Levin, Jacobson, Fast winding numbers for soups and clouds (2018), whose criterion for opening
a node is a ratio of distances in place of our bound; van Oosterom & Strackee, The solid angle of a plane triangle
(1983).
"""

import math
from fractions import Fraction
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jhd._arithmetic.rationals import root_between
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._runtime.arrays import in_chunks
from jhd._runtime.compiled import optimized
from jhd._shapes.mesh import TriangleMesh, edges_of
from jhd._shapes.prepared import prepared
from jhd._triangles.box_tree import WIDTH
from jhd._triangles.closest_point import (
    BLOCKS,
    ClosestPoints,
    TriangleTree,
    closest_points,
    curve_places,
    in_blocks,
    in_unit_of,
    popped,
    triangle_tree,
)
from jhd._triangles.unit import in_unit, scaled_down

# Largest error of one node, in turn: the first decides nearly all points of a closed mesh, the last opens every node.
_TOLERANCES = (1.2e-2, 2e-3, 1e-5, 0.0)
# Groups of points up to this number are evaluated without moving them to more room.
_FEW = 256


class _Moments(NamedTuple):
    """Sums over the triangles of every node, in the order of the tree's nodes."""

    table: Array  # c, N, M, R, S and area of each node (18 numbers), repeated up to a length with a compiled function
    corners: Array  # corners of the sorted triangles, padded in length like the table
    count: int  # number of triangles


def is_inside(
    mesh: TriangleMesh, points: Float[np.ndarray, "points 3"], found: ClosestPoints | None = None
) -> Bool[np.ndarray, " points"]:
    """Whether the winding number of each point is at least 1/2 in absolute value; all numbers known.

    Certain for points that are off the mesh by more than rounding, except where the number is 1/2 within rounding.

    Args:
        mesh: the mesh, closed or not.
        points: in the unit of the mesh.
        found: the nearest points, which save work if the mesh is closed; then points that may be on the mesh, to
            within rounding, count as outside.
    """
    mesh, power = in_unit(mesh)
    points, near = scaled_down(points, power)
    inside = np.zeros(len(points), bool)
    if found is None or not prepared(mesh)._part(_is_cycle):
        inside[near] = _decided(mesh, points[near])
        return inside
    off = near[found.lower[near] > 0]
    if len(off):
        room, foot = (np.ldexp(x[off], -power) for x in (found.lower, found.foot))
        inside[off] = _grouped(mesh, points[off], room, foot)
    return inside


def _grouped(mesh: TriangleMesh, points: np.ndarray, room: np.ndarray, foot: np.ndarray) -> np.ndarray:
    """`is_inside` for points about which balls of radius `room` are free of a closed mesh.

    One member of each group is evaluated. If many groups are left, these members are moved away from their feet to
    more room, so that more of their balls meet.
    """
    tree, members = triangle_tree(mesh), np.arange(len(points))
    for turn in range(4):
        chosen, group = _leaders(points, room, tree)
        points, room, foot, members = points[chosen], room[chosen], foot[chosen], group[members]
        if turn == 3 or len(chosen) <= _FEW:
            break
        _move_away(mesh, points, room, foot)
    return _decided(mesh, points)[members]


def _leaders(points: np.ndarray, room: np.ndarray, tree: TriangleTree) -> tuple[np.ndarray, np.ndarray]:
    """The point with the most room of each group of meeting balls, and the group number of each point."""
    order, group = _linked(points, room, tree)
    largest = np.lexsort((-room[order], group))
    chosen = order[largest[np.flatnonzero(np.diff(group[largest], prepend=-1))]]
    members = np.empty(len(points), np.int64)
    members[order] = group
    return chosen, members


def _move_away(mesh: TriangleMesh, points: np.ndarray, room: np.ndarray, foot: np.ndarray) -> None:
    """Move points away from their feet, in place, as far as they are proven to stay on their side of a closed mesh.

    A step is proven if the balls free of the mesh about the new and the old point meet. The longest steps are tried
    first: if the mesh is nearly flat, the room grows by the whole step.
    """
    away = points - foot
    length = np.max(np.abs(away), axis=1, keepdims=True)
    away = away / np.where(length > 0, length, 1.0)
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1.0)
    left = np.arange(len(points))
    # Steps as fractions of the size of the mesh.
    for share in [2.0**-k for k in (3, 5, 7, 10, 13, 16, 20)]:
        left = left[room[left] < 0.5 * share]
        if len(left) <= _FEW:
            return
        moved = (points[left] + away[left] * share).astype(points.dtype)
        there = closest_points(mesh, moved)
        apart = np.linalg.norm(moved.astype(np.float64) - points[left], axis=1)
        meets = (apart * (1 + 1e-6) < (room[left] + there.lower) * (1 - 1e-6)) & (there.lower > room[left])
        points[left[meets]], room[left[meets]] = moved[meets], there.lower[meets]
        left = left[~meets]


def _is_cycle(mesh: TriangleMesh) -> bool:
    """Whether the winding number is constant off the mesh."""
    return bool(np.all(edges_of(mesh).balance == 0))


def _linked(points: np.ndarray, clearance: np.ndarray, tree: TriangleTree) -> tuple[np.ndarray, np.ndarray]:
    """An order of the points, and for each in that order the number of its group, joined by balls that meet."""
    order = np.argsort(curve_places(tree, points), kind="stable")
    rows, room = points[order], clearance[order] * (1 - 1e-6)
    count, links = len(points), []
    # Steps along the space-filling curve between points that are tested.
    for step in (k for k in (1, 2, 4, 8, 16) if k < count):
        apart = np.max(np.abs(rows[step:] - rows[:-step]), axis=1)
        meets = math.sqrt(3) * apart < room[step:] + room[:-step]
        links.append((step, meets))
    label = np.arange(count)
    while True:
        before = label.copy()
        for step, meets in links:
            least = np.minimum(label[step:], label[:-step])
            np.copyto(label[step:], least, where=meets)
            np.copyto(label[:-step], least, where=meets)
        label = label[label]
        if np.array_equal(label, before):
            return order, np.unique(label, return_inverse=True)[1]


def _decided(mesh: TriangleMesh, points: np.ndarray) -> np.ndarray:
    """`is_inside` for each point by itself, for a mesh as returned by `in_unit`."""
    tree, moments, scaled = _prepared(mesh, points)
    inside, open_ = np.zeros(len(points), bool), np.arange(len(points))
    for tolerance in _TOLERANCES:
        left = []
        for start in range(0, len(open_), BLOCKS[-1]):
            rows = open_[start : start + BLOCKS[-1]]
            number, error = _numbers(tree, moments, scaled[rows], tolerance)
            inside[rows] = np.abs(number) >= 0.5
            left.append(rows[np.abs(np.abs(number) - 0.5) <= error])
        open_ = np.concatenate(left)
        if not len(open_):
            break
    corners = np.asarray(mesh.corners, np.float64)
    for k in open_:
        inside[k] = abs(_exact_number(corners, points[k].astype(np.float64))) >= 0.5
    return inside


def _prepared(mesh: TriangleMesh, points: np.ndarray) -> tuple[TriangleTree, _Moments, np.ndarray]:
    """Tree, sums and points in one unit, for a mesh as returned by `in_unit`."""
    tree, scaled = in_unit_of(triangle_tree(mesh), points)
    return tree, _shrunk(prepared(mesh)._part(_moments), tree.exponent), scaled


def _moments(mesh: TriangleMesh) -> _Moments:
    """The sums of every node, each from its triangles."""
    tree, given = triangle_tree(mesh), np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    corners = given[tree.order].astype(np.float64)
    normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    parts, span = [], 1
    for level in tree.levels:
        span *= WIDTH
        parts.append(_of_level(corners, normal, np.arange(level.count) * span))
    table = np.concatenate(parts).astype(given.dtype)
    # Sizes and sums that bound errors are rounded up.
    table[:, 15:] *= 1 + gamma(1024, given.dtype)
    padded = (
        x[np.minimum(np.arange(n), len(x) - 1)] for x, n in ((table, len(tree.boxes)), (corners, len(tree.table)))
    )
    table, corners = (jnp.asarray(x.astype(given.dtype)) for x in padded)
    return _Moments(table, corners, len(given))


def _of_level(corners: np.ndarray, normal: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """c, N, M, R, S and area of the nodes whose triangles begin at the indices `starts`."""
    low, high = np.minimum.reduceat(corners.min(axis=1), starts), np.maximum.reduceat(corners.max(axis=1), starts)
    center, size = 0.5 * (low + high), np.max(np.abs(normal), axis=1)
    area = size * np.linalg.norm(normal / np.where(size > 0, size, 1.0)[:, None], axis=1)
    sizes = np.diff(np.append(starts, len(corners)))
    off = corners - np.repeat(center, sizes, axis=0)[:, None]
    reach_sq = np.sum(off * off, axis=2).max(axis=1)
    first = off.mean(axis=1)[:, :, None] * normal[:, None, :]
    columns = [normal, first.reshape(-1, 9)]
    sums = [np.add.reduceat(x, starts) for x in columns]
    radius = np.sqrt(np.maximum.reduceat(reach_sq, starts))
    ends = [radius, np.add.reduceat(area * reach_sq, starts), np.add.reduceat(area, starts)]
    return np.concatenate([center, *sums, np.stack(ends, axis=1)], axis=1)


def _shrunk(moments: _Moments, power: int) -> _Moments:
    """The sums in a unit larger by 2^power; numbers that underflow are far below any decision."""
    if power == 0:
        return moments
    powers = np.repeat([1, 2, 3, 1, 4, 2], [3, 3, 9, 1, 1, 1]) * -power
    table = jnp.asarray(np.ldexp(np.asarray(moments.table), powers))
    return moments._replace(table=table, corners=jnp.asarray(np.ldexp(np.asarray(moments.corners), -power)))


def _numbers(
    tree: TriangleTree, moments: _Moments, points: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Winding numbers of a block of points and bounds of their errors."""
    number, error = np.zeros(len(points)), np.full(len(points), 1e-12)
    everyone = np.arange(len(points), dtype=np.int32)
    stack = [(len(tree.levels) - 1, everyone, np.zeros(len(points), np.int32))]
    while stack:
        level, who, node = popped(stack)
        if level < 0:
            value, bound = in_blocks(lambda p, i: _angles(moments.corners, p, i), points[who], node)
            taken = slice(None)
        else:
            places = node + tree.levels[level].start
            value, bound = in_blocks(lambda p, i: _expansions(moments.table, p, i), points[who], places)
            taken = bound <= tolerance
            opened, row = who[~taken], node[~taken]
            if len(opened):
                below = tree.levels[level - 1].count if level else moments.count
                children = row[:, None] * WIDTH + np.arange(WIDTH, dtype=np.int32)
                there = children < below
                stack.append((level - 1, np.repeat(opened, WIDTH)[there.ravel()], children[there]))
        number += np.bincount(who[taken], value[taken], len(points))
        error += np.bincount(who[taken], bound[taken], len(points))
    return number, error * (1 + 1e-9)


@optimized
def _expansions(table: Array, points: Array, node: Array) -> tuple[Array, Array]:
    """Winding numbers of nodes by the expansion, and bounds of their errors; infinite if q may be within the radius R.

    The terms are at most A / |r|^2 and 4 A R / |r|^3, and have far less than 64 roundings. Underflow in N, M and S adds
    a separate part.
    """
    row = table[node]
    r = [row[:, k] - points[:, k] for k in range(3)]
    square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    length = jnp.sqrt(square)
    radius, second, area = row[:, 15], row[:, 16], row[:, 17]
    sound = length * (1 - gamma(16, points.dtype)) > radius
    square, length = jnp.where(sound, square, 1.0), jnp.where(sound, length, 1.0)
    cube = square * length
    flux = r[0] * row[:, 3] + r[1] * row[:, 4] + r[2] * row[:, 5]
    trace = row[:, 6] + row[:, 10] + row[:, 14]
    twice = 0.0
    for i in range(3):
        twice = twice + r[i] * (row[:, 6 + 3 * i] * r[0] + row[:, 7 + 3 * i] * r[1] + row[:, 8 + 3 * i] * r[2])
    value = (flux + trace) / cube - 3 * twice / (cube * square)
    gap = length * (1 - gamma(16, points.dtype)) - radius
    gap = jnp.where(sound & (gap > 0), gap, 1.0)
    # Largest loss of the sums of a node by underflow, in smallest normal numbers: triangles lose fractions of one.
    lost = 64 * smallest_normal(points.dtype)
    rounding = (gamma(1024, points.dtype) * area * (1 + 4 * radius / length) + lost * (1 + 1 / length)) / square
    remainder = 3 * (second + lost) / (gap * gap) / (gap * gap)
    bound = jnp.where(sound & (gap > 0), (remainder + rounding) * (1 + gamma(64, points.dtype)), jnp.inf)
    return value / (4 * math.pi), bound / (4 * math.pi)


@optimized
def _angles(corners: Array, points: Array, triangle: Array) -> tuple[Array, Array]:
    """Winding numbers of single triangles, and bounds of their errors."""
    return solid_angles(corners[triangle] - points[:, None, :])


def solid_angles(offsets: Float[Array, "*batch corners 3"]) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Solid angles over 4 pi of triangles seen from the origin, and bounds of the errors.

    The angle is twice the angle of the vector (D, V) with V = det(a, b, c) and
    D = |a| |b| |c| + (a.b) |c| + (b.c) |a| + (c.a) |b|. Corners have one rounding each; so V has an error of at most
    gamma(9) times the sum of the absolute values of its six products, which is at most sqrt(2) |a| |b| |c|, and D one
    of gamma(16) 4 |a| |b| |c|. An error e of a vector of length l > e turns it by at most (pi / 2) e / l. If D is
    negative and V has no certain sign, the angle may be off by a whole turn of the vector.
    """
    a, b, c = (offsets[..., k, :] for k in range(3))
    size = jnp.max(jnp.abs(offsets), axis=(-2, -1))
    scale = jnp.where(size > 0, size, 1.0)[..., None]
    a, b, c = a / scale, b / scale, c / scale
    x, y, z = (jnp.sqrt(jnp.sum(v * v, axis=-1)) for v in (a, b, c))
    cross = [b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1], b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2]]
    cross.append(b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    volume = a[..., 0] * cross[0] + a[..., 1] * cross[1] + a[..., 2] * cross[2]
    product = x * y * z
    below = product + jnp.sum(a * b, -1) * z + jnp.sum(b * c, -1) * x + jnp.sum(c * a, -1) * y
    error = gamma(96, offsets.dtype) * product + smallest_normal(offsets.dtype)
    length = jnp.maximum(jnp.abs(volume), jnp.abs(below))
    turned = (below <= error) & (jnp.abs(volume) <= error)
    bound = jnp.where(turned | (length <= error), 1.0, jnp.minimum(1.0, 0.5 * error / jnp.maximum(length, error)))
    nothing = jnp.where((volume == 0) & (below == 0), 1.0, below)
    return jnp.arctan2(volume, nothing) / (2 * math.pi), bound + gamma(16, offsets.dtype)


def _exact_number(corners: np.ndarray, point: np.ndarray) -> float:
    """The winding number from all triangles; triangles with the largest errors are evaluated exactly."""
    value, bound = (np.array(x) for x in _known_angles(jnp.asarray(corners), jnp.asarray(point)))
    order = np.argsort(bound)
    # Triangles whose errors add up to less are not evaluated exactly.
    for k in order[np.cumsum(bound[order]) > 0.1]:
        p, *abc = ([Fraction(float(x)) for x in row] for row in (point, *corners[k]))
        value[k] = _exact_angle(*([x - y for x, y in zip(row, p, strict=True)] for row in abc))
    return float(np.sum(value))


def _exact_angle(a: list[Fraction], b: list[Fraction], c: list[Fraction]) -> float:
    """The solid angle over 4 pi of a triangle seen from the origin, to single precision; zero from its own plane.

    V is exact, and the roots in D get as many digits as needed: this ends, as V is not zero.
    """
    volume = sum(a[i] * (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2]) for i in range(3))
    if not volume:
        return 0.0
    bits = 64
    low, high = _below(a, b, c, bits)
    while high - low > max(abs(volume), abs(low), abs(high)) / 2**24:
        bits *= 2
        low, high = _below(a, b, c, bits)
    size = max(abs(volume), abs(low), abs(high))
    return math.atan2(float(volume / size), float(low / size)) / (2 * math.pi)


def _below(a: list[Fraction], b: list[Fraction], c: list[Fraction], bits: int) -> tuple[Fraction, Fraction]:
    """Bounds of D, with roots to `bits` bits."""
    lengths = [root_between(_dot(v, v), bits) for v in (a, b, c)]
    factors = _dot(b, c), _dot(c, a), _dot(a, b)
    terms = [sorted(factor * end for end in ends) for factor, ends in zip(factors, lengths, strict=True)]
    least, most = (Fraction(math.prod(x[k] for x in lengths) + sum(x[k] for x in terms)) for k in (0, 1))
    return least, most


def _dot(u: list[Fraction], v: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(u, v, strict=True)), Fraction(0))


@optimized
def _known_angles(corners: Array, point: Array) -> tuple[Array, Array]:
    return solid_angles(corners - point)


def summed_angles(corners: Float[Array, "triangles corners 3"], points: Float[Array, "points 3"]) -> Array:
    """Winding numbers of points from all triangles, in blocks; for use under tracing, without a bound."""
    # Triangles whose solid angles are formed at once.
    chunk = max(1, (1 << 16) // corners.shape[0])
    return in_chunks(lambda point: jnp.sum(solid_angles(corners - point)[0]), points, chunk)
