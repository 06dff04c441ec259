"""Simple curves from numbers: point sets, polylines and circles."""

import math

import numpy as np
from jaxtyping import Array

from jhd._runtime.arrays import is_traced, module_of, on_host, real_array
from jhd._shapes.checks import Numbers
from jhd._shapes.curve import BezierSegments
from jhd._shapes.foreign import HasCoords


def point_set(array: Numbers) -> BezierSegments:
    """A point set as a curve of degree 0, with one segment per point.

    >>> import jhd
    >>> jhd.point_set([[0, 0], [3, 4]])
    BezierSegments(2 points, in the plane, box (0, 0) to (3, 4))

    Args:
        array: (count, 2) or (count, 3) coordinates, in any unit of length.

    Returns:
        The points in the given order.

    Raises:
        ValueError: wrong shape, no point, NaN or infinity.
    """
    (rows,) = on_host(_rows("points", array, 1))
    return BezierSegments(rows[:, None, :])


def polyline(points: Numbers | HasCoords, closed: bool = False) -> BezierSegments:
    """The straight segments that join consecutive points; a closed polyline also joins the last point to the first.

    >>> import jhd
    >>> jhd.polyline([[0, 0], [1, 0], [1, 1]], closed=True).count
    3

    Args:
        points: (count, 2) or (count, 3) coordinates of at least two points, in any unit of length; or an object with
            `coords`, for example a shapely LineString.
        closed: whether to join the last point to the first. Nothing is added if both already agree.

    Returns:
        Segments of degree 1 in the given order.

    Raises:
        ValueError: wrong shape, fewer than two points, NaN or infinity.
    """
    (rows,) = on_host(_rows("points", getattr(points, "coords", points), 2))
    xp = module_of(rows)
    if closed and (is_traced(rows) or bool(np.any(rows[0] != rows[-1]))):
        rows = xp.concatenate([rows, rows[:1]])
    return BezierSegments(xp.stack([rows[:-1], rows[1:]], axis=1))


def _rows(name: str, value: object, least: int) -> Array:
    rows = real_array(name, value)
    if rows.ndim != 2 or rows.shape[-1] not in (2, 3):
        turned = " Points are rows: pass its transpose?" if rows.ndim == 2 and rows.shape[0] in (2, 3) else ""
        raise ValueError(f"{name} has shape {rows.shape}; needs (points, 2) or (points, 3).{turned}")
    if rows.shape[0] < least:
        raise ValueError(f"{name} has {rows.shape[0]} points; needs at least {least}.")
    return rows


def circle(center: Numbers, radius: Numbers) -> BezierSegments:
    """A circle as four rational quadratic quarters, counter-clockwise from angle 0.

    The weights 1, sqrt(1/2), 1 are rounded, so the stored curve leaves the true circle by about an ulp of the radius.

    >>> import jhd
    >>> jhd.circle([0, 0], 2).control_points[0].tolist()
    [[2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]

    Args:
        center: (2,) coordinates of the center, in any unit of length.
        radius: positive radius, in the unit of the center.

    Returns:
        A closed curve of four segments.

    Raises:
        ValueError: wrong shape, NaN or infinity, or a radius that is not positive.
    """
    center, radius = real_array("center", center), real_array("radius", radius)
    if center.shape != (2,):
        raise ValueError(f"center has shape {center.shape}; needs (2,).")
    if radius.shape != ():
        raise ValueError(f"radius has shape {radius.shape}; needs a scalar.")
    if not is_traced(radius) and float(radius) <= 0:
        raise ValueError(f"radius is not positive: {float(radius):g}.")
    corners = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], dtype=float)
    quarters = np.stack([corners[2 * k : 2 * k + 3] for k in range(4)])
    weights = np.broadcast_to([1.0, math.sqrt(0.5), 1.0], (4, 3))
    middle, length = on_host(center, radius)
    return BezierSegments(middle + length * quarters, weights, np.array([1, 2, 3, 0]))
