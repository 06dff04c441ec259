"""B-spline curves, polynomial or rational (NURBS), open or periodic.

Every polynomial is evaluated by blossoms (`knots.py`). Evaluation, conversion to Bezier segments and knot insertion are
therefore convex combinations inside the domain, and knots of any multiplicity are allowed.

Source: Piegl & Tiller, The NURBS Book (1997), chapters 2 to 5.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._results.display import batch_text, count_text
from jhd._runtime.argument_hints import belongs
from jhd._runtime.arrays import is_traced, module_of, real_array
from jhd._shapes.checks import Numbers, check_control_points, check_degrees, checked_between
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.foreign import SciPySpline
from jhd._shapes.homogeneous import cartesian, elevate, hodograph, homogeneous, in_unit, out_of_unit
from jhd._shapes.joints import completed
from jhd._shapes.knots import (
    bezier_pieces,
    check_knots,
    checked_degree,
    clamped_knots,
    evaluate,
    insert,
    parted,
    ratio,
    tolerance,
    unrolled,
)
from jhd._shapes.unchecked import segments_of

_NO_DEGREE = "it follows from the knots; write BSplineCurve.clamped(points, degree) or .uniform(..., periodic=True)"


class BSplineCurve(AbstractCurve):
    """A B-spline curve, polynomial or rational (NURBS), open or periodic.

    The degree is p = len(knots) - n - 1 for n control points. An open curve has the domain [knots[p], knots[n]];
    outside, the polynomials at its ends are extended. A periodic curve has the period knots[n] - knots[0] and the
    domain [knots[p], knots[p] + period]; outside, the parameter wraps. A periodic curve stores each point once, and
    knots[n:] repeat knots[: p + 1] one period later.

    At a knot of multiplicity p + 1 or more the curve may jump; its value there is the limit from the right. If
    the multiplicity is larger, some control points have no influence.

    >>> import jhd
    >>> curve = jhd.BSplineCurve([[0, 0], [1, 2], [2, 0]], knots=[0, 0, 0, 1, 1, 1])
    >>> curve(0.5).tolist()
    [1.0, 1.0]

    Args:
        control_points: (n, dim) coordinates with dim 2 or 3, in any unit of length; at least p + 1 points, or max(p, 1)
            if periodic.
        knots: (n + p + 1,) non-decreasing parameters; differentiable like the points.
        weights: (n,) positive weights; None means a polynomial spline.
        periodic: whether the parameter wraps, for knots and control points of a closed curve. Clamped knots leave the
            curve open: make a closed one by `uniform(points, periodic=True)`.

    Raises:
        ValueError: wrong number of axes, no point, not two or three coordinates, NaN or infinity; weights that are not
            positive or do not match the points; too few points for the degree, a degree above 128 (32 in single
            precision); knots that decrease, span no length or do not repeat.
        TypeError: entries that are not real numbers.
    """

    control_points: Float[Array, "points dim"]
    knots: Float[Array, " knots"]
    weights: Float[Array, " points"] | None
    periodic: bool = eqx.field(static=True)

    @belongs(
        degree=_NO_DEGREE,
        closed="write BSplineCurve.uniform(control_points, degree, periodic=True)",
    )
    def __init__(self, control_points: Numbers, knots: Numbers, weights: Numbers | None = None, periodic: bool = False):
        self.control_points = real_array("control_points", control_points)
        for name, given in (("knots", knots), ("weights", weights)):
            _refuse_degree(name, given)
        self.knots = real_array("knots", knots)
        self.weights = None if weights is None else real_array("weights", weights)
        self.periodic = bool(periodic)
        check_control_points(self.control_points, self.weights, ("points", "dim"))
        check_knots("knots", self.knots, "points", self.control_points.shape[0], self.periodic)
        check_degrees(self.control_points.dtype, self.degree)

    @classmethod
    @belongs(closed="write periodic=True")
    def uniform(
        cls, control_points: Numbers, degree: int = 3, periodic: bool = False, weights: Numbers | None = None
    ) -> "BSplineCurve":
        """The spline with the knots 0, 1, ..., points + degree; if periodic, closed, with one knot span per point.

        >>> import jhd
        >>> jhd.BSplineCurve.uniform([[0, 0], [6, 0], [6, 6], [0, 6]], periodic=True)(3.0).tolist()
        [5.0, 1.0]

        Args:
            control_points: (points, dim) coordinates of at least degree + 1 points, or max(degree, 1) if periodic.
            degree: polynomial degree, at least 0; the default 3 gives continuous curvature.
            periodic: whether the curve is closed: it returns from the last point to the first.
            weights: (points,) positive weights; None means a polynomial spline.

        Returns:
            The spline.

        Raises:
            ValueError: arguments that the class refuses, or a negative degree.
            TypeError: arguments that the class refuses, or a degree that is not an integer.
        """
        points, degree = _rows(control_points), checked_degree(degree)
        return cls(points, np.arange(points.shape[0] + degree + 1.0), weights, periodic)

    @classmethod
    def clamped(cls, control_points: Numbers, degree: int = 3, weights: Numbers | None = None) -> "BSplineCurve":
        """The spline that starts at the first point and ends at the last, with uniform inner knots.

        The knots are 0, 1, ..., points - degree; the first and the last have multiplicity degree + 1.

        >>> import jhd
        >>> jhd.BSplineCurve.clamped([[0, 0], [1, 2], [3, 2], [4, 0]], degree=2).knots.tolist()
        [0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0]

        Args:
            control_points: (points, dim) coordinates of at least degree + 1 points.
            degree: polynomial degree, at least 0; the default 3 gives continuous curvature.
            weights: (points,) positive weights; None means a polynomial spline.

        Returns:
            The spline.

        Raises:
            ValueError: arguments that the class refuses, or a negative degree.
            TypeError: arguments that the class refuses, or a degree that is not an integer.
        """
        points = _rows(control_points)
        return cls(points, clamped_knots(points.shape[0], degree), weights)

    @classmethod
    def from_scipy(cls, spline: SciPySpline) -> "BSplineCurve":
        """The curve of a `scipy.interpolate.BSpline` whose coefficients are points.

        A spline with extrapolate="periodic" becomes periodic if its knots and coefficients repeat. If they do not,
        SciPy wraps only the parameter, and the curve is returned as an open spline.

        >>> import jhd
        >>> from scipy.interpolate import make_interp_spline
        >>> spline = make_interp_spline([0, 1, 2, 3], [(0, 0), (1, 1), (2, 0), (3, 1)])
        >>> jhd.BSplineCurve.from_scipy(spline)(1.0).round(6).tolist()
        [1.0, 1.0]

        Args:
            spline: an object with t (knots), c (coefficients (points, 2) or (points, 3)) and k (degree).

        Returns:
            The same curve over the same parameters.

        Raises:
            TypeError: `spline` lacks one of these attributes.
            ValueError: coefficients that are not points in the plane or in space, or arguments that the class refuses.
        """
        if not all(hasattr(spline, name) for name in ("t", "c", "k")):
            raise TypeError(f"spline must be a scipy.interpolate.BSpline (t, c and k); got {type(spline).__name__}.")
        knots, degree = np.asarray(spline.t, dtype=float), checked_degree(spline.k)
        # scipy ignores coefficients beyond the number that the knots ask for.
        points = np.asarray(spline.c)[: len(knots) - degree - 1]
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise ValueError(f"spline.c has shape {points.shape}; needs (points, 2) or (points, 3).")
        curve = cls(points, knots)
        return curve.to_periodic() if getattr(spline, "extrapolate", None) == "periodic" else curve

    def _summary(self) -> str:
        points = count_text(self.control_points.shape[-2], "control point")
        shown = f"degree {self.degree}, {points}, {'periodic' if self.periodic else 'open'}"
        batch = batch_text(self.control_points, 2)
        return f"{batch}, {shown}" if batch else shown

    @property
    def degree(self) -> int:
        """Polynomial degree between two knots."""
        return self.knots.shape[-1] - self.control_points.shape[-2] - 1

    @property
    def domain(self) -> tuple[Array, Array]:
        """First and last parameter of the curve."""
        last = self.knots.shape[-1] - 1
        return self.knots[..., self.degree], self.knots[..., last if self.periodic else last - self.degree]

    def to_open(self) -> "BSplineCurve":
        """The same curve as an open spline; a periodic one repeats its first points and knots at the end."""
        return self._open(*self._unrolled())

    def to_periodic(self) -> "BSplineCurve":
        """The inverse of `to_open`: a periodic spline if points, weights and knots repeat, otherwise itself."""
        knots, p, count = np.asarray(self.knots), self.degree, self.control_points.shape[-2]
        arrays = [np.asarray(x) for x in (self.control_points, self.weights) if x is not None]
        if self.periodic or not all(_repeats(x, knots, p) for x in arrays):
            return self
        weights = None if self.weights is None else self.weights[: count - p]
        return BSplineCurve(self.control_points[: count - p], knots[: count + 1], weights, True)

    def _open(self, h: Array, knots: Numbers) -> "BSplineCurve":
        points, weights = cartesian(h, self.weights is not None)
        return BSplineCurve(points, knots, weights)

    def _unrolled(self) -> tuple[Any, Any]:
        """Homogeneous points and knots of the open spline with the same curve over the same domain."""
        return _unrolled(self.control_points, self.weights, self.knots, self.periodic)

    def __call__(self, t: Numbers) -> Array:
        """Points at parameters t of any shape: (*t.shape, dim). Uses de Boor's algorithm."""
        return self._values(real_array("t", t))

    @eqx.filter_jit
    def _values(self, t: Array) -> Array:
        (h, knots), (start, stop) = self._unrolled(), self.domain
        if self.periodic:
            period = jnp.where(stop > start, stop - start, 1.0)
            t = t - period * jnp.floor((t - start) / period)
        value = evaluate(h, knots, self.degree, self.periodic, t.ravel())
        return cartesian(value.reshape(*t.shape, h.shape[-1]), self.weights is not None)[0]

    def segments(self) -> BezierSegments:
        """One Bezier segment for each knot span of the domain; an empty span gives a segment that is a single point.

        If the multiplicity of a knot leaves the curve continuous, the segments before and after it have the same end
        point and are joined. Other ends are joined if they agree.
        """
        arrays = self.control_points, self.weights, self.knots
        # The pieces of curves of few control points are remembered: their conversion takes as long as a search.
        if is_traced(arrays) or self.control_points.shape[0] > 4096:
            return segments_of(*_joined_pieces(arrays, self.periodic))
        numbers = tuple(None if x is None else (np.asarray(x).tobytes(), x.dtype, x.shape) for x in arrays)
        return segments_of(*_last_pieces(numbers, self.periodic))

    @eqx.filter_jit
    def derivative(self) -> "BSplineCurve":
        """The hodograph, the curve of first derivatives, over the same parameter.

        Polynomial curves give degree p - 1 with the points p (d_{j+1} - d_j) / (t_{j+p+1} - t_{j+1}). Rational curves
        give degree 2 p, with every knot of the domain 2 p + 1 times. If the curve jumps, the derivative does not record
        the jump.
        """
        p, points = self.degree, self.control_points
        if p == 0:
            return BSplineCurve(jnp.zeros_like(points), self.knots, None, self.periodic)
        if self.weights is not None:
            hodographs, weights = hodograph(*self._own_pieces())
            breaks = self._breaks()
            return self._from_pieces(ratio(hodographs, jnp.diff(breaks)[:, None, None]), weights, breaks)
        steps = jnp.roll(points, -1, axis=0) - points if self.periodic else jnp.diff(points, axis=0)
        widths = (self.knots[p + 1 :] - self.knots[1:-p])[: steps.shape[0], None]
        knots = self.knots[1:] if self.periodic else self.knots[1:-1]
        return BSplineCurve(p * ratio(steps, widths), knots, None, self.periodic)

    def _breaks(self) -> Array:
        knots = unrolled(self.knots, self.degree, self.periodic)
        return knots[self.degree : knots.shape[0] - self.degree]

    def _own_pieces(self) -> tuple[Any, Any]:
        return _pieces(self.control_points, self.weights, self.knots, self.periodic)[:2]

    def _from_pieces(self, points: Array, weights: Array | None, breaks: Array) -> "BSplineCurve":
        """The spline of Bezier pieces (pieces, points, dim) between breaks, each a knot of multiplicity degree + 1."""
        count, dim = points.shape[-2:]
        flat = None if weights is None else weights.ravel()
        return BSplineCurve(points.reshape(-1, dim), jnp.repeat(breaks, count), flat, self.periodic)

    def elevate(self, degree: int) -> "BSplineCurve":
        """The same curve in a higher degree, with every knot of the domain degree + 1 times.

        To get Bezier segments of higher degree, elevate `segments()` instead: the knots of this spline have many empty
        spans.

        Args:
            degree: new degree, at least the current degree.

        Returns:
            A BSplineCurve of this degree.

        Raises:
            ValueError: `degree` is below the degree of the curve.
        """
        if degree == self.degree:
            return self
        return self._elevated(degree)

    @eqx.filter_jit
    def _elevated(self, degree: int) -> "BSplineCurve":
        points, weights = self._own_pieces()
        raised = elevate(homogeneous(points, weights), degree)
        return self._from_pieces(*cartesian(raised, weights is not None), self._breaks())

    def split(self, t: Numbers) -> tuple["BSplineCurve", "BSplineCurve"]:
        """The two parts of the curve, before and after t, with the same parameters; open, and clamped at the cut.

        Args:
            t: a parameter strictly inside the domain.

        Returns:
            Two BSplineCurves.

        Raises:
            ValueError: t is outside this range.
            TypeError: t or the knots are traced; the numbers of control points of both parts depend on them.
        """
        if is_traced(t, self.knots):
            raise TypeError("split of a BSplineCurve needs concrete t and knots: the numbers of points depend on them.")
        knots, p = unrolled(np.asarray(self.knots), self.degree, self.periodic), self.degree
        checked_between("t", t, knots[p], knots[len(knots) - 1 - p])
        before, after = parted(self._unrolled()[0], knots, p, t)
        return self._open(*before), self._open(*after)

    def insert_knot(self, t: Numbers) -> "BSplineCurve":
        """The same curve with one more knot at t and one more control point; periodic if this curve is.

        Args:
            t: a parameter strictly inside the domain; may be traced.

        Returns:
            A BSplineCurve.

        Raises:
            ValueError: t is outside this range.
        """
        u = checked_between("t", t, *self.domain)
        return self._refined(u)

    @eqx.filter_jit
    def _refined(self, u: Array) -> "BSplineCurve":
        n, p, (h, knots) = self.control_points.shape[-2], self.degree, self._unrolled()
        h, refined = insert(h, knots, p, u)
        if not self.periodic:
            return self._open(h, refined)
        # Points before the first one of the domain feel the new knot one period earlier: read them one period later.
        index = jnp.arange(n + 1)
        span = jnp.searchsorted(knots, u, side="right") - 1
        points, weights = cartesian(h[jnp.where(index + n + 1 <= span, index + n + 1, index)], self.weights is not None)
        head = refined[p] - (refined[n + p + 1] - refined[n + 1 : n + p + 1])
        return BSplineCurve(points, jnp.concatenate([head, refined[p : n + p + 2]]), weights, True)

    @eqx.filter_jit
    def reverse(self) -> "BSplineCurve":
        """The same point set, traversed in the opposite direction over the same domain."""
        h, knots = self._unrolled()
        start, stop = self.domain
        turned = (start + stop - knots[::-1])[: self.knots.shape[-1]]
        points, weights = cartesian(h[::-1][: self.control_points.shape[-2]], self.weights is not None)
        return BSplineCurve(points, turned, weights, self.periodic)


def _rows(control_points: Numbers) -> Array:
    points = real_array("control_points", control_points)
    check_control_points(points, None, ("points", "dim"))
    return points


def _refuse_degree(name: str, given: object) -> None:
    """Raise TypeError if a degree is passed instead of an array."""
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        raise TypeError(f"{name} is {given}; BSplineCurve() takes no degree: {_NO_DEGREE}.")


def _unrolled(points: Any, weights: Any, knots: Any, periodic: bool) -> tuple[Any, Any]:
    h, p = homogeneous(points, weights), knots.shape[0] - points.shape[0] - 1
    return module_of(h).concatenate([h, h[:p]]) if periodic else h, unrolled(knots, p, periodic)


@lru_cache(maxsize=16)
def _last_pieces(numbers: tuple[Any, ...], periodic: bool) -> tuple[Any, Any, Any]:
    """`_joined_pieces` of known arrays; the pieces of the last curves are found by the numbers of the curves."""
    return _joined_pieces([None if x is None else np.frombuffer(*x[:2]).reshape(x[2]) for x in numbers], periodic)


def _joined_pieces(arrays: Sequence[Any], periodic: bool) -> tuple[Any, Any, Any]:
    """Points and weights of the pieces, and the piece that follows each, from control points, weights and knots."""
    # In units in which no product of a point and its weight underflows.
    points, weights, of_points, of_weights = in_unit(*arrays[:2])
    knots = arrays[2]
    if is_traced(points, weights, knots):
        points, weights, jumps = _compiled_pieces(points, weights, knots, periodic)
    else:
        # An optimizer may have changed the knots since the constructor checked them.
        knots = np.asarray(knots)
        check_knots("knots", knots, "points", points.shape[0], periodic)
        # On the host: a function would be compiled for every number of points.
        with np.errstate(over="ignore", invalid="ignore"):
            points, weights, jumps = _pieces(points, weights, knots, periodic)
    points, weights = out_of_unit(points, of_points), out_of_unit(weights, of_weights)
    xp = jnp if is_traced(jumps) else np
    index = np.arange(1, points.shape[0] + 1) % points.shape[0]
    return points, weights, completed(xp.where(xp.asarray(jumps)[index], -1, index), points)


def _pieces(points: Any, weights: Any, knots: Any, periodic: bool) -> tuple[Any, Any, Any]:
    """Points and weights of the Bezier pieces, and the pieces before which the curve may jump."""
    degree = knots.shape[0] - points.shape[0] - 1
    pieces, jumps = bezier_pieces(*_unrolled(points, weights, knots, periodic), degree, periodic)
    return *cartesian(pieces, weights is not None), jumps


_compiled_pieces = jax.jit(_pieces, static_argnums=3)


def _repeats(points: np.ndarray, knots: np.ndarray, degree: int) -> bool:
    """Whether an open spline is the unrolled form of a periodic one."""
    pieces = len(points) - degree
    if pieces < max(degree, 1):
        return False
    same_points = np.abs(points[pieces:] - points[:degree]) <= tolerance(points)
    same_knots = np.abs(knots[pieces:] - knots[: 2 * degree + 1] - (knots[pieces] - knots[0])) <= tolerance(knots)
    return bool(np.all(same_points) and np.all(same_knots))
