"""Fitting by the Hausdorff distance itself: minimax fits with a proven error and a certificate of stationarity.

At the optimum several maxima of the distance are equal, so descent on the largest one zigzags; here all of them take
part in each step (jhd.fitting.minimax). A stationary point is a local minimum at best: start from several places.
"""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jhd.arrays import real_array
from jhd.distance.frame.method import AbstractHausdorffMethod
from jhd.distance.hausdorff import hausdorff
from jhd.distance.witness.critical import critical_pairs
from jhd.fitting.bundle import Bundled, minimise_by_cuts, motions
from jhd.fitting.chain import Chain, Layout, divided, least_squares, longest_pieces, turns
from jhd.fitting.minimax import Ended, FitProgress, Problem, minimise
from jhd.shapes.as_shape import taken_as
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.solution import DIRECTIONS, RESULTS, CriticalPairs, FitSolution

# Shapes that are fitted, and fitted to.
Fitted = AbstractCurve | ImplicitSurface | TriangleMesh
# Pairs kept for a number of parameters: an error curve with p + 1 equal maxima has some more below.
_CAPACITIES = ((14, 32), (40, 64))
_LARGEST_CAPACITY = 128
# A maximum was missed where the proven distance is larger by this share, or this share of the size.
_MISSED = 1e-9
# Pieces of least squares within this many tolerances are tried first, for minimax fits are nearer by such a factor at
# best; then each time within this share of the last, so many times at most.
_GAIN, _CLOSER, _TRIES = 4.0, 0.75, 40
# Other starts differ from the first by this share of the target's size.
_SPREAD = 0.1


def minimise_hausdorff(
    build: Callable[[Any], Fitted],
    parameters: Any,
    target: Any,
    *,
    starts: Any = 1,
    seed: int = 0,
    max_steps: int = 60,
    atol: float = 0.0,
    capacity: int | None = None,
    method: AbstractHausdorffMethod | None = None,
    progress: Callable[[FitProgress], object] | None = None,
) -> FitSolution:
    """The parameters for which build(parameters) is nearest to the target, in the Hausdorff distance.

    A local minimum near the start. What is to stay fixed (ends, tangents, closedness) is what `build` does not vary.
    Curves are fitted by all maxima of their distance and their curvature; surfaces and meshes, of which one maximum of
    each direction is known, by a bundle of their gradients, which ends where a convex combination of those nearby is
    below a twentieth of their length.

    Args:
        build: from the parameters to a shape of the target's kind; traced, so written in jax.numpy. A module-level
            function or a Module is compiled once, a lambda at each call.
        parameters: the start: an array or a pytree of arrays.
        target: the curve, implicit surface or mesh to be near to.
        starts: how many starts, the first at `parameters` and the others about it; or their parameters, stacked along
            a new leading axis. The best end is returned.
        seed: of the random starts.
        max_steps: most steps from each start.
        atol: a distance at which the fit is good enough; zero goes on to a stationary point.
        capacity: of curves, how many maxima take part; by default enough for the number of parameters.
        method: how the error is proven; by default BranchAndBound().
        progress: called with a FitProgress after each step.

    Raises:
        TypeError: a target that is no curve, surface or mesh, or shapes of another kind than the target.
        ValueError: no parameter, or starts of another shape.
    """
    target = taken_as("target", target)
    bundled = isinstance(target, ImplicitSurface | TriangleMesh)
    if not bundled:
        check_curve("target", target)
    flat, unravel = ravel_pytree(jax.tree_util.tree_map(lambda x: jnp.asarray(x, dtype=float), parameters))
    if flat.size == 0:
        raise ValueError("parameters holds no number; needs at least one.")
    capacity = _capacity(flat.size) if capacity is None else capacity
    built = _Flat(build, unravel)
    ends = []
    for number, start in enumerate(_starts(built, np.asarray(flat), starts, seed, target)):

        def report(step: int, value: float, optimality: float, number: int = number) -> None:
            if progress is not None:
                progress(FitProgress(number, step, value, optimality))

        if bundled:
            ends.append(minimise_by_cuts(built, target, start, max_steps, atol, report))
        else:
            ends.append(minimise(Problem(built, target.segments(), capacity), start, max_steps, atol, report))
    if bundled:
        return _bundled_solution(min(ends, key=lambda ended: ended.point.value), unravel, target, method)
    return _solution(min(ends, key=lambda ended: ended.point.top), unravel, target, method)


def fit_curve(
    target: Any,
    *,
    degree: int,
    segments: int = 1,
    ends: Literal["fixed", "free"] = "fixed",
    closed: bool | None = None,
    smooth: bool = False,
    max_steps: int = 60,
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
        degree: of the segments; at least 3 with `smooth`, and 2 for one segment with fixed ends.
        segments: how many; the target is divided at its corners, and evenly between them.
        ends: "fixed" at those of the target, or "free".
        closed: whether the last segment leads to the first; by default as the target is.
        smooth: whether the tangent is continuous at the joints; without it they may be corners.
        max_steps: most steps from each start.
        atol: a distance at which the fit is good enough; zero goes on to a stationary point.
        method: how the error is proven; by default BranchAndBound().
        progress: called with a FitProgress after each step.

    Raises:
        TypeError: a target that is no curve.
        ValueError: a target of several contours, or sizes that are too small.
    """
    target = taken_as("target", target)
    check_curve("target", target)
    curve = target.segments()
    following = np.asarray(curve.following)
    if np.any(following[:-1] != np.arange(1, curve.count)):
        raise ValueError("target has several contours; needs one, with its segments in order.")
    closed = bool(following[-1] == 0) if closed is None else closed
    least = 3 if smooth else 2 if ends == "fixed" and segments == 1 and not closed else 1
    if not degree >= least:
        raise ValueError(f"degree is {degree}; needs at least {least}.")
    if segments < 1:
        raise ValueError(f"segments is {segments}; needs at least 1.")
    if ends not in ("fixed", "free"):
        raise ValueError(f"ends is {ends!r}; needs 'fixed' or 'free'.")
    joints = divided(curve, segments)
    layout = Layout(degree, segments, closed, ends == "fixed", smooth)
    options = {"max_steps": max_steps, "atol": atol, "method": method, "progress": progress}
    build, start = least_squares(layout, curve, joints)
    if ends == "fixed" or closed:
        return minimise_hausdorff(build, start, curve, **options)
    held, free = least_squares(layout._replace(fixed_ends=True), curve, joints)
    if free.size:
        first = minimise_hausdorff(held, free, curve, **options).parameters
        others = _points_of(build, np.asarray(held(first).control_points))
        return minimise_hausdorff(build, start, curve, starts=np.stack([others, start]), **options)
    return minimise_hausdorff(build, start, curve, **options)


def fit_outline(
    target: Any,
    tolerance: Numbers,
    *,
    degree: int = 3,
    smooth: bool = False,
    max_segments: int = 64,
    max_steps: int = 40,
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
        degree: of the segments.
        smooth: whether inner joints have one tangent.
        max_segments: most segments of one contour.
        max_steps: most steps of one fit; a fit within the tolerance takes no more.
        progress: called with a FitProgress after each step.

    Raises:
        TypeError: a target that is no curve.
        ValueError: a tolerance that is not positive.
    """
    target = taken_as("target", target)
    check_curve("target", target)
    limit = real_array("tolerance", tolerance)
    if limit.shape != () or not float(limit) > 0:
        raise ValueError(f"tolerance is {limit}; needs one positive number.")
    found = []
    for contour in _contours(target.segments()):
        found.append(_within(_from_a_corner(contour), float(limit), degree, smooth, max_segments, max_steps, progress))
    return found


def _within(
    contour: BezierSegments,
    limit: float,
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
    laid = (longest_pieces(contour, degree, _GAIN * limit * _CLOSER**k) for k in range(_TRIES))
    # Of those with as many pieces the last ones are the most even.
    for count, alike in groupby(laid, key=lambda found: min(max(len(found[1]), least), most)):
        joints, pieces = list(alike)[-1]
        own = count == len(pieces)
        layout = Layout(degree, count, closed, not closed, smooth)
        build, start = least_squares(layout, contour, joints if own else divided(contour, count))
        if own and not smooth:
            start = _points_of(build, pieces)
        fit = minimise_hausdorff(build, start, contour, max_steps=max_steps, atol=0.99 * limit, progress=progress)
        if float(fit.error.upper) <= limit or count == most:
            break
    return fit


def _from_a_corner(contour: BezierSegments) -> BezierSegments:
    """A closed contour beginning at its first corner; any other as it is."""
    corners = np.flatnonzero(turns(contour))
    if np.asarray(contour.following)[-1] != 0 or len(corners) == 0:
        return contour
    shift = -(int(corners[0]) + 1)
    weights = None if contour.weights is None else jnp.roll(contour.weights, shift, axis=0)
    return BezierSegments(jnp.roll(contour.control_points, shift, axis=0), weights, contour.following)


def _contours(curve: BezierSegments) -> list[BezierSegments]:
    """The runs of segments that follow each other."""
    following = np.asarray(curve.following)
    starts = np.flatnonzero(np.append(True, following[:-1] != np.arange(1, curve.count)))
    contours = []
    for first, last in zip(starts, np.append(starts[1:], curve.count), strict=True):
        index = np.arange(1, last - first + 1)
        index[-1] = 0 if following[last - 1] == first else -1
        weights = None if curve.weights is None else curve.weights[first:last]
        contours.append(BezierSegments(curve.control_points[first:last], weights, index))
    return contours


def _points_of(build: Chain, control_points: np.ndarray) -> np.ndarray:
    """The free points that give these control points."""
    matrix = np.asarray(build.matrix).reshape(-1, build.matrix.shape[-1])
    return np.linalg.lstsq(matrix, control_points.reshape(len(matrix), -1), rcond=None)[0]


class _Flat(eqx.Module):
    """`build` as a function of a vector."""

    build: Callable
    unravel: Callable

    def __call__(self, parameters: Array) -> Any:
        return self.build(self.unravel(parameters))


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
    scales = (
        Problem(build, target.segments(), 1).scales if isinstance(target, AbstractCurve) else partial(motions, build)
    )
    low, high = target.box()
    spread = _SPREAD * float(jnp.max(high - low)) * scales(first)
    noise = np.random.default_rng(seed).normal(size=(starts - 1, first.size))
    return np.concatenate([first[None], first + spread * noise])


def _rows(starts: Any) -> list[Any]:
    count = jax.tree_util.tree_leaves(starts)[0].shape[0]
    return [jax.tree_util.tree_map(lambda x, k=k: jnp.asarray(x, dtype=float)[k], starts) for k in range(count)]


def _solution(
    ended: Ended, unravel: Callable, target: AbstractCurve, method: AbstractHausdorffMethod | None
) -> FitSolution:
    point, pairs = ended.point, ended.point.pairs
    mu = np.zeros(pairs.value.shape)
    mu[: len(ended.multipliers)] = ended.multipliers
    error = hausdorff(target, point.shape, method, throw=False)
    missed = float(error.lower) > point.top * (1 + _MISSED) + _MISSED * point.size
    return FitSolution(
        parameters=unravel(jnp.asarray(point.parameters)),
        shape=point.shape,
        error=error,
        optimality=jnp.asarray(ended.optimality),
        multipliers=jnp.asarray(mu),
        pairs=pairs,
        result=RESULTS.fit_missed_a_maximum if missed else ended.result,
        stats={name: jnp.asarray(count) for name, count in ended.counts.items()},
        history=jnp.asarray(ended.history),
    )


def _bundled_solution(
    ended: Bundled, unravel: Callable, target: Fitted, method: AbstractHausdorffMethod | None
) -> FitSolution:
    point = ended.point
    there, back = point.solutions
    back = eqx.tree_at(lambda s: s.witness.direction, back, DIRECTIONS.b_to_a)
    order = (0, 1) if there.value >= back.value else (1, 0)
    values, witness = jax.tree_util.tree_map(
        lambda *x: jnp.stack([x[k] for k in order]), *((s.value, s.witness) for s in (there, back))
    )
    return FitSolution(
        parameters=unravel(jnp.asarray(point.parameters)),
        shape=point.shape,
        error=hausdorff(target, point.shape, method, throw=False),
        optimality=jnp.asarray(ended.optimality),
        multipliers=jnp.asarray(ended.multipliers[list(order)]),
        pairs=CriticalPairs(values, witness, jnp.ones(2, bool), RESULTS.successful),
        result=ended.result,
        stats={name: jnp.asarray(count) for name, count in ended.counts.items()},
        history=jnp.asarray(ended.history),
    )


def soft_hausdorff(a: AbstractCurve, b: AbstractCurve, temperature: Numbers, *, capacity: int = 16) -> Array:
    """A smooth stand-in for the Hausdorff distance: temperature log sum exp(h_j / temperature) of the critical pairs.

    It lies above the largest h_j by at most temperature log capacity and falls to it with the temperature; where one
    maximum is born or dies far below the top it hardly jumps. For optimisers that want one smooth loss.

    Args:
        a: a curve.
        b: a curve of the same dimension.
        temperature: a positive length.
        capacity: how many maxima take part.
    """
    pairs, heat = critical_pairs(a, b, capacity), real_array("temperature", temperature)
    return heat * jax.nn.logsumexp(pairs.value / heat, b=pairs.valid)
