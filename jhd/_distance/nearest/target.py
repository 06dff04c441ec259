"""Targets of distances: shapes that find their nearest points to many queries at once, from the host.

A target answers in the user's coordinates, with bounds that are rounded outward, so callers need no normalization. It
prepares the common data of its searches (a tree, samples, a cover) once, for any number of queries.
"""

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import override

from jhd._arithmetic.rounding import gamma
from jhd._runtime.arrays import taken
from jhd._shapes.curve import BezierSegments
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.closest_point import (
    BLOCKS,
    TriangleTree,
    barycentric_of,
    closest_points,
    in_unit_again,
    in_unit_of,
    nearest_triangles,
    outward,
    pair_squares,
    point_tree,
    triangle_tree,
    triangles_within,
)


class ProvenFeet(NamedTuple):
    """Nearest points of a shape, in the user's coordinates."""

    distance: Float[np.ndarray, " points"]  # distance to the foot; infinite if there is none
    lower: Float[np.ndarray, " points"]  # proven lower bound of the distance to the whole shape
    upper: Float[np.ndarray, " points"]  # proven upper bound; infinite if no point of the shape is proven
    foot: Float[np.ndarray, "points dim"]  # a point of the shape
    segment: Int[np.ndarray, " points"]  # the part of the shape that holds it, as `element` of a Projection
    t: Float[np.ndarray, "points ..."]  # its parameters there, as in Projection
    closed: Bool[np.ndarray, " points"]  # whether the bounds meet the tolerance

    take = taken


class FootRows(NamedTuple):
    """Points of a shape, any number of them for each of some cells."""

    point: Float[np.ndarray, "*cells feet dim"]  # the points
    error: Float[np.ndarray, "*cells feet"]  # the shape has a point within this distance; infinite if none is proven
    segment: Int[np.ndarray, "*cells feet"]  # the part of the shape that holds each, as `element` of a Projection
    # Its parameters there, one column each; no columns for implicit surfaces.
    t: Float[np.ndarray, "*cells feet parameters"]

    take = taken

    def map(self, function: Any) -> "FootRows":
        """Apply a function to every array."""
        return FootRows(*(function(x) for x in self))


class Flats(NamedTuple):
    """Flat pieces: all points origin + s first + t second have a point of the shape within `sag` of them."""

    origin: Any  # of each piece, (cells, flats, 3)
    first: Any  # along s in [0, 1]
    second: Any  # along t in [0, 1]; for triangles s + t is at most one
    sag: Any  # distance to the shape; infinite if nothing is proven


class ConvexPieces(NamedTuple):
    """All convex pieces of a shape near points, any number for each point; points with too many pieces have none."""

    who: Int[np.ndarray, " pairs"]  # the point that each belongs to
    corners: Float[np.ndarray, "pairs corners 3"]  # corners of the convex pieces, (pairs, corners, 3)
    foot: Float[np.ndarray, "pairs 3"]  # approximate nearest point of each piece


class AbstractTarget(ABC):
    """A shape that distances are taken to; all its numbers are known."""

    # Number of points that are best passed together.
    block: int = BLOCKS[-1]
    # Rows for feet in a witness.
    feet_named: int = 4
    # Whether bounds always differ by the rounding error only.
    sharp: bool = True
    # Whether its flat pieces are triangles; else they are parallelograms.
    triangles: bool = False

    # Feet of neighboring points are one foot within this fraction of their distance.
    same: float = 1e-4

    @abstractmethod
    def rounding(self, distance: float) -> float:
        """Return the gap that rounding may leave between the bounds of a distance."""

    @abstractmethod
    def feet(self, points: np.ndarray) -> np.ndarray:
        """Return proven upper bounds of the distances of points (points, dim), from points of the shape near them."""

    def near(self, points: np.ndarray) -> ProvenFeet:
        """Return points of the shape near the given points, with proven upper bounds; lower bounds may be zero.

        Sharp targets return their nearest points.
        """
        return self.nearest(points)

    @abstractmethod
    def error(self, found: ProvenFeet) -> np.ndarray:
        """Return lengths within which the shape has a point of each foot found."""

    @abstractmethod
    def flats(self, feet: FootRows, corners: np.ndarray) -> Flats:
        """Return flat pieces of the shape near cells in the hulls of corners (cells, corners, 3)."""

    @abstractmethod
    def parameters(self, t: np.ndarray) -> np.ndarray:
        """Return the parameters of feet as a Witness stores them, from rows of parameters."""

    def pieces_within(self, points: np.ndarray, reach: np.ndarray) -> "ConvexPieces | None":
        """Return all convex pieces that may be within `reach` of points; None if the shape is not a union of few."""
        return None

    def rows_of(self, found: ProvenFeet) -> FootRows:
        """Return the feet of the nearest points found, in rows."""
        t = found.t.reshape(len(found.segment), -1)
        segment = np.where(np.isfinite(found.upper), found.segment, -1)
        return FootRows(found.foot, self.error(found), segment, np.where(np.isnan(t), 0.0, t))

    @abstractmethod
    def nearest(
        self, points: np.ndarray, enough: float | np.ndarray = -np.inf, close: float = 0.0, hasty: bool = False
    ) -> ProvenFeet:
        """Nearest points with proven bounds.

        Args:
            points: queries (points, dim), finite.
            enough: the bounds of a query may stay apart if its upper bound is at most this number, or its number.
            close: gap at which the bounds of a query are close enough.
            hasty: whether a query that takes long may be given up; its bounds are then wider, and not closed.
        """


class PointTarget(AbstractTarget):
    """A set of points; points of the plane lie at height zero."""

    feet_named = 2
    same = 0.0

    def __init__(self, points: BezierSegments):
        self.rows = np.asarray(points.control_points)[:, 0]
        self.tree = point_tree(in_space(self.rows))

    @override
    def rounding(self, distance: float) -> float:
        return _left(self.tree, distance)

    @override
    def feet(self, points: np.ndarray) -> np.ndarray:
        upper, row = _hinted(self.tree, in_space(points))
        return np.where(self._holds(points, self.tree.order[row]), 0.0, upper).astype(upper.dtype)

    def _holds(self, points: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Return whether queries are points of the set; then nothing about their distance is rounded."""
        return np.all(self.rows[index] == points, axis=1)

    @override
    def error(self, found: ProvenFeet) -> np.ndarray:
        return np.zeros_like(found.distance)

    @override
    def flats(self, feet: FootRows, corners: np.ndarray) -> Flats:
        """Return the points."""
        nothing = np.zeros_like(feet.point)
        return Flats(feet.point, nothing, nothing, feet.error)

    @override
    def parameters(self, t: np.ndarray) -> np.ndarray:
        """Return zeros: points have no parameters."""
        return t[:, 0]

    @override
    def pieces_within(self, points: np.ndarray, reach: np.ndarray) -> ConvexPieces:
        """Return the points."""
        who, row = _within(self.tree, in_space(points), reach)
        held = in_space(self.rows)[self.tree.order[row]]
        return ConvexPieces(who, held[:, None], held)

    @override
    def nearest(
        self, points: np.ndarray, enough: float | np.ndarray = -np.inf, close: float = 0.0, hasty: bool = False
    ) -> ProvenFeet:
        """Return nearest points with bounds that differ by the rounding error only."""
        tree, scaled = in_unit_of(self.tree, in_space(points))
        found = nearest_triangles(tree, scaled)
        distance, dtype = np.sqrt(found.square), scaled.dtype
        error, index = tree.error(distance), tree.order[found.triangle]
        error = np.where(self._holds(points, index), 0.0, error)
        return ProvenFeet(
            distance=in_unit_again(distance, tree.exponent),
            lower=outward(distance.astype(np.float64) - error, tree.exponent, dtype, -1),
            upper=outward(distance.astype(np.float64) + error, tree.exponent, dtype, 1),
            foot=self.rows[index],
            segment=index,
            t=np.zeros(len(index), dtype),
            closed=np.ones(len(index), bool),
        )


class MeshTarget(AbstractTarget):
    """A triangle mesh."""

    triangles = True

    def __init__(self, mesh: TriangleMesh):
        self.mesh, self.tree = mesh, triangle_tree(mesh)
        self._corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]

    @override
    def rounding(self, distance: float) -> float:
        return _left(self.tree, distance)

    @override
    def feet(self, points: np.ndarray) -> np.ndarray:
        return _hinted(self.tree, points)[0]

    @override
    def error(self, found: ProvenFeet) -> np.ndarray:
        """Bound the rounding error of a foot, which multiplies barycentric coordinates with corners."""
        sizes = np.max(np.abs(self._corners[found.segment]), axis=(1, 2))
        return gamma(16, sizes.dtype) * 2 * sizes

    @override
    def flats(self, feet: FootRows, corners: np.ndarray) -> Flats:
        """Return the triangles."""
        first, second, third = np.moveaxis(self._corners[feet.segment], -2, 0)
        return Flats(first, second - first, third - first, np.zeros_like(feet.error))

    @override
    def parameters(self, t: np.ndarray) -> np.ndarray:
        return t

    @override
    def pieces_within(self, points: np.ndarray, reach: np.ndarray) -> ConvexPieces:
        """Return the triangles."""
        who, row = _within(self.tree, points, reach)
        tree, scaled = in_unit_of(self.tree, points)
        corners = self._corners[tree.order[row]]
        if len(row) == 0:
            return ConvexPieces(who, corners, np.zeros((0, 3)))
        foot = np.einsum("nk,nkd->nd", barycentric_of(tree, scaled[who], row), corners)
        return ConvexPieces(who, corners, foot)

    @override
    def nearest(
        self, points: np.ndarray, enough: float | np.ndarray = -np.inf, close: float = 0.0, hasty: bool = False
    ) -> ProvenFeet:
        """Return nearest points with bounds that differ by the rounding error only."""
        found = closest_points(self.mesh, points)
        return ProvenFeet(*found, closed=np.ones(len(points), bool))


def _left(tree: TriangleTree, distance: float) -> float:
    """Return the gap that rounding may leave between bounds of a distance by a tree, in the user's unit."""
    with np.errstate(over="ignore", under="ignore"):
        error = float(np.ldexp(tree.error(np.ldexp(distance, -tree.exponent)), tree.exponent))
        return 4 * max(error, float(np.spacing(np.asarray(distance, tree.table.dtype))))


def _within(tree: TriangleTree, points: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of points and sorted triangles (or points) that may be within `reach` of them, if these are few."""
    tree, scaled = in_unit_of(tree, points)
    # Most triangles near a point that are examined one by one.
    return triangles_within(tree, scaled, np.ldexp(outward(reach, 0, scaled.dtype, 1), -tree.exponent), 32)


def _hinted(tree: TriangleTree, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return upper bounds of distances by the triangles (or points) in the grid of the tree, and their rows."""
    tree, scaled = in_unit_of(tree, points)
    row = tree.hints.at(scaled).astype(np.int32)
    distance = np.sqrt(pair_squares(tree.table, scaled, row).astype(np.float64))
    return outward(distance + tree.error(distance), tree.exponent, points.dtype, 1), row


def in_space(points: np.ndarray) -> np.ndarray:
    """Return points of the plane as points of space with last coordinate zero; other points unchanged."""
    return points if points.shape[1] == 3 else np.concatenate([points, np.zeros_like(points[:, :1])], axis=1)


def curve_in_space(curve: BezierSegments) -> BezierSegments:
    """Return a plane curve with known numbers as a space curve with last coordinate zero; others unchanged."""
    if curve.dim == 3:
        return curve
    points = np.asarray(curve.control_points)
    weights = None if curve.weights is None else np.asarray(curve.weights)
    return BezierSegments(np.concatenate([points, np.zeros_like(points[..., :1])], axis=-1), weights)
