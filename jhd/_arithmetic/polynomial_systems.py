"""All roots of polynomial systems in Bernstein form: the projected polyhedron method, with proven enclosures.

A box is kept as long as the hulls of the coefficients, projected on the plane of each variable and each equation, leave
room for a root; it shrinks to this room, and is halved if it shrinks by less than a fifth. Every step rounds outward
and counts the rounding of the coefficients, so **no root is ever lost**: each lies in a returned box. The converse is
not proven: a box holds one root, several, a stretch of a curve of roots, or none if the equations vanish to within
their rounding.

Boxes are examined first come, first served and live in one table of fixed length. So they are of about equal size when
the table is full, and a curve of roots ends as a coarse cover with the code capacity_reached instead of exhausting the
search at one of its ends.

Source: Sherbrooke & Patrikalakis, Computation of the solutions of nonlinear polynomial systems, CAGD 10 (1993);
Patrikalakis & Maekawa, Shape Interrogation for Computer Aided Design and Manufacturing (2002), chapter 4; for the
combination of equations Mourrain & Pavone, Subdivision methods for solving polynomial equations, JSC 44 (2009).
"""

import math
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

from jhd._arithmetic.box_systems import combinations, on_box, scaled, shrunk, vanish
from jhd._results.solution import RESULTS
from jhd._runtime.arrays import varying

# A box that keeps more than this fraction of its largest side is halved: Sherbrooke & Patrikalakis, section 4.
KEPT = 0.8
# At most this wide, a box is final if the combinations of the equations tell nothing more: at a tangency the
# equations are told from zero down to slivers 1e-8 long and 1e-16 wide. Wider boxes go on, for on a curve of common
# roots the combinations vanish everywhere.
COARSE = 2.0**-20
# Numbers a block of lanes holds in its inner loop, about half a megabyte: past the second-level cache of one core a
# round costs 36 times as much for 10 times the lanes.
BLOCK_NUMBERS = 1 << 16
# Keys of table entries; smaller keys are pending boxes, the smallest is the next one.
FINAL, EMPTY = 1 << 30, (1 << 30) + 1


class Roots(eqx.Module):
    """Boxes that together contain every root in the unit box; disjoint, in lexicographic order, padded and masked.

    Args:
        lower: lower corners; 1 in the padding.
        upper: upper corners; 0 in the padding, so that it contains nothing.
        valid: which entries hold a box.
        boxes: number of boxes examined.
        result: capacity_reached or gap_not_closed if some returned boxes are wider than asked for.
            nonfinite_value if an input was not finite: then the whole unit box is returned.
    """

    lower: Float[Array, "capacity variables"]
    upper: Float[Array, "capacity variables"]
    valid: Bool[Array, " capacity"]
    boxes: Int[Array, ""]
    result: Any


def solve(
    coefficients: Float[ArrayLike, "equations ..."],
    errors: ArrayLike = 0.0,
    *,
    capacity: int = 64,
    max_steps: int = 4096,
    atol: ArrayLike | None = None,
) -> Roots:
    """All roots in the unit box of polynomials in as many variables as the coefficients have further axes.

    A root of the exact polynomials, whose coefficients differ from those given by at most `errors`, lies in one of the
    boxes. A box is final when its sides are at most `atol`, or when every coefficient on it is within two rounding
    bounds: there is no more to learn. So a double root gives one box of about the square root of the unit roundoff,
    and equations that vanish identically give the unit box. Final boxes that touch are merged.

    Write it for one system and map it: under vmap the systems are solved side by side, in blocks. Not differentiable:
    the roots are constants to derivatives.

    >>> roots = solve(jnp.array([[-0.25, 0.25, 0.75]]))  # t - 1/4 in degree two
    >>> int(roots.valid.sum()), bool((roots.lower[0] <= 0.25) & (0.25 <= roots.upper[0]))
    (1, True)

    Args:
        coefficients: one Bernstein tensor for each equation, all of the same degree in each variable. There may be more
            equations than variables, or fewer (then the roots are curves, see above).
        errors: absolute error of the coefficients, one number or one for each equation.
        capacity: length of the table of boxes, pending and final. In one variable three times the degree was
            enough in every trial; in two and three variables ten for each root were.
        max_steps: most boxes examined; a simple root takes about five, a double root thirty.
        atol: largest side of a final box, in parameters; None means 64 times the spacing of floats at one. Zero is
            allowed.

    Raises:
        ValueError: coefficients without an axis for a variable, or a capacity below one.
    """
    c = lax.stop_gradient(jnp.asarray(coefficients))
    if c.ndim < 2 or c.size == 0:
        raise ValueError(f"coefficients needs axes (equations, degree + 1, ...); its shape is {c.shape}.")
    if capacity < 1:
        raise ValueError(f"capacity must be at least 1; it is {capacity}.")
    errors = jnp.broadcast_to(lax.stop_gradient(jnp.asarray(errors, c.dtype)), c.shape[:1])
    atol = jnp.asarray(64 * jnp.finfo(c.dtype).eps if atol is None else atol, c.dtype)
    tensors = jnp.moveaxis(c, 0, -1)[..., None]
    found = _solver(capacity, max_steps)(tensors, errors[:, None], lax.stop_gradient(atol)[None])
    found = jax.tree.map(lambda x: x[..., 0], found)
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


class _BoxTable(NamedTuple):
    """Boxes of each lane: corners (capacity, variables, lanes), keys (capacity, lanes), boxes examined, overflow."""

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
    def search(c: Array, errors: Array, atol: Array) -> _FoundRoots:
        return _in_blocks(partial(_search, capacity=capacity, max_steps=max_steps), capacity, c, errors, atol)

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


def _in_blocks(search: Callable[..., _FoundRoots], capacity: int, c: Array, *rest: Array) -> _FoundRoots:
    """The search over blocks of lanes, one after another: each stays in the cache and ends with its own slowest lane.

    Lanes are filled up with zero polynomials, which end at once. On an accelerator there is one block.
    """
    lanes, variables = c.shape[-1], c.ndim - 2
    a_lane = 3 * math.prod(c.shape[:-1]) + capacity * (2 * variables + 1)
    block = max(16, 1 << (BLOCK_NUMBERS // a_lane).bit_length() - 1) if BLOCK_NUMBERS > a_lane else 16
    if lanes <= block or jax.default_backend() != "cpu":
        return search(c, *rest)
    count = -(-lanes // block)

    def cut(x: Array) -> Array:
        x = jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, count * block - lanes)])
        return jnp.moveaxis(x.reshape(*x.shape[:-1], count, block), -2, 0)

    found = lax.map(lambda args: search(*args), tuple(cut(x) for x in (c, *rest)))
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1)[..., :lanes], found)


def _search(c: Array, errors: Array, atol: Array, *, capacity: int, max_steps: int) -> _FoundRoots:
    """Examine boxes until no lane has a pending one; then merge the final ones.

    Args:
        c: coefficients (d1 + 1, ..., dn + 1, equations, lanes).
        errors: absolute errors of the coefficients (equations, lanes).
        atol: (lanes,).
        capacity: length of the table.
        max_steps: most boxes examined in a lane.
    """
    variables, lanes = c.ndim - 2, c.shape[-1]
    tensor_axes = tuple(range(variables))
    nonfinite = ~jnp.all(jnp.isfinite(c), axis=(*tensor_axes, -2)) | ~jnp.all(jnp.isfinite(errors), axis=0)
    c, errors = scaled(jnp.where(nonfinite, 0.0, c), jnp.where(nonfinite, 0.0, errors))
    key = jnp.full((capacity, lanes), EMPTY, jnp.int32).at[0].set(jnp.where(nonfinite, FINAL, 0))
    corner = jnp.zeros((capacity, variables, lanes), c.dtype)
    table = _BoxTable(corner, corner + 1, key, jnp.zeros(lanes, jnp.int32), jnp.zeros(lanes, bool))
    table = lax.while_loop(
        lambda t: jnp.any(_active(t, max_steps)),
        lambda t: _examine(t, c, errors, atol, max_steps),
        varying(table, c, errors, atol),
    )
    lower, upper, valid = _merged(table.lower, table.upper, table.key < EMPTY)
    return _FoundRoots(lower, upper, valid, table.boxes, jnp.any(table.key < FINAL, axis=0), table.full, nonfinite)


def _active(table: _BoxTable, max_steps: int) -> Array:
    return (jnp.min(table.key, axis=0) < FINAL) & (table.boxes < max_steps)


def _examine(table: _BoxTable, c: Array, errors: Array, atol: Array, max_steps: int) -> _BoxTable:
    """One step of every active lane: the oldest pending box is dropped, kept, shrunk or halved.

    Writes are masks over the whole table: scatters by lane are slow on every backend.
    """
    key, variables = table.key, c.ndim - 2
    active = _active(table, max_steps)
    current = (key == jnp.min(key, axis=0)) & active
    lower, upper = (jnp.sum(jnp.where(current[:, None], x, 0.0), axis=0) for x in (table.lower, table.upper))
    own, bounds = on_box(c, errors, lower, upper)
    combined, combined_bounds = combinations(own, bounds)
    rows, row_bounds = jnp.concatenate([own, combined], axis=-2), jnp.concatenate([bounds, combined_bounds])
    new_lower, new_upper, gone = shrunk(rows, row_bounds, lower, upper)

    sides = new_upper - new_lower
    longest = jnp.max(sides, axis=0)
    cut = jnp.arange(variables)[:, None] == jnp.argmax(sides, axis=0)
    middle = new_lower + 0.5 * sides
    exhausted = vanish(own, bounds)
    if combined.shape[-2] > 0:
        exhausted |= vanish(combined, combined_bounds) & (longest <= COARSE)
    indivisible = jnp.any(cut & ((middle <= new_lower) | (middle >= new_upper)), axis=0)
    final = exhausted | indivisible | (longest <= atol)
    halve = active & ~gone & ~final & (longest > KEPT * jnp.max(upper - lower, axis=0))

    slots = jnp.arange(key.shape[0], dtype=jnp.int32)[:, None]
    free = (slots == jnp.min(jnp.where(key == EMPTY, slots, key.shape[0]), axis=0)) & halve
    no_room = halve & ~jnp.any(free, axis=0)
    halve &= ~no_room
    first_key = jnp.where(gone, EMPTY, jnp.where(final | no_room, FINAL, 2 * table.boxes + 1))
    first_upper, second_lower = jnp.where(cut & halve, middle, new_upper), jnp.where(cut, middle, new_lower)
    return _BoxTable(
        lower=jnp.where(current[:, None], new_lower, jnp.where(free[:, None], second_lower, table.lower)),
        upper=jnp.where(current[:, None], first_upper, jnp.where(free[:, None], new_upper, table.upper)),
        key=jnp.where(current, first_key, jnp.where(free, 2 * table.boxes + 2, key)),
        boxes=table.boxes + active,
        full=table.full | no_room,
    )


def _merged(lower: Array, upper: Array, valid: Array) -> tuple[Array, Array, Array]:
    """Boxes that touch replaced by their hull, until none touch; then sorted, the valid ones first."""
    index = jnp.arange(valid.shape[0])
    lower = jnp.where(valid[:, None], lower, jnp.inf)
    upper = jnp.where(valid[:, None], upper, -jnp.inf)

    used = jnp.max(jnp.where(valid, index[:, None] + 1, 0))

    def absorb(j: Array, boxes: tuple[Array, Array]) -> tuple[Array, Array]:
        touch = _touch(*boxes, boxes[0][j], boxes[1][j])[:, None]
        return (
            jnp.where(touch, jnp.minimum(boxes[0], boxes[0][j]), boxes[0]),
            jnp.where(touch, jnp.maximum(boxes[1], boxes[1][j]), boxes[1]),
        )

    def grow(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        new_lower, new_upper = lax.fori_loop(0, used, absorb, state[:2])
        return new_lower, new_upper, jnp.any((new_lower != state[0]) | (new_upper != state[1]))

    def repeat(j: Array, repeated: Array) -> Array:
        return repeated | (_touch(lower, upper, lower[j], upper[j]) & (index > j)[:, None])

    start = varying((lower, upper, jnp.array(True)), valid, lower)
    lower, upper, _ = lax.while_loop(lambda state: state[2], grow, start)
    repeated = lax.fori_loop(0, used, repeat, varying(jnp.zeros_like(valid), lower))
    valid = (valid & ~repeated)[:, None]
    corners = jnp.concatenate([jnp.where(valid, lower, 1.0), jnp.where(valid, upper, 0.0)], axis=1)
    variables = lower.shape[1]
    operands = (~valid[:, 0], *(corners[:, k] for k in range(2 * variables)))
    absent, *columns = lax.sort(operands, dimension=0, num_keys=1 + variables)
    return jnp.stack(columns[:variables], axis=1), jnp.stack(columns[variables:], axis=1), ~absent


def _touch(lower: Array, upper: Array, other_lower: Array, other_upper: Array) -> Array:
    """Mask of the boxes (capacity, variables, lanes) that meet the other box of their lane; empty ones never do."""
    return jnp.all((lower <= other_upper) & (other_lower <= upper), axis=1)
