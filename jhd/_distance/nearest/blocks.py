"""Long curves: segments in blocks that lie close together, so that one box excludes most of them.

Segments are sorted along a space-filling curve and cut into blocks with a box each; queries are cut into groups in the
same way. A group examines blocks in the order of the distance of their boxes, until the next block is out of reach of
all its queries. A query is compared with the chord of a segment.

With D the distance of a query from the chord, the distance from the segment lies in [D - delta, D + delta]; see
jhd._distance.nearest.chords, for the rounding too. A box is exact, and its distance takes no more roundings than D.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.nearest.chords import chord_error, chords_between, square_and_parameter
from jhd._distance.nearest.curves import NearestOnCurve, nearest, repeated
from jhd._runtime.arrays import varying
from jhd._shapes.curve import BezierSegments

# Segments of a block, and queries of a group.
_BLOCK, _GROUP = 64, 128
# Segments that are searched at once: of a query's own, few suffice if segments are nearly straight.
_LISTED = 8


def is_long(curve: BezierSegments) -> bool:
    """Return whether a curve has enough segments for blocks to pay off."""
    # From this number of segments on blocks are faster than all segments at once.
    return curve.count >= 512


class Blocks(NamedTuple):
    """A curve of many segments in sorted blocks; all coordinates at most one in size."""

    curve: BezierSegments  # the curve
    segment: Array  # numbers of the segments as sorted, (blocks, segments)
    start: Array  # first points
    chord: Array  # vectors to the last points; zero if they are too short to count
    inverse: Array  # one over their squares, or zero
    delta: Array  # bounds of how far the segments are from their chords, inf for repeated segments
    lower: Array  # lower corners of the boxes of the blocks
    upper: Array  # upper corners of the boxes of the blocks


def blocks_of(curve: BezierSegments) -> Blocks:
    """Return a curve in blocks."""
    points = curve.control_points
    low, high = jnp.min(points, axis=1), jnp.max(points, axis=1)
    order = jnp.argsort(places(0.5 * (low + high)))
    order = order[np.minimum(np.arange(-(-curve.count // _BLOCK) * _BLOCK), curve.count - 1)].reshape(-1, _BLOCK)
    start, chord, inverse, delta = chords_between(points[:, 0], points[:, -1], points)
    delta = jnp.where(repeated(points, curve.weights), jnp.inf, delta)
    rows = (start, chord, inverse, delta, low, high)
    start, chord, inverse, delta, low, high = (x[order] for x in rows)
    return Blocks(curve, order, start, chord, inverse, delta, jnp.min(low, axis=1), jnp.max(high, axis=1))


def places(points: Array) -> Array:
    """Return positions of points along a curve that fills their box: the interleaved bits of their coordinates."""
    integer = jnp.int64 if points.dtype == jnp.float64 else jnp.int32
    bits = (8 * jnp.dtype(integer).itemsize - 2) // points.shape[1]
    low = jnp.min(points, axis=0)
    extent = jnp.max(jnp.max(points, axis=0) - low)
    cells = ((points - low) / jnp.where(extent > 0, extent, 1.0) * (2**bits - 1)).astype(integer)

    def with_bit(k: Any, place: Array) -> Array:
        for axis in range(points.shape[1]):
            place = place << 1 | (cells[:, axis] >> (bits - 1 - k)) & 1
        return place

    start = varying(jnp.zeros(points.shape[:1], integer), points)
    return jax.lax.fori_loop(0, bits, with_bit, start)


def in_groups(function: Callable[[Array], Any], points: Array) -> Any:
    """Apply a function of groups (queries, dim) to all points, sorted into groups."""
    count = points.shape[0]
    size = min(_GROUP, count)
    order = jnp.argsort(places(points))
    back = jnp.zeros_like(order).at[order].set(jnp.arange(count))
    rows = order[np.minimum(np.arange(-(-count // size) * size), count - 1)].reshape(-1, size)
    found = jax.lax.map(function, points[rows])
    return jax.tree_util.tree_map(lambda x: x.reshape((-1, *x.shape[2:]))[back], found)


def guesses(blocks: Blocks, points: Array) -> tuple[Array, Array]:
    """Return for each point of a group the segment of the nearest chord and the parameter there; not proven."""
    integer = jnp.int64 if points.dtype == jnp.float64 else jnp.int32

    def look(k: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        least, chosen = found
        squares = _to_chords(blocks, k, points)[0] + jnp.where(jnp.isinf(blocks.delta[k]), jnp.inf, 0.0)[:, None]
        # The index replaces the last bits, so that one minimum finds both: argmin is slow on CPU.
        number = jnp.arange(_BLOCK, dtype=integer)[:, None]
        key = jnp.min(jax.lax.bitcast_convert_type(squares, integer) & -_BLOCK | number, axis=0)
        square, index = jax.lax.bitcast_convert_type(key & -_BLOCK, points.dtype), key & (_BLOCK - 1)
        return jnp.minimum(square, least), jnp.where(square < least, k * _BLOCK + index, chosen)

    count = points.shape[0]
    start = jnp.full(count, jnp.inf, points.dtype), jnp.zeros(count, int)
    # Blocks that are looked at for a guess; more are in reach only if very many segments are equally far.
    _, (_, chosen) = _nearest_first(blocks, points, lambda found: jnp.sqrt(jnp.max(found[0])), look, start, 64)
    k, i = chosen // _BLOCK, chosen % _BLOCK
    rows = (blocks.start[k, i], blocks.chord[k, i], blocks.inverse[k, i])
    return blocks.segment[k, i], jax.vmap(square_and_parameter)(points, *rows)[1]


class _GroupLook(NamedTuple):
    """Progress of a group: the segments searched, first a few for each query, then block after block."""

    found: NearestOnCurve  # the nearest points so far
    least: Array  # lower bounds of the distances to the segments looked at
    remaining: Array  # lower bounds of the distances to the blocks not begun
    block: Array  # the block that is looked at
    count: Array  # how often some segments were looked at


def nearest_in_blocks(blocks: Blocks, points: Array, wanted: Array | bool = True) -> NearestOnCurve:
    """Return proven nearest points for the points of a group, as `nearest` does on all segments.

    Each query searches the few segments with the smallest lower bounds. If others are in its reach, the whole group
    searches block after block. If the points are not wanted, nothing is searched, and the upper bounds are infinite.
    """
    lower, listed, rest, reach = _listed(blocks, points, _LISTED, wanted)
    curve, parts = blocks.curve, _BLOCK // _LISTED
    gaps, error = _gaps(blocks, points), chord_error(points.shape[1], points.dtype)

    def going(state: _GroupLook) -> Array:
        upper = jnp.minimum(reach, state.found.upper)
        within = jnp.any(rest <= upper) & (jnp.min(state.remaining) <= jnp.max(upper))
        return wanted & ((state.count == 0) | ((state.count - 1) % parts > 0) | within)

    def step(state: _GroupLook) -> _GroupLook:
        first, part = state.count == 0, (state.count - 1) % parts
        new = ~first & (part == 0)
        block = jnp.where(new, jnp.argmin(state.remaining), state.block)
        distance = jnp.sqrt(_to_chords(blocks, block, points)[0])
        # Repeated segments have no upper bound and none below.
        bounds = jnp.where(jnp.isinf(blocks.delta[block]), jnp.inf, (distance.T - blocks.delta[block]) - error)
        low, segments = (
            jax.lax.dynamic_slice_in_dim(x, part * _LISTED, _LISTED, -1) for x in (bounds, blocks.segment[block])
        )
        low, segments = jnp.where(first, lower, low), jnp.where(first, listed, segments)
        # Segments that are passed over are at least as far as the bound that excludes them.
        skip = low > jnp.minimum(reach, state.found.upper)[:, None]
        weights = None if curve.weights is None else curve.weights[segments]
        control_points = curve.control_points[segments]
        found = jax.vmap(lambda p, c, w, skip: nearest(p, c, w, 0.0, skip))(points, control_points, weights, skip)
        least = jnp.minimum(found.lower, jnp.min(jnp.where(skip, low, jnp.inf), axis=1))
        at = jnp.take_along_axis(segments, found.segment[:, None], axis=1)[:, 0]
        found = _nearer(state.found, eqx.tree_at(lambda n: n.segment, found, at))
        remaining = jnp.where(new, state.remaining.at[block].set(jnp.inf), state.remaining)
        return _GroupLook(found, jnp.minimum(least, state.least), remaining, block, state.count + 1)

    none, zero, dtype = jnp.full_like(reach, jnp.inf), jnp.zeros(reach.shape, int), reach.dtype
    nothing = NearestOnCurve(none, none, none, zero, jnp.zeros(reach.shape, dtype), jnp.full(reach.shape, True), zero)
    start = _GroupLook(nothing, none, gaps, jnp.array(0), jnp.array(0))
    end = jax.lax.while_loop(going, step, varying(start, blocks, points))
    found, beyond = end.found, jnp.maximum(rest, jnp.min(end.remaining))
    return eqx.tree_at(lambda n: n.lower, found, jnp.minimum(jnp.minimum(end.least, beyond), found.upper))


def _nearer(old: NearestOnCurve, new: NearestOnCurve) -> NearestOnCurve:
    """Return the nearer one of two results for each query; closed if both results are closed."""
    better = new.upper < old.upper
    found = jax.tree_util.tree_map(lambda x, y: jnp.where(better, x, y), new, old)
    return eqx.tree_at(lambda n: (n.closed, n.steps), found, (old.closed & new.closed, old.steps + new.steps))


def _listed(blocks: Blocks, points: Array, most: int, wanted: Array | bool) -> tuple[Array, Array, Array, Array]:
    """Return the segments with the smallest lower bounds for each point of a group, and bounds for all other segments.

    Returns:
        Lower bounds (queries, listed) of the distances to the listed segments; these segments; a lower bound of the
        distance to all others; and an upper bound of the distance to the curve.
    """
    error, count = chord_error(points.shape[1], points.dtype), points.shape[0]

    def look(k: Array, found: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        reach, lower, listed = found
        squares, starts = _to_chords(blocks, k, points)
        distance, delta = jnp.sqrt(squares), blocks.delta[k][:, None]
        reach = jnp.minimum(reach, jnp.min(distance + delta, axis=0) + error)
        reach = jnp.minimum(reach, jnp.sqrt(jnp.min(starts, axis=0)) + error)
        # Repeated segments have no upper bound and none below.
        new = jnp.where(jnp.isinf(delta), jnp.inf, distance - delta - error).T
        lower = jnp.concatenate([lower, _down(new)], axis=1)
        listed = jnp.concatenate([listed, jnp.broadcast_to(blocks.segment[k], new.shape)], axis=1)
        lower, index = jax.lax.top_k(-lower, most + 1)
        return reach, -lower, jnp.take_along_axis(listed, index, axis=1)

    blank = jnp.full((count, most + 1), jnp.inf, jnp.float32)
    # No block is within a reach of minus infinity.
    reach = jnp.full(count, jnp.where(wanted, jnp.inf, -jnp.inf), points.dtype)
    start = reach, blank, jnp.zeros((count, most + 1), int)
    beyond, (reach, lower, listed) = _nearest_first(blocks, points, lambda found: jnp.max(found[0]), look, start)
    lower = lower.astype(points.dtype)
    return lower[:, :-1], listed[:, :-1], jnp.minimum(lower[:, -1], beyond), reach


def _nearest_first(
    blocks: Blocks,
    points: Array,
    worst: Callable[[Any], Array],
    look: Callable[[Array, Any], Any],
    start: Any,
    most: int | None = None,
) -> tuple[Array, Any]:
    """Look at blocks from the nearest on, while their lower bounds are not above the worst bound of the points.

    Returns:
        A lower bound of the distance to all segments of the blocks not looked at, and the last result of `look`.
    """
    lower = _gaps(blocks, points)
    most = lower.size if most is None else most

    def going(state: tuple[Array, Any, Array]) -> Array:
        lower, found, count = state
        return (jnp.min(lower) <= worst(found)) & (count < most)

    def step(state: tuple[Array, Any, Array]) -> tuple[Array, Any, Array]:
        lower, found, count = state
        k = jnp.argmin(lower)
        return lower.at[k].set(jnp.inf), look(k, found), count + 1

    state = varying((lower, start, jnp.array(0)), blocks, points)
    lower, found, _ = jax.lax.while_loop(going, step, state)
    return jnp.min(lower), found


def _gaps(blocks: Blocks, points: Array) -> Array:
    """Return lower bounds of the distances of all points of a group to each block."""
    low, high = jnp.min(points, axis=0), jnp.max(points, axis=0)
    gaps = jnp.maximum(jnp.maximum(blocks.lower - high, low - blocks.upper), 0.0)
    return jnp.sqrt(jnp.sum(gaps * gaps, axis=1)) - chord_error(points.shape[1], points.dtype)


def _to_chords(blocks: Blocks, k: Array, points: Array) -> tuple[Array, Array]:
    """Return squared distances (segments, points) from the chords of a block, and from their starts."""
    start, chord, inverse = blocks.start[k], blocks.chord[k], blocks.inverse[k][:, None]
    # Component by component, so that the long axis is the last.
    d = [x - s[:, None] for x, s in zip(points.T, start.T, strict=True)]
    v = [x[:, None] for x in chord.T]
    t = jnp.clip(sum((x * y for x, y in zip(d, v, strict=True)), start=0.0) * inverse, 0.0, 1.0)
    squares = sum(((x - t * y) ** 2 for x, y in zip(d, v, strict=True)), start=jnp.zeros_like(t))
    return squares, sum((x * x for x in d), start=jnp.zeros_like(t))


def _down(x: Array) -> Array:
    """Round down to single precision, in which the few smallest of many lengths are found much faster on CPU."""
    return jnp.maximum(x, 0.0).astype(jnp.float32) * np.float32(1 - 2.0**-22) - np.float32(2.0**-100)
