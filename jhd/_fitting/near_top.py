"""The local maxima of the distance between two curves of many segments that are near the largest, in NumPy.

One direction at a time. Samples of the carrier have an upper bound of their distance from the tree of the other curve's
samples at once; samples that can be near the top get feet. A maximum lies between two samples if the distance rises at
the first and falls at the second, at a corner, or at an end. Between two samples it is bracketed by halving, then
polished: one foot by Newton's method, two feet by making their distances equal.

Nothing is proven: a maximum that is narrower than the spacing of the samples can be missed. A fit by these maxima
checks its end by a proven distance, and takes more samples if a maximum was missed.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jhd._distance.nearest.feet import dot, stays
from jhd._fitting.sampled import CurvePlaces, SampledCurve, SampledFeet
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, CriticalPairs, Witness, result_where
from jhd._runtime.arrays import joined, taken
from jhd._runtime.clock import Clock

# Samples whose feet give a first value of the top, and most samples that get feet, the farthest ones.
_FIRST, _MOST = 32, 1 << 14
# A point is not polished if its nearest foot is nearer than the polished foot by this fraction.
_NEARER = 1e-9
# The numbers of both directions, from b to a first.
_WAYS = tuple(int(way._value) for way in (DIRECTIONS.b_to_a, DIRECTIONS.a_to_b))

FloatArray = Any


class NearTop(NamedTuple):
    """Local maxima along a carrier: values, locations, their feet with weights, and events."""

    value: FloatArray
    at: CurvePlaces
    point: FloatArray
    feet: FloatArray  # (maxima, 2, dim)
    feet_elements: FloatArray
    feet_params: FloatArray
    multipliers: FloatArray
    event: FloatArray

    take = taken


class _Intervals(NamedTuple):
    """Intervals of the carrier with the feet at both ends."""

    segment: FloatArray
    t0: FloatArray
    t1: FloatArray
    left: CurvePlaces
    right: CurvePlaces


def near_top(carrier: SampledCurve, other: SampledCurve, share: float) -> NearTop:
    """The local maxima of the distance along the carrier above the fraction `share` of the largest."""
    rough = other.tree.query(carrier.points)[0]
    first = np.argpartition(-rough, min(_FIRST, len(rough)) - 1)[:_FIRST]
    top = np.max(other.feet(carrier.points[first]).distance)
    least = share * top
    if len(rough) > _MOST:
        least = max(least, np.partition(rough, -_MOST)[-_MOST])
    wanted = rough >= least
    looked = np.flatnonzero(_widened(carrier, wanted))
    feet = other.feet(carrier.points[looked])
    distance, slope = np.full(len(rough), -np.inf), np.zeros(len(rough))
    places = CurvePlaces(np.zeros(len(rough), int), np.zeros(len(rough)))
    distance[looked] = feet.distance
    places.segment[looked], places.t[looked] = feet.at
    slope[looked] = dot(carrier.points[looked] - feet.point, carrier.jets(carrier.samples.take(looked)).first)
    inside = _inside(carrier, other, distance, slope, places, least)
    held = _held(carrier, other, np.flatnonzero(_held_samples(carrier, slope) & (distance >= least)))
    found = joined([inside, held])
    # If the largest sample exceeds all maxima, as along a flat stretch, it counts as a maximum.
    best = np.argmax(distance)
    if not np.max(found.value, initial=-np.inf) >= distance[best] * (1 - _NEARER):
        found = joined([found, _held(carrier, other, np.array([best]))])
    return found.take(found.value >= share * np.max(found.value, initial=0.0))


def _widened(carrier: SampledCurve, wanted: FloatArray) -> FloatArray:
    """Mask of the wanted samples, their neighbors, and both samples at each joint."""
    wide = wanted.copy()
    wide[1:] |= wanted[:-1]
    wide[:-1] |= wanted[1:]
    start, end = carrier.first[:-1], carrier.first[1:] - 1
    goes_on = carrier.next_segment >= 0
    before, after = end[goes_on], start[carrier.next_segment[goes_on]]
    both = wide[before] | wide[after]
    wide[before], wide[after] = both, both
    return wide


def _held_samples(carrier: SampledCurve, slope: FloatArray) -> FloatArray:
    """Mask of corners and ends from which the distance does not rise; if the curve stands still, the slope is zero."""
    held = np.zeros(len(slope), bool)
    start, end = carrier.first[:-1], carrier.first[1:] - 1
    if carrier.degree == 0:
        return ~held
    on = carrier.next_segment
    falls = np.where(on >= 0, slope[start[on]] <= 0, True)
    held[end] = (slope[end] > 0) & falls
    starts = (slope[start] < 0) | (slope[start] == 0) & (slope[start + 1] <= 0)
    held[start] |= (carrier.preceding < 0) & starts
    return held


def _held(carrier: SampledCurve, other: SampledCurve, samples: FloatArray) -> NearTop:
    """Maxima at samples (ends, corners, or one along a flat stretch), each with its nearest foot."""
    at = carrier.samples.take(samples)
    found = other.feet(carrier.points[samples])
    corner = (at.t == 1) & (carrier.next_segment[at.segment] >= 0)
    end = (at.t == 1) | (at.t == 0) & (carrier.preceding[at.segment] < 0)
    free = np.where(end, int(EVENTS.a_end._value), int(EVENTS.antipodal._value))
    event = np.where(corner, int(EVENTS.corner._value), free)
    two = CurvePlaces(*(np.stack([x, x], axis=1) for x in found.at))
    weights = np.tile([1.0, 0.0], (len(samples), 1))
    feet = np.stack([found.point, found.point], axis=1)
    return NearTop(found.distance, at, carrier.points[samples], feet, *two, weights, event)


def _inside(
    carrier: SampledCurve,
    other: SampledCurve,
    distance: FloatArray,
    slope: FloatArray,
    places: CurvePlaces,
    least: float,
) -> NearTop:
    """Maxima between samples."""
    samples = carrier.samples
    alike = samples.segment[1:] == samples.segment[:-1]
    risen = np.maximum(distance[1:], distance[:-1]) >= least
    index = np.flatnonzero(alike & risen & (slope[:-1] > 0) & (slope[1:] <= 0))
    cells = _Intervals(
        samples.segment[index], samples.t[index], samples.t[index + 1], places.take(index), places.take(index + 1)
    )
    for _ in range(14):
        cells = _halved(carrier, other, cells)
    return _polished(carrier, other, cells)


def _halved(carrier: SampledCurve, other: SampledCurve, cells: _Intervals) -> _Intervals:
    """The half of each interval that contains a maximum, by the sign of the slope at the middle."""
    middle = 0.5 * (cells.t0 + cells.t1)
    jet = carrier.jets(CurvePlaces(cells.segment, middle))
    found = other.feet(jet.point, cells.left, cells.right)
    rising = dot(jet.point - found.point, jet.first) > 0

    def chosen(which: FloatArray, old: CurvePlaces) -> CurvePlaces:
        return CurvePlaces(*(np.where(which, x, y) for x, y in zip(found.at, old, strict=True)))

    t0, t1 = np.where(rising, middle, cells.t0), np.where(rising, cells.t1, middle)
    return _Intervals(cells.segment, t0, t1, chosen(rising, cells.left), chosen(~rising, cells.right))


def _polished(carrier: SampledCurve, other: SampledCurve, cells: _Intervals) -> NearTop:
    """The maxima of small intervals."""
    middle = 0.5 * (cells.t0 + cells.t1)
    jet = carrier.jets(CurvePlaces(cells.segment, middle))
    # The first foot in the order of segments and parameters is named first.
    turned = cells.left.segment + cells.left.t > cells.right.segment + cells.right.t
    left, right = (
        CurvePlaces(*(np.where(turned, x, y) for x, y in zip(*places, strict=True)))
        for places in ((cells.right, cells.left), (cells.left, cells.right))
    )
    first, second = (other.followed(jet.point, place) for place in (left, right))
    apart = np.sqrt(dot(first.point - second.point, first.point - second.point))
    moved = 64.0 * (cells.t1 - cells.t0) * np.sqrt(dot(jet.first, jet.first))
    # Feet at both ends of a small interval count as two if their distance exceeds this fraction of the value, or this
    # many times the length of the interval.
    two = apart > np.maximum(1e-3 * first.distance, moved)
    width = 4 * (cells.t1 - cells.t0)
    t = middle
    # Newton steps after the halvings.
    for _ in range(5):
        at = carrier.jets(CurvePlaces(cells.segment, t))
        first, second = (other.followed(at.point, foot.at) for foot in (first, second))
        slopes = [dot(at.point - foot.point, at.first) for foot in (first, second)]
        uneven, change = 0.5 * (first.distance**2 - second.distance**2), slopes[0] - slopes[1]
        equal = -uneven / np.where(change != 0, change, np.inf)
        step = np.where(two, equal, _step_of_one(carrier, other, CurvePlaces(cells.segment, t), first))
        t = np.clip(t + step, np.maximum(middle - width, 0.0), np.minimum(middle + width, 1.0))
    return _described(carrier, other, CurvePlaces(cells.segment, t), first, second, two)


def _step_of_one(carrier: SampledCurve, other: SampledCurve, at: CurvePlaces, foot: SampledFeet) -> FloatArray:
    """Newton's step of t for c.A' = 0 with a moving foot, whose derivative enters."""
    a, b = carrier.jets(at), other.jets(foot.at)
    c = a.point - b.point
    pinned = ((foot.at.t <= 0) & (dot(c, b.first) < 0)) | ((foot.at.t >= 1) & (dot(c, b.first) > 0))
    across, own = dot(a.first, b.first), dot(b.first, b.first) - dot(c, b.second)
    speed = np.where(pinned | (own <= 0), 0.0, across / np.where(own > 0, own, 1.0))
    bent = dot(a.first, a.first) + dot(c, a.second) - across * speed
    # Zero unless it leads to a maximum.
    return np.where(bent < 0, -dot(c, a.first) / np.where(bent < 0, bent, 1.0), 0.0)


def _described(
    carrier: SampledCurve,
    other: SampledCurve,
    at: CurvePlaces,
    first: SampledFeet,
    second: SampledFeet,
    two: FloatArray,
) -> NearTop:
    """The maxima at the given locations, with one or two feet; if another foot is nearer, with that foot only."""
    jet = carrier.jets(at)
    first, second = (other.followed(jet.point, foot.at) for foot in (first, second))
    nearest = other.feet(jet.point)
    value = np.where(two, np.minimum(first.distance, second.distance), first.distance)
    wrong = nearest.distance < value * (1 - _NEARER)
    two = two & ~wrong
    foot = CurvePlaces(*(np.where(wrong, x, y) for x, y in zip(nearest.at, first.at, strict=True)))
    point = np.where(wrong[:, None], nearest.point, first.point)
    other_foot = CurvePlaces(*(np.where(two, x, y) for x, y in zip(second.at, foot, strict=True)))
    feet = np.stack([point, np.where(two[:, None], second.point, point)], axis=1)
    apart = jet.point[:, None] - feet
    distance = np.sqrt(dot(apart, apart))
    slopes = dot(apart, jet.first[:, None]) / np.where(distance > 0, distance, 1.0)
    difference = slopes[:, 0] - slopes[:, 1]
    weight = np.clip(-slopes[:, 1] / np.where(difference != 0, difference, 1.0), 0.0, 1.0)
    weight = np.where(two, np.where(difference != 0, weight, 0.5), 1.0)
    tangent = other.jets(foot).first
    size = distance[:, 0] * np.sqrt(dot(tangent, tangent))
    single = np.where(
        stays(foot.t, dot(apart[:, 0], tangent), size), int(EVENTS.b_end._value), int(EVENTS.antipodal._value)
    )
    event = np.where(two, int(EVENTS.one_to_two._value), single)
    return NearTop(
        np.min(distance, axis=1),
        at,
        jet.point,
        feet,
        np.stack([foot.segment, other_foot.segment], axis=1),
        np.stack([foot.t, other_foot.t], axis=1),
        np.stack([weight, 1 - weight], axis=1),
        event,
    )


def pairs_near_top(a: SampledCurve, b: SampledCurve, share: float, capacity: int, clock: Clock) -> CriticalPairs:
    """The largest local maxima of both directions above the fraction `share` of the largest, largest first."""
    there = near_top(a, b, share)
    clock.check()
    back = near_top(b, a, share)
    back = back.take(~_repeated(there, back))
    both = joined([there, back])
    order = np.argsort(-both.value, kind="stable")[:capacity]
    turned = order >= len(there.value)
    found = both.take(order)
    room = np.minimum(np.arange(capacity), max(len(order) - 1, 0))
    found, turned, valid = found.take(room), turned[room], np.arange(capacity) < len(order)
    witness = Witness(
        element=jnp.asarray(found.at.segment),
        t=jnp.asarray(found.at.t),
        point=jnp.asarray(found.point),
        feet=jnp.asarray(found.feet),
        feet_elements=jnp.asarray(found.feet_elements),
        feet_params=jnp.asarray(found.feet_params),
        multipliers=jnp.asarray(found.multipliers),
        event=_members(EVENTS.antipodal, found.event),
        direction=_members(DIRECTIONS.a_to_b, np.where(turned, *_WAYS)),
    )
    full = jnp.asarray(len(both.value) > capacity)
    result = result_where(full, RESULTS.capacity_reached, RESULTS.successful)
    return CriticalPairs(jnp.asarray(np.where(valid, found.value, 0.0)), witness, jnp.asarray(valid), result)


def _repeated(there: NearTop, back: NearTop) -> FloatArray:
    """Mask of the maxima `back` that repeat one of `there`: one foot, equal points, and equal ends held."""
    if not len(there.value) or not len(back.value):
        return np.zeros(len(back.value), bool)
    ends = [int(event._value) for event in (EVENTS.a_end, EVENTS.corner)]

    def held(found: NearTop) -> tuple[FloatArray, FloatArray]:
        carrier, s = np.isin(found.event, ends), found.feet_params[:, 0]
        return carrier, (found.event == int(EVENTS.b_end._value)) | carrier & ((s <= 0) | (s >= 1))

    def apart(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.max(np.abs(x[:, None] - y), axis=-1)

    (w_carrier, w_foot), (v_carrier, v_foot) = held(there), held(back)
    alike = (v_carrier[:, None] == w_foot) & (v_foot[:, None] == w_carrier)
    near = np.maximum(apart(back.point, there.feet[:, 0]), apart(back.feet[:, 0], there.point))
    single = np.all(back.multipliers != 0, axis=1)[:, None] | np.all(there.multipliers != 0, axis=1)
    # Maxima of both directions closer than this fraction of the distance are one.
    return np.any(alike & ~single & (near < 1e-6 * there.value), axis=1)


def _members(item: Any, values: FloatArray) -> Any:
    """A member of an enumeration for each of the values."""
    return eqx.tree_at(lambda member: member._value, item, jnp.asarray(values))
