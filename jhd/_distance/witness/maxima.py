"""Local maxima along one curve of the distance to another one, refined and checked.

Samples of each segment propose the maxima: intervals in which the slope of the distance changes its sign, ends and
corners. Bisection with the nearest foot distinguishes one foot from two, Newton's method on the active system
(jhd._distance.witness.active) refines the maxima, and a proven search checks that no further foot is nearer.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.nearest.curves import nearest, repeated
from jhd._distance.nearest.feet import by_normal, follow_foot
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of, preceding
from jhd._distance.witness import active
from jhd._distance.witness.ends import Around, around
from jhd._distance.witness.events import ZERO, describe
from jhd._results.solution import DIRECTIONS, EVENTS, Witness
from jhd._runtime.arrays import in_chunks, varying
from jhd._shapes.curve import BezierSegments

# Samples of the curve that carries the maxima, shared among its segments within these limits for each.
_SAMPLES, _LEAST, _MOST = 1024, 12, 256
# Bisections of an interval between two samples; Newton steps after them.
_BISECTIONS, _POLISH = 16, 5
# Two feet are one if they are nearer than this fraction of the distance, or than one foot can have moved in a cell.
_ONE_FOOT, _MOVED = 1e-3, 64.0
# A foot is the nearest if no foot is nearer by this fraction, or this length in the common coordinates.
NEARER, ROUNDED = 1e-9, 1e-13


class _CriticalPair(NamedTuple):
    """Two curves in one direction, the preceding segments of both, and samples of b for the first feet."""

    a: BezierSegments
    b: BezierSegments
    before_a: Array
    before_b: Array
    seeds: Array  # (seeds, dim)
    seed_at: CurvePlace


class _Foot(NamedTuple):
    """A foot on b of a point of a, and the slope of the distance along a."""

    segment: Array
    s: Array
    point: Array
    distance: Array
    slope: Array


class _CriticalCell(NamedTuple):
    """An interval of a segment of a that may hold a maximum, or an end, with points of b at which feet may be."""

    segment: Array
    t0: Array
    t1: Array
    left: CurvePlace
    right: CurvePlace
    other: CurvePlace


class _FoundMaximum(NamedTuple):
    value: Array
    witness: Witness
    wrong: Array  # whether another foot is nearer, or a followed point is no foot
    nearest: CurvePlace


class _Rounds(NamedTuple):
    cells: _CriticalCell
    found: _FoundMaximum
    count: Array


def local_maxima(a: BezierSegments, b: BezierSegments, lanes: int) -> tuple[Array, Witness]:
    """Return local maxima along a of the distance to b: values, -inf if there is none, and witnesses."""
    pair = _prepared(a, b)
    keys, cells, top = _proposed(pair, lanes)

    def round_(state: _Rounds) -> _Rounds:
        found = _refined(pair, state.cells)
        return varying(_Rounds(state.cells._replace(other=found.nearest), found, state.count + 1), pair)

    def again(state: _Rounds) -> Array:
        # Rounds of refinement: an interval whose foot was not the nearest starts again with the nearest foot.
        return jnp.any(state.found.wrong & (keys > -jnp.inf)) & (state.count < 3)

    blank = jax.tree_util.tree_map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(lambda: _refined(pair, cells)))
    start = _Rounds(cells, blank._replace(wrong=jnp.ones_like(blank.wrong)), jnp.array(0))
    found = jax.lax.while_loop(again, round_, varying(start, pair)).found
    value = jnp.where(found.wrong | (keys == -jnp.inf), -jnp.inf, found.value)
    # The last lane holds the largest sample. It counts if it exceeds all maxima, as along a flat stretch.
    spare = (jnp.arange(lanes + 1) == lanes) & (jnp.max(value[:-1]) >= top * (1 - NEARER) - ROUNDED)
    value = jnp.where(spare, -jnp.inf, value)
    return value, _at_ends(pair, found.witness, value > -jnp.inf)


def _at_ends(pair: _CriticalPair, witness: Witness, valid: Array) -> Witness:
    """Return the witnesses; at ends and corners with all feet that are equally near and count."""
    ends = valid & ((witness.event == EVENTS.a_end) | (witness.event == EVENTS.corner))
    (order,) = jnp.nonzero(ends, size=ends.size, fill_value=0)

    def described(i: Array, witness: Witness) -> Witness:
        k = order[i]
        w = jax.tree_util.tree_map(lambda x: x[k], witness)
        place, foot = CurvePlace(w.element, w.t), CurvePlace(w.feet_elements[0], w.feet_params[0])
        new = describe(pair.a, pair.b, place, foot).witness()
        return jax.tree_util.tree_map(lambda x, y: x.at[k].set(y), witness, new)

    # One after the other: they are few.
    return jax.lax.fori_loop(0, jnp.sum(ends), described, varying(witness, pair))


def _prepared(a: BezierSegments, b: BezierSegments) -> _CriticalPair:
    # Samples of each segment of the other curve for the first feet.
    s = jnp.linspace(0.0, 1.0, 13, dtype=b.control_points.dtype)
    points = jax.vmap(lambda k: jax.vmap(lambda u: jet(*piece_of(b, k), u).point)(s))(jnp.arange(b.count))
    at = CurvePlace(jnp.repeat(jnp.arange(b.count), s.size), jnp.tile(s, b.count))
    return _CriticalPair(a, b, preceding(a.next_segment), preceding(b.next_segment), points.reshape(-1, b.dim), at)


def _seed(pair: _CriticalPair, points: Array) -> CurvePlace:
    """Return the nearest sample of b for each of the points (points, dim); the index replaces the last bits."""
    count = pair.seeds.shape[0]
    last_bits = 2 ** (count - 1).bit_length() - 1
    offsets = [x[:, None] - y for x, y in zip(pair.seeds.T, points.T, strict=True)]
    squares = sum((x * x for x in offsets), jnp.zeros(())).astype(jnp.float32)
    key = jax.lax.bitcast_convert_type(squares, jnp.int32) & ~last_bits | jnp.arange(count, dtype=jnp.int32)[:, None]
    index = jnp.min(key, axis=0) & last_bits
    return CurvePlace(pair.seed_at.segment[index], pair.seed_at.t[index])


def _foot(pair: _CriticalPair, segment: Array, t: Array, starts: CurvePlace) -> _Foot:
    """Return the nearest of the feet reached from the starts (starts,) of the point of a, and the slope there."""
    at = jet(*piece_of(pair.a, segment), t)
    # Newton steps that lead from a sample to a foot, one of them lost at each joint that is crossed.
    feet = jax.vmap(lambda k, s: follow_foot(at.point, pair.b, pair.before_b, k, s, 7))(*starts)
    squares = jnp.sum((feet.point - at.point) ** 2, axis=-1)
    best = jnp.argmin(squares)
    k, s, point, pinned = (x[best] for x in feet)
    c, tangent = at.point - point, jet(*piece_of(pair.b, k), s).first
    distance = jnp.sqrt(squares[best])
    slope = c @ at.first
    if c.shape[0] == 2:
        side = jnp.sign(tangent[0] * c[1] - tangent[1] * c[0])
        known = ~pinned & by_normal(squares[best], tangent @ tangent)
        slope = jnp.where(known, side * (tangent[0] * at.first[1] - tangent[1] * at.first[0]), slope)
    return _Foot(k, s, point, distance, slope)


def _proposed(pair: _CriticalPair, lanes: int) -> tuple[Array, _CriticalCell, Array]:
    """Return the most promising cells of maxima, their keys (-inf for none), and the largest sample."""
    a = pair.a
    steps = min(max(math.ceil(_SAMPLES / a.count), _LEAST), _MOST)
    t = jnp.tile(jnp.linspace(0.0, 1.0, steps + 1, dtype=a.control_points.dtype), a.count)
    segment = jnp.repeat(jnp.arange(a.count), steps + 1)
    skip, skipped = (repeated(curve.control_points, curve.weights) for curve in (a, pair.b))

    def sampled(at: CurvePlace) -> _Foot:
        # A followed foot can be a wrong one, and hide a wide maximum.
        point = jet(*piece_of(a, at.segment), at.t).point
        enough = jnp.where(skip[at.segment], jnp.inf, 0.0)
        found = nearest(point, pair.b.control_points, pair.b.weights, enough, skipped)
        return _foot(pair, at.segment, at.t, CurvePlace(found.segment[None], found.t[None]))

    # Samples whose nearest points are searched in one batch.
    foot = in_chunks(sampled, CurvePlace(segment, t), 32)
    foot = jax.tree_util.tree_map(lambda x: x.reshape(a.count, steps + 1, *x.shape[1:]), foot)
    slope, distance = foot.slope, foot.distance
    skip = skip[:, None]
    # At points at which the curves meet, the distance rises on both sides and has no slope.
    met = distance <= ZERO
    rises = (slope[:, :-1] > 0) | met[:, :-1] & ~met[:, 1:]
    inside = rises & ((slope[:, 1:] <= 0) | met[:, 1:] & ~met[:, :-1])
    joined = jnp.where(a.next_segment < 0, 1.0, -slope[jnp.maximum(a.next_segment, 0), 0]) >= 0
    at_end = (slope[:, -1] > 0) & joined
    falls = (slope[:, 0] < 0) | (slope[:, 0] == 0) & (slope[:, 1] <= 0)
    at_start = (pair.before_a < 0) & falls
    key = jnp.concatenate([at_start[:, None], inside, at_end[:, None]], axis=1) & ~skip
    # Cells of a segment: its start, the intervals between samples, its end.
    low = jnp.arange(steps + 2) - 1
    low, high = jnp.clip(low, 0, steps), jnp.clip(low + 1, 0, steps)
    keys = jnp.where(key, jnp.maximum(distance[:, low], distance[:, high]), -jnp.inf).ravel()
    # In single precision, which is thirty times faster on CPU; the order need not be exact.
    _, index = jax.lax.top_k(keys.astype(jnp.float32), lanes)
    row, column = index // (steps + 2), index % (steps + 2)
    best = jnp.argmax(jnp.where(skip, -jnp.inf, distance))
    row, best_column = jnp.append(row, best // (steps + 1)), best % (steps + 1)
    low, high = (jnp.append(x[column], best_column) for x in (low, high))
    t = t[: steps + 1]
    left, right = (CurvePlace(foot.segment[row, x], foot.s[row, x]) for x in (low, high))
    top = distance.ravel()[best]
    return jnp.append(keys[index], top), _CriticalCell(row, t[low], t[high], left, right, left), top


def _starts(*places: CurvePlace) -> CurvePlace:
    return CurvePlace(*(jnp.stack(x, axis=-1) for x in zip(*places, strict=True)))


def _refined(pair: _CriticalPair, cells: _CriticalCell) -> _FoundMaximum:
    """Return the maximum in each cell."""

    def foot(t: Array, left: CurvePlace, right: CurvePlace) -> _Foot:
        points = jax.vmap(lambda k, u: jet(*piece_of(pair.a, k), u).point)(cells.segment, t)
        starts = _starts(_seed(pair, points), left, right, cells.other)
        return jax.vmap(lambda k, u, s: _foot(pair, k, u, s))(cells.segment, t, starts)

    def halved(_: int, state: tuple[_CriticalCell, Array, _Foot]) -> tuple[_CriticalCell, Array, _Foot]:
        cell = state[0]
        middle = 0.5 * (cell.t0 + cell.t1)
        here = foot(middle, cell.left, cell.right)
        rising, at = here.slope > 0, CurvePlace(here.segment, here.s)
        left, right = (
            CurvePlace(*(jnp.where(which, x, y) for x, y in zip(at, old, strict=True)))
            for which, old in ((rising, cell.left), (~rising, cell.right))
        )
        t0, t1 = jnp.where(rising, middle, cell.t0), jnp.where(rising, cell.t1, middle)
        return cell._replace(t0=t0, t1=t1, left=left, right=right), middle, here

    zeros = jnp.zeros_like(cells.t0)
    points = jnp.zeros((*zeros.shape, pair.a.dim), zeros.dtype)
    blank = _Foot(cells.left.segment, zeros, points, zeros, zeros)
    small, t, here = jax.lax.fori_loop(0, _BISECTIONS, halved, varying((cells, zeros, blank), pair))
    held = cells.t0 == cells.t1
    return jax.vmap(lambda *lane: _described(pair, *lane))(small, t, here, held)


def _described(pair: _CriticalPair, cell: _CriticalCell, t: Array, foot: _Foot, held: Array) -> _FoundMaximum:
    """Return the polished maximum of a cell that has been halved often enough."""
    a, b = pair.a, pair.b
    piece = piece_of(a, cell.segment)
    speed = jnp.sqrt(jnp.sum(jet(*piece, t).first ** 2))
    ends = jnp.stack([jet(*piece_of(b, k), s).point for k, s in (cell.left, cell.right)])
    apart = jnp.sqrt(jnp.sum((ends[0] - ends[1]) ** 2))
    moved = _MOVED * (cell.t1 - cell.t0) * speed
    two = ~held & (apart > jnp.maximum(_ONE_FOOT * foot.distance, moved))
    # The first foot in the order of segments and parameters is named first.
    turned = two & (cell.left.segment + cell.left.t > cell.right.segment + cell.right.t)
    first, second = (
        CurvePlace(*(jnp.where(two, jnp.where(turned, x, y), z) for x, y, z in zip(*places, strict=True)))
        for places in (
            (cell.right, cell.left, (foot.segment, foot.s)),
            (cell.left, cell.right, (foot.segment, foot.s)),
        )
    )
    border = jnp.round(t)
    place = around(a, pair.before_a, CurvePlace(cell.segment, border))
    event = _event(place, held & (t == border), EVENTS.where(two, EVENTS.one_to_two, EVENTS.antipodal))
    y = jnp.stack([t, first.t, second.t])
    one = jnp.array([1.0, 0.0])
    system = active.active(piece, piece_of(b, first.segment), piece_of(b, second.segment), y, event, one)
    event = EVENTS.where((event == EVENTS.antipodal) & system.held[1], EVENTS.b_end, event)
    new = jax.lax.fori_loop(0, _POLISH, lambda _, x: jnp.clip(active.newton(x, system), 0.0, 1.0), varying(y, system))
    # The maximum lies in the cell; if Newton's method leaves the cell, the middle is kept.
    stays = jnp.abs(new[0] - t) <= 4 * (cell.t1 - cell.t0)
    y = jnp.where(stays, new, y)
    # Between the arms of b an end or corner can be a maximum that rises on one side, towards it, for either foot alone.
    # A maximum of two feet this near to an end of its segment is at the end: the tie determines it only to rounding.
    ending = two & (jnp.abs(y[0] - border) <= 1e-12)
    y = y.at[0].set(jnp.where(ending, border, y[0]))
    event = _event(place, ending, event)
    s1, s2 = y[1], jnp.where(two, y[2], y[1])
    at, value = jet(*piece, y[0]).point, active.distance(y, system)
    near = nearest(at, b.control_points, b.weights, 0.0, repeated(b.control_points, b.weights))
    witness = Witness(
        element=cell.segment,
        t=y[0],
        point=at,
        feet=jnp.stack([jet(*system.first, s1).point, jet(*system.second, s2).point]),
        feet_elements=jnp.stack([first.segment, second.segment]),
        feet_params=jnp.stack([s1, s2]),
        multipliers=active.balance(y, system, one)[0],
        event=EVENTS.where(value <= ZERO, EVENTS.coincident, event),
        direction=DIRECTIONS.a_to_b,
    )
    wrong = jnp.abs(value - near.distance) > near.distance * NEARER + ROUNDED
    return _FoundMaximum(value, witness, wrong, CurvePlace(near.segment, near.t))


def _event(place: Around, held: Array, event: Any) -> Any:
    """Return the event, which is an end or corner if the parameter is held there."""
    event = EVENTS.where(held & place.corner, EVENTS.corner, event)
    return EVENTS.where(held & place.end, EVENTS.a_end, event)
