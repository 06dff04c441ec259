"""Segments of a curve, places on it, and which segment precedes which."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jhd._shapes.curve import BezierSegments


class Piece(NamedTuple):
    """One segment: control points and weights."""

    control_points: Float[Array, "points dim"]
    weights: Float[Array, " points"] | None


class CurvePlace(NamedTuple):
    """A point of a curve by its segment and parameter."""

    segment: Array
    t: Array

    def if_(self, condition: Array, other: "CurvePlace") -> "CurvePlace":
        """This place if the condition holds, else the other one."""
        return CurvePlace(*(jnp.where(condition, x, y) for x, y in zip(self, other, strict=True)))


def piece_of(curve: BezierSegments, segment: Array) -> Piece:
    """The segment with this index."""
    return Piece(curve.control_points[segment], None if curve.weights is None else curve.weights[segment])


def is_point(piece: Piece) -> Array:
    """Whether all control points of a segment are one."""
    return jnp.all(piece.control_points == piece.control_points[0])


def preceding(next_segment: Array) -> Array:
    """For each segment the one that ends where it starts, -1 at a free start: `next_segment` turned round.

    Where several end there, as repeated segments do, it is the first of them.
    """
    count = next_segment.shape[-1]
    # The free ends, -1, all write to the slot behind the last.
    slots = jnp.where(next_segment < 0, count, next_segment)
    first = jnp.full(count + 1, count).at[slots].min(jnp.arange(count))[:count]
    return jnp.where(first < count, first, -1)
