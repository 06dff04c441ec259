"""Position, velocity and acceleration of one (rational) Bezier segment at one parameter."""

from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float

from jhd._runtime.arrays import module_of


class CurveJet(NamedTuple):
    """A point of a curve with its first two derivatives."""

    point: Float[Array, " dim"]
    first: Float[Array, " dim"]
    second: Float[Array, " dim"]


@jax.jit
def jet(control_points: Array, weights: Array | None, t: Array) -> CurveJet:
    """Return the jet of one segment (points, dim) at the scalar t; jitted so that its many uses are traced once.

    For C = n/w the quotient rule gives C' = (n' - C w')/w and C'' = (n'' - 2 C' w' - C w'')/w.
    """
    if weights is None:
        return polynomial_jet(control_points, t)
    return quotient(polynomial_jet(control_points * weights[:, None], t), polynomial_jet(weights, t))


def quotient(n: CurveJet, w: CurveJet) -> CurveJet:
    """Return the jet of n / w."""
    point = n.point / w.point
    first = (n.first - point * w.first) / w.point
    return CurveJet(point, first, (n.second - 2 * first * w.first - point * w.second) / w.point)


def polynomial_jet(c: Any, t: Any) -> CurveJet:
    """Return the jet at t of polynomials with coefficients (points, ...); in NumPy for NumPy coefficients."""
    degree = c.shape[0] - 1
    second = first = module_of(c).zeros_like(c[0])
    for level in range(degree, 0, -1):
        if level == 2:
            second = degree * (degree - 1) * (c[2] - 2 * c[1] + c[0])
        if level == 1:
            first = degree * (c[1] - c[0])
        c = (1 - t) * c[:-1] + t * c[1:]
    return CurveJet(c[0], first, second)
