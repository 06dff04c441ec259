"""A search by two kinds of bounds in turn: what each is given, and that the second knows what the first found."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.cells.pairs import BestPair, Cell, PairBound
from jhd._distance.cells.tracked_feet import WithMovingFeet
from jhd._distance.search import two_phase_minimum
from jhd._distance.search.closest import ClosestState, WantedGap, longer, table_of
from jhd._distance.search.two_phase_minimum import _FIRST_TURN, _LONGEST, FollowedPairs, InTurn

FOUND, TOLERANCE = 4.0, 1e-2


class Shapes(NamedTuple):
    floor: float = 0.0


def table(length=64):
    """One with a single pair."""
    zeros: Any = jnp.zeros
    cells = Cell(zeros(1, int), zeros(1, int), zeros((1, 2)), 1 + zeros((1, 2)))
    best = BestPair(zeros(()) + FOUND, zeros(()) + FOUND, zeros((), int), zeros((), int), zeros(2))
    return table_of(zeros(1), cells, zeros(1, int), best, length)


def bounds(shapes, count, piece_a, piece_b, low, high):
    """A family: the bound of a cell is short by the square of its width along the first parameter."""
    width = high[:, 0] - low[:, 0]
    upper: Any = np.full(len(width), FOUND + 1)
    thin: Any = np.zeros(len(width), bool)
    extent: Any = np.stack([width, np.full(len(width), -1.0)], axis=1)
    return PairBound(FOUND - width**2, upper, upper, low, Cell(piece_a, piece_b, low, high), extent, thin)


def search(monkeypatch, first=10**6, max_steps=10**6):
    """One whose first kind closes after so many steps; it writes down what the first was asked for."""
    asked = []

    def stretch(table, limit, growing):
        asked.append(int(limit))
        going = int(limit) < first
        return table._replace(steps=jnp.asarray(limit)), "first", np.array([going, False, limit, 1])

    monkeypatch.setattr(two_phase_minimum, "_bounds", bounds)
    # No bounds by feet besides.
    monkeypatch.setattr(two_phase_minimum, "_followed", lambda _, pairs: (np.zeros(len(pairs.x)), pairs.extent))
    monkeypatch.setattr(two_phase_minimum, "_with_feet", lambda shapes, best: WithMovingFeet)
    wanted = WantedGap(*map(jnp.asarray, (TOLERANCE, 0.0, True, max_steps)))
    shown: Any = lambda reached: reached  # noqa: E731
    return InTurn(table, stretch, lambda best: Shapes(), lambda best: best, shown, wanted), asked


def test_what_closes_in_the_first_turn_has_no_second(monkeypatch):
    searched, asked = search(monkeypatch, first=100)
    state, standing = searched.advance(searched.begin(), 64, True)
    assert standing.going_on
    state, standing = searched.advance(state, 10_000, True)
    assert not standing.going_on and isinstance(state, ClosestState)
    assert asked == [64, _FIRST_TURN]


def test_no_more_steps_than_the_first_turn_has_leave_it_at_that(monkeypatch):
    searched, asked = search(monkeypatch)
    state, standing = searched.advance(searched.begin(), _FIRST_TURN, True)
    assert isinstance(state, ClosestState) and standing.going_on
    # None at all, as where the search is interrupted.
    state, _ = searched.advance(state, 0, False)
    assert isinstance(state, ClosestState) and asked[-1] == 0


@pytest.mark.parametrize("full", [False, True])
def test_the_second_kind_begins_with_all_pairs_and_knows_what_the_first_found(monkeypatch, full):
    searched, _ = search(monkeypatch)
    begun = table(_LONGEST if full else 64)
    best = begun.best._replace(upper=jnp.asarray(3.9), distance=jnp.asarray(2.0))
    found = begun._replace(
        lower=begun.lower.at[0].set(1.5), best=best, steps=jnp.asarray(_FIRST_TURN), pairs=jnp.asarray(7)
    )
    if full:
        found = found._replace(steps=jnp.asarray(100), lower=jnp.full_like(found.lower, 1.5))
    assert searched.longer(found).lower.size == (_LONGEST if full else longer(found).lower.size)
    state: Any = searched.advance(found, _FIRST_TURN + 1, True)[0]
    assert isinstance(state, FollowedPairs)
    assert np.all(state.cell.high[:, 0] - state.cell.low[:, 0] <= 0.5) and np.all(state.lower >= 1.5)
    assert float(state.best.upper) == 3.9 and state.pairs >= 9


def test_the_second_kind_closes_a_family_and_takes_no_more_steps_than_it_may(monkeypatch):
    searched, _ = search(monkeypatch)
    state: Any = searched.advance(searched.begin(), _FIRST_TURN, True)[0]
    steps = _FIRST_TURN
    for limit in (_FIRST_TURN + 1, _FIRST_TURN + 3, 10**6):
        state, standing = searched.advance(state, limit, True)
        assert steps < standing.steps <= limit
        steps = standing.steps
        reached = standing.solution
        assert reached.waiting == standing.waiting == len(state.lower)
        assert reached.lower == min(np.min(state.lower, initial=np.inf), state.settled) <= FOUND
    # Cells of a sixteenth are the first whose bounds are within nine tenths of the tolerance.
    assert not standing.going_on and standing.waiting == 0
    assert FOUND - TOLERANCE <= reached.lower == FOUND - 1 / 256
    assert reached.pairs == 2 * 15 and steps == _FIRST_TURN + 4


def test_a_pair_that_is_closed_by_a_nearer_best_one_still_counts(monkeypatch):
    searched, _ = search(monkeypatch)
    state: Any = searched.advance(table()._replace(steps=jnp.asarray(_FIRST_TURN)), _FIRST_TURN + 1, True)[0]
    # Of two pairs one is within the tolerance of the best pair; the other one closes at once.
    close = FOUND - 0.5 * TOLERANCE
    state = state._replace(lower=np.array([1.0, close]))
    monkeypatch.setattr(two_phase_minimum, "_bounds", lambda *x: bounds(*x)._replace(lower=np.full(len(x[2]), FOUND)))
    state, standing = searched.advance(state, 10**6, True)
    assert standing.waiting == 0 and standing.solution.lower == close


def test_a_family_that_needs_far_more_steps_than_are_left_is_given_up(monkeypatch):
    searched, _ = search(monkeypatch, max_steps=2000)
    state: Any = searched.advance(table()._replace(steps=jnp.asarray(_FIRST_TURN)), _FIRST_TURN + 1, True)[0]
    for count, going in ((1, True), (10**6, False)):
        late = state._replace(steps=1100, lower=np.repeat(state.lower[:1], count))
        problem: Any = WithMovingFeet(Shapes())  # pyright: ignore[reportArgumentType]
        assert searched._is_going(problem, late) == going
