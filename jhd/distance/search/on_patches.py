"""Nearest points of parametric surfaces and curves in space, proven, for many queries at once.

A query is a pair search of a point and a net (jhd.distance.cells.pairs). The cells of all queries wait in one list: a
block of them is bounded by a compiled program, and the host cuts those that may still hold a nearer point. So the work
is that of the cells alone, whichever query they belong to. The first feet come from samples of the surface and a few
steps of Newton's method.

Rounding. The control points are taken relative to the query, which rounds each coordinate once, and scaled by a power
of two to at most one, for each pair of query and piece: bounds of a cell are relative to how far away its piece is.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma, smallest_normal, unit_roundoff
from jhd.arithmetic.scaling import common_exponent, length, unit_weights
from jhd.compiled import compiled, optimised
from jhd.distance.cells.beside import beside_net, of_points
from jhd.distance.cells.pairs import Cell, bound, derivatives, nearest_in, newton_step
from jhd.distance.frame.curves import padded_count
from jhd.distance.frame.net_jets import Net, jet, point_error
from jhd.distance.nearest.target import AbstractTarget, Flats, FootRows, ProvenFeet
from jhd.distance.search.patch_samples import samples_of, starts_among
from jhd.distance.search.rows import BLOCK, each, in_blocks
from jhd.triangles.closest_point import TriangleTree, in_unit_of, nearest_triangles, outward, point_tree

# Samples of a piece along each parameter from which feet are looked for, and Newton steps for feet.
_SAMPLES, _FOOT_STEPS = 6, 10
# Queries or cells that are bounded side by side: few, since often there are no more.
_LANES = 8
# A larger change of the parameters by one more Newton step is no mending.
_MENDED = 1e-6
# Pairs of queries and boxes of pieces that are formed at once.
_PAIRS = 1 << 20
# A query that needs more cells than this keeps the bounds it has; where there are few, those of all together.
_MOST, _MOST_OF_ALL = 4096, 1 << 17
# A query may be so many powers of two farther away than the surface is large before its coordinates would overflow.
_FAR = {8: 900, 4: 90}
# The gap at which a query is done, in units of roundoff of its distance and the size of the surface.
_CLOSE = 512


class _Cells(NamedTuple):
    """Cells that wait: query, piece, ends of the parameters (cells, 2 parameters), proven lower bound."""

    who: np.ndarray
    piece: np.ndarray
    low: np.ndarray
    high: np.ndarray
    lower: np.ndarray

    def take(self, rows: Any) -> "_Cells":
        """Some of the cells."""
        return _Cells(*(x[rows] for x in self))


class _Feet(NamedTuple):
    """The best foot of every query: proven upper bound, computed distance, piece, parameters."""

    upper: np.ndarray
    distance: np.ndarray
    piece: np.ndarray
    x: np.ndarray


class NetTarget(AbstractTarget):
    """A parametric surface, or a curve in space, its coordinates divided by 2^exponent, which leaves at most one."""

    block = 1024
    sharp = False

    def __init__(self, net: Net):
        points: Any = np.asarray(net.points)
        weights: Any = net.weights
        self.exponent = int(common_exponent(points))
        points = np.ldexp(points, -self.exponent)
        if weights is not None:
            weights = unit_weights(np.asarray(weights), (1, 2))
        self.count = len(points)
        index = np.minimum(np.arange(padded_count(self.count, small=True)), self.count - 1)
        self.net = Net(points, weights)
        self._padded = Net(points[index], None if weights is None else weights[index])
        places = np.linspace(0.0, 1.0, _SAMPLES).astype(points.dtype)
        samples = samples_of(self.net, places)
        self._places = places
        found = starts_among(samples.reshape(self.count, *[_SAMPLES] * self.net.parameters, 3))
        self._tree: TriangleTree = point_tree(samples.reshape(-1, 3)[found.rows])
        self._rows, self._beside = found
        self._off = float(np.ldexp(point_error(self.net), self.exponent))

    def rounding(self, distance: float) -> float:
        """See AbstractTarget."""
        size = float(np.ldexp(1.0, self.exponent))
        return 4 * _CLOSE * float(np.finfo(self.net.points.dtype).eps) * (size + distance)

    def feet(self, points: np.ndarray) -> np.ndarray:
        """See AbstractTarget."""
        scaled, shift = self._scaled(points)
        return outward(self._near(scaled, shift).upper, self.exponent + shift, points.dtype, 1)

    def near(self, points: np.ndarray) -> ProvenFeet:
        """See AbstractTarget."""
        scaled, shift = self._scaled(points)
        feet = self._near(scaled, shift)
        return self._placed(feet, shift, np.zeros(len(points)), np.zeros(len(points), bool), points.dtype)

    def error(self, found: ProvenFeet) -> np.ndarray:
        """See AbstractTarget."""
        # The unit of queries from afar is larger, and what rounding leaves of feet with it.
        u = unit_roundoff(found.distance.dtype)
        return np.maximum(found.upper - found.distance, 0.0) + 8 * u * found.distance + self._off

    def flats(self, feet: FootRows, corners: np.ndarray) -> Flats:
        """See AbstractTarget: parts of the pieces, and the feet themselves."""
        scale = -self.exponent
        scaled = feet.map(lambda x: np.ldexp(x, scale) if x is feet.point or x is feet.error else x)
        found = in_blocks(_beside, self._padded, *scaled, np.ldexp(corners, scale))
        return Flats(*(np.ldexp(x, self.exponent) for x in found))

    def parameters(self, t: np.ndarray) -> np.ndarray:
        """See AbstractTarget."""
        return t if self.net.parameters == 2 else t[:, 0]

    def nearest(self, points: np.ndarray, enough: float = -np.inf, close: float = 0.0) -> ProvenFeet:
        """See AbstractTarget."""
        scaled, shift = self._scaled(points)
        unit = self.exponent + shift
        with np.errstate(over="ignore"):
            least = np.ldexp(max(enough, -1.0), -unit) if np.isfinite(enough) else -np.inf
            close = float(np.ldexp(close, -unit))
        feet, lower, closed = self._searched(scaled, shift, least, close)
        return self._placed(feet, shift, lower, closed, points.dtype)

    def _placed(self, feet: _Feet, shift: int, lower: np.ndarray, closed: np.ndarray, dtype: Any) -> ProvenFeet:
        """The feet in the user's coordinates."""
        unit = self.exponent + shift
        foot = in_blocks(_points, self._shrunk(shift), feet.piece, feet.x)
        x = feet.x if feet.x.shape[1] == 2 else np.concatenate([feet.x, np.zeros_like(feet.x)], axis=1)
        low, high = outward(lower, unit, dtype, -1), outward(feet.upper, unit, dtype, 1)
        return ProvenFeet(
            distance=np.clip(np.ldexp(feet.distance, unit), low, high),
            lower=low,
            upper=high,
            foot=np.ldexp(foot, unit),
            segment=feet.piece,
            t=x,
            closed=closed,
        )

    def within(self, points: np.ndarray, upper: float) -> np.ndarray:
        """Which of the points may be this near, by the boxes of the pieces."""
        scaled, shift = self._scaled(points)
        room = 1 + gamma(64, points.dtype)
        with np.errstate(over="ignore"):
            far = float(np.ldexp(upper, -(self.exponent + shift))) * room + gamma(64, points.dtype)
        found = np.zeros(len(points), bool)
        found[self._whole(scaled, self._shrunk(shift), np.full(len(points), far)).who] = True
        return found

    def _scaled(self, points: np.ndarray) -> tuple[np.ndarray, int]:
        """The queries in the unit of the surface, or in a larger one by a power of two where they would overflow."""
        shift = max(0, int(common_exponent(points)) - self.exponent - _FAR[points.dtype.itemsize])
        return np.ldexp(points, -(self.exponent + shift)), shift

    def _shrunk(self, shift: int) -> Net:
        return self._padded if shift == 0 else self._padded._replace(points=np.ldexp(self._padded.points, -shift))

    def _near(self, points: np.ndarray, shift: int) -> _Feet:
        """Feet near the nearest samples, and what is left of the distance after some steps from there."""
        # Where the queries are in a larger unit than the samples they only start elsewhere.
        tree, rows = in_unit_of(self._tree, points)
        sample = self._rows[tree.order[nearest_triangles(tree, rows).triangle]]
        n = self.net.parameters
        piece, place = np.divmod(sample, _SAMPLES**n)
        places = np.stack(np.unravel_index(place, (_SAMPLES,) * n), axis=1)
        feet = self._moved(points, shift, piece, self._places[places])
        return self._beyond(points, shift, feet)

    def _beyond(self, points: np.ndarray, shift: int, feet: _Feet) -> _Feet:
        """The same inside of a piece; on its border the nearest of that and of those on its neighbours."""
        rows = np.flatnonzero(np.any((feet.x <= 0) | (feet.x >= 1), axis=1))
        shape = (_SAMPLES,) * self.net.parameters
        place = np.rint(feet.x[rows] * (_SAMPLES - 1)).astype(int)
        beside = self._beside[feet.piece[rows] * _SAMPLES ** len(shape) + np.ravel_multi_index(tuple(place.T), shape)]
        for sample in beside.T:
            some = sample >= 0
            who, sample = rows[some], sample[some]
            if not len(who):
                break
            piece, place = np.divmod(sample, _SAMPLES ** len(shape))
            found = self._moved(
                points[who], shift, piece, self._places[np.stack(np.unravel_index(place, shape), axis=1)]
            )
            better = found.upper < feet.upper[who]
            feet = _Feet(*(_written(held, who[better], new[better]) for held, new in zip(feet, found, strict=True)))
        return feet

    def _moved(self, points: np.ndarray, shift: int, piece: np.ndarray, x: np.ndarray) -> _Feet:
        upper, distance, x = in_blocks(_foot, self._shrunk(shift), points, piece, x)
        return _Feet(upper.astype(np.float64), distance, piece, x)

    def _searched(
        self, points: np.ndarray, shift: int, enough: float, apart: float
    ) -> tuple[_Feet, np.ndarray, np.ndarray]:
        """The best feet, proven lower bounds, and whether these are close enough."""
        feet, dtype = self._near(points, shift), points.dtype
        net, u = self._shrunk(shift), float(np.finfo(dtype).eps)
        settled, work = np.full(len(points), np.inf), np.zeros(len(points), int)
        most = max(_MOST, _MOST_OF_ALL // len(points))
        feet = _Feet(*(np.array(x) for x in feet))

        def goal() -> np.ndarray:
            """Cells with bounds from here on need not be looked at."""
            size = np.ldexp(1.0, -shift)
            close = _CLOSE * u * np.minimum(feet.upper + size, np.maximum(64 * feet.upper, size))
            return np.where(feet.upper <= enough, -np.inf, feet.upper - np.maximum(close, apart))

        stack = [self._whole(points, net, feet.upper)]
        while stack:
            cells = stack.pop()
            stop = cells.lower >= goal()[cells.who]
            stop |= work[cells.who] > most
            np.minimum.at(settled, cells.who[stop], cells.lower[stop])
            cells = cells.take(~stop)
            if not len(cells.who):
                continue
            if len(cells.who) > BLOCK:
                stack.append(cells.take(slice(BLOCK, None)))
                cells = cells.take(slice(None, BLOCK))
            np.add.at(work, cells.who, 1)
            found = in_blocks(_bounded, net, points[cells.who], *cells[1:4])
            _take_over(feet, cells, *found[1:4])
            lower = np.maximum(cells.lower, np.nan_to_num(found[0].astype(np.float64), nan=0.0, posinf=np.inf))
            low, high, axis, thin = found[4:]
            np.minimum.at(settled, cells.who[thin], lower[thin])
            stack.append(_halved(_Cells(cells.who, cells.piece, low, high, lower).take(~thin), axis[~thin]))
        lower = np.minimum(settled, feet.upper)
        closed = (lower >= goal()) | (feet.upper <= enough)
        polished = self._moved(points, shift, feet.piece, feet.x)
        better = polished.upper <= feet.upper
        feet = _Feet(
            *(np.where(better.reshape(-1, *[1] * (x.ndim - 1)), y, x) for x, y in zip(feet, polished, strict=True))
        )
        return feet, np.minimum(lower, feet.upper), closed

    def _whole(self, points: np.ndarray, net: Net, upper: np.ndarray) -> _Cells:
        """Whole pieces whose boxes are not farther away than the feet; boxes of control points round three times."""
        low, high = (f(net.points[: self.count], axis=(1, 2)).astype(np.float64) for f in (np.min, np.max))
        rows, pieces, lowers = [], [], []
        step = max(1, _PAIRS // self.count)
        room = 1 - gamma(16, np.float64)
        for start in range(0, len(points), step):
            p = points[start : start + step, None].astype(np.float64)
            apart = np.maximum(np.maximum(low - p, p - high), 0.0) * room
            size = np.max(apart, axis=2, keepdims=True)
            scaled = apart / np.where(size > 0, size, 1.0)
            lower = size[..., 0] * np.sqrt(np.sum(scaled * scaled, axis=2)) * room
            row, piece = np.nonzero(lower <= upper[start : start + step, None])
            rows.append(row + start)
            pieces.append(piece)
            lowers.append(lower[row, piece])
        who, piece = np.concatenate(rows), np.concatenate(pieces)
        n, dtype = self.net.parameters, points.dtype
        return _Cells(who, piece, np.zeros((len(who), n), dtype), np.ones((len(who), n), dtype), np.concatenate(lowers))


def _halved(cells: _Cells, axis: np.ndarray) -> _Cells:
    """Both halves of every cell; one of what has shrunk to a point."""
    along = axis[:, None] == np.arange(cells.low.shape[1])
    middle = 0.5 * (cells.low + cells.high)
    first = cells._replace(high=np.where(along, middle, cells.high))
    second = cells._replace(low=np.where(along, middle, cells.low)).take(np.any(cells.low < cells.high, axis=1))
    return _Cells(*(np.concatenate(x) for x in zip(first, second, strict=True)))


def _take_over(feet: _Feet, cells: _Cells, upper: np.ndarray, distance: np.ndarray, x: np.ndarray) -> None:
    """The feet found in cells, where they are nearer than those known."""
    upper = np.where(np.isnan(upper), np.inf, upper.astype(np.float64))
    order = np.lexsort((-upper, cells.who))
    # Of each query the nearest is written last.
    rows = order[upper[order] < feet.upper[cells.who[order]]]
    who = cells.who[rows]
    feet.upper[who], feet.distance[who], feet.piece[who] = upper[rows], distance[rows], cells.piece[rows]
    feet.x[who] = x[rows]


def _written(held: np.ndarray, rows: np.ndarray, new: np.ndarray) -> np.ndarray:
    """A copy with some rows exchanged."""
    held = np.array(held)
    held[rows] = new
    return held


class _About(NamedTuple):
    """A piece relative to a query, its coordinates at most one in a unit of its own, and the query as a net."""

    point: Net
    piece: Net
    unit: Array

    @property
    def error(self) -> float:
        """Bound on what taking differences moves a control point by, flushed digits included, in the unit."""
        return gamma(4, self.piece.points.dtype)


def _about(net: Net, point: Array, piece: Array) -> _About:
    part = net.piece(piece)
    offsets = jnp.asarray(part.points) - point
    unit = jnp.maximum(jnp.max(jnp.abs(offsets)), 4 * smallest_normal(offsets.dtype))
    power = jnp.frexp(unit)[1]
    one = jnp.ones((1, 1, 3), offsets.dtype)
    return _About(Net(0 * one, None), Net(jnp.ldexp(offsets, -power), part.weights), power)


def _lengths(about: _About, lower: Array, upper: Array, distance: Array) -> tuple[Array, Array, Array]:
    """Bounds and a distance in the unit of the surface; what is flushed there counts."""
    dtype = distance.dtype
    tiny = 64 * smallest_normal(dtype)
    low = jnp.maximum(lower - about.error, 0.0) * (1 - gamma(4, dtype))
    low = jnp.maximum(jnp.ldexp(low, about.unit) - tiny, 0.0)
    high = (upper + about.error) * (1 + gamma(4, dtype))
    return low, jnp.ldexp(high, about.unit) + tiny, jnp.ldexp(distance, about.unit)


def _fixed(n: int) -> np.ndarray:
    """The query has one parameter, which has one value only."""
    return np.arange(1 + n) == 0


def _mended(about: _About, x: Array, fixed: Array) -> Array:
    """Distances are as good as they get where the parameters are off by the root of that; two more steps mend it."""
    for _ in range(2):
        _, slope, bent = derivatives(jet(about.point, x[:1]), jet(about.piece, x[1:]))
        held = fixed | ((x <= 0) & (slope > 0)) | ((x >= 1) & (slope < 0))
        step = newton_step(slope, bent, held)
        x = jnp.where(jnp.max(jnp.abs(step)) < _MENDED, jnp.clip(x + step, 0.0, 1.0), x)
    return x


@optimised
def _foot(net: Net, count: Array, points: Array, piece: Array, start: Array) -> Any:
    """Upper bounds, distances and parameters of points of pieces near the starts, moved towards the nearest."""

    def one(point: Array, k: Array, x: Array) -> Any:
        about = _about(net, point, k)
        x = jnp.concatenate([jnp.zeros((1,), x.dtype), x])
        fixed = jnp.asarray(_fixed(net.parameters))
        x = _mended(about, nearest_in(about.point, about.piece, x, fixed, _FOOT_STEPS), fixed)
        distance = length(jet(about.piece, x[1:]).point)
        upper = distance * (1 + gamma(12, distance.dtype)) + point_error(about.piece)
        _, upper, distance = _lengths(about, jnp.zeros_like(upper), upper, distance)
        return upper, distance, x[1:]

    return each(one, count, (points, piece, start), _LANES)


@compiled
def _bounded(net: Net, count: Array, points: Array, piece: Array, low: Array, high: Array) -> Any:
    """Bounds, a foot, and what is left of cells, with the axis to cut along."""

    def one(point: Array, k: Array, low: Array, high: Array) -> Any:
        about = _about(net, point, k)
        zero = jnp.zeros((1,), low.dtype)
        a, b = jax.tree_util.tree_map(lambda x: x[None], (about.point, about.piece))
        first = jnp.zeros((), int)
        cell = Cell(first, first, jnp.concatenate([zero, low]), jnp.concatenate([zero, high]))
        found = bound(a, b, cell)
        # An excluded cell has an infinite bound.
        lower, upper, distance = _lengths(about, found.lower, found.upper, found.distance)
        left = found.cell
        return lower, upper, distance, found.x[1:], left.low[1:], left.high[1:], found.axis - 1, found.thin

    return each(one, count, (points, piece, low, high), _LANES)


@compiled
def _points(net: Net, count: Array, piece: Array, x: Array) -> Array:
    return each(lambda k, x: jet(net.piece(k), x).point, count, (piece, x), _LANES)


@compiled
def _beside(net: Net, count: Array, point: Array, error: Array, segment: Array, t: Array, corners: Array) -> Flats:
    """Flat pieces beside cells: parts of the net, then the feet themselves."""

    def one(point: Array, error: Array, segment: Array, t: Array, corners: Array) -> Flats:
        parts = jax.vmap(lambda k, x: beside_net(net, k, x, corners))(segment, t[:, : net.parameters])
        feet = of_points(point, error)
        return jax.tree_util.tree_map(lambda x, y: jnp.concatenate([x, y]), parts, feet)

    return each(one, count, (point, error, segment, t, corners), _LANES)
