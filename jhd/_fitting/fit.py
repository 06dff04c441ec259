"""Fits that minimize the Hausdorff distance itself, with certified errors and a stationarity measure.

At the optimum several local maxima of the distance are equal, so descent on the largest one zigzags. Here every step
uses all of them (jhd._fitting.minimax). A stationary point is at best a local minimum, so try several starts.
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

from jhd._distance.normalization.method import AbstractHausdorffMethod
from jhd._distance.normalization.stopping import default_tolerance
from jhd._distance.search.bodies import diagonal_of
from jhd._distance.statistics.statistics import AbstractStatistic
from jhd._fitting.annealing import annealing
from jhd._fitting.chain import Layout, contours, divided, from_a_corner, least_squares, longest_pieces, points_of
from jhd._fitting.sampled import lengths_of
from jhd._fitting.ways import Limits, scales_of, way_of
from jhd._results.solution import RESULTS, Built, FitSolution, Parameters, name_of, with_result
from jhd._runtime.argument_hints import refuse_tracing, traceable
from jhd._runtime.arrays import check_scalar, real_array, whole
from jhd._runtime.clock import Clock
from jhd._shapes.as_shape import Shape, ShapeLike, taken_as
from jhd._shapes.checks import Numbers
from jhd._shapes.curve import BezierSegments, check_curve
from jhd.progress import Callback, Progress

# Fits of a higher degree have no fewer segments, and take minutes to compile.
_LARGEST_DEGREE = 32


def minimize_hausdorff(
    build: Callable[[Parameters], Built],
    parameters: Parameters,
    target: ShapeLike,
    *,
    statistic: AbstractStatistic | None = None,
    temperature: Numbers | None = None,
    starts: int | Parameters = 1,
    seed: int = 0,
    max_steps: int = 60,
    max_seconds: float | None = None,
    stop_below: float = 0.0,
    capacity: int | None = None,
    method: AbstractHausdorffMethod | None = None,
    progress: Callback | None = None,
) -> FitSolution[Parameters, Built]:
    """Parameters that minimize the distance from build(parameters) to a target, or a statistic of this distance.

    The result is a local minimum near the start. To keep ends, tangents or closedness fixed, let `build` not vary them.

    - Curves: each step uses all local maxima of the distance and their curvature. If the product of both numbers of
      segments exceeds 1024, only the maxima near the largest take part, found with trees of samples. Such a fit stops
      with the result fit_slow_progress if four steps together gain less than a thousandth. If the certified distance
      shows that a maximum was missed, the search is refined and the fit continues.
    - Implicit surfaces and meshes: only one maximum of each direction is known, so a bundle of gradients is used. The
      fit stops when a convex combination of nearby gradients is shorter than a twentieth of their length.
    - With another statistic, shapes of all kinds can be fitted, also to point sets. For example,
      `QuantileDistance(0.9, directed=True)` ignores up to 10 % of outliers in a scan.

    >>> import jax.numpy as jnp
    >>> import jhd
    >>> quarter = jhd.BezierSegments(jhd.circle([0, 0], 1).control_points[:1], jhd.circle([0, 0], 1).weights[:1])
    >>> build = lambda h: jhd.BezierSegments(jnp.array([[(1, 0), (1, h), (h, 1), (0, 1)]]))
    >>> fit = jhd.minimize_hausdorff(build, 0.5, quarter)
    >>> round(float(fit.parameters), 6), round(float(fit), 6)
    (0.551915, 0.000196)

    Args:
        build: function that maps parameters to a shape. It is traced, so write it in jax.numpy. A module-level function
            or an equinox Module is compiled once, a lambda in every call.
        parameters: start of the fit: an array or a pytree of arrays.
        target: curve or point set, implicit surface or mesh, of the kind that `build` returns. With a statistic other
            than the Hausdorff distance, all shapes for which the statistic is defined.
        statistic: loss: MaxDistance() (the default), MeanDistance(), RMSDistance() or QuantileDistance(q), applied to
            (target, shape).
        temperature: positive length for starts that are far away, for curves only: about a third of the distance at the
            start. Steps on `soft_hausdorff` come first, with temperatures from this value down to a fiftieth. They are
            not reported. None (the default) omits them.
        starts: number of starts, at least 1; the first is `parameters`, the others are random points near it. Or the
            starts themselves, stacked along a new leading axis. The best fit is returned.
        seed: seed of the random starts.
        max_steps: largest number of steps from each start.
        max_seconds: wall time in seconds after which the best fit so far is returned, with the result out_of_time.
            Running work is canceled, except for the first evaluation. The certification of the error may exceed the
            limit by a tenth, and then ends with the bounds that it has reached. If less than 10 s are left, fits of
            curves by the Hausdorff distance skip searches that are not compiled yet, and their bounds are wider. Other
            fits wait for the compilation. None (the default) sets no limit.
        stop_below: distance at which the fit is good enough and stops. 0 (the default) continues to a stationary point.
        capacity: number of local maxima used in each step, for curves. None chooses it by the number of parameters.
        method: method that certifies the error. None selects BranchAndBound().
        progress: callback that receives a Progress after each step.

    Returns:
        A FitSolution with the best parameters, their shape, its certified error, and the result of the best start.

    Raises:
        TypeError: the target is no curve, surface or mesh, or `build` returns a shape of another kind.
        ValueError: there are no parameters, `starts` has another shape, or a temperature is not a positive length or is
            given together with a statistic.
    """
    refuse_tracing("minimize_hausdorff", parameters, target)
    options = {"statistic": statistic, "starts": starts, "seed": seed, "max_steps": max_steps, "stop_below": stop_below}
    options |= {"capacity": capacity, "method": method, "progress": progress, "temperature": temperature}
    return _minimized(build, parameters, target, Clock(max_seconds), **options)


def _minimized(
    build: Callable[..., Any],
    parameters: Any,
    target: Any,
    clock: Clock,
    *,
    max_steps: int,
    statistic: AbstractStatistic | None = None,
    temperature: Numbers | None = None,
    starts: Any = 1,
    seed: int = 0,
    stop_below: float = 0.0,
    capacity: int | None = None,
    method: AbstractHausdorffMethod | None = None,
    progress: Callback | None = None,
) -> FitSolution:
    """`minimize_hausdorff` within the time of a clock."""
    max_steps = whole("max_steps", max_steps, 0)
    check_scalar("stop_below", real_array("stop_below", stop_below))
    target = taken_as("target", target)
    flat, unravel = ravel_pytree(jax.tree_util.tree_map(lambda x: jnp.asarray(x, dtype=float), parameters))
    if flat.size == 0:
        raise ValueError("parameters holds no number; needs at least one number.")
    built = _Flat(build, unravel)
    limits = Limits(max_steps, stop_below, _capacity(flat.size) if capacity is None else capacity, clock, method)
    way = way_of(built, target, statistic, limits)
    begin = annealing(temperature, statistic, built, target, scales_of(built, target), clock)
    ends = []
    for number, start in enumerate(_starts(built, np.asarray(flat), starts, seed, target)):

        def report(step: int, value: float, optimality: float, number: int = number) -> None:
            if progress is not None:
                details = {"value": value, "optimality": optimality}
                progress(Progress(f"start {number}", step, max_steps, details=details))

        if ends and clock.is_over():
            break
        ends.append(way.iterate(begin(start), report))
    return way.solution(min(ends, key=way.value), unravel)


def fit_curve(
    target: ShapeLike,
    *,
    degree: int,
    segments: int | None = None,
    tolerance: Numbers | None = None,
    statistic: AbstractStatistic | None = None,
    ends: Literal["fixed", "free"] = "fixed",
    closed: bool | None = None,
    smooth: bool = False,
    max_steps: int = 60,
    max_seconds: float | None = None,
    stop_below: float = 0.0,
    method: AbstractHausdorffMethod | None = None,
    progress: Callback | None = None,
) -> FitSolution[Array, BezierSegments]:
    """Fit of polynomial Bezier segments to a connected curve, by the Hausdorff distance or a statistic.

    The start is a least-squares fit to points of the target. A fit with free ends starts from the fit with fixed ends,
    so its error is never larger. The result is a local minimum.

    >>> import jhd
    >>> quarter = jhd.BezierSegments(jhd.circle([0, 0], 1).control_points[:1], jhd.circle([0, 0], 1).weights[:1])
    >>> round(float(jhd.fit_curve(quarter, degree=3)), 9)
    6.844e-05

    Args:
        target: curve of one contour, with its segments in order.
        degree: degree of the segments, 1 to 32; at least 3 with `smooth`, at least 2 for one segment with fixed ends.
        segments: number of segments; None means 1. The target is divided at its corners, and evenly between them.
        tolerance: largest certified distance, in the unit of the coordinates. Pass it instead of `segments` to get few
            segments, at most 64, as from `fit_outline`; the ends are then fixed.
        statistic: loss to minimize; None selects MaxDistance(). See `minimize_hausdorff`.
        ends: "fixed" keeps the end points of the target; "free" fits them too.
        closed: whether the last segment joins the first; None takes this from the target.
        smooth: whether the tangent is continuous at the joints. By default joints may be corners.
        max_steps: largest number of steps from each start.
        max_seconds: wall time in seconds after which the best fit so far is returned; see `minimize_hausdorff`.
        stop_below: distance at which the fit is good enough and stops. 0 (the default) continues to a stationary point.
        method: method that certifies the error. None selects BranchAndBound().
        progress: callback that receives a Progress after each step.

    Returns:
        A FitSolution with the fitted curve (`shape`), its certified error, and the free control points (`parameters`).

    Raises:
        TypeError: the target is no curve.
        ValueError: the target has several contours or is a point set, a size is out of range, or a tolerance is given
            together with an option that it determines.
    """
    refuse_tracing("fit_curve", target)
    given, clock = taken_as("target", target), Clock(max_seconds)
    check_curve("target", given)
    curve = given.segments()
    _refuse_points(curve)
    following = np.asarray(curve.next_segment)
    if np.any(following[:-1] != np.arange(1, curve.count)):
        raise ValueError("target has several contours; needs one, with its segments in order; or use fit_outline.")
    if tolerance is not None:
        others = {"segments": segments, "statistic": statistic, "method": method}
        others |= {"closed": closed, "ends": None if ends == "fixed" else ends, "stop_below": stop_below or None}
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
    segments = whole("segments", 1 if segments is None else segments, 1)
    closed = bool(following[-1] == 0) if closed is None else closed
    least = 3 if smooth else 2 if ends == "fixed" and segments == 1 and not closed else 1
    degree = _checked_degree(degree, least)
    if ends not in ("fixed", "free"):
        raise ValueError(f"ends is {ends!r}; needs 'fixed' or 'free'.")
    joints = divided(curve, segments)
    layout = Layout(degree, segments, closed, ends == "fixed", smooth)
    options = {
        "max_steps": max_steps,
        "stop_below": stop_below,
        "method": method,
        "progress": progress,
        "statistic": statistic,
    }
    build, start = least_squares(layout, curve, joints)
    if ends == "fixed" or closed:
        return _minimized(build, start, curve, clock, **options)
    held, free = least_squares(layout._replace(fixed_ends=True), curve, joints)
    if free.size:
        first = _minimized(held, free, curve, clock, **options).parameters
        others = points_of(build, np.asarray(held(first).control_points))
        return _minimized(build, start, curve, clock, starts=np.stack([others, start]), **options)
    return _minimized(build, start, curve, clock, **options)


def _refuse_points(curve: BezierSegments) -> None:
    if curve.degree == 0:
        raise ValueError(
            "target is a set of points, which have no order; join them by jhd.polyline, or fit them "
            "by minimize_hausdorff with a statistic."
        )


def _refuse_beside_tolerance(others: dict[str, Any]) -> None:
    for name, given in others.items():
        if given is not None:
            raise ValueError(f"{name} is given together with a tolerance, which determines it; pass only one of them.")


def fit_outline(
    target: ShapeLike,
    tolerance: Numbers,
    *,
    degree: int = 3,
    smooth: bool = False,
    max_segments: int = 64,
    max_steps: int = 40,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> list[FitSolution[Array, BezierSegments]]:
    """Fits of all contours of an outline within a tolerance, by few segments.

    Pieces between joints are as long as possible while their least-squares fits stay within a multiple of the
    tolerance. Minimax fits of these pieces are nearer, and may meet the tolerance. If they do not, smaller multiples
    with more segments follow. A smaller number of segments is not ruled out.

    If a contour exceeds the tolerance even with `max_segments`, its `result` is `fit_tolerance_missed`, or
    `out_of_time` if the time was over. The end points of open contours are kept. A closed contour starts at a
    corner if it has one.

    >>> import jhd
    >>> quarter = jhd.BezierSegments(jhd.circle([0, 0], 1).control_points[:1], jhd.circle([0, 0], 1).weights[:1])
    >>> [fit] = jhd.fit_outline(quarter, 1e-3)
    >>> fit.shape.count, bool(fit.error.upper <= 1e-3)
    (1, True)

    Args:
        target: outline of one or several contours, each with its segments in order.
        tolerance: largest certified Hausdorff distance between a contour and its fit, in the unit of the coordinates;
            at least 1e-10 of the diagonal of the target's box, to which distances are certified.
        degree: degree of the segments, 1 to 32; with `smooth` at least 3, or 2 if all contours are open.
        smooth: whether the tangent is continuous at the joints inside a contour. By default joints may be corners.
        max_segments: largest number of segments of one contour, at least 1.
        max_steps: largest number of steps of one fit. A fit stops as soon as it is within the tolerance.
        max_seconds: wall time in seconds for all contours together; see `minimize_hausdorff`. When it is over, the
            best fits so far are returned, which may exceed the tolerance.
        progress: callback that receives a Progress after each step.

    Returns:
        A list with one FitSolution for each contour, in the order of the contours.

    Raises:
        TypeError: the target is no curve.
        ValueError: the target is a point set, a number is out of range, or the tolerance is too small.
    """
    refuse_tracing("fit_outline", target)
    max_segments, max_steps = whole("max_segments", max_segments, 1), whole("max_steps", max_steps, 0)
    given, clock = taken_as("target", target), Clock(max_seconds)
    check_curve("target", given)
    curve = given.segments()
    _refuse_points(curve)
    outline = contours(curve)
    # The point after a joint follows from the point before it, which must not follow from the last joint in turn.
    least = 1 if not smooth else 3 if any(np.asarray(part.next_segment)[-1] == 0 for part in outline) else 2
    degree = _checked_degree(degree, least)
    limit = real_array("tolerance", tolerance)
    if limit.shape != () or not float(limit) > 0:
        raise ValueError(f"tolerance is {limit}; needs one positive number.")
    resolved = float(default_tolerance(diagonal_of(curve), np.dtype(limit.dtype), 0.0))
    if float(limit) < resolved:
        why = "to which distances of this size are certified."
        raise ValueError(f"tolerance is {float(limit):g}; needs at least {1.01 * resolved:.2g}, {why}")
    found = []
    for contour in outline:
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
    progress: Callback | None,
) -> FitSolution:
    """The first fit within the limit, with joints closer and closer together; otherwise the last fit."""
    closed = bool(np.asarray(contour.next_segment)[-1] == 0)
    least = 2 if closed else 1
    fit: Any = None
    reach = _reach(contour, limit)
    # Least-squares pieces within this many tolerances are tried first, as minimax fits are nearer by this factor at
    # best.
    laid = (longest_pieces(contour, degree, 4.0 * limit * 0.75**k, reach) for k in range(40))
    # Of several results with equally many pieces, the last is the most even.
    for count, alike in groupby(laid, key=lambda found: min(max(len(found[1]), least), most)):
        joints, pieces = list(alike)[-1]
        own = count == len(pieces)
        layout = Layout(degree, count, closed, not closed, smooth)
        build, start = least_squares(layout, contour, joints if own else divided(contour, count))
        if own and not smooth:
            start = points_of(build, pieces)
        fit = _minimized(build, start, contour, clock, max_steps=max_steps, stop_below=0.99 * limit, progress=progress)
        if float(fit.error.upper) <= limit or count == most or clock.is_over():
            break
    if float(fit.error.upper) <= limit or name_of(fit.result) != "successful":
        return fit
    late = clock.is_over() or name_of(fit.error.result) == "out_of_time"
    return with_result(fit, RESULTS.out_of_time if late else RESULTS.fit_tolerance_missed)


def _reach(contour: BezierSegments, limit: float) -> float:
    """The scale, as a fraction of the length, at which corners matter for a tolerance."""
    length = float(np.sum(lengths_of(np.asarray(contour.homogeneous), contour.weights is not None)))
    # Scale at which corners are searched, in tolerances.
    return min(8.0 * limit / length, 0.1) if length > 0 else 0.0


class _Flat(eqx.Module):
    """`build` as a function of a vector."""

    build: Callable
    unravel: Callable

    def __call__(self, parameters: Array) -> Any:
        found = traceable(self.build, self.unravel(parameters))
        if not isinstance(found, Shape):
            came = "an array" if isinstance(found, jax.Array) else type(found).__name__
            raise TypeError(f"build(parameters) must be a shape of jhd, for example a jhd.BezierCurve; got {came}.")
        return found


def _capacity(count: int) -> int:
    # Pairs kept for a number of parameters: an error curve with p + 1 equal maxima has some more below.
    return 32 if count <= 14 else 64 if count <= 40 else 128


def _starts(build: Callable, first: np.ndarray, starts: Any, seed: int, target: Shape) -> np.ndarray:
    """Start parameters, one row for each start."""
    if not isinstance(starts, int):
        rows = np.stack([np.asarray(ravel_pytree(row)[0]) for row in _rows(starts)])
        if rows.shape[1:] != first.shape:
            raise ValueError(f"starts holds {rows.shape[1]} parameters each; needs {first.size}.")
        return rows
    if starts < 1:
        raise ValueError(f"starts is {starts}; needs at least 1.")
    if starts == 1:
        return first[None]
    low, high = target.bounds
    # Other starts differ from the first by this fraction of the target's size.
    spread = 0.1 * float(jnp.max(high - low)) * scales_of(build, target)(first)
    noise = np.random.default_rng(seed).normal(size=(starts - 1, first.size))
    return np.concatenate([first[None], first + spread * noise])


def _rows(starts: Any) -> list[Any]:
    count = jax.tree_util.tree_leaves(starts)[0].shape[0]
    return [jax.tree_util.tree_map(lambda x, k=k: jnp.asarray(x, dtype=float)[k], starts) for k in range(count)]


def _checked_degree(degree: int, least: int) -> int:
    degree = whole("degree", degree, 0)
    if not least <= degree <= _LARGEST_DEGREE:
        raise ValueError(f"degree is {degree}; needs at least {least} and at most {_LARGEST_DEGREE}.")
    return degree
