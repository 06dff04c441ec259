"""Parametric surfaces: tensor-product Bezier patches in space, polynomial or rational.

`BezierPatches` is the working form: a union of patches of one pair of degrees, as `BezierSegments` is for curves. Their
meshes have a certified deviation (`jhd._shapes.tessellation`).

Source: Farin, Curves and Surfaces for CAGD, 5th edition (2002), chapters 14 and 15; Piegl & Tiller, The NURBS Book
(1997), chapters 1 and 4.
"""

import dataclasses
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._arithmetic import bernstein
from jhd._results.display import batch_text, count_text, described, fields_shown, is_known, net_text, opaque, size_text
from jhd._runtime.arrays import array_of, on_host, real_array
from jhd._runtime.compiled import optimized
from jhd._shapes import sketches
from jhd._shapes.approximation import Approximation, checked_tolerance
from jhd._shapes.checks import Numbers, check_degrees, checked_between, checked_net, checked_parameter
from jhd._shapes.homogeneous import affine_image, cartesian, homogeneous
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.sizes import AbstractHasArea
from jhd._shapes.tessellation import tessellate


class Partials(NamedTuple):
    """Points of a surface with their first and second partial derivatives.

    Args:
        point: (*batch, 3) points.
        u: (*batch, 3) first derivatives in u.
        v: (*batch, 3) first derivatives in v.
        uu: (*batch, 3) second derivatives in u.
        uv: (*batch, 3) mixed second derivatives.
        vv: (*batch, 3) second derivatives in v.
    """

    point: Array
    u: Array
    v: Array
    uu: Array
    uv: Array
    vv: Array

    def __repr__(self) -> str:
        return fields_shown(self, *self._fields)


class PatchMesh(Approximation[TriangleMesh]):
    """A triangle mesh of a parametric surface with a certified deviation; unpack it as `mesh, deviation = ...`.

    Args:
        shape: the triangles; their corners are points of the surface.
        deviation: certified bound of the Hausdorff distance between mesh and surface, in the unit of the coordinates.
        patch: for each vertex the index of its patch in `surface.patches()`.
        u: first parameter of each vertex on its patch, from 0 to 1.
        v: second parameter of each vertex on its patch, from 0 to 1.
    """

    patch: Int[Array, " vertices"]
    u: Float[Array, " vertices"]
    v: Float[Array, " vertices"]

    def on(self, surface: "AbstractPatch") -> TriangleMesh:
        """The same triangles with their corners at the same parameters of another surface; differentiable in it.

        The deviation holds only for the surface that the mesh was made for.

        Args:
            surface: a parametric surface with at least as many patches as the original.

        Returns:
            The moved mesh.

        Raises:
            ValueError: the surface has too few patches.
        """
        parts = surface.patches()
        most = int(np.max(np.asarray(self.patch)))
        if most >= parts.count:
            raise ValueError(f"surface has {parts.count} patches; a vertex is on patch {most}.")
        return TriangleMesh(parts.point(self.patch, self.u, self.v), self.shape.triangles)


SomePatch = TypeVar("SomePatch", bound="AbstractPatch")


class AbstractPatch(AbstractHasArea):
    """A parametric surface in space. Points are rows; parameters u, v are scalars or arrays that broadcast."""

    control_points: eqx.AbstractVar[Array]
    weights: eqx.AbstractVar[Array | None]

    @abstractmethod
    def _value(self, u: Array, v: Array) -> Array:
        """The point at two numbers."""

    @abstractmethod
    def patches(self) -> "BezierPatches":
        """The surface as Bezier patches, the working form of all distances."""

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
        """Lines of constant parameters, as notebooks show the surface; None for a batch and for unknown numbers."""
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
        """Homogeneous control points: coordinates times weight, then the weight itself if the surface is rational."""
        return homogeneous(self.control_points, self.weights)

    def __call__(self, u: Numbers, v: Numbers) -> Array:
        """Points at the parameters u and v, which broadcast: shape (*batch, 3)."""
        u, v = jnp.broadcast_arrays(real_array("u", u), real_array("v", v))
        return points_at(self, u, v)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the bounding box of the control points; the surface lies inside."""
        # On the host: a reduction would be compiled for every number of patches.
        (control_points,) = on_host(self.patches().control_points)
        low, high = control_points.min(axis=(-4, -3, -2)), control_points.max(axis=(-4, -3, -2))
        return array_of(low), array_of(high)

    def partials(self, u: Numbers, v: Numbers) -> Partials:
        """Points and their first and second partial derivatives in the parameters of the surface.

        Args:
            u: first parameters.
            v: second parameters; broadcast against `u`.

        Returns:
            A Partials: points and derivatives, each of shape (*batch, 3).
        """
        u, v = jnp.broadcast_arrays(real_array("u", u), real_array("v", v))
        return Partials(*_partials(self, u, v))

    def transform(self: SomePatch, matrix: Numbers, offset: Numbers = 0.0) -> SomePatch:
        """The image under x -> matrix x + offset, of the same class; differentiable in both.

        Args:
            matrix: (3, 3) real numbers.
            offset: (3,) translation in the unit of the coordinates, or one number for all axes.

        Returns:
            A surface of the same class.

        Raises:
            ValueError: wrong shapes, NaN or infinity.
        """
        return dataclasses.replace(self, control_points=affine_image(self.control_points, matrix, offset))

    def to_mesh(self, tolerance: Numbers, *, max_triangles: int = 2_000_000) -> "PatchMesh":
        """A triangle mesh of the surface with a certified deviation of at most `tolerance` in both directions.

        Triangles are small where the surface is curved, and long in straight directions. Patches whose control points
        (and weights) agree along a common edge, in either direction, have the same vertices there, so the mesh has no
        cracks. Degenerate triangles, for example at poles, are kept. The distance between two meshes differs from the
        distance between their surfaces by at most the sum of both deviations.

        >>> import jhd
        >>> mesh, deviation = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]]).to_mesh(0.5)
        >>> mesh.count, deviation <= 0.5
        (8, True)

        Args:
            tolerance: largest deviation allowed in either direction, a positive length in the unit of the coordinates.
            max_triangles: largest number of triangles to produce; it grows like 1 / tolerance.

        Returns:
            The mesh with its deviation; its method `on` moves the mesh with the surface.

        Raises:
            ValueError: `tolerance` is not positive, is below the rounding of the coordinates or needs more than
                `max_triangles`.
            TypeError: the surface is traced; the number of triangles depends on its numbers.
        """
        wanted = checked_tolerance(tolerance, self, "to_mesh needs a concrete surface", "triangles")
        parts = self.patches()
        weights = None if parts.weights is None else np.asarray(parts.weights)
        found = tessellate(np.asarray(parts.control_points), weights, wanted, max_triangles)
        mesh = TriangleMesh(found.vertices, found.triangles)
        places = array_of(found.patch), array_of(found.u), array_of(found.v)
        return PatchMesh(mesh, found.deviation, *places)


class BezierPatch(AbstractPatch):
    """A tensor-product Bezier patch: sum w_ij B_i(u) B_j(v) p_ij / sum w_ij B_i(u) B_j(v) for u, v in [0, 1].

    Rows belong to u and columns to v; the degrees are rows - 1 and columns - 1. Outside [0, 1] the polynomials are
    extended. Degree 0 is allowed.

    >>> import jhd
    >>> patch = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]])
    >>> patch(0.5, 0.5).tolist()
    [1.0, 1.0, 1.0]

    Args:
        control_points: (rows, columns, 3) coordinates, in any unit of length; distances have the same unit.
        weights: (rows, columns) positive weights; None means a polynomial patch.

    Raises:
        ValueError: wrong number of axes, no point, not three coordinates, NaN or infinity; weights that are not
            positive or do not match the points; or a degree above 128 (32 in single precision).
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

    def _with_homogeneous(self, homogeneous: Array) -> "BezierPatch":
        """The patch of these homogeneous control points, rational if this patch is."""
        return BezierPatch(*cartesian(homogeneous, self.weights is not None))

    def _value(self, u: Array, v: Array) -> Array:
        value = bernstein.evaluate(bernstein.evaluate(self.homogeneous, u, axis=0), v, axis=0)
        return cartesian(value, self.weights is not None)[0]

    def patches(self) -> "BezierPatches":
        """The surface as one patch."""
        return BezierPatches(self.control_points[None], None if self.weights is None else self.weights[None])

    def split(self, t: Numbers, axis: int = 0) -> tuple["BezierPatch", "BezierPatch"]:
        """The two parts of the patch, before and after a line of constant parameter, each over its own unit square.

        Args:
            t: parameter of the cut, strictly between 0 and 1; may be traced.
            axis: 0 cuts at u = t, 1 cuts at v = t.

        Returns:
            Two patches of the same degrees.

        Raises:
            ValueError: t is outside this range, or `axis` is not 0 or 1.
        """
        if axis not in (0, 1):
            raise ValueError(f"axis is {axis!r}; needs 0 (cut at u = t) or 1 (cut at v = t).")
        left, right = bernstein.split(self.homogeneous, checked_between("t", t, 0.0, 1.0), axis=axis)
        return self._with_homogeneous(left), self._with_homogeneous(right)

    def restrict(self, u0: Numbers, u1: Numbers, v0: Numbers, v1: Numbers) -> "BezierPatch":
        """The part of the patch over [u0, u1] x [v0, v1], reparametrized to the unit square.

        Args:
            u0: first parameter in u, from 0 to 1; may be traced.
            u1: last parameter in u, from 0 to 1; may be traced. If u1 < u0, the part is reversed in u.
            v0: first parameter in v, from 0 to 1; may be traced.
            v1: last parameter in v, from 0 to 1; may be traced. If v1 < v0, the part is reversed in v.

        Returns:
            A BezierPatch.

        Raises:
            ValueError: a parameter outside [0, 1].
        """
        ends = [checked_parameter(name, t) for name, t in zip(("u0", "u1", "v0", "v1"), (u0, u1, v0, v1), strict=True)]
        part = bernstein.restrict(self.homogeneous, ends[0], ends[1], axis=0)
        return self._with_homogeneous(bernstein.restrict(part, ends[2], ends[3], axis=1))

    def elevate(self, degree_u: int, degree_v: int) -> "BezierPatch":
        """The same patch in higher degrees.

        Args:
            degree_u: new degree in u, at least the current one.
            degree_v: new degree in v, at least the current one.

        Returns:
            A BezierPatch of these degrees.

        Raises:
            ValueError: a degree is below the current one.
        """
        raised = bernstein.elevate(self.homogeneous, degree_u, axis=0)
        return self._with_homogeneous(bernstein.elevate(raised, degree_v, axis=1))


class BezierPatches(AbstractPatch):
    """A union of Bezier patches of the same degrees in u and v; the patches need not be connected.

    A call takes u in [k, k + 1] and v in [0, 1] for patch k; the method `point` takes the index of the patch.

    >>> import jhd
    >>> net = [[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]]
    >>> jhd.BezierPatches([net]).count, jhd.BezierPatches([net]).degrees
    (1, (1, 1))

    Args:
        control_points: (patches, rows, columns, 3) coordinates, in any unit of length; distances have the same unit.
        weights: (patches, rows, columns) positive weights; None means polynomial patches.

    Raises:
        ValueError: arrays that BezierPatch refuses.
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
        """Points of numbered patches at local parameters: shape (*batch, 3).

        Args:
            patch: integer indices of patches, from 0.
            u: first local parameters, from 0 to 1; broadcast against `patch`.
            v: second local parameters, from 0 to 1; broadcast against `patch`.

        Returns:
            The points, (*batch, 3).
        """
        patch, u, v = jnp.broadcast_arrays(jnp.asarray(patch), real_array("u", u), real_array("v", v))
        return _points_of(self, patch, u, v)

    def patches(self) -> "BezierPatches":
        """The surface itself."""
        return self

    def elevate(self, degree_u: int, degree_v: int) -> "BezierPatches":
        """The same patches in higher degrees.

        Args:
            degree_u: new degree in u, at least the current one.
            degree_v: new degree in v, at least the current one.

        Returns:
            BezierPatches of these degrees.

        Raises:
            ValueError: a degree is below the current one.
        """
        if self.degrees == (degree_u, degree_v):
            # The way through homogeneous coordinates rounds.
            return self
        raised = bernstein.elevate(bernstein.elevate(self.homogeneous, degree_u, axis=-3), degree_v, axis=-2)
        return BezierPatches(*cartesian(raised, self.weights is not None))

    @staticmethod
    def join(surfaces: Sequence[AbstractPatch]) -> "BezierPatches":
        """The union of several surfaces as one, in their largest degrees; rational if any of them is.

        >>> import jhd
        >>> patch = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]])
        >>> jhd.BezierPatches.join([patch, patch]).count
        2

        Args:
            surfaces: parametric surfaces.

        Returns:
            The patches of all surfaces in order.

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


def _of_batch(function: Callable[..., Any], *parameters: Array) -> Any:
    """The function of single parameters on a batch of any shape."""
    shape = parameters[0].shape
    values = jax.vmap(function)(*(x.ravel() for x in parameters))
    return jax.tree_util.tree_map(lambda x: x.reshape(*shape, *x.shape[1:]), values)


@optimized
def points_at(surface: Any, u: Array, v: Array) -> Array:
    """Points of a surface at parameters of one batch shape."""
    return _of_batch(surface._value, u, v)


@optimized
def _points_of(surface: BezierPatches, patch: Array, u: Array, v: Array) -> Array:
    return _of_batch(surface._at, patch, u, v)


@optimized
def _partials(surface: Any, u: Array, v: Array) -> tuple[Array, ...]:
    value = surface._value

    def one(u: Array, v: Array) -> tuple[Array, ...]:
        first, second = jax.jacfwd(value, (0, 1)), jax.jacfwd(jax.jacfwd(value, (0, 1)), (0, 1))
        (uu, uv), (_, vv) = second(u, v)
        return value(u, v), *first(u, v), uu, uv, vv

    return _of_batch(one, u, v)
