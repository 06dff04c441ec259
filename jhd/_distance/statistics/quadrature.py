"""Integrals of the distance to b along a, differentiable: nodes on a, placed by an adaptive pass, and weights.

The parameter cells of a are halved until a Lobatto rule over a cell and over its parts agree, for the distance, its
square, and the direction away from the foot, up to the rounding of coordinates. The distance has a breakpoint where the
foot jumps; cells about it are cut until their error vanishes, so on curves value and derivatives are accurate nearly to
rounding. A rule without nodes at the ends of a cell would miss a breakpoint next to them. On surfaces, creases are
whole curves (jhd._distance.statistics.surface_quadrature). There this file serves a given number of nodes, which ends
the refinement; if there is no room for parts, rules of Gauss need fewer nodes.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context
from jaxtyping import Array, Float, Int

from jhd._arithmetic.scaling import length
from jhd._distance.normalization.net_jets import Net, jet
from jhd._runtime.arrays import joined, taken
from jhd._runtime.compiled import optimized

# Nodes of a rule along each parameter of a curve and of a surface, and smaller numbers for many pieces.
_ON_CURVES, _ON_SURFACES, _COARSE = 9, 4, (3, 2, 1)
# Halvings of a cell in all, and the largest number of nodes on curves and on surfaces, where a projection may take a
# millisecond.
_HALVINGS, _MOST_PLACES = 26, {1: 1 << 17, 2: 1 << 13}
# A cell is done if a rule over it and over its parts differ by this fraction of the integral, on curves and surfaces.
_AGREED = {1: 1e-13, 2: 1e-10}
# Rounding errors of distances, in units of roundoff of coordinates of at most one.
_ROUNDINGS = 64
# Numbers of nodes that are compiled.
_PADDED = (64, 512, 1 << 13, 1 << 17, 1 << 18)


class ParameterCells(NamedTuple):
    """Boxes of parameters: pieces, lower and upper ends (cells, parameters)."""

    piece: Int[np.ndarray, " cells"]
    low: Float[np.ndarray, "cells parameters"]
    high: Float[np.ndarray, "cells parameters"]

    take = taken


class Resolved(NamedTuple):
    """Cells over which rules agree with the rules over their parts."""

    cells: ParameterCells  # cells of the parameters
    count: int  # nodes of the rule along each parameter
    left: float  # fraction of the length or area in cells without agreement: feet may jump there


class Nodes(NamedTuple):
    """Nodes along a shape: pieces, parameters (places, parameters), and the factor of each."""

    piece: Int[np.ndarray, " places"]
    t: Float[np.ndarray, "places parameters"]
    factor: Float[np.ndarray, " places"]


def whole(net: Net) -> ParameterCells:
    """Return one cell for each piece."""
    ends = np.zeros((net.points.shape[0], net.parameters))
    return ParameterCells(np.arange(len(ends)), ends, ends + 1)


@lru_cache
def _lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of the Lobatto rule with `count` nodes, which include both ends."""
    top = np.polynomial.legendre.Legendre.basis(count - 1)
    x = np.concatenate([[-1.0], np.sort(top.deriv().roots().real), [1.0]])
    return x, 2 / (count * (count - 1) * top(x) ** 2)


def nodes_of(cells: ParameterCells, count: int) -> Nodes:
    """Return the nodes of a rule with `count` along each parameter, cell after cell; a Lobatto rule from four on."""
    x, w = _lobatto(count) if count > max(_COARSE) else np.polynomial.legendre.leggauss(count)
    n = cells.low.shape[1]
    places = np.stack([g.ravel() for g in np.meshgrid(*[(x + 1) / 2] * n, indexing="ij")], axis=-1)
    factors = np.prod(np.stack([g.ravel() for g in np.meshgrid(*[w / 2] * n, indexing="ij")], axis=-1), axis=-1)
    size = cells.high - cells.low
    t = cells.low[:, None] + size[:, None] * places
    factor = np.prod(size, axis=1)[:, None] * factors
    return Nodes(np.repeat(cells.piece, len(places)), t.reshape(-1, n), factor.ravel())


def halved(cells: ParameterCells) -> ParameterCells:
    """Return each cell as two or four parts, in their order."""
    n = cells.low.shape[1]
    middle = 0.5 * (cells.low + cells.high)
    parts = np.array(list(np.ndindex(*[2] * n)), bool)
    low = np.where(parts, middle[:, None], cells.low[:, None]).reshape(-1, n)
    high = np.where(parts, cells.high[:, None], middle[:, None]).reshape(-1, n)
    return ParameterCells(np.repeat(cells.piece, len(parts)), low, high)


def resolved(net: Net, see: Callable[[Net, "Nodes"], Any], most: int | None = None) -> "Resolved":
    """Return cells over which rules with some nodes along each parameter agree with the rules over their parts.

    Args:
        net: the pieces, known.
        see: returns the data seen from points of the net, whose coordinates are at most one
            (jhd._distance.statistics.pointwise).
        most: largest number of nodes in all, but at least one for each piece; None for a fixed limit.

    Returns:
        The cells, the number of nodes along each parameter, and a bound of the relative error of derivatives of sums.
    """
    cells = whole(net)
    most = _MOST_PLACES[net.parameters] if most is None else most
    count = (_ON_CURVES, _ON_SURFACES)[net.parameters - 1]
    if 2**net.parameters * len(cells.piece) * count**net.parameters > most:
        count = next((k for k in _COARSE if len(cells.piece) * k**net.parameters <= most), 1)
    each, parts = count**net.parameters, 2**net.parameters
    values = _integrals(net, see, cells, count)
    done: list[ParameterCells] = []
    total = np.abs(np.sum(values, axis=0))
    # Directions are unknown if distances are positive but on average at most this, in units of roundoff.
    unknown = 0 < total[1] <= (1 << 14) * float(np.finfo(values.dtype).eps) * total[0]
    for _ in range(0 if unknown else _HALVINGS):
        settled = sum(len(c.piece) for c in done)
        if (settled + parts * len(cells.piece)) * each > most:
            break
        finer = halved(cells)
        below = _integrals(net, see, finer, count)
        both = np.sum(below.reshape(len(cells.piece), parts, -1), axis=1)
        total = np.maximum(total, np.abs(np.sum(below, axis=0)))
        agreed = np.abs(both - values)[:, :-1] <= _allowed(total, values, net.parameters)
        agreed = np.repeat(np.all(agreed, axis=1), parts)
        done.append(finer.take(agreed))
        cells, values = finer.take(~agreed), below[~agreed]
        if len(cells.piece) == 0:
            break
    left = float(np.sum(np.abs(values[:, 0])) / total[0]) if total[0] > 0 else 0.0
    return Resolved(joined([*done, cells]), count, left)


def _integrals(net: Net, see: Callable[[Net, Nodes], Any], cells: ParameterCells, count: int) -> np.ndarray:
    """Integrals of 1, the distance, its square and the direction over each cell, and the direction's rounding."""
    nodes = nodes_of(cells, count)
    seen = see(net, nodes)
    d, each = seen.distance, count**net.parameters
    noise = np.minimum(_ROUNDINGS * float(np.finfo(d.dtype).eps) / np.where(d > 0, d, np.inf), 1.0).reshape(-1, each)
    # Where the foot jumps, the direction jumps by more than rounding; where shapes cross or part, it turns or vanishes.
    normal, label = seen.normal.reshape(len(noise), each, -1), seen.label.reshape(len(noise), -1)
    spread = np.max(np.sum((normal - normal[:, :1]) ** 2, axis=2), axis=1) ** 0.5
    several = np.any(label != label[:, :1], axis=1) & (spread > 2 * np.max(noise, axis=1))
    several |= np.any(np.sum(normal * normal[:, :1], axis=2) < 0, axis=1)
    several |= np.any(label != label[:, :1], axis=1) & np.any(label < 0, axis=1)
    noise = np.where(several[:, None], 0.0, noise)
    rows = np.column_stack([np.ones_like(d), d, d**2, seen.normal, noise.ravel()])
    rows = rows * (nodes.factor * seen.density)[:, None]
    return np.sum(rows.reshape(len(noise), each, -1), axis=1)


def _allowed(total: np.ndarray, values: np.ndarray, parameters: int) -> np.ndarray:
    """Return the allowed differences between integrals over cells and over their parts, all but the last."""
    rounded = _ROUNDINGS * float(np.finfo(values.dtype).eps)
    least = _AGREED[parameters] * total[:3]
    room = rounded * np.column_stack([0 * values[:, 0], values[:, 0], 2 * values[:, 1]])
    # Rules for the direction may differ by this fraction of the length or area.
    directions = np.repeat(1e-9 * total[0] + values[:, -1:], values.shape[1] - 4, axis=1)
    return np.concatenate([least + room, directions], axis=1)


def along(net: Net, nodes: Nodes) -> tuple[Array, Array, Array]:
    """Return points of a shape at nodes, its speed or area per parameter and its first derivatives, differentiable."""
    points, density, first = _along(net, *map(jnp.asarray, _padded(nodes)))
    count = len(nodes.piece)
    return points[:count], density[:count], first[:count]


def known_along(net: Net, nodes: Nodes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the results of `along` for a known shape, in NumPy, at a small part of the cost of each call."""
    with eval_context():
        points, density, first = (np.asarray(x)[: len(nodes.piece)] for x in _along(net, *_padded(nodes)))
    return points, density, first


def _padded(nodes: Nodes) -> tuple[np.ndarray, np.ndarray]:
    """Return pieces and parameters padded to a number of nodes that is compiled."""
    count = len(nodes.piece)
    more = next((size for size in _PADDED if size >= count), count) - count
    t = np.pad(nodes.t, ((0, more), (0, 0)), constant_values=0.5)
    return np.pad(nodes.piece, (0, more)), t


@optimized
def _along(net: Net, piece: Array, t: Array) -> tuple[Array, Array, Array]:
    def one(k: Array, t: Array) -> tuple[Array, Array, Array]:
        at = jet(net.piece(k), t)
        if net.parameters == 1:
            return at.point, length(at.first[0]), at.first
        first, second = (x if net.dim == 3 else jnp.pad(x, (0, 3 - net.dim)) for x in at.first)
        return at.point, length(jnp.cross(first, second)), at.first

    return jax.vmap(one)(piece, t)
