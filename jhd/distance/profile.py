"""The distance to a shape along a curve, as arrays."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._results.display import count_text, described, most_text, opaque
from jhd._runtime.arrays import check_whole
from jhd.distance.project import project
from jhd.shapes.as_shape import taken_as
from jhd.shapes.curve import check_curve


class Profile(NamedTuple):
    """Distances from places along a curve, in the order of the curve.

    Args:
        t: parameters of a.segments(): segment k carries [k, k + 1], and joints come twice.
        point: the places.
        distance: from there to the other shape, between the bounds.
        lower: proven lower bounds of it.
        upper: proven upper bounds.
        foot: nearest points of the other shape.
    """

    t: Float[Array, " places"]
    point: Float[Array, "places dim"]
    distance: Float[Array, " places"]
    lower: Float[Array, " places"]
    upper: Float[Array, " places"]
    foot: Float[Array, "places dim"]

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        places = count_text(self.distance.shape[-1], "place")
        return described(self, places, most_text("distances up to", self.upper))


def profile(a: Any, b: Any, samples: int = 64) -> Profile:
    """The distance to b along the curve a at evenly spaced parameters, differentiable as that of `project` is.

    Its largest value is at most the directed Hausdorff distance; between the places nothing is said.

    >>> import jhd
    >>> found = profile(jhd.polyline([(0, 0), (2, 0)]), jhd.points([(0, 0)]), samples=4)
    >>> found.t.tolist(), found.distance.tolist()
    ([0.0, 0.25, 0.5, 0.75, 1.0], [0.0, 0.5, 1.0, 1.5, 2.0])

    Args:
        a: a curve, or what jhd.as_shape takes for one; of points each is one place.
        b: any shape of the same dimension.
        samples: steps along each segment of a.

    Raises:
        TypeError: a that is no curve, or b that is no shape.
        ValueError: shapes of different dimensions, or samples below 1.
    """
    a = taken_as("a", a)
    check_curve("a", a)
    check_whole("samples", samples, 1)
    segments = a.segments()
    shares = np.linspace(0.0, 1.0, samples + 1) if segments.degree > 0 else np.zeros(1)
    index = np.repeat(np.arange(segments.count), len(shares))
    places = np.tile(shares, segments.count)
    point = segments.point(index, places)
    found = project(point, b, throw=False)
    return Profile(jnp.asarray(index + places), point, found.distance, found.lower, found.upper, found.foot)
