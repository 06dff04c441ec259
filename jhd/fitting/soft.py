"""A smooth stand-in for the Hausdorff distance of two curves."""

import jax
from jaxtyping import Array

from jhd.arrays import real_array
from jhd.distance.witness.critical import critical_pairs
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve


def soft_hausdorff(a: AbstractCurve, b: AbstractCurve, temperature: Numbers, *, capacity: int = 16) -> Array:
    """A smooth stand-in for the Hausdorff distance: temperature log sum exp(h_j / temperature) of the critical pairs.

    It lies above the largest h_j by at most temperature log capacity and falls to it with the temperature; where one
    maximum is born or dies far below the top it hardly jumps. For optimisers that want one smooth loss.

    Args:
        a: a curve.
        b: a curve of the same dimension.
        temperature: a positive length.
        capacity: how many maxima take part.
    """
    pairs, heat = critical_pairs(a, b, capacity), real_array("temperature", temperature)
    return heat * jax.nn.logsumexp(pairs.value / heat, b=pairs.valid)
