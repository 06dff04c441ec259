"""A search in two turns: what each is given, and that the second begins once, with what is known."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jhd.distance.cells.pairs import BestPair, Cell
from jhd.distance.search.closest import table_of
from jhd.distance.search.in_turn import _FIRST_TURN, InTurn


def table(length=64):
    """One with a single pair."""
    zeros: Any = jnp.zeros
    cells = Cell(zeros(1, int), zeros(1, int), zeros((1, 6)), 1 + zeros((1, 6)))
    best = BestPair(zeros(()), zeros(()), zeros((), int), zeros((), int), zeros(6))
    return table_of(zeros(1), cells, zeros(1, int), best, length)


def search(close_at, max_steps=10**6):
    """One that counts steps, closes after so many, and writes down what its turns were asked for."""
    asked = []

    def turn(name):
        def stretch(table, limit, growing):
            asked.append((name, int(table.steps), int(limit)))
            steps = min(int(limit), close_at)
            return table._replace(steps=jnp.asarray(steps)), name, np.array([steps < close_at, False, steps, 1])

        return stretch

    def afresh(table):
        asked.append(("afresh", int(table.steps)))
        return table

    return InTurn(table, turn("first"), afresh, turn("second"), max_steps), asked


def run(searched, limits):
    state = searched.begin()
    for limit in limits:
        state, standing = searched.advance(state, limit, True)
    return state, standing


def test_what_closes_in_the_first_turn_has_no_second():
    searched, asked = search(100)
    _, standing = run(searched, [64, 10_000])
    assert not standing.going_on and standing.steps == 100
    assert [name for name, *_ in asked] == ["first", "first"]


def test_the_second_turn_begins_once_where_the_first_one_ends():
    searched, asked = search(10_000)
    state, standing = run(searched, [64, 5_000, 5_000, 20_000])
    assert state.second and not standing.going_on and standing.steps == 10_000
    assert asked == [
        ("first", 0, 64),
        ("first", 64, _FIRST_TURN),
        ("afresh", _FIRST_TURN),
        ("second", _FIRST_TURN, 5_000),
        ("second", 5_000, 20_000),
    ]


def test_no_more_steps_than_the_first_turn_has_leave_it_at_that():
    searched, asked = search(10_000)
    state, standing = run(searched, [_FIRST_TURN, _FIRST_TURN, 0])
    assert not state.second and standing.going_on
    assert ("afresh", _FIRST_TURN) not in asked


def test_a_longer_table_is_that_of_the_turn_it_is_in():
    begun = table()
    searched, _ = search(100)
    grown = searched.longer(searched.begin()._replace(table=begun, second=True))
    assert grown.second and grown.table.lower.size > begun.lower.size
