"""Searches that compiled functions call on the host: the same answers as compiled in, in batches, beside other work."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from tests.processes import python

_ROWS = np.random.default_rng(3).normal(size=(9, 2, 4, 2))
_SPHERES = [jhd.ImplicitSurface.parse(text, [-2.0] * 3, [2.0] * 3) for text in ("x^2 + y^2 + z^2 - 1", "x^2 + z^2 - 2")]


def _pair(x):
    return jhd.BezierCurve(x[0]), jhd.BezierCurve(x[1])


def _answer(found):
    return found.value, found.lower, found.upper, found.witness.point


def _slope(x):
    """The gradient of the distance, and beside it the gradient with the answer."""

    def value(x):
        found = jhd.hausdorff(*_pair(x))
        return found.value, _answer(found)

    gradient, answer = jax.grad(value, has_aux=True)(x)
    return gradient, (gradient, answer)


# By name: of the control points of two cubics to numbers.
_ENTRIES = {
    "hausdorff": lambda x: _answer(jhd.hausdorff(*_pair(x))),
    "directed": lambda x: _answer(jhd.directed_hausdorff(*_pair(x))),
    "at most": lambda x: jhd.hausdorff_at_most(*_pair(x), 1.5).answer._value,
    "minimum": lambda x: jhd.minimum_distance(*_pair(x)).value,
    "project": lambda x: jhd.project(x[0], jhd.BezierCurve(x[1])).foot,
    "stationary": lambda x: jhd.stationary_points(x[0], jhd.BezierCurve(x[1])).distance[:, :2],
    "gradient": _slope,
    "Hessian": jax.jacfwd(_slope, has_aux=True),
    "motion": jax.jacfwd(lambda x: jhd.hausdorff(*_pair(x)).witness.feet),
    "gradient of distances": jax.value_and_grad(lambda x: jnp.sum(jhd.project(x[0], jhd.BezierCurve(x[1])).distance)),
    "gradient of minimum": jax.value_and_grad(lambda x: jhd.minimum_distance(*_pair(x)).value),
}


@pytest.mark.parametrize("entry", [pytest.param("at most", marks=pytest.mark.slow), "minimum", "gradient"])
def test_a_batch_has_the_answers_of_single_calls(entry):
    function = jax.jit(_ENTRIES[entry])
    batch = jax.jit(jax.vmap(_ENTRIES[entry]))(_ROWS)
    for k, row in enumerate(_ROWS):
        jax.tree_util.tree_map(lambda x, y, k=k: np.testing.assert_array_equal(x[k], y), batch, function(row))


def test_only_one_curve_of_a_pair_is_batched_and_batches_are_nested():
    distances = jax.jit(jax.vmap(jax.vmap(lambda x, y: jhd.hausdorff(*_pair([x, y])).value, (0, None)), (None, 0)))
    found = distances(_ROWS[:3, 0], _ROWS[:2, 1])
    each = [[float(jhd.hausdorff(*_pair([x, y])).value) for x in _ROWS[:3, 0]] for y in _ROWS[:2, 1]]
    np.testing.assert_allclose(found, each, rtol=1e-13)


def test_a_scan_calls_the_host_at_each_step():
    value = lambda x: jhd.hausdorff(*_pair(x)).value  # noqa: E731
    last, values = jax.jit(lambda x: jax.lax.scan(lambda x, _: (x - 0.1 * jax.grad(value)(x), value(x)), x, None, 4))(
        _ROWS[0]
    )
    assert values[3] < values[0] and np.all(np.isfinite(last))


def test_the_search_is_in_the_program_only_where_that_is_asked_for():
    function = lambda x: jhd.minimum_distance(*_pair(x)).value  # noqa: E731
    assert "buffer_callback" in str(jax.make_jaxpr(function)(_ROWS[0]))
    with jhd.inline_searches():
        assert "callback" not in str(jax.make_jaxpr(function)(_ROWS[0]))
        with jhd.inline_searches(False):
            assert "buffer_callback" in str(jax.make_jaxpr(function)(_ROWS[0]))


def test_numbers_that_are_not_finite_are_told_in_a_batch():
    rows = jnp.asarray(_ROWS[:3]).at[1, 0, 0, 0].set(jnp.nan)
    found = jax.jit(jax.vmap(lambda x: jhd.project(x[0], jhd.BezierCurve(x[1]))))(rows)
    ends = np.asarray(found.result == jhd.RESULTS.nonfinite_value)
    assert ends.sum() == 1 and ends[1, 0] and np.isinf(found.upper[1, 0]) and found.lower[1, 0] == 0
    curves = jax.jit(jax.vmap(lambda x: jhd.project(x[0], jhd.BezierCurve(x[1]))))(rows[:, ::-1])
    assert np.array_equal(np.all(np.isinf(curves.upper), axis=1), [False, True, False])


def test_shapes_that_are_closed_over_are_searched_on_the_host_too():
    for entry in ("hausdorff", "directed", "minimum", "project", "stationary"):
        inside = jax.jit(lambda x, entry=entry: (x, _ENTRIES[entry](_ROWS[0])))(2.0)[1]
        jax.tree_util.tree_map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9), inside, _ENTRIES[entry](_ROWS[0])
        )


def test_constants_of_numpy_are_batched_inside_a_function():
    project = lambda x: jax.vmap(lambda y: jhd.project(x, jhd.BezierCurve(y)).distance)(_ROWS[:, 0])  # noqa: E731
    found, gradient = jax.jit(lambda x: (project(x), jax.grad(lambda x: jnp.sum(project(x)))(x)))(_ROWS[0, 1, 0])
    each = [float(jhd.project(_ROWS[0, 1, 0], jhd.BezierCurve(y)).distance) for y in _ROWS[:, 0]]
    np.testing.assert_allclose(found, each, rtol=1e-13)
    assert np.all(np.isfinite(gradient))


def test_queries_far_away_leave_the_others_of_a_batch_as_they_are():
    curve, queries = jhd.BezierCurve(_ROWS[0, 0]), np.array([(1e200, 0.0), (0.3, 0.4), (5.0, 1.0)])
    found = jax.jit(jax.vmap(lambda x: jhd.project(x, curve)))(queries)
    assert [float(x) for x in found.distance[1:]] == [float(jhd.project(x, curve).distance) for x in queries[1:]]
    assert np.all(found.result == jhd.RESULTS.successful)


def test_stationary_points_have_the_derivatives_of_differences():
    curve, x = jhd.BezierCurve(_ROWS[0, 0]), np.array([0.3, 0.2])

    def numbers(x):
        found = jhd.stationary_points(x, curve)
        return jnp.stack([found.distance[0], found.t[0]])

    slope = jax.jit(jax.jacfwd(numbers))
    for function, derivative in ((numbers, slope), (slope, jax.jit(jax.jacfwd(slope)))):
        steps = [(function(x + h) - function(x - h)) / 2e-5 for h in 1e-5 * np.eye(2)]
        np.testing.assert_allclose(derivative(x), np.stack(steps, axis=-1), rtol=1e-6, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("entry", ["Hessian", "motion", "stationary", "gradient of distances", "gradient of minimum"])
def test_the_host_and_the_program_give_the_same_answers(entry):
    here = jax.jit(lambda x: _ENTRIES[entry](x))(_ROWS[0])
    with jhd.inline_searches():
        inside = jax.jit(lambda x: _ENTRIES[entry](x))(_ROWS[0])
    jax.tree_util.tree_map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9), here, inside)


@pytest.mark.slow
def test_implicit_surfaces_are_searched_on_the_host_too():
    first, second = _SPHERES

    def distance(scale):
        return jhd.directed_hausdorff(jhd.ImplicitSurface(scale * first.coefficients, *first.bounds), second).value

    np.testing.assert_allclose(jax.jit(distance)(2.0), jhd.directed_hausdorff(first, second).value, rtol=1e-9)


@pytest.mark.slow
def test_a_function_whose_searches_are_in_the_program_can_be_exported():
    with jhd.inline_searches():
        exported = jax.export.export(jax.jit(_ENTRIES["minimum"]))(_ROWS[0])
    np.testing.assert_allclose(exported.call(_ROWS[0]), jax.jit(_ENTRIES["minimum"])(_ROWS[0]), atol=1e-12)


# Threads that call compiled functions with arrays made anew, some of them large or of new sizes, beside others that
# keep the threads of the device busy. By `jax.pure_callback` some of them stood still for more than a minute.
_BUSY = """
import sys, threading, time
import jax, jax.numpy as jnp, numpy as np
import jhd

random = np.random.default_rng(0)
queries, matrix = random.normal(size=(3000, 2)), random.normal(size=(600, 600))

def curves(count, segments, seed):
    points = np.cumsum(np.random.default_rng(seed).normal(size=(count, 3 * segments + 1, 2)), axis=1)
    return np.stack([points[:, 3 * i : 3 * i + 4] for i in range(segments)], axis=1)

of = lambda entry: lambda a, b: entry(jhd.BezierSegments(a), jhd.BezierSegments(b)).value
value = of(jhd.hausdorff)
batch, slopes, least = jax.jit(jax.vmap(value)), jax.jit(jax.vmap(jax.grad(value))), jax.jit(of(jhd.minimum_distance))
project = jax.jit(lambda a: jhd.project(queries, jhd.BezierSegments(a)).distance)
large = jax.jit(lambda x: jnp.sum(x @ x.T + jnp.linalg.svd(x, compute_uv=False)[0]))

@jax.jit
def descend(a, b, x):
    def step(a, _):
        found, slope = jax.value_and_grad(value)(a, b)
        return a - 1e-3 * slope, found + 1e-30 * jnp.sum(x @ x)
    return jax.lax.scan(step, a, None, length=5)

calls = [
    lambda k: batch(curves(16 + k % 100, 3, k), curves(16 + k % 100, 3, k + 1)),
    lambda k: slopes(curves(8, 30, 0), curves(8, 30, 1)),
    lambda k: batch(curves(64, 100, 2), curves(64, 100, 3)),
    lambda k: descend(*curves(2, 4, k), matrix),
    lambda k: project(curves(1, 12, 0)[0]),
    lambda k: least(*curves(2, 20, k)),
    lambda k: value(*curves(2, 5, k)),
    lambda k: large(matrix),
]
for call in calls:
    jax.block_until_ready(call(0))
end, counts = time.time() + float(sys.argv[1]), [0] * len(calls)

def work(k):
    while time.time() < end:
        jax.block_until_ready(calls[k](counts[k]))
        counts[k] += 1

threads = [threading.Thread(target=work, args=(k,), daemon=True) for k in range(len(calls))]
for thread in threads:
    thread.start()
while time.time() < end:
    before, _ = counts.copy(), time.sleep(min(30, max(end - time.time(), 0)))
    still = [k for k in range(len(counts)) if counts[k] == before[k]]
    if still and time.time() < end:
        sys.exit(f"no call of {still} ended in 30 s")
for thread in threads:
    thread.join(60)
sys.exit("a call did not end" if any(thread.is_alive() for thread in threads) else 0)
"""


@pytest.mark.exhaustive
def test_calls_of_the_host_end_while_all_threads_are_busy():
    python("-c", _BUSY, "600")
