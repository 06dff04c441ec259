"""Means and quantiles of distances as losses: closed forms, proven bounds, and derivatives beside differences."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.statistics.statistics import _rounded_outward
from jhd._results.solution import name_of
from tests.sweeps import swept

ORIGIN = jhd.point_set([(0.0, 0.0)])
# Of the distance x from the origin along a segment from there, as shares of its length.
SHARES = [(jhd.MeanDistance(True), 1 / 2), (jhd.RMSDistance(True), 3**-0.5), (jhd.QuantileDistance(0.9, True), 0.9)]
SCATTERED = np.random.default_rng(3).normal(size=(40, 2))
WEIGHTS = np.random.default_rng(4).uniform(0, 2, size=40)
STEP, CENTRAL = 1e-4, {1: 2 / 3, 2: -1 / 12}


def segment(length):
    return jhd.polyline(jnp.stack([jnp.zeros(2), jnp.stack([length, 0.0])]))


def difference(function):
    """The derivative of a function of a step at zero, to fourth order."""
    return sum(share * float(function(k * STEP) - function(-k * STEP)) for k, share in CENTRAL.items()) / STEP


@pytest.mark.slow
@pytest.mark.parametrize(("statistic", "share"), SHARES, ids=["mean", "rms", "quantile"])
def test_measures_of_a_segment_from_a_point_are_those_of_its_length_and_so_are_derivatives(statistic, share):
    value, slope = jax.value_and_grad(lambda x: statistic(segment(x), ORIGIN).value)(2.0)
    found = statistic(segment(2.0), ORIGIN)
    assert float(found.lower) <= 2 * share <= float(found.upper) <= float(found.lower) + 2e-2
    assert float(found.lower) <= float(found.value) <= float(found.upper)
    assert float(value) == pytest.approx(2 * share, rel=1e-12)
    assert float(slope) == pytest.approx(share, rel=1e-9)


@pytest.mark.slow
def test_weights_count_and_the_larger_direction_is_taken_and_differentiated():
    points, far = jhd.point_set(SCATTERED), jhd.point_set([(9.0, 0.0), (0.0, 0.5)])
    d = np.min(np.linalg.norm(SCATTERED[:, None] - np.array([(9.0, 0.0), (0.0, 0.5)]), axis=-1), axis=1)
    for statistic, exact in (
        (jhd.MeanDistance(True), np.average(d, weights=WEIGHTS)),
        (jhd.RMSDistance(True), np.average(d**2, weights=WEIGHTS) ** 0.5),
    ):
        found = statistic(points, far, weights=WEIGHTS)
        assert float(found.value) == pytest.approx(exact, rel=1e-14)
        assert found.lower <= exact * (1 + 1e-15) and exact * (1 - 1e-15) <= found.upper <= found.lower * (1 + 1e-12)
    order = np.argsort(d)
    k = order[np.searchsorted(np.cumsum(WEIGHTS[order]), 0.8 * np.sum(WEIGHTS))]
    assert float(jhd.QuantileDistance(0.8, True)(points, far, weights=WEIGHTS)) == pytest.approx(d[k], rel=1e-14)
    # From the two points the nearest is far for one: the mean of that direction is larger.
    found = jhd.MeanDistance()(points, far)
    assert name_of(found.direction) == "b_to_a"

    def moved(x):
        return jhd.MeanDistance()(
            points, jhd.point_set(jnp.array([[9.0, 0.0], [0.0, 0.5]]) + x * jnp.array([1.0, 0.0]))
        ).value

    assert float(jax.grad(moved)(0.0)) == pytest.approx(difference(moved), abs=1e-9)


@pytest.mark.slow
def test_means_are_differentiated_in_their_weights_in_programs_too():
    # The mean of d with weights w moves with w_k by (d_k - mean) / sum w.
    points, d = jhd.point_set(SCATTERED), np.linalg.norm(SCATTERED, axis=1)
    expected = (d - np.average(d, weights=WEIGHTS)) / WEIGHTS.sum()
    mean = lambda w: jhd.MeanDistance(True)(points, ORIGIN, weights=w).value  # noqa: E731
    for gradient in (jax.grad(mean), jax.jit(jax.grad(mean))):
        np.testing.assert_allclose(gradient(jnp.asarray(WEIGHTS)), expected, atol=1e-14)


@pytest.mark.parametrize("statistic", [jhd.MeanDistance(), jhd.RMSDistance(), jhd.QuantileDistance(0.9)], ids=str)
def test_values_of_subnormal_points_lie_between_their_bounds_in_the_larger_direction(statistic):
    small, wide = jhd.point_set([(3e-310, 4e-310), (6e-310, 8e-310)]), jhd.point_set([(0.0, 0.0), (0.0, 3e-309)])
    found = statistic(small, wide)
    lower, value, upper = (float(x) for x in (found.lower, found.value, found.upper))
    assert 0 < lower <= value <= upper < 3e-309 and upper > 1e-309 and name_of(found.direction) == "b_to_a"


def test_bounds_round_outward_in_the_precision_of_the_shapes():
    for end in (0.1, 1 / 3, 7e30):
        lower, upper = _rounded_outward(jhd.Bounds(end, end), np.dtype(np.float32))
        assert lower.dtype == upper.dtype == np.float32
        assert float(lower) <= end <= float(upper) < float(lower) * (1 + 1e-6)


def test_nine_of_ten_points_are_a_share_of_nine_tenths():
    d = np.arange(1.0, 11.0)
    found = jhd.QuantileDistance(0.9, directed=True)(jhd.point_set(np.stack([d, 0 * d], axis=1)), ORIGIN)
    assert float(found.lower) <= 9 <= float(found.upper) < 9 + 1e-12
    assert float(found) == 9 and name_of(found.result) == "successful"


def test_a_quantile_at_just_half_of_the_weight_is_that_of_the_point_there():
    # Sums of these whole weights over the largest one are off by more than a share is rounded.
    random, x = np.random.default_rng(2), np.linspace(1.0, 2.0, 512)
    half = random.integers(1, 8, 256)
    weights = np.concatenate([half, random.permutation(half)])

    def value(rows):
        return jhd.QuantileDistance(0.5, True, weights).estimate(jhd.point_set(rows), ORIGIN)

    found, slope = jax.value_and_grad(value)(jnp.stack([x, 0 * x], axis=1))
    assert float(found) == pytest.approx(x[255], rel=1e-15) and np.flatnonzero(slope).tolist() == [2 * 255]


def test_what_is_no_measure_is_refused():
    points = jhd.point_set(SCATTERED)
    with pytest.raises(ValueError, match="above 0"):
        jhd.QuantileDistance(0.0)
    with pytest.raises(ValueError, match=r"needs \(40,\)"):
        jhd.MeanDistance()(points, ORIGIN, weights=[1.0])
    with pytest.raises(ValueError, match="none negative"):
        jhd.MeanDistance()(points, ORIGIN, weights=-WEIGHTS)
    with pytest.raises(ValueError, match="accepts no weights"):
        jhd.MaxDistance()(points, ORIGIN, weights=WEIGHTS)
    with pytest.raises(TypeError, match="weights need a point set"):
        jhd.MeanDistance()(segment(1.0), ORIGIN, weights=[1.0])
    with pytest.raises(ValueError, match=r"needs \(40,\)"):
        jhd.MeanDistance(weights=[1.0])(points, ORIGIN)


@pytest.mark.parametrize(
    "statistic", [jhd.MeanDistance, jhd.RMSDistance, jhd.MaxDistance, lambda a: jhd.QuantileDistance(0.5, a)]
)
def test_shapes_in_the_call_that_makes_a_measure_are_named(as_a_user, statistic):
    with pytest.raises(TypeError, match="directed must be True or False; got BezierSegments. Pass shapes in a second"):
        statistic(ORIGIN)


@pytest.mark.slow
@pytest.mark.parametrize(
    "statistic",
    [
        pytest.param(jhd.MeanDistance(True, WEIGHTS), id="mean"),
        pytest.param(jhd.QuantileDistance(0.7, weights=WEIGHTS), id="quantile"),
    ],
)
def test_in_programs_and_batches_measures_and_their_gradients_are_those_outside(statistic):
    far = jnp.array([(9.0, 0.0), (0.0, 0.5)])

    def found(x):
        return statistic(jhd.point_set(x), jhd.point_set(far))

    def value(x):
        return found(x).value

    def loss(x):
        return statistic.estimate(jhd.point_set(x), jhd.point_set(far))

    outside, inside = found(SCATTERED), jax.jit(found)(SCATTERED)
    for name in ("value", "lower", "upper"):
        assert float(getattr(inside, name)) == float(getattr(outside, name))
    assert (name_of(inside.direction), name_of(inside.result)) == (name_of(outside.direction), "successful")
    gradient = jax.grad(value)(jnp.asarray(SCATTERED))
    assert np.count_nonzero(gradient) >= 2
    for function in (value, loss):
        assert np.array_equal(jax.jit(jax.grad(function))(SCATTERED), gradient)
    batch = jnp.stack([SCATTERED, 2 * SCATTERED])
    values, gradients = jax.vmap(jax.value_and_grad(value))(batch)
    for k in (0, 1):
        assert float(values[k]) == float(value(batch[k]))
        assert np.array_equal(gradients[k], jax.grad(value)(batch[k]))


def test_in_programs_what_a_plain_call_refuses_the_result_says():
    found = jax.jit(lambda x: jhd.MeanDistance(True)(jhd.point_set(x), ORIGIN))(np.full((3, 2), np.nan))
    assert name_of(found.result) == "nonfinite_value"
    assert (float(found.lower), float(found.upper)) == (0.0, math.inf)


def test_kinds_that_have_no_distribution_are_refused_when_a_program_is_traced():
    sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", -1.5 * np.ones(3), 1.5 * np.ones(3))
    cloud, flat = jhd.point_set([(0.0, 0.0, 2.0)]), jhd.BezierPatch(np.arange(9.0).reshape(1, 3, 3))
    refused = [
        (
            jhd.MeanDistance(directed=True),
            sphere,
            cloud,
            TypeError,
            "a is an ImplicitSurface, whose area is not certified",
        ),
        (jhd.QuantileDistance(0.5), cloud, sphere, TypeError, "b is an ImplicitSurface, whose area is not certified"),
        (jhd.MeanDistance(), cloud, flat, ValueError, "b has no area"),
        (jhd.RMSDistance(True), ORIGIN, cloud, ValueError, "a has 2 coordinates a point and b has 3"),
    ]
    for statistic, a, b, error, message in refused:
        for call in (statistic, statistic.estimate):
            with pytest.raises(error, match=message):
                call(a, b)
            with pytest.raises(error, match=message):
                jax.make_jaxpr(call)(a, b)


@pytest.mark.slow
def test_weights_of_a_measure_count_in_fits():
    scan, target = np.array([[-1.0, 0.0], [1.0, 0.0], [9.0, 0.0]]), np.array([1.0, 1.0, 0.0])
    fit = jhd.minimize_hausdorff(
        lambda x: jhd.point_set(x[None]),
        np.array([0.5, 0.6]),
        jhd.point_set(scan),
        statistic=jhd.RMSDistance(directed=True, weights=target),
    )
    # The middle of the two that count.
    assert fit.statistic is not None and float(fit.statistic) == pytest.approx(1.0)
    assert np.allclose(fit.parameters, 0.0, atol=1e-6)


EVERY_STATISTIC = [jhd.MaxDistance(), jhd.MeanDistance(), jhd.RMSDistance(), jhd.QuantileDistance(0.5)]
CURVES = [np.random.default_rng(k).normal(size=(k + 2, 4, 2)) for k in (0, 1)]


@pytest.mark.parametrize("statistic", swept(EVERY_STATISTIC, slow=1))
def test_derivatives_in_control_points_are_those_of_differences_and_bounds_hold_dense_sums(statistic):
    a, b = CURVES
    directions = [np.random.default_rng(7 + k).normal(size=x.shape) for k, x in enumerate(CURVES)]

    def value(x):
        return statistic.estimate(*(jhd.BezierSegments(p + x * d) for p, d in zip(CURVES, directions, strict=True)))

    assert float(jax.grad(value)(0.0)) == pytest.approx(difference(value), abs=1e-6)
    found = statistic(jhd.BezierSegments(a), jhd.BezierSegments(b))
    assert found.lower <= found.value <= found.upper
    first, second = jhd.BezierSegments(a), jhd.BezierSegments(b)
    dense = [_dense(statistic, first, second), _dense(statistic, second, first)]
    assert float(found.lower) - 1e-4 <= max(dense) <= float(found.upper) + 1e-4


@pytest.mark.slow
def test_curves_that_coincide_have_the_derivative_zero_and_near_ones_that_of_their_distance():
    ends = np.array([(0.1, 0.2), (0.7, 1.1), (2.3, 0.4)])

    def value(x, statistic):
        # Less than the whole: no foot leaves a segment.
        inner = jnp.asarray(ends[0] + np.array([[0.2], [0.7]]) * (ends[1] - ends[0]))
        return statistic.estimate(jhd.polyline(inner + x * jnp.array([0.6, 0.8])), jhd.polyline(ends))

    def mean(x):
        return value(x, jhd.MeanDistance(True))

    others = (lambda x, how=how: value(x, how) for how in (jhd.QuantileDistance(0.5, True), jhd.RMSDistance(True)))
    for function in (mean, jax.jit(mean), *others):
        assert [float(y) for y in jax.value_and_grad(function)(0.0)] == [0, 0]
    # So near, distances are known to seven digits: rules over halves of cells differ by that.
    across = abs(0.9 * 0.6 - 0.6 * 0.8) / math.hypot(0.6, 0.9)
    assert float(jax.grad(mean)(1e-9)) == pytest.approx(across, rel=1e-5)


def _dense(statistic, a, b, count=4000):
    """The statistic of the middles of many parts of each cubic."""
    t = ((np.arange(count) + 0.5) / count)[:, None, None]
    rows = np.asarray(a.control_points)
    powers = [math.comb(3, k) * t**k * (1 - t) ** (3 - k) for k in range(4)]
    points = np.sum([power * rows[:, k] for k, power in enumerate(powers)], axis=0).reshape(-1, 2)
    slopes = [math.comb(2, k) * t**k * (1 - t) ** (2 - k) for k in range(3)]
    tangents = np.sum([x * (rows[:, k + 1] - rows[:, k]) for k, x in enumerate(slopes)], axis=0).reshape(-1, 2)
    d, speed = np.asarray(jhd.project(points, b).distance), np.linalg.norm(tangents, axis=1)
    order = np.argsort(d)
    share = np.cumsum(speed[order]) / np.sum(speed)
    return {
        "MaxDistance": np.max(d),
        "MeanDistance": np.average(d, weights=speed),
        "RMSDistance": np.average(d**2, weights=speed) ** 0.5,
        "QuantileDistance": d[order][np.searchsorted(share[:-1], getattr(statistic, "q", 1.0))],
    }[type(statistic).__name__]


@pytest.mark.parametrize(
    "statistic",
    swept([jhd.MeanDistance(True), jhd.RMSDistance(True), jhd.QuantileDistance(0.7, True)]),
)
def test_parallel_squares_are_everywhere_as_far_as_their_planes(statistic):
    grid = np.stack([*np.meshgrid([0.0, 1.0], [0.0, 1.0], indexing="ij"), np.zeros((2, 2))], axis=-1)
    wide = jhd.BezierPatch(np.array([5.0, 5.0, 1.0]) * (grid - [0.5, 0.5, 0.0]))

    def from_patch(height):
        return statistic(jhd.BezierPatch(jnp.asarray(grid) + height * jnp.array([0, 0, 1.0])), wide).value

    def from_mesh(height):
        rows = jnp.asarray(grid.reshape(-1, 3)) + height * jnp.array([0, 0, 1.0])
        return statistic(jhd.TriangleMesh(rows, np.array([[0, 1, 3], [0, 3, 2]])), wide).value

    for function in (from_patch, from_mesh):
        value, slope = jax.value_and_grad(function)(0.25)
        assert float(value) == pytest.approx(0.25, rel=1e-11)
        assert float(slope) == pytest.approx(1.0, rel=1e-9)


def test_the_largest_distance_is_estimated_in_compiled_functions_and_nodes_may_be_of_numpy(as_a_user):
    largest = jhd.MaxDistance()
    low, high = (jhd.point_set([[0.0, 0, x], [1, 0, 0]]) for x in (0, 2))
    found, known = jax.jit(largest.estimate)(low, high), largest.estimate(low, high)
    assert float(found) == float(known) == pytest.approx(2.0, rel=1e-12)
    a, b = (jhd.BezierSegments(x[:1]) for x in CURVES)
    mean, nodes = jhd.MeanDistance(), np.int64(8)
    value = mean.estimate(a, b, nodes=nodes)  # pyright: ignore[reportArgumentType]
    assert float(value) == float(mean.estimate(a, b, nodes=8))


def test_estimates_of_shapes_that_are_nearly_subnormal_are_refused(as_a_user):
    a, b = jhd.polyline([(0.0, 0), (1e-307, 0)]), jhd.point_set([(0.0, 1e-307)])
    for statistic in (jhd.RMSDistance(directed=True), jhd.QuantileDistance(0.5, directed=True)):
        with pytest.raises(ValueError, match=r"coordinates are at most 1e-307, too small for an estimate"):
            statistic.estimate(a, b)
        with pytest.raises(ValueError, match="nodes is 0; needs a whole number of at least 1"):
            statistic.estimate(a, b, nodes=0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("scale", [2.0**-500, 2.0**500])
def test_measures_scale_with_the_shapes(scale):
    for statistic in (jhd.MeanDistance(), jhd.RMSDistance(), jhd.QuantileDistance(0.5)):
        a, b = (jhd.BezierSegments(x[:1]) for x in CURVES)
        there = statistic(*(jhd.BezierSegments(x[:1] * scale) for x in CURVES))
        assert float(there.value) / scale == pytest.approx(float(statistic(a, b).value), rel=1e-9)
        assert there.lower <= there.value <= there.upper


SQUARE = np.stack([*np.meshgrid([0.0, 1.0], [0.0, 1.0], indexing="ij"), np.zeros((2, 2))], axis=-1)
UP = jnp.array([0.0, 0.0, 1.0])


@pytest.mark.exhaustive
def test_the_quantile_over_a_square_about_a_point_is_the_radius_of_a_circle_and_so_is_its_derivative():
    def value(height, size):
        return jhd.QuantileDistance(0.3, True).estimate(
            jhd.BezierPatch(size * SQUARE), jhd.point_set(jnp.array([[0.52, 0.47, 0.0]]) + height * UP)
        )

    exact, slopes = jax.value_and_grad(value, (0, 1))(0.2, 1.0)
    radius = math.sqrt(0.2**2 + 0.3 / math.pi)
    assert float(exact) == pytest.approx(radius, rel=1e-10)
    assert np.allclose(slopes, [0.2 / radius, 0.3 / math.pi / radius], rtol=1e-8)


@pytest.mark.exhaustive
@pytest.mark.parametrize("statistic", [jhd.MeanDistance(True), jhd.QuantileDistance(0.7, True)])
def test_derivatives_over_surfaces_are_those_of_differences_where_feet_jump(statistic):
    rows = np.array([[0.1, 0.2, 0.3], [0.8, 0.9, 0.2], [0.9, 0.1, 0.4]])
    bent = SQUARE + 0.2 * np.random.default_rng(0).normal(size=SQUARE.shape)

    def value(x):
        return statistic.estimate(
            jhd.BezierPatch(bent * (1 + x)),
            jhd.point_set(rows + x * jnp.array([[0.3, -1.0, 0.5], [1.0, 0, 0], [0, 1, 1]])),
        )

    assert float(jax.grad(value)(0.0)) == pytest.approx(difference(value), rel=1e-6)


@pytest.mark.slow
def test_what_is_small_beside_its_distance_has_a_length():
    bow = jhd.BezierSegments([1e-3 * np.array([(0.0, 0.0), (1.0, 3.0), (-1.0, 0.2)])], [[1.0, 0.2, 3.0]])
    found = jhd.deviation(bow, jhd.point_set([(5.0, 0.0)]), rtol=0.05)
    assert found.mean.lower <= 5 <= found.mean.upper < 5.3
