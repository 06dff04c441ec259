"""A pair of parametric shapes in common coordinates, and the nearest pair of points as a function of both.

The exact distance is that of the stored arrays; `jhd.distance.frame.curves.preparation_error` bounds what moving them
to the origin and raising the degree of curves does.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array

from jhd.arithmetic.scaling import unit_weights
from jhd.arrays import is_traced
from jhd.compiled import compiled
from jhd.distance.cells.pairs import BestPair, derivatives, length, newton_step
from jhd.distance.frame.attach import attached
from jhd.distance.frame.coordinates import Frame, common_points, extremes, frame_of
from jhd.distance.frame.curves import elevation_matrix, padded_count, preparation_error, raised_degree
from jhd.distance.frame.net_jets import Net, NetJet, jet, usable_net
from jhd.distance.nearest.feet import presses
from jhd.shapes.curve import AbstractCurve
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch
from jhd.solution import MinimumSolution

_POLISH = 16
_NEWTON = optx.Newton(rtol=1e-14, atol=1e-14)


def net_of(shape: AbstractCurve | AbstractPatch | TriangleMesh) -> Net:
    """Control points (pieces, rows, columns, dim) and weights of a shape, the largest of a piece in [1/2, 1).

    Curves have one column.
    A triangle is the bilinear patch of which one side is a single point: the same set of points, exactly.
    """
    if isinstance(shape, TriangleMesh):
        return Net(shape.corners[:, np.array([[0, 1], [0, 2]])], None)
    if isinstance(shape, AbstractCurve):
        segments = shape.segments()
        weights = None if segments.weights is None else unit_weights(segments.weights[:, :, None], (1, 2))
        return Net(segments.control_points[:, :, None], weights)
    patches = shape.patches()
    weights = None if patches.weights is None else unit_weights(patches.weights, (1, 2))
    return Net(patches.control_points, weights)


def prepared(a: Net, b: Net) -> tuple[Net, Net, Frame, float]:
    """Both with coordinates in [-1, 1] about the origin, the frame that leads back, and a bound of the error made.

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
    """The net with curves raised to a degree that programs are compiled for, and pieces repeated to such a number."""
    index = np.minimum(np.arange(padded_count(points.shape[0])), points.shape[0] - 1)
    if weights is not None:
        weights = xp.asarray(weights)
        weights = xp.where(good, weights, 1.0) if is_traced(good) else weights
    degree = points.shape[1] - 1
    target = raised_degree(degree)
    if points.shape[2] == 1 and target > degree:
        raising = elevation_matrix(degree, target).astype(points.dtype)[:, :, None, None]
        rows = points if weights is None else points * weights[..., None]
        points = xp.sum(raising * rows[:, None], axis=2)
        if weights is not None:
            weights = xp.sum(raising[..., 0] * weights[:, None], axis=2)
            points = points / weights[..., None]
    return Net(points[index], None if weights is None else weights[index])


def polished(a: Net, b: Net, best: BestPair) -> BestPair:
    """The nearest pair moved to where the distance is stationary, parameters at a border held; else as it was."""
    n = a.parameters
    pieces = a.piece(best.piece_a), b.piece(best.piece_b)
    held = _held(*pieces, best.x)

    def residual(x: Array, args: Any) -> Array:
        (a, b), start, held = args
        return jnp.where(held, x - start, derivatives(*_jets(a, b, x))[1])

    found = optx.root_find(residual, _NEWTON, best.x, (pieces, best.x, held), max_steps=_POLISH, throw=False).value
    x = jnp.clip(jnp.where(jnp.isfinite(found), found, best.x), 0.0, 1.0)
    distances = jnp.stack([length(jet(pieces[0], x[:n]).point - jet(pieces[1], x[n:]).point) for x in (x, best.x)])
    x = jnp.where(distances[0] <= distances[1], x, best.x)
    return best._replace(x=x, distance=jnp.min(distances))


def _jets(a: Net, b: Net, x: Array) -> tuple[NetJet, NetJet]:
    return jet(a, x[: a.parameters]), jet(b, x[a.parameters :])


def _held(a: Net, b: Net, x: Array) -> Array:
    """Which parameters are kept at the border of their piece by the slope of the distance."""
    p, q = _jets(a, b, x)
    slope = derivatives(p, q)[1]
    return presses(x, slope, jnp.sum(jnp.abs(jnp.concatenate([p.first, q.first])), axis=-1))


def with_net_derivatives(solution: MinimumSolution, a: Net, b: Net, frame: Frame, best: BestPair) -> MinimumSolution:
    """The solution with its derivatives in both shapes, in the user's coordinates.

    At fixed parameters the derivative of the distance is that of the minimum (the envelope theorem); two steps of
    Newton's method on the parameters that are not held carry the second derivatives, and those of the points. At
    distance zero the derivatives are zero by convention.
    """
    if not is_traced(a, b):
        return solution
    distance, point_a, point_b = _moving(a, b, frame, jax.lax.stop_gradient(best))
    return attached(solution, solution.value > 0, value=distance, point_a=point_a, point_b=point_b)


@compiled
def _moving(a: Net, b: Net, frame: Frame, best: BestPair) -> tuple[Array, Array, Array]:
    """Distance and nearest points as functions of both shapes."""
    n = a.parameters

    def piece(net: Net, k: Array) -> Net:
        return Net(frame.moved(net.points[k]), None if net.weights is None else net.weights[k])

    pieces = piece(a, best.piece_a), piece(b, best.piece_b)
    x, held = jax.lax.stop_gradient((best.x, _held(*pieces, best.x)))
    for _ in range(2):
        _, slope, bent = derivatives(*_jets(*pieces, x))
        step = newton_step(slope, bent, held)
        x = x + jnp.where(jnp.all(jnp.isfinite(step)), step, 0.0)
    p, q = jet(pieces[0], x[:n]).point, jet(pieces[1], x[n:]).point
    square, scale = jnp.sum((p - q) ** 2), frame.scale(p.dtype)
    distance = jnp.sqrt(jnp.where(square > 0, square, 1.0))
    return jnp.where(square > 0, distance, 0.0) / scale, p / scale, q / scale
