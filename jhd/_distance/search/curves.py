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

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array

from jhd._distance.cells.branches import CurveBound, CurveCell, cell_upper_bound, first_upper_bound
from jhd._distance.nearest.blocks import Blocks
from jhd._distance.nearest.chords import Chords
from jhd._distance.nearest.curves import NearestOnCurve, repeated
from jhd._distance.nearest.feet import equation, gauss_newton, nearest_passed
from jhd._distance.nearest.near_curve import NearCurve
from jhd._distance.normalization.coordinates import diagonal, extremes
from jhd._distance.normalization.curves import evaluation_error
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import CurvePlace, piece_of
from jhd._distance.normalization.stopping import Aim, Wanted, default_tolerance
from jhd._distance.search.refined_witness import SearchedPlace, refined
from jhd._results.solution import RESULTS, HausdorffSolution, result_where
from jhd._runtime.arrays import in_chunks, varying
from jhd._shapes.curve import BezierSegments

# Cells bounded in one step: two waste the vector units, eight bound cells that the first four would have closed.
LANES = 4
# Newton steps for a foot from the start of its search.
_SEED_STEPS = 3
# Segments of a long curve whose cells are made in one batch.
_CHUNK = 4096
# Newton steps from the peak to the parameter nearest to a joint.
_JOINT_STEPS = 2
# Distance of a joint, in units of the distance at the peak, below which cells are cut next to the joint.
_BESIDE = 0.5
# A parameter this near to an end of the cell, as a fraction of its width, is the end up to rounding.
_AT_END = 1e-6
# A peak closer to an end than this fraction of the cell does not serve as a cut; the middle does.
_NEAR_END = 0.02
# Least gap, in units of the error of the common coordinates: used in both bounds, and again in the bounds of cells.
_FLOOR = 8


class _Tolerances(NamedTuple):
    """Requested tolerances in common coordinates, and the smallest gap that can be reached."""

    atol: Array
    rtol: Array
    floor: Array

    def wanted(self, distance: Array) -> Array:
        """Return the tolerance at a distance."""
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
        """Return the cells of some rows."""
        whole, real = self.whole[rows], self.real[rows]
        return CurveCell(whole[:, 0], real[:, 0], real[:, 1], whole[:, 1], real[:, 2], whole[:, 2], real[:, 3])

    def longer(self, more: int) -> "CurveTable":
        """Return the table with more room."""
        whole, real = (jnp.pad(x, ((0, more), (0, 0))) for x in self[:2])
        return CurveTable(whole, real, jnp.pad(self.upper, (0, more), constant_values=-jnp.inf))


def _rows(cell: CurveCell, upper: Array) -> CurveTable:
    """Return a table of these cells."""
    whole, real = (cell.segment, cell.k0, cell.k1), (cell.t0, cell.t1, cell.s0, cell.s1)
    return CurveTable(jnp.stack(whole, axis=1), jnp.stack(real, axis=1), upper)


class CurveState(NamedTuple):
    """State of a search: its table of cells, and the bounds and points found so far."""

    table: CurveTable
    lower: Array
    value: Array
    at: CurvePlace
    foot: CurvePlace
    closed: Array  # largest upper bound of the cells that were closed or dropped
    dropped: Array
    pending: CurvePlace  # a point of a to be measured in the first step
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
    """Return whether more steps would improve the requested bounds."""
    above = jnp.max(state.table.upper) > _goal(_tolerances(a, near.curve, wanted), wanted.aim, state.lower)
    return above & (state.lower <= wanted.aim.ceiling)


def _goal(tolerances: _Tolerances, aim: Aim, lower: Array) -> Array:
    """Return the upper bound up to which cells are closed."""
    return jnp.maximum(aim.level, lower + jnp.maximum(tolerances.floor, tolerances.wanted(lower)))


def advance(
    a: BezierSegments, near: NearCurve, wanted: Wanted, state: CurveState, limit: ArrayLike, growing: ArrayLike = False
) -> CurveState:
    """Advance until the goal or the limit of steps is reached; `growing` also stops before the table is full."""
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
        # The most promising point is measured if it can raise the lower bound.
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
            at=CurvePlace(segment, t).if_(raised, state.at),
            foot=CurvePlace(measured.segment, measured.t).if_(raised, state.foot),
            steps=state.steps + 1,
        )
        mine = (jnp.arange(LANES) == best) & asked & ~first
        goal = _goal(tolerances, aim, state.lower)
        return _pushed(a, near, state._replace(table=rest), goal, taken, upper, found, mine, measured)

    return jax.lax.while_loop(open_, step, varying(state, a, near))


def solution_of(a: BezierSegments, near: NearCurve, wanted: Wanted, state: CurveState) -> HausdorffSolution:
    """Return the solution of a search as it stands."""
    b, dtype = near.curve, a.control_points.dtype
    tolerances, upper = _tolerances(a, b, wanted), state.upper
    found = refined(a, near, SearchedPlace(state.at, state.foot, state.value, state.lower, upper))
    witness, value, lower = found.witness, found.value, jnp.minimum(found.lower, upper)
    # Four units for the rounding of this comparison itself.
    gap = upper - jnp.maximum(lower, wanted.aim.level)
    closed = gap <= tolerances.wanted(upper) * (1 + 4 * jnp.finfo(dtype).eps)
    result = result_where(closed, RESULTS.successful, RESULTS.gap_not_closed)
    result = result_where(~closed & state.dropped, RESULTS.capacity_reached, result)
    stats = {"steps": state.steps, "cells": state.steps * LANES}
    return HausdorffSolution(jnp.clip(value, lower, upper), lower, upper, witness, result, stats)


def begin(a: BezierSegments, near: NearCurve, wanted: Wanted, capacity: int) -> CurveState:
    """Return the first state: one cell a segment of a, feet found from samples of b, and first upper bounds."""
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
    # Until a point is measured it is its own witness.
    foot = CurvePlace(k.ravel()[at], s.ravel()[at])
    return CurveState(table, zeros[0], none, pending, foot, none, jnp.array(False), pending, jnp.array(0))


def _first_upper(a: BezierSegments, b: BezierSegments, runs: Chords | None, cell: CurveCell) -> Array:
    return first_upper_bound(a, b, cell, runs) + evaluation_error(a, b)


def _first_foot(b: BezierSegments, point: Array, start: CurvePlace) -> tuple[Array, Array, Array]:
    piece = piece_of(b, start.segment)
    s = nearest_passed(point, piece, start.t, _SEED_STEPS)
    return start.segment, s, jnp.sqrt(jnp.sum((jet(*piece, s).point - point) ** 2))


def _begin_long(a: BezierSegments, near: NearCurve, wanted: Wanted, capacity: int) -> CurveState:
    """Return the first state for a curve with many segments.

    The point that seems farthest is measured, so that only cells with larger bounds enter the table. Cells that do not
    fit are folded into the bound of the search.
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
    """Return the cells with the largest upper bounds, and the table without them."""
    # In single precision, which is thirty times faster on CPU; the order need not be exact.
    _, index = jax.lax.top_k(table.upper.astype(jnp.float32), LANES)
    return table.cells(index), table.upper[index], table._replace(upper=table.upper.at[index].set(-jnp.inf))


def _beside_joints(
    a: BezierSegments, b: BezierSegments, cut: Array, cells: CurveCell, found: CurveBound
) -> tuple[Array, Array]:
    """Move the cuts next to the joint of the two segments that carry the feet, if it is much nearer than the peak.

    Each branch ends at the joint, so its bound is exact on its own side only. Cut elsewhere, the bound of the cell that
    holds the joint falls no faster than the width of the cell. The second result tells which cuts were moved.
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
    """Cut the cells, give the cuts their feet, and put the halves that are above the goal into the table."""
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

    # The proven foot is offered to all cells: several of them may follow the wrong foot.
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
    # A peak above the lower bound at an end with an unproven foot may belong to a wrong foot, and would stay in ever
    # smaller cells: such a cell waits uncut until it is its turn to be measured.
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
    # If the table is full the smaller bound of the two makes room: it is folded into the result.
    stays = old.upper >= new.upper
    lost = jnp.max(jnp.minimum(old.upper, new.upper))
    rows = (jnp.where(stays[:, None], x, y) for x, y in zip(old[:2], new[:2], strict=True))
    whole, real = (x.at[slots].set(y) for x, y in zip((whole, real), rows, strict=True))
    table = CurveTable(whole, real, upper.at[slots].set(jnp.maximum(old.upper, new.upper)))
    return state._replace(table=table, closed=jnp.maximum(closed, lost), dropped=state.dropped | (lost > goal))
