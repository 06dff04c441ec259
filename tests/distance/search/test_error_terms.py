"""What both curves may have been moved by widens every bound of a search, by all of it.

A distance changes by at most the sum of what the curves are moved by, and by as much where they move apart. Here that
sum is a number that no rounding hides, and what is measured is one.
"""

from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.cells.branches import CurveBound
from jhd._distance.nearest.chords import chords_between
from jhd._distance.nearest.curves import NearestOnCurve
from jhd._distance.nearest.near_curve import NearCurve
from jhd._distance.normalization.pieces import CurvePlace
from jhd._distance.normalization.stopping import Wanted, aim_at
from jhd._distance.search import curves as search
from jhd._distance.search import refined_witness
from jhd._shapes.unchecked import trusted

MOVED = 0.125
WANTED = Wanted(jnp.array(1e-9), jnp.array(0.0), aim_at(None, None, np.float64))


class OneAway(NearCurve):
    """A curve all of whose points are one away from wherever one asks."""

    def starts(self, points):
        zeros = jnp.zeros(points.shape[:-1])
        return CurvePlace(zeros.astype(int), zeros)

    def nearest(self, point, tolerance=0.0):
        one, zero = jnp.ones(()), jnp.array(0)
        return NearestOnCurve(one, one, one, zero, 0.5 * one, jnp.array(True), zero)


def one_away(curve):
    guide: Any = None
    # A run as straight as can be, so that its bound counts in steps too.
    points = curve.control_points
    runs = chords_between(points[:, 0], points[:, -1], points)
    return OneAway(curve, jnp.zeros(1, bool), guide, runs)


@pytest.fixture
def a(monkeypatch):
    """A segment, while all bounds of its cells are one but for what the curves are moved by."""
    one = jnp.ones(())
    for module in (search, refined_witness):
        monkeypatch.setattr(module, "evaluation_error", lambda a, b: MOVED)
    monkeypatch.setattr(search, "cell_upper_bound", lambda a, b, c, runs: CurveBound(one, 0.5 * one, one, c.k0, c.s0))
    monkeypatch.setattr(search, "first_upper_bound", lambda a, b, c, runs: one)
    monkeypatch.setattr(search, "_first_foot", lambda b, x, s: (s.segment, s.t, one))
    return trusted(jnp.array([[[0.0, 0.0], [1.0, 0.0]]]), None, jnp.array([-1]))


def bounds(state):
    return state.lower, state.upper


def begun(a):
    return search.begin(a, one_away(a), WANTED, 2 * search.LANES)


@pytest.mark.parametrize("long", (False, True))
def test_the_first_bounds_of_cells_are_widened(a, long, monkeypatch):
    monkeypatch.setattr(search, "Blocks", object if long else int)
    lower, upper = jax.jit(lambda: bounds(begun(a)))()
    assert float(upper) == 1 + MOVED
    assert float(lower) == (1 - MOVED if long else 0.0)


def test_the_bounds_of_a_step_are_widened(a, monkeypatch):
    def closed(a, near, state, goal, taken, upper, found, mine, measured):
        return state._replace(closed=jnp.max(upper))

    def step():
        state, near = begun(a), one_away(a)
        # Were the first bounds not larger, those of the step would not show.
        table = state.table._replace(upper=jnp.where(state.table.upper > 0, 2.0, -jnp.inf))
        return bounds(search.advance(a, near, WANTED, state._replace(table=table), 1))

    monkeypatch.setattr(search, "_pushed", closed)
    lower, upper = jax.jit(step)()
    assert float(upper) == 1 + MOVED
    assert float(lower) == 1 - MOVED


def test_the_lower_bound_of_a_polished_witness_is_widened(a, monkeypatch):
    system, places = SimpleNamespace(two=jnp.array(False), pieces=()), (jnp.zeros(2), jnp.zeros((2, 2)))
    stays = SimpleNamespace(
        active=lambda *_: system,
        polished=lambda y, _: y,
        places=lambda *_: places,
        balance=lambda y, s, held: (held, None),
    )
    monkeypatch.setattr(refined_witness, "active", stays)
    # The feet need not agree with the distance.
    monkeypatch.setattr(refined_witness, "_AGREEING", 1e30)

    def polished():
        state, near = begun(a), one_away(a)
        witness = jax.eval_shape(lambda: refined_witness.describe(a, a, state.at, state.foot).witness())
        witness = jax.tree_util.tree_map(lambda x: jnp.zeros(x.shape, x.dtype), witness)
        place = refined_witness.SearchedPlace(state.at, state.foot, state.value, state.lower, state.upper)
        return refined_witness._polished(a, near, witness, place)[1:3]

    value, lower = jax.jit(polished)()
    assert float(value) == 1.0
    assert float(lower) == 1 - MOVED


def test_cells_that_a_full_table_loses_stay_in_the_upper_bound(a, monkeypatch):
    monkeypatch.setattr(search, "_FLOOR", 0)

    def bound_without_the_table():
        state, near = begun(a), one_away(a)
        # The four largest leave the table; their eight halves find four free rows.
        whole, real = (jnp.tile(x[:1], (2 * search.LANES, 1)) for x in state.table[:2])
        table = search.CurveTable(whole, real, jnp.arange(2.0, 2.0 + 2 * search.LANES))
        state = search.advance(a, near, WANTED, state._replace(table=table), 1)
        free = jnp.full_like(state.table.upper, -jnp.inf)
        return state._replace(table=state.table._replace(upper=free)).upper, state.dropped

    upper, dropped = jax.jit(bound_without_the_table)()
    assert float(upper) == 1 + MOVED
    assert bool(dropped)
