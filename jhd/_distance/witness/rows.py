"""Rows of shapes on which a point depends: the point, its constraint and the coordinates that a border holds.

A point has three coordinates: parameters of a piece, barycentric coordinates of a triangle, or the position on an
implicit surface. See `jhd._distance.witness.balance`, which solves the conditions at a farthest point with them.
"""

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array
from typing_extensions import override

from jhd._arithmetic.polynomials import jets, rescaled, slopes
from jhd._arithmetic.rounding import like_double, smallest_normal, unit_roundoff
from jhd._arithmetic.scaling import length
from jhd._distance.normalization.net_jets import Net, jet
from jhd._distance.witness.mesh_feet import foot_on
from jhd._distance.witness.surface_projection import distance_from_surface, distances_from_patches
from jhd._results.solution import Witness

# A border presses if the slope towards it is at least this fraction of the length of the derivative.
_PRESSING = 1e-7
# Coordinates of points at about one are known to this many units of roundoff.
NOISE = 256


class AbstractRows(eqx.Module):
    """The rows of a shape on which one or several of its points depend."""

    # Whether coordinates satisfy an equation, and whether its gradient is the normal of the surface.
    has_constraint: ClassVar[bool] = False
    has_normals: ClassVar[bool] = False

    @abstractmethod
    def nearest(self, query: Array, w: Witness) -> tuple[Array, Array]:
        """Return the distance of a point, and its foot next to the first foot of a witness."""

    @abstractmethod
    def point(self, x: Array) -> Array:
        """Return the point at coordinates x."""

    @abstractmethod
    def in_unit(self, origin: Array, scale: Array) -> "AbstractRows":
        """Return the rows, counted from an origin, times a scale; implicit surfaces keep their origin."""

    @abstractmethod
    def held(self, x: Array, pull: Array, far: Array) -> tuple[Array, Array]:
        """Return a mask of the coordinates of a point that are held, and of the ones at their lower border."""

    def constraint(self, x: Array) -> tuple[Array, Array]:
        """Return the value of a constraint, and its gradient.

        Values are lengths on an implicit surface and squares of lengths on a triangle: multipliers are about one.
        """
        return jnp.zeros((), x.dtype), jnp.zeros_like(x)

    def rounding(self, x: Array) -> Array:
        """Bound the value that rounding alone may give a constraint, which is large far from the origin."""
        return jnp.zeros((), x.dtype)


class AbstractPointRows(AbstractRows):
    """Rows of points, which determine the shape."""

    points: Any

    @override
    def in_unit(self, origin: Array, scale: Array) -> "AbstractRows":
        return replace(self, points=(self.points - origin) * scale)


class NetRows(AbstractPointRows):
    """Points, segments or patches, with 0, 1 or 2 axes: each has control points, and weights if there are any."""

    weights: Any
    axes: int = eqx.field(static=True, default=2)

    @property
    def net(self) -> Net:
        """One piece, with one column if it is a piece of a curve."""
        if self.points.ndim == 3:
            return Net(self.points, self.weights)
        return Net(self.points[:, None], None if self.weights is None else self.weights[:, None])

    @override
    def nearest(self, query: Array, w: Witness) -> tuple[Array, Array]:
        if self.axes == 0:
            return length(query - self.points[0, 0]), self.points[0, 0]
        first, net = jnp.zeros(1, int), Net(self.points, self.weights)
        distance, foot, _ = distances_from_patches(query[None], first, w.feet_params[:1], net)
        return distance[0], foot[0]

    @override
    def point(self, x: Array) -> Array:
        return jet(self.net, x[: self.axes]).point

    @override
    def held(self, x: Array, pull: Array, far: Array) -> tuple[Array, Array]:
        size = far * length(jet(self.net, x[: self.axes]).first)
        size, n = jnp.pad(size, (0, 3 - len(size))), len(size)
        presses = (x <= 0) & (pull > _PRESSING * size) | (x >= 1) & (pull < -_PRESSING * size)
        return presses | (jnp.arange(3) >= n), x <= 0


class CornerRows(AbstractPointRows):
    """Corners of triangles."""

    axes, has_constraint = 3, True

    @override
    def nearest(self, query: Array, w: Witness) -> tuple[Array, Array]:
        return foot_on(query, self.points[0], w.feet_params[0] > 0)[:2]

    @override
    def point(self, x: Array) -> Array:
        return jnp.sum(x[:, None] * self.points, axis=0)

    @override
    def constraint(self, x: Array) -> tuple[Array, Array]:
        square = jax.lax.stop_gradient(jnp.max(jnp.abs(self.points - self.points[0])) ** 2)
        return square * (jnp.sum(x) - 1), jnp.full_like(x, square)

    @override
    def held(self, x: Array, pull: Array, far: Array) -> tuple[Array, Array]:
        # Barycentric coordinates below this put a point on an edge.
        inside = x > 1e-9
        pull = pull - jnp.sum(jnp.where(inside, pull, 0.0)) / jnp.maximum(jnp.sum(inside), 1)
        size = jnp.max(length(self.points - self.point(x)))
        # A triangle whose corners are one point has no coordinates, and its constraint would have no weight.
        return ~inside & (pull > _PRESSING * far * size) | (size**2 < smallest_normal(x.dtype)), ~inside


class Polynomial(AbstractRows):
    """An implicit surface."""

    coefficients: Any
    lower: Any
    upper: Any
    axes, has_constraint, has_normals = 3, True, True

    @override
    def nearest(self, query: Array, w: Witness) -> tuple[Array, Array]:
        found = distance_from_surface(query[None], w.feet[:1], self.coefficients, jnp.stack([self.lower, self.upper]))
        return found[0][0], found[1][0]

    @override
    def in_unit(self, origin: Array, scale: Array) -> "AbstractRows":
        return Polynomial(rescaled(self.coefficients, scale), self.lower * scale, self.upper * scale)

    @override
    def point(self, x: Array) -> Array:
        return x

    def moving_point(self, still: "Polynomial", x: Array, held: Array, low: Array) -> Array:
        """Return the point that moves along the normal, which is constant, and with the faces that hold it."""
        moving = jnp.where(held, jnp.where(low, self.lower, self.upper), x)
        free = jnp.where(held, 0.0, slopes(still.coefficients, x)[1])
        # The square of a length of 1e-20 is zero in single precision.
        steep = length(free)
        steep = jnp.where(steep > 0, steep, jnp.inf)
        return moving - slopes(self.coefficients, moving)[0] / steep * (free / steep)

    @override
    def constraint(self, x: Array) -> tuple[Array, Array]:
        value, gradient = slopes(self.coefficients, x)
        steep = jax.lax.stop_gradient(length(gradient))
        steep = jnp.where(steep > 0, steep, 1.0)
        return value / steep, gradient / steep

    @override
    def rounding(self, x: Array) -> Array:
        terms, steep = slopes(jnp.abs(self.coefficients), jnp.abs(x))[0], length(slopes(self.coefficients, x)[1])
        return NOISE * unit_roundoff(x.dtype) * terms / jnp.where(steep > 0, steep, 1.0)

    @override
    def held(self, x: Array, pull: Array, far: Array) -> tuple[Array, Array]:
        """Return the masks for faces that press and are not only touched."""
        # Fraction of the size of a box within which a point lies on one of its faces.
        near = like_double(1e-9, x.dtype) * jnp.max(self.upper - self.lower)
        gradient, low = slopes(self.coefficients, x)[1], x <= self.lower + near
        border = low | (x >= self.upper - near)
        # A face whose angle with the surface has a smaller sine does not hold: the surface touches it.
        steep = 0.05 * length(gradient)
        touched = (length(jnp.where(border, 0.0, gradient)) <= steep) & ~jnp.all(border)
        # Of the faces at an edge, the faces across the surface go on holding.
        border = border & ~(touched & (jnp.abs(gradient) > steep))
        free = jnp.where(border, 0.0, gradient)
        rest = length(free)
        rest = jnp.where(rest > 0, rest, jnp.inf)
        pull = pull - jnp.sum(free / rest * pull) * (gradient / rest)
        # A face lets go if the pull is inward by more than this fraction of the distance.
        return border & (jnp.where(low, pull, -pull) >= -like_double(1e-9, x.dtype) * far), low

    def is_along_normal(self, x: Array, place: Array) -> Array:
        """Return whether rounding turns the normal at a foot less than the vector to the farthest point.

        Points are known to a unit of roundoff of the coordinates or of the box. This turns the vector by this error
        divided by its length, and the gradient by its product with the second derivatives. Rounding of the terms of the
        gradient turns it too. So normals do not count next to singular points, nor beyond the centers of curvature.
        """
        _, gradient, hessian = jets(self.coefficients, x)
        terms = slopes(jnp.abs(self.coefficients), jnp.abs(x))[1]
        reach = jnp.max(jnp.stack([length(x), length(place), jnp.max(self.upper - self.lower)]))
        return (length(terms) / reach + length(hessian.ravel())) * length(place - x) < length(gradient)
