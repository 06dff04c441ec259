"""End points of biarcs: the pieces of a plane curve, subdivided until each has a biarc within the tolerance.

Two end points and their tangents determine a circle that contains the joint of every biarc. We take the point at which
the curve crosses this circle, so that each arc belongs to an interval of parameters of one segment. Everything runs in
NumPy, on all pieces of one depth together. `deviation` measures the result, so nothing here needs a proof.

Source: Sir, Feichtinger & Juttler, CAD 38 (2006), as used by Kim et al. 2010, section 2.2.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from jhd._arithmetic.bernstein import basis, binomials
from jhd._runtime.arrays import joined
from jhd._shapes.deviation import SHORT, HostArcs, HostCurve, Pieces, deviation, evaluated, pieces_of

# Parameters inside a piece at which the joint's equation is sampled.
_SAMPLES = 15


def fitted(curve: HostCurve, tolerance: float) -> HostArcs:
    """Arcs within tolerance of their pieces: biarcs if they fit, lines for straight pieces, else both halves.

    In order of segments and parameters. If a piece is too long but no float lies between its end parameters, it
    becomes a line with a larger deviation.
    """
    count = curve.rows.shape[1]
    zeros = np.zeros(count)
    todo = HostArcs(np.arange(count), zeros, zeros + 1, curve.ends[0], curve.ends[1], zeros, zeros)
    done = []
    while len(todo.segment):
        pieces = pieces_of(curve, todo)
        middle = curve.number(0.5 * (todo.t0 + todo.t1))
        whole = (middle <= todo.t0) | (middle >= todo.t1)
        # Pieces below this fraction of the tolerance that no biarc fits (cusps) become lines.
        speck = curve.length(np.abs(pieces.offsets).max(axis=0)) <= tolerance / 16
        todo = _measured(curve, todo, pieces, whole | speck)
        straight = todo.deviation <= min(tolerance, 2 * curve.rounding)
        fits = np.zeros(len(whole), bool)
        tried = np.flatnonzero(~straight & ~_hopeless(curve, pieces, tolerance))
        if len(tried):
            first, second, good = _biarc(curve, todo.take(tried), pieces.take(tried))
            good &= np.maximum(first.deviation, second.deviation) <= tolerance
            fits[tried[good]] = True
            done += [first.take(good), second.take(good)]
        line = straight | ~fits & (speck & (todo.deviation <= tolerance) | whole)
        done.append(todo.take(line))
        rest = ~line & ~fits
        todo, middle = todo.take(rest), middle[rest]
        cut = curve.point(todo.segment, middle)
        todo = joined([todo._replace(t1=middle, end=cut), todo._replace(t0=middle, start=cut)])
    arcs = joined(done)
    return arcs.take(np.lexsort((arcs.t0, arcs.segment)))


def _measured(curve: HostCurve, lines: HostArcs, pieces: Pieces, wanted: np.ndarray) -> HostArcs:
    """The lines with their deviations, if wanted or possibly due to rounding alone; the others get infinity."""
    length = np.maximum(np.abs(pieces.chord), SHORT)
    off = np.abs(np.imag(pieces.offsets * pieces.chord.conj())).max(axis=0)
    rows = np.flatnonzero(wanted | (off <= 2 * np.ldexp(curve.rounding, -curve.first - curve.second) * length))
    result = np.full(len(wanted), np.inf)
    if len(rows):
        result[rows] = deviation(curve, pieces.take(rows), lines.bulge[rows])
    return lines._replace(deviation=result)


def _hopeless(curve: HostCurve, pieces: Pieces, tolerance: float) -> np.ndarray:
    """Mask of the polynomial pieces whose curvature changes too much from end to end; free of divisions."""
    n, q = curve.degree, pieces.offsets
    if curve.weights is not None or n < 2:
        return np.zeros(q.shape[1], bool)
    legs = [q[1] - q[0], q[2] - q[1], q[-2] - q[-3], q[-1] - q[-2]]
    bends = [(n - 1) / n * np.imag(legs[k].conj() * legs[k + 1]) for k in (0, 2)]
    cubes = [np.abs(legs[k]) ** 3 for k in (0, 3)]
    change = np.abs(bends[1] * cubes[0] - bends[0] * cubes[1]) * np.abs(pieces.chord) ** 2
    # A biarc of length h errs by h^2 / 324 times the change of curvature if the curvature grows evenly (Meek & Walton
    # 1995). No biarc is tried if this error exceeds four tolerances.
    with np.errstate(over="ignore"):
        return change > 324 * 4 * np.ldexp(tolerance, -curve.first - curve.second) * cubes[0] * cubes[1]


def _biarc(curve: HostCurve, spans: HostArcs, pieces: Pieces) -> tuple[HostArcs, HostArcs, np.ndarray]:
    """Both arcs of a biarc for each span with deviations, and whether the biarc exists; otherwise ignore the arcs."""
    first, last = _tangents(curve, spans, pieces)
    chord = np.maximum(np.abs(pieces.chord), SHORT)
    slack = np.ldexp(curve.rounding, -curve.first - curve.second) / chord
    share, found = _joint(pieces, first.conj() * last, slack)
    t = curve.number(spans.t0 + (spans.t1 - spans.t0) * share)
    found &= (spans.t0 < t) & (t < spans.t1)
    joint = curve.point(spans.segment, t)
    z = curve.local(joint) - curve.local(spans.start)
    turns = np.concatenate([z * first.conj(), last * (pieces.chord - z).conj()])
    bulge = curve.number(np.tan(0.5 * np.angle(turns)))
    both = joined([spans._replace(t1=t, end=joint), spans._replace(t0=t, start=joint)])._replace(bulge=bulge)
    both = both._replace(deviation=deviation(curve, pieces_of(curve, both), bulge))
    count = len(t)
    return both.take(slice(count)), both.take(slice(count, None)), found


def _tangents(curve: HostCurve, spans: HostArcs, pieces: Pieces) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangents at both ends; if the velocity vanishes, from the piece's own control points.

    (X / W)' has the direction of X' W - X W'.
    """
    both = np.concatenate([spans.segment, spans.segment])
    t, rows = np.concatenate([spans.t0, spans.t1]), curve.rows[:, both]
    value, velocity = evaluated(rows, t)
    steps = np.abs(np.diff(rows, axis=0)).max(axis=0) * curve.degree
    if curve.weights is not None:
        weight, slope = evaluated(curve.weights[:, both], t)
        velocity, steps = velocity * weight - value * slope, steps * weight
    size = np.abs(velocity)
    # A velocity below this fraction of the largest one has no reliable direction.
    still = np.flatnonzero(size <= 1e-9 * steps)
    if len(still):
        velocity[still] = np.concatenate([_away(pieces.offsets), -_away(pieces.offsets[::-1])])[still]
        size = np.abs(velocity)
    unit = np.where(size > 0, velocity / np.where(size > 0, size, 1.0), 1.0)
    return unit[: len(spans.t0)], unit[len(spans.t0) :]


def _away(offsets: np.ndarray) -> np.ndarray:
    """The vector from each first control point to the next control point that differs from it."""
    away = offsets[1:] - offsets[:1]
    # A control point this near to an end, as a fraction of the farthest, gives no tangent direction there.
    next_ = np.argmax(np.abs(away) > 1e-3 * np.abs(away).max(axis=0), axis=0)
    return away[next_, np.arange(away.shape[1])]


@cache
def _samples(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters inside [0, 1], Bernstein polynomials there, and the matrix to coefficients of powers."""
    inner, powers = np.arange(1, _SAMPLES + 1) / (_SAMPLES + 1), np.arange(n + 1)
    change = np.zeros((n + 1, n + 1))
    for i in powers:
        # The k-th power's coefficient is C(n,k) times the k-th difference.
        change[i:, i] = binomials(n)[i:] * [binomials(k)[i] * (-1.0) ** (k - i) for k in range(i, n + 1)]
    return inner, basis(n, inner), change


def _joint(pieces: Pieces, turn: np.ndarray, slack: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative parameter at which each piece crosses its circle of joints, and whether it does.

    Arcs from 0 to z with the tangent T_0 and from z to v with the tangent T_1 have one tangent at z if and only if the
    direction of z^2 conj(v - z)^2 conj(T_0) T_1 is 1. Only inner parameters count, and of several the one next to the
    middle. It is the middle itself if the equation holds everywhere, or holds there up to `slack`, the angle by which
    rounded ends are wrong.
    """
    chord, weights = pieces.chord, pieces.weights
    rows = pieces.offsets if weights is None else pieces.offsets * weights
    inner, basis, change = _samples(len(rows) - 1)
    z = basis @ rows if weights is None else (basis @ rows) / (basis @ weights)
    product = z * (chord - z).conj()
    size = np.abs(product)
    known = size > np.finfo(float).tiny
    f = (np.where(known, product, 0.0) / np.where(known, size, 1.0)) ** 2 * turn
    sine, cosine = np.imag(f), np.real(f)
    crossing = (sine[:-1] * sine[1:] <= 0) & (cosine[:-1] > 0) & (cosine[1:] > 0)
    remote = np.abs(0.5 * (inner[:-1] + inner[1:]) - 0.5)[:, None]
    place = np.argmin(np.where(crossing, remote, np.inf), axis=0)
    k = np.arange(len(turn))
    crossed, middle = crossing[place, k], _SAMPLES // 2
    off = np.abs(sine[middle])
    # The equation of the joint holds everywhere on lines and circles; below this it is rounding.
    even = (cosine[middle] > 0) & ((off < 1e-12) | ~crossed & (off < slack))
    share = np.full(len(turn), 0.5)
    rows_ = np.flatnonzero(crossed & ~even)
    if len(rows_):
        polynomials = change @ rows[:, rows_], None if weights is None else change @ weights[:, rows_]
        f = _mismatch(*polynomials, chord[rows_], turn[rows_])
        place = place[rows_]
        share[rows_] = _root(f, inner[place], inner[place + 1])
    return share, even | crossed


def _mismatch(
    rows: np.ndarray, weights: np.ndarray | None, chord: np.ndarray, turn: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """The equation of the joint up to a positive factor, for pieces as sums of powers."""
    scale = 1 / np.maximum(np.abs(chord), SHORT)
    rows, chord = rows * scale, chord * scale

    def f(t: np.ndarray) -> np.ndarray:
        z = _horner(rows, t) if weights is None else _horner(rows, t) / _horner(weights, t)
        product = z * (chord - z).conj()
        return np.imag(product * product * turn)

    return f


def _horner(c: np.ndarray, t: np.ndarray) -> np.ndarray:
    value = c[-1] * t + c[-2] if len(c) > 1 else c[0] + 0 * t
    for row in c[-3::-1]:
        value = value * t + row
    return value


def _root(f: Callable[[np.ndarray], np.ndarray], a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """A zero of f between a and b, at which f has opposite signs, by the Illinois rule."""
    fa, fb = f(a), f(b)
    for _ in range(12):
        slope = fb - fa
        x = np.where(slope == 0, b, b - fb * (b - a) / np.where(slope == 0, 1.0, slope))
        # The root find ends when no parameter moves by more.
        if np.abs(x - b).max() < 1e-13:
            break
        fx = f(x)
        opposite = fx * fb < 0
        a, fa = np.where(opposite, b, a), np.where(opposite, fb, 0.5 * fa)
        b, fb = x, fx
    return b
