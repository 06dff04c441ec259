"""All roots of a polynomial in Bernstein form in the unit interval, with proven enclosures: the projected polyhedron.

An interval is kept as long as the hull of the coefficients on it leaves room for a root; it shrinks to this room, and
is halved if it shrinks by less than a fifth. Every step rounds outward and counts the rounding of the coefficients, so
**no root is ever lost**: each lies in a returned interval. The converse is not proven: an interval holds one root,
several, or none if the polynomial vanishes to within its rounding.

Intervals are examined first come, first served and live in one table of fixed length. So they are of about equal length
when the table is full, and the search ends with the code capacity_reached instead of exhausting itself at one end.

Source: Sherbrooke & Patrikalakis, Computation of the solutions of nonlinear polynomial systems, CAGD 10 (1993);
Patrikalakis & Maekawa, Shape Interrogation for Computer Aided Design and Manufacturing (2002), chapter 4.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jhd._arithmetic import rounding
from jhd._results.solution import RESULTS
from jhd._runtime.arrays import varying

# Numbers a block of lanes holds in its inner loop, about half a megabyte: past the second-level cache of one core a
# round costs 36 times as much for 10 times the lanes.
BLOCK_NUMBERS = 1 << 16
# Keys of table entries; smaller keys are pending intervals, the smallest is the next one.
FINAL, EMPTY = 1 << 30, (1 << 30) + 1


class Roots(eqx.Module):
    """Intervals that together contain every root in [0, 1]; disjoint, in increasing order, padded and masked.

    Args:
        lower: lower ends; 1 in the padding.
        upper: upper ends; 0 in the padding, so that it contains nothing.
        valid: which entries hold an interval.
        boxes: number of intervals examined.
        result: capacity_reached or gap_not_closed if some returned intervals are longer than rounding makes them.
            nonfinite_value if an input was not finite: then the whole unit interval is returned.
    """

    lower: Float[Array, " capacity"]
    upper: Float[Array, " capacity"]
    valid: Bool[Array, " capacity"]
    boxes: Int[Array, ""]
    result: Any


def solve(
    coefficients: Float[ArrayLike, " points"], error: ArrayLike = 0.0, *, capacity: int = 64, max_steps: int = 4096
) -> Roots:
    """All roots of a polynomial in the unit interval.

    A root of the exact polynomial, whose coefficients differ from those given by at most `error`, lies in one of the
    intervals. An interval is final when it is at most 64 times the spacing of floats at one, or when every coefficient
    on it is within two rounding bounds: there is no more to learn. So a double root gives one interval of about the
    square root of the unit roundoff, and zero the unit interval. Final intervals that touch are merged.

    Write it for one polynomial and map it: under vmap the polynomials are solved side by side, in blocks. Not
    differentiable: the roots are constants to derivatives.

    >>> roots = solve(jnp.array([-0.25, 0.25, 0.75]))  # t - 1/4 in degree two
    >>> int(roots.valid.sum()), bool((roots.lower[0] <= 0.25) & (0.25 <= roots.upper[0]))
    (1, True)

    Args:
        coefficients: the Bernstein coefficients.
        error: absolute error of the coefficients.
        capacity: length of the table of intervals, pending and final; three times the degree was enough in every trial.
        max_steps: most intervals examined; a simple root takes about five, a double root thirty.

    Raises:
        ValueError: a capacity below one.
    """
    if capacity < 1:
        raise ValueError(f"capacity must be at least 1; it is {capacity}.")
    c = lax.stop_gradient(jnp.asarray(coefficients))
    error = lax.stop_gradient(jnp.asarray(error, c.dtype))
    found = jax.tree.map(lambda x: x[..., 0], _solver(capacity, max_steps)(c[:, None], error[None]))
    result = RESULTS.where(found.pending, RESULTS.gap_not_closed, RESULTS.successful)  # pyright: ignore[reportArgumentType]
    result = RESULTS.where(found.full, RESULTS.capacity_reached, result)
    result = RESULTS.where(found.nonfinite, RESULTS.nonfinite_value, result)
    return Roots(found.lower, found.upper, found.valid, found.boxes, result)


class _FoundRoots(NamedTuple):
    """Results of the search, with lanes as the last axis."""

    lower: Array
    upper: Array
    valid: Array
    boxes: Array
    pending: Array
    full: Array
    nonfinite: Array


class _RootTable(NamedTuple):
    """Intervals of each lane: ends and keys (capacity, lanes), number of intervals examined, overflow."""

    lower: Array
    upper: Array
    key: Array
    boxes: Array
    full: Array


@cache
def _solver(capacity: int, max_steps: int) -> Callable[..., _FoundRoots]:
    """The search with lanes as the last axis; vmap makes more lanes of it.

    Mapped from outside, a loop would carry its lanes first, and arrays with a short last axis do not vectorize.
    """

    @custom_vmap
    def search(c: Array, error: Array) -> _FoundRoots:
        return _in_blocks(partial(_search, capacity=capacity, max_steps=max_steps), capacity, c, error)

    @search.def_vmap
    def _(size: int, batched: list[bool], *args: Array):
        lanes = args[-1].shape[-1]

        def flatten(x: Array, is_batched: bool) -> Array:
            x = jnp.moveaxis(x, 0, -2) if is_batched else jnp.repeat(x[..., None, :], size, axis=-2)
            return x.reshape(*x.shape[:-2], size * lanes)

        found = search(*(flatten(x, b) for x, b in zip(args, batched, strict=True)))
        split = jax.tree.map(lambda x: jnp.moveaxis(x.reshape(*x.shape[:-1], size, lanes), -2, 0), found)
        return split, jax.tree.map(lambda _: True, split)

    # Called outside of a jitted function, the loop is compiled once for each shape instead of at each call.
    return jax.jit(search)


def _in_blocks(search: Callable[..., _FoundRoots], capacity: int, c: Array, error: Array) -> _FoundRoots:
    """The search over blocks of lanes, one after another: each stays in the cache and ends with its own slowest lane.

    Lanes are filled up with zero polynomials, which end at once. On an accelerator there is one block.
    """
    count, lanes = c.shape
    block = max(16, (1 << (BLOCK_NUMBERS // (3 * (count + capacity))).bit_length()) >> 1)
    if lanes <= block or jax.default_backend() != "cpu":
        return search(c, error)
    blocks = -(-lanes // block)

    def cut(x: Array) -> Array:
        x = jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, blocks * block - lanes)])
        return jnp.moveaxis(x.reshape(*x.shape[:-1], blocks, block), -2, 0)

    found = lax.map(lambda args: search(*args), (cut(c), cut(error)))
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1)[..., :lanes], found)


def _search(c: Array, error: Array, *, capacity: int, max_steps: int) -> _FoundRoots:
    """Examine intervals until no lane has a pending one; then merge the final ones.

    Args:
        c: coefficients (degree + 1, lanes).
        error: absolute error of the coefficients (lanes,).
        capacity: length of the table.
        max_steps: most intervals examined in a lane.
    """
    lanes = c.shape[-1]
    nonfinite = ~(jnp.all(jnp.isfinite(c), axis=0) & jnp.isfinite(error))
    c, error = _scaled(jnp.where(nonfinite, 0.0, c), jnp.where(nonfinite, 0.0, error))
    key = jnp.full((capacity, lanes), EMPTY, jnp.int32).at[0].set(jnp.where(nonfinite, FINAL, 0))
    ends = jnp.zeros((capacity, lanes), c.dtype)
    table = _RootTable(ends, ends + 1, key, jnp.zeros(lanes, jnp.int32), jnp.zeros(lanes, bool))
    table = lax.while_loop(
        lambda t: jnp.any(_active(t, max_steps)),
        lambda t: _examine(t, c, error, max_steps),
        varying(table, c, error),
    )
    lower, upper, valid = _merged(table.lower, table.upper, table.key < EMPTY)
    return _FoundRoots(lower, upper, valid, table.boxes, jnp.any(table.key < FINAL, axis=0), table.full, nonfinite)


def _active(table: _RootTable, max_steps: int) -> Array:
    return (jnp.min(table.key, axis=0) < FINAL) & (table.boxes < max_steps)


def _examine(table: _RootTable, c: Array, error: Array, max_steps: int) -> _RootTable:
    """One step of every active lane: the oldest pending interval is dropped, kept, shrunk or halved.

    Writes are masks over the whole table: scatters by lane are slow on every backend.
    """
    key = table.key
    active = _active(table, max_steps)
    current = (key == jnp.min(key, axis=0)) & active
    lower, upper = (jnp.sum(jnp.where(current, x, 0.0), axis=0) for x in (table.lower, table.upper))
    own, bound = _on_interval(c, error, lower, upper)
    new_lower, new_upper, gone = _shrunk(own, bound, lower, upper)

    side = new_upper - new_lower
    middle = new_lower + 0.5 * side
    # Shrinking leaves about one error bound on each side of a simple root; if coefficients within one bound, not two,
    # ended the search, such intervals would be halved into eight.
    exhausted = jnp.max(jnp.abs(own), axis=0) <= 2 * bound
    indivisible = (middle <= new_lower) | (middle >= new_upper)
    final = exhausted | indivisible | (side <= 64 * jnp.finfo(c.dtype).eps)
    # An interval that keeps more than this fraction of its length is halved: Sherbrooke & Patrikalakis, section 4.
    halve = active & ~gone & ~final & (side > 0.8 * (upper - lower))

    slots = jnp.arange(key.shape[0], dtype=jnp.int32)[:, None]
    free = (slots == jnp.min(jnp.where(key == EMPTY, slots, key.shape[0]), axis=0)) & halve
    no_room = halve & ~jnp.any(free, axis=0)
    halve &= ~no_room
    first_key = jnp.where(gone, EMPTY, jnp.where(final | no_room, FINAL, 2 * table.boxes + 1))
    first_upper = jnp.where(halve, middle, new_upper)
    return _RootTable(
        lower=jnp.where(current, new_lower, jnp.where(free, middle, table.lower)),
        upper=jnp.where(current, first_upper, jnp.where(free, new_upper, table.upper)),
        key=jnp.where(current, first_key, jnp.where(free, 2 * table.boxes + 2, key)),
        boxes=table.boxes + active,
        full=table.full | no_room,
    )


def _merged(lower: Array, upper: Array, valid: Array) -> tuple[Array, Array, Array]:
    """Intervals that touch replaced by their hull, in increasing order, the valid ones first.

    The next interval begins at the least lower end beyond the last one. A loop is faster here than sorting.
    """
    lower = jnp.where(valid, lower, jnp.inf)

    def following(state: tuple[Array, ...]) -> tuple[Array, ...]:
        k, last, lowers, uppers = state
        start = jnp.min(jnp.where(lower > last, lower, jnp.inf), axis=0)

        def reached(end: Array) -> Array:
            return jnp.maximum(end, jnp.max(jnp.where((lower >= start) & (lower <= end), upper, -jnp.inf), axis=0))

        ends = lax.while_loop(lambda x: jnp.any(x[0] != x[1]), lambda x: (x[1], reached(x[1])), (start, reached(start)))
        there, end = start < jnp.inf, ends[1]
        return k + 1, end, lowers.at[k].set(jnp.where(there, start, 1.0)), uppers.at[k].set(jnp.where(there, end, 0.0))

    first = jnp.array(0), jnp.full_like(lower[0], -jnp.inf), jnp.ones_like(lower), jnp.zeros_like(lower)
    _, _, lower, upper = lax.while_loop(
        lambda state: (state[0] < lower.shape[0]) & jnp.any(state[1] < jnp.inf), following, varying(first, lower)
    )
    return lower, upper, lower <= upper


def _scaled(c: Array, error: Array) -> tuple[Array, Array]:
    """Coefficients divided by a power of two so that the largest is in [1, 2), and their error.

    The error has three parts: `error` and nu (subnormal coefficients count as zero) divided by the same power, and nu
    for results of the division that are flushed.
    """
    nu = rounding.smallest_normal(c.dtype)
    scale = rounding.power_of_two(jnp.max(jnp.abs(c), axis=0))
    given = rounding.round_up(rounding.round_up(rounding.flush_up(error) + nu) / scale)
    return c / scale, rounding.round_up(given + nu)


def _on_interval(c: Array, error: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Coefficients on an interval and a bound of their error.

    `error` does not change, for the weights of a restriction sum to one. Its rounding, 9 n operations in degree n
    (`_restrict`), acts on sums of weights times |c|, which the restriction of |c| computes. So the bound follows the
    size of the polynomial on the interval, and roots next to an end at which the coefficients are tiny stay apart. One
    more operation in the count covers the rounding of the restriction of |c|.
    """
    both = _restrict(jnp.stack([c, jnp.abs(c)], axis=1), lower, upper)
    size = jnp.max(both[:, 1], axis=0)
    return both[:, 0], rounding.round_up(error + rounding.absolute_error(9 * (c.shape[0] - 1) + 1, size))


def _restrict(c: Array, t0: Array, t1: Array) -> Array:
    """Coefficients on [t0, t1], 0 <= t0 <= t1 <= 1, of each lane, from the original coefficients (degree + 1, ...).

    The blossoms of `bernstein.restrict` take n^3 / 2 operations; here two passes of de Casteljau's algorithm take
    2 n^2. The first gives the blossoms with n - j arguments t0 and j arguments 1; the second moves the ones to t1, by
    t1 = a t0 + b 1 with a = (1 - t1) / (1 - t0) and b = (t1 - t0) / (1 - t0), which may both be computed with small
    relative errors. All weights are non-negative. A level of the first pass costs three roundings, one of the second
    six (two differences, a quotient of two roundings, product, sum): the error is at most `absolute_error(9 n, m)` for
    coefficients of magnitude m. For t0 = 1 every blossom is the last coefficient already.
    """
    n = c.shape[0] - 1
    index = jnp.arange(n + 1).reshape((-1,) + (1,) * (c.ndim - 1))
    inner = t0 < 1
    rest = jnp.where(inner, 1 - t0, 1.0)
    a, b = jnp.where(inner, (1 - t1) / rest, 1.0), jnp.where(inner, (t1 - t0) / rest, 0.0)

    def to_the_right(level: Array, c: Array) -> Array:
        following = jnp.concatenate([c[1:], c[n:]])
        return jnp.where(index < n - level, (1 - t0) * c + t0 * following, c)

    def to_the_left(level: Array, c: Array) -> Array:
        preceding = jnp.concatenate([c[:1], c[:n]])
        return jnp.where(index > level, a * preceding + b * c, c)

    return lax.fori_loop(0, n, to_the_left, lax.fori_loop(0, n, to_the_right, varying(c, t0, a, b)))


def _shrunk(c: Array, error: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
    """The part of an interval that may hold a root, and whether it is empty; c is restricted to the interval.

    The new lower end is lower + x (upper - lower), for x that is too small if anything: the product of non-negative
    numbers is reduced by gamma(4) for its two roundings, the sum is rounded down. The upper end is found in this way
    from the other side. No end leaves the interval.
    """
    values = jnp.stack([rounding.round_down(c - error), rounding.round_down(-c - error)], axis=1)
    start, end = _first_crossing(values), _first_crossing(values[::-1])
    side = (upper - lower) * (1 - rounding.gamma(4, c.dtype))
    new_lower = jnp.maximum(lower, rounding.round_down(lower + jnp.minimum(start, 1.0) * side))
    new_upper = jnp.minimum(upper, rounding.round_up(upper - jnp.minimum(end, 1.0) * side))
    return new_lower, new_upper, jnp.isinf(start) | jnp.isinf(end) | (new_lower > new_upper)


def _first_crossing(v: Array) -> Array:
    """Part of the interval from its lower end that holds no root, the largest over the rows; infinite: none at all.

    For coefficients c, v (degree + 1, rows, lanes) holds c less the error, and -c less the error. On the interval the
    polynomial is at least the lower hull of the points (i / d, v_i), so above the line through the first of them with
    the smallest slope. If v_0 > 0 that line is positive before

        x_0 = min over j with v_j < v_0 of (j / d) v_0 / (v_0 - v_j),

    and if all v_i > 0 there is no root. (The line replaces the hull's own crossing: a division for each point instead
    of each pair; random polynomials need 1 % more intervals in degree 5 and 6 % more in degree 28.)

    x_0 costs seven roundings on non-negative numbers, so it is reduced by gamma(8). A difference v_0 - v_j that is
    flushed to zero is below nu; nu in its place makes x_0 smaller.
    """
    degree = v.shape[0] - 1
    part = jnp.arange(degree + 1, dtype=v.dtype)[:, None, None] * ((1 - rounding.gamma(8, v.dtype)) / max(degree, 1))
    falls = jnp.maximum(v[0] - v, rounding.smallest_normal(v.dtype))
    x = jnp.min(jnp.where(v < v[0], part * v[0] / falls, jnp.inf), axis=0)
    x = jnp.where(jnp.min(v, axis=0) > 0, jnp.inf, jnp.where(v[0] > 0, x, 0.0))
    return jnp.max(x, axis=0)
