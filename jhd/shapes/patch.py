"""Parametric surfaces: tensor-product Bezier patches, polynomial or rational, in space.

`BezierPatches` is the working form: a union of patches of one pair of degrees, as `BezierSegments` is for curves.
Meshes of them have a proven deviation (`jhd.shapes.tessellation`).

Source: Farin, Curves and Surfaces for CAGD, 5th edition (2002), chapters 14 and 15; Piegl & Tiller, The NURBS Book
(1997), chapters 1 and 4.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._results.display import batch_text, count_text, described, fields_shown, is_known, net_text, opaque, size_text
from jhd._runtime.arrays import array_of, is_traced, real_array
from jhd._runtime.compiled import optimised
from jhd.arithmetic import bernstein
from jhd.shapes import sketches
from jhd.shapes.checks import Numbers, check_control_points, check_degrees, checked_between, checked_parameter
from jhd.shapes.curve import affine_image
from jhd.shapes.homogeneous import cartesian, homogeneous
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.tessellation import tessellate


class Partials(NamedTuple):
    """Points of a surface with their first and second partial derivatives, arrays (*batch, 3)."""

    point: Array
    u: Array
    v: Array
    uu: Array
    uv: Array
    vv: Array

    def __repr__(self) -> str:
        return fields_shown(self, *self._fields)


class PatchMesh(eqx.Module):
    """A mesh and a proven bound of how far it and its surface are from each other, both ways: `mesh, deviation = ...`.

    Args:
        mesh: the triangles; their corners are points of the surface.
        deviation: the bound, in the unit of the coordinates.
        patch: a patch of `surface.patches()` that each vertex lies on.
        u: its first parameter there, from 0 to 1.
        v: its second one.
    """

    mesh: TriangleMesh
    deviation: float
    patch: Int[Array, " vertices"]
    u: Float[Array, " vertices"]
    v: Float[Array, " vertices"]

    def __repr__(self) -> str:
        return fields_shown(self, "mesh", "deviation")

    def __iter__(self) -> Iterator[Any]:
        return iter((self.mesh, self.deviation))

    def on(self, surface: "AbstractPatch") -> TriangleMesh:
        """The same triangles with their corners at the same parameters of a surface; differentiable in it.

        Nothing is said of how far they are from another surface than the one that they were made for.

        Raises:
            ValueError: the surface has another number of patches than the vertices ask for.
        """
        parts = surface.patches()
        most = int(np.max(np.asarray(self.patch)))
        if most >= parts.count:
            raise ValueError(f"surface has {parts.count} patches; a vertex is on patch {most}.")
        return TriangleMesh(parts.point(self.patch, self.u, self.v), self.mesh.triangles)


class AbstractPatch(eqx.Module):
    """A parametric surface in space. Points are rows; parameters u, v are scalars or arrays that broadcast."""

    control_points: eqx.AbstractVar[Array]
    weights: eqx.AbstractVar[Array | None]

    @abstractmethod
    def _value(self, u: Array, v: Array) -> Array:
        """The point at two numbers."""

    @abstractmethod
    def patches(self) -> "BezierPatches":
        """The surface as Bezier patches, the form that distances consume."""

    @abstractmethod
    def transform(self, matrix: Numbers, offset: Numbers = 0.0) -> "AbstractPatch":
        """The image under x -> matrix x + offset; differentiable in both."""

    @property
    @abstractmethod
    def degrees(self) -> tuple[int, int]:
        """Degrees in u and in v."""

    def _summary(self) -> str:
        return batch_text(self.control_points, 3)

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        degrees = f"degrees {size_text(self.degrees)}"
        return described(self, self._summary(), degrees, net_text(self.control_points, self.weights))

    def _repr_svg_(self) -> str | None:
        """Lines of constant parameters, as notebooks show the surface; None of a batch, or of what is not known."""
        axes = 4 if isinstance(self, BezierPatches) else 3
        if opaque(self) or not is_known(self.control_points) or self.control_points.ndim != axes:
            return None
        found = self.patches()
        weights = None if found.weights is None else np.asarray(found.weights)
        return sketches.svg(sketches.across(np.asarray(found.control_points), weights), repr(self))

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return 3

    @property
    def homogeneous(self) -> Float[Array, "*rows width"]:
        """The control points times their weights, and the weights as one more coordinate where there are any."""
        return homogeneous(self.control_points, self.weights)

    def __call__(self, u: Numbers, v: Numbers) -> Array:
        """Points at the parameters, which broadcast: shape (*batch, 3)."""
        u, v = jnp.broadcast_arrays(real_array("u", u), real_array("v", v))
        return points_at(self, u, v)

    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner of the box of all control points; the surface lies inside, as weights are positive."""
        control_points = self.patches().control_points
        return jnp.min(control_points, axis=(-4, -3, -2)), jnp.max(control_points, axis=(-4, -3, -2))

    def partials(self, u: Numbers, v: Numbers) -> Partials:
        """Points and their partial derivatives of first and second order in the parameters of the surface."""
        u, v = jnp.broadcast_arrays(real_array("u", u), real_array("v", v))
        return Partials(*_partials(self, u, v))

    def to_mesh(self, atol: Numbers, *, max_triangles: int = 2_000_000) -> "PatchMesh":
        """A triangle mesh with a proven deviation of at most atol, both ways.

        Triangles are small where the surface is curved and long where it is straight. Patches whose control points (and
        weights) agree along a common edge, in either direction, share the vertices there: the mesh has no cracks.
        Triangles with two corners at one place, as at poles, are kept. Distances between meshes of two surfaces are
        those of the surfaces to within the sum of their deviations; `on` of the result moves the mesh with the surface.

        Args:
            atol: the most that the surface may be away from the mesh anywhere, and the mesh from the surface.
            max_triangles: the largest mesh to make; their number grows like 1 / atol.

        Raises:
            ValueError: atol is not positive, or asks for too many triangles or for less than rounding leaves.
            TypeError: the surface is traced; the number of triangles depends on it.
        """
        if is_traced(self, atol):
            raise TypeError("to_mesh needs a concrete surface and atol: the number of triangles depends on them.")
        tolerance = real_array("atol", atol)
        if tolerance.shape != () or not float(tolerance) > 0:
            raise ValueError(f"atol is {tolerance}; needs one positive number.")
        parts = self.patches()
        weights = None if parts.weights is None else np.asarray(parts.weights)
        found = tessellate(np.asarray(parts.control_points), weights, float(tolerance), max_triangles)
        mesh = TriangleMesh(found.vertices, found.triangles)
        places = array_of(found.patch), array_of(found.u), array_of(found.v)
        return PatchMesh(mesh, found.deviation, *places)


class BezierPatch(AbstractPatch):
    """A tensor-product Bezier patch: sum w_ij B_i(u) B_j(v) p_ij / sum w_ij B_i(u) B_j(v) for u, v in [0, 1].

    Rows go with u, columns with v; the degrees are rows - 1 and columns - 1. Outside [0, 1] the polynomials are
    extended. Degree 0 is allowed.

    >>> patch = BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]])
    >>> patch(0.5, 0.5).tolist()
    [1.0, 1.0, 1.0]

    Args:
        control_points: coordinates, in any unit of length.
        weights: positive weights, or None for a polynomial patch.

    Raises:
        ValueError: wrong number of axes, no point, other than three coordinates, NaN or infinity, weights that are not
            positive or do not match.
        TypeError: entries that are not real numbers.
    """

    control_points: Float[Array, "rows columns 3"]
    weights: Float[Array, "rows columns"] | None

    def __init__(self, control_points: Numbers, weights: Numbers | None = None):
        self.control_points, self.weights = checked_net(control_points, weights, ("rows", "columns", "3"))
        check_degrees(self.control_points.dtype, *self.degrees)

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees in u and in v."""
        return self.control_points.shape[-3] - 1, self.control_points.shape[-2] - 1

    def with_homogeneous(self, homogeneous: Array) -> "BezierPatch":
        """A patch from control points in the form of `homogeneous`, polynomial or rational as this one is."""
        return BezierPatch(*cartesian(homogeneous, self.weights is not None))

    def _value(self, u: Array, v: Array) -> Array:
        value = bernstein.evaluate(bernstein.evaluate(self.homogeneous, u, axis=0), v, axis=0)
        return cartesian(value, self.weights is not None)[0]

    def patches(self) -> "BezierPatches":
        """The surface as one patch."""
        return BezierPatches(self.control_points[None], None if self.weights is None else self.weights[None])

    def split(self, t: Numbers, axis: int = 0) -> tuple["BezierPatch", "BezierPatch"]:
        """The parts before and after u = t (axis 0) or v = t (axis 1), strictly between 0 and 1; t may be traced.

        Raises:
            ValueError: t is outside, or another axis.
        """
        if axis not in (0, 1):
            raise ValueError(f"axis is {axis!r}; needs 0 (cut at u = t) or 1 (cut at v = t).")
        left, right = bernstein.split(self.homogeneous, checked_between("t", t, 0.0, 1.0), axis=axis)
        return self.with_homogeneous(left), self.with_homogeneous(right)

    def restrict(self, u0: Numbers, u1: Numbers, v0: Numbers, v1: Numbers) -> "BezierPatch":
        """The part on [u0, u1] x [v0, v1] within the unit square, over its own; ends may be traced and reversed.

        Raises:
            ValueError: an end outside [0, 1].
        """
        ends = [checked_parameter(name, t) for name, t in zip(("u0", "u1", "v0", "v1"), (u0, u1, v0, v1), strict=True)]
        part = bernstein.restrict(self.homogeneous, ends[0], ends[1], axis=0)
        return self.with_homogeneous(bernstein.restrict(part, ends[2], ends[3], axis=1))

    def elevate(self, degree_u: int, degree_v: int) -> "BezierPatch":
        """The same patch written in higher degrees.

        Raises:
            ValueError: a degree is below the one of the patch.
        """
        raised = bernstein.elevate(self.homogeneous, degree_u, axis=0)
        return self.with_homogeneous(bernstein.elevate(raised, degree_v, axis=1))

    def transform(self, matrix: Numbers, offset: Numbers = 0.0) -> "BezierPatch":
        """The image under x -> matrix x + offset; differentiable in both.

        Raises:
            ValueError: wrong shapes, NaN or infinity.
        """
        return BezierPatch(affine_image(self.control_points, matrix, offset), self.weights)


class BezierPatches(AbstractPatch):
    """A union of Bezier patches of one pair of degrees; they need not be connected.

    Patch k carries the parameters u in [k, k + 1], v in [0, 1] of a call; `point` takes the patch by its number.

    Args:
        control_points: coordinates, in any unit of length.
        weights: positive weights, or None for polynomial patches.

    Raises:
        ValueError: as for BezierPatch.
        TypeError: entries that are not real numbers.
    """

    control_points: Float[Array, "patches rows columns 3"]
    weights: Float[Array, "patches rows columns"] | None

    def __init__(self, control_points: Numbers, weights: Numbers | None = None):
        self.control_points, self.weights = checked_net(control_points, weights, ("patches", "rows", "columns", "3"))
        check_degrees(self.control_points.dtype, *self.degrees)

    def _summary(self) -> str:
        batch, patches = batch_text(self.control_points, 4), count_text(self.count, "patch", "patches")
        return f"{batch}, {patches}" if batch else patches

    @property
    def count(self) -> int:
        """Number of patches."""
        return self.control_points.shape[-4]

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees in u and in v."""
        return self.control_points.shape[-3] - 1, self.control_points.shape[-2] - 1

    def _value(self, u: Array, v: Array) -> Array:
        patch = jnp.clip(jnp.floor(u), 0, self.count - 1)
        return self._at(patch.astype(int), u - patch, v)

    def _at(self, patch: Array, u: Array, v: Array) -> Array:
        value = bernstein.evaluate(bernstein.evaluate(self.homogeneous[patch], u, axis=0), v, axis=0)
        return cartesian(value, self.weights is not None)[0]

    def point(self, patch: Int[Array, "..."] | int, u: Numbers, v: Numbers) -> Array:
        """Points of the named patches at local parameters in [0, 1]; all three broadcast."""
        patch, u, v = jnp.broadcast_arrays(jnp.asarray(patch), real_array("u", u), real_array("v", v))
        return _points_of(self, patch, u, v)

    def patches(self) -> "BezierPatches":
        """The surface itself."""
        return self

    def elevate(self, degree_u: int, degree_v: int) -> "BezierPatches":
        """The same patches written in higher degrees.

        Raises:
            ValueError: a degree is below the one of the patches.
        """
        if self.degrees == (degree_u, degree_v):
            # The way through homogeneous coordinates rounds.
            return self
        raised = bernstein.elevate(bernstein.elevate(self.homogeneous, degree_u, axis=-3), degree_v, axis=-2)
        return BezierPatches(*cartesian(raised, self.weights is not None))

    @staticmethod
    def join(surfaces: Sequence[AbstractPatch]) -> "BezierPatches":
        """The union of surfaces as one: degrees are raised to the largest, weights of one added where others have some.

        Raises:
            ValueError: no surface.
            TypeError: an entry that is not a parametric surface.
        """
        surfaces = list(surfaces)
        if not surfaces:
            raise ValueError("join needs at least one surface; got none.")
        for k, surface in enumerate(surfaces):
            if not isinstance(surface, AbstractPatch):
                raise TypeError(f"surfaces[{k}] must be a parametric surface; got {type(surface).__name__}.")
        parts = [surface.patches() for surface in surfaces]
        degrees = [max(part.degrees[axis] for part in parts) for axis in (0, 1)]
        parts = [part.elevate(*degrees) for part in parts]
        points = jnp.concatenate([part.control_points for part in parts])
        if all(part.weights is None for part in parts):
            return BezierPatches(points)
        weights = [jnp.ones(x.control_points.shape[:-1]) if x.weights is None else x.weights for x in parts]
        return BezierPatches(points, jnp.concatenate(weights))

    def transform(self, matrix: Numbers, offset: Numbers = 0.0) -> "BezierPatches":
        """The image under x -> matrix x + offset; differentiable in both.

        Raises:
            ValueError: wrong shapes, NaN or infinity.
        """
        return BezierPatches(affine_image(self.control_points, matrix, offset), self.weights)


def checked_net(control_points: Numbers, weights: Numbers | None, axes: tuple[str, ...]) -> tuple[Array, Array | None]:
    """Control points in space and their weights; ValueError and TypeError as for the patches."""
    points = real_array("control_points", control_points)
    given = None if weights is None else real_array("weights", weights)
    check_control_points(points, given, axes)
    return points, given


def _of_batch(function: Callable[..., Any], *parameters: Array) -> Any:
    """The function of single parameters on a batch of any shape."""
    shape = parameters[0].shape
    values = jax.vmap(function)(*(x.ravel() for x in parameters))
    return jax.tree_util.tree_map(lambda x: x.reshape(*shape, *x.shape[1:]), values)


@optimised
def points_at(surface: Any, u: Array, v: Array) -> Array:
    """Points of a surface at parameters of one batch shape."""
    return _of_batch(surface._value, u, v)


@optimised
def _points_of(surface: BezierPatches, patch: Array, u: Array, v: Array) -> Array:
    return _of_batch(surface._at, patch, u, v)


@optimised
def _partials(surface: Any, u: Array, v: Array) -> tuple[Array, ...]:
    value = surface._value

    def one(u: Array, v: Array) -> tuple[Array, ...]:
        first, second = jax.jacfwd(value, (0, 1)), jax.jacfwd(jax.jacfwd(value, (0, 1)), (0, 1))
        (uu, uv), (_, vv) = second(u, v)
        return value(u, v), *first(u, v), uu, uv, vv

    return _of_batch(one, u, v)
