"""Minimizing a mean or a quantile of distances: steps of BFGS, which tolerate creases where the foot jumps.

Source: Lewis & Overton, Nonsmooth Optimization via Quasi-Newton Methods (2013): the line search requires only a
sufficient decrease and a flatter slope, by halving and doubling.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jhd._results.solution import RESULTS
from jhd._runtime.clock import Clock, OutOfTimeError


class Lowered(NamedTuple):
    """Parameters with the value and the gradient there."""

    parameters: Any
    value: float
    gradient: Any


class Ended(NamedTuple):
    """The end of an iteration."""

    point: Any  # the last parameters with their values
    multipliers: Any  # of the distances whose maximum is minimized
    optimality: float  # length of the shortest combination of their gradients
    result: Any
    counts: dict[str, int]
    history: list[float]


def descend(
    function: Callable[[Any], Any],
    parameters: Any,
    scale: Any,
    size: float,
    max_steps: int,
    stop_below: float,
    clock: Clock,
    report: Callable[[int, float, float], object],
) -> Ended:
    """Minimize from the parameters until the value is stationary, below stop_below, or steps gain nothing.

    Args:
        function: a differentiable function of a vector, called outside jit.
        parameters: the start, a vector.
        scale: the change of each parameter that moves the shape by about one unit of length.
        size: size of the shapes.
        max_steps: most steps.
        stop_below: value at which to stop.
        clock: ends the iteration.
        report: called with step, value and length of the gradient.
    """
    counts = {"steps": 0, "newton_steps": 0, "evaluations": 0}
    evaluate = jax.value_and_grad(function)

    def at(place: Any) -> Lowered:
        if counts["evaluations"]:
            clock.check()
        counts["evaluations"] += 1
        value, gradient = evaluate(jnp.asarray(place))
        return Lowered(place, float(value), np.asarray(gradient))

    point = at(np.asarray(parameters))
    history, small, result = [point.value], 0, RESULTS.fit_steps_exhausted
    # Values within this many roundings of the size count as zero: remaining distances to a copy have no slope.
    enough = max(stop_below, 64 * float(np.finfo(point.gradient.dtype).eps) * size)
    slope = point.gradient * scale
    first = float(np.linalg.norm(slope))
    # The estimate of the inverse Hessian, in scaled parameters.
    # First step as a fraction of the size.
    inverse = np.eye(len(slope)) * (0.02 * size / (np.max(np.abs(slope)) or 1.0))
    report(0, point.value, float(np.linalg.norm(point.gradient)))
    try:
        while counts["steps"] < max_steps:
            slope = point.gradient * scale
            # A gradient shorter than 1e-9 of the first one counts as zero; gains end after three steps without one.
            if point.value <= enough or small >= 3 or np.linalg.norm(slope) <= 1e-9 * first:
                result = RESULTS.successful
                break
            moved = _searched(at, point, scale, -inverse @ slope)
            if moved is None:
                result = RESULTS.fit_nonsmooth_stall
                break
            step, change = (moved.parameters - point.parameters) / scale, (moved.gradient - point.gradient) * scale
            inverse = _updated(inverse, step, change, counts["steps"] == 0)
            # Gains below this fraction of the value count as none.
            small = small + 1 if point.value - moved.value <= 1e-9 * point.value else 0
            point = moved
            counts["steps"] += 1
            history.append(point.value)
            report(counts["steps"], point.value, float(np.linalg.norm(point.gradient)))
    except OutOfTimeError:
        result = RESULTS.out_of_time
    return Ended(point, np.zeros(1), float(np.linalg.norm(point.gradient)), result, counts, history)


def _searched(at: Callable[[Any], Lowered], point: Lowered, scale: Any, direction: Any) -> Lowered | None:
    """A point along the direction, in scaled parameters, with sufficient gain and, if possible, a flatter slope."""
    slope = float(direction @ (point.gradient * scale))
    if not slope < 0:
        return None
    share, low, high, best = 1.0, 0.0, np.inf, None
    for _ in range(25):
        moved = at(point.parameters + share * scale * direction)
        # Least fraction of the gain promised by the slope.
        if not moved.value <= point.value + 1e-4 * share * slope:
            high = share
        else:
            best = moved
            # Largest fraction of the slope that a step may leave.
            if float(direction @ (moved.gradient * scale)) >= 0.9 * slope:
                break
            low = share
        share = 2 * share if np.isinf(high) else 0.5 * (low + high)
        if high - low <= 1e-12 * high:
            break
    return best


def _updated(inverse: Any, step: Any, change: Any, first: bool) -> Any:
    along = float(step @ change)
    if not along > 0:
        return inverse
    if first:
        inverse = np.eye(len(step)) * along / float(change @ change)
    left = np.eye(len(step)) - np.outer(step, change) / along
    return left @ inverse @ left.T + np.outer(step, step) / along
