"""Long curves in blocks: the same bounds as all segments at once give, whatever the order of the segments."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.nearest.blocks import blocks_of, guesses, in_groups, nearest_in_blocks
from jhd._distance.nearest.curves import nearest
from jhd._distance.nearest.near_curve import near_curve
from tests.sweeps import swept

COUNT, QUERIES = 768, 200


def _segments(kind, rng):
    """Control points (768, 4, 2) of size below one, and queries."""
    queries = rng.uniform(-0.5, 0.5, size=(QUERIES, 2))
    small = 0.02 * rng.normal(size=(COUNT, 4, 2)) + rng.uniform(-0.5, 0.5, size=(COUNT, 1, 2))
    if kind == "repeated":
        small[100:200] = small[99]
    if kind == "overlapping":
        small = np.clip(0.2 * rng.normal(size=(COUNT, 4, 2)), -1, 1)
    if kind == "points":
        small = np.repeat(small[:, :1], 4, axis=1)
        queries[:50] = small[:50, 0]
    if kind == "around":
        angles = np.linspace(0, 2 * np.pi, COUNT + 1)
        ring = 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        small = ring[:-1, None] + np.linspace(0, 1, 4)[:, None] * (ring[1:] - ring[:-1])[:, None]
        queries *= 1e-3
    return small, queries


@jax.jit
def _both(points, queries):
    curve = jhd.BezierSegments(points)
    blocks = blocks_of(curve)
    found = in_groups(lambda rows: (nearest_in_blocks(blocks, rows), guesses(blocks, rows)), queries)
    return found, jax.vmap(lambda q: nearest(q, points, None))(queries)


# The overlapping ones take far longer than all others.
@pytest.mark.parametrize(
    "kind",
    swept(["plain", "repeated", "overlapping", "points", "around"], slow=["plain", "repeated", "points", "around"]),
)
def test_blocks_prove_what_all_segments_prove(kind):
    points, queries = _segments(kind, np.random.default_rng(3))
    (found, (segment, t)), expected = _both(jnp.asarray(points), jnp.asarray(queries))
    assert np.all(found.closed)
    assert np.all(found.lower <= expected.upper) and np.all(expected.lower <= found.upper)
    assert np.all(found.upper - found.lower <= 1e-13)
    # What is named attains the distance.
    curve = jhd.BezierSegments(points)
    rows = np.asarray(points)[np.asarray(found.segment)]
    s = np.asarray(found.t)[:, None]
    places = sum(c * (1 - s) ** (3 - i) * s**i * rows[:, i] for i, c in enumerate((1, 3, 3, 1)))
    np.testing.assert_allclose(np.linalg.norm(places - queries, axis=1), found.distance, atol=1e-14)
    assert np.all((segment >= 0) & (segment < curve.count) & (t >= 0) & (t <= 1))


def test_a_point_whose_distance_does_not_matter_is_not_searched():
    points, queries = (jnp.asarray(x) for x in _segments("plain", np.random.default_rng(3)))
    near = near_curve(jhd.BezierSegments(points), True)
    measured = jax.jit(near.nearest)
    found, free = measured(queries[0], 0.0), measured(queries[0], np.inf)
    assert int(found.steps) > 0 and int(free.steps) == 0
    assert float(free.lower) <= float(found.upper) and float(free.upper) == np.inf


@pytest.mark.exhaustive  # programs of its own
def test_a_table_that_is_too_short_for_a_long_curve_grows_before_the_first_step():
    # Every segment is as far from the other ring, so none is closed by the first bounds at a tolerance of zero.
    angles = np.linspace(0, 2 * np.pi, 769)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    a, b = jhd.polyline(ring), jhd.polyline(2 * ring)
    method = jhd.BranchAndBound(queue_size=16)
    solution = jhd.directed_hausdorff(a, b, method)
    roomy = jhd.directed_hausdorff(a, b)
    assert float(solution.lower) <= float(roomy.upper) and float(roomy.lower) <= float(solution.upper)


@pytest.mark.exhaustive
def test_many_queries_of_a_long_curve_come_back_in_their_order():
    rng = np.random.default_rng(5)
    angles = np.linspace(0, 2 * np.pi, COUNT + 1)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    curve = jhd.polyline(ring)
    queries = np.concatenate([rng.normal(size=(1200, 2)), ring[:50], [[0.0, 0.0], [1e6, 0.0]]]).reshape(2, 626, 2)
    offset, edge = queries[:, :, None] - ring[:-1], ring[1:] - ring[:-1]
    share = np.clip(np.sum(offset * edge, axis=-1) / np.sum(edge * edge, axis=-1), 0, 1)
    exact = np.linalg.norm(offset - share[..., None] * edge, axis=-1).min(axis=-1)
    for found in (jhd.project(queries, curve), jax.jit(jhd.project)(queries[:, :100], curve)):
        expected = exact[:, : found.distance.shape[1]]
        # At an error of the scale of the farthest query.
        assert np.all(found.lower <= expected + 1e-9) and np.all(found.upper >= expected - 1e-9)
        np.testing.assert_allclose(found.distance, expected, atol=1e-9)
        assert np.all(found.upper - found.lower <= 1e-7)


@pytest.mark.exhaustive
def test_many_curved_segments_are_at_no_distance_from_themselves_at_once():
    points, _ = _segments("overlapping", np.random.default_rng(6))
    solution = jhd.directed_hausdorff(jhd.BezierSegments(points), jhd.BezierSegments(points[::-1]))
    assert float(solution.upper) < 1e-12 and solution.stats["steps"] == 0
