"""Polynomials of two points on two curves, as Bernstein coefficients on boxes, with bounds of their rounding errors.

With h(t, s) = 2 A(t).B(s) - |B(s)|^2 the squared distance is |A|^2 - h, and a foot is where h_s / 2 = (A - B).B' = 0.
Everything runs in NumPy: the arrays are short in all but the last axis, which counts boxes, and nothing has to be
compiled for a degree or size.

Rounding. Coordinates are at most one, and an operation errs by u = 2^-53 (NumPy rounds to nearest; subnormals stay).
Restricted control points are off by gamma(9 n) each (`jhd._arithmetic.polynomial_roots`), relative to an origin by
eta = gamma(9 n + 4); control points of the velocity by gamma(9 n) V with V its largest coordinate on the segment. With
D and w the largest coordinates of the pieces of a and b about the origin, the products of two sums:

 - h is off by at most 8 eta (D + w) for the points and gamma(2 n + 8) (4 D w + 2 w^2) <= gamma(16 n + 64) (D + w) for
   the products, their sums with weights that sum to one, and the difference: gamma(88 n + 104) (D + w);
 - (A - B).B' by 2 (D + w) gamma(9 n) V + 4 eta V for its factors and 2 gamma(2 n + 8) (D + w) V for the products:
   gamma(40 n + 60) (1 + D + w) V.

Differences of coefficients of order k err by 2^k times that, and averages of them no more.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import product_weights
from jhd._arithmetic.rounding import gamma
from jhd._distance.normalization.curves import elevation_matrix

# Tangents that differ by more than this angle (radians) make a joint of b a corner; below, feet at the joint count as
# feet of both segments, within four times the angle.
CORNER_ANGLE = 1e-9


class Curve(NamedTuple):
    """A curve of the systems: control points (points, 2, segments), the last of which may be single points.

    Args:
        points: control points.
        velocity: control points of the derivatives (points - 1, 2, segments).
        speed: their largest coordinate, (segments,).
        moving: number of segments that are no points.
        next_segment: the segment that continues smoothly at the end of each, -1 if there is none.
        start_of: for each segment that is a point, the segment that starts there, else -1.
        end_of: for each segment that is a point, the segment that ends there, else -1.
    """

    points: np.ndarray
    velocity: np.ndarray
    speed: np.ndarray
    moving: int
    next_segment: np.ndarray
    start_of: np.ndarray
    end_of: np.ndarray


def restricted(c: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Return the control points (points, 2, boxes) on [t0, t1], in two passes, see `polynomial_roots._restrict`."""
    c, n, (t0, t1) = c.copy(), len(c) - 1, side
    inner = t0 < 1
    v = np.where(inner, (t1 - t0) / np.where(inner, 1 - t0, 1.0), 0.0)
    for level in range(n):
        c[: n - level] = (1 - t0) * c[: n - level] + t0 * c[1 : n - level + 1]
    for level in range(n):
        c[level + 1 :] = (1 - v) * c[level:-1] + v * c[level + 1 :]
    return c


class EventForm(NamedTuple):
    """Coefficients of h on a box, (n + 1, 2 n + 1, boxes), and a bound of their errors."""

    c: np.ndarray
    error: np.ndarray


@cache
def _square_map(n: int) -> np.ndarray:
    """Return the (2 n + 1, (n + 1)^2) matrix from products of coefficients to the coefficients of a square."""
    weights, index = product_weights(n, n), np.add.outer(np.arange(n + 1), np.arange(n + 1))
    return (index.ravel() == np.arange(2 * n + 1)[:, None]) * weights.ravel()


def h_form(a: np.ndarray, b: np.ndarray) -> EventForm:
    """Return 2 A.B - |B|^2 for pieces relative to an origin near b."""
    n, boxes = len(a) - 1, a.shape[-1]
    raised = (elevation_matrix(n, 2 * n) @ b.reshape(n + 1, -1)).reshape(2 * n + 1, 2, boxes)
    squares = b[:, None, 0] * b[None, :, 0] + b[:, None, 1] * b[None, :, 1]
    square = _square_map(n) @ squares.reshape(-1, boxes)
    c = 2 * (a[:, None, 0] * raised[None, :, 0] + a[:, None, 1] * raised[None, :, 1]) - square
    size = np.max(np.abs(a), axis=(0, 1)) + np.max(np.abs(b), axis=(0, 1))
    return EventForm(c, gamma(88 * n + 104, np.float64) * size)


class EventPiece(NamedTuple):
    """A part of a segment: control points (n + 1, 2, boxes), those for velocity (n, 2, boxes), largest velocity."""

    points: np.ndarray
    velocity: np.ndarray
    speed: np.ndarray

    def about(self, origin: np.ndarray) -> "EventPiece":
        """Return the part relative to an origin."""
        return self._replace(points=self.points - origin)


def piece_of(curve: Curve, segment: np.ndarray, side: np.ndarray) -> EventPiece:
    """Return the parts of these segments."""
    velocity = curve.velocity[..., segment]
    return EventPiece(restricted(curve.points[..., segment], side), restricted(velocity, side), curve.speed[segment])


@cache
def _product_map(n: int) -> np.ndarray:
    """Return the (2 n, (n + 1) n) matrix that sums products of coefficients of degrees n and n - 1."""
    weights, index = product_weights(n, n - 1), np.add.outer(np.arange(n + 1), np.arange(n))
    return (index.ravel() == np.arange(2 * n)[:, None]) * weights.ravel()


def foot_form(a: np.ndarray, b: EventPiece, side: np.ndarray | None = None) -> EventForm:
    """Return (A - B).B' = h_s / 2 for pieces relative to an origin near b, (n + 1, 2 n, boxes).

    `side` is the part of the segment of b: at an end of the whole segment, a foot in a joint whose tangents differ by
    an angle below `CORNER_ANGLE` leaves |A - B| |B'| times that angle.
    """
    n, boxes = len(a) - 1, a.shape[-1]
    raised = (elevation_matrix(n - 1, 2 * n - 1) @ b.velocity.reshape(n, -1)).reshape(2 * n, 2, boxes)
    products = b.points[:, None, 0] * b.velocity[None, :, 0] + b.points[:, None, 1] * b.velocity[None, :, 1]
    own = _product_map(n) @ products.reshape(-1, boxes)
    c = a[:, None, 0] * raised[None, :, 0] + a[:, None, 1] * raised[None, :, 1] - own
    reach = np.max(np.abs(a), axis=(0, 1)) + np.max(np.abs(b.points), axis=(0, 1))
    error = gamma(40 * n + 60, np.float64) * (1 + reach) * b.speed
    if side is not None:
        at_joint = (side[0] == 0) | (side[1] == 1)
        error = error + np.where(at_joint, 16 * CORNER_ANGLE * reach * np.abs(b.velocity).max((0, 1)), 0.0)
    return EventForm(c, error)


def may_vanish(form: EventForm) -> np.ndarray:
    """Return whether the coefficients allow a root."""
    axes = tuple(range(form.c.ndim - 1))
    return (form.c.min(axes) <= form.error) & (form.c.max(axes) >= -form.error)


def mean_slope(c: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean difference of the last and the first coefficients along an axis."""
    other = tuple(k for k in range(c.ndim - 2))
    return (np.take(c, -1, axis) - np.take(c, 0, axis)).mean(other)


def ramp(count: int, axis: int, variables: int) -> np.ndarray:
    """Return the coefficients of one variable itself, to be broadcast over the others."""
    shape = [1] * (variables + 1)
    shape[axis] = count
    return np.linspace(0.0, 1.0, count).reshape(shape)


def bounds(rest: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the range of a remainder formed with three roundings, of terms at most three times its coefficients."""
    axes = tuple(range(rest.ndim - 1))
    low, high = rest.min(axes), rest.max(axes)
    error = error + 1e-14 * np.maximum(np.abs(low), np.abs(high))
    return low - error, high + error


def cut_by(side: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the part of a side on which slope x + rest = 0 for some rest in [low, high]."""
    steep = np.abs(slope) > 1e-200
    safe = np.where(steep, slope, 1.0)
    # An overflowing quotient is no bound: infinity.
    with np.errstate(over="ignore"):
        first, last = -low / safe, -high / safe
    below = np.where(steep, np.minimum(first, last), -np.inf)
    above = np.where(steep, np.maximum(first, last), np.inf)
    return np.stack([np.maximum(side[0], below), np.minimum(side[1], above)])


def linear_cut(side: np.ndarray, form: EventForm, axis: int) -> np.ndarray:
    """Cut the side of one variable by one equation, over all values of the others."""
    slope = mean_slope(form.c, axis)
    size = 1e-14 * np.abs(slope)
    rest = form.c - ramp(form.c.shape[axis], axis, form.c.ndim - 1) * slope
    return cut_by(side, slope, *bounds(rest, form.error + size))


def extent(piece: np.ndarray) -> np.ndarray:
    """Return the largest side of the box of the control points."""
    return (piece.max(0) - piece.min(0)).max(0)


def hull_distances(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bound all distances between two pieces, (points, 2, boxes), by their hulls, rounding included.

    From below, the gap of the projections on the line of the centers; from above, the farthest two control points.
    """
    between = a.mean(0) - b.mean(0)
    length = np.hypot(*between)
    unit = between / np.where(length > 0, length, 1.0)
    gap = (a * unit).sum(1).min(0) - (b * unit).sum(1).max(0)
    offsets = a[:, None] - b[None]
    far = np.sqrt((offsets**2).sum(2).max((0, 1)))
    slack = gamma(9 * len(a) + 24, np.float64) * 8
    return np.maximum(gap - slack, 0.0), far + slack


def unwanted(distances: tuple[np.ndarray, np.ndarray], wanted: np.ndarray) -> np.ndarray:
    """Return which boxes have no distance in the interval that matters."""
    return (distances[1] < wanted[0]) | (distances[0] > wanted[1])
