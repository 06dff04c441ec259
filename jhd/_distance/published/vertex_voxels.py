"""The published local search for the nearest triangle of a mesh: simple, and not always right.

The cube around a mesh is cut into voxels. Voxels that hold a vertex are features, and the distance transform gives
every voxel its nearest feature. For a point, all features that are equally near to its voxel are taken, and the
triangles around their vertices are searched. The nearest triangle need not be one of these: a large triangle can pass
close to a point whose nearest vertices belong to others. So the distance found is an upper bound, and there is no lower
bound.

Source: C. Lin, C. Wang, "3-D signed Euclidean distance transform and its applications" (2003), section 3, algorithm 1,
steps 1, 2, 3.1.1 and 3.1.2.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from jhd._fields.distance_transform import METHODS, distance_transform
from jhd._runtime.arrays import check_whole, is_traced, one_of
from jhd._shapes.mesh import TriangleMesh, check_mesh, places_of
from jhd._shapes.prepared import prepared
from jhd._triangles.closest_point import (
    AbstractMeshSearch,
    ClosestPoints,
    TriangleTree,
    barycentric_of,
    in_unit_of,
    outward,
    pair_squares,
    triangle_tree,
)

# Finest grids that are tried: three such indices fit into one integer, and few floats are closer.
_FINEST = 1 << 20
# Points searched together: their memory grows with the number of triangles around their features.
_TOGETHER = 1 << 11


class VertexGrid(NamedTuple):
    """Voxels of the cube around a mesh, each with the nearest one that holds a vertex."""

    lower: Float[np.ndarray, "3"]  # lower corner of the cube, in the unit of the mesh's tree
    side: float  # side of the cube
    nearest: Int[np.ndarray, "voxels voxels voxels"]  # a nearest feature of each voxel
    features: Int[np.ndarray, "features 3"]  # the voxels that hold vertices
    starts: Int[np.ndarray, " ends"]  # start of each feature's triangles, and the end of the last
    # The triangles around the vertices in each feature, as sorted in the mesh's tree.
    triangles: Int[np.ndarray, " entries"]


class _Cube(NamedTuple):
    """The cube around a mesh, in the unit of its tree."""

    lower: Float[np.ndarray, "3"]  # its lower corner
    side: float  # its side, one for a mesh in a single point
    shares: Float[np.ndarray, "vertices 3"]  # the vertices of the triangles, as fractions of the side
    corners: Int[np.ndarray, "triangles 3"]  # the triangles as indices of these vertices
    count: int  # number of distinct vertices


def _cube(mesh: TriangleMesh, exponent: int) -> _Cube:
    # Vertices that no triangle names are no part of the surface.
    used, corners = np.unique(np.asarray(mesh.triangles), return_inverse=True)
    vertices = np.ldexp(np.asarray(mesh.vertices, np.float64)[used], -exponent)
    lower = vertices.min(axis=0)
    side = float((vertices.max(axis=0) - lower).max()) or 1.0
    count = int(places_of(vertices).max()) + 1
    return _Cube(lower, side, (vertices - lower) / side, corners.reshape(-1, 3), count)


def _one_each(cube: _Cube, n: int) -> bool:
    """Return whether no voxel holds more than one vertex; equal vertices count as one."""
    return len(np.unique(_names(_places(cube.shares, n), n))) == cube.count


def _places(shares: np.ndarray, n: int) -> np.ndarray:
    return np.clip(np.floor(shares * n), 0, n - 1).astype(np.int64)


def _names(places: np.ndarray, n: int) -> np.ndarray:
    return (places[:, 0] * n + places[:, 1]) * n + places[:, 2]


def _voxels_of(grid: VertexGrid, points: np.ndarray) -> np.ndarray:
    """Return the voxel of each point, as one number; for points outside the cube the nearest voxel."""
    n = len(grid.nearest)
    return _names(_places((points - grid.lower) / grid.side, n), n)


def _searched(
    grid: VertexGrid, tree: TriangleTree, points: np.ndarray, voxels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least squared distances, and sorted triangles that have them."""
    from scipy.spatial import KDTree

    features = KDTree(grid.features)
    square, triangle = np.empty(len(points), points.dtype), np.empty(len(points), np.int32)
    order = np.argsort(voxels, kind="stable")
    for start in range(0, len(points), _TOGETHER):
        rows = order[start : start + _TOGETHER]
        who, near = _candidates(grid, features, voxels[rows])
        squares = pair_squares(tree.table, points[rows][who], near.astype(np.int32))
        first = np.searchsorted(who, np.arange(len(rows)))
        square[rows] = np.minimum.reduceat(squares, first)
        best = np.flatnonzero(squares == square[rows][who])
        triangle[rows] = near[best[np.searchsorted(who[best], np.arange(len(rows)))]]
    return square, triangle


def _candidates(grid: VertexGrid, features: Any, voxels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of an ascending index into `voxels` and a triangle around a vertex in a nearest feature."""
    names, index = np.unique(voxels, return_inverse=True)
    places = np.stack(np.unravel_index(names, grid.nearest.shape), axis=1)
    squares = np.sum((grid.features[grid.nearest.reshape(-1)[names]] - places) ** 2, axis=1)
    balls = features.query_ball_point(places, np.sqrt(squares + 0.5))
    ends = np.concatenate([[0], np.cumsum([len(ball) for ball in balls])])
    tied = np.concatenate(balls).astype(np.int64)
    owner = np.repeat(np.arange(len(names)), np.diff(ends))
    # If the transform misses the nearest feature, the ball holds nearer ones, which the paper does not examine.
    as_near = np.sum((grid.features[tied] - places[owner]) ** 2, axis=1) == squares[owner]
    tied, owner = tied[as_near], owner[as_near]
    pair, entry = _expanded(np.searchsorted(owner, np.arange(len(names) + 1)), index)
    pair_of, listed = _expanded(grid.starts, tied[entry])
    return pair[pair_of], grid.triangles[listed]


def _expanded(starts: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all entries of the lists with indices `rows`: the index into `rows`, and the position of the entry."""
    lengths = np.diff(starts)[rows]
    owner = np.repeat(np.arange(len(rows)), lengths)
    return owner, np.arange(len(owner)) + (starts[rows] - np.cumsum(lengths) + lengths)[owner]


class VertexVoxels(AbstractMeshSearch):
    """Nearest points on a mesh by the published local search, over triangles around the nearest vertices.

    The distance found is the distance to one triangle, so it is an upper bound. It can be too large: nothing is
    certified about the other triangles, and the lower bound is 0. The method does not work under jit. A grid is kept
    with its mesh; while it is made, each voxel takes about 50 bytes.

    Changes to the source, Lin & Wang, 3-D signed Euclidean distance transform and its applications (2003), section 3:

     - The distance transform is exact by default.
     - The number of voxels along a side is a power of two.
     - A point outside the cube uses the nearest voxel of the cube.
     - Equally near features come from a tree. The source walks over the voxels between two cubes.

    Use it as `jhd.project(points, mesh, jhd.published.VertexVoxels())`.

    Args:
        resolution: number of voxels along each side of the cube. By default the least power of two for which no voxel
            holds more than one vertex, as published; unevenly spaced vertices can then need more memory than there is.
        capacity: largest number of voxels of a grid; by default 256 along each side.
        transform: the method of jhd.distance_transform: "exact", or "vector_propagation" as in the paper.

    Raises:
        ValueError: a count that is not a positive whole number, or an unknown transform.
    """

    resolution: int | None = eqx.field(static=True, default=None)
    capacity: int = eqx.field(static=True, default=1 << 24)
    transform: str = eqx.field(static=True, default="exact")

    def __check_init__(self) -> None:
        if self.resolution is not None:
            check_whole("resolution", self.resolution, 1)
        check_whole("capacity", self.capacity, 1)
        one_of("transform", self.transform, METHODS)

    def voxels(self, mesh: TriangleMesh) -> int:
        """Number of voxels along each side of the cube around a mesh.

        Args:
            mesh: a concrete TriangleMesh.

        Returns:
            The number, an int.

        Raises:
            TypeError: not a mesh, or a traced one.
            ValueError: a grid of more voxels than the capacity.
        """
        check_mesh("mesh", mesh)
        if is_traced(mesh):
            raise TypeError("the number of voxels depends on the vertices; pass a concrete mesh, outside jit.")
        return self._resolution(_cube(mesh, triangle_tree(mesh).exponent))

    def _search(self, points: np.ndarray, mesh: TriangleMesh) -> ClosestPoints:
        """The nearest points that the search finds; called by `jhd.project`.

        Args:
            points: concrete query points, (points, 3).
            mesh: a concrete TriangleMesh.

        Returns:
            The nearest points, with lower bounds of 0.

        Raises:
            ValueError: a grid of more voxels than the capacity.
        """
        # Methods of modules with equal fields are equal.
        grid, tree = prepared(mesh)._part(self._grid), triangle_tree(mesh)
        with np.errstate(over="ignore"):
            voxels = _voxels_of(grid, np.ldexp(points.astype(np.float64), -tree.exponent))
        tree, scaled = in_unit_of(tree, points)
        square, triangle = _searched(grid, tree, scaled, voxels)
        t = barycentric_of(tree, scaled, triangle)
        distance, number = np.sqrt(square), tree.order[triangle]
        corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)[number]]
        upper = distance.astype(np.float64) + tree.error(distance)
        return ClosestPoints(
            distance=np.ldexp(distance, tree.exponent),
            lower=np.zeros_like(distance),
            upper=outward(upper, tree.exponent, points.dtype, 1),
            foot=np.ldexp(np.einsum("nk,nkd->nd", t, np.ldexp(corners, -tree.exponent)), tree.exponent),
            triangle=number,
            t=t,
        )

    def _grid(self, mesh: TriangleMesh) -> VertexGrid:
        tree = triangle_tree(mesh)
        cube = _cube(mesh, tree.exponent)
        n, count = self._resolution(cube), mesh.count
        names, feature = np.unique(_names(_places(cube.shares, n), n), return_inverse=True)
        features = np.stack(np.unravel_index(names, (n, n, n)), axis=1)
        # A triangle with several corners in a voxel is there once.
        around = feature.reshape(-1)[cube.corners[tree.order]]
        entries = np.unique(around * count + np.arange(count)[:, None])
        starts = np.searchsorted(entries, np.arange(len(features) + 1) * count)
        occupied = np.zeros((n, n, n), bool)
        occupied.reshape(-1)[names] = True
        nearest = np.asarray(distance_transform(occupied, method=self.transform).nearest)
        numbers = np.cumsum(occupied, dtype=np.int32).reshape(n, n, n) - 1
        numbers = numbers[tuple(np.moveaxis(nearest, -1, 0))]
        return VertexGrid(cube.lower, cube.side, numbers, features, starts, entries % count)

    def _resolution(self, cube: _Cube) -> int:
        n = self.resolution
        if n is None:
            n = next((1 << k for k in range(_FINEST.bit_length()) if _one_each(cube, 1 << k)), None)
        if n is None or n**3 > self.capacity:
            needed = f"more than {_FINEST}" if n is None else f"{n}"
            asked = "at most one vertex a voxel needs" if self.resolution is None else "resolution asks for"
            room = f"{needed} voxels along each axis; capacity is {self.capacity} voxels in all"
            raise ValueError(f"{asked} {room}: give a lower resolution, or more capacity.")
        return n
