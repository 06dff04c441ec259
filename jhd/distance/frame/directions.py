"""The Hausdorff distance of two directed ones: the larger of them, and the larger of their bounds."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic.rounding import ordered
from jhd.compiled import compiled
from jhd.solution import RESULTS, HausdorffSolution, result_where


@compiled
def larger(there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
    """The larger of both directed distances, the first one at a tie; it keeps both.

    Args:
        there: from a to b.
        back: from b to a, in the same unit.
    """
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
        directions=(there, back),
    )


def alike(there: HausdorffSolution, back: HausdorffSolution) -> tuple[HausdorffSolution, HausdorffSolution]:
    """Both in one form: `t` and `foot_params` are repeated to a common shape; counts that one lacks are zeros."""
    first, second = there.witness, back.witness
    forms = (
        jnp.broadcast_shapes(first.t.shape, second.t.shape),
        jnp.broadcast_shapes(
            *(w.foot_params.shape if w.foot_params.ndim == 2 else (*w.foot_params.shape, 1) for w in (first, second))
        ),
    )
    names = {**there.stats, **back.stats}
    return _formed(there, *forms, names), _formed(back, *forms, names)


def _formed(solution: HausdorffSolution, t: tuple, params: tuple, names: Any) -> HausdorffSolution:
    w = solution.witness
    own = w.foot_params if w.foot_params.ndim == 2 else jnp.broadcast_to(w.foot_params[:, None], params)
    own = own if params[1] > 1 else own[:, 0]
    witness = replace(w, t=jnp.broadcast_to(w.t, t), foot_params=own)
    return replace(solution, witness=witness, stats={n: solution.stats.get(n, jnp.array(0)) for n in names})


def _maximum(x: Array, y: Array) -> Array:
    # Of subnormal lengths, which the compiled maximum takes for zeros, the larger one too.
    return jnp.where(ordered(x) >= ordered(y), x, y)
