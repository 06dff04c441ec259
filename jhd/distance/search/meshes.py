"""Hausdorff distances of triangle meshes: branch and bound over the triangles of the one, with proven bounds.

The lower bound is the distance of the best point found, the upper one the largest bound of a cell that was not needed
any more, or that is still waiting (see jhd.distance.cells.triangles). Rounds of a bounded number of cells run from the
host: those with the largest bounds are split, and cells are dropped as soon as their bound is within the tolerance of
the lower one.

Sources: Kang, Kyung, Yoon, Kim, Fast and robust Hausdorff distance computation from triangle mesh to quad mesh in near-
zero cases (2018), and CGAL's bounded-error Hausdorff distance, after Tang, Lee, Kim, Interactive Hausdorff distance
computation for general polygonal models (2009), bound a cell in the same way; splitting at ties and the proof are ours.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from jhd.arithmetic.rounding import unit_roundoff
from jhd.arrays import is_traced
from jhd.distance.cells.triangles import Cells, Side, first_cells, split
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.search import Progress
from jhd.distance.witness.meshes import active_feet, with_mesh_derivatives, witness_of
from jhd.shapes.mesh import TriangleMesh, check_mesh
from jhd.solution import RESULTS, HausdorffSolution
from jhd.triangles.closest_point import in_unit_of, outward, triangle_tree

# Cells split in one round, and most that wait; each takes about 400 bytes, and its parts as much.
_BATCH, _WAITING = 1 << 14, 1 << 20
# Where the lower bound is below this share of the upper one, a may lie in b.
_COINCIDENT = 1e-3
# Default tolerance, as a share of the diagonal of the box of both meshes; the second in units of roundoff.
_ATOL, _ROUNDOFFS = 1e-10, 4096


class _Best(NamedTuple):
    """The farthest point found: its triangle, weights, computed distance, nearest triangle and proven lower bound."""

    owner: int
    weights: np.ndarray
    distance: float
    nearest: int
    lower: float


def mesh_directed(
    a: TriangleMesh,
    b: TriangleMesh,
    method: BranchAndBound,
    level: float = -np.inf,
    ceiling: float = np.inf,
    progress: Callable[[Progress], object] | None = None,
    direction: str = "a_to_b",
) -> HausdorffSolution:
    """Directed Hausdorff distance of meshes: the maximum over a of the distance to b, with proven bounds.

    The value is differentiable in the vertices of both, to first order (see jhd.distance.witness.meshes).

    Args:
        a: the mesh whose farthest point is looked for; its numbers must be known, under differentiation too.
        b: the mesh that distances are taken to.
        method: its tolerances, by default 1e-10 of the diagonal of the box of both (4096 units of roundoff in single
            precision), or what rounding leaves; max_steps bounds the rounds; the capacity is not used.
        level: nothing up to this matters: cells are dropped at it, and the upper bound stops there.
        ceiling: nothing above matters: the search ends when the lower bound exceeds it.
        progress: called after each round; interruption ends the search with the bounds reached.
        direction: for `progress` alone.

    Raises:
        TypeError: not meshes, or meshes that are traced.
    """
    check_mesh("a", a)
    check_mesh("b", b)
    fixed = lax.stop_gradient((a, b))
    if is_traced(fixed):
        raise TypeError("Hausdorff distances of meshes are searched from the host: not under jit or vmap.")
    return with_mesh_derivatives(_searched(*fixed, method, level, ceiling, progress, direction), a, b)


def _side(a: TriangleMesh, b: TriangleMesh) -> tuple[Side, np.ndarray]:
    vertices, triangles = np.asarray(a.vertices), np.asarray(a.triangles)
    tree, scaled = in_unit_of(triangle_tree(b), vertices)
    b_corners = np.ldexp(np.asarray(b.vertices)[np.asarray(b.triangles)], -tree.exponent)
    corners = scaled[triangles]
    return Side(corners, float(np.max(np.abs(corners))), tree, b_corners), scaled


def _tolerance(side: Side, method: BranchAndBound) -> Callable[[float], float]:
    """The gap that is allowed at a lower bound, in the unit of the tree."""
    ends = np.concatenate([side.corners.reshape(-1, 3), side.b_corners.reshape(-1, 3)]).astype(np.float64)
    diagonal = float(np.linalg.norm(ends.max(axis=0) - ends.min(axis=0)))
    share = max(_ATOL, _ROUNDOFFS * unit_roundoff(side.corners.dtype))
    given = method.atol
    atol = share * diagonal if given is None else float(np.ldexp(float(given), -side.tree.exponent))
    rtol = float(method.rtol)

    def allowed(lower: float) -> float:
        # Bounds err to both sides; less than this cannot be told.
        rounding = 4 * float(side.tree.error(np.array(lower))) + 4 * float(side.slack(64))
        return max(atol, rtol * lower, rounding)

    return allowed


def _searched(
    a: TriangleMesh,
    b: TriangleMesh,
    method: BranchAndBound,
    level: float,
    ceiling: float,
    progress: Callable[[Progress], object] | None,
    direction: str,
) -> HausdorffSolution:
    side, scaled = _side(a, b)
    exponent = side.tree.exponent
    level, ceiling = (float(np.ldexp(float(x), -exponent)) for x in (level, ceiling))
    allowed = _tolerance(side, method)
    waiting, used = first_cells(side, np.asarray(a.triangles), scaled)
    best = _improved(None, side, waiting)
    dropped, rounds, split_count, result = -np.inf, 0, 0, RESULTS.successful
    try:
        while True:
            done = waiting.upper <= max(best.lower + allowed(best.lower), level)
            dropped = max(dropped, float(waiting.upper[done].max(initial=-np.inf)))
            waiting = waiting.take(np.flatnonzero(~done))
            if progress is not None:
                top = max(dropped, float(waiting.upper.max(initial=-np.inf)))
                ends = (
                    float(outward(np.array([x]), exponent, np.dtype(float), k)[0])
                    for x, k in ((best.lower, -1), (top, 1))
                )
                progress(Progress(direction, rounds, waiting.count, *ends))
            if not waiting.count or best.lower > ceiling:
                break
            if rounds >= method.max_steps or waiting.count > _WAITING:
                result = RESULTS.gap_not_closed
                break
            order = np.argsort(-waiting.upper, kind="stable")
            clipping = best.lower <= _COINCIDENT * float(waiting.upper.max()) or rounds % 8 > 5
            parts = split(side, waiting.take(order[:_BATCH]), rounds, clipping)
            best = _improved(best, side, parts)
            split_count += min(_BATCH, waiting.count)
            waiting = Cells.join([waiting.take(order[_BATCH:]), parts])
            rounds += 1
    except KeyboardInterrupt:
        result = RESULTS.interrupted
    upper = max(dropped, float(waiting.upper.max(initial=-np.inf)), best.lower)
    stats = {
        "steps": rounds,
        "cells": a.count + 4 * split_count,
        "split": split_count,
        "points": len(used) + 3 * split_count,
    }
    return _solution(side, best, upper, result, stats)


def _improved(best: _Best | None, side: Side, cells: Cells) -> _Best:
    """The best point found so far."""
    distance = np.sqrt(cells.square.astype(np.float64))
    row, corner = np.unravel_index(int(np.argmax(distance)), distance.shape)
    there = float(distance[row, corner])
    if best is not None and there <= best.distance:
        return best
    error = float(side.tree.error(np.array(there)) + side.slack(cells.depth[row]))
    lower = max((there - error) * (1 - 4e-16), best.lower if best is not None else 0.0, 0.0)
    weights = cells.weights[row, corner].astype(np.float64)
    return _Best(int(cells.owner[row]), weights, there, int(cells.nearest[row, corner]), lower)


def _solution(side: Side, best: _Best, upper: float, result: Any, stats: dict[str, int]) -> HausdorffSolution:
    dtype, exponent = side.corners.dtype, side.tree.exponent
    feet = active_feet(side, best.owner, best.weights, best.nearest, upper - best.lower)
    lower, top = (outward(np.array([x]), exponent, dtype, sign)[0] for x, sign in ((best.lower, -1), (upper, 1)))
    # What cannot be told from zero is called zero.
    distance = best.distance if best.lower > 0 else 0.0
    value = np.clip(np.ldexp(distance, exponent).astype(dtype), lower, top)
    return HausdorffSolution(
        value=jnp.asarray(value),
        lower=jnp.asarray(lower),
        upper=jnp.asarray(top),
        witness=witness_of(feet, side, best.owner, best.weights, distance),
        result=result,
        stats={name: jnp.asarray(count) for name, count in stats.items()},
    )
