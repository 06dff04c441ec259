"""The witness of a distance between meshes: all nearest triangles of the farthest point, and their weights.

The distance from a point to one foot is a convex function. So a maximum over a that is not a vertex of a has several
feet at one distance, and a maximum at a vertex can have several. To first order the maximum moves so that these
distances stay equal. Its derivative is the sum of their derivatives at the fixed point on a, with the multipliers of
jhd._distance.witness.multipliers: they balance along a face; at an edge or a vertex no direction into one of the
triangles there raises the distance.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic.rounding import smallest_normal
from jhd._arithmetic.scaling import unit
from jhd._distance.cells.triangles import MeshSide
from jhd._distance.witness.multipliers import balanced_feet
from jhd._results.solution import DIRECTIONS, EVENTS, Witness
from jhd._runtime.arrays import array_of
from jhd._triangles.closest_point import barycentric_of, nearest_triangles, pair_squares

# Distance of the points around the point at which triangles are searched, and the margin within which they count as
# nearest; fractions of the size.
_RING, _EQUAL = 1e-6, 1e-8
# In these directions: within the plane of a face, else all around, to the corners, edges and sides of a cube.
_ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
# Barycentric coordinates below this put the point on an edge.
_ON_EDGE = 1e-9


class MeshFeet(NamedTuple):
    """The active feet of a point, one row each, the first repeated with multiplier zero."""

    triangle: np.ndarray  # triangle of b, as sorted in the tree
    t: np.ndarray  # barycentric coordinates
    multipliers: np.ndarray  # weights in the derivative
    count: int  # number of feet with positive multipliers


def active_feet(side: MeshSide, owner: int, weights: np.ndarray, nearest: int, gap: float) -> MeshFeet:
    """Return the feet of a point of a that balance, in the unit of the tree.

    Args:
        side: both meshes.
        owner: the triangle of a.
        weights: barycentric coordinates of the point.
        nearest: a nearest triangle of b.
        gap: upper - lower; the distances of active feet may differ by this.
    """
    corners = side.corners[owner].astype(np.float64)
    point, free = weights @ corners, weights > _ON_EDGE
    size = max(float(np.max(np.abs(corners[1:] - corners[0]))), smallest_normal(side.corners.dtype))
    rays = _into(side, owner, free)
    ring = np.cos(_ANGLES)[:, None] * rays[0] + np.sin(_ANGLES)[:, None] * rays[1] if free.all() else _CUBE
    around = point + _RING * size * np.concatenate([np.zeros((1, 3)), ring, rays])
    triangles = np.unique(
        np.append(nearest_triangles(side.tree, around.astype(side.corners.dtype)).triangle, nearest)
    ).astype(np.int32)
    rows = np.broadcast_to(point.astype(side.corners.dtype), (len(triangles), 3))
    distance = np.sqrt(pair_squares(side.tree.table, rows, triangles).astype(np.float64))
    equal = max(4 * gap, _EQUAL * size)
    near = np.flatnonzero(distance <= distance.min() + equal)
    t = barycentric_of(side.tree, rows[: len(near)], triangles[near])
    feet = np.einsum("nk,nkd->nd", t, _corners_of(side, triangles[near]))
    rows, multipliers = balanced_feet(point, feet, distance[near], (equal, 1e-2 * _RING * size), (rays,))
    return MeshFeet(triangles[near][rows], t[rows], multipliers, int(np.count_nonzero(multipliers)))


def _corners_of(side: MeshSide, triangles: np.ndarray) -> np.ndarray:
    """Return corners of triangles of b, in the order of the mesh and the unit of the tree."""
    return side.b_corners[side.tree.order[triangles]].astype(np.float64)


def _into(side: MeshSide, owner: int, free: np.ndarray) -> np.ndarray:
    """Return unit vectors whose combinations are the directions into the triangles of a at a point of a triangle.

    On a face there are four, the first two orthogonal; on an edge, vectors along it and across each triangle; at a
    vertex, both sides of each triangle and the vector between them, which a flat angle needs. Triangles meet in equal
    corners.
    """
    own = side.corners[owner][free]
    at = (side.corners[:, :, None] == own).all(axis=-1)
    touching = np.flatnonzero(at.any(axis=1).all(axis=1))
    base = own[0].astype(np.float64)
    shared = at[touching].any(axis=2)[..., None]
    sides = np.where(shared, 0.0, side.corners[touching].astype(np.float64) - base)
    if len(own) == 1:
        ends = unit(sides)
        return np.concatenate([ends.reshape(-1, 3), unit(ends.sum(axis=1))])
    along = unit(own[1].astype(np.float64) - base)
    third = own[2:].astype(np.float64) - base if len(own) == 3 else sides.sum(axis=1)
    across = third - (third @ along)[:, None] * along
    # A triangle whose height is below this fraction of its side has no known direction across.
    flat = np.linalg.norm(across, axis=1) <= 1e-12 * np.linalg.norm(third, axis=1)
    rays = np.concatenate([along[None], unit(np.where(flat[:, None], 0.0, across))])
    return np.concatenate([rays, -rays if len(own) == 3 else -rays[:1]])


def event_of(feet: MeshFeet, weights: np.ndarray, distance: float) -> Any:
    """Return the event of the maximum: a vertex of a, several feet, an edge of a, or the feature of the foot."""
    if distance <= 0:
        return EVENTS.coincident
    if np.count_nonzero(weights > _ON_EDGE) == 1:
        return EVENTS.corner
    if feet.count > 1:
        return EVENTS.one_to_two
    if np.any(weights <= _ON_EDGE):
        return EVENTS.corner
    return EVENTS.antipodal if np.all(feet.t[0] > 0) else EVENTS.b_end


def witness_of(feet: MeshFeet, side: MeshSide, owner: int, weights: np.ndarray, distance: float) -> Witness:
    """Return the witness in the user's unit, from a to b."""
    exponent, dtype = side.tree.exponent, side.corners.dtype
    point = np.ldexp(weights @ side.corners[owner].astype(np.float64), exponent)
    places = np.einsum("nk,nkd->nd", feet.t.astype(np.float64), _corners_of(side, feet.triangle))
    return Witness(
        element=array_of(np.asarray(int(owner))),
        t=array_of(weights.astype(dtype)),
        point=array_of(point.astype(dtype)),
        feet=array_of(np.ldexp(places, exponent).astype(dtype)),
        feet_elements=array_of(side.tree.order[feet.triangle].astype(int)),
        feet_params=array_of(feet.t.astype(dtype)),
        multipliers=array_of(feet.multipliers.astype(dtype)),
        event=event_of(feet, weights, distance),
        direction=DIRECTIONS.a_to_b,
    )
