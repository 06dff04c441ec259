"""Bounds over cells by feet that are followed over them, if one of the shapes is an implicit surface.

The feet lie on pieces of the other shape, or on the surface itself (jhd._distance.cells.tracked_feet_surfaces). In a
cell that it crosses in one sheet, an implicit surface is close to a polynomial graph, with a proven distance
(jhd._distance.cells.graphs). The graph is a piece of a parametric surface, and is bounded like one, cuts included.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import unit_roundoff
from jhd._distance.cells.foot_maps import Triangles
from jhd._distance.cells.graphs import beside_graph, control_points, graph_over, values_on_graph
from jhd._distance.cells.tracked_feet_nets import points_of_net
from jhd._distance.cells.tracked_feet_surfaces import distance_to_surface
from jhd._distance.nearest.forms import boxes, form
from jhd._distance.nearest.target import AbstractTarget, FootRows
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.followed_cells import FollowedFeet
from jhd._distance.search.polished_place import PlaceOnPiece
from jhd._distance.search.row_batches import BLOCK, each, in_blocks, in_groups
from jhd._distance.search.sources import CellRows
from jhd._runtime.compiled import compiled

# Cells processed in one batch.
_LANES = 64
# A graph is used if it is this close, as a fraction of the size of the cell.
_CLOSE = 1e-2
# Feet are followed on a surface if there are this many cells in all and for each piece: usually fewer are left, and
# compiling takes twelve seconds.
_MANY, _OF_EACH = 256, 16
# Half the sides of boxes about a point whose graph is computed, as fractions of the box of the surface.
_ABOUT = 2.0 ** -np.arange(15.0, 5, -3)


class FollowedGraphs:
    """Bounds between an implicit surface and a shape of pieces, in common coordinates.

    Args:
        side: the surface whose cells are bounded.
        b: the other shape: a net, or the corners of triangles.
        target: finds nearest points of `b`.
    """

    def __init__(self, side: Side, b: Net | Triangles, target: AbstractTarget):
        self._side = side
        dtype = np.asarray(side.lower).dtype
        # A placeholder for the graphs of a block.
        none: Any = Net(jnp.zeros((1, 1, 1, 3), dtype), None)
        self._feet = FollowedFeet(none, b, target)

    def over(self, cells: CellRows, feet: FootRows, goal: float) -> np.ndarray:
        """Proven upper bounds of the distances of all points in cells, from their feet; see FollowedFeet.over.

        They are infinite if the surface is not close to a graph.
        """
        points, beside = in_blocks(_graphs, self._side, cells.low, cells.high)
        size = np.max(cells.high - cells.low, axis=1)
        bound = np.full(len(size), np.inf)
        good = np.flatnonzero(beside <= _CLOSE * size)
        for rows in (good[k : k + BLOCK] for k in range(0, len(good), BLOCK)):
            count, away = len(rows), beside[rows].astype(np.float64)
            net = Net(points[np.concatenate([rows, np.full(BLOCK - count, rows[-1])])], None)
            ends = np.zeros((count, 2), points.dtype)
            parts = CellRows(np.arange(count), ends, ends + 1)
            found = self._feet.instead(net).over(parts, feet.take(rows), goal - away)
            bound[rows] = (found + away) * (1 + 4 * unit_roundoff(np.float64))
        return bound


def places_on_graphs(side: Side, b: Any, found: Any) -> list[PlaceOnPiece]:
    """Return a point of the surface as points on nearby graphs, with the other shape; see PlaceOnPiece.

    Smaller graphs are closer to the surface, and cover less of it.
    """
    lower, upper, x = np.asarray(side.lower), np.asarray(side.upper), found.point
    half = (_ABOUT * np.max(upper - lower)).astype(lower.dtype)[:, None]
    low, high = np.maximum(x - half, lower), np.minimum(x + half, upper)
    points, beside = in_blocks(_graphs, side, low, high)
    close = np.flatnonzero(beside <= _CLOSE * half[:, 0])
    # The compiled functions take one graph.
    return [PlaceOnPiece((Net(points[[k]], None), b), 0, _parameters(points[k], low[k], high[k], x)) for k in close]


def _parameters(points: np.ndarray, low: np.ndarray, high: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the parameters of a graph at a point of the box; two coordinates depend linearly on one parameter each."""
    ends = [(points[0, 0], points[-1, 0]), (points[0, 0], points[0, -1])]
    # The coordinate that goes from end to end of the box.
    axes = [np.argmin(np.abs(first - low) + np.abs(last - high)) for first, last in ends]
    return np.array([(place[k] - low[k]) / (high[k] - low[k]) for k in axes], points.dtype)


@compiled
def _graphs(side: Side, count: Array, low: Array, high: Array) -> Any:
    """Return control points (cells, degree + 1, degree + 1, 3) of graphs, and bounds of their errors."""

    def group(low: Array, high: Array) -> tuple[Array, Array]:
        cells = boxes(low.T, high.T)
        over = graph_over(form(side, cells), side, cells)
        points, off = control_points(over)
        beside = (beside_graph(over.graph, over.on, values_on_graph(over.on)) + off) * (
            1 + 8 * unit_roundoff(low.dtype)
        )
        points = jnp.moveaxis(points, -1, 0)
        good = jnp.isfinite(beside) & jnp.all(jnp.isfinite(points), axis=(1, 2, 3))
        return jnp.where(good[:, None, None, None], points, 0.0), jnp.where(good, beside, jnp.inf)

    return in_groups(group, count, (low, high), _LANES)


class FollowedOnSurface:
    """Bounds between a parametric shape and an implicit surface, in common coordinates.

    Args:
        net: the shape whose cells are bounded.
        side: the surface.
    """

    def __init__(self, net: Net, side: Side):
        self._shapes = net, side

    def over(self, cells: CellRows, feet: FootRows, goal: float) -> np.ndarray:
        """Return proven upper bounds of the distances of all points in cells; see cells.tracked_feet_surfaces.

        They are off by the eighth order of the size of a cell if the distance is constant. They cost much, and are
        infinite unless there are many cells of each piece.
        """
        if len(cells.piece) < max(_MANY, _OF_EACH * len(np.unique(cells.piece))):
            return np.full(len(cells.piece), np.inf)
        start = feet.point[:, 0].astype(cells.low.dtype)
        return in_blocks(_distances, self._shapes, *cells[:3], start).astype(np.float64)


@compiled
def _distances(shapes: tuple[Net, Side], count: Array, piece: Array, low: Array, high: Array, start: Array) -> Array:
    net, side = shapes

    def one(piece: Array, low: Array, high: Array, start: Array) -> Array:
        return distance_to_surface(side, points_of_net(net.piece(piece), low, high).point, start)

    return each(one, count, (piece, low, high, start), _LANES)
