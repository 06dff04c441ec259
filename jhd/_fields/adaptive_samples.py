"""Signed distances of many points to one mesh, for a search that requests more and more of them.

A mesh takes the place of a parametric or implicit surface. If it is within d of the surface in both directions, their
distances differ by at most d. The side of a point is its side of the mesh; for points farther than d from the surface
this is also their side of the surface.

If every edge of a mesh is traversed equally often in both directions, its winding number is constant off the mesh. The
signed distance then has Lipschitz constant 1. Two points with |p - q| < d(p) + d(q) are on the same side, since the
open balls around them, which do not meet the mesh, intersect. So few winding numbers are evaluated: `spread` passes
signs from points to their neighbors, with distances rounded down.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import common_exponent
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh, edges_of
from jhd._shapes.patch import AbstractPatch
from jhd._triangles.closest_point import (
    AbstractMeshSearch,
    ClosestPoints,
    TriangleTree,
    barycentric_of,
    closest_points,
    in_unit_of,
    nearest_triangles,
    outward,
    triangle_tree,
)
from jhd._triangles.pseudonormal import is_behind, pseudonormals
from jhd._triangles.winding import is_inside

SIGNS = ("winding", "pseudonormal", "none")
# Published averages of normals go with the published search alone.
PUBLISHED_SIGN = "average"
# Fraction of the tolerance of a field for its mesh, which gives about as many triangles as cells.
MESH_SHARE = 0.25


class Samples(NamedTuple):
    """Points near a mesh with their known distances and sides."""

    distance: Float[np.ndarray, " points"]  # rounded distances to the mesh, in its unit
    clearance: Float[np.ndarray, " points"]  # proven lower bounds of the distances
    triangle: Int[np.ndarray, " points"]  # the nearest triangle, in the order of the tree
    side: Int[np.ndarray, " points"]  # 1 outside, -1 inside, 0 if not known yet

    @property
    def signed(self) -> Float[np.ndarray, " points"]:
        """Signed distances, negative inside."""
        return self.distance * self.side


class CellNeighbors(NamedTuple):
    """Known samples around each of some points."""

    numbers: Int[np.ndarray, "points neighbors"]  # numbers of the samples
    points: Float[np.ndarray, "points neighbors 3"]  # coordinates of the samples


class Surface(NamedTuple):
    """A mesh prepared for many queries.

    Args:
        mesh: the mesh, its numbers known.
        tree: tree of its triangles.
        sign: one of SIGNS.
        linked: whether the distances have no jumps: unsigned ones, and signed ones if the winding number is constant
            off the mesh.
        search: the search for nearest points; None for the exact search.
    """

    mesh: TriangleMesh
    tree: TriangleTree
    sign: str
    linked: bool
    search: AbstractMeshSearch | None = None

    @property
    def dtype(self) -> np.dtype:
        """The precision of the coordinates."""
        return np.asarray(self.mesh.vertices).dtype


def meshed(shape: Any, tolerance: float, sign: str = "none") -> tuple[Any, float]:
    """The mesh of a curved surface and its deviation, at most MESH_SHARE * tolerance; any other shape and 0.

    Closed meshes are turned so that they face outward: a polynomial may be negative or positive inside.

    Raises:
        ValueError: as `to_mesh` of the surface, or a sign is asked for and the surface is open.
        TypeError: the surface is traced.
    """
    if not isinstance(shape, AbstractPatch | ImplicitSurface):
        return shape, 0.0
    mesh, deviation = shape.to_mesh(MESH_SHARE * tolerance)
    if sign != "none" and not mesh.is_closed:
        raise ValueError("the surface is open, so it has no inside; the sign 'none' gives unsigned distances.")
    if mesh.is_closed and _signed_volume(mesh) < 0:
        mesh = TriangleMesh(mesh.vertices, np.asarray(mesh.triangles)[:, [0, 2, 1]])
    return mesh, deviation


def _signed_volume(mesh: TriangleMesh) -> float:
    """A positive multiple of the enclosed volume, on the host."""
    vertices = np.asarray(mesh.vertices, np.float64)
    near = np.ldexp(vertices, -int(common_exponent(vertices)))
    low = near.min(axis=0)
    a, b, c = np.moveaxis((near - low)[np.asarray(mesh.triangles)], 1, 0)
    return float(np.sum(a * np.cross(b, c)))


def surface_of(mesh: TriangleMesh, sign: str = "winding", search: AbstractMeshSearch | None = None) -> Surface:
    """The prepared mesh; a search determines the distances, and signs then use the published averages of normals.

    Raises:
        ValueError: normals of a mesh that is not closed and consistently oriented.
    """
    if search is not None:
        pseudonormals(mesh, PUBLISHED_SIGN)
        return Surface(mesh, triangle_tree(mesh), PUBLISHED_SIGN, False, search)
    if sign == "pseudonormal":
        pseudonormals(mesh)
    linked = sign == "none" or bool(np.all(edges_of(mesh).balance == 0))
    return Surface(mesh, triangle_tree(mesh), sign, linked)


def unsigned(
    surface: Surface, points: Float[np.ndarray, "points 3"], near: Int[np.ndarray, " points"] | None = None
) -> Samples:
    """Samples with distances; sides are known only by pseudonormals or averages, or without a sign (all outside).

    Args:
        surface: the mesh.
        points: one point at least, in the unit and precision of the mesh.
        near: a near triangle for each point, in the order of the tree; None searches for them.
    """
    if surface.search is not None:
        local = surface.search._search(points, surface.mesh)
        behind = is_behind(surface.mesh, points, local.triangle, local.t, surface.sign)
        # No other search starts near these triangles, so they need no numbers of the tree.
        return Samples(local.distance, local.lower, local.triangle, np.where(behind, -1, 1).astype(np.int8))
    tree, scaled = in_unit_of(surface.tree, points)
    found = nearest_triangles(tree, scaled, near)
    distance = np.sqrt(found.square)
    lower = distance.astype(np.float64) - tree.error(distance)
    side = np.full(len(points), 1 if surface.sign == "none" else 0, np.int8)
    if surface.sign == "pseudonormal":
        side = np.where(_is_behind(surface.mesh, tree, scaled, found.triangle), -1, 1).astype(np.int8)
    clearance = outward(lower, tree.exponent, points.dtype, -1)
    return Samples(np.ldexp(distance, tree.exponent), clearance, found.triangle, side)


def _is_behind(mesh: TriangleMesh, tree: TriangleTree, scaled: np.ndarray, near: np.ndarray) -> np.ndarray:
    t = barycentric_of(tree, scaled, near)
    return is_behind(mesh, np.ldexp(scaled, tree.exponent), tree.order[near], t)


def _met(samples: Samples, others: np.ndarray, apart: np.ndarray, clearance: np.ndarray) -> np.ndarray:
    """The known side of a sample among `others` whose ball meets the ball of radius `clearance`; 0 if none does."""
    meets = _meet(apart, clearance[:, None], samples.clearance[others])
    side = np.where(meets, samples.side[others], 0)
    return side[np.arange(len(side)), np.argmax(np.abs(side), axis=1)]


def spread(samples: Samples, who: np.ndarray, others: np.ndarray, apart: np.ndarray) -> None:
    """Set the sides of the samples `who` from `others` whose balls meet theirs, in place."""
    found = _met(samples, others, apart, samples.clearance[who])
    samples.side[who[found != 0]] = found[found != 0]


def lift(surface: Surface, samples: Samples, who: np.ndarray, points: np.ndarray, others: CellNeighbors) -> None:
    """Set the sides of samples close to the mesh from their neighbors, in place.

    Points are moved away from the mesh, inside the balls about them, until a ball meets the ball of a neighbor.
    """
    left = np.arange(len(who))
    # Times that a point is moved away from the mesh, which doubles the room about it at best.
    for _ in range(5):
        if not len(left):
            return
        found = closest_points(surface.mesh, points[left])
        away = np.linalg.norm(points[left, None] - others.points[left], axis=2)
        side = _met(samples, others.numbers[left], away, found.lower)
        samples.side[who[left]] = side
        points[left] += 0.95 * found.lower[:, None] * _directions(points[left] - found.foot)
        left = left[side == 0]


def decide(surface: Surface, samples: Samples, who: np.ndarray, points: np.ndarray) -> None:
    """Set missing sides by the winding number, in place."""
    left = np.flatnonzero(samples.side[who] == 0)
    if len(left):
        found = closest_points(surface.mesh, points[left]) if surface.linked else None
        samples.side[who[left]] = np.where(is_inside(surface.mesh, points[left], found), -1, 1)


def is_inner(
    surface: Surface, points: np.ndarray, found: ClosestPoints, reach: np.ndarray
) -> Bool[np.ndarray, " points"]:
    """Whether points are inside by the winding number: jhd._triangles.winding.is_inside, faster near the mesh.

    If sign is "none", all are outside.

    Points close to the mesh are first moved away from it, if this is proven to keep their side. Larger balls meet
    more often, so fewer winding numbers are evaluated.
    """
    if surface.sign == "none":
        return np.zeros(len(points), bool)
    near = np.flatnonzero((found.lower < 0.5 * reach) & (found.lower > 0))
    if not (surface.linked and len(near)):
        return is_inside(surface.mesh, points, found)
    moved = points[near] + reach[near, None] * _directions(points[near] - found.foot[near])
    there = closest_points(surface.mesh, moved.astype(points.dtype))
    apart = np.linalg.norm(moved.astype(points.dtype).astype(np.float64) - points[near], axis=1)
    # Moved points that may be on the mesh would count as outside.
    meets = _meet(apart, found.lower[near], there.lower) & (there.lower > 0)
    asked, room = points.copy(), ClosestPoints(*(x.copy() for x in found))
    asked[near[meets]] = moved[meets]
    for old, new in zip(room, there, strict=True):
        old[near[meets]] = new[meets]
    return is_inside(surface.mesh, asked, room)


def _directions(steps: np.ndarray) -> np.ndarray:
    """Vectors of at most unit length along others; zero vectors stay zero."""
    size = np.max(np.abs(steps), axis=1, keepdims=True)
    steps = steps / np.where(size > 0, size, 1.0)
    return steps / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1.0)


def _meet(apart: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether balls of these radii at distance `apart` are proven to meet despite rounding."""
    return apart * (1 + gamma(16, one.dtype)) < (one + other) * (1 - gamma(4, one.dtype))
