"""Quantiles of the distance along a shape, with derivatives: levels below which a fraction of its length or area lies.

With M(Q) the length or area of the part with d <= Q, and L the length or area of the whole, the quantile solves
M(Q) = q L. A point with d = Q moves with the shapes, by the change of d there over the slope of d. So each point at
which a line of a cut rule crosses the level counts with w = density / slope, and dQ = (q dL - dM + sum w dd) / sum w,
where dM is the derivative of M at fixed parameters. The lines run across the cells of a surface; on a curve the lines
are the cells themselves. Only cells that the level may cross are examined closely: the distance changes by no more than
the point moves.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.cells.weighted import first_reaching
from jhd._distance.normalization.net_jets import Net
from jhd._distance.statistics.cut_cells import CellNodes, Looked
from jhd._distance.statistics.error_control import Estimated
from jhd._distance.statistics.level_cuts import cut_at_level
from jhd._distance.statistics.pointwise import Sight
from jhd._distance.statistics.quadrature import Nodes, ParameterCells, along, halved, known_along, nodes_of, whole
from jhd._runtime.arrays import joined, undifferentiated

# Nodes of the rule along each parameter if no curve cuts, and largest number of initial halvings of pieces.
_RULE, _FIRST = 6, 3
# Allowed errors of the fraction of the measure and of the density of the level in each of Newton's steps, on curves and
# on surfaces.
_OFF = {
    1: ((1e-3, 1e-2), (1e-6, 1e-3), *((1e-13, 1e-10),) * 5),
    2: ((1e-3, 1e-2), (1e-6, 1e-3), *((1e-10, 1e-8),) * 5),
}
# More than this many times the allowed error is surely off; and the error of the fraction allowed at the end.
_SURE, _REACHED = 10.0, {1: 1e-12, 2: 1e-7}
# Halvings of a cell in each.
_HALVINGS = {1: 26, 2: 14}
# There is no level if the fraction below it is off by this at the end: a whole region is equally far.
_PLATEAU = 1e-4
# The fraction of points nearest to the level that replace the points on it, and bisection steps for it.
_BESIDE, _BISECTIONS = 0.02, 80


class _MeasuredCells(NamedTuple):
    """Cells, their measures, the distances from their middles, and bounds of the distance of points to the middle."""

    cells: ParameterCells
    size: np.ndarray
    distance: np.ndarray
    radius: np.ndarray

    def passed(self, level: float) -> np.ndarray:
        """Return whether the level may cross each cell."""
        return np.abs(self.distance - level) <= self.radius


class _Below(NamedTuple):
    """The part of a shape below a level."""

    size: float  # its length or area
    slope: float  # derivative of the size in the level
    inside: list[Nodes]  # nodes over the whole part below
    met: list[Nodes]  # points on the level, with their factors
    off: float  # relative difference that remains between rules over cells and over their parts


def quantile_over(net: Net, sight: Sight, b: Any, q: float, steps: int | None = None) -> Estimated | None:
    """Return the quantile over a curve or a surface; None if a surface has too many pieces.

    If a whole region is equally far, the derivative is taken over the points there.

    Args:
        net: the pieces, differentiable.
        sight: the distances to the other shape.
        b: the other shape, differentiable.
        q: the fraction.
        steps: largest number of Newton steps for the level; few if derivatives need not be confirmed.
    """
    known: Net = undifferentiated(net)
    looked = Looked(known, sight)
    first = whole(known)
    n, parts = net.parameters, 2**net.parameters
    if n == 2 and (1 + parts) * len(first.piece) * _RULE**n > sight.most:
        return None
    for _ in range(_FIRST):
        if parts * len(first.piece) * _RULE**n <= sight.most / 8:
            first = halved(first)
    first = _settled(known, first) if n == 1 else first
    everywhere = nodes_of(first, _RULE)
    base = _looked_at(first, looked)
    weight = everywhere.factor * known_along(known, everywhere)[1]
    at = looked.at(everywhere)
    level, total = quantile_of(at.distance, weight, q)[1], float(np.sum(weight))
    low, high = float(np.min(base.distance - base.radius)), float(np.max(base.distance + base.radius))
    below, passed = None, False
    # Rounding errors of fractions of the measure, in units of roundoff.
    least = 64 * float(np.finfo(net.points.dtype).eps)
    # At level zero, points on the level have no slope.
    for off in _OFF[n][:steps] if level > 0 else ():
        below = _below(base, looked, level, (max(off[0], least), max(off[1], least)), total)
        passed = below.slope > 0 and bool(np.isfinite(below.slope))
        if not passed:
            break
        missing = q * total - below.size
        low, high = max(low, level) if missing > _SURE * off[0] * total else low, high
        high = min(high, level) if missing < -_SURE * off[0] * total else high
        level = float(np.clip(level + missing / below.slope, low, high))
        if off == _OFF[n][-1] and (abs(missing) <= _REACHED[n] * total or looked.count > 2 * sight.most):
            break
    missing = np.inf if below is None else abs(below.size - q * total) / total
    if below is None or not passed or missing > _PLATEAU:
        points, density, _ = along(net, everywhere)
        found = quantile_beside(sight.moving(points, b), jnp.asarray(everywhere.factor) * density, q)
        return found._replace(off=0.0 if missing > _PLATEAU else np.inf)
    inside, met = (joined(x) for x in (below.inside, below.met))
    points, *_ = along(net, met)
    change = q * _size(net, everywhere) - _size(net, inside) + jnp.sum(met.factor * sight.moving(points, b))
    return Estimated(level + (change - jax.lax.stop_gradient(change)) / below.slope, max(below.off, missing))


def _size(net: Net, nodes: Nodes) -> Array:
    return jnp.sum(nodes.factor * along(net, nodes)[1])


def _settled(net: Net, cells: ParameterCells) -> ParameterCells:
    """Return cells of a curve, halved until the length over each agrees with the length over its halves."""
    done, sizes, total = [], _sizes(net, cells), np.inf
    for _ in range(_HALVINGS[1]):
        finer = halved(cells)
        below = _sizes(net, finer)
        both = np.sum(below.reshape(-1, 2), axis=1)
        total = min(total, float(np.sum(both)))
        open_ = np.abs(both - sizes) > _OFF[1][-1][0] * total
        done.append(cells.take(~open_))
        cells, sizes = finer.take(np.repeat(open_, 2)), below[np.repeat(open_, 2)]
        if len(cells.piece) == 0:
            break
    return joined([*done, cells])


def _sizes(net: Net, cells: ParameterCells) -> np.ndarray:
    nodes = nodes_of(cells, _RULE)
    return np.sum((nodes.factor * known_along(net, nodes)[1]).reshape(len(cells.piece), -1), axis=1)


def _looked_at(cells: ParameterCells, looked: Looked) -> _MeasuredCells:
    count, nodes = len(cells.piece), nodes_of(cells, _RULE)
    points, density, _ = known_along(looked.net, nodes)
    middle = Nodes(cells.piece, 0.5 * (cells.low + cells.high), np.ones(count))
    apart = points.reshape(count, -1, points.shape[1]) - known_along(looked.net, middle)[0][:, None]
    # Cells may be this much larger than the nodes of a rule in them show.
    radius = 1.1 * np.sqrt(np.max(np.sum(apart**2, axis=2), axis=1))
    size = np.sum((nodes.factor * density).reshape(count, -1), axis=1)
    return _MeasuredCells(cells, size, looked.at(middle).distance, radius)


class _LevelCells(NamedTuple):
    """Rules over cells that a level may cut."""

    # For each cell, its length or area below the level, the derivative of this in the level, and this times the
    # directions from the feet.
    values: np.ndarray
    inside: CellNodes  # nodes of the rule that lie below
    met: CellNodes  # points at which lines cross the level
    settled: np.ndarray  # whether the integrand is smooth in each part of a cell

    def take(self, rows: np.ndarray) -> "_LevelCells":
        """Return the cells in a mask."""
        return _LevelCells(self.values[rows], self.inside.of(rows), self.met.of(rows), self.settled[rows])


def _below(base: _MeasuredCells, looked: Looked, level: float, off: tuple[float, float], total: float) -> _Below:
    """Return the part below a level, by rules over cells that agree with the rules over their parts."""
    passed, lies = base.passed(level), base.distance < level
    found = _Below(0.0, 0.0, [], [], np.inf)
    found = _with_whole(found, base, ~passed & lies)
    cells, known = base.cells.take(passed), _cut(base.cells.take(passed), looked, level, 0)
    slopes, most = float(np.sum(known.values[:, 1])), looked.count + looked.sight.most
    many = 2**looked.net.parameters
    for step in range(_HALVINGS[looked.net.parameters]):
        if len(cells.piece) == 0 or looked.count > most:
            break
        parts = _looked_at(halved(cells), looked)
        passed, lies = parts.passed(level), parts.distance < level
        finer = _cut(parts.cells.take(passed), looked, level, step + 1)
        values = np.zeros((len(passed), known.values.shape[1]))
        values[lies, 0] = parts.size[lies]
        values[passed] = finer.values
        both = np.sum(values.reshape(-1, many, values.shape[1]), axis=1)
        slopes = max(slopes, float(np.sum(both[:, 1])))
        wanted = np.where(np.arange(values.shape[1]) == 0, off[0] * total, off[1] * slopes)
        settled = np.ones(len(passed), bool)
        settled[passed] = finer.settled
        with np.errstate(invalid="ignore"):
            apart = np.abs(both - known.values)
        agreed = np.all(apart <= wanted, axis=1) & np.all(settled.reshape(-1, many), axis=1)
        left = np.sum(apart[~agreed], axis=0)
        of = np.where(np.arange(len(left)) == 0, total, slopes)
        found = found._replace(off=float(np.max(left / np.where(of > 0, of, 1.0))) if np.isfinite(slopes) else np.inf)
        agreed = np.repeat(agreed, many)
        found = _with(_with_whole(found, parts, ~passed & lies), finer.take(agreed[passed]))
        cells, known = parts.cells.take(passed & ~agreed), finer.take(~agreed[passed])
    return _with(found, known)


def _cut(cells: ParameterCells, looked: Looked, level: float, step: int) -> _LevelCells:
    """Return rules over cells that are cut at `level`, with their measures below it and derivatives in it."""
    count = len(cells.piece)
    if count == 0:
        nothing = CellNodes(nodes_of(cells, _RULE), np.zeros(0, int))
        return _LevelCells(np.zeros((0, 2 + looked.net.dim)), nothing, nothing, np.zeros(0, bool))
    across = _across(cells, looked)
    rule = cut_at_level(cells, looked, across, level, step)
    density = known_along(looked.net, rule.below.nodes)[1]
    size = rule.below.sums((rule.below.nodes.factor * density)[:, None], count)
    seen = looked.at(rule.on.nodes)
    with np.errstate(divide="ignore"):
        factor = rule.on.nodes.factor * seen.density / np.abs(seen.slope[np.arange(len(rule.axis)), rule.axis])
    met = CellNodes(rule.on.nodes._replace(factor=factor), rule.on.cell)
    columns = np.concatenate([np.ones((len(factor), 1)), seen.normal], axis=1)
    with np.errstate(invalid="ignore"):
        values = np.concatenate([size, met.sums(columns * factor[:, None], count)], axis=1)
    return _LevelCells(values, rule.below, met, rule.settled)


def _across(cells: ParameterCells, looked: Looked) -> np.ndarray:
    """Return the parameter along which the distance changes most over each cell."""
    count, n = cells.low.shape
    if n == 1:
        return np.zeros(count, int)
    corners = np.array(list(np.ndindex(2, 2)), bool)
    t = np.where(corners, cells.high[:, None], cells.low[:, None]).reshape(-1, 2)
    slope = looked.at(Nodes(np.repeat(cells.piece, 4), t, np.ones(len(t)))).slope.reshape(-1, 4, 2)
    return np.argmax(np.sum(np.abs(slope), axis=1) * (cells.high - cells.low), axis=1)


def _with_whole(found: _Below, cells: _MeasuredCells, below: np.ndarray) -> _Below:
    """Return the part with additional whole cells below the level."""
    size = found.size + float(np.sum(cells.size[below]))
    return found._replace(size=size, inside=[*found.inside, nodes_of(cells.cells.take(below), _RULE)])


def _with(found: _Below, known: _LevelCells) -> _Below:
    """Return the part with the contributions of cut cells."""
    size, slope = np.sum(known.values[:, :2], axis=0)
    inside, met = [*found.inside, known.inside.nodes], [*found.met, known.met.nodes]
    return _Below(found.size + float(size), found.slope + float(slope), inside, met, found.off)


def quantile_of(distance: Any, weight: Any, q: float) -> tuple[int, float]:
    """Return the index of the point whose distance is the weighted quantile, and this distance."""
    d, w = (np.asarray(undifferentiated(x)) for x in (distance, weight))
    order = np.argsort(d, kind="stable")
    k = order[first_reaching(w[order], q)]
    return int(k), float(d[k])


def quantile_beside(distance: Array, weight: Array, q: float) -> Estimated:
    """Return the quantile of distances at many points, smoothed: each is spread evenly over a narrow band around it.

    The derivative belongs to this level, which differs from the quantile by the order of the squared width of the band.
    It is confirmed only if the band has no width, because many points are equally far.

    Args:
        distance: the distances, differentiable.
        weight: weights of the points, differentiable.
        q: the fraction.
    """
    _, level = quantile_of(distance, weight, q)
    d, w = (np.asarray(undifferentiated(x)) for x in (distance, weight))
    off = np.sort(np.abs(d - level))
    half = off[min(int(_BESIDE * len(d)), len(d) - 1)]
    if not half > 0:
        return Estimated(distance[np.argmin(np.abs(d - level))], 0.0)
    low, high, wanted = level - 2 * half, level + 2 * half, q * np.sum(w)
    for _ in range(_BISECTIONS):
        level = 0.5 * (low + high)
        below = np.sum(w * np.clip(0.5 + (level - d) / (2 * half), 0.0, 1.0))
        low, high = (level, high) if below < wanted else (low, level)
    inside = 0.5 + (level - d) / (2 * half)
    slope = np.where((inside > 0) & (inside < 1), w, 0.0)
    change = (q - np.clip(inside, 0.0, 1.0)) * weight * 2 * half + slope * distance
    total = jnp.sum(change) / np.sum(slope)
    width = half / max(abs(level), float(np.finfo(w.dtype).tiny))
    # Distances that differ by less than this fraction are equal.
    return Estimated(level + total - jax.lax.stop_gradient(total), 0.0 if width < 1e-8 else np.inf)
