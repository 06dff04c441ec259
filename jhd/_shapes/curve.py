"""Curves: the interface that all curves offer, and `BezierSegments`, the working form of all distances.

A `BezierSegments` is a union of (rational) Bezier segments of one degree. It need not be connected: outlines with
several contours, polylines and point sets (degree 0) all have this form.
"""

import dataclasses
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from jhd._results.display import batch_text, count_text, described, is_known, net_text, opaque
from jhd._runtime.arrays import array_of, is_traced, module_of, on_host, real_array
from jhd._shapes import convert, sketches
from jhd._shapes.approximation import Approximation, checked_tolerance
from jhd._shapes.checks import Numbers, check_degrees, checked_between, checked_net, checked_parameter
from jhd._shapes.flattening import flattened, pieces_following
from jhd._shapes.foreign import HasVertices, ShapelyGeometry
from jhd._shapes.homogeneous import affine_image, cartesian, cut, elevate, evaluate, hodograph, homogeneous, restrict
from jhd._shapes.joints import checked, completed, followed, joints, linked, turned, united
from jhd._shapes.sizes import AbstractHasLength

SomeCurve = TypeVar("SomeCurve", bound="AbstractCurve")


class AbstractCurve(AbstractHasLength):
    """A curve in the plane or in space. Points are rows; parameters are scalars or arrays of any shape."""

    control_points: eqx.AbstractVar[Array]
    weights: eqx.AbstractVar[Array | None]

    @abstractmethod
    def __call__(self, t: Numbers) -> Array:
        """Points at the parameters t: shape (*t.shape, dim)."""

    @abstractmethod
    def segments(self) -> "BezierSegments":
        """The curve as Bezier segments, the working form of all distances."""

    @abstractmethod
    def derivative(self) -> "AbstractCurve":
        """The hodograph: the curve of the first derivatives, over the same parameter."""

    @abstractmethod
    def split(self, t: Numbers) -> "tuple[AbstractCurve, AbstractCurve]":
        """The two parts of the curve, before and after the parameter t."""

    @abstractmethod
    def reverse(self) -> "AbstractCurve":
        """The curve, traversed in the opposite direction."""

    @abstractmethod
    def elevate(self, degree: int) -> "AbstractCurve":
        """The same curve in a higher degree.

        Args:
            degree: the new degree, at least the degree of the curve.

        Returns:
            A curve with the same points at the same parameters.
        """

    @abstractmethod
    def _summary(self) -> str:
        """Degree and counts, for the curve as it is printed."""

    def __repr__(self) -> str:
        return opaque(self) or described(self, self._summary(), net_text(self.control_points, self.weights))

    def _repr_svg_(self) -> str | None:
        """The curve as notebooks show it; None for a batch and for unknown numbers."""
        axes = 3 if isinstance(self, BezierSegments) else 2
        if opaque(self) or not is_known(self.control_points) or self.control_points.ndim != axes:
            return None
        found = self.segments()
        weights = None if found.weights is None else np.asarray(found.weights)
        lines = sketches.along(np.asarray(found.control_points), weights)
        return sketches.svg(lines, repr(self), dots=found.degree == 0)

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return self.control_points.shape[-1]

    def transform(self: SomeCurve, matrix: Numbers, offset: Numbers = 0.0) -> SomeCurve:
        """The image under x -> matrix x + offset, of the same class; differentiable in both. Joints are kept.

        Args:
            matrix: (new_dim, dim) real numbers, with new_dim 2 or 3.
            offset: (new_dim,) translation in the unit of the coordinates, or one number for all axes.

        Returns:
            A curve of the same class, in new_dim dimensions.

        Raises:
            ValueError: wrong shapes, NaN or infinity.
        """
        return self._with_points(affine_image(self.control_points, matrix, offset))

    def _with_points(self: SomeCurve, points: Array) -> SomeCurve:
        return dataclasses.replace(self, control_points=points)

    def to_polyline(self, tolerance: Numbers, *, max_segments: int = 1_000_000) -> "Approximation[BezierSegments]":
        """A polyline through points of the curve, with a certified deviation of at most `tolerance` in both directions.

        Segments are halved until each part is close enough, so their number grows like 1 / sqrt(tolerance). Joints and
        closed contours are kept. The distance between two polylines differs from the distance between their curves by
        at most the sum of both deviations.

        >>> import jhd
        >>> found = jhd.circle([0, 0], 1).to_polyline(0.05)
        >>> found.shape.count, found.deviation < 0.05
        (16, True)

        Args:
            tolerance: largest deviation allowed in either direction, a positive length in the unit of the coordinates.
            max_segments: largest number of segments to produce; more raise ValueError.

        Returns:
            An Approximation: the polyline as `shape`, and `deviation`, a bound of its Hausdorff distance to the curve.

        Raises:
            ValueError: `tolerance` is not positive, is below the rounding of the coordinates or needs more than
                `max_segments` segments; or the curve is a point set.
            TypeError: the curve is traced; the number of segments depends on its numbers.
        """
        return _approximated(self, 1, tolerance, max_segments)

    def to_cubics(self, tolerance: Numbers, *, max_segments: int = 1_000_000) -> "Approximation[BezierSegments]":
        """Polynomial cubics that approximate the curve within `tolerance`, with the ends and tangents of its parts.

        The number of cubics grows like (1 / tolerance)^(1/4), and like (1 / tolerance)^(1/6) for arcs of circles and
        ellipses. Polynomial segments of degree 3 or less are elevated; `deviation` includes the rounding.

        >>> import jhd
        >>> found = jhd.circle([0, 0], 1).to_cubics(1e-4)
        >>> found.shape.count, found.deviation < 5e-6
        (8, True)

        Args:
            tolerance: largest deviation allowed in either direction, a positive length in the unit of the coordinates.
            max_segments: largest number of cubics to produce; more raise ValueError.

        Returns:
            An Approximation: the cubics as `shape`, and `deviation`, a bound of their Hausdorff distance to the curve.

        Raises:
            ValueError: `tolerance` is not positive, is below the rounding of the coordinates or needs more than
                `max_segments` cubics; or the curve is a point set.
            TypeError: the curve is traced; the number of cubics depends on its numbers.
        """
        return _approximated(self, 3, tolerance, max_segments)

    @property
    def homogeneous(self) -> Float[Array, "*rows width"]:
        """Homogeneous control points: coordinates times weight, then the weight itself if the curve is rational."""
        return homogeneous(self.control_points, self.weights)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the bounding box of the control points; the curve lies inside."""
        (control_points,) = on_host(self.segments().control_points)
        low, high = control_points.min(axis=(-3, -2)), control_points.max(axis=(-3, -2))
        return array_of(low), array_of(high)


class BezierSegments(AbstractCurve):
    """A union of polynomial or rational Bezier segments of one degree, in the plane or in space.

    Ends that meet are stored twice. An optimizer of the segments would tear them apart: build both from one array.

    >>> import jax.numpy as jnp
    >>> import jhd
    >>> corner = jhd.BezierSegments([[[0, 0], [1, 0]], [[1, 0], [1, 2]]])
    >>> corner.count, corner.next_segment.tolist()
    (2, [1, -1])
    >>> outline = jhd.polyline([[0, 0], [1, 0], [1, 1]], closed=True)
    >>> free = outline.control_points[:, :-1]  # all but the last point of each segment
    >>> jhd.BezierSegments(jnp.concatenate([free, free[outline.next_segment, :1]], axis=1)).next_segment.tolist()
    [1, 2, 0]

    Args:
        control_points: (segments, points, dim) coordinates with dim 2 or 3, in any unit of length; distances have the
            same unit.
        weights: (segments, points) positive weights; None means polynomial segments.
        next_segment: (segments,) integers: for each segment the index of the segment that starts at its end, or -1 at a
            free end. By default two ends are joined if they agree within 8 ulp of the largest coordinate; the next
            segment is preferred. Stored as floats with zero derivative, which jax.grad and optimizers accept.

    Raises:
        ValueError: wrong number of axes, no point, not two or three coordinates, NaN or infinity; weights that are not
            positive or do not match the points; or a degree above 128 (32 in single precision).
        TypeError: entries that are not real numbers.
    """

    control_points: Float[Array, "segments points dim"]
    weights: Float[Array, "segments points"] | None
    # Integers inside the compiled functions of this package: jhd._distance.normalization.curves.trusted.
    links: Float[Array, "segments 2"] | Int[Array, " segments"] = eqx.field(metadata={"name": "next_segment"})

    def __init__(self, control_points: Numbers, weights: Numbers | None = None, next_segment: Numbers | None = None):
        self.control_points, self.weights = checked_net(control_points, weights, ("segments", "points", "dim"))
        check_degrees(self.control_points.dtype, self.degree)
        following = joints(self.control_points) if next_segment is None else checked(next_segment, self.count)
        self.links = array_of(linked(following))

    @property
    def next_segment(self) -> Array:
        """For each segment the index of the segment that starts at its end, -1 at a free end."""
        return array_of(followed(self.links))

    def _summary(self) -> str:
        batch = batch_text(self.control_points, 3)
        lead = f"{batch}, " if batch else ""
        if self.degree == 0:
            return lead + count_text(self.count, "point")
        return f"{lead}{count_text(self.count, 'segment')} of degree {self.degree}{self._ends_text()}"

    def _ends_text(self) -> str:
        next_segment = followed(self.links) if is_known(self.links) else None
        if next_segment is None or next_segment.ndim != 1:
            return ""
        ends = int(np.sum(np.asarray(next_segment) < 0))
        if ends == 0:
            return ", closed"
        return ", open" if ends == 1 else f", {ends} open ends"

    @property
    def count(self) -> int:
        """Number of segments."""
        return self.control_points.shape[-3]

    @property
    def degree(self) -> int:
        """Degree of the segments."""
        return self.control_points.shape[-2] - 1

    def _with_homogeneous(self, homogeneous: Array, next_segment: Array | None = None) -> "BezierSegments":
        """The segments of these homogeneous control points, rational if this curve is."""
        return BezierSegments(*cartesian(homogeneous, self.weights is not None), next_segment)

    @staticmethod
    def from_path(path: HasVertices) -> "BezierSegments":
        """The contours of a matplotlib Path, all elevated to their largest degree.

        Open contours stay open. CLOSEPOLY adds the closing line unless it has length zero.

        >>> import jhd
        >>> from matplotlib.path import Path
        >>> jhd.BezierSegments.from_path(Path([(0, 0), (1, 2), (2, 0)], [1, 3, 3]))(0.5).tolist()
        [1.0, 1.0]

        Args:
            path: a matplotlib Path, or any object with `vertices` and `codes`; None as codes means one polyline.

        Returns:
            One segment for each line or curve of the path; ends that meet are joined.

        Raises:
            TypeError: `path` has no `vertices` or no `codes`.
            ValueError: no segment, NaN or infinity, or a code that is unknown, misplaced or lacks vertices.
        """
        control_points, next_segment = convert.outline_arrays(convert.path_contours(path))
        return BezierSegments(control_points, None, completed(next_segment, array_of(control_points)))

    @staticmethod
    def from_shapely(geometry: ShapelyGeometry) -> "BezierSegments":
        """The points and lines of a shapely geometry; a polygon gives its boundary rings, not its interior.

        >>> import jhd
        >>> import shapely
        >>> jhd.BezierSegments.from_shapely(shapely.box(0, 0, 2, 1)).next_segment.tolist()
        [1, 2, 3, 0]

        Args:
            geometry: a shapely geometry of any type. z coordinates are kept; measures (m) are dropped.

        Returns:
            Segments of degree 1, or of degree 0 if the geometry consists of points.

        Raises:
            TypeError: `geometry` is not a shapely geometry.
            ValueError: an empty geometry, NaN or infinity, or a collection with members in the plane and in space.
        """
        control_points, next_segment = convert.outline_arrays(convert.geometry_contours(geometry))
        return BezierSegments(control_points, None, completed(next_segment, array_of(control_points)))

    def point(self, segment: Numbers, t: Numbers) -> Array:
        """Points of numbered segments at local parameters: shape (*batch, dim).

        Args:
            segment: integer indices of segments, from 0.
            t: local parameters from 0 to 1; broadcast against `segment`.

        Returns:
            The points, (*batch, dim).
        """
        return evaluate(self.control_points, self.weights, jnp.asarray(segment), real_array("t", t))

    def __call__(self, t: Numbers) -> Array:
        """Points at global parameters t, which are in [k, k + 1] on segment k: shape (*t.shape, dim)."""
        (t,) = on_host(real_array("t", t))
        xp = module_of(t)
        segment = xp.clip(xp.floor(t), 0, self.count - 1)
        return evaluate(self.control_points, self.weights, segment.astype(int), t - segment)

    def segments(self) -> "BezierSegments":
        """The curve itself."""
        return self

    def derivative(self) -> "BezierSegments":
        """The hodographs of all segments, each over its own [0, 1]; degree 2 n if the curve is rational."""
        points, weights = hodograph(self.control_points, self.weights)
        return BezierSegments(points, weights)

    def split(self, t: Numbers) -> tuple["BezierSegments", "BezierSegments"]:
        """The two parts of the curve, before and after the global parameter t.

        Args:
            t: a number strictly between 0 and the number of segments.

        Returns:
            Two BezierSegments.

        Raises:
            ValueError: t is outside this range.
            TypeError: t is traced; the numbers of segments of both parts depend on it.
        """
        if is_traced(t):
            raise TypeError("split of BezierSegments needs a concrete t: the numbers of segments depend on it.")
        checked_between("t", t, 0.0, float(self.count))
        t = float(np.asarray(t))
        whole, inside = int(t), int(t != int(t))
        first, last = cut(self.homogeneous, t - whole, whole, inside)
        xp = jnp if is_traced(self.next_segment) else np
        next_segment = xp.asarray(self.next_segment)
        before, after = next_segment[: whole + inside], next_segment[whole:] - whole
        # The last segment before the cut leads to the cut, and none after it leads back to the cut.
        kept = (before < whole + inside) & (np.arange(whole + inside) < whole)
        before, after = xp.where(kept, before, -1), xp.where(after >= inside, after, -1)
        return self._completed(first, before), self._completed(last, after)

    def _completed(self, homogeneous: Array, next_segment: Any) -> "BezierSegments":
        control_points, weights = cartesian(homogeneous, self.weights is not None)
        return BezierSegments(control_points, weights, completed(next_segment, control_points))

    def restrict(self, t0: Numbers, t1: Numbers) -> "BezierSegments":
        """The part of every segment over the local parameters [t0, t1]; ends that agree are joined.

        Args:
            t0: local parameter of the start, from 0 to 1; a scalar, or one value per segment.
            t1: local parameter of the end, from 0 to 1; if t1 < t0, the segment is reversed.

        Returns:
            BezierSegments, as many as before.

        Raises:
            ValueError: a parameter outside [0, 1].
        """
        ends = [jnp.broadcast_to(checked_parameter(name, t), (self.count,)) for name, t in (("t0", t0), ("t1", t1))]
        return self._with_homogeneous(jax.vmap(restrict)(self.homogeneous, *ends))

    def elevate(self, degree: int) -> "BezierSegments":
        """The same curve in a higher degree.

        Args:
            degree: new degree, at least the current degree.

        Returns:
            BezierSegments of this degree.

        Raises:
            ValueError: `degree` is below the degree of the curve.
        """
        if degree == self.degree:
            # The way through homogeneous coordinates rounds.
            return self
        return self._with_homogeneous(elevate(self.homogeneous, degree), self.next_segment)

    def reverse(self) -> "BezierSegments":
        """The same point set, traversed in the opposite direction."""
        return self._completed(self.homogeneous[::-1, ::-1], turned(self.next_segment))

    @override
    def _with_points(self, points: Array) -> "BezierSegments":
        return BezierSegments(points, self.weights, completed(self.next_segment, points))

    def pad(self, count: int) -> "BezierSegments":
        """The same point set with `count` segments, so that ragged curves fit one batch; the last segment is repeated.

        Args:
            count: new number of segments, at least the current number.

        Returns:
            BezierSegments, `count` of them.

        Raises:
            ValueError: `count` is below the number of segments.
            TypeError: `count` is not an integer.
        """
        if not isinstance(count, int | np.integer):
            raise TypeError(f"count must be a whole number; got {type(count).__name__}.")
        if count < self.count:
            raise ValueError(f"count is {count}; the curve has {self.count} segments.")
        index = np.minimum(np.arange(count), self.count - 1)
        points, weights, next_segment = on_host(self.control_points, self.weights, self.next_segment)
        return BezierSegments(points[index], None if weights is None else weights[index], next_segment[index])

    @staticmethod
    def join(curves: Sequence[AbstractCurve]) -> "BezierSegments":
        """The union of several curves as one, in their largest degree; rational if any of them is.

        >>> import jhd
        >>> jhd.BezierSegments.join([jhd.polyline([[0, 0], [1, 0]]), jhd.point_set([[2, 2]])]).control_points.shape
        (2, 2, 2)

        Args:
            curves: curves of one dimension.

        Returns:
            The segments of all curves in order. Joints are kept, and free ends that meet are joined.

        Raises:
            ValueError: no curve, or curves of different dimensions.
            TypeError: an entry that is not a curve.
        """
        if isinstance(curves, AbstractCurve):
            raise TypeError(f"curves must be a sequence of curves; got one {type(curves).__name__}.")
        curves = list(curves)
        if not curves:
            raise ValueError("join needs at least one curve; got none.")
        for k, curve in enumerate(curves):
            check_curve(f"curves[{k}]", curve)
        parts = [curve.segments() for curve in curves]
        if len({part.dim for part in parts}) > 1:
            raise ValueError(f"join needs curves of one dimension; got {[part.dim for part in parts]}.")
        degree = max(part.degree for part in parts)
        parts = [part.elevate(degree) for part in parts]
        tables = on_host(*(part.control_points for part in parts))
        points = module_of(tables[0]).concatenate(tables)
        next_segment = united([part.next_segment for part in parts], points)
        if all(part.weights is None for part in parts):
            return BezierSegments(points, None, next_segment)
        ones = [np.ones(part.control_points.shape[:-1]) if part.weights is None else part.weights for part in parts]
        return BezierSegments(points, module_of(points).concatenate(on_host(*ones)), next_segment)


def check_curve(name: str, value: object) -> None:
    """Raise TypeError unless the value is a curve."""
    if not isinstance(value, AbstractCurve):
        raise TypeError(
            f"{name} must be a curve (BezierCurve, BSplineCurve, BezierSegments; see also jhd.point_set, "
            f"jhd.polyline); got {type(value).__name__}."
        )


def _approximated(curve: AbstractCurve, degree: int, tolerance: Numbers, most: int) -> "Approximation[BezierSegments]":
    """The checked curve as lines (degree 1) or cubics (degree 3) within the tolerance, with their largest deviation."""
    wanted = checked_tolerance(tolerance, curve, "an approximation needs a concrete curve", "segments")
    segments = curve.segments()
    if segments.degree == 0:
        raise ValueError("the curve is a point set (degree 0); join its points with jhd.polyline first.")
    points, weights = np.asarray(segments.control_points), segments.weights
    found = flattened(points, None if weights is None else np.asarray(weights), degree, wanted, most)
    next_segment = pieces_following(found.segment, np.asarray(segments.next_segment))
    return Approximation(BezierSegments(found.control_points, None, next_segment), found.deviation)
