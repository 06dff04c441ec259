"""The stationary parameters of the distance from a point to one segment: roots of (P - B).B' in Bernstein form."""

import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic import bernstein, polynomial_roots
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.normalization.pieces import piece_of
from jhd._shapes.curve import BezierSegments
from jhd._shapes.homogeneous import wronskian


def roots_on(point: Array, curve: BezierSegments, segment: Array, capacity: int) -> polynomial_roots.Roots:
    """Return enclosures of the roots of (P - B).B' on one segment."""
    return polynomial_roots.solve(*stationarity(point, *piece_of(curve, segment)), capacity=capacity)


def stationarity(point: Array, control_points: Array, weights: Array | None) -> tuple[Array, Array]:
    """Return Bernstein coefficients of (P - B).B', times w^3 on rational segments, and a bound of their error.

    With e = P - b and h the control points of the hodograph (or of x'w - xw'), each coefficient is a sum of products
    e_i.h_j with weights c_ij that are non-negative and sum to one. Rounding: e, h and the product table err by a few
    relative u each (h sums at most degree + 1 terms, all rounded from exact differences), so a coefficient is off by
    at most gamma(4 n + dim + 16) times max |e| max sum |h terms|; components are summed, not rooted.
    Source: Cao et al. 2014, equation (10) with its indices corrected.
    """
    n = control_points.shape[0] - 1
    e = point - control_points
    if n == 0:
        return jnp.zeros((2,), e.dtype), jnp.zeros((), e.dtype)
    if weights is None:
        h = bernstein.derivative(control_points, axis=0)
        size = n * jnp.max(jnp.abs(jnp.diff(control_points, axis=0)), axis=0)
    else:
        # The factor w > 0 of P w - x = w (P - b) leaves the roots alone; so does a common scale.
        e = e * weights[:, None]
        h = wronskian(control_points, weights)
        # The largest sum of absolute terms of a coefficient.
        size = jnp.max(wronskian(control_points, weights, absolute=True), axis=0)
    error = gamma(4 * n + point.shape[0] + 16, e.dtype) * jnp.sum(jnp.max(jnp.abs(e), axis=0) * size)
    return bernstein.dot(e, h), error + 64 * (n + 1) * smallest_normal(e.dtype)
