"""The exception for computations that miss their goal: the reason, the bounds reached, and a remedy."""

import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jhd._results.batches import Bounds
from jhd._results.outcomes import RESULTS
from jhd._runtime.arrays import is_traced
from jhd._runtime.decimals import lower_text, upper_text

# Result codes of searches whose bounds a wider tolerance would accept, and results of calls that take one.
_TOO_WIDE = {int(x._value) for x in (RESULTS.gap_not_closed, RESULTS.capacity_reached, RESULTS.nonisolated_maxima)}
_WITH_TOLERANCE = "HausdorffSolution", "StatisticSolution", "MinimumSolution"


class NotProvenError(RuntimeError):
    """A computation ended without the requested accuracy. `solution` holds its result, whose bounds are true."""

    def __init__(self, message: str, solution: eqx.Module):
        super().__init__(message)
        # One of many classes; the caller knows which.
        self.solution: Any = solution


def throw_unless_successful(
    solution: Any, known: Mapping[str, Bounds] | None = None, option: str | None = None
) -> None:
    """Raise NotProvenError with the solution unless every entry is successful or RESULTS.not_certified; tracers pass.

    Args:
        solution: the result of a computation.
        known: the bounds reached, by name, if there are several; by default the bounds of the solution.
        option: the option that would accept these bounds, as written in a call; by default a tolerance of their width.
    """
    if is_traced(solution.result):
        return
    found = np.ravel(np.asarray(solution.result._value))
    # A method that proves nothing promises no accuracy.
    failed = (found != int(RESULTS.successful._value)) & (found != int(RESULTS.not_certified._value))
    if failed.any():
        first = int(np.argmax(failed))
        ended = int(found[first])
        known = _bounds_of(solution, first) if known is None else known
        option = _tolerance(solution, known) if option is None else option
        reached = _reached(known, option if ended in _TOO_WIDE else None)
        raise NotProvenError(f"{RESULTS._index_to_message[ended]}{reached}", solution)


def relative_tolerance(known: Mapping[str, Bounds]) -> str | None:
    """The least `rtol` that accepts all bounds, as written in a call; `atol` if the bounds are far apart.

    None if there are no bounds, or infinite ones.
    """
    if not known or not all(math.isfinite(x.lower) and math.isfinite(x.upper) for x in known.values()):
        return None
    share = max(((x.upper - x.lower) / x.upper for x in known.values() if x.upper > 0), default=0.0)
    # Larger relative tolerances are meaningless.
    if share < 0.5:
        return f"rtol={_least(share)}"
    return f"atol={_least(max(x.upper - x.lower for x in known.values()))}"


def _bounds_of(solution: Any, lane: int) -> dict[str, Bounds]:
    """The bounds in one lane of a solution; empty if it has none, or if its bounds have another shape."""
    ends: list[Any] = [getattr(solution, name, None) for name in ("lower", "upper")]
    if any(not isinstance(end, jax.Array | np.ndarray | float) for end in ends):
        return {}
    if np.shape(ends[0]) != np.shape(solution.result._value):
        return {}
    found = Bounds(*(np.ravel(np.asarray(end))[lane] for end in ends))
    of = f"entry {lane} of {np.size(solution.lower)}" if np.size(solution.lower) > 1 else ""
    return {of: found}


def _tolerance(solution: Any, known: Mapping[str, Bounds]) -> str | None:
    gap = max((x.upper - x.lower for x in known.values()), default=0.0)
    takes_one = type(solution).__name__ in _WITH_TOLERANCE
    return f"atol={_least(gap)}" if takes_one and 0 < gap < math.inf else None


def _reached(known: Mapping[str, Bounds], option: str | None) -> str:
    """The bounds as a sentence, with the option that would accept them."""
    parts = [
        f"{lower_text(x.lower)} and {upper_text(x.upper)}{f' for {of}' if of else ''}"
        for of, x in known.items()
        if not math.isnan(x.lower) and not math.isnan(x.upper)
    ]
    if not parts:
        return ""
    remedy = f" Pass {option} to accept them." if option else ""
    return f" The bounds reached are {', '.join(parts)}.{remedy}"


def _least(tolerance: float) -> str:
    """The tolerance in two digits, rounded up, so that it accepts the bounds reached."""
    return upper_text(tolerance, ".2g")
