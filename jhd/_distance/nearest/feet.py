"""Local feet on a curve: Newton's method on one segment and across joints, their speed, and whether an end holds them.

A foot is a root of (B - P).B' near a parameter; nothing is proven of it here.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.normalization.jets import CurveJet, jet
from jhd._distance.normalization.pieces import Piece, is_point, piece_of
from jhd._runtime.arrays import module_of, varying
from jhd._shapes.curve import BezierSegments

# A foot at an end of its segment is free where the slope of the distance is below this share of its size: Newton's
# method stops within the root of rounding, 1e-8, of a free one. A share of |A - B| |B'| is an angle, which tells a foot
# on a corner from one beside it; a share of |B'|^2 counts feet as free where A - B is rounding, of close curves.
_HELD = 1e-7
# A speed below this share of the segment's extent is none: the segment stands still there.
_STILL = 1e-9
# Rounding of (B - P).B' in common coordinates, in units of roundoff of |B - P| + |B'|.
_ROUNDED = 256
# The equation has a slope, and a foot moves, where it is above this share of |B'|^2.
_SINGULAR = 1e-10
# Newton's step is short below a quarter of the segment: four times the residual must be below the slope.
_SHORT = 4.0
# Below these shares of |B'|^2 the slope of the equation tells little: of the place of a foot, and of its speed.
_FLAT, _SLOW = 0.05, 1e-3
# Share of the interval by which a step goes downhill where Newton's method would climb.
_DOWNHILL = 0.25


class FootEquation(NamedTuple):
    """(B - P).B' at a parameter: B - P, B', the residual, its slope, and |B'|^2, which is the slope near the curve."""

    apart: Any
    first: Any
    residual: Any
    slope: Any
    square: Any

    @property
    def distance_sq(self) -> Any:
        """|B - P|^2."""
        return dot(self.apart, self.apart)

    @property
    def rounding(self) -> Array:
        """How large the residual can be at a foot, in common coordinates."""
        eps = float(jnp.finfo(self.residual.dtype).eps)
        return _ROUNDED * eps * (jnp.sqrt(self.distance_sq) + jnp.sqrt(self.square))

    @property
    def is_simple(self) -> Array:
        """Whether the root is simple."""
        return abs(self.slope) > _SINGULAR * self.square

    @property
    def is_minimum(self) -> Array:
        """Whether the distance is stationary there, up to rounding, and not largest."""
        return (abs(self.residual) <= self.rounding) & (self.slope >= -_SINGULAR * self.square)

    @property
    def uncertainty(self) -> Array:
        """How far from the root the rounding of the equation leaves the foot, as a length along the curve."""
        flat = _SINGULAR * self.square
        slope = jnp.maximum(self.slope, jnp.where(flat > 0, flat, 1.0))
        return self.rounding * jnp.sqrt(self.square) / slope


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
        before: `preceding(b.next_segment)`.
        segment: where to start.
        s: where to start.
        steps: number of Newton steps.
    """

    def newton(_: Any, foot: tuple[Array, Array]) -> tuple[Array, Array]:
        segment, s = foot
        s = s + newton_step(equation(point, piece_of(b, segment), s), _DOWNHILL)
        nxt, last = b.next_segment[segment], before[segment]
        forward, backward = (s > 1) & (nxt >= 0), (s < 0) & (last >= 0)
        segment = jnp.where(forward, nxt, jnp.where(backward, last, segment))
        s = jnp.where(forward, 0.0, jnp.where(backward, 1.0, jnp.clip(s, 0.0, 1.0)))
        return segment, s

    segment, s = jax.lax.fori_loop(0, steps, newton, varying((segment, s), point, b))
    foot, pinned = foot_at(point, b, segment, s)
    return FootState(segment, s, foot, pinned)


def foot_in(point: Array | float, piece: Piece, s: Array, steps: int, low: Any = 0.0, high: Any = 1.0) -> Array:
    """The local foot of a point reached from s by Newton's method, kept in [low, high]."""
    step = lambda _, s: step_in(equation(point, piece, s), s, low, high)  # noqa: E731
    return jax.lax.fori_loop(0, steps, step, varying(s, point, piece, low, high))


def step_in(here: FootEquation, s: Array, low: Any = 0.0, high: Any = 1.0) -> Array:
    """The parameter in [low, high] after a step of Newton's method from s towards a local foot."""
    return jnp.clip(s + newton_step(here, _DOWNHILL * (high - low)), low, high)


def nearest_passed(point: Array, piece: Piece, s: Array, steps: int) -> Array:
    """A parameter in [0, 1] near s where (B - P).B' is small: Newton's method, Gauss-Newton where it is not convex.

    Next to the center of curvature the distance is convex but hardly so; there Newton's step is taken if it is short.
    The nearest of all the points passed is returned: at a cusp of b the steps lead anywhere.
    """

    def newton(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        s, best, least = state
        here = equation(point, piece, s)
        # At a tie the later one, which Newton's method has improved beyond what the squares can tell.
        nearer = here.distance_sq <= least
        return gauss_newton(s, here), jnp.where(nearer, s, best), jnp.where(nearer, here.distance_sq, least)

    # One step more than are taken, whose place is only compared: one evaluation in a program instead of two.
    start = varying((s, s, jnp.full_like(s, jnp.inf)), point, piece)
    return jax.lax.fori_loop(0, steps + 1, newton, start)[1]


def equation(point: Array | float, piece: Piece, s: Array) -> FootEquation:
    """The equation of the foot of a point on one segment."""
    return equation_of(point, jet(*piece, s))


def equation_of(point: Any, b: CurveJet) -> FootEquation:
    """The same from the jet of the curve; in NumPy, and for many of both along leading axes, too."""
    apart, square = b.point - point, dot(b.first, b.first)
    return FootEquation(apart, b.first, dot(apart, b.first), square + dot(apart, b.second), square)


def newton_step(here: FootEquation, downhill: Any) -> Array:
    """Newton's step; where the distance is not convex, in which it would climb, this far downhill."""
    convex = here.slope > 0
    return jnp.where(convex, -here.residual / jnp.where(convex, here.slope, 1.0), -downhill * jnp.sign(here.residual))


def gauss_newton(s: Any, here: FootEquation) -> Any:
    """The parameter in [0, 1] after Newton's step, or that of Gauss and Newton where it is long and hardly convex."""
    xp = module_of(s)
    least = xp.minimum(_FLAT * here.square, _SHORT * abs(here.residual))
    return xp.clip(s - here.residual / _slope(here, least), 0.0, 1.0)


def foot_speed(s: Any, here: FootEquation, velocity: Any, width: Any) -> Any:
    """ds/dt of the foot of a moving point: A'.B' / (B'.B' + (B - P).B''); 0 where the foot is held at an end.

    Where the distance is not convex, or so little that the foot would run along all of b while the point runs along its
    width, the speed of the nearest point of the tangent stands in.
    """
    xp, common = module_of(s), dot(velocity, here.first)
    least = xp.minimum(_SLOW * here.square, width * abs(common))
    return xp.where(stays(s, here.residual, here.square), 0.0, common / _slope(here, least))


def _slope(here: FootEquation, least: Any) -> Any:
    """The slope of the equation, or |B'|^2 where it is not above a least one; 1 where both are zero."""
    xp = module_of(here.slope)
    slope = xp.where(here.slope > least, here.slope, here.square)
    return xp.where(slope > 0, slope, 1.0)


def dot(x: Any, y: Any) -> Any:
    """Scalar products along the last axis."""
    return (x * y).sum(-1)


def foot_at(point: Array, b: BezierSegments, segment: Array, s: Array) -> tuple[Array, Array]:
    """The point at a parameter, and whether the foot is held there."""
    piece = piece_of(b, segment)
    return jet(*piece, s).point, is_held(point, piece, s)


def is_held(point: Array, piece: Piece, s: Array) -> Array:
    """Whether the foot of a point stays at an end or corner where the distance is not stationary, or at a point."""
    return holds(equation(point, piece, s), piece, s)


def holds(here: FootEquation, piece: Piece, s: Array) -> Array:
    """The same from the equation of the foot; an end where the segment stands still holds its foot, too."""
    border = (s <= 0) | (s >= 1)
    still = border & stands_still(here.first, piece.control_points)
    return stays(s, here.residual, jnp.sqrt(here.distance_sq * here.square)) | still | is_point(piece)


def stands_still(first: Any, control_points: Any) -> Any:
    """Whether a derivative of a segment is none; in NumPy, and for many segments along leading axes, too."""
    extent = abs(control_points - control_points[..., :1, :]).max((-2, -1))
    return abs(first).max(-1) <= _STILL * extent


def by_normal(apart_sq: Any, speed_sq: Any) -> Any:
    """Whether the normal of the curve tells the direction to a foot in the plane better than B - P does.

    Both are off by the same rounding divided by their lengths: B - P is lost where the curves nearly coincide, the
    normal where the curve stands still.
    """
    return speed_sq > apart_sq


def stays(s: Any, slope: Any, size: Any) -> Any:
    """Whether a foot is at an end of its segment, with a slope that is more than rounding of a size; in NumPy too."""
    return ((s <= 0) | (s >= 1)) & (abs(slope) > _HELD * size)


def presses(s: Any, slope: Any, size: Any) -> Any:
    """The same where the distance falls towards the end, as at a minimum."""
    return stays(s, slope, size) & ((slope > 0) == (s <= 0))
