"""The nearest pair of points of two parametric shapes: made sharp, and as a function of both."""

from typing import Any

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array

from jhd.arithmetic.scaling import length
from jhd.arrays import is_traced
from jhd.compiled import compiled
from jhd.distance.cells.pairs import BestPair, derivatives, newton_step
from jhd.distance.frame.attach import attached
from jhd.distance.frame.coordinates import Frame
from jhd.distance.frame.net_jets import Net, NetJet, jet
from jhd.distance.nearest.feet import presses
from jhd.solution import MinimumSolution

_POLISH = 16
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
    slope = derivatives(p, q)[1]
    return presses(x, slope, jnp.sum(jnp.abs(jnp.concatenate([p.first, q.first])), axis=-1))


def with_net_derivatives(solution: MinimumSolution, a: Net, b: Net, frame: Frame, best: BestPair) -> MinimumSolution:
    """The solution with its derivatives in both shapes, in the user's coordinates.

    At fixed parameters the derivative of the distance is that of the minimum (the envelope theorem); two steps of
    Newton's method on the parameters that are not held carry the second derivatives, and those of the points. At
    distance zero the derivatives are zero by convention.
    """
    if not is_traced(a, b):
        return solution
    distance, point_a, point_b = _moving(a, b, frame, jax.lax.stop_gradient(best))
    return attached(solution, solution.value > 0, value=distance, point_a=point_a, point_b=point_b)


@compiled
def _moving(a: Net, b: Net, frame: Frame, best: BestPair) -> tuple[Array, Array, Array]:
    """Distance and nearest points as functions of both shapes."""
    n = a.parameters

    def piece(net: Net, k: Array) -> Net:
        return Net(frame.moved(net.points[k]), None if net.weights is None else net.weights[k])

    pieces = piece(a, best.piece_a), piece(b, best.piece_b)
    x, held = jax.lax.stop_gradient((best.x, _held(*pieces, best.x)))
    for _ in range(2):
        _, slope, bent = derivatives(*_jets(*pieces, x))
        step = newton_step(slope, bent, held)
        x = x + jnp.where(jnp.all(jnp.isfinite(step)), step, 0.0)
    p, q = jet(pieces[0], x[:n]).point, jet(pieces[1], x[n:]).point
    scale = frame.scale(p.dtype)
    return length(p - q) / scale, p / scale, q / scale
