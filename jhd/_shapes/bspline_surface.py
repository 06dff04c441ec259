"""Tensor-product B-spline surfaces in space, polynomial or rational; searches work on their Bezier patches.

Source: Piegl & Tiller, The NURBS Book (1997), chapters 3 to 5; Farin, Curves and Surfaces for CAGD, 5th edition (2002),
chapter 15.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._results.display import batch_text, size_text
from jhd._runtime.argument_hints import belongs
from jhd._runtime.arrays import is_traced, module_of, real_array
from jhd._shapes.checks import Numbers, check_degrees, checked_net
from jhd._shapes.homogeneous import cartesian, homogeneous, in_unit, out_of_unit
from jhd._shapes.knots import bezier_pieces, check_knots, clamped_knots, evaluate, parted
from jhd._shapes.patch import AbstractPatch, BezierPatches


class BSplineSurface(AbstractPatch):
    """A tensor-product B-spline surface in space, polynomial or rational (NURBS).

    The degree in u is p = len(knots_u) - rows - 1, and the degree in v is q = len(knots_v) - columns - 1. The domain is
    [knots_u[p], knots_u[rows]] x [knots_v[q], knots_v[columns]]; outside, the polynomials at its border are extended.
    At a knot of multiplicity degree + 1 or more the surface may jump; its value there is the limit from larger
    parameters.

    >>> import jhd
    >>> knots = [0, 0, 1, 1]
    >>> surface = jhd.BSplineSurface([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]], knots, knots)
    >>> surface(0.5, 0.5).tolist()
    [1.0, 1.0, 1.0]

    Args:
        control_points: (rows, columns, 3) coordinates, in any unit of length; at least p + 1 rows and q + 1 columns.
        knots_u: (rows + p + 1,) non-decreasing parameters of the rows.
        knots_v: (columns + q + 1,) non-decreasing parameters of the columns.
        weights: (rows, columns) positive weights; None means that the surface is polynomial.

    Raises:
        ValueError: arrays that BezierPatch refuses, wrong numbers of knots, too few points for the degrees, knots that
            decrease or span no length.
        TypeError: entries that are not real numbers.
    """

    control_points: Float[Array, "rows columns 3"]
    knots_u: Float[Array, " knots_u"]
    knots_v: Float[Array, " knots_v"]
    weights: Float[Array, "rows columns"] | None

    @belongs(
        degree="it follows from the knots; write BSplineSurface.clamped(control_points, (p, q))",
        degrees="they follow from the knots; write BSplineSurface.clamped(control_points, (p, q))",
    )
    def __init__(self, control_points: Numbers, knots_u: Numbers, knots_v: Numbers, weights: Numbers | None = None):
        self.control_points, self.weights = checked_net(control_points, weights, ("rows", "columns", "3"))
        self.knots_u, self.knots_v = real_array("knots_u", knots_u), real_array("knots_v", knots_v)
        rows, columns = self.control_points.shape[:2]
        check_knots("knots_u", self.knots_u, "rows", rows)
        check_knots("knots_v", self.knots_v, "columns", columns)
        check_degrees(self.control_points.dtype, *self.degrees)

    @classmethod
    def clamped(
        cls, control_points: Numbers, degrees: tuple[int, int] = (3, 3), weights: Numbers | None = None
    ) -> "BSplineSurface":
        """The surface that interpolates its four corner points, with uniform inner knots in both parameters.

        >>> import jhd
        >>> jhd.BSplineSurface.clamped([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]], (1, 1)).knots_u.tolist()
        [0.0, 0.0, 1.0, 1.0]

        Args:
            control_points: (rows, columns, 3) coordinates, with more rows and columns than the degrees.
            degrees: degrees in u and in v, at least 0; the default (3, 3) gives continuous curvature.
            weights: (rows, columns) positive weights; None means that the surface is polynomial.

        Returns:
            The surface.

        Raises:
            ValueError: arguments that the class refuses, or a negative degree.
            TypeError: arguments that the class refuses, or a degree that is not an integer.
        """
        points = checked_net(control_points, None, ("rows", "columns", "3"))[0]
        if np.shape(degrees) != (2,):
            raise TypeError(f"degrees must be two integers; got {degrees!r}.")
        knots_u, knots_v = map(clamped_knots, points.shape, degrees)
        return cls(points, knots_u, knots_v, weights)

    def _summary(self) -> str:
        batch, net = batch_text(self.control_points, 3), f"{size_text(self.control_points.shape[-3:-1])} control points"
        return f"{batch}, {net}" if batch else net

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees in u and in v."""
        rows, columns = self.control_points.shape[-3:-1]
        return self.knots_u.shape[-1] - rows - 1, self.knots_v.shape[-1] - columns - 1

    @property
    def domain(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """The pairs (first u, last u) and (first v, last v) of parameters."""
        (p, q), (rows, columns) = self.degrees, self.control_points.shape[-3:-1]
        return (self.knots_u[p], self.knots_u[rows]), (self.knots_v[q], self.knots_v[columns])

    def _value(self, u: Array, v: Array) -> Array:
        (p, q), h = self.degrees, self.homogeneous
        row = evaluate(h.reshape(h.shape[0], -1), self.knots_u, p, False, u[None])[0]
        value = evaluate(row.reshape(h.shape[1:]), self.knots_v, q, False, v[None])[0]
        return cartesian(value, self.weights is not None)[0]

    def patches(self) -> BezierPatches:
        """One Bezier patch for each pair of knot spans of the domain; the patches of one span of u are consecutive.

        Neighboring patches have identical control points on their common edge if the multiplicity of the knot leaves
        the surface continuous.
        """
        # In units in which no product of a point and its weight underflows.
        *parts, of_points, of_weights = in_unit(self.control_points, self.weights)
        where = lambda s: (s.control_points, s.weights)  # noqa: E731
        unit = eqx.tree_at(where, self, tuple(parts), is_leaf=lambda x: x is None)
        if is_traced(unit):
            # Some of its numbers may be known.
            pieces = _pieces(jax.tree_util.tree_map(jnp.asarray, unit))
        else:
            # An optimizer may have changed the knots since the constructor checked them.
            check_knots("knots_u", self.knots_u, "rows", self.control_points.shape[0])
            check_knots("knots_v", self.knots_v, "columns", self.control_points.shape[1])
            # On the host: a function would be compiled for every number of points.
            with np.errstate(over="ignore", invalid="ignore"):
                pieces = _pieces(jax.tree_util.tree_map(np.asarray, unit))
        points, weights = cartesian(pieces, self.weights is not None)
        return BezierPatches(out_of_unit(points, of_points), out_of_unit(weights, of_weights))

    def restrict(self, u0: Numbers, u1: Numbers, v0: Numbers, v1: Numbers) -> "BSplineSurface":
        """The part of the surface over [u0, u1] x [v0, v1], with the same parameters; clamped at the cuts.

        Args:
            u0: first parameter in u, inside the domain.
            u1: last parameter in u, inside the domain and above u0.
            v0: first parameter in v, inside the domain.
            v1: last parameter in v, inside the domain and above v0.

        Returns:
            A surface with the domain [u0, u1] x [v0, v1].

        Raises:
            ValueError: a parameter outside the domain, or a first parameter that is not below the last.
            TypeError: knots or parameters are traced; the numbers of control points depend on them.
        """
        if is_traced(self.knots_u, self.knots_v, u0, u1, v0, v1):
            raise TypeError(
                "restrict of a BSplineSurface needs concrete knots and ends: numbers of points depend on them."
            )
        (p, q), (domain_u, domain_v), h = self.degrees, self.domain, self.homogeneous
        ends_u, ends_v = _within("u", (u0, u1), domain_u), _within("v", (v0, v1), domain_v)
        h, knots_u = _restricted(h, np.asarray(self.knots_u), p, ends_u)
        h, knots_v = _restricted(jnp.swapaxes(h, 0, 1), np.asarray(self.knots_v), q, ends_v)
        points, weights = cartesian(jnp.swapaxes(h, 0, 1), self.weights is not None)
        return BSplineSurface(points, knots_u, knots_v, weights)


def _within(name: str, ends: tuple[Numbers, Numbers], domain: tuple[Array, Array]) -> tuple[float, float]:
    """The ends as numbers; ValueError unless they rise within the domain."""
    (start, stop), (low, high) = ((float(np.asarray(x)) for x in pair) for pair in (ends, domain))
    if not low <= start < stop <= high:
        raise ValueError(
            f"{name}0 and {name}1 are {start:g} and {stop:g}; needs {low:g} <= {name}0 < {name}1 <= {high:g}."
        )
    return start, stop


def _restricted(h: Array, knots: np.ndarray, p: int, ends: tuple[float, float]) -> tuple[Array, np.ndarray]:
    """Points and knots of splines along the first axis, one for each entry of the other axes, between both ends."""
    rest, rows = h.shape[1:], h.reshape(h.shape[0], -1)
    if ends[0] > knots[p]:
        rows, knots = parted(rows, knots, p, ends[0])[1]
    if ends[1] < knots[len(knots) - 1 - p]:
        rows, knots = parted(rows, knots, p, ends[1])[0]
    return rows.reshape(-1, *rest), knots


def _pieces(surface: BSplineSurface) -> Any:
    """Homogeneous control points (patches, rows, columns, width) of all pairs of spans."""
    (p, q), h = surface.degrees, homogeneous(surface.control_points, surface.weights)
    xp = module_of(h)
    columns, width = h.shape[1:]
    along_u, jumps = bezier_pieces(h.reshape(h.shape[0], -1), surface.knots_u, p, False)
    spans_u = along_u.shape[0]
    turned = xp.moveaxis(along_u.reshape(spans_u, p + 1, columns, width), 2, 0)
    both = bezier_pieces(turned.reshape(columns, -1), surface.knots_v, q, False)[0]
    pieces = xp.moveaxis(both.reshape(-1, q + 1, spans_u, p + 1, width), (2, 0, 3, 1), (0, 1, 2, 3))
    # The second pass may round the two copies of an edge differently.
    shared = xp.where(jumps[:, None, None, None], pieces[:, :, 0], xp.roll(pieces[:, :, -1], 1, axis=0))
    return xp.concatenate([shared[:, :, None], pieces[:, :, 1:]], axis=2).reshape(-1, p + 1, q + 1, width)
