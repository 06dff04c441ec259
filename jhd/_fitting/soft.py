"""A smooth upper bound of the Hausdorff distance of two curves, differentiable in all of their control points.

S = H + tau log(1 + K M), where H is the certified upper bound of the distance, tau the temperature, and M the mean of
exp((min(d, H) - H) / tau) over samples of both curves with distances d to the opposite curve. Each curve contributes
half of M. Each term of M lies in [0, 1], so

    H <= S <= H + tau log(1 + K)

for all samples and all feet: only the hard distance needs a proof. The gradient of S is a mean of the gradients of H
and of all d, with weights that fall by a factor e for each tau that d lies below H. It tends to the gradient of H as
tau goes to zero. If tau is at least the spacing of the samples, S is smooth even if the farthest point jumps. First
derivatives are exact; second derivatives ignore how the feet move.

Samples lie at fixed parameters and are weighted by the local length of the curve, so a reparametrization changes
little. Their feet are found by Newton's method from near the nearest samples of the opposite curve.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic.scaling import length
from jhd._distance.hausdorff import hausdorff
from jhd._distance.nearest.blocks import is_long
from jhd._distance.nearest.curves import repeated
from jhd._distance.nearest.feet import follow_foot
from jhd._distance.nearest.near_curve import near_curve
from jhd._distance.normalization.coordinates import Frame, extremes, frame_of
from jhd._distance.normalization.curves import padded_count, replaced, usable
from jhd._distance.normalization.custom_derivatives import carrying
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.method import AbstractHausdorffMethod, check_serves
from jhd._distance.normalization.pieces import CurvePlace, piece_of, preceding
from jhd._distance.search.branch_and_bound import BranchAndBound, chosen_method
from jhd._runtime.arrays import check_scalar, real_array, undifferentiated
from jhd._runtime.compiled import compiled
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.checks import Numbers
from jhd._shapes.curve import BezierSegments, check_curve
from jhd._shapes.unchecked import trusted

# Weight of all samples relative to the farthest point: a larger weight makes S smoother and larger.
WEIGHT = 63
# Samples of one curve, divided among its segments, and most samples of a segment; each has at least one.
SAMPLES, MOST = 1024, 256
# Newton steps that lead from a sample to a foot, one of them lost at each joint that is crossed: in the last one a
# hundredth of the feet still moves, by more than this fraction of a segment.
_FOLLOW, _STILL = 5, 2.0**-26
# Further steps for feet that still move, and feet in one batch: a step of all feet costs sixteen times as much.
_FURTHER, _SIDE_BY_SIDE = 8, 64


class SoftSamples(NamedTuple):
    """Points of a curve at fixed parameters, and their weights, which sum to one."""

    points: Array
    weight: Array


def soft_hausdorff(
    a: ShapeLike,
    b: ShapeLike,
    temperature: Numbers,
    method: AbstractHausdorffMethod | None = None,
    *,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    throw: bool = True,
) -> Array:
    """Smooth upper bound S of the Hausdorff distance H of two curves: a loss with dense gradients.

    S satisfies H <= S <= H + temperature * log(64), for the certified upper bound H of the distance. S is a log-sum-exp
    of H and the distances at about a thousand samples of each curve, at most 256 per segment. Its gradient therefore
    moves all control points whose distance is within a few temperatures of the maximum; the gradient of `hausdorff`
    acts at one point only.

    Start with a temperature of a third of the distance and lower it, so that S tends to H. The cost is one `hausdorff`
    and the feet of the samples. Works under jit, vmap and grad, for first derivatives.

    >>> import jhd
    >>> a, b = jhd.polyline([(0, 0), (1, 0)]), jhd.polyline([(0, 1), (1, 1)])
    >>> [round(float(jhd.soft_hausdorff(a, b, temperature)), 4) for temperature in (0.1, 0.01)]
    [1.4159, 1.0416]

    Args:
        a: curve or point set, or an object that jhd.as_shape converts to one.
        b: curve or point set of the same dimension as `a`.
        temperature: positive length, in the unit of the coordinates.
        method: BranchAndBound with the sizes of the search for H. None selects BranchAndBound().
        rtol: tolerance of H, relative to its upper bound; see `hausdorff`. S grows by the gap of the bounds of H.
        atol: absolute tolerance of H, in the unit of the coordinates; see `hausdorff`.
        throw: whether to raise NotProvenError if the bounds of H do not close; by default True. S is an upper bound of
            the distance in any case.

    Returns:
        The bound S, a scalar in the unit of the coordinates.

    Raises:
        TypeError: a shape is no curve, or the method is not BranchAndBound.
        ValueError: the dimensions differ, or the temperature is not a positive length.
        NotProvenError: the bounds of H do not close, and `throw` is True (not under jit or vmap).
    """
    first, second = taken_as("a", a), taken_as("b", b)
    check_curve("a", first)
    check_curve("b", second)
    heat = real_array("temperature", temperature)
    check_scalar("temperature", heat, positive=True)
    method = chosen_method(method, rtol, atol)
    check_serves(method, first, second, (BranchAndBound,))
    p, q = first.segments(), second.segments()
    found = hausdorff(p, q, method, throw=throw)
    hard = carrying(found.upper, found.value)
    known = undifferentiated((p, q))
    good = usable(known[0]) & usable(known[1])
    frame = frame_of([extremes(replaced(curve, good).control_points) for curve in known], good)
    pair = (replaced(curve.pad(padded_count(curve.count, small=True)), good) for curve in (p, q))
    return _softened(*pair, hard, heat, frame)


@compiled
def _softened(a: BezierSegments, b: BezierSegments, hard: Array, heat: Array, frame: Frame) -> Array:
    """S, from the bound and the temperature in the user's unit."""
    scale = frame.scale(hard.dtype)
    known = jnp.isfinite(hard)
    top = jnp.where(known, hard, 0.0)
    a, b = (trusted(frame.moved(curve.control_points), curve.weights, curve.next_segment) for curve in (a, b))
    long = is_long(a) or is_long(b)
    means = [_mean(sampled(x), y, long, top * scale, heat * scale) for x, y in ((a, b), (b, a))]
    # The exact mean is at most one; with rounded weights it may be larger.
    share = jnp.minimum(0.5 * (means[0] + means[1]), 1.0)
    return jnp.where(known, top + heat * jnp.log1p(WEIGHT * share), hard)


def _mean(of: SoftSamples, b: BezierSegments, long: bool, top: Array, heat: Array) -> Array:
    """The mean of exp((min(d, top) - top) / heat) over samples with distances d; in common coordinates."""
    distance = jnp.minimum(_distances(of, b, long), top)
    # A temperature below this fraction of the size softens less than rounding.
    return jnp.sum(of.weight * jnp.exp((distance - top) / jnp.maximum(heat, 1e-15)))


def sampled(curve: BezierSegments) -> SoftSamples:
    """Samples in the middles of equal steps of each segment's parameter, weighted by the local length."""
    steps = min(math.ceil(SAMPLES / curve.count), MOST)
    t = (jnp.arange(steps, dtype=curve.control_points.dtype) + 0.5) / steps
    each = jax.vmap(lambda k: jax.vmap(lambda u: jet(*piece_of(curve, k), u))(t))(jnp.arange(curve.count))
    # Points have no length: all count equally.
    speed = length(each.first) if curve.degree else jnp.ones(each.point.shape[:-1], t.dtype)
    own = ~repeated(curve.control_points, curve.weights)[:, None]
    speed = jnp.where(own, speed, 0.0)
    total = jnp.sum(speed)
    # A curve that is one point.
    weight = jnp.where(total > 0, speed / jnp.where(total > 0, total, 1.0), own / (steps * jnp.sum(own)))
    return SoftSamples(each.point.reshape(-1, curve.dim), weight.ravel())


def _distances(of: SoftSamples, b: BezierSegments, long: bool) -> Array:
    """Distances to the feet on b, which are constants: the distance is stationary in their parameters, or they stay."""
    points, known = jax.lax.stop_gradient((of.points, b))
    # Samples of the opposite curve, divided among its segments; the nearest starts the search of a foot. On four random
    # cubics seven feet in a thousand are not the nearest; with four samples of each segment it was a fifth of all feet.
    before, starts = preceding(known.next_segment), near_curve(known, long, 256 // b.count).starts(points)

    def foot(point: Array, start: CurvePlace, steps: int) -> CurvePlace:
        found = follow_foot(point, known, before, *start, steps)
        return CurvePlace(found.segment, found.s)

    def nearer(point: Array, foot: CurvePlace, start: CurvePlace) -> CurvePlace:
        first, last = (jet(*piece_of(known, x.segment), x.t).point for x in (start, foot))
        better = jnp.sum((last - point) ** 2) <= jnp.sum((first - point) ** 2)
        return CurvePlace(*(jnp.where(better, *pair) for pair in zip(foot, start, strict=True)))

    feet = _followed(foot, points, starts)
    feet = jax.vmap(nearer)(points, feet, starts)
    return length(of.points - jax.vmap(lambda k, s: jet(*piece_of(b, k), s).point)(*feet))


def _followed(foot: Callable[..., CurvePlace], points: Array, starts: CurvePlace) -> CurvePlace:
    """The feet of points: a few steps for all, more for the few that still move."""
    early = jax.vmap(partial(foot, steps=_FOLLOW - 1))(points, starts)
    feet = jax.vmap(partial(foot, steps=1))(points, early)
    moves = (feet.segment != early.segment) | (jnp.abs(feet.t - early.t) > _STILL)
    count = min(_SIDE_BY_SIDE, points.shape[0])

    def further(state: tuple[CurvePlace, Array]) -> tuple[CurvePlace, Array]:
        feet, moves = state
        _, rows = jax.lax.top_k(moves.astype(jnp.float32), count)
        moved = jax.vmap(partial(foot, steps=_FURTHER))(points[rows], CurvePlace(feet.segment[rows], feet.t[rows]))
        feet = CurvePlace(*(x.at[rows].set(y) for x, y in zip(feet, moved, strict=True)))
        return feet, moves.at[rows].set(False)

    return jax.lax.while_loop(lambda state: jnp.any(state[1]), further, (feet, moves))[0]
