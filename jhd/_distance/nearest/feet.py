"""Local feet on a curve: Newton's method on one segment and across joints, their speed, and whether an end holds them.

A foot is a root of (B - P).B' near a parameter; nothing is proven about it here.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.normalization.jets import CurveJet, jet
from jhd._distance.normalization.pieces import Piece, is_point, piece_of
from jhd._runtime.arrays import module_of, varying
from jhd._shapes.curve import BezierSegments

# The equation has a slope, and a foot moves, if the slope is above this fraction of |B'|^2.
_SINGULAR = 1e-10
# Newton's step is short below a quarter of the segment: four times the residual must be below the slope.
_SHORT = 4.0
# Below these fractions of |B'|^2 the slope of the equation is unreliable: for the location and speed of a foot.
_FLAT, _SLOW = 0.05, 1e-3
# Fraction of the interval by which a step goes downhill when Newton's method would climb.
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
        """Bound the residual at a foot that rounding can cause, in common coordinates."""
        eps = float(jnp.finfo(self.residual.dtype).eps)
        # Rounding of (B - P).B' in common coordinates, in units of roundoff of |B - P| + |B'|.
        return 256 * eps * (jnp.sqrt(self.distance_sq) + jnp.sqrt(self.square))

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
        """Bound the distance of the foot from the root that rounding causes, as a length along the curve."""
        flat = _SINGULAR * self.square
        slope = jnp.maximum(self.slope, jnp.where(flat > 0, flat, 1.0))
        return self.rounding * jnp.sqrt(self.square) / slope


class Branch(NamedTuple):
    """A foot on b that is followed along a: its piece, parameter, and whether it is pinned there."""

    piece: Piece
    pinned: Array
    s: Array


class FootState(NamedTuple):
    """A local foot on b: its segment and parameter, the point, and whether it is held at an end or corner."""

    segment: Array
    s: Array
    point: Array
    pinned: Array


def follow_foot(point: Array, b: BezierSegments, before: Array, segment: Array, s: Array, steps: int) -> FootState:
    """Return the local foot of the point, reached from (segment, s) by Newton's method across the joints of b.

    Args:
        point: the query.
        b: the curve that carries the foot.
        before: `preceding(b.next_segment)`.
        segment: first segment.
        s: first parameter on it.
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
    """Return the local foot of a point reached from s by Newton's method, kept in [low, high]."""
    step = lambda _, s: step_in(equation(point, piece, s), s, low, high)  # noqa: E731
    return jax.lax.fori_loop(0, steps, step, varying(s, point, piece, low, high))


def step_in(here: FootEquation, s: Array, low: Any = 0.0, high: Any = 1.0) -> Array:
    """Return the parameter in [low, high] after a Newton step from s towards a local foot."""
    return jnp.clip(s + newton_step(here, _DOWNHILL * (high - low)), low, high)


def nearest_passed(point: Array, piece: Piece, s: Array, steps: int) -> Array:
    """Return a parameter in [0, 1] near s at which (B - P).B' is small, by Newton's and Gauss-Newton steps.

    A Gauss-Newton step replaces Newton's if the distance is not convex. Next to the center of curvature it is hardly
    convex; Newton's step is then taken if it is short. The nearest of all the points passed is returned: at a cusp of b
    the steps lead anywhere.
    """

    def newton(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        s, best, least = state
        here = equation(point, piece, s)
        # At a tie the later parameter, which Newton's method has improved beyond the resolution of the squares.
        nearer = here.distance_sq <= least
        return gauss_newton(s, here), jnp.where(nearer, s, best), jnp.where(nearer, here.distance_sq, least)

    # The extra last step only compares: one evaluation in the compiled function instead of two.
    start = varying((s, s, jnp.full_like(s, jnp.inf)), point, piece)
    return jax.lax.fori_loop(0, steps + 1, newton, start)[1]


def equation(point: Array | float, piece: Piece, s: Array) -> FootEquation:
    """Return the equation of the foot of a point on one segment."""
    return equation_of(point, jet(*piece, s))


def equation_of(point: Any, b: CurveJet) -> FootEquation:
    """Return the equation of the foot from the jet of the curve; also in NumPy, and for many along leading axes."""
    apart, square = b.point - point, dot(b.first, b.first)
    return FootEquation(apart, b.first, dot(apart, b.first), square + dot(apart, b.second), square)


def newton_step(here: FootEquation, downhill: Any) -> Array:
    """Return Newton's step; if the distance is not convex, a step of length `downhill` that decreases it."""
    convex = here.slope > 0
    return jnp.where(convex, -here.residual / jnp.where(convex, here.slope, 1.0), -downhill * jnp.sign(here.residual))


def gauss_newton(s: Any, here: FootEquation) -> Any:
    """Return the parameter in [0, 1] after Newton's step, or Gauss-Newton's if it is long and hardly convex."""
    xp = module_of(s)
    least = xp.minimum(_FLAT * here.square, _SHORT * abs(here.residual))
    return xp.clip(s - here.residual / _slope(here, least), 0.0, 1.0)


def foot_speed(s: Any, here: FootEquation, velocity: Any, width: Any) -> Any:
    """Return ds/dt of the foot of a moving point: A'.B' / (B'.B' + (B - P).B''); 0 if the foot is held at an end.

    If the distance is not convex, or hardly convex, the speed of the nearest point of the tangent is used. It is hardly
    convex if the foot would cross all of b while the point crosses its width.
    """
    xp, common = module_of(s), dot(velocity, here.first)
    least = xp.minimum(_SLOW * here.square, width * abs(common))
    return xp.where(stays(s, here.residual, here.square), 0.0, common / _slope(here, least))


def _slope(here: FootEquation, least: Any) -> Any:
    """Return the slope of the equation, or |B'|^2 if the slope is not above `least`; 1 if both are zero."""
    xp = module_of(here.slope)
    slope = xp.where(here.slope > least, here.slope, here.square)
    return xp.where(slope > 0, slope, 1.0)


def dot(x: Any, y: Any) -> Any:
    """Scalar products along the last axis."""
    return (x * y).sum(-1)


def foot_at(point: Array, b: BezierSegments, segment: Array, s: Array) -> tuple[Array, Array]:
    """Return the point at a parameter, and whether the foot is held there."""
    piece = piece_of(b, segment)
    return jet(*piece, s).point, is_held(point, piece, s)


def is_held(point: Array, piece: Piece, s: Array) -> Array:
    """Return whether the foot of a point stays at a non-stationary end or corner, or its segment is a point."""
    return holds(equation(point, piece, s), piece, s)


def holds(here: FootEquation, piece: Piece, s: Array) -> Array:
    """Return `is_held` from the equation of the foot; an end at which the segment stands still holds its foot, too."""
    border = (s <= 0) | (s >= 1)
    still = border & stands_still(here.first, piece.control_points)
    return stays(s, here.residual, jnp.sqrt(here.distance_sq * here.square)) | still | is_point(piece)


def stands_still(first: Any, control_points: Any) -> Any:
    """Return whether a derivative of a segment is zero up to rounding; for NumPy and leading axes, too."""
    extent = abs(control_points - control_points[..., :1, :]).max((-2, -1))
    # A speed below this fraction of the segment's extent counts as zero: the segment stands still there.
    return abs(first).max(-1) <= 1e-9 * extent


def by_normal(apart_sq: Any, speed_sq: Any) -> Any:
    """Return whether the normal of the curve gives the direction to a foot in the plane more exactly than B - P.

    Both have the same rounding error divided by their lengths. B - P is lost if the curves nearly coincide, the normal
    if the curve stands still.
    """
    return speed_sq > apart_sq


def stays(s: Any, slope: Any, size: Any) -> Any:
    """Return whether a foot is at an end of its segment, with a slope above the rounding of `size`; in NumPy too."""
    # A foot at an end of its segment is free if the slope of the distance is below this fraction of its size: Newton's
    # method stops within the root of rounding, 1e-8, of a free foot. A fraction of |A - B| |B'| is an angle, which
    # tells a foot on a corner from a foot next to it; a fraction of |B'|^2 counts feet as free if A - B is rounding.
    return ((s <= 0) | (s >= 1)) & (abs(slope) > 1e-7 * size)


def presses(s: Any, slope: Any, size: Any) -> Any:
    """Return whether the foot stays at an end towards which the distance falls, as at a minimum."""
    return stays(s, slope, size) & ((slope > 0) == (s <= 0))
