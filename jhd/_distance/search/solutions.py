"""Start and end of a search on two implicit surfaces: targets, empty surfaces, and solutions."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool

from jhd._arithmetic.rounding import like_double, unit_roundoff
from jhd._distance.cells.surfaces import FEET
from jhd._distance.nearest.forms import boxes, form
from jhd._distance.nearest.surface_points import projected, proven_radius
from jhd._distance.nearest.surfaces import cloud, cover, halved, inner, pushed
from jhd._distance.normalization.stopping import Wanted
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.candidates import Target
from jhd._distance.search.surfaces import SurfaceState, advance, begin, tolerance, unfinished
from jhd._results.solution import EVENTS, RESULTS, HausdorffSolution, Witness, result_where
from jhd._runtime.arrays import varying

# Waiting cells of a search for any point, cells per step, and steps.
_CAPACITY, _LANES, _STEPS = 2048, 32, 400
_NARROW = 2.0**-44
_POINT_STEPS = 8
# A distance of at most this many units of roundoff is zero; weights below this fraction of the largest are zero.
_COINCIDENT, _WEIGHTLESS = 256, 1e-9
# A measured distance contributes to the gap if its bounds differ by more than this fraction of the tolerance.
_WIDE = 0.5
# If this many cells are left when a search ends, the farthest points are not isolated.
_FAMILY = 400


class _Look(NamedTuple):
    rows: Array
    key: Array  # minus the width, inf where free
    point: Array
    radius: Array
    whole: Array
    steps: Array


def target(side: Side) -> tuple[Target, Bool[Array, ""]]:
    """Return a side with its cover and its cloud, and whether it is proven to have no point in its box."""
    return with_some_point(Target(side, cover(side), cloud(side)))


def with_some_point(known: Target) -> tuple[Target, Bool[Array, ""]]:
    """Return the target with a proven point in its cloud, if one is found, and whether none is proven to exist.

    If no point of the cloud is proven, smaller and smaller cells are examined until one holds a proven point or none is
    left. The point replaces the first point of the cloud.
    """
    side, covering, points = known
    none = ~jnp.any(jnp.isfinite(points.radius))

    def going(look: _Look) -> Array:
        return none & jnp.isinf(look.radius) & jnp.any(look.key < jnp.inf) & (look.steps < _STEPS)

    def step(look: _Look) -> _Look:
        _, index = jax.lax.top_k(-look.key.astype(jnp.float32), _LANES)
        taken, live = look.rows[index].T, look.key[index] < jnp.inf
        low, high = taken[:3], taken[3:]
        free, middle = inner(side, low, high), 0.5 * (low + high)
        face = jnp.where(low <= jnp.asarray(side.lower)[:, None], low, high)
        starts = jnp.concatenate([middle, jnp.where(free, middle, face)], axis=1)
        fixed = jnp.concatenate([jnp.zeros_like(free), ~free], axis=1)
        found = projected(side, starts, fixed, _POINT_STEPS)
        radius = jnp.where(jnp.tile(live, 2), proven_radius(side, found), jnp.inf)
        best = jnp.argmin(radius)
        wide = live & (jnp.max(high - low, axis=0) >= like_double(_NARROW, low.dtype))
        low, high = halved(low, high)
        kept = form(side, boxes(low, high)).may_vanish & jnp.tile(wide, 8)
        key = jnp.where(kept, -jnp.max(high - low, axis=0), jnp.inf)
        rows, keys, dropped = pushed(look.rows, look.key.at[index].set(jnp.inf), jnp.concatenate([low, high]).T, key)
        whole = look.whole & jnp.isinf(dropped) & jnp.all(wide | ~live)
        return _Look(rows, keys, found[:, best], radius[best], whole, look.steps + 1)

    width = jnp.max(covering.upper - covering.lower, axis=0)
    room = _CAPACITY - width.size
    start = _Look(
        jnp.pad(jnp.concatenate([covering.lower, covering.upper]).T, ((0, room), (0, 0))),
        jnp.pad(jnp.where(covering.alive, -width, jnp.inf), (0, room), constant_values=jnp.inf),
        points.points[:, 0],
        points.radius[0],
        jnp.array(True),
        jnp.zeros((), int),
    )
    end = jax.lax.while_loop(going, step, varying(start, side))
    points = points._replace(
        points=points.points.at[:, 0].set(jnp.where(none, end.point, points.points[:, 0])),
        radius=points.radius.at[0].set(jnp.where(none, end.radius, points.radius[0])),
    )
    empty = none & jnp.isinf(end.radius) & ~jnp.any(end.key < jnp.inf) & end.whole
    return Target(side, covering, points), empty


class CoveredPair(NamedTuple):
    """Two surfaces of a directed distance, and whether one of them is proven to have no point."""

    a: Target  # the surface whose farthest point is searched
    b: Target  # the surface that distances are taken to
    empty: Array  # whether one surface is proven to have no point, so that there is no distance

    def turned(self) -> "CoveredPair":
        """Return the direction from b to a."""
        return CoveredPair(self.b, self.a, self.empty)


def in_one_go(pair: CoveredPair, wanted: Wanted, capacity: int, max_steps: int, direction: Any) -> HausdorffSolution:
    """Run the whole search."""
    state, _ = advanced(pair, wanted, begin(pair.a, pair.b, capacity), max_steps)
    return solution_of(pair, wanted, state, direction)


def solution_of(pair: CoveredPair, wanted: Wanted, state: SurfaceState, direction: Any) -> HausdorffSolution:
    """Return the solution of a search as it stands, in common coordinates."""
    a, b, empty = pair
    best, u = state.best, unit_roundoff(state.best.lower.dtype)
    proven = _known(pair)
    upper = jnp.where(proven, jnp.maximum(state.upper, best.lower), jnp.inf)
    lower = jnp.where(proven, best.lower, 0.0)
    gap = upper - jnp.maximum(lower, wanted.aim.level)
    closed = gap <= tolerance(a.side, b.side, wanted, upper) * (1 + 4 * u)
    family = state.waiting >= _FAMILY
    result = result_where(family, RESULTS.nonisolated_maxima, RESULTS.gap_not_closed)
    # Capacity is missing if cells were dropped, or if a point is farther than its bound: then many points of b are
    # about equally near.
    wide = best.value - best.lower > _WIDE * tolerance(a.side, b.side, wanted, upper)
    result = result_where(state.full | wide, RESULTS.capacity_reached, result)
    # A point that cannot be proven may keep the bounds apart.
    result = result_where(a.side.isolated.doubtful | b.side.isolated.doubtful, RESULTS.existence_not_certified, result)
    result = result_where(closed, RESULTS.successful, result)
    result = result_where(proven, result, RESULTS.existence_not_certified)
    result = result_where(empty, RESULTS.empty_surface, result)
    value = jnp.where(proven, jnp.clip(best.value, lower, upper), jnp.nan)
    stats = {"steps": state.steps, "cells": state.cells, "waiting": state.waiting, "measured": best.measured}
    witness = _witness(a.side, b.side, state, value, direction)
    return HausdorffSolution(value, lower, upper, witness, result, stats)


def _witness(a: Side, b: Side, state: SurfaceState, value: Array, direction: Any) -> Witness:
    place, u = state.best.place, unit_roundoff(value.dtype)
    at_border = jnp.any((place.point == jnp.asarray(a.lower)) | (place.point == jnp.asarray(a.upper)))
    foot = place.feet[0]
    foot_at_border = jnp.any((foot == jnp.asarray(b.lower)) | (foot == jnp.asarray(b.upper)))
    several = jnp.sum(place.weights > like_double(_WEIGHTLESS, value.dtype)) > 1
    event = EVENTS.where(foot_at_border, EVENTS.b_end, EVENTS.antipodal)
    event = EVENTS.where(at_border, EVENTS.a_end, event)
    event = EVENTS.where(several, EVENTS.one_to_two, event)
    event = EVENTS.where(value <= _COINCIDENT * u, EVENTS.coincident, event)
    nothing = jnp.full((FEET,), -1, int)
    return Witness(
        element=nothing[0],
        t=jnp.asarray(jnp.nan, value.dtype),
        point=place.point,
        feet=place.feet,
        feet_elements=nothing,
        feet_params=jnp.full((FEET,), jnp.nan, value.dtype),
        multipliers=place.weights,
        event=event,
        direction=direction,
    )


def advanced(
    pair: CoveredPair, wanted: Wanted, state: SurfaceState, limit: ArrayLike, following: bool = True
) -> tuple[SurfaceState, Array]:
    """Return the search some steps on, and whether more steps would help; none do if a bound is missing for good."""
    known = _known(pair)
    state = advance(pair.a, pair.b, wanted, state, jnp.where(known, limit, 0), following)
    return state, known & unfinished(pair.a, pair.b, wanted, state)


def _known(pair: CoveredPair) -> Array:
    """Return whether both surfaces have a proven point."""
    return jnp.any(jnp.isfinite(pair.b.cloud.radius)) & jnp.any(jnp.isfinite(pair.a.cloud.radius)) & ~pair.empty
