"""The nearest pair of points of two parametric shapes: refined to full precision, and as a function of both shapes."""

from typing import Any

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array

from jhd._arithmetic.scaling import length
from jhd._distance.cells.pairs import BestPair, derivatives, newton_step
from jhd._distance.nearest.feet import presses
from jhd._distance.normalization.implicit_derivatives import MovingNumbers
from jhd._distance.normalization.net_jets import Net, NetJet, jet
from jhd._distance.witness.balance import apart, finite, in_one_unit
from jhd._distance.witness.rows import NetRows
from jhd._results.solution import MinimumSolution

_POLISH = 16
_NEWTON = optx.Newton(rtol=1e-14, atol=1e-14)


def polished(a: Net, b: Net, best: BestPair) -> BestPair:
    """Return the nearest pair moved to a stationary distance, with parameters at a border held; else unchanged."""
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
    """Return a mask of the parameters that the slope of the distance keeps at the border of their piece."""
    p, q = _jets(a, b, x)
    e, slope = derivatives(p, q)[:2]
    return presses(x, slope, length(e) * jnp.sum(jnp.abs(jnp.concatenate([p.first, q.first])), axis=-1))


def from_nets(rows: tuple[NetRows, NetRows], constants: tuple[MinimumSolution, Array, Array]) -> MovingNumbers:
    """Return distance and nearest points of two nets as functions of both pieces; see `balance.from_pair`.

    Only parameters are unknown, so two steps of Newton's method carry the second derivatives, also of the points.
    """
    rows, (solution, x, distance) = finite((rows, constants))
    scale, rows = in_one_unit(rows, solution.value)
    a, b = (part.net for part in rows)
    held = jax.lax.stop_gradient(_held(a, b, x))
    for _ in range(2):
        _, slope, bent = derivatives(*_jets(a, b, x))
        step = newton_step(slope, bent, held)
        x = x + jnp.where(jnp.all(jnp.isfinite(step)), step, 0.0)
    p, q = (at.point for at in _jets(a, b, x))
    numbers = {"value": length(p - q) / scale, "point_a": p / scale, "point_b": q / scale}
    return MovingNumbers(numbers, apart(solution, distance))
