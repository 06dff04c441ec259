"""Points of implicit surfaces without a change of sign of the polynomial, in common coordinates.

A surface may have only such points, for example a sphere that touches its box from outside: no sign proves them, and
enclosures leave a ball about them of the size of the square root of the roundoff. For known surfaces they are found and
proven beforehand (jhd._arithmetic.isolated_zeros): within a cube about such a point only a small ball counts.
"""

from fractions import Fraction
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jhd._arithmetic.isolated_zeros import IsolatedZero
from jhd._arithmetic.rounding import gamma, round_up, smallest_normal, unit_roundoff

# Largest number of points that are kept.
_KEPT = 8


class IsolatedPoints(NamedTuple):
    """Cubes around points; within a cube only a ball around its point may hold points of the surface.

    Args:
        center: the points, in the box.
        half: half the sides of the cubes; negative for unused entries.
        radius: radius of the balls; minus infinity if there is no point.
        there: whether the ball is proven to hold a point.
    """

    center: Any  # (places, 3)
    half: Any  # (places,)
    radius: Any  # (places,)
    there: Any  # (places,)

    @property
    def doubtful(self) -> Any:
        """Return whether for one of them it is undecided if the polynomial is exactly zero there."""
        return jnp.any((jnp.asarray(self.half) > 0) & (jnp.asarray(self.radius) >= 0) & ~jnp.asarray(self.there))


def none_known(dtype: Any) -> IsolatedPoints:
    """Return empty entries: no points are known beforehand."""
    numbers = np.zeros(_KEPT, dtype)
    return IsolatedPoints(np.zeros((_KEPT, 3), dtype), numbers - 1, numbers, np.zeros(_KEPT, bool))


def isolated_points(found: list[IsolatedZero], lower: np.ndarray, upper: np.ndarray) -> IsolatedPoints:
    """Return exact zeros, rounded to floats of the type of the box; only the first few are kept."""
    points = none_known(lower.dtype)
    eps = float(np.finfo(lower.dtype).eps)
    for k, zero in enumerate(found[:_KEPT]):
        center = np.clip(np.array([float(x) for x in zero.place]).astype(lower.dtype), lower, upper)
        off = sum((abs(Fraction(x) - y) for x, y in zip(center.tolist(), zero.place, strict=True)), Fraction(0))
        # An ulp of the number that the radius is added to; nothing is rounded if the point itself is exact.
        room = float(off) * (1 + eps) + (2 * eps * float(np.max(np.abs(center))) if zero.radius or off else 0.0)
        half = 0.99 * zero.half - 4 * room
        if half <= 64 * eps:
            continue
        points.center[k], points.half[k], points.there[k] = center, half, zero.there
        points.radius[k] = -np.inf if zero.radius < 0 else (zero.radius + room) * (1 + 4 * eps)
    return points


def cleared(
    points: IsolatedPoints, lower: Float[Array, "3 cells"], upper: Float[Array, "3 cells"]
) -> Bool[Array, " cells"]:
    """Return which cells lie in one of the cubes and outside of its ball."""
    center, half, radius = (jnp.asarray(x)[..., None] for x in points[:3])
    half, radius = half[:, None], radius[:, None]
    within = jnp.all((lower >= center - half) & (upper <= center + half), axis=1)
    beside = jnp.any((lower > center + radius) | (upper < center - radius), axis=1)
    return jnp.any(within & beside & (half[:, 0] > 0), axis=0)


def snapped(
    points: IsolatedPoints, places: Float[Array, "3 places"], starts: Float[Array, "3 places"]
) -> Float[Array, "3 places"]:
    """Return the places, replaced by the isolated point of a cube if they started or ended in it."""
    center, half, there = (jnp.asarray(x)[::-1] for x in (points.center, points.half, points.there))
    # One comparison for all cubes and both arrays: compile time grows with the number of operations.
    where = jnp.stack([places, starts])
    far = jnp.max(jnp.abs(where[:, None] - center[..., None]), axis=2)
    inside = ((far < half[:, None]) & there[:, None]).reshape(-1, places.shape[1])
    first = jnp.argmax(inside, axis=0)
    return jnp.where(jnp.any(inside, axis=0), center[first % _KEPT].T, places)


def on_isolated(points: IsolatedPoints, places: Float[Array, "3 places"]) -> Bool[Array, " places"]:
    """Return which places are isolated points known beforehand."""
    same = jnp.all(jnp.asarray(points.center)[..., None] == places, axis=1)
    return jnp.any(same & jnp.asarray(points.there)[:, None], axis=0)


def isolated_radius(points: IsolatedPoints, places: Float[Array, "3 places"]) -> Float[Array, " places"]:
    """Return lengths within which there is an isolated point; infinite if none is known."""
    apart = jnp.asarray(points.center)[..., None] - places
    dtype = apart.dtype
    exact = jnp.all(apart == 0, axis=1)
    length = jnp.sqrt(jnp.sum(apart**2, axis=1)) * (1 + gamma(8, dtype)) + 2 * smallest_normal(dtype) ** 0.5
    radius = jnp.asarray(points.radius)[:, None]
    total = round_up((jnp.where(exact, 0.0, length) + radius) * (1 + 4 * unit_roundoff(dtype)))
    total = jnp.where(exact & (radius == 0), 0.0, total)
    return jnp.min(jnp.where(jnp.asarray(points.there)[:, None], total, jnp.inf), axis=0)
