"""Approximate foot maps: from a cell of one shape to the parameters of another shape; nothing is proven here.

A piece of a shape is a piece of a net, or a triangle, whose parameters are its three barycentric coordinates. On its
sides one parameter is zero, or, for a net, one.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import smallest_normal
from jhd._arithmetic.simplices import fitting
from jhd._distance.cells.pairs import newton_step
from jhd._distance.normalization.net_jets import Net, NetJet, jet

# How far towards the middle of a cell the points lie whose feet are followed.
INSET = 0.125
# Newton steps towards the foot of the middle, and from there towards the feet of the other points.
_FIRST, _STEPS = 4, 4
# How far feet are followed beyond the sides of a piece.
BEYOND = 0.5
# Steps of the method of false position towards a point whose foot is on a side, and Newton steps in each.
_ROOT_STEPS, _STEPS_IN_ROOTS = 7, 3


class Triangles(NamedTuple):
    """The corners (triangles, 3, 3) of triangles."""

    corners: Any
    # Feet take no steps; points have three barycentric coordinates; the degrees cover fewer than 20 roundings of parts.
    flat, parameters, degrees = True, 3, (1, 0)

    def piece(self, k: Array) -> "Triangles":
        """Return the triangle with index `k`, or the triangles with an array of indices."""
        return Triangles(self.corners[k])

    def point(self, x: Array) -> Array:
        """Return the point of one triangle at its barycentric coordinates."""
        return jnp.sum(x[:, None] * self.corners, axis=0)


def weighted(shares: Array, rows: Array) -> Array:
    """Return the sums of `rows` weighted by `shares`."""
    return jnp.sum(shares[:, :, None] * rows[None], axis=1)


def foot_map(places: Array, b: Net | Triangles, start: Array, beyond: Array | float = 0.0) -> Array:
    """Coefficients (indices, parameters of b) of a quadratic foot map into the domain of the piece b.

    Args:
        places: points of a at the inner lattice of the cell, (indices, 3).
        b: the piece.
        start: parameters of b near the foot of the middle.
        beyond: how far a net is continued beyond its sides.
    """
    matrix = fitting(1 if len(places) == 3 else 2, 2, INSET).astype(places.dtype)
    if b.flat:
        feet = jax.vmap(lambda p: foot_near(b, p, start))(places)
        found = jnp.maximum(jnp.sum(matrix[:, :, None] * feet[None], axis=1), 0.0)
        return found / jnp.sum(found, axis=1, keepdims=True)
    feet = _followed(b, places, jnp.mean(places, axis=0), start, beyond)
    return jnp.clip(jnp.sum(matrix[:, :, None] * feet[None], axis=1), -beyond, 1 + beyond)


def foot_near(
    b: Net | Triangles, place: Array, start: Array, steps: int = _FIRST + _STEPS, beyond: float = 0.0
) -> Array:
    """Return the parameters of the foot of `place` on a piece, or `beyond` its sides, searched from `start`."""
    if isinstance(b, Triangles):
        return (_in_plane if beyond else _on_triangle)(b.corners, place)
    return foot_between(b, place, start, steps, -beyond, 1 + beyond)


def foot_between(b: Net, place: Array, start: Array, steps: int, low: Array | float, high: Array | float) -> Array:
    """Return the parameters of b between `low` and `high` at about the foot of `place`, searched from `start`."""
    return jax.lax.fori_loop(0, steps, lambda _, x: _nearer(b, place, x, low, high), start)


def _nearer(b: Net, place: Array, x: Array, low: Array | float, high: Array | float) -> Array:
    """Return x after one step of Newton's method, kept between `low` and `high`."""
    return stepped(jet(b, x), place, x, low, high)


def stepped(at: NetJet, place: Array, x: Array, low: Array | float, high: Array | float) -> Array:
    """Return x after one step of Newton's method towards the foot of `place`, given the point and derivatives at x."""
    e = at.point - place
    slope = jnp.sum(at.first * e, axis=-1)
    bent = jnp.sum(at.first[:, None] * at.first[None], axis=-1) + jnp.sum(at.second * e, axis=-1)
    held = ((x <= low) & (slope > 0)) | ((x >= high) & (slope < 0))
    moved = x + newton_step(slope, bent, held)
    return jnp.clip(jnp.where(jnp.isfinite(moved), moved, x), low, high)


def _followed(b: Any, places: Array, middle: Array, start: Array, beyond: Array | float) -> Array:
    """Return the parameters of the feet of `places`, found from `start` by way of the foot of `middle`.

    All first go to the foot of the middle, side by side: one loop compiles in half the time of two.
    """

    def step(k: Array, x: Array) -> Array:
        towards = jnp.where(k < _FIRST, middle, places)
        return jax.vmap(lambda p, x: _nearer(b, p, x, -beyond, 1 + beyond))(towards, x)

    return jax.lax.fori_loop(0, _FIRST + _STEPS, step, jnp.broadcast_to(start, (len(places), len(start))))


def _in_plane(corners: Array, place: Array) -> Array:
    """The barycentric coordinates of the foot in the plane of a triangle."""
    a, b, p = corners[1] - corners[0], corners[2] - corners[0], place - corners[0]
    aa, bb, ab, pa, pb = (jnp.sum(x * y) for x, y in ((a, a), (b, b), (a, b), (p, a), (p, b)))
    area = jnp.maximum(aa * bb - ab * ab, smallest_normal(place.dtype))
    s, t = (pa * bb - pb * ab) / area, (pb * aa - pa * ab) / area
    return jnp.stack([1 - s - t, s, t])


def _on_triangle(corners: Array, place: Array) -> Array:
    """Return barycentric coordinates of a triangle's nearest point: the foot in its plane, or on the nearest side."""
    inside = _in_plane(corners, place)
    ends = np.array([[0, 1], [1, 2], [2, 0]])

    def on_side(i: Array, j: Array) -> tuple[Array, Array]:
        along, p = corners[j] - corners[i], place - corners[i]
        square = jnp.sum(along * along)
        share = jnp.clip(jnp.sum(p * along) / jnp.where(square > 0, square, 1.0), 0.0, 1.0)
        eye = jnp.eye(3, dtype=place.dtype)
        return (1 - share) * eye[i] + share * eye[j], jnp.sum((p - share * along) ** 2)

    rows, squares = jax.vmap(on_side)(jnp.asarray(ends[:, 0]), jnp.asarray(ends[:, 1]))
    return jnp.where(jnp.all(inside >= 0), inside, rows[jnp.argmin(squares)])


def distance_to(triangle: Triangles, place: Array) -> Array:
    """Return the distance of the point `place` from a triangle."""
    return jnp.sqrt(jnp.sum((triangle.point(_on_triangle(triangle.corners, place)) - place) ** 2))


def _sides(b: Net | Triangles, x: Array) -> Array:
    """Return one number for each side: positive inside the piece and zero on that side."""
    return x if b.flat else jnp.concatenate([x, 1 - x])


def beyond_sides(b: Net | Triangles, points: Array, start: Array) -> Array:
    """Return how far inside each side of a piece the feet of points are, (points, sides); negative beyond it."""
    if b.flat:
        return jax.vmap(lambda p: _sides(b, foot_near(b, p, start, beyond=BEYOND)))(points)
    return jax.vmap(partial(_sides, b))(_followed(b, points, points[-1], start, BEYOND))


def share_on_side(
    a: Net | Triangles, b: Net | Triangles, ends: Array, start: Array, side: Array, values: Array
) -> Array:
    """Return the fraction of the way between two points of a at which the foot reaches a side of b.

    Args:
        a: the piece with the points.
        b: the piece with the feet.
        ends: parameters of the two points, (2, parameters).
        start: parameters of b near the feet.
        side: index of the side.
        values: `beyond_sides` of both ends at this side, of different signs.
    """

    def value(share: Array) -> Array:
        x = ends[0] + share * (ends[1] - ends[0])
        return _sides(b, foot_near(b, a.point(x), start, _FIRST + _STEPS_IN_ROOTS, BEYOND))[side]

    def step(_: Any, state: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, first, second, last, _ = state
        share = low + (high - low) * first / (first - second)
        share = jnp.where(jnp.isfinite(share), share, 0.5 * (low + high))
        found = value(share)
        # The end that stays counts half (the Illinois variant).
        left = found * first > 0
        first_again = jnp.where(~left & (last < 0), 0.5, 1.0) * first
        second_again = jnp.where(left & (last > 0), 0.5, 1.0) * second
        ends = jnp.where(left, share, low), jnp.where(left, high, share)
        return (
            *ends,
            jnp.where(left, found, first_again),
            jnp.where(left, second_again, found),
            jnp.where(left, 1.0, -1.0),
            share,
        )

    zero = jnp.zeros_like(values[0])
    state = (zero, zero + 1, values[0], values[1], zero, zero + 0.5)
    share = jax.lax.fori_loop(0, _ROOT_STEPS, step, state)[-1]
    return jnp.clip(jnp.where(jnp.isfinite(share), share, 0.5), 0.0, 1.0)
