"""Quantiles of the distance over a surface, with derivatives: levels below which a fraction of its area lies.

With M(Q) the area of the part with d <= Q and L the whole area, the quantile solves M(Q) = q L. The curve d = Q moves
with the shapes by the change of d over its slope. So each point at which a line of a cut rule crosses the level counts
with w = density / slope, and dQ = (q dL - dM + sum w dd) / sum w, where dM is the derivative of the area below at fixed
parameters, as along curves (jhd._distance.statistics.quantiles). Only cells that the level may cross are examined
closely: the distance changes by no more than the point moves.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.normalization.net_jets import Net
from jhd._distance.statistics.cut_cells import CellNodes, Looked
from jhd._distance.statistics.error_control import Estimated
from jhd._distance.statistics.level_cuts import cut_at_level
from jhd._distance.statistics.pointwise import Sight
from jhd._distance.statistics.quadrature import Nodes, ParameterCells, along, halved, known_along, nodes_of, whole
from jhd._distance.statistics.quantiles import quantile_beside, quantile_of
from jhd._runtime.arrays import joined, undifferentiated

# Places of the rule along each parameter where no curve cuts, and halvings of pieces to begin with at most.
_RULE, _FIRST = 6, 3
# How far the share of the area and the density of the level may be off in each of Newton's steps.
_OFF = ((1e-3, 1e-2), (1e-6, 1e-3), *((1e-10, 1e-8),) * 5)
# More than this many times that is surely off; and what may be missing of the share in the end.
_SURE, _REACHED = 10.0, 1e-7
# What rounding leaves of these, in units of roundoff.
_ROUNDINGS = 64
# Halvings of a cell in each.
_HALVINGS = 14
# Cells may be this much larger than the places of a rule in them say.
_BULGE = 1.1
# The level is none where the share below it is off by this in the end: a whole region is as far.
_PLATEAU = 1e-4


class _MeasuredCells(NamedTuple):
    """Cells with their areas, the distance from their middles, and how far these are from any place in them."""

    cells: ParameterCells
    area: np.ndarray
    distance: np.ndarray
    radius: np.ndarray

    def passed(self, level: float) -> np.ndarray:
        """Whether the level may pass each."""
        return np.abs(self.distance - level) <= self.radius


class _Below(NamedTuple):
    """What lies below a level.

    Args:
        area: of it.
        slope: the change of the area with the level.
        inside: places and factors over all that lies below.
        met: places on the level, with the factor that each counts with.
        off: by what rules over cells still differ from those over their parts, as a share.
    """

    area: float
    slope: float
    inside: list[Nodes]
    met: list[Nodes]
    off: float


def quantile_over(net: Net, sight: Sight, b: Any, q: float) -> Estimated | None:
    """The quantile over a surface, None where there are too many pieces.

    Where a whole region is as far, the derivative is that of the places there.

    Args:
        net: the pieces of the surface, differentiable.
        sight: of the other shape.
        b: the other shape, differentiable.
        q: the share.
    """
    known: Net = undifferentiated(net)
    looked = Looked(known, sight)
    first = whole(known)
    if 5 * len(first.piece) * _RULE**2 > sight.most:
        return None
    for _ in range(_FIRST):
        if 4 * len(first.piece) * _RULE**2 <= sight.most / 8:
            first = halved(first)
    everywhere = nodes_of(first, _RULE)
    base = _looked_at(first, looked)
    weight = everywhere.factor * known_along(known, everywhere)[1]
    at = looked.at(everywhere)
    level, total = quantile_of(at.distance, weight, q)[1], float(np.sum(weight))
    low, high = float(np.min(base.distance - base.radius)), float(np.max(base.distance + base.radius))
    below, passed = None, False
    least = _ROUNDINGS * float(np.finfo(net.points.dtype).eps)
    # At level zero what lies on it has no slope.
    for off in _OFF if level > 0 else ():
        below = _below(base, looked, level, (max(off[0], least), max(off[1], least)), total)
        passed = below.slope > 0 and bool(np.isfinite(below.slope))
        if not passed:
            break
        missing = q * total - below.area
        low, high = max(low, level) if missing > _SURE * off[0] * total else low, high
        high = min(high, level) if missing < -_SURE * off[0] * total else high
        level = float(np.clip(level + missing / below.slope, low, high))
        if off == _OFF[-1] and (abs(missing) <= _REACHED * total or looked.count > 2 * sight.most):
            break
    missing = np.inf if below is None else abs(below.area - q * total) / total
    if below is None or not passed or missing > _PLATEAU:
        points, density, _ = along(net, everywhere)
        found = quantile_beside(sight.moving(points, b), jnp.asarray(everywhere.factor) * density, q)
        return found._replace(off=0.0 if missing > _PLATEAU else np.inf)
    inside, met = (joined(x) for x in (below.inside, below.met))
    points, *_ = along(net, met)
    change = q * _area(net, everywhere) - _area(net, inside) + jnp.sum(met.factor * sight.moving(points, b))
    return Estimated(level + (change - jax.lax.stop_gradient(change)) / below.slope, max(below.off, missing))


def _area(net: Net, nodes: Nodes) -> Array:
    return jnp.sum(nodes.factor * along(net, nodes)[1])


def _looked_at(cells: ParameterCells, looked: Looked) -> _MeasuredCells:
    count, nodes = len(cells.piece), nodes_of(cells, _RULE)
    points, density, _ = known_along(looked.net, nodes)
    middle = Nodes(cells.piece, 0.5 * (cells.low + cells.high), np.ones(count))
    apart = points.reshape(count, -1, points.shape[1]) - known_along(looked.net, middle)[0][:, None]
    radius = _BULGE * np.sqrt(np.max(np.sum(apart**2, axis=2), axis=1))
    area = np.sum((nodes.factor * density).reshape(count, -1), axis=1)
    return _MeasuredCells(cells, area, looked.at(middle).distance, radius)


class _LevelCells(NamedTuple):
    """Rules over cells that a level may cut.

    Args:
        values: of each, the area below the level, its change with it, and that times the directions from the feet.
        inside: places of the rule that lie below.
        met: places where lines pass the level.
        settled: whether what is summed is smooth in each part of a cell.
    """

    values: np.ndarray
    inside: CellNodes
    met: CellNodes
    settled: np.ndarray

    def take(self, rows: np.ndarray) -> "_LevelCells":
        """Those of some cells, given by a mask."""
        return _LevelCells(self.values[rows], self.inside.of(rows), self.met.of(rows), self.settled[rows])


def _below(base: _MeasuredCells, looked: Looked, level: float, off: tuple[float, float], total: float) -> _Below:
    """What lies below a level, by rules over cells that agree with those over their parts."""
    passed, lies = base.passed(level), base.distance < level
    found = _Below(0.0, 0.0, [], [], np.inf)
    found = _with_whole(found, base, ~passed & lies)
    cells, known = base.cells.take(passed), _cut(base.cells.take(passed), looked, level, 0)
    slopes, most = float(np.sum(known.values[:, 1])), looked.count + looked.sight.most
    for step in range(_HALVINGS):
        if len(cells.piece) == 0 or looked.count > most:
            break
        parts = _looked_at(halved(cells), looked)
        passed, lies = parts.passed(level), parts.distance < level
        finer = _cut(parts.cells.take(passed), looked, level, step + 1)
        values = np.zeros((len(passed), known.values.shape[1]))
        values[lies, 0] = parts.area[lies]
        values[passed] = finer.values
        both = np.sum(values.reshape(-1, 4, values.shape[1]), axis=1)
        slopes = max(slopes, float(np.sum(both[:, 1])))
        wanted = np.where(np.arange(values.shape[1]) == 0, off[0] * total, off[1] * slopes)
        settled = np.ones(len(passed), bool)
        settled[passed] = finer.settled
        agreed = np.all(np.abs(both - known.values) <= wanted, axis=1) & np.all(settled.reshape(-1, 4), axis=1)
        left = np.sum(np.abs(both - known.values)[~agreed], axis=0)
        of = np.where(np.arange(len(left)) == 0, total, slopes)
        found = found._replace(off=float(np.max(left / np.where(of > 0, of, 1.0))) if np.isfinite(slopes) else np.inf)
        agreed = np.repeat(agreed, 4)
        found = _with(_with_whole(found, parts, ~passed & lies), finer.take(agreed[passed]))
        cells, known = parts.cells.take(passed & ~agreed), finer.take(~agreed[passed])
    return _with(found, known)


def _cut(cells: ParameterCells, looked: Looked, level: float, step: int) -> _LevelCells:
    count = len(cells.piece)
    if count == 0:
        nothing = CellNodes(nodes_of(cells, _RULE), np.zeros(0, int))
        return _LevelCells(np.zeros((0, 2 + looked.net.dim)), nothing, nothing, np.zeros(0, bool))
    across = _across(cells, looked)
    rule = cut_at_level(cells, looked, across, level, step)
    density = known_along(looked.net, rule.below.nodes)[1]
    area = rule.below.sums((rule.below.nodes.factor * density)[:, None], count)
    seen = looked.at(rule.on.nodes)
    with np.errstate(divide="ignore"):
        factor = rule.on.nodes.factor * seen.density / np.abs(seen.slope[np.arange(len(rule.axis)), rule.axis])
    met = CellNodes(rule.on.nodes._replace(factor=factor), rule.on.cell)
    columns = np.concatenate([np.ones((len(factor), 1)), seen.normal], axis=1)
    values = np.concatenate([area, met.sums(columns * factor[:, None], count)], axis=1)
    return _LevelCells(values, rule.below, met, rule.settled)


def _across(cells: ParameterCells, looked: Looked) -> np.ndarray:
    """The parameter along which the distance changes most over each cell."""
    corners = np.array(list(np.ndindex(2, 2)), bool)
    t = np.where(corners, cells.high[:, None], cells.low[:, None]).reshape(-1, 2)
    slope = looked.at(Nodes(np.repeat(cells.piece, 4), t, np.ones(len(t)))).slope.reshape(-1, 4, 2)
    return np.argmax(np.sum(np.abs(slope), axis=1) * (cells.high - cells.low), axis=1)


def _with_whole(found: _Below, cells: _MeasuredCells, below: np.ndarray) -> _Below:
    """The same with some whole cells that lie below the level."""
    area = found.area + float(np.sum(cells.area[below]))
    return found._replace(area=area, inside=[*found.inside, nodes_of(cells.cells.take(below), _RULE)])


def _with(found: _Below, known: _LevelCells) -> _Below:
    """The same with what cut cells say."""
    area, slope = np.sum(known.values[:, :2], axis=0)
    inside, met = [*found.inside, known.inside.nodes], [*found.met, known.met.nodes]
    return _Below(found.area + float(area), found.slope + float(slope), inside, met, found.off)
