"""Which segment of a curve starts where another one ends, so that a seam is not taken for a free end."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jhd.arrays import is_traced

# Ends that agree to this many ulp of the largest coordinate are one joint: conversions between curve formats and knot
# insertion leave differences of one to four.
_JOINT_ULPS = 8

# Pairs of segment ends compared at once, so that many loose segments need tens of megabytes and not the square of them.
_JOINT_CHUNK = 2**20


def joints(control_points: Array) -> Int[Array, " segments"]:
    """For each segment the one that starts where it ends: the next if it does, else the first, else itself, else -1.

    A segment that is one point follows none but the one before it in the list: it is no way on from an end.
    """
    count, points = control_points.shape[-3], control_points.shape[-2]
    if points == 1:
        return jnp.full((count,), -1)
    xp = jnp if is_traced(control_points) else np
    pieces = control_points if xp is jnp else np.asarray(control_points)
    tolerance = _JOINT_ULPS * float(jnp.finfo(control_points.dtype).eps) * xp.max(xp.abs(pieces))
    single = xp.max(xp.abs(pieces - pieces[:, :1]), axis=(-2, -1)) <= tolerance
    if xp is jnp:
        return _meeting(jnp, jnp.arange(count), pieces[:, -1], pieces[:, 0], single, tolerance)
    following = np.arange(1, count + 1)
    apart = np.max(np.abs(pieces[:-1, -1] - pieces[1:, 0]), axis=-1) > tolerance
    loose = np.append(np.flatnonzero(apart), count - 1)
    for rows in np.array_split(loose, 1 + len(loose) * count // _JOINT_CHUNK):
        following[rows] = _meeting(np, rows, pieces[rows, -1], pieces[:, 0], single, tolerance)
    return jnp.asarray(following)


def _meeting(xp: Any, rows: Any, ends: Any, starts: Any, single: Any, tolerance: Any) -> Any:
    """`joints` for the segments `rows`, whose ends are `ends`, in numpy or jax.numpy as xp says."""
    count = len(starts)
    index = xp.arange(count)
    meets = xp.max(xp.abs(ends[:, None] - starts), axis=-1) <= tolerance
    meets = meets & (~single | (index == rows[:, None] + 1))
    # Rank of each candidate: itself last, otherwise by distance along the list, so the next segment comes first.
    rank = xp.where(meets, (index - rows[:, None] - 1) % count, count)
    return xp.where(xp.min(rank, axis=-1) < count, xp.argmin(rank, axis=-1), -1)


def completed(following: Any, control_points: Array) -> Int[Array, " segments"]:
    """`following` as it is known, and where it is -1 the segment that `joints` finds."""
    if is_traced(following):
        return jnp.where(following < 0, joints(control_points), following)
    if np.all(np.asarray(following) >= 0):
        return jnp.asarray(following)
    found = joints(control_points)
    xp = jnp if is_traced(found) else np
    return jnp.asarray(xp.where(np.asarray(following) < 0, xp.asarray(found), np.asarray(following)))


def turned(following: Any) -> Any:
    """`following` of the segments in the opposite order and direction; where two lead to one, one of them counts."""
    count = following.shape[0]
    index = np.arange(count)
    # The free ends, -1, all write to the slot behind the last.
    if is_traced(following):
        preceding = jnp.full(count + 1, -1).at[following].set(index)
        return jnp.where(preceding[:-1] >= 0, count - 1 - preceding[:-1], -1)[::-1]
    preceding = np.full(count + 1, -1)
    preceding[np.asarray(following)] = index
    return np.where(preceding[:-1] >= 0, count - 1 - preceding[:-1], -1)[::-1]
