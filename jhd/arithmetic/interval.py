"""Intervals of real numbers: what a proven range is handed out as."""

import equinox as eqx
from jaxtyping import Array, Float

from jhd.arithmetic import rounding


class Interval(eqx.Module):
    """The numbers x with lower <= x <= upper, elementwise; an infinite end is a bound that is not known.

    Ends are zero, normal or infinite: subnormal ones are moved outward, since XLA computes with them as if they were
    zero, and a NaN becomes an infinite end.

    Args:
        lower: lower ends.
        upper: upper ends, of the same shape.
    """

    lower: Float[Array, "..."] = eqx.field(converter=rounding.flush_down)
    upper: Float[Array, "..."] = eqx.field(converter=rounding.flush_up)
