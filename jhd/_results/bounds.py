"""Numbers with certified bounds: lower <= exact <= upper."""

from typing import SupportsFloat

import equinox as eqx
from jaxtyping import Array

from jhd._results.batches import AbstractResult
from jhd._results.display import fields_shown
from jhd._runtime.arrays import is_traced


class AbstractBounds(AbstractResult):
    """A number with certified bounds."""

    value: eqx.AbstractVar[Array | float]
    lower: eqx.AbstractVar[Array | float]
    upper: eqx.AbstractVar[Array | float]

    def __float__(self) -> float:
        if is_traced(self.value):
            raise TypeError("the number is traced and not known yet: use its `value` instead.")
        return float(self.value)


class Bounds(AbstractBounds):
    """Certified bounds of a number.

    `float(bounds)` is the midpoint. `f"{bounds:.3f}"` shows both bounds, rounded outward.

    Args:
        lower: the lower bound.
        upper: the upper bound; inf if none is certified.
    """

    lower: float
    upper: float

    def __init__(self, lower: SupportsFloat, upper: SupportsFloat):
        self.lower, self.upper = float(lower), float(upper)

    @property
    def value(self) -> float:
        """Midpoint of the bounds; its error is at most half of `upper - lower`."""
        return 0.5 * self.lower + 0.5 * self.upper

    def __repr__(self) -> str:
        return fields_shown(self, "lower", "upper")
