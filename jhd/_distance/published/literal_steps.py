"""The two steps of Cao et al. 2014 as they are printed, for comparison; each shape is taken as one curve.

 1. Samples lie at equal steps of the parameter of a. The distance of each is its distance to the nearest stationary
    point of b, all of which the projected polyhedron finds, or to an end of a segment of b.
 2. The farthest samples that are "small-large-small" are refined. Let P1 and P2 be the samples before and after one,
    Q1 and Q2 their feet. If |Q1 Q2| is small, the maximum is taken for antipodal and bisection solves (14), else it is
    taken for one-to-two and bisection solves (15).
 3. If a is open, its ends are candidates with their distances to b; if b is open, its ends with theirs to a.

The last rule is false: the distance from an end of b to a can exceed the distance from a to b. The source does not say
how many samples are refined, and which |Q1 Q2| is small; the constants below fix both.

Source: Cao, Dong and Cao, Computation of Hausdorff distance between planar curves, 2014, sections 2 and 3.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.nearest.stationarity import roots_on
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of
from jhd._distance.published.refinement import RefinedPair, lengths
from jhd._runtime.arrays import in_chunks
from jhd._shapes.curve import BezierSegments

# Samples searched side by side.
_CHUNK = 32


class PublishedCandidates(NamedTuple):
    """Candidates for the maximum by the published rules, with the distances that they give; -inf for invalid ones."""

    place: CurvePlace  # points on a
    distance: Array  # to the foot, in the common coordinates
    samples: Array  # number of samples
    peaks: Array  # number of samples that were "small-large-small"


class _NearestTwo(NamedTuple):
    """The nearest of all stationary points and ends, and the distance of the second nearest."""

    distance: Array
    second: Array
    place: CurvePlace
    point: Array


class _Run(NamedTuple):
    """A curve with one parameter: its segments without repetitions, their number, and whether it closes."""

    curve: BezierSegments
    skip: Array
    order: Array
    count: Array
    closed: Array

    @classmethod
    def of(cls, curve: BezierSegments, skip: Array) -> "_Run":
        order, count = jnp.argsort(skip, stable=True), jnp.sum(~skip)
        return cls(curve, skip, order, count, curve.next_segment[order[count - 1]] == order[0])

    def place(self, g: Array) -> CurvePlace:
        """Return the segment and its parameter at the parameter g of the whole curve."""
        g = jnp.where(self.closed, jnp.mod(g, self.count), g)
        index = jnp.clip(jnp.floor(g).astype(int), 0, self.count - 1)
        return CurvePlace(self.order[index], jnp.clip(g - index, 0.0, 1.0))

    def ends(self) -> tuple[Array, Array]:
        """Return the parameters of both ends, and whether they are ends."""
        return jnp.stack([jnp.zeros_like(self.count), self.count]).astype(float), jnp.broadcast_to(~self.closed, (2,))

    def point(self, at: CurvePlace) -> Array:
        return jet(*piece_of(self.curve, at.segment), at.t).point

    def feet(self, point: Array) -> _NearestTwo:
        """Return the nearest two of all stationary points of the distance from a point, and of all ends of segments."""
        index = jnp.arange(self.curve.count)
        # Boxes of stationary points that there is room for on a segment.
        roots = jax.vmap(lambda k: roots_on(point, self.curve, k, 16))(index)
        ends = jnp.broadcast_to(jnp.array([0.0, 1.0]), (len(index), 2))
        t = jnp.concatenate([0.5 * (roots.lower + roots.upper), ends], axis=1)
        valid = jnp.concatenate([roots.valid, ends >= 0], axis=1) & ~self.skip[:, None]
        points = jax.vmap(jax.vmap(lambda k, s: self.point(CurvePlace(k, s)), in_axes=(None, 0)))(index, t)
        distance = jnp.where(valid, lengths(points - point), jnp.inf)
        first = jnp.unravel_index(jnp.argmin(distance), distance.shape)
        # Stationary points closer than this are one: a joint is the end of two segments.
        others = lengths(points - points[first]) > 1e-7
        second = jnp.min(jnp.where(others, distance, jnp.inf))
        return _NearestTwo(distance[first], second, CurvePlace(first[0], t[first]), points[first])


def published_candidates(pair: RefinedPair, samples: int) -> PublishedCandidates:
    """Return the refined samples, then the ends of a, then the feet of the ends of b.

    Args:
        pair: both curves.
        samples: number of steps of the parameter of the whole curve a.
    """
    a, b = _Run.of(pair.a, pair.skip_a), _Run.of(pair.b, pair.skip_b)
    g = jnp.arange(samples + 1) * (a.count / samples)
    feet = in_chunks(lambda x: b.feet(a.point(a.place(x))), g, _CHUNK)
    peak = _peaks(feet.distance, a.closed)
    # Samples that are refined.
    _, k = jax.lax.top_k(jnp.where(peak, feet.distance, -jnp.inf), min(8, samples))
    before = jnp.where(k == 0, samples - 1, k - 1)
    low, high = g[k] - a.count / samples, g[k] + a.count / samples
    # Feet closer than this, in the common coordinates, are taken for one branch.
    apart = lengths(feet.point[before] - feet.point[jnp.minimum(k + 1, samples)]) >= 0.25
    refined = jax.vmap(lambda *x: _bisected(a, b, *x))(low, g[k], high, apart)
    ends, free = a.ends()
    t = jnp.concatenate([refined, ends])
    place = jax.vmap(a.place)(t)
    measured = in_chunks(lambda x: b.feet(a.point(a.place(x))).distance, t, _CHUNK)
    of_b, free_b = b.ends()
    back = jax.vmap(lambda x: a.feet(b.point(b.place(x))))(of_b)
    valid = jnp.concatenate([peak[k], free, free_b])
    distance = jnp.concatenate([measured, back.distance])
    place = CurvePlace(*(jnp.concatenate(x) for x in zip(place, back.place, strict=True)))
    count = samples + jnp.where(a.closed, 0, 1)
    return PublishedCandidates(place, jnp.where(valid, distance, -jnp.inf), count, jnp.sum(peak))


def _peaks(d: Array, closed: Array) -> Array:
    """Return samples not below either neighbor; on a closed curve the last one repeats the first."""
    j, last = jnp.arange(d.shape[0]), d.shape[0] - 1
    before = d[jnp.where(j == 0, last - 1, j - 1)]
    inner = (j > 0) | closed
    return inner & (j < last) & (d >= before) & (d >= d[jnp.minimum(j + 1, last)])


def _bisected(a: _Run, b: _Run, low: Array, middle: Array, high: Array, apart: Array) -> Array:
    """Return the root of (14), or of (15) if feet are apart; the middle sample if the ends have one sign."""

    def f(g: Array) -> Array:
        at = a.place(g)
        here = jet(*piece_of(a.curve, at.segment), at.t)
        foot = b.feet(here.point)
        r = here.point - foot.point
        sizes = lengths(r) * lengths(here.first)
        cosine = jnp.where(sizes > 0, (r @ here.first) / jnp.where(sizes > 0, sizes, 1.0), 0.0)
        angle = jnp.arccos(jnp.clip(cosine, -1.0, 1.0)) - 0.5 * jnp.pi
        gap = jnp.where(jnp.isfinite(foot.second), foot.distance - foot.second, -1.0)
        return jnp.where(apart, jnp.sign(angle) * gap, angle)

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        left, right = ends
        g = 0.5 * (left + right)
        goes_on = f(g) * at_low > 0
        return jnp.where(goes_on, g, left), jnp.where(goes_on, right, g)

    at_low, at_high = jax.vmap(f)(jnp.stack([low, high]))
    # After these halvings, intervals of at most two segments end below the printed 1e-10.
    left, right = jax.lax.fori_loop(0, 36, halve, (low, high))
    return jnp.where(at_low * at_high < 0, 0.5 * (left + right), middle)
