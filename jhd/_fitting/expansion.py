"""Values, gradients and Hessians of critical pairs in the parameters of one of the curves.

With t on the curve that carries the maximum, feet s_i and multipliers lambda_i the value is the stationary value of
L = sum lambda_i |X(t) - Y(s_i)| in (t, s, lambda), so its gradient is L_theta and its Hessian the Schur complement
L_theta theta - L_theta z L_zz^-1 L_z theta over the unknowns z that are not held. The part of the Hessian of a distance
d that is orthogonal to its direction u is a a^T / d; one more unknown with the diagonal -d keeps it out of the matrices
as d goes to zero, and at a free foot in the plane u is the normal of the curve: the close case stays well conditioned.

This runs in NumPy on the host, at once for all pairs with equally many feet, without compilation. Unknowns that are
held have rows and columns of zeros, which the least-norm solution leaves at zero. The derivatives agree with those of
`critical_pairs` under jax.grad.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import basis
from jhd._arithmetic.rounding import smallest_normal
from jhd._distance.nearest.feet import by_normal, dot, stands_still, stays
from jhd._distance.normalization.jets import CurveJet, polynomial_jet, quotient
from jhd._results.solution import DIRECTIONS, EVENTS, CriticalPairs

FloatArray = Any  # np.ndarray of floats; NumPy's own generic alias says no more


class Moving(NamedTuple):
    """A curve with its derivatives in the parameters, in homogeneous form if it has weights."""

    # (segments, points, width), the coordinates, times the weights and followed by them if there are any.
    points: FloatArray
    tangent: FloatArray | None  # (segments, points, width, parameters), or None for a curve that is fixed
    rational: bool  # whether the last coordinate is the weight

    def places(self, segment: FloatArray) -> FloatArray:
        """The control points (segments, points, dim) of some segments."""
        points = self.points[segment]
        return points[..., :-1] / points[..., -1:] if self.rational else points


class Expansion(NamedTuple):
    """Second-order expansion of the values of some pairs."""

    value: FloatArray  # (pairs,) distances, largest first
    gradient: FloatArray  # (pairs, parameters)
    rows: FloatArray  # (pairs, unknowns, parameters), and
    # (pairs, unknowns, unknowns) whose products rows^T core rows are the Hessians, but for the second derivatives of
    # the control points. There are few unknowns, whatever the number of parameters.
    core: FloatArray
    # (pairs, segments, points, width) gradients in the homogeneous control points of the moving curve.
    cotangent: FloatArray

    def hessian(self, weights: FloatArray) -> FloatArray:
        """The sum of the Hessians (parameters, parameters) times weights (pairs,)."""
        some = np.flatnonzero(weights)
        rows = self.rows[some]
        inner = (self.core[some] @ rows) * np.asarray(weights)[some, None, None]
        return np.tensordot(rows, inner, axes=((0, 1), (0, 1)))

    def bowls(self, scale: FloatArray, bending: FloatArray) -> FloatArray:
        """Roots (pairs, rank, parameters) of the convex parts of all Hessians plus a matrix, in units of the scale."""
        rows, core = self.rows * scale, self.core
        if np.any(bending):
            value, vector = np.linalg.eigh(bending * scale * scale[:, None])
            count, few = len(value), core.shape[1]
            rows = np.concatenate([rows, np.broadcast_to(vector.T, (len(rows), count, count))], axis=1)
            both = np.zeros((len(core), few + count, few + count))
            both[:, :few, :few], both[:, few:, few:] = core, np.diag(value)
            core = both
        frame, mixed = np.linalg.qr(np.swapaxes(rows, 1, 2))
        return roots(mixed @ core @ np.swapaxes(mixed, 1, 2)) @ np.swapaxes(frame, 1, 2)


def roots(matrices: FloatArray) -> FloatArray:
    """R (count, rank, size), for which R^T R are the convex parts of symmetric matrices (count, size, size)."""
    values, vectors = np.linalg.eigh(matrices)
    values, vectors = values[:, ::-1], np.swapaxes(vectors, 1, 2)[:, ::-1]
    # Curvatures below this fraction of the largest are rounding.
    some = values > 1e-14 * np.max(np.abs(values), axis=1, initial=0.0, keepdims=True)
    rank = int(np.max(np.sum(some, axis=1), initial=0))
    return (np.sqrt(np.where(some, values, 0.0))[:, :, None] * vectors)[:, :rank]


class _MovingJets(NamedTuple):
    """Points with their derivatives in t and in the parameters, one for each pair."""

    point: FloatArray  # (pairs, dim)
    first: FloatArray
    second: FloatArray
    tangent: FloatArray  # (pairs, dim, parameters)
    tangent_first: FloatArray
    weight_tangent: FloatArray  # (pairs, parameters), relative to the weight
    cotangent: FloatArray  # (pairs, points, width, dim): the points' derivatives in the homogeneous control points


class _PairPlaces(NamedTuple):
    """Locations of some pairs: the fields of a witness that give them."""

    element: FloatArray
    t: FloatArray
    feet_elements: FloatArray
    feet_params: FloatArray
    multipliers: FloatArray


class _MovingFeet(NamedTuple):
    """One foot of each pair: location, derivatives, unit vector to the point, whether it is held, and multiplier."""

    segment: FloatArray
    jets: _MovingJets
    unit: FloatArray
    held: FloatArray
    weight: FloatArray


def expand(pairs: CriticalPairs, fixed: Moving, moving: Moving, least: float) -> Expansion:
    """Expansion of the pairs of (fixed, moving) whose values exceed `least`."""
    values = np.asarray(pairs.value)
    keep = np.flatnonzero(np.asarray(pairs.valid) & (values > least))
    events, directions = (np.asarray(x._value)[keep] for x in (pairs.witness.event, pairs.witness.direction))
    ends = np.isin(events, [int(event._value) for event in (EVENTS.a_end, EVENTS.corner)])
    turned = directions == int(DIRECTIONS.b_to_a._value)
    two = np.min(np.asarray(pairs.witness.multipliers)[keep], axis=-1) > 0
    count = 0 if moving.tangent is None else moving.tangent.shape[-1]
    # Pairs with two feet have the most unknowns.
    unknowns = _unknowns(2, moving.points.shape[-1] - moving.rational) + 4 * moving.rational
    found = Expansion(
        values[keep],
        np.zeros((len(keep), count)),
        np.zeros((len(keep), unknowns, count)),
        np.zeros((len(keep), unknowns, unknowns)),
        np.zeros((len(keep), *moving.points.shape)),
    )
    for back, feet in ((False, 1), (False, 2), (True, 1), (True, 2)):
        rows = np.flatnonzero((turned == back) & (two == (feet == 2)))
        if len(rows):
            witness = _PairPlaces(
                *(np.asarray(getattr(pairs.witness, name))[keep[rows]] for name in _PairPlaces._fields)
            )
            _fill(found, rows, witness, (fixed, moving), back, ends[rows], feet)
    return found


def _fill(
    found: Expansion,
    rows: FloatArray,
    at: _PairPlaces,
    curves: tuple[Moving, Moving],
    turned: bool,
    ends: FloatArray,
    count: int,
) -> None:
    """Fill rows of an expansion from the pairs of one direction with `count` feet."""
    parameters, (carrier, other) = found.gradient.shape[-1], reversed(curves) if turned else curves
    x = _jets(carrier, at.element, at.t, parameters)
    feet = []
    for i in range(count):
        segment, s = at.feet_elements[:, i], at.feet_params[:, i]
        y = _jets(other, segment, s, parameters)
        still = stands_still(y.first, other.places(segment))
        weight = at.multipliers[:, i] if count == 2 else np.ones(len(rows))
        feet.append(_MovingFeet(segment, y, *_directions(x, y, s, still), weight))
    held = ends | ~np.any(x.first, axis=-1)
    found.gradient[rows], c, core = _derivatives(x, feet, held)
    found.rows[rows, : c.shape[1]] = c
    found.core[rows, : c.shape[1], : c.shape[1]] = core
    if turned:
        unit = sum(foot.weight[:, None] * foot.unit for foot in feet)
        found.cotangent[rows, at.element] += np.einsum("kpwd,kd->kpw", x.cotangent, unit)
    else:
        for foot in feet:
            pull = -foot.weight[:, None] * foot.unit
            found.cotangent[rows, foot.segment] += np.einsum("kpwd,kd->kpw", foot.jets.cotangent, pull)


def _jets(curve: Moving, segment: FloatArray, t: FloatArray, count: int) -> _MovingJets:
    """Points of a curve at parameters t of segments, with derivatives in t, `count` parameters and control points."""
    points = curve.points[segment]
    values = basis(points.shape[1] - 1, t)[:, :, None, None]
    jet = polynomial_jet(np.moveaxis(points, 1, 0), t[:, None])
    v = np.zeros((2, len(segment), points.shape[2], count))
    if curve.tangent is not None:
        v = np.stack(polynomial_jet(np.moveaxis(curve.tangent[segment], 1, 0), t[:, None, None])[:2])
    if not curve.rational:
        still = np.zeros((len(segment), count))
        return _MovingJets(*jet, v[0], v[1], still, values * np.eye(points.shape[2]))
    n, w = CurveJet(*(x[:, :-1] for x in jet)), CurveJet(*(x[:, -1:] for x in jet))
    weight, v = v[:, :, -1], v[:, :, :-1]
    x, x1, x2 = quotient(n, w)
    over = w.point[:, :, None]
    vx = (v[0] - x[:, :, None] * weight[0][:, None]) / over
    vx1 = v[1] - x1[:, :, None] * weight[0][:, None] - x[:, :, None] * weight[1][:, None] - vx * w.first[:, :, None]
    into = np.broadcast_to(np.eye(x.shape[1]), (len(x), x.shape[1], x.shape[1]))
    cotangent = values / over[:, None] * np.concatenate([into, -x[:, None]], axis=1)[:, None]
    return _MovingJets(x, x1, x2, vx, vx1 / over, weight[0] / w.point, cotangent)


def _directions(x: _MovingJets, y: _MovingJets, s: FloatArray, still: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors from the feet to the points, and whether the feet are held, for example if b stands still."""
    c = x.point - y.point
    length, speed = np.sqrt(dot(c, c)), np.sqrt(dot(y.first, y.first))
    held = (speed == 0) | ((s <= 0) | (s >= 1)) & still | stays(s, dot(c, y.first), length * speed)
    known = ~held & by_normal(length, speed)
    unit = c / np.where(length > 0, length, 1.0)[:, None]
    if c.shape[1] == 2:
        normal = np.stack([-y.first[:, 1], y.first[:, 0]], axis=1) / np.where(known, speed, 1.0)[:, None]
        normal = np.where(dot(normal, c)[:, None] >= 0, normal, -normal)
        unit = np.where(known[:, None], normal, unit)
    return unit, held


def _unknowns(feet: int, dim: int) -> int:
    """The number of unknowns: t, the feet, dim - 1 directions across for each, and feet - 1 multipliers."""
    return 1 + feet * dim + feet - 1


def _derivatives(
    x: _MovingJets, feet: list[_MovingFeet], held: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gradients, and rows and cores of the Hessians; `held` marks pairs whose t on the carrier is fixed."""
    (pairs, dim, count), some = x.tangent.shape, len(feet)
    size = _unknowns(some, dim)
    k, c, free = np.zeros((pairs, size, size)), np.zeros((pairs, size, count)), np.ones((pairs, size), bool)
    g, pull = np.zeros((pairs, count)), np.zeros((pairs, count))
    # At an end the multipliers are constants.
    free[:, [0, *range(1 + some * dim, size)]] = ~held[:, None]
    for i, (_, y, u, foot_held, weight) in enumerate(feet):
        offset, change = x.point - y.point, x.tangent - y.tangent
        across = np.linalg.svd(u[:, None])[2][:, 1:]
        extra = slice(1 + some + i * (dim - 1), 1 + some + (i + 1) * (dim - 1))
        free[:, 1 + i] = ~foot_held
        g += weight[:, None] * _along(u, change)
        k[:, 0, 0] += weight * dot(u, x.second)
        k[:, 1 + i, 1 + i] = -weight * dot(u, y.second)
        c[:, 0] += weight[:, None] * _along(u, x.tangent_first)
        c[:, 1 + i] = -weight[:, None] * _along(u, y.tangent_first)
        pull += weight[:, None] * _along(u, x.tangent)
        own = dot(u, offset) / np.maximum(weight, smallest_normal(k.dtype))
        k[:, extra, extra] = -np.eye(dim - 1) * own[:, None, None]
        for j, speed in ((0, x.first), (1 + i, -y.first)):
            k[:, extra, j] = k[:, j, extra] = np.einsum("kid,kd->ki", across, speed)
        c[:, extra] = across @ change
    if some == 2:
        (_, y, u, _, _), (_, z, v, _, _) = feet
        for j, rate in enumerate((dot(u - v, x.first), -dot(u, y.first), dot(v, z.first))):
            k[:, -1, j] = k[:, j, -1] = rate
        c[:, -1] = _along(u, x.tangent - y.tangent) - _along(v, x.tangent - z.tangent)
    k, c = k * free[:, :, None] * free[:, None], c * free[:, :, None]
    weights = [(pull, x.weight_tangent, -np.ones(pairs))]
    weights += [(_along(foot.unit, foot.jets.tangent), foot.jets.weight_tangent, foot.weight) for foot in feet]
    # Singular values below this fraction of the largest count as zero: nothing moves along these directions.
    return g, *_with_weights(c, -np.linalg.pinv(k, rcond=1e-12), [w for w in weights if np.any(w[1])])


def _with_weights(
    c: FloatArray, core: FloatArray, weights: list[tuple[FloatArray, FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Rows and cores extended by moving weights, each with a pull p, a change w of weights and a factor f of p w^T."""
    size, more = core.shape[1], 2 * len(weights)
    both = np.zeros((len(core), size + more, size + more))
    both[:, :size, :size] = core
    for i, (_, _, factor) in enumerate(weights):
        at = size + 2 * i
        both[:, at, at + 1] = both[:, at + 1, at] = factor
    return np.concatenate([c, *(row[:, None] for p, w, _ in weights for row in (p, w))], axis=1), both


def _along(u: FloatArray, change: FloatArray) -> FloatArray:
    """The components (pairs, parameters) along unit vectors (pairs, dim) of changes (pairs, dim, parameters)."""
    return np.einsum("kd,kdp->kp", u, change)
