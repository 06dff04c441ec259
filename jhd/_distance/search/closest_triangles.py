"""Minimum distances of triangle meshes: the search from the host, and derivatives of its result.

Point sets and polylines are meshes of degenerate triangles, so they are served too. Meshes are surfaces, not solids:
for a mesh inside another one, the result is the distance of the surfaces.

The derivative is the derivative of the distance between the features that hold the nearest points: two points, a point
and a line, a point and a plane, or two lines. So it is right to any order if the points stay on these features.
"""

from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array
from typing_extensions import override

from jhd._arithmetic.rationals import float_above, float_below, float_near, root_between
from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import common_exponent, length, scale_of
from jhd._distance.normalization.coordinates import diagonal, extremes
from jhd._distance.normalization.host_callback import from_program
from jhd._distance.normalization.implicit_derivatives import MovingNumbers, TouchedRows, following
from jhd._distance.normalization.stopping import AllowedGap, default_tolerance
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.search import AbstractSearch, Listener, Standing, drive
from jhd._distance.search.tree_pairs import MeshBoxes, PairSearch, in_one_unit, mesh_boxes, stored_corners
from jhd._results.solution import RESULTS, MinimumSolution
from jhd._runtime.arrays import is_traced, is_tracing, undifferentiated
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.prepared import prepared
from jhd._triangles.closest_point import outward
from jhd.progress import Callback


def of_meshes(a: TriangleMesh, b: TriangleMesh, method: BranchAndBound, progress: Callback | None) -> MinimumSolution:
    """Return the minimum distance of two meshes, differentiable in both; under tracing the host searches, too."""
    first, second = undifferentiated((a, b))
    # Inside jit all operations are traced, also on known numbers.
    if is_tracing(first, second, method):
        found = from_program(_searched, partial(_unusable, a.vertices.dtype), (first, second), method)
    else:
        found = _searched((first, second), method, progress)
    solution, triangles, weights = found
    if not is_traced(a, b):
        return solution
    parts = [TouchedRows(mesh.vertices, k, mesh.triangles) for mesh, k in zip((a, b), triangles, strict=True)]
    numbers = {"value": solution.value, "point_a": solution.point_a, "point_b": solution.point_b}
    return replace(solution, **following(_moving, numbers, parts, (solution.value, weights)))


def _searched(meshes: Any, method: BranchAndBound, progress: Callback | None = None) -> "_FoundPair":
    return drive(TriangleSearch(meshes[0], meshes[1], method), Listener(progress))


class _FoundPair(NamedTuple):
    """A solution in the user's unit, and the triangles that hold its points."""

    solution: MinimumSolution
    triangles: tuple[Any, Any]
    weights: Any  # barycentric coordinates of the points, (shapes, corners)

    @property
    def lower(self) -> Array:
        return self.solution.lower

    @property
    def upper(self) -> Array:
        return self.solution.upper

    @property
    def result(self) -> Any:
        return self.solution.result


def _unusable(dtype: Any) -> _FoundPair:
    """Return the result for meshes that contain a NaN. Every result has its structure."""
    zero, infinite, nowhere = jnp.zeros((), dtype), jnp.full((), jnp.inf, dtype), jnp.full(3, jnp.nan, dtype)
    stats = {"steps": jnp.array(0), "exact": jnp.array(0)}
    solution = MinimumSolution(infinite, zero, infinite, nowhere, nowhere, RESULTS.nonfinite_value, stats)
    return _FoundPair(solution, (jnp.array(0), jnp.array(0)), jnp.zeros((2, 3), dtype))


class TriangleSearch(AbstractSearch):
    """The search of jhd._distance.search.tree_pairs. The object is its own state, consistent after any interruption.

    Args:
        a: the first mesh, its numbers known.
        b: the second mesh, its numbers known.
        method: the options.
    """

    first_steps = 1

    def __init__(self, a: TriangleMesh, b: TriangleMesh, method: BranchAndBound):
        self._sides = in_one_unit(prepared(a)._part(mesh_boxes), prepared(b)._part(mesh_boxes))
        self._corners = stored_corners(a), stored_corners(b)
        self._allowed = _allowed(self._sides, method)
        self.max_steps = method.max_steps

    @override
    def begin(self) -> PairSearch:
        return PairSearch(*self._sides, self._corners)

    @override
    def advance(self, state: PairSearch, limit: int, growing: bool) -> tuple[PairSearch, Standing]:
        while state.is_waiting and state.steps < limit:
            state.advance()
        if not state.is_waiting:
            state.settle(self._allowed, limit - state.steps)
        going_on = state.is_waiting or not state.is_settled
        return state, Standing(self._found(state), going_on, False, state.steps + state.tried, state.waiting)

    def _found(self, state: PairSearch) -> _FoundPair:
        best, dtype = state.best, self._sides[0].corners.dtype
        points = [
            _places(triangles[k], w, dtype)
            for triangles, k, w in zip(self._corners, best.triangles, best.weights, strict=True)
        ]
        lower, upper = self._bounds(state)
        value = float_near(root_between(best.nearest.square)[0], dtype)
        near = state.upper - state.lower <= self._allowed.asked(state.upper)
        solution = MinimumSolution(
            value=jnp.asarray(np.clip(value, lower, upper), dtype),
            lower=jnp.asarray(lower, dtype),
            upper=jnp.asarray(upper, dtype),
            point_a=jnp.asarray(points[0]),
            point_b=jnp.asarray(points[1]),
            result=RESULTS.successful if near else RESULTS.gap_not_closed,
            stats={"steps": jnp.asarray(state.steps), "exact": jnp.asarray(state.exact)},
        )
        weights = np.array([[float_near(x, dtype) for x in row] for row in best.weights])
        return _FoundPair(solution, best.triangles, weights)

    def _bounds(self, state: PairSearch) -> tuple[Any, Any]:
        """Return the bounds in the user's unit: of the nearest pair measured, unless others may be nearer."""
        dtype = self._sides[0].corners.dtype
        low, high = root_between(state.best.nearest.square)
        lower, upper = float_below(low, dtype), float_above(high, dtype)
        if state.lower < state.best.lower:
            lower = min(lower, outward(np.array([state.lower]), self._sides[0].exponent, dtype, -1)[0])
        return lower, upper


def _allowed(sides: tuple[MeshBoxes, MeshBoxes], method: BranchAndBound) -> AllowedGap:
    """Return the gap that is allowed at an upper bound, in the common unit."""
    corners, dtype = [side.corners.astype(np.float64) for side in sides], sides[0].corners.dtype
    size = float(diagonal([extremes(x) for x in corners]))
    # Gap that rounding leaves if not all pairs can be measured exactly.
    floor = gamma(256, dtype) * size
    atol = default_tolerance(size, dtype, floor)
    if method.atol is not None:
        atol = np.ldexp(float(method.atol), -sides[0].exponent)
    return AllowedGap(float(atol), float(method.rtol), lambda upper: floor, method.atol is not None)


def _places(corners: np.ndarray, weights: tuple[Fraction, ...], dtype: np.dtype) -> np.ndarray:
    """Return the point at exact barycentric coordinates, rounded once."""
    rows = [[Fraction(float(x)) for x in corner] for corner in corners]
    place = [sum((w * row[k] for w, row in zip(weights, rows, strict=True)), Fraction(0)) for k in range(3)]
    return np.array([float_near(x, dtype) for x in place])


def _moving(rows: list[Array], constants: tuple[Array, Array]) -> MovingNumbers:
    """Return distance and nearest points of the features that the corners of positive weight span.

    The result is a function of these corners. At most two directions d, e are free: the distance is the part of p + x d
    - (q + y e) that x and y cannot change.
    """
    value, weights = constants
    corners, active = jnp.stack(rows), weights > 0
    fixed = lax.stop_gradient(corners)
    origin = fixed[0, 0]
    scale = scale_of(common_exponent(fixed - origin), corners.dtype)
    corners = (corners - origin) * scale
    first = jnp.argmax(active, axis=1)
    base = corners[np.arange(2), first]
    sides = (corners - base[:, None]) * jnp.asarray([1.0, -1.0], corners.dtype)[:, None, None]
    free = (active & (np.arange(3) != first[:, None])).reshape(-1)
    order = jnp.argsort(~free)[:2]
    directions = sides.reshape(-1, 3)[order]
    e = base[0] - base[1]
    distance, shares = _apart(e, directions, free[order])
    steps = jnp.zeros(6, corners.dtype).at[order].set(shares).reshape(2, 3, 1)
    points = base + jnp.sum(steps * (corners - base[:, None]), axis=1)
    point_a, point_b = points / scale + origin
    moving = {"value": distance / scale, "point_a": point_a, "point_b": point_b}
    return MovingNumbers(moving, value > 0)


def _apart(e: Array, directions: Array, free: Array) -> tuple[Array, Array]:
    """Return the distance of e from zero along the free directions, and how far to go along them."""
    u, v = (jnp.where(here, d, 0.0) for here, d in zip(free, directions, strict=True))
    normal = jnp.cross(u, v)
    a, b, c, d, f = u @ u, u @ v, v @ v, u @ e, v @ e
    area_sq = jnp.sum(normal**2)
    face = free[0] & free[1] & (area_sq > 0)
    safe = jnp.where(face, area_sq, 1.0)
    both = jnp.stack([b * f - c * d, b * d - a * f]) / safe
    one = jnp.stack([-d / jnp.where(a > 0, a, 1.0), jnp.zeros_like(a)])
    height = jnp.sum(e * normal) / jnp.sqrt(safe)
    # With the normal the distance keeps its digits if the points are close.
    distance = jnp.where(face, jnp.where(height < 0, -height, height), length(e + one[0] * u))
    return distance, jnp.where(face, both, one)
