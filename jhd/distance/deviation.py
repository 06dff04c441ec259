"""The distance to one shape along another, as a distribution: largest, mean, root mean square, quantiles, shares."""

import json
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from jhd.arrays import check_scalar, check_whole, is_traced, real_array
from jhd.distance.cells.weighted import Weights, quantile_bounds, share_bounds
from jhd.distance.frame.coordinates import Frame
from jhd.distance.hausdorff import directed_hausdorff
from jhd.distance.project import project
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.distribution import COUNTS, Distribution, DistributionSearch
from jhd.distance.search.measured import AbstractMeasured, MeasuredMesh, MeasuredNet, MeasuredPoints
from jhd.distance.search.mixes import Together, diagonal_of, dtype_of, target_in, together
from jhd.distance.search.points import is_points
from jhd.distance.search.search import Listener, Progress, drive
from jhd.shapes.as_shape import Shape, taken_as
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve, BezierSegments
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch
from jhd.solution import (
    RESULTS,
    HausdorffSolution,
    Projection,
    name_of,
    throw_unless_successful,
    to_plain,
)

# Where no tolerance is asked for, gaps up to this share of the diagonal stay.
_SHARE = 1e-6
# What rounding leaves between bounds, in units of roundoff of coordinates of at most one.
_ROUNDINGS = 4096
# Most steps of the search; its cells end it much earlier.
_MAX_STEPS = 4000


class Bounds(NamedTuple):
    """A number that is proven to lie between two others.

    Args:
        lower: the lower one.
        upper: the upper one; inf where nothing is proven.
    """

    lower: float
    upper: float

    @property
    def value(self) -> float:
        """The middle, which is off by at most half of what they are apart."""
        return 0.5 * self.lower + 0.5 * self.upper


class DistanceSamples(NamedTuple):
    """Parts of a that are all of it, for pictures and statistics.

    Args:
        place: the middle of each, about.
        lower: proven lower bounds of the distance everywhere in the part.
        upper: proven upper bounds.
        share: bounds of the share of a that it is, as length, area or number, (parts, 2), up to one common factor.
    """

    place: Float[np.ndarray, "parts dim"]
    lower: Float[np.ndarray, " parts"]
    upper: Float[np.ndarray, " parts"]
    share: Float[np.ndarray, "parts 2"]


class Deviation(eqx.Module):
    """The distance d(x, b) for x along a, as a distribution over the length or area of a, or the number of its points.

    All bounds are proven: lower <= exact <= upper.

    Args:
        a: the shape along which the distance is looked at.
        b: the shape that distances are taken to.
        maximum: the largest distance, the directed Hausdorff distance; its value is differentiable as that is.
        mean: the mean distance.
        rms: the root of the mean of the squared distance.
        measure: the length or area of a, or the number of its points, in the unit of the coordinates.
        samples: parts of a with bounds, from which quantiles and shares are taken.
        result: successful where maximum, mean and rms are known to the tolerance, else why they are not.
        stats: counts.
    """

    a: Any = eqx.field(metadata={"stored": False})
    b: Any = eqx.field(metadata={"stored": False})
    maximum: HausdorffSolution
    mean: Bounds
    rms: Bounds
    measure: Bounds
    samples: DistanceSamples = eqx.field(metadata={"stored": False})
    result: Any
    stats: dict[str, int]

    def quantile(self, q: float) -> Bounds:
        """The least distance that a share q of a does not exceed; q = 0.5 is the median.

        Args:
            q: above 0 and at most 1.

        Raises:
            ValueError: another q.
        """
        if not 0 < q <= 1:
            raise ValueError(f"q is {q}; needs a number above 0 and at most 1.")
        lower, upper = quantile_bounds(self._weights(), self.samples.lower, self.samples.upper, float(q))
        return Bounds(lower, min(upper, float(self.maximum.upper)))

    def share_within(self, threshold: float) -> Bounds:
        """The share of a whose distance to b is at most the threshold, between 0 and 1.

        Args:
            threshold: a length of at least 0, in the unit of the coordinates.

        Raises:
            ValueError: a threshold that is no length.
        """
        if not threshold >= 0:
            raise ValueError(f"threshold is {threshold}; needs a length of at least 0.")
        surely, maybe = self.samples.upper <= threshold, self.samples.lower <= threshold
        return Bounds(*share_bounds(self._weights(), surely, maybe))

    def at(self, places: Numbers | None = None) -> Projection:
        """Distances to b, with bounds and feet, at places of a; differentiable as `project` is.

        Args:
            places: None for the points of a set or the vertices of a mesh; of a curve parameters (...,) as in a call of
                it, of a parametric surface rows (..., 2) of its parameters.

        Raises:
            ValueError: no places on a curve or surface, places on points or a mesh, or rows of another length.
        """
        return project(_places(self.a, places), self.b, throw=False)

    def to_json(self, **options: Any) -> str:
        """The bounds as JSON text, and some quantiles; what is not proven is null.

        Args:
            options: handed to json.dumps, for example indent=2.
        """
        return json.dumps(self.to_plain(), **options)

    def to_plain(self) -> dict[str, Any]:
        """The bounds as JSON holds them."""
        quantiles = {str(q): to_plain(list(self.quantile(q))) for q in (0.5, 0.9, 0.99)}
        ends = {name: to_plain(list(getattr(self, name))) for name in ("mean", "rms", "measure")}
        return {"maximum": to_plain(self.maximum), **ends, "quantiles": quantiles, "result": name_of(self.result)} | {
            "stats": dict(self.stats)
        }

    def to_trimesh(self) -> Any:
        """A trimesh.Trimesh of a mesh a, with the distances at its vertices as the attribute `distance`.

        Raises:
            TypeError: a is no mesh.
            ImportError: trimesh is not installed.
        """
        import trimesh

        mesh = self._mesh()
        attributes: Any = {"distance": np.asarray(self.at().distance)}
        return trimesh.Trimesh(
            np.asarray(mesh.vertices), np.asarray(mesh.triangles), process=False, vertex_attributes=attributes
        )

    def to_pyvista(self) -> Any:
        """A pyvista.PolyData of a mesh a, with the distances at its points as the array `distance`.

        Raises:
            TypeError: a is no mesh.
            ImportError: PyVista is not installed.
        """
        import pyvista  # pyright: ignore[reportMissingImports]

        mesh = self._mesh()
        triangles = np.asarray(mesh.triangles)
        faces = np.concatenate([np.full((len(triangles), 1), 3), triangles], axis=1)
        data = pyvista.PolyData(np.asarray(mesh.vertices), faces.ravel())
        data.point_data["distance"] = np.asarray(self.at().distance)
        return data

    def _mesh(self) -> TriangleMesh:
        if not isinstance(self.a, TriangleMesh):
            raise TypeError(f"a is {type(self.a).__name__}; needs a TriangleMesh: take a.to_mesh(atol).mesh for it.")
        return self.a

    def _weights(self) -> Weights:
        return Weights(self.samples.share[:, 0], self.samples.share[:, 1])

    def __float__(self) -> float:
        return self.mean.value

    def __repr__(self) -> str:
        largest = Bounds(float(self.maximum.lower), float(self.maximum.upper))
        rows = {"maximum": largest, "rms": self.rms, "mean": self.mean, "median": self.quantile(0.5)}
        text = ", ".join(f"{name} in [{x.lower:.6g}, {x.upper:.6g}]" for name, x in rows.items())
        return f"Deviation({text},\n  {len(self.samples.lower)} parts, {name_of(self.result)})"


def deviation(
    a: Any,
    b: Any,
    *,
    atol: Numbers | None = None,
    rtol: Numbers = 1e-3,
    max_cells: int = 1 << 17,
    throw: bool = True,
    progress: Callable[[Progress], object] | None = None,
) -> Deviation:
    """How far b is along a: the largest distance, mean, root mean square, quantiles and shares, with proven bounds.

    a is cut into cells whose lengths or areas and distances to b have proven bounds; those that leave most of the gaps
    of mean and root mean square are cut on, until both are known to the tolerance. The distance is that of the stored
    numbers. What a covers twice counts twice.

    What a cell leaves open is about its squared size times the curvature of either shape, so the number of cells grows
    like 1 / gap on a surface and like its root along a curve. Where the distance is as small as that, as between a
    surface and its triangulation, ask for a larger rtol. Quantiles and shares come from the same cells, whose bounds
    are as wide as the distance varies in them.

    The value of `maximum` (within about the root of its gap) and the distances of `at(places)` are differentiable in
    both shapes, to first order; mean and the other bounds are plain numbers. Shapes must be known: there is no
    deviation under jit or vmap.

    >>> import jhd
    >>> found = deviation(jhd.polyline([(0, 0), (1, 0)]), jhd.points([(0, 0)]))
    >>> found.mean.lower <= 0.5 <= found.mean.upper, found.mean.upper - found.mean.lower < 1e-3
    (True, True)

    Args:
        a: points (jhd.points), a curve, a parametric surface or a mesh, or what jhd.as_shape takes for one.
        b: any shape of the same dimension, likewise.
        atol: the gap that may stay between bounds, in the unit of the coordinates; by default 1e-6 of the diagonal of
            the box of both shapes.
        rtol: the same relative to the upper bound; the larger of both counts.
        max_cells: most cells.
        throw: whether to raise where the tolerance was not reached.
        progress: called with a Progress now and then, with the bounds of the mean after those of the maximum.

    Raises:
        TypeError: what is no shape, traced shapes, or a an ImplicitSurface, whose area is not proven.
        ValueError: shapes of different dimensions, a surface b without points in its box, a without length or area, or
            a negative tolerance.
        NotProvenError: the tolerance was not reached, or the search was interrupted, and throw is True; it carries the
            Deviation, whose bounds are true.
    """
    a, b = taken_as("a", a), taken_as("b", b)
    absolute, relative = _checked(a, b, atol, rtol, max_cells)
    tolerance = BranchAndBound(atol=absolute, rtol=relative)
    maximum = directed_hausdorff(a, b, tolerance, throw=False, progress=progress)
    found, pair, dimension = _distributed(a, b, (absolute, relative), max_cells, maximum, progress)
    deviation = _in_units(a, b, maximum, found, pair, dimension)
    if throw:
        throw_unless_successful(deviation)
    return deviation


def _checked(a: Any, b: Any, atol: Any, rtol: Any, max_cells: int) -> tuple[float, float]:
    """Both tolerances."""
    if isinstance(a, ImplicitSurface):
        raise TypeError("a is an ImplicitSurface, whose area is not proven; take a mesh or a parametric surface.")
    for name, shape in (("a", a), ("b", b)):
        if not isinstance(shape, Shape):
            raise TypeError(f"{name} must be a shape of jhd; got {type(shape).__name__}.")
    if isinstance(a, AbstractPatch) and min(a.patches().degrees) == 0:
        raise ValueError("a has no area: there is nothing to average over; a patch of degree zero is a curve.")
    if is_traced(*jax.tree_util.tree_leaves(jax.lax.stop_gradient((a, b)))):
        raise TypeError(
            "deviation needs known shapes: its cells depend on them. Under tracing take directed_hausdorff."
        )
    check_whole("max_cells", max_cells, 16)
    given = None if atol is None else real_array("atol", atol)
    relative = real_array("rtol", rtol)
    check_scalar("atol", given)
    check_scalar("rtol", relative)
    if given is None:
        given = _SHARE * diagonal_of(*(_working(shape) for shape in (a, b)))
    return float(given), float(relative)


def _working(shape: Any) -> Any:
    """A shape as searches take it, nothing of it traced; of the plane at height zero."""
    shape = jax.lax.stop_gradient(shape)
    if isinstance(shape, AbstractPatch):
        return shape.patches()
    if not isinstance(shape, AbstractCurve):
        return shape
    segments = shape.segments()
    if segments.dim == 3:
        return segments
    points = np.asarray(segments.control_points)
    weights = None if segments.weights is None else np.asarray(segments.weights)
    return BezierSegments(np.concatenate([points, np.zeros_like(points[..., :1])], axis=-1), weights)


def _distributed(
    a: Any, b: Any, tolerances: tuple[float, float], max_cells: int, maximum: HausdorffSolution, progress: Any
) -> tuple[Distribution, Together, int]:
    a, b = _working(a), _working(b)
    pair = together(a, b)
    frame, moved = pair.frame, pair.moved
    source = _measured(a, pair.a, moved)
    target, size = target_in(b, pair.b)
    dtype = dtype_of(a)
    # Less than this cannot be told: bounds err by some hundred roundings to both sides.
    floor = 8 * moved + _ROUNDINGS * float(np.finfo(dtype).eps) * (1 + size)
    atol = max(float(frame.common(np.asarray(tolerances[0]))), floor)

    def allowed(upper: float) -> float:
        return max(atol, tolerances[1] * upper)

    most = float(frame.common(np.asarray(maximum.upper, np.float64), np.inf)) + moved
    search = DistributionSearch(source, target, dtype, most, allowed, max_cells, _MAX_STEPS)
    listener = Listener(progress, frame)
    # Who interrupted the search for the maximum waits for no other.
    listener.interrupted = name_of(maximum.result) == "interrupted"
    found = drive(search, listener)
    if source.dimension and not np.any(found.cells.flat.lower > 0):
        raise ValueError(f"a has no {('length', 'area')[source.dimension - 1]}: there is nothing to average over.")
    return found, pair, source.dimension


def _measured(shape: Any, moved: Any, off: float) -> AbstractMeasured:
    if is_points(shape):
        return MeasuredPoints(moved, off)
    if isinstance(shape, TriangleMesh):
        return MeasuredMesh(moved[np.asarray(shape.triangles)], off)
    return MeasuredNet(moved, off)


def _in_units(
    a: Any, b: Any, maximum: HausdorffSolution, found: Distribution, pair: Together, dimension: int
) -> Deviation:
    """What was found, in the user's coordinates."""
    frame, over, flat = pair.frame, found.cells.over, found.cells.flat
    ends = partial(_lengths, frame, pair.moved)
    mean, rms = (Bounds(*(float(x) for x in ends(*known))) for known in ((found.lower, found.upper), found.rms))
    lower, upper = ends(over.lower, over.upper)
    place = np.asarray(frame.place(np.mean(flat.corners, axis=1)))[:, : a.dim]
    samples = DistanceSamples(place, lower, upper, np.stack([flat.lower, flat.upper], axis=1))
    result = maximum.result if found.result == RESULTS.successful else found.result
    counts = {name: int(count) for name, count in zip(COUNTS, (found.steps, len(lower)), strict=True)}
    measure = _measure(frame, dimension, float(np.sum(flat.lower)), float(np.sum(flat.upper)), len(lower))
    return Deviation(a, b, maximum, mean, rms, measure, samples, result, counts)


def _lengths(frame: Frame, moved: float, lower: Any, upper: Any) -> tuple[np.ndarray, np.ndarray]:
    below, above = np.maximum(np.asarray(lower) - moved, 0.0), np.asarray(upper) + moved
    room = 4 * np.finfo(np.float64).eps
    low, high = frame.length(below * (1 - room), 0.0), frame.length(above * (1 + room), np.inf)
    return np.asarray(low, np.float64), np.asarray(high, np.float64)


def _measure(frame: Frame, dimension: int, lower: float, upper: float, count: int) -> Bounds:
    """The measure of all cells, whose sum rounds once a cell."""
    if dimension == 0:
        return Bounds(float(count), float(count))
    room = (count + 16) * np.finfo(np.float64).eps
    power = dimension * int(frame.first + frame.second)
    with np.errstate(over="ignore", under="ignore"):
        low, high = (np.ldexp(x, power) for x in (lower * (1 - room), upper * (1 + room)))
    return Bounds(float(min(low, np.finfo(np.float64).max)), float(np.nextafter(high, np.inf)))


def _places(shape: Any, places: Any) -> Array:
    if isinstance(shape, TriangleMesh) or is_points(shape):
        if places is not None:
            raise ValueError("places is for curves and surfaces; those of a mesh are its vertices, of points all.")
        return shape.vertices if isinstance(shape, TriangleMesh) else shape.segments().control_points[:, 0]
    if places is None:
        raise ValueError("places is missing: the parameters on the curve or surface at which distances are wanted.")
    rows = real_array("places", places)
    if isinstance(shape, AbstractCurve):
        return shape(rows)
    if rows.ndim == 0 or rows.shape[-1] != 2:
        raise ValueError(f"places has shape {rows.shape}; needs (..., 2), the two parameters of a surface.")
    return shape(rows[..., 0], rows[..., 1])
