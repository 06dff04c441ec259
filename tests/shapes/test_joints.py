"""Joints as floats: whole numbers that jax.grad and optimizers take, leave, and pass through every transformation."""

import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jhd
from jhd._shapes.joints import followed, linked

TRIANGLE = jhd.polyline([(0, 0), (1, 0), (1, 1)], closed=True)
OPEN = jhd.BezierSegments(TRIANGLE.control_points, None, [-1, 2, -1])


def area(curve):
    x, y = curve.control_points[:, 0], curve.control_points[:, 1]
    return 0.5 * jnp.sum(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0])


@pytest.mark.parametrize("known", [[-1], [1, 2, 0], [-1, -1, 4, 0, 2], [[1, 0], [-1, -1]], np.arange(100_000) - 1])
def test_floats_hold_whole_numbers(known):
    links = linked(np.array(known))
    assert jnp.issubdtype(links.dtype, jnp.floating)
    np.testing.assert_array_equal(followed(links), known)
    np.testing.assert_array_equal(jax.jit(lambda x: followed(linked(x)))(np.array(known)), known)
    # Weight decay: ten thousand steps that each take off a ten thousandth.
    np.testing.assert_array_equal(followed(links * np.float32(1 - 1e-4) ** 10_000), known)


def test_a_curve_is_something_to_differentiate_by():
    value, slope = jax.jit(jax.value_and_grad(area))(TRIANGLE)
    assert float(value) == 0.5 and isinstance(slope, jhd.BezierSegments)
    assert not np.any(slope.links)
    np.testing.assert_array_equal(slope.control_points[0], [[0.0, -0.5], [0.0, 0.0]])
    rational = jhd.circle((0, 0), 1)
    slope = jax.jit(jax.grad(lambda c: jnp.sum(c.reverse().point(0, 0.3))))(rational)
    assert np.any(slope.weights) and not np.any(slope.links)
    np.testing.assert_array_equal(jax.jit(jax.hessian(area))(TRIANGLE).links.links, np.zeros((3, 2, 3, 2)))


def test_joints_are_known_while_a_derivative_is_taken():
    def length_of_parts(curve):
        before, after = curve.split(1.5)
        assert before.next_segment.tolist() == [1, -1] and after.next_segment.tolist() == [1, -1]
        return jnp.sum(before.control_points) + jnp.sum(after.control_points)

    assert np.any(jax.grad(length_of_parts)(TRIANGLE).control_points)


@pytest.mark.parametrize(
    "optimizer", [optax.adamw(1e-2, weight_decay=0.1), optax.sgd(0.1, momentum=0.9), optax.lion(1e-2)]
)
def test_optimizers_move_the_points_and_leave_the_joints(optimizer):
    curve, state = TRIANGLE, optimizer.init(TRIANGLE)  # pyright: ignore[reportArgumentType]

    @jax.jit
    def step(curve, state):
        slope = jax.grad(lambda c: (area(c) - 1) ** 2)(curve)
        updates, state = optimizer.update(slope, state, curve)
        return optax.apply_updates(curve, updates), state

    for _ in range(20):
        curve, state = step(curve, state)
    assert float(area(curve)) > 0.6
    np.testing.assert_array_equal(curve.next_segment, [1, 2, 0])


def test_other_joints_are_no_other_program():
    traces = []

    @jax.jit
    def next_segment(curve):
        traces.append(curve)
        return curve.next_segment

    assert next_segment(TRIANGLE).tolist() == [1, 2, 0] and next_segment(OPEN).tolist() == [-1, 2, -1]
    batch = jax.tree_util.tree_map(lambda *x: jnp.stack(x), TRIANGLE, OPEN)
    assert jax.vmap(next_segment)(batch).tolist() == [[1, 2, 0], [-1, 2, -1]]
    assert len(traces) == 1
    assert jhd.stack_curves([TRIANGLE, OPEN]).next_segment.tolist() == [[1, 2, 0, 0], [-1, 2, -1, -1]]


def test_curves_are_kept_and_compared_with_their_joints():
    again = pickle.loads(pickle.dumps(OPEN))
    assert eqx.tree_equal(again, OPEN) and again.next_segment.tolist() == [-1, 2, -1]
    assert not eqx.tree_equal(TRIANGLE, OPEN)
