"""Common coordinates of two shapes: moved to the origin between two scalings by powers of two, and the way back.

The first power keeps the center from overflowing, the second brings the extent that is left to order one; both are
exact, flushed subnormals aside, so only the subtraction of the center rounds, once for each coordinate. If nothing may
round, `exact_middle` moves only the axes that move without rounding, and `origin` moves nothing. The common coordinates
depend only on the extreme corners of both shapes.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma, smallest_normal
from jhd._arithmetic.scaling import common_exponent, ldexp, length, scale_of, times_two_to
from jhd._results.solution import RESULTS, HausdorffSolution, result_where, with_lengths
from jhd._runtime.arrays import array_of, is_traced

# An axis is moved exactly if the middle is at least this many half extents away: all coordinates are then within a
# factor of two of the middle, and their differences to it are exact (Sterbenz).
_FAR = 2.5


class Frame(NamedTuple):
    """Map from common coordinates to the user's: x_user = (2^second x + center) 2^first."""

    center: Any
    first: Any
    second: Any
    usable: Any = True  # whether all numbers were; under tracing this is known only now

    def place(self, x: Any) -> Array:
        """Return points in the user's coordinates."""
        return array_of(user_place(self, x))

    def scale(self, dtype: DTypeLike) -> Array:
        """Return the power of two that scales the user's lengths to the common unit."""
        return scale_of(self.first + self.second, dtype)

    def moved(self, x: Array) -> Array:
        """Return the user's points in the common coordinates, differentiably."""
        return (x - times_two_to(jnp.asarray(self.center), self.first)) * self.scale(x.dtype)

    def common(self, x: Any, toward: float | None = None) -> Any:
        """Return a user's length in the common coordinates, rounded towards `toward` if it is below the normal numbers.

        If rounded towards zero, it is at most four, which exceeds any distance there.
        """
        xp = jnp if is_traced(x, self) else np
        with np.errstate(over="ignore"):
            scaled = ldexp(xp.asarray(x), -(self.first + self.second))
        if toward is None:
            return scaled
        nu = smallest_normal(scaled.dtype)
        lost, end = (xp.abs(scaled) < nu) & (scaled != 0), 0.0 if toward == 0 else nu
        return xp.where(lost, xp.asarray(end, scaled.dtype), xp.minimum(scaled, 4.0) if toward == 0 else scaled)

    def length(self, x: Any, toward: float | None = None) -> Array:
        """Return lengths in the user's unit, exact, or rounded towards `toward` below the normal numbers."""
        return array_of(user_length(self, x, toward))


def reported(frame: Frame, solution: HausdorffSolution) -> HausdorffSolution:
    """Return a solution in the user's coordinates."""
    witness, good = solution.witness, frame.usable
    value, lower = user_length(frame, solution.value, None), user_length(frame, solution.lower, 0.0)
    upper = user_length(frame, solution.upper, np.inf)
    if is_traced(good):
        value, lower, upper = (jnp.where(good, x, y) for x, y in ((value, jnp.inf), (lower, 0.0), (upper, jnp.inf)))
        solution = replace(solution, result=result_where(good, solution.result, RESULTS.nonfinite_value))
    places = user_place(frame, witness.point), user_place(frame, witness.feet)
    return with_lengths(solution, value, lower, upper, *places)


def user_place(frame: Frame, x: Any) -> Any:
    """Return points as `Frame.place` does; known numbers stay on the host."""
    return times_two_to(times_two_to(x, frame.second) + frame.center, frame.first)


def user_length(frame: Frame, x: Any, toward: float | None) -> Any:
    """Return lengths as `Frame.length` does; known numbers stay on the host, in their precision."""
    traced = is_traced(x, frame)
    xp = jnp if traced else np
    given = xp.asarray(x)
    with np.errstate(over="ignore"):
        scaled = times_two_to(given, frame.first + frame.second)
    if toward is None:
        return scaled
    if toward == 0:  # a lower bound that overflows is at least the largest float
        scaled = xp.where(xp.isfinite(given), xp.minimum(scaled, xp.finfo(scaled.dtype).max), scaled)
    if traced:
        # Compiled functions flush subnormal inputs: that moves a distance by a few of the smallest normal numbers.
        flushed = 32 * smallest_normal(scaled.dtype)
        return jnp.maximum(scaled - flushed, 0.0) if toward == 0 else scaled + flushed
    outward = xp.nextafter(scaled, xp.asarray(toward, scaled.dtype))
    exact = (xp.abs(scaled) > 2 * smallest_normal(scaled.dtype)) | (given == 0)
    return xp.where(exact, scaled, outward)


def extremes(x: Any) -> tuple[Any, Any]:
    """Return the least and the largest of each coordinate of points (..., dim)."""
    if is_traced(x):
        axes = tuple(range(x.ndim - 1))
        return jnp.min(x, axis=axes), jnp.max(x, axis=axes)
    # Along contiguous rows, which takes a twentieth of the time.
    rows = np.ascontiguousarray(np.asarray(x).reshape(-1, x.shape[-1]).T)
    return rows.min(axis=1), rows.max(axis=1)


def diagonal(corners: Sequence[tuple[Any, Any]]) -> Any:
    """Return the diagonal of the box of all shapes with these lower and upper corners."""
    low, high = _box_of(corners)
    # Half of the diagonal does not overflow; the whole may, and is then infinite.
    with np.errstate(over="ignore"):
        return 2 * length(0.5 * high - 0.5 * low)


def _box_of(corners: Sequence[tuple[Any, Any]]) -> tuple[Any, Any]:
    xp: Any = jnp if is_traced(corners) else np
    lows, highs = zip(*corners, strict=True)
    return reduce(xp.minimum, lows), reduce(xp.maximum, highs)


def middle(low: Any, high: Any) -> Any:
    """Return the middle of a box."""
    return 0.5 * (low + high)


def exact_middle(low: Any, high: Any) -> Any:
    """Return the middle along axes on which all differences to it are exact, else zero."""
    center = 0.5 * (low + high)
    far = abs(center) >= _FAR * 0.5 * (high - low)
    return (jnp if is_traced(center) else np).where(far, center, 0.0)


def origin(low: Any, high: Any) -> Any:
    """Return zero: coordinates are only scaled."""
    return 0.0 * low


def frame_of(
    corners: Sequence[tuple[Any, Any]], usable: Any = True, center: Callable[[Any, Any], Any] = middle
) -> Frame:
    """Return the common coordinates of shapes with these lower and upper corners.

    Args:
        corners: lower and upper corners of each shape, finite.
        usable: whether all numbers of the shapes were finite.
        center: returns the center from the corners of the box of all shapes, which are at most one.
    """
    low, high = _box_of(corners)
    first = common_exponent(low, high)
    low, high = ldexp(low, -first), ldexp(high, -first)
    at = center(low, high)
    # If all points are equal, every difference is an exact zero: no length is left for a relative error.
    # Power of two that stands for no extent at all; single precision ends at 2^-126.
    return Frame(at, first, common_exponent(low - at, high - at, nothing=-100), usable)


def common_points(frame: Frame, x: Any) -> Any:
    """Return the user's points in the common coordinates; subtracting the center rounds each coordinate once."""
    center, first, second = frame.center, frame.first, frame.second
    return times_two_to(ldexp(x, -first) - center, -second)


def moved_by(x: np.ndarray) -> np.ndarray:
    """Bound the displacement of points x by the move to common coordinates, in the common unit."""
    return gamma(4, x.dtype) * np.sqrt(3) * np.max(np.abs(x), axis=1).astype(np.float64) + 64 * smallest_normal(x.dtype)
