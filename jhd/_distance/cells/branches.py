"""Upper bound of the distance from one cell of a to b: two branches of b, matched to the cell and split at their peak.

A cell is a parameter interval of one segment of a, with a foot on b at each end. A branch continues one of the feet
over the cell by a map sigma of the cell's parameter u into the parameter of one segment of b, so that
D(u) = |A(u) - B(sigma(u))|^2 bounds the squared distance at every u, for any sigma. In Bernstein form its largest
coefficient bounds it over the cell, and the smaller of the two branches' bounds holds too. The coefficients of both are
first **split at tau**, where min(D_X, D_Y) is largest, and the larger of the two halves' bounds is taken: next to an
interior peak all coefficients equal the value there, and at a crossing each half is monotone, so the bound is exact up
to the mismatch of the feet, at antipodal and at one-to-two maxima alike. Any tau gives a true bound, so tau is not
proven.

sigma is a cubic with the feet's speeds at both ends on polynomial curves, which leaves a mismatch of fourth order, and
a Moebius map on rational ones, which is exact between two proper parametrizations of one rational curve.

Rounding, for coordinates of at most one. Let p, q be the degrees, g the degree of sigma (1 for a Moebius map), n the
degree of the difference e, d the dimension, G(k) = rounding.gamma(k).
 - A on the cell: restriction, 3 p roundings a coefficient; raising it to degree n, n + 6 more.
 - B(sigma): q levels of g + 4 roundings each (complement, binomial factors, products, g + 1 sums), then a division (two
   roundings): q (g + 4) + 2; raising it to degree n, n + 6 more. sigma's coefficients are floats by definition.
 - Every coefficient is a sum of terms with non-negative factors that add up to one (to the weight on rational curves,
   where both sides carry both weights, two roundings more each), so e(u) is off by at most
   eta = sqrt(d) G(3 p + q (g + 4) + 2 n + 20) times w(u); splitting at tau adds 3 n roundings of |e| <= 2 w.
 - |e|^2: as in jhd._distance.nearest.curves, at most G(n + d + 8) rho^2 with rho the largest |e_i| / w_i of the half;
   the quotient by w^2 a relative G(2 (3 p + q (g + 4) + 5 n) + 20), none on polynomial curves.
 - Flushed subnormals add a few hundred smallest normal numbers nu, on rational curves divided by the smallest weight
   and, under the root, by its square; the constructors of curves limit the ratio of weights, so w^2 is no subnormal.
 - So distance <= sqrt(max D_k (1 + that) + G(n + d + 8) rho^2) (1 + G(4)) + eta.

Source: the hull property is in Farouki & Rajan, CAGD 5 (1988); the split at tau and the maps are ours.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic import bernstein
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._distance.nearest.chords import Chords, chord_error, square_and_parameter
from jhd._distance.nearest.feet import equation, foot_speed, nearest_passed
from jhd._distance.normalization.jets import CurveJet, jet
from jhd._distance.normalization.pieces import Piece, piece_of
from jhd._runtime.arrays import module_of, varying
from jhd._shapes.curve import BezierSegments

# Newton steps that carry a foot to the other end of its cell, from a start of second order.
_CARRY = 3
# Samples of the cell among which the peak is looked for, and steps that refine it; two reach full precision.
_NODES, _PEAK_STEPS = 9, 2
# Ratio of the foot speeds at the ends of a cell beyond which a Moebius map would only do harm.
_MOST_SKEW = 16.0


class CurveCell(NamedTuple):
    """A parameter interval of one segment of a, with a foot on b at each end."""

    segment: Array
    t0: Array
    t1: Array
    k0: Array
    s0: Array
    k1: Array
    s1: Array


class CurveBound(NamedTuple):
    """Upper bound over a cell; the parameter of the peak, the distance of the branches there, and the nearer's foot."""

    upper: Array
    t: Array
    distance: Array
    k: Array
    s: Array


class _FollowedBranch(NamedTuple):
    """Difference e = w (A - B(sigma)) over the cell, its weight w (None if it is one), and the ends of sigma."""

    e: Array
    w: Array | None
    s0: Array
    s1: Array


def cell_upper_bound(a: BezierSegments, b: BezierSegments, cell: CurveCell, runs: Chords | None = None) -> CurveBound:
    """Bound the distance to b over one cell of a, and choose a cut; `runs` are the straight runs of b, if any."""
    piece = piece_of(a, cell.segment)
    width = cell.t1 - cell.t0
    part = _restricted(piece, cell.t0, cell.t1)
    ends = jnp.stack([cell.t0, cell.t1])
    jets = jax.vmap(lambda t: jet(*piece, t))(ends)

    def branch(k: Array, s: Array, from_right: Array) -> _FollowedBranch:
        near = jax.tree_util.tree_map(lambda x: jnp.where(from_right, x[1], x[0]), jets)
        far = jax.tree_util.tree_map(lambda x: jnp.where(from_right, x[0], x[1]), jets)
        foot = piece_of(b, k)
        speed = _speed(near, width, foot, s)
        guess = jnp.clip(s + speed * jnp.where(from_right, -width, width), 0.0, 1.0)
        other = nearest_passed(far.point, foot, guess, _CARRY)
        far_speed = _speed(far, width, foot, other)
        s0, s1 = jnp.where(from_right, other, s), jnp.where(from_right, s, other)
        v0, v1 = jnp.where(from_right, far_speed, speed), jnp.where(from_right, speed, far_speed)
        e, w = _difference(part, foot, *_sigma(s0, s1, v0 * width, v1 * width, part.weights is not None))
        return _FollowedBranch(e, w, s0, s1)

    right = jnp.array([False, True])
    both = jax.vmap(branch)(jnp.stack([cell.k0, cell.k1]), jnp.stack([cell.s0, cell.s1]), right)
    u, distance, nearer = _peak(both)
    upper = _split_bound(both, u, a.degree, b.degree)
    upper = upper if runs is None else jnp.minimum(upper, _run_bound(part, runs, cell))
    s = both.s0[nearer] + u * (both.s1[nearer] - both.s0[nearer])
    k = jnp.where(nearer == 0, cell.k0, cell.k1)
    return CurveBound(upper, cell.t0 + u * width, distance, k, s)


def first_upper_bound(a: BezierSegments, b: BezierSegments, cell: CurveCell, runs: Chords | None = None) -> Array:
    """A cheap upper bound: sigma affine between feet on one segment, else constant at either foot.

    The length of e is convex, so |e(u)| <= w(u) max |e_i| / w_i; roundings as for the full bound.
    """
    part = _restricted(piece_of(a, cell.segment), cell.t0, cell.t1)
    same = cell.k0 == cell.k1

    def bound(k: Array, s0: Array, s1: Array) -> Array:
        sigma = jnp.stack([s0, s1])
        e, w = _difference(part, piece_of(b, k), sigma, 1 - sigma)
        flushed = 200 * (a.degree + b.degree + 2) * smallest_normal(e.dtype)
        # Divided before they are squared: squares of small weights would be flushed.
        vectors = e if w is None else e / w[:, None]
        lost = flushed if w is None else flushed * (1 + 1 / jnp.min(w))
        return jnp.sqrt(jnp.max(jnp.sum(vectors * vectors, axis=-1)) + flushed) + lost

    ks = jnp.stack([cell.k0, cell.k1])
    firsts = jnp.stack([cell.s0, jnp.where(same, cell.s0, cell.s1)])
    lasts = jnp.stack([jnp.where(same, cell.s1, cell.s0), cell.s1])
    most = jnp.min(jax.vmap(bound)(ks, firsts, lasts))
    p, q, dim, dtype = a.degree, b.degree, a.dim, most.dtype
    roundings = 2 * (3 * p + 5 * q + 5 * (p + q)) + dim + 24
    most = most * (1 + gamma(roundings, dtype)) + math.sqrt(dim) * gamma(roundings, dtype)
    return most if runs is None else jnp.minimum(most, _run_bound(part, runs, cell))


def _run_bound(part: Piece, runs: Chords, cell: CurveCell) -> Array:
    """An upper bound by the straight runs of b that carry the feet; exact over a straight part of a along such a run.

    The distance from the chord of a run is convex, so over the hull of the cell it is largest at a control point; from
    the run it is at most delta more (jhd._distance.nearest.chords). No joint between segments of a run matters.

    Rounding: a control point of the cell is off by 3 p roundings in numerator and weight, and by the roundings of the
    product and the quotient.
    """
    points = part.control_points if part.weights is None else part.control_points / part.weights[:, None]
    count, dim = points.shape

    def bound(k: Array) -> Array:
        start, chord, inverse, delta = (x[k] for x in runs)
        squares = jax.vmap(lambda p: square_and_parameter(p, start, chord, inverse)[0])(points)
        return jnp.sqrt(jnp.max(squares)) + delta

    most = jnp.min(jax.vmap(bound)(jnp.stack([cell.k0, cell.k1])))
    rounding = math.sqrt(dim) * gamma(6 * (count - 1) + 8, most.dtype)
    return most * (1 + gamma(4, most.dtype)) + chord_error(dim, most.dtype) + rounding


def _speed(a: CurveJet, width: Array, piece: Piece, s: Array) -> Array:
    return foot_speed(s, equation(a.point, piece, s), a.first, width)


def _restricted(piece: Piece, t0: Array, t1: Array) -> Piece:
    """Homogeneous control points and weights of the part [t0, t1]."""
    if piece.weights is None:
        return Piece(bernstein.restrict(piece.control_points, t0, t1, axis=0), None)
    points = piece.control_points * piece.weights[:, None]
    return Piece(bernstein.restrict(points, t0, t1, axis=0), bernstein.restrict(piece.weights, t0, t1))


def _sigma(s0: Array, s1: Array, v0: Array, v1: Array, rational: bool) -> tuple[Array, Array]:
    """Bernstein coefficients of sigma and of its complement, both non-negative.

    Cubic Hermite with end speeds v0, v1 per unit of u, its inner coefficients kept near [s0, s1] and in [0, 1]; on
    rational curves a Moebius map whose end speeds have the ratio of v0 and v1, in homogeneous form.
    """
    if rational:
        weights, sigma = moebius_weights(v0, v1), jnp.stack([s0, s1])
        return sigma * weights, (1 - sigma) * weights
    sigma = hermite(s0, s1, v0, v1)
    return sigma, 1 - sigma


def moebius_weights(v0: Any, v1: Any) -> Any:
    """The weights of a Moebius map whose speeds at the ends have the ratio of v0 and v1, along a last axis."""
    xp, ratio = module_of(v0), v0 / module_of(v0).where(v1 == 0, 1.0, v1)
    usable = (ratio > 1 / _MOST_SKEW) & (ratio < _MOST_SKEW) & (v1 != 0)
    weight = xp.sqrt(xp.where(usable, ratio, 1.0))
    return xp.stack([xp.ones_like(weight), weight], axis=-1)


def hermite(s0: Any, s1: Any, v0: Any, v1: Any) -> Any:
    """Bernstein coefficients, along a last axis, of a cubic with these speeds at its ends, near [s0, s1], in [0, 1]."""
    xp = module_of(s0)
    slack = 0.5 * abs(s1 - s0)
    low, high = xp.minimum(s0, s1) - slack, xp.maximum(s0, s1) + slack
    inner = (xp.clip(xp.clip(x, low, high), 0.0, 1.0) for x in (s0 + v0 / 3, s1 - v1 / 3))
    return xp.stack([s0, *inner, s1], axis=-1)


def _composed(c: Array, sigma: Array, complement: Array) -> Array:
    """Coefficients of f(sigma(u)), f given by c (q + 1, ...), by de Casteljau's algorithm on scaled polynomials."""
    q, g = c.shape[0] - 1, sigma.shape[0] - 1
    s, o = (polynomial * bernstein.binomials(g).astype(sigma.dtype) for polynomial in (sigma, complement))
    rows = c[..., None]
    for _ in range(q):
        rows = bernstein.shifted_sum(o[:, None] * rows[:-1, ..., None, :] + s[:, None] * rows[1:, ..., None, :])
    scale = bernstein.binomials(g * q).astype(sigma.dtype)
    return jnp.moveaxis(rows[0] / scale, -1, 0)


def _difference(part: Piece, foot: Piece, sigma: Array, complement: Array) -> tuple[Array, Array | None]:
    """E = A - B(sigma) in common degree, or w_B A - w_A B with the weight w_A w_B."""
    if part.weights is None or foot.weights is None:
        path = _composed(foot.control_points, sigma, complement)
        n = max(part.control_points.shape[0], path.shape[0]) - 1
        return bernstein.elevate(part.control_points, n, axis=0) - bernstein.elevate(path, n, axis=0), None
    path = _composed(foot.control_points * foot.weights[:, None], sigma, complement)
    weight = _composed(foot.weights, sigma, complement)
    e = bernstein.multiply(part.control_points.T, weight) - bernstein.multiply(path.T, part.weights)
    return e.T, bernstein.multiply(part.weights, weight)


def _peak(both: _FollowedBranch) -> tuple[Array, Array, Array]:
    """Return the parameter at which the smaller of the two distances is largest, its value, and the nearer branch."""

    def heights(u: Array) -> Array:
        def one(e: Array, w: Array | None) -> Array:
            c = jet(e if w is None else e / w[:, None], w, u)
            return jnp.stack([c.point @ c.point, 2 * (c.point @ c.first), 2 * (c.first @ c.first + c.point @ c.second)])

        return jax.vmap(one, out_axes=1)(both.e, both.w)

    nodes = np.linspace(0.0, 1.0, _NODES)
    samples = jax.vmap(lambda u: jnp.min(heights(u)[0]))(jnp.asarray(nodes, both.e.dtype))
    u = jnp.argmax(samples).astype(both.e.dtype) / (_NODES - 1)
    low, high = jnp.maximum(u - 1 / (_NODES - 1), 0.0), jnp.minimum(u + 1 / (_NODES - 1), 1.0)

    def step(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        u, (f, f1, f2), tried = state
        rows = jax.vmap(heights)(tried)
        least = jnp.min(rows[:, 0], axis=-1)
        i = jnp.argmax(least)
        # At a tie the later one, which is nearer to the peak than values can tell.
        better = least[i] >= jnp.min(f)
        u, (f, f1, f2) = jnp.where(better, tried[i], u), jnp.where(better, rows[i], state[1])
        tops = u - f1 / jnp.where(f2 < 0, f2, -jnp.inf)
        slope = f1[0] - f1[1]
        crossing = u - (f[0] - f[1]) / jnp.where(slope != 0, slope, jnp.inf)
        return u, jnp.stack([f, f1, f2]), jnp.clip(jnp.append(tops, crossing), low, high)

    # The first step tries the sample itself: the compiled function has one evaluation instead of three.
    start = u, jnp.full((3, 2), -jnp.inf, u.dtype), jnp.stack([u, u, u])
    u, (f, *_), _ = jax.lax.fori_loop(0, _PEAK_STEPS + 1, step, varying(start, both))
    return u, jnp.sqrt(jnp.min(f)), jnp.argmin(f)


def _split_bound(both: _FollowedBranch, u: Array, p: int, q: int) -> Array:
    """Return the maximum over both halves of the cell of the smaller proven bound of the two branches."""
    n, dim, dtype = both.e.shape[1] - 1, both.e.shape[2], both.e.dtype
    g = 3 if both.w is None else 1
    roundings = 3 * p + q * (g + 4) + 2 * n + 20
    eta = math.sqrt(dim) * (gamma(roundings, dtype) + 2 * gamma(3 * n + 1, dtype))
    flushed = 200 * (n + q + 2) * smallest_normal(dtype)

    def bound(e: Array, w: Array | None) -> Array:
        squares, rho_sq = bernstein.dot(e, e), jnp.sum(e * e, axis=-1)
        relative, lost = 0.0, flushed
        if w is not None:
            weight_sq = bernstein.multiply(w, w)
            # Digits of e, w and their squares that are flushed count in units of the weight.
            lost = flushed * (1 + 1 / jnp.min(w)) / jnp.min(weight_sq)
            squares, rho_sq = squares / weight_sq, rho_sq / (w * w)
            relative = gamma(2 * (3 * p + q * (g + 4) + 5 * n) + 20, dtype)
        most = jnp.max(squares) * (1 + relative) + gamma(n + dim + 8, dtype) * jnp.max(rho_sq) * (1 + relative)
        return jnp.sqrt(jnp.maximum(most, 0.0) + lost) * (1 + gamma(4, dtype)) + eta + flushed

    def halves(e: Array, w: Array | None) -> Array:
        e0, e1 = bernstein.split(e, u, axis=0)
        if w is None:
            return jax.vmap(lambda x: bound(x, None))(jnp.stack([e0, e1]))
        return jax.vmap(bound)(jnp.stack([e0, e1]), jnp.stack(bernstein.split(w, u)))

    return jnp.max(jnp.min(jax.vmap(halves)(both.e, both.w), axis=0))
