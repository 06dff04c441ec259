"""Parametric surfaces for several experiments, and distances estimated by samples and a k-d tree."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from common import Run
from scipy.spatial import KDTree

import jhd
from jhd._plot.nets import quadrilaterals

# Largest number of samples in a smoke run: each number of samples is compiled for separately.
_SMOKE_SAMPLES = 1000
# Weight of the middle control points of a quarter circle; the full circle as four quarters, with weights.
_HALF = np.sqrt(0.5)
_CIRCLE = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], float)
_CIRCLE_WEIGHTS = np.array([1, _HALF] * 4 + [1])
_CIRCLE_KNOTS = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], float)


def wavy_net(n: int) -> np.ndarray:
    """Return the control points of a sheet of n x n bicubic patches with unequal waves, over about the unit square."""
    x, y = np.meshgrid(*[(np.arange(n + 3) - 1) / n] * 2, indexing="ij")
    return np.stack([x, y, 0.15 * np.sin(4 * x + 1) * np.cos(3 * y) + 0.08 * np.sin(7 * x * y)], axis=-1)


def bicubic(net: np.ndarray) -> jhd.BSplineSurface:
    """Return the uniform bicubic B-spline surface of a net."""
    return jhd.BSplineSurface(net, *(np.arange(count + 4.0) for count in net.shape[:2]))


def turned(offset: float = 0.0, bulge: float = 0.0) -> jhd.BSplineSurface:
    """Return a rational torus about z: circles of radius 0.35 + offset about the unit circle, 16 patches of degree 2.

    If bulge is not 0, the circle about the axis becomes an ellipse that is longer by this fraction along x.
    """
    section = np.array([1.0, 0.0]) + (0.35 + offset) * _CIRCLE
    net = np.empty((9, 9, 3))
    net[..., :2] = _CIRCLE[:, None] * section[None, :, :1] * [1 + bulge, 1.0]
    net[..., 2] = section[:, 1]
    weights = _CIRCLE_WEIGHTS[:, None] * _CIRCLE_WEIGHTS
    return jhd.BSplineSurface(net, _CIRCLE_KNOTS, _CIRCLE_KNOTS, weights)


def diagonal(*shapes: Any) -> float:
    """Return the diagonal of the joint bounding box of all control points, vertices and boxes."""
    ends = np.array([[np.asarray(end) for end in shape.bounds] for shape in shapes])
    return float(np.linalg.norm(ends[:, 1].max(axis=0) - ends[:, 0].min(axis=0)))


def samples(shape: Any, count: int) -> np.ndarray:
    """Return about `count` points of a shape: even parameters, or for an implicit surface points near it on a grid."""
    if isinstance(shape, jhd.TriangleMesh):
        return _of_mesh(shape, count)
    if isinstance(shape, jhd.ImplicitSurface):
        # The surface meets about twice as many cells as the square of the cells along an axis.
        return quadrilaterals(shape, max(int(np.sqrt(count / 2)), 4))[:, 0]
    if hasattr(shape, "segments"):
        pieces = shape.segments()
        if pieces.degree == 0:
            return np.asarray(pieces.control_points)[:, 0]
        t = np.linspace(0, 1, max(count // pieces.count, 2))
        return np.asarray(pieces.point(np.arange(pieces.count)[:, None], t)).reshape(-1, pieces.dim)
    patches = shape.patches()
    t = np.linspace(0, 1, max(int(np.sqrt(count / patches.count)), 2))
    return np.asarray(patches.point(np.arange(patches.count)[:, None, None], t[:, None], t)).reshape(-1, 3)


def _of_mesh(mesh: jhd.TriangleMesh, count: int) -> np.ndarray:
    """Return corners and points inside the triangles, equally many in each."""
    corners = np.asarray(mesh.corners)
    n = max(int(np.sqrt(2 * count / len(corners))), 1)
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    inside = i + j <= n
    u, v = i[inside] / n, j[inside] / n
    shares = np.stack([1 - u - v, u, v], axis=-1)
    return np.einsum("pc,tcd->tpd", shares, corners).reshape(-1, 3)


def sampled_directed(a: Any, b: Any, count: int) -> float:
    """Largest distance from samples of a to samples of b; it is no bound of the distance from a to b."""
    return float(np.max(KDTree(samples(b, count)).query(samples(a, count))[0]))


def sampled(a: Any, b: Any, count: int) -> float:
    """Estimate the two-sided distance by samples; it is no bound."""
    p, q = samples(a, count), samples(b, count)
    return float(max(np.max(KDTree(y).query(x)[0]) for x, y in ((p, q), (q, p))))


def cpu(action: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of an action and the CPU seconds of this process that it took."""
    start = time.process_time()
    value = action()
    return value, time.process_time() - start


def beside(run: Run, action: Callable[[int], float], seconds: float, most: int = 1_000_000) -> dict[str, Any]:
    """Double the number of samples until they take `seconds`; return the last value, its time and its number."""
    count, most = 1000, _SMOKE_SAMPLES if run.smoke else most
    while True:
        value, taken = cpu(partial(action, count))
        if taken >= seconds or 2 * count > most:
            return {"value": value, "seconds": taken, "samples": count}
        count *= 2


def stored(shape: Any) -> dict[str, Any]:
    """Return the numbers from which a figure rebuilds a shape."""
    if isinstance(shape, jhd.TriangleMesh):
        return {"vertices": shape.vertices, "triangles": shape.triangles}
    if isinstance(shape, jhd.ImplicitSurface):
        return {"coefficients": shape.coefficients, "lower": shape.lower, "upper": shape.upper}
    pieces = shape.segments() if hasattr(shape, "segments") else shape.patches()
    return {"control_points": pieces.control_points, "weights": pieces.weights}
