"""Proven lower and upper bounds of the directed Hausdorff distance of two curves, closed by branch and bound.

Cells that cover a wait in a table with a proven upper bound each. A step takes the few cells with the largest bounds,
bounds them by two branches split at their peak (jhd._distance.cells.branches), proves the distance of the most
promising peak from below over all of b (jhd._distance.nearest.curves), and cuts the cells at their peaks. Three or four
steps reach a maximum, because the bound of a cell cut at its peak is exact up to the mismatch of its feet.

At every moment every point of a lies in a cell whose upper bound holds, so the largest of them is a bound of the
distance, also when the search is stopped. If a cell does not fit into the table, its bound is kept. Nothing is
discarded on an unproven lower bound.

Source: the search and the bounds are ours; the events are those of Elber & Grandine, GMP 2008.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array

from jhd._distance.cells.branches import CurveBound, CurveCell, cell_upper_bound, first_upper_bound
from jhd._distance.nearest.blocks import Blocks
from jhd._distance.nearest.chords import Chords
from jhd._distance.nearest.curves import NearestOnCurve, in_chunks, repeated
from jhd._distance.nearest.feet import equation, gauss_newton, nearest_passed
from jhd._distance.nearest.near_curve import NearCurve
from jhd._distance.normalization.coordinates import diagonal, extremes
from jhd._distance.normalization.curves import evaluation_error
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of
from jhd._distance.normalization.stopping import Aim, Wanted, default_tolerance
from jhd._distance.witness import active
from jhd._distance.witness.events import OPEN, ZERO, describe
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness, result_where
from jhd._runtime.arrays import varying
from jhd._shapes.curve import BezierSegments

# Cells bounded in one step: two waste the vector units, eight bound cells that the first four would have closed.
LANES = 4
# Newton steps of a foot from where its search starts.
_SEED_STEPS = 3
# Segments of a long curve whose cells are made side by side.
_CHUNK = 4096
# Newton steps from the peak to the parameter beside a joint.
_JOINT_STEPS = 2
# Distance of a joint in units of the distance at the peak below which cells are cut beside the joint.
_BESIDE = 0.5
# A parameter this near to an end of the cell, as a fraction of its width, is the end up to rounding.
_AT_END = 1e-6
# A peak nearer than this share of the cell to an end does not serve as a cut; the middle does.
_NEAR_END = 0.02
# Least gap in units of the error of the common coordinates: both bounds take it, and those of the cells as much again.
_FLOOR = 8
# Rounding of a distance, and of one whose foot has been refined, in units of roundoff of the common coordinates.
_NOISE, _AGREEING = 4, 64
# Attempts to refine a maximum: from the place found, from where that leads to, from places between, and with the feet
# of the place found alone; and after how many there must be places on both sides of the maximum.
_TRIALS, _LED = 12, 2


class _Tolerances(NamedTuple):
    """What was asked for, in the common coordinates, and what can be reached."""

    atol: Array
    rtol: Array
    floor: Array

    def wanted(self, distance: Array) -> Array:
        """The tolerance at a distance."""
        return jnp.maximum(self.atol, self.rtol * distance)


def _tolerances(a: BezierSegments, b: BezierSegments, wanted: Wanted) -> _Tolerances:
    dtype = a.control_points.dtype
    # Closer than a few times the error of the common coordinates the bounds cannot get.
    floor = jnp.asarray(_FLOOR * evaluation_error(a, b), dtype)
    default = default_tolerance(diagonal([extremes(curve.control_points) for curve in (a, b)]), dtype, floor)
    return _Tolerances(jnp.where(wanted.atol < 0, default, wanted.atol), wanted.rtol, floor)


class CurveTable(NamedTuple):
    """Cells that wait to be cut, in rows: fewer and longer arrays are quicker to compile and to write to."""

    whole: Array  # (cells, 3): segment, k0, k1
    real: Array  # (cells, 4): t0, t1, s0, s1
    upper: Array  # -inf where free

    def cells(self, rows: Array) -> CurveCell:
        """Some of the cells."""
        whole, real = self.whole[rows], self.real[rows]
        return CurveCell(whole[:, 0], real[:, 0], real[:, 1], whole[:, 1], real[:, 2], whole[:, 2], real[:, 3])

    def longer(self, more: int) -> "CurveTable":
        """The table with more room."""
        whole, real = (jnp.pad(x, ((0, more), (0, 0))) for x in self[:2])
        return CurveTable(whole, real, jnp.pad(self.upper, (0, more), constant_values=-jnp.inf))


def _rows(cell: CurveCell, upper: Array) -> CurveTable:
    """A table of these cells."""
    whole, real = (cell.segment, cell.k0, cell.k1), (cell.t0, cell.t1, cell.s0, cell.s1)
    return CurveTable(jnp.stack(whole, axis=1), jnp.stack(real, axis=1), upper)


class CurveState(NamedTuple):
    """A search: its table of cells, and what it has proven and found so far."""

    table: CurveTable
    lower: Array
    value: Array
    at: CurvePlace
    foot: CurvePlace
    closed: Array  # largest upper bound of the cells that were closed or dropped
    dropped: Array
    pending: CurvePlace  # a place of a to be measured in the first step
    steps: Array

    @property
    def upper(self) -> Array:
        """Proven bound of the whole distance."""
        return jnp.maximum(jnp.maximum(jnp.max(self.table.upper), self.closed), self.lower)

    @property
    def waiting(self) -> Array:
        """Number of cells in the table."""
        return jnp.sum(self.table.upper > -jnp.inf)


def unfinished(a: BezierSegments, near: NearCurve, wanted: Wanted, state: CurveState) -> Array:
    """Whether more steps would serve what is wanted."""
    above = jnp.max(state.table.upper) > _goal(_tolerances(a, near.curve, wanted), wanted.aim, state.lower)
    return above & (state.lower <= wanted.aim.ceiling)


def _goal(tolerances: _Tolerances, aim: Aim, lower: Array) -> Array:
    """Cells with upper bounds up to this one are closed."""
    return jnp.maximum(aim.level, lower + jnp.maximum(tolerances.floor, tolerances.wanted(lower)))


def advance(
    a: BezierSegments, near: NearCurve, wanted: Wanted, state: CurveState, limit: ArrayLike, growing: ArrayLike = False
) -> CurveState:
    """Goes on until what is wanted is reached, or the limit of steps; `growing` stops before the table is full."""
    b = near.curve
    error, tolerances, aim = evaluation_error(a, b), _tolerances(a, b, wanted), wanted.aim

    def open_(state: CurveState) -> Array:
        full = growing & (state.waiting + LANES > state.table.upper.size)
        above = jnp.max(state.table.upper) > _goal(tolerances, aim, state.lower)
        return above & (state.lower <= aim.ceiling) & (state.steps < limit) & ~full

    def step(state: CurveState) -> CurveState:
        taken, uppers, rest = _largest(state.table)
        found = jax.vmap(lambda c: cell_upper_bound(a, b, c, near.runs))(taken)
        upper = jnp.minimum(uppers, found.upper + error)
        live = upper > _goal(tolerances, aim, state.lower)
        # The most promising place is measured where it can raise the lower bound.
        hope = jnp.where(live, found.distance, -jnp.inf)
        best = jnp.argmax(hope)
        first = state.steps == 0
        segment = jnp.where(first, state.pending[0], taken.segment[best])
        t = jnp.where(first, state.pending[1], found.t[best])
        point = jet(*piece_of(a, segment), t).point
        asked = first | (hope[best] > state.lower)
        measured = near.nearest(point, jnp.where(asked, 0.0, jnp.inf))
        raised = asked & (measured.distance > state.value)
        state = state._replace(
            lower=jnp.where(asked, jnp.maximum(measured.lower - error, state.lower), state.lower),
            value=jnp.where(raised, measured.distance, state.value),
            at=_where(raised, CurvePlace(segment, t), state.at),
            foot=_where(raised, CurvePlace(measured.segment, measured.t), state.foot),
            steps=state.steps + 1,
        )
        mine = (jnp.arange(LANES) == best) & asked & ~first
        goal = _goal(tolerances, aim, state.lower)
        return _pushed(a, near, state._replace(table=rest), goal, taken, upper, found, mine, measured)

    return jax.lax.while_loop(open_, step, varying(state, a, near))


def solution_of(a: BezierSegments, near: NearCurve, wanted: Wanted, state: CurveState) -> HausdorffSolution:
    """The solution that a search stands at."""
    b, dtype = near.curve, a.control_points.dtype
    tolerances, upper = _tolerances(a, b, wanted), state.upper
    witness, value, lower, *_ = _refined(a, near, state)
    lower = jnp.minimum(lower, upper)
    # Four units for the rounding of this comparison itself.
    gap = upper - jnp.maximum(lower, wanted.aim.level)
    closed = gap <= tolerances.wanted(upper) * (1 + 4 * jnp.finfo(dtype).eps)
    result = result_where(closed, RESULTS.successful, RESULTS.gap_not_closed)
    result = result_where(~closed & state.dropped, RESULTS.capacity_reached, result)
    stats = {"steps": state.steps, "cells": state.steps * LANES}
    return HausdorffSolution(jnp.clip(value, lower, upper), lower, upper, witness, result, stats)


class _RefinedWitness(NamedTuple):
    """A witness with value and lower bound, whether it solves its equations, and the place that these lead to."""

    witness: Witness
    value: Array
    lower: Array
    solved: Array
    at: CurvePlace
    foot: CurvePlace


class _RefinementTrial(NamedTuple):
    """Attempts to refine a maximum: how many, the last one, where the next one begins, and a place on each side."""

    count: Array
    found: _RefinedWitness
    at: CurvePlace
    foot: CurvePlace
    sides: tuple[CurvePlace, CurvePlace]  # places of a where the distance rises and falls, and the foot of each


def _refined(a: BezierSegments, near: NearCurve, state: CurveState) -> _RefinedWitness:
    """The witness of a search, with value and lower bound.

    First with the feet that count wherever the gap leaves the maximum, then with those that count where these lead to,
    then from places between two where the distance rises and falls: beside a cusp of the evolute both feet exist only
    near the tie. If no such maximum is found, the feet count that are equally near where the search stopped.
    """

    def again(tried: _RefinementTrial) -> Array:
        return (tried.count < _TRIALS) & ~tried.found.solved

    def next_(tried: _RefinementTrial) -> _RefinementTrial:
        last = tried.count == _TRIALS - 1
        at, foot = _where(last, state.at, tried.at), _where(last, state.foot, tried.foot)
        here = describe(a, near.curve, at, foot)
        reach = jnp.where(last, 0.0, here.reach(state.upper - state.lower))
        found = _polished(a, near, here.witness(reach), state)
        more = (tried.sides[0], at, found.at), (tried.sides[1], here.nearest, found.foot)
        places, feet = (
            jax.tree_util.tree_map(lambda x, *y: jnp.concatenate([x, jnp.stack(y)]), *parts) for parts in more
        )
        sides, between, apart = _between(a, near.curve, places, feet, state.upper - state.lower)
        at = found.at._replace(t=jnp.where(tried.count > 0, between, found.at.t))
        # An end or corner stays the maximum, whatever rounding leaves of its feet.
        held = here.around.end | here.around.corner
        count = jnp.where(last | ~held & (apart | (tried.count < _LED)), tried.count + 1, _TRIALS - 1)
        return _RefinementTrial(count, found, at, found.foot, sides)

    (segment, t), (k, s) = state.at, state.foot
    feet, one = jnp.zeros((2, a.dim), t.dtype), jnp.array([1.0, 0.0], t.dtype)
    feet_at, event, direction = (jnp.stack([k, k]), jnp.stack([s, s])), EVENTS.antipodal, DIRECTIONS.a_to_b
    witness = Witness(segment, t, feet[0], feet, *feet_at, one, event, direction)
    untried = _RefinedWitness(witness, t, t, jnp.array(False), state.at, state.foot)
    sides = jax.tree_util.tree_map(lambda x: jnp.stack([x, x]), (state.at, state.foot))
    start = _RefinementTrial(jnp.array(0), untried, state.at, state.foot, sides)
    return jax.lax.while_loop(again, next_, varying(start, a, near, state)).found


def _between(
    a: BezierSegments, b: BezierSegments, at: CurvePlace, feet: CurvePlace, gap: Array
) -> tuple[tuple, Array, Array]:
    """Return the last place where the distance rises and the first where it falls, and a parameter between them.

    It is the one at which the linear models of the distance at both places agree, or the middle of the places. If there
    is one place only, it is about as far as the maximum can be if the distance rises by the gap.

    Args:
        a: the curve that carries the maximum.
        b: the other one.
        at: places on a, stacked.
        feet: the foot of each on b.
        gap: of the bounds.

    Returns:
        Both places with their feet, stacked; the parameter; whether there are such places on one segment.
    """

    def model(at: CurvePlace, foot: CurvePlace) -> tuple[Array, Array]:
        here = jet(*piece_of(a, at.segment), at.t)
        apart = here.point - jet(*piece_of(b, foot.segment), foot.t).point
        distance = jnp.sqrt(jnp.sum(apart**2))
        return distance, jnp.sum(apart * here.first) / jnp.where(distance > 0, distance, 1.0)

    distance, slope = jax.vmap(model)(at, feet)
    here = at.segment == at.segment[0]
    falls = jnp.where(here & (slope < 0), at.t, jnp.inf)
    # Of the places on the left of it that on another hump does not count.
    rises = jnp.where(here & (slope > 0) & (at.t < jnp.min(falls)), at.t, -jnp.inf)
    chosen = jnp.stack([jnp.argmax(rises), jnp.argmin(falls)])
    sides = jax.tree_util.tree_map(lambda x: x[chosen], (at, feet))
    (rise, fall), (low, high), (start, end) = slope[chosen], distance[chosen], at.t[chosen]
    apart = (rise > 0) & (fall < 0) & (start < end) & jnp.all(here[chosen])
    t = start + (high - low + fall * (start - end)) / jnp.where(apart, rise - fall, 1.0)
    t = jnp.where((t > start) & (t < end), t, 0.5 * (start + end))
    left = (rise > 0) & here[chosen[0]]
    steep = jnp.where(left, rise, jnp.minimum(fall, -ZERO))
    beyond = jnp.clip(jnp.where(left, start, end) + OPEN * gap / steep, 0.0, 1.0)
    return sides, jnp.where(apart, t, beyond), apart


def _polished(a: BezierSegments, near: NearCurve, witness: Witness, state: CurveState) -> _RefinedWitness:
    """The witness at the solution of its equations: peaks are off by the root of the gap.

    Accepted only where the place is measured to be as far, both feet to be its nearest points, and two feet balance.
    """
    b, k, (k1, k2) = near.curve, witness.element, witness.feet_elements
    y = jnp.concatenate([witness.t[None], witness.feet_params])
    pieces = piece_of(a, k), piece_of(b, k1), piece_of(b, k2)
    system = active.active(*pieces, y, witness.event, witness.multipliers)
    y = active.polished(y, system)
    y = y.at[2].set(jnp.where(system.two, y[2], y[1]))
    point, feet = active.places(y, system.pieces)
    found = near.nearest(point)
    # Where a foot is flat the one that is proven is off by more than the distance tells.
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
    return _RefinedWitness(witness, value, lower, better, CurvePlace(k, y[0]), CurvePlace(found.segment, found.t))


def _where(condition: Array, new: CurvePlace, old: CurvePlace) -> CurvePlace:
    return CurvePlace(*(jnp.where(condition, x, y) for x, y in zip(new, old, strict=True)))


def begin(a: BezierSegments, near: NearCurve, wanted: Wanted, capacity: int) -> CurveState:
    """One cell for each segment of a, with feet found from samples of b and a first upper bound."""
    if isinstance(near.guide, Blocks):
        return _begin_long(a, near, wanted, capacity)
    b, dtype = near.curve, a.control_points.dtype
    ends = a.control_points[:, jnp.array([0, -1])]
    k, s, distance = jax.vmap(jax.vmap(partial(_first_foot, b)))(ends, near.starts(ends))
    count, zeros = a.count, jnp.zeros((a.count,), dtype)
    cell = CurveCell(jnp.arange(count), zeros, zeros + 1, k[:, 0], s[:, 0], k[:, 1], s[:, 1])
    # Straight runs of b count from the first step on: another bound here takes longer to compile than it saves.
    upper = jax.vmap(partial(_first_upper, a, b, None))(cell)
    upper = jnp.where(repeated(a.control_points, a.weights), -jnp.inf, upper)
    table = _rows(cell, upper).longer(capacity - count)
    at = jnp.argmax(distance)
    pending = CurvePlace(at // 2, (at % 2).astype(dtype))
    none = jnp.array(-jnp.inf, dtype)
    # Until a place is measured it is its own witness.
    foot = CurvePlace(k.ravel()[at], s.ravel()[at])
    return CurveState(table, zeros[0], none, pending, foot, none, jnp.array(False), pending, jnp.array(0))


def _first_upper(a: BezierSegments, b: BezierSegments, runs: Chords | None, cell: CurveCell) -> Array:
    return first_upper_bound(a, b, cell, runs) + evaluation_error(a, b)


def _first_foot(b: BezierSegments, point: Array, start: CurvePlace) -> tuple[Array, Array, Array]:
    piece = piece_of(b, start.segment)
    s = nearest_passed(point, piece, start.t, _SEED_STEPS)
    return start.segment, s, jnp.sqrt(jnp.sum((jet(*piece, s).point - point) ** 2))


def _begin_long(a: BezierSegments, near: NearCurve, wanted: Wanted, capacity: int) -> CurveState:
    """The same for many segments.

    The place that seems the farthest is measured, so that only cells with larger bounds come into the table; those that
    do not fit are folded into the bound of all.
    """
    b, dtype = near.curve, a.control_points.dtype
    error, skip = evaluation_error(a, b), repeated(a.control_points, a.weights)

    def first(row: tuple[Array, CurvePlace]) -> tuple[CurveCell, Array, Array]:
        segment, start = row
        k, s, distance = jax.vmap(partial(_first_foot, b))(ends[segment], start)
        zero = jnp.zeros((), dtype)
        cell = CurveCell(segment, zero, zero + 1, k[0], s[0], k[1], s[1])
        return cell, _first_upper(a, b, near.runs, cell), distance

    ends = a.control_points[:, jnp.array([0, -1])]
    cell, upper, distance = in_chunks(first, (jnp.arange(a.count), near.starts(ends)), _CHUNK)
    far = jnp.argmax(distance)
    at = CurvePlace(far // 2, (far % 2).astype(dtype))
    measured = near.nearest(a.control_points[at.segment][-(far % 2)])
    lower = jnp.maximum(measured.lower - error, 0.0)
    goal = _goal(_tolerances(a, b, wanted), wanted.aim, lower)
    live = ~skip & (upper > goal)
    waiting = jnp.where(live, upper, -jnp.inf)
    # In single precision, which is thirty times faster on CPU; the order need not be exact.
    _, kept = jax.lax.top_k(waiting.astype(jnp.float32), min(capacity, a.count))
    lost = jnp.max(waiting.at[kept].set(-jnp.inf))
    closed = jnp.maximum(jnp.max(jnp.where(live | skip, -jnp.inf, upper)), lost)
    table = _rows(CurveCell(*(x[kept] for x in cell)), waiting[kept]).longer(capacity - kept.size)
    foot = CurvePlace(measured.segment, measured.t)
    return CurveState(table, lower, measured.distance, at, foot, closed, lost > goal, at, jnp.array(0))


def _largest(table: CurveTable) -> tuple[CurveCell, Array, CurveTable]:
    """The cells with the largest upper bounds, and the table without them."""
    # In single precision, which is thirty times faster on CPU; the order need not be exact.
    _, index = jax.lax.top_k(table.upper.astype(jnp.float32), LANES)
    return table.cells(index), table.upper[index], table._replace(upper=table.upper.at[index].set(-jnp.inf))


def _beside_joints(
    a: BezierSegments, b: BezierSegments, cut: Array, cells: CurveCell, found: CurveBound
) -> tuple[Array, Array]:
    """The cuts, moved beside the joint of the two segments that carry the feet if it is much nearer than the peak.

    Each branch ends at the joint, so its bound is exact on its own side only. Cut elsewhere, the bound of the cell that
    holds the joint falls no faster than the width of the cell.

    Returns:
        The cuts, and which of them were moved.
    """
    forward, backward = b.next_segment[cells.k0] == cells.k1, b.next_segment[cells.k1] == cells.k0
    joined = (forward | backward) & (cells.k0 != cells.k1)

    def moved(cut: Array, k: Array, joined: Array, cell: CurveCell, found: CurveBound) -> tuple[Array, Array]:
        joint, piece = b.control_points[k, -1], piece_of(a, cell.segment)
        t, least = found.t, _AT_END * (cell.t1 - cell.t0)
        for _ in range(_JOINT_STEPS):
            t = gauss_newton(t, equation(joint, piece, t))
        near = equation(joint, piece, t).distance_sq < (_BESIDE * found.distance) ** 2
        taken = joined & near & (t > cell.t0 + least) & (t < cell.t1 - least)
        return jnp.where(taken, t, cut), taken

    rows = cut, jnp.where(forward, cells.k0, cells.k1), joined, cells, found
    return jax.lax.cond(jnp.any(joined), jax.vmap(moved), lambda cut, *_: (cut, jnp.zeros_like(joined)), *rows)


def _pushed(
    a: BezierSegments,
    near: NearCurve,
    state: CurveState,
    goal: Array,
    cell: CurveCell,
    upper: Array,
    found: CurveBound,
    mine: Array,
    measured: NearestOnCurve,
) -> CurveState:
    """Cuts the cells, gives the cuts their feet, and puts the halves that are still above the goal into the table."""
    b, width = near.curve, cell.t1 - cell.t0
    at_left = found.t <= cell.t0 + _NEAR_END * width
    at_right = found.t >= cell.t1 - _NEAR_END * width
    cut = jnp.where(at_left | at_right, cell.t0 + 0.5 * width, found.t)
    cut, at_joint = _beside_joints(a, b, cut, cell, found)

    def foot(point: Array, start: CurvePlace, ks: Array, ss: Array) -> tuple[Array, Array]:
        ks, ss = jnp.append(ks, start.segment), jnp.append(ss, start.t)
        ss = jax.vmap(lambda k, s: nearest_passed(point, piece_of(b, k), s, _SEED_STEPS))(ks, ss)
        feet = jax.vmap(lambda k, s: jet(*piece_of(b, k), s).point)(ks, ss)
        best = jnp.argmin(jnp.sum((feet - point) ** 2, axis=-1))
        return ks[best], ss[best]

    # The proven foot is offered to all cells: several of them may follow the same wrong one.
    proven = (jnp.full_like(cell.k0, measured.segment), jnp.full_like(cell.s0, measured.t))
    starts = [
        jnp.stack(x, axis=1) for x in ((found.k, cell.k0, cell.k1, proven[0]), (found.s, cell.s0, cell.s1, proven[1]))
    ]
    at_both = jax.vmap(jax.vmap(foot), in_axes=(0, 0, None, None))
    points = jax.vmap(jax.vmap(lambda k, t: jet(*piece_of(a, k), t).point), in_axes=(None, 0))(
        cell.segment, jnp.stack([cut, found.t])
    )
    (k, peak_k), (s, peak_s) = at_both(points, near.starts(points), *starts)
    # The measured foot is proven to be the nearest.
    peak_k, peak_s = jnp.where(mine, measured.segment, peak_k), jnp.where(mine, measured.t, peak_s)
    inside = ~at_left & ~at_right & ~at_joint
    k, s = jnp.where(inside, peak_k, k), jnp.where(inside, peak_s, s)
    # A peak at an end of the cell: the foot there may have been a wrong one.
    cell = cell._replace(
        k0=jnp.where(at_left, peak_k, cell.k0),
        s0=jnp.where(at_left, peak_s, cell.s0),
        k1=jnp.where(at_right, peak_k, cell.k1),
        s1=jnp.where(at_right, peak_s, cell.s1),
    )
    # A peak above the lower bound at an end whose foot is not proven may be that of a wrong foot, and would stay one in
    # ever smaller cells: such a cell waits uncut until it is its turn to be measured.
    waits = ~inside & ~at_joint & (found.distance > state.lower) & ~mine
    end = (jnp.where(waits, old, new) for old, new in ((cell.t1, cut), (cell.k1, k), (cell.s1, s)))
    left = cell._replace(**dict(zip(("t1", "k1", "s1"), end, strict=True)))
    right = cell._replace(t0=cut, k0=k, s0=s)
    halves = CurveCell(*(jnp.concatenate(pair) for pair in zip(left, right, strict=True)))
    uppers = jnp.concatenate([upper, jnp.where(waits, -jnp.inf, upper)])
    # A cell of a few ulp cannot be cut again.
    open_ = (uppers > goal) & (jnp.tile(width, 2) > 8 * jnp.finfo(width.dtype).eps)
    closed = jnp.maximum(state.closed, jnp.max(jnp.where(open_, -jnp.inf, uppers)))
    new = _rows(halves, jnp.where(open_, uppers, -jnp.inf))
    _, slots = jax.lax.top_k(-state.table.upper.astype(jnp.float32), 2 * LANES)
    whole, real, upper = state.table
    old = CurveTable(whole[slots], real[slots], upper[slots])
    # Where the table is full the smaller bound of the two makes room: it is folded into the result.
    stays = old.upper >= new.upper
    lost = jnp.max(jnp.minimum(old.upper, new.upper))
    rows = (jnp.where(stays[:, None], x, y) for x, y in zip(old[:2], new[:2], strict=True))
    whole, real = (x.at[slots].set(y) for x, y in zip((whole, real), rows, strict=True))
    table = CurveTable(whole, real, upper.at[slots].set(jnp.maximum(old.upper, new.upper)))
    return state._replace(table=table, closed=jnp.maximum(closed, lost), dropped=state.dropped | (lost > goal))
