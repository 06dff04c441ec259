"""The smooth upper bound: between the distance and its stated smoothing, at any scale; its gradient; what it costs."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.normalization.pieces import CurvePlace
from jhd._fitting import soft
from tests.distance.witness.test_critical import STILL
from tests.sweeps import swept

ROUNDING = 16 * np.finfo(float).eps
SMOOTHING = math.log(1 + soft.WEIGHT)
HEAT = 0.03


def random_rows(seed):
    return np.random.default_rng(seed).normal(size=(4, 4, 2))


def straight(offset):
    """Four cubics along a line, some way above it."""
    across = np.linspace(0, 1, 13)[3 * np.arange(4)[:, None] + np.arange(4)]
    return np.stack([across, np.full_like(across, offset)], axis=-1)


def bumped(height):
    """A line with one narrow bump, between two samples of any even number."""
    rows = straight(0.0)
    rows[1, 1:3] += [[0.0, height], [0.0, height]]
    return rows


PAIRS = {
    "random": (random_rows(0), random_rows(1)),
    "far apart": (random_rows(2), random_rows(3) + 1e6),
    "the same": (random_rows(4), random_rows(4)),
    "an offset": (straight(0.0), straight(1.0)),
    "a bump": (bumped(1.0), straight(0.0)),
    "a point": (np.zeros((4, 4, 2)) + [0.3, 0.7], straight(0.0)),
    "two points": (np.zeros((4, 4, 2)), np.ones((4, 4, 2))),
    "the other way": (straight(0.0), straight(0.0)[::-1, ::-1] + 1e-9),
}


@pytest.mark.parametrize("exponent", [0, 300, -300])
@pytest.mark.parametrize("name", PAIRS)
def test_it_lies_above_the_distance_by_at_most_its_smoothing(name, exponent):
    a, b = (jhd.BezierSegments(rows * 2.0**exponent) for rows in PAIRS[name])
    hard, last = jhd.hausdorff(a, b), math.inf
    assert hard.upper > 0 or name == "the same"
    for share in (10.0, 0.3, 1e-2, 1e-13, 1e-40):
        temperature = share * 2.0**exponent
        found = float(jhd.soft_hausdorff(a, b, temperature))
        assert hard.upper <= found <= last
        assert found <= (float(hard.upper) + temperature * SMOOTHING) * (1 + ROUNDING)
        last = found


def test_at_one_distance_everywhere_it_is_as_far_above_as_it_can_be():
    a, b = (jhd.BezierSegments(rows) for rows in PAIRS["an offset"])
    assert float(jhd.soft_hausdorff(a, b, 0.1)) == pytest.approx(1 + 0.1 * SMOOTHING, rel=1e-9)


@pytest.mark.slow
def test_a_sample_whose_foot_is_too_far_counts_as_much_as_the_farthest_place():
    # Newton's method can end at a foot that is not the nearest one, farther than the distance of the curves.
    a, b = (jhd.BezierSegments(rows) for rows in PAIRS["an offset"])
    mean = soft._mean(soft.sampled(a), b, False, jnp.array(0.5), jnp.array(0.1))
    assert float(mean) == pytest.approx(1, rel=ROUNDING * soft.SAMPLES)


@pytest.mark.slow
def test_hardly_a_foot_of_a_sample_is_not_the_nearest_one():
    far = []
    for seed in range(6):
        a, b = (jhd.BezierSegments(random_rows(2 * seed + k) / 4) for k in range(2))
        samples = soft.sampled(a)
        found = np.asarray(jax.jit(soft._distances, static_argnums=2)(samples, b, False))
        far.append(found - np.asarray(jhd.project(samples.points, b).upper))
    assert np.min(far) >= -ROUNDING and np.mean(np.array(far) > 1e-8) < 0.02


@pytest.mark.slow
def test_one_search_and_a_thousand_samples_are_what_it_costs(monkeypatch):
    calls = []

    def counted(a, b, method, **options):
        calls.append((a, b, method))
        return jhd.hausdorff(a, b, method, **options)

    monkeypatch.setattr(soft, "hausdorff", counted)
    a, b = (jhd.BezierSegments(rows) for rows in PAIRS["random"])
    jhd.soft_hausdorff(a, b, 0.1)
    assert len(calls) == 1

    def samples(count):
        curve = jax.eval_shape(lambda x: jhd.BezierSegments(x), jax.ShapeDtypeStruct((count, 4, 2), float))
        return jax.eval_shape(soft.sampled, curve).weight.size

    assert [samples(count) for count in (1, 4, 48, 512, 10_000)] == [256, 1024, 1056, 1024, 10_000]


def test_what_is_no_temperature_or_serves_no_curves_is_refused():
    a, b = (jhd.BezierSegments(rows) for rows in PAIRS["random"])
    for temperature in (0.0, -1.0):
        with pytest.raises(ValueError, match="temperature is .*; needs a positive number"):
            jhd.soft_hausdorff(a, b, temperature)
    with pytest.raises(TypeError, match=r"method must be BranchAndBound\(\)"):
        jhd.soft_hausdorff(a, b, 0.1, jhd.published.TwoStep())
    with pytest.raises(TypeError, match="b must be a curve"):
        jhd.soft_hausdorff(a, jhd.ImplicitSurface.parse("x + y + z", [-1, -1, -1], [1, 1, 1]), 0.1)
    with pytest.raises(jhd.NotProvenError):
        jhd.soft_hausdorff(a, b, HEAT, jhd.BranchAndBound(max_steps=1))
    wide = jhd.soft_hausdorff(a, b, HEAT, jhd.BranchAndBound(max_steps=1), throw=False)
    assert wide > jhd.soft_hausdorff(a, b, HEAT) and jhd.soft_hausdorff(a, b, HEAT, atol=0.5) <= wide


def close_pair(seed):
    """A random curve and one near it, whose parameters are its control points."""
    rows = random_rows(seed)
    noise = np.random.default_rng(seed + 50).normal(size=rows.shape)
    return jhd.BezierSegments(rows), jnp.asarray(rows + 0.05 * noise)


@pytest.mark.parametrize("seed", swept([11, 12], 0, 1))
def test_its_gradient_is_dense_and_that_of_differences(seed):
    target, rows = close_pair(seed)

    def loss(rows, temperature):
        return jhd.soft_hausdorff(target, jhd.BezierSegments(rows), temperature)

    for temperature in (0.2, 0.02):
        slope, by_heat = jax.grad(loss, (0, 1))(rows, temperature)
        assert np.all(np.any(np.asarray(slope) != 0, axis=-1))
        for index in ((0, 1, 0), (2, 2, 1), (3, 3, 0)):
            # Short: where a foot of one sample jumps the bound has a kink.
            step = 1e-6
            ahead, behind = (loss(rows.at[index].add(x), temperature) for x in (step, -step))
            assert float(slope[index]) == pytest.approx(float(ahead - behind) / (2 * step), rel=1e-6, abs=1e-8)
        ahead, behind = (loss(rows, temperature * (1 + x)) for x in (1e-5, -1e-5))
        assert float(by_heat) == pytest.approx(float(ahead - behind) / (2e-5 * temperature), rel=1e-6)


@pytest.mark.exhaustive
def test_a_batch_in_one_program_is_what_each_is_alone():
    targets, starts = zip(*(close_pair(seed) for seed in (20, 21, 22)), strict=True)
    batch, rows = jhd.stack_curves(targets), jnp.stack(starts)

    def loss(target, rows):
        return jhd.soft_hausdorff(target, jhd.BezierSegments(rows), 0.1)

    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(loss, 1)))(batch, rows)
    for k, target in enumerate(targets):
        value, slope = jax.value_and_grad(loss, 1)(target, rows[k])
        assert float(values[k]) == pytest.approx(float(value), rel=1e-10)
        np.testing.assert_allclose(slopes[k], slope, rtol=0, atol=1e-6)


def ring(count):
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


# Points and weights; space; weights on both sides; and many segments.
OTHERS = [
    lambda rng: (jhd.point_set(rng.normal(size=(30, 2))), jhd.circle((0, 0), 1)),
    lambda rng: (jhd.BezierCurve(rng.normal(size=(4, 3))), jhd.BezierCurve(rng.normal(size=(5, 3)))),
    lambda rng: (jhd.circle((0, 0), 1), jhd.circle((0.1, 0), 1.2)),
    lambda rng: (
        jhd.polyline(ring(400) * rng.normal(1, 1e-2, size=(400, 1)), True),
        jhd.BSplineCurve.uniform(ring(20), periodic=True),
    ),
]


@pytest.mark.parametrize("pair", swept(OTHERS, 0, 1))
def test_curves_with_weights_in_space_and_of_points_are_softened_too(pair):
    a, b = pair(np.random.default_rng(5))
    hard, found = jhd.hausdorff(a, b), float(jhd.soft_hausdorff(a, b, 0.05))
    assert hard.upper <= found <= (float(hard.upper) + 0.05 * SMOOTHING) * (1 + ROUNDING)
    assert found > float(hard.upper) + 1e-6


def test_feet_that_still_move_are_followed_on_however_many_there_are():
    slow = np.arange(1000) % 3 == 0

    def foot(point, start, steps):
        """Halves what is left to the end with each step, or is there."""
        return CurvePlace(start.segment, jnp.where(point > 0, 1 - (1 - start.t) * 0.5**steps, start.t))

    start = CurvePlace(jnp.zeros(1000, int), jnp.zeros(1000))
    found = np.asarray(soft._followed(foot, jnp.asarray(slow, float), start).t)
    assert np.all(found[slow] >= 1 - 0.5 ** (soft._FOLLOW + soft._FURTHER)) and np.all(found[~slow] == 0)


@pytest.mark.parametrize("count", swept([1, 40], slow=[1]))
def test_on_curves_that_stand_still_it_lies_above_the_distance_and_its_gradient_is_that_of_differences(count):
    soft_with_gradient = jax.jit(
        jax.value_and_grad(lambda a, b: jhd.soft_hausdorff(jhd.BezierSegments(a), jhd.BezierSegments(b), HEAT), (0, 1))
    )
    for kinds in STILL:
        rng = np.random.default_rng(8)
        for _ in range(count):
            rows = [kind(rng)[None] for kind in kinds]
            ways = [rng.normal(size=x.shape) for x in rows]
            value, gradient = soft_with_gradient(*rows)
            a, b = (jhd.BezierSegments(x) for x in rows)
            hard = jhd.hausdorff(a, b).upper
            assert hard * (1 - 1e-9) <= value <= hard + HEAT * SMOOTHING + 1e-9
            slope = sum(float(np.sum(x * y)) for x, y in zip(gradient, ways, strict=True))
            # Beside a tie of two feet or maxima it is one of the one-sided slopes, or between them.
            ahead, behind = (
                float(soft_with_gradient(*(x + step * y for x, y in zip(rows, ways, strict=True)))[0] - value) / step
                for step in (1e-6, -1e-6)
            )
            assert min(ahead, behind) - 1e-4 <= slope <= max(ahead, behind) + 1e-4, rows
