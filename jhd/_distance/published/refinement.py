"""Refinement of one interval of a, in which the distance to b may have a maximum: the second step of the method.

The foot points of both ends are followed as branches. If the branches differ, bisection on the difference of their
distances finds the crossing, and Newton's method solves the three equations of a one-to-two event. On either side of
the crossing, or on the whole interval if the branches agree, bisection on (A - B).A' and Newton's method give an
antipodal event. The root finders come from optimistix and run on several intervals side by side.

Source: Cao, Dong and Cao, Computation of Hausdorff distance between planar curves, 2014, section 4.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array

from jhd._distance.nearest.feet import Branch, FootState, follow_foot
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import piece_of
from jhd._distance.witness.events import event_residual
from jhd._runtime.arrays import varying
from jhd._shapes.curve import BezierSegments

# Fraction of an interval at which bisection hands over to Newton's method.
COARSE = 2.0**-8
# Differences of squared distances below this count as zero: rounding leaves about 1e-15 in the common coordinates.
_EQUAL = 1e-14
_NEWTON = optx.Newton(rtol=1e-14, atol=1e-14)


class RefinedPair(NamedTuple):
    """Both curves, the preceding segment of each segment of b, and the segments that only repeat others."""

    a: BezierSegments
    b: BezierSegments
    before: Array
    skip_a: Array
    skip_b: Array


class Bracket(NamedTuple):
    """An interval of a segment of a, the feet of both ends, and the largest distance that is possible in it."""

    key: Array
    segment: Array
    t0: Array
    t1: Array
    k0: Array
    s0: Array
    k1: Array
    s1: Array


def candidates(pair: RefinedPair, lanes: Bracket) -> tuple[Array, Array]:
    """Return the refined parameters of the three candidates of each interval, and the distances of the followed feet.

    The candidates are the crossing of the two branches, and an antipodal event of each branch on its side of the
    crossing.
    """
    # A second, finer pass only if Newton's method failed for some candidate; a loop, so that it is compiled once.

    def refine(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        turn, t, ok = state
        # Fraction of an interval at which bisection ends if Newton's method fails.
        refined = _refined(pair, lanes, jnp.where(turn == 0, COARSE, 2.0**-44))
        polished, good = jax.vmap(_polished, in_axes=(None, 0, 0))(pair, lanes, refined)
        return turn + 1, jnp.where(ok, t, polished), ok | good

    shape = (lanes.t0.shape[0], 3)
    start = varying((jnp.array(0), jnp.zeros(shape, lanes.t0.dtype), jnp.zeros(shape, bool)), pair, lanes)
    _, t, _ = jax.lax.while_loop(lambda s: (s[0] == 0) | ((s[0] == 1) & ~jnp.all(s[2])), refine, start)
    return t, jax.vmap(_followed, in_axes=(None, 0, 0))(pair, lanes, t)


class _Refined(NamedTuple):
    """Bisected candidates of one interval: parameter, whether there is an event, and the feet of both branches."""

    t: Array
    wanted: Array
    x: FootState
    y: FootState


def _point(pair: RefinedPair, bracket: Bracket, t: Array) -> Array:
    return jet(*piece_of(pair.a, bracket.segment), t).point


@jax.jit
def _branch(pair: RefinedPair, bracket: Bracket, t: Array, from_right: Array) -> FootState:
    """Return the foot at t on the branch of the left or of the right end."""
    k, s = jnp.where(from_right, bracket.k1, bracket.k0), jnp.where(from_right, bracket.s1, bracket.s0)
    # Newton steps that follow a foot over an interval.
    return follow_foot(_point(pair, bracket, t), pair.b, pair.before, k, s, 6)


@jax.jit
def _lead(t: Array, args: tuple[RefinedPair, Bracket, Array]) -> Array:
    """Squared distance to the right end's branch minus the left end's, less a shift: falls at the crossing."""
    pair, bracket, shift = args
    feet = jax.vmap(lambda right: _branch(pair, bracket, t, right))(jnp.array([False, True])).point
    return (2 * _point(pair, bracket, t) - feet[0] - feet[1]) @ (feet[0] - feet[1]) - shift


@jax.jit
def _rise(t: Array, args: tuple[RefinedPair, Bracket, Array]) -> Array:
    """Return (A - B).A' on one branch: the sign of the slope of its distance."""
    pair, bracket, from_right = args
    here = jet(*piece_of(pair.a, bracket.segment), t)
    return (here.point - _branch(pair, bracket, t, from_right).point) @ here.first


def _refined(pair: RefinedPair, lanes: Bracket, width: Array) -> _Refined:
    """Bisect all intervals to a fraction `width` of each."""

    def crossing(bracket: Bracket) -> tuple[Array, Array]:
        both_ends, zero = jnp.stack([bracket.t0, bracket.t1]), jnp.zeros_like(bracket.t0)
        at0, at1 = jax.vmap(_lead, in_axes=(0, None))(both_ends, (pair, bracket, zero))
        # A branch that ends before the other end of the interval is followed onto the other branch, and does not lead
        # from there on; the crossing is before that.
        shift = jnp.where(at1 >= -_EQUAL, _EQUAL, jnp.where(at0 <= _EQUAL, -_EQUAL, zero))
        apart = (at0 > shift) & (at1 < shift)
        tau = _bisected(_lead, bracket.t0, bracket.t1, at0 - shift, at1 - shift, (pair, bracket, shift), width)
        return jnp.where(apart, tau, jnp.where(at1 < -_EQUAL, bracket.t0, bracket.t1)), apart

    tau, apart = jax.vmap(crossing)(lanes)

    def side(bracket: Bracket, tau: Array, from_right: Array) -> tuple[Array, Array]:
        args = (pair, bracket, from_right)
        low, high = jnp.where(from_right, tau, bracket.t0), jnp.where(from_right, bracket.t1, tau)
        at_low, at_high = jax.vmap(_rise, in_axes=(0, None))(jnp.stack([low, high]), args)
        found = (at_low > 0) & (at_high < 0)
        t = _bisected(_rise, low, high, at_low, at_high, args, width)
        # Without a change of sign the larger end of the side stands in.
        return jnp.where(found, t, jnp.where(at_low > 0, high, low)), found

    both = jnp.array([False, True])
    sides, found = jax.vmap(jax.vmap(side, in_axes=(None, None, 0)), in_axes=(0, 0, None))(lanes, tau, both)
    t = jnp.concatenate([tau[:, None], sides], axis=1)
    wanted = jnp.concatenate([apart[:, None], found], axis=1)

    def feet(bracket: Bracket, ts: Array, right: Array) -> FootState:
        return jax.vmap(lambda u: _branch(pair, bracket, u, right))(ts)

    at = jax.vmap(jax.vmap(feet, in_axes=(0, 0, None)), in_axes=(None, None, 0))(lanes, t, both)
    return _Refined(t, wanted, FootState(*(x[0] for x in at)), FootState(*(x[1] for x in at)))


def _bisected(
    residual: Callable, low: Array, high: Array, at_low: Array, at_high: Array, args: tuple, width: Array
) -> Array:
    """Return the parameter at which a residual falls from positive to negative, to a fraction `width` of the interval.

    The solver wants the interval and the residual below one tolerance, so both are scaled to order one.
    """
    scale = jnp.maximum(jnp.maximum(jnp.abs(at_low), jnp.abs(at_high)), jnp.finfo(low.dtype).tiny)
    solution = optx.root_find(
        partial(_scaled, residual),
        optx.Bisection(rtol=0.0, atol=width, flip=True),  # pyright: ignore[reportArgumentType]
        jnp.full_like(low, 0.5),
        (low, high, scale, args),
        options={"lower": jnp.zeros_like(low), "upper": jnp.ones_like(low)},
        max_steps=64,
        throw=False,
    )
    return low + jnp.clip(solution.value, 0.0, 1.0) * (high - low)


def _scaled(residual: Callable, share: Array, args: tuple) -> Array:
    low, high, scale, inner = args
    return residual(low + share * (high - low), inner) / scale


def _polished(pair: RefinedPair, bracket: Bracket, refined: _Refined) -> tuple[Array, Array]:
    """Run Newton's method from the bisected candidates; return parameters and whether each can be trusted."""
    piece = piece_of(pair.a, bracket.segment)

    def branch(foot: FootState) -> Branch:
        return Branch(piece_of(pair.b, foot.segment), foot.pinned, foot.s)

    def newton(t: Array, first: FootState, second: FootState, two: Array) -> tuple[Array, Array]:
        start = jnp.stack([t, first.s, second.s])
        args = (piece, branch(first), branch(second), two)
        options = {
            "lower": jnp.zeros_like(start).at[0].set(bracket.t0),
            "upper": jnp.ones_like(start).at[0].set(bracket.t1),
        }
        # Newton steps of a polish.
        solution = optx.root_find(event_residual, _NEWTON, start, args, options=options, max_steps=16, throw=False)
        left = jnp.max(jnp.abs(event_residual(solution.value, args)))
        # Residual of the equations, in the common coordinates, that a polished event leaves.
        return solution.value[0], jnp.isfinite(left) & (left <= 1e-13)

    # The crossing has both branches as feet; the antipodal candidates one, of the left and of the right end.
    turned = jnp.array([False, False, True])
    first = _chosen(turned, refined.y, refined.x)
    t, good = jax.vmap(newton)(refined.t, first, refined.y, jnp.array([True, False, False]))
    near = jnp.abs(t - refined.t) <= 4 * COARSE * (bracket.t1 - bracket.t0)
    use = refined.wanted & good & near
    return jnp.where(use, t, refined.t), use | ~refined.wanted


def _chosen(turned: Array, x: FootState, y: FootState) -> FootState:
    return FootState(*(jnp.where(turned.reshape(-1, *[1] * (u.ndim - 1)), u, v) for u, v in zip(x, y, strict=True)))


def _followed(pair: RefinedPair, bracket: Bracket, t: Array) -> Array:
    """Return the distance to the nearer of the two branches at each parameter."""

    def one(t: Array) -> Array:
        feet = jax.vmap(lambda right: _branch(pair, bracket, t, right))(jnp.array([False, True])).point
        return jnp.min(lengths(_point(pair, bracket, t) - feet))

    return jax.vmap(one)(t)


def lengths(vectors: Array) -> Array:
    """Return Euclidean lengths along the last axis."""
    return jnp.sqrt(jnp.sum(vectors * vectors, axis=-1))
