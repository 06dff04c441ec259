"""A pair of curves in common coordinates (jhd._distance.normalization.coordinates), padded to a few sizes.

The exact distance refers to the stored arrays, so every step has a bound: scaling by a power of two is exact (flushed
subnormals aside), and `preparation_error` covers moving and raising the degree.
"""

import math
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from jhd._arithmetic.bernstein import product_weights
from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import unit_weights
from jhd._distance.normalization.coordinates import Frame, common_points, extremes, frame_of
from jhd._runtime.arrays import is_traced, module_of
from jhd._shapes.checks import usable_numbers
from jhd._shapes.curve import BezierSegments
from jhd._shapes.joints import followed
from jhd._shapes.unchecked import trusted

# Numbers of segments and degrees that are compiled. Small curves have one size, for which the cost of the repetition is
# negligible; from 192 on, at most a third is repetition.
_COUNTS = (48, 96, *(size for k in range(6, 24) for size in (3 * 2**k, 4 * 2**k)))
# Sizes for work with a noticeable cost per segment: inside a user's compiled function, which is compiled for its sizes
# anyway and in which four segments instead of 48 take two thirds of the time, and in work that visits every segment
# many times.
_SMALL_COUNTS = (4, 16)
_DEGREES = (3, 6, 10)
# Up to this number both curves of a pair have one size; above it, if the smaller size is this fraction of the larger.
_SHARED, _ALIKE = 96, 0.5


def padded_count(count: int, small: bool = False) -> int:
    """Return the smallest compiled number of segments that is at least `count`.

    With `small` there are sizes below 48: more compiled functions, each faster on few segments.
    """
    return next(bucket for bucket in ((*_SMALL_COUNTS, *_COUNTS) if small else _COUNTS) if bucket >= count)


def raised_degree(degree: int) -> int:
    """Return the smallest compiled degree that is at least `degree`; above ten, each degree is compiled."""
    return next((bucket for bucket in _DEGREES if bucket >= degree), degree)


@lru_cache(maxsize=64)
def elevation_matrix(degree: int, target: int) -> np.ndarray:
    """Return the (target + 1, degree + 1) matrix of degree raising, C(n,i) C(m-n,k-i) / C(m,k): convex combinations."""
    weights = product_weights(degree, target - degree)
    matrix = np.zeros((target + 1, degree + 1))
    for i in range(degree + 1):
        matrix[i : i + target - degree + 1, i] = weights[i]
    return matrix


def raised(raising: Any, points: Any, weights: Any) -> tuple[Any, Any]:
    """Return control points (..., points, dim) and weights (or None) of a higher degree, by an elevation matrix."""
    xp = module_of(points)
    if weights is None:
        return xp.sum(raising[:, :, None] * points[..., None, :, :], axis=-2), None
    high = xp.sum(raising * weights[..., None, :], axis=-1)
    return raised(raising, points * weights[..., None], None)[0] / high[..., None], high


def usable(curve: BezierSegments) -> Any:
    """Return whether all control points are finite and all weights finite and positive; True for concrete curves."""
    return usable_numbers(curve.control_points, curve.weights) if is_traced(curve) else True


def replaced(curve: BezierSegments, good: Any) -> BezierSegments:
    """Return the curve, with harmless numbers unless it is good, so that no NaN enters a search."""
    if not is_traced(good):
        return curve
    weights = None if curve.weights is None else jnp.where(good, curve.weights, 1.0)
    return trusted(jnp.where(good, curve.control_points, 0.0), weights, curve.next_segment)


def shared_count(first: int, second: int, small: bool = False) -> tuple[int, int]:
    """Return the padded numbers of segments of two curves: one for both if they are about equal.

    So fewer sizes are compiled; each takes seconds. Repeated segments cost a search little up to a hundred, and at most
    a tenth of its time if they are half of the longer curve.
    """
    counts = padded_count(first, small), padded_count(second, small)
    most = max(counts)
    return (most, most) if most <= _SHARED or min(counts) >= _ALIKE * most else counts


def prepare(
    a: BezierSegments, b: BezierSegments, *, sharing: bool = False
) -> tuple[BezierSegments, BezierSegments, Frame]:
    """Both curves padded and with coordinates in [-1, 1] about the origin, and the frame that leads back.

    On concrete curves this runs in NumPy, which keeps subnormals. `sharing` pads to the sizes of `shared_count`;
    without it, and under tracing, small sizes stay small.
    """
    traced = is_traced(a, b)
    xp = jnp if traced else np
    good = usable(a) & usable(b) if traced else True
    a, b = replaced(a, good), replaced(b, good)
    x, y = (xp.asarray(curve.control_points) for curve in (a, b))
    frame = frame_of([extremes(x), extremes(y)], good)
    x, y = common_points(frame, x), common_points(frame, y)
    degree, rational = raised_degree(max(a.degree, b.degree)), a.weights is not None or b.weights is not None
    if sharing:
        counts = shared_count(a.count, b.count, small=traced)
    else:
        counts = padded_count(a.count, small=True), padded_count(b.count, small=True)
    return (
        _bucketed(xp, a, x, degree, rational, counts[0]),
        _bucketed(xp, b, y, degree, rational, counts[1]),
        frame,
    )


def preparation_error(degree: int, dim: int, dtype: DTypeLike) -> float:
    """Bound the distance by which `prepare` moves any point of one curve, in the common coordinates.

    Subtracting the center rounds each coordinate once. Raising the degree forms convex combinations of at most
    degree + 1 products, with weights of two roundings; on rational curves numerator and denominator each err by a
    relative gamma(degree + 6), and so does the position of the point, twice, in units of coordinates of at most one.
    """
    return math.sqrt(dim) * gamma(4 * (degree + 7) + 1, dtype)


def evaluation_error(a: BezierSegments, b: BezierSegments) -> float:
    """Bound the distance of the computed witness from a point of a, and of both curves from the stored ones.

    De Casteljau's algorithm costs three roundings a level, in numerator and denominator of a rational segment, whose
    quotient adds a product and a division, each relative to coordinates of at most one.
    """
    dtype = a.control_points.dtype
    evaluation = math.sqrt(a.dim) * gamma(6 * a.degree + 6, dtype)
    return evaluation + sum(preparation_error(curve.degree, curve.dim, dtype) for curve in (a, b))


def _bucketed(xp: Any, curve: BezierSegments, points: Any, degree: int, rational: bool, count: int) -> BezierSegments:
    """Return the curve with these control points, raised to `degree`, its last segment repeated up to `count`.

    A polynomial curve gets weights of one if the other curve is rational. The weights of each segment are first scaled
    to a largest one in [1/2, 1), which changes no point.
    """
    index = np.minimum(np.arange(count), curve.count - 1)
    weights: Any = curve.weights
    if weights is None and rational:
        weights = xp.ones(points.shape[:-1], points.dtype)
    if weights is not None:
        weights = unit_weights(xp.asarray(weights))
    if degree > curve.degree:
        points, weights = raised(elevation_matrix(curve.degree, degree).astype(points.dtype), points, weights)
    weights = None if weights is None else weights[index]
    return trusted(points[index], weights, xp.asarray(followed(curve.links))[index])
