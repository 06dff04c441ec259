"""Quantiles of the distance along a shape, with derivatives: levels below which a fraction of its length or area lies.

With M(Q) the length of the part with d <= Q and L the whole length, the quantile solves M(Q) = q L. A point with d = Q
moves with the shapes, by the change of d there over the slope of d. So each of these points counts with
w = speed / slope, and dQ = (q dL - dM + sum w dd) / sum w, where dM is the derivative of M at fixed parameters.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.cells.weighted import first_reaching
from jhd._distance.normalization.net_jets import Net, jet
from jhd._distance.statistics.error_control import Estimated
from jhd._distance.statistics.quadrature import Nodes, ParameterCells, along, known_along, nodes_of
from jhd._runtime.arrays import taken, undifferentiated
from jhd._runtime.compiled import compiled

# Parts of a cell whose ends are looked at, and places of the rule over each for its length.
_PARTS, _RULE = 8, 6
# Newton steps for the level, and for the places where the distance passes it.
_LEVEL_STEPS, _PLACE_STEPS = 20, 12
# On surfaces, the share of places nearest to the level that stand for those on it, and halvings for it.
_BESIDE, _BISECTIONS = 0.02, 80
# Distances that differ by less than this share are the same.
_SAME = 1e-8


class _Parts(NamedTuple):
    """Parts of the pieces of a curve, in order: pieces, ends, and the distances there."""

    piece: np.ndarray
    low: np.ndarray
    high: np.ndarray
    first: np.ndarray
    last: np.ndarray

    take = taken


class _Passed(NamedTuple):
    """A level: what of the length lies below it, and where the distance passes it.

    Args:
        below: the length.
        piece: of the places.
        t: likewise.
        count: speed over slope there.
        part: the part that each lies in.
    """

    below: float
    piece: np.ndarray
    t: np.ndarray
    count: np.ndarray
    part: np.ndarray


def quantile_along(
    net: Net, cells: ParameterCells, distance: Callable[[Array], Array], feet: Callable[[np.ndarray], Any], q: float
) -> Estimated | None:
    """The quantile along a curve; None where the distance passes the level nowhere with a slope.

    Args:
        net: the pieces of the curve, differentiable.
        cells: over which the distance is smooth, but for small ones.
        distance: of points to the other shape, differentiable.
        feet: their distances and nearest points, not differentiable.
        q: the share.
    """
    known: Net = undifferentiated(net)
    parts = _parts(known, cells, feet)
    lengths = _lengths(known, parts.piece, parts.low, parts.high)
    level, found = _solved(known, parts, lengths, feet, q)
    if found is None:
        return None
    piece, low, high, inside = _split(parts, level, found)
    nodes = nodes_of(ParameterCells(piece, low[:, None], high[:, None]), _RULE)
    counted = nodes.factor * along(net, nodes)[1]
    below = jnp.sum(counted * np.repeat(inside, _RULE))
    places, *_ = along(net, Nodes(found.piece, found.t[:, None], np.ones(len(found.t))))
    there = distance(places)
    change = q * jnp.sum(counted) - below + jnp.sum(found.count * there)
    missing = abs(found.below - q * np.sum(lengths)) / np.sum(lengths)
    return Estimated(level + (change - jax.lax.stop_gradient(change)) / np.sum(found.count), float(missing))


def _parts(known: Net, cells: ParameterCells, feet: Callable[[np.ndarray], Any]) -> _Parts:
    order = np.lexsort((cells.low[:, 0], cells.piece))
    piece, low, high = cells.piece[order], cells.low[order, 0], cells.high[order, 0]
    shares = np.arange(_PARTS + 1) / _PARTS
    ends = low[:, None] * (1 - shares) + high[:, None] * shares
    at = Nodes(np.repeat(piece, _PARTS + 1), ends.reshape(-1, 1), np.ones(ends.size))
    values = feet(known_along(known, at)[0])[0].reshape(ends.shape)
    rows = [np.repeat(piece, _PARTS), ends[:, :-1], ends[:, 1:], values[:, :-1], values[:, 1:]]
    return _Parts(*(x.ravel() for x in rows))


def _lengths(known: Net, piece: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    nodes = nodes_of(ParameterCells(piece, low[:, None], high[:, None]), _RULE)
    density = known_along(known, nodes)[1]
    return np.sum((nodes.factor * density).reshape(len(piece), _RULE), axis=1)


def _solved(
    known: Net, parts: _Parts, lengths: np.ndarray, feet: Callable[[np.ndarray], Any], q: float
) -> tuple[float, _Passed | None]:
    """The level with the share q below it, by Newton steps between levels that are too low and too high."""
    wanted = q * np.sum(lengths)
    low, high = float(min(np.min(parts.first), np.min(parts.last))), float(max(np.max(parts.first), np.max(parts.last)))
    level, found = _first_level(parts, lengths, wanted, low, high), None
    for _ in range(_LEVEL_STEPS):
        found = _level(known, parts, lengths, feet, level)
        if found.below < wanted:
            low = max(low, level)
        else:
            high = min(high, level)
        slope = np.sum(found.count)
        if len(found.t) == 0 or not np.isfinite(slope):
            return level, None
        step = (wanted - found.below) / slope
        following = level + step if low <= level + step <= high else 0.5 * (low + high)
        if abs(following - level) <= 4 * np.finfo(float).eps * high:
            break
        level = following
    return level, found


def _first_level(parts: _Parts, lengths: np.ndarray, wanted: float, low: float, high: float) -> float:
    """The level as if the distance were linear over each part."""
    least, most = np.minimum(parts.first, parts.last), np.maximum(parts.first, parts.last)
    rise = np.where(most > least, most - least, 1.0)
    for _ in range(60):
        level = 0.5 * (low + high)
        share = np.where(most > least, np.clip((level - least) / rise, 0.0, 1.0), level >= least)
        low, high = (level, high) if np.sum(share * lengths) < wanted else (low, level)
    return 0.5 * (low + high)


def _level(known: Net, parts: _Parts, lengths: np.ndarray, feet: Callable[[np.ndarray], Any], level: float) -> _Passed:
    rises = (parts.first <= level) & (parts.last > level)
    passes = rises | ((parts.first > level) & (parts.last <= level))
    inside = (parts.first <= level) & (parts.last <= level)
    index = np.flatnonzero(passes)
    if len(index) == 0:
        nothing = np.zeros(0)
        return _Passed(float(np.sum(lengths[inside])), index, nothing, nothing, index)
    some = parts.take(index)
    rising = rises[index]
    low, high = some.low.copy(), some.high.copy()
    t = low + (high - low) * (level - some.first) / (some.last - some.first)
    count = np.ones(len(t))
    for _ in range(_PLACE_STEPS):
        points, tangent = (np.asarray(x) for x in _tangents(known, some.piece, t))
        d, foot = feet(points)
        slope = np.sum((points - foot) * tangent, axis=1) / np.where(d > 0, d, 1.0)
        with np.errstate(divide="ignore"):
            count = np.linalg.norm(tangent, axis=1) / np.abs(slope)
        before = (d <= level) == rising
        low, high = np.where(before, t, low), np.where(before, high, t)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = t + (level - d) / slope
        # At the ends of what is known Newton's step is as good as it gets.
        following = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        if np.all(np.abs(following - t) <= np.finfo(float).eps):
            break
        t = following
    ends = np.where(rising, some.low, t), np.where(rising, t, some.high)
    below = np.sum(lengths[inside]) + np.sum(_lengths(known, some.piece, *ends))
    return _Passed(float(below), some.piece, t, count, index)


@compiled
def _tangents(net: Net, piece: Array, t: Array) -> tuple[Array, Array]:
    def one(k: Array, t: Array) -> tuple[Array, Array]:
        at = jet(net.piece(k), t[None])
        return at.point, at.first[0]

    return jax.vmap(one)(piece, t)


def _split(parts: _Parts, level: float, found: _Passed) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All parts, those in which the distance passes the level cut there, and which lie below it."""
    inside = (parts.first <= level) & (parts.last <= level)
    high = parts.high.copy()
    high[found.part] = found.t
    below = inside.copy()
    below[found.part] = parts.first[found.part] <= level
    rest = parts.take(found.part)
    return (
        np.concatenate([parts.piece, rest.piece]),
        np.concatenate([parts.low, found.t]),
        np.concatenate([high, rest.high]),
        np.concatenate([below, rest.last <= level]),
    )


def quantile_of(distance: Any, weight: Any, q: float) -> tuple[int, float]:
    """The place whose distance is the quantile of known distances at places that count so much, and that distance."""
    d, w = (np.asarray(undifferentiated(x)) for x in (distance, weight))
    order = np.argsort(d, kind="stable")
    k = order[first_reaching(w[order], q)]
    return int(k), float(d[k])


def quantile_beside(distance: Array, weight: Array, q: float) -> Estimated:
    """The quantile of distances at many places, smoothed: each counts as spread evenly over a narrow band about it.

    The derivative is that of this level. It lies off the quantile by the order of the squared width of the band, and
    is confirmed only where that has none, as many places are as far.

    Args:
        distance: differentiable.
        weight: what each place counts, differentiable.
        q: the share.
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
    return Estimated(level + total - jax.lax.stop_gradient(total), 0.0 if width < _SAME else np.inf)
