import math

import equinox as eqx
import jax
import numpy as np
import pytest

import jhd
from jhd import BezierCurve

# A few roundings of numbers of size one.
ROUNDING = 1e-14
# Central differences with step 1e-6: truncation 1e-12, rounding 1e-10, of derivatives of size ten.
DIFFERENCES = 1e-8

POINTS = np.random.default_rng(1).normal(size=(4, 2))
WEIGHTS = np.array([1.0, 2.0, 0.5, 1.5])
T = np.linspace(0.0, 1.0, 9)
RATIONAL = pytest.mark.parametrize("weights", [None, WEIGHTS])


@RATIONAL
def test_evaluation_agrees_with_the_bernstein_sum(weights):
    basis = np.stack([math.comb(3, i) * T**i * (1 - T) ** (3 - i) for i in range(4)], axis=1)
    basis = basis * (np.ones(4) if weights is None else weights)
    expected = basis @ POINTS / basis.sum(axis=1, keepdims=True)
    curve = BezierCurve(POINTS, weights)
    np.testing.assert_allclose(curve(T), expected, atol=ROUNDING)
    np.testing.assert_allclose(curve.segments()(T), expected, atol=ROUNDING)
    assert (curve.degree, curve.dim) == (3, 2)


@pytest.mark.parametrize("control_points", [POINTS, POINTS[:1]])
def test_parameters_keep_their_shape(control_points):
    curve = BezierCurve(control_points)
    assert curve(0.5).shape == (2,)
    assert curve([0.25, 0.5]).shape == (2, 2)
    assert curve(np.full((2, 3), 0.5)).shape == (2, 3, 2)


def test_a_single_point_is_a_curve():
    point = BezierCurve([[1, 2, 3]], [5])
    assert (point.degree, point.dim) == (0, 3)
    np.testing.assert_array_equal(point(T), np.tile([1.0, 2.0, 3.0], (9, 1)))
    np.testing.assert_array_equal(point.derivative()(0.5), [0, 0, 0])
    np.testing.assert_array_equal(point.split(0.5)[1].control_points, [[1, 2, 3]])
    assert point.segments().next_segment.tolist() == [-1]


@RATIONAL
def test_derivative_agrees_with_differences(weights):
    curve, h = BezierCurve(POINTS, weights), 1e-6
    derivative = curve.derivative()
    assert derivative.degree == (2 if weights is None else 6)
    np.testing.assert_allclose(derivative(T), (curve(T + h) - curve(T - h)) / (2 * h), atol=DIFFERENCES)


@RATIONAL
def test_parts_of_a_split_cover_the_curve(weights):
    curve = BezierCurve(POINTS, weights)
    before, after = curve.split(0.3)
    np.testing.assert_allclose(before(T), curve(0.3 * T), atol=ROUNDING)
    np.testing.assert_allclose(after(T), curve(0.3 + 0.7 * T), atol=ROUNDING)
    np.testing.assert_allclose(before.control_points[-1], after.control_points[0], atol=ROUNDING)


def test_split_may_be_traced():
    moved = jax.jit(jax.grad(lambda t: BezierCurve(POINTS).split(t)[0].control_points[-1, 0]))(0.3)
    np.testing.assert_allclose(moved, BezierCurve(POINTS).derivative()(0.3)[0], rtol=10 * ROUNDING)


@pytest.mark.parametrize("ends", [(0.2, 0.7), (0.0, 1.0), (0.9, 0.1), (0.5, 0.5)])
def test_restriction_runs_over_its_own_parameter(ends):
    curve = BezierCurve(POINTS, WEIGHTS)
    part = curve.restrict(*ends)
    np.testing.assert_allclose(part(T), curve(ends[0] + T * (ends[1] - ends[0])), atol=ROUNDING)


def test_elevation_and_reversal_keep_the_curve():
    curve = BezierCurve(POINTS, WEIGHTS)
    assert curve.elevate(6).degree == 6
    np.testing.assert_allclose(curve.elevate(6)(T), curve(T), atol=ROUNDING)
    np.testing.assert_allclose(curve.reverse()(T), curve(1 - T), atol=ROUNDING)


def test_transform_is_affine():
    matrix = np.array([[1.0, 2.0], [0.0, 3.0], [1.0, 0.0]])
    curve = BezierCurve(POINTS, WEIGHTS)
    image = curve.transform(matrix, [1, 2, 3])
    assert image.dim == 3
    np.testing.assert_allclose(image(T), curve(T) @ matrix.T + np.arange(1, 4), atol=10 * ROUNDING)


def test_a_closed_curve_follows_itself():
    assert BezierCurve([[0, 0], [1, 0], [0, 1], [0, 0]]).segments().next_segment.tolist() == [0]
    assert BezierCurve(POINTS).segments().next_segment.tolist() == [-1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: BezierCurve([]), r"control_points has shape \(0,\); needs \(points, dim\)\."),
        (lambda: BezierCurve(np.zeros((0, 2))), r"control_points is empty: its shape is \(0, 2\)\."),
        (lambda: BezierCurve([[1.0], [2.0]]), r"control_points has 1 coordinates a point; needs 2 or 3\."),
        (lambda: BezierCurve([[0, 0], [1]]), r"control_points must be a rectangular array of numbers"),
        (lambda: BezierCurve([[0, 0], [np.nan, 0.5]]), r"control_points\[1\] is not finite: \(nan, 0\.5\)\."),
        (lambda: BezierCurve(POINTS, [1, 2, 3]), r"weights has 3 entries; control_points has 4 points\."),
        (lambda: BezierCurve(POINTS, [[1, 2, 3, 4]]), r"weights has 1 x 4; control_points has 4 points\."),
        (lambda: BezierCurve(POINTS, [1, 2, 0, 4]), r"weights\[2\] is not positive: 0\."),
        (lambda: BezierCurve(POINTS, [1, 2, np.inf, 4]), r"weights\[2\] is not finite: inf\."),
        (lambda: BezierCurve(POINTS).split(0.0), r"t is 0; needs 0 < t < 1\."),
        (lambda: BezierCurve(POINTS).split(1), r"t is 1; needs 0 < t < 1\."),
        (lambda: BezierCurve(POINTS).restrict(-0.5, 1), r"t0 is -0\.5; needs 0 <= t0 <= 1\."),
        (lambda: BezierCurve(POINTS).restrict(0, 1.5), r"t1 is 1\.5; needs 0 <= t1 <= 1\."),
        (lambda: BezierCurve(POINTS).elevate(2), r"degree is 3; cannot elevate to 2\."),
        (lambda: BezierCurve(POINTS)(np.nan), r"t is not finite: nan\."),
        (lambda: BezierCurve(POINTS).transform(np.eye(3)), r"matrix has shape \(3, 3\); needs \(new_dim, 2\)\."),
    ],
)
def test_wrong_values_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("wrong", [[["a", "b"]], POINTS * 1j])
def test_what_are_no_real_numbers_is_refused(wrong):
    with pytest.raises(TypeError, match=r"control_points must be real numbers; its dtype is"):
        BezierCurve(wrong)


def test_a_curve_is_a_tree_of_its_arrays():
    curve = BezierCurve(POINTS, WEIGHTS)
    leaves, structure = jax.tree_util.tree_flatten(curve)
    assert [leaf.shape for leaf in leaves] == [(4, 2), (4,)]
    assert bool(eqx.tree_equal(curve, jax.tree_util.tree_unflatten(structure, leaves)))


def test_curves_are_mapped_over():
    batch = eqx.filter_vmap(BezierCurve)(np.stack([POINTS, 2 * POINTS]), np.stack([WEIGHTS, WEIGHTS]))
    assert (batch.degree, batch.dim) == (3, 2)
    values = jax.jit(jax.vmap(lambda curve: curve(T)))(batch)
    np.testing.assert_allclose(values[1], 2 * BezierCurve(POINTS, WEIGHTS)(T), atol=ROUNDING)
    parts = jax.vmap(lambda curve, t: curve.split(t)[0].control_points[-1])(batch, np.array([0.25, 0.5]))
    np.testing.assert_allclose(parts[1], 2 * BezierCurve(POINTS, WEIGHTS)(0.5), atol=ROUNDING)


def test_the_gradient_in_points_and_weights_agrees_with_differences():
    def value(points, weights):
        return BezierCurve(points, weights)(0.3)[0]

    gradient = jax.jit(jax.grad(value, argnums=(0, 1)))(POINTS, WEIGHTS)
    step = np.eye(4)[2] * 1e-6
    by_weight = (value(POINTS, WEIGHTS + step) - value(POINTS, WEIGHTS - step)) / 2e-6
    by_point = (value(POINTS + step[:, None], WEIGHTS) - value(POINTS - step[:, None], WEIGHTS)) / 2e-6
    np.testing.assert_allclose(gradient[1][2], by_weight, atol=DIFFERENCES)
    np.testing.assert_allclose(gradient[0][2, 0], by_point, atol=DIFFERENCES)


def test_degrees_have_a_limit_that_is_named():
    row = np.linspace([0, 0], [1, 0], 130)
    knots = np.repeat([0.0, 1.0], 130)
    net = np.zeros((2, 130, 3))
    for make in (
        lambda: BezierCurve(row),
        lambda: jhd.BezierSegments(row[None]),
        lambda: jhd.BSplineCurve(row, knots),
        lambda: jhd.BezierPatch(net),
        lambda: jhd.BezierPatches(net[None]),
        lambda: jhd.BSplineSurface(net, [0, 0, 1, 1], knots),
        lambda: BezierCurve(row[:2]).elevate(129),
    ):
        with pytest.raises(ValueError, match="the degree is 129; must be at most 128"):
            make()
    assert BezierCurve(row[1:]).degree == 128


@pytest.mark.exhaustive
def test_nearest_points_at_the_largest_degree_are_proven():
    found = jhd.project([[0.3, 0.4], [2.0, 0.0]], BezierCurve(np.linspace([0, 0], [1, 0], 129)))
    lower, upper = np.asarray(found.lower), np.asarray(found.upper)
    assert np.all(lower <= [0.4, 1.0]) and np.all(upper >= [0.4, 1.0])
    assert np.all(upper - lower < 1e-10)


def test_segments_are_in_the_default_precision_whatever_that_of_the_curve():
    points = [(0.0, 0), (1, 2), (2, 0)]
    with jax.enable_x64(False):
        single = BezierCurve(points, [1, 2, 1])
    for curve, wide in ((single, True), (BezierCurve(points), False)):
        with jax.enable_x64(wide):
            kinds = {x.dtype for x in jax.tree_util.tree_leaves(curve.segments())}
        assert kinds == {np.dtype(float if wide else np.float32)}
