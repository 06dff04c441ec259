"""The nearest pair of points of two parametric shapes: made sharp, and as a function of both."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array

from jhd._results.solution import MinimumSolution
from jhd._runtime.arrays import is_traced
from jhd.arithmetic.rounding import unit_roundoff
from jhd.arithmetic.scaling import length
from jhd.distance.cells.pairs import BestPair, derivatives, newton_step
from jhd.distance.frame.coordinates import Frame
from jhd.distance.frame.following import MovingNumbers, TouchedRows, following
from jhd.distance.frame.net_jets import Net, NetJet, jet
from jhd.distance.nearest.feet import presses

_POLISH = 16
# Of points in common coordinates, in units of roundoff, what their distance is known to.
_NOISE = 256
_NEWTON = optx.Newton(rtol=1e-14, atol=1e-14)


def polished(a: Net, b: Net, best: BestPair) -> BestPair:
    """The nearest pair moved to where the distance is stationary, parameters at a border held; else as it was."""
    n = a.parameters
    pieces = a.piece(best.piece_a), b.piece(best.piece_b)
    held = _held(*pieces, best.x)

    def residual(x: Array, args: Any) -> Array:
        (a, b), start, held = args
        return jnp.where(held, x - start, derivatives(*_jets(a, b, x))[1])

    found = optx.root_find(residual, _NEWTON, best.x, (pieces, best.x, held), max_steps=_POLISH, throw=False).value
    x = jnp.clip(jnp.where(jnp.isfinite(found), found, best.x), 0.0, 1.0)
    distances = jnp.stack([length(jet(pieces[0], x[:n]).point - jet(pieces[1], x[n:]).point) for x in (x, best.x)])
    x = jnp.where(distances[0] <= distances[1], x, best.x)
    return best._replace(x=x, distance=jnp.min(distances))


def _jets(a: Net, b: Net, x: Array) -> tuple[NetJet, NetJet]:
    return jet(a, x[: a.parameters]), jet(b, x[a.parameters :])


def _held(a: Net, b: Net, x: Array) -> Array:
    """Which parameters are kept at the border of their piece by the slope of the distance."""
    p, q = _jets(a, b, x)
    e, slope = derivatives(p, q)[:2]
    return presses(x, slope, length(e) * jnp.sum(jnp.abs(jnp.concatenate([p.first, q.first])), axis=-1))


def apart(solution: MinimumSolution, distance: Array) -> Array:
    """Whether the shapes are proven to be apart, or their nearest points are by more than rounding moves these.

    Elsewhere the direction from one to the other is noise, and derivatives are zero as where shapes meet.

    Args:
        solution: the distance with its bounds.
        distance: the same in common coordinates, where both shapes have about the size one.
    """
    told = (solution.lower > 0) | (distance > _NOISE * unit_roundoff(distance.dtype))
    return told & (solution.value > 0) & jnp.isfinite(solution.value)


def with_net_derivatives(solution: MinimumSolution, a: Net, b: Net, frame: Frame, best: BestPair) -> MinimumSolution:
    """The solution with its derivatives in both shapes, in the user's coordinates.

    At fixed parameters the derivative of the distance is that of the minimum (the envelope theorem); two steps of
    Newton's method on the parameters that are not held carry the second derivatives, and those of the points. At
    distance zero the derivatives are zero by convention.
    """
    if not is_traced(a, b):
        return solution
    numbers = {"value": solution.value, "point_a": solution.point_a, "point_b": solution.point_b}
    parts = _piece(a, best.piece_a), _piece(b, best.piece_b)
    return replace(solution, **following(_moving, numbers, parts, (solution, frame, best.x)))


def _piece(net: Net, k: Array) -> Net:
    rows: tuple[Any, Any] = TouchedRows(net.points, k), None if net.weights is None else TouchedRows(net.weights, k)
    return Net(*rows)


def _moving(pieces: tuple[Net, Net], constants: tuple[MinimumSolution, Frame, Array]) -> MovingNumbers:
    """Distance and nearest points as functions of both pieces."""
    solution, frame, at = constants
    n = pieces[0].parameters
    a, b = (Net(frame.moved(piece.points), piece.weights) for piece in pieces)
    pieces = a, b
    x, held = jax.lax.stop_gradient((at, _held(*pieces, at)))
    for _ in range(2):
        _, slope, bent = derivatives(*_jets(*pieces, x))
        step = newton_step(slope, bent, held)
        x = x + jnp.where(jnp.all(jnp.isfinite(step)), step, 0.0)
    p, q = jet(pieces[0], x[:n]).point, jet(pieces[1], x[n:]).point
    scale = frame.scale(p.dtype)
    moving = {"value": length(p - q) / scale, "point_a": p / scale, "point_b": q / scale}
    return MovingNumbers(moving, apart(solution, solution.value * scale))
