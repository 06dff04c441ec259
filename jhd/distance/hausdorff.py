"""The entries: directed and two-sided Hausdorff distances of two shapes."""

import math
from collections.abc import Callable
from typing import Any

from jhd._results.solution import (
    Decision,
    HausdorffSolution,
    on_device,
    throw_unless_successful,
)
from jhd._runtime.arrays import same_arrays
from jhd.distance.decisions import checked_limit, decided, of_copies
from jhd.distance.frame.method import AbstractHausdorffMethod, check_serves
from jhd.distance.pairs import pair_of
from jhd.distance.search.branch_and_bound import BranchAndBound, default_method
from jhd.distance.search.search import Progress
from jhd.shapes.checks import Numbers
from jhd.slips import belongs

# What belongs to a method is easily handed to the call.
_OF_THE_METHOD = {
    name: f"write method=jhd.BranchAndBound({name}=...)" for name in ("atol", "rtol", "max_steps", "capacity")
}


@belongs(**_OF_THE_METHOD)
def directed_hausdorff(
    a: Any,
    b: Any,
    method: AbstractHausdorffMethod | None = None,
    *,
    throw: bool = True,
    progress: Callable[[Any], object] | None = None,
) -> HausdorffSolution:
    """Directed Hausdorff distance: the maximum over a of the minimum over b of the distance.

    The distance is that of the stored numbers (Bezier segments, coefficients, triangles) taken as real. Works under jit
    and vmap, where checks of values are left out and `throw` is ignored: read `result`. Meshes, parametric surfaces,
    and shapes of two kinds are searched from the host, there too.

    The value is differentiable in all arrays of both shapes, twice. CubeIntervals() has no derivatives.

    Between parametric surfaces, and shapes of two kinds, the cost grows like diagonal / gap where the distance is
    constant over a whole part of a (a shape and its offset); the bounds are then true and wider, as
    RESULTS.family_of_maxima.

    Args:
        a: the shape whose farthest point is looked for: points (jhd.points), a curve, an ImplicitSurface, a mesh, a
            parametric surface (BezierPatch, BezierPatches, BSplineSurface), or what jhd.as_shape takes for one.
        b: the shape that distances are taken to, of any of these kinds and of the same dimension.
        method: how; by default BranchAndBound(), which serves all. CubeIntervals() serves implicit surfaces, not under
            jit; TwoStep(), BiarcTrimming() and AlgebraicEvents() serve curves.
        throw: whether to raise where the method did not reach what it promises.
        progress: called with a Progress now and then while the search lasts (by CubeIntervals with a VoxelProgress);
            not under jit. Ctrl-C ends the search with the bounds reached, as RESULTS.interrupted.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: what is no shape, or a method that does not serve them.
        ValueError: shapes of different dimensions, or a surface proven empty in its box.
        NotProvenError: the method failed or was interrupted and throw is True; it carries the solution.
    """
    pair = pair_of(a, b, method, progress)
    return _finish(pair.finished(pair.measured()), throw)


@belongs(**_OF_THE_METHOD)
def hausdorff(
    a: Any,
    b: Any,
    method: AbstractHausdorffMethod | None = None,
    *,
    throw: bool = True,
    progress: Callable[[Any], object] | None = None,
) -> HausdorffSolution:
    """Hausdorff distance: the larger of both directed distances; the witness's `direction` says which, a_to_b at a tie.

    `directions` holds both directed distances. The one from b to a is looked for only where it exceeds the other one:
    below that its bounds are true and may be wide. Derivatives are those of the larger one, see `directed_hausdorff`.

    Args:
        a: points (jhd.points), a curve, an ImplicitSurface, a mesh, a parametric surface (BezierPatch, BezierPatches,
            BSplineSurface), or what jhd.as_shape takes for one.
        b: another of these, of the same dimension.
        method: how; by default BranchAndBound(). CubeIntervals() serves implicit surfaces, not under jit.
        throw: whether to raise where the method did not reach what it promises.
        progress: as for `directed_hausdorff`.

    Returns:
        The distance with its bounds, in the unit of the coordinates.

    Raises:
        TypeError: what is no shape, or a method that does not serve them.
        ValueError: shapes of different dimensions, or a surface proven empty in its box.
        NotProvenError: the method failed or was interrupted and throw is True; it carries the solution.
    """
    pair = pair_of(a, b, method, progress)
    there, back = pair.both()
    return _finish(pair.larger(pair.reported(there), pair.reported(back)), throw)


@belongs(**_OF_THE_METHOD)
def hausdorff_at_most(
    a: Any,
    b: Any,
    threshold: Numbers,
    method: AbstractHausdorffMethod | None = None,
    *,
    directed: bool = False,
    progress: Callable[[Progress], object] | None = None,
) -> Decision:
    """Whether the Hausdorff distance is at most the threshold: proven yes, proven no, or undecided at the tolerance.

    The same search as for the distance, ended as soon as the bounds are on one side of the threshold, which takes a few
    steps where the threshold is not close to the distance. A shape and itself, or a copy of its numbers, are at the
    distance 0.

    Args:
        a: points (jhd.points), a curve, an ImplicitSurface, a mesh, a parametric surface (BezierPatch, BezierPatches,
            BSplineSurface), or what jhd.as_shape takes for one.
        b: another of these, of the same dimension.
        threshold: a length of at least 0, in the unit of the coordinates.
        method: options of the search; its tolerance says when it gives up.
        directed: whether the directed distance from a to b is meant.
        progress: as for `directed_hausdorff`.

    Returns:
        The answer with the bounds of the distance that were reached; `result` says why where it is undecided.

    Raises:
        TypeError: what is no shape, or another method than BranchAndBound.
        ValueError: shapes of different dimensions, a surface proven empty in its box, or a threshold that is no length.
    """
    method = default_method() if method is None else method
    # It proves both bounds, and ends where they say enough.
    check_serves(method, a, b, (BranchAndBound,))
    pair, limit = pair_of(a, b, method, progress), checked_limit(threshold)
    # Inward, so that bounds cut off at the level are not above the threshold, nor at the ceiling below it.
    level, ceiling = pair.length(limit, 0.0), pair.length(limit, math.inf)
    if directed:
        found = pair.reported(pair.measured(level=level, ceiling=ceiling))
    else:
        there, back = pair.both(level, ceiling)
        found = pair.larger(pair.reported(there), pair.reported(back))
    return decided(of_copies(found) if same_arrays(a, b) else found, limit)


def _finish(solution: HausdorffSolution, throw: bool) -> HausdorffSolution:
    solution = on_device(solution)
    if throw:
        throw_unless_successful(solution)
    return solution
