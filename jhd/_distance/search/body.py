"""The base class of bodies: one class for each kind of shape, with everything that depends on the kind.

A shape in common coordinates is called `moved` here: a Net for curves and parametric surfaces, a Side for implicit
surfaces, rows (points, 3) for points and for the vertices of meshes.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.foot_maps import Triangles
from jhd._distance.cells.surfaces import FEET
from jhd._distance.nearest.target import AbstractTarget, curve_in_space
from jhd._distance.normalization.coordinates import Frame, common_points, diagonal
from jhd._distance.normalization.host_callback import AnswerForm
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.nets import hull_of, net_of, prepare_nets, repeated
from jhd._distance.normalization.stopping import Aim, AllowedGap, default_tolerance
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._distance.search import farthest_place
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.cell_heights import CellHeights
from jhd._distance.search.farthest_place import FarthestSearch
from jhd._distance.search.followed_cells import FollowedFeet
from jhd._distance.search.followed_graphs import FollowedGraphs, FollowedOnSurface
from jhd._distance.search.polished_place import About, place_of
from jhd._distance.search.search import AbstractSearch
from jhd._distance.search.sources import AbstractSource
from jhd._distance.search.weighted_cells import AbstractMeasured
from jhd._results.solution import Projection
from jhd._shapes.checks import largest_weight_ratio
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.prepared import prepared


class Together(NamedTuple):
    """Two shapes in common coordinates."""

    a: Any  # the first shape
    b: Any  # the second shape
    frame: Frame  # leads back to the user's coordinates
    moved: float  # bound on the error of the coordinates of both


Followed = tuple[About, FollowedFeet | None, FollowedGraphs | FollowedOnSurface | None]


class AbstractBody(ABC):
    """A shape of one kind.

    Args:
        shape: the shape; most methods need its working form, see jhd._shapes.prepared.
    """

    # The kind in words, its measure, and the piece and the parameters that locate a point ("" without pieces).
    name: str
    measure: str = "area"
    places: tuple[str, ...] = ("",)
    # Dimension of its measure: 0 for a number of points, 1 a length, 2 an area; None if no measure is certified.
    dimension: int | None = 2
    # Shape of the array of parameters of a point.
    parameters: tuple[int, ...] = ()
    # Makes a target of a shape.
    make_target: Callable[[Any], AbstractTarget]
    # Whether its pieces are curved.
    curved: bool = False
    # Whether common coordinates must be exact.
    exact: bool = False
    # Number of feet on it in a witness whose point is of a point set, and names of the counts of the search over it.
    feet_named: int = FEET
    counts: tuple[str, ...] = farthest_place.COUNTS
    # Largest number of points whose distances to it an estimate takes: each may take a tenth of a millisecond.
    most_points: int = 1 << 15

    def __init__(self, shape: Any):
        self.shape = shape

    # ---- the shape in the user's coordinates

    @property
    def box(self) -> tuple[Any, Any]:
        """The ends of a box that holds it."""
        return self.shape.bounds

    def is_usable(self) -> bool:
        """Return whether its numbers, which are known, are valid."""
        leaves = jax.tree_util.tree_leaves(self.shape)
        return all(np.all(np.isfinite(np.asarray(x))) for x in leaves) and self.is_consistent()

    def is_consistent(self) -> bool:
        """Return whether its numbers, which are finite, satisfy the conditions of its kind."""
        weights = getattr(self.shape, "weights", None)
        if weights is None:
            return True
        least, most = float(np.min(np.asarray(weights))), float(np.max(np.asarray(weights)))
        return least > 0 and most / largest_weight_ratio(np.asarray(weights).dtype) <= least

    def lacks_area(self) -> bool:
        """Return whether its area is certainly zero because of its form."""
        return False

    def order(self) -> tuple[int, ...]:
        """Return a sort key by kind and sizes: one order of two shapes suffices for compiled functions."""
        net = net_of(self.shape)
        return (0, *net.points.shape[1:3], net.weights is not None, net.points.shape[0])

    def in_space(self) -> Any:
        """Return the shape; a curve or points in the plane at height zero."""
        return curve_in_space(self.shape) if self.shape.dim == 2 else self.shape

    def triangles(self) -> TriangleMesh | None:
        """Return it as a mesh of triangles, degenerate for points and segments in space; None for other shapes."""
        return None

    def meshes_with(self, other: "AbstractBody") -> tuple[TriangleMesh, TriangleMesh] | None:
        """Return both shapes as meshes if the search for meshes serves them."""
        return None

    @property
    def points(self) -> Any:
        """The points (points, dim) that determine it, if it is a set of points or a mesh."""
        raise NotImplementedError

    @property
    def rows(self) -> Any:
        """The points that are moved to common coordinates and set their scale."""
        return self.points

    def at(self, params: Any) -> Array:
        """Return its points at parameters, or all of its points if it has no parameters."""
        if params is not None:
            raise ValueError("params is for curves and surfaces; leave it out for meshes (vertices) and points.")
        return self.points

    def cuts(self, parts: int) -> int:
        """Return into how many parts along each parameter its pieces are best cut for many queries."""
        return 1

    def target(self) -> AbstractTarget:
        """Return the target of the shape, whose numbers are known, stored with the shape; see `jhd.prepare`.

        Raises:
            ValueError: an implicit surface without points in its box.
        """
        return prepared(self.shape)._part(type(self).make_target)

    @abstractmethod
    def with_foot_derivatives(self, found: Projection, queries: Array) -> Projection:
        """Return nearest points differentiable in the queries and in the shape."""

    def smooth_parts(self, foot: np.ndarray, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return a number of the smooth part that holds each foot: of a piece the inside, a side or a corner."""
        return strata(segment, t.reshape(len(t), -1), 0.0, 1.0)

    # ---- the shape in common coordinates

    def hull(self) -> Any:
        """Return what sets the frame: a Net, or an implicit surface itself."""
        return hull_of(self.rows)

    def next_to(self, surface: "AbstractBody") -> tuple[Any, Any, Frame]:
        """Return another shape and this one in exact common coordinates, at least one an implicit surface."""
        return prepare_surfaces(surface.hull(), self.hull())

    def in_common(self, moved: Any, frame: Frame) -> Any:
        """Return it in common coordinates; `moved` is its hull there."""
        rows = np.asarray(self.rows)
        return common_points(frame, rows).astype(rows.dtype)

    def source(self, moved: Any) -> tuple[AbstractSource, float]:
        """Return a source, and the rounding error of its bounds; points have none, but a search of their own."""
        raise NotImplementedError

    @abstractmethod
    def target_in(self, moved: Any) -> tuple[AbstractTarget, float]:
        """Return a target, and its largest coordinate."""

    def measured(self, moved: Any, off: float, counts: np.ndarray | None) -> AbstractMeasured:
        """Return it as cells with measures, given the error of its coordinates and weights of points."""
        raise NotImplementedError

    def pieces(self, moved: Any) -> Net | Triangles | None:
        """Return pieces on which feet are followed; None if it has no pieces."""
        return None

    def feet_on(self, moved: Any) -> Any:
        """Return the shape on which feet of single points are followed; None for points."""
        pieces = self.pieces(moved)
        return None if pieces is None else repeated(pieces)

    def from_pieces(self, pieces: Net, moved: Any) -> FollowedOnSurface | None:
        """Return bounds over cells of curved pieces, if feet are followed on the shape as a whole."""
        return None

    def followed(self, other: "AbstractBody", pair: Together, target: AbstractTarget) -> Followed:
        """Return objects that follow feet: of a point, and over cells of pieces and of graphs (both may be None)."""
        first: Any = self.pieces(pair.a)
        second, feet_on = other.pieces(pair.b), other.feet_on(pair.b)
        followed = None if second is None else FollowedFeet(first, second, target)
        first = repeated(first)
        graphs = other.from_pieces(first, pair.b) if self.curved else None
        return partial(place_of, (first, feet_on)), followed, graphs

    def heights(self, other: "AbstractBody", pair: Together, target: AbstractTarget) -> CellHeights | None:
        """Return bounds over its cells by heights above another shape, or None if neither shape is curved."""
        first, second = self.pieces(pair.a), other.pieces(pair.b)
        curved = self.curved or other.curved
        return None if first is None or second is None or not curved else CellHeights(first, second, target)

    def form(self, other: "AbstractBody") -> AnswerForm:
        """Return shapes and types of every answer about the distance from it to another shape."""
        feet = other.feet_named if self.dimension == 0 else FEET
        return AnswerForm(dtype_of(self.shape), self.shape.dim, feet, self.parameters, other.parameters, self.counts)

    def search(self, other: "AbstractBody", method: BranchAndBound, aim: Aim) -> AbstractSearch:
        """Return the search for its point that is farthest from another shape."""
        pair = together(self, other)
        source, floor = self.source(pair.a)
        target, size = other.target_in(pair.b)
        frame, moved = pair.frame, pair.moved
        dtype = np.asarray(frame.center).dtype
        floor = (floor + 16 * gamma(64, dtype)) * (1 + size) + 8 * moved
        atol = float(default_tolerance(float(frame.common(np.asarray(joint_diagonal(self, other)))), dtype, 0.0))
        atol = atol if method.atol is None else float(frame.common(np.asarray(method.atol)))
        given = method.atol is not None
        allowed = AllowedGap(atol, float(method.rtol), lambda lower: floor + target.rounding(lower), given)
        followed = self.followed(other, pair, target)
        return FarthestSearch(source, target, frame, moved, allowed, aim, method.max_steps, *followed)


def together(a: AbstractBody, b: AbstractBody) -> Together:
    """Return both shapes in common coordinates; with an implicit surface only points and vertices are rounded."""
    if not (a.exact or b.exact):
        p, q, frame, moved = prepare_nets(a.hull(), b.hull())
        return Together(a.in_common(p, frame), b.in_common(q, frame), frame, moved)
    p, q, frame = b.next_to(a)
    p, q = a.in_common(p, frame), b.in_common(q, frame)
    moved = max(
        (gamma(4, x.dtype) * 2 * float(np.max(np.abs(x))) for x in (p, q) if isinstance(x, np.ndarray)), default=0
    )
    return Together(p, q, frame, float(moved))


def dtype_of(shape: Any) -> np.dtype:
    """Return the type of a shape's real numbers."""
    types = [x.dtype for x in jax.tree_util.tree_leaves(shape) if jnp.issubdtype(x.dtype, jnp.floating)]
    return np.dtype(types[0])


def joint_diagonal(*bodies: AbstractBody) -> float:
    """Return the length of the diagonal of the box of all shapes."""
    ends = [[np.asarray(end, np.float64) for end in body.box] for body in bodies]
    return float(diagonal([(low, high) for low, high in ends]))


def strata(segment: np.ndarray, x: np.ndarray, low: Any, high: Any) -> np.ndarray:
    """Return one number for each piece and stratum of a box: its inside, faces, edges and corners."""
    ends = (x <= np.asarray(low)) + 2 * (x >= np.asarray(high))
    return 27 * segment + ends @ 3 ** np.arange(ends.shape[1])
