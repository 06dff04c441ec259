"""Fitting by the Hausdorff distance itself: minimax fits with a proven error and a certificate of stationarity.

At the optimum several maxima of the distance are equal, so descent on the largest one zigzags; here all of them take
part in each step (jhd.fitting.minimax). A stationary point is a local minimum at best: start from several places.
"""

from collections.abc import Callable
from itertools import groupby
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jhd._results.solution import FitSolution
from jhd._runtime.arrays import real_array
from jhd.distance.frame.method import AbstractHausdorffMethod
from jhd.distance.measures.measures import AbstractMeasure
from jhd.fitting.annealing import annealing
from jhd.fitting.chain import Layout, contours, divided, from_a_corner, least_squares, longest_pieces, points_of
from jhd.fitting.clock import Clock
from jhd.fitting.minimax import FitProgress
from jhd.fitting.sampled import lengths_of
from jhd.fitting.ways import Limits, scales_of, way_of
from jhd.shapes.as_shape import Shape, taken_as
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch
from jhd.slips import refuse_tracing, traceable

# Shapes that are fitted, and fitted to.
Fitted = AbstractCurve | AbstractPatch | ImplicitSurface | TriangleMesh
# Pairs kept for a number of parameters: an error curve with p + 1 equal maxima has some more below.
_CAPACITIES = ((14, 32), (40, 64))
_LARGEST_CAPACITY = 128
# Pieces of least squares within this many tolerances are tried first, for minimax fits are nearer by such a factor at
# best; then each time within this share of the last, so many times at most.
_GAIN, _CLOSER, _TRIES = 4.0, 0.75, 40
# Corners are looked for at a scale of so many tolerances.
_CORNERS = 8.0
# Fits of a higher degree are no shorter, and programs for them take minutes to compile.
_LARGEST_DEGREE = 32
# Other starts differ from the first by this share of the target's size.
_SPREAD = 0.1


def minimise_hausdorff(
    build: Callable[[Any], Fitted],
    parameters: Any,
    target: Any,
    *,
    measure: AbstractMeasure | None = None,
    temperature: Numbers | None = None,
    starts: Any = 1,
    seed: int = 0,
    max_steps: int = 60,
    max_seconds: float | None = None,
    atol: float = 0.0,
    capacity: int | None = None,
    method: AbstractHausdorffMethod | None = None,
    progress: Callable[[FitProgress], object] | None = None,
) -> FitSolution:
    """The parameters for which build(parameters) is nearest to the target, in the Hausdorff distance or a measure.

    A local minimum near the start. What is to stay fixed (ends, tangents, closedness) is what `build` does not vary.
    Curves are fitted by all maxima of their distance and their curvature; surfaces and meshes, of which one maximum of
    each direction is known, by a bundle of their gradients, which ends where a convex combination of those nearby is
    below a twentieth of their length.

    Where the product of both curves' numbers of segments is above 1024 the maxima near the top alone take part, found
    with trees of samples: the search of a step grows like the sum of both numbers, its model at most like the cube of
    the number of parameters. Such a fit ends where four steps together gain less than a thousandth, named
    fit_in_a_valley. If the proven distance shows that a maximum was missed, it looks closer and goes on.

    By another measure any shapes are fitted, points among the targets: a quantile or
    a mean of the distances from a scan, `Quantile(0.9, directed=True)`, leaves its outliers out.

    Args:
        build: from the parameters to a shape of the target's kind; traced, so written in jax.numpy. A module-level
            function or a Module is compiled once, a lambda at each call.
        parameters: the start: an array or a pytree of arrays.
        target: the curve, implicit surface or mesh to be near to; for other measures any shape that they take.
        measure: Hausdorff(), which is the default, Mean(), RootMeanSquare() or Quantile(q), of (target, shape).
        temperature: of curves, where the start is far: a length, about a third of the distance there. Steps on
            `soft_hausdorff` with it and less and less, down to a fiftieth, come first and are not reported.
        starts: how many starts, the first at `parameters` and the others about it; or their parameters, stacked along
            a new leading axis. The best end is returned.
        seed: of the random starts.
        max_steps: most steps from each start.
        max_seconds: wall time after which the best so far is returned, with the result fit_out_of_time; what has begun
            is given up, but for the first evaluation, and the proof of the error is ended a tenth of the time later
            with the bounds it has. Where less than half a minute is left, fits of curves to their largest distance do
            without searches that are not compiled yet, and the bounds of the error are wider then; other fits wait for
            them. None for no limit.
        atol: a distance at which the fit is good enough; zero goes on to a stationary point.
        capacity: of curves, how many maxima take part; by default enough for the number of parameters.
        method: how the error is proven; by default BranchAndBound().
        progress: called with a FitProgress after each step.

    Raises:
        TypeError: a target that is no curve, surface or mesh, or shapes of another kind than the target.
        ValueError: no parameter, starts of another shape, or a temperature that is no length or beside a measure.
    """
    refuse_tracing("minimise_hausdorff", parameters, target)
    options = {"measure": measure, "starts": starts, "seed": seed, "max_steps": max_steps, "atol": atol}
    options |= {"capacity": capacity, "method": method, "progress": progress, "temperature": temperature}
    return _minimised(build, parameters, target, Clock(max_seconds), **options)


def _minimised(
    build: Callable[[Any], Fitted],
    parameters: Any,
    target: Any,
    clock: Clock,
    *,
    max_steps: int,
    measure: AbstractMeasure | None = None,
    temperature: Numbers | None = None,
    starts: Any = 1,
    seed: int = 0,
    atol: float = 0.0,
    capacity: int | None = None,
    method: AbstractHausdorffMethod | None = None,
    progress: Callable[[FitProgress], object] | None = None,
) -> FitSolution:
    """As `minimise_hausdorff`, within the time of a clock."""
    target = taken_as("target", target)
    flat, unravel = ravel_pytree(jax.tree_util.tree_map(lambda x: jnp.asarray(x, dtype=float), parameters))
    if flat.size == 0:
        raise ValueError("parameters holds no number; needs at least one.")
    built = _Flat(build, unravel)
    limits = Limits(max_steps, atol, _capacity(flat.size) if capacity is None else capacity, clock, method)
    way = way_of(built, target, measure, limits)
    begin = annealing(temperature, measure, built, target, scales_of(built, target), clock)
    ends = []
    for number, start in enumerate(_starts(built, np.asarray(flat), starts, seed, target)):

        def report(step: int, value: float, optimality: float, number: int = number) -> None:
            if progress is not None:
                progress(FitProgress(number, step, value, optimality))

        if ends and clock.is_over():
            break
        ends.append(way.iterate(begin(start), report))
    return way.solution(min(ends, key=way.value), unravel)


def fit_curve(
    target: Any,
    *,
    degree: int,
    segments: int | None = None,
    tolerance: Numbers | None = None,
    measure: AbstractMeasure | None = None,
    ends: Literal["fixed", "free"] = "fixed",
    closed: bool | None = None,
    smooth: bool = False,
    max_steps: int = 60,
    max_seconds: float | None = None,
    atol: float = 0.0,
    method: AbstractHausdorffMethod | None = None,
    progress: Callable[[FitProgress], object] | None = None,
) -> FitSolution:
    """Polynomial Bezier segments that are nearest to a connected curve, in the Hausdorff distance.

    The start is a least-squares fit to points of the target. A fit with free ends goes on from the one with fixed ends,
    so it is never farther. A local minimum; its `parameters` are the free control points.

    >>> from jhd.shapes.curve import BezierSegments, circle
    >>> quarter = BezierSegments(circle([0, 0], 1).control_points[:1], circle([0, 0], 1).weights[:1])
    >>> round(float(fit_curve(quarter, degree=3)), 9)
    6.844e-05

    Args:
        target: one contour, its segments in order.
        degree: of the segments, at most 32; at least 3 with `smooth`, and 2 for one segment with fixed ends.
        segments: how many, one by default; the target is divided at its corners, and evenly between them.
        tolerance: in place of `segments`, the largest proven distance: few segments that come below it, as by
            `fit_outline`, up to 64; with ends as the target has them.
        measure: what is made least; by default Hausdorff(), see `minimise_hausdorff`.
        ends: "fixed" at those of the target, or "free".
        closed: whether the last segment leads to the first; by default as the target is.
        smooth: whether the tangent is continuous at the joints; without it they may be corners.
        max_steps: most steps from each start.
        max_seconds: wall time after which the best so far is returned; see `minimise_hausdorff`.
        atol: a distance at which the fit is good enough; zero goes on to a stationary point.
        method: how the error is proven; by default BranchAndBound().
        progress: called with a FitProgress after each step.

    Raises:
        TypeError: a target that is no curve.
        ValueError: a target of several contours or of points, sizes that are too small, or a tolerance beside what it
            decides.
    """
    refuse_tracing("fit_curve", target)
    target, clock = taken_as("target", target), Clock(max_seconds)
    check_curve("target", target)
    curve = target.segments()
    _refuse_points(curve)
    following = np.asarray(curve.following)
    if np.any(following[:-1] != np.arange(1, curve.count)):
        raise ValueError("target has several contours; needs one, with its segments in order.")
    if tolerance is not None:
        others = {"segments": segments, "measure": measure, "method": method}
        others |= {"closed": closed, "ends": None if ends == "fixed" else ends, "atol": atol or None}
        _refuse_beside_tolerance(others)
        return fit_outline(
            curve,
            tolerance,
            degree=degree,
            smooth=smooth,
            max_steps=max_steps,
            max_seconds=max_seconds,
            progress=progress,
        )[0]
    segments = 1 if segments is None else segments
    closed = bool(following[-1] == 0) if closed is None else closed
    least = 3 if smooth else 2 if ends == "fixed" and segments == 1 and not closed else 1
    _check_degree(degree, least)
    if segments < 1:
        raise ValueError(f"segments is {segments}; needs at least 1.")
    if ends not in ("fixed", "free"):
        raise ValueError(f"ends is {ends!r}; needs 'fixed' or 'free'.")
    joints = divided(curve, segments)
    layout = Layout(degree, segments, closed, ends == "fixed", smooth)
    options = {"max_steps": max_steps, "atol": atol, "method": method, "progress": progress, "measure": measure}
    build, start = least_squares(layout, curve, joints)
    if ends == "fixed" or closed:
        return _minimised(build, start, curve, clock, **options)
    held, free = least_squares(layout._replace(fixed_ends=True), curve, joints)
    if free.size:
        first = _minimised(held, free, curve, clock, **options).parameters
        others = points_of(build, np.asarray(held(first).control_points))
        return _minimised(build, start, curve, clock, starts=np.stack([others, start]), **options)
    return _minimised(build, start, curve, clock, **options)


def _refuse_points(curve: BezierSegments) -> None:
    if curve.degree == 0:
        raise ValueError(
            "target is a set of points, which do not follow each other; join them by polyline, or fit them "
            "by minimise_hausdorff."
        )


def _refuse_beside_tolerance(others: dict[str, Any]) -> None:
    for name, given in others.items():
        if given is not None:
            raise ValueError(f"{name} is given with a tolerance, which decides it; give one of both.")


def fit_outline(
    target: Any,
    tolerance: Numbers,
    *,
    degree: int = 3,
    smooth: bool = False,
    max_segments: int = 64,
    max_steps: int = 40,
    max_seconds: float | None = None,
    progress: Callable[[FitProgress], object] | None = None,
) -> list[FitSolution]:
    """Each contour of the target within the tolerance, by few segments; one fit for each contour, in their order.

    Joints are laid so that each piece of least squares is as long as it can be within some tolerances: first so many
    that only a minimax fit can come below one, then fewer, down to where least squares are there already. A smaller
    number of segments is not ruled out. A contour that stays above the tolerance with `max_segments` says so in its
    `error`. Ends of open contours are kept; a closed one begins at a corner where it has one.

    Args:
        target: an outline of one or several contours, each with its segments in order.
        tolerance: largest proven Hausdorff distance between a contour and its fit, in the unit of the coordinates.
        degree: of the segments, 1 to 32.
        smooth: whether inner joints have one tangent.
        max_segments: most segments of one contour.
        max_steps: most steps of one fit; a fit within the tolerance takes no more.
        max_seconds: wall time for all contours, see `minimise_hausdorff`; then the fits in hand are returned, which may
            be above the tolerance.
        progress: called with a FitProgress after each step.

    Raises:
        TypeError: a target that is no curve.
        ValueError: a tolerance that is not positive.
    """
    refuse_tracing("fit_outline", target)
    _check_degree(degree, 1)
    target, clock = taken_as("target", target), Clock(max_seconds)
    check_curve("target", target)
    _refuse_points(target.segments())
    limit = real_array("tolerance", tolerance)
    if limit.shape != () or not float(limit) > 0:
        raise ValueError(f"tolerance is {limit}; needs one positive number.")
    found = []
    for contour in contours(target.segments()):
        start = from_a_corner(contour, _reach(contour, float(limit)))
        found.append(_within(start, float(limit), clock, degree, smooth, max_segments, max_steps, progress))
    return found


def _within(
    contour: BezierSegments,
    limit: float,
    clock: Clock,
    degree: int,
    smooth: bool,
    most: int,
    max_steps: int,
    progress: Callable[[FitProgress], object] | None,
) -> FitSolution:
    """The first fit within the limit, of joints that are laid closer and closer; else the last one."""
    closed = bool(np.asarray(contour.following)[-1] == 0)
    least = 2 if closed else 1
    fit: Any = None
    reach = _reach(contour, limit)
    laid = (longest_pieces(contour, degree, _GAIN * limit * _CLOSER**k, reach) for k in range(_TRIES))
    # Of those with as many pieces the last ones are the most even.
    for count, alike in groupby(laid, key=lambda found: min(max(len(found[1]), least), most)):
        joints, pieces = list(alike)[-1]
        own = count == len(pieces)
        layout = Layout(degree, count, closed, not closed, smooth)
        build, start = least_squares(layout, contour, joints if own else divided(contour, count))
        if own and not smooth:
            start = points_of(build, pieces)
        fit = _minimised(build, start, contour, clock, max_steps=max_steps, atol=0.99 * limit, progress=progress)
        if float(fit.error.upper) <= limit or count == most or clock.is_over():
            break
    return fit


def _reach(contour: BezierSegments, limit: float) -> float:
    """The share of the length at which corners are to be seen that matter to a tolerance."""
    length = float(np.sum(lengths_of(np.asarray(contour.homogeneous), contour.weights is not None)))
    return min(_CORNERS * limit / length, 0.1) if length > 0 else 0.0


class _Flat(eqx.Module):
    """`build` as a function of a vector."""

    build: Callable
    unravel: Callable

    def __call__(self, parameters: Array) -> Any:
        found = traceable(self.build, self.unravel(parameters))
        if not isinstance(found, Shape):
            came = "an array" if isinstance(found, jax.Array) else type(found).__name__
            raise TypeError(f"build(parameters) must be a shape of jhd, as jhd.BezierCurve makes one; got {came}.")
        return found


def _capacity(count: int) -> int:
    return next((capacity for most, capacity in _CAPACITIES if count <= most), _LARGEST_CAPACITY)


def _starts(build: Callable, first: np.ndarray, starts: Any, seed: int, target: Fitted) -> np.ndarray:
    """Rows of parameters to start from."""
    if not isinstance(starts, int):
        rows = np.stack([np.asarray(ravel_pytree(row)[0]) for row in _rows(starts)])
        if rows.shape[1:] != first.shape:
            raise ValueError(f"starts holds {rows.shape[1]} parameters each; needs {first.size}.")
        return rows
    if starts < 1:
        raise ValueError(f"starts is {starts}; needs at least 1.")
    if starts == 1:
        return first[None]
    low, high = target.box()
    spread = _SPREAD * float(jnp.max(high - low)) * scales_of(build, target)(first)
    noise = np.random.default_rng(seed).normal(size=(starts - 1, first.size))
    return np.concatenate([first[None], first + spread * noise])


def _rows(starts: Any) -> list[Any]:
    count = jax.tree_util.tree_leaves(starts)[0].shape[0]
    return [jax.tree_util.tree_map(lambda x, k=k: jnp.asarray(x, dtype=float)[k], starts) for k in range(count)]


def _check_degree(degree: int, least: int) -> None:
    if not least <= degree <= _LARGEST_DEGREE:
        raise ValueError(f"degree is {degree}; needs at least {least} and at most {_LARGEST_DEGREE}.")
