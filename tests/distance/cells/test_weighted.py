"""Means, shares and quantiles enclose what weights and values within their bounds can give."""

from fractions import Fraction

import numpy as np
import pytest

from jhd.distance.cells.weighted import Weights, mean_bounds, quantile_bounds, share_bounds

SEEDS = range(20)


def drawn(seed):
    """Bounds of weights and values, some weights known exactly and some possibly zero, and choices within them."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 12))
    least = rng.uniform(0, 1, count) * (rng.random(count) > 0.3)
    weights = Weights(least, least + rng.uniform(0.01, 1, count) * (rng.random(count) > 0.2) + 1e-3)
    lower = rng.uniform(0, 2, count)
    upper = lower + rng.uniform(0, 1, count)
    for _ in range(50):
        share = rng.random((2, count)).round(int(rng.integers(0, 3)))
        w = weights.lower + share[0] * (weights.upper - weights.lower)
        if w.sum() > 0:
            yield weights, (lower, upper), w, lower + share[1] * (upper - lower)


@pytest.mark.parametrize("seed", SEEDS)
def test_means_of_all_choices_are_within_the_bounds(seed):
    for weights, values, w, x in drawn(seed):
        low, high = mean_bounds(weights, *values)
        assert low <= np.sum(w * x) / np.sum(w) * (1 + 1e-15) and np.sum(w * x) / np.sum(w) <= high * (1 + 1e-15)


def test_the_least_mean_is_attained():
    weights = Weights(np.array([1.0, 1.0]), np.array([3.0, 2.0]))
    low, high = mean_bounds(weights, np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    assert low == pytest.approx(1 / 4, rel=1e-12) and high == pytest.approx(2 / 3, rel=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_shares_and_quantiles_of_all_choices_are_within_the_bounds(seed):
    for weights, (lower, upper), w, x in drawn(seed):
        for t in (0.5, 1.0, 1.7):
            low, high = share_bounds(weights, upper <= t, lower <= t)
            share = np.sum(w[x <= t]) / np.sum(w)
            assert low - 1e-15 <= share <= high + 1e-15
        order = np.argsort(x)
        for q in (0.1, 0.5, 0.93, 1.0):
            exact = x[order][np.argmax(np.cumsum(w[order]) >= q * np.sum(w) * (1 - 1e-13))]
            low, high = quantile_bounds(weights, lower, upper, q)
            assert low <= exact <= high


@pytest.mark.parametrize("seed", range(40))
def test_the_upper_bound_of_a_share_counts_the_rounding_of_a_difference(seed):
    random = np.random.default_rng(seed)
    weights, holds = (
        np.append(1.0, random.uniform(size=2) * 10.0 ** -random.uniform(1, 4)),
        np.array([True, True, False]),
    )
    exact = sum(map(Fraction, weights[holds].tolist())) / sum(map(Fraction, weights.tolist()))
    low, high = share_bounds(Weights(weights, weights), holds, holds)
    assert low <= exact <= high


def test_what_has_no_upper_bound_leaves_the_mean_without():
    weights = Weights(np.ones(2), np.ones(2))
    low, high = mean_bounds(weights, np.array([1.0, 2.0]), np.array([1.0, np.inf]))
    assert 1.49 < low <= 1.5 and high == np.inf
