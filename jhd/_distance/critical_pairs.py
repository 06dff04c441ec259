"""Critical pairs of two curves, led by the largest maximum, which the certified search finds if the samples miss it.

The local maxima come from jhd._distance.witness.critical. That search misses a maximum narrower than the sample
spacing: at the tips of folds that nearly coincide, or next to an end.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.hausdorff import hausdorff
from jhd._distance.normalization.coordinates import Frame
from jhd._distance.witness.critical import local_pairs
from jhd._distance.witness.derivative import moving
from jhd._distance.witness.maxima import NEARER, ROUNDED
from jhd._results.solution import RESULTS, CriticalPairs, HausdorffSolution, result_where
from jhd._runtime.arrays import is_traced, undifferentiated, whole
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.checks import check_same_dim
from jhd._shapes.curve import check_curve


def critical_pairs(a: ShapeLike, b: ShapeLike, capacity: int = 16) -> CriticalPairs:
    """The largest local maxima of the distance from `a` to `b` and from `b` to `a`, largest first.

    Each maximum has a value and a witness, differentiable in all arrays of both curves as in `hausdorff`. A pair of
    points that is a maximum in both directions appears once, as a maximum on `a`. The first value is at least the lower
    bound of `hausdorff`. The other entries are not certified to be complete. Every value is the distance from a point
    of one curve to the other curve. Works under jit and vmap.

    >>> import jhd
    >>> found = jhd.critical_pairs(jhd.polyline([(0, 0), (5, 0)]), jhd.polyline([(0, 0), (4.5, 6)]))
    >>> found.value[found.valid].round(9).tolist()
    [6.0, 4.0]

    Args:
        a: a curve, or an object that `jhd.as_shape` accepts.
        b: a curve of the same dimension.
        capacity: length of the list, at least 1; by default 16. Unused entries are not `valid` and have the value 0.

    Returns:
        A CriticalPairs. Its result is capacity_reached if there are more maxima, or the reason why the search for the
        largest one failed.

    Raises:
        TypeError: a shape of another kind.
        ValueError: the dimensions differ, or the capacity is not a whole number of at least 1.
    """
    first, second = taken_as("a", a), taken_as("b", b)
    check_curve("a", first)
    check_curve("b", second)
    capacity = whole("capacity", capacity, 1)
    pair = first.segments(), second.segments()
    check_same_dim(pair[0].dim, pair[1].dim)
    found, frame = local_pairs(*pair, capacity)
    found = _led(found, hausdorff(*undifferentiated(pair), throw=False), frame)
    if not is_traced(*pair):
        return found
    value, witness = jax.vmap(moving, in_axes=(0, 0, None, None, None))(found.value, found.witness, *pair, frame)
    return replace(found, value=jnp.where(found.valid, value, 0.0), witness=witness)


def _led(found: CriticalPairs, proven: HausdorffSolution, frame: Frame) -> CriticalPairs:
    """Return the pairs, preceded by the witness of the proven search if they miss the largest maximum."""
    first, lower = found.value[0], jnp.asarray(proven.lower, found.value.dtype)
    missed = lower > first * (1 + NEARER) + frame.length(ROUNDED)

    def led(entries: Array, entry: Any) -> Array:
        return jnp.where(missed, jnp.concatenate([jnp.asarray(entry, entries.dtype)[None], entries[:-1]]), entries)

    answers = (found.value, found.witness, found.valid), (proven.value, proven.witness, jnp.array(True))
    value, witness, valid = jax.tree_util.tree_map(led, *answers)
    # Below the bound by rounding alone.
    value = value.at[0].set(jnp.where(valid[0], jnp.maximum(value[0], lower), value[0]))
    result = result_where(missed & found.valid[-1], RESULTS.capacity_reached, found.result)
    result = result_where(result == RESULTS.successful, proven.result, result)
    return CriticalPairs(value, witness, valid, result)
