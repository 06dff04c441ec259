"""Ragged curves as one batch: the same point sets, in one size."""

import jax
import numpy as np
import pytest

import jhd

LINE = jhd.polyline([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)])
ARC = jhd.circle((1.0, 2.0), 3.0)
CUBIC = jhd.BezierCurve([(0, 0), (1, 2), (3, -1), (4, 0)])


def of(batch, k):
    return jax.tree_util.tree_map(lambda x: x[k], batch)


def test_each_row_is_the_curve_that_it_was_made_of():
    batch = jhd.stack_curves([LINE, CUBIC, LINE.pad(7)])
    assert batch.control_points.shape == (3, 16, 4, 2) and batch.weights is None
    t = np.linspace(0, 1, 9)
    for k, curve in ((0, LINE), (1, CUBIC.segments()), (2, LINE.pad(7))):
        for segment in range(16):
            there = curve.point(min(segment, curve.count - 1), t)
            np.testing.assert_allclose(of(batch, k).point(segment, t), there, rtol=0, atol=8 * np.finfo(float).eps * 4)
    # What has the degree already is kept to the last bit.
    np.testing.assert_array_equal(batch.control_points[1, 0], CUBIC.control_points)
    np.testing.assert_array_equal(batch.next_segment[0, :2], LINE.next_segment)


def test_weights_of_one_curve_are_weights_of_all():
    batch = jhd.stack_curves([ARC, LINE, CUBIC])
    assert batch.weights is not None and batch.weights.shape == (3, 4, 4)
    for k, curve in ((0, ARC), (1, LINE), (2, CUBIC.segments())):
        t = np.array([0.0, 0.3, 1.0])
        there = curve.point(curve.count - 1, t)
        np.testing.assert_allclose(of(batch, k).point(3, t), there, rtol=0, atol=64 * np.finfo(float).eps)


def test_a_batch_of_traced_curves_is_differentiated_through():
    def spread(x):
        batch = jhd.stack_curves([jhd.polyline(x), CUBIC])
        return batch.control_points[0, 0].sum()

    slope = jax.grad(spread)(jax.numpy.array([(0.0, 0.0), (1.0, 0.0)]))
    np.testing.assert_allclose(slope, [[2.0, 2.0], [2.0, 2.0]], rtol=1e-15)


def test_what_is_no_batch_is_refused(as_a_user):
    with pytest.raises(ValueError, match="curves is empty"):
        jhd.stack_curves([])
    with pytest.raises(ValueError, match=r"curves\[1\] has 3 coordinates a point and curves\[0\] has 2"):
        jhd.stack_curves([LINE, jhd.polyline([(0, 0, 0), (1, 1, 1)])])
    with pytest.raises(TypeError, match="curves must be a list of shapes; got a single BezierSegments"):
        jhd.stack_curves(LINE)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match=r"curves\[1\]"):
        jhd.stack_curves([LINE, "a"])  # pyright: ignore[reportArgumentType]
