"""Residuals of the events at which the distance from a to b is maximal, and the witness that tells them apart.

A foot is free, where (A - B).B' = 0, or pinned at an end or corner of b, where its parameter is fixed. With that one
switch a pair of feet covers foot and foot, foot and end, end and end.

Source: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008; Cao et
al. 2014, section 3.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jhd.distance.frame.jets import jet
from jhd.distance.frame.pieces import CurvePlace, Piece, piece_of, preceding
from jhd.distance.nearest.curves import repeated, segment_bounds
from jhd.distance.nearest.feet import Branch, foot_at, foot_in
from jhd.distance.witness.ends import around
from jhd.distance.witness.multipliers import two_of
from jhd.shapes.curve import BezierSegments
from jhd.solution import DIRECTIONS, EVENTS, Witness

# The distance of two feet that count as equally near, relative to the size of the pair: refined maxima reach 1e-12.
_TIE = 1e-9
# Distances below this, in common coordinates, are zero: points of curves are evaluated to a hundred roundings.
ZERO = 3e-14
# Feet closer than this share of the size are one foot; two feet of one maximum merge only at a centre of curvature.
_SAME_FOOT = 1e-6
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


def describe(a: BezierSegments, b: BezierSegments, at: CurvePlace, foot: CurvePlace, size: Array) -> Witness:
    """The witness at the parameter (segment, t) of a: nearest feet on b, multipliers and the kind of event.

    All local feet that are equally near are gathered, and of them one or two count, as jhd.distance.witness.multipliers
    has it: two inside of a, where the maximum is then one-to-two, if they pull the distance opposite ways along a; two
    at an end or corner if the nearest one alone would make the maximum leave it. The first foot in the order of
    segments and parameters is named first.

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
    place = around(a, preceding(a.following), at)
    units = (here.point - feet) / jnp.where(distances > 0, distances, 1.0)[:, None]
    nearest = jnp.argmin(distances)
    pair, share = two_of(units @ place.into.T, active, nearest)
    apart = jnp.sum((feet[pair[0]] - feet[pair[1]]) ** 2) > (_SAME_FOOT * size) ** 2
    two = (share > 0) & (share < 1) & apart
    order = segments[pair] + params[pair]
    turned = two & (order[0] > order[1])
    pair, share = jnp.where(turned, pair[::-1], pair), jnp.where(turned, 1 - share, share)
    single = pair[jnp.where(share >= 0.5, 0, 1)]
    chosen = jnp.where(two, pair, single)
    multipliers = jnp.where(two, jnp.stack([share, 1 - share]), jnp.array([1.0, 0.0]))
    _, pinned = foot_at(here.point, b, segments[single], params[single])
    event = EVENTS.where(pinned, EVENTS.b_end, EVENTS.antipodal)
    event = EVENTS.where(two, EVENTS.one_to_two, event)
    event = EVENTS.where(place.corner, EVENTS.corner, event)
    event = EVENTS.where(place.end, EVENTS.a_end, event)
    event = EVENTS.where(least <= ZERO * size, EVENTS.coincident, event)
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
        return jnp.full((_STARTS,), segment), jax.vmap(lambda s: foot_in(point, piece, s, _NEWTON_STEPS))(starts)

    segments, params = jax.vmap(feet_on)(segments)
    return segments.ravel(), params.ravel()
