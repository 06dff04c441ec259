"""Biarcs: a plane curve replaced by circular arcs, each with a proven deviation from its piece of the curve.

Two end points and their tangents fix a circle on which the joint of every biarc lies. The joint is taken where the
curve crosses that circle, so that each arc stands for an interval of parameters of one segment. An arc is kept as its
ends and its bulge tan(sweep / 4), as in DXF files: a line is an arc of bulge zero, and nothing here or downstream
divides by a curvature. All work is done by NumPy, on all pieces of one depth together.

Source: Sir, Feichtinger & Juttler, Approximating curves and their offsets using biarcs and Pythagorean hodograph
quintics, CAD 38 (2006), as used by Kim et al. 2010, section 2.2; the proof of the deviation is ours.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd.arithmetic.bernstein import binomials, product_weights
from jhd.arithmetic.rounding import gamma, unit_roundoff
from jhd.arrays import is_traced, real_array
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.solution import NotProvenError

# Sweeps up to 106 degrees: the weight of the rational quadratic stays at 0.6 and above, and the proof needs less than
# half a turn.
_BULGE = 0.5
# Places inside a piece where the sign of the joint's equation is looked at, and steps of the root find after that.
_SAMPLES, _STEPS = 15, 12
# The equation of the joint holds everywhere on lines and circles; below this it is rounding.
_FLAT = 1e-12
# A velocity below this share of the largest one has no direction of its own.
_STILL = 1e-9
# A control point this near to an end, as a share of the farthest, gives the tangent there no direction.
_NEAR = 1e-3
# Pieces of this share of the tolerance that no biarc fits (cusps) become lines.
_SPECK = 1 / 16
# Shorter chords are points: their squares would underflow. The unit is the extent of the curve.
_SHORT = 2.0**-200


class BiarcCurve(eqx.Module):
    """Circular arcs and lines in the order of the curve they approximate, made by `biarcs`.

    Args:
        start: where each arc starts; in the unit of the coordinates, as all lengths.
        end: where it ends; the next arc of the same segment starts at the very same numbers.
        bulge: tan(sweep / 4), at most 1/2 in size: positive to the left (counter-clockwise), zero for a line.
        segment: the segment of the curve that the arc stands for.
        t0: where the piece starts on that segment.
        t1: where it ends.
        deviation: proven bound of the Hausdorff distance, in both directions, of the arc and its piece.
        following: for each arc the one that goes on where it ends, -1 at a free end.
    """

    start: Float[Array, "arcs dim"]
    end: Float[Array, "arcs dim"]
    bulge: Float[Array, " arcs"]
    segment: Int[Array, " arcs"]
    t0: Float[Array, " arcs"]
    t1: Float[Array, " arcs"]
    deviation: Float[Array, " arcs"]
    following: Int[Array, " arcs"]

    @property
    def count(self) -> int:
        """Number of arcs."""
        return self.bulge.shape[-1]

    @property
    def sweep(self) -> Float[Array, " arcs"]:
        """The signed angle that the direction turns by, 4 atan(bulge)."""
        return 4 * jnp.arctan(self.bulge)

    @property
    def curvature(self) -> Float[Array, " arcs"]:
        """Signed curvature 4 bulge / (chord (1 + bulge^2)), positive to the left; zero for lines and points."""
        _, b, _, _, length = self._parts()
        return jnp.asarray(4 * b / (length * (1 + b * b)))[..., 0]

    @property
    def radius(self) -> Float[Array, " arcs"]:
        """Radius, infinite for lines and points."""
        xp, b, _, _, length = self._parts()
        radius = length * (1 + b * b) / (4 * xp.abs(xp.where(b == 0, 1.0, b)))
        return jnp.asarray(xp.where(b == 0, xp.inf, radius))[..., 0]

    @property
    def centre(self) -> Float[Array, "arcs dim"]:
        """Centre, infinite for lines and points."""
        xp, b, middle, chord, _ = self._parts()
        some = xp.where(b == 0, 1.0, b)
        centre = middle + _left(xp, chord) * ((1 - some) * (1 + some) / (4 * some))
        return jnp.asarray(xp.where(b == 0, xp.inf, centre))

    @property
    def tangents(self) -> Float[Array, "arcs 2 dim"]:
        """Unit tangents at start and end: the chord turned by half the sweep to either side; zero for points."""
        xp, b, _, chord, length = self._parts()
        along, across = chord / length * ((1 - b) * (1 + b)), _left(xp, chord) / length * (2 * b)
        return jnp.asarray(xp.stack([along - across, along + across], axis=-2) / (1 + b * b)[..., None])

    def segments(self) -> BezierSegments:
        """The arcs as rational quadratic Bezier segments with weights 1, cos(sweep / 2), 1: exact but for rounding."""
        xp, b, middle, chord, _ = self._parts()
        apex = middle - _left(xp, chord) * (b / ((1 - b) * (1 + b)))
        cosine = (1 - b) * (1 + b) / (1 + b * b)
        weights = xp.concatenate([xp.ones_like(b), cosine, xp.ones_like(b)], axis=-1)
        rows = xp.stack([xp.asarray(self.start), apex, xp.asarray(self.end)], axis=-2)
        return BezierSegments(rows, weights, self.following)

    def _parts(self) -> tuple[Any, Any, Any, Any, Any]:
        """NumPy where the arcs are known; bulge, middle of the chord, chord, and its length, one where there is none.

        In JAX each of the operations would be compiled for each number of arcs.
        """
        xp = jnp if is_traced(self) else np
        start, end, b = xp.asarray(self.start), xp.asarray(self.end), xp.asarray(self.bulge)[..., None]
        chord = end - start
        length = xp.hypot(chord[..., :1], chord[..., 1:])
        return xp, b, 0.5 * start + 0.5 * end, chord, xp.where(length > 0, length, 1.0)


def _left(xp: Any, x: Any) -> Any:
    """Vectors turned by a right angle to the left."""
    return xp.stack([-x[..., 1], x[..., 0]], axis=-1)


def biarcs(curve: AbstractCurve, atol: Numbers) -> BiarcCurve:
    """Arcs that approximate a plane curve, each within `atol` of its piece of the curve, proven in both directions.

    So the Hausdorff distance of the curve and all arcs together is at most the largest deviation. Where the curve is
    smooth its arcs join smoothly; corners and cusps stay. Exceptions are pieces smaller than a sixteenth of `atol` that
    turn too far for a biarc: they become lines, as do pieces that are straight up to rounding. The number of arcs grows
    with atol^(-1/3).

    >>> from jhd.shapes.curve import circle
    >>> arcs = biarcs(circle([0, 0], 1), 1e-9)
    >>> arcs.count, bool(abs(arcs.radius - 1).max() < 1e-12)
    (8, True)

    Args:
        curve: polynomial or rational, in the plane; its control points must be known, not traced.
        atol: largest deviation allowed, a length in the unit of the coordinates.

    Returns:
        The arcs in the order of segments and parameters; together their intervals cover every segment.

    Raises:
        TypeError: no curve, or one whose control points are traced: the number of arcs depends on them.
        ValueError: a curve in space, or an atol that is not positive or is below `least_tolerance`.
        NotProvenError: weights so uneven that no parameter lies between the ends of a piece that is still too long; it
            carries the arcs, whose deviations hold.
    """
    segments = _checked(curve)
    tolerance = real_array("atol", atol)
    if tolerance.shape != ():
        raise ValueError(f"atol has shape {tolerance.shape}; needs a scalar.")
    if is_traced(tolerance):
        raise TypeError("biarcs needs a known atol, not a traced one: the number of arcs depends on it.")
    wanted, least = float(np.asarray(tolerance)), least_tolerance(segments)
    if wanted < least or wanted <= 0:
        raise ValueError(f"atol is {wanted:g}; needs at least {max(least, 5e-324):g}, which these coordinates resolve.")
    if segments.degree <= 1:
        return _assembled(segments, _lines(segments))
    found = _assembled(segments, _subdivided(_host(segments), wanted))
    reached = float(np.max(np.asarray(found.deviation)))
    if reached > wanted:
        message = f"The deviation stays at {reached:g} where atol is {wanted:g}: the weights are too uneven to go on."
        raise NotProvenError(message, found)
    return found


def least_tolerance(curve: AbstractCurve) -> float:
    """The smallest tolerance that `biarcs` accepts: four times what rounding adds to a deviation; 0 for polylines.

    Raises:
        TypeError: no curve, or one whose control points are traced.
        ValueError: a curve in space.
    """
    segments = _checked(curve)
    return 0.0 if segments.degree <= 1 else 4 * _host(segments).rounding


def _checked(curve: AbstractCurve) -> BezierSegments:
    check_curve("curve", curve)
    segments = curve.segments()
    if is_traced(segments):
        raise TypeError("biarcs needs known control points, not traced ones: the number of arcs depends on them.")
    if segments.dim != 2:
        raise ValueError(f"curve has {segments.dim} coordinates a point; biarcs needs 2.")
    return segments


class _Arcs(NamedTuple):
    """Arcs on the host; places and deviations in the user's coordinates, rounded to the precision of the curve."""

    segment: np.ndarray
    t0: np.ndarray
    t1: np.ndarray
    start: np.ndarray
    end: np.ndarray
    bulge: np.ndarray
    deviation: np.ndarray

    def take(self, rows: np.ndarray) -> "_Arcs":
        return _Arcs(*(x[rows] for x in self))


def _joined(parts: list[_Arcs]) -> _Arcs:
    return _Arcs(*(np.concatenate(x) for x in zip(*parts, strict=True)))


def _lines(segments: BezierSegments) -> _Arcs:
    """Points and lines are arcs themselves."""
    points, zeros = np.asarray(segments.control_points), np.zeros(segments.count)
    return _Arcs(np.arange(segments.count), zeros, zeros + 1, points[:, 0], points[:, -1], zeros, zeros)


def _assembled(segments: BezierSegments, arcs: _Arcs) -> BiarcCurve:
    """The arcs in order, each with the one that follows it."""
    arcs = arcs.take(np.lexsort((arcs.t0, arcs.segment)))
    last = np.append(arcs.segment[1:] != arcs.segment[:-1], True)
    first = np.searchsorted(arcs.segment, np.arange(segments.count))
    onward = np.asarray(segments.following)[arcs.segment]
    following = np.where(last, np.where(onward < 0, -1, first[onward]), np.arange(len(last)) + 1)
    dtype = segments.control_points.dtype
    start, end, bulge, t0, t1, deviation = (
        jnp.asarray(x, dtype) for x in (arcs.start, arcs.end, arcs.bulge, arcs.t0, arcs.t1, arcs.deviation)
    )
    return BiarcCurve(start, end, bulge, jnp.asarray(arcs.segment), t0, t1, deviation, jnp.asarray(following))


class _Host(NamedTuple):
    """A curve in float64: local coordinates x = 2^-second (2^-first x_user - centre), of size at most one."""

    rows: np.ndarray  # local control points times weights, and weights of size at most one
    ends: np.ndarray  # first and last control point of each segment, in the user's coordinates
    centre: np.ndarray
    first: int
    second: int
    dtype: np.dtype
    noise: float  # what the rounding of local numbers adds to a deviation, in local units
    rounding: float  # the deviation that lines have by rounding alone, that of the ends of arcs included; user's unit

    def local(self, x: np.ndarray) -> np.ndarray:
        """Stored points in local coordinates; the subtraction is the only rounding."""
        return np.ldexp(np.ldexp(x, -self.first) - self.centre, -self.second)

    def stored(self, x: np.ndarray) -> np.ndarray:
        """Local points as they are stored, rounded to the precision of the curve."""
        x = np.ldexp(np.ldexp(x, self.second) + self.centre, self.first)
        return x.astype(self.dtype).astype(np.float64)

    def length(self, x: np.ndarray) -> np.ndarray:
        """Local lengths in the user's unit, rounded up to the precision of the curve."""
        with np.errstate(over="ignore"):
            x = np.nextafter(np.ldexp(x, self.first + self.second), np.inf)
            rounded = x.astype(self.dtype)
        return np.where(rounded < x, np.nextafter(rounded, np.array(np.inf, self.dtype)), rounded).astype(np.float64)

    def point(self, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Stored points of the curve; at the ends of segments the control points themselves."""
        value = _evaluated(self.rows[segment], t)[0]
        inner = self.stored(value[:, :2] / value[:, 2:])
        outer = self.ends[segment, (t >= 0.5).astype(int)]
        return np.where(((t == 0) | (t == 1))[:, None], outer, inner)


def _host(segments: BezierSegments) -> _Host:
    """The curve in local coordinates, with the noise of _deviation."""
    dtype = np.dtype(segments.control_points.dtype)
    given = np.asarray(segments.control_points, np.float64)
    first = int(np.frexp(np.max(np.abs(given)))[1])
    points = np.ldexp(given, -first)
    centre = 0.5 * (points.min(axis=(0, 1)) + points.max(axis=(0, 1)))
    points = points - centre
    extent = np.max(np.abs(points))
    # Where all points are one, nothing is left that an error could be relative to.
    second = int(np.frexp(extent)[1]) if extent > 0 else -200
    points = np.ldexp(points, -second)
    if segments.weights is None:
        weights = np.ones(points.shape[:-1])
    else:
        weights = np.asarray(segments.weights, np.float64)
        weights = np.ldexp(weights, -np.frexp(weights.max(axis=-1, keepdims=True))[1])
    rows = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
    noise = gamma((8 if segments.weights is None else 32) * (segments.degree + 1) + 8, np.float64)
    rounding = np.ldexp(8 * noise, first + second) + 5 * unit_roundoff(dtype) * np.max(np.abs(given))
    return _Host(rows, given[:, [0, -1]], centre, first, second, dtype, noise, float(rounding))


def _evaluated(rows: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and derivatives (pieces, width) of polynomials (pieces, points, width) at t, by de Casteljau."""
    degree, t = rows.shape[1] - 1, t[:, None, None]
    while rows.shape[1] > 2:
        rows = (1 - t) * rows[:, :-1] + t * rows[:, 1:]
    t = t[:, 0]
    return (1 - t) * rows[:, 0] + t * rows[:, 1], degree * (rows[:, 1] - rows[:, 0])


def _restricted(rows: np.ndarray, t0: np.ndarray, t1: np.ndarray) -> np.ndarray:
    """Coefficients on [t0, t1], as `bernstein.restrict`, one interval for each of the polynomials."""
    degree = rows.shape[1] - 1
    rows = np.repeat(rows[:, None], degree + 1, axis=1)
    for level in range(1, degree + 1):
        late = level > degree - np.arange(degree + 1)
        u = np.where(late, t1[:, None], t0[:, None])[..., None, None]
        rows = (1 - u) * rows[:, :, :-1] + u * rows[:, :, 1:]
    return rows[:, :, 0]


class _Pieces(NamedTuple):
    """Pieces of the curve, relative to where their arcs start, in local units."""

    offsets: np.ndarray  # (pieces, points, 2) control points
    weights: np.ndarray
    chord: np.ndarray


def _pieces(curve: _Host, arcs: _Arcs) -> _Pieces:
    rows = _restricted(curve.rows[arcs.segment], arcs.t0, arcs.t1)
    start = curve.local(arcs.start)
    points, weights = rows[..., :2] / rows[..., 2:], rows[..., 2]
    return _Pieces(points - start[:, None], weights, curve.local(arcs.end) - start)


def _deviation(curve: _Host, pieces: _Pieces, bulge: np.ndarray) -> np.ndarray:
    """Bound of the Hausdorff distance of each arc and its piece of the curve, in the user's unit.

    Let the arc start at 0 and end at v, with bulge b, |b| <= 1/2, chord L = |v| > 0 and n = v turned to the left. With
    o its centre and r its radius, 2 b (x - o) = w(x) = 2 b x - b v - (1 - b^2) n / 2, |w| = 2 |b| |x - o|, and
    2 |b| r = R = L (1 + b^2) / 2. Then G(x) = 2 b x.(x - v) - (1 - b^2) x.n = 2 b (|x - o|^2 - r^2), so

        | |x - o| - r | = |G(x)| / (|w(x)| + R),

    with nothing to cancel, and for b = 0 the distance to the line. Let the piece x(t) have the control points q_i and
    positive weights W_i, and m = max |q_i|.

    1. rho, the largest radial distance. The Bernstein coefficients of (sum W_i B_i)^2 G(x(t)) over those of
       (sum W_i B_i)^2 are means, with the weights C(n,i) C(n,j) W_i W_j over i + j = k, of the polar values
       g_ij = 2 b (q_i.q_j - (q_i + q_j).v / 2) - (1 - b^2)(q_i + q_j).n / 2. So are those of both halves of the piece,
       which are closer to G; the largest of their sizes, g, bounds |G|. So rho <= g / R =: rho_0; and then
       |w| >= R - 2 |b| rho_0, which gives rho <= g / (2 (R - |b| rho_0)) where |b| rho_0 <= R / 2.
    2. The piece stays on the arc's side of the centre. Required is w(q_i).n < 0 for all i. It is affine in x, so
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
    most sqrt(2) gamma(3 n + 3) in all: centring, restriction, one subtraction of size two. Rational ones by
    sqrt(2) gamma(6 n + 6), and a relative change gamma(3 n) of the weights moves the curve by that share of its
    diameter, which is at most 2 sqrt(2). (ii) An arc is the image (1 - z) A + z B of its ends, in complex numbers, with
    |z|, |1 - z| <= 1, so it moves by no more than both ends together: sqrt(2) u and (sqrt(2) + 2 sqrt(2)) u.
    Both are below `noise`, which is added at the end; offsets, weights, chord and bulge then count as exact. (iii) The
    g_ij cost at most 8 roundings of terms of total size M = 2 |b| (m^2 + m L) + (1 + b^2) m L, their means at most
    6 n + 16 more: gamma(6 n + 24) M. (iv) h costs gamma(16) (m + L). (v) The condition of 2 is asked for with a tenth
    to spare and m <= 2^20 L. (vi) The rest are fewer than 64 roundings of positive numbers. Underflow is below
    2^-700 for L > 2^-200, and thus below the slack of `noise`.
    """
    q, chord, b = pieces.offsets, pieces.chord, bulge
    left = _left(np, chord)
    length, far = np.hypot(*chord.T), np.max(np.hypot(q[..., 0], q[..., 1]), axis=1)
    size, bend = np.maximum(length, _SHORT), (1 - b) * (1 + b)
    along, across = np.einsum("kid,kd->ki", q, chord), np.einsum("kid,kd->ki", q, left)
    e0, e1 = np.hypot(*q[:, 0].T), np.hypot(*(q[:, -1] - chord).T)

    total = 2 * np.abs(b) * far * (far + length) + (1 + b * b) * far * length
    g = _largest_mean(pieces, along, across, b) + gamma(6 * q.shape[1] + 18, np.float64) * total
    full = size * (1 + b * b) / 2
    rho0 = g / full
    tight = np.abs(b) * rho0 <= full / 2
    rho = np.where(tight, g / (2 * np.where(tight, full - np.abs(b) * rho0, full)), rho0)

    scale = (size * (1 + b * b))[:, None]
    before = (2 * b[:, None] * across - bend[:, None] * along) / scale
    beyond = (bend[:, None] * (along - (length**2)[:, None]) + 2 * b[:, None] * across) / scale
    h = np.maximum(np.maximum(before, beyond).max(axis=1), 0) + gamma(16, np.float64) * (far + length)

    ahead = (2 * b[:, None] * across).max(axis=1) <= 0.45 * bend * length**2
    sound = (length > _SHORT) & (far <= 2.0**20 * size) & ahead & (np.abs(b) <= _BULGE)
    arc = np.where(sound, np.maximum(rho + 2 * h, 3 * np.maximum(e0, e1)), np.inf)
    bound = np.minimum(arc, np.maximum(far, e0 + length))
    bound = np.where(np.abs(b) <= _BULGE, bound, np.inf)
    return curve.length(bound * (1 + gamma(64, np.float64)) + curve.noise)


def _largest_mean(pieces: _Pieces, along: np.ndarray, across: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest |coefficient| of G over those of the squared weights: step 1 of _deviation."""
    q, n = pieces.offsets, pieces.offsets.shape[1] - 1
    sums = [x[:, :, None] + x[:, None, :] for x in (along, across)]
    b = b[:, None, None]
    polar = 2 * b * (q @ q.transpose(0, 2, 1) - 0.5 * sums[0]) - (1 - b) * (1 + b) * 0.5 * sums[1]
    share = product_weights(n, n) * pieces.weights[:, :, None] * pieces.weights[:, None, :]
    gather = _halved_diagonals(n)
    shares = share.reshape(len(q), -1) @ gather
    return np.max(np.abs((share * polar).reshape(len(q), -1) @ gather) / shares, axis=1)


@cache
def _halved_diagonals(n: int) -> np.ndarray:
    """The ((n + 1)^2, 4 n + 2) matrix that adds up the diagonals i + j = k of a table and splits their form in halves.

    The entries C(k,i) / 2^k are exact up to degree 28, and rounded once beyond.
    """
    index = np.add.outer(np.arange(n + 1), np.arange(n + 1)).ravel()
    diagonals = (index[:, None] == np.arange(2 * n + 1)).astype(float)
    left = np.array([np.pad(binomials(k), (0, 2 * n - k)) * 0.5**k for k in range(2 * n + 1)]).T
    return diagonals @ np.concatenate([left, left[::-1, ::-1]], axis=1)


def _subdivided(curve: _Host, atol: float) -> _Arcs:
    """Arcs within atol of their pieces: biarcs where they fit, lines where nothing is curved, else both halves."""
    count = len(curve.rows)
    zeros = np.zeros(count)
    todo = _Arcs(np.arange(count), zeros, zeros + 1, curve.ends[:, 0], curve.ends[:, 1], zeros, zeros)
    done = []
    while len(todo.segment):
        pieces = _pieces(curve, todo)
        todo = todo._replace(deviation=_deviation(curve, pieces, todo.bulge))
        far = curve.length(np.max(np.hypot(*np.moveaxis(pieces.offsets, -1, 0)), axis=1))
        straight = todo.deviation <= min(atol, 2 * curve.rounding)
        first, second, fits = _biarc(curve, todo, pieces)
        fits &= ~straight & (np.maximum(first.deviation, second.deviation) <= atol)
        middle = (0.5 * (todo.t0 + todo.t1)).astype(curve.dtype).astype(np.float64)
        whole = (middle <= todo.t0) | (middle >= todo.t1)
        line = straight | ~fits & ((far <= _SPECK * atol) & (todo.deviation <= atol) | whole)
        done += [todo.take(line), first.take(fits), second.take(fits)]
        todo, middle = todo.take(~line & ~fits), middle[~line & ~fits]
        cut = curve.point(todo.segment, middle)
        todo = _joined([todo._replace(t1=middle, end=cut), todo._replace(t0=middle, start=cut)])
    return _joined(done)


def _biarc(curve: _Host, spans: _Arcs, pieces: _Pieces) -> tuple[_Arcs, _Arcs, np.ndarray]:
    """Both arcs of a biarc for each span, measured, and whether there is one; where not, the numbers mean nothing."""
    tangents = _tangents(curve, spans.segment, spans.t0, pieces.offsets, 1)
    last = _tangents(curve, spans.segment, spans.t1, pieces.offsets[:, ::-1], -1)
    chord = np.maximum(np.hypot(*pieces.chord.T), _SHORT)
    share, found = _joint(pieces, tangents, last, np.ldexp(curve.rounding, -curve.first - curve.second) / chord)
    t = (spans.t0 + (spans.t1 - spans.t0) * share).astype(curve.dtype).astype(np.float64)
    found &= (spans.t0 < t) & (t < spans.t1)
    joint = curve.point(spans.segment, t)
    start, middle, end = (_complex(curve.local(x)) for x in (spans.start, joint, spans.end))
    turns = (middle - start) * tangents.conj(), last * (end - middle).conj()
    bulges = [np.tan(0.5 * np.angle(turn)).astype(curve.dtype).astype(np.float64) for turn in turns]
    both = _joined(
        [spans._replace(t1=t, end=joint, bulge=bulges[0]), spans._replace(t0=t, start=joint, bulge=bulges[1])]
    )
    both = both._replace(deviation=_deviation(curve, _pieces(curve, both), both.bulge))
    halves = np.arange(len(t)), np.arange(len(t)) + len(t)
    return both.take(halves[0]), both.take(halves[1]), found


def _complex(x: np.ndarray) -> np.ndarray:
    return x[..., 0] + 1j * x[..., 1]


def _tangents(curve: _Host, segment: np.ndarray, t: np.ndarray, offsets: np.ndarray, sign: int) -> np.ndarray:
    """Unit tangents at t as complex numbers; where the velocity vanishes, from the piece's own control points.

    The direction of (X / W)' is that of X' W - X W'. `offsets` start at t; sign is -1 where they run backwards.
    """
    rows = curve.rows[segment]
    value, first = _evaluated(rows, t)
    velocity = _complex(first[:, :2] * value[:, 2:] - value[:, :2] * first[:, 2:])
    steps = np.abs(np.diff(rows, axis=1)).max(axis=(1, 2)) * (rows.shape[1] - 1) * value[:, 2]
    # The first control point that is not at the end itself gives the tangent there.
    away = _complex(offsets[:, 1:] - offsets[:, :1])
    first_away = np.argmax(np.abs(away) > _NEAR * np.abs(away).max(axis=1, keepdims=True), axis=1)
    polygon = sign * away[np.arange(len(t)), first_away]
    direction = np.where(np.abs(velocity) > _STILL * steps, velocity, polygon)
    size = np.abs(direction)
    return np.where(size > 0, direction / np.where(size > 0, size, 1.0), 1.0)


def _joint(pieces: _Pieces, tangents: np.ndarray, last: np.ndarray, slack: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where in its piece, as a share of the parameters, the curve crosses the circle of joints; and whether it does.

    Arcs from 0 to z with the tangent T_0 and from z to v with the tangent T_1 have one tangent at z if and only if the
    direction of z^2 conj(v - z)^2 conj(T_0) T_1 is 1. Only inner places count, and of several the one next to the
    middle; the middle itself where the equation holds everywhere, or holds there up to `slack`, the angle that rounded
    ends are wrong by.
    """
    rows = np.concatenate([pieces.offsets * pieces.weights[..., None], pieces.weights[..., None]], axis=-1)
    chord, turn = _complex(pieces.chord), tangents.conj() * last

    def mismatch(value: np.ndarray, chord: np.ndarray, turn: np.ndarray) -> np.ndarray:
        z = _complex(value[..., :2] / value[..., 2:])
        product = z * (chord - z).conj()
        size = np.abs(product)
        known = size > np.finfo(float).tiny
        return np.where(known, product / np.where(known, size, 1.0), 0.0) ** 2 * turn

    n, inner = rows.shape[1] - 1, np.arange(1, _SAMPLES + 1) / (_SAMPLES + 1)
    powers = np.arange(n + 1)
    basis = binomials(n) * inner[:, None] ** powers * (1 - inner[:, None]) ** (n - powers)
    f = mismatch(np.einsum("si,kiw->ksw", basis, rows), chord[:, None], turn[:, None])
    sine, cosine = np.imag(f), np.real(f)
    crossing = (sine[:, :-1] * sine[:, 1:] <= 0) & (cosine[:, :-1] > 0) & (cosine[:, 1:] > 0)
    remote = np.abs(0.5 * (inner[:-1] + inner[1:]) - 0.5)
    place = np.argmin(np.where(crossing, remote, np.inf), axis=1)
    k = np.arange(len(rows))
    share = _root(
        lambda x: np.imag(mismatch(_evaluated(rows, x)[0], chord, turn)),
        (inner[place], inner[place + 1]),
        (sine[k, place], sine[k, place + 1]),
    )
    crossed, upright = crossing[k, place], cosine[:, _SAMPLES // 2] > 0
    off = np.abs(sine[:, _SAMPLES // 2])
    middle = upright & ((off < _FLAT) | ~crossed & (off < slack))
    return np.where(middle, 0.5, share), middle | crossed


def _root(
    f: Callable[[np.ndarray], np.ndarray], ends: tuple[np.ndarray, np.ndarray], values: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Where f vanishes between the ends, at which it has the given values, of opposite signs; the Illinois rule."""
    (a, b), (fa, fb) = ends, values
    for _ in range(_STEPS):
        slope = fb - fa
        x = np.where(slope == 0, b, b - fb * (b - a) / np.where(slope == 0, 1.0, slope))
        fx = f(x)
        opposite = fx * fb < 0
        a, fa = np.where(opposite, b, a), np.where(opposite, fb, 0.5 * fa)
        b, fb = x, fx
    return b
