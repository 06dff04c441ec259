"""The distance to a shape seen from places of another one: its value, and its slopes along the parameters.

Whoever looks at thousands of places needs the nearest foot but not its distance to the last digit of a proof: bounds of
the distance to a surface may stay apart by some billionths of the size, and its pieces are cut beforehand, which takes
an eighth of the time. A foot that is not the nearest is then as near as that.
"""

from typing import Any, NamedTuple

import jax
import numpy as np
from jax.core import eval_context
from jaxtyping import Array, Float, Int

from jhd.compiled import compiled
from jhd.distance.frame.net_jets import Net, part_of
from jhd.distance.frame.nets import net_of
from jhd.distance.measures.quadrature import Nodes, known_along
from jhd.distance.nearest.target import AbstractTarget, ProvenFeet
from jhd.distance.project import project
from jhd.distance.search.on_patches import NetTarget
from jhd.distance.search.points import is_points
from jhd.distance.search.targets import proven_with_derivatives, target_of
from jhd.shapes.curve import AbstractCurve
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch
from jhd.solution import Projection

# Bounds may stay apart by this share of the size; about so many parts are made of all pieces of a surface.
_CLOSE, _PARTS = 2.0**-27, 64
# Most places that are looked at: what takes a tenth of a millisecond each on surfaces takes less on curves, and some
# microseconds elsewhere.
_MOST, _MOST_ON_CURVES, _MOST_ON_SURFACES = 1 << 18, 1 << 16, 1 << 15
# As many times as many where a derivative is to be confirmed, which jumps where feet do and the distance does not.
_PATIENCE = 4


class Seen(NamedTuple):
    """What is seen at places: distances, unit vectors away from the feet, slopes along the parameters, density.

    Args:
        distance: to the nearest foot, or to a near one.
        normal: (places, dim); zero at distance zero.
        slope: (places, parameters).
        density: length or area per parameter.
        label: which smooth part of the shape holds the foot, as a number: of two such parts they differ.
    """

    distance: Float[np.ndarray, " places"]
    normal: Float[np.ndarray, "places dim"]
    slope: Float[np.ndarray, "places parameters"]
    density: Float[np.ndarray, " places"]
    label: Int[np.ndarray, " places"]


class Sight:
    """Distances to b, whose numbers are known, from places given in another unit.

    Args:
        b: the shape.
        scale: a power of two; places and answers are multiplied with it.
        derived: whether derivatives are asked for.
    """

    def __init__(self, b: Any, scale: float, derived: bool):
        self.b, self.scale = jax.lax.stop_gradient(b), scale
        self._cuts = 1
        self._target: AbstractTarget | None = None
        if isinstance(b, AbstractPatch):
            net = net_of(self.b)
            self._cuts = max(1, round((_PARTS / len(net.points)) ** 0.5))
            self._target = NetTarget(_cut(net, self._cuts))
        elif is_points(b) or not isinstance(b, AbstractCurve):
            self._target = target_of(self.b.segments() if is_points(b) else self.b)
        low, high = (np.asarray(end) for end in self.b.box())
        self._close = _CLOSE * float(np.max(high - low))
        few = _MOST_ON_SURFACES if isinstance(b, AbstractPatch | ImplicitSurface) else _MOST_ON_CURVES
        self.most = (_MOST if is_points(b) or isinstance(b, TriangleMesh) else few) * (_PATIENCE if derived else 1)

    def feet(self, points: np.ndarray) -> ProvenFeet | Projection:
        """The nearest feet of points, in the unit of b."""
        # Known numbers need nothing of a derivative that is being taken around.
        with eval_context():
            if self._target is None:
                return project(points, self.b, throw=False)
            found = self._target.nearest(points, close=self._close)
        if self._cuts == 1:
            return found
        piece, part = np.divmod(found.segment, self._cuts**2)
        corner = np.stack(np.unravel_index(part, (self._cuts,) * 2), axis=1)
        return found._replace(segment=piece, t=(corner + found.t) / self._cuts)

    def distance(self, points: Any) -> np.ndarray:
        """Distances of points, times the scale."""
        return self.near(points)[0]

    def near(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances of points and their feet, both times the scale."""
        own = np.asarray(points) / self.scale
        found = self.feet(own)
        return np.asarray(found.distance) * self.scale, np.asarray(found.foot) * self.scale

    def at(self, net: Net, nodes: Nodes) -> Seen:
        """What is seen from places of a known net."""
        if len(nodes.piece) == 0:
            nothing = np.zeros(0)
            shapes = np.zeros((0, net.dim)), np.zeros((0, net.parameters))
            return Seen(nothing, *shapes, nothing, np.zeros(0, int))
        points, density, first = known_along(net, nodes)
        own = points / self.scale
        found = self.feet(own)
        # In units in which squares are numbers.
        apart = (own - np.asarray(found.foot)) * self.scale
        length = np.linalg.norm(apart, axis=1, keepdims=True)
        normal = apart / np.where(length > 0, length, 1.0)
        slope = np.sum(first * normal[:, None], axis=2)
        return Seen(np.asarray(found.distance) * self.scale, normal, slope, density, self._labels(found))

    def _labels(self, found: Any) -> np.ndarray:
        """The vertex, edge or face of a mesh, the inside, side or corner of a piece, or the faces of a box."""
        foot, segment, t = (np.asarray(x) for x in (found.foot, found.segment, found.t))
        segment = segment.astype(np.int64)
        if isinstance(self.b, TriangleMesh):
            held = np.sort(np.where(t > 0, np.asarray(self.b.triangles, np.int64)[segment] + 1, 0), axis=1)
            return held @ (len(self.b.vertices) + 1) ** np.arange(3, dtype=np.int64)
        low, high = self.b.box() if isinstance(self.b, ImplicitSurface) else (0.0, 1.0)
        at = foot if isinstance(self.b, ImplicitSurface) else t.reshape(len(t), -1)
        ends = (at <= np.asarray(low)) + 2 * (at >= np.asarray(high))
        return 27 * segment + ends @ 3 ** np.arange(ends.shape[1])

    def moving(self, points: Array, b: Any) -> Array:
        """Distances of places to b, differentiable in both."""
        if isinstance(b, AbstractPatch | ImplicitSurface):
            own = points / self.scale
            return proven_with_derivatives(self.feet(np.asarray(jax.lax.stop_gradient(own))), own, b) * self.scale
        return project(points / self.scale, b, throw=False).distance * self.scale


def _cut(net: Net, count: int) -> Net:
    """Each piece as so many parts along each parameter."""
    pieces = len(net.points)
    low = np.tile(np.array(list(np.ndindex(count, count))) / count, (pieces, 1))
    return jax.tree_util.tree_map(np.asarray, _parts(net, np.repeat(np.arange(pieces), count**2), low, 1 / count))


@compiled
def _parts(net: Net, piece: Any, low: Any, size: Any) -> Net:
    return jax.vmap(lambda k, at: part_of(net.piece(k), at, at + size))(piece, low)
