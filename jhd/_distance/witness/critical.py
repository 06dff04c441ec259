"""Critical pairs: the local maxima of the distance between two curves, in both directions, with their derivatives.

They are the active set of a minimax problem: if one curve is fitted to the other, several of them are equal.
jhd._distance.witness.maxima finds the maxima of one direction. A maximum that is narrower than the spacing of the
samples can be missed, so the list may be incomplete. The entry, jhd._distance.critical_pairs, checks the largest one.

Source: the events are those of Elber & Grandine, GMP 2008; the search is ours.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.curves import prepare
from jhd._distance.witness.maxima import local_maxima
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, CriticalPairs, Witness, result_where
from jhd._runtime.arrays import undifferentiated
from jhd._runtime.compiled import compiled
from jhd._shapes.curve import BezierSegments


def local_pairs(a: BezierSegments, b: BezierSegments, capacity: int) -> tuple[CriticalPairs, Frame]:
    """Return the critical pairs that samples show, without derivatives, and the frame of the search."""
    p, q, frame = prepare(*undifferentiated((a, b)))
    return _placed(_both(p, q, capacity), frame), frame


def _placed(found: CriticalPairs, frame: Frame) -> CriticalPairs:
    """Return the pairs in the user's coordinates."""
    witness = replace(found.witness, point=frame.place(found.witness.point), feet=frame.place(found.witness.feet))
    usable = jnp.asarray(frame.usable)
    result = result_where(usable, found.result, RESULTS.nonfinite_value)
    return CriticalPairs(frame.length(found.value), witness, found.valid & usable, result)


@partial(compiled, static=(2,))
def _both(a: BezierSegments, b: BezierSegments, capacity: int) -> CriticalPairs:
    """Return critical pairs in the common coordinates."""
    # One compiled function for both directions, one after the other: compiling two would take twice as long.
    count = max(a.count, b.count)
    pairs = jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), _padded(a, count), _padded(b, count))
    turned = jax.tree_util.tree_map(lambda x: x[::-1], pairs)
    found = jax.lax.map(lambda pair: local_maxima(pair[0], pair[1], 2 * capacity), (pairs, turned))
    there, back = (jax.tree_util.tree_map(lambda x, k=k: x[k], found) for k in range(2))
    back = _of_other_direction(back)
    value = jnp.concatenate([there[0], jnp.where(_repeats(there, back), -jnp.inf, back[0])])
    witness = jax.tree_util.tree_map(lambda x, y: jnp.concatenate([x, y]), there[1], back[1])
    order = jnp.argsort(-value)[:capacity]
    kept = value[order]
    valid = kept > -jnp.inf
    # Unused entries repeat the first one, so that no derivative meets an empty system.
    order = jnp.where(valid, order, order[0])
    full = jnp.sum(value > -jnp.inf) > capacity
    result = result_where(full, RESULTS.capacity_reached, RESULTS.successful)
    kept_witness = jax.tree_util.tree_map(lambda x: x[order], witness)
    return CriticalPairs(jnp.where(valid, kept, 0.0), kept_witness, valid, result)


def _padded(curve: BezierSegments, count: int) -> BezierSegments:
    """Return the curve padded by repeating its last segment."""
    index = np.minimum(np.arange(count), curve.count - 1)
    return jax.tree_util.tree_map(lambda x: jnp.asarray(x)[index], curve)


def _of_other_direction(found: tuple[Array, Witness]) -> tuple[Array, Witness]:
    value, witness = found
    turned = jax.vmap(lambda _: DIRECTIONS.b_to_a)(value)
    return value, replace(witness, direction=turned)


def _repeats(there: tuple[Array, Witness], back: tuple[Array, Witness]) -> Array:
    """Return a mask of the maxima of one direction that are pairs of the other: equal points, held in the same way.

    An end with a foot near an end of the other curve, and that end with the first end as its foot, are two maxima.
    """
    (first, w), (_, v) = there, back

    def apart(x: Array, y: Array) -> Array:
        return jnp.max(jnp.abs(x[:, None] - y), axis=-1)

    def held(x: Witness) -> tuple[Array, Array]:
        carrier, s = (x.event == EVENTS.a_end) | (x.event == EVENTS.corner), x.feet_params[:, 0]
        return carrier, (x.event == EVENTS.b_end) | carrier & ((s <= 0) | (s >= 1))

    (w_carrier, w_foot), (v_carrier, v_foot) = held(w), held(v)
    alike = (v_carrier[:, None] == w_foot) & (v_foot[:, None] == w_carrier)
    # Pairs at equal points, in the common coordinates, are one pair.
    crosswise = alike & (jnp.maximum(apart(v.point, w.feet[:, 0]), apart(v.feet[:, 0], w.point)) < 1e-5)
    single = jnp.any(v.multipliers == 0, axis=-1)[:, None] & jnp.any(w.multipliers == 0, axis=-1)
    return jnp.any(crosswise & single & (first > -jnp.inf), axis=1)
