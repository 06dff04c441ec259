"""Straight lines and cubics for Bezier segments of any degree, rational or not, with a certified deviation.

A piece of a segment N / w is compared with its line or cubic Q at equal parameters. The coefficients of N - w Q in the
sum of both degrees, divided by those of w in that degree, bound |N / w - Q|, and so the distance in both directions.
For a line it is enough to take the components of these coefficients across the line, if the control points lie between
its ends. Each point of the piece is then as far from the line as it is across. The piece runs from end to end, so each
point of the line has a point of the piece straight across. Control points beyond an end, and rounded ends, add their
distance to the bound. Pieces that are farther off than allowed are halved. Cubics have the ends and the tangents of the
piece (Hermite). Halving divides their deviation by about 16, and the deviation of lines by 4.

Arcs of ellipses are rational quadratics of middle weight w < 1 (with outer weights 1). They are affine images of arcs
of the unit circle of half angle h, cos h = w. Take the cubic with their ends, tangents and middle. Its inner points are
at 4 w / (3 (1 + w)) of the way to the middle control point. With T = t (1 - t) and k = (1 - w) / (1 + w) it is, over
the circle, x = w + 4 (1 - w) T, y = sin h (2 t - 1) (1 + 2 k T), so that x^2 + y^2 - 1 = 4 k (1 - w)^2 T^2 (1 - 4 T),
which is between 0 and (1 - w)^3 / (27 (1 + w)). Its angle runs from -h to h without turning back, since y / x does.
Half of this bound is therefore a bound of the distance along radii in both directions. Times the norm of the affine map
it bounds the distance of the images. Halving divides it by about 64. (The weight w keeps a relative error of 1e-14; 1 -
w is at least 1e-8, so a relative margin of 1e-5 covers this.) The distance of the stored points from the exact ones is
added, and rounding is treated as below.

A line may be written with the weights of the ends of the piece: its points then move along it, towards the
points of the piece at equal parameters.

All computations use coordinates of order one about a common center, with the lines and cubics as they are stored.
Rounding, for points of pieces and of Q of size at most r and segments of degree n: restricted coefficients of N and w
pass 3 n roundings and two more, with factors that add up to the weight; the terms N_i - w_i Q_j, their factors, sums
and the quotient pass fewer than 20 more. Each of N / w and Q enters with size r, so the bound is off by at most 2
sqrt(dim) gamma(6 n + 30) r.

Source: Farin, Curves and Surfaces for CAGD (2002), chapters 4, 5 and 13; the bound is as in `tessellation`. The
cubics of arcs are those of Floater, An O(h^2n) Hermite approximation for conic sections, CAGD 14 (1997); their bound is
ours.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import product_weights
from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import common_exponent, unit_weights
from jhd._shapes.approximation import check_count

# Arcs of ellipses have a middle weight below 1 by more than this; relative rounding error of their bound.
_BENT, _ROOM = 1e-8, 1e-5


class FlatPieces(NamedTuple):
    """Control points (pieces, degree + 1, dim) in order, the segment of each, and their largest deviation."""

    control_points: np.ndarray
    segment: np.ndarray
    deviation: float


def restricted(rows: np.ndarray, t0: np.ndarray, t1: np.ndarray) -> np.ndarray:
    """Coefficients (degree + 1, pieces) on [t0, t1], as `bernstein.restrict`, one interval for each polynomial."""
    degree = len(rows) - 1
    u = np.empty((degree + 1, 1, len(t0)))
    u[:] = t0
    table: np.ndarray = rows[None]
    for level in range(1, degree + 1):
        u[degree - level + 1 :] = t1
        table = (1 - u) * table[:, :-1] + u * table[:, 1:]
    return table[:, 0]


class _LocalCurve(NamedTuple):
    """Segments in local coordinates, about a center and divided by powers of two, with the numbers to convert back."""

    net: np.ndarray  # (degree + 1, segments, dim + 1): points times weights, and weights
    ends: np.ndarray  # (2, segments, dim): first and last control points as they are stored
    center: np.ndarray
    first: int
    second: int
    size: float

    def stored(self, local: np.ndarray) -> np.ndarray:
        """Local points in the user's coordinates, rounded to their precision."""
        return np.ldexp(np.ldexp(local, self.second) + self.center, self.first).astype(self.ends.dtype)

    def local(self, stored: np.ndarray) -> np.ndarray:
        """Stored points in local coordinates; the subtraction is the only rounding."""
        return np.ldexp(np.ldexp(stored.astype(np.float64), -self.first) - self.center, -self.second)


def flattened(points: np.ndarray, weights: np.ndarray | None, degree: int, tolerance: float, most: int) -> FlatPieces:
    """Lines (degree 1) or cubics (degree 3) within tolerance of Bezier segments (segments, points, dim).

    Raises:
        ValueError: more than `most` pieces are needed, or tolerance is below the rounding of coordinates.
    """
    curve = _local(points, weights)
    count = len(points)
    if points.shape[1] == 2 and degree == 1:
        # A line is straight whatever its weights are.
        return FlatPieces(points, np.arange(count), 0.0)
    unit = curve.first + curve.second
    # Below that no number of pieces is enough, since their ends are rounded.
    least = np.ldexp(_error(curve, 0.0), unit) + 4 * float(np.spacing(np.abs(points).max()))
    if not tolerance >= least:
        raise ValueError(f"tolerance is {tolerance:g}, below the rounding of the coordinates; try {2 * least:.1g}.")
    segment, t0, t1 = np.arange(count), np.zeros(count), np.ones(count)
    done: list[tuple[np.ndarray, ...]] = []
    # Halvings after which the ends of a piece no longer differ.
    for _ in range(40):
        pieces, bound = _pieces(curve, segment, t0, t1, degree)
        with np.errstate(over="ignore"):
            bound = np.nextafter(np.ldexp(bound, unit), np.inf)
        # Written so that pieces with a bound of NaN are halved, too.
        good = bound <= tolerance
        done.append((segment[good], t0[good], pieces[good], bound[good]))
        segment, t0, t1 = segment[~good], t0[~good], t1[~good]
        if not len(segment):
            segment, t0, pieces, bound = (np.concatenate(x) for x in zip(*done, strict=True))
            order = np.lexsort((t0, segment))
            return FlatPieces(pieces[order], segment[order], float(bound.max()))
        check_count(sum(len(x[0]) for x in done) + 2 * len(segment), "max_segments", most, tolerance)
        middle = 0.5 * (t0 + t1)
        segment = np.concatenate([segment, segment])
        t0, t1 = np.concatenate([t0, middle]), np.concatenate([middle, t1])
    raise ValueError(f"tolerance is {tolerance:g}, below the rounding of coordinates of this size; raise it.")


def _error(curve: _LocalCurve, size: Any) -> Any:
    """The largest rounding error in the deviation of pieces whose coordinates have this size, in local units."""
    n, dim = len(curve.net) - 1, curve.net.shape[2] - 1
    return 2 * np.sqrt(dim) * gamma(6 * n + 30, np.float64) * np.maximum(size, curve.size)


def _local(points: np.ndarray, weights: np.ndarray | None) -> _LocalCurve:
    first = int(common_exponent(points))
    scaled = np.ldexp(points.astype(np.float64), -first)
    low, high = scaled.min(axis=(0, 1)), scaled.max(axis=(0, 1))
    center = low + 0.5 * (high - low)
    about = scaled - center
    # Far from the origin the curve may be small compared with its coordinates.
    second = int(common_exponent(about))
    about = np.ldexp(about, -second)
    heavy = np.ones(points.shape[:2]) if weights is None else unit_weights(weights.astype(np.float64))
    net = np.concatenate([about * heavy[..., None], heavy[..., None]], axis=-1)
    ends = points[:, [0, -1]].swapaxes(0, 1)
    return _LocalCurve(net.swapaxes(0, 1), ends, center, first, second, float(np.abs(about).max()))


def _pieces(
    curve: _LocalCurve, segment: np.ndarray, t0: np.ndarray, t1: np.ndarray, degree: int
) -> tuple[np.ndarray, np.ndarray]:
    """The line or cubic (pieces, degree + 1, dim) of each piece as it is stored, and a bound of its deviation."""
    rows = curve.net[:, segment]
    n, count, width = len(rows) - 1, len(segment), rows.shape[2]
    h = restricted(rows.reshape(n + 1, -1), np.repeat(t0, width), np.repeat(t1, width)).reshape(n + 1, count, width)
    p, w = h[..., :-1] / h[..., -1:], h[..., -1:]
    inside = np.stack([p[0], p[-1]])
    if degree == 3:
        before = p[0] + (n / 3) * (w[1] / w[0]) * (p[1] - p[0])
        after = p[-1] - (n / 3) * (w[-2] / w[-1]) * (p[-1] - p[-2])
        inside = np.stack([p[0], before, after, p[-1]])
    arcs = _arcs(p, w) if degree == n + 1 == 3 else None
    if arcs is not None:
        inside = np.where(arcs.round, arcs.cubic, inside)
    stored = curve.stored(inside)
    # The ends of segments are the control points themselves, so that joints stay joints.
    stored[0] = np.where((t0 == 0)[:, None], curve.ends[0, segment], stored[0])
    stored[-1] = np.where((t1 == 1)[:, None], curve.ends[1, segment], stored[-1])
    q = curve.local(stored)
    shares, own = product_weights(n, degree), np.ones((degree + 1, count, 1))
    if degree == 1:
        own = np.stack([w[0], w[-1]])
    total, weight = np.zeros((n + degree + 1, count, width - 1)), np.zeros((n + degree + 1, count, 1))
    for j in range(degree + 1):
        share = shares[:, j, None, None] * own[j]
        total[j : j + n + 1] += share * (h[..., :-1] - w * q[j])
        weight[j : j + n + 1] += share * w
    apart, room = total / weight, _error(curve, np.abs(q).max(axis=(0, 2)))
    bound = np.sqrt(np.sum(apart**2, axis=-1)).max(axis=0) + room
    if degree == 1:
        bound = np.minimum(bound, _across(apart, p, q) + 3 * room)
    if arcs is not None:
        off = np.sqrt(np.sum((q - arcs.cubic) ** 2, axis=-1)).max(axis=0)
        along = arcs.deviation + off + _error(curve, np.abs(q).max(axis=(0, 2)))
        bound = np.where(arcs.round[:, 0], along, bound)
    return stored.swapaxes(0, 1), bound * (1 + 1e-14)


def _across(apart: np.ndarray, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Bound of the distance of pieces from their lines, across and beyond the ends; infinite for lines of no length.

    Args:
        apart: coefficients (coefficients, pieces, dim) of the differences from the lines.
        p: the control points of the pieces.
        q: the ends of the lines.
    """
    chord = q[1] - q[0]
    length = np.sqrt(np.sum(chord**2, axis=-1))
    along = chord / np.where(length > 0, length, 1.0)[:, None]
    across = apart - np.sum(apart * along, axis=-1, keepdims=True) * along
    at = np.sum((p - q[0]) * along, axis=-1)
    beyond = np.maximum(np.maximum(-at, at - length).max(axis=0), np.maximum(at[0], length - at[-1]))
    off = np.hypot(np.sqrt(np.sum(across**2, axis=-1)).max(axis=0), np.maximum(beyond, 0.0))
    return np.where(length > 0, off, np.inf)


class _EllipseArcs(NamedTuple):
    """For rational quadratics: whether they are arcs of ellipses, their cubics, and the deviations of these."""

    round: np.ndarray  # (pieces, 1)
    cubic: np.ndarray  # (4, pieces, dim)
    deviation: np.ndarray  # (pieces,)


def _arcs(p: np.ndarray, w: np.ndarray) -> _EllipseArcs:
    """The arcs of control points (3, pieces, dim) and weights (3, pieces, 1)."""
    weight = w[1] / np.sqrt(w[0] * w[2])
    bent = weight < 1 - _BENT
    cosine = np.where(bent, weight, 0.5)
    share = 4 * cosine / (3 * (1 + cosine))
    cubic = np.stack([p[0], p[0] + share * (p[1] - p[0]), p[2] + share * (p[1] - p[2]), p[2]])
    sine_sq = 1 - cosine**2
    up, across = (p[1] - 0.5 * (p[0] + p[2])) * cosine / sine_sq, 0.5 * (p[2] - p[0]) / np.sqrt(sine_sq)
    aa, bb, ab = (np.sum(x * y, axis=-1) for x, y in ((up, up), (across, across), (up, across)))
    norm = np.sqrt(0.5 * (aa + bb) + np.hypot(0.5 * (aa - bb), ab))
    radial = (1 - cosine[:, 0]) ** 3 / (54 * (1 + cosine[:, 0]))
    return _EllipseArcs(bent, cubic, norm * radial * (1 + _ROOM))


def pieces_following(segment: np.ndarray, next_segment: np.ndarray) -> np.ndarray:
    """Index of the piece after each piece: the next of its segment, or the first of the next segment; -1 at ends."""
    count = len(segment)
    first = np.searchsorted(segment, np.arange(len(next_segment)))
    nxt = np.arange(1, count + 1)
    last = np.append(segment[1:] != segment[:-1], True)
    after = next_segment[segment]
    return np.where(last, np.where(after < 0, -1, first[np.maximum(after, 0)]), nxt)
