"""A single Bezier curve, polynomial or rational.

Source: Farin, Curves and Surfaces for CAGD, 5th edition (2002), chapters 4, 5 and 13.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._results.display import batch_text
from jhd._runtime.arrays import is_traced, real_array
from jhd._shapes.checks import Numbers, check_degrees, checked_between, checked_net, checked_parameter
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.homogeneous import cartesian, elevate, evaluate, hodograph, restrict, split
from jhd._shapes.unchecked import segments_of


class BezierCurve(AbstractCurve):
    """A Bezier curve of degree points - 1: c(t) = sum w_i B_i(t) p_i / sum w_i B_i(t) for t in [0, 1].

    Outside [0, 1] the polynomials are extended. Degree 0, a single point, is allowed.

    >>> import jhd
    >>> curve = jhd.BezierCurve([[0, 0], [1, 2], [2, 0]])
    >>> curve(0.5).tolist()
    [1.0, 1.0]

    Args:
        control_points: (points, dim) coordinates with dim 2 or 3, in any unit of length; distances have the same unit.
        weights: (points,) positive weights; None means a polynomial curve.

    Raises:
        ValueError: wrong number of axes, no point, not two or three coordinates, NaN or infinity; weights that are not
            positive or do not match the points; or a degree above 128 (32 in single precision).
        TypeError: entries that are not real numbers.
    """

    control_points: Float[Array, "points dim"]
    weights: Float[Array, " points"] | None

    def __init__(self, control_points: Numbers, weights: Numbers | None = None):
        self.control_points, self.weights = checked_net(control_points, weights, ("points", "dim"))
        check_degrees(self.control_points.dtype, self.degree)

    def _summary(self) -> str:
        batch = batch_text(self.control_points, 2)
        return f"{batch}, degree {self.degree}" if batch else f"degree {self.degree}"

    @property
    def degree(self) -> int:
        """Degree of the curve."""
        return self.control_points.shape[-2] - 1

    def _with_homogeneous(self, homogeneous: Array) -> "BezierCurve":
        """The curve of these homogeneous control points, rational if this curve is."""
        return BezierCurve(*cartesian(homogeneous, self.weights is not None))

    def __call__(self, t: Numbers) -> Array:
        """Points at parameters t of any shape: (*t.shape, dim). The curve itself has t in [0, 1]."""
        weights = None if self.weights is None else self.weights[None]
        return evaluate(self.control_points[None], weights, 0, real_array("t", t))

    def segments(self) -> BezierSegments:
        """The curve as one Bezier segment."""
        # Of known arrays NumPy takes the view: an operation of JAX costs more than the rest.
        xp = jnp if is_traced(self) else np
        weights = None if self.weights is None else xp.asarray(self.weights)[None]
        return segments_of(xp.asarray(self.control_points)[None], weights)

    def derivative(self) -> "BezierCurve":
        """The hodograph, the curve of first derivatives; degree 2 n if the curve is rational."""
        return BezierCurve(*hodograph(self.control_points, self.weights))

    def split(self, t: Numbers) -> tuple["BezierCurve", "BezierCurve"]:
        """The two parts of the curve, before and after t, each over its own [0, 1].

        Args:
            t: a number strictly between 0 and 1; may be traced.

        Returns:
            Two curves of the same degree.

        Raises:
            ValueError: t is outside this range.
        """
        left, right = split(self.homogeneous, checked_between("t", t, 0.0, 1.0))
        return self._with_homogeneous(left), self._with_homogeneous(right)

    def restrict(self, t0: Numbers, t1: Numbers) -> "BezierCurve":
        """The part of the curve over [t0, t1], reparametrized to [0, 1].

        Args:
            t0: parameter of the start, from 0 to 1; may be traced.
            t1: parameter of the end, from 0 to 1; may be traced. If t1 < t0, the part is reversed.

        Returns:
            A curve of the same degree; two equal parameters give a single point.

        Raises:
            ValueError: a parameter outside [0, 1].
        """
        ends = checked_parameter("t0", t0), checked_parameter("t1", t1)
        return self._with_homogeneous(restrict(self.homogeneous, *ends))

    def elevate(self, degree: int) -> "BezierCurve":
        """The same curve in a higher degree.

        Args:
            degree: new degree, at least the current degree.

        Returns:
            A curve with the same parameters, equal up to rounding.

        Raises:
            ValueError: `degree` is below the degree of the curve.
        """
        return self._with_homogeneous(elevate(self.homogeneous, degree))

    def reverse(self) -> "BezierCurve":
        """The same point set, traversed in the opposite direction: t becomes 1 - t."""
        return BezierCurve(self.control_points[::-1], None if self.weights is None else self.weights[::-1])
