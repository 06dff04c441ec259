"""What fits by the Hausdorff distance hand back: where they ended, with the proven distance."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jhd.distance.frame.method import AbstractHausdorffMethod
from jhd.distance.hausdorff import hausdorff
from jhd.fitting.bundle import Bundled
from jhd.fitting.minimax import Ended
from jhd.shapes.curve import AbstractCurve
from jhd.solution import DIRECTIONS, RESULTS, CriticalPairs, FitSolution

# A maximum was missed where the proven distance is larger by this share, or this share of the size.
_MISSED = 1e-9


def minimax_solution(
    ended: Ended, unravel: Callable, target: AbstractCurve, method: AbstractHausdorffMethod | None
) -> FitSolution:
    """The end of a fit by all maxima of the distance, with the proven distance."""
    point, pairs = ended.point, ended.point.pairs
    mu = np.zeros(pairs.value.shape)
    mu[: len(ended.multipliers)] = ended.multipliers
    error = hausdorff(target, point.shape, method, throw=False)
    missed = float(error.lower) > point.top * (1 + _MISSED) + _MISSED * point.size
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
    ended: Bundled, unravel: Callable, target: Any, method: AbstractHausdorffMethod | None
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
        error=hausdorff(target, point.shape, method, throw=False),
        optimality=jnp.asarray(ended.optimality),
        multipliers=jnp.asarray(ended.multipliers[list(order)]),
        pairs=CriticalPairs(values, witness, jnp.ones(2, bool), RESULTS.successful),
        result=ended.result,
        stats={name: jnp.asarray(count) for name, count in ended.counts.items()},
        history=jnp.asarray(ended.history),
    )
