"""Maxima near the top found with trees are those that all of them are, and lead fits of many segments to their end."""

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._fitting.chain import Layout, chain
from jhd._fitting.minimax import minimize
from jhd._fitting.near_top import pairs_near_top
from jhd._fitting.problem import Problem
from jhd._fitting.sampled import SampledCurve
from jhd._runtime.clock import Clock

# Vertices of a noisy outline and its noise; segments of its fit.
VERTICES, NOISE, SEGMENTS = 150, 0.01, 8


def sampled(curve):
    segments = curve.segments()
    rational = segments.weights is not None
    return SampledCurve(np.asarray(segments.homogeneous), np.asarray(segments.next_segment), rational, 0.01)


def noisy(count=VERTICES):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = 1 + 0.25 * np.cos(3 * angle)
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points + NOISE * np.random.default_rng(0).normal(size=points.shape)


@pytest.mark.slow
def test_the_maxima_near_the_top_are_the_largest_of_all_critical_pairs():
    a = jhd.circle([3, 1], 2.0)
    b = a.transform(jnp.array([[1.3, 0.2], [0.0, 0.8]]), jnp.array([-0.4, 0.3]))
    found, everything = pairs_near_top(sampled(a), sampled(b), 0.3, 32, Clock()), jhd.critical_pairs(a, b, 32)
    wanted = np.asarray(everything.value)[np.asarray(everything.valid & (everything.value > 0.3 * everything.value[0]))]
    values = np.asarray(found.value)[np.asarray(found.valid)]
    np.testing.assert_allclose(values, wanted, rtol=1e-12)
    for name in ("point", "feet", "multipliers"):
        got, right = (np.asarray(getattr(pairs.witness, name))[: len(wanted)] for pairs in (found, everything))
        np.testing.assert_allclose(got, right, atol=1e-7)


@pytest.mark.parametrize("a", [[(0, 1), (0, 1), (0.5, 0.2), (1, 0)], [(0, 1), (1, 1)]], ids=["doubled", "parallel"])
def test_the_largest_maximum_is_found_at_a_start_without_a_slope(a):
    curves = sampled(jhd.BezierCurve(a)), sampled(jhd.polyline([(0, 0), (1, 0)]))
    for p, q in (curves, curves[::-1]):
        pairs = pairs_near_top(p, q, 0.3, 32, Clock())
        assert pairs.valid[0] and abs(pairs.value[0] - 1) <= 1e-15


def test_feet_from_a_tree_are_those_of_all_places():
    curve, points = jhd.polyline(noisy(), closed=True), np.random.default_rng(1).normal(size=(200, 2))
    starts = np.asarray(curve.control_points)
    along = starts[:, 1] - starts[:, 0]
    t = np.clip(np.einsum("kld,ld->kl", points[:, None] - starts[:, 0], along) / np.sum(along**2, axis=1), 0, 1)
    apart = points[:, None] - starts[:, 0] - t[..., None] * along
    exact = np.sqrt(np.min(np.sum(apart**2, axis=-1), axis=1))
    np.testing.assert_allclose(sampled(curve).feet(points).distance, exact, rtol=1e-13)


@pytest.mark.exhaustive
def test_a_noisy_outline_is_fitted_by_the_maxima_near_the_top():
    points = noisy()
    built = chain(Layout(3, SEGMENTS, True, False, False), points[[0, -1]], np.ones(SEGMENTS))
    build = lambda p: built(p.reshape(-1, 2))  # noqa: E731
    # Thirds of the pieces of the outline without noise.
    angle = np.linspace(0, 2 * np.pi, 3 * SEGMENTS, endpoint=False)
    start = (1 + 0.25 * np.cos(3 * angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    problem = Problem(build, jhd.polyline(points, closed=True), 64)
    ended = minimize(problem, start.ravel(), 12, 0.0, lambda *news: None)
    assert ended.point.many and np.all(np.diff(ended.history) < 0)
    assert ended.point.top < 0.4 * ended.history[0]
    # Several maxima carry the end.
    values = ended.point.expansion.value
    assert np.sum(values > 0.99 * ended.point.top) >= 5


@pytest.mark.slow
def test_a_fit_of_few_segments_goes_on_where_its_maxima_are_between_samples():
    # The tips of two folded lines: samples see none of what is left after seven steps, 6e-6.
    target = jhd.BezierCurve([(-0.528, 0), (0.874, 0), (-1.039, 0), (-0.165, 0)])
    fit = jhd.fit_curve(target, degree=2, segments=1, max_steps=12)
    assert fit.error.lower * (1 - 1e-9) <= fit.pairs.value[0] <= 1e-7


@pytest.mark.parametrize("dim", [2, 3])
def test_the_maxima_of_many_points_and_a_curve_are_found(dim):
    # A quarter of a circle about the middle of the points, in the plane of the first two coordinates.
    points = np.random.default_rng(2).normal(size=(1200, dim))
    arc = jhd.circle([0, 0], 1.0)
    quarter = np.pad(np.asarray(arc.control_points)[:1], [(0, 0), (0, 0), (0, dim - 2)])

    def build(radius):
        return jhd.BezierSegments(radius[0] * quarter, np.asarray(arc.weights)[:1])

    at = Problem(build, jhd.point_set(points), 32).at(np.array([1.5]))
    assert at.many
    inside = np.all(points[:, :2] > 0, axis=1)
    off = np.where(inside, np.abs(np.hypot(points[:, 0], points[:, 1]) - 1.5), np.inf)
    ends = [np.hypot(points[:, 0] - x, points[:, 1] - y) for x, y in ((1.5, 0), (0, 1.5))]
    flat = np.minimum(off, np.minimum(*ends))
    distance = np.sqrt(flat**2 + np.sum(points[:, 2:] ** 2, axis=1))
    values = np.asarray(at.pairs.value)[: np.sum(np.asarray(at.pairs.valid))]
    exact = np.sort(distance)[::-1][: len(values)]
    np.testing.assert_allclose(values, exact, rtol=1e-12)


@pytest.mark.exhaustive
def test_a_noisy_outline_of_many_vertices_is_fitted_soon_and_its_corners_are_noise():
    target = jhd.polyline(noisy(400), closed=True)
    fit = jhd.fit_curve(target, degree=3, segments=SEGMENTS, max_steps=12)
    assert float(fit.error.upper) < 0.75 * float(fit.history[0])
    assert float(fit.error.lower) <= float(fit.history[-1]) * (1 + 1e-9)
