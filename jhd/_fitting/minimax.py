"""Minimizing the largest of all critical pairs: a trust region with a quadratic model of each, then Newton's method.

A step minimizes max_i h_i + g_i d + d H_i d / 2 in a box, over the maxima of both directions, with the convex parts of
their Hessians; a step is taken if the true maximum falls. Near the end Newton's method on the optimality system of
the active pairs, h_j = z, sum mu_j g_j = 0, sum mu_j = 1, converges quadratically; its step is taken if the true
maximum does not rise. Parameters are scaled so that each moves the control points by about as much.

Source: trust regions for minimax problems are in Conn, Gould & Toint, Trust-Region Methods (2000), chapter 11.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from jhd._fitting.descent import Ended
from jhd._fitting.expansion import FloatArray, roots
from jhd._fitting.problem import Point, Problem
from jhd._fitting.subproblem import model_step, multipliers
from jhd._results.solution import RESULTS
from jhd._runtime.clock import OutOfTimeError

# Rounding of a value, as a fraction of the size.
_ROUNDING = 4e-16
# Residual of a stationary point.
STATIONARY = 1e-8
# Fraction of the last gain as the reward for unchanged parameters; scaled slopes below _TOUCHED count as zero.
_LAZY, _TOUCHED = 0.1, 1e-6
# Newton's method is tried if the last step gained less than this fraction.
_NEAR = 0.3
# A step in a valley gains less than this fraction.
_VALLEY = 1e-3
# A fit of curves of many segments ends when this many steps together gain less than _VALLEY.
_SETTLED = 4


def slack(point: Point) -> float:
    """Largest difference from the largest pair for a pair to be active."""
    # Pairs are active within this fraction of the largest value, or within rounding.
    return max(1e-8 * point.top, _ROUNDING * point.size)


def stationarity(point: Point) -> tuple[FloatArray, float]:
    """Multipliers of all pairs, zero for inactive ones, and the minimal length of the weighted sum of gradients."""
    h, g = point.expansion.value, point.expansion.gradient
    mu = np.zeros(len(h))
    if not len(h):
        return mu, 0.0
    active = h >= point.top - slack(point)
    mu[active] = multipliers(g[active], np.zeros(np.sum(active)))
    return mu, float(np.linalg.norm(mu @ g))


def minimize(
    problem: Problem,
    parameters: FloatArray,
    max_steps: int,
    stop_below: float,
    report: Callable[[int, float, float], object],
) -> Ended:
    """Minimize until the parameters are stationary, the distance is below stop_below, or steps gain nothing."""
    point = problem.at(parameters)
    scale = problem.scales(parameters)
    # First radius: this fraction of the size, or this many times the distance if that is less.
    radius = np.full(len(scale), min(0.1 * point.size, 30.0 * point.top))
    stride, history, creeping, result = np.zeros_like(scale), [point.top], 0, RESULTS.fit_steps_exhausted
    mu, residual = stationarity(point)
    report(0, point.top, residual)
    for step in range(max_steps + 1):
        # At this residual no further step is tried.
        if point.top <= max(stop_below, _ROUNDING * point.size) or residual <= 1e-13 or step == max_steps:
            break
        last = history[-2] - point.top if len(history) > 1 else point.top
        try:
            moved, radius, stride, result = _step(problem, point, scale, radius, stride, last)
        except OutOfTimeError:
            result = RESULTS.out_of_time
            break
        if moved is None:
            break
        gain, point = point.top - moved.top, moved
        before, (mu, residual) = residual, stationarity(point)
        history.append(point.top)
        report(step + 1, point.top, residual)
        problem.counts["steps"] += 1
        creeping = creeping + 1 if gain < _VALLEY * point.top else 0
        # A valley: this many steps in a row with little gain.
        result = RESULTS.fit_slow_progress if creeping >= 10 else RESULTS.fit_steps_exhausted
        if gain <= _ROUNDING * point.size and residual <= STATIONARY and residual >= 0.1 * before:
            break
        if point.many and len(history) > _SETTLED and history[-1 - _SETTLED] - point.top < _VALLEY * point.top:
            result = RESULTS.fit_slow_progress
            break
    if residual <= STATIONARY or point.top <= max(stop_below, _ROUNDING * point.size):
        result = RESULTS.successful
    return Ended(point, mu, residual, result, problem.counts, history)


def _step(
    problem: Problem, point: Point, scale: FloatArray, radius: FloatArray, stride: FloatArray, last: float
) -> tuple[Point | None, FloatArray, FloatArray, Any]:
    """The next point (or None), radii, stride and a result code."""
    moved, result = _newton(problem, point, scale) if last < _NEAR * point.top else None, RESULTS.successful
    if moved is not None:
        radius = np.maximum(radius, 4 * _length((moved.parameters - point.parameters) / scale))
        problem.counts["newton_steps"] += 1
    else:
        moved, radius, result = _trusted_step(problem, point, scale, radius, last)
    # Steps that gain less than this fraction are tried twice as long.
    if moved is not None and point.top - moved.top < 0.05 * point.top:
        # Along a valley the next steps would be similar: repeat this step and the last one together.
        further = _further(problem, moved, stride + moved.parameters - point.parameters, scale, radius)
        stride = further.parameters - point.parameters if further is not moved else np.zeros_like(scale)
        moved = further
    return moved, radius, stride, result


def _priced(point: Point, scale: FloatArray) -> FloatArray:
    """Multipliers of all pairs, with a price on pairs below the top."""
    h = point.expansion.value
    return multipliers(point.expansion.gradient * scale, 10 * (point.top - h) / point.top)


def _trusted_step(
    problem: Problem, point: Point, scale: FloatArray, radius: FloatArray, last: float
) -> tuple[Point | None, FloatArray, Any]:
    """The point after a step that lowers the largest distance (or None), the next radii, and a result code.

    Each parameter has its own radius. If a step fails, radii of parameters on which the offending pairs depend shrink.
    """
    h, g = point.expansion.value, point.expansion.gradient * scale
    mu = _priced(point, scale)
    bending = problem.bending(point, mu)
    models = [point.expansion.bowls(scale, bending)]
    if last < _NEAR * point.top:
        # The joint curvature of the pairs: in a valley the curvature of each pair alone is too large.
        models.append(roots((point.expansion.hessian(mu) + bending)[None] * scale * scale[:, None]))
    # Parameters that do not matter stay unchanged.
    lazy = min(_LAZY, _LAZY * last / point.top) / len(scale) * point.top
    # Accuracy of models: this fraction of the last gain, and at least this fraction of the distance.
    floor, accuracy = _ROUNDING * point.size, min(1e-6, 1e-4 * last / point.top)
    # Attempts at a step with smaller radii before the fit gives up.
    for _ in range(12):
        tried = []
        for model in models:
            near = _reachable(h, g, model, radius)
            own = model if len(model) == 1 else model[near]
            d = model_step(h[near], g[near], own, radius, lazy, accuracy)
            predicted = point.top - float(np.max(h + g @ d + 0.5 * np.sum((model @ d) ** 2, axis=1)))
            if predicted > floor:
                tried.append((problem.at(point.parameters + scale * d), predicted, d))
        if not tried:
            return None, radius, RESULTS.fit_roundoff_limited
        moved, predicted, d = min(tried, key=lambda trial: trial[0].top)
        gain = point.top - moved.top
        offending = moved.expansion.value > point.top - 0.5 * predicted
        touched = np.max(np.abs(moved.expansion.gradient[offending] * scale), axis=0, initial=0.0) > _TOUCHED
        # Least fraction of the predicted gain to take a step.
        if gain > 0.02 * predicted:
            bound = (np.abs(d) > 0.9 * radius) & ~touched
            shrunk = touched & (gain < 0.25 * predicted)
            # Radii of parameters that no offending pair depends on grow.
            radius = np.where(bound, 2.5 * radius, np.where(shrunk, 0.5 * np.minimum(radius, _length(d)), radius))
            return moved, radius, RESULTS.successful
        touched = touched if np.any(touched) else np.ones_like(touched)
        # Radii of the other parameters shrink.
        radius = np.where(touched, 0.3 * np.minimum(radius, _length(d)), radius)
    return None, radius, RESULTS.fit_nonsmooth_stall


def _reachable(h: FloatArray, g: FloatArray, model: FloatArray, radius: FloatArray) -> FloatArray:
    """Mask of the pairs that can be the largest of the model (given by its roots) anywhere within the radii."""
    slope = np.abs(g) @ radius
    rise = slope + 0.5 * np.sum((np.abs(model) @ radius) ** 2, axis=1)
    return h + rise >= np.max(h - slope)


def _further(problem: Problem, point: Point, stride: FloatArray, scale: FloatArray, radius: FloatArray) -> Point:
    """The best of the point, the point moved on by `stride`, and this point after a step that equalizes pairs."""
    ahead = problem.at(point.parameters + stride)
    # Longer steps are dropped if the distance grows by this factor.
    if ahead.top > 1.5 * point.top:
        return point
    model = ahead.expansion.bowls(scale, problem.bending(ahead, _priced(ahead, scale)))
    lazy = _LAZY / len(scale) * point.top
    d = model_step(ahead.expansion.value, ahead.expansion.gradient * scale, model, radius, lazy)
    equal = problem.at(ahead.parameters + scale * d)
    return min((point, ahead, equal), key=lambda p: p.top)


def _length(d: FloatArray) -> float:
    return float(np.max(np.abs(d)))


def _newton(problem: Problem, point: Point, scale: FloatArray) -> Point | None:
    """The point after Newton's step on the optimality system of the pairs that carry the maximum, or None."""
    support = np.flatnonzero(_priced(point, scale) > 1e-6)
    h, g = point.expansion.value[support], point.expansion.gradient[support] * scale
    mu = np.zeros(len(point.expansion.value))
    mu[support] = multipliers(g, np.zeros(len(support)))
    # If the gradients do not nearly cancel, pairs are missing, and the step would only make values equal.
    # Newton's method needs a combination of the gradients below this fraction of the longest gradient.
    if np.linalg.norm(mu[support] @ g) > 0.1 * np.max(np.linalg.norm(g, axis=1)):
        return None
    hessian = point.expansion.hessian(mu) + problem.bending(point, mu)
    # Steps in units of the distance: Hessians of close curves grow with its reciprocal.
    hessian = hessian * scale * scale[:, None] * point.top
    count, active = len(scale), len(support)
    rows = np.block(
        [
            [hessian, g.T, np.zeros((count, 1))],
            [g, np.zeros((active, active)), -np.ones((active, 1))],
            [np.zeros((1, count)), np.ones((1, active)), np.zeros((1, 1))],
        ]
    )
    d = np.linalg.lstsq(rows, np.concatenate([np.zeros(count), 1 - h / point.top, [1.0]]), rcond=1e-13)[0]
    d[:count] *= point.top
    # Largest step of Newton's method, as a fraction of the size.
    if not np.all(np.isfinite(d)) or np.max(np.abs(d[:count])) > 0.05 * point.size or np.min(d[count:-1]) < -1e-3:
        return None
    moved = problem.at(point.parameters + scale * d[:count])
    return moved if moved.top <= point.top * (1 + 1e-13) + _ROUNDING * point.size else None
