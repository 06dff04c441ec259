"""Triangle meshes: unions of triangles, taken as surfaces and not as the solids that they may bound.

Common edges and vertices are found from the coordinates. Vertices at the same point count as one, so a mesh whose file
repeats vertices along seams can still be closed.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jhd._arithmetic.scaling import ldexp, length
from jhd._results.display import batch_text, box_text, count_text, described, is_known, opaque
from jhd._runtime.argument_hints import takes
from jhd._runtime.arrays import array_of, bare_array, is_traced, module_of, on_host, real_array
from jhd._shapes import sketches
from jhd._shapes.checks import Numbers
from jhd._shapes.foreign import HasVertices, PolyData, Trimesh
from jhd._shapes.homogeneous import affine_image, in_unit

# Scenes of trimesh, grids of PyVista.
_WAYS_TO_MESHES = ("to_mesh", "extract_surface")


class TriangleMesh(eqx.Module):
    """A surface made of triangles in space; differentiable in the vertices.

    Degenerate triangles count as the segments or points that they are. Vertices that belong to no triangle are kept,
    but are not part of the surface.

    >>> import jhd
    >>> square = jhd.TriangleMesh([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> float(square.area), square.is_closed, square.normals[0].tolist()
    (4.0, False, [0.0, 0.0, 1.0])

    Args:
        vertices: (vertices, 3) coordinates, in any unit of length; distances have the same unit.
        triangles: (triangles, 3) integers from 0: the indices of the corners, counter-clockwise seen from outside.

    Raises:
        ValueError: wrong shapes, no vertex, no triangle, NaN or infinity, or indices that are negative or too large.
        TypeError: vertices that are not real numbers, or triangles that are not integers.
    """

    vertices: Float[Array, "vertices 3"]
    triangles: Int[Array, "triangles 3"]

    @takes(2, "vertices and triangles; jhd.as_shape takes meshes of other packages and pairs (vertices, triangles)")
    def __init__(self, vertices: Numbers, triangles: Numbers):
        self.vertices = real_array("vertices", vertices)
        _check_rows("vertices", self.vertices.shape)
        self.triangles = _checked_triangles(triangles, self.vertices.shape[0])

    @classmethod
    def from_object(cls, mesh: "TriangleMesh | HasVertices") -> "TriangleMesh":
        """The mesh of an object of another library.

        >>> import jhd
        >>> import trimesh
        >>> jhd.TriangleMesh.from_object(trimesh.creation.box()).count
        12

        Args:
            mesh: a TriangleMesh, which is returned unchanged, or an object with `vertices` and either `faces` (for
                example of trimesh) or `triangles`.

        Returns:
            The same triangles as a TriangleMesh.

        Raises:
            TypeError: an object without these attributes.
            ValueError: arrays that the class refuses.
        """
        if isinstance(mesh, cls):
            return mesh
        vertices, faces = getattr(mesh, "vertices", None), getattr(mesh, "faces", getattr(mesh, "triangles", None))
        if vertices is None or faces is None:
            needed = "a TriangleMesh, or an object with vertices and faces (trimesh)"
            raise TypeError(f"mesh must be {needed}; got {kind_of(mesh)}.")
        return cls(bare_array("vertices", vertices), bare_array("faces", faces))

    def to_trimesh(self) -> Trimesh:
        """A trimesh.Trimesh of the same vertices and triangles, in their order.

        Raises:
            ImportError: trimesh is not installed.
        """
        try:
            import trimesh
        except ImportError as error:
            raise ImportError("to_trimesh needs trimesh: pip install jhd[mesh].") from error

        return trimesh.Trimesh(np.asarray(self.vertices), np.asarray(self.triangles), process=False)

    def to_pyvista(self) -> PolyData:
        """A pyvista.PolyData of the same vertices and triangles, in their order.

        Raises:
            ImportError: PyVista is not installed.
        """
        try:
            import pyvista  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ImportError("to_pyvista needs PyVista: pip install jhd[pyvista].") from error

        triangles = np.asarray(self.triangles)
        faces = np.concatenate([np.full((len(triangles), 1), 3), triangles], axis=1)
        return pyvista.PolyData(np.asarray(self.vertices), faces.ravel())

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        counts = count_text(self.vertices.shape[-2], "vertex", "vertices"), count_text(self.count, "triangle")
        return described(self, batch_text(self.vertices, 2), *counts, box_text(self.vertices))

    def _repr_svg_(self) -> str | None:
        """The edges, as notebooks show the mesh; None for a batch and for unknown numbers."""
        if opaque(self) or not is_known(self.vertices) or not is_known(self.triangles) or self.vertices.ndim != 2:
            return None
        corners = np.asarray(self.vertices)[np.asarray(self.triangles)]
        return sketches.svg(corners[:, [0, 1, 2, 0]], repr(self))

    @property
    def count(self) -> int:
        """Number of triangles."""
        return self.triangles.shape[-2]

    @property
    def dim(self) -> int:
        """Number of coordinates: 3."""
        return 3

    @property
    def corners(self) -> Float[Array, "triangles corners 3"]:
        """Coordinates of the three corners of each triangle."""
        vertices, triangles = on_host(self.vertices, self.triangles)
        return array_of(vertices[triangles])

    @property
    def normals(self) -> Float[Array, "triangles 3"]:
        """Unit normals; the zero vector for triangles without area."""
        doubled, sizes, _ = self._doubled_areas()
        return array_of(doubled / module_of(sizes).where(sizes > 0, sizes, 1.0))

    @property
    @np.errstate(over="ignore")
    def area(self) -> Float[Array, ""]:
        """Sum of the areas of all triangles, rounded; `jhd.surface_area(mesh)` returns certified bounds."""
        _, sizes, power = self._doubled_areas()
        return array_of(ldexp(0.5 * sizes.sum(), 2 * power))

    @property
    @np.errstate(over="ignore")
    def volume(self) -> Float[Array, ""]:
        """Enclosed volume of a closed mesh, positive if the normals point outwards.

        It is the sum of the signed volumes of the tetrahedra between the triangles and the center of the bounding box.
        The value is meaningless if the mesh is not closed.
        """
        corners, _, power, _ = in_unit(self.corners, None)
        center = 0.5 * (corners.min(axis=(-3, -2)) + corners.max(axis=(-3, -2)))
        a, b, c = module_of(corners).moveaxis(corners - center, -2, 0)
        return array_of(ldexp((a * module_of(corners).cross(b, c)).sum() / 6, 3 * power))

    @property
    def is_closed(self) -> bool:
        """Whether the mesh has no border: every edge belongs to at least two triangles.

        Raises:
            TypeError: the mesh is traced.
        """
        edges = edges_of(self)
        return bool(np.all(edges.count >= 2))

    @property
    def is_manifold(self) -> bool:
        """Whether every edge belongs to one triangle, or to two that run along it in opposite directions.

        Raises:
            TypeError: the mesh is traced.
        """
        edges = edges_of(self)
        return bool(np.all((edges.count <= 2) & ((edges.count == 1) | (edges.balance == 0))))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the bounding box of all triangles."""
        (corners,) = on_host(self.corners)
        return array_of(corners.min(axis=(-3, -2))), array_of(corners.max(axis=(-3, -2)))

    def point(self, triangle: Numbers, t: Numbers) -> Array:
        """Points of numbered triangles at barycentric coordinates, the sum of t_i times corner i: shape (*batch, 3).

        Args:
            triangle: indices of triangles.
            t: (*batch, 3) barycentric coordinates; each row is nonnegative and has the sum 1 for points of the
                triangle.

        Returns:
            The points, (*batch, 3).
        """
        corners = self.vertices[self.triangles[jnp.asarray(triangle)]]
        return jnp.sum(real_array("t", t)[..., None] * corners, axis=-2)

    @np.errstate(over="ignore", invalid="ignore")
    def transform(self, matrix: Numbers, offset: Numbers = 0.0) -> "TriangleMesh":
        """The image under x -> matrix x + offset; differentiable in both.

        A map that mirrors reverses every triangle, so that the outside stays outside.

        Args:
            matrix: (3, 3) real numbers.
            offset: (3,) translation in the unit of the coordinates, or one number for all axes.

        Returns:
            A mesh with the same numbers of vertices and triangles, in their order.

        Raises:
            ValueError: wrong shapes, NaN or infinity.
        """
        matrix = real_array("matrix", matrix)
        if matrix.shape != (3, 3):
            raise ValueError(f"matrix has shape {matrix.shape}; needs (3, 3).")
        rows, triangles = on_host(matrix, self.triangles)
        xp = module_of(rows)
        mirrored = (rows[0] * xp.cross(rows[1], rows[2])).sum() < 0
        triangles = array_of(xp.where(mirrored, triangles[:, np.array([0, 2, 1])], triangles))
        return TriangleMesh(affine_image(self.vertices, matrix, offset), triangles)

    def _doubled_areas(self) -> tuple[Any, Any, Any]:
        """Normals as long as twice the area, these lengths, and the power of two that is the unit of the corners."""
        corners, _, power, _ = in_unit(self.corners, None)
        a, b, c = module_of(corners).moveaxis(corners, -2, 0)
        doubled = module_of(corners).cross(b - a, c - a)
        return doubled, length(doubled)[..., None], power


class Edges(NamedTuple):
    """Incidence of triangles, edges and vertices of a mesh; vertices with equal coordinates count as one."""

    places: Int[np.ndarray, "triangles 3"]  # number of the point at each corner of each triangle
    # The edge from corner k to corner k + 1 of each triangle; -1 if both corners are one point.
    edge: Int[np.ndarray, "triangles 3"]
    count: Int[np.ndarray, " edges"]  # the number of triangles at each edge
    # The number of triangles that run along the edge one way, minus the number that run the other way.
    balance: Int[np.ndarray, " edges"]
    proper: Bool[np.ndarray, " triangles"]  # which triangles have three different corners; the others have no edges


def edges_of(mesh: TriangleMesh) -> Edges:
    """The edges of a mesh, found on the host.

    Raises:
        TypeError: the mesh is traced; which vertices coincide depends on its numbers.
    """
    if is_traced(mesh):
        raise TypeError("the edges of a mesh are found from its numbers; they cannot be traced.")
    places = places_of(np.asarray(mesh.vertices))[np.asarray(mesh.triangles)]
    next_segment = np.roll(places, -1, axis=1)
    proper = np.all(places != next_segment, axis=1)
    low, high = np.minimum(places, next_segment)[proper], np.maximum(places, next_segment)[proper]
    # Two point numbers in one integer sort faster than pairs.
    names = low.astype(np.int64) * (int(places.max()) + 1) + high
    _, index, count = np.unique(names.ravel(), return_inverse=True, return_counts=True)
    direction = np.where(places == np.minimum(places, next_segment), 1, -1)[proper]
    balance = np.bincount(index.ravel(), weights=direction.ravel(), minlength=len(count)).astype(np.int64)
    edge = np.full(places.shape, -1, np.int64)
    edge[proper] = index.reshape(-1, 3)
    return Edges(places, edge, count, balance, proper)


def places_of(points: Float[np.ndarray, "points 3"]) -> Int[np.ndarray, " points"]:
    """A number for each point, equal for equal coordinates; numbers are sorted by x, then y, then z."""
    order = np.lexsort((points[:, 2], points[:, 1], points[:, 0]))
    new = np.any(points[order[1:]] != points[order[:-1]], axis=1)
    numbers = np.empty(len(points), np.int64)
    numbers[order] = np.concatenate([[0], np.cumsum(new)])
    return numbers


def kind_of(value: object) -> str:
    """The type of an object, for messages; if the object holds a mesh, also the method that returns the mesh."""
    way = next((f": call its {way}()" for way in _WAYS_TO_MESHES if hasattr(value, way)), "")
    return type(value).__name__ + way


def check_mesh(name: str, value: object) -> None:
    """Raise TypeError unless the value is a triangle mesh."""
    if not isinstance(value, TriangleMesh):
        raise TypeError(f"{name} must be a TriangleMesh (see TriangleMesh.from_object); got {kind_of(value)}.")


def _check_rows(name: str, shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or shape[1] != 3:
        turned = " They are rows: pass the transpose?" if len(shape) == 2 and shape[0] == 3 < shape[1] else ""
        raise ValueError(f"{name} has shape {shape}; needs ({name}, 3).{turned}")
    if shape[0] == 0:
        raise ValueError(f"{name} is empty: its shape is {shape}.")


def _checked_triangles(triangles: Numbers, count: int) -> Array:
    """The triangles as an array of integers below count."""
    if is_traced(triangles):
        array = jnp.asarray(triangles)
        kind = "i" if jnp.issubdtype(array.dtype, jnp.integer) else "f"
    else:
        array = bare_array("triangles", triangles)
        kind = array.dtype.kind
    # An empty list has no type of its own.
    if array.size and kind not in "iu":
        raise TypeError(f"triangles must be integers; its dtype is {array.dtype}.")
    _check_rows("triangles", array.shape)
    if not is_traced(array):
        bad = np.argwhere((array < 0) | (array >= count))
        if len(bad):
            row = int(bad[0, 0])
            shown = ", ".join(map(str, array[row]))
            hint = "; if they start at 1, subtract 1" if array.min() == 1 and array.max() == count else ""
            raise ValueError(f"triangles[{row}] is ({shown}); needs indices from 0 to {count - 1}{hint}.")
    return jnp.asarray(array, dtype=int)
