"""Minimum distances of curves and parametric surfaces: in one compiled function under tracing, else from the host."""

from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.pairs import Parametric
from jhd._distance.normalization.coordinates import extremes
from jhd._distance.normalization.host_callback import by_kept_program
from jhd._distance.normalization.net_jets import Net, jet, point_error
from jhd._distance.normalization.nets import net_of, prepare_nets
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.closest import (
    ClosestState,
    Outcome,
    Reached,
    WantedGap,
    advance,
    begin,
    in_one_go,
    news_of,
    outcome,
    pairs_of,
    reached_by,
    room_for,
    wanted_gap,
)
from jhd._distance.search.search import Listener, drive
from jhd._distance.search.two_phase_minimum import InTurn
from jhd._distance.witness.mixed_derivatives import with_pair_derivatives
from jhd._distance.witness.nets import polished
from jhd._results.solution import MinimumSolution
from jhd._runtime.arrays import is_tracing, undifferentiated
from jhd._runtime.compiled import compiled
from jhd.progress import Callback

# Pairs of pieces whose boxes are compared at once.
_TOGETHER = 1 << 14


def of_nets(a: Any, b: Any, method: BranchAndBound, progress: Callback | None) -> MinimumSolution:
    """Return the minimum distance of curves and parametric surfaces, differentiable in both."""
    nets = net_of(a), net_of(b)
    counts = nets[0].points.shape[0], nets[1].points.shape[0]
    p, q, frame, error = prepare_nets(*undifferentiated(nets))
    problem = Parametric(p, q, np.asarray(error, p.points.dtype))
    wanted = wanted_gap([extremes(net.points) for net in (p, q)], frame, method, problem.floor)
    # Inside jit all operations are traced, also on known numbers.
    if is_tracing(problem, wanted):
        search = _TracedMinimum(counts, method.queue_size, method.max_steps)
        found = by_kept_program(
            search, Outcome.like(p.points.dtype, p.parameters + q.parameters, p.dim), (problem, wanted)
        )
    else:
        pairs, valid = _near_pairs(p, q, counts)
        begun = partial(_begun, problem, pairs, valid, room_for(len(pairs), method.queue_size))
        search = InTurn(
            begun,
            partial(_stretch, problem, wanted),
            lambda best: problem,
            lambda best: best,
            partial(_shown, problem, wanted),
            wanted,
        )
        found = drive(search, Listener(progress, frame))
    best = found.best
    return with_pair_derivatives(found.solution(frame), nets, (best.piece_a, best.piece_b), best.x, best.distance)


class _TracedMinimum(NamedTuple):
    """The search over all pairs of the first `counts` pieces, in one compiled function."""

    counts: tuple[int, int]
    capacity: int
    max_steps: int

    def __call__(self, problem: Parametric, wanted: WantedGap) -> Outcome:
        """The outcome for a problem."""
        return in_one_go(partial(_all_pairs, self.counts, self.capacity), _outcome, problem, wanted, self.max_steps)


def _all_pairs(counts: tuple[int, int], capacity: int, problem: Parametric) -> ClosestState:
    pairs = pairs_of(counts)
    return begin(problem, jnp.asarray(pairs), jnp.ones(len(pairs), bool), room_for(len(pairs), capacity))


def _outcome(problem: Parametric, wanted: WantedGap, reached: Reached) -> Outcome:
    """Return bounds and points of the search as it stands, the nearest pair polished."""
    a, b, error = problem
    dtype, n = reached.lower.dtype, a.parameters
    best = polished(a, b, reached.best)
    points = jet(a.piece(best.piece_a), best.x[:n]).point, jet(b.piece(best.piece_b), best.x[n:]).point
    upper = best.distance * (1 + gamma(12, dtype)) + point_error(a) + point_error(b)
    upper = jnp.minimum(upper, reached.best.upper) * (1 + gamma(6, dtype)) + error
    lower = jnp.maximum(reached.lower * (1 - gamma(6, dtype)) - error, 0.0)
    # The search closes pairs below the tolerance by more than the error of preparing.
    return outcome(wanted, reached, best, (jnp.minimum(lower, upper), upper), points, problem.floor + 2 * error)


_begun = compiled(begin, (3,))


@compiled
def _stretch(
    problem: Parametric, wanted: WantedGap, state: ClosestState, limit: Array, growing: Array
) -> tuple[ClosestState, Outcome, Array]:
    """Take some steps, and return the table, the outcome and four numbers on the progress."""
    state = advance(problem, wanted, state, limit, growing)
    return state, _outcome(problem, wanted, reached_by(state)), news_of(problem, wanted, state, growing)


_shown = compiled(_outcome)


def _near_pairs(a: Net, b: Net, counts: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of pieces with boxes within an upper bound of the distance, padded to a power of two.

    Corners of pieces are points of the shapes. The slack is far more than the roundings of boxes and lengths. Pairs
    left out do not matter, since their distance is larger.
    """
    if counts[0] > counts[1]:
        pairs, valid = _near_pairs(b, a, (counts[1], counts[0]))
        return pairs[:, ::-1], valid
    x, y = (np.asarray(net.points)[:count] for net, count in zip((a, b), counts, strict=True))
    upper, kept, rows = np.inf, [], 1 + _TOGETHER // len(y)
    parts = [slice(k, k + rows) for k in range(0, len(x), rows)]
    for part in parts:
        upper = min(upper, float(np.sqrt(np.sum((x[part, None, 0, 0] - y[:, 0, 0]) ** 2, axis=-1)).min()))
    slack = 1e4 * float(np.finfo(x.dtype).eps)
    low_a, high_a, low_b, high_b = x.min((1, 2)), x.max((1, 2)), y.min((1, 2)), y.max((1, 2))
    for part in parts:
        apart = np.maximum(np.maximum(low_a[part, None] - high_b, low_b - high_a[part, None]), 0.0)
        near = np.sqrt(np.sum(apart**2, axis=-1)) <= upper * (1 + slack) + slack
        kept.append(np.argwhere(near) + [part.start, 0])
    pairs = np.concatenate(kept)
    size = max(16, 1 << (len(pairs) - 1).bit_length())
    index = np.minimum(np.arange(size), len(pairs) - 1)
    return pairs[index], np.arange(size) < len(pairs)
