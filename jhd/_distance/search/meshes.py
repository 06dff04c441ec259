"""Hausdorff distances of triangle meshes: branch and bound over the triangles of one mesh, with proven bounds.

The lower bound is the distance of the best point found. The upper bound is the largest bound of all cells, dropped or
waiting (see jhd._distance.cells.triangles). In a step the host splits a bounded number of cells with the largest
bounds. A cell is dropped as soon as its bound is within the tolerance of the lower bound.

Sources: Kang, Kyung, Yoon, Kim, Fast and robust Hausdorff distance computation from triangle mesh to quad mesh in near-
zero cases (2018), and CGAL's bounded-error Hausdorff distance, after Tang, Lee, Kim, Interactive Hausdorff distance
computation for general polygonal models (2009), bound a cell in the same way; splitting at ties and the proof are ours.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from typing_extensions import override

from jhd._distance.cells.surfaces import FEET
from jhd._distance.cells.triangles import MeshSide, TriangleCells, first_cells, split
from jhd._distance.normalization.coordinates import diagonal, exact_middle, extremes, frame_of
from jhd._distance.normalization.host_callback import AnswerForm, from_program
from jhd._distance.normalization.stopping import Aim, AllowedGap, default_tolerance
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.search import AbstractSearch, Listener, Standing, drive
from jhd._distance.witness.meshes import active_feet, witness_of
from jhd._results.solution import RESULTS, HausdorffSolution
from jhd._runtime.arrays import array_of, is_tracing, joined
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.closest_point import in_unit_of, outward, triangle_tree

# Cells split in one step, and most that wait for each row of the capacity; a cell takes about 400 bytes, and its parts
# as much.
_BATCH = 1 << 14
_ROOM = 1 << 11
# Counts: steps, cells, cells that were split, and points that were measured.
_COUNTS = "steps", "cells", "split", "points"
# If the lower bound is below this fraction of the upper bound, a may lie in b.
_COINCIDENT = 1e-3
# Cells are dropped within this fraction of the requested gap.
_OF_ASKED = 0.99


class _FarthestPoint(NamedTuple):
    """The farthest point found: its triangle, weights, computed distance, nearest triangle and proven lower bound."""

    owner: int
    weights: np.ndarray
    distance: float
    nearest: int
    lower: float


class _CutCells(NamedTuple):
    """A search: cells that wait, the best point, the largest bound of cells that were dropped, and counts."""

    waiting: TriangleCells
    best: _FarthestPoint
    dropped: float
    corners: int  # of a that were measured
    steps: int = 0
    split: int = 0

    @property
    def upper(self) -> float:
        """Proven bound of the whole distance."""
        return max(self.dropped, float(self.waiting.upper.max(initial=-np.inf)), self.best.lower)


def mesh_directed(
    a: TriangleMesh, b: TriangleMesh, method: BranchAndBound, aim: Aim, listener: Listener, direction: Any
) -> HausdorffSolution:
    """Return the directed distance of two meshes in their own coordinates; under tracing the host searches, too.

    Meshes far from the origin are moved there along the axes on which the move is exact, since bounds count roundings
    of the largest coordinate.
    """

    def search(meshes: Any, method: BranchAndBound, aim: Aim) -> HausdorffSolution:
        near, center = _near_origin(*meshes)
        return _moved_by(center, drive(MeshSearch(near[0], near[1], method, aim), listener, direction))

    # Inside jit all operations are traced, also on known numbers.
    if is_tracing(a, b, method, aim):
        listener = Listener()
        form = AnswerForm(a.vertices.dtype, 3, FEET, (3,), (3,), _COUNTS)
        return from_program(search, form.refused, (a, b), method, aim)
    return search((a, b), method, aim)


def _near_origin(*meshes: TriangleMesh) -> tuple[tuple[TriangleMesh, ...], np.ndarray]:
    """Return meshes minus a common center. Its coordinate is zero on axes on which the difference would round."""
    corners = [extremes(np.asarray(x.vertices)[np.asarray(x.triangles)]) for x in meshes]
    frame = frame_of(corners, center=exact_middle)
    center = np.ldexp(frame.center, frame.first)
    if not np.any(center):
        return meshes, center
    # Vertices that no triangle has may overflow.
    with np.errstate(over="ignore"):
        rows = [array_of(np.asarray(x.vertices) - center) for x in meshes]
    return tuple(eqx.tree_at(lambda m: m.vertices, x, y) for x, y in zip(meshes, rows, strict=True)), center


def _moved_by(center: np.ndarray, solution: HausdorffSolution) -> HausdorffSolution:
    if not np.any(center):
        return solution
    witness = solution.witness
    point, feet = (array_of(np.asarray(x) + center) for x in (witness.point, witness.feet))
    return replace(solution, witness=replace(witness, point=point, feet=feet))


class MeshSearch(AbstractSearch):
    """The search for the point of a mesh that is farthest from another one; its solutions are in the user's unit.

    Args:
        a: the mesh whose farthest point is searched, its numbers known.
        b: the mesh that distances are taken to, its numbers known.
        method: gives the tolerances (by default of jhd._distance.normalization.stopping) and limits waiting cells.
        aim: range of distances that matter: cells are dropped at its level, and the upper bound stops there.
    """

    first_steps = 0

    def __init__(self, a: TriangleMesh, b: TriangleMesh, method: BranchAndBound, aim: Aim):
        self._a, self._method, self.max_steps = a, method, method.max_steps
        self._side, self._scaled = _side(a, b)
        self._allowed = _allowed(self._side, method)
        self._level, self._ceiling = (float(np.ldexp(float(x), -self._side.tree.exponent)) for x in aim)

    @override
    def begin(self) -> _CutCells:
        cells, used = first_cells(self._side, np.asarray(self._a.triangles), self._scaled)
        return self._dropping(_CutCells(cells, _improved(None, self._side, cells), -np.inf, len(used)))

    @override
    def advance(self, state: _CutCells, limit: int, growing: bool) -> tuple[_CutCells, Standing]:
        while self._is_open(state) and state.steps < limit and self._has_room(state):
            state = self._dropping(self._step(state))
        going_on = self._is_open(state) and self._has_room(state)
        return state, Standing(self._solution(state), going_on, False, state.steps, state.waiting.count)

    def _is_open(self, state: _CutCells) -> bool:
        return bool(state.waiting.count) and state.best.lower <= self._ceiling

    def _has_room(self, state: _CutCells) -> bool:
        return state.waiting.count <= _ROOM * self._method.queue_size

    def _dropping(self, state: _CutCells) -> _CutCells:
        """Return the state without the cells whose bounds are within the tolerance."""
        lower = state.best.lower
        done = state.waiting.upper <= max(lower + self._allowed(lower), self._level)
        dropped = max(state.dropped, float(state.waiting.upper[done].max(initial=-np.inf)))
        return state._replace(waiting=state.waiting.take(np.flatnonzero(~done)), dropped=dropped)

    def _step(self, state: _CutCells) -> _CutCells:
        """Split the cells with the largest bounds."""
        waiting, best, steps = state.waiting, state.best, state.steps
        order = np.argsort(-waiting.upper, kind="stable")
        clipping = best.lower <= _COINCIDENT * float(waiting.upper.max()) or steps % 8 > 5
        parts = split(self._side, waiting.take(order[:_BATCH]), steps, clipping)
        return state._replace(
            waiting=joined([waiting.take(order[_BATCH:]), parts]),
            best=_improved(best, self._side, parts),
            steps=steps + 1,
            split=state.split + min(_BATCH, waiting.count),
        )

    def _solution(self, state: _CutCells) -> HausdorffSolution:
        side, best, upper = self._side, state.best, state.upper
        dtype, exponent = side.corners.dtype, side.tree.exponent
        feet = active_feet(side, best.owner, best.weights, best.nearest, upper - best.lower)
        lower, top = (outward(np.array([x]), exponent, dtype, sign)[0] for x, sign in ((best.lower, -1), (upper, 1)))
        # A distance that cannot be distinguished from zero is reported as zero.
        distance = best.distance if best.lower > 0 else 0.0
        value = np.clip(np.ldexp(distance, exponent).astype(dtype), lower, top)
        result = RESULTS.gap_not_closed if self._has_room(state) else RESULTS.capacity_reached
        gap = state.upper - max(best.lower, self._level)
        closed = not self._is_open(state) and (gap <= self._allowed.asked(best.lower) or best.lower > self._ceiling)
        counts = state.steps, self._a.count + 4 * state.split, state.split, state.corners + 3 * state.split
        return HausdorffSolution(
            value=array_of(value),
            lower=array_of(lower),
            upper=array_of(top),
            witness=witness_of(feet, side, best.owner, best.weights, distance),
            result=RESULTS.successful if closed else result,
            stats={name: array_of(np.asarray(count)) for name, count in zip(_COUNTS, counts, strict=True)},
        )


def _side(a: TriangleMesh, b: TriangleMesh) -> tuple[MeshSide, np.ndarray]:
    vertices, triangles = np.asarray(a.vertices), np.asarray(a.triangles)
    tree, scaled = in_unit_of(triangle_tree(b), vertices)
    b_corners = np.ldexp(np.asarray(b.vertices)[np.asarray(b.triangles)], -tree.exponent)
    corners = scaled[triangles]
    return MeshSide(corners, float(np.max(np.abs(corners))), tree, b_corners), scaled


def _allowed(side: MeshSide, method: BranchAndBound) -> AllowedGap:
    """Return the gap that is allowed, in the unit of the tree."""
    floor = partial(_rounding, side)
    if method.atol is None:
        size = diagonal([extremes(x.astype(np.float64)) for x in (side.corners, side.b_corners)])
        atol = float(default_tolerance(size, side.corners.dtype, floor(0.0)))
    else:
        # The rest is for rounding the bounds outward.
        atol = _OF_ASKED * float(np.ldexp(float(method.atol), -side.tree.exponent))
    return AllowedGap(atol, float(method.rtol), floor, method.atol is not None)


def _rounding(side: MeshSide, lower: float) -> float:
    """Return the smallest gap that can be resolved, given that bounds err to both sides."""
    return 4 * float(side.tree.error(np.array(lower))) + 4 * float(side.slack(64))


def _improved(best: _FarthestPoint | None, side: MeshSide, cells: TriangleCells) -> _FarthestPoint:
    """Return the best point so far, after the corners of `cells`."""
    distance = np.sqrt(cells.square.astype(np.float64))
    row, corner = np.unravel_index(int(np.argmax(distance)), distance.shape)
    there = float(distance[row, corner])
    if best is not None and there <= best.distance:
        return best
    error = float(side.tree.error(np.array(there)) + side.slack(cells.depth[row]))
    lower = max((there - error) * (1 - 4e-16), best.lower if best is not None else 0.0, 0.0)
    weights = cells.weights[row, corner].astype(np.float64)
    return _FarthestPoint(int(cells.owner[row]), weights, there, int(cells.nearest[row, corner]), lower)
