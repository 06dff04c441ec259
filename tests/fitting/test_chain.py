"""Corners of targets: those of noise are none where they do not matter, and those of the shape stay."""

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._fitting.chain import Layout, divided, least_squares, longest_pieces, turns
from jhd._fitting.host_bounds import host_bounds
from jhd._runtime.clock import Clock

NOISE = 0.01


def square(count):
    """A square of side 2 with noisy vertices, `count` on each side, beginning in the middle of one."""
    side = np.linspace(-1, 1, count, endpoint=False)
    ones = np.ones(count)
    points = np.concatenate([np.stack(x, axis=1) for x in ((side, -ones), (ones, side), (-side, ones), (-ones, -side))])
    points = np.roll(points, -count // 2, axis=0) + NOISE * np.random.default_rng(0).normal(size=points.shape)
    return jhd.polyline(points, closed=True)


def circle(count):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return jhd.polyline(points + NOISE * np.random.default_rng(0).normal(size=points.shape), closed=True)


def test_a_noisy_circle_has_many_corners_and_none_that_matters():
    assert np.sum(turns(circle(200))) > 100
    assert not np.any(turns(circle(200), 0.03))


@pytest.mark.parametrize("count", [50, 80])
def test_a_noisy_square_has_its_four_corners(count):
    corners = np.flatnonzero(turns(square(count), 0.03))
    assert len(corners) == 4
    # The segment that ends at the corner, to a few vertices.
    np.testing.assert_allclose(corners + 1, count // 2 + count * np.arange(4), atol=3)


def test_pieces_of_a_noisy_square_meet_at_its_corners():
    joints = divided(square(50), 12)
    assert len(joints) == 13
    apart = np.abs(joints[:, None] - (np.arange(4) / 4 + 0.125))
    assert np.all(np.min(apart, axis=0) < 0.02)


def test_few_pieces_lie_within_a_tolerance_of_a_noisy_circle():
    joints, pieces = longest_pieces(circle(200), 3, 0.04, 0.03)
    assert len(pieces) == len(joints) - 1 < 12


@pytest.mark.slow
def test_one_narrow_feature_takes_fewer_pieces_that_are_laid_by_error_than_even_ones():
    x = np.linspace(0, 4, 801)
    target = jhd.polyline(np.stack([x, 0.3 * np.exp(-(((x - 1.3) / 0.03) ** 2))], axis=1))
    pieces = longest_pieces(target, 3, 2e-3, 0.01)[1]
    assert len(pieces) <= 12
    assert host_bounds(target, jhd.BezierSegments(pieces), Clock()).upper <= 2e-3
    for count in (12, 18):
        build, free = least_squares(Layout(3, count, False, True, False), target, divided(target, count))
        assert host_bounds(target, build(jnp.asarray(free)), Clock()).lower > 2.4e-3
