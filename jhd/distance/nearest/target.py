"""What distances are taken to: shapes that know their nearest points, for many queries at once, from the host.

A target answers in the user's coordinates, with bounds that are rounded outward, so whoever asks needs no frame. It
prepares once what its searches share (a tree, samples, a cover), and can be asked as often as one likes.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jhd.shapes.curve import BezierSegments
from jhd.shapes.mesh import TriangleMesh
from jhd.triangles.closest_point import (
    BLOCKS,
    TriangleTree,
    closest_points,
    in_unit_of,
    nearest_triangles,
    outward,
    pair_squares,
    point_tree,
    triangle_tree,
)


class ProvenFeet(NamedTuple):
    """Nearest points of a shape, in the user's coordinates.

    Args:
        distance: to the foot; infinite where there is none.
        lower: proven lower bound of the distance to the whole shape.
        upper: proven upper bound; infinite where no point of the shape is proven.
        foot: a point of the shape.
        segment: the part of the shape that holds it, as in Projection.
        t: its parameters there, as in Projection.
        closed: whether the bounds are as close as they should be.
    """

    distance: Float[np.ndarray, " points"]
    lower: Float[np.ndarray, " points"]
    upper: Float[np.ndarray, " points"]
    foot: Float[np.ndarray, "points dim"]
    segment: Int[np.ndarray, " points"]
    t: Float[np.ndarray, "points ..."]
    closed: Bool[np.ndarray, " points"]


class AbstractTarget(ABC):
    """A shape that distances are taken to; all its numbers are known."""

    # Points that are best asked for together.
    block: int = BLOCKS[-1]
    # Rows for feet in a witness.
    feet_named: int = 4
    # Whether bounds are always those of rounding.
    sharp: bool = True

    @abstractmethod
    def rounding(self, distance: float) -> float:
        """The gap that bounds of a distance may keep, by rounding."""

    @abstractmethod
    def feet(self, points: np.ndarray) -> np.ndarray:
        """Proven upper bounds of the distances of points (points, dim), those of points of the shape near them."""

    @abstractmethod
    def nearest(self, points: np.ndarray, enough: float = -np.inf) -> ProvenFeet:
        """Nearest points with proven bounds.

        Args:
            points: queries (points, dim), finite.
            enough: the bounds of a query may stay apart where its upper one is at most this.
        """


class PointTarget(AbstractTarget):
    """A set of points; those of the plane lie at height zero."""

    feet_named = 2

    def __init__(self, points: BezierSegments):
        self.rows = np.asarray(points.control_points)[:, 0]
        self.tree = point_tree(in_space(self.rows))

    def rounding(self, distance: float) -> float:
        """See AbstractTarget."""
        return _left(self.tree, distance)

    def feet(self, points: np.ndarray) -> np.ndarray:
        """See AbstractTarget."""
        upper, row = _hinted(self.tree, in_space(points))
        return np.where(self._holds(points, self.tree.order[row]), 0.0, upper).astype(upper.dtype)

    def _holds(self, points: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Whether queries are points of the set; then nothing about their distance is rounded."""
        return np.all(self.rows[index] == points, axis=1)

    def nearest(self, points: np.ndarray, enough: float = -np.inf) -> ProvenFeet:
        """See AbstractTarget: the bounds are always those of rounding."""
        tree, scaled = in_unit_of(self.tree, in_space(points))
        found = nearest_triangles(tree, scaled)
        distance, dtype = np.sqrt(found.square), scaled.dtype
        error, index = tree.error(distance), tree.order[found.triangle]
        error = np.where(self._holds(points, index), 0.0, error)
        return ProvenFeet(
            distance=np.ldexp(distance, tree.exponent),
            lower=outward(distance.astype(np.float64) - error, tree.exponent, dtype, -1),
            upper=outward(distance.astype(np.float64) + error, tree.exponent, dtype, 1),
            foot=self.rows[index],
            segment=index,
            t=np.zeros(len(index), dtype),
            closed=np.ones(len(index), bool),
        )


class MeshTarget(AbstractTarget):
    """A triangle mesh."""

    def __init__(self, mesh: TriangleMesh):
        self.mesh, self.tree = mesh, triangle_tree(mesh)

    def rounding(self, distance: float) -> float:
        """See AbstractTarget."""
        return _left(self.tree, distance)

    def feet(self, points: np.ndarray) -> np.ndarray:
        """See AbstractTarget."""
        return _hinted(self.tree, points)[0]

    def nearest(self, points: np.ndarray, enough: float = -np.inf) -> ProvenFeet:
        """See AbstractTarget: the bounds are always those of rounding."""
        found = closest_points(self.mesh, points)
        return ProvenFeet(*found, closed=np.ones(len(points), bool))


def _left(tree: TriangleTree, distance: float) -> float:
    """What the bounds of a distance by a tree may be apart, in the user's unit: their error, or their own rounding."""
    with np.errstate(over="ignore", under="ignore"):
        error = float(np.ldexp(tree.error(np.ldexp(distance, -tree.exponent)), tree.exponent))
        return 4 * max(error, float(np.spacing(np.asarray(distance, tree.table.dtype))))


def _hinted(tree: TriangleTree, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Upper bounds of distances by the triangles, or points, that the tree's grid names, and their rows there."""
    tree, scaled = in_unit_of(tree, points)
    row = tree.hints.at(scaled).astype(np.int32)
    distance = np.sqrt(pair_squares(tree.table, scaled, row).astype(np.float64))
    return outward(distance + tree.error(distance), tree.exponent, points.dtype, 1), row


def in_space(points: np.ndarray) -> np.ndarray:
    """Points of the plane as points of space, of which the last coordinate is zero; others as they are."""
    return points if points.shape[1] == 3 else np.concatenate([points, np.zeros_like(points[:, :1])], axis=1)
