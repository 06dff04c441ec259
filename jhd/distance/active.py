"""The active system: the equations that hold at a witness, and the distance there, as functions of both curves.

At a witness the parameter t on a and the feet s1, s2 on b solve three equations G = 0. A foot is free, (A - B).B' = 0,
or held at an end or corner of b. The parameter is held at an end or corner of a, or set by equal distances of two feet,
or by (A - B).A' = 0. In the plane the last one is B' x A' = 0 at a free foot: the direction of A - B is lost to
rounding where the curves nearly coincide, the normal of b is not. The distance is taken along that normal for the same
reason.

The derivative of the value is that of the distance at the solution of G = 0: with one foot the partial derivative at
fixed parameters, with two feet lambda_1 d1 + lambda_2 d2 with the multipliers of the witness. Two Newton steps from
the solution, differentiated, carry the first two derivatives of the parameters, and all of the system's sizes fit
Cramer's rule. Where its determinant vanishes (concentric arcs, where the maximum is not isolated) nothing moves.

Source: the events are those of Elber & Grandine, GMP 2008; implicit differentiation is Danskin's theorem for one foot.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd.distance.events import Piece
from jhd.distance.jets import jet
from jhd.solution import EVENTS

# A determinant below this share of the product of the lengths of its rows is none.
_SINGULAR = 1e-10
# A foot at an end of its segment is free when its residual is below this share of |A - B| |B'|.
_STATIONARY = 1e-7
# Newton steps of a polish; the peaks of the search are off by the root of its tolerance.
_POLISH = 4


class Active(NamedTuple):
    """The pieces that carry a witness and its feet, which of the three parameters are held, whether both feet count."""

    a: Piece
    first: Piece
    second: Piece
    held: Array  # (3,)
    two: Array


def active(a: Piece, first: Piece, second: Piece, y: Array, event: Any) -> Active:
    """The system that belongs to an event at the parameters y = (t, s1, s2)."""
    at = jet(*a, y[0]).point
    two = event == EVENTS.one_to_two
    ends = (event == EVENTS.a_end) | (event == EVENTS.corner) | _single(a)
    held = jnp.stack([ends, _held(at, first, y[1]), _held(at, second, y[2]) | ~two])
    return Active(a, first, second, held, two)


def _single(piece: Piece) -> Array:
    return jnp.all(piece.control_points == piece.control_points[0])


def _held(point: Array, piece: Piece, s: Array) -> Array:
    foot = jet(*piece, s)
    c = foot.point - point
    moving = jnp.abs(c @ foot.first) > _STATIONARY * jnp.sqrt((c @ c) * (foot.first @ foot.first))
    return (((s <= 0) | (s >= 1)) & moving) | _single(piece)


def _cross(x: Array, y: Array) -> Array:
    return x[0] * y[1] - x[1] * y[0]


def _residual(y: Array, start: Array, system: Active) -> Array:
    a, b, d = (jet(*piece, y[i]) for i, piece in enumerate((system.a, system.first, system.second)))
    c, e = a.point - b.point, a.point - d.point
    stationary = c @ a.first
    if a.point.shape[0] == 2:
        stationary = jnp.where(system.held[1], stationary, _cross(b.first, a.first))
    # (c + e).(c - e) with c - e = d - b: the difference of the squares without cancellation.
    along = jnp.where(system.two, (c + e) @ (d.point - b.point), stationary)
    return jnp.where(system.held, y - start, jnp.stack([along, c @ b.first, e @ d.first]))


def newton(y: Array, system: Active) -> Array:
    """One Newton step from y; y itself where the determinant vanishes."""

    def residual(x: Array) -> Array:
        return _residual(x, y, system)

    value, rows = residual(y), jax.jacfwd(residual)(y)
    determinant = _determinant(rows)
    size = jnp.prod(jnp.sqrt(jnp.sum(jax.lax.stop_gradient(rows) ** 2, axis=1)))
    regular = jnp.abs(determinant) > _SINGULAR * size
    columns = [_determinant(rows.at[:, i].set(value)) for i in range(3)]
    return y - jnp.where(regular, jnp.stack(columns) / jnp.where(regular, determinant, 1.0), 0.0)


def _determinant(m: Array) -> Array:
    return m[0] @ jnp.stack([_cross(m[1, 1:], m[2, 1:]), _cross(m[2, ::2], m[1, ::2]), _cross(m[1, :2], m[2, :2])])


def distance(y: Array, system: Active) -> Array:
    """Distance from the witness to its first foot; along the normal of b where that is known."""
    a, b = jet(*system.a, y[0]), jet(*system.first, y[1])
    c = a.point - b.point
    square = c @ c
    length = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    if c.shape[0] == 3:
        return length
    speed_sq = b.first @ b.first
    known = ~system.held[1] & (speed_sq > 0)
    height = _cross(b.first, c) / jnp.sqrt(jnp.where(known, speed_sq, 1.0))
    return jnp.where(known, jnp.where(height < 0, -height, height), length)


def polished(y: Array, system: Active) -> Array:
    """Parameters after a few Newton steps, kept in [0, 1]."""
    return jax.lax.fori_loop(0, _POLISH, lambda _, x: jnp.clip(newton(x, system), 0.0, 1.0), y)


def multipliers(y: Array, system: Active) -> Array:
    """Weights of both feet with lambda_1 g1 + lambda_2 g2 = 0 for the slopes g_i of the distances along a."""
    a = jet(*system.a, y[0])
    slopes = []
    for piece, s in ((system.first, y[1]), (system.second, y[2])):
        c = a.point - jet(*piece, s).point
        square = c @ c
        slopes.append(c @ a.first / jnp.sqrt(jnp.where(square > 0, square, 1.0)))
    spread = jnp.where(system.two, slopes[0] - slopes[1], 1.0)
    opposite = system.two & (spread != 0)
    share = jnp.clip(-slopes[1] / jnp.where(opposite, spread, 1.0), 0.0, 1.0)
    return jnp.where(opposite, jnp.stack([share, 1 - share]), jnp.array([1.0, 0.0]))
