"""Stopping criteria of a search: the tolerance of its bounds, and the range in which the distance matters."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array

from jhd._runtime.arrays import is_traced

# The default tolerance as a share of the diagonal, and in units of the last place of one where that is more.
_SHARE = 1e-10
_EPS = 64


class Aim(NamedTuple):
    """What of a distance matters, in the common coordinates: nothing up to `level`, nothing more above `ceiling`."""

    level: Any
    ceiling: Any


def aim_at(level: Any, ceiling: Any, dtype: DTypeLike) -> Aim:
    """The aim of these lengths; None where everything matters."""
    infinity = np.asarray(np.inf, dtype)
    return Aim(-infinity if level is None else level, infinity if ceiling is None else ceiling)


class Wanted(NamedTuple):
    """What was asked for, in the common coordinates; a negative atol stands for the default."""

    atol: Array
    rtol: Array
    aim: Aim


class AllowedGap(NamedTuple):
    """How far apart bounds may stay, in the unit of a search.

    Args:
        atol: what was asked for, or the default.
        rtol: the same relative to the bound.
        floor: what rounding leaves at a bound.
        given: whether atol was asked for: then a gap beyond it has not been closed, whatever rounding leaves.
    """

    atol: float
    rtol: float
    floor: Callable[[float], float]
    given: bool

    def __call__(self, bound: float) -> float:
        """The gap within which no search goes on."""
        return max(self.atol, self.rtol * bound, self.floor(bound))

    def asked(self, bound: float) -> float:
        """The gap that has been closed."""
        return max(self.atol, self.rtol * bound) if self.given else self(bound)


def default_tolerance(diagonal: Any, dtype: DTypeLike, floor: Any) -> Any:
    """The gap that is allowed where nothing is asked for: 1e-10 of the diagonal, 64 eps of it where that is more.

    Args:
        diagonal: length of the diagonal of the box of both shapes.
        dtype: of the arithmetic.
        floor: what rounding leaves, which counts where it is more.
    """
    xp: Any = jnp if is_traced(diagonal, floor) else np
    return xp.maximum(max(_SHARE, _EPS * float(jnp.finfo(dtype).eps)) * diagonal, floor)
