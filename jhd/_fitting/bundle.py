"""Minimizing a Hausdorff distance if only the largest maximum of each direction is known: a bundle method.

Each evaluation gives two cuts, the value and the gradient of both directed distances. The cuts of all parameters nearby
make a piecewise linear model, whose least point within a trust region is tried next. One gradient alone says little at
the optimum, at which several maxima are equal; a convex combination of nearby gradients vanishes there.

Source: bundle methods with trust regions are in Kiwiel, Methods of Descent for Nondifferentiable Optimization (1985).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jhd._distance.hausdorff import directed_hausdorff
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._fields.octree import voxelize
from jhd._fitting.descent import Ended
from jhd._fitting.subproblem import model_step, multipliers
from jhd._results.solution import RESULTS, HausdorffSolution
from jhd._runtime.clock import Clock, OutOfTimeError
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh

Target = ImplicitSurface | TriangleMesh

# Relative accuracy of an evaluation.
_ACCURACY = 1e-6
# Promised gains below this fraction of the distance do not count; they are of the order of the errors of evaluations.
_NO_GAIN = 4 * _ACCURACY
# A point is stationary if its gradients cancel to this fraction of the longest gradient.
STATIONARY = 0.05


class Cut(NamedTuple):
    """A directed distance at a vector of parameters, to first order."""

    parameters: Any
    value: float
    gradient: Any


class Evaluated(NamedTuple):
    """Parameters with their shape, both directed distances and cuts."""

    parameters: Any
    shape: Target
    solutions: tuple[HausdorffSolution, HausdorffSolution]
    cuts: tuple[Cut, Cut]

    @property
    def value(self) -> float:
        """The Hausdorff distance."""
        return max(cut.value for cut in self.cuts)


class _Model(NamedTuple):
    """Cuts near a point: their heights at it, none above the distance, and their gradients."""

    height: Any
    gradient: Any


def minimize_by_cuts(
    build: Callable[[Any], Target],
    target: Target,
    parameters: Any,
    max_steps: int,
    stop_below: float,
    report: Callable[[int, float, float], object],
    clock: Clock,
) -> Ended:
    """Minimize until no cut promises a gain, the distance is at most stop_below, or the radius vanishes.

    The multipliers at the end are one for each direction.

    Args:
        build: takes a vector of parameters and returns a surface or mesh.
        target: the shape to approximate.
        parameters: the start, a vector.
        max_steps: most evaluations after the first one.
        stop_below: distance at which to stop.
        report: called with step, distance and optimality.
        clock: ends the iteration.
    """
    low, high = target.bounds
    size = float(np.max(np.asarray(high) - np.asarray(low)))
    point = evaluated(build, target, parameters)
    scale = motions(build, parameters)
    cuts, history, steps, late = list(point.cuts), [point.value], 0, False
    # First radius: this fraction of the size or this many distances, the smaller one.
    radius = largest = min(0.1 * size, 3.0 * point.value)
    result, optimality, mu = RESULTS.fit_steps_exhausted, *_stationarity(point, cuts, scale, radius)
    report(0, point.value, optimality)
    for step in range(max_steps):
        if point.value <= stop_below or radius < 1e-6 * size:
            break
        model = _model(point, cuts, scale, radius)
        slopes = model.gradient * scale
        straight = np.zeros((1, 0, slopes.shape[1]))
        move = model_step(model.height, slopes, straight, np.full(len(scale), radius))
        promised = point.value - float(np.max(model.height + slopes @ move))
        if promised <= _NO_GAIN * point.value:
            radius = 0.25 * radius
            continue
        try:
            clock.check()
            tried = evaluated(build, target, point.parameters + scale * move, clock)
        except OutOfTimeError:
            late = True
            break
        # Most cuts of a model; the latest ones count.
        cuts, steps = [*cuts, *tried.cuts][-80:], steps + 1
        # Least fraction of the promised gain to take a step.
        if point.value - tried.value >= 0.1 * promised:
            # Growth of the radius after a step that was taken.
            point, radius = tried, min(largest, 2.0 * radius)
        else:
            radius = 0.5 * float(np.max(np.abs(move)))
        optimality, mu = _stationarity(point, cuts, scale, radius)
        history.append(point.value)
        report(step + 1, point.value, optimality)
    else:
        radius = np.inf
    if point.value <= stop_below or optimality <= STATIONARY * max(np.linalg.norm(x.gradient) for x in point.cuts):
        result = RESULTS.successful
    elif late:
        result = RESULTS.out_of_time
    elif radius < np.inf:
        result = RESULTS.fit_nonsmooth_stall
    counts = {"steps": int(np.sum(np.diff(history) < 0)), "evaluations": steps + 1}
    return Ended(point, mu, optimality, result, counts, history)


def evaluated(build: Callable[[Any], Target], target: Target, parameters: Any, clock: Clock | None = None) -> Evaluated:
    """Both directed distances at the parameters, with their gradients; a clock ends the search when the time is up."""
    method, heard = BranchAndBound(rtol=_ACCURACY), None if clock is None else clock.heard

    def distances(p: Any) -> tuple[Any, Any]:
        shape = build(p)
        pairs = (target, shape), (shape, target)
        found = tuple(directed_hausdorff(*pair, method, throw=False, progress=heard) for pair in pairs)
        return tuple(solution.value for solution in found), found

    values, back, found = jax.vjp(distances, jnp.asarray(parameters), has_aux=True)
    ones = np.eye(2)
    gradients = [
        np.asarray(back(tuple(jnp.asarray(x, v.dtype) for x, v in zip(row, values, strict=True)))[0]) for row in ones
    ]
    first, second = (Cut(parameters, float(v), g) for v, g in zip(values, gradients, strict=True))
    return Evaluated(parameters, build(jnp.asarray(parameters)), jax.lax.stop_gradient(found), (first, second))


def _model(point: Evaluated, cuts: list[Cut], scale: Any, radius: float) -> _Model:
    """The model of nearby cuts; cuts above the distance at the point, as it is not convex, are lowered to it."""
    others = [cut for cut in cuts if cut.parameters is not point.parameters]
    apart = np.array([np.max(np.abs((cut.parameters - point.parameters) / scale)) for cut in others])
    # A convex combination of at most one more gradients than parameters vanishes at an optimum.
    # All cuts within 3 radii count, and only the nearest ones within 30.
    count = max(int(np.sum(apart <= 3.0 * radius)), min(2 * (len(scale) + 1), int(np.sum(apart <= 30.0 * radius))))
    near = [*point.cuts, *(others[k] for k in np.argsort(apart, kind="stable")[:count])]
    gradient = np.array([cut.gradient for cut in near])
    height = np.array([cut.value + cut.gradient @ (point.parameters - cut.parameters) for cut in near])
    return _Model(np.minimum(height, point.value), gradient)


def _stationarity(point: Evaluated, cuts: list[Cut], scale: Any, radius: float) -> tuple[float, Any]:
    """Length of the best convex combination of nearby gradients, and multipliers of both directions at the point."""
    model = _model(point, cuts, scale, radius)
    price = 10 * (point.value - model.height) / (point.value or 1.0)
    mu = multipliers(model.gradient * scale, price)
    prices = 10 * (point.value - np.array([cut.value for cut in point.cuts])) / (point.value or 1.0)
    best = multipliers(np.array([cut.gradient for cut in point.cuts]) * scale, prices)
    return float(np.linalg.norm(mu @ model.gradient)), best


def motions(build: Callable[[Any], Target], parameters: Any) -> Any:
    """The change of each parameter that moves the part of the shape that depends on it by about one unit of length."""
    start = jnp.asarray(parameters)
    shape = build(start)
    if not isinstance(shape, Target):
        raise TypeError(f"build must return an ImplicitSurface or a TriangleMesh; got {type(shape).__name__}.")
    if isinstance(shape, TriangleMesh):
        # Most numbers for a mesh.
        if shape.vertices.size * start.size > 10_000_000:
            return np.ones(start.size)
        slopes = np.asarray(jax.jacfwd(lambda p: build(p).vertices)(start))  # pyright: ignore[reportAttributeAccessIssue]
        moved = np.linalg.norm(slopes.reshape(-1, 3, start.size), axis=1)
    else:
        # Cells along each axis whose centers show how far parameters move a surface.
        cells = voxelize(shape, 16)
        places = cells.lower + (np.asarray(cells.cells) + 0.5) * cells.spacing
        steep = np.linalg.norm(np.asarray(shape.gradient(places)), axis=-1)
        values = np.asarray(jax.jacfwd(lambda p: build(p)(places))(start))  # pyright: ignore[reportCallIssue]
        moved = np.abs(values[steep > 0]) / steep[steep > 0, None]
    typical = [np.median(column[column > 0]) if np.any(column > 0) else 1.0 for column in moved.T]
    return 1 / np.array(typical)
