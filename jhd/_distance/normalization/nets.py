"""A pair of parametric shapes as nets of control points in common coordinates.

The exact distance refers to the stored arrays; `jhd._distance.normalization.curves.preparation_error` bounds the error
of moving them to the origin and of raising the degree of curves.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jhd._arithmetic.scaling import unit_weights
from jhd._distance.normalization.coordinates import Frame, common_points, extremes, frame_of
from jhd._distance.normalization.curves import (
    elevation_matrix,
    padded_count,
    preparation_error,
    raised,
    raised_degree,
)
from jhd._distance.normalization.net_jets import Net, usable_net
from jhd._runtime.arrays import is_traced, on_host
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch
from jhd._shapes.prepared import working


def net_of(shape: AbstractCurve | AbstractPatch | TriangleMesh) -> Net:
    """Return the control points (pieces, rows, columns, dim) and weights of a shape, its largest weight in [1/2, 1).

    Curves have one column. A triangle becomes a bilinear patch with a side that is a single point: exactly the same set
    of points.
    """
    if isinstance(shape, TriangleMesh):
        return Net(shape.corners[:, np.array([[0, 1], [0, 2]])], None)
    pieces = working(shape)
    points, weights = on_host(pieces.control_points, pieces.weights)
    if isinstance(shape, AbstractCurve):
        points, weights = points[:, :, None], None if weights is None else weights[:, :, None]
    return Net(points, None if weights is None else unit_weights(weights, (1, 2)))


def hull_of(points: Any) -> Net:
    """Return the least and the largest coordinates of points (..., dim), as a net that replaces them in a frame."""
    ends: Any = np.stack(extremes(np.asarray(points)))[:, None, None]
    return Net(ends, None)


def prepare_nets(a: Net, b: Net) -> tuple[Net, Net, Frame, float]:
    """Return both with coordinates in [-1, 1] about the origin, the frame that leads back, and a bound of the error.

    On concrete shapes this runs in NumPy, which keeps subnormals.
    """
    traced = is_traced(a, b)
    xp = jnp if traced else np
    good = usable_net(a) & usable_net(b) if traced else True
    points = [xp.asarray(net.points) for net in (a, b)]
    points = [jnp.where(good, x, 0.0) for x in points] if traced else points
    frame = frame_of([extremes(x) for x in points], good)
    nets = [_bucketed(xp, common_points(frame, x), net.weights, good) for x, net in zip(points, (a, b), strict=True)]
    error = sum(preparation_error(max(net.degrees), net.dim, net.points.dtype) for net in nets)
    return nets[0], nets[1], frame, float(error)


def _bucketed(xp: Any, points: Any, weights: Any, good: Any) -> Net:
    """Return the net with curves raised to a compiled degree, and pieces repeated up to a compiled number."""
    if weights is not None:
        weights = xp.asarray(weights)
        weights = xp.where(good, weights, 1.0) if is_traced(good) else weights
    degree = points.shape[1] - 1
    target = raised_degree(degree)
    if points.shape[2] == 1 and target > degree:
        raising = elevation_matrix(degree, target).astype(points.dtype)
        points, weights = raised(raising, points[:, :, 0], None if weights is None else weights[:, :, 0])
        points, weights = points[:, :, None], None if weights is None else weights[:, :, None]
    return repeated(Net(points, weights))


def repeated(pieces: Any) -> Any:
    """Return a net or triangles, with the last piece repeated up to a number of pieces that is compiled."""
    count = pieces[0].shape[0]
    return pieces.piece(np.minimum(np.arange(padded_count(count, small=is_traced(pieces[0]))), count - 1))
