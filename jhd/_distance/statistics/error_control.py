"""Values whose derivatives are known to some accuracy; derivatives that are not confirmed are refused.

Rules over cells are compared with rules over their parts. The difference that remains at the largest number of nodes
is the error of the derivative, as a fraction of the terms that it sums.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.normalization.custom_derivatives import without_derivative
from jhd._runtime.arrays import is_traced, is_tracing, undifferentiated

# Derivatives that may be off by more than this are refused.
_CONFIRMED = 1e-6


class Estimated(NamedTuple):
    """A value, differentiable."""

    value: Array  # the number
    off: float  # bound of the relative error of its derivative; infinite if unknown

    @property
    def is_confirmed(self) -> bool:
        """Return whether the derivative is as accurate as promised, or not requested."""
        roundoff = float(np.finfo(self.value.dtype).eps)
        # The same bound in units of roundoff.
        return not is_traced(self.value) or self.off <= max(_CONFIRMED, 1e4 * roundoff)

    @property
    def is_known(self) -> bool:
        """Return whether the number is known now, though it may be differentiated."""
        return not is_tracing(undifferentiated(self.value))

    @property
    def refusal(self) -> str:
        """Message about a derivative that is not confirmed."""
        known = f"only to a fraction of {self.off:.1g}" if np.isfinite(self.off) else "not at all"
        return (
            f"the derivative of this statistic is confirmed {known}, not to {_CONFIRMED:g}, with the largest number of "
            "nodes; estimate(a, b, nodes=n) has a derivative that is smoothed over n points, good for fits."
        )

    def guarded(self) -> Array:
        """Return the value, with a NaN derivative if it is not confirmed."""
        return self.value if self.is_confirmed else without_derivative(self.value)

    def larger(self, other: "Estimated") -> "Estimated":
        """Return the larger one: equal ones both count half, if both derivatives are confirmed."""
        if (self.is_confirmed and other.is_confirmed) or not (self.is_known and other.is_known):
            return Estimated(jnp.maximum(self.value, other.value), max(self.off, other.off) if self.is_known else 0.0)
        first, second = (float(undifferentiated(x.value)) for x in (self, other))
        if first == second:
            return self if self.off > other.off else other
        return self if first > second else other
