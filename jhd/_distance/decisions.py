"""Decisions whether a distance is at most a threshold, from its bounds."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic.rounding import ordered
from jhd._results.solution import ANSWERS, RESULTS, Decision, HausdorffSolution, MinimumSolution, result_where
from jhd._runtime.arrays import is_traced, real_array
from jhd._runtime.compiled import compiled
from jhd._shapes.checks import Numbers


def checked_limit(threshold: Numbers) -> Array:
    """Return the threshold as a number of at least 0; raise ValueError otherwise."""
    limit = real_array("threshold", threshold)
    if limit.shape != () or (not is_traced(limit) and float(limit) < 0):
        raise ValueError(f"threshold is {limit}; needs one number of at least 0.")
    return limit


def of_copies(solution: HausdorffSolution) -> HausdorffSolution:
    """Return the solution for a shape and its copy: distance zero if the shape is certified to have a point."""
    upper = jnp.where(jnp.isfinite(solution.upper), 0.0, solution.upper)
    return eqx.tree_at(lambda x: (x.lower, x.upper), solution, (jnp.zeros_like(upper), upper))


@compiled
def decided(solution: HausdorffSolution | MinimumSolution, limit: Array) -> Decision:
    """Return the decision about a threshold that the bounds of a distance allow."""
    lower, upper, most = (ordered(x) for x in (solution.lower, solution.upper, limit))
    below, above = upper <= most, lower > most
    answer = ANSWERS.where(below, ANSWERS.yes, ANSWERS.where(above, ANSWERS.no, ANSWERS.undecided))
    ended = result_where(solution.result == RESULTS.successful, RESULTS.gap_not_closed, solution.result)
    result = result_where(below | above, RESULTS.successful, ended)
    if isinstance(solution, MinimumSolution):
        points = solution.point_a, solution.point_b
        return Decision(answer, solution.lower, solution.upper, result, solution.stats, "minimum", *points)
    distance = "directed" if solution.directed else "two_sided"
    return Decision(answer, solution.lower, solution.upper, result, solution.stats, distance)
