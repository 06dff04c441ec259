"""Fits: known best curves are reached, errors are proven, maxima are equal, stops are named, input is checked."""

from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

import jhd
from jhd._results.solution import name_of
from tests.sweeps import swept

# The best c of the cubic quarter circle (1, 0), (1, c), (c, 1), (0, 1), and its error, by Newton's method in 40 digits.
BEST, ERROR = 0.551915024493510570743562722793, 1.9607646987687817401874512914923e-4
FIXED, FREE, QUINTIC = 6.84399e-5, 5.50781e-5, 7.7034e-10
STATIONARY, ROUNDING = 1e-8, 4e-16
STEPS = 15


def quarter():
    return jhd.BezierSegments([[[1, 0], [1, 1], [0, 1]]], [[1, 0.5**0.5, 1]])


def symmetric(c):
    """The cubic with one parameter."""
    return jhd.BezierCurve(
        jnp.array([[1.0, 0], [1, 0], [0, 1], [0, 1]]) + c * jnp.array([[0, 0], [0, 1], [1, 0], [0, 0]])
    )


def turned(parameters):
    """The symmetric cubic moved, as a pytree of parameters."""
    return symmetric(0.55).transform(jnp.eye(2), parameters["offset"])


def spread(solution):
    """How far the pairs with positive multipliers are below the largest."""
    values = np.asarray(solution.pairs.value)[np.asarray(solution.multipliers) > 0]
    return values.max() - values.min()


def random_curve(seed):
    """A random curve of degree 7: every second one is wild."""
    noise = np.random.default_rng(seed).normal(size=(8, 2))
    return jhd.BezierCurve(np.stack([np.linspace(0, 1, 8), np.zeros(8)], axis=1) + (0.12, 0.3)[seed % 2] * noise)


@cache
def fitted(start):
    """The fit of one parameter to the quarter circle, made once."""
    return jhd.minimize_hausdorff(symmetric, start, quarter())


@pytest.mark.exhaustive
@pytest.mark.parametrize("start", [0.8, 0.3, 0.5])
def test_the_best_quarter_circle_of_one_parameter_is_found(start):
    solution = fitted(start)
    assert name_of(solution.result) == "successful"
    assert abs(float(solution.parameters) - BEST) <= 1e-12
    assert int(solution.stats["steps"]) <= STEPS
    assert solution.error.lower <= ERROR * (1 + 1e-12) and ERROR * (1 - 1e-12) <= solution.error.upper


@pytest.mark.slow
def test_the_error_is_proven_and_the_history_falls():
    solution = fitted(0.8)
    assert name_of(solution.error.result) == "successful"
    assert np.all(np.diff(solution.history) <= ROUNDING)
    assert len(solution.history) == int(solution.stats["steps"]) + 1
    assert float(solution) == float(solution.error.value)
    assert "successful" in repr(solution)


@pytest.mark.slow
def test_free_inner_points_end_in_equal_oscillation():
    solution = jhd.fit_curve(quarter(), degree=3)
    assert float(solution.error.value) == pytest.approx(FIXED, rel=1e-5)
    assert float(solution.optimality) <= STATIONARY
    # Four parameters and five equal maxima.
    assert np.sum(solution.multipliers > 0) == 5 and spread(solution) <= max(1e-8 * FIXED, ROUNDING)


@pytest.mark.slow
def test_free_ends_are_nearer_than_fixed_ones():
    solution = jhd.fit_curve(quarter(), degree=3, ends="free")
    assert float(solution.error.value) == pytest.approx(FREE, rel=1e-5)


@pytest.mark.slow
def test_parameters_may_be_a_pytree_and_progress_is_reported():
    seen = []
    solution = jhd.minimize_hausdorff(turned, {"offset": jnp.array([0.1, 0.0])}, quarter(), progress=seen.append)
    assert set(solution.parameters) == {"offset"}
    assert [news.done for news in seen] == list(range(len(solution.history)))
    assert float(solution.error.value) < 1e-3


@pytest.mark.slow
def test_several_starts_give_the_best_of_them():
    solution = jhd.minimize_hausdorff(symmetric, 0.3, quarter(), starts=jnp.array([0.1, 0.54]), max_steps=2)
    alone = jhd.minimize_hausdorff(symmetric, 0.54, quarter(), max_steps=2)
    assert float(solution.error.value) == float(alone.error.value)


def test_a_fit_without_steps_says_so():
    solution = jhd.minimize_hausdorff(symmetric, 0.3, quarter(), max_steps=0)
    assert name_of(solution.result) == "fit_steps_exhausted" and float(solution.parameters) == 0.3


def test_a_fit_that_is_good_enough_stops():
    solution = jhd.minimize_hausdorff(symmetric, 0.3, quarter(), stop_below=0.05)
    assert name_of(solution.result) == "successful" and float(solution.error.value) <= 0.05
    assert float(solution.optimality) > 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"degree": 1}, "degree"),
        ({"degree": 2, "smooth": True, "segments": 2}, "degree"),
        ({"degree": 1, "smooth": True, "tolerance": 1e-2}, "degree is 1; needs at least 2 and at most 32"),
        ({"degree": 3, "segments": 0}, "segments"),
        ({"degree": 3, "ends": "loose"}, "ends"),
        ({"degree": 3.0}, "degree is 3.0; needs a whole number"),
        ({"degree": 3, "segments": 1.5}, "segments is 1.5; needs a whole number"),
        ({"degree": 3, "max_steps": -1}, "max_steps is -1; needs a whole number of at least 0"),
        ({"degree": 3, "stop_below": -1.0}, "stop_below is -1; needs a number of at least 0"),
        ({"degree": 3, "tolerance": 1e-11}, r"tolerance is 1e-11; needs at least 1.4e-10, to which distances"),
    ],
)
def test_sizes_that_are_too_small_are_refused(options, message, as_a_user):
    with pytest.raises(ValueError, match=message):
        jhd.fit_curve(quarter(), **options)


def test_a_fit_that_misses_its_tolerance_says_so(as_a_user):
    sizes: Any = {"degree": np.int64(3), "max_segments": np.int32(1)}
    [fit] = jhd.fit_outline(quarter(), 1e-5, **sizes)
    assert float(fit.error.upper) > 1e-5 and name_of(fit.result) == "fit_tolerance_missed" and not fit.ok
    with pytest.raises(ValueError, match="max_segments is 0; needs a whole number of at least 1"):
        jhd.fit_outline(quarter(), 1e-5, max_segments=0)


def test_degrees_beyond_those_served_are_refused_at_once():
    target = jhd.polyline([(0, 0), (1, 0), (1, 1)])
    with pytest.raises(ValueError, match="degree is 99999999; needs at least 2 and at most 32"):
        jhd.fit_curve(target, degree=99_999_999)
    with pytest.raises(ValueError, match="degree is 33; needs at least 1 and at most 32"):
        jhd.fit_outline(target, 1.0, degree=33)


@pytest.mark.parametrize("degree", [1, 2])
def test_smooth_outlines_of_a_degree_without_smooth_chains_are_refused(degree):
    with pytest.raises(ValueError, match=f"degree is {degree}; needs at least 3 and at most 32"):
        jhd.fit_outline(jhd.circle([0, 0], 1), 0.1, degree=degree, smooth=True)


def test_a_target_of_two_contours_is_refused():
    with pytest.raises(ValueError, match="several contours"):
        jhd.fit_curve(jhd.BezierSegments([[[0, 0], [1, 0]], [[5, 5], [6, 5]]]), degree=2)


def test_points_have_no_order_to_be_fitted_in():
    with pytest.raises(ValueError, match="set of points"):
        jhd.fit_curve(jhd.point_set([(0, 0), (1, 0)]), degree=3)
    with pytest.raises(ValueError, match="set of points"):
        jhd.fit_outline(jhd.point_set([(0, 0), (1, 0)]), 0.1)


def test_no_parameters_are_refused():
    with pytest.raises(ValueError, match="parameters"):
        jhd.minimize_hausdorff(symmetric, jnp.zeros((0,)), quarter())


@pytest.mark.exhaustive
def test_the_quintic_quarter_circle_reaches_the_floor_of_rounding_or_says_that_it_is_near_it():
    # Some processors round so that the last steps, a few units of roundoff each, find no descent.
    solution = jhd.fit_curve(quarter(), degree=5)
    value, result = float(solution.pairs.value[0]), name_of(solution.result)
    assert value >= QUINTIC * (1 - 1e-4) and result in ("successful", "fit_roundoff_limited")
    if result == "successful":
        assert value == pytest.approx(QUINTIC, rel=1e-4)
        assert spread(solution) <= ROUNDING and np.sum(solution.multipliers > 0) == 9
    else:
        assert value <= 1.05 * QUINTIC


@pytest.mark.exhaustive
@pytest.mark.parametrize(("segments", "error"), [(6, 0.086), (15, 1.51e-3)])
def test_an_outline_of_thirty_segments_is_fitted_with_sixty_parameters(segments, error):
    path = TextPath((0, 0), "S", size=1, prop=FontProperties(family="DejaVu Serif"))
    outline = jhd.BezierSegments.from_path(path)
    solution = jhd.fit_curve(outline, degree=2, segments=segments, max_steps=100)
    assert outline.count == 30 and solution.parameters.size == 4 * segments
    # Two dozen maxima are equal then; which of two neighboring optima it is hangs on rounding.
    assert name_of(solution.result) in ("successful", "fit_roundoff_limited")
    assert float(solution.error.value) < error
    assert solution.history[-2] - solution.history[-1] <= 1e-6 * solution.history[-1]


@pytest.mark.exhaustive
def test_smooth_joints_have_one_tangent():
    wave = jhd.BezierCurve([[0, 0], [1, 3], [2, -4], [3, 5], [4, -2], [5, 0]])
    solution = jhd.fit_curve(wave, degree=3, segments=3, smooth=True)
    points = solution.shape.segments().control_points
    before, after = points[:-1, -1] - points[:-1, -2], points[1:, 1] - points[1:, 0]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    np.testing.assert_allclose(cross, 0, atol=1e-12)
    assert float(solution.optimality) <= STATIONARY


@cache
def reduced(seed, degree, ends):
    """The fit to a random curve, made once."""
    return jhd.fit_curve(random_curve(seed), degree=degree, ends=ends)


@pytest.mark.parametrize("count", swept([2, 10]))
def test_most_random_degree_reductions_are_stationary_and_the_others_are_named(count):
    stationary = 0
    for seed in range(count):
        errors = []
        for degree in (3, 4):
            solution = reduced(seed, degree, "fixed")
            errors.append(float(solution.error.value))
            equal = spread(solution) <= max(1e-8 * errors[-1], ROUNDING)
            stationary += bool(solution.optimality <= STATIONARY and equal)
            assert (name_of(solution.result) == "successful") == bool(solution.optimality <= STATIONARY)
        assert errors[1] <= errors[0] * (1 + 1e-9)
    assert stationary >= 1.6 * count


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_free_ends_are_never_farther(seed):
    fixed, free = (reduced(seed, 3, ends) for ends in ("fixed", "free"))
    assert float(free.error.value) <= float(fixed.error.value) * (1 + 1e-9)


# A circle of radius 2 about (3, 1), some noise, and one point of twelve far away.
NOISE = np.random.default_rng(0)
ANGLES = np.linspace(0, 2 * np.pi, 120, endpoint=False)
POINTS = np.stack([3 + 2 * np.cos(ANGLES), 1 + 2 * np.sin(ANGLES)], axis=1) + 0.01 * NOISE.normal(size=(120, 2))
POINTS[::12] += 1.5 * NOISE.normal(size=(10, 2))


def about(parameters):
    return jhd.circle(parameters[:2], parameters[2])


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "statistic", [jhd.MeanDistance(directed=True), jhd.QuantileDistance(0.9, directed=True)], ids=["mean", "quantile"]
)
def test_a_circle_is_found_among_outliers_by_a_mean_and_by_a_quantile(statistic):
    fit = jhd.minimize_hausdorff(
        about, np.array([2.5, 1.3, 1.5]), jhd.point_set(POINTS), statistic=statistic, max_steps=40
    )
    np.testing.assert_allclose(fit.parameters, [3, 1, 2], atol=0.02)
    assert fit.statistic is not None
    assert float(fit.statistic.lower) <= float(fit) <= float(fit.statistic.upper)
    assert fit.history[-1] == pytest.approx(float(fit), rel=1e-9) and np.all(np.diff(fit.history) <= 0)
    # The farthest outlier stays where it is.
    assert float(fit.error.lower) > 1


@pytest.mark.slow
def test_a_fit_that_runs_out_of_time_hands_back_the_best_so_far(monkeypatch):
    monkeypatch.setattr("jhd._runtime.clock.time.monotonic", iter(range(10**6)).__next__)
    target, start = jhd.circle([3, 1], 2.0), np.array([2.5, 1.3, 1.5])
    fit = jhd.minimize_hausdorff(about, start, target, max_seconds=2.5)
    assert name_of(fit.result) == "out_of_time"
    assert float(fit.error.value) <= float(jhd.hausdorff(about(start), target).value) * (1 + 1e-12)
    with pytest.raises(ValueError, match="max_seconds is 0"):
        jhd.minimize_hausdorff(about, start, target, max_seconds=0)


@pytest.mark.exhaustive
def test_segments_are_as_many_as_a_tolerance_needs():
    target = jhd.circle([0, 0], 1.0)
    fit = jhd.fit_curve(target, degree=3, tolerance=1e-3)
    assert float(fit.error.upper) <= 1e-3 < float(jhd.fit_curve(target, degree=3, segments=2).error.lower)
    with pytest.raises(ValueError, match="segments is given together with a tolerance"):
        jhd.fit_curve(target, degree=3, tolerance=1e-3, segments=2)


# A cubic, and a curve of degree 5 in space.
CUBIC = np.array([[0, 0], [1, 2], [3, 2], [4, 0.0]])
QUINTIC_IN_SPACE = [[0, 0, 0], [1, 2, 1], [3, 2, -1], [4, 0, 2], [5, 1, 1], [6, -1, 0]]


@pytest.mark.slow
def test_a_copy_of_the_target_stays_where_it_is():
    fit = jhd.minimize_hausdorff(jhd.BezierCurve, CUBIC, jhd.BezierCurve(CUBIC))
    assert name_of(fit.result) == "successful"
    assert (int(fit.stats["steps"]), int(fit.stats["evaluations"])) == (0, 1)
    np.testing.assert_array_equal(fit.parameters, CUBIC)
    assert float(fit.error.lower) == 0 and float(fit.error.upper) < 1e-12


def begun_before(inner):
    """A cubic with the last point of the other one, and a first point that is one off, held."""
    return jhd.BezierCurve(jnp.concatenate([jnp.array([[-1.0, 0]]), inner, jnp.asarray(CUBIC[3:])]))


@pytest.mark.exhaustive
def test_an_end_that_is_held_where_it_is_farthest_cannot_be_improved():
    fit = jhd.minimize_hausdorff(begun_before, CUBIC[1:3] + 0.1, jhd.BezierCurve(CUBIC))
    assert name_of(fit.result) == "successful" and int(fit.stats["steps"]) == 0
    assert float(fit.optimality) == 0 and float(fit.error.value) == pytest.approx(1, rel=1e-12)


@pytest.mark.exhaustive
@pytest.mark.parametrize("smooth", [True, False])
def test_a_curve_in_space_is_fitted_within_a_tolerance(smooth):
    fit = jhd.fit_curve(jhd.BezierCurve(QUINTIC_IN_SPACE), degree=3, tolerance=0.02, smooth=smooth)
    assert float(fit.error.upper) <= 0.02 and fit.shape.count <= 3
    points = np.asarray(fit.shape.control_points)
    np.testing.assert_allclose(points[[0, -1], [0, -1]], np.array(QUINTIC_IN_SPACE)[[0, -1]], atol=1e-15)
    out, into = points[:-1, -1] - points[:-1, -2], points[1:, 1] - points[1:, 0]
    lengths = np.linalg.norm(out, axis=1) * np.linalg.norm(into, axis=1)
    assert bool(np.all(np.sum(out * into, axis=1) > (1 - 1e-9) * lengths)) == smooth


@pytest.mark.parametrize(
    ("build", "options", "message"),
    [
        (lambda p: p, {}, "must be a shape of jhd, for example a jhd.BezierCurve; got an array"),
        (jhd.BezierCurve, {"statistic": "mean"}, r"statistic must be MaxDistance\(\), Mean.*; got 'mean'"),
        (jhd.BezierCurve, {"statistic": jhd.QuantileDistance}, "got the class QuantileDistance: call it"),
        (jhd.BezierCurve, {"max_seconds": "5"}, "max_seconds must be a number; got '5'"),
    ],
)
def test_slips_in_a_fit_are_named(as_a_user, build, options, message):
    with pytest.raises(TypeError, match=message):
        jhd.minimize_hausdorff(build, np.eye(2), jhd.polyline([(0, 0), (1, 0)]), **options)
