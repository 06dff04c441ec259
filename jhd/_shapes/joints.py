"""Joints of curves: which segment starts at the end of another, so that a seam does not count as a free end.

Curves of users store joints as floats, so that they can be differentiated; compiled functions take integers.
"""

from collections.abc import Sequence
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jhd._runtime.arrays import array_of, is_traced, module_of, undifferentiated

# Most pairs that are compared without sorting.
_FEW_PAIRS = 2**12
# The two ends of a window of sorted numbers.
_WINDOW: tuple[tuple[int, Literal["left", "right"]], ...] = ((-1, "left"), (1, "right"))


def joints(control_points: Any) -> Any:
    """Index of the segment that starts at the end of each segment, or -1.

    Of several, the first after it in the list counts, cyclically; itself comes last. A segment that is one point can
    only follow the segment before it in the list. The result is a NumPy array for known points.
    """
    # Integers have no derivatives: if the points are traced only for derivatives, they are known.
    control_points = undifferentiated(control_points)
    count, points = control_points.shape[-3], control_points.shape[-2]
    if points == 1:
        return np.full((count,), -1)
    xp = jnp if is_traced(control_points) else np
    pieces: Any = control_points if xp is jnp else np.asarray(control_points)
    # Ends that agree to this many ulp of the largest coordinate are one joint: conversions between curve formats and
    # knot insertion leave differences of one to four.
    tolerance = 8 * float(jnp.finfo(control_points.dtype).eps) * xp.max(xp.abs(pieces))
    single: Any = xp.max(xp.abs(pieces - pieces[:, :1]), axis=(-2, -1)) <= tolerance
    if xp is jnp:
        return _meeting(jnp.arange(count), pieces[:, -1], pieces[:, 0], single, tolerance)
    next_segment = np.arange(1, count + 1)
    apart = np.max(np.abs(pieces[:-1, -1] - pieces[1:, 0]), axis=-1) > tolerance
    loose = np.append(np.flatnonzero(apart), count - 1)
    found = _meeting if len(loose) * count <= _FEW_PAIRS else _found
    next_segment[loose] = found(loose, pieces[loose, -1], pieces[:, 0], single, tolerance)
    return next_segment


def _meeting(rows: Any, ends: Any, starts: Any, single: Any, tolerance: Any) -> Any:
    """`joints` for the segments `rows`, whose ends are `ends`, by comparing them with all starts."""
    xp, count = module_of(starts), len(starts)
    index = np.arange(count)
    meets = xp.max(xp.abs(ends[:, None] - starts), axis=-1) <= tolerance
    meets = meets & (~single | (index == rows[:, None] + 1))
    # Rank of each candidate: itself last, otherwise by distance along the list, so the next segment comes first.
    rank = xp.where(meets, (index - rows[:, None] - 1) % count, count)
    return xp.where(xp.min(rank, axis=-1) < count, xp.argmin(rank, axis=-1), -1)


def _found(rows: np.ndarray, ends: np.ndarray, starts: np.ndarray, single: np.ndarray, tolerance: Any) -> np.ndarray:
    """`joints` for the segments `rows`, whose ends are `ends`, by looking among starts sorted along one coordinate."""
    count, best = len(starts), np.full(len(rows), len(starts))
    orders = np.argsort(starts, axis=0, kind="stable")
    # Twice as wide as the tolerance, so that rounding of the ends of windows does not matter.
    windows = [
        [np.searchsorted(starts[order, k], ends[:, k] + sign * 2 * tolerance, side) for sign, side in _WINDOW]
        for k, order in enumerate(orders.T)
    ]
    # The coordinate that tells the starts apart best.
    axis = int(np.argmin([np.sum(last - first) for first, last in windows]))
    first, width = windows[axis][0], windows[axis][1] - windows[axis][0]
    # Pairs of ends compared at once, so that many ends that nearly meet need only tens of megabytes.
    for part in np.array_split(np.arange(len(rows)), 1 + int(width.sum()) // 2**20):
        row = np.repeat(part, width[part])
        within = np.arange(len(row)) - np.repeat(np.cumsum(width[part]) - width[part], width[part])
        start = orders[first[row] + within, axis]
        meets = np.max(np.abs(ends[row] - starts[start]), axis=-1) <= tolerance
        meets &= ~single[start] | (start == rows[row] + 1)
        np.minimum.at(best, row[meets], (start[meets] - rows[row[meets]] - 1) % count)
    return np.where(best < count, (best + rows + 1) % count, -1)


def checked(next_segment: Any, count: int) -> Int[Array, " segments"]:
    """`next_segment` as given, an integer array for `count` segments; ValueError if it is invalid."""
    given = next_segment if isinstance(next_segment, Array) else np.asarray(next_segment)
    if given.dtype == object:
        raise ValueError("next_segment has entries that are not integers or are too large.")
    next_segment = array_of(given)
    if next_segment.shape != (count,) or not jnp.issubdtype(next_segment.dtype, jnp.integer):
        raise ValueError(
            f"next_segment has shape {next_segment.shape} and dtype {next_segment.dtype}; needs ({count},) integers."
        )
    if is_traced(next_segment):
        return next_segment.astype(int)
    known = np.asarray(next_segment)
    bad = np.flatnonzero((known < -1) | (known >= count))
    if len(bad):
        raise ValueError(f"next_segment[{bad[0]}] is {known[bad[0]]}; needs -1 or a segment below {count}.")
    return array_of(known.astype(int))


def linked(next_segment: Any) -> Any:
    """`next_segment` as pairs of floats: each number plus one, and a one; a NumPy array for known numbers.

    jax.grad does not accept integers. The derivative of these floats is zero, so optimizers leave them unchanged.
    Scaling all parameters, as weight decay does, changes no quotient.
    """
    xp = jnp if is_traced(next_segment) else np
    # Not stacked: JAX does not stack explicitly sharded numbers with constants.
    number = (xp.asarray(next_segment) + 1)[..., None]
    return xp.where(np.array([True, False]), number, 1).astype(jnp.result_type(float))


def followed(links: Any) -> Any:
    """`next_segment` from the result of `linked`, a NumPy array for known numbers; integers stay. Zeros give -1."""
    if jnp.issubdtype(links.dtype, jnp.integer):
        return links
    # The numbers are known if they are traced only for derivatives.
    links = undifferentiated(links)
    xp = jnp if is_traced(links) else np
    pairs: Any = xp.asarray(links)
    some = pairs[..., 1] != 0
    quotient = xp.where(some, pairs[..., 0], 0.0) / xp.where(some, pairs[..., 1], 1.0)
    return xp.rint(quotient).astype(int) - 1


def completed(next_segment: Any, control_points: Any) -> Any:
    """`next_segment` with each -1 replaced by the segment that `joints` finds."""
    if is_traced(next_segment):
        return jnp.where(next_segment < 0, joints(control_points), next_segment)
    if np.all(np.asarray(next_segment) >= 0):
        return next_segment
    found = joints(control_points)
    xp = jnp if is_traced(found) else np
    return xp.where(np.asarray(next_segment) < 0, found, np.asarray(next_segment))


def united(parts: Sequence[Any], points: Any) -> Any:
    """Joints of several curves as one, and of its free ends that meet.

    Args:
        parts: for each curve the index of the segment that follows each of its segments, or -1.
        points: control points of all curves.
    """
    xp = jnp if is_traced(parts) else np
    first = np.cumsum([0, *map(len, parts)])
    rows = [xp.asarray(part) for part in parts]
    return completed(xp.concatenate([xp.where(x < 0, -1, x + k) for x, k in zip(rows, first, strict=False)]), points)


def turned(next_segment: Any) -> Any:
    """`next_segment` of the segments in reverse order and direction; if two lead to one segment, one of them counts."""
    count = next_segment.shape[0]
    index = np.arange(count)
    # The free ends, -1, all write to the slot behind the last.
    if is_traced(next_segment):
        preceding = jnp.full(count + 1, -1).at[next_segment].set(index)
        return jnp.where(preceding[:-1] >= 0, count - 1 - preceding[:-1], -1)[::-1]
    preceding = np.full(count + 1, -1)
    preceding[np.asarray(next_segment)] = index
    return np.where(preceding[:-1] >= 0, count - 1 - preceding[:-1], -1)[::-1]
