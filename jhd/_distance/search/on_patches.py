"""Nearest points of parametric surfaces and curves in space, proven, for many queries at once.

The first feet come from samples of the surface and a few steps of Newton's method. Most of them are proven at once: the
distance is convex over a part of the piece about the foot, and this part contains all parts that boxes do not exclude
(jhd._distance.search.patch_boxes).

Each remaining query is a pair search of a point and a net (jhd._distance.cells.pairs). The cells of all queries wait in
one list: a compiled function bounds a block of them, and the host cuts the cells that may still hold a nearer point. So
the work depends only on the number of cells, not on their distribution over queries.

Rounding. Surfaces far from the origin are moved there along the axes on which the move is exact. Queries are moved with
them, and the bounds include the rounding of this move. The control points are taken relative to the query, which rounds
each coordinate once, and scaled by a power of two to at most one, for each pair of query and piece: bounds of a cell
are relative to how far away its piece is.
"""

from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._arithmetic.rounding import gamma, smallest_normal, unit_roundoff
from jhd._arithmetic.scaling import common_exponent, frexp, ldexp, length, times_two_to, unit, unit_weights
from jhd._distance.cells.flat_pieces import beside_net, of_points
from jhd._distance.cells.pairs import Cell, bound, nearest_in
from jhd._distance.cells.squared_distance_bounds import distances_by_squares
from jhd._distance.nearest.target import AbstractTarget, Flats, FootRows, ProvenFeet
from jhd._distance.normalization.coordinates import exact_middle, extremes, frame_of, moved_by
from jhd._distance.normalization.curves import padded_count
from jhd._distance.normalization.net_jets import Net, jet, point_error
from jhd._distance.search.patch_boxes import PatchBoxes, PieceParts, SettledParts
from jhd._distance.search.patch_samples import SampledStarts, samples_of, starts_among
from jhd._distance.search.row_batches import BLOCK, each, in_blocks
from jhd._runtime.arrays import joined, taken
from jhd._runtime.compiled import compiled, optimized
from jhd._triangles.closest_point import outward

# Samples of a piece along each parameter from which feet are searched, and Newton steps for feet.
_SAMPLES, _FOOT_STEPS = 6, 10
# Queries or cells that are bounded in one batch: few, since often there are no more.
_LANES = 8
# Distances are equal if they differ by less than this many units of roundoff of the surface and the distance.
_TIED = 16
# Feet no farther from a pole, a point onto which an edge is collapsed, are searched all around it.
_AT_POLE = 1e-5
# Directions from a pole lead to points this far from samples (fraction of the parameters), and bend by at most this.
_INSIDE, _BENT = 2.0**-10, 0.05
# Newton steps that correct feet, and how much they may change parameters.
_MENDING, _MENDED = 2, 1e-6
# Cells of a query from which on squares bound them too. Queries with no convex part, for example on an axis of
# revolution, use squares from the first cell on.
_HARD = 64
# Half sides of the parts about feet that are bounded first: the first serves nearly all points of smooth surfaces, the
# last the points near poles and centers of curvature.
_REACHES = 2.0**-3, 2.0**-5, 2.0**-7
# A query that needs more cells keeps the bounds it has; for few queries the second number limits all cells together.
_MOST, _MOST_OF_ALL = 4096, 1 << 17
# Largest distance of a query, in powers of two of the size of the surface, before its coordinates would overflow.
_FAR = {8: 900, 4: 90}
# The gap at which a query is done, in units of roundoff of its distance and the size of the surface.
_CLOSE = 512


class _Feet(NamedTuple):
    """The best foot of every query: proven upper bound, computed distance, piece, parameters, point."""

    upper: np.ndarray
    distance: np.ndarray
    piece: np.ndarray
    x: np.ndarray
    point: np.ndarray

    take = taken

    def put(self, rows: np.ndarray, new: "_Feet") -> None:
        """Replace the feet of some queries."""
        for held, found in zip(self, new, strict=True):
            held[rows] = found


class NetTarget(AbstractTarget):
    """A parametric surface, or a curve in space, about the origin, divided by 2^exponent, which leaves at most one."""

    block = 1024
    sharp = False

    def __init__(self, net: Net):
        given: Any = np.asarray(net.points)
        weights: Any = net.weights
        frame = frame_of([extremes(given)], center=exact_middle)
        # On axes on which moving would round, the center is zero.
        self._is_moved = bool(np.any(frame.center))
        # Twice the unit about the middle, which is the unit of a surface with a corner at the origin.
        self.exponent = int(frame.first + frame.second) + self._is_moved
        points, self._center = (
            np.ldexp(x, int(frame.first) - self.exponent)
            for x in (np.ldexp(given, -int(frame.first)) - frame.center, frame.center)
        )
        if weights is not None:
            weights = unit_weights(np.asarray(weights), (1, 2))
        self.count = len(points)
        index = np.minimum(np.arange(padded_count(self.count, small=True)), self.count - 1)
        self.net = Net(points, weights)
        self._padded = Net(points[index], None if weights is None else weights[index])
        places = np.linspace(0.0, 1.0, _SAMPLES)
        samples = samples_of(self.net, places)
        # Samples are numbered by their indices along each parameter.
        self._places, self._strides = places.astype(points.dtype), _SAMPLES ** np.arange(self.net.parameters)[::-1]
        found = starts_among(samples.reshape(self.count, *[_SAMPLES] * self.net.parameters, 3))
        self._rows, self._beside, self._at_poles = found
        samples = samples.reshape(-1, 3)
        self._samples = SampledStarts(samples[self._rows].astype(points.dtype))
        self._poles = SampledStarts(samples[self._at_poles[:, 0]].astype(points.dtype))
        # Moving feet back rounds them once.
        back = np.sqrt(3) * gamma(2, points.dtype) * float(np.max(np.abs(given))) if self._is_moved else 0.0
        self._off = float(np.ldexp(point_error(self.net), self.exponent)) + back

    @cached_property
    def _from_poles(self) -> np.ndarray:
        """Unit vectors (poles, most, 3) that lead from each pole into the pieces, one for each sample around it."""
        places = np.linspace(0.0, 1.0, _SAMPLES)
        ends = (samples_of(self.net, x) for x in (places, places + _INSIDE * np.sign(0.5 - places)))
        start, end = (x.reshape(-1, 3)[self._at_poles] for x in ends)
        return unit(end - start)

    @cached_property
    def _boxes(self) -> PatchBoxes:
        return PatchBoxes(self.net)

    @override
    def rounding(self, distance: float) -> float:
        size = float(np.ldexp(1.0, self.exponent))
        return 4 * _CLOSE * float(np.finfo(self.net.points.dtype).eps) * (size + distance)

    @override
    def feet(self, points: np.ndarray) -> np.ndarray:
        scaled, shift = self._scaled(points)
        upper = self._near(scaled, shift).upper + self._moved_by(scaled)
        return outward(upper, self.exponent + shift, points.dtype, 1)

    @override
    def near(self, points: np.ndarray) -> ProvenFeet:
        scaled, shift = self._scaled(points)
        feet = self._near(scaled, shift)
        return self._placed(feet, shift, np.zeros(len(points)), np.zeros(len(points), bool), scaled)

    @override
    def error(self, found: ProvenFeet) -> np.ndarray:
        # The unit of far queries is larger, and so is the rounding of their feet.
        u = unit_roundoff(found.distance.dtype)
        return np.maximum(found.upper - found.distance, 0.0) + 8 * u * found.distance + self._off

    @override
    def flats(self, feet: FootRows, corners: np.ndarray) -> Flats:
        """Return flat parts of the pieces, and the feet themselves."""
        scale, center = -self.exponent, self._center
        scaled = feet._replace(point=np.ldexp(feet.point, scale) - center, error=np.ldexp(feet.error, scale))
        found = in_blocks(_beside, self._padded, *scaled, np.ldexp(corners, scale) - center)
        origin, first, second, sag = (np.ldexp(x, self.exponent) for x in (found.origin + center, *found[1:]))
        if self._is_moved:
            # Feet were rounded when they were moved, and all origins when they are moved back.
            sag = sag + 4 * gamma(4, sag.dtype) * np.max(np.abs(origin), axis=-1)
        return Flats(origin, first, second, sag)

    @override
    def parameters(self, t: np.ndarray) -> np.ndarray:
        return t if self.net.parameters == 2 else t[:, 0]

    @override
    def nearest(
        self, points: np.ndarray, enough: float | np.ndarray = -np.inf, close: float = 0.0, hasty: bool = False
    ) -> ProvenFeet:
        scaled, shift = self._scaled(points)
        unit = self.exponent + shift
        with np.errstate(over="ignore"):
            least = np.ldexp(np.broadcast_to(enough, len(points)), -unit) - self._moved_by(scaled)
            close = float(np.ldexp(close, -unit))
        feet, lower, closed = self._searched(scaled, shift, least, close, hasty)
        return self._placed(feet, shift, lower, closed, scaled)

    def _placed(self, feet: _Feet, shift: int, lower: np.ndarray, closed: np.ndarray, scaled: np.ndarray) -> ProvenFeet:
        """Return the feet of scaled queries in the user's coordinates."""
        unit, off, dtype = self.exponent + shift, self._moved_by(scaled), scaled.dtype
        x = feet.x if feet.x.shape[1] == 2 else np.concatenate([feet.x, np.zeros_like(feet.x)], axis=1)
        low, high = outward(lower - off, unit, dtype, -1), outward(feet.upper + off, unit, dtype, 1)
        return ProvenFeet(
            distance=np.clip(np.ldexp(feet.distance, unit), low, high),
            lower=low,
            upper=high,
            foot=np.ldexp(feet.point + np.ldexp(self._center, -shift), unit),
            segment=feet.piece,
            t=x,
            closed=closed,
        )

    def within(self, points: np.ndarray, upper: float) -> np.ndarray:
        """Return a mask of the points that may be within `upper` of the surface, by the boxes of the pieces."""
        scaled, shift = self._scaled(points)
        room = 1 + gamma(64, points.dtype)
        with np.errstate(over="ignore"):
            far = float(np.ldexp(upper, -(self.exponent + shift))) * room + gamma(64, points.dtype)
        found = np.zeros(len(points), bool)
        found[self._boxes.near(scaled, far + self._moved_by(scaled), shift).who] = True
        return found

    def _scaled(self, points: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the queries in the unit of the surface times a power of two that avoids overflow, and the power."""
        shift = max(0, int(common_exponent(points)) - self.exponent - _FAR[points.dtype.itemsize])
        return np.ldexp(points, -(self.exponent + shift)) - np.ldexp(self._center, -shift), shift

    def _moved_by(self, scaled: np.ndarray) -> np.ndarray:
        return moved_by(scaled) if self._is_moved else np.zeros(len(scaled))

    def _shrunk(self, shift: int) -> Net:
        return self._padded if shift == 0 else self._padded._replace(points=np.ldexp(self._padded.points, -shift))

    def _near(self, points: np.ndarray, shift: int) -> _Feet:
        """Return feet near the nearest samples, after some Newton steps."""
        # Queries in a larger unit than the samples only start elsewhere.
        feet = self._from_samples(points, shift, self._rows[self._samples.nearest(points)])
        size = float(np.ldexp(1.0, -shift))
        # Inside a piece this suffices. On its border feet on neighboring pieces may be nearer.
        rows = np.flatnonzero(np.any((feet.x <= 0) | (feet.x >= 1), axis=1))
        place = np.rint(feet.x[rows] * (_SAMPLES - 1)).astype(int)
        sample = self._beside[feet.piece[rows] * _SAMPLES ** place.shape[1] + place @ self._strides]
        who, column = np.nonzero(sample >= 0)
        if len(who):
            _take_over(feet, rows[who], self._from_samples(points[rows[who]], shift, sample[who, column]), size)
        self._look_around_poles(feet, points, shift)
        return feet

    def _look_around_poles(self, feet: _Feet, points: np.ndarray, shift: int) -> None:
        """Search feet near a pole from all samples around it: Newton's method turns by less than 45 degrees."""
        if not len(self._at_poles):
            return
        there = np.ldexp(feet.point, shift)
        pole = self._poles.nearest(there)
        near = np.flatnonzero(np.max(np.abs(there - self._poles.points[pole]), axis=1) <= _AT_POLE)
        for start in range(0, len(near), BLOCK):
            rows = near[start : start + BLOCK]
            away = points[rows] - np.ldexp(self._poles.points[pole[rows]], -shift)
            # From an apex no direction leads nearer.
            nearer = np.einsum("nk,nmk->nm", away, self._from_poles[pole[rows]])
            ahead = nearer >= -_BENT * np.max(np.abs(away), axis=1, keepdims=True)
            samples = self._at_poles[pole[rows]]
            who, column = np.nonzero(ahead & (samples >= 0))
            if len(who):
                found = self._from_samples(points[rows[who]], shift, samples[who, column])
                _take_over(feet, rows[who], found, float(np.ldexp(1.0, -shift)))

    def _from_samples(self, points: np.ndarray, shift: int, sample: np.ndarray) -> _Feet:
        piece, place = np.divmod(sample, _SAMPLES**self.net.parameters)
        return self._moved(points, shift, piece, self._places[place[:, None] // self._strides % _SAMPLES])

    def _moved(self, points: np.ndarray, shift: int, piece: np.ndarray, x: np.ndarray) -> _Feet:
        upper, distance, x, point = in_blocks(_foot, self._shrunk(shift), points, piece, x)
        return _Feet(*(np.array(y) for y in (upper.astype(np.float64), distance, piece, x, point)))

    def _settled_about(
        self, feet: _Feet, points: np.ndarray, net: Net, goal: np.ndarray, settled: np.ndarray
    ) -> SettledParts:
        """Return parts of pieces about feet, proven to hold nothing nearer than `goal`; bounds go to `settled`."""
        about = SettledParts.nothing(points, self.net.parameters)
        for reach in _REACHES:
            rows = np.flatnonzero((goal > 0) & (about.piece < 0))
            if not len(rows):
                break
            low, high = (np.clip(feet.x[rows] + x, 0, 1).astype(points.dtype) for x in (-reach, reach))
            lower = in_blocks(_bounded, net, points[rows], feet.piece[rows], low, high)[0].astype(np.float64)
            good = lower >= goal[rows]
            rows = rows[good]
            settled[rows], about.piece[rows] = lower[good], feet.piece[rows]
            about.low[rows], about.high[rows] = low[good], high[good]
        return about

    def _searched(
        self, points: np.ndarray, shift: int, enough: np.ndarray, apart: float, hasty: bool
    ) -> tuple[_Feet, np.ndarray, np.ndarray]:
        """Return the best feet, proven lower bounds, and whether the bounds are close enough."""
        feet, dtype = self._near(points, shift), points.dtype
        net, u = self._shrunk(shift), float(np.finfo(dtype).eps)
        settled, work = np.full(len(points), np.inf), np.zeros(len(points), int)
        polished_at = feet.x.copy()

        def goal() -> np.ndarray:
            """Return the bound from which on cells need no search."""
            size = np.ldexp(1.0, -shift)
            close = _CLOSE * u * np.minimum(feet.upper + size, np.maximum(64 * feet.upper, size))
            return np.where(feet.upper <= enough, -np.inf, feet.upper - np.maximum(close, apart))

        about = self._settled_about(feet, points, net, goal(), settled)
        stack = [self._boxes.near(points, feet.upper, shift, about, goal())]
        most = _MOST if hasty else max(_MOST, _MOST_OF_ALL // max(1, len(np.unique(stack[0].who))))
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
            upper = np.where(np.isnan(found[1]), np.inf, found[1].astype(np.float64))
            _take_over(feet, cells.who, _Feet(upper, found[2], cells.piece, *found[3:5]))
            lower = np.maximum(cells.lower, np.nan_to_num(found[0].astype(np.float64), nan=0.0, posinf=np.inf))
            low, high, axis, thin = found[5:]
            hard = (about.piece < 0) | (work > _HARD)
            hard = np.flatnonzero(hard[cells.who] & (lower < goal()[cells.who]))
            if len(hard):
                some = cells.take(hard)
                squares, across = distances_by_squares(net, points[some.who], *some[1:4], goal()[some.who])
                lower[hard] = np.maximum(lower[hard], squares)
                axis = axis.copy()
                axis[hard] = across
            np.minimum.at(settled, cells.who[thin], lower[thin])
            stack.append(_halved(PieceParts(cells.who, cells.piece, low, high, lower).take(~thin), axis[~thin]))
        lower = np.minimum(settled, feet.upper)
        closed = (lower >= goal()) | (feet.upper <= enough)
        new = np.flatnonzero(np.any(feet.x != polished_at, axis=1))
        if len(new):
            polished = self._moved(points[new], shift, feet.piece[new], feet.x[new])
            better = polished.upper <= feet.upper[new]
            feet.put(new[better], polished.take(better))
        return feet, np.minimum(lower, feet.upper), closed


def _halved(cells: PieceParts, axis: np.ndarray) -> PieceParts:
    """Return both halves of every cell; a cell that has shrunk to a point stays whole."""
    along = axis[:, None] == np.arange(cells.low.shape[1])
    middle = 0.5 * (cells.low + cells.high)
    first = cells._replace(high=np.where(along, middle, cells.high))
    second = cells._replace(low=np.where(along, middle, cells.low)).take(np.any(cells.low < cells.high, axis=1))
    return joined([first, second])


def _take_over(feet: _Feet, who: np.ndarray, found: _Feet, size: float = 0.0) -> None:
    """Replace the feet of queries by the feet found if these are nearer.

    Of feet that are equal up to rounding, a foot that no border of a piece holds is preferred: the neighboring piece
    may have the foot, and its distance determines it only to the root of rounding.
    """
    new, old = (
        x.upper + np.where(np.any((x.x <= 0) | (x.x >= 1), axis=1), _TIED, 0) * _rounding(x, size)
        for x in (found, feet)
    )
    old = old[who]
    order = np.lexsort((-new, who))
    # The nearest foot of each query is written last.
    rows = order[new[order] < old[order]]
    feet.put(who[rows], found.take(rows))


def _rounding(feet: _Feet, size: float) -> np.ndarray:
    """Return one unit of roundoff of a size and the distances; zero without a size."""
    return float(np.finfo(feet.x.dtype).eps) * (size + feet.upper) if size else np.zeros(len(feet.upper))


class _About(NamedTuple):
    """A piece relative to a query, its coordinates at most one in a unit of its own, and the query as a net."""

    point: Net
    piece: Net
    unit: Array

    @property
    def error(self) -> float:
        """Bound the error of a control point by differences, flushed digits included, in the unit."""
        return gamma(4, self.piece.points.dtype)


def _about(net: Net, point: Array, piece: Array) -> _About:
    part = net.piece(piece)
    offsets = jnp.asarray(part.points) - point
    unit = jnp.maximum(jnp.max(jnp.abs(offsets)), 4 * smallest_normal(offsets.dtype))
    power = frexp(unit)[1]
    one = jnp.ones((1, 1, 3), offsets.dtype)
    return _About(Net(0 * one, None), Net(ldexp(offsets, -power), part.weights), power)


def _lengths(about: _About, lower: Array, upper: Array, distance: Array) -> tuple[Array, Array, Array]:
    """Return bounds and a distance in the unit of the surface, including the error of flushing."""
    dtype = distance.dtype
    tiny = 64 * smallest_normal(dtype)
    low = jnp.maximum(lower - about.error, 0.0) * (1 - gamma(4, dtype))
    low = jnp.maximum(times_two_to(low, about.unit) - tiny, 0.0)
    high = (upper + about.error) * (1 + gamma(4, dtype))
    return low, times_two_to(high, about.unit) + tiny, times_two_to(distance, about.unit)


@optimized
def _foot(net: Net, count: Array, points: Array, piece: Array, start: Array) -> Any:
    """Return upper bounds, distances, parameters and points of pieces near the starts, moved towards the nearest."""

    def one(point: Array, k: Array, x: Array) -> Any:
        about = _about(net, point, k)
        fixed = jnp.zeros(x.shape, bool)
        x = nearest_in(about.point, about.piece, x, fixed, _FOOT_STEPS, _MENDING, _MENDED)
        distance = length(jet(about.piece, x).point)
        upper = distance * (1 + gamma(12, distance.dtype)) + point_error(about.piece)
        _, upper, distance = _lengths(about, jnp.zeros_like(upper), upper, distance)
        return upper, distance, x, jet(net.piece(k), x).point

    return each(one, count, (points, piece, start), _LANES)


@compiled
def _bounded(net: Net, count: Array, points: Array, piece: Array, low: Array, high: Array) -> Any:
    """Return bounds and a foot for each cell, the part of it that remains, and the axis to cut along."""

    def one(point: Array, k: Array, low: Array, high: Array) -> Any:
        about = _about(net, point, k)
        a, b = jax.tree_util.tree_map(lambda x: x[None], (about.point, about.piece))
        first = jnp.zeros((), int)
        found = bound(a, b, Cell(first, first, low, high))
        # An excluded cell has an infinite bound.
        lower, upper, distance = _lengths(about, found.lower, found.upper, found.distance)
        left, x = found.cell, found.x
        point = jet(net.piece(k), x).point
        return lower, upper, distance, x, point, left.low, left.high, jnp.argmax(found.extent), found.thin

    return each(one, count, (points, piece, low, high), _LANES)


@compiled
def _beside(net: Net, count: Array, point: Array, error: Array, segment: Array, t: Array, corners: Array) -> Flats:
    """Return flat pieces near cells: parts of the net, then the feet themselves."""

    def one(point: Array, error: Array, segment: Array, t: Array, corners: Array) -> Flats:
        parts = jax.vmap(lambda k, x: beside_net(net, k, x, corners))(segment, t[:, : net.parameters])
        feet = of_points(point, error)
        return jax.tree_util.tree_map(lambda x, y: jnp.concatenate([x, y]), parts, feet)

    return each(one, count, (point, error, segment, t, corners), _LANES)
