"""The ways to fit: by all maxima of curves, by a bundle of gradients of surfaces and meshes, by another measure."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jhd._results.solution import FitSolution
from jhd.distance.frame.method import AbstractHausdorffMethod
from jhd.distance.measures.measures import AbstractMeasure, Hausdorff, check_measure
from jhd.fitting.bundle import minimise_by_cuts, motions
from jhd.fitting.clock import Clock
from jhd.fitting.measured import fit_by_measure, measured_solution
from jhd.fitting.problem import Problem
from jhd.fitting.solutions import bundled_solution, minimax_solution, minimise_and_prove
from jhd.shapes.curve import AbstractCurve, check_curve
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch


class Limits(NamedTuple):
    """What ends an iteration, how many maxima take part, and how the end is proven."""

    max_steps: int
    atol: float
    capacity: int
    clock: Clock
    method: AbstractHausdorffMethod | None


class Way(NamedTuple):
    """A way to fit: from a start and a listener to an end, the value of an end, and the solution that it is."""

    iterate: Callable[[Any, Callable[[int, float, float], object]], Any]
    value: Callable[[Any], float]
    solution: Callable[[Any, Callable], FitSolution]


def way_of(built: Any, target: Any, measure: AbstractMeasure | None, limits: Limits) -> Way:
    """How shapes of the target's kind are fitted to it by a measure."""
    check_measure(measure)
    steps, atol, capacity, clock, method = limits
    if measure is not None and measure != Hausdorff():
        scales = scales_of(built, target)
        return Way(
            lambda start, report: fit_by_measure(
                built, measure, target, start, scales(start), steps, atol, clock, report
            ),
            lambda ended: ended.point.value,
            lambda ended, unravel: measured_solution(built, unravel, measure, target, ended, method),
        )
    if isinstance(target, ImplicitSurface | TriangleMesh):
        return Way(
            lambda start, report: minimise_by_cuts(built, target, start, steps, atol, report, clock),
            lambda ended: ended.point.value,
            lambda ended, unravel: bundled_solution(ended, unravel, target, method, clock),
        )
    check_curve("target", target)
    return Way(
        lambda start, report: minimise_and_prove(
            Problem(built, target.segments(), capacity, clock), start, steps, atol, method, report
        ),
        lambda found: found.ended.point.top,
        lambda found, unravel: minimax_solution(found, unravel),
    )


def scales_of(build: Callable, target: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Of parameters, the change of each that moves the shape by about one unit of length."""

    def scales(parameters: np.ndarray) -> np.ndarray:
        shape = build(jnp.asarray(parameters))
        if isinstance(shape, AbstractCurve) and isinstance(target, AbstractCurve):
            return Problem(build, target.segments(), 1).scales(parameters)
        if isinstance(shape, AbstractPatch):
            slopes = jax.jacfwd(lambda p: build(p).patches().control_points)(jnp.asarray(parameters))
            moved = np.max(np.abs(np.asarray(slopes).reshape(-1, len(parameters))), axis=0)
            return 1 / np.where(moved > 0, moved, 1.0)
        return motions(build, parameters)

    return scales
