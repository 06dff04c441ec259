"""Cells of a certificate: parts of a with a map into b each, cut until an exact check accepts every one of them.

All of a curve is cut breadth first. The ends of a cell get their proven nearest feet (jhd.distance.nearest.curves); a
branch follows one of them over the cell, and sigma is written down from the feet and their speeds at both ends: affine,
a Moebius map on rational curves, a cubic (as in jhd.distance.cells.branches). Whatever is proposed here in floating
point, in common coordinates, is checked exactly on the stored arrays by jhd.distance.certificate.verification. A cell
of which no proposal is accepted is cut where the smaller of the two branches' distances is largest, which is where an
exact bound needs a cut.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jhd._runtime.arrays import taken
from jhd._runtime.compiled import compiled
from jhd.arithmetic.bernstein import basis
from jhd.distance.cells.branches import hermite, moebius_weights
from jhd.distance.certificate.host import SNAP, Host, jets, local_feet, speed_of_feet
from jhd.distance.certificate.verification.pieces import Part, composed, difference, simplex_map
from jhd.distance.certificate.verification.proofs import failure_at_most, squares_of
from jhd.distance.frame.coordinates import Frame
from jhd.distance.nearest.curves import NearestOnCurve, nearest, repeated
from jhd.distance.nearest.feet import dot
from jhd.shapes.curve import BezierSegments

# Points measured side by side: one compiled program whatever their number.
_LANES = 64
# Samples of a cell among which its peak is looked for and proposals are rejected.
_NODES = np.linspace(0.0, 1.0, 13)
# Steps of Newton's method: for a foot that starts near, for the peak among three candidates, for the chosen one alone.
_FOOT_STEPS, _PEAK_STEPS, _LAST_STEPS = 6, 4, 4
# Halvings that find a parameter to its last digit.
_BISECTIONS = 54
# A sample this much above the bound, in units of the coordinates, rejects a proposal without an exact check.
_SURELY = 1e-13
# A peak nearer than this share of the cell to an end is not the only cut: the middle is one too.
_NEAR_END = 0.05


class Places(NamedTuple):
    """Places of a: segments, parameters, with the segments and parameters of their nearest feet and the distances."""

    segment: np.ndarray
    t: np.ndarray
    foot: np.ndarray
    s: np.ndarray
    distance: np.ndarray


class _CoverCells(NamedTuple):
    """Cells with the places of their ends."""

    first: Places
    last: Places


class _Branches(NamedTuple):
    """The foot of one end of each cell, followed to the other end: its segment, parameters and speeds at both."""

    foot: np.ndarray
    s0: np.ndarray
    s1: np.ndarray
    v0: np.ndarray
    v1: np.ndarray


class UncoveredError(Exception):
    """The cells did not get below the bound; the message says where or why."""


class Measure:
    """Proven nearest feet on b for places of a, and all places measured so far.

    Args:
        a: the curve that carries the places.
        b: the stored curve that carries the feet.
        prepared: b in the common coordinates, as the search of feet takes it.
    """

    def __init__(self, a: Host, b: Host, prepared: BezierSegments):
        self.a, self.b, self.prepared = a, b, prepared
        self.skip = repeated(jnp.asarray(prepared.control_points), prepared.weights)
        self.known: list[Places] = []

    def __call__(self, segment: np.ndarray, t: np.ndarray) -> Places:
        """The places with their feet."""
        points = jets(self.a, segment, t)[0]
        found = [_nearest(self, points[k : k + _LANES]) for k in range(0, len(points), _LANES)]
        foot, s, distance = (np.concatenate([getattr(x, name) for x in found]) for name in ("segment", "t", "distance"))
        foot = np.minimum(foot, len(self.b.rows) - 1)
        s = local_feet(self.b, foot, s.astype(np.float64), points, 2)
        self.known.append(Places(segment, t, foot, s, distance))
        return self.known[-1]


def _nearest(measure: Measure, points: Any) -> NearestOnCurve:
    """Nearest points of up to _LANES points, repeated up to that number."""
    prepared = measure.prepared
    rows = points[np.minimum(np.arange(_LANES), len(points) - 1)].astype(prepared.control_points.dtype)
    found = _nearest_lanes(rows, prepared.control_points, prepared.weights, measure.skip)
    return jax.tree_util.tree_map(lambda x: np.asarray(x)[: len(points)], found)


@compiled
def _nearest_lanes(points: Any, control_points: Any, weights: Any, skip: Any) -> NearestOnCurve:
    return jax.vmap(lambda point: nearest(point, control_points, weights, 0.0, skip))(points)


def cover(
    measure: Measure, upper: float, frame: Frame, max_cells: int, report: Callable[[int, int], None]
) -> list[dict[str, Any]]:
    """Cells that cover a, each proven to be at most `upper` away from b.

    Args:
        measure: the curves, and the search of nearest feet.
        upper: the bound to prove, in the unit of the stored arrays.
        frame: the common coordinates.
        max_cells: most cells, before it is given up.
        report: called after each generation with the numbers of proven and of open cells.

    Raises:
        UncoveredError: a place is farther away, or too many or too narrow cells would be needed.
    """
    count = len(measure.a.rows)
    ends = measure(np.repeat(np.arange(count), 2), np.tile([0.0, 1.0], count))
    limit = math.ldexp(upper, -int(frame.first + frame.second))
    cells = _CoverCells(taken(ends, np.arange(0, 2 * count, 2)), taken(ends, np.arange(1, 2 * count, 2)))
    proven: list[dict[str, Any]] = []
    while len(cells.first.t):
        _check_places(measure.known[-1], limit)
        branches = _branches(measure, cells)
        accepted = _accepted(measure, cells, branches, upper, limit)
        proven += [cell for cell in accepted if cell is not None]
        rest = np.array([cell is None for cell in accepted])
        if rest.any() and not measure.a.exact[0].corners:
            raise UncoveredError(f"point {cells.first.segment[rest][0]} is not proven to be nearer than the bound.")
        report(len(proven), int(rest.sum()))
        if len(proven) + rest.sum() > max_cells:
            raise UncoveredError(f"more than {max_cells} cells are needed: raise max_cells.")
        cells = _halved(measure, _chosen(cells, rest), [_chosen(branch, rest) for branch in branches], limit)
    return sorted(proven, key=lambda cell: (cell["piece"], cell["cell"] or []))


def _check_places(places: Places, limit: float) -> None:
    """Raises UncoveredError where a place is farther from b than the bound, by more than its distance may be off."""
    most = int(np.argmax(places.distance))
    if places.distance[most] > limit * (1 + 1e-6) + 1e-6 * (places.distance.dtype == np.float32) + _SURELY:
        raise UncoveredError(f"segment {places.segment[most]} at {places.t[most]!r} is farther away than the bound.")


def _chosen(rows: Any, index: np.ndarray) -> Any:
    """The rows of all leaves of a pytree."""
    return jax.tree_util.tree_map(lambda x: x[index], rows)


def _accepted(
    measure: Measure, cells: _CoverCells, branches: list[_Branches], upper: float, limit: float
) -> list[dict[str, Any] | None]:
    """For each cell the first proposal that the exact check accepts."""
    t0, t1 = cells.first.t, cells.last.t
    nodes = t0[:, None] + _NODES * (t1 - t0)[:, None]
    points = jets(measure.a, np.repeat(cells.first.segment[:, None], len(_NODES), axis=1), nodes)[0]
    found: list[dict[str, Any] | None] = [None] * len(t0)
    for branch in branches:
        for proposed, weights in _proposals(branch, measure.a.rational or measure.b.rational):
            # Tiny numbers would make long integers, for nothing.
            sigma = np.where(proposed < SNAP, 0.0, proposed)
            s = _bernstein(sigma) if weights is None else _bernstein(sigma) / _bernstein(weights)
            feet = jets(measure.b, np.repeat(branch.foot[:, None], len(_NODES), axis=1), np.clip(s, 0.0, 1.0))[0]
            highest = np.sqrt(np.max(np.sum((points - feet) ** 2, axis=-1), axis=-1))
            for k in np.flatnonzero(highest <= limit + _SURELY):
                if found[k] is None:
                    entry = _entry(measure, cells, branch, int(k), sigma[k], None if weights is None else weights[k])
                    found[k] = _proven(measure, entry, upper)
    return found


def _entry(
    measure: Measure, cells: _CoverCells, branch: _Branches, k: int, sigma: np.ndarray, weights: np.ndarray | None
) -> dict[str, Any]:
    """A cell with its foot as certificates have them: what is a point has no parameters, and takes one foot."""
    is_point, to_points = (not curve.exact[0].corners for curve in (measure.a, measure.b))
    if is_point or to_points:
        place = float(sigma[0] if weights is None else sigma[0] / weights[0])
        foot = {"piece": int(branch.foot[k]), "map": [[] if to_points else [place]], "weights": None}
    else:
        given = None if weights is None else weights.tolist()
        foot = {"piece": int(branch.foot[k]), "map": [[s] for s in sigma.tolist()], "weights": given}
    return {
        "piece": int(cells.first.segment[k]),
        "cell": None if is_point else [float(cells.first.t[k]), float(cells.last.t[k])],
        "feet": [foot],
        "multipliers": None,
    }


def _proven(measure: Measure, entry: dict[str, Any], upper: float) -> dict[str, Any] | None:
    """The entry with its bound, the smaller one of `upper` and of what its coefficients show at once."""
    a, (foot,) = measure.a.exact[entry["piece"]], entry["feet"]
    b, corners = measure.b.exact[foot["piece"]], 1 if entry["cell"] is None else 2
    cell = simplex_map(a, corners, [[]] if entry["cell"] is None else [[t] for t in entry["cell"]])
    apart = difference(composed(a, cell), composed(b, simplex_map(b, corners, foot["map"], foot["weights"])))
    for bound in (root_above(apart), upper):
        if bound <= upper and failure_at_most([apart], bound, None) is None:
            return {**entry, "bound": bound}
    return None


def root_above(apart: Part) -> float:
    """A float of at least the length of a difference, from its squared coefficients; inf where that is no float."""
    squares, weights, _ = squares_of(apart)
    if not any(squares.values()):
        return 0.0
    pairs = [(squares.get(i, 0), w) for i, w in weights.items()]
    most = max(x.bit_length() - w.bit_length() for x, w in pairs)
    bits = max(0, 60 - most // 2)
    root = math.isqrt(max((x << 2 * bits) // w for x, w in pairs) + 1) + 1
    try:
        return math.nextafter(math.ldexp(root, -bits), math.inf)
    except OverflowError:
        return math.inf


# ---- proposals -----------------------------------------------------------------------------------


def _branches(measure: Measure, cells: _CoverCells) -> list[_Branches]:
    """The feet of the first ends followed to the last ends, and the other way round."""
    a, b, (first, last) = measure.a, measure.b, cells
    width = last.t - first.t
    ends = [jets(a, places.segment, places.t) for places in cells]
    branches = []
    for near, start, step, far in ((ends[0], first, width, ends[1]), (ends[1], last, -width, ends[0])):
        speed = speed_of_feet(b, start.foot, start.s, near, width)
        guess = np.clip(start.s + speed * step, 0.0, 1.0)
        other = local_feet(b, start.foot, guess, far[0], _FOOT_STEPS)
        far_speed = speed_of_feet(b, start.foot, other, far, width)
        pair = (start.s, other, speed * width, far_speed * width)
        branches.append(_Branches(start.foot, *(pair if step is width else (pair[1], pair[0], pair[3], pair[2]))))
    return branches


def _proposals(branch: _Branches, rational: bool) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    """Bernstein coefficients of sigma, and their weights, from the simplest on."""
    s0, s1, v0, v1 = branch[1:]
    ends = np.stack([s0, s1], axis=-1)
    yield ends, None
    if rational:
        weights = moebius_weights(v0, v1)
        yield ends * weights, weights
    yield hermite(s0, s1, v0, v1), None


def _halved(measure: Measure, cells: _CoverCells, branches: list[_Branches], limit: float) -> _CoverCells:
    """The cells cut at their peaks, or at a seam of b where no peak is too high; near an end in the middle too.

    A seam is where the foot of a branch reaches the end of its segment; beyond, another one has to be followed.
    """
    if not len(cells.first.t):
        return cells
    t0, t1 = cells.first.t, cells.last.t
    width, (peak, top) = t1 - t0, _peak(measure, cells, branches)
    for branch, end in zip(branches[::-1], (branches[1].s0, branches[0].s1), strict=True):
        seam = _seam(measure, cells, branch.foot, end)
        inside = (seam > t0 + _SURELY) & (seam < t1 - _SURELY) & (branches[0].foot != branches[1].foot)
        peak = np.where(inside & (top <= limit**2) & ((end == 0) | (end == 1)), seam, peak)
    middle = t0 + 0.5 * width
    narrow = np.flatnonzero((middle <= t0) | (middle >= t1) | (width < 1e-15))
    if len(narrow):
        place = f"segment {cells.first.segment[narrow[0]]} at {float(t0[narrow[0]])!r}"
        raise UncoveredError(f"{place} is not proven to be nearer than the bound.")
    at_end = (peak <= t0 + 4e-16) | (peak >= t1 - 4e-16)
    near = (peak < t0 + _NEAR_END * width) | (peak > t1 - _NEAR_END * width)
    # Two cuts each; the second one, where there is none, is the first again.
    cuts = np.sort(
        np.stack([np.where(at_end, middle, peak), np.where(near, middle, np.where(at_end, middle, peak))]), 0
    )
    twice = cuts[0] != cuts[1]
    places = measure(np.repeat(cells.first.segment, 1 + twice), cuts.T[np.stack([np.ones_like(twice), twice], 1)])
    index = np.cumsum(1 + twice) - 1 - twice
    lower, higher = taken(places, index), taken(places, index + twice)
    parts = [
        _CoverCells(cells.first, lower),
        _chosen(_CoverCells(lower, higher), twice),
        _CoverCells(higher, cells.last),
    ]
    return jax.tree_util.tree_map(lambda *x: np.concatenate(x), *parts)


def _seam(measure: Measure, cells: _CoverCells, foot: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The parameter at which the foot on the segment reaches its end, by bisection; an end of the cell if nowhere."""
    place, tangent, _ = jets(measure.b, foot, end)
    low, high = cells.first.t, cells.last.t

    def residual(t: np.ndarray) -> np.ndarray:
        return dot(jets(measure.a, cells.first.segment, t)[0] - place, tangent)

    sign = np.sign(residual(low))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        same = np.sign(residual(middle)) == sign
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return high


def _peak(measure: Measure, cells: _CoverCells, branches: list[_Branches]) -> tuple[np.ndarray, np.ndarray]:
    """The parameter at which the smaller distance to the local feet of both branches is largest, and its square there.

    The best of a few samples, then steps to the best of the peaks of either branch and their crossing, then to that one
    alone: comparing values gives a smooth peak to half of the digits only.
    """
    segment, t0, t1 = cells.first.segment, cells.first.t, cells.last.t
    feet = [branch.foot for branch in branches]
    ends = [(branch.s0, branch.s1) for branch in branches]

    def heights(t: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
        share = (t - t0) / (t1 - t0)
        jet = jets(measure.a, segment, t)
        rows = []
        for foot, (s0, s1) in zip(feet, ends, strict=True):
            s = local_feet(measure.b, foot, s0 + share * (s1 - s0), jet[0], _FOOT_STEPS)
            place, first, _ = jets(measure.b, foot, s)
            e = jet[0] - place
            bend = dot(jet[1], jet[1]) - dot(jet[1], first) * speed_of_feet(measure.b, foot, s, jet, t1 - t0)
            rows.append((dot(e, e), 2 * dot(e, jet[1]), 2 * (bend + dot(e, jet[2]))))
        return tuple(list(row) for row in zip(*rows, strict=True))  # pyright: ignore[reportReturnType]

    def steps(t: np.ndarray) -> np.ndarray:
        f, f1, f2 = heights(t)
        slope = f1[0] - f1[1]
        tops = [t - np.where(y < 0, x / np.where(y < 0, y, -1.0), 0.0) for x, y in zip(f1, f2, strict=True)]
        crossing = t - np.where(slope != 0, (f[0] - f[1]) / np.where(slope != 0, slope, 1.0), 0.0)
        return np.clip(np.stack([*tops, crossing]), low, high)

    rows = np.arange(len(t0))
    samples = np.stack([np.minimum(*heights(t0 + u * (t1 - t0))[0]) for u in _NODES])
    best = np.argmax(samples, axis=0)
    t, top = t0 + _NODES[best] * (t1 - t0), samples[best, rows]
    reach = (t1 - t0) / (len(_NODES) - 1)
    low, high = np.maximum(t - reach, t0), np.minimum(t + reach, t1)
    kind = np.full(len(t0), -1)
    for _ in range(_PEAK_STEPS):
        tried = steps(t)
        found = np.stack([np.minimum(*heights(x)[0]) for x in tried])
        i = np.argmax(found, axis=0)
        better = found[i, rows] > top
        t, top = np.where(better, tried[i, rows], t), np.where(better, found[i, rows], top)
        kind = np.where(better, i, kind)
    last = t
    for _ in range(_LAST_STEPS):
        last = np.where(kind < 0, last, steps(last)[kind, rows])
    return np.where(np.minimum(*heights(last)[0]) >= top - 1e-12 * np.maximum(top, _SURELY), last, t), top


def _bernstein(coefficients: np.ndarray) -> np.ndarray:
    """Values at the nodes of the polynomials of these coefficients, along the last axis."""
    return coefficients @ basis(coefficients.shape[-1] - 1, _NODES).T
