"""Chords of curves: the distance of a point from one, and runs of segments that lie along one chord.

A run is a sequence of consecutive segments, each starting exactly at the end point of the one before. With delta the
largest distance of its control points from its chord, every point of the run is within delta of the chord, as the
distance from a convex set is convex. Every point of the chord is within delta of the run, which passes over all of them
on its way from one end to the other. So the distance of any point from the run differs from its distance to the chord
by at most delta, for positive weights too. This holds for every choice of runs.

Rounding, for coordinates of at most one, u the unit roundoff and d the dimension. The offset, the chord and its points
take 12 roundings of numbers up to two in each component, the length d + 2 more, and the parameter of the chord's
nearest point is off by gamma(2 d + 10) |offset| in units of length, which no distance exceeds in its effect. In all
that is below gamma(40) 4 sqrt(d). A chord whose square is below u^4 counts as its first point.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma
from jhd._runtime.arrays import varying
from jhd._shapes.curve import BezierSegments


class Chords(NamedTuple):
    """Chords with leading axes, and bounds of the distance of each from its part of the curve."""

    start: Array  # first points
    chord: Array  # vectors to the last points; zero if they are too short to count
    inverse: Array  # one over their squares, or zero
    delta: Array  # bounds of the distances of all control points from their chord


def chords_between(start: Array, end: Array, points: Array) -> Chords:
    """Return the chords from starts to ends (rows, dim); `delta` covers the points (rows, points, dim)."""
    dtype, chord = start.dtype, end - start
    square = jnp.sum(chord * chord, axis=-1)
    counts = square > float(jnp.finfo(dtype).eps) ** 4
    chord = jnp.where(counts[:, None], chord, 0.0)
    inverse = jnp.where(counts, 1 / jnp.where(counts, square, 1.0), 0.0)
    away = jax.vmap(lambda p, s, c, i: jax.vmap(lambda q: square_and_parameter(q, s, c, i)[0])(p))
    delta = jnp.sqrt(jnp.max(away(points, start, chord, inverse), axis=1)) + chord_error(start.shape[1], dtype)
    return Chords(start, chord, inverse, delta)


def runs_of(curve: BezierSegments) -> Chords:
    """Return for each segment of a curve the chord of its run; delta is inf for runs of one segment.

    Two consecutive segments belong to one run if they are joined and their chords turn by no more than rounding. A
    curved segment in a run makes its delta large, and the bound true and useless.
    """
    points, index = curve.control_points, jnp.arange(curve.count)
    first, last = points[:, 0], points[:, -1]
    chord = last - first
    length = jnp.sqrt(jnp.sum(chord**2, axis=1, keepdims=True))
    unit = chord / jnp.where(length > 0, length, 1.0)
    turn = jnp.sum((unit[1:] - unit[:-1]) ** 2, axis=1) * jnp.minimum(length[1:], length[:-1])[:, 0] ** 2
    joined = (turn <= (2 * chord_error(curve.dim, points.dtype)) ** 2) & jnp.all(last[:-1] == first[1:], axis=1)
    # Each step doubles how far the pointers to the neighbors in a run lead; scans take longer to compile.
    to = jnp.stack([index - jnp.append(False, joined), index + jnp.append(joined, False)])
    far = lambda _, to: jnp.take_along_axis(to, to, axis=1)  # noqa: E731
    begins, ends = jax.lax.fori_loop(0, curve.count.bit_length(), far, varying(to, curve))
    own = chords_between(first[begins], last[ends], points)
    delta = jax.ops.segment_max(own.delta, begins, curve.count, indices_are_sorted=True)[begins]
    return own._replace(delta=jnp.where(begins < ends, delta, jnp.inf))


def square_and_parameter(point: Array, start: Array, chord: Array, inverse: Array) -> tuple[Array, Array]:
    """Return the squared distance of a point from a chord, and the parameter of the nearest point."""
    d = point - start
    t = jnp.clip(jnp.sum(d * chord) * inverse, 0.0, 1.0)
    return jnp.sum((d - t * chord) ** 2), t


def chord_error(dim: int, dtype: DTypeLike) -> float:
    """Bound the rounding of the root of a squared distance from a chord."""
    return 4 * math.sqrt(dim) * gamma(40, dtype)
