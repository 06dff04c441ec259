"""The ways to fit: by all maxima (curves), by a bundle of gradients (surfaces and meshes), or by another statistic.

Fits return their last parameters with the certified distance.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jhd._distance.hausdorff import hausdorff
from jhd._distance.normalization.method import AbstractHausdorffMethod
from jhd._distance.statistics.statistics import AbstractStatistic, MaxDistance, check_statistic
from jhd._fitting.bundle import minimize_by_cuts, motions
from jhd._fitting.descent import Ended, descend
from jhd._fitting.host_bounds import host_bounds
from jhd._fitting.minimax import minimize
from jhd._fitting.problem import Point, Problem
from jhd._results.solution import DIRECTIONS, RESULTS, CriticalPairs, FitSolution, HausdorffSolution
from jhd._runtime.arrays import array_of
from jhd._runtime.clock import Clock, OutOfTimeError
from jhd._runtime.compiled import asking
from jhd._shapes.curve import AbstractCurve, check_curve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch
from jhd._triangles.closest_point import outward

# A maximum was missed if the proven distance is larger by this fraction of itself or of the size.
_MISSED = 1e-9


class Limits(NamedTuple):
    """Stopping criteria of an iteration, the number of maxima that take part, and the method of the final proof."""

    max_steps: int
    stop_below: float
    capacity: int
    clock: Clock
    method: AbstractHausdorffMethod | None


class Way(NamedTuple):
    """A way to fit: functions from a start and a callback to an end, and from an end to its value and solution."""

    iterate: Callable[[Any, Callable[[int, float, float], object]], Any]
    value: Callable[[Any], float]
    solution: Callable[[Any, Callable], FitSolution]


def way_of(built: Any, target: Any, statistic: AbstractStatistic | None, limits: Limits) -> Way:
    """The way to fit shapes to a target of this kind by a statistic."""
    check_statistic(statistic)
    steps, stop_below, capacity, clock, method = limits
    if statistic is not None and statistic != MaxDistance():
        scales = scales_of(built, target)
        return Way(
            lambda start, report: fit_by_measure(
                built, statistic, target, start, scales(start), steps, stop_below, clock, report
            ),
            lambda ended: ended.point.value,
            lambda ended, unravel: measured_solution(built, unravel, statistic, target, ended, method),
        )
    if isinstance(target, ImplicitSurface | TriangleMesh):
        return Way(
            lambda start, report: minimize_by_cuts(built, target, start, steps, stop_below, report, clock),
            lambda ended: ended.point.value,
            lambda ended, unravel: bundled_solution(ended, unravel, target, method, clock),
        )
    check_curve("target", target)
    return Way(
        lambda start, report: minimize_and_prove(
            Problem(built, target.segments(), capacity, clock), start, steps, stop_below, method, report
        ),
        lambda found: found.ended.point.top,
        minimax_solution,
    )


def scales_of(build: Callable, target: Any) -> Callable[[np.ndarray], np.ndarray]:
    """A function from parameters to the change of each that moves the shape by about one unit of length."""

    def scales(parameters: np.ndarray) -> np.ndarray:
        shape = build(jnp.asarray(parameters))
        if isinstance(shape, AbstractCurve) and isinstance(target, AbstractCurve):
            return Problem(build, target.segments(), 1).scales(parameters)
        if isinstance(shape, AbstractPatch):
            slopes = jax.jacfwd(lambda p: build(p).patches().control_points)(jnp.asarray(parameters))
            moved = np.max(np.abs(np.asarray(slopes).reshape(-1, len(parameters))), axis=0)
            return 1 / np.where(moved > 0, moved, 1.0)
        return motions(build, parameters)

    return scales


def fit_by_measure(
    build: Callable[[Any], Any],
    statistic: AbstractStatistic,
    target: Any,
    parameters: Any,
    scale: Any,
    max_steps: int,
    stop_below: float,
    clock: Clock,
    report: Callable[[int, float, float], object],
) -> Ended:
    """Minimize a statistic of (target, shape) from a vector of parameters until it is stationary; see descend."""
    low, high = (np.asarray(end) for end in target.bounds)
    size = float(np.max(high - low)) or 1.0
    # Nodes along a curve or surface at each evaluation, fewer than for the final bounds.
    function = lambda p: statistic.estimate(target, build(p), nodes=1 << 11)  # noqa: E731
    return descend(function, parameters, scale, size, max_steps, stop_below, clock, report)


def measured_solution(
    build: Callable[[Any], Any],
    unravel: Callable,
    statistic: AbstractStatistic,
    target: Any,
    ended: Ended,
    method: Any,
) -> FitSolution:
    """The fit with the proven statistic and the proven largest distance."""
    shape = build(jnp.asarray(ended.point.parameters))
    error = hausdorff(target, shape, method, throw=False)
    witness = jax.tree_util.tree_map(lambda x: jnp.asarray(x)[None], error.witness)
    pairs = CriticalPairs(error.value[None], witness, jnp.ones(1, bool), RESULTS.successful)
    return _solution(ended, unravel, shape, error, pairs, statistic(target, shape, throw=False))


def _solution(
    ended: Ended, unravel: Callable, shape: Any, error: HausdorffSolution, pairs: CriticalPairs, statistic: Any = None
) -> FitSolution:
    """The solution at the end of an iteration."""
    return FitSolution(
        parameters=unravel(jnp.asarray(ended.point.parameters)),
        shape=shape,
        error=error,
        optimality=jnp.asarray(ended.optimality),
        multipliers=jnp.asarray(ended.multipliers),
        pairs=pairs,
        result=ended.result,
        stats={name: jnp.asarray(count) for name, count in ended.counts.items()},
        history=jnp.asarray(ended.history),
        statistic=statistic,
    )


class ProvenEnd(NamedTuple):
    """The end of a fit by all maxima, with the proven distance."""

    ended: Ended
    error: HausdorffSolution
    missed: bool


def minimize_and_prove(
    problem: Problem,
    start: Any,
    max_steps: int,
    stop_below: float,
    method: AbstractHausdorffMethod | None,
    report: Callable[[int, float, float], object],
) -> ProvenEnd:
    """Fit by all maxima; continue with denser samples or proven maxima if one was missed."""
    found = _proven(problem, minimize(problem, start, max_steps, stop_below, report), method)
    # How often samples are doubled after a maximum was missed.
    for _ in range(3):
        before, steps = found.ended, problem.counts["steps"]
        if not found.missed or steps >= max_steps or problem.clock.is_over():
            break
        problem.look_closer()

        def later(step: int, value: float, optimality: float, steps: int = steps) -> None:
            if step:
                report(steps + step, value, optimality)

        ended = minimize(problem, before.point.parameters, max_steps - steps, stop_below, later)
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
    """The distance at a point by bounds that need no compilation."""
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
    pairs = ended.point.pairs
    mu = np.zeros(pairs.value.shape)
    mu[: len(ended.multipliers)] = ended.multipliers
    result = RESULTS.fit_missed_a_maximum if missed else ended.result
    ended = ended._replace(multipliers=mu, result=result)
    return _solution(ended, unravel, ended.point.shape, error, pairs)


def bundled_solution(
    ended: Ended, unravel: Callable, target: Any, method: AbstractHausdorffMethod | None, clock: Clock
) -> FitSolution:
    """The FitSolution at the end of a fit by cuts."""
    point = ended.point
    there, back = point.solutions
    back = eqx.tree_at(lambda s: s.witness.direction, back, DIRECTIONS.b_to_a)
    order = (0, 1) if there.value >= back.value else (1, 0)
    values, witness = jax.tree_util.tree_map(
        lambda *x: jnp.stack([x[k] for k in order]), *((s.value, s.witness) for s in (there, back))
    )
    pairs = CriticalPairs(values, witness, jnp.ones(2, bool), RESULTS.successful)
    error = hausdorff(target, point.shape, method, throw=False, progress=clock.closing)
    return _solution(ended._replace(multipliers=ended.multipliers[list(order)]), unravel, point.shape, error, pairs)
