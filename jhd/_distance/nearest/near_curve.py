"""A curve as the target of a search: start parameters for the search of a foot, and proven nearest points.

Samples of a short curve are compared all at once; a long one is looked at in blocks (jhd._distance.nearest.blocks).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array

from jhd._distance.nearest.blocks import Blocks, blocks_of, guesses, in_groups, nearest_in_blocks
from jhd._distance.nearest.chords import Chords, runs_of
from jhd._distance.nearest.curves import NearestOnCurve, nearest, repeated
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of
from jhd._shapes.curve import BezierSegments

# Points whose nearest samples are searched in one batch.
_SIDE_BY_SIDE = 256


class _NearSamples(NamedTuple):
    """Samples of a curve: (samples, dim) points, their segments and parameters."""

    points: Array
    segment: Array
    s: Array


class NearCurve(NamedTuple):
    """A curve in common coordinates with the data for finding feet on it."""

    curve: BezierSegments  # the curve
    skip: Array  # mask of the segments that repeat their predecessor
    guide: _NearSamples | Blocks  # samples of a short curve, blocks of a long one
    # For each segment the chord of the straight run that it belongs to; None if there are few segments.
    runs: Chords | None

    def starts(self, points: Array) -> CurvePlace:
        """Return start parameters for the search of a foot of each point (..., dim): near the nearest, not proven."""
        guide = self.guide
        if isinstance(guide, _NearSamples):
            index = _nearest_sample(guide, points)
            return CurvePlace(guide.segment[index], guide.s[index])
        rows = points.reshape(-1, points.shape[-1])
        # A few points may be anywhere: each of them is a group of its own.
        alone = jax.vmap(lambda p: jax.tree_util.tree_map(lambda x: x[0], guesses(guide, p[None])))
        found = alone(rows) if rows.shape[0] < _SIDE_BY_SIDE else in_groups(lambda r: guesses(guide, r), rows)
        return CurvePlace(*(x.reshape(points.shape[:-1]) for x in found))

    def nearest(self, point: Array, tolerance: ArrayLike = 0.0) -> NearestOnCurve:
        """Return the proven nearest point; with an infinite tolerance, a bound that costs next to nothing."""
        if isinstance(self.guide, _NearSamples):
            return nearest(point, self.curve.control_points, self.curve.weights, jnp.asarray(tolerance), self.skip)
        found = nearest_in_blocks(self.guide, point[None], jnp.isfinite(tolerance))
        return jax.tree_util.tree_map(lambda x: x[0], found)


def near_curve(curve: BezierSegments, long: bool, seeds: int = 0) -> NearCurve:
    """Return the curve in blocks if it or the other curve is long, else with at least `seeds` samples a segment."""
    skip = repeated(curve.control_points, curve.weights)
    # Fewer segments close without bounds by straight runs, and compile sooner.
    runs = runs_of(curve) if curve.count >= 16 else None
    # Samples of each segment for the first feet.
    return NearCurve(curve, skip, blocks_of(curve) if long else _samples(curve, max(seeds, 4)), runs)


def _samples(b: BezierSegments, seeds: int) -> _NearSamples:
    """Return samples of b; the nearest sample starts the search of a foot."""
    samples = jnp.linspace(0.0, 1.0, seeds + 1, dtype=b.control_points.dtype)
    points = jax.vmap(lambda k: jax.vmap(lambda s: jet(*piece_of(b, k), s).point)(samples))(jnp.arange(b.count))
    segment = jnp.repeat(jnp.arange(b.count), samples.size)
    return _NearSamples(points.reshape(-1, b.dim), segment, jnp.tile(samples, b.count))


def _nearest_sample(samples: _NearSamples, points: Array) -> Array:
    """Return the index of the nearest sample for each of the points (..., dim).

    The result is only a guess, so the index replaces the last bits of the squared distance. One minimum of integers
    over the leading axis finds both: argmin costs thirty times as much on CPU.
    """
    rows = points.reshape(-1, points.shape[-1])
    count, integer = samples.points.shape[0], jnp.int64 if points.dtype == jnp.float64 else jnp.int32
    last_bits = 2 ** (count - 1).bit_length() - 1

    def nearest_of(rows: Array) -> Array:
        squares = sum(((x[:, None] - y) ** 2 for x, y in zip(samples.points.T, rows.T, strict=True)), start=0.0)
        key = jax.lax.bitcast_convert_type(squares, integer) & ~last_bits | jnp.arange(count, dtype=integer)[:, None]
        return jnp.min(key, axis=0) & last_bits

    if rows.shape[0] <= _SIDE_BY_SIDE:
        return nearest_of(rows).reshape(points.shape[:-1])
    # In blocks, so that the table of all squares is never there.
    blocks = jnp.pad(rows, ((0, -rows.shape[0] % _SIDE_BY_SIDE), (0, 0))).reshape(-1, _SIDE_BY_SIDE, rows.shape[1])
    return jax.lax.map(nearest_of, blocks).ravel()[: rows.shape[0]].reshape(points.shape[:-1])
