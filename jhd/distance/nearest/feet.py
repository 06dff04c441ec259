"""Local feet on a curve: Newton's method across joints, and whether a foot is held at an end or corner."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arrays import varying
from jhd.distance.frame.jets import jet
from jhd.distance.frame.pieces import Piece, is_point, piece_of
from jhd.shapes.curve import BezierSegments

# A foot at an end of its segment is free where the slope of the distance is below this share of its size: Newton's
# method stops within the root of rounding, 1e-8, of a free one. A share of |A - B| |B'| is an angle, which tells a foot
# on a corner from one beside it; a share of |B'|^2 counts feet as free where A - B is rounding, of close curves.
_HELD = 1e-7


class Branch(NamedTuple):
    """A foot on b that is followed along a: its piece, and where it is pinned."""

    piece: Piece
    pinned: Array
    s: Array


class FootState(NamedTuple):
    """A local foot on b: its place, the point, and whether it is held at an end or corner."""

    segment: Array
    s: Array
    point: Array
    pinned: Array


def follow_foot(point: Array, b: BezierSegments, before: Array, segment: Array, s: Array, steps: int) -> FootState:
    """The local foot of the point reached from (segment, s) by Newton's method, across the joints of b.

    Args:
        point: the query.
        b: the curve that carries the foot.
        before: `preceding(b.following)`.
        segment: where to start.
        s: where to start.
        steps: number of Newton steps.
    """

    def newton(_: Any, foot: tuple[Array, Array]) -> tuple[Array, Array]:
        segment, s = foot
        s = s + newton_step(point, piece_of(b, segment), s)
        nxt, last = b.following[segment], before[segment]
        forward, backward = (s > 1) & (nxt >= 0), (s < 0) & (last >= 0)
        segment = jnp.where(forward, nxt, jnp.where(backward, last, segment))
        s = jnp.where(forward, 0.0, jnp.where(backward, 1.0, jnp.clip(s, 0.0, 1.0)))
        return segment, s

    segment, s = jax.lax.fori_loop(0, steps, newton, varying((segment, s), point, b))
    foot, pinned = foot_at(point, b, segment, s)
    return FootState(segment, s, foot, pinned)


@jax.jit
def newton_step(point: Array, piece: Piece, s: Array) -> Array:
    """Newton's step of (B - P).B' = 0, downhill by a quarter where the distance is not convex, at most a half."""
    b = jet(*piece, s)
    c = b.point - point
    residual, slope = c @ b.first, b.first @ b.first + c @ b.second
    step = jnp.where(slope > 0, -residual / jnp.where(slope > 0, slope, 1.0), -0.25 * jnp.sign(residual))
    return jnp.clip(step, -0.5, 0.5)


def foot_at(point: Array, b: BezierSegments, segment: Array, s: Array) -> tuple[Array, Array]:
    """The point at a parameter, and whether the foot is held there."""
    piece = piece_of(b, segment)
    return jet(*piece, s).point, is_held(point, piece, s)


def is_held(point: Array, piece: Piece, s: Array) -> Array:
    """Whether the foot of a point stays at an end or corner where the distance is not stationary, or at a point."""
    foot = jet(*piece, s)
    c = foot.point - point
    return stays(s, c @ foot.first, jnp.sqrt((c @ c) * (foot.first @ foot.first))) | is_point(piece)


def stays(s: Any, slope: Any, size: Any) -> Any:
    """Whether a foot is at an end of its segment, with a slope that is more than rounding of a size; in NumPy too."""
    return ((s <= 0) | (s >= 1)) & (abs(slope) > _HELD * size)


def presses(s: Any, slope: Any, size: Any) -> Any:
    """The same where the distance falls towards the end, as at a minimum."""
    return stays(s, slope, size) & ((slope > 0) == (s <= 0))
