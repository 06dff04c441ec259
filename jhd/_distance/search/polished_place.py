"""The farthest point to full precision, on a parametric piece or a triangle: a proposal, nothing is proven.

A search knows its farthest point to about the root of the gap. Let d_k be the distances of a(x) to the feet that count,
each followed on its piece of b or on an implicit surface (a point stays), g_k their gradients in the parameters x of a,
and Z directions along the sides of the domain that hold x. At the maximum of the smallest of them all d_k are equal and
sum l_k Z g_k = 0 with multipliers l_k of sum one. Newton's method takes the second derivatives of sum l_k d_k from
differences of the gradients, which the envelope theorem gives without any derivatives of the feet.

Source: conditions of Karush, Kuhn and Tucker, and Newton's method on them, as in Nocedal & Wright, Numerical
Optimization (2006), chapters 12 and 18.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._distance.cells.foot_maps import Triangles, foot_near
from jhd._distance.nearest.surface_points import local_feet
from jhd._distance.nearest.target import FootRows
from jhd._distance.normalization.net_jets import Net, jet
from jhd._distance.search.row_batches import each, in_blocks
from jhd._runtime.compiled import compiled

# Newton steps; they end at the first step longer than this fraction of the domain, or shorter than that one.
_STEPS, _LONGEST, _SHORTEST = 8, 0.05, 1e-15
# Newton steps towards a foot on an implicit surface.
_FOOT_STEPS = 8
# Step of the differences of gradients, as a fraction of the domain.
_STEP = 1e-4
# A side this near holds a point if the slope towards it is more than minus this fraction of the longest gradient. At
# the last distance the point lies on the side up to rounding.
_BESIDE, _OUTWARD, _ROUNDED = 1e-6, 1e-6, 1e-15


class _Followed(NamedTuple):
    """Distances (points, feet), their gradients (points, feet, parameters), points, and feet with parameters."""

    distance: np.ndarray
    gradient: np.ndarray
    point: np.ndarray
    foot: np.ndarray
    t: np.ndarray


class PlaceOnPiece(NamedTuple):
    """A point on a piece of a parametric shape or a mesh."""

    # The shape of the point, a net or triangles, and the target: also an implicit surface; None for points.
    shapes: Any
    piece: int  # index of the piece
    x: np.ndarray  # its parameters; for triangles the last two barycentric coordinates

    def moved(self, feet: FootRows) -> FootRows:
        """Return feet, each moved along its piece until it is nearest to the point."""
        known = np.isfinite(feet.error)
        there = feet.take(known)
        found = _followed(self.shapes, self.piece, self.x[None], there)
        feet = feet.map(np.array)
        feet.point[known] = found.foot[0]
        if isinstance(self.shapes[1], Net | Triangles):
            feet.t[known, : found.t.shape[2]] = found.t[0]
        return feet


# Leads from a point that a search has found to the point on pieces, on which feet are followed; the closest come first.
About = Callable[[Any], list[PlaceOnPiece]]


def place_of(shapes: Any, found: Any) -> list[PlaceOnPiece]:
    """Return a point that a search has found, on its piece of the first of two shapes."""
    return [PlaceOnPiece(shapes, found.piece, found.x)]


class SharpenedPlace(NamedTuple):
    """Parameters of a maximum, and the point there."""

    x: np.ndarray
    point: np.ndarray


def polished(place: PlaceOnPiece, feet: FootRows, shares: np.ndarray) -> SharpenedPlace | None:
    """Return the maximum of the distance to the nearest of some feet, or None if none is found.

    Args:
        place: a point near the maximum.
        feet: points near its feet.
        shares: multipliers of the feet; feet whose multiplier is zero do not count.
    """
    shapes, piece, x = place
    used = np.flatnonzero(shares > 0)
    feet, shares = feet.map(lambda y: y[used]), shares[used]
    x, dtype = x.astype(np.float64), x.dtype
    steps = np.concatenate([np.zeros((1, len(x))), _STEP * np.eye(len(x)), -_STEP * np.eye(len(x))])
    for _ in range(_STEPS):
        found = _followed(shapes, piece, (x + steps).astype(dtype), feet)
        gradient, (ahead, behind) = found.gradient[0], np.split(found.gradient[1:], 2)
        x, along = _held(shapes[0], x, shares @ gradient, np.max(np.abs(gradient), initial=0.0))
        if along.shape[1] < len(shares) - 1:
            if not along.shape[1] or not np.all(np.isfinite(gradient)):
                return None
            kept, shares = _basic(gradient @ along, shares)
            return polished(place, feet.take(kept), shares)
        if not along.shape[1]:
            break
        bent = along.T @ np.einsum("ikn,k->in", ahead - behind, shares) @ along / (2 * _STEP)
        step, shares = _newton(0.5 * (bent + bent.T), gradient @ along, found.distance[0])
        step = along @ step
        # Fixed feet cannot be lost.
        longest = 1.0 if shapes[1] is None else _LONGEST
        if not np.all(np.isfinite(step)) or np.max(np.abs(step)) > longest:
            return None
        # A side that the step reaches holds the point from the next step on, if the point still would leave.
        x = _within(shapes[0], x + step)
        if np.max(np.abs(step)) < _SHORTEST:
            break
    x = x.astype(dtype)
    return SharpenedPlace(x, _followed(shapes, piece, x[None], feet).point[0, 0])


def _basic(slopes: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a subset of feet, one more than directions, and multipliers with the same sum of slopes (Caratheodory)."""
    kept = np.arange(len(shares))
    while len(kept) > slopes.shape[1] + 1:
        # Multipliers move along it, until the first is zero, and the sum stays.
        null = np.linalg.svd(np.vstack([slopes[kept].T, np.ones(len(kept))]))[2][-1]
        null = null if np.max(null) >= -np.min(null) else -null
        room = np.where(null > 0, shares / np.where(null > 0, null, 1.0), np.inf)
        k = int(np.argmin(room))
        shares = np.delete(shares - room[k] * null, k)
        kept = np.delete(kept, k)
    return kept, shares


def _newton(bent: np.ndarray, slopes: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a step and multipliers: sum l_k (slope_k + ...) = 0, distances along it all equal, sum l_k = 1."""
    feet, n = slopes.shape
    matrix, right = np.zeros((n + feet + 1, n + feet + 1)), np.zeros(n + feet + 1)
    matrix[:n, :n], matrix[:n, n : n + feet] = bent, slopes.T
    matrix[n:-1, :n], matrix[n:-1, -1], right[n:-1] = slopes, -1.0, -(distance - np.mean(distance))
    matrix[-1, n:-1], right[-1] = 1.0, 1.0
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
        return np.full(n, np.nan), np.full(feet, np.nan)
    found = np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
    return found[:n], found[n:-1]


def _domain(a: Net | Triangles, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and bounds of the linear inequalities rows @ x <= bounds for the parameters of a piece."""
    eye = np.eye(n)
    if a.flat:
        return np.concatenate([-eye, np.ones((1, 2))]), np.array([0.0, 0.0, 1.0])
    return np.concatenate([-eye, eye]), np.append(np.zeros(n), np.ones(n))


def _within(a: Net | Triangles, x: np.ndarray) -> np.ndarray:
    """Return parameters moved into the domain, and onto sides that they miss by rounding only."""
    x = np.where(np.abs(x - np.round(x)) <= _ROUNDED, np.round(x), np.clip(x, 0.0, 1.0))
    return np.array([x[0], 1 - x[0]]) if a.flat and np.sum(x) > 1 - _ROUNDED else x


def _held(a: Net | Triangles, x: np.ndarray, slope: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the point moved onto the sides that hold it, and orthonormal directions along them as columns."""
    sides, room = _domain(a, len(x))
    held = (room - sides @ x <= _BESIDE) & (sides @ slope > -_OUTWARD * size)
    if not np.any(held):
        return x, np.eye(len(x))
    values, frame = np.linalg.svd(sides[held])[1:]
    onto = np.linalg.lstsq(sides[held], (room - sides @ x)[held], rcond=1e-9)[0]
    return _within(a, x + onto), frame[np.count_nonzero(values > 1e-9) :].T


def _followed(shapes: Any, piece: int, x: np.ndarray, feet: FootRows) -> _Followed:
    """Follow the feet to points (points, parameters) of a piece."""
    count, many = len(x), len(feet.segment)
    rows = np.repeat(x, many, axis=0)
    segment = np.tile(feet.segment, count)
    t = feet.t[:, : shapes[1].parameters] if isinstance(shapes[1], Net | Triangles) else feet.point
    start = np.tile(t.astype(x.dtype), (count, 1))
    found = in_blocks(_followed_to, shapes, np.full(len(rows), piece), rows, segment, start)
    point, tangents, foot, t = (np.reshape(y, (count, many, *y.shape[1:])) for y in found)
    apart = point.astype(np.float64) - foot
    distance = np.linalg.norm(apart, axis=-1)
    unit = apart / np.where(distance > 0, distance, 1.0)[..., None]
    return _Followed(distance, np.einsum("pkd,pknd->pkn", unit, tangents), point, foot, t)


@compiled
def _followed_to(shapes: Any, count: Array, piece: Array, x: Array, segment: Array, start: Array) -> Any:
    a, b = shapes

    def one(k: Array, x: Array, segment: Array, start: Array) -> tuple[Array, ...]:
        point, tangents = _point_and_tangents(a.piece(k), x)
        if isinstance(b, Net | Triangles):
            foot = foot_near(b.piece(segment), point, start)
            return point, tangents, b.piece(segment).point(foot), foot
        foot = start if b is None else local_feet(b, point[:, None], start[:, None], _FOOT_STEPS)[:, 0]
        return point, tangents, foot, foot

    return each(one, count, (piece, x, segment, start), 8)


def _point_and_tangents(a: Net | Triangles, x: Array) -> tuple[Array, Array]:
    if isinstance(a, Triangles):
        weights = jnp.concatenate([1 - jnp.sum(x, keepdims=True), x])
        return a.point(weights), a.corners[1:] - a.corners[0]
    at = jet(a, x)
    return at.point, at.first
