"""The Hausdorff distance of two directed ones: one search for both, the larger of them, the larger of their bounds."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.arithmetic.rounding import ordered
from jhd.arrays import varying
from jhd.compiled import compiled
from jhd.distance.frame.aim import Aim, aim_at
from jhd.solution import DIRECTIONS, RESULTS, HausdorffSolution, in_direction, result_where


def in_turn(
    search: Callable[[Any, Aim], HausdorffSolution], there: Any, back: Any, level: Any, ceiling: Any
) -> tuple[HausdorffSolution, HausdorffSolution]:
    """Both directions by one traced search, which is compiled once and run twice.

    Args:
        search: of what is given for a direction, and an aim.
        there: for the direction from a to b.
        back: for the other one, arrays of the same shapes.
        level: nothing up to this length matters; None: nothing below the first lower bound, of the second direction.
        ceiling: nothing more matters above this length, or None.
    """
    given = jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), there, back)
    dtype = jnp.result_type(*(x for x in jax.tree_util.tree_leaves(given) if jnp.issubdtype(x.dtype, jnp.floating)))
    aim = varying(aim_at(level, ceiling, dtype), given)

    def one(least: Any, pair: Any) -> tuple[Any, HausdorffSolution]:
        solution = search(pair, Aim(least, aim.ceiling))
        return solution.lower if level is None else least, solution

    _, found = jax.lax.scan(one, jnp.asarray(aim.level), given)
    first, second = (jax.tree_util.tree_map(lambda x, k=k: x[k], found) for k in range(2))
    return in_direction(first, DIRECTIONS.a_to_b), in_direction(second, DIRECTIONS.b_to_a)


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
