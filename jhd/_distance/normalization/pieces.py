"""Segments of a curve, points on it by segment and parameter, and the predecessors of segments."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jhd._shapes.curve import BezierSegments


class Piece(NamedTuple):
    """A segment: control points and weights."""

    control_points: Float[Array, "points dim"]
    weights: Float[Array, " points"] | None


class CurvePlace(NamedTuple):
    """A point of a curve by its segment and parameter."""

    segment: Array
    t: Array

    def if_(self, condition: Array, other: "CurvePlace") -> "CurvePlace":
        """Return this point if the condition holds, else `other`."""
        return CurvePlace(*(jnp.where(condition, x, y) for x, y in zip(self, other, strict=True)))


def piece_of(curve: BezierSegments, segment: Array) -> Piece:
    """Return the segment with this index."""
    return Piece(curve.control_points[segment], None if curve.weights is None else curve.weights[segment])


def is_point(piece: Piece) -> Array:
    """Return whether all control points of a segment are equal."""
    return jnp.all(piece.control_points == piece.control_points[0])


def preceding(next_segment: Array) -> Array:
    """Return for each segment the one that ends at its start, -1 at a free start: the inverse of `next_segment`.

    If several end there, for example repeated segments, it is the first of them.
    """
    count = next_segment.shape[-1]
    # The free ends, -1, all write to the slot behind the last.
    slots = jnp.where(next_segment < 0, count, next_segment)
    first = jnp.full(count + 1, count).at[slots].min(jnp.arange(count))[:count]
    return jnp.where(first < count, first, -1)
