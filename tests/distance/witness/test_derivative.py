"""Derivatives of values, witnesses and projections against central differences, away from ties and at them."""

import itertools
import os
from collections import Counter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.witness import derivative
from jhd._results.solution import name_of
from tests.processes import python
from tests.sweeps import swept

# Step of the differences, and what is allowed of their error: h^2 times third derivatives, and 1e-15 / h of rounding.
STEP, FIRST = 1e-5, 1e-6
# Differences of gradients.
SECOND = 1e-4


def curve(kind, rng, spread=1.0):
    """A random curve of a kind."""
    dim = 3 if kind == "space" else 2
    if kind in ("closed", "nurbs"):
        angle = 2 * np.pi * np.arange(7) / 7
        rows = spread * np.stack([np.cos(angle), np.sin(angle)], axis=1) + 0.2 * rng.normal(size=(7, 2))
        weights = np.exp(0.3 * rng.normal(size=7)) if kind == "nurbs" else None
        return jhd.BSplineCurve.uniform(rows, periodic=True, weights=weights)
    if kind == "spline":
        knots = np.concatenate([np.zeros(4), np.sort(rng.uniform(0.1, 0.9, 3)), np.ones(4)])
        return jhd.BSplineCurve(spread * rng.normal(size=(7, 2)), knots)
    if kind == "polyline":  # as a spline, whose segments share their ends
        return jhd.BSplineCurve.clamped(spread * rng.normal(size=(4, 2)), degree=1)
    weights = np.exp(0.5 * rng.normal(size=4)) if kind == "rational" else None
    return jhd.BezierCurve(spread * rng.normal(size=(4, dim)), weights)


def moved(shape, direction, h):
    return jax.tree_util.tree_map(
        lambda x, v: x if v is None else x + h * v, shape, direction, is_leaf=lambda x: x is None
    )


def a_direction(shapes, rng):
    """A random direction in all arrays of numbers, small in knots, whose order must stay."""
    draw = lambda x: jnp.asarray(0.02 * rng.normal(size=x.shape)) if eqx.is_inexact_array(x) else None  # noqa: E731
    return jax.tree_util.tree_map(draw, shapes)


def rule_and_difference(entry, shapes, rng):
    """The derivative along a random direction by the rule and by differences; None where the event changes."""
    direction = a_direction(shapes, rng)
    here, *near = (entry(*moved(shapes, direction, h)) for h in (0.0, STEP, -STEP))
    if any(name_of(s.event) != name_of(here.event) or name_of(s.direction) != name_of(here.direction) for s in near):
        return None
    if any(float(jnp.max(jnp.abs(s.witness.point - here.witness.point))) > 0.01 for s in near):
        return None
    gradient = eqx.filter_grad(lambda shapes: entry(*shapes).value)(shapes)
    parts = zip(jax.tree_util.tree_leaves(gradient), jax.tree_util.tree_leaves(direction), strict=True)
    rule = sum(float(jnp.sum(g * v)) for g, v in parts)
    return here, rule, (float(near[0].value) - float(near[1].value)) / (2 * STEP)


KINDS = (("bezier", "bezier"),)
MORE = (
    ("rational", "bezier"),
    ("polyline", "bezier"),
    ("closed", "closed"),
    ("spline", "bezier"),
    ("nurbs", "closed"),
    ("bezier", "polyline"),
    ("rational", "rational"),
    ("space", "space"),
)


def check(kinds, seeds, entry):
    """Compares over several seeds and counts the events met."""
    events = Counter()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        shapes = curve(kinds[0], rng), curve(kinds[1], rng, 1.3)
        found = rule_and_difference(entry, shapes, rng)
        if found is None:
            continue
        here, rule, difference = found
        events[name_of(here.event)] += 1
        assert rule == pytest.approx(difference, rel=FIRST, abs=FIRST * 0.02)
        np.testing.assert_allclose(np.sum(here.witness.multipliers), 1.0, rtol=1e-12)
        if name_of(here.event) == "one_to_two":
            assert np.all(np.asarray(here.witness.multipliers) > 0)
    return events


@pytest.mark.parametrize("kinds", KINDS, ids="-".join)
def test_the_gradient_agrees_with_differences(kinds):
    assert check(kinds, range(2), jhd.directed_hausdorff).total() == 2


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(jhd.directed_hausdorff, marks=pytest.mark.exhaustive, id="directed"),
        pytest.param(jhd.hausdorff, marks=pytest.mark.exhaustive, id="two_sided"),
    ],
)
def test_the_gradient_agrees_for_every_event_and_kind_of_shape(entry):
    events = Counter()
    for kinds in (*KINDS, *MORE):
        events += check(kinds, range(100, 108), entry)
    assert events.total() >= 60
    assert set(events) >= {"a_end", "b_end", "antipodal", "one_to_two", "corner"}


ROWS = [[0.0, 0.0], [1.0, 2.0], [3.0, -1.0], [4.0, 0.0]]
PARABOLA = jnp.array([[-2.0, 4.0], [0.0, -4.0], [2.0, 4.0]])


def over_the_parabola(shift, heights=(2.0, 2.3)):
    """A segment across the axis of a parabola, moved sideways: two feet, so single branches have the wrong slope."""
    segment = jnp.array([[-0.5, heights[0]], [0.5, heights[1]]]) + shift * jnp.array([1.0, 0.0])
    return jhd.directed_hausdorff(jhd.BezierCurve(segment), jhd.BezierCurve(PARABOLA))


def test_two_feet_share_the_derivative_by_their_multipliers():
    solution = over_the_parabola(0.1)
    assert name_of(solution.event) == "one_to_two"
    rule = jax.grad(lambda shift: over_the_parabola(shift).value)(0.1)
    difference = (float(over_the_parabola(0.1 + STEP)) - float(over_the_parabola(0.1 - STEP))) / (2 * STEP)
    assert float(rule) == pytest.approx(difference, rel=FIRST)
    w = solution.witness
    units = (w.point - w.feet) / jnp.linalg.norm(w.point - w.feet, axis=1, keepdims=True)
    assert float(rule) == pytest.approx(float(w.multipliers @ units[:, 0]), rel=1e-9)
    # Each foot alone pulls the distance harder, and one of them the other way.
    assert min(float(units[0, 0]), float(units[1, 0])) < 0 < max(float(units[0, 0]), float(units[1, 0]))


def test_the_witness_moves_as_differences_say():
    # Below the parabola an end has one foot, which is given twice.
    for heights, event in (((2.0, 2.3), "one_to_two"), ((-0.5, -1.0), "a_end")):

        def parts(shift, heights=heights):
            w = over_the_parabola(shift, heights).witness
            return jnp.concatenate([w.t[None], w.point, w.feet.ravel(), w.feet_params])

        assert name_of(over_the_parabola(0.1, heights).event) == event
        rule = jax.jacfwd(parts)(0.1)
        np.testing.assert_allclose(rule, (parts(0.1 + STEP) - parts(0.1 - STEP)) / (2 * STEP), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("seed", swept([3, 21], slow=[21]))
def test_the_hessian_agrees_with_differences_of_the_gradient(seed):
    rng = np.random.default_rng(seed)
    rows = jnp.asarray(np.stack([0.3 * rng.normal(size=(4, 2)), rng.normal(size=(4, 2))]))
    direction = jnp.asarray(rng.normal(size=rows.shape))
    product = _product(rows, direction)
    h = STEP
    difference = (_gradient(rows + h * direction) - _gradient(rows - h * direction)) / (2 * h)
    np.testing.assert_allclose(product, difference, rtol=SECOND, atol=SECOND * float(jnp.max(jnp.abs(difference))))
    # Of a function of the distance the products of first derivatives count, too.
    slope, value = _gradient(rows), _value(rows)
    _, square = jax.jvp(jax.grad(lambda rows: _value(rows) ** 2), (rows,), (direction,))
    np.testing.assert_allclose(square, 2 * (slope * jnp.vdot(slope, direction) + value * product), rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_reverse_mode_can_be_taken_twice():
    rng = np.random.default_rng(21)
    rows = jnp.asarray(np.stack([0.3 * rng.normal(size=(4, 2)), rng.normal(size=(4, 2))]))
    direction = jnp.asarray(rng.normal(size=rows.shape))
    twice = jax.grad(lambda x: jnp.vdot(_gradient(x), direction))(rows)
    np.testing.assert_allclose(twice, _product(rows, direction), rtol=1e-9, atol=1e-12)


def _value(rows):
    return jhd.directed_hausdorff(jhd.BezierCurve(rows[0]), jhd.BezierCurve(rows[1])).value


_gradient = jax.grad(_value)


def _product(rows, direction):
    return jax.jvp(_gradient, (rows,), (direction,))[1]


@pytest.mark.slow
def test_forward_and_reverse_mode_agree_and_batches_equal_single_calls():
    rows = jnp.asarray(np.random.default_rng(5).normal(size=(4, 2, 4, 2)))
    batched = jax.jit(jax.vmap(jax.grad(_value)))(rows)
    single = jnp.stack([_gradient(pair) for pair in rows])
    np.testing.assert_allclose(batched, single, rtol=1e-12, atol=1e-14)
    forward = jax.jacfwd(_value)(rows[0])
    np.testing.assert_allclose(forward, single[0], rtol=1e-12, atol=1e-14)


@pytest.mark.slow
def test_gradients_of_curves_of_any_length_share_the_program_of_the_slopes(monkeypatch):
    traced, pieces = [], derivative._pieces
    monkeypatch.setattr(
        derivative, "_pieces", lambda rows, *rest: traced.append(rows[0].carrier.points.shape) or pieces(rows, *rest)
    )

    def gradient(count):
        rows = np.random.default_rng(count).normal(size=(count, 4, 2))
        return jax.grad(lambda x: jhd.hausdorff(jhd.BezierSegments(x), jhd.BezierCurve(ROWS)).value)(jnp.asarray(rows))

    assert np.any(np.asarray(gradient(2)))
    traced.clear()
    assert np.any(np.asarray(gradient(5)))
    assert not traced


@pytest.mark.slow
def test_at_distance_zero_the_gradient_is_zero():
    rows = jnp.array([[0.0, 0.0], [1.0, 2.0], [3.0, -1.0], [4.0, 0.0]])
    gradient = jax.grad(lambda x: jhd.hausdorff(jhd.BezierCurve(x), jhd.BezierCurve(rows)).value)(rows)
    assert not np.any(np.asarray(gradient))
    second = jax.jvp(
        jax.grad(lambda x: jhd.hausdorff(jhd.BezierCurve(x), jhd.BezierCurve(rows)).value), (rows,), (rows,)
    )
    assert not np.any(np.asarray(second[1]))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (jhd.circle((0, 0), 1.0), jhd.circle((0, 0), 2.0)),
        pytest.param(
            jhd.point_set([[0.0, 0.0], [1.0, 1.0]]), jhd.point_set([[0.0, 1.0], [3.0, 0.0]]), marks=pytest.mark.slow
        ),
        pytest.param(*(jhd.polyline([[0.0, y], [1.0, y]]) for y in (0.0, 1.0)), marks=pytest.mark.slow),
        pytest.param(jhd.circle((0, 0), 1e-6), jhd.circle((0, 0), 1.0), marks=pytest.mark.slow),
        (jhd.BezierCurve([(0, 0), (1, 1), (0, 1), (1, 0)]), jhd.BezierCurve([(0, 0), (0, 0), (0, 0), (1, 0)])),
    ],
    ids=["concentric", "points", "parallel", "about_the_center", "cusp"],
)
@pytest.mark.slow
def test_degenerate_pairs_have_finite_derivatives(a, b):
    gradient = eqx.filter_grad(lambda ab: jhd.hausdorff(*ab).value)((a, b))
    for leaf in jax.tree_util.tree_leaves(gradient):
        assert np.all(np.isfinite(leaf))


@pytest.mark.slow
def test_the_radius_of_a_concentric_circle_has_slope_one():
    outer = lambda r: jhd.hausdorff(jhd.circle((0, 0), 1.0), jhd.circle((0, 0), r)).value  # noqa: E731
    assert float(jax.grad(outer)(2.0)) == pytest.approx(1.0, rel=1e-12)
    assert float(jax.grad(outer)(0.5)) == pytest.approx(-1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("dim", "rational"), swept(itertools.product([2, 3], [False, True]), slow=[(2, True), (3, False)])
)
def test_projections_are_differentiable_in_points_and_curve(dim, rational):
    rng = np.random.default_rng(dim)
    rows, queries = rng.normal(size=(4, dim)), 1.5 * rng.normal(size=(5, dim))
    weights = np.exp(rng.normal(size=4)) if rational else None

    def answer(queries, rows):
        found = jhd.project(queries, jhd.BezierCurve(rows, weights))
        return jnp.concatenate([found.distance, found.t, found.foot.ravel()])

    step = rng.normal(size=queries.shape), rng.normal(size=rows.shape)
    _, rule = jax.jvp(answer, (queries, rows), step)
    # Feet run fast where weights differ, so third derivatives are large.
    h = 0.1 * STEP
    ahead, behind = (answer(queries + x * step[0], rows + x * step[1]) for x in (h, -h))
    np.testing.assert_allclose(rule, (ahead - behind) / (2 * h), rtol=FIRST, atol=FIRST)


@pytest.mark.slow
def test_second_derivatives_of_the_nearest_point_of_a_circle_are_those_of_the_direction():
    quarter = jhd.BezierCurve([(1, 0), (1, 1), (0, 1)], [1.0, np.sqrt(0.5), 1.0])
    point, way = jnp.array([1.5, 0.75]), jnp.array([0.5, -1.0])

    def second(function):
        return jax.jvp(lambda x: jax.jvp(function, (x,), (way,))[1], (point,), (way,))[1]

    rule, expected = second(lambda x: jhd.project(x, quarter).foot), second(lambda x: x / jnp.linalg.norm(x))
    np.testing.assert_allclose(rule, expected, rtol=0, atol=1e-12)


def test_a_point_on_the_curve_has_gradient_zero():
    line = jhd.BezierCurve([(0, 0), (1, 0), (2, 0)])
    assert not np.any(jax.grad(lambda p: jhd.project(p, line).distance)(jnp.array([1.0, 0.0])))


DEVICES = """
import jax, jax.numpy as jnp, numpy as np
from jax.sharding import PartitionSpec
import jhd

missed = []
jax.monitoring.register_event_listener(lambda event, **_: missed.append(event) if event.endswith("misses") else None)
both = jax.vmap(jax.value_and_grad(lambda x: jhd.hausdorff(jhd.BezierCurve(x[0]), jhd.BezierCurve(x[1])).value))
rows = jnp.asarray(np.random.default_rng(6).normal(size=(4, 2, 4, 2)))
mesh = jax.sharding.Mesh(jax.devices(), ("pairs",))
place = PartitionSpec("pairs")
shared = jax.jit(jax.shard_map(both, mesh=mesh, in_specs=place, out_specs=place))
def check():
    for found, known in zip(shared(rows), jax.jit(both)(rows)):
        np.testing.assert_allclose(found, known, rtol=1e-12, atol=1e-14)

assert len(jax.devices()) == 2
check()
missed.clear()
with jhd.inline_searches():
    check()
print(len(missed))
"""


@pytest.mark.exhaustive
def test_two_devices_share_a_batch_and_programs_come_from_the_persistent_cache(tmp_path):
    env = os.environ | {
        "JAX_COMPILATION_CACHE_DIR": str(tmp_path),
        "JAX_PLATFORMS": "cpu",
        "XLA_FLAGS": "--xla_force_host_platform_device_count=2",
    }
    counts = [int(python("-c", DEVICES, env=env).stdout) for _ in range(2)]
    assert counts[0] > 0 == counts[1]
