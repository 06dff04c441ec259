"""Proven lower and upper bounds of the directed Hausdorff distance of two curves, closed by branch and bound.

Cells that cover a wait in a table with a proven upper bound each. A step takes the few with the largest bounds, bounds
them by two branches split at their peak (jhd.distance.bounds), proves the distance of the most promising peak from
below over all of b (jhd.distance.nearest), and cuts the cells at their peaks. Maxima are met after three or four steps,
because the bound of a cell cut at its peak is exact up to the mismatch of its feet.

At every moment every point of a lies in a cell whose upper bound holds, so the largest of them is a bound of the
distance, also when the search is stopped; what does not fit in the table is folded into it. Nothing is discarded on an
unproven lower bound.

Source: the search and the bounds are ours; the events are those of Elber & Grandine, GMP 2008.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arrays import is_traced, real_array
from jhd.distance.bounds import Cell, CellBound, cell_upper_bound, first_upper_bound, local_foot
from jhd.distance.events import Place, describe, piece_of
from jhd.distance.jets import jet
from jhd.distance.method import AbstractHausdorffMethod, Aim
from jhd.distance.nearest import Nearest, nearest, repeated
from jhd.distance.prepare import Frame, evaluation_error
from jhd.shapes.curve import BezierSegments
from jhd.solution import RESULTS, HausdorffSolution, result_where

# Cells bounded in one step: two waste the vector units, eight bound cells that the first four would have closed.
_LANES = 4
# Samples of each segment of b for the first feet.
_SEEDS = 4
_SEED_STEPS = 3
# A peak nearer than this share of the cell to an end does not serve as a cut; the middle does.
_NEAR_END = 0.02
# Least gap in units of the error of the common coordinates: both bounds take it, and those of the cells as much again.
_FLOOR = 8
# Default tolerance in units of the diagonal.
_DEFAULT = 1e-10


class BranchAndBound(AbstractHausdorffMethod):
    """Certified distance: lower <= exact <= upper, with upper - lower below the tolerance.

    Args:
        atol: absolute tolerance on upper - lower, in the unit of the coordinates; by default 1e-10 (in float32: 64
            units of roundoff) of the diagonal of the box of both shapes' control points, or what rounding leaves where
            that is more.
        rtol: tolerance relative to upper; the larger of both tolerances counts.
        max_steps: most steps, of four cells each.
        capacity: least length of the table of cells; twice the number of segments of a where that is more.
    """

    atol: Array | None = eqx.field(default=None, converter=lambda x: None if x is None else real_array("atol", x))
    rtol: Array = eqx.field(default=0.0, converter=lambda x: real_array("rtol", x))
    max_steps: int = eqx.field(static=True, default=2000)
    capacity: int = eqx.field(static=True, default=512)

    def __check_init__(self) -> None:
        for name in ("atol", "rtol"):
            value = getattr(self, name)
            if value is None:
                continue
            if value.shape != ():
                raise ValueError(f"{name} has shape {value.shape}; needs a scalar.")
            if not is_traced(value) and not float(value) >= 0:
                raise ValueError(f"{name} is {float(value):g}; needs a number of at least 0.")
        for name, least in (("max_steps", 0), ("capacity", 16)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < least:
                raise ValueError(f"{name} is {value!r}; needs a whole number of at least {least}.")

    def directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """One direction in common coordinates."""
        dtype = a.control_points.dtype
        # Closer than a few times the error of the common coordinates the bounds cannot get.
        floor = jnp.asarray(_FLOOR * evaluation_error(a, b), dtype)
        if self.atol is None:
            rows = jnp.concatenate([a.control_points.reshape(-1, a.dim), b.control_points.reshape(-1, a.dim)])
            diagonal = jnp.sqrt(jnp.sum((jnp.max(rows, axis=0) - jnp.min(rows, axis=0)) ** 2))
            atol = jnp.maximum(max(_DEFAULT, 64 * float(jnp.finfo(dtype).eps)) * diagonal, floor)
        else:
            atol = jnp.ldexp(self.atol.astype(dtype), -(frame.first + frame.second))
        tolerances = _Tolerances(atol, self.rtol.astype(dtype), floor)
        return _search(a, b, tolerances, aim, self.max_steps, max(self.capacity, 2 * a.count))


class _Tolerances(NamedTuple):
    """What was asked for, in the common coordinates, and what can be reached."""

    atol: Array
    rtol: Array
    floor: Array

    def wanted(self, distance: Array) -> Array:
        """The tolerance at a distance."""
        return jnp.maximum(self.atol, self.rtol * distance)


class _Table(NamedTuple):
    cell: Cell
    upper: Array  # -inf where free


class _Seeds(NamedTuple):
    """Samples of b: (samples, dim) points, their segments and parameters."""

    points: Array
    segment: Array
    s: Array


class _State(NamedTuple):
    table: _Table
    lower: Array
    value: Array
    at: Place
    foot: Place
    closed: Array  # largest upper bound of the cells that were closed or dropped
    dropped: Array
    pending: Place  # a place of a to be measured in the first step
    steps: Array


def _search(
    a: BezierSegments, b: BezierSegments, tolerances: _Tolerances, aim: Aim, max_steps: int, capacity: int
) -> HausdorffSolution:
    dtype = a.control_points.dtype
    skip_b = repeated(b.control_points, b.weights)
    error = evaluation_error(a, b)
    seeds = _seeds(b)
    state = _start(a, b, seeds, error, capacity)

    def goal(state: _State) -> Array:
        return jnp.maximum(aim.level, state.lower + jnp.maximum(tolerances.floor, tolerances.wanted(state.lower)))

    def unfinished(state: _State) -> Array:
        open_ = (jnp.max(state.table.upper) > goal(state)) & (state.lower <= aim.ceiling)
        return open_ & (state.steps < max_steps)

    def step(state: _State) -> _State:
        taken, uppers, rest = _largest(state.table)
        found = jax.vmap(lambda c: cell_upper_bound(a, b, c))(taken)
        upper = jnp.minimum(uppers, found.upper + error)
        live = upper > goal(state)
        # The most promising place is measured where it can raise the lower bound.
        hope = jnp.where(live, found.distance, -jnp.inf)
        best = jnp.argmax(hope)
        first = state.steps == 0
        segment = jnp.where(first, state.pending[0], taken.segment[best])
        t = jnp.where(first, state.pending[1], found.t[best])
        point = jet(*piece_of(a, segment), t).point
        wanted = first | (hope[best] > state.lower)
        measured = nearest(point, b.control_points, b.weights, jnp.where(wanted, 0.0, jnp.inf), skip_b)
        raised = wanted & (measured.distance > state.value)
        state = state._replace(
            lower=jnp.where(wanted, jnp.maximum(measured.lower - error, state.lower), state.lower),
            value=jnp.where(raised, measured.distance, state.value),
            at=_where(raised, Place(segment, t), state.at),
            foot=_where(raised, Place(measured.segment, measured.t), state.foot),
            steps=state.steps + 1,
        )
        mine = (jnp.arange(_LANES) == best) & wanted & ~first
        return _pushed(a, b, seeds, state._replace(table=rest), goal(state), taken, upper, found, mine, measured)

    state = jax.lax.while_loop(unfinished, step, state)
    left = jnp.max(state.table.upper)
    upper = jnp.maximum(jnp.maximum(left, state.closed), state.lower)
    lower = state.lower
    # Four units for the rounding of this comparison itself.
    gap = upper - jnp.maximum(lower, aim.level)
    closed = gap <= tolerances.wanted(upper) * (1 + 4 * jnp.finfo(dtype).eps)
    result = result_where(closed, RESULTS.successful, RESULTS.gap_not_closed)
    result = result_where(~closed & state.dropped, RESULTS.capacity_reached, result)
    witness = describe(a, b, state.at, state.foot, jnp.ones((), dtype))
    stats = {"steps": state.steps, "cells": state.steps * _LANES}
    value = jnp.clip(state.value, lower, upper)
    return HausdorffSolution(value, lower, upper, witness, result, stats)


def _where(condition: Array, new: Place, old: Place) -> Place:
    return Place(*(jnp.where(condition, x, y) for x, y in zip(new, old, strict=True)))


def _seeds(b: BezierSegments) -> _Seeds:
    """Samples of b; the nearest of them starts the search of a foot."""
    samples = jnp.linspace(0.0, 1.0, _SEEDS + 1, dtype=b.control_points.dtype)
    points = jax.vmap(lambda k: jax.vmap(lambda s: jet(*piece_of(b, k), s).point)(samples))(jnp.arange(b.count))
    return _Seeds(points.reshape(-1, b.dim), jnp.repeat(jnp.arange(b.count), samples.size), jnp.tile(samples, b.count))


def _start(a: BezierSegments, b: BezierSegments, seeds: _Seeds, error: float, capacity: int) -> _State:
    """One cell for each segment of a, with feet found from samples of b and a first upper bound."""
    dtype = a.control_points.dtype
    ends = a.control_points[:, jnp.array([0, -1])]

    def foot(point: Array) -> tuple[Array, Array, Array]:
        index = jnp.argmin(jnp.sum((seeds.points - point) ** 2, axis=-1))
        piece = piece_of(b, seeds.segment[index])
        s = local_foot(point, piece, seeds.s[index], _SEED_STEPS)
        return seeds.segment[index], s, jnp.sqrt(jnp.sum((jet(*piece, s).point - point) ** 2))

    k, s, distance = jax.vmap(jax.vmap(foot))(ends)
    count, zeros = a.count, jnp.zeros((a.count,), dtype)
    cell = Cell(jnp.arange(count), zeros, zeros + 1, k[:, 0], s[:, 0], k[:, 1], s[:, 1])
    upper = jax.vmap(lambda c: first_upper_bound(a, b, c))(cell) + error
    upper = jnp.where(repeated(a.control_points, a.weights), -jnp.inf, upper)
    table = _Table(
        Cell(*(jnp.pad(x, (0, capacity - count)) for x in cell)),
        jnp.pad(upper, (0, capacity - count), constant_values=-jnp.inf),
    )
    at = jnp.argmax(distance)
    pending = Place(at // 2, (at % 2).astype(dtype))
    none = jnp.array(-jnp.inf, dtype)
    zero = jnp.array(0)
    # Until a place is measured the first one of a stands for it; its foot is met among the local ones.
    start = Place(zero, zeros[0])
    return _State(table, zeros[0], none, start, start, none, jnp.array(False), pending, zero)


def _largest(table: _Table) -> tuple[Cell, Array, _Table]:
    """The cells with the largest upper bounds, and the table without them."""
    upper, index = jax.lax.top_k(table.upper, _LANES)
    return Cell(*(x[index] for x in table.cell)), upper, table._replace(upper=table.upper.at[index].set(-jnp.inf))


def _pushed(
    a: BezierSegments,
    b: BezierSegments,
    seeds: _Seeds,
    state: _State,
    goal: Array,
    cell: Cell,
    upper: Array,
    found: CellBound,
    mine: Array,
    measured: Nearest,
) -> _State:
    """Cuts the cells, gives the cuts their feet, and puts the halves that are still above the goal into the table."""
    width = cell.t1 - cell.t0
    at_left = found.t <= cell.t0 + _NEAR_END * width
    at_right = found.t >= cell.t1 - _NEAR_END * width
    cut = jnp.where(at_left | at_right, cell.t0 + 0.5 * width, found.t)

    def foot(segment: Array, t: Array, ks: Array, ss: Array) -> tuple[Array, Array]:
        point = jet(*piece_of(a, segment), t).point
        seed = jnp.argmin(jnp.sum((seeds.points - point) ** 2, axis=-1))
        ks, ss = jnp.append(ks, seeds.segment[seed]), jnp.append(ss, seeds.s[seed])
        ss = jax.vmap(lambda k, s: local_foot(point, piece_of(b, k), s, _SEED_STEPS))(ks, ss)
        feet = jax.vmap(lambda k, s: jet(*piece_of(b, k), s).point)(ks, ss)
        best = jnp.argmin(jnp.sum((feet - point) ** 2, axis=-1))
        return ks[best], ss[best]

    # The proven foot is offered to all cells: several of them may follow the same wrong one.
    near = (jnp.full_like(cell.k0, measured.segment), jnp.full_like(cell.s0, measured.t))
    starts = [
        jnp.stack(x, axis=1) for x in ((found.k, cell.k0, cell.k1, near[0]), (found.s, cell.s0, cell.s1, near[1]))
    ]
    at_both = jax.vmap(jax.vmap(foot), in_axes=(None, 0, None, None))
    (k, peak_k), (s, peak_s) = at_both(cell.segment, jnp.stack([cut, found.t]), *starts)
    # The measured foot is proven to be the nearest.
    peak_k, peak_s = jnp.where(mine, measured.segment, peak_k), jnp.where(mine, measured.t, peak_s)
    inside = ~at_left & ~at_right
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
    waits = ~inside & (found.distance > state.lower) & ~mine
    end = (jnp.where(waits, old, new) for old, new in ((cell.t1, cut), (cell.k1, k), (cell.s1, s)))
    left = cell._replace(**dict(zip(("t1", "k1", "s1"), end, strict=True)))
    right = cell._replace(t0=cut, k0=k, s0=s)
    halves = Cell(*(jnp.concatenate(pair) for pair in zip(left, right, strict=True)))
    uppers = jnp.concatenate([upper, jnp.where(waits, -jnp.inf, upper)])
    # A cell of a few ulp cannot be cut again.
    open_ = (uppers > goal) & (jnp.tile(width, 2) > 8 * jnp.finfo(width.dtype).eps)
    closed = jnp.maximum(state.closed, jnp.max(jnp.where(open_, -jnp.inf, uppers)))
    new = jnp.where(open_, uppers, -jnp.inf)
    negated, slots = jax.lax.top_k(-state.table.upper, 2 * _LANES)
    old = -negated
    # Where the table is full the smaller bound of the two makes room: it is folded into the result.
    stays = old >= new
    lost = jnp.max(jnp.minimum(old, new))
    table = _Table(
        Cell(*(x.at[slots].set(jnp.where(stays, x[slots], y)) for x, y in zip(state.table.cell, halves, strict=True))),
        state.table.upper.at[slots].set(jnp.maximum(old, new)),
    )
    return state._replace(table=table, closed=jnp.maximum(closed, lost), dropped=state.dropped | (lost > goal))
