"""Minimum distances of curves and parametric surfaces: in one program under tracing, from the host elsewhere."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma
from jhd.arrays import is_traced, is_tracing
from jhd.compiled import compiled
from jhd.distance.frame.aim import default_tolerance
from jhd.distance.frame.coordinates import Frame, diagonal, extremes
from jhd.distance.frame.net_jets import Net, jet, point_error
from jhd.distance.frame.nets import net_of, prepare_nets
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.closest import (
    FIRST_STEPS,
    GROWTH,
    LONGEST,
    ClosestState,
    Outcome,
    Parametric,
    advance,
    begin,
    is_open,
    longer,
    lower_of,
    news_of,
    room_for,
)
from jhd.distance.search.search import AbstractSearch, Listener, Progress, Standing, drive
from jhd.distance.witness.nets import polished, with_net_derivatives
from jhd.solution import RESULTS, MinimumSolution, result_where


class _Asked(NamedTuple):
    """Tolerances in common coordinates, and what preparing the shapes may have changed."""

    atol: Array
    rtol: Array
    error: Array


def of_nets(a: Any, b: Any, method: BranchAndBound, progress: Callable[[Progress], object] | None) -> MinimumSolution:
    """Minimum distance of curves and parametric surfaces, in common coordinates, with derivatives in both."""
    nets = net_of(a), net_of(b)
    counts = nets[0].points.shape[0], nets[1].points.shape[0]
    p, q, frame, error = prepare_nets(*jax.lax.stop_gradient(nets))
    wanted = _wanted(p, q, frame, error, method)
    # Inside jit all operations are traced, those on known numbers too.
    if is_tracing(p, q, wanted):
        found = _in_one_go(p, q, counts, wanted, method)
    else:
        found = drive(NetSearch(p, q, counts, wanted, method), Listener(progress, frame.length))
    return with_net_derivatives(found.solution(frame), *nets, frame, found.best)


class NetSearch(AbstractSearch):
    """The search of jhd.distance.search.closest for two nets.

    Args:
        a: the first shape in common coordinates.
        b: the second one.
        counts: the numbers of their pieces, without those that pad them.
        wanted: what is asked for.
        method: the options.
    """

    first_steps = FIRST_STEPS

    def __init__(self, a: Net, b: Net, counts: tuple[int, int], wanted: _Asked, method: BranchAndBound):
        self._nets, self._counts, self._wanted = (a, b), counts, wanted
        self._capacity, self.max_steps = method.capacity, method.max_steps

    def begin(self) -> ClosestState:
        """See AbstractSearch."""
        pairs, valid = _near_pairs(*self._nets, self._counts)
        return _begun(*self._nets, pairs, valid, room_for(len(pairs), self._capacity))

    def advance(self, state: ClosestState, limit: int, growing: bool) -> tuple[ClosestState, Standing]:
        """See AbstractSearch."""
        growing = growing and state.lower.size < LONGEST
        state, found, news = _stretch(*self._nets, self._wanted, state, np.asarray(limit), np.asarray(growing))
        return state, Standing(found, *np.asarray(news))

    def longer(self, state: ClosestState) -> ClosestState:
        """See AbstractSearch."""
        return longer(state, GROWTH)


def _wanted(a: Net, b: Net, frame: Frame, error: float, method: BranchAndBound) -> _Asked:
    xp: Any = jnp if is_traced(a, b, method, frame) else np
    points = [xp.asarray(net.points) for net in (a, b)]
    dtype = points[0].dtype
    if method.atol is None:
        absolute = default_tolerance(diagonal([extremes(x) for x in points]), dtype, Parametric(a, b).floor)
    else:
        absolute = frame.common(method.atol)
    return _Asked(xp.asarray(absolute, dtype), xp.asarray(method.rtol, dtype), xp.asarray(error, dtype))


def _pairs(counts: tuple[int, int]) -> np.ndarray:
    return np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 2)


def _in_one_go(a: Net, b: Net, counts: tuple[int, int], wanted: _Asked, method: BranchAndBound) -> Outcome:
    """All in one program; of a batch the searches run one after the other on a CPU, side by side elsewhere."""
    pairs = _pairs(counts)

    def search(a: Net, b: Net, wanted: _Asked) -> Outcome:
        room = room_for(len(pairs), method.capacity)
        state = begin(a, b, jnp.asarray(pairs), jnp.ones(len(pairs), bool), room)
        state = advance(Parametric(a, b), wanted.atol, wanted.rtol, state, method.max_steps)
        return _outcome(a, b, wanted, state)

    if jax.default_backend() == "cpu":
        search = sequential_vmap(search)
    return search(a, b, wanted)


def _outcome(a: Net, b: Net, wanted: _Asked, state: ClosestState) -> Outcome:
    """Bounds and points of the search as it stands, the nearest pair polished."""
    dtype, n = state.lower.dtype, a.parameters
    best = polished(a, b, state.best)
    point_a = jet(a.piece(best.piece_a), best.x[:n]).point
    point_b = jet(b.piece(best.piece_b), best.x[n:]).point
    upper = best.distance * (1 + gamma(12, dtype)) + point_error(a) + point_error(b)
    upper = jnp.minimum(upper, state.best.upper) * (1 + gamma(6, dtype)) + wanted.error
    lower = jnp.maximum(lower_of(state) * (1 - gamma(6, dtype)) - wanted.error, 0.0)
    lower = jnp.minimum(lower, upper)
    # The search closes pairs below the tolerance by more than the error of preparing.
    granted = jnp.maximum(jnp.maximum(wanted.atol, wanted.rtol * upper), 2 * Parametric(a, b).floor + 4 * wanted.error)
    failed = result_where(state.lost, RESULTS.capacity_reached, RESULTS.gap_not_closed)
    result = result_where(upper - lower <= granted, RESULTS.successful, failed)
    stats = {"steps": state.steps, "pairs": state.pairs, "waiting": jnp.sum(jnp.isfinite(state.lower))}
    best = best._replace(distance=jnp.clip(best.distance, lower, upper))
    return Outcome(best, lower, upper, point_a, point_b, result, stats)


_begun = compiled(begin, (4,))


@compiled
def _stretch(
    a: Net, b: Net, wanted: _Asked, state: ClosestState, limit: Array, growing: Array
) -> tuple[ClosestState, Outcome, Array]:
    """Goes on for some steps, and says how the search stands, in four numbers."""
    state = advance(Parametric(a, b), wanted.atol, wanted.rtol, state, limit, growing)
    going_on = is_open(Parametric(a, b), wanted.atol, wanted.rtol, state)
    return state, _outcome(a, b, wanted, state), news_of(state, going_on, growing)


def _near_pairs(a: Net, b: Net, counts: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The pairs of pieces whose boxes are not farther apart than two points of the shapes, padded to a power of two.

    Corners of pieces are points of the shapes. The slack is far more than the roundings of boxes and lengths; of pairs
    left out nothing has to be known, since their distance is larger.
    """
    if counts[0] > counts[1]:
        pairs, valid = _near_pairs(b, a, (counts[1], counts[0]))
        return pairs[:, ::-1], valid
    x, y = (np.asarray(net.points)[:count] for net, count in zip((a, b), counts, strict=True))
    upper, kept = np.inf, []
    for i in range(len(x)):
        upper = min(upper, float(np.sqrt(np.sum((x[i, 0, 0] - y[:, 0, 0]) ** 2, axis=-1)).min()))
    slack = 1e4 * float(np.finfo(x.dtype).eps)
    low_a, high_a, low_b, high_b = x.min((1, 2)), x.max((1, 2)), y.min((1, 2)), y.max((1, 2))
    for i in range(len(x)):
        apart = np.maximum(np.maximum(low_a[i] - high_b, low_b - high_a[i]), 0.0)
        near = np.flatnonzero(np.sqrt(np.sum(apart**2, axis=-1)) <= upper * (1 + slack) + slack)
        kept.append(np.stack([np.full(len(near), i), near], axis=-1))
    pairs = np.concatenate(kept)
    size = max(16, 1 << (len(pairs) - 1).bit_length())
    index = np.minimum(np.arange(size), len(pairs) - 1)
    return pairs[index], np.arange(size) < len(pairs)
