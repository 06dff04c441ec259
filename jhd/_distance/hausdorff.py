"""Entry points for directed and two-sided Hausdorff distances of two shapes."""

import math

from jhd._distance.decisions import checked_limit, decided, of_copies
from jhd._distance.normalization.method import AbstractHausdorffMethod, check_serves
from jhd._distance.pairs import pair_of
from jhd._distance.search.branch_and_bound import BranchAndBound, chosen_method, limited, sized_by_method
from jhd._results.solution import (
    Decision,
    HausdorffSolution,
    throw_unless_successful,
)
from jhd._runtime.arrays import same_arrays
from jhd._shapes.as_shape import ShapeLike
from jhd._shapes.checks import Numbers
from jhd.progress import Callback


@sized_by_method
def directed_hausdorff(
    a: ShapeLike,
    b: ShapeLike,
    method: AbstractHausdorffMethod | None = None,
    *,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    throw: bool = True,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> HausdorffSolution:
    """Directed Hausdorff distance from `a` to `b`, with certified bounds.

        h(a, b) = max over p in a of min over q in b of |p - q|

    The result refers to the stored numbers (Bezier segments, coefficients, triangles), taken as real numbers.

    Works under jit and vmap. There, checks of values are skipped and `throw` is ignored: read `result`. On CPUs the
    compiled function calls the search on the host (see `inline_searches`). Meshes, parametric surfaces and mixed
    pairs are searched on the host on all devices.

    The value is differentiable twice in all arrays of both shapes. `jax.grad` of a function of a curve or a surface
    returns a shape of the same class, whose arrays are the derivatives. CubeIntervals() has no derivatives.

    If the distance is constant on a region of `a` (for example a shape and its offset), the cost grows like diagonal /
    gap for parametric surfaces and mixed pairs. The bounds are then true but wider, with RESULTS.nonisolated_maxima.

    >>> import jhd
    >>> found = jhd.directed_hausdorff(jhd.point_set([(0, 0), (4, 0)]), jhd.point_set([(0, 3)]))
    >>> float(found.value), bool(found.lower <= 5 <= found.upper), found.witness.point.tolist()
    (5.0, True, [4.0, 0.0])

    Args:
        a: the shape on which the farthest point is sought: points (`jhd.point_set`), a curve, a parametric surface
            (BezierPatch, BezierPatches, BSplineSurface), an ImplicitSurface, a mesh, or an object that `jhd.as_shape`
            accepts.
        b: the shape to which distances are measured, of any of these kinds and of the same dimension.
        method: the method with its options; by default BranchAndBound(), which accepts all shapes. The methods in
            `jhd.published` are for comparison: CubeIntervals() accepts implicit surfaces, outside jit, TwoStep()
            curves, and BiarcTrimming() and AlgebraicEvents() polynomial curves in the plane, outside jit.
        rtol: tolerance on `upper - lower`, relative to `upper`; by default 0. The search ends when the gap is at
            most the larger of both tolerances.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; by default 1e-10 (in float32: 64
            units in the last place) of the diagonal of the joint bounding box. A published
            method has options of its own.
        throw: whether to raise NotProvenError if the method does not reach the tolerance; by default True.
        max_seconds: wall time in seconds after which the search ends with the bounds reached (RESULTS.out_of_time); by
            default no limit. It does not end a compilation, and is ignored under jit.
        progress: a function that is called with a Progress from time to time; ignored under jit. Ctrl-C ends the search
            with the bounds reached and RESULTS.interrupted.

    Returns:
        A HausdorffSolution: value, bounds and witness, in the unit of the coordinates.

    Raises:
        TypeError: `a` or `b` is not a shape, the method does not serve this pair of shapes, or a tolerance is given
            twice, or together with a published method.
        ValueError: the dimensions differ, or a surface is certified to be empty in its box.
        NotProvenError: the method failed or was interrupted, and `throw` is True. The exception carries the solution.
    """
    method = chosen_method(method, rtol, atol)
    pair = pair_of(a, b, method, limited(method, progress, max_seconds))
    return _finish(pair.finished(pair.measured()), throw)


@sized_by_method
def hausdorff(
    a: ShapeLike,
    b: ShapeLike,
    method: AbstractHausdorffMethod | None = None,
    *,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    throw: bool = True,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> HausdorffSolution:
    """Hausdorff distance of `a` and `b` (the larger of both directed distances), with certified bounds.

    The witness has a `direction`: `a_to_b` or `b_to_a`, and `a_to_b` at a tie. `directions` holds both directed
    distances. The search from `b` to `a` stops once its distance is known not to exceed the first one. Its bounds are
    then true but may be wide. The derivative is the derivative of the larger directed distance; see
    `directed_hausdorff`.

    >>> import jhd
    >>> found = jhd.hausdorff(jhd.point_set([(0, 3)]), jhd.point_set([(0, 0), (4, 0)]))
    >>> float(found.value), jhd.DIRECTIONS[found.direction]
    (5.0, 'The point lies on b, its foot points on a.')

    Args:
        a: points (`jhd.point_set`), a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an
            ImplicitSurface, a mesh, or an object that `jhd.as_shape` accepts.
        b: a shape of any of these kinds and of the same dimension.
        method: the method with its options; by default BranchAndBound(), which accepts all shapes. The methods in
            `jhd.published` are for comparison: CubeIntervals() accepts implicit surfaces, outside jit, TwoStep()
            curves, and BiarcTrimming() and AlgebraicEvents() polynomial curves in the plane, outside jit.
        rtol: tolerance on `upper - lower`, relative to `upper`; by default 0. The search ends when the gap is at
            most the larger of both tolerances.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; by default 1e-10 (in float32: 64
            units in the last place) of the diagonal of the joint bounding box. A published
            method has options of its own.
        throw: whether to raise NotProvenError if the method does not reach the tolerance; by default True.
        max_seconds: wall time in seconds after which the search ends with the bounds reached; see `directed_hausdorff`.
        progress: a function that is called with a Progress from time to time; see `directed_hausdorff`.

    Returns:
        A HausdorffSolution: value, bounds, witness and both directions, in the unit of the coordinates.

    Raises:
        TypeError: `a` or `b` is not a shape, the method does not serve this pair of shapes, or a tolerance is given
            twice, or together with a published method.
        ValueError: the dimensions differ, or a surface is certified to be empty in its box.
        NotProvenError: the method failed or was interrupted, and `throw` is True. The exception carries the solution.
    """
    method = chosen_method(method, rtol, atol)
    pair = pair_of(a, b, method, limited(method, progress, max_seconds))
    there, back = pair.both()
    return _finish(pair.larger(pair.reported(there), pair.reported(back)), throw)


@sized_by_method
def hausdorff_at_most(
    a: ShapeLike,
    b: ShapeLike,
    threshold: Numbers,
    method: AbstractHausdorffMethod | None = None,
    *,
    directed: bool = False,
    rtol: Numbers | None = None,
    atol: Numbers | None = None,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> Decision:
    """Whether the Hausdorff distance is at most a threshold: certified yes, certified no, or undecided.

    This is the search for the distance, stopped as soon as both bounds are on one side of the threshold. It takes few
    steps unless the distance is close to the threshold. A shape and a copy of its numbers have distance 0.

    >>> import jhd
    >>> bool(jhd.hausdorff_at_most(jhd.point_set([(0, 3)]), jhd.point_set([(0, 0), (4, 0)]), 4))
    False

    Args:
        a: points (`jhd.point_set`), a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an
            ImplicitSurface, a mesh, or an object that `jhd.as_shape` accepts.
        b: a shape of any of these kinds and of the same dimension.
        threshold: a length of at least 0, in the unit of the coordinates.
        method: options of the search, a BranchAndBound. The search gives up (undecided) when its tolerance is reached.
        directed: whether to test the directed distance from `a` to `b` only; by default False.
        rtol: relative tolerance at which the search gives up; see `hausdorff`.
        atol: absolute tolerance at which the search gives up; see `hausdorff`.
        max_seconds: wall time in seconds after which the search ends with the bounds reached; see `directed_hausdorff`.
        progress: a function that is called with a Progress from time to time; see `directed_hausdorff`.

    Returns:
        A Decision: the answer with the bounds reached. If it is undecided, `result` tells why.

    Raises:
        TypeError: `a` or `b` is not a shape, the method is not BranchAndBound, or a tolerance is given twice.
        ValueError: the dimensions differ, a surface is certified to be empty in its box, or the threshold is negative
            or not one number.
    """
    method = chosen_method(method, rtol, atol)
    # The default method proves both bounds, and ends as soon as they decide.
    check_serves(method, a, b, (BranchAndBound,))
    pair, limit = pair_of(a, b, method, limited(method, progress, max_seconds)), checked_limit(threshold)
    # Inward, so that bounds cut off at the level are not above the threshold, nor at the ceiling below it.
    level, ceiling = pair.length(limit, 0.0), pair.length(limit, math.inf)
    if directed:
        found = pair.reported(pair.measured(level=level, ceiling=ceiling))
    else:
        there, back = pair.both(level, ceiling)
        found = pair.larger(pair.reported(there), pair.reported(back))
    return decided(of_copies(found) if same_arrays(a, b) else found, limit)


def _finish(solution: HausdorffSolution, throw: bool) -> HausdorffSolution:
    if throw:
        throw_unless_successful(solution)
    return solution
