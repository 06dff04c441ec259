"""Points of one surface that may be farthest from the other: polished to a local maximum, and measured with a proof.

Polishing uses cutting planes: it finds the maximum of the smallest distance to some feet, and adds the nearest point on
b of this maximum to the feet, until no further foot appears. The proof bounds the distance of a point from all of b,
less the length within which a has a point there.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jhd._arithmetic.rounding import like_double, round_down, unit_roundoff
from jhd._distance.cells.surfaces import FEET
from jhd._distance.nearest.surface_points import thorough_radius
from jhd._distance.nearest.surfaces import CAPACITY, Cover, SurfaceCloud, nearest, nearest_places
from jhd._distance.normalization.surfaces import Side
from jhd._distance.witness.polish import polish
from jhd._runtime.arrays import varying

# The last points of b that were found nearest.
HINTS = 8
# Gain over the last candidate that a new one has to promise, and agreement of feet, in units of roundoff.
NOISE = 64
# Rounds of the cutting planes.
_ROUNDS = 5
# Feet are equal below this distance; they count together if their distances agree to this fraction and as much.
_SAME, _AGREEING = 1e-6, 1e-3


class Target(NamedTuple):
    """A side of an implicit surface with its cover and cloud, from which searches start."""

    side: Side
    cover: Cover
    cloud: SurfaceCloud


class SurfacePlace(NamedTuple):
    """A point of a at which the distance is attained, its feet on b, and their weights, zero for unused feet."""

    point: Array  # (3,)
    feet: Array  # (4, 3)
    weights: Array  # (4,)


class FarthestPlace(NamedTuple):
    """The farthest point of a so far: the proven bound, the value (-inf if none is proven) and the point with feet."""

    lower: Array
    value: Array
    place: SurfacePlace
    hints: Array  # (8, 3), points of b that were nearest
    measured: Array


class _Round(NamedTuple):
    best: FarthestPlace
    feet: Array
    used: Array
    going: Array
    count: Array


def improved(
    a: Target,
    b: Target,
    best: FarthestPlace,
    place: SurfacePlace,
    asked: Bool[Array, ""],
    close: Array,
    capacity: int = CAPACITY,
) -> FarthestPlace:
    """Return the farthest point after a candidate has been measured and polished, if `asked`.

    Args:
        a: the surface that carries the candidate.
        b: the surface that distances are taken to.
        best: the farthest point so far.
        place: the candidate: a point close to a, and its feet.
        asked: whether to do anything.
        close: gap at which the bounds of its distance are close enough.
        capacity: capacity of open cells of the search for its distance.
    """
    start = varying(best, a, b, place)
    return jax.lax.cond(asked, lambda best: _measured(a, b, best, place, close, capacity), lambda best: best, start)


def _measured(
    a: Target, b: Target, best: FarthestPlace, place: SurfacePlace, close: Array, capacity: int
) -> FarthestPlace:
    """Measure a candidate, polish it in rounds with new feet, and return the farthest point so far."""
    noise = NOISE * unit_roundoff(best.lower.dtype)
    box_a, box_b = ((jnp.asarray(t.side.lower), jnp.asarray(t.side.upper)) for t in (a, b))
    coefficients = jnp.asarray(a.side.coefficients), jnp.asarray(b.side.coefficients)

    def turn(r: _Round) -> _Round:
        best, plain = r.best, r.count == 0
        found = polish(coefficients[0], box_a, coefficients[1], box_b, place.point, r.feet, r.used)
        # The first round measures the candidate itself.
        good = found.converged & ~plain
        point = jnp.where(good, found.point, place.point)
        radius = thorough_radius(a.side, point[:, None])[0]
        starts = jnp.concatenate([found.feet, r.feet, best.hints]).T
        starts = jnp.concatenate([starts, nearest_places(b.cloud, point)], axis=1)
        near = nearest(b.side, b.cover, point, starts, best.lower + radius, close, capacity)
        proven = jnp.isfinite(radius) & (plain | found.converged)
        lower = jnp.where(proven, round_down(near.lower - radius), -jnp.inf)
        value = jnp.sqrt(jnp.sum((near.foot - point) ** 2))
        first = proven & (best.value == -jnp.inf)
        raised = first | (lower > best.lower) | (good & (lower >= best.lower - noise) & (value > best.value))
        new = _described(SurfacePlace(point, found.feet, found.multipliers), near.foot, good)
        # A new foot replaces a foot that does not count.
        missing = good & (value < found.distance - noise)
        slot = jnp.arange(FEET) == jnp.argmin(jnp.where(r.used, 1.0 + found.multipliers, 0.0))
        going = jnp.where(plain, near.upper > best.lower, missing & (found.distance > best.lower))
        best = FarthestPlace(
            lower=jnp.maximum(lower, best.lower),
            value=jnp.where(raised, value, best.value),
            place=jax.tree_util.tree_map(lambda x, y: jnp.where(raised, x, y), new, best.place),
            hints=jnp.roll(best.hints, 1, axis=0).at[0].set(near.foot),
            measured=best.measured + 1,
        )
        feet = jnp.where((missing & slot)[:, None], near.foot, r.feet)
        return _Round(best, feet, r.used | (missing & slot), going, r.count + 1)

    start = _Round(best, place.feet, _distinct(place), jnp.array(True), jnp.zeros((), int))
    end = jax.lax.while_loop(lambda r: r.going & (r.count < _ROUNDS), turn, varying(start, a, b, place))
    return end.best


def _distinct(place: SurfacePlace) -> Array:
    """Return a mask of the feet that are near enough to count, each once."""
    distances = jnp.sqrt(jnp.sum((place.feet - place.point) ** 2, axis=1))
    near = distances <= jnp.min(distances) * (1 + _AGREEING) + like_double(_SAME, distances.dtype)
    return near & ~_repeated(place.feet, near)


def _repeated(feet: Array, counting: Array) -> Array:
    """Return a mask of the feet that repeat an earlier foot that counts."""
    same = jnp.sum((feet[:, None] - feet) ** 2, axis=-1) <= like_double(_SAME, feet.dtype) ** 2
    return jnp.any(jnp.tril(same & counting[None], -1), axis=1)


def _described(place: SurfacePlace, foot: Array, polished: Array) -> SurfacePlace:
    """Return the point with merged feet, largest weight first; or its nearest point if it was not polished."""
    counting = place.weights > 0
    same = (
        (jnp.sum((place.feet[:, None] - place.feet) ** 2, axis=-1) <= like_double(_SAME, place.feet.dtype) ** 2)
        & counting
        & counting[:, None]
    )
    first = counting & ~jnp.any(jnp.tril(same, -1), axis=1)
    weights = jnp.where(first, jnp.sum(jnp.where(same, place.weights, 0.0), axis=1), 0.0)
    order = jnp.argsort(-weights)
    weights = weights[order] / jnp.sum(weights)
    feet = jnp.where((weights > 0)[:, None], place.feet[order], place.feet[order[0]])
    return SurfacePlace(
        place.point,
        jnp.where(polished, feet, foot),
        jnp.where(polished, weights, jnp.eye(FEET, dtype=weights.dtype)[0]),
    )
