"""The distance to a shape at points of another shape: its value, and its slopes along the parameters.

Integrals over thousands of points need the nearest foot of each, but not its distance to the last digit of a proof.
Bounds of the distance to a surface may therefore differ by some billionths of the size, and its pieces are cut
beforehand, which takes an eighth of the time. A foot that is not the nearest exceeds the distance by no more than that.

A distance that rounding cannot distinguish from zero is zero, and so is its derivative. If shapes coincide, feet differ
from their points by rounding alone, in any direction.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context
from jaxtyping import Array, Float, Int

from jhd._distance.nearest.target import AbstractTarget, ProvenFeet
from jhd._distance.normalization.net_jets import Net, part_of
from jhd._distance.normalization.nets import net_of
from jhd._distance.project import project
from jhd._distance.search.bodies import body_of
from jhd._distance.search.on_patches import NetTarget
from jhd._distance.search.targets import proven_with_derivatives
from jhd._distance.statistics.quadrature import Nodes, known_along
from jhd._results.solution import RESULTS
from jhd._runtime.arrays import undifferentiated
from jhd._runtime.compiled import compiled
from jhd._shapes.prepared import working

# Bounds may differ by this fraction of the size; the pieces of a surface are cut into about this many parts in all.
_CLOSE, _PARTS = 2.0**-27, 64


class Seen(NamedTuple):
    """Data at points: distances, unit vectors away from the feet, slopes along the parameters, density."""

    distance: Float[np.ndarray, " places"]  # distance to the nearest foot, or to a nearly nearest one
    normal: Float[np.ndarray, "places dim"]  # (places, dim); zero at distance zero
    slope: Float[np.ndarray, "places parameters"]  # (places, parameters)
    density: Float[np.ndarray, " places"]  # length or area per parameter
    # Number of the smooth part of the shape that holds the foot; a negative number at distance zero.
    label: Int[np.ndarray, " places"]


class Sight:
    """Distances to b, whose numbers are known, from points in another unit.

    Args:
        b: the shape.
        scale: a power of two; points and results are multiplied by it.
        derived: whether derivatives are requested.
    """

    def __init__(self, b: Any, scale: float, derived: bool):
        self.b, self.scale = undifferentiated(b), scale
        self._target: AbstractTarget | None = None
        self._body = body_of(working(self.b))
        self._cuts = self._body.cuts(_PARTS)
        if self._cuts > 1:
            self._target = NetTarget(_cut(net_of(self.b), self._cuts))
        elif self._body.dimension != 1:
            self._target = self._body.target()
        low, high = (np.asarray(end) for end in self.b.bounds)
        self._close = _CLOSE * float(np.max(high - low))
        # Factor for derivatives that are to be confirmed: they jump where feet jump, but the distance does not.
        self.most = self._body.most_points * (4 if derived else 1)

    def feet(self, points: np.ndarray) -> ProvenFeet:
        """Return the nearest feet of points, in the unit of b."""
        # Known numbers need nothing of a derivative that is being taken around.
        with eval_context():
            if self._target is None:
                found = project(points, self.b, throw=False)
                closed = found.result == RESULTS.successful
                known = found.distance, found.lower, found.upper, found.foot, found.element, found.t, closed
                return ProvenFeet(*map(np.asarray, known))
            found = self._target.nearest(points, close=self._close)
            # Points that may be at distance zero are resolved to the end.
            maybe = (found.lower <= 0) & told_from_zero(found, self.scale)
            if np.any(maybe):
                closer = self._target.nearest(points[maybe])
                found = ProvenFeet(*map(np.array, found))
                for x, y in zip(found, closer, strict=True):
                    x[maybe] = y
        if self._cuts == 1:
            return found
        piece, part = np.divmod(found.segment, self._cuts**2)
        corner = np.stack(np.unravel_index(part, (self._cuts,) * 2), axis=1)
        return found._replace(segment=piece, t=(corner + found.t) / self._cuts)

    def _seen(self, points: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray]:
        """Return the nearest feet, the distances, and the points minus their feet, both times the scale."""
        own = np.asarray(points) / self.scale
        found = self.feet(own)
        told = told_from_zero(found, self.scale)
        # In units in which squares are numbers.
        apart = (own - np.asarray(found.foot)) * self.scale
        return found, np.where(told, np.asarray(found.distance) * self.scale, 0.0), np.where(told[:, None], apart, 0.0)

    def at(self, net: Net, nodes: Nodes) -> Seen:
        """Return the data seen from points of a known net."""
        if len(nodes.piece) == 0:
            nothing = np.zeros(0)
            shapes = np.zeros((0, net.dim)), np.zeros((0, net.parameters))
            return Seen(nothing, *shapes, nothing, np.zeros(0, int))
        points, density, first = known_along(net, nodes)
        found, distance, apart = self._seen(points)
        length = np.linalg.norm(apart, axis=1, keepdims=True)
        normal = apart / np.where(length > 0, length, 1.0)
        slope = np.sum(first * normal[:, None], axis=2)
        parts = self._body.smooth_parts(
            np.asarray(found.foot), np.asarray(found.segment, np.int64), np.asarray(found.t)
        )
        # The label of points at distance zero; other labels are not negative.
        label = np.where(distance > 0, parts, -2)
        return Seen(distance, normal, slope, density, label)

    def moving(self, points: Array, b: Any) -> Array:
        """Return distances of points to b, differentiable in both."""
        own = points / self.scale
        if self._target is None:
            found = project(own, b, throw=False)
            distance = found.distance
        else:
            found = self.feet(np.asarray(undifferentiated(own)))
            distance = proven_with_derivatives(found, own, b)
        return jnp.where(told_from_zero(found, self.scale), distance * self.scale, 0.0)


def told_from_zero(found: Any, scale: float) -> np.ndarray:
    """Return whether known distances are proven positive, or exceed the rounding of coordinates.

    Args:
        found: the nearest points.
        scale: a power of two that makes coordinates at most one.
    """
    lower, distance = (np.asarray(undifferentiated(x)) for x in (found.lower, found.distance))
    # A distance up to this, in units of roundoff of coordinates of at most one, is not told from zero without a proof.
    return (lower > 0) | (distance * scale > 256 * float(np.finfo(distance.dtype).eps))


def _cut(net: Net, count: int) -> Net:
    """Return each piece cut into equal parts along each parameter."""
    pieces = len(net.points)
    low = np.tile(np.array(list(np.ndindex(count, count))) / count, (pieces, 1))
    return jax.tree_util.tree_map(np.asarray, _parts(net, np.repeat(np.arange(pieces), count**2), low, 1 / count))


@compiled
def _parts(net: Net, piece: Any, low: Any, size: Any) -> Net:
    return jax.vmap(lambda k, at: part_of(net.piece(k), at, at + size))(piece, low)
