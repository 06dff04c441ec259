"""Curves: what every curve can do, and `BezierSegments`, the working form that all distances consume.

A `BezierSegments` is a union of (rational) Bezier segments of one degree. It need not be connected: outlines with
several contours, polylines and point sets (degree 0) are the same thing.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jhd.arithmetic import bernstein
from jhd.arrays import is_traced, real_array

# Ends that agree to this many ulp of the largest coordinate are one joint: conversions between curve formats and knot
# insertion leave differences of one to four.
_JOINT_ULPS = 8


class AbstractCurve(eqx.Module):
    """A curve in the plane or in space. Points are rows; parameters are scalars or arrays of any shape."""

    @abstractmethod
    def __call__(self, t: ArrayLike) -> Array:
        """Points at the parameters t: shape (*t.shape, dim)."""

    @abstractmethod
    def segments(self) -> "BezierSegments":
        """The curve as Bezier segments, the form that all distances consume."""

    @abstractmethod
    def derivative(self) -> "AbstractCurve":
        """The hodograph: the curve of the first derivatives, over the same parameter."""

    @abstractmethod
    def split(self, t: ArrayLike) -> tuple[Any, Any]:
        """The parts before and after the parameter t."""

    @abstractmethod
    def transform(self, matrix: ArrayLike, offset: ArrayLike = 0.0) -> Self:
        """The image under x -> matrix x + offset; differentiable in both."""


def check_control_points(control_points: Array, weights: Array | None, axes: tuple[str, ...]) -> None:
    """Raises ValueError unless the arrays have these axes, two or three coordinates and positive weights to match."""
    shape = control_points.shape
    if len(shape) != len(axes):
        raise ValueError(f"control_points has shape {shape}; needs ({', '.join(axes)}).")
    if 0 in shape:
        raise ValueError(f"control_points is empty: its shape is {shape}.")
    if shape[-1] not in (2, 3):
        raise ValueError(f"control_points has {shape[-1]} coordinates a point; needs 2 or 3.")
    if weights is None:
        return
    if weights.shape != shape[:-1]:
        raise ValueError(
            f"weights has {_count(weights.shape)}; control_points has {_count(shape[:-1])} points."
            if len(shape) > 2 or weights.ndim != 1
            else f"weights has {weights.shape[0]} entries; control_points has {shape[0]} points."
        )
    if is_traced(weights):
        return
    bad = np.argwhere(np.asarray(weights) <= 0)
    if bad.size:
        place = tuple(int(i) for i in bad[0])
        value = float(np.asarray(weights)[place])
        raise ValueError(f"weights[{', '.join(map(str, place))}] is not positive: {value:g}.")


def _count(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) if shape else "no axis"


class BezierSegments(AbstractCurve):
    """A union of (rational) Bezier segments of one degree, plane or space.

    Args:
        control_points: coordinates, in any unit of length; distances come in the same unit.
        weights: positive weights, or None for polynomial segments.
        following: for each segment the index of the one that starts where it ends, -1 at a free end. By default ends
            that agree within 8 ulp of the largest coordinate are joined; the next segment is preferred.

    Raises:
        ValueError: wrong number of axes, no point, other than two or three coordinates, NaN or infinity, weights that
            are not positive or do not match.
        TypeError: entries that are not real numbers.
    """

    control_points: Float[Array, "segments points dim"]
    weights: Float[Array, "segments points"] | None
    following: Int[Array, " segments"]

    def __init__(self, control_points: ArrayLike, weights: ArrayLike | None = None, following: ArrayLike | None = None):
        self.control_points = real_array("control_points", control_points)
        self.weights = None if weights is None else real_array("weights", weights)
        check_control_points(self.control_points, self.weights, ("segments", "points", "dim"))
        self.following = _joints(self.control_points) if following is None else jnp.asarray(following, dtype=int)

    @property
    def count(self) -> int:
        """Number of segments."""
        return self.control_points.shape[-3]

    @property
    def degree(self) -> int:
        """Degree of the segments."""
        return self.control_points.shape[-2] - 1

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return self.control_points.shape[-1]

    @property
    def homogeneous(self) -> Float[Array, "segments points width"]:
        """The control points times their weights, and the weights as one more coordinate where there are any."""
        if self.weights is None:
            return self.control_points
        return jnp.concatenate([self.control_points * self.weights[..., None], self.weights[..., None]], axis=-1)

    def with_homogeneous(self, homogeneous: Array, following: Array | None = None) -> "BezierSegments":
        """Segments from control points in the form of `homogeneous`, polynomial or rational as this curve is."""
        if self.weights is None:
            return BezierSegments(homogeneous, None, following)
        weights = homogeneous[..., -1]
        return BezierSegments(homogeneous[..., :-1] / weights[..., None], weights, following)

    def point(self, segment: ArrayLike, t: ArrayLike) -> Array:
        """Points of the named segments at local parameters in [0, 1]; both arrays broadcast."""
        segment, t = jnp.broadcast_arrays(jnp.asarray(segment), jnp.asarray(t, dtype=float))
        pieces = self.homogeneous[segment]
        value = bernstein.evaluate(jnp.moveaxis(pieces, -2, 0), t[..., None], axis=0)
        return value if self.weights is None else value[..., :-1] / value[..., -1:]

    def __call__(self, t: ArrayLike) -> Array:
        """Points at global parameters in [0, segments]: segment k carries [k, k + 1]."""
        t = real_array("t", t)
        segment = jnp.clip(jnp.floor(t).astype(int), 0, self.count - 1)
        return self.point(segment, t - segment)

    def segments(self) -> "BezierSegments":
        """The curve itself."""
        return self

    def derivative(self) -> "BezierSegments":
        """The hodographs of the segments, each over its own [0, 1]; rational ones have degree 2 n."""
        points, weights = hodograph(self.control_points, self.weights)
        return BezierSegments(points, weights)

    def split(self, t: ArrayLike) -> tuple["BezierSegments", "BezierSegments"]:
        """The parts before and after the global parameter t, strictly between 0 and the number of segments.

        Raises:
            ValueError: t is outside.
            TypeError: t is traced; the numbers of segments of the parts depend on it.
        """
        if is_traced(t):
            raise TypeError("split of BezierSegments needs a concrete t: the numbers of segments depend on it.")
        t = float(np.asarray(t))
        if not 0.0 < t < self.count:
            raise ValueError(f"t is {t:g}; needs 0 < t < {self.count}.")
        whole = int(t)
        h = self.homogeneous
        if t == whole:
            return self.with_homogeneous(h[:whole]), self.with_homogeneous(h[whole:])
        left, right = bernstein.split(h[whole], t - whole, axis=-2)
        first, last = jnp.concatenate([h[:whole], left[None]]), jnp.concatenate([right[None], h[whole + 1 :]])
        return self.with_homogeneous(first), self.with_homogeneous(last)

    def restrict(self, t0: ArrayLike, t1: ArrayLike) -> "BezierSegments":
        """Every segment cut to local parameters [t0, t1]; scalars, or one value a segment."""
        ends = [jnp.broadcast_to(jnp.asarray(t, dtype=float), (self.count,)) for t in (t0, t1)]
        cut = jax.vmap(lambda h, u0, u1: bernstein.restrict(h, u0, u1, axis=-2))
        return self.with_homogeneous(cut(self.homogeneous, *ends))

    def elevate(self, degree: int) -> "BezierSegments":
        """The same curve written in a higher degree."""
        return self.with_homogeneous(bernstein.elevate(self.homogeneous, degree, axis=-2), self.following)

    def reverse(self) -> "BezierSegments":
        """The same point set traversed the other way."""
        weights = None if self.weights is None else self.weights[::-1, ::-1]
        return BezierSegments(self.control_points[::-1, ::-1], weights)

    def transform(self, matrix: ArrayLike, offset: ArrayLike = 0.0) -> "BezierSegments":
        """The image under x -> matrix x + offset; differentiable in both."""
        return BezierSegments(affine_image(self.control_points, matrix, offset), self.weights)

    def pad(self, count: int) -> "BezierSegments":
        """The same point set with `count` segments: the last one is repeated, so ragged curves fit one batch.

        Raises:
            ValueError: count is below the number of segments.
        """
        if count < self.count:
            raise ValueError(f"count is {count}; the curve has {self.count} segments.")
        index = np.minimum(np.arange(count), self.count - 1)
        weights = None if self.weights is None else self.weights[index]
        return BezierSegments(self.control_points[index], weights, self.following[index])

    @staticmethod
    def join(curves: Sequence[AbstractCurve]) -> "BezierSegments":
        """The union of curves as one: degrees are raised to the largest, weights of one added where others have some.

        Raises:
            ValueError: no curve, or curves of different dimensions.
            TypeError: an entry that is not a curve.
        """
        curves = list(curves)
        if not curves:
            raise ValueError("join needs at least one curve; got none.")
        for curve in curves:
            check_curve("curves", curve)
        parts = [curve.segments() for curve in curves]
        if len({part.dim for part in parts}) > 1:
            raise ValueError(f"join needs curves of one dimension; got {[part.dim for part in parts]}.")
        degree = max(part.degree for part in parts)
        parts = [part.elevate(degree) for part in parts]
        points = jnp.concatenate([part.control_points for part in parts])
        if all(part.weights is None for part in parts):
            return BezierSegments(points)
        ones = [jnp.ones(part.control_points.shape[:-1]) if part.weights is None else part.weights for part in parts]
        return BezierSegments(points, jnp.concatenate(ones))


def check_curve(name: str, value: object) -> None:
    """Raises TypeError unless the value is a curve."""
    if not isinstance(value, AbstractCurve):
        raise TypeError(
            f"{name} must be a curve (BezierCurve, BSplineCurve, BezierSegments; see also jhd.points and jhd.polyline); "
            f"got {type(value).__name__}."
        )


def affine_image(points: Array, matrix: ArrayLike, offset: ArrayLike) -> Array:
    """Rows x of `points` mapped to matrix x + offset.

    Raises:
        ValueError: the matrix does not take points of this dimension, or the offset does not fit its result.
    """
    matrix, offset = real_array("matrix", matrix), real_array("offset", offset)
    if matrix.ndim != 2 or matrix.shape[1] != points.shape[-1]:
        raise ValueError(f"matrix has shape {matrix.shape}; needs (dim, {points.shape[-1]}).")
    if offset.ndim > 1 or offset.shape not in ((), (1,), (matrix.shape[0],)):
        raise ValueError(f"offset has shape {offset.shape}; needs ({matrix.shape[0]},).")
    # A sum of products in full precision: matrix products may run in reduced precision on accelerators.
    return jnp.sum(points[..., None, :] * matrix, axis=-1) + offset


def hodograph(control_points: Array, weights: Array | None) -> tuple[Array, Array | None]:
    """Control points and weights of the derivative of Bezier segments (..., points, dim).

    For x/w it is (x'w - xw') / w^2 with the numerator raised from degree 2 n - 2 to 2 n.
    """
    if weights is None:
        return bernstein.derivative(control_points, axis=-2), None
    n = control_points.shape[-2] - 1
    denominator = bernstein.multiply(weights, weights)
    numerator = bernstein.elevate(wronskian(control_points, weights), 2 * n, axis=-2) if n else control_points * 0.0
    return numerator / denominator[..., None], denominator


def wronskian(control_points: Array, weights: Array) -> Array:
    """Coefficients of x'w - xw' for x = w p, in degree 2 n - 2 (the leading terms of degree 2 n - 1 cancel), n >= 1.

    B_i B_j' - B_i' B_j = C(n,i) C(n,j) (j - i) s^(i+j-1) (1-s)^(2n-1-i-j), so coefficient i + j - 1 collects
    (j - i) w_i w_j (p_j - p_i) for i < j: differences of control points, no cancellation of large coordinates.
    """
    n = control_points.shape[-2] - 1
    pairs = [(i, j) for i in range(n + 1) for j in range(i + 1, n + 1)]
    i, j = (np.array(column) for column in zip(*pairs, strict=True))
    factor = np.array([(b - a) * math.comb(n, a) * math.comb(n, b) / math.comb(2 * n - 2, a + b - 1) for a, b in pairs])
    terms = (factor * weights[..., i] * weights[..., j])[..., None] * (
        control_points[..., j, :] - control_points[..., i, :]
    )
    rows = [jnp.sum(terms[..., np.flatnonzero(i + j - 1 == k), :], axis=-2) for k in range(2 * n - 1)]
    return jnp.stack(rows, axis=-2)


def _joints(control_points: Array) -> Array:
    """For each segment the one that starts where it ends: the next if it does, else the first, else itself, else -1."""
    count, points = control_points.shape[-3], control_points.shape[-2]
    if points == 1:
        return jnp.full((count,), -1)
    ends, starts = control_points[:, -1], control_points[:, 0]
    tolerance = _JOINT_ULPS * jnp.finfo(control_points.dtype).eps * jnp.max(jnp.abs(control_points))
    xp = jnp if is_traced(control_points) else np
    ends, starts, tolerance = (value if xp is jnp else np.asarray(value) for value in (ends, starts, tolerance))
    meets = xp.max(xp.abs(ends[:, None] - starts[None]), axis=-1) <= tolerance
    index = xp.arange(count)
    # Rank of each candidate: itself last, otherwise by distance along the list, so the next segment comes first.
    rank = xp.where(meets, (index[None] - index[:, None] - 1) % count, count)
    best = xp.argmin(rank, axis=-1)
    return jnp.asarray(xp.where(xp.min(rank, axis=-1) < count, best, -1))


def points(array: ArrayLike) -> BezierSegments:
    """A point set as a curve of degree 0: one segment a point.

    Args:
        array: (count, 2) or (count, 3) coordinates.

    Raises:
        ValueError: wrong shape, no point, NaN or infinity.
    """
    rows = _rows("points", array, 1)
    return BezierSegments(rows[:, None, :])


def polyline(points: ArrayLike, closed: bool = False) -> BezierSegments:
    """The straight segments that join the points in order, and the last to the first where closed.

    Args:
        points: (count, 2) or (count, 3) coordinates, at least two; or an object with `coords`, as shapely's LineString.
        closed: whether the last point is joined to the first; nothing is added where they are the same already.

    Raises:
        ValueError: wrong shape, too few points, NaN or infinity.
    """
    rows = _rows("points", getattr(points, "coords", points), 2)
    if closed and (is_traced(rows) or bool(jnp.any(rows[0] != rows[-1]))):
        rows = jnp.concatenate([rows, rows[:1]])
    return BezierSegments(jnp.stack([rows[:-1], rows[1:]], axis=1))


def _rows(name: str, value: object, least: int) -> Array:
    rows = real_array(name, value)
    if rows.ndim != 2 or rows.shape[-1] not in (2, 3):
        raise ValueError(f"{name} has shape {rows.shape}; needs (points, 2) or (points, 3).")
    if rows.shape[0] < least:
        raise ValueError(f"{name} has {rows.shape[0]} points; needs at least {least}.")
    return rows


def circle(centre: ArrayLike, radius: ArrayLike) -> BezierSegments:
    """A circle as four rational quadratic quarters, counter-clockwise from angle 0.

    The weights 1, sqrt(1/2), 1 are rounded, so the stored curve leaves the true circle by about an ulp of the radius.

    Args:
        centre: (2,) coordinates.
        radius: positive length.

    Raises:
        ValueError: wrong shape, NaN or infinity, a radius that is not positive.
    """
    centre, radius = real_array("centre", centre), real_array("radius", radius)
    if centre.shape != (2,):
        raise ValueError(f"centre has shape {centre.shape}; needs (2,).")
    if radius.shape != ():
        raise ValueError(f"radius has shape {radius.shape}; needs a scalar.")
    if not is_traced(radius) and float(radius) <= 0:
        raise ValueError(f"radius is not positive: {float(radius):g}.")
    corners = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], dtype=float)
    quarters = np.stack([corners[2 * k : 2 * k + 3] for k in range(4)])
    weights = jnp.broadcast_to(jnp.array([1.0, math.sqrt(0.5), 1.0]), (4, 3))
    return BezierSegments(centre + radius * quarters, weights, np.array([1, 2, 3, 0]))
