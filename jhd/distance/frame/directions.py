"""The Hausdorff distance of two directed ones: the larger of them, and the larger of their bounds."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic.rounding import ordered
from jhd.compiled import compiled
from jhd.solution import RESULTS, HausdorffSolution, result_where


def larger(there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
    """The larger of both directed distances, the first one at a tie; it keeps both.

    Args:
        there: from a to b.
        back: from b to a, in the same unit.
    """
    return replace(_larger(there, back), directions=(there, back))


@compiled
def _larger(there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
    turned = ordered(back.value) > ordered(there.value)
    chosen = jax.tree_util.tree_map(lambda x, y: jnp.where(turned, x, y), back, there)
    stats = {f"{name}_{key}": x for name, s in (("a_to_b", there), ("b_to_a", back)) for key, x in s.stats.items()}
    return HausdorffSolution(
        value=chosen.value,
        lower=_maximum(there.lower, back.lower),
        upper=_maximum(there.upper, back.upper),
        witness=chosen.witness,
        result=result_where(there.result == RESULTS.successful, back.result, there.result),
        stats=stats,
        directed=False,
    )


def _maximum(x: Array, y: Array) -> Array:
    # Of subnormal lengths, which the compiled maximum takes for zeros, the larger one too.
    return jnp.where(ordered(x) >= ordered(y), x, y)
