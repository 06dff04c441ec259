"""A polynomial system in Bernstein form on a box: its coefficients there, and the part of the box that may hold a root.

Every step rounds outward and counts the rounding of the coefficients, so no root leaves the part that is kept. Arrays
are (d1 + 1, ..., dn + 1, equations, lanes).

Source: Sherbrooke & Patrikalakis, CAGD 10 (1993); for the combination of equations Mourrain & Pavone, Subdivision
methods for solving polynomial equations, JSC 44 (2009).
"""

from functools import partial

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from jhd._arithmetic import rounding
from jhd._runtime.arrays import varying

# A box is exhausted if its coefficients are within this many error bounds. Shrinking leaves about one bound on
# each side of a simple root; with 1 here such boxes were halved into eight.
EXHAUSTED = 2.0


def scaled(c: Array, errors: Array) -> tuple[Array, Array]:
    """Coefficients divided by a power of two so that the largest is in [1, 2), and their errors.

    The errors have three parts: `errors` and nu (subnormal coefficients count as zero) divided by the same power, and
    nu for results of the division that are flushed.
    """
    nu = rounding.smallest_normal(c.dtype)
    scale = rounding.power_of_two(jnp.max(jnp.abs(c), axis=tuple(range(c.ndim - 2))))
    given = rounding.round_up(rounding.round_up(rounding.flush_up(errors) + nu) / scale)
    return c / scale, rounding.round_up(given + nu)


def on_box(c: Array, errors: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Coefficients on a box and a bound of their errors, one for each equation.

    `errors` do not change, for the weights of a restriction sum to one. Its rounding, 9 n operations in a variable
    of degree n (`restrict`), acts on sums of weights times |c|, which the restriction of |c| computes. So the bound
    follows the size of the equations on the box, and roots next to a corner at which the coefficients are tiny stay
    apart. One more operation in the count covers the rounding of the restriction of |c|.
    """
    both = jnp.concatenate([c, jnp.abs(c)], axis=-2)
    for axis in range(c.ndim - 2):
        both = restrict(both, lower[axis], upper[axis], axis)
    part, size = jnp.split(both, 2, axis=-2)
    operations = 9 * sum(n - 1 for n in c.shape[:-2]) + 1
    size = jnp.max(size, axis=tuple(range(c.ndim - 2)))
    return part, rounding.round_up(errors + rounding.absolute_error(operations, size))


def restrict(c: Array, t0: Array, t1: Array, axis: int) -> Array:
    """Coefficients on [t0, t1], 0 <= t0 <= t1 <= 1, of each lane, along one axis; from the original coefficients.

    The blossoms of `bernstein.restrict` take n^3 / 2 operations; here two passes of de Casteljau's algorithm take
    2 n^2. The first gives the blossoms with n - j arguments t0 and j arguments 1; the second moves the ones to t1, by
    t1 = a t0 + b 1 with a = (1 - t1) / (1 - t0) and b = (t1 - t0) / (1 - t0), which may both be computed with small
    relative errors. All weights are non-negative. A level of the first pass costs three roundings, one of the second
    six (two differences, a quotient of two roundings, product, sum): the error is at most `absolute_error(9 n, m)` for
    coefficients of magnitude m. For t0 = 1 every blossom is the last coefficient already.
    """
    n = c.shape[axis] - 1
    index = jnp.arange(n + 1).reshape((-1,) + (1,) * (c.ndim - axis - 1))
    inner = t0 < 1
    rest = jnp.where(inner, 1 - t0, 1.0)
    a, b = jnp.where(inner, (1 - t1) / rest, 1.0), jnp.where(inner, (t1 - t0) / rest, 0.0)

    def to_the_right(level: Array, c: Array) -> Array:
        following = jnp.concatenate([part(c, 1, n + 1), part(c, n, n + 1)], axis=axis)
        return jnp.where(index < n - level, (1 - t0) * c + t0 * following, c)

    def to_the_left(level: Array, c: Array) -> Array:
        preceding = jnp.concatenate([part(c, 0, 1), part(c, 0, n)], axis=axis)
        return jnp.where(index > level, a * preceding + b * c, c)

    part = partial(lax.slice_in_dim, axis=axis)
    return lax.fori_loop(0, n, to_the_left, lax.fori_loop(0, n, to_the_right, varying(c, t0, a, b)))


def combinations(c: Array, errors: Array) -> tuple[Array, Array]:
    """Combinations of the equations by the adjugate of the Jacobian, with error bounds; none unless square, n = 2, 3.

    Each combination depends on one variable only, up to second order, so that boxes shrink quadratically at simple
    roots whatever the directions of the curves; at a tangency the combinations are the equations without their linear
    part, which keeps the number of boxes bounded there. Any matrix A is safe: roots of F are roots of A F. The error
    of a combination is sum |A_e| (error_e + gamma m_e), with m_e the largest coefficient of equation e on this box.
    """
    variables, equations = c.ndim - 2, c.shape[-2]
    if equations != variables or variables not in (2, 3):
        return c[..., :0, :], errors[:0]
    jacobian = jnp.stack([_mean_slope(c, axis) for axis in range(variables)])  # (variables, equations, lanes)
    matrix = _adjugate(jacobian)
    matrix = matrix / rounding.power_of_two(jnp.max(jnp.abs(matrix), axis=1, keepdims=True))
    rows = sum(c[..., e, None, :] * matrix[:, e] for e in range(equations))
    gamma = rounding.gamma(16, c.dtype)
    size = errors + gamma * jnp.max(jnp.abs(c), axis=tuple(range(variables)))
    bound = (1 + gamma) * jnp.sum(jnp.abs(matrix) * size, axis=1)
    bound = rounding.round_up(bound + 16 * rounding.smallest_normal(c.dtype))
    return jnp.asarray(rows), bound


def _mean_slope(c: Array, axis: int) -> Array:
    """Mean over the box of the derivative in one variable: the mean over the other indices of last minus first."""
    ends = jnp.take(c, -1, axis=axis) - jnp.take(c, 0, axis=axis)
    return jnp.mean(ends, axis=tuple(range(ends.ndim - 2)))


def _adjugate(columns: Array) -> Array:
    """Adjugate of the matrices whose columns are given, (variables, equations, lanes), as rows; two or three rows."""
    if columns.shape[0] == 2:
        (a, b), (c, d) = columns
        return jnp.stack([jnp.stack([d, -c]), jnp.stack([-b, a])])
    return jnp.stack([jnp.cross(columns[k - 2], columns[k - 1], axis=0) for k in range(3)])


def _room(c: Array, errors: Array) -> tuple[Array, Array]:
    """Parts of each side of the box, from its lower and from its upper end, that hold no root; infinite: none at all.

    For one equation and one variable let v_i be the smallest coefficient with index i in that variable, less the
    error. On the box the polynomial is at least the lower hull of the points (i / d, v_i), so above the line through
    the first of them with the smallest slope. If v_0 > 0 that line is positive before

        x_0 = min over j with v_j < v_0 of (j / d) v_0 / (v_0 - v_j),

    and if all v_i > 0 there is no root. The same holds for the largest coefficients with signs changed, and from the
    other end. (The line replaces the hull's own crossing: a division for each point instead of each pair; random
    polynomials need 1 % more boxes in degree 5 and 6 % more in degree 28.)

    x_0 costs seven roundings on non-negative numbers, so it is reduced by gamma(8). A difference v_0 - v_j that is
    flushed to zero is below nu; nu in its place makes x_0 smaller.

    Returns:
        Two arrays (variables, lanes).
    """
    variables = c.ndim - 2
    starts, ends = [], []
    for axis in range(variables):
        others = tuple(other for other in range(variables) if other != axis)
        low = rounding.round_down(jnp.min(c, axis=others) - errors)
        high = rounding.round_down(-jnp.max(c, axis=others) - errors)
        values = jnp.concatenate([low, high], axis=-2)
        starts.append(_first_crossing(values))
        ends.append(_first_crossing(values[::-1]))
    return jnp.stack(starts), jnp.stack(ends)


def _first_crossing(v: Array) -> Array:
    """The largest x_0 of `_room` over the rows, for points v (degree + 1, rows, lanes)."""
    degree = v.shape[0] - 1
    part = jnp.arange(degree + 1, dtype=v.dtype)[:, None, None] * ((1 - rounding.gamma(8, v.dtype)) / max(degree, 1))
    falls = jnp.maximum(v[0] - v, rounding.smallest_normal(v.dtype))
    x = jnp.min(jnp.where(v < v[0], part * v[0] / falls, jnp.inf), axis=0)
    x = jnp.where(jnp.min(v, axis=0) > 0, jnp.inf, jnp.where(v[0] > 0, x, 0.0))
    return jnp.max(x, axis=0)


def vanish(c: Array, errors: Array) -> Array:
    """Whether, in each lane, every coefficient is at most EXHAUSTED times its error bound."""
    return jnp.all(jnp.max(jnp.abs(c), axis=tuple(range(c.ndim - 2))) <= EXHAUSTED * errors, axis=0)


def shrunk(c: Array, errors: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
    """The part of a box in which `_room` leaves room for a root, and whether it is empty; c is restricted to the box.

    The new lower end is lower + x (upper - lower), for x that is too small if anything: the product of non-negative
    numbers is reduced by gamma(4) for its two roundings, the sum is rounded down. The upper end is found in this way
    from the other side. No end leaves the box.
    """
    start, end = _room(c, errors)
    none = jnp.any(jnp.isinf(start) | jnp.isinf(end), axis=0)
    side = (upper - lower) * (1 - rounding.gamma(4, c.dtype))
    new_lower = jnp.maximum(lower, rounding.round_down(lower + jnp.minimum(start, 1.0) * side))
    new_upper = jnp.minimum(upper, rounding.round_up(upper - jnp.minimum(end, 1.0) * side))
    return new_lower, new_upper, none | jnp.any(new_lower > new_upper, axis=0)
