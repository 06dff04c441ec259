"""PivotDistances: distances of shapes from fixed points, which bound the distances of all pairs at once.

The Hausdorff distance h(a, b) is the largest |d(p, a) - d(p, b)| over all points p of the space. So the distances from
a few points, taken once for each shape, bound every pair from below. If every point x of a has a point p of a lattice
within r, they also bound from above: d(p, a) <= r and d(x, b) <= d(p, b) + r.

Polynomial curves are measured as chords of their segments. Coordinates are at most one there, and u is the roundoff:

- moving to common coordinates displaces control points, and so the curve, and the points by `preparation_error` each;
- the ends of the chords are sums of n + 1 products with Bernstein polynomials that took 2 n + 2 roundings: they are off
  by gamma(3 n + 5) in each coordinate;
- over a part of length 1 / m of a segment the chord deviates by at most n (n - 1) / (8 m^2) of the largest second
  difference of the control points, whose own rounding is below 4 u in each coordinate;
- for a chord from S along E and o = p - S, the parameter s = o.E / E.E is off by gamma(2 dim + 5) |o| / |E|, the offset
  o - s E by three roundings of its terms, its length by gamma(dim + 2): altogether the distance is off by at most
  gamma(3 dim + 12) (|o| + |E|), and neither length is above 2 sqrt(dim). If E.E underflows, E is shorter than any of
  these errors.

Other shapes are measured by jhd.project, whose bounds are certified. Distances from fixed points are the pivots of
metric search. Here they may be any points of the space, so they need no Hausdorff distance.
"""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._arithmetic.rounding import gamma, round_down, round_up, unit_roundoff
from jhd._arithmetic.scaling import common_exponent
from jhd._distance.collections.blocks import SIZES
from jhd._distance.collections.shapes import Collection
from jhd._distance.collections.tasks import completed
from jhd._distance.normalization.coordinates import Frame, common_points, frame_of
from jhd._distance.normalization.curves import preparation_error
from jhd._distance.project import project
from jhd._results.display import count_text, described, opaque
from jhd._runtime.compiled import optimized
from jhd._shapes.curve import BezierSegments

# Points of a lattice: four times as many halve the number of distances that are left, and cost more than these.
_POINTS = 200
# Chords of a segment: they deviate by a sixteenth of the deviation of a single chord.
_CHORDS = 4
# Shapes in one call of the compiled function, and pivot distances that one call compares with all others.
_SHAPES, _ROWS = 16, 32
# Room for underflow, far below everything else.
_TINY = 2.0**-400
# Shapes whose windows are compared together.
_TOGETHER = 64


class PointLattice(NamedTuple):
    """Points in the unit of the shapes: the product of some numbers along each axis."""

    axes: tuple[np.ndarray, ...]

    @property
    def points(self) -> np.ndarray:
        """Return the points (points, dim)."""
        return np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(-1, len(self.axes))


class PivotDistances(NamedTuple):
    """Certified distances of shapes from fixed points, in the unit of the coordinates.

    The bounds are certified and may be wide: curves are replaced by chords, and no `result` tells whether a search ends
    early.

    Args:
        points: the points, (points, dim).
        lower: certified lower bounds of the distances, (shapes, points).
        upper: certified upper bounds of the distances, (shapes, points).
        covering_radius: for each shape a radius within which each of its points has one of `points`; inf if it is
            unknown.
    """

    points: Float[np.ndarray, "points dim"]
    lower: Float[np.ndarray, "shapes points"]
    upper: Float[np.ndarray, "shapes points"]
    covering_radius: Float[np.ndarray, " shapes"]

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        shapes, points = self.lower.shape[-2:]
        return described(self, f"{count_text(shapes, 'shape')} from {count_text(points, 'point')}")


def lattice_over(*collections: Collection) -> PointLattice:
    """Return a lattice over the boxes of most shapes: a few shapes far away do not make it coarse."""
    corners = [corner for collection in collections for corner in collection.corners]
    frame = frame_of(corners)
    low, high = (common_points(frame, np.stack(x)) for x in zip(*corners, strict=True))
    low, high = np.percentile(low, 1, axis=0), np.percentile(high, 99, axis=0)
    side = np.maximum(high - low, 0.0)
    step = max(float(np.max(side)), _TINY) / _POINTS
    while np.prod(np.maximum(np.ceil(side / step), 1)) > _POINTS:
        step *= 1.05
    numbers = np.maximum(np.ceil(side / step), 1).astype(int)
    along = [x + s * (np.arange(n) + 0.5) / n for x, s, n in zip(low, side, numbers, strict=True)]
    longest = max(numbers)
    table = np.stack([x[np.minimum(np.arange(longest), len(x) - 1)] for x in along], axis=1)
    placed = np.asarray(frame.place(table))
    return PointLattice(tuple(placed[:n, k] for k, n in enumerate(numbers)))


def reaches(collection: Collection, lattice: PointLattice) -> np.ndarray:
    """Return for each shape a length within which each of its points has a lattice point, rounded up.

    Along each axis the distance from the nearest number is largest at an end of the shape's box or half way between
    two numbers.
    """
    lowest, highest = (np.array([end(x) for x in lattice.axes]) for end in (np.min, np.max))
    frame = frame_of([*collection.corners, (lowest, highest)])
    low, high = (common_points(frame, np.stack(x)) for x in zip(*collection.corners, strict=True))
    gaps = []
    for k, axis in enumerate(lattice.axes):
        table = np.repeat(axis[:, None], low.shape[1], axis=1)
        numbers = np.sort(common_points(frame, table)[:, k])
        half = np.max(np.diff(numbers), initial=0.0) / 2
        ends = [np.min(np.abs(x[:, k, None] - numbers), axis=1) for x in (low, high)]
        gaps.append(np.maximum(half, np.maximum(*ends)))
    dim, dtype = low.shape[1], low.dtype
    length = np.sqrt(sum(gap**2 for gap in gaps)) * (1 + gamma(12, dtype))
    # Both ends of a difference were moved.
    return np.asarray(frame.length(length + 4 * preparation_error(0, dim, dtype) + _TINY, np.inf))


def pivot_distances_of(
    collection: Collection, points: np.ndarray, reach: np.ndarray, executor: Executor, report: Callable[[int], None]
) -> PivotDistances:
    """Return the pivot distances of all shapes at these points; `report` gets the number of finished shapes."""
    shape = len(collection), len(points)
    lower, upper, done = np.zeros(shape), np.full(shape, np.inf), 0
    frame = frame_of([*collection.corners, (points.min(axis=0), points.max(axis=0))])
    for index, (low, high) in completed(executor, _tasks(collection, points, frame)):
        lower[index], upper[index] = low, high
        done += len(index)
        report(done)
    return PivotDistances(points, lower, upper, reach)


def _tasks(collection: Collection, points: np.ndarray, frame: Frame) -> Iterator[Any]:
    sizes: dict[int, list[int]] = {}
    for k, shape in enumerate(collection.shapes):
        if _has_chords(shape):
            size = next(size for size in SIZES if size >= shape.count)
            sizes.setdefault(size, []).append(k)
        else:
            yield np.array([k]), _projected, (points, shape)
    moved = common_points(frame, points)
    for size, members in sizes.items():
        for start in range(0, len(members), _SHAPES):
            index = np.array(members[start : start + _SHAPES])
            yield index, _chord_distances, (moved, [_chords(collection.shapes[k], frame, size) for k in index], frame)


def _has_chords(shape: Any) -> bool:
    return isinstance(shape, BezierSegments) and shape.weights is None and shape.count <= max(SIZES)


def _projected(task: Any) -> tuple[np.ndarray, np.ndarray]:
    points, shape = task
    found = project(points, shape, throw=False)
    return np.asarray(found.lower)[None], np.asarray(found.upper)[None]


def _chords(curve: BezierSegments, frame: Frame, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the chords (size, chords + 1, dim) of each segment, and bounds of the error of distances."""
    points = common_points(frame, np.asarray(curve.control_points))
    degree, dim, dtype = curve.degree, curve.dim, points.dtype
    t = np.linspace(0, 1, _CHORDS + 1)[:, None]
    basis = np.stack([math.comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)], axis=-1)[:, 0]
    ends = np.einsum("ki,sid->skd", basis.astype(dtype), points)
    bend = np.zeros(curve.count)
    if degree > 1:
        second = np.max(np.linalg.norm(np.diff(points, n=2, axis=1), axis=-1), axis=1)
        rounding = 4 * math.sqrt(dim) * unit_roundoff(dtype)
        bend = degree * (degree - 1) / (8 * _CHORDS**2) * (second + rounding) * (1 + gamma(16, dtype))
    moving = 2 * preparation_error(degree, dim, dtype)
    formula = math.sqrt(dim) * (gamma(3 * degree + 5, dtype) + 4 * gamma(3 * dim + 12, dtype))
    index = np.minimum(np.arange(size), curve.count - 1)
    return ends[index], (bend + (moving + formula) * (1 + 8 * unit_roundoff(dtype)) + _TINY)[index]


def _chord_distances(task: Any) -> tuple[np.ndarray, np.ndarray]:
    points, curves, frame = task
    ends, off = (np.stack(x) for x in zip(*curves, strict=True))
    index = np.minimum(np.arange(_SHAPES), len(ends) - 1)
    found = (np.asarray(x)[: len(ends)] for x in _distances(points, ends[index], off[index], np.asarray(len(ends))))
    low, high = found
    return np.asarray(frame.length(low, 0.0)), np.asarray(frame.length(high, np.inf))


@optimized
def _distances(points: Array, ends: Array, off: Array, count: Array) -> tuple[Array, Array]:
    """Return lower and upper bounds (shapes, points) of the distances from curves with these chords."""

    def one(k: Any, out: tuple[Array, Array]) -> tuple[Array, Array]:
        start, along = ends[k, :, :-1], ends[k, :, 1:] - ends[k, :, :-1]
        square = jnp.sum(along * along, axis=-1)
        offset = points[:, None, None] - start
        s = jnp.clip(jnp.sum(offset * along, axis=-1) / jnp.where(square > 0, square, 1.0), 0.0, 1.0)
        rest = offset - s[..., None] * along
        distance = jnp.sqrt(jnp.min(jnp.sum(rest * rest, axis=-1), axis=-1))
        low, high = jnp.min(distance - off[k], axis=-1), jnp.min(distance + off[k], axis=-1)
        return out[0].at[k].set(jnp.maximum(round_down(low), 0.0)), out[1].at[k].set(round_up(high))

    empty = jnp.zeros((len(ends), len(points)), points.dtype)
    return jax.lax.fori_loop(0, count, one, (empty, empty))


class PivotBounds:
    """Bounds of the distances of all pairs of two collections from their pivot distances at the same points.

    The pivot distances are scaled by a power of two and rounded outward to single precision, which halves the time.
    """

    def __init__(self, a: PivotDistances, b: PivotDistances):
        both = (a,) if a is b else (a, b)
        numbers = [x[np.isfinite(x)] for s in both for x in (s.lower, s.upper, s.covering_radius)]
        exponent = common_exponent(*(x for x in numbers if x.size))
        del numbers
        dim = a.points.shape[1]
        self._frame = Frame(np.zeros(dim), exponent, np.int32(0))
        self._a = _single(a, exponent)
        self._b = self._a if a is b else _single(b, exponent)
        self._dtype = a.lower.dtype

    def between(self, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds (rows, columns) for these shapes of the first collection and of the second."""
        columns_there = _filled(len(columns))
        b = tuple(x[columns[columns_there]] for x in self._b)
        lower, upper = (np.empty((len(rows), len(columns)), self._dtype) for _ in range(2))
        for start in range(0, len(rows), _ROWS):
            part = rows[start : start + _ROWS]
            index = part[np.minimum(np.arange(_ROWS), len(part) - 1)]
            bounds = _bounds(*(x[index] for x in self._a), *b, np.asarray(len(part)))
            low, high = (np.asarray(x)[: len(part), : len(columns)].astype(self._dtype) for x in bounds)
            there = slice(start, start + len(part))
            lower[there], upper[there] = self._frame.length(low, 0.0), self._frame.length(high, np.inf)
        return lower, upper


def candidates(a: PivotDistances, b: PivotDistances, threshold: float, same: bool) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield rows, columns, lower and upper bounds of the pairs that are not certified to be farther apart.

    Args:
        a: pivot distances of the first shapes.
        b: pivot distances of the second shapes.
        threshold: a length in the unit of the shapes.
        same: whether both collections are the same. Then each pair comes once, the smaller index first.
    """
    bounds = PivotBounds(a, b)
    with np.errstate(over="ignore", invalid="ignore"):
        spread = np.where(np.all(np.isfinite(a.upper), axis=0), np.std(a.upper, axis=0), 0.0)
    pivot = int(np.argmax(spread))
    order_a, order_b = (np.argsort(x.lower[:, pivot], kind="stable") for x in (a, b))
    keys = b.lower[order_b, pivot]
    # A key is at most this much below the distance that it stands for.
    slack = np.max(b.upper[:, pivot] - b.lower[:, pivot])
    for start in range(0, len(order_a), _TOGETHER):
        rows = order_a[start : start + _TOGETHER]
        least, most = a.lower[rows, pivot].min(), a.upper[rows, pivot].max()
        # Widened by far more than the rounding of these sums.
        margin = (threshold + slack) * (1 + 1e-9) + 1e-9 * abs(most)
        first = int(np.searchsorted(keys, least - margin))
        last = int(np.searchsorted(keys, most + margin, "right"))
        columns = order_b[first:last]
        if not len(columns):
            continue
        lower, upper = bounds.between(rows, columns)
        near = lower <= threshold
        if same:
            near &= columns[None, :] > rows[:, None]
        i, j = np.nonzero(near)
        yield rows[i], columns[j], lower[i, j], upper[i, j]


def _filled(count: int) -> np.ndarray:
    """Return indices into `count` rows, the last one repeated up to a power of two, so that few sizes are compiled."""
    return np.minimum(np.arange(1 << (max(count, _ROWS) - 1).bit_length()), count - 1)


def _single(s: PivotDistances, exponent: Any) -> tuple[np.ndarray, ...]:
    with np.errstate(over="ignore", under="ignore"):
        lower = _rounded(np.ldexp(s.lower, -exponent), -np.inf)
        upper, reach = (_rounded(np.ldexp(x, -exponent), np.inf) for x in (s.upper, s.covering_radius))
    return np.maximum(lower, 0), upper, reach


def _rounded(x: np.ndarray, toward: float) -> np.ndarray:
    """Return x in single precision, rounded outward by two units: more than scaling and rounding take, and normal."""
    single = x.astype(np.float32)
    nu = np.float32(np.finfo(np.float32).smallest_normal)
    moved = np.nextafter(np.nextafter(single, np.float32(toward)), np.float32(toward))
    return moved + (nu if toward > 0 else -nu)


@optimized
def _bounds(
    low_a: Array, high_a: Array, reach_a: Array, low_b: Array, high_b: Array, reach_b: Array, count: Array
) -> tuple[Array, Array]:
    def one(k: Any, out: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high, reach = low_a[k], high_a[k], reach_a[k]
        apart = jnp.max(jnp.maximum(low - high_b, low_b - high), axis=1)
        # Bounds of the distance from b by the points near a, and the other way round.
        there = jnp.max(jnp.where(low <= reach, high_b, -jnp.inf), axis=1) + reach
        back = jnp.max(jnp.where(low_b <= reach_b[:, None], high, -jnp.inf), axis=1) + reach_b
        far = jnp.where(jnp.isinf(reach) | jnp.isinf(reach_b), jnp.inf, round_up(jnp.maximum(there, back)))
        return out[0].at[k].set(jnp.maximum(round_down(apart), 0.0)), out[1].at[k].set(far)

    empty = jnp.zeros((len(low_a), len(low_b)), low_a.dtype)
    return jax.lax.fori_loop(0, count, one, (empty, empty))
