"""Distances from points along a curve to a shape, as arrays."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._distance.project import project
from jhd._results.batches import AbstractSolution
from jhd._results.display import count_text, described, most_text, opaque
from jhd._results.outcomes import RESULTS
from jhd._runtime.arrays import check_whole
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.curve import check_curve


class DistanceProfile(AbstractSolution):
    """Distances from points along a curve to a shape, in the order of the curve.

    Args:
        t: parameters of `a.segments()`: segment k has the interval [k, k + 1], and joints appear twice.
        point: the points of `a` at these parameters.
        distance: distances from these points to `b`, between the bounds.
        lower: certified lower bounds of the distances.
        upper: certified upper bounds of the distances.
        foot: foot points on `b`.
        result: a member of RESULTS for each point.
    """

    t: Float[Array, "*batch"]
    point: Float[Array, "*batch dim"]
    distance: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    foot: Float[Array, "*batch dim"]
    result: RESULTS

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        parameters = count_text(np.size(self.distance), "parameter")
        return described(self, parameters, most_text("distances up to", self.upper))


def distance_profile(a: ShapeLike, b: ShapeLike, samples: int = 64) -> DistanceProfile:
    """Distances to `b` from points of the curve `a` at evenly spaced parameters; differentiable like `project`.

    The largest of these distances is at most the directed Hausdorff distance. Between the points nothing is certified.

    >>> import jhd
    >>> found = jhd.distance_profile(jhd.polyline([(0, 0), (2, 0)]), jhd.point_set([(0, 0)]), samples=4)
    >>> found.t.tolist(), found.distance.tolist()
    ([0.0, 0.25, 0.5, 0.75, 1.0], [0.0, 0.5, 1.0, 1.5, 2.0])

    Args:
        a: a curve, or an object that `jhd.as_shape` accepts. For a point set every point is one entry.
        b: a shape of any kind and of the same dimension, or an object that `jhd.as_shape` accepts.
        samples: number of steps along each segment of `a`, at least 1; by default 64.

    Returns:
        A DistanceProfile: parameters, points, distances with bounds, and foot points.

    Raises:
        TypeError: `a` is not a curve, or `b` is not a shape.
        ValueError: the dimensions differ, or `samples` is below 1.
    """
    curve = taken_as("a", a)
    check_curve("a", curve)
    check_whole("samples", samples, 1)
    segments = curve.segments()
    shares = np.linspace(0.0, 1.0, samples + 1) if segments.degree > 0 else np.zeros(1)
    index = np.repeat(np.arange(segments.count), len(shares))
    places = np.tile(shares, segments.count)
    point = segments.point(index, places)
    found = project(point, b, throw=False)
    ends = found.distance, found.lower, found.upper
    return DistanceProfile(jnp.asarray(index + places), point, *ends, found.foot, found.result)
