"""Bodies: for each kind of shape one class with everything that searches and entries ask of the kind.

`body_of` returns the body of a shape. A new kind is a subclass of `AbstractBody`, registered at the end of this module.
"""

from functools import partial, singledispatch
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._arithmetic.scaling import length
from jhd._distance.cells.foot_maps import Triangles
from jhd._distance.nearest.target import AbstractTarget, MeshTarget, PointTarget
from jhd._distance.normalization.coordinates import Frame, common_points, extremes
from jhd._distance.normalization.custom_derivatives import attached
from jhd._distance.normalization.net_jets import Net, eta, point_error
from jhd._distance.normalization.nets import net_of, repeated
from jhd._distance.normalization.stopping import Aim, AllowedGap, default_tolerance
from jhd._distance.normalization.surfaces import Side, prepare_surfaces
from jhd._distance.search.body import AbstractBody, Followed, Together, joint_diagonal, strata
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.followed_graphs import FollowedGraphs, FollowedOnSurface, places_on_graphs
from jhd._distance.search.on_patches import NetTarget
from jhd._distance.search.on_surfaces import SurfaceTarget
from jhd._distance.search.points import COUNTS as POINT_COUNTS
from jhd._distance.search.points import PointSearch
from jhd._distance.search.search import AbstractSearch
from jhd._distance.search.sources import AbstractSource, MeshSource, NetSource
from jhd._distance.search.surface_source import SurfaceSource, looked_at
from jhd._distance.search.weighted_cells import AbstractMeasured, MeasuredMesh, MeasuredNet, MeasuredPoints
from jhd._distance.witness.mesh_feet import with_mesh_derivatives
from jhd._distance.witness.surface_projection import with_patch_derivatives, with_surface_derivatives
from jhd._results.solution import Projection
from jhd._runtime.arrays import real_array
from jhd._shapes.checks import empty_surface
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch
from jhd._shapes.prepared import prepared, working

# Resolution of the search over an implicit surface, in units of roundoff of the common coordinates.
_ULPS = 512
# The size of points, in units of a surface, from which on their common box is the unit; by the bytes of a number.
_FAR = {8: 2.0**400, 4: 2.0**40}


class PointBody(AbstractBody):
    """A set of points: BezierSegments of degree zero."""

    name = "set of points"
    measure = "points"
    places = ("point",)
    dimension = 0
    make_target = PointTarget
    feet_named = PointTarget.feet_named
    counts = POINT_COUNTS
    most_points = 1 << 18

    @property
    @override
    def points(self) -> Any:
        return self.shape.control_points[:, 0]

    @override
    def triangles(self) -> TriangleMesh:
        """Return degenerate triangles in space; points of the plane lie at height zero."""
        rows = self.points if self.shape.dim == 3 else jnp.pad(self.points, ((0, 0), (0, 1)))
        return _as_triangles(rows[:, None])

    @override
    def with_foot_derivatives(self, found: Projection, queries: Array) -> Projection:
        foot = self.points[found.element]
        return attached(attached(found, found.distance > 0, distance=length(queries - foot)), foot=foot)

    @override
    def next_to(self, surface: AbstractBody) -> tuple[Any, Any, Frame]:
        # Points so far away that their squares overflow next to the surface share its coordinates; it may vanish there.
        found = prepare_surfaces(*(surface.hull(),) * 2)
        rows = np.asarray(self.points)
        is_far = np.max(np.abs(common_points(found[2], rows))) > _FAR[rows.dtype.itemsize]
        return prepare_surfaces(surface.hull(), self.hull()) if is_far else found

    @override
    def target_in(self, moved: np.ndarray) -> tuple[AbstractTarget, float]:
        return PointTarget(BezierSegments(moved[:, None])), float(np.max(np.abs(moved)))

    @override
    def measured(self, moved: np.ndarray, off: float, counts: np.ndarray | None) -> AbstractMeasured:
        return MeasuredPoints(moved, off, counts)

    @override
    def search(self, other: AbstractBody, method: BranchAndBound, aim: Aim) -> AbstractSearch:
        rows, target = np.asarray(self.points), other.target()
        # Targets whose bounds differ by rounding only need no tolerance.
        atol = 0.0 if target.sharp else float(default_tolerance(joint_diagonal(self, other), rows.dtype, 0.0))
        atol = atol if method.atol is None else float(method.atol)
        allowed = AllowedGap(atol, float(method.rtol), target.rounding, method.atol is not None)
        return PointSearch(rows, target, allowed, aim, method.max_steps)


def _target_of_net(shape: Any) -> NetTarget:
    return NetTarget(net_of(shape))


def _target_of_pieces(shape: Any) -> NetTarget:
    return prepared(working(shape))._part(_target_of_net)


class AbstractNetBody(AbstractBody):
    """A shape whose working form consists of Bezier pieces."""

    curved = True
    make_target = staticmethod(_target_of_net)

    @override
    def at(self, params: Any) -> Array:
        if params is None:
            raise ValueError("params is missing: pass the parameters of the curve or surface at which to measure.")
        rows = real_array("params", params)
        if not self.parameters:
            return self.shape(rows)
        if rows.ndim == 0 or rows.shape[-1] != 2:
            raise ValueError(f"params has shape {rows.shape}; needs (..., 2), the two parameters of a surface.")
        return self.shape(rows[..., 0], rows[..., 1])

    @override
    def with_foot_derivatives(self, found: Projection, queries: Array) -> Projection:
        return with_patch_derivatives(found, queries, Net(self.shape.control_points, self.shape.weights))

    @override
    def hull(self) -> Net:
        return net_of(self.shape)

    @override
    def in_common(self, moved: Net, frame: Frame) -> Net:
        count = self.shape.count
        return Net(moved.points[:count], None if moved.weights is None else moved.weights[:count])

    @override
    def source(self, moved: Net) -> tuple[AbstractSource, float]:
        net = repeated(moved)
        return NetSource(net, self.shape.count), 16 * (point_error(net) + 2 * eta(net))

    @override
    def target_in(self, moved: Net) -> tuple[AbstractTarget, float]:
        return prepared(moved)._part(NetTarget), 1.0

    @override
    def measured(self, moved: Net, off: float, counts: np.ndarray | None) -> AbstractMeasured:
        return MeasuredNet(moved, off)

    @override
    def pieces(self, moved: Net) -> Net:
        return moved


class CurveBody(AbstractNetBody):
    """A curve; its working form is BezierSegments."""

    name = "curve"
    measure = "length"
    places = ("segment", "t")
    dimension = 1
    most_points = 1 << 16

    @override
    def triangles(self) -> TriangleMesh | None:
        points = self.shape.segments().control_points
        return _as_triangles(points) if points.shape[1] <= 2 and points.shape[2] == 3 else None


class PatchBody(AbstractNetBody):
    """A parametric surface; its working form is BezierPatches."""

    name = "parametric surface"
    places = ("patch", "u", "v")
    # A B-spline surface is found by its own numbers, a sixteenth of those of its patches.
    make_target = staticmethod(_target_of_pieces)
    parameters = (2,)

    @override
    def lacks_area(self) -> bool:
        return min(self.shape.patches().degrees) == 0

    @override
    def cuts(self, parts: int) -> int:
        return max(1, round((parts / net_of(self.shape).points.shape[0]) ** 0.5))


class MeshBody(AbstractBody):
    """A triangle mesh."""

    name = "mesh"
    places = ("triangle", "t1", "t2", "t3")
    make_target = MeshTarget
    parameters = (3,)
    most_points = 1 << 18

    @property
    @override
    def box(self) -> tuple[Any, Any]:
        """The ends of the box of all vertices that a triangle has."""
        return extremes(np.asarray(self.shape.vertices)[np.asarray(self.shape.triangles)])

    @override
    def triangles(self) -> TriangleMesh:
        return self.shape

    @override
    def meshes_with(self, other: AbstractBody) -> tuple[TriangleMesh, TriangleMesh] | None:
        # Segments are bounded as nets.
        mesh = None if other.dimension == 1 else other.triangles()
        return None if mesh is None else (self.shape, mesh)

    @property
    @override
    def points(self) -> Any:
        return self.shape.vertices

    @property
    @override
    def rows(self) -> np.ndarray:
        """The vertices; those of no triangle, which may be far away, are replaced by one that counts."""
        vertices, triangles = np.asarray(self.shape.vertices), np.asarray(self.shape.triangles)
        counts = np.zeros(len(vertices), bool)
        counts[triangles] = True
        return np.where(counts[:, None], vertices, vertices[triangles[0, 0]])

    @override
    def with_foot_derivatives(self, found: Projection, queries: Array) -> Projection:
        return with_mesh_derivatives(found, queries, self.shape)

    @override
    def smooth_parts(self, foot: np.ndarray, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return a number of the vertex, edge or face that holds each foot."""
        held = np.sort(np.where(t > 0, np.asarray(self.shape.triangles, np.int64)[segment] + 1, 0), axis=1)
        return held @ (len(self.shape.vertices) + 1) ** np.arange(3, dtype=np.int64)

    @override
    def source(self, moved: np.ndarray) -> tuple[AbstractSource, float]:
        return MeshSource(self.pieces(moved).corners), 0.0

    @override
    def target_in(self, moved: np.ndarray) -> tuple[AbstractTarget, float]:
        return MeshTarget(TriangleMesh(moved, self.shape.triangles)), 1.0

    @override
    def measured(self, moved: np.ndarray, off: float, counts: np.ndarray | None) -> AbstractMeasured:
        return MeasuredMesh(self.pieces(moved).corners, off)

    @override
    def pieces(self, moved: np.ndarray) -> Triangles:
        return Triangles(moved[np.asarray(self.shape.triangles)])


class ImplicitBody(AbstractBody):
    """An implicit surface."""

    name = "implicit surface"
    dimension = None
    exact = True
    make_target = SurfaceTarget

    @override
    def is_consistent(self) -> bool:
        low, high = (np.asarray(end) for end in self.box)
        return bool(np.any(np.asarray(self.shape.coefficients) != 0) and np.all(low < high))

    @override
    def order(self) -> tuple[int, ...]:
        return (1,)

    @override
    def with_foot_derivatives(self, found: Projection, queries: Array) -> Projection:
        return with_surface_derivatives(found, queries, self.shape)

    @override
    def smooth_parts(self, foot: np.ndarray, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return a number of the inside, face, edge or corner of the box that holds each foot."""
        return strata(segment, foot, *self.box)

    @override
    def hull(self) -> ImplicitSurface:
        return self.shape

    @override
    def in_common(self, moved: Side, frame: Frame) -> Side:
        return moved

    @override
    def source(self, moved: Side) -> tuple[AbstractSource, float]:
        target, empty = looked_at(moved)
        if bool(empty):
            raise empty_surface()
        return SurfaceSource(target), _ULPS * float(np.finfo(np.asarray(moved.lower).dtype).eps)

    @override
    def target_in(self, moved: Side) -> tuple[AbstractTarget, float]:
        return prepared(moved)._part(SurfaceTarget), 1.0

    @override
    def feet_on(self, moved: Side) -> Side:
        return moved

    @override
    def from_pieces(self, pieces: Net, moved: Side) -> FollowedOnSurface | None:
        return FollowedOnSurface(pieces, moved)

    @override
    def followed(self, other: AbstractBody, pair: Together, target: AbstractTarget) -> Followed:
        second = other.pieces(pair.b)
        graphs = None if second is None else FollowedGraphs(pair.a, second, target)
        return partial(places_on_graphs, pair.a, other.feet_on(pair.b)), None, graphs


def _as_triangles(points: Array) -> TriangleMesh:
    """Return points or straight segments in space as degenerate triangles."""
    count, order, _ = points.shape
    # Weights move points along their segment, and do not change it.
    corners = np.arange(count * order).reshape(count, order)[:, [0, -1, -1]]
    return TriangleMesh(points.reshape(-1, 3), corners)


def diagonal_of(*shapes: Any) -> float:
    """Return the length of the diagonal of the box of all shapes."""
    return joint_diagonal(*map(body_of, shapes))


def target_of(shape: Any) -> AbstractTarget:
    """Return the target of a shape whose numbers are known; see AbstractBody.target."""
    return body_of(shape).target()


@singledispatch
def body_of(shape: Any) -> AbstractBody:
    """Return the body of a shape."""
    raise TypeError(f"no body for {type(shape).__name__}.")


def _of_segments(shape: BezierSegments) -> AbstractBody:
    return CurveBody(shape) if shape.degree else PointBody(shape)


body_of.register(BezierSegments, _of_segments)
body_of.register(AbstractCurve, CurveBody)
body_of.register(AbstractPatch, PatchBody)
body_of.register(TriangleMesh, MeshBody)
body_of.register(ImplicitSurface, ImplicitBody)
