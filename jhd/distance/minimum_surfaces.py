"""Bounds of the distance over pairs of cells where one or both of the shapes are implicit surfaces.

A cell of an implicit surface is a part of its box. With F = |p - q|^2 / 2 and the polynomials f_k that vanish on the
surfaces, every L = F - sum l_k f_k + sum r_k f_k^2 / 2 has the values of F where the distance is taken, whatever the
numbers l_k and r_k >= 0 are. So over a cell

    F >= L(z) + sum g_i (x_i - z_i) + (1/2) sum h_ij (x_i - z_i) (x_j - z_j)

with the gradient g of L at any z and the second derivatives h over the cell: the last sum is left out where h is proven
positive semidefinite, else bounded term by term. At a point z that solves the Lagrange system within the cell, with the
sides of the cell as constraints, this is a bound of second order, exact where L is convex; the terms in r_k make it
convex across the surfaces where the minimum is strict along them. The same holds of n.(p - q) - sum l_k f_k with a
fixed unit vector n. Cells are excluded where a polynomial has no zero, and where p - q is proven not to be parallel to
the gradient of f in a cell that is away from the faces of its box.

A distance is proven by points near the computed ones: f changes its sign, rounding included, along a short segment.

Rounding: polynomials by `jhd.arithmetic.trivariate`, all else in balls; coordinates are the user's.

Source: Hansen & Walster, Global Optimization Using Interval Analysis (2004), chapter 12 to 14; Bertsekas, Constrained
Optimization and Lagrange Multiplier Methods (1982), for the quadratic terms.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd.arithmetic import trivariate
from jhd.arithmetic.rounding import gamma, smallest_normal
from jhd.distance.minimum_balls import Ball, dot, minus, plus, semidefinite, times
from jhd.distance.minimum_cells import (
    Cell,
    CellBound,
    Net,
    enclosed,
    eta,
    jet,
    length,
    newton_step,
    part_of,
    point_error,
    skew,
)

# Steps of Newton's method on the Lagrange system of a cell, and back onto the surfaces.
_STEPS, _BACK = 6, 3
# The share of the quadratic terms: in the steps, where it makes them keep to the surfaces, and in the bounds.
_STIFF, _CONVEX = 1e5, 30.0
_THINNEST = 16
# A direction within the faces serves unless the gradient is this much longer.
_TANGENT = 0.1
# Second derivatives xx, yy, zz, xy, xz, yz as a matrix.
_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


class Implicit(NamedTuple):
    """An implicit surface: its polynomial with the first and second derivatives, (10, i, j, k), and its box."""

    table: Array
    lower: Array
    upper: Array


class WithSurface(NamedTuple):
    """A pair of shapes in the user's coordinates, of which one at least is an implicit surface."""

    a: Net | Implicit
    b: Net | Implicit

    def bound(self, cell: Cell) -> CellBound:
        """Bounds over one pair of cells."""
        return _bound(self.a, self.b, cell)

    @property
    def floor(self) -> Array:
        """The gap that rounding leaves."""
        return 64 * (_error(self.a) + _error(self.b))


def implicit(coefficients: Array, lower: Array, upper: Array) -> Implicit:
    """The surface with the derivatives of its polynomial; each coefficient is rounded once at most."""

    def derived(c: Array, axis: int) -> Array:
        n = c.shape[axis]
        factors = np.arange(n).reshape([-1 if i == axis else 1 for i in range(3)])
        moved = jnp.roll(c * factors, -1, axis=axis)
        return moved

    first = [derived(coefficients, axis) for axis in range(3)]
    second = [derived(first[i], j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return Implicit(jnp.stack([coefficients, *first, *second]), lower, upper)


def parameters(shape: Net | Implicit) -> int:
    """The number of parameters of a cell."""
    return 3 if isinstance(shape, Implicit) else shape.parameters


def size_of(shape: Net | Implicit) -> Array:
    """The largest coordinate."""
    if isinstance(shape, Implicit):
        return jnp.maximum(jnp.max(jnp.abs(shape.lower)), jnp.max(jnp.abs(shape.upper)))
    return jnp.max(jnp.abs(shape.points))


def _error(shape: Net | Implicit) -> Array:
    """Bound on the error of the length of a computed point."""
    size = size_of(shape)
    if isinstance(shape, Implicit):
        return 2 * math.sqrt(3) * gamma(12, size.dtype) * size
    return point_error(shape) * size


class _Local(NamedTuple):
    """One shape over a cell: balls of the point and its derivatives, and of its polynomial in the parameters."""

    point: Ball
    first: Ball
    second: Ball
    value: Ball | None
    slope: Ball | None  # in space
    bent: Ball | None


class _At(NamedTuple):
    """One shape at a point, not enclosed: point and derivatives, polynomial and derivatives in the parameters."""

    point: Array
    first: Array
    second: Array
    value: Array | None
    slope: Array | None
    bent: Array | None


def _values(shape: Implicit, x: Array) -> tuple[Array, Array, Array]:
    """Value, gradient and second derivatives at a point, not enclosed."""
    c = shape.table
    for axis in range(3):
        t, rows = x[axis], jnp.moveaxis(c, 1, 0)
        c = rows[-1]
        for row in rows[-2::-1]:
            c = c * t + row
    return c[0], c[1:4], c[4:][_SYMMETRIC]


def _at(shape: Net | Implicit, part: Any, low: Array, width: Array, x: Array) -> _At:
    if not isinstance(shape, Implicit):
        j = jet(part, x)
        return _At(j.point, j.first, j.second, None, None, None)
    point = low + x * width
    value, gradient, bent = _values(shape, point)
    zero = jnp.zeros((3, 3, 3), width.dtype)
    return _At(point, jnp.diag(width), zero, value, gradient * width, bent * width[:, None] * width)


def _over(shape: Net | Implicit, part: Any, low: Array, high: Array) -> _Local:
    if not isinstance(shape, Implicit):
        size = size_of(shape)
        j = enclosed(part, eta(shape) * size, eta(shape))
        return _Local(j.point, j.first, j.second, None, None, None)
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    # Wider by the roundings of both.
    half = half * (1 + gamma(4, half.dtype)) + gamma(6, half.dtype) * jnp.maximum(jnp.abs(low), jnp.abs(high))
    ranges = jax.vmap(lambda c: trivariate.enclose(c, centre[:, None], half[:, None]))(shape.table)
    balls = _between(ranges.lower[:, 0], ranges.upper[:, 0])
    width, zero = high - low, jnp.zeros((3, 3, 3), low.dtype)
    first = Ball(jnp.diag(width), gamma(4, width.dtype) * jnp.diag(width))
    take = lambda rows: jax.tree_util.tree_map(lambda x: x[rows], balls)  # noqa: E731
    return _Local(Ball(centre, half), first, Ball(zero, zero), take(0), take(np.arange(1, 4)), take(4 + _SYMMETRIC))


def _between(lower: Array, upper: Array) -> Ball:
    mid = 0.5 * lower + 0.5 * upper
    size = jnp.maximum(jnp.abs(lower), jnp.abs(upper))
    return Ball(mid, (0.5 * upper - 0.5 * lower) + gamma(8, mid.dtype) * size + 16 * smallest_normal(mid.dtype))


class _Lagrange(NamedTuple):
    """At a point: difference, gradient of F, its second derivatives, and the polynomials' values and derivatives."""

    e: Array
    gradient: Array
    hessian: Array
    values: Array
    slopes: Array
    bents: Array


def _lagrange(a: _At, b: _At) -> _Lagrange:
    n, m = a.first.shape[0], b.first.shape[0]
    e = a.point - b.point
    first = jnp.concatenate([a.first, -b.first])
    hessian = jnp.sum(first[:, None] * first[None], axis=-1)
    hessian = hessian.at[:n, :n].add(jnp.sum(a.second * e, axis=-1)).at[n:, n:].add(-jnp.sum(b.second * e, axis=-1))
    values, slopes, bents = [], [], []
    for side, place in ((a, slice(0, n)), (b, slice(n, n + m))):
        if side.value is not None:
            values.append(side.value)
            slopes.append(jnp.zeros(n + m, e.dtype).at[place].set(side.slope))
            bents.append(jnp.zeros((n + m, n + m), e.dtype).at[place, place].set(side.bent))
    return _Lagrange(e, jnp.sum(first * e, -1), hessian, jnp.stack(values), jnp.stack(slopes), jnp.stack(bents))


def _multipliers(now: _Lagrange, free: Array) -> Array:
    """Least-squares multipliers; the polynomials have no common variables."""
    slopes = jnp.where(free, now.slopes, 0.0)
    square = jnp.sum(slopes**2, axis=-1)
    return jnp.sum(slopes * now.gradient, axis=-1) / jnp.where(square > 0, square, jnp.inf)


def _ratio(x: Array, y: Array) -> Array:
    return x / jnp.where(y > 0, y, jnp.inf)


def _bound(a: Net | Implicit, b: Net | Implicit, cell: Cell) -> CellBound:
    n, dtype = parameters(a), cell.low.dtype
    low, high = cell.low, cell.high
    parts = [_part(a, cell.piece_a, low[:n], high[:n]), _part(b, cell.piece_b, low[n:], high[n:])]
    width = high - low

    def there(x: Array) -> tuple[_At, _At]:
        return (
            _at(a, parts[0], low[:n], width[:n], x[:n]),
            _at(b, parts[1], low[n:], width[n:], x[n:]),
        )

    def step(_: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
        x, multipliers = state
        now = _lagrange(*there(x))
        square = jnp.sum(now.slopes**2, axis=-1)
        stiff = _STIFF * _ratio(jnp.max(jnp.abs(jnp.diagonal(now.hessian))), square)
        pull = multipliers - stiff * now.values
        gradient = now.gradient - pull @ now.slopes
        bent = now.hessian - jnp.tensordot(multipliers, now.bents, 1)
        bent = bent + jnp.sum(stiff[:, None, None] * now.slopes[:, :, None] * now.slopes[:, None], axis=0)
        held = ((x <= 0) & (gradient > 0)) | ((x >= 1) & (gradient < 0))
        move = jnp.clip(x + newton_step(gradient, bent, held), 0.0, 1.0) - x
        return x + move, multipliers - stiff * (now.values + now.slopes @ move)

    start = jnp.full(low.shape, 0.5, dtype)
    first_now = _lagrange(*there(start))
    z, multipliers = jax.lax.fori_loop(0, _STEPS, step, (start, _multipliers(first_now, start > 0)))
    multipliers = jnp.where(jnp.isfinite(multipliers), multipliers, 0.0)
    z = jnp.where(jnp.isfinite(z), z, 0.5)
    now = _lagrange(*there(z))
    distance, unit = length(now.e), now.e / jnp.where(length(now.e) > 0, length(now.e), 1.0)

    local = _over(a, parts[0], low[:n], high[:n]), _over(b, parts[1], low[n:], high[n:])
    sides = [side for side in local if side.value is not None]
    apart = minus(local[0].point, local[1].point)
    gaps = jnp.maximum(jnp.maximum(apart.lower, -apart.upper), 0.0)
    lower = length(gaps) * (1 - gamma(12, dtype))

    # Balls of L and of n.(p - q) - sum l f at z: values and gradients; and of their second derivatives over the cell.
    tight = _pointwise(a, b, there(z), low + z * width, n, parts)
    over = _stacked(local, n)
    scale = _ratio(jnp.max(jnp.abs(jnp.diagonal(now.hessian))), jnp.sum(now.slopes**2, axis=-1))
    lower_f = _second_order(tight, over, apart, tight.e, multipliers, _CONVEX * scale, z, True)
    per = 1.0 / jnp.where(distance > 0, distance, jnp.inf)
    along = Ball(unit, jnp.zeros_like(unit))
    lower_psi = _second_order(tight, over, along, along, multipliers * per, _CONVEX * scale * per, z, False)
    by_f = jnp.sqrt(jnp.maximum(2 * lower_f, 0.0)) * (1 - gamma(12, dtype))
    lower = jnp.maximum(lower, jnp.where(jnp.isnan(by_f), 0.0, by_f))
    by_psi = jnp.where(distance > 0, lower_psi, 0.0) * (1 - gamma(16, dtype))
    lower = jnp.maximum(lower, jnp.where(jnp.isnan(by_psi), 0.0, by_psi))

    excluded = jnp.zeros((), bool)
    for side in sides:
        value: Any = side.value
        excluded |= (value.lower > 0) | (value.upper < 0)
    naive = dot(over.first, Ball(apart.mid[None], apart.rad[None]))
    for shape, side, place in ((a, local[0], slice(0, n)), (b, local[1], slice(n, None))):
        if isinstance(shape, Implicit):
            excluded |= _not_parallel(shape, side, apart, low[place], high[place])
        else:
            rising, falling = naive.lower[place] > 0, naive.upper[place] < 0
            excluded |= jnp.any((rising & (low[place] > 0)) | (falling & (high[place] < 1)))

    upper, x = _proven(a, b, parts, low, width, z, n)
    extent = jnp.max(jnp.abs(over.first.mid) + over.first.rad, axis=-1)
    room = jnp.maximum(jnp.abs(low), jnp.abs(high)) * jnp.finfo(dtype).eps * _THINNEST
    extent = jnp.where(width > jnp.maximum(room, 64 * smallest_normal(dtype)), extent, -1.0)
    lower = jnp.where(excluded, jnp.inf, lower)
    return CellBound(lower, upper, distance, x, cell, jnp.argmax(extent), jnp.max(extent) < 0)


def _part(shape: Net | Implicit, k: Array, low: Array, high: Array) -> Any:
    return None if isinstance(shape, Implicit) else part_of(shape.piece(k), low, high)


class _Tight(NamedTuple):
    """Balls at one point, in all parameters: difference, first derivatives, polynomials and their slopes.

    `shift` bounds how far the parameters are from those that the point was computed for.
    """

    e: Ball
    first: Ball
    values: Ball
    slopes: Ball
    shift: Array


def _pointwise(a: Any, b: Any, at: tuple[_At, _At], place: Array, n: int, parts: list[Any]) -> _Tight:
    """Balls at the point, for polynomials by their enclosure there."""
    points, firsts, values, slopes, shifts = [], [], [], [], []
    total = place.shape[0]
    for shape, here, span, part in zip((a, b), at, (slice(0, n), slice(n, None)), parts, strict=True):
        wrong = _error(shape)
        if isinstance(shape, Implicit):
            # The point is a float by definition, at a parameter that differs by its rounding.
            found = jax.vmap(lambda c, x=place[span]: trivariate.evaluate(c, x[:, None]))(shape.table[:4])
            balls = _between(found.lower[:, 0], found.upper[:, 0])
            values.append(jax.tree_util.tree_map(lambda x: x[0], balls))
            width = jnp.diagonal(here.first)
            slope = times(jax.tree_util.tree_map(lambda x: x[1:], balls), Ball(width, gamma(4, width.dtype) * width))
            slopes.append(_placed(slope, span, total))
            points.append(Ball(place[span], jnp.zeros_like(width)))
            shifts.append(_ratio(gamma(8, width.dtype) * (jnp.abs(place[span]) + width), width))
            firsts.append(Ball(here.first, gamma(4, width.dtype) * here.first))
        else:
            loose = 16.0 * max(1, *shape.degrees) * wrong * skew(part)
            points.append(Ball(here.point, jnp.full_like(here.point, wrong)))
            shifts.append(jnp.zeros_like(place[span]))
            firsts.append(Ball(here.first, jnp.full_like(here.first, loose)))
    first = Ball(jnp.concatenate([firsts[0].mid, -firsts[1].mid]), jnp.concatenate([f.rad for f in firsts]))
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


def _stacked(local: tuple[_Local, _Local], n: int) -> _Stacked:
    a, b = local
    total = n + b.first.mid.shape[0]
    first = Ball(jnp.concatenate([a.first.mid, -b.first.mid]), jnp.concatenate([a.first.rad, b.first.rad]))
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
    row = Ball(vector.mid[None, None], vector.rad[None, None])
    bent_a, bent_b = dot(over.second_a, row), dot(over.second_b, row)
    h = Ball(_blocks(bent_a.mid, -bent_b.mid), _blocks(bent_a.rad, bent_b.rad))
    if squared:
        h = plus(h, dot(_expand(over.first, 1), _expand(over.first, 0)))
    # Of sum (r f - l) f'' + r f' f'^T one term for each surface.
    factor = minus(times(heavy, over.values), exact)
    for k in range(multipliers.shape[0]):
        pick = lambda ball, k=k: jax.tree_util.tree_map(lambda x: x[k], ball)  # noqa: E731
        h = plus(h, times(pick(over.bents), pick(factor)))
        square = times(_expand(pick(over.slopes), 1), _expand(pick(over.slopes), 0))
        h = plus(h, times(square, pick(heavy)))
    convex = semidefinite(h, jnp.zeros(z.shape, bool))
    reach = jnp.maximum(z, 1 - z) + at.shift
    off_diagonal = jnp.where(jnp.eye(z.size, dtype=bool), jnp.maximum(-h.lower, 0.0), h.size)
    curved = 0.5 * jnp.sum(off_diagonal * reach[:, None] * reach) * (1 + gamma(24, dtype))
    up = jnp.maximum(slope.upper, 0.0) * (z + at.shift)
    down = jnp.maximum(-slope.lower, 0.0) * (1 - z + at.shift)
    taken = jnp.sum(jnp.maximum(up, down)) * (1 + gamma(16, dtype)) + jnp.where(convex, 0.0, curved)
    found = value.lower - taken
    return found - gamma(6, dtype) * (jnp.abs(value.lower) + taken) - 64 * smallest_normal(dtype)


def _blocks(a: Array, b: Array) -> Array:
    n, m = a.shape[0], b.shape[0]
    above = jnp.concatenate([a, jnp.zeros((n, m), a.dtype)], axis=1)
    return jnp.concatenate([above, jnp.concatenate([jnp.zeros((m, n), b.dtype), b], axis=1)])


def _expand(ball: Ball, axis: int) -> Ball:
    return Ball(jnp.expand_dims(ball.mid, axis), jnp.expand_dims(ball.rad, axis))


def _not_parallel(shape: Implicit, side: _Local, apart: Ball, low: Array, high: Array) -> Array:
    """Whether p - q and the gradient are proven not to be parallel, in coordinates that no face of the box holds."""
    if side.slope is None:
        return jnp.zeros((), bool)
    inside = (low > shape.lower) & (high < shape.upper)
    i, j = np.array([1, 2, 0]), np.array([2, 0, 1])
    take = lambda ball, k: Ball(ball.mid[k], ball.rad[k])  # noqa: E731
    cross = minus(times(take(apart, i), take(side.slope, j)), times(take(apart, j), take(side.slope, i)))
    return jnp.any(((cross.lower > 0) | (cross.upper < 0)) & inside[i] & inside[j])


def _proven(
    a: Net | Implicit, b: Net | Implicit, parts: list[Any], low: Array, width: Array, z: Array, n: int
) -> tuple[Array, Array]:
    """An upper bound of the distance by points proven near z, and where they are."""
    points, radii, places = [], [], []
    for shape, part, span in ((a, parts[0], slice(0, n)), (b, parts[1], slice(n, None))):
        if isinstance(shape, Implicit):
            point, radius = proven_point(shape, low[span] + z[span] * width[span])
            places.append(point)
        else:
            point, radius = jet(part, z[span]).point, _error(shape)
            places.append(low[span] + z[span] * width[span])
        points.append(point)
        radii.append(radius)
    distance = length(points[0] - points[1])
    return distance * (1 + gamma(16, z.dtype)) + radii[0] + radii[1], jnp.concatenate(places)


def proven_point(shape: Implicit, x: Array) -> tuple[Array, Array]:
    """A point of the box near x, and a radius within which the surface is proven to have one; infinite where not.

    A few steps of Newton's method along the gradient, within the faces that x lies on. Both ends of the segment along
    it are floats of the box where the polynomial is proven to have different signs.
    """
    dtype = x.dtype

    def direction(x: Array, gradient: Array) -> Array:
        within = jnp.where((x <= shape.lower) | (x >= shape.upper), 0.0, gradient)
        enough = jnp.sum(within**2) > _TANGENT**2 * jnp.sum(gradient**2)
        return jnp.where(enough, within, gradient)

    def step(_: Any, x: Array) -> Array:
        value, gradient, _ = _values(shape, x)
        along = direction(x, gradient)
        move = value * along / jnp.where(jnp.sum(along**2) > 0, jnp.sum(along**2), jnp.inf)
        return jnp.clip(x - jnp.where(jnp.isfinite(move), move, 0.0), shape.lower, shape.upper)

    x = jax.lax.fori_loop(0, _BACK, step, jnp.clip(x, shape.lower, shape.upper))
    value, gradient, _ = _values(shape, x)
    along = direction(x, gradient)
    slope = jnp.sqrt(jnp.sum(along**2))
    slope = jnp.where(slope > 0, slope, jnp.inf)
    here = trivariate.evaluate(shape.table[0], x[:, None])
    error = (here.upper - here.lower)[0]
    reach = 2 * (2 * error + jnp.abs(value)) / slope + 4 * jnp.finfo(dtype).eps * jnp.max(jnp.abs(x))
    ends = [jnp.clip(x + sign * reach * along / slope, shape.lower, shape.upper) for sign in (-1, 1)]
    signs = trivariate.evaluate(shape.table[0], jnp.stack(ends, axis=1))
    lower, upper = signs.lower, signs.upper
    proven = ((lower[0] > 0) & (upper[1] < 0)) | ((upper[0] < 0) & (lower[1] > 0))
    far = jnp.maximum(*(length(end - x) for end in ends)) * (1 + gamma(16, dtype))
    return x, jnp.where(proven, far, jnp.inf)
