"""Ends and corners of a curve: the directions in which the curve leaves one of its points."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.nearest.feet import stands_still
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of
from jhd._shapes.curve import BezierSegments

# If a segment stands still, the chord to a point this far inside replaces the tangent.
_INSIDE = 1e-4


class Around(NamedTuple):
    """The directions of a curve at a point: whether it is a free end or a corner, and unit vectors along the curve."""

    end: Array  # the curve begins or ends there
    corner: Array  # a joint at which the tangent jumps
    into: Array  # (2, dim) unit vectors from the point along the curve; zero if missing or if the curve stands still


def around(curve: BezierSegments, before: Array, at: CurvePlace) -> Around:
    """Return the kind of a point of a curve and its directions; `before` is `preceding(curve.next_segment)`.

    A joint without a corner is an ordinary point, and so is the seam of a closed curve.
    """
    segment, t = at
    first, last = t <= 0, t >= 1
    neighbor = jnp.where(last, curve.next_segment[segment], jnp.where(first, before[segment], segment))
    beyond = jnp.where(last, 0.0, jnp.where(first, 1.0, t))
    own, other = jax.vmap(lambda k, t: _tangent(curve, k, t))(jnp.stack([segment, neighbor]), jnp.stack([t, beyond]))
    border = first | last
    end = border & (neighbor < 0)
    # The angle between unit vectors is nearly the length of their difference.
    # Tangents that differ by more than this angle (radians) make a joint a corner: joints that are smooth by
    # construction are off by the rounding of control points, divided by the length of the first leg.
    corner = border & (neighbor >= 0) & (jnp.sum((own - other) ** 2) > 1e-6**2)
    back = jnp.where(last, -own, own)
    on = jnp.where(corner, jnp.where(last, other, -other), jnp.where(end, 0.0, -back))
    return Around(end, corner, jnp.stack([back, on]))


def _tangent(curve: BezierSegments, segment: Array, t: Array) -> Array:
    """Return the unit tangent of a segment; at an end with zero speed, the chord to a point a little inside."""
    piece = piece_of(curve, segment)
    here = jet(*piece, t)
    inside = jet(*piece, jnp.clip(t, _INSIDE, 1 - _INSIDE)).point - here.point
    inside = jnp.where(t >= 1, -inside, inside)
    vector = jnp.where(stands_still(here.first, piece.control_points), inside, here.first)
    length = jnp.sqrt(jnp.sum(vector**2))
    return vector / jnp.where(length > 0, length, 1.0)
