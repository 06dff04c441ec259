"""Distance map of a plane curve: for each pixel of a grid, the distance to its arcs and the index of the nearest arc.

The distance is evaluated at the centers of the pixels, not rendered as cones into a depth buffer, so rounding is its
only error. The grid is divided into tiles. A quadtree above the tiles drops the arcs that cannot be nearest anywhere in
a square: arcs farther from its center than the nearest arc by more than the diagonal. So each tile processes only the
few arcs near it, and memory beyond the map itself is bounded.

Source: Kim et al. 2010, section 3.1, with the depth buffer of Hoff et al., SIGGRAPH 1999, replaced by evaluation.
"""

import math
from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jhd._arithmetic import rounding
from jhd._arithmetic.interval import Interval
from jhd._arithmetic.scaling import common_exponent
from jhd._results.display import count_text, described, opaque, size_text, value_text
from jhd._runtime.arrays import is_traced, real_array
from jhd._runtime.compiled import compiled, optimized
from jhd._runtime.decimals import upper_text
from jhd._shapes.as_shape import ShapeLike
from jhd._shapes.biarc import BiarcCurve, biarcs, least_tolerance
from jhd._shapes.checks import Numbers

# Pixels on the side of a tile: of 16, 32, 64 the fastest on a CPU, whose cache holds the data of a tile.
_TILE = 32
# Tiles of one call of the compiled function, and pairs of a tile and an arc kept at once; tens of megabytes.
_TILES, _PAIRS = 4096, 2**20
# Tiles that a GPU processes in parallel; a CPU takes one after the other.
_BATCH = 256
# Error of one distance, in roundings of the largest coordinate: see _distance.
_ROUNDINGS = 2048

# Squares, the square of each candidate arc, and the arcs.
_Tiles = tuple[np.ndarray, np.ndarray, np.ndarray]


class DistanceMap(eqx.Module):
    """Distances from the centers of pixels to a curve; the first axis is x, the second y.

    Pixel (i, j) has its center at lower + (i + 1/2, j + 1/2) * spacing. At the center, the stored distance is within
    `error` of the exact distance to the curve. Anywhere in the pixel it is within `max_error`, as distances are
    1-Lipschitz.

    Args:
        distance: distances to the nearest arc, in the unit of the coordinates.
        nearest: index of the nearest arc; the smallest index at a tie.
        lower: lower corner of the box.
        spacing: side lengths of a pixel.
        error: certified bound of |distance - exact|: the largest deviation of the arcs from the curve, plus rounding.
        arcs: arcs to which `nearest` refers.
    """

    distance: Float[Array, "columns rows"]
    nearest: Int[Array, "columns rows"]
    lower: Float[Array, " dim"]
    spacing: Float[Array, " dim"]
    error: Float[Array, ""]
    arcs: BiarcCurve

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        pixels, arcs = f"{size_text(self.distance.shape)} pixels", count_text(self.arcs.count, "arc")
        sides = (f"lower={value_text(self.lower)}", f"spacing={value_text(self.spacing)}")
        return described(self, pixels, *sides, f"error={value_text(self.error, upper_text)}", arcs)

    @property
    def centers(self) -> tuple[Float[Array, " columns"], Float[Array, " rows"]]:
        """The x and the y coordinates of the centers of the pixels."""
        columns, rows = self.distance.shape
        return (
            self.lower[0] + (jnp.arange(columns) + 0.5) * self.spacing[0],
            self.lower[1] + (jnp.arange(rows) + 0.5) * self.spacing[1],
        )

    @property
    def max_error(self) -> Float[Array, ""]:
        """Certified bound of |distance - exact| for all points of a pixel: `error` plus half the pixel's diagonal."""
        half = jnp.hypot(0.5 * self.spacing[0], 0.5 * self.spacing[1])
        small = 2 * rounding.smallest_normal(half.dtype)
        return rounding.round_up(self.error + (half * (1 + rounding.gamma(8, half.dtype)) + small))

    def enclose(self, points: Numbers) -> Interval:
        """Certified bounds of the exact distances of points to the curve, from the pixels that contain the points.

        The bounds at the center of the pixel are widened by the distance from the center. A point outside the box uses
        the nearest pixel. Center coordinates are off by at most 8 roundings, which the bounds include.

        Args:
            points: coordinates, (..., 2).

        Returns:
            An Interval of lower and upper bounds of shape (...).

        Raises:
            TypeError: the points are not real numbers.
            ValueError: the points do not have shape (..., 2) or are not finite.
        """
        x = real_array("points", points)
        if x.ndim < 1 or x.shape[-1] != 2:
            raise ValueError(f"points has shape {x.shape}; needs (..., 2).")
        return _enclosed(self, x)


@compiled
def _enclosed(field: DistanceMap, x: Array) -> Interval:
    """Proven range of the distance at points x (..., 2), from the distance of their pixel and its 1-Lipschitz bound."""
    index = jnp.clip(jnp.floor((x - field.lower) / field.spacing), 0, jnp.array(field.distance.shape) - 1)
    center = field.lower + (index + 0.5) * field.spacing
    slip = rounding.absolute_error(8, jnp.abs(x) + jnp.abs(center) + jnp.abs(field.lower))
    away = jnp.hypot(*jnp.moveaxis(jnp.abs(x - center) + slip, -1, 0)) * (1 + rounding.gamma(8, x.dtype))
    k = index.astype(int)
    distance, margin = field.distance[k[..., 0], k[..., 1]], rounding.round_up(field.error + away)
    lower, upper = rounding.round_down(distance - margin), rounding.round_up(distance + margin)
    return Interval(jnp.maximum(lower, 0.0), upper)


def distance_map(
    curve: ShapeLike | BiarcCurve,
    lower: Numbers,
    upper: Numbers,
    resolution: int | tuple[int, int],
    *,
    tolerance: Numbers | None = None,
    tile: int = _TILE,
) -> DistanceMap:
    """Distances to a plane curve on a grid of pixels, with the nearest arc of each pixel.

    >>> import jhd
    >>> found = jhd.distance_map(jhd.polyline([(0, 0), (2, 0)]), [0, 0], [2, 2], 2)
    >>> [[round(x, 3) for x in column] for column in found.distance.tolist()]
    [[0.5, 1.5], [0.5, 1.5]]

    Args:
        curve: plane curve, or an object that jhd.as_shape converts to one, which is first approximated by biarcs; or a
            BiarcCurve.
        lower: lower corner (x, y) of the box that the pixels fill.
        upper: upper corner (x, y) of the box.
        resolution: number of pixels along x and along y, or one number for both.
        tolerance: largest deviation of the arcs from the curve, a positive length. None selects an eighth of the
            smaller side of a pixel, or the resolution of the coordinates if that is larger. Not allowed for a
            BiarcCurve.
        tile: number of pixels along the side of the squares that are computed together, at least 1. The map does not
            depend on it.

    Returns:
        The map, with a certified bound of its error.

    Raises:
        TypeError: the input is no curve, or it is traced: the number of arcs depends on the curve.
        ValueError: the curve is in space; `lower` is not below `upper`, or is not finite; `resolution` or `tile` is
            below 1; or `tolerance` is given for a BiarcCurve or refused by `biarcs`.
    """
    columns, rows = _checked_resolution(resolution)
    if not isinstance(tile, int | np.integer) or isinstance(tile, bool) or tile < 1:
        raise ValueError(f"tile is {tile!r}; needs a whole number of at least 1.")
    low, high = _checked_box(lower, upper)
    dtype = jnp.result_type(float)
    spacing = ((high / 2 - low / 2) / np.array([columns, rows]) * 2).astype(dtype).astype(np.float64)
    if not np.all(spacing > 0):
        raise ValueError(
            f"resolution is {(columns, rows)}; needs fewer pixels: they have no size in the box from {low} to {high}."
        )
    arcs = _checked_arcs(curve, tolerance, float(spacing.min()))
    frame = _PixelFrame.of(arcs, low, high)
    table, step = frame.table(arcs).astype(dtype), np.ldexp(spacing, -frame.first - frame.second).astype(dtype)
    distance, nearest = _mapped(table, step, (columns, rows), int(tile))
    deviation = float(np.max(np.asarray(arcs.deviation)))
    error = frame.length(rounding.gamma(_ROUNDINGS, dtype)) + deviation + rounding.smallest_normal(dtype)
    stored = (frame.length(distance), nearest, low.astype(dtype), spacing.astype(dtype), _rounded_up(error, dtype))
    return DistanceMap(*jax.device_put(stored), arcs=arcs)


def _checked_resolution(resolution: Any) -> tuple[int, int]:
    both = resolution if isinstance(resolution, tuple | list) else (resolution, resolution)
    for number in both:
        if not isinstance(number, int | np.integer) or isinstance(number, bool):
            raise TypeError(f"resolution must be a whole number or two of them; got {resolution!r}.")
    if len(both) != 2 or min(both) < 1:
        raise ValueError(f"resolution is {resolution}; needs two numbers of pixels of at least 1, or one for both.")
    return int(both[0]), int(both[1])


def _checked_box(lower: Numbers, upper: Numbers) -> tuple[np.ndarray, np.ndarray]:
    corners = []
    for name, value in (("lower", lower), ("upper", upper)):
        corner = real_array(name, value)
        if is_traced(corner):
            raise TypeError(f"distance_map needs a known {name}, not a traced array.")
        if corner.shape != (2,):
            raise ValueError(f"{name} has shape {corner.shape}; needs (2,).")
        corners.append(np.asarray(corner, np.float64))
    low, high = corners
    if not np.all(low < high):
        raise ValueError(f"the box is empty or upside down: lower is {low.tolist()}, upper is {high.tolist()}.")
    return low, high


def _checked_arcs(curve: Any, tolerance: Numbers | None, pixel: float) -> BiarcCurve:
    if isinstance(curve, BiarcCurve):
        if is_traced(curve):
            raise TypeError("distance_map needs known arcs, not traced arcs.")
        if tolerance is not None:
            raise ValueError("tolerance is for a curve; the arcs already have a deviation, so leave tolerance out.")
        return curve
    least = least_tolerance(curve)
    # The deviation of biarcs made for a map, as a fraction of the pixel's smaller side.
    return biarcs(
        curve, max(pixel / 8, least, rounding.smallest_normal(np.float64)) if tolerance is None else tolerance
    )


def _rounded_up(x: float, dtype: Any) -> np.ndarray:
    """A positive sum of three numbers, rounded up in this precision to at least the exact sum."""
    above = np.asarray(x * (1 + rounding.gamma(4, np.float64)), dtype)
    return np.asarray(np.nextafter(above, np.asarray(np.inf, dtype)))


class _PixelFrame(NamedTuple):
    """Local coordinates x = 2^-second (2^-first x_user - low), in which pixels and ends of arcs are at most one."""

    low: np.ndarray
    first: int
    second: int

    @staticmethod
    def of(arcs: BiarcCurve, low: np.ndarray, high: np.ndarray) -> "_PixelFrame":
        """The frame of a box and arcs: the lower corner is the origin, which every pixel and arc is relative to."""
        ends = np.concatenate([np.asarray(x, np.float64) for x in (arcs.start, arcs.end, [low, high])])
        first = int(common_exponent(ends))
        ends, low = np.ldexp(ends, -first), np.ldexp(low, -first)
        return _PixelFrame(low, first, int(common_exponent(ends - low)))

    def length(self, x: Any) -> Any:
        """Local lengths in the user's unit."""
        with np.errstate(over="ignore"):
            return np.ldexp(x, self.first + self.second)

    def table(self, arcs: BiarcCurve) -> np.ndarray:
        """Nine numbers for each arc: both ends, the vectors e and f of _distance, and the curvature."""
        a, b = (np.ldexp(np.asarray(x, np.float64), -self.first) for x in (arcs.start, arcs.end))
        chord = np.ldexp(b - a, -self.second)
        a, b = (np.ldexp(x - self.low, -self.second) for x in (a, b))
        bulge = np.asarray(arcs.bulge, np.float64)
        length = np.hypot(*chord.T)
        # Shorter chords count as points: their curvature squared must not overflow, in single precision either.
        long = length > 2.0**-60
        chord = np.where(long[:, None], chord / np.where(long, length, 1.0)[:, None], [1.0, 0.0])
        bulge, length = np.where(long, bulge, 0.0), np.where(long, length, 1.0)
        left = np.stack([-chord[:, 1], chord[:, 0]], axis=-1)
        square = (1 + bulge**2)[:, None]
        along, across = chord * (2 * bulge[:, None] / square), left * (((1 - bulge) * (1 + bulge))[:, None] / square)
        curvature = 4 * bulge / (length * square[:, 0])
        # A point keeps no strip but a line through it, on which both formulas agree.
        b = np.where(long[:, None], b, a)
        return np.stack([*a.T, *b.T, *(-along - across).T, *(along - across).T, curvature])


def _distance(xp: Any, arc: Any, x: Any, y: Any) -> Any:
    """Distance of (x, y) to an arc, with no division by its curvature k and no difference of large numbers.

    Let A and B be the ends, o the center, e = k (A - o) and f = k (B - o) unit vectors, for lines their limit, the
    normal; d = x - A and p = k (x - o) = k d + e. Then k (|x - o|^2 - 1 / k^2) = d.(p + e) gives

        | |x - o| - 1 / |k| | = |d.(p + e)| / (1 + |p|),

    the distance if x is in the arc's wedge: beyond its start, e x d >= 0, before its end, f x (x - B) <= 0, and on
    its side of the center, p.(e + f) >= 0. Elsewhere it is the distance to the nearer end.

    Rounding, in local coordinates, which are at most one, so |d| <= 3, with u the unit roundoff and sweeps up to 107
    degrees: k, e, f are within 12 u, relative, of those of the stored arc; differences of coordinates within 4 u in
    all. Then p errs by 16 u (|k| |d| + 1), and as 1 + |p| is at least 1 and at least |k| |d|, the quotient by at most
    5 * 20 u |d| + 8 u < 310 u. A wrong answer of the first or second test needs x within 50 u of the ray's line, and
    changes the distance by less than three times that. One of the third needs (x - o).m, with m the unit vector to the
    middle of the arc, to be below 30 u (|d| + r), and there r <= 1.5 |d|: below 230 u. If all of its tests are then
    answered as for the wedge, or x is in it, |x - o| < (230 u + 50 u + 0.8 * 230 u) / 0.6 < 800 u, and all distances
    to the circle and to its points differ by at most 1600 u. Chords that count as points add 2^-60. With the
    quotient's 310 u that is less than the 2048 roundings allowed for.
    """
    ax, ay, bx, by, ex, ey, fx, fy, k = arc
    dx, dy, gx, gy = x - ax, y - ay, x - bx, y - by
    px, py = k * dx + ex, k * dy + ey
    inside = (ex * dy - ey * dx >= 0) & (fx * gy - fy * gx <= 0) & (px * (ex + fx) + py * (ey + fy) >= 0)
    # One root for both: of |p|^2 in the wedge, of the smaller squared distance outside.
    root = xp.sqrt(xp.where(inside, px * px + py * py, xp.minimum(dx * dx + dy * dy, gx * gx + gy * gy)))
    return xp.where(inside, xp.abs(dx * (px + ex) + dy * (py + ey)) / (1 + root), root)


def _mapped(table: np.ndarray, step: np.ndarray, size: tuple[int, int], tile: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances in local units and nearest arcs of all pixels, batch by batch of tiles."""
    tiles = [-(-n // tile) for n in size]
    distance = np.empty((tiles[0], tile, tiles[1], tile), table.dtype)
    nearest = np.empty(distance.shape, np.int32)
    batch = 1 if jax.default_backend() == "cpu" else _BATCH
    for squares, counts, arcs in _batches(table, step, tiles, tile):
        first = np.cumsum(counts) - counts
        places = [np.pad(x, (0, _bucket(len(squares)) - len(squares))) for x in (*squares.T, first, counts)]
        pairs = np.pad(arcs, (0, _bucket(len(arcs)) - len(arcs)))
        found = _tiles_evaluated(tile, batch, step, places, table[:, pairs].T, pairs)
        found = [np.asarray(x)[: len(squares)] for x in found]
        distance[squares[:, 0], :, squares[:, 1]], nearest[squares[:, 0], :, squares[:, 1]] = found
    whole, inside = (tiles[0] * tile, tiles[1] * tile), (slice(size[0]), slice(size[1]))
    return distance.reshape(whole)[inside], nearest.reshape(whole)[inside]


def _bucket(count: int) -> int:
    """The next power of four: few functions are compiled."""
    return 4 ** max(2, math.ceil(math.log(count, 4) - 1e-9))


@partial(optimized, static=(0, 1))
def _tiles_evaluated(
    tile: int, batch: int, step: Array, places: list[Array], rows: Array, index: Array
) -> tuple[Array, Array]:
    """Distances and nearest arcs (tiles, tile, tile) of tiles given by position, first pair and number of pairs."""
    inner = jnp.arange(tile)

    def one(place: list[Array]) -> tuple[Array, Array]:
        i, j, first, count = place
        x, y = ((start * tile + inner + 0.5) * side for start, side in ((i, step[0]), (j, step[1])))

        def nearer(k: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
            found = _distance(jnp, rows[first + k], x[:, None], y)
            closer = found < best[0]
            return jnp.where(closer, found, best[0]), jnp.where(closer, index[first + k], best[1])

        start = jnp.full((tile, tile), jnp.inf, rows.dtype), jnp.zeros((tile, tile), jnp.int32)
        return lax.fori_loop(0, count, nearer, start)

    return lax.map(one, places, batch_size=None if batch == 1 else batch)


def _batches(
    table: np.ndarray, step: np.ndarray, tiles: list[int], tile: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Batches of tiles, the number of candidate arcs of each, and the arcs in ascending order; depth first."""
    depth = max((n - 1).bit_length() for n in tiles)
    arcs = np.arange(table.shape[1], dtype=np.int32)
    waiting = [(depth, np.zeros((1, 2), int), np.zeros(len(arcs), int), arcs)]
    while waiting:
        level, squares, owner, arcs = waiting.pop()
        if len(squares) > 1 and (len(arcs) > _PAIRS // 4 or len(squares) > _TILES):
            half = len(squares) // 2
            cut = np.searchsorted(owner, half)
            waiting += [
                (level, squares[half:], owner[cut:] - half, arcs[cut:]),
                (level, squares[:half], owner[:cut], arcs[:cut]),
            ]
        elif level == 0:
            yield squares, np.bincount(owner, minlength=len(squares)), arcs
        else:
            side = tile << (level - 1)
            most = [((n - 1) >> (level - 1)) + 1 for n in tiles]
            waiting.append((level - 1, *_quartered(table, step, squares, owner, arcs, side, most)))


def _quartered(
    table: np.ndarray,
    step: np.ndarray,
    squares: np.ndarray,
    owner: np.ndarray,
    arcs: np.ndarray,
    side: int,
    most: list[int],
) -> _Tiles:
    """The quarters of squares, of `side` pixels, and the arcs that may be nearest in each.

    Distances change over a square by at most the distance from its center. So an arc that is farther from the center
    than the nearest arc by more than the diagonal is nowhere the nearest arc.
    """
    quarters = 2 * squares[:, None] + np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    there = np.all(quarters < most, axis=-1)
    quarter = np.where(there, np.cumsum(there).reshape(there.shape) - 1, -1)[owner]
    arcs, owner = np.repeat(arcs, 4), quarter.ravel()
    order = np.argsort(owner, kind="stable")
    order = order[owner[order] >= 0]
    arcs, owner, squares = arcs[order], owner[order], quarters[there]
    half = 0.5 * math.hypot(*(side * step))
    x, y = ((squares + 0.5) * side * step).T
    parts = range(0, len(arcs), _PAIRS // 4)
    rows = [slice(k, k + _PAIRS // 4) for k in parts]
    distance = np.concatenate([_distance(np, table[:, arcs[k]], x[owner[k]], y[owner[k]]) for k in rows])
    least = np.minimum.reduceat(distance, np.searchsorted(owner, np.arange(len(squares))))
    slack = 4 * rounding.gamma(_ROUNDINGS, table.dtype)
    kept = distance <= (least + 2 * half)[owner] * (1 + slack) + slack
    return squares, owner[kept], arcs[kept]
