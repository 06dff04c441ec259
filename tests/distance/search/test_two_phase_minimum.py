"""A search by two kinds of bounds in turn: what each is given, and that the second knows what the first found."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jhd._distance.cells.pairs import BestPair, Cell
from jhd._distance.search.closest import table_of
from jhd._distance.search.two_phase_minimum import _FIRST_TURN, InTurn


def table(length=64):
    """One with a single pair."""
    zeros: Any = jnp.zeros
    cells = Cell(zeros(1, int), zeros(1, int), zeros((1, 6)), 1 + zeros((1, 6)))
    best = BestPair(zeros(()) + 4, zeros(()) + 4, zeros((), int), zeros((), int), zeros(6))
    return table_of(zeros(1), cells, zeros(1, int), best, length)


def search(first=10**6, second=10**6, max_steps=10**6):
    """One whose kinds close after so many steps of their own; it writes down what they were asked for."""
    asked = []
    own = {"first": 0, "second": 0}

    def kind(name, close_at):
        def stretch(table, limit, growing):
            began = int(table.steps)
            own[name] += int(limit) - began
            asked.append((name, began, int(limit)))
            return table._replace(steps=jnp.asarray(limit)), name, np.array([own[name] < close_at, False, limit, 1])

        return stretch

    return InTurn(table, kind("first", first), kind("second", second), max_steps), asked


def run(searched, limits):
    state = searched.begin()
    for limit in limits:
        while True:
            state, standing = searched.advance(state, limit, True)
            if not standing.going_on or standing.steps >= limit:
                break
        if not standing.going_on:
            break
    return state, standing


def test_what_closes_in_the_first_turn_has_no_second():
    searched, asked = search(first=100)
    _, standing = run(searched, [64, 10_000])
    assert not standing.going_on
    assert asked == [("first", 0, 64), ("first", 64, _FIRST_TURN)]


def test_the_second_kind_goes_on_to_the_end():
    searched, asked = search(second=3000, max_steps=5000)
    _, standing = run(searched, [600, 3000, 5000])
    assert not standing.going_on
    assert asked == [("first", 0, 512), ("second", 512, 600), ("second", 600, 3000), ("second", 3000, 5000)]


def test_no_more_steps_than_the_first_turn_has_leave_it_at_that():
    searched, asked = search()
    state, standing = run(searched, [_FIRST_TURN])
    assert state.kind == 0 and standing.going_on
    # None at all, as where the search is interrupted.
    state, _ = searched.advance(state, 0, False)
    assert state.kind == 0 and asked[-1] == ("first", _FIRST_TURN, 0)


def test_the_second_kind_has_a_table_of_its_own_and_knows_what_the_first_found():
    begun = table()
    searched, _ = search()
    state = searched.begin()
    best = begun.best._replace(upper=jnp.asarray(3.0), distance=jnp.asarray(2.0))
    found = begun._replace(
        lower=begun.lower.at[0].set(1.5), best=best, steps=jnp.asarray(_FIRST_TURN), pairs=jnp.asarray(7)
    )
    state, _ = searched.advance(state._replace(table=found), 600, True)
    assert state.kind == 1
    assert float(state.table.lower[0]) == 1.5 and np.isinf(np.asarray(state.table.lower[1:])).all()
    assert float(state.table.best.upper) == 3.0 and int(state.table.pairs) == 7
    grown = searched.longer(state)
    assert grown.table.lower.size > begun.lower.size
