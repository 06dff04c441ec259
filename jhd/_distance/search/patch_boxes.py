"""A tree of oriented boxes of parts of patches: which parts of a surface may be near points, for many points at once.

Every piece is a node. Above the pieces lie boxes of eight nodes each; below them lie parts between halves of their
parameters. A box has the directions of its part, so its thickness is of second order in the size of the part. A node is
cut when points first need its parts, and the parts stay for later points. The same tree serves curves.

Rounding, for coordinates of at most one. The axes are divided by a bound of their largest singular value, so the image
of a vector is no longer than the vector, even if the axes are not orthonormal. Half sides are enlarged by errors of the
control points and of their projections. The projection of a point errs by gamma(4) of its size; `near` subtracts that.

Source: Gottschalk, Lin & Manocha, OBBTree, SIGGRAPH (1996). Directions from patches and cuts on demand are ours.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import length, unit
from jhd._distance.cells.arc_length_area import off_by, restricted
from jhd._distance.normalization.net_jets import Net
from jhd._runtime.arrays import joined, taken
from jhd._triangles.box_tree import WIDTH, box_tree

# Nodes are cut for at least this many pairs of points and nodes; for fewer the calls cost more than they save.
_WORTH = 8
# Parts are not cut below this size in a parameter: about a half of the smallest box that is settled about a foot.
_SMALLEST = 2.0**-8
# Largest number of nodes: 12 MB.
_MOST = 1 << 16
# A point with more nodes on one level keeps these: near a center of curvature all parts stay, however small they are.
_CROWD = 16
# Points that descend together: their pairs fit into the cache of a processor.
_TOGETHER = 4096
# Sine of the angle between two sides below which their directions count as one.
_PARALLEL = 1e-6
# More than the roundings of each step here.
_ROUNDINGS = gamma(16, np.float64)


class PieceParts(NamedTuple):
    """Parts of pieces, each for one point: point, piece, ends of the parameters, certified lower bound."""

    who: Int[np.ndarray, " cells"]
    piece: Int[np.ndarray, " cells"]
    low: Float[np.ndarray, "cells parameters"]
    high: Float[np.ndarray, "cells parameters"]
    lower: Float[np.ndarray, " cells"]

    take = taken


class SettledParts(NamedTuple):
    """One part of a piece for each point, whose distance is already bounded: piece (-1 for none) and ends."""

    piece: Int[np.ndarray, " points"]
    low: Float[np.ndarray, "points parameters"]
    high: Float[np.ndarray, "points parameters"]

    @classmethod
    def nothing(cls, points: np.ndarray, parameters: int) -> "SettledParts":
        """Return no part for each point."""
        low, high = np.zeros((2, len(points), parameters), points.dtype)
        return cls(np.full(len(points), -1), low, high)


class _PartNodes(NamedTuple):
    """Piece (-1 above pieces), ends, box (axes, middle and half sides along them), first child (or -1), children."""

    piece: np.ndarray
    low: np.ndarray
    high: np.ndarray
    box: np.ndarray
    first: np.ndarray
    children: np.ndarray


class PatchBoxes:
    """The tree of a net.

    Args:
        net: the pieces, without repetitions, with coordinates and weights of at most one.
    """

    def __init__(self, net: Net):
        points = np.asarray(net.points, np.float64)
        weights = np.ones(points.shape[:-1]) if net.weights is None else np.asarray(net.weights, np.float64)
        self._rows = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
        self._off = off_by(net.degrees) + gamma(4, np.float64)
        order = box_tree(points.reshape(len(points), -1, 3)).order
        ends = np.zeros((len(points), net.parameters))
        self._nodes = _uncut(order, ends, ends + 1, points[order], np.zeros(len(points)))
        self._top = np.arange(len(points))
        low, high = (f(points, axis=(1, 2))[order] for f in (np.min, np.max))
        while len(self._top) > WIDTH:
            starts = np.arange(0, len(self._top), WIDTH)
            low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
            box = _boxes(np.stack([low, high], axis=1), np.eye(3)[None], np.zeros(len(starts)))
            children = np.diff(np.append(starts, len(self._top)))
            nothing = np.full(len(starts), -1), ends[: len(starts)], ends[: len(starts)]
            above = _PartNodes(*nothing, box, self._top[starts], children)
            self._top = len(self._nodes.piece) + np.arange(len(starts))
            self._nodes = joined([self._nodes, above])

    def near(
        self,
        points: Float[np.ndarray, "points 3"],
        upper: Float[np.ndarray, " points"],
        power: int = 0,
        settled: SettledParts | None = None,
        goal: Float[np.ndarray, " points"] | None = None,
    ) -> PieceParts:
        """Return all parts of pieces within some distance of points, except settled parts.

        Points with a settled part get small parts, other points get whole pieces.

        Args:
            points: the points.
            upper: the distances.
            power: points and distances are in a unit that is larger by this power of two.
            settled: the parts to leave out.
            goal: parts with a lower bound of at least this are not cut; by default `upper`.
        """
        settled = SettledParts.nothing(points, self._nodes.low.shape[1]) if settled is None else settled
        goal = upper if goal is None else goal
        points = points.astype(np.float64)
        off = 2 * _ROUNDINGS * (1 + np.max(np.abs(points), axis=1))
        found = []
        for start in range(0, len(points), _TOGETHER):
            rows = slice(start, start + _TOGETHER)
            part = taken(settled, rows)
            cells = self._descend(points[rows], off[rows], upper[rows], goal[rows], part, power)
            found += [x._replace(who=x.who + start) for x in cells]
        return joined(found)

    def _descend(
        self,
        points: np.ndarray,
        off: np.ndarray,
        upper: np.ndarray,
        goal: np.ndarray,
        settled: SettledParts,
        power: int,
    ) -> list[PieceParts]:
        """Return the parts near points, from the top nodes down; only points with a settled part get cut pieces."""
        who, node = np.repeat(np.arange(len(points)), len(self._top)), np.tile(self._top, len(points))
        found = []
        while True:
            lower = np.maximum(_distances(self._nodes.box[node], points[who], power) - off[who], 0.0)
            piece, low, high = (x[node] for x in self._nodes[:3])
            left = (piece == settled.piece[who]) & (piece >= 0)
            for k in range(low.shape[1]):
                left &= (low[:, k] >= settled.low[who, k]) & (high[:, k] <= settled.high[who, k])
            left = np.flatnonzero(~left & (lower <= upper[who]))
            who, node = who[left], node[left]
            cells = PieceParts(who, *(x[left] for x in (piece, low, high, lower)))
            cut = (settled.piece[who] >= 0) & (cells.lower < goal[who])
            cut &= np.bincount(who, minlength=len(points))[who] <= _CROWD
            cut &= cells.high[:, 0] - cells.low[:, 0] > _SMALLEST
            self._cut(node[cut & (self._nodes.first[node] < 0)])
            first = self._nodes.first[node]
            cut = (cut | (cells.piece < 0)) & (first >= 0)
            found.append(cells.take(~cut))
            if not np.any(cut):
                return found
            children = self._nodes.children[node[cut]]
            number = np.arange(np.sum(children)) - np.repeat(np.cumsum(children) - children, children)
            who, node = np.repeat(who[cut], children), np.repeat(first[cut], children) + number

    def _cut(self, node: np.ndarray) -> None:
        """Add the parts of nodes; nodes may be repeated."""
        if len(node) < _WORTH:
            return
        held, parameters = len(self._nodes.piece), self._nodes.low.shape[1]
        children = 1 << parameters
        node = np.unique(node)[: max(0, _MOST - held) // children]
        if not len(node):
            return
        piece, low, high = (np.repeat(x[node], children, axis=0) for x in self._nodes[:3])
        above = np.tile(np.indices((2,) * parameters).reshape(parameters, -1).T == 1, (len(node), 1))
        middle = 0.5 * (low + high)
        nodes = joined([self._nodes, self._parts(piece, np.where(above, middle, low), np.where(above, high, middle))])
        nodes.first[node], nodes.children[node] = held + children * np.arange(len(node)), children
        self._nodes = nodes

    def _parts(self, piece: np.ndarray, low: np.ndarray, high: np.ndarray) -> _PartNodes:
        """Return the parts as nodes; a part with a weight that rounding may have changed much has an infinite box."""
        rows = restricted(self._rows[piece], low, high)
        least = np.min(rows[..., 3], axis=(1, 2))
        good = least > 4 * self._off
        points = rows[..., :3] / np.where(good[:, None, None, None], rows[..., 3:], 1.0)
        off = np.where(good, 3 * self._off / np.where(good, least, 1.0), np.inf)
        return _uncut(piece, low, high, points, off)


def _uncut(piece: np.ndarray, low: np.ndarray, high: np.ndarray, points: np.ndarray, off: np.ndarray) -> _PartNodes:
    """Return nodes without children, from control points (parts, rows, columns, 3) with errors of at most `off`."""
    rows = points.reshape(len(points), -1, 3)
    box, straight = (_boxes(rows, axes, off) for axes in (_axes(points), np.eye(3)[None]))
    # Boxes along the coordinates fit parts that are symmetric in them, such as octants of spheres.
    smaller = np.prod(straight[:, 12:], axis=1) < np.prod(box[:, 12:], axis=1)
    box = np.where(smaller[:, None], straight, box)
    return _PartNodes(piece, low, high, box, np.full(len(piece), -1), np.zeros(len(piece), int))


def _axes(points: np.ndarray) -> np.ndarray:
    """Return unit vectors (parts, 3, 3) along the longer side of parts, across it, and normal to both."""
    start, right, up, end = (points[:, i, j] for i, j in ((0, 0), (0, -1), (-1, 0), (-1, -1)))
    a, b = up + end - start - right, right + end - start - up
    longer = (length(a) >= length(b))[:, None]
    a, b = unit(np.where(longer, a, b)), unit(np.where(longer, b, a))
    a = np.where(np.any(a != 0, axis=1, keepdims=True), a, np.eye(3)[0])
    other = np.eye(3)[np.argmin(np.abs(a), axis=1)]
    b, other = (x - np.sum(x * a, axis=1, keepdims=True) * a for x in (b, other))
    b = unit(np.where(length(b)[:, None] > _PARALLEL, b, other))
    return np.stack([a, b, np.cross(a, b)], axis=1)


def _boxes(points: np.ndarray, axes: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return boxes (parts, 15) with these axes about points (parts, points, 3), with errors up to `off`."""
    square = np.max(np.sum(np.abs(axes @ np.swapaxes(axes, 1, 2)), axis=2), axis=1) + _ROUNDINGS
    axes = axes / (np.sqrt(square) * (1 + _ROUNDINGS))[:, None, None]
    along = points @ np.swapaxes(axes, 1, 2)
    low, high = np.min(along, axis=1), np.max(along, axis=1)
    half = 0.5 * (high - low) + 2 * (off[:, None] + _ROUNDINGS)
    axes = np.broadcast_to(axes.reshape(-1, 9), (len(points), 9))
    return np.concatenate([axes, 0.5 * (low + high), half], axis=1)


def _distances(box: np.ndarray, points: np.ndarray, power: int) -> np.ndarray:
    """Return distances of points (pairs, 3) from boxes (pairs, 15), rounded down but for errors of projections."""
    middle, half = (np.ldexp(x, -power) if power else x for x in (box[:, 9:12], box[:, 12:]))
    along = np.einsum("nxd,nd->nx", box[:, :9].reshape(-1, 3, 3), points)
    apart = np.ascontiguousarray(np.maximum(np.abs(along - middle) - half, 0.0).T)
    # Squares of distances from far away would overflow.
    size = np.max(apart, axis=0)
    apart /= np.where(size > 0, size, 1.0)
    return size * np.sqrt(apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2) * (1 - _ROUNDINGS)
