"""Annealing from a far start toward the least Hausdorff distance: smooth losses with a falling temperature.

At each temperature steps of BFGS lower `soft_hausdorff`, whose gradient is dense; the next, lower temperature continues
at their end. The result is a start for a minimax fit, which needs no temperature.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from jhd._distance.statistics.statistics import AbstractStatistic, MaxDistance
from jhd._fitting.descent import descend
from jhd._fitting.soft import soft_hausdorff
from jhd._runtime.arrays import check_scalar, real_array
from jhd._runtime.clock import Clock
from jhd._shapes.checks import Numbers
from jhd._shapes.curve import check_curve


def annealing(
    temperature: Numbers | None,
    statistic: AbstractStatistic | None,
    build: Callable[[Any], Any],
    target: Any,
    scales: Callable[[Any], Any],
    clock: Clock,
) -> Callable[[Any], Any]:
    """A function from a start vector of parameters to a better start for a fit of build(parameters) to the target.

    Args:
        temperature: the first temperature, a length; None returns the parameters unchanged.
        statistic: the statistic that the fit minimizes.
        build: takes a vector of parameters and returns a curve.
        target: a curve.
        scales: takes parameters; returns the change of each that moves the curve by about one unit of length.
        clock: ends the search.

    Raises:
        TypeError: a target that is no curve.
        ValueError: another statistic than the Hausdorff distance, or a temperature that is no positive length.
    """
    if temperature is None:
        return lambda parameters: parameters
    if statistic is not None and statistic != MaxDistance():
        name = type(statistic).__name__
        raise ValueError(f"temperature is given with the statistic {name}; it is for the Hausdorff distance only.")
    check_curve("target", target)
    heat = real_array("temperature", temperature)
    check_scalar("temperature", heat, positive=True)
    low, high = (np.asarray(end) for end in target.bounds)
    size = float(np.max(high - low)) or 1.0

    def annealed(parameters: Any) -> Any:
        # The last temperature is a fiftieth of the first.
        for warmth in float(heat) * 0.27 ** np.arange(4):
            if clock.is_over():
                break
            loss = lambda p, warmth=warmth: soft_hausdorff(target, build(p), warmth)  # noqa: E731
            scale = scales(parameters)
            parameters = descend(loss, parameters, scale, size, 15, 0.0, clock, lambda *_: None).point.parameters
        return parameters

    return annealed
