"""Residuals of the events at which the distance from a to b is maximal, and the witness that tells them apart.

A foot is free, with (A - B).B' = 0, or pinned at an end or corner of b, with a fixed parameter. With this one switch a
pair of feet covers foot and foot, foot and end, end and end.

Source: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008; Cao et
al. 2014, section 3.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jhd._distance.nearest.curves import repeated, segment_bounds
from jhd._distance.nearest.feet import Branch, FootEquation, equation, holds, step_in
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, Piece, piece_of, preceding
from jhd._distance.witness.ends import Around, around
from jhd._distance.witness.multipliers import two_of
from jhd._results.solution import DIRECTIONS, EVENTS, Witness
from jhd._runtime.arrays import varying
from jhd._shapes.curve import BezierSegments

# Distances, in common coordinates, that differ by at most this are equal: refined maxima reach 1e-12.
_TIE = 1e-9
# Distances below this, in common coordinates, are zero: points of curves are evaluated to a hundred roundings.
ZERO = 3e-14
# Feet no farther apart than this are one; so are feet no farther apart than the second number times the uncertainty of
# each by rounding, up to the third. Two feet of one maximum merge only at a center of curvature. There both feet are
# known only to a small fraction of the size, and so are all directions between them.
_SAME_FOOT, _UNCERTAIN, _MERGED = 1e-6, 16, 1e-3
# Factor by which the gap may be too small, and the largest distance of a point from its maximum.
OPEN, _FARTHEST = 4, 1.0
# Starts of Newton's method on each segment when the feet of a witness are gathered. If there are more segments than
# curves are usually padded to, only the segments with the smallest lower bounds are searched.
_STARTS, _SEARCHED = 8, 48
# Most Newton steps; they end when none is longer than this: next to a center of curvature each gains a third.
_NEWTON_STEPS, _SETTLED = 48, 1e-9


@jax.jit
def event_residual(y: Float[Array, "3"], args: tuple[Piece, Branch, Branch, Array]) -> Float[Array, "3"]:
    """Return the residual of both refined events at y = (t, s, r), so that one solver serves them.

    One-to-two: |A - B(s)|^2 = |A - B(r)|^2 with both feet stationary (Cao14, equation 13). Antipodal: (A - B(s)).A' = 0
    with the foot stationary (Cao14, equation 12), and r pinned to its start.

    Args:
        y: the parameter of a and the parameters of the two feet.
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


class Described(NamedTuple):
    """A point of a with its local feet on b, before some of them are chosen."""

    at: CurvePlace  # segment and parameter of the point
    around: Around  # the directions in which a leaves it
    point: Array  # the point
    feet: Array  # local feet on b, (feet, dim)
    segments: Array  # segments of the feet
    params: Array  # parameters of the feet
    held: Array  # whether a foot is held at an end or corner
    uncertainty: Array  # bound on the displacement of each foot by rounding
    distances: Array  # distances to the feet; inf if there is no foot
    slopes: Array  # slopes of the distances along the directions in which a leaves the point, (feet, 2)

    @property
    def nearest(self) -> CurvePlace:
        """The nearest foot."""
        k = jnp.argmin(self.distances)
        return CurvePlace(self.segments[k], self.params[k])

    def reach(self, gap: Array) -> Array:
        """Bound how far along a the maximum can be, if the bounds of the distance are apart by `gap`.

        The distance to the nearest foot rises towards the maximum, by at most the gap.
        """
        steep = jnp.max(self.slopes[jnp.argmin(self.distances)])
        reach = jnp.where(steep > 0, OPEN * gap / jnp.where(steep > 0, steep, 1.0), 0.0)
        return jnp.minimum(reach, _FARTHEST)

    def witness(self, reach: Array | float = 0.0) -> Witness:
        """Return the witness, with the feet that count if the maximum is no farther along a than `reach`.

        The feet that balance to first order count, one or two (jhd._distance.witness.multipliers). Inside of a, two
        feet count if they pull the distance opposite ways along a; the maximum is then one-to-two. At an end or corner,
        two feet count if the nearest foot alone would make the maximum leave it. The first foot in the order of
        segments and parameters is named first.
        """
        nearest = jnp.argmin(self.distances)
        least = self.distances[nearest]
        excess = self.distances - least
        tied = excess <= _TIE
        active = tied | (excess <= 2 * reach)
        farther = jnp.where(tied | ~active, 0.0, excess / jnp.maximum(reach, _TIE))
        pair, share = two_of(self.slopes, active, nearest, farther)
        uncertain = jnp.clip(_UNCERTAIN * jnp.sum(self.uncertainty[pair]), _SAME_FOOT, _MERGED)
        apart = jnp.sum((self.feet[pair[0]] - self.feet[pair[1]]) ** 2) > uncertain**2
        two = (share > 0) & (share < 1) & apart
        order = self.segments[pair] + self.params[pair]
        turned = two & (order[0] > order[1])
        pair, share = jnp.where(turned, pair[::-1], pair), jnp.where(turned, 1 - share, share)
        single = pair[jnp.where(share >= 0.5, 0, 1)]
        chosen = jnp.where(two, pair, single)
        event = EVENTS.where(self.held[single], EVENTS.b_end, EVENTS.antipodal)
        event = EVENTS.where(two, EVENTS.one_to_two, event)
        event = EVENTS.where(self.around.corner, EVENTS.corner, event)
        event = EVENTS.where(self.around.end, EVENTS.a_end, event)
        event = EVENTS.where(least <= ZERO, EVENTS.coincident, event)
        return Witness(
            element=self.at.segment,
            t=self.at.t,
            point=self.point,
            feet=self.feet[chosen],
            feet_elements=self.segments[chosen],
            feet_params=self.params[chosen],
            multipliers=jnp.where(two, jnp.stack([share, 1 - share]), jnp.array([1.0, 0.0])),
            event=event,
            direction=DIRECTIONS.a_to_b,
        )


def describe(a: BezierSegments, b: BezierSegments, at: CurvePlace, foot: CurvePlace) -> Described:
    """Return the point (segment, t) of a with its local feet on b, from which a witness is chosen.

    A local foot counts if it solves its equation, or is held at an end.

    Args:
        a: the curve that carries the maximum.
        b: the curve that carries the feet.
        at: segment and parameter of the maximum on a.
        foot: its proven nearest point on b; it is used if the local feet miss it, as at a cusp.
    """
    here = jet(*piece_of(a, at.segment), at.t)
    segments, params, equations = _local_feet(here.point, b, foot)

    def measured(segment: Array, s: Array, found: FootEquation) -> tuple[Array, ...]:
        held = holds(found, piece_of(b, segment), s)
        uncertainty = jnp.where(held, 0.0, found.uncertainty)
        return found.apart, held, uncertainty, held | found.is_minimum

    apart, held, uncertainty, sound = jax.vmap(measured)(segments, params, equations)
    distances = jnp.sqrt(jnp.sum(apart**2, axis=-1))
    missed = ~jnp.any(sound[:-1] & (distances[:-1] <= distances[-1] + ZERO))
    sound = sound.at[-1].set(missed)
    around_ = around(a, preceding(a.next_segment), at)
    slopes = -apart @ around_.into.T / jnp.where(distances > 0, distances, 1.0)[:, None]
    distances = jnp.where(sound, distances, jnp.inf)
    return Described(
        at, around_, here.point, here.point + apart, segments, params, held, uncertainty, distances, slopes
    )


def _local_feet(point: Array, b: BezierSegments, foot: CurvePlace) -> tuple[Array, Array, FootEquation]:
    """Return local feet from several starts on each of the nearest segments, and, last, a known foot unchanged.

    Returns:
        Their segments and parameters, and the equation of each foot there.
    """
    segments = jnp.arange(b.count)
    if b.count > _SEARCHED:
        lower, _ = segment_bounds(point, b.control_points, b.weights)
        lower = jnp.where(repeated(b.control_points, b.weights), jnp.inf, lower)
        segments = jnp.sort(jax.lax.top_k(-lower.astype(jnp.float32), _SEARCHED)[1])
    starts = jnp.linspace(0.0, 1.0, _STARTS, dtype=b.control_points.dtype)
    starts = jnp.concatenate([jnp.tile(starts, segments.size), jnp.stack([foot.t, foot.t])])
    segments = jnp.concatenate([jnp.repeat(segments, _STARTS), jnp.stack([foot.segment, foot.segment])])

    def step(state: tuple[Array, FootEquation, Array, Array]) -> tuple[Array, FootEquation, Array, Array]:
        s, here, _, count = state
        new = jnp.where(jnp.arange(s.size) < s.size - 1, jax.vmap(step_in)(here, s), s)
        here = jax.vmap(lambda k, s: equation(point, piece_of(b, k), s))(segments, new)
        return new, here, jnp.max(jnp.abs(new - s)), count + 1

    def moves(state: tuple[Array, FootEquation, Array, Array]) -> Array:
        return (state[2] > _SETTLED) & (state[3] <= _NEWTON_STEPS) | (state[3] < 2)

    # The first step does not move, so that the compiled function evaluates the equation only once.
    zeros, rows = jnp.zeros_like(starts), jnp.zeros((starts.size, b.dim), starts.dtype)
    begin = starts, FootEquation(rows, rows, zeros, zeros + 1, zeros), zeros[0], jnp.array(0)
    params, equations, _, _ = jax.lax.while_loop(moves, step, varying(begin, point, b))
    return segments, params, equations
