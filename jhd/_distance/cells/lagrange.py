"""Bounds of the distance over pairs of cells, if one or both of the shapes are implicit surfaces.

A cell of an implicit surface is a part of its box. With F = |p - q|^2 / 2 and the polynomials f_k that vanish on the
surfaces, every L = F - sum l_k f_k + sum r_k f_k^2 / 2 has the values of F on the surfaces, for any numbers l_k and
r_k >= 0. So over a cell

    F >= L(z) + sum g_i (x_i - z_i) + (1/2) sum h_ij (x_i - z_i) (x_j - z_j)

with the gradient g of L at any z and the second derivatives h over the cell. The last sum is left out if h is proven
positive semidefinite, else bounded term by term or by the least eigenvalue of h. Without the terms in r_k the second
derivatives of quadrics are constant, so an eigenvalue that is zero along equally near points costs nothing. At a point
z that solves the Lagrange system within the cell, with the sides of the cell as constraints, this is a bound of second
order, exact if L is convex. The terms in r_k make L convex across the surfaces if the minimum is strict along them. The
same holds for n.(p - q) - sum l_k f_k with a fixed unit vector n. A cell is excluded if a polynomial has no zero in it,
or if p - q is proven not to be parallel to the gradient of f in a cell away from the faces of its box.

A distance is proven by points near the computed ones: f changes its sign, rounding included, along a short segment.

Rounding: polynomials as in `jhd._distance.cells.implicit`, all else in balls; coordinates are at most one.

Source: Hansen & Walster, Global Optimization Using Interval Analysis (2004), chapter 12 to 14; Bertsekas, Constrained
Optimization and Lagrange Multiplier Methods (1982), for the quadratic terms.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.balls import Ball, dot, least_eigenvalue, minus, plus, semidefinite, times
from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.scaling import length
from jhd._distance.cells.implicit import (
    At,
    Local,
    between,
    error_of,
    polynomial_at,
    shape_at,
    shape_over,
)
from jhd._distance.cells.pairs import Cell, PairBound, bends, derivatives, expand, joined, newton_step
from jhd._distance.nearest.surface_points import proven_radius, returned
from jhd._distance.normalization.isolated import cleared
from jhd._distance.normalization.net_jets import Net, part_of, skew
from jhd._distance.normalization.surfaces import Side

# Steps of Newton's method on the Lagrange system of a cell.
_STEPS = 8
# The weight of the quadratic terms: in the steps, where they keep the iterates near the surfaces, and in the bounds.
_STIFF, _CONVEX = 1e5, 30.0
_THINNEST = 16
# A step leads to a surface if it leaves at most this fraction of its polynomial's change in the cell.
_MET = 1e-3
# Steps of Newton's method back onto a surface.
_BACK = 3


class WithSurface(NamedTuple):
    """A pair of shapes in common coordinates, of which one at least is an implicit surface."""

    a: Net | Side
    b: Net | Side
    # Allowance for rounding, in errors of points; large if points are proven by signs of enclosures.
    room: Array | float = 64.0

    def bound(self, cell: Cell) -> PairBound:
        """Return the bounds over one pair of cells."""
        return _bound(self.a, self.b, cell)

    @property
    def floor(self) -> Array:
        """Gap that rounding leaves."""
        return self.room * (error_of(self.a) + error_of(self.b))


class _Lagrange(NamedTuple):
    """At a point: difference, gradient of F, its second derivatives, and the polynomials' values and derivatives."""

    e: Array
    gradient: Array
    hessian: Array
    values: Array
    slopes: Array
    bents: Array


def _lagrange(a: At, b: At) -> _Lagrange:
    n, m = a.first.shape[0], b.first.shape[0]
    e, gradient, hessian = derivatives(a, b)
    values, slopes, bents = [], [], []
    for side, place in ((a, slice(0, n)), (b, slice(n, n + m))):
        if side.value is not None:
            values.append(side.value)
            slopes.append(jnp.zeros(n + m, e.dtype).at[place].set(side.slope))
            bents.append(jnp.zeros((n + m, n + m), e.dtype).at[place, place].set(side.bent))
    return _Lagrange(e, gradient, hessian, jnp.stack(values), jnp.stack(slopes), jnp.stack(bents))


def _multipliers(now: _Lagrange, free: Array) -> Array:
    """Least-squares multipliers; the polynomials have no common variables."""
    slopes = jnp.where(free, now.slopes, 0.0)
    square = jnp.sum(slopes**2, axis=-1)
    return jnp.sum(slopes * now.gradient, axis=-1) / jnp.where(square > 0, square, jnp.inf)


def _ratio(x: Array, y: Array) -> Array:
    return x / jnp.where(y > 0, y, jnp.inf)


class _LagrangePlace(NamedTuple):
    """A point in a cell, in [0, 1]^n, with multipliers; and the parts of both shapes that the cell names."""

    z: Array
    multipliers: Array
    parts: tuple[Any, Any]


def _there(a: Net | Side, b: Net | Side, parts: tuple[Any, Any], cell: Cell, z: Array) -> tuple[At, At]:
    n, width = a.parameters, cell.high - cell.low
    return (
        shape_at(a, parts[0], cell.low[:n], width[:n], z[:n]),
        shape_at(b, parts[1], cell.low[n:], width[n:], z[n:]),
    )


def stationary(a: Net | Side, b: Net | Side, cell: Cell, start: Array, steps: int = _STEPS) -> _LagrangePlace:
    """Solve the Lagrange system approximately in a cell, its sides as constraints; nothing is proven."""
    n = a.parameters
    parts = _part(a, cell.piece_a, cell.low[:n], cell.high[:n]), _part(b, cell.piece_b, cell.low[n:], cell.high[n:])

    def step(_: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
        x, multipliers = state
        now = _lagrange(*_there(a, b, parts, cell, x))
        square = jnp.sum(now.slopes**2, axis=-1)
        stiff = _STIFF * _ratio(jnp.max(jnp.abs(jnp.diagonal(now.hessian))), square)
        pull = multipliers - stiff * now.values
        gradient = now.gradient - pull @ now.slopes
        bent = now.hessian - jnp.tensordot(multipliers, now.bents, 1)
        bent = bent + jnp.sum(stiff[:, None, None] * now.slopes[:, :, None] * now.slopes[:, None], axis=0)
        held = ((x <= 0) & (gradient > 0)) | ((x >= 1) & (gradient < 0))
        move = jnp.clip(x + newton_step(gradient, bent, held), 0.0, 1.0) - x
        left = now.values + now.slopes @ move
        met = jnp.abs(left) <= _MET * jnp.sum(jnp.abs(now.slopes), axis=-1)
        # If the sides of the cell hold the point off the surface, the remaining value of the polynomial tells nothing.
        return x + move, jnp.where(met, multipliers - stiff * left, _multipliers(now, x >= 0))

    first = _lagrange(*_there(a, b, parts, cell, start))
    z, multipliers = jax.lax.fori_loop(0, steps, step, (start, _multipliers(first, start > 0)))
    return _LagrangePlace(
        jnp.where(jnp.isfinite(z), z, 0.5), jnp.where(jnp.isfinite(multipliers), multipliers, 0.0), parts
    )


def _bound(a: Net | Side, b: Net | Side, cell: Cell) -> PairBound:
    """Return the bounds over one pair of cells: lower ones of the module, an upper one by proven points."""
    n, dtype, width = a.parameters, cell.low.dtype, cell.high - cell.low
    place = stationary(a, b, cell, jnp.full(cell.low.shape, 0.5, dtype))
    local = (
        shape_over(a, place.parts[0], cell.low[:n], cell.high[:n]),
        shape_over(b, place.parts[1], cell.low[n:], cell.high[n:]),
    )
    apart, over = minus(local[0].point, local[1].point), _stacked(local, n)
    lower = jnp.maximum(_of_boxes(apart), _of_second_order(a, b, cell, place, over, apart))
    lower = jnp.where(_excluded(a, b, cell, local, over, apart), jnp.inf, lower)
    upper, x, distance = _proven(a, b, cell, place)
    extent = jnp.max(jnp.abs(over.first.mid) + over.first.rad, axis=-1)
    room = jnp.maximum(jnp.abs(cell.low), jnp.abs(cell.high)) * jnp.finfo(dtype).eps * _THINNEST
    extent = jnp.where(width > jnp.maximum(room, 64 * smallest_normal(dtype)), extent, -1.0)
    return PairBound(lower, upper, distance, x, cell, extent, jnp.max(extent) < 0)


def _of_boxes(apart: Ball) -> Array:
    """Lower bound: the gap between the boxes of both parts."""
    gaps = jnp.maximum(jnp.maximum(apart.lower, -apart.upper), 0.0)
    return length(gaps) * (1 - gamma(12, gaps.dtype))


def _of_second_order(
    a: Net | Side, b: Net | Side, cell: Cell, place: _LagrangePlace, over: "_Stacked", apart: Ball
) -> Array:
    """Return the larger of the bounds by F and by the unit vector that joins the points; see the module."""
    z, n, dtype = place.z, a.parameters, cell.low.dtype
    there = _there(a, b, place.parts, cell, z)
    now = _lagrange(*there)
    distance = length(now.e)
    per = 1.0 / jnp.where(distance > 0, distance, jnp.inf)
    unit = now.e / jnp.where(distance > 0, distance, 1.0)
    tight = _pointwise(a, b, there, cell.low + z * (cell.high - cell.low), n, place.parts)
    scale = _CONVEX * _ratio(jnp.max(jnp.abs(jnp.diagonal(now.hessian))), jnp.sum(now.slopes**2, axis=-1))
    by_f = _second_order(tight, over, apart, tight.e, place.multipliers, scale, z, True)
    # Of quadrics this has constant second derivatives.
    by_f = jnp.fmax(by_f, _second_order(tight, over, apart, tight.e, place.multipliers, 0 * scale, z, True))
    by_f = jnp.sqrt(jnp.maximum(2 * by_f, 0.0)) * (1 - gamma(12, dtype))
    along = Ball(unit, jnp.zeros_like(unit))
    by_psi = _second_order(tight, over, along, along, place.multipliers * per, scale * per, z, False)
    by_psi = jnp.where(distance > 0, by_psi, 0.0) * (1 - gamma(16, dtype))
    return jnp.maximum(*(jnp.where(jnp.isnan(x), 0.0, x) for x in (by_f, by_psi)))


def _excluded(a: Any, b: Any, cell: Cell, local: tuple[Local, Local], over: "_Stacked", apart: Ball) -> Array:
    """Return whether the cell is proven to hold no nearest pair."""
    n, low, high = a.parameters, cell.low, cell.high
    out = jnp.zeros((), bool)
    naive = dot(over.first, Ball(apart.mid[None], apart.rad[None]))
    for shape, side, span in ((a, local[0], slice(0, n)), (b, local[1], slice(n, None))):
        if side.value is not None:
            ends = low[span], high[span]
            out |= (side.value.lower > 0) | (side.value.upper < 0) | _not_parallel(shape, side, apart, *ends)
            out |= cleared(shape.isolated, *(x[:, None] for x in ends))[0]
        else:
            rising, falling = naive.lower[span] > 0, naive.upper[span] < 0
            out |= jnp.any((rising & (low[span] > 0)) | (falling & (high[span] < 1)))
    return out


def _part(shape: Net | Side, k: Array, low: Array, high: Array) -> Any:
    return None if isinstance(shape, Side) else part_of(shape.piece(k), low, high)


class _Tight(NamedTuple):
    """Balls at one point, in all parameters: difference, first derivatives, polynomials and their slopes.

    `shift` bounds the distance of the parameters from the ones at which the point was computed.
    """

    e: Ball
    first: Ball
    values: Ball
    slopes: Ball
    shift: Array


def _pointwise(a: Any, b: Any, at: tuple[At, At], place: Array, n: int, parts: tuple[Any, Any]) -> _Tight:
    """Balls at the point `place`; polynomials are enclosed there."""
    points, firsts, values, slopes, shifts = [], [], [], [], []
    total = place.shape[0]
    for shape, here, span, part in zip((a, b), at, (slice(0, n), slice(n, None)), parts, strict=True):
        wrong = error_of(shape)
        if part is None:
            # The point is a float by definition, at a parameter that differs by its rounding.
            value, gradient = polynomial_at(shape, place[span])
            values.append(value)
            width = jnp.diagonal(here.first)
            slope = times(gradient, Ball(width, gamma(4, width.dtype) * width))
            slopes.append(_placed(slope, span, total))
            points.append(Ball(place[span], jnp.zeros_like(width)))
            shifts.append(_ratio(gamma(8, width.dtype) * (jnp.abs(place[span]) + width), width))
            firsts.append(Ball(here.first, gamma(4, width.dtype) * here.first))
        else:
            loose = 16.0 * max(1, *shape.degrees) * wrong * skew(part)
            points.append(Ball(here.point, jnp.full_like(here.point, wrong)))
            shifts.append(jnp.zeros_like(place[span]))
            firsts.append(Ball(here.first, jnp.full_like(here.first, loose)))
    first = joined(*firsts)
    stack = lambda balls: jax.tree_util.tree_map(lambda *x: jnp.stack(x), *balls)  # noqa: E731
    return _Tight(minus(*points), first, stack(values), stack(slopes), jnp.concatenate(shifts))


def _placed(ball: Ball, span: slice, total: int) -> Ball:
    return Ball(*(jnp.zeros(total, x.dtype).at[span].set(x) for x in ball))


class _Stacked(NamedTuple):
    """Balls over a cell in all parameters: first derivatives of p - q, second ones of each, polynomials."""

    first: Ball
    second_a: Ball
    second_b: Ball
    values: Ball
    slopes: Ball
    bents: Ball


def _stacked(local: tuple[Local, Local], n: int) -> _Stacked:
    """Gather the derivatives and polynomials of both shapes over a cell in all parameters."""
    a, b = local
    total = n + b.first.mid.shape[0]
    first = joined(a.first, b.first)
    values, slopes, bents = [], [], []
    for side, span in ((a, slice(0, n)), (b, slice(n, None))):
        if side.value is None or side.slope is None or side.bent is None:
            continue
        width = Ball(jnp.diagonal(side.first.mid), jnp.diagonal(side.first.rad))
        column, row = (Ball(*(jnp.expand_dims(x, i) for x in width)) for i in (1, 0))
        values.append(side.value)
        slopes.append(_placed(times(side.slope, width), span, total))
        bent = times(times(side.bent, column), row)
        bents.append(Ball(*(jnp.zeros((total, total), x.dtype).at[span, span].set(x) for x in bent)))
    stack = lambda balls: jax.tree_util.tree_map(lambda *x: jnp.stack(x), *balls)  # noqa: E731
    return _Stacked(first, a.second, b.second, stack(values), stack(slopes), stack(bents))


def _second_order(
    at: _Tight, over: _Stacked, vector: Ball, here: Ball, multipliers: Array, stiff: Array, z: Array, squared: bool
) -> Array:
    """Lower bound over the cell of F, or of a linear function of the points, on the surfaces."""
    exact = Ball(multipliers, jnp.zeros_like(multipliers))
    heavy = Ball(stiff, jnp.zeros_like(stiff))
    dtype = z.dtype
    base = dot(at.e, here)
    base = Ball(0.5 * base.mid, 0.5 * base.rad) if squared else base
    value = minus(base, dot(exact, at.values))
    # The quadratic terms are not negative: left out at z.
    pull = minus(exact, times(heavy, at.values))
    slope = dot(at.first, Ball(here.mid[None], here.rad[None]))
    slope = minus(slope, dot(Ball(at.slopes.mid.T, at.slopes.rad.T), Ball(pull.mid[None], pull.rad[None])))
    h = bends(over.second_a, over.second_b, vector)
    if squared:
        h = plus(h, dot(expand(over.first, 1), expand(over.first, 0)))
    # Of sum (r f - l) f'' + r f' f'^T one term for each surface.
    factor = minus(times(heavy, over.values), exact)
    for k in range(multipliers.shape[0]):
        pick = lambda ball, k=k: jax.tree_util.tree_map(lambda x: x[k], ball)  # noqa: E731
        h = plus(h, times(pick(over.bents), pick(factor)))
        h = plus(h, times(_outer_square(pick(over.slopes)), pick(heavy)))
    convex = semidefinite(h, jnp.zeros(z.shape, bool))
    reach = jnp.maximum(z, 1 - z) + at.shift
    off_diagonal = jnp.where(jnp.eye(z.size, dtype=bool), jnp.maximum(-h.lower, 0.0), h.size)
    curved = 0.5 * jnp.sum(off_diagonal * reach[:, None] * reach) * (1 + gamma(z.size**2 + 24, dtype))
    flat = jnp.maximum(-least_eigenvalue(h), 0.0) * 0.5 * jnp.sum(reach**2) * (1 + gamma(z.size + 24, dtype))
    curved = jnp.minimum(curved, flat)
    up = jnp.maximum(slope.upper, 0.0) * (z + at.shift)
    down = jnp.maximum(-slope.lower, 0.0) * (1 - z + at.shift)
    taken = jnp.sum(jnp.maximum(up, down)) * (1 + gamma(16, dtype)) + jnp.where(convex, 0.0, curved)
    found = value.lower - taken
    return found - gamma(6, dtype) * (jnp.abs(value.lower) + taken) - 64 * smallest_normal(dtype)


def _outer_square(x: Ball) -> Ball:
    """The products of the entries of a vector, of which the squares are not negative."""
    far, near = jnp.abs(x.mid) + x.rad, jnp.maximum(jnp.abs(x.mid) - x.rad, 0.0)
    room = gamma(8, far.dtype)
    own = between(near**2 * (1 - room), far**2 * (1 + room))
    every, diagonal = times(expand(x, 1), expand(x, 0)), jnp.eye(far.size, dtype=bool)
    return Ball(*(jnp.where(diagonal, y, z) for y, z in zip(own, every, strict=True)))


def _not_parallel(shape: Side, side: Local, apart: Ball, low: Array, high: Array) -> Array:
    """Return whether p - q and the gradient are proven not parallel, in coordinates that no face of the box holds."""
    if side.slope is None:
        return jnp.zeros((), bool)
    inside = (low > jnp.asarray(shape.lower)) & (high < jnp.asarray(shape.upper))
    i, j = np.array([1, 2, 0]), np.array([2, 0, 1])
    take = lambda ball, k: Ball(ball.mid[k], ball.rad[k])  # noqa: E731
    cross = minus(times(take(apart, i), take(side.slope, j)), times(take(apart, j), take(side.slope, i)))
    return jnp.any(((cross.lower > 0) | (cross.upper < 0)) & inside[i] & inside[j])


def _proven(a: Any, b: Any, cell: Cell, place: _LagrangePlace) -> tuple[Array, Array, Array]:
    """Upper bound of the distance by points proven near `place`, their parameters (or coordinates) and distance."""
    n, places = a.parameters, cell.low + place.z * (cell.high - cell.low)
    points, radii, moved = [], [], []
    for shape, span, part in ((a, slice(0, n), place.parts[0]), (b, slice(n, None), place.parts[1])):
        if part is None:
            near = jnp.clip(places[span], jnp.asarray(shape.lower), jnp.asarray(shape.upper))
            found = returned(shape, near[:, None], _BACK)
            radius, own = proven_radius(shape, found)[0], found[:, 0]
        else:
            radius, own = error_of(shape), places[span]
        moved.append(own)
        radii.append(radius)
        points.append(own if part is None else part.point(place.z[span]))
    distance = length(points[0] - points[1])
    return joined_upper(distance, jnp.stack(radii)), jnp.concatenate(moved), distance


def joined_upper(distance: Array, radii: Array) -> Array:
    """Upper bound by two points that are proven within these radii."""
    return distance * (1 + gamma(16, distance.dtype)) + jnp.sum(radii) * (1 + gamma(4, distance.dtype))
