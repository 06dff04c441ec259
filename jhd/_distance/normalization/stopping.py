"""Stopping criteria of a search: the tolerance of its bounds, and the range in which the distance matters."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array

from jhd._runtime.arrays import is_traced

# The default tolerance as a fraction of the diagonal, and in units of the last place of one if this is more.
_SHARE = 1e-10
_EPS = 64


class Aim(NamedTuple):
    """The range in which a distance matters, in common coordinates: above `level`, and closely only up to `ceiling`."""

    level: Any
    ceiling: Any


def aim_at(level: Any, ceiling: Any, dtype: DTypeLike) -> Aim:
    """Return the range in which a distance matters as an Aim; None for either end if everything matters."""
    infinity = np.asarray(np.inf, dtype)
    return Aim(-infinity if level is None else level, infinity if ceiling is None else ceiling)


class Wanted(NamedTuple):
    """The requested tolerances, in the common coordinates; a negative atol stands for the default."""

    atol: Array
    rtol: Array
    aim: Aim


class AllowedGap(NamedTuple):
    """Largest gap between the bounds at which a search may stop, in the unit of the search."""

    atol: float  # absolute tolerance, as requested or by default
    rtol: float  # tolerance relative to the bound
    floor: Callable[[float], float]  # gap that rounding leaves at a bound
    given: bool  # whether atol was requested: a larger gap then counts as not closed, even if rounding causes it

    def __call__(self, bound: float) -> float:
        """Return the gap at which searches stop."""
        return max(self.atol, self.rtol * bound, self.floor(bound))

    def asked(self, bound: float) -> float:
        """Return the gap that counts as closed."""
        return max(self.atol, self.rtol * bound) if self.given else self(bound)


def default_tolerance(diagonal: Any, dtype: DTypeLike, floor: Any) -> Any:
    """Return the default tolerance: 1e-10 of the diagonal, or 64 eps of it if this is more.

    Args:
        diagonal: length of the diagonal of the box of both shapes.
        dtype: type of the arithmetic.
        floor: gap that rounding leaves, used if it is larger.
    """
    xp: Any = jnp if is_traced(diagonal, floor) else np
    return xp.maximum(max(_SHARE, _EPS * float(jnp.finfo(dtype).eps)) * diagonal, floor)
