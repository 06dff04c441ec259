"""What fits by the Hausdorff distance hand back: where they ended, with the proven distance."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jhd._results.solution import DIRECTIONS, RESULTS, CriticalPairs, FitSolution, HausdorffSolution
from jhd._runtime.arrays import array_of
from jhd._runtime.compiled import asking
from jhd.distance.frame.method import AbstractHausdorffMethod
from jhd.distance.hausdorff import hausdorff
from jhd.fitting.bundle import Bundled
from jhd.fitting.clock import Clock, OutOfTimeError
from jhd.fitting.host_bounds import host_bounds
from jhd.fitting.minimax import Ended, minimise
from jhd.fitting.problem import Point, Problem
from jhd.triangles.closest_point import outward

# A maximum was missed where the proven distance is larger by this share, or this share of the size.
_MISSED = 1e-9
# How often samples are doubled after a maximum was missed.
_DENSER = 3


class ProvenEnd(NamedTuple):
    """The end of a fit by all maxima, with the proven distance."""

    ended: Ended
    error: HausdorffSolution
    missed: bool


def minimise_and_prove(
    problem: Problem,
    start: Any,
    max_steps: int,
    atol: float,
    method: AbstractHausdorffMethod | None,
    report: Callable[[int, float, float], object],
) -> ProvenEnd:
    """A fit by all maxima, taken up again with a closer look at the maxima if one was missed."""
    found = _proven(problem, minimise(problem, start, max_steps, atol, report), method)
    for _ in range(_DENSER):
        before, steps = found.ended, problem.counts["steps"]
        if not found.missed or steps >= max_steps or problem.clock.is_over():
            break
        problem.look_closer()

        def later(step: int, value: float, optimality: float, steps: int = steps) -> None:
            if step:
                report(steps + step, value, optimality)

        ended = minimise(problem, before.point.parameters, max_steps - steps, atol, later)
        found = _proven(problem, ended._replace(history=before.history + ended.history[1:]), method)
    return found


def _proven(problem: Problem, ended: Ended, method: AbstractHausdorffMethod | None) -> ProvenEnd:
    point, clock = ended.point, problem.clock
    try:
        with asking(clock.compiling):
            error = hausdorff(problem.target, point.shape, method, throw=False, progress=clock.closing)
    except OutOfTimeError:
        error = _bounded(problem, point)
    return ProvenEnd(ended, error, float(error.lower) > point.top * (1 + _MISSED) + _MISSED * point.size)


def _bounded(problem: Problem, point: Point) -> HausdorffSolution:
    """The distance at a point by bounds that need no program."""
    bounds = host_bounds(problem.target, point.shape.segments(), problem.clock)
    dtype = np.dtype(point.pairs.value.dtype)
    lower, upper = (outward(np.asarray(end), 0, dtype, sign) for end, sign in zip(bounds, (-1, 1), strict=True))
    return HausdorffSolution(
        value=array_of(np.clip(dtype.type(point.top), lower, upper)),
        lower=array_of(lower),
        upper=array_of(upper),
        witness=jax.tree_util.tree_map(lambda x: x[0], point.pairs.witness),
        result=RESULTS.interrupted,
        stats={},
        directed=False,
    )


def minimax_solution(proven: ProvenEnd, unravel: Callable) -> FitSolution:
    """The solution of a fit by all maxima."""
    ended, error, missed = proven
    point, pairs = ended.point, ended.point.pairs
    mu = np.zeros(pairs.value.shape)
    mu[: len(ended.multipliers)] = ended.multipliers
    return FitSolution(
        parameters=unravel(jnp.asarray(point.parameters)),
        shape=point.shape,
        error=error,
        optimality=jnp.asarray(ended.optimality),
        multipliers=jnp.asarray(mu),
        pairs=pairs,
        result=RESULTS.fit_missed_a_maximum if missed else ended.result,
        stats={name: jnp.asarray(count) for name, count in ended.counts.items()},
        history=jnp.asarray(ended.history),
    )


def bundled_solution(
    ended: Bundled, unravel: Callable, target: Any, method: AbstractHausdorffMethod | None, clock: Clock
) -> FitSolution:
    """The end of a fit by cuts, likewise."""
    point = ended.point
    there, back = point.solutions
    back = eqx.tree_at(lambda s: s.witness.direction, back, DIRECTIONS.b_to_a)
    order = (0, 1) if there.value >= back.value else (1, 0)
    values, witness = jax.tree_util.tree_map(
        lambda *x: jnp.stack([x[k] for k in order]), *((s.value, s.witness) for s in (there, back))
    )
    return FitSolution(
        parameters=unravel(jnp.asarray(point.parameters)),
        shape=point.shape,
        error=hausdorff(target, point.shape, method, throw=False, progress=clock.closing),
        optimality=jnp.asarray(ended.optimality),
        multipliers=jnp.asarray(ended.multipliers[list(order)]),
        pairs=CriticalPairs(values, witness, jnp.ones(2, bool), RESULTS.successful),
        result=ended.result,
        stats={name: jnp.asarray(count) for name, count in ended.counts.items()},
        history=jnp.asarray(ended.history),
    )
