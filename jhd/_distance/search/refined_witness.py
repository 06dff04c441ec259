"""The witness of a maximum along a curve, refined from the farthest point of a search.

The search closes its bounds at a point whose distance is the maximum up to the tolerance, so the point itself is off by
the root of the tolerance. Newton's method on the equations of the event (jhd._distance.witness.active) refines it. The
feet that count can change on the way: near a cusp of the evolute of b, a second foot exists only near the tie.

Source: the events are those of Elber & Grandine, GMP 2008; Newton's method from points at which linear models of the
distance agree is ours.
"""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.nearest.near_curve import NearCurve
from jhd._distance.normalization.curves import evaluation_error
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of
from jhd._distance.witness import active
from jhd._distance.witness.events import OPEN, ZERO, describe
from jhd._results.solution import DIRECTIONS, EVENTS, Witness
from jhd._runtime.arrays import varying
from jhd._shapes.curve import BezierSegments

# Rounding of a distance, and of a distance to a refined foot, in units of roundoff of the common coordinates.
_NOISE, _AGREEING = 4, 64
# Attempts to refine a maximum: from the point found, from the point reached, from points between, and only with the
# feet of the point found; and the number of attempts before points on both sides of the maximum are needed.
_TRIALS, _LED = 12, 2


class SearchedPlace(NamedTuple):
    """The result of a search: the farthest point of a found, its foot on b, its distance, and both bounds."""

    at: CurvePlace
    foot: CurvePlace
    value: Array
    lower: Array
    upper: Array

    @property
    def gap(self) -> Array:
        """The difference of the bounds."""
        return self.upper - self.lower


class RefinedWitness(NamedTuple):
    """A witness with value and lower bound, whether it solves its equations, and the point reached, with its foot."""

    witness: Witness
    value: Array
    lower: Array
    solved: Array
    at: CurvePlace
    foot: CurvePlace


class _RefinementTrial(NamedTuple):
    """Attempts to refine a maximum: their number, the last one, the next start, and a point on each side."""

    count: Array
    found: RefinedWitness
    at: CurvePlace
    foot: CurvePlace
    sides: tuple[CurvePlace, CurvePlace]  # points of a with rising and falling distance, and the foot of each


def refined(a: BezierSegments, near: NearCurve, state: SearchedPlace) -> RefinedWitness:
    """Return the witness of a search, with value and lower bound.

    First with the feet that count wherever the maximum may be, then with the feet of the point reached, then from
    points between two with rising and falling distance: near a cusp of the evolute both feet exist only near the tie.
    If no such maximum is found, the feet that are equally near at the last point of the search count.
    """

    def again(tried: _RefinementTrial) -> Array:
        return (tried.count < _TRIALS) & ~tried.found.solved

    def next_(tried: _RefinementTrial) -> _RefinementTrial:
        last = tried.count == _TRIALS - 1
        at, foot = state.at.if_(last, tried.at), state.foot.if_(last, tried.foot)
        here = describe(a, near.curve, at, foot)
        reach = jnp.where(last, 0.0, here.reach(state.gap))
        found = _polished(a, near, here.witness(reach), state)
        more = (tried.sides[0], at, found.at), (tried.sides[1], here.nearest, found.foot)
        places, feet = (
            jax.tree_util.tree_map(lambda x, *y: jnp.concatenate([x, jnp.stack(y)]), *parts) for parts in more
        )
        sides, between, apart = _between(a, near.curve, places, feet, state.gap)
        at = found.at._replace(t=jnp.where(tried.count > 0, between, found.at.t))
        # An end or corner stays the maximum, whatever rounding leaves of its feet.
        held = here.around.end | here.around.corner
        count = jnp.where(last | ~held & (apart | (tried.count < _LED)), tried.count + 1, _TRIALS - 1)
        return _RefinementTrial(count, found, at, found.foot, sides)

    (segment, t), (k, s) = state.at, state.foot
    feet, one = jnp.zeros((2, a.dim), t.dtype), jnp.array([1.0, 0.0], t.dtype)
    feet_at, event, direction = (jnp.stack([k, k]), jnp.stack([s, s])), EVENTS.antipodal, DIRECTIONS.a_to_b
    witness = Witness(segment, t, feet[0], feet, *feet_at, one, event, direction)
    untried = RefinedWitness(witness, t, t, jnp.array(False), state.at, state.foot)
    sides = jax.tree_util.tree_map(lambda x: jnp.stack([x, x]), (state.at, state.foot))
    start = _RefinementTrial(jnp.array(0), untried, state.at, state.foot, sides)
    return jax.lax.while_loop(again, next_, varying(start, a, near, state)).found


def _between(
    a: BezierSegments, b: BezierSegments, at: CurvePlace, feet: CurvePlace, gap: Array
) -> tuple[tuple, Array, Array]:
    """Return the last point with rising and the first with falling distance, and a parameter between them.

    At this parameter the linear models of the distance at both points agree, or it is the middle. If there is only one
    point, the parameter is about as far as the maximum can be if the distance rises by the gap. The last result tells
    whether there are two points.
    """

    def model(at: CurvePlace, foot: CurvePlace) -> tuple[Array, Array]:
        here = jet(*piece_of(a, at.segment), at.t)
        apart = here.point - jet(*piece_of(b, foot.segment), foot.t).point
        distance = jnp.sqrt(jnp.sum(apart**2))
        return distance, jnp.sum(apart * here.first) / jnp.where(distance > 0, distance, 1.0)

    distance, slope = jax.vmap(model)(at, feet)
    falls = jnp.where(slope < 0, at.t, jnp.inf)
    # A point beyond the first falling one is on another hump.
    rises = jnp.where((slope > 0) & (at.t < jnp.min(falls)), at.t, -jnp.inf)
    chosen = jnp.stack([jnp.argmax(rises), jnp.argmin(falls)])
    sides = jax.tree_util.tree_map(lambda x: x[chosen], (at, feet))
    (rise, fall), (low, high), (start, end) = slope[chosen], distance[chosen], at.t[chosen]
    apart = (rise > 0) & (fall < 0)
    t = start + (high - low + fall * (start - end)) / jnp.where(apart, rise - fall, 1.0)
    t = jnp.where((t > start) & (t < end), t, 0.5 * (start + end))
    steep = jnp.where(rise > 0, rise, jnp.minimum(fall, -ZERO))
    beyond = jnp.clip(jnp.where(rise > 0, start, end) + OPEN * gap / steep, 0.0, 1.0)
    return sides, jnp.where(apart, t, beyond), apart


def _polished(a: BezierSegments, near: NearCurve, witness: Witness, state: SearchedPlace) -> RefinedWitness:
    """Return the witness at the solution of its equations: peaks are off by the root of the gap.

    It is accepted only if the point is measured to be as far, its feet to be its nearest points, and two feet balance.
    """
    b, k, (k1, k2) = near.curve, witness.element, witness.feet_elements
    y = jnp.concatenate([witness.t[None], witness.feet_params])
    pieces = piece_of(a, k), piece_of(b, k1), piece_of(b, k2)
    system = active.active(*pieces, y, witness.event, witness.multipliers)
    y = active.polished(y, system)
    y = y.at[2].set(jnp.where(system.two, y[2], y[1]))
    point, feet = active.places(y, system.pieces)
    found = near.nearest(point)
    # At a flat foot the error of the proven foot exceeds the difference of the distances.
    distances = jnp.append(jnp.sqrt(jnp.sum((feet - point) ** 2, axis=1)), found.distance)
    off = jnp.max(distances[:2]) - jnp.min(distances)
    eps = float(jnp.finfo(point.dtype).eps)
    better = (found.distance >= state.value - _NOISE * eps) & (off <= _AGREEING * eps)
    multipliers, _ = active.balance(y, system, witness.multipliers)
    better = better & (~system.two | jnp.all(multipliers > 0))
    new = replace(witness, t=y[0], point=point, feet=feet, feet_params=y[1:], multipliers=multipliers)
    witness = jax.tree_util.tree_map(lambda x, y: jnp.where(better, x, y), new, witness)
    lower = jnp.where(better, jnp.maximum(state.lower, found.lower - evaluation_error(a, b)), state.lower)
    value = jnp.where(better, jnp.maximum(found.distance, state.value), state.value)
    return RefinedWitness(witness, value, lower, better, CurvePlace(k, y[0]), CurvePlace(found.segment, found.t))
