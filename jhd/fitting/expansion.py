"""Values, gradients and Hessians of critical pairs in the parameters of one of the curves.

With t on the curve that carries the maximum, feet s_i and multipliers lambda_i the value is the stationary value of
L = sum lambda_i |X(t) - Y(s_i)| in (t, s, lambda), so its gradient is L_theta and its Hessian the Schur complement
L_theta theta - L_theta z L_zz^-1 L_z theta over the unknowns z that are not held. The part of the Hessian of a distance
d that is orthogonal to its direction u is a a^T / d; one more unknown with the diagonal -d keeps it out of the matrices
as d goes to zero, and at a free foot in the plane u is the normal of the curve: the close case stays well conditioned.

This runs in NumPy on the host: a dozen pairs with a few unknowns each, and nothing to compile. The same derivatives are
those of `critical_pairs` under jax.grad.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd.arithmetic.bernstein import basis
from jhd.arithmetic.rounding import smallest_normal
from jhd.distance.frame.jets import CurveJet, polynomial_jet, quotient
from jhd.distance.nearest.feet import stays
from jhd.solution import DIRECTIONS, EVENTS, CriticalPairs

# Singular values below this share of the largest are none: where they vanish nothing moves.
_SINGULAR = 1e-12

FloatArray = Any  # np.ndarray of floats; NumPy's own generic alias says no more


class Moving(NamedTuple):
    """A curve with its derivatives in the parameters, in homogeneous form where it has weights.

    Args:
        points: (segments, points, width), the coordinates, times the weights and followed by them if there are any.
        tangent: (segments, points, width, parameters), or None for a curve that is fixed.
        rational: whether the last coordinate is the weight.
    """

    points: FloatArray
    tangent: FloatArray | None
    rational: bool


class Expansion(NamedTuple):
    """Second-order expansion of the values of some pairs.

    Args:
        value: (pairs,) distances, largest first.
        gradient: (pairs, parameters).
        hessian: (pairs, parameters, parameters), but for the second derivatives of the control points.
        cotangent: (pairs, segments, points, width) gradients in the homogeneous control points of the moving curve.
    """

    value: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    cotangent: FloatArray


class _MovingJet(NamedTuple):
    """A point with its derivatives in t and in the parameters."""

    point: FloatArray
    first: FloatArray
    second: FloatArray
    tangent: FloatArray  # (dim, parameters)
    tangent_first: FloatArray
    weight_tangent: FloatArray  # (parameters,), relative to the weight
    cotangent: FloatArray  # (points, width, dim): the point's derivative in the homogeneous control points


def expand(pairs: CriticalPairs, fixed: Moving, moving: Moving, least: float) -> Expansion:
    """Expansion of the pairs of (fixed, moving) whose values exceed `least`."""
    values = np.asarray(pairs.value)
    keep = np.flatnonzero(np.asarray(pairs.valid) & (values > least))
    names = ("segment", "t", "foot_segments", "foot_params", "multipliers")
    witness = {name: np.asarray(getattr(pairs.witness, name)).tolist() for name in names}
    events, directions = (np.asarray(x._value) for x in (pairs.witness.event, pairs.witness.direction))
    count = 0 if moving.tangent is None else moving.tangent.shape[-1]
    gradient, hessian = np.zeros((len(keep), count)), np.zeros((len(keep), count, count))
    cotangent = np.zeros((len(keep), *moving.points.shape))
    for row, k in enumerate(keep):
        turned = directions[k] == int(DIRECTIONS.b_to_a._value)
        carrier, other = (moving, fixed) if turned else (fixed, moving)
        at = witness["segment"][k], witness["t"][k]
        feet = list(zip(witness["foot_segments"][k], witness["foot_params"][k], strict=True))
        two = min(witness["multipliers"][k]) > 0
        feet, weights = (feet, witness["multipliers"][k]) if two else (feet[:1], [1.0])
        x, ys = _jet(carrier, *at, count), [_jet(other, *foot, count) for foot in feet]
        ends = [int(event._value) for event in (EVENTS.a_end, EVENTS.corner)]
        held_t = bool(events[k] in ends or not np.any(x.first))
        units, held = zip(*(_direction(x, y, s) for y, (_, s) in zip(ys, feet, strict=True)), strict=True)
        gradient[row], hessian[row] = _derivatives(x, ys, units, weights, held_t, held)
        for (segment, _), jet, unit in (
            [(at, x, sum(w * u for w, u in zip(weights, units, strict=True)))]
            if turned
            else [(foot, y, -w * u) for foot, y, w, u in zip(feet, ys, weights, units, strict=True)]
        ):
            cotangent[row, segment] += jet.cotangent @ unit
    return Expansion(values[keep], gradient, hessian, cotangent)


def _jet(curve: Moving, segment: int, t: float, count: int) -> _MovingJet:
    points, t = curve.points[segment], float(t)
    values, jet = basis(len(points) - 1, t)[:, None, None], polynomial_jet(points, t)
    v = np.zeros((2, points.shape[1], count))
    if curve.tangent is not None:
        v = np.stack(polynomial_jet(curve.tangent[segment], t)[:2])
    if not curve.rational:
        return _MovingJet(*jet, v[0], v[1], np.zeros(count), values * np.eye(points.shape[1]))
    n, w = CurveJet(*(x[:-1] for x in jet)), CurveJet(*(x[-1] for x in jet))
    weight, v = v[:, -1], v[:, :-1]
    x, x1, x2 = quotient(n, w)
    vx = (v[0] - np.outer(x, weight[0])) / w.point
    vx1 = (v[1] - np.outer(x1, weight[0]) - np.outer(x, weight[1]) - vx * w.first) / w.point
    cotangent = values / w.point * np.vstack([np.eye(len(x)), -x])
    return _MovingJet(x, x1, x2, vx, vx1, weight[0] / w.point, cotangent)


def _direction(x: _MovingJet, y: _MovingJet, s: float) -> tuple[FloatArray, bool]:
    """Unit vector from the foot to the point, and whether the foot is held."""
    c = x.point - y.point
    length, speed = np.sqrt(c @ c), np.sqrt(y.first @ y.first)
    held = bool(speed == 0 or stays(s, c @ y.first, length * speed))
    if len(c) == 2 and not held:
        normal = np.array([-y.first[1], y.first[0]]) / speed
        return (normal if normal @ c >= 0 else -normal), held
    return c / (length if length > 0 else 1.0), held


def _derivatives(
    x: _MovingJet, ys: list[_MovingJet], units: Any, weights: list[float], held_t: bool, held: Any
) -> tuple[FloatArray, FloatArray]:
    """Gradient and Hessian of one value."""
    dim, count = x.tangent.shape
    feet = len(ys)
    size = 1 + feet + feet * (dim - 1) + (feet - 1)
    k, c, m, g = np.zeros((size, size)), np.zeros((size, count)), np.zeros((count, count)), np.zeros(count)
    for i, (y, u, weight) in enumerate(zip(ys, units, weights, strict=True)):
        offset, change = x.point - y.point, x.tangent - y.tangent
        across = np.linalg.svd(u[None])[2][1:]
        extra = slice(1 + feet + i * (dim - 1), 1 + feet + (i + 1) * (dim - 1))
        g += weight * u @ change
        k[0, 0] += weight * u @ x.second
        k[1 + i, 1 + i] = -weight * u @ y.second
        c[0] += weight * u @ x.tangent_first
        c[1 + i] = -weight * u @ y.tangent_first
        for jet, sign in ((x, 1.0), (y, -1.0)):
            pull = np.outer(u @ jet.tangent, jet.weight_tangent)
            m -= sign * weight * (pull + pull.T)
        k[extra, extra] = -np.eye(dim - 1) * (u @ offset) / max(weight, smallest_normal(k.dtype))
        k[extra, 0] = k[0, extra] = across @ x.first
        k[extra, 1 + i] = k[1 + i, extra] = -across @ y.first
        c[extra] = across @ change
    if feet == 2:
        (u, v), (y, z) = units, ys
        k[-1, 0] = k[0, -1] = (u - v) @ x.first
        k[-1, 1] = k[1, -1] = -u @ y.first
        k[-1, 2] = k[2, -1] = v @ z.first
        c[-1] = u @ (x.tangent - y.tangent) - v @ (x.tangent - z.tangent)
    # At an end the multipliers are constants.
    free = np.array([not held_t, *(not h for h in held), *([True] * (feet * (dim - 1))), *([not held_t] * (feet - 1))])
    k, c = k[np.ix_(free, free)], c[free]
    hessian = m - c.T @ np.linalg.lstsq(k, c, rcond=_SINGULAR)[0]
    return g, 0.5 * (hessian + hessian.T)
