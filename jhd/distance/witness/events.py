"""Residuals of the events at which the distance from a to b is maximal, and the witness that tells them apart.

A foot is free, where (A - B).B' = 0, or pinned at an end or corner of b, where its parameter is fixed. With that one
switch a pair of feet covers foot and foot, foot and end, end and end.

Source: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008; Cao et
al. 2014, section 3.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jhd.arrays import varying
from jhd.distance.frame.jets import jet
from jhd.distance.frame.pieces import Piece, Place, piece_of, preceding
from jhd.distance.nearest.curves import repeated, segment_bounds
from jhd.distance.nearest.feet import Branch, foot_at, newton_step
from jhd.shapes.curve import BezierSegments
from jhd.solution import DIRECTIONS, EVENTS, Witness

# The distance of two feet that count as equally near, relative to the size of the pair: refined maxima reach 1e-12.
_TIE = 1e-9
# Feet closer than this share of the size are one foot; two feet of one maximum merge only at a centre of curvature.
_SAME_FOOT = 1e-6
# Tangents that differ by more than this angle (radians) make a joint a corner.
_CORNER = 1e-6
# Starts of Newton's method on each segment when the feet of a witness are gathered; of many segments those with the
# smallest lower bounds are searched.
_STARTS, _SEARCHED = 8, 32
_NEWTON_STEPS = 12


@jax.jit
def event_residual(y: Float[Array, "3"], args: tuple[Piece, Branch, Branch, Array]) -> Float[Array, "3"]:
    """Residual of both refined events at y = (t, s, r), so that one solver serves them.

    One-to-two: |A - B(s)|^2 = |A - B(r)|^2 with both feet stationary (Cao14, equation 13). Antipodal: (A - B(s)).A' = 0
    with the foot stationary (Cao14, equation 12), and r pinned to its start.

    Args:
        y: the parameter of a and those of the two feet.
        args: the piece of a, the two branches, and whether the event is one-to-two.
    """
    piece, first, second, two = args
    a, b, d = jet(*piece, y[0]), jet(*first.piece, y[1]), jet(*second.piece, y[2])
    c, e = a.point - b.point, a.point - d.point
    # (c + e).(c - e) with c - e = d - b: the difference of the squares without cancellation.
    difference = (c + e) @ (d.point - b.point)
    return jnp.stack(
        [
            jnp.where(two, difference, c @ a.first),
            _foot_residual(c @ b.first, y[1], first),
            jnp.where(two, _foot_residual(e @ d.first, y[2], second), y[2] - second.s),
        ]
    )


def _foot_residual(stationarity: Array, s: Array, branch: Branch) -> Array:
    return jnp.where(branch.pinned, s - branch.s, stationarity)


def describe(a: BezierSegments, b: BezierSegments, at: Place, foot: Place, size: Array) -> Witness:
    """The witness at the parameter (segment, t) of a: nearest feet on b, multipliers and the kind of event.

    All local feet that are equally near are gathered. Where two of them pull the distance opposite ways along a, the
    maximum is one-to-two and its multipliers solve lambda_1 g_1 + lambda_2 g_2 = 0, g_i = d/dt |A - B(s_i)|; otherwise
    the nearest foot alone is active. The first foot in the order of segments and parameters is named first.

    Args:
        a: the curve that carries the maximum.
        b: the other one.
        at: the place of the maximum on a.
        foot: its nearest point on b, as proven; it stands in where the local feet miss it, as at a cusp.
        size: largest extent of the pair, for the tolerances.
    """
    segment, t = at
    here = jet(*piece_of(a, segment), t)
    segments, params = _local_feet(here.point, b)
    segments, params = jnp.append(segments, foot.segment), jnp.append(params, foot.t)
    feet = jax.vmap(lambda k, s: jet(*piece_of(b, k), s).point)(segments, params)
    distances = jnp.sqrt(jnp.sum((here.point - feet) ** 2, axis=-1))
    least = jnp.min(distances)
    active = distances <= least + _TIE * size
    safe = jnp.where(distances > 0, distances, 1.0)
    slopes = (here.point - feet) @ here.first / safe
    up = jnp.argmax(jnp.where(active, slopes, -jnp.inf))
    down = jnp.argmin(jnp.where(active, slopes, jnp.inf))
    nearest = jnp.argmin(distances)
    end, corner = _end_or_corner(a, segment, t)
    apart = jnp.sum((feet[up] - feet[down]) ** 2) > (_SAME_FOOT * size) ** 2
    two = (slopes[up] > 0) & (slopes[down] < 0) & apart & ~end & ~corner
    turned = segments[up] + params[up] > segments[down] + params[down]
    order = jnp.where(turned, jnp.stack([down, up]), jnp.stack([up, down]))
    chosen = jnp.where(two, order, jnp.stack([nearest, nearest]))
    g = slopes[chosen]
    spread = jnp.where(two, g[0] - g[1], 1.0)
    multipliers = jnp.where(two, jnp.stack([-g[1], g[0]]) / spread, jnp.array([1.0, 0.0]))
    _, pinned = foot_at(here.point, b, segments[nearest], params[nearest])
    event = EVENTS.where(pinned, EVENTS.b_end, EVENTS.antipodal)
    event = EVENTS.where(two, EVENTS.one_to_two, event)
    event = EVENTS.where(corner, EVENTS.corner, event)
    event = EVENTS.where(end, EVENTS.a_end, event)
    event = EVENTS.where(least <= _TIE**1.5 * size, EVENTS.coincident, event)
    return Witness(
        segment=segment,
        t=t,
        point=here.point,
        feet=feet[chosen],
        foot_segments=segments[chosen],
        foot_params=params[chosen],
        multipliers=multipliers,
        event=event,
        direction=DIRECTIONS.a_to_b,
    )


def _local_feet(point: Array, b: BezierSegments) -> tuple[Array, Array]:
    """Local feet from several starts on each of the nearest segments, ends included: indices and parameters, flat."""
    starts = jnp.linspace(0.0, 1.0, _STARTS)
    segments = jnp.arange(b.count)
    if b.count > _SEARCHED:
        lower, _ = segment_bounds(point, b.control_points, b.weights)
        lower = jnp.where(repeated(b.control_points, b.weights), jnp.inf, lower)
        segments = jnp.sort(jax.lax.top_k(-lower.astype(jnp.float32), _SEARCHED)[1])

    def feet_on(segment: Array) -> tuple[Array, Array]:
        piece = piece_of(b, segment)

        def foot(s: Array) -> Array:
            step = lambda _, s: jnp.clip(s + newton_step(point, piece, s), 0.0, 1.0)  # noqa: E731
            return jax.lax.fori_loop(0, _NEWTON_STEPS, step, varying(s, point, b))

        return jnp.full((_STARTS,), segment), jax.vmap(foot)(starts)

    segments, params = jax.vmap(feet_on)(segments)
    return segments.ravel(), params.ravel()


def _end_or_corner(a: BezierSegments, segment: Array, t: Array) -> tuple[Array, Array]:
    """Whether (segment, t) is a free end of a, and whether it is a joint where the tangent jumps."""
    nxt, last = a.following[segment], preceding(a.following)[segment]
    neighbour = jnp.where(t >= 1, nxt, jnp.where(t <= 0, last, segment))
    at_end = (t <= 0) | (t >= 1)
    first = _direction(a, segment, t)
    second = _direction(a, neighbour, jnp.where(t >= 1, 0.0, jnp.where(t <= 0, 1.0, t)))
    # The angle between unit vectors is nearly the length of their difference.
    jump = jnp.sum((first - second) ** 2) > _CORNER**2
    joined = at_end & (neighbour >= 0)
    return at_end & (neighbour < 0), joined & jump


def _direction(a: BezierSegments, segment: Array, t: Array) -> Array:
    """Unit tangent of a segment; at an end with zero speed that of the chord to a point a little inside."""
    piece = piece_of(a, segment)
    here = jet(*piece, t)
    inside = jet(*piece, jnp.clip(t, 1e-4, 1 - 1e-4)).point - here.point
    inside = jnp.where(t >= 1, -inside, inside)
    extent = jnp.max(jnp.abs(piece.control_points - piece.control_points[0]))
    slow = jnp.max(jnp.abs(here.first)) <= 1e-9 * extent
    vector = jnp.where(slow, inside, here.first)
    length = jnp.sqrt(jnp.sum(vector**2))
    return vector / jnp.where(length > 0, length, 1.0)
