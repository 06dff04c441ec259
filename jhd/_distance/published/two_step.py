"""The two-step method: sample a, then refine the local maxima of the distance by root finding.

Step 1 samples every segment of a and finds the nearest point of b for each sample. An interval between two samples is
kept if the distance rises at its left and falls at its right end, if its ends have different foot points, or if it
touches a sample above both neighbors ("small-large-small").

Step 2 follows the foot points of both ends as branches. If the branches differ, bisection on the difference of their
distances finds the crossing, and Newton's method solves the three equations of a one-to-two event. On either side of
the crossing, or on the whole interval if the branches agree, bisection on (A - B).A' and Newton's method on two
equations give an antipodal event. Every candidate is then measured by the certified nearest point. If a third branch is
nearer than the two that were followed, the interval is cut there and both parts are refined again.

The method certifies a lower bound only: it can miss a maximum that lies between samples.

Source: Cao, Dong and Cao, Computation of Hausdorff distance between planar curves, 2014, sections 3 and 4.
"""

import math
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.nearest.curves import NearestOnCurve, nearest, repeated
from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.curves import evaluation_error
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.method import AbstractCurveMethod
from jhd._distance.normalization.pieces import CurvePlace, piece_of, preceding
from jhd._distance.normalization.stopping import Aim
from jhd._distance.published.literal_steps import published_candidates
from jhd._distance.published.refinement import COARSE, Bracket, RefinedPair, candidates, lengths
from jhd._distance.witness.events import describe
from jhd._results.solution import RESULTS, HausdorffSolution
from jhd._runtime.arrays import check_whole, in_chunks, varying
from jhd._shapes.curve import BezierSegments


class TwoStep(AbstractCurveMethod):
    """Hausdorff distance of curves by sampling and root finding: fast, but without a certified upper bound.

    The error is about 1e-12 of the size, unless a maximum is narrower than the spacing of the samples.

    Changes to the source, Cao, Dong and Cao, Computation of Hausdorff distance between planar curves, 2014:

     - The nearest point of a sample comes from a certified best-first search, not from the projected polyhedron.
     - An interval is also kept if the slopes at its ends, or its foot points, require it. The source keeps
       "small-large-small" only.
     - No constant separates the kinds of events: every interval is searched for both. The source compares |Q1 Q2| or
       |s1 - s2| with a constant to choose between equations (14) and (15).
     - Bisection ends at 2^-8 of the interval and Newton's method goes on. The source bisects to 1e-10.
     - Branches are followed by continuation. In (15) the source ranks foot points by their distances, which fails if a
       third branch comes between.
     - Corners of both curves and foot points at ends are events. At an end of b the distance is a maximum along a; the
       source takes the nearest point of a, which is a minimum.

    `variant="paper"` leaves these changes out (`literal_steps`), except for foot points at ends of segments of b, which
    are no roots. Its result is RESULTS.not_certified: a maximum can be missed, and if b is open the value can be too
    large.

    `stats["samples"]` counts the samples. Ends of segments that meet are one sample; padding is not counted.

    Use it as `jhd.directed_hausdorff(a, b, jhd.published.TwoStep())`.

    Args:
        samples: number of intervals between samples; more samples find narrower maxima. By default 512 in all, with 6
            to 128 for each segment; with variant="paper" 90 in all.
        spacing: "uniform" in the parameter, or "curvature": denser if the tangent turns faster.
        max_rounds: largest number of rounds of refinement, eight intervals each, largest possible distance first.
        per: whether `samples` counts the intervals of each "segment", or of the whole "curve" as in the source. With
            "curve" the ends of segments are samples too. variant="paper" always counts the whole curve.
        variant: "ours" or "paper", as above.
    """

    samples: int | None = eqx.field(static=True, default=None)
    spacing: Literal["uniform", "curvature"] = eqx.field(static=True, default="uniform")
    max_rounds: int = eqx.field(static=True, default=16)
    per: Literal["segment", "curve"] = eqx.field(static=True, default="segment")
    variant: Literal["ours", "paper"] = eqx.field(static=True, default="ours")

    def __check_init__(self) -> None:
        if self.samples is not None:
            check_whole("samples", self.samples, 1)
        check_whole("max_rounds", self.max_rounds, 0)
        choices = ("spacing", ("uniform", "curvature")), ("per", ("segment", "curve")), ("variant", ("ours", "paper"))
        for name, allowed in choices:
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} is {getattr(self, name)!r}; needs {' or '.join(map(repr, allowed))}.")
        whole = self.per == "curve" or self.variant == "paper"
        if whole and self.spacing == "curvature":
            raise ValueError("spacing is 'curvature'; per='curve' and variant='paper' need 'uniform'.")
        if self.per == "curve" and self.samples is None:
            raise ValueError("samples is None; per='curve' needs a whole number of at least 1.")

    def _directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """The distance from `a` to `b` in common coordinates; called by `jhd.directed_hausdorff`."""
        skip = (repeated(curve.control_points, curve.weights) for curve in (a, b))
        pair = RefinedPair(a, b, preceding(b.next_segment), *skip)
        if self.variant == "paper":
            # Samples of the whole curve with variant="paper": the number in the source's example 2.
            return _as_published(pair, self.samples or 90)
        samples = _sampled(pair, self._places(a, pair.skip_a))
        brackets = _brackets(samples)
        best = _best_sample(samples)
        state = jax.lax.while_loop(
            lambda s: (jnp.max(s.brackets.key) > s.best.distance) & (s.rounds < self.max_rounds),
            lambda s: _round(pair, s),
            varying(_Refining(brackets, best, jnp.array(0), jnp.array(0)), a, b),
        )
        best = state.best
        witness = describe(a, b, best.place, best.foot).witness()
        lower = jnp.maximum(best.lower - evaluation_error(a, b), 0.0)
        stats = {
            "samples": _number(pair, samples),
            "intervals": jnp.sum(jnp.isfinite(brackets.key)),
            "rounds": state.rounds,
            "cuts": state.cuts,
        }
        value = jnp.maximum(best.distance, lower)
        return HausdorffSolution(value, lower, jnp.full_like(lower, jnp.inf), witness, RESULTS.successful, stats)

    def _places(self, a: BezierSegments, skip: Array) -> CurvePlace:
        """Return all samples, in the order of segments and parameters; ends of segments that meet are there twice."""
        if self.per == "curve" and self.samples is not None:
            return _over_all(a.count, skip, self.samples)
        t = self._parameters(a)
        return CurvePlace(jnp.repeat(jnp.arange(a.count), t.shape[1]), t.ravel())

    def _parameters(self, a: BezierSegments) -> Array:
        """Return the sample parameters, (segments, samples + 1), from 0 to 1."""
        # Samples of the whole curve if their number is left open: shared among the segments, within these limits for
        # each.
        count = self.samples or min(max(math.ceil(512 / a.count), 6), 128)
        uniform = jnp.linspace(0.0, 1.0, count + 1)
        if self.spacing == "uniform" or a.degree < 2:
            return jnp.broadcast_to(uniform, (a.count, count + 1))
        return jax.vmap(lambda k: _by_curvature(a, k, count))(jnp.arange(a.count))


class _CurveSamples(NamedTuple):
    """Feet and distances of the samples of a, in the order of segments and parameters."""

    segment: Array
    t: Array
    distance: Array
    lower: Array
    foot_segment: Array
    foot_s: Array
    slope: Array
    point: Array
    foot: Array


class _BestSample(NamedTuple):
    distance: Array
    lower: Array
    place: CurvePlace
    foot: CurvePlace


class _Refining(NamedTuple):
    brackets: Bracket
    best: _BestSample
    rounds: Array
    cuts: Array


def _by_curvature(a: BezierSegments, segment: Array, count: int) -> Array:
    """Return parameters between which the curve advances and turns by equal amounts: half arc length, half angle."""
    t = jnp.linspace(0.0, 1.0, 8 * count + 1)
    tangents = jax.vmap(lambda t: jet(*piece_of(a, segment), t).first)(t)
    speed = jnp.sqrt(jnp.sum(tangents**2, axis=-1))
    unit = tangents / jnp.where(speed > 0, speed, 1.0)[:, None]
    turn = jnp.sqrt(jnp.sum((unit[1:] - unit[:-1]) ** 2, axis=-1))
    length = 0.5 * (speed[1:] + speed[:-1])
    # The turn of a curve that turns by less than a radian in all is not normalized: angles of a straight line are
    # rounding.
    share = _normalized(length) + turn / jnp.maximum(jnp.sum(turn), 1.0)
    # A small uniform part keeps the parameters apart if the curve neither moves nor turns.
    grown = jnp.concatenate([jnp.zeros(1), jnp.cumsum(share + 0.1 / t.size)])
    inner = jnp.interp(jnp.linspace(0.0, 1.0, count + 1), grown / grown[-1], t)
    return inner.at[0].set(0.0).at[-1].set(1.0)


def _normalized(x: Array) -> Array:
    total = jnp.sum(x)
    return x / jnp.where(total > 0, total, 1.0)


def _nearest_all(pair: RefinedPair, points: Array, skip: Array) -> NearestOnCurve:
    """Return proven nearest points for rows of points, in chunks; rows to skip get bounds that are true and wide."""
    b = pair.b

    def search(query: tuple[Array, Array]) -> NearestOnCurve:
        point, tolerance = query
        return nearest(point, b.control_points, b.weights, tolerance, pair.skip_b)

    # Samples searched side by side: more wait for the slowest of them, fewer do not fill the vector units.
    return in_chunks(search, (points, jnp.where(skip, jnp.inf, 0.0)), 128)


def _over_all(count: int, skip: Array, samples: int) -> CurvePlace:
    """Return equal steps of the parameter of all segments that repeat no other, and both ends of each."""
    kept = jnp.sum(~skip)
    g = jnp.arange(1, samples) * kept / samples
    index = jnp.minimum(jnp.floor(g).astype(int), kept - 1)
    segment, ends = jnp.argsort(skip, stable=True)[index], jnp.tile(jnp.arange(count), 2)
    segment = jnp.concatenate([segment, ends])
    t = jnp.concatenate([jnp.clip(g - index, 0.0, 1.0), jnp.repeat(jnp.array([0.0, 1.0]), count)])
    order = jnp.lexsort((t, segment))
    return CurvePlace(segment[order], t[order])


def _number(pair: RefinedPair, samples: _CurveSamples) -> Array:
    """Return the number of samples, without samples of repeated segments; samples at a joint count once."""
    again = (samples.segment[1:] == samples.segment[:-1]) & (samples.t[1:] == samples.t[:-1])
    kept = ~pair.skip_a[samples.segment] & ~jnp.pad(again, (1, 0))
    return jnp.sum(kept) - jnp.sum(~pair.skip_a & (pair.a.next_segment >= 0))


def _sampled(pair: RefinedPair, at: CurvePlace) -> _CurveSamples:
    a, b = pair.a, pair.b
    jets = jax.vmap(lambda k, u: jet(*piece_of(a, k), u))(at.segment, at.t)
    skip = pair.skip_a[at.segment]
    found = _nearest_all(pair, jets.point, skip)
    foot = jax.vmap(lambda k, s: jet(*piece_of(b, k), s).point)(found.segment, found.t)
    slope = jnp.sum((jets.point - foot) * jets.first, axis=-1)
    distance = jnp.where(skip, -jnp.inf, found.distance)
    return _CurveSamples(*at, distance, found.lower, found.segment, found.t, slope, jets.point, foot)


def _best_sample(samples: _CurveSamples) -> _BestSample:
    k = jnp.argmax(samples.distance)
    place, foot = (samples.segment[k], samples.t[k]), (samples.foot_segment[k], samples.foot_s[k])
    return _BestSample(samples.distance[k], samples.lower[k], CurvePlace(*place), CurvePlace(*foot))


def _brackets(samples: _CurveSamples) -> Bracket:
    """Return intervals between samples that may hold a local maximum, followed by free entries."""
    d, left, right = samples.distance, slice(None, -1), slice(1, None)
    chord = lengths(samples.point[right] - samples.point[left])
    feet_apart = lengths(samples.foot[right] - samples.foot[left])
    rises_and_falls = (samples.slope[left] > 0) & (samples.slope[right] < 0)
    joined = samples.segment[left] == samples.segment[right]
    before, after = jnp.roll(d, 1), jnp.roll(d, -1)
    peak = (d > before) & (d >= after) | (d >= before) & (d > after)
    peak = peak | jnp.pad(~joined, (1, 0), constant_values=True) | jnp.pad(~joined, (0, 1), constant_values=True)
    # Feet of one branch move about as fast as the samples, unless a center of curvature of b is near.
    wanted = rises_and_falls | (feet_apart > 4 * chord) | peak[left] | peak[right]
    wanted = wanted & joined & (samples.t[left] < samples.t[right])
    # Arc length of an interval in units of its chord, for ranking only.
    key = jnp.where(wanted, 0.5 * (d[left] + d[right] + 1.25 * chord), -jnp.inf)
    grids = (samples.t, samples.foot_segment, samples.foot_s)
    ends = [x[part] for x in grids for part in (left, right)]
    fields = (key, samples.segment[left], ends[0], ends[1], ends[2], ends[4], ends[3], ends[5])
    fill = (-jnp.inf, 0, 0.0, 0.0, 0, 0.0, 0, 0.0)
    # Free entries for the halves of intervals that a third branch cuts.
    return Bracket(*(jnp.pad(x, (0, 32), constant_values=v) for x, v in zip(fields, fill, strict=True)))


def _as_published(pair: RefinedPair, samples: int) -> HausdorffSolution:
    """Return the largest of the published candidates, and the proven bound at their points on a."""
    found = published_candidates(pair, samples)
    points = jax.vmap(lambda k, u: jet(*piece_of(pair.a, k), u).point)(*found.place)
    proven = _nearest_all(pair, points, found.distance == -jnp.inf)
    k = jnp.argmax(found.distance)
    place, foot = CurvePlace(*(x[k] for x in found.place)), CurvePlace(proven.segment[k], proven.t[k])
    witness = describe(pair.a, pair.b, place, foot).witness()
    lower = jnp.maximum(jnp.max(proven.lower) - evaluation_error(pair.a, pair.b), 0.0)
    value = jnp.maximum(found.distance[k], lower)
    stats = {"samples": found.samples, "peaks": found.peaks}
    return HausdorffSolution(value, lower, jnp.full_like(lower, jnp.inf), witness, RESULTS.not_certified, stats)


def _round(pair: RefinedPair, state: _Refining) -> _Refining:
    """Refine the intervals with the largest keys and take the best of their candidates."""
    brackets, best = state.brackets, state.best
    # Intervals refined together; most pairs need one or two rounds of this size.
    keys, index = jax.lax.top_k(brackets.key, 8)
    lanes = Bracket(*(x[index] for x in brackets))
    live = keys > best.distance
    t, tracked = candidates(pair, lanes)
    points = jax.vmap(lambda k, ts: jax.vmap(lambda u: jet(*piece_of(pair.a, k), u).point)(ts))(lanes.segment, t)
    found = _nearest_all(pair, points.reshape(-1, pair.a.dim), jnp.repeat(~live, t.shape[1]))
    found = jax.tree_util.tree_map(lambda x: x.reshape(t.shape), found)
    distance = jnp.where(live[:, None], found.distance, -jnp.inf)
    at = jnp.argmax(distance)
    lane = at // t.shape[1]
    foot = CurvePlace(found.segment.ravel()[at], found.t.ravel()[at])
    top = _BestSample(
        distance.ravel()[at], found.lower.ravel()[at], CurvePlace(lanes.segment[lane], t.ravel()[at]), foot
    )
    better = top.distance > best.distance
    best = jax.tree_util.tree_map(lambda new, old: jnp.where(better, new, old), top, best)
    brackets = brackets._replace(key=brackets.key.at[index].set(-jnp.inf))
    halves, cut = _halves(lanes, t, tracked, found)
    halves = halves._replace(key=jnp.where(jnp.tile(live & cut, 2), halves.key, -jnp.inf))
    return _Refining(_stored(brackets, halves), best, state.rounds + 1, state.cuts + jnp.sum(live & cut))


def _stored(brackets: Bracket, new: Bracket) -> Bracket:
    """Replace the intervals with the smallest keys by new ones, unless their keys are larger."""
    _, worst = jax.lax.top_k(-brackets.key, new.key.shape[0])
    take = new.key > brackets.key[worst]
    return Bracket(*(old.at[worst].set(jnp.where(take, x, old[worst])) for old, x in zip(brackets, new, strict=True)))


def _halves(lanes: Bracket, t: Array, tracked: Array, found: NearestOnCurve) -> tuple[Bracket, Array]:
    """Return the two parts of each interval at its best candidate, wanted if an unfollowed branch is nearer there."""
    which = jnp.argmax(tracked, axis=1)
    pick = lambda x: jnp.take_along_axis(x, which[:, None], axis=1)[:, 0]  # noqa: E731
    cut_at, true, followed = pick(t), pick(found.distance), pick(tracked)
    k, s = pick(found.segment), pick(found.t)
    width = lanes.t1 - lanes.t0
    inside = (cut_at > lanes.t0 + COARSE * width) & (cut_at < lanes.t1 - COARSE * width)
    cut = (followed > true + 1e-13) & inside & (width > COARSE**4)
    left = lanes._replace(t1=cut_at, k1=k, s1=s)
    right = lanes._replace(t0=cut_at, k0=k, s0=s)
    both = Bracket(*(jnp.concatenate([x, y]) for x, y in zip(left, right, strict=True)))
    # The followed distance bounds the parts, in addition to their keys.
    return both._replace(key=jnp.tile(jnp.minimum(lanes.key, followed), 2)), cut
