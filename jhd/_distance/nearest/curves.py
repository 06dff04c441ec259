"""The proven nearest point: distance from one point to all segments of a curve, from both sides.

A best-first search over cells (a segment and an interval of its parameter). With e_i = P - b_i restricted to the cell,
|e(s)|^2 is a polynomial whose smallest Bernstein coefficient bounds the squared distance from below. Cutting the cell
at a local foot makes the bound exact up to the error of the foot, because each half is then monotone near the cut. One
to three cuts close a segment that holds the nearest point, none or one a segment that does not.

Rounding. P, b_i and w_i are exact floats. Write r for the largest |P - b_i| component of the segment, g(k) for
rounding.gamma(k), q for the degree, d for the dimension.
 - n_i = w_i (P - b_i) takes two roundings, restriction three a level: each component of the restricted n_j is a sum of
   non-negative multiples of the n_i, each with a relative error of at most g(3 q + 2), so it is off by at most
   g(3 q + 2) r w_j, and the computed n(s) by at most g(3 q + 2) r w(s). Dividing by w(s): the computed |n|/w is within
   eta = sqrt(d) g(3 q + 3) r of the distance, whatever the weights; w(s) itself is off by a relative g(3 q).
 - The coefficients N_k = sum c_ij n_i.n_j and W_k = sum c_ij w_i w_j have non-negative c_ij that sum to one. With
   rho = max |n_j| / w_j on the cell, N_k is off by at most g(q + d + 6) rho^2 W_k.
 - So distance >= sqrt(min N_k / W_k - g(q + d + 7) rho^2) (1 - g(7 q + 12)) - eta, and at a point
   distance <= |n| / w (1 + g(3 q + d + 6)) + eta.
Flushed subnormals add at most a few smallest normal numbers a step, 40 (q + 2) nu in all where lengths are added, and
the same under the root where squares are, on rational curves divided by the smallest weight and its square. The callers
scale by a power of two, and constructors of curves limit the ratio of weights, so these do not show.

Source: the hull bound and its quadratic convergence are in Farouki & Rajan, CAGD 5 (1988); the cut at the foot is ours.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int

from jhd._arithmetic import bernstein
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.nearest.feet import foot_in
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import Piece
from jhd._runtime.arrays import varying

# Open cells without the whole segments. A search holds a handful; symmetric and degenerate input up to about twenty.
_CAPACITY = 32
# Cuts for one point, in addition to one for each segment. Random queries take 1 to 6; a point at the center of a nearly
# circular stretch some 60.
_MAX_STEPS = 400
# A foot closer to an end than this fraction of the cell does not serve as a cut; the cut is then _ZOOM from that end.
_NEAR_END = 0.01
_ZOOM = 0.125
# Cells are closed a little below the tolerance, so that rounding of the comparison cannot exceed it.
_CLOSE = 0.99


class NearestOnCurve(eqx.Module):
    """Bounds of the distance from each query point to a curve, and the foot that attains the upper bound."""

    distance: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    segment: Int[Array, "*batch"]
    t: Float[Array, "*batch"]
    closed: Bool[Array, "*batch"]
    steps: Int[Array, "*batch"]


class _SegmentCell(eqx.Module):
    """Parts of segments. One array for several numbers compiles faster than one for each."""

    segment: Array
    numbers: Array  # (..., 4): lower bound, the ends of the part, and the start for the search of a foot

    @property
    def lower(self) -> Array:
        return self.numbers[..., 0]


class _CurveQuery(eqx.Module):
    whole: Array  # lower bounds of the segments not yet cut, inf where cut
    cells: _SegmentCell  # the stack; a free slot has lower = inf
    best: NearestOnCurve
    settled: Array  # smallest lower bound of the cells that were closed, or found no room
    steps: Array


@jax.jit
def nearest(
    point: Float[Array, " dim"],
    control_points: Float[Array, "segments points dim"],
    weights: Float[Array, "segments points"] | None,
    tolerance: Float[Array, ""] | float = 0.0,
    skip: Bool[Array, " segments"] | None = None,
) -> NearestOnCurve:
    """Return the proven nearest point of all segments to one point.

    Args:
        point: the query.
        control_points: the segments, scaled so that squares neither overflow nor vanish.
        weights: positive, or None.
        tolerance: the search stops at upper - lower <= tolerance, or the rounding error if larger; if cells cannot be
            cut again or find no room, it may stop at eight times this length.
        skip: segments that repeat others and need no search; see `repeated`.
    """
    count = control_points.shape[0]
    offsets = point - control_points
    radius = jnp.max(jnp.abs(offsets), axis=(1, 2))
    floor = _resolution(offsets.shape[1] - 1, offsets.shape[2], jnp.max(radius))
    tolerance = jnp.maximum(floor, tolerance)
    lower, start = segment_bounds(point, control_points, weights)
    state = _CurveQuery(
        whole=lower if skip is None else jnp.where(skip, jnp.inf, lower),
        cells=_SegmentCell(jnp.zeros((_CAPACITY,), int), jnp.full((_CAPACITY, 4), jnp.inf, point.dtype)),
        best=best_end(offsets),
        settled=jnp.array(jnp.inf, point.dtype),
        steps=jnp.array(0),
    )

    def unfinished(state: _CurveQuery) -> Array:
        return (_open_lower(state) < state.best.upper - _CLOSE * tolerance) & (state.steps < _MAX_STEPS + count)

    def step(state: _CurveQuery) -> _CurveQuery:
        bounds = jnp.concatenate([state.whole, state.cells.lower])
        index = jnp.argmin(bounds)
        is_whole, slot = index < count, index - count
        taken = jax.tree_util.tree_map(lambda x: x[jnp.maximum(slot, 0)], state.cells)
        segment = jnp.where(is_whole, index, taken.segment)
        ends = jnp.zeros_like(tolerance), jnp.ones_like(tolerance)
        fresh = _SegmentCell(segment, jnp.stack([bounds[index], *ends, start[segment]]))
        cell = jax.tree_util.tree_map(lambda x, y: jnp.where(is_whole, x, y), fresh, taken)
        whole = jnp.where(jnp.arange(count) == index, jnp.inf, state.whole)
        numbers = jnp.where((jnp.arange(_CAPACITY) == slot)[:, None], jnp.inf, state.cells.numbers)
        state = _CurveQuery(
            whole,
            _SegmentCell(state.cells.segment, numbers),
            state.best,
            state.settled,
            state.steps + 1,
        )
        return _cut(state, cell, offsets[segment], None if weights is None else weights[segment], tolerance)

    state = jax.lax.while_loop(unfinished, step, varying(state, offsets, weights, tolerance))
    lower = jnp.minimum(jnp.minimum(_open_lower(state), state.settled), state.best.upper)
    # Cells of a few ulp are settled with the bounds they have, which are wide if weights are very uneven.
    # Cells that cannot be cut again are closed at this multiple of the tolerance. In single precision, of 18,000
    # queries of curves with even weights, five stay open at one tolerance and none at eight.
    closed = lower >= state.best.upper - 8 * tolerance
    closed &= _open_lower(state) >= state.best.upper - tolerance
    return eqx.tree_at(
        lambda n: (n.lower, n.closed, n.steps), state.best, (jnp.maximum(lower, 0.0), closed, state.steps)
    )


def segment_bounds(point: Array, control_points: Array, weights: Array | None) -> tuple[Array, Array]:
    """Return lower bounds of the distances to whole segments, and the parameters of their smallest coefficients."""
    offsets = point - control_points
    return jax.vmap(cell_bound)(*_homogeneous(offsets, weights), jnp.max(jnp.abs(offsets), axis=(1, 2)))


def _resolution(degree: int, dim: int, size: Array) -> Array:
    """Return the smallest gap of a search, eight times the rounding error of a distance for offsets of this size."""
    return 8 * (math.sqrt(dim) * gamma(3 * degree + 8, size.dtype) * size + _flushed(degree, size.dtype))


def repeated(control_points: Array, weights: Array | None) -> Bool[Array, " segments"]:
    """Return a mask of the segments that equal the segment before them, as padding does."""
    same = jnp.all(control_points[1:] == control_points[:-1], axis=(1, 2))
    if weights is not None:
        same &= jnp.all(weights[1:] == weights[:-1], axis=1)
    return jnp.concatenate([jnp.zeros((1,), bool), same])


def _open_lower(state: _CurveQuery) -> Array:
    return jnp.minimum(jnp.min(state.whole), jnp.min(state.cells.lower))


def _homogeneous(offsets: Array, weights: Array | None) -> tuple[Array, Array | None]:
    return (offsets, None) if weights is None else (offsets * weights[..., None], weights)


@jax.jit
def cell_bound(n: Array, w: Array | None, radius: Array) -> tuple[Array, Array]:
    """Return a lower bound of the distance over one cell, and the local parameter of its smallest coefficient."""
    q, dim, dtype = n.shape[0] - 1, n.shape[1], n.dtype
    squares = bernstein.dot(n, n)
    rho_sq = jnp.sum(n * n, axis=-1)
    lost = _flushed(q, dtype)
    if w is not None:
        weight_sq = bernstein.multiply(w, w)
        lost = lost * (1 + 1 / jnp.min(w)) / jnp.min(weight_sq)
        squares, rho_sq = squares / weight_sq, rho_sq / (w * w)
    least = jnp.min(squares) - gamma(q + dim + 7, dtype) * jnp.max(rho_sq) - lost
    distance = jnp.sqrt(jnp.maximum(least, 0.0)) * (1 - gamma(7 * q + 12, dtype))
    start = jnp.argmin(squares) / max(2 * q, 1)
    return distance - _eta(q, dim, radius), start.astype(dtype)


def _eta(degree: int, dim: int, radius: Array) -> Array:
    return math.sqrt(dim) * gamma(3 * degree + 3, radius.dtype) * radius + _flushed(degree, radius.dtype)


def _flushed(degree: int, dtype: DTypeLike) -> float:
    return 40 * (degree + 2) * smallest_normal(dtype)


def length_bound(vector: Array, degree: int, radius: Array) -> tuple[Array, Array]:
    """Return the length of the computed vector from a curve point to the query, and a bound of the true distance."""
    dim = vector.shape[-1]
    # Scaled by the largest component: squares of tiny vectors would be flushed.
    largest = jnp.max(jnp.abs(vector), axis=-1)
    safe = jnp.where(largest > 0, largest, 1.0)
    length = largest * jnp.sqrt(jnp.sum((vector / safe[..., None]) ** 2, axis=-1))
    return length, length * (1 + gamma(3 * degree + dim + 6, vector.dtype)) + _eta(degree, dim, radius)


def best_end(offsets: Array) -> NearestOnCurve:
    """Return the nearest of all segment ends. Only the offset is rounded, once."""
    ends = offsets[:, jnp.array([0, -1])]
    distance, upper = length_bound(ends, 0, jnp.max(jnp.abs(ends), axis=-1))
    index = jnp.argmin(upper)
    unset = jnp.zeros((), offsets.dtype)
    return NearestOnCurve(
        distance=distance.ravel()[index],
        lower=unset,
        upper=upper.ravel()[index],
        segment=index // 2,
        t=(index % 2).astype(offsets.dtype),
        closed=jnp.array(False),
        steps=jnp.array(0),
    )


def _cut(state: _CurveQuery, cell: _SegmentCell, e: Array, w: Array | None, tolerance: Array) -> _CurveQuery:
    """Improve the foot inside the cell, cut there, and keep the halves that may hold a nearer point."""
    degree, radius = e.shape[0] - 1, jnp.max(jnp.abs(e))
    least, low, high, start = cell.numbers
    # Newton steps for a local foot; it is started at the smallest coefficient, so three reach full precision mostly.
    foot = foot_in(0.0, Piece(e, w), start, 4, low, high)
    distance, upper = length_bound(jet(e, w, foot).point, degree, radius)
    best = state.best
    nearer = upper < best.upper
    best = NearestOnCurve(
        distance=jnp.where(nearer, distance, best.distance),
        lower=best.lower,
        upper=jnp.where(nearer, upper, best.upper),
        segment=jnp.where(nearer, cell.segment, best.segment),
        t=jnp.where(nearer, foot, best.t),
        closed=best.closed,
        steps=best.steps,
    )
    width = high - low
    at_left, at_right = foot - low <= _NEAR_END * width, high - foot <= _NEAR_END * width
    cut = jnp.where(at_left, low + _ZOOM * width, jnp.where(at_right, high - _ZOOM * width, foot))
    ends = jnp.stack([low, cut, high])
    n, w = _homogeneous(e, w)

    def half(s0: Array, s1: Array) -> Array:
        part = bernstein.restrict(n, s0, s1, axis=0)
        lower, start = cell_bound(part, None if w is None else bernstein.restrict(w, s0, s1), radius)
        return jnp.stack([jnp.maximum(lower, least), s0, s1, s0 + start * (s1 - s0)])

    halves = jax.vmap(half)(ends[:-1], ends[1:])
    lower = halves[:, 0]
    # A cell of a few ulp cannot be cut again. Near zero they are smaller, which uneven weights need.
    keep = (lower < best.upper - _CLOSE * tolerance) & (ends[1:] - ends[:-1] > 8 * jnp.finfo(e.dtype).eps * ends[1:])
    # The first half goes to the first free slot; so does the second half if the first is not kept.
    rows, free = jnp.arange(_CAPACITY), jnp.isinf(state.cells.lower)
    first = jnp.argmax(free)
    second = jnp.where(keep[0], jnp.argmax(free & (rows != first)), first)
    room = jnp.stack([jnp.any(free), jnp.sum(free) > keep[0]])
    here = (rows == jnp.stack([first, second])[:, None]) & (keep & room)[:, None]
    segments = jnp.where(here[0] | here[1], cell.segment, state.cells.segment)
    numbers = jnp.where(here[1][:, None], halves[1], jnp.where(here[0][:, None], halves[0], state.cells.numbers))
    settled = jnp.minimum(state.settled, jnp.min(jnp.where(keep & room, jnp.inf, lower)))
    return _CurveQuery(state.whole, _SegmentCell(segments, numbers), best, settled, state.steps)
