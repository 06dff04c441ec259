"""Points of implicit surfaces where the polynomial does not change its sign, in common coordinates.

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

# So many of them are kept.
_KEPT = 8


class IsolatedPoints(NamedTuple):
    """Cubes about places, in which only balls about these may hold points of a surface.

    Args:
        center: the places, in the box.
        half: half the sides of the cubes; negative where the place is none.
        radius: of the balls; minus infinity where there is no point.
        there: whether the ball is proven to hold a point.
    """

    center: Any  # (places, 3)
    half: Any  # (places,)
    radius: Any  # (places,)
    there: Any  # (places,)

    @property
    def doubtful(self) -> Any:
        """Whether nothing can be said of one of them: a point where the polynomial is zero exactly, or none."""
        return jnp.any((jnp.asarray(self.half) > 0) & (jnp.asarray(self.radius) >= 0) & ~jnp.asarray(self.there))


def none_known(dtype: Any) -> IsolatedPoints:
    """Where nothing is known beforehand."""
    numbers = np.zeros(_KEPT, dtype)
    return IsolatedPoints(np.zeros((_KEPT, 3), dtype), numbers - 1, numbers, np.zeros(_KEPT, bool))


def isolated_points(found: list[IsolatedZero], lower: np.ndarray, upper: np.ndarray) -> IsolatedPoints:
    """Exact ones in floats of the corners of the box; those beyond the first few are left out."""
    points = none_known(lower.dtype)
    eps = float(np.finfo(lower.dtype).eps)
    for k, zero in enumerate(found[:_KEPT]):
        center = np.clip(np.array([float(x) for x in zero.place]).astype(lower.dtype), lower, upper)
        off = sum((abs(Fraction(x) - y) for x, y in zip(center.tolist(), zero.place, strict=True)), Fraction(0))
        # An ulp of what the radius is added to; nothing is rounded where the place itself is all there is.
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
    """Which cells lie in one of the cubes and hold nothing of its ball."""
    center, half, radius = (jnp.asarray(x)[..., None] for x in points[:3])
    half, radius = half[:, None], radius[:, None]
    within = jnp.all((lower >= center - half) & (upper <= center + half), axis=1)
    beside = jnp.any((lower > center + radius) | (upper < center - radius), axis=1)
    return jnp.any(within & beside & (half[:, 0] > 0), axis=0)


def snapped(
    points: IsolatedPoints, places: Float[Array, "3 places"], starts: Float[Array, "3 places"]
) -> Float[Array, "3 places"]:
    """The places, for those that started in a cube, or ended in one, the point that is there."""
    center, half, there = (jnp.asarray(x)[::-1] for x in (points.center, points.half, points.there))
    # One question for all cubes and both: a program is as long to compile as it has parts.
    where = jnp.stack([places, starts])
    far = jnp.max(jnp.abs(where[:, None] - center[..., None]), axis=2)
    inside = ((far < half[:, None]) & there[:, None]).reshape(-1, places.shape[1])
    first = jnp.argmax(inside, axis=0)
    return jnp.where(jnp.any(inside, axis=0), center[first % _KEPT].T, places)


def on_isolated(points: IsolatedPoints, places: Float[Array, "3 places"]) -> Bool[Array, " places"]:
    """Which places are points that are known beforehand."""
    same = jnp.all(jnp.asarray(points.center)[..., None] == places, axis=1)
    return jnp.any(same & jnp.asarray(points.there)[:, None], axis=0)


def isolated_radius(points: IsolatedPoints, places: Float[Array, "3 places"]) -> Float[Array, " places"]:
    """Lengths within which there is one of the points, infinite where no point is known."""
    apart = jnp.asarray(points.center)[..., None] - places
    dtype = apart.dtype
    exact = jnp.all(apart == 0, axis=1)
    length = jnp.sqrt(jnp.sum(apart**2, axis=1)) * (1 + gamma(8, dtype)) + 2 * smallest_normal(dtype) ** 0.5
    radius = jnp.asarray(points.radius)[:, None]
    total = round_up((jnp.where(exact, 0.0, length) + radius) * (1 + 4 * unit_roundoff(dtype)))
    total = jnp.where(exact & (radius == 0), 0.0, total)
    return jnp.min(jnp.where(jnp.asarray(points.there)[:, None], total, jnp.inf), axis=0)
