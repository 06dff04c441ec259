"""Boxes: their children, and the smallest and largest distances between points of two boxes."""

from functools import reduce

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

# The corners of the unit cube, x slowest.
CORNERS = np.array(list(np.ndindex(2, 2, 2)))


def children(cells: Int[np.ndarray, "cells 3"]) -> Int[np.ndarray, "children 3"]:
    """The eight parts of each cell i, with numbers 2 i and 2 i + 1 along each axis; parts of a cell are adjacent."""
    return (2 * cells[:, None, :] + CORNERS.astype(cells.dtype)).reshape(-1, 3)


def squared_distances(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    """Smallest and largest squared distance of a point of box a from a point of box b; boxes broadcast.

    With s = max(a.lower - b.upper, b.lower - a.upper) and r = min(the same two) in each coordinate, the smallest is the
    sum of max(s, 0)^2 and the largest the sum of r^2 (r <= 0 if the boxes are not empty). All terms are positive, so
    each computed number is off by a factor of at most five roundings: one for the difference, which is squared, one for
    the square, two for the sum. Integers below 2^24 (2^53) are exact in single (double) precision.

    Args:
        a: lower and upper corners, the three coordinates in front: arrays (3, ...).
        b: lower and upper corners, arrays (3, ...).

    Source: Interval arithmetic on the squared distance, AlgSurf, section 2, step 4.
    """
    gaps, reaches = [], []
    for axis in range(3):
        before, after = a[0][axis] - b[1][axis], b[0][axis] - a[1][axis]
        gaps.append(jnp.maximum(jnp.maximum(before, after), 0))
        reaches.append(jnp.minimum(before, after))
    least, most = (x * x + y * y + z * z for x, y, z in (gaps, reaches))
    return least, most


def squared_vertex_distances(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    """Smallest and largest squared distance of a vertex of box a from a vertex of box b, of 64; boxes broadcast.

    The differences along each axis take four values, whichever they are along the others, so the extremes add up. The
    largest equals the largest of `squared_distances`. The smallest is larger if the boxes overlap along an axis and
    have no common end there; then it is no bound of the distances of their points.

    Args:
        a: lower and upper corners, the three coordinates in front: arrays (3, ...).
        b: lower and upper corners, arrays (3, ...).

    Source: AlgSurf, section 2, step 4, the second way.
    """
    ends = []
    for axis in range(3):
        four = [jnp.abs(x[axis] - y[axis]) for x in a for y in b]
        ends.append((reduce(jnp.minimum, four), reduce(jnp.maximum, four)))
    least, most = (x * x + y * y + z * z for x, y, z in zip(*ends, strict=True))
    return least, most
