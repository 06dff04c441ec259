"""Integrals of the distance to b over a surface, differentiable, with errors estimated by two refinements.

Cells of the parameters are halved until a rule over a cell and over its parts agree on all integrals: area, distance,
its square, and the direction away from the foot. This direction jumps where the foot jumps, as derivatives of the
distance do, so the derivatives are as accurate as the cells. Rules are cut in cells with feet of several labels, and in
cells that do not agree after some halvings: a crease is assumed to cross these.
"""

from typing import NamedTuple

import numpy as np

from jhd._distance.normalization.net_jets import Net
from jhd._distance.statistics.cut_cells import CellNodes, Looked, cut_at_kinks
from jhd._distance.statistics.pointwise import Seen, Sight
from jhd._distance.statistics.quadrature import Nodes, ParameterCells, halved, nodes_of, whole
from jhd._runtime.arrays import joined

# Nodes of the rule along each parameter.
_RULE = 6
# Halvings before all rules are cut, and in all.
_PLAIN, _HALVINGS = 5, 16
# No label.
_SEVERAL = -1


class _Rule(NamedTuple):
    """Rules over cells."""

    places: CellNodes  # all nodes
    values: np.ndarray  # integrals over each cell
    label: np.ndarray  # label of the feet, or _SEVERAL
    smooth: np.ndarray  # whether the integrand is smooth in each part of the cells

    def of(self, cells: np.ndarray) -> "_Rule":
        return _Rule(self.places.of(cells), *(x[cells] for x in self[1:]))


def resolved_on_surface(net: Net, sight: Sight) -> tuple[Nodes, float] | None:
    """Return nodes over a surface with factors, and the relative difference between rules over cells and over parts.

    None if even rules over whole pieces need more nodes than allowed.

    Args:
        net: the pieces, known.
        sight: the distances to the other shape.
    """
    looked = Looked(net, sight)
    cells = whole(net)
    if 5 * len(cells.piece) * _RULE**2 > sight.most:
        return None
    known = _ruled(cells, looked, 0)
    done, total = [], np.abs(np.sum(known.values, axis=0))
    # A cell is done if rules over it and its parts differ by this fraction of the integral, or by its rounding error.
    close = max(1e-8, 64 * float(np.finfo(net.points.dtype).eps))
    labels, off = set(known.label.tolist()), np.inf
    for step in range(_HALVINGS):
        finer = halved(cells)
        parts = _ruled(finer, looked, step + 1)
        labels.update(parts.label.tolist())
        both = np.sum(parts.values.reshape(len(cells.piece), 4, -1), axis=1)
        total = np.maximum(total, np.abs(np.sum(parts.values, axis=0)))
        # Of directions the components may cancel: they are as large as the area.
        largest = np.where(np.arange(len(total)) < 3, total, total[0])
        agreed = np.all(np.abs(both - known.values) <= close * largest, axis=1)
        agreed &= np.all(parts.smooth.reshape(-1, 4), axis=1)
        agreed &= ~_overlooked(finer, parts, looked, agreed, labels)
        left = np.sum(np.abs(both - known.values)[~agreed], axis=0)
        off = float(np.max(left / np.where(largest > 0, largest, 1.0)))
        agreed = np.repeat(agreed, 4)
        done.append(parts.of(agreed).places.nodes)
        cells, known = finer.take(~agreed), parts.of(~agreed)
        if len(cells.piece) == 0 or looked.count > sight.most:
            break
    return joined([*done, known.places.nodes]), off


def _ruled(cells: ParameterCells, looked: Looked, step: int) -> _Rule:
    """Return rules over cells, cut if several branches of the distance are seen, or everywhere."""
    count = len(cells.piece)
    nodes = nodes_of(cells, _RULE)
    seen = looked.at(nodes)
    plain = CellNodes(nodes, np.repeat(np.arange(count), _RULE**2))
    values = plain.sums(_integrands(nodes, seen), count)
    labeled, turned = _kinked(seen, count)
    label = np.where(labeled, _SEVERAL, seen.label[:: _RULE**2])
    several, smooth = labeled | turned | (step > _PLAIN), np.ones(count, bool)
    if not np.any(several):
        return _Rule(plain, values, label, smooth)
    across = _across(seen, cells)[several]
    found = cut_at_kinks(cells.take(several), looked, across, ~labeled[several], step)
    inside, smooth[several] = found
    values[several] = inside.sums(_integrands(inside.nodes, looked.at(inside.nodes)), len(across))
    rest, number = plain.of(~several), np.arange(count)
    nodes = joined([rest.nodes, inside.nodes])
    cell = np.concatenate([number[~several][rest.cell], number[several][inside.cell]])
    return _Rule(CellNodes(nodes, cell), values, label, smooth)


def _overlooked(cells: ParameterCells, rule: _Rule, looked: Looked, agreed: np.ndarray, labels: set[int]) -> np.ndarray:
    """Return whether from the borders of a cell's four parts a label is seen that no node of the rules there sees."""
    rows = np.flatnonzero(np.repeat(agreed, 4) & (rule.label != _SEVERAL))
    if len(labels) < 2 or len(rows) == 0:
        return np.zeros(len(agreed), bool)
    low, size = cells.low[rows], cells.high[rows] - cells.low[rows]
    # In cells that see one label, this many points along the border of a piece are searched for another label.
    each = max(2, round(128 * float(np.max(size))))
    share, one = (np.arange(each) + 0.5) / each, np.ones(each)
    sides = [(share, 0 * one), (share, one), (0 * one, share), (one, share)]
    border = np.concatenate([np.stack(side, axis=1) for side in sides])
    count = len(border)
    t = (low[:, None] + size[:, None] * border).reshape(-1, 2)
    label = looked.at(Nodes(np.repeat(cells.piece[rows], count), t, np.ones(len(t)))).label
    other = np.any(label.reshape(-1, count) != rule.label[rows, None], axis=1)
    found = np.zeros(len(cells.piece), bool)
    found[rows] = other
    return np.any(found.reshape(-1, 4), axis=1)


def _kinked(seen: Seen, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return whether feet of several labels, and whether feet on both sides, are seen from the nodes of each cell."""
    label, normal = seen.label.reshape(count, -1), seen.normal.reshape(count, _RULE**2, -1)
    turned = np.sum(normal * normal[:, :1], axis=2) < 0
    return np.any(label != label[:, :1], axis=1), np.any(turned, axis=1)


def _across(seen: Seen, cells: ParameterCells) -> np.ndarray:
    """Return the parameter along which labels change most often, else the one along which slopes differ most."""
    count = len(cells.piece)
    label = seen.label.reshape(count, _RULE, _RULE)
    changes = [np.sum(np.diff(label, axis=1 + k) != 0, axis=(1, 2)) for k in (0, 1)]
    slope = (seen.slope.reshape(count, -1, 2) * (cells.high - cells.low)[:, None])[:, [0, _RULE - 1, -_RULE, -1]]
    apart = np.abs(slope[:, :, None] - slope[:, None]).reshape(count, 16, 2)
    most = apart[np.arange(count), np.argmax(np.sum(apart, axis=2), axis=1)]
    return np.where(changes[0] == changes[1], most[:, 1] > most[:, 0], changes[1] > changes[0]).astype(int)


def _integrands(nodes: Nodes, seen: Seen) -> np.ndarray:
    """Return 1, the distance, its square and the direction away from the foot, times the weight of each node."""
    columns = [np.ones_like(seen.distance), seen.distance, seen.distance**2, *seen.normal.T]
    return np.stack(columns, axis=1) * (nodes.factor * seen.density)[:, None]
