"""Searches for the farthest point, in stretches of one compiled function: for curves and for implicit surfaces."""

from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._distance.nearest.blocks import is_long
from jhd._distance.nearest.near_curve import near_curve
from jhd._distance.normalization.pieces import CurvePlace
from jhd._distance.normalization.stopping import Wanted
from jhd._distance.search import solutions as surface_solution
from jhd._distance.search import surfaces as surface_search
from jhd._distance.search.curves import LANES, CurveState, CurveTable, advance, begin, solution_of, unfinished
from jhd._distance.search.search import AbstractSearch, Standing
from jhd._distance.search.solutions import CoveredPair
from jhd._results.solution import HausdorffSolution, in_direction, on_device
from jhd._runtime.compiled import compiled
from jhd._shapes.curve import BezierSegments

# Steps of the first stretch, which hold all but hard pairs of curves.
_FIRST_STEPS = 128
# Steps of the first stretch for surfaces; each later step takes a third longer (two cones take 19 and 27 steps).
_FIRST_STEPS_OF_SURFACES = 64
# The table grows by this factor.
_GROWTH = 4


class CurveSearch(AbstractSearch):
    """The search of jhd._distance.search.curves; its state is a table state, and whether it has not begun yet.

    Args:
        a: the curve whose farthest point is searched, in common coordinates.
        b: the curve that distances are taken to.
        wanted: tolerances and aim.
        direction: a member of DIRECTIONS.
        capacity: length of the table at first.
        max_steps: most steps.
    """

    first_steps = _FIRST_STEPS

    def __init__(
        self, a: BezierSegments, b: BezierSegments, wanted: Wanted, direction: Any, capacity: int, max_steps: int
    ):
        self._asked, self._capacity, self.max_steps = (a, b, wanted, direction), capacity, max_steps

    @override
    def begin(self) -> tuple[CurveState, bool]:
        """Return an empty state: the compiled function of the first stretch does the work."""
        return _blank(self._capacity, np.dtype(self._asked[0].control_points.dtype).name), True

    @override
    def advance(
        self, state: tuple[CurveState, bool], limit: int, growing: bool
    ) -> tuple[tuple[CurveState, bool], Standing]:
        table, solution, news = _stretch(*self._asked, *state, limit, growing)
        return (table, False), Standing(solution, *np.asarray(news))

    @override
    def longer(self, state: tuple[CurveState, bool]) -> tuple[CurveState, bool]:
        table = state[0].table
        # If no step was taken, cells were left out for lack of room: it begins anew.
        longer = table.longer((_GROWTH - 1) * table.upper.size)
        return state[0]._replace(table=longer), int(state[0].steps) == 0


class SurfaceSearch(AbstractSearch):
    """The search for surfaces. Its table keeps its length: a longer table hardly helps.

    Args:
        pair: both surfaces in common coordinates.
        wanted: tolerances and aim.
        direction: a member of DIRECTIONS.
        capacity: length of the table.
        max_steps: most steps.
    """

    first_steps = _FIRST_STEPS_OF_SURFACES

    def __init__(self, pair: CoveredPair, wanted: Wanted, direction: Any, capacity: int, max_steps: int):
        self._asked, self._capacity, self.max_steps = (pair, wanted, direction), capacity, max_steps

    @override
    def begin(self) -> tuple[surface_search.SurfaceState, bool]:
        return _blank_surfaces(self._capacity, np.dtype(self._asked[0].a.side.lower.dtype).name), True

    @override
    def advance(
        self, state: tuple[surface_search.SurfaceState, bool], limit: int, growing: bool
    ) -> tuple[tuple[surface_search.SurfaceState, bool], Standing]:
        # Only hard cases need the feet that move, and a second compiled function.
        table, solution, news = _surface_stretch(*self._asked, *state, limit, limit > _FIRST_STEPS_OF_SURFACES)
        return (table, False), Standing(solution, *np.asarray(news))


@compiled
def _stretch(
    a: BezierSegments,
    b: BezierSegments,
    wanted: Wanted,
    direction: Any,
    state: CurveState,
    fresh: Array,
    limit: Array,
    growing: Array,
) -> tuple[CurveState, HausdorffSolution, Array]:
    """Begin the search if it is fresh, take some steps, and return the state, the solution and four numbers."""
    capacity, near = state.table.upper.size, near_curve(b, is_long(a) or is_long(b))
    state = jax.lax.cond(fresh, lambda _: begin(a, near, wanted, capacity), lambda state: state, state)
    state = advance(a, near, wanted, state, limit, growing)
    going_on = unfinished(a, near, wanted, state)
    full = going_on & (state.waiting + LANES > capacity)
    solution = in_direction(solution_of(a, near, wanted, state), direction)
    return state, solution, jnp.stack([going_on, full, state.steps, state.waiting])


@lru_cache(maxsize=8)
def _blank(capacity: int, dtype: str) -> CurveState:
    """Return a state of the right shapes, to begin in."""
    zeros: Any = np.zeros
    table = CurveTable(zeros((capacity, 3), int), zeros((capacity, 4), dtype), zeros(capacity, dtype))
    number, count = zeros((), dtype), zeros((), int)
    place, none = CurvePlace(count, number), zeros((), bool)
    return on_device(CurveState(table, number, number, place, place, number, none, place, count))


@partial(compiled, static=(6,))
def _surface_stretch(
    pair: CoveredPair,
    wanted: Wanted,
    direction: Any,
    state: surface_search.SurfaceState,
    fresh: Array,
    limit: Array,
    following: bool,
) -> tuple[surface_search.SurfaceState, HausdorffSolution, Array]:
    capacity = state.table.bound.size
    state = jax.lax.cond(fresh, lambda _: surface_search.begin(pair.a, pair.b, capacity), lambda state: state, state)
    state, going_on = surface_solution.advanced(pair, wanted, state, limit, following)
    news = jnp.stack([going_on, jnp.array(False), state.steps, state.waiting])
    return state, surface_solution.solution_of(pair, wanted, state, direction), news


@lru_cache(maxsize=8)
def _blank_surfaces(capacity: int, dtype: str) -> surface_search.SurfaceState:
    return on_device(surface_search.blank(capacity, dtype))
