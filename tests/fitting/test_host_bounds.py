"""Bounds without programs: exact distances lie between them, without tolerance; fits too short to compile have them."""

import math

import numpy as np
import pytest

import jhd
from jhd._fitting import problem, ways
from jhd._fitting.host_bounds import host_bounds
from jhd._results.solution import name_of
from jhd._runtime import compiled
from jhd._runtime.clock import Clock, OutOfTimeError
from tests.sweeps import swept

LINE = [[[0.0, 0], [1, 0]]]
# Control points, weights of the first curve, and distances that are numbers of double precision.
EXACT = {
    "parallel": (LINE, [[[0, 1], [1, 1]]], None, 1.0),
    "a parabola": ([[[0, 0], [0.5, 0.5], [1, 0]]], LINE, None, 0.25),
    # Its shoulder is at w / (1 + w) of the height.
    "a hyperbola": ([[[0, 0], [0.5, 1], [1, 0]]], LINE, [[1, 3, 1]], 0.75),
    "points": ([[[0, 0]], [[1, 0]]], [[[0, 1.5]], [[1, 2]]], None, 2.0),
    "in space": ([[[0, 0, 0], [3, 0, 4]]], [[[0, 0, 0]]], None, 5.0),
    "the same": (LINE, LINE, None, 0.0),
}
CLOSED, COPIES = 1e-6, 1e-3
# One of each kind first; then with weights at the ends of the range as well.
FIRST = [("a parabola", 0), ("a hyperbola", 0), ("points", 300), ("in space", -300), ("the same", 0)]
FIRST += [("parallel", 0), ("a hyperbola", 300), ("a hyperbola", -300), ("the same", 300)]
OTHERS = [(name, exponent) for name in EXACT for exponent in (0, 300, -300) if (name, exponent) not in FIRST]


@pytest.mark.parametrize(("name", "exponent"), swept(FIRST + OTHERS, 1, 8))
def test_exact_distances_lie_between_the_bounds(name, exponent):
    first, second, weights, exact = EXACT[name]
    size = 2.0**exponent
    pair = (jhd.BezierSegments(size * np.array(first), weights), jhd.BezierSegments(size * np.array(second)))
    for a, b in (pair, pair[::-1]):
        lower, upper = host_bounds(a, b, Clock())
        assert lower <= exact * size <= upper
        if exponent == 0:
            assert upper - lower <= (CLOSED * exact if exact else COPIES)


def test_what_is_too_large_or_too_small_to_be_squared_has_no_bounds():
    for size in (1e200, 1e-200):
        assert host_bounds(jhd.BezierSegments(size * np.array(LINE)), jhd.point_set([(0, 0)]), Clock()) == (0, math.inf)


@pytest.mark.parametrize("seed", swept(range(4), slow=1))
def test_distances_of_dense_samples_are_between_the_bounds(seed):
    random = np.random.default_rng(seed)
    curves = [random.normal(size=(3, 4, 2)), random.normal(size=(2, 5, 2))]
    lower, upper = host_bounds(jhd.BezierSegments(curves[0]), jhd.BezierSegments(curves[1]), Clock())
    t = np.linspace(0.0, 1.0, 801)[:, None]
    samples, gaps = [], []
    for rows in curves:
        n = rows.shape[1] - 1
        basis = np.concatenate([math.comb(n, k) * t**k * (1 - t) ** (n - k) for k in range(n + 1)], axis=1)
        points = np.einsum("tp,spd->std", basis, rows)
        gaps.append(float(np.max(np.linalg.norm(np.diff(points, axis=1), axis=-1))))
        samples.append(points.reshape(-1, 2))
    apart = np.linalg.norm(samples[0][:, None] - samples[1], axis=-1)
    found = max(np.max(np.min(apart, axis=0)), np.max(np.min(apart, axis=1)))
    # A sample is never farther from a place of its curve than the arc between two samples, a little above the chord.
    assert lower - 1.01 * max(gaps) <= found <= upper + 1.01 * max(gaps)
    assert upper - lower <= CLOSED * upper


@pytest.mark.slow
def test_a_fit_without_time_to_compile_has_wider_bounds_that_hold(monkeypatch):
    def refuse(_):
        raise OutOfTimeError

    # As if no program were at hand, and too late.
    monkeypatch.setattr(Clock, "compiling", refuse)
    for module, name in ((problem, "local_pairs"), (ways, "hausdorff")):
        monkeypatch.setattr(module, name, lambda *_, **__: compiled._ask())
    quarter = jhd.BezierSegments([[[1, 0], [1, 1], [0, 1]]], [[1, 0.5**0.5, 1]])
    fit = jhd.fit_curve(quarter, degree=3)
    assert name_of(fit.error.result) == "interrupted" and fit.history[-1] < fit.history[0]
    # The least error of a cubic with these ends.
    assert fit.error.lower <= 6.84399e-5 * (1 + 1e-4) and 6.84398e-5 <= fit.error.upper <= 6.85e-5
    assert fit.error.lower <= fit.error.value <= fit.error.upper
