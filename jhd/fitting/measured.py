"""Fits by a mean or a quantile of the distances instead of the largest one."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jhd._results.solution import RESULTS, CriticalPairs, FitSolution
from jhd.distance.hausdorff import hausdorff
from jhd.distance.measures.measures import AbstractMeasure
from jhd.fitting.clock import Clock
from jhd.fitting.descent import Descended, descend

# Places along a curve or surface at each evaluation: fewer than the bounds at the end are made of.
_PLACES = 1 << 11


def fit_by_measure(
    build: Callable[[Any], Any],
    measure: AbstractMeasure,
    target: Any,
    parameters: Any,
    scale: Any,
    max_steps: int,
    atol: float,
    clock: Clock,
    report: Callable[[int, float, float], object],
) -> Descended:
    """Steps from the parameters, a vector, until the measure of (target, shape) is stationary; see descend."""
    low, high = (np.asarray(end) for end in target.box())
    size = float(np.max(high - low)) or 1.0
    function = lambda p: measure.estimate(target, build(p), places=_PLACES)  # noqa: E731
    return descend(function, parameters, scale, size, max_steps, atol, clock, report)


def measured_solution(
    build: Callable[[Any], Any], unravel: Callable, measure: AbstractMeasure, target: Any, ended: Descended, method: Any
) -> FitSolution:
    """The fit with the proven measure and the proven largest distance."""
    parameters = jnp.asarray(ended.point.parameters)
    shape = build(parameters)
    error = hausdorff(target, shape, method, throw=False)
    witness = jax.tree_util.tree_map(lambda x: jnp.asarray(x)[None], error.witness)
    pairs = CriticalPairs(error.value[None], witness, jnp.ones(1, bool), RESULTS.successful)
    return FitSolution(
        parameters=unravel(parameters),
        shape=shape,
        error=error,
        optimality=jnp.asarray(float(np.linalg.norm(ended.point.gradient))),
        multipliers=jnp.zeros(1),
        pairs=pairs,
        result=ended.result,
        stats={name: jnp.asarray(count) for name, count in ended.counts.items()},
        history=jnp.asarray(ended.history),
        measured=measure(target, shape, throw=False),
    )
