"""Runs a method on a pair: under tracing in one program, else from the host, which can report, stop and make room.

On the host a search goes in stretches of a bounded number of steps. Between two of them Python hears Ctrl-C, progress
is reported, and a table that is about to be full is exchanged for a longer one.
"""

import time
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arrays import is_traced
from jhd.compiled import compiled
from jhd.distance.cells.branches import Cell
from jhd.distance.frame.method import AbstractHausdorffMethod, AbstractHostMethod, Aim
from jhd.distance.frame.pieces import Place
from jhd.distance.frame.prepare import Frame
from jhd.distance.search import solutions as surface_solution
from jhd.distance.search import surfaces as surface_search
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.curves import State, Table, Wanted, advance, begin, solution_of, unfinished
from jhd.distance.search.solutions import Pair
from jhd.shapes.curve import BezierSegments
from jhd.solution import RESULTS, HausdorffSolution, name_of

# Steps of the first stretch, which hold all but hard pairs, and the seconds that later ones are made to last.
_FIRST_STEPS, _SECONDS = 128, 0.2
# The table grows by this factor.
_GROWTH = 4


class Progress(NamedTuple):
    """How far a search has come; bounds in the unit of the coordinates.

    Args:
        direction: the name of a member of DIRECTIONS.
        steps: steps taken in this direction.
        waiting: cells whose upper bounds are still to be lowered.
        lower: proven lower bound of this directed distance.
        upper: proven upper bound of it.
    """

    direction: str
    steps: int
    waiting: int
    lower: float
    upper: float


class Host:
    """What the host is to do between the stretches of the searches of one call, and whether it was interrupted.

    Args:
        frame: leads back to the user's coordinates.
        progress: called with a Progress after each stretch, or None.
    """

    def __init__(self, frame: Frame, progress: Callable[[Progress], Any] | None = None):
        self.frame, self.progress, self.interrupted = frame, progress, False

    def run(
        self, method: AbstractHausdorffMethod, a: BezierSegments, b: BezierSegments, aim: Aim, direction: Any
    ) -> HausdorffSolution:
        """The directed distance from a to b, in the common coordinates of the frame."""
        # Inside jit all operations are traced, those on known numbers too.
        if is_traced(a, b, method, aim, jnp.zeros(())):
            return method.directed(a, b, self.frame, aim)
        if isinstance(method, BranchAndBound):
            wanted = method.wanted(a, self.frame, aim)
            state = _blank(method.length_of_table(a), np.dtype(a.control_points.dtype).name)
            return self._in_stretches(partial(_stretch, a, b, wanted), state, _longer, method.max_steps, direction)
        run = method.directed if isinstance(method, AbstractHostMethod) else partial(_in_one_go, method)
        solution = run(a, b, self.frame, aim)
        self._report(direction, solution, 0)
        return solution

    def run_surfaces(self, method: BranchAndBound, pair: Pair, aim: Aim, direction: Any) -> HausdorffSolution:
        """The directed distance of a pair of surfaces, in the common coordinates of the frame."""
        if is_traced(pair, method, aim, jnp.zeros(())):
            return method.directed_surfaces(pair, self.frame, aim, direction)
        wanted, capacity = method.wanted(pair.a, self.frame, aim), method.length_of_table(pair.a)
        state = _blank_surfaces(capacity, np.dtype(pair.a.side.lower.dtype).name)
        stretch = partial(_surface_stretch, pair, wanted, direction)
        return self._in_stretches(stretch, state, lambda state: state, method.max_steps, direction)

    def _in_stretches(
        self,
        advanced: Callable[..., Any],
        state: Any,
        longer: Callable[[Any], Any],
        max_steps: int,
        direction: Any,
    ) -> HausdorffSolution:
        """The search from a state that is to be begun in, with more room wherever it is about to be full.

        Args:
            advanced: state, whether it is fresh, limit of steps and whether to stop before it is full -> state,
                solution, and three numbers: whether it is unfinished, cells that wait, and steps.
            state: of the right shapes.
            longer: the same state with more room.
            max_steps: most steps.
            direction: a member of DIRECTIONS.
        """
        solution, fresh, steps, stretch = None, True, 0, _FIRST_STEPS
        while True:
            # After an interruption the other direction gets the bounds it begins with.
            limit = 0 if self.interrupted else min(steps + stretch, max_steps)
            began = time.perf_counter()
            try:
                state, solution, news = advanced(state, fresh, limit, not self.interrupted)
                going_on, waiting, taken = np.asarray(news)
                seconds = time.perf_counter() - began
                self._report(direction, solution, int(waiting))
            except KeyboardInterrupt:
                if solution is None:
                    raise
                self.interrupted = True
                break
            if not going_on or taken >= limit == max_steps or self.interrupted:
                break
            if not fresh:
                stretch = max(1, int(stretch * min(4.0, _SECONDS / seconds)))
            if taken < limit:
                state = longer(state)
            steps, fresh = int(taken), False
        if self.interrupted and name_of(solution.result) != "successful":
            solution = eqx.tree_at(lambda s: s.result, solution, RESULTS.interrupted)
        return solution

    def _report(self, direction: Any, solution: HausdorffSolution, waiting: int) -> None:
        if self.progress is None:
            return
        lower, upper = self.frame.length(solution.lower, 0.0), self.frame.length(solution.upper, np.inf)
        steps = int(solution.stats.get("steps", 0))
        self.progress(Progress(name_of(direction), steps, waiting, float(lower), float(upper)))


@compiled
def _stretch(
    a: BezierSegments, b: BezierSegments, wanted: Wanted, state: State, fresh: Array, limit: Array, growing: Array
) -> tuple[State, HausdorffSolution, Array]:
    """Begins the search if it is fresh, goes on for some steps, and says whether it is unfinished, and two counts."""
    capacity = state.table.upper.size
    state = jax.lax.cond(fresh, lambda _: begin(a, b, capacity), lambda state: state, state)
    state = advance(a, b, wanted, state, limit, growing)
    news = jnp.stack([unfinished(a, b, wanted, state).astype(int), state.waiting, state.steps])
    return state, solution_of(a, b, wanted, state), news


@lru_cache(maxsize=8)
def _blank(capacity: int, dtype: str) -> State:
    """A state of the right shapes, to begin in."""
    numbers, index = jnp.zeros(capacity, dtype), jnp.zeros(capacity, int)
    cell = Cell(index, numbers, numbers, index, numbers, index, numbers)
    number, count = jnp.zeros((), dtype), jnp.array(0)
    place = Place(count, number)
    return State(Table(cell, numbers), number, number, place, place, number, jnp.array(False), place, count)


@compiled
def _surface_stretch(
    pair: Pair, wanted: Wanted, direction: Any, state: surface_search.State, fresh: Array, limit: Array, _: Array
) -> tuple[surface_search.State, HausdorffSolution, Array]:
    """The same for surfaces, whose table stays as long as it is: more of it than that hardly helps."""
    capacity = state.table.bound.size
    state = jax.lax.cond(fresh, lambda _: surface_search.begin(pair.a, pair.b, capacity), lambda state: state, state)
    state, going_on = surface_solution.advanced(pair, wanted, state, limit)
    news = jnp.stack([going_on.astype(int), state.waiting, state.steps])
    return state, surface_solution.solution_of(pair, wanted, state, direction), news


@lru_cache(maxsize=8)
def _blank_surfaces(capacity: int, dtype: str) -> surface_search.State:
    return surface_search.blank(capacity, dtype)


@compiled
def _in_one_go(
    method: AbstractHausdorffMethod, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim
) -> HausdorffSolution:
    return method.directed(a, b, frame, aim)


def _longer(state: State) -> State:
    """The same search with more room."""
    more = (_GROWTH - 1) * state.table.upper.size
    cell = Cell(*(jnp.pad(x, (0, more)) for x in state.table.cell))
    upper = jnp.pad(state.table.upper, (0, more), constant_values=-jnp.inf)
    return state._replace(table=Table(cell, upper))
