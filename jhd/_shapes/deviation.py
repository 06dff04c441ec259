"""The proof behind biarcs: bounds of the distance between a piece of a plane curve and a circular arc.

Everything runs in NumPy, in float64, on all pieces together: points are complex numbers and the last axis counts the
pieces. The bounds are derived in `deviation`.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import binomials, product_weights
from jhd._arithmetic.rounding import cast, gamma, unit_roundoff
from jhd._arithmetic.scaling import common_exponent, unit_weights
from jhd._runtime.arrays import taken
from jhd._shapes.curve import BezierSegments
from jhd._shapes.flattening import restricted

# Sweeps up to 106 degrees: the weight of the rational quadratic stays at 0.6 and above, and the proof needs less than
# half a turn.
LARGEST_BULGE = 0.5
# Shorter chords are points: their squares would underflow. The unit is the extent of the curve.
SHORT = 2.0**-200


class HostArcs(NamedTuple):
    """Arcs on the host; points and deviations in the user's coordinates, rounded to the precision of the curve."""

    segment: np.ndarray  # the segment of the curve that each arc stands for
    t0: np.ndarray  # parameter at the start of its piece
    t1: np.ndarray  # parameter at the end of its piece
    start: np.ndarray  # first point of the arc, a complex number
    end: np.ndarray  # last point of the arc
    bulge: np.ndarray  # tan(sweep / 4), positive to the left
    deviation: np.ndarray  # proven bound of the Hausdorff distance of the arc and its piece

    take = taken


class HostCurve(NamedTuple):
    """A curve in float64: local coordinates x = 2^-second (2^-first x_user - center), of size at most one."""

    rows: np.ndarray  # (points, segments) local control points, times weights if there are any
    weights: np.ndarray | None  # of size at most one
    ends: np.ndarray  # (2, segments) first and last control points, in the user's coordinates
    center: complex
    first: int
    second: int
    dtype: np.dtype
    noise: float  # rounding error of a deviation from local numbers, in local units
    rounding: float  # deviation of lines by rounding alone, also of the ends of arcs; user's unit

    @classmethod
    def of(cls, curve: BezierSegments) -> "HostCurve":
        """The curve in local coordinates, with the noise of `deviation`."""
        dtype = np.dtype(curve.control_points.dtype)
        given = complex_points(np.asarray(curve.control_points, np.float64)).T
        largest = _size(given)
        first = int(common_exponent(largest))
        points = scaled(given, -first)
        x, y = np.real(points), np.imag(points)
        center = 0.5 * complex(x.min() + x.max(), y.min() + y.max())
        points = points - center
        # If all points coincide, no size is left to which an error could be relative.
        second = int(common_exponent(_size(points), nothing=-200))
        points, weights = scaled(points, -second), None
        if curve.weights is not None:
            weights = np.asarray(curve.weights, np.float64).T
            weights = unit_weights(weights, 0)
            points = points * weights
        noise = gamma((8 if weights is None else 32) * (curve.degree + 1) + 8, np.float64)
        rounding = np.ldexp(8 * noise, first + second) + 5 * unit_roundoff(dtype) * largest
        return cls(points, weights, given[[0, -1]], center, first, second, dtype, noise, float(rounding))

    @property
    def least(self) -> float:
        """Least deviation that can be requested: four times the deviation by rounding alone."""
        return 4 * self.rounding

    @property
    def degree(self) -> int:
        """Degree of the segments."""
        return len(self.rows) - 1

    def local(self, x: np.ndarray) -> np.ndarray:
        """Stored points in local coordinates; the subtraction is the only rounding."""
        return scaled(scaled(x, -self.first) - self.center, -self.second)

    def stored(self, x: np.ndarray) -> np.ndarray:
        """Local points as they are stored, rounded to the precision of the curve."""
        x = scaled(scaled(x, self.second) + self.center, self.first)
        return x if self.dtype == np.float64 else self.number(x.view(np.float64)).view(np.complex128)

    def number(self, x: np.ndarray) -> np.ndarray:
        """Real numbers rounded to the precision of the curve."""
        return x.astype(self.dtype).astype(np.float64)

    def length(self, x: np.ndarray) -> np.ndarray:
        """Local lengths in the user's unit, rounded up to the precision of the curve."""
        with np.errstate(over="ignore"):
            x = np.nextafter(np.ldexp(x, self.first + self.second), np.inf)
        return cast(x, self.dtype, np.inf).astype(np.float64)

    def point(self, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Stored points of the curve; at the ends of segments the control points themselves."""
        inner = evaluated(self.rows[:, segment], t)[0]
        if self.weights is not None:
            inner = inner / evaluated(self.weights[:, segment], t)[0]
        return np.where((t == 0) | (t == 1), self.ends[(t >= 0.5).astype(int), segment], self.stored(inner))


def complex_points(x: np.ndarray) -> np.ndarray:
    """Points (..., 2) as complex numbers."""
    return np.ascontiguousarray(x).view(np.complex128)[..., 0]


def scaled(x: np.ndarray, exponent: int) -> np.ndarray:
    """Complex numbers times a power of two, without overflow of the power itself."""
    return np.ldexp(np.ascontiguousarray(x).view(np.float64), exponent).view(np.complex128)


def _size(x: np.ndarray) -> float:
    return float(max(np.abs(np.real(x)).max(), np.abs(np.imag(x)).max()))


def evaluated(rows: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and derivatives of polynomials (points, pieces) at t, by de Casteljau."""
    degree, u = len(rows) - 1, 1 - t
    while len(rows) > 2:
        rows = u * rows[:-1] + t * rows[1:]
    return u * rows[0] + t * rows[1], degree * (rows[1] - rows[0])


class Pieces(NamedTuple):
    """Pieces of the curve relative to the starts of their arcs, in local units."""

    offsets: np.ndarray  # (points, pieces) control points
    weights: np.ndarray | None
    chord: np.ndarray

    def take(self, rows: np.ndarray) -> "Pieces":
        """Some of the pieces."""
        weights = None if self.weights is None else self.weights[:, rows]
        return Pieces(self.offsets[:, rows], weights, self.chord[rows])


def pieces_of(curve: HostCurve, arcs: HostArcs) -> Pieces:
    """The pieces that the arcs stand for."""
    points, weights = restricted(curve.rows[:, arcs.segment], arcs.t0, arcs.t1), None
    if curve.weights is not None:
        weights = restricted(curve.weights[:, arcs.segment], arcs.t0, arcs.t1)
        points = points / weights
    start = curve.local(arcs.start)
    return Pieces(points - start, weights, curve.local(arcs.end) - start)


def deviation(curve: HostCurve, pieces: Pieces, bulge: np.ndarray) -> np.ndarray:
    """Bound of the Hausdorff distance of each arc and its piece of the curve, in the user's unit.

    Let the arc start at 0 and end at v, with bulge b, |b| <= 1/2, chord L = |v| > 0 and n = v turned to the left. With
    o its center and r its radius, 2 b (x - o) = w(x) = 2 b x - b v - (1 - b^2) n / 2, |w| = 2 |b| |x - o|, and
    2 |b| r = R = L (1 + b^2) / 2. Then G(x) = 2 b x.(x - v) - (1 - b^2) x.n = 2 b (|x - o|^2 - r^2), so

        | |x - o| - r | = |G(x)| / (|w(x)| + R),

    with nothing to cancel, and for b = 0 the distance to the line. Let the piece x(t) have the control points q_i and
    positive weights W_i, and m = max |q_i|.

    1. rho, the largest radial distance. The Bernstein coefficients of (sum W_i B_i)^2 G(x(t)) over those of
       (sum W_i B_i)^2 are means, with the weights C(n,i) C(n,j) W_i W_j over i + j = k, of the polar values
       g_ij = 2 b q_i.q_j - l_i - l_j with l_i = b q_i.v + (1 - b^2) q_i.n / 2. So are those of both halves of the
       piece, which are closer to G; their largest size g bounds |G|. So rho <= g / R =: rho_0; and then
       |w| >= R - 2 |b| rho_0, which gives rho <= g / (2 (R - |b| rho_0)) if |b| rho_0 <= R / 2.
    2. The piece stays on the arc's side of the center. Required is w(q_i).n < 0 for all i. It is affine in x, so
       w(x).n < 0 on the whole piece: with k the unit vector from o to the middle of the arc, (x - o).k > 0 (for a line
       it holds everywhere).
    3. h, how far the piece leaves the strip of the arc: the largest of -T_0.q_i, T_1.(q_i - v) and 0, where T_0 and
       T_1 = ((1 - b^2) v -+ 2 b n) / (L (1 + b^2)) are the tangents at the ends; affine, so it holds on the piece.
    4. Piece to arc. A point of the piece with T_0.x >= 0 and T_1.(x - v) <= 0 and (2) is in the arc's wedge, and its
       distance to the arc is the radial one. Else let x = -h' T_0 + y N with N the unit normal at 0 towards o and
       0 < h' <= h. If y > r, (x - o).k = -h' sin(sweep/2) - (y - r) cos(sweep/2) < 0, against (2). So y <= r, and
       r - y = sqrt(|x - o|^2 - h'^2) lies between r - rho - h' and r + rho: |y| <= rho + h', and |x| <= rho + 2 h. The
       same at the other end and for lines. So the distance is at most rho + 2 h.
    5. Arc to piece. By (2) the angle of x(t) - o against k is continuous, within a right angle, so it takes every value
       between those at both ends: points of the arc at such angles are within rho of the piece. Let e_0 = |q_0|. A
       point y of the arc at an angle between those of its start 0 and of q_0 is no farther from 0 than the point of
       the circle nearest to q_0 is, so |y| <= 2 e_0 and |y - q_0| <= 3 e_0. Every other point of the arc lies likewise
       between its end and q_n: within 3 e_1, e_1 = |q_n - v|. (For lines: project on the chord.)

    So max(rho + 2 h, 3 e_0, 3 e_1) bounds both directions. And so does max(m, e_0 + L) always, since the points of the
    arc are within L of its start; it serves points, loops and specks.

    Rounding, in local units, where coordinates are at most one. (i) The control points of the piece are off by at
    most sqrt(2) gamma(3 n + 3) in all: centering, restriction, one subtraction of size two. Rational ones by
    sqrt(2) gamma(6 n + 6), and a relative change gamma(3 n) of the weights moves the curve by that fraction of its
    diameter, which is at most 2 sqrt(2). (ii) An arc is the image (1 - z) A + z B of its ends, in complex numbers, with
    |z|, |1 - z| <= 1, so it moves by no more than both ends together: sqrt(2) u and (sqrt(2) + 2 sqrt(2)) u.
    Both are below `noise`, which is added at the end; offsets, weights, chord and bulge then count as exact. (iii) The
    g_ij cost at most 9 roundings of terms of total size M = 2 |b| (m^2 + m L) + (1 + b^2) m L, their means as many as
    there are pairs i <= j, twice that with weights, and 2 n + 16 more. (iv) h costs gamma(24) (m + L). (v) The
    condition of 2 is asked for with a tenth to spare and m <= 2^20 L. (vi) The rest are fewer than 64 roundings of
    positive numbers. Underflow is below 2^-700 for L > 2^-200, and thus below the slack of `noise`.
    """
    q, b = pieces.offsets, bulge
    length, far = np.abs(pieces.chord), np.abs(q).max(axis=0)
    size, bend, one = np.maximum(length, SHORT), (1 - b) * (1 + b), 1 + b * b
    turned = q * pieces.chord.conj()
    along, across = np.real(turned), np.imag(turned)  # the products with v and n
    e0, e1 = np.abs(q[0]), np.abs(q[-1] - pieces.chord)

    total = 2 * np.abs(b) * far * (far + length) + one * far * length
    pairs = (len(q) * (len(q) + 1)) // 2
    roundings = (1 if pieces.weights is None else 2) * pairs + 2 * len(q) + 23
    g = _largest_mean(pieces, b * along + 0.5 * bend * across, b) + gamma(roundings, np.float64) * total
    full = 0.5 * size * one
    rho0 = g / full
    tight = np.abs(b) * rho0 <= 0.5 * full
    rho = np.where(tight, g / (2 * np.where(tight, full - np.abs(b) * rho0, full)), rho0)

    bent, across = bend * along, 2 * b * across
    outside = np.maximum((across - bent).max(axis=0), (bent + across).max(axis=0) - bend * length**2)
    h = np.maximum(outside, 0) / (size * one) + gamma(24, np.float64) * (far + length)

    ahead = across.max(axis=0) <= 0.45 * bend * length**2
    flat = np.abs(b) <= LARGEST_BULGE
    sound = (length > SHORT) & (far <= 2.0**20 * size) & ahead & flat
    arc = np.where(sound, np.maximum(rho + 2 * h, 3 * np.maximum(e0, e1)), np.inf)
    bound = np.where(flat, np.minimum(arc, np.maximum(far, e0 + length)), np.inf)
    return curve.length(bound * (1 + gamma(64, np.float64)) + curve.noise)


def _largest_mean(pieces: Pieces, linear: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest |coefficient| of G divided by coefficients of the squared weights: step 1 of `deviation`."""
    q, n = pieces.offsets, len(pieces.offsets) - 1
    i, j, gather = _halved_diagonals(n)
    first, second = q[i], q[j]
    polar = 2 * b * np.real(first * second.conj()) - linear[i] - linear[j]
    if pieces.weights is None:
        return np.abs(gather @ polar).max(axis=0)
    share = pieces.weights[i] * pieces.weights[j]
    return (np.abs(gather @ (share * polar)) / (gather @ share)).max(axis=0)


@cache
def _halved_diagonals(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs i <= j, and the (4 n + 2, pairs) matrix of their factors in the coefficients of both halves of a square.

    The factors for a coefficient sum to one. For i + j = k they are C(n,i) C(n,j) / C(2n,k), twice for i < j, and a
    half has the coefficients sum C(k,l) / 2^k c_l.
    """
    i, j = np.triu_indices(n + 1)
    shares = product_weights(n, n)[i, j] * np.where(i < j, 2, 1)
    diagonals = (i + j == np.arange(2 * n + 1)[:, None]) * shares
    left = np.array([np.pad(binomials(k), (0, 2 * n - k)) * 0.5**k for k in range(2 * n + 1)])
    return i, j, np.concatenate([left, left[::-1, ::-1]]) @ diagonals
