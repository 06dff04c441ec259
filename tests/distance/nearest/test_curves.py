"""Bounds of the nearest point hold against rational arithmetic, without a tolerance."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jhd._distance.nearest import curves as module
from jhd._distance.nearest.curves import nearest, repeated
from tests import reference
from tests.distance import exact
from tests.sweeps import swept

# The reference's distances are off by a few roundings of coordinates of order one.
REFERENCE = 1e-13
# Upper and lower meet at eight times the rounding error of a distance: 8 * sqrt(3) * 38 * 1.02 * 2^-53 for degree 10.
CLOSED = 1e-13
# Queries of one curve; one program a shape of curve.
COUNT = 24
GRID = [Fraction(k, 16) for k in range(17)]

search = jax.jit(jax.vmap(nearest, (0, None, None)))


def queries(control_points, weights, seed):
    """Points on the curve, beside it by 1e-14 to 1e-2, at control points, near and far away."""
    rng = np.random.default_rng(seed)
    count, dim = len(control_points), control_points.shape[-1]
    on = reference.evaluate(control_points, weights, rng.uniform(size=COUNT))[
        rng.integers(0, count, COUNT), range(COUNT)
    ]
    rows = np.concatenate([on[:4], on[4:12] + rng.normal(size=(8, dim)) * 10.0 ** rng.uniform(-14, -2, (8, 1))])
    rows = np.concatenate([rows, control_points.reshape(-1, dim)[:3], rng.normal(size=(COUNT, dim))])[:COUNT]
    rows[-2:] *= 1e3
    return rows


def holds(found, rows, control_points, weights):
    """Asserts upper >= distance to a point of the curve, and lower <= distances to many points of it, all exact."""
    for k, row in enumerate(rows):
        piece, t = int(found.segment[k]), Fraction(float(found.t[k]))
        lower_sq, upper_sq = (Fraction(float(x[k])) ** 2 for x in (found.lower, found.upper))
        assert found.lower[k] <= found.distance[k] <= found.upper[k]
        assert exact.distance_sq(row, *segment_of(control_points, weights, piece), t) <= upper_sq
        assert lower_sq <= exact.minimum_near(row, *segment_of(control_points, weights, piece), t)
        for index in range(len(control_points)):
            piece = segment_of(control_points, weights, index)
            assert all(lower_sq <= exact.distance_sq(row, *piece, s) for s in GRID)


def segment_of(control_points, weights, index):
    return control_points[index], None if weights is None else weights[index]


def special(name, rng):
    """Single cubic segments in the plane with what makes trouble."""
    points = rng.normal(size=(4, 2))
    if name == "cusp":
        points[1:3] = points[3], points[0]
    if name == "no speed at an end":
        points[1] = points[0]
    if name == "point":
        points[:] = points[0]
    if name == "line":
        points = points[:1] + np.linspace(0, 1, 4)[:, None] * points[1:2]
    if name == "folded line":
        points = points[:1] * rng.normal(size=(4, 1))
    if name == "nearly flat":
        points[:, 1] *= 1e-12
    if name == "nearly a point":
        points = points[:1] + 1e-13 * points
    return points[None]


KINDS = ("smooth", "cusp", "no speed at an end", "point", "line", "folded line", "nearly flat", "nearly a point")


@pytest.mark.parametrize("kind", swept(KINDS, slow=KINDS))
def test_bounds_hold_beside_cubics_of_every_kind(kind):
    control_points = special(kind, np.random.default_rng(len(kind)))
    rows = queries(control_points, None, 1)
    found = search(rows, control_points, None)
    holds(found, rows, control_points, None)
    assert found.closed.all()
    np.testing.assert_allclose(found.distance, reference.distance_profile(rows, control_points), atol=REFERENCE * 1e3)


@pytest.mark.parametrize("degree", swept([0, 1, 2, 6, 10], slow=[0, 10]))
def test_bounds_hold_for_every_degree(degree):
    control_points = np.random.default_rng(degree).normal(size=(1, degree + 1, 3 if degree == 10 else 2))
    rows = queries(control_points, None, 2)
    found = search(rows, control_points, None)
    holds(found, rows, control_points, None)
    assert found.closed.all()
    size = np.maximum(1, np.abs(rows).max(axis=1))
    assert np.all(found.upper - found.lower <= CLOSED * 4 * size)


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [0, 1, 3])
def test_bounds_hold_for_weights_from_a_thousandth_to_a_thousand(exponent):
    rng = np.random.default_rng(exponent)
    control_points, weights = rng.normal(size=(1, 4, 2)), 10 ** rng.uniform(-exponent, exponent, size=(1, 4))
    rows = queries(control_points, weights, 3)
    found = search(rows, control_points, weights)
    holds(found, rows, control_points, weights)
    assert found.closed.all()


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [-140, -40, 40, 400])
def test_bounds_hold_at_every_scale(exponent):
    control_points = np.ldexp(special("smooth", np.random.default_rng(4)), exponent)
    rows = np.ldexp(queries(special("smooth", np.random.default_rng(4)), None, 4), exponent)
    found = search(rows, control_points, None)
    holds(found, rows, control_points, None)
    assert found.closed.all()


@pytest.mark.slow
def test_bounds_hold_for_several_segments_and_repeated_ones_change_nothing():
    rng = np.random.default_rng(6)
    control_points = rng.normal(size=(4, 4, 2))
    control_points[2:] = control_points[1]
    rows = queries(control_points, None, 6)
    found = search(rows, control_points, None)
    holds(found, rows, control_points, None)
    skip = repeated(jnp.array(control_points), None)
    np.testing.assert_array_equal(skip, [False, False, True, True])
    again = jax.jit(jax.vmap(lambda p: nearest(p, control_points, None, 0.0, skip)))(rows)
    np.testing.assert_allclose(again.distance, found.distance, atol=REFERENCE * 1e3)
    assert (again.segment <= 1).all() and (again.steps <= found.steps).all()
    holds(again, rows, control_points, None)


def test_weights_tell_repeated_segments_apart():
    control_points, weights = jnp.ones((3, 2, 2)), jnp.array([[1.0, 2.0], [1.0, 2.0], [1.0, 3.0]])
    np.testing.assert_array_equal(repeated(control_points, weights), [False, True, False])


@pytest.mark.slow
def test_lower_bounds_are_proven_by_rational_subdivision():
    rng = np.random.default_rng(8)
    for weights in (None, 10 ** rng.uniform(-2, 2, size=(1, 4))):
        control_points = rng.normal(size=(1, 4, 2))
        rows = queries(control_points, weights, 8)[4:16]
        found = search(rows, control_points, weights)
        for row, lower, t in zip(rows, found.lower, found.t, strict=True):
            assert exact.is_below(lower, row, *segment_of(control_points, weights, 0), near=t)


def test_the_rational_proof_refuses_a_bound_that_is_a_little_too_large():
    control_points, row = special("smooth", np.random.default_rng(9)), np.array([[0.25, -2.0]])
    found = search(row, control_points, None)
    assert exact.is_below(float(found.lower[0]), row[0], control_points[0], near=found.t[0])
    assert not exact.is_below(float(found.upper[0]) + 1e-13, row[0], control_points[0], near=found.t[0])


@given(st.lists(st.integers(-3, 3), min_size=10, max_size=10))
def test_bounds_hold_on_a_lattice(integers):
    # A lattice is full of ties, double points, collinear and repeated control points.
    control_points, row = np.reshape(integers[:8], (1, 4, 2)) / 2.0, np.reshape(integers[8:], (1, 2)) / 2.0
    rows = np.tile(row, (COUNT, 1))
    found = jax.tree_util.tree_map(lambda x: x[:1], search(rows, control_points, None))
    holds(found, row, control_points, None)
    assert found.closed.all()
    assert abs(found.distance[0] - reference.project(row[0], control_points)[0]) <= REFERENCE


@pytest.mark.parametrize(("name", "value"), [("_CAPACITY", 1), ("_MAX_STEPS", 1)])
@pytest.mark.slow
def test_a_full_queue_and_a_step_limit_leave_true_bounds(monkeypatch, name, value):
    # Folded to and fro over a line: from beside it several stretches are almost equally near.
    folded = np.array([[(0, 0), (9, 0), (-30, 0.5), (60, 0), (-60, 0.25), (30, 0), (-9, 0), (0, 0.125)]])
    rows = np.stack([np.linspace(-1, 1, COUNT), np.full(COUNT, 3.0)], axis=1)
    assert search(rows, folded, None).closed.all()
    monkeypatch.setattr(module, name, value)
    # Compiled anew: a function that is jitted itself would not look at the new limit.
    fresh = getattr(nearest, "__wrapped__", nearest)
    found = jax.jit(jax.vmap(lambda p: fresh(p, jnp.array(folded), None)))(rows)
    holds(found, rows, folded, None)
    assert not found.closed.all()


@pytest.mark.slow
def test_a_tolerance_stops_early_with_true_bounds():
    control_points = special("smooth", np.random.default_rng(11))
    rows = queries(control_points, None, 11)
    found = jax.jit(jax.vmap(lambda p: nearest(p, control_points, None, 0.25)))(rows)
    holds(found, rows, control_points, None)
    assert found.closed.all() and (found.upper - found.lower <= 0.25).all()
    assert found.steps.sum() < search(rows, control_points, None).steps.sum()


def test_few_cuts_are_needed():
    rng = np.random.default_rng(12)
    control_points = rng.normal(size=(1, 4, 2))
    steps = search(rng.normal(size=(COUNT, 2)), control_points, None).steps
    # 1 to 6 for random queries: a larger number means that the cut at the local foot is lost.
    assert steps.max() <= 12 and steps.mean() <= 4
