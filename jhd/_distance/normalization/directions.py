"""The Hausdorff distance from both directed distances: a joint search, the larger distance, the larger bounds."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import ordered
from jhd._distance.normalization.host_callback import by_kept_program
from jhd._distance.normalization.stopping import Aim, aim_at
from jhd._results.solution import DIRECTIONS, RESULTS, HausdorffSolution, in_direction, unchecked
from jhd._runtime.arrays import is_tracing, varying
from jhd._runtime.compiled import compiled

Run = Callable[[Any, Any, Aim], tuple[HausdorffSolution, Any]]


class TracedSearch(NamedTuple):
    """A traced search for both directions, with its arguments."""

    # `scanned` with a function for one direction, as a function of a module.
    both: Callable[[Any, Any, Aim, Array], tuple[HausdorffSolution, Any]]
    common: Any  # arguments that both directions share
    there: Any  # arguments for the direction from a to b
    back: Any  # arguments for the direction from b to a, arrays of the same shapes
    answers: Any  # shapes and types of the answers for both; None for a search that is always traced.


def in_turn(search: TracedSearch, level: Any, ceiling: Any) -> tuple[Any, Any]:
    """Return both directions of one traced search, which is compiled once and run twice.

    Each result is a solution with the second result of the search.

    Args:
        search: the search.
        level: distances up to this length do not matter; None for the lower bound of the first direction, in the
            second.
        ceiling: distances above this length need no closer bounds; None without.
    """
    given = jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), search.there, search.back)
    dtype = jnp.result_type(*(x for x in jax.tree_util.tree_leaves(given) if jnp.issubdtype(x.dtype, jnp.floating)))
    rising = jnp.asarray(level is None)
    aim = aim_at(level, ceiling, dtype)
    found = by_kept_program(search.both, search.answers, (search.common, given, aim, rising))
    (first, of_first), (second, of_second) = (jax.tree_util.tree_map(lambda x, k=k: x[k], found) for k in range(2))
    return (in_direction(first, DIRECTIONS.a_to_b), of_first), (in_direction(second, DIRECTIONS.b_to_a), of_second)


def scanned(run: Run, common: Any, given: Any, aim: Aim, rising: Array) -> tuple[HausdorffSolution, Any]:
    """Return the results of both directions; with `rising`, the second matters only above the first.

    Args:
        run: function of the common arguments, the arguments of one direction, and an aim; returns a solution and a
            pytree of further arrays.
        common: arguments that both directions share.
        given: arguments of both directions, stacked.
        aim: aim of the first direction.
        rising: whether the lower bound of the first direction is the level of the second.
    """

    def one(least: Any, pair: Any) -> tuple[Any, Any]:
        solution, further = run(common, pair, Aim(least, aim.ceiling))
        return jnp.where(rising, solution.lower, least), (solution, further)

    return jax.lax.scan(one, jnp.asarray(varying(aim.level, given)), given)[1]


def larger(there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
    """Return the larger of both directed distances, the first one at a tie; it keeps both."""
    chosen = _picked(_above(back.value, there.value), back, there)
    ended = there.result._value
    successful = (ended if is_tracing(ended) else np.asarray(ended)) == RESULTS.successful._value
    stats = {f"{name}_{key}": x for name, s in (("a_to_b", there), ("b_to_a", back)) for key, x in s.stats.items()}
    fields = {
        "lower": _picked(_above(back.lower, there.lower), back.lower, there.lower),
        "upper": _picked(_above(back.upper, there.upper), back.upper, there.upper),
        "result": _picked(successful, back.result, there.result),
        "stats": stats,
        "directed": False,
        "directions": (there, back),
    }
    return unchecked(HausdorffSolution, vars(chosen) | fields)


@compiled
def larger_of_forms(there: HausdorffSolution, back: HausdorffSolution) -> HausdorffSolution:
    """Return the larger of two directed distances in different forms, which its directions keep."""
    return replace(larger(*_alike(there, back)), directions=(there, back))


def _alike(there: HausdorffSolution, back: HausdorffSolution) -> tuple[HausdorffSolution, HausdorffSolution]:
    """Return both in one form: parameters are filled up to the longer ones, missing counts are zero.

    A single number is repeated, and rows are filled up with zeros.
    """
    witnesses = there.witness, back.witness
    columns = max(w.t.shape[0] if w.t.ndim else 0 for w in witnesses)
    params = max(w.feet_params.shape[1] if w.feet_params.ndim == 2 else 0 for w in witnesses)
    names = {**there.stats, **back.stats}
    return _formed(there, columns, params, names), _formed(back, columns, params, names)


def _formed(solution: HausdorffSolution, columns: int, params: int, names: Any) -> HausdorffSolution:
    w = solution.witness
    witness = replace(
        w, t=_filled(w.t, columns, w.t.ndim == 0), feet_params=_filled(w.feet_params, params, w.feet_params.ndim == 1)
    )
    return replace(solution, witness=witness, stats={n: solution.stats.get(n, jnp.array(0)) for n in names})


def _filled(rows: Array, columns: int, single: bool) -> Array:
    """Return the rows filled up to `columns` numbers each, or unchanged for none."""
    if columns == 0:
        return rows
    if single:
        return jnp.broadcast_to(rows[..., None], (*rows.shape, columns))
    return jnp.pad(rows, [(0, 0)] * (rows.ndim - 1) + [(0, columns - rows.shape[-1])])


def _above(x: Any, y: Any) -> Any:
    # Of subnormal lengths, which compiled functions take for zeros, the larger one too.
    return ordered(x) > ordered(y) if is_tracing(x, y) else np.asarray(x) > np.asarray(y)


def _picked(condition: Any, yes: Any, no: Any) -> Any:
    """Return one of two trees of arrays; of known ones, without an operation on arrays."""
    if isinstance(condition, np.ndarray | np.generic):
        return yes if condition else no
    return jax.tree_util.tree_map(lambda x, y: jnp.where(condition, x, y), yes, no)
