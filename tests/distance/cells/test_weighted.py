"""Means, shares and quantiles enclose what weights and values within their bounds can give."""

from fractions import Fraction

import numpy as np
import pytest

from jhd._distance.cells.weighted import (
    Values,
    Weights,
    greatest_square,
    least_square,
    mean_bounds,
    quantile_bounds,
    share_bounds,
)

SEEDS = range(20)


def constant(lower, upper):
    """Values that cells bound by their ends alone."""
    return Values(lower, upper, np.stack([lower, upper], axis=1)[:, None])


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


def test_means_are_rounded_outward():
    for values in np.random.default_rng(0).random((50, 3)):
        exact = sum(map(Fraction, values.tolist())) / 3
        lower, upper = mean_bounds(Weights(np.ones(3), np.ones(3)), values, values)
        assert lower <= exact <= upper


def test_a_share_is_reached_within_its_own_rounding():
    # 0.55 * 100 is 55 and an ulp as floats.
    values, ones = np.arange(1.0, 101.0), np.ones(100)
    assert quantile_bounds(Weights(ones, ones), constant(values, values), 0.55) == (55.0, 55.0)


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
            low, high = quantile_bounds(weights, constant(lower, upper), q)
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


def share_below(values, level):
    """The share of a simplex over which the affine function with these values at its corners is at most a level."""
    least, *middle, most = sorted(map(Fraction, values))
    if level >= most:
        return Fraction(1)
    if level < least:
        return Fraction(0)
    if not middle:
        return (level - least) / (most - least)
    if level < middle[0]:
        return (level - least) ** 2 / ((middle[0] - least) * (most - least))
    return 1 - (most - level) ** 2 / ((most - middle[0]) * (most - least))


@pytest.mark.parametrize("corners", [2, 3])
def test_shares_and_quantiles_of_affine_functions_enclose_the_exact_ones_closely(corners):
    random = np.random.default_rng(corners)
    for rounded in (1, 9):
        # Rounded to tenths many corners are as high.
        ends = random.uniform(size=(12, corners)).round(rounded)
        weights = random.uniform(0.1, 1, 12)
        values = Values(ends.min(axis=1), ends.max(axis=1), np.stack([ends, ends], axis=2))

        def exact(level, ends=ends, weights=weights):
            shares = [Fraction(w) * share_below(row, Fraction(level)) for w, row in zip(weights, ends, strict=True)]
            return sum(shares) / sum(map(Fraction, weights))

        for level in (0.0, 0.1, 0.35, 0.5, 0.9):
            low, high = share_bounds(Weights(weights, weights), *values.within(level))
            assert low <= exact(level) <= high <= low + 1e-12
        for q in (0.01, 0.3, 0.5, 0.99, 1.0):
            low, high = quantile_bounds(Weights(weights, weights), values, q)
            assert exact(np.nextafter(low, 0)) <= q <= exact(high) * Fraction(1 + 2**-49) and high - low < 1e-6


def test_mean_squares_of_affine_functions_are_rounded_outward():
    for values in np.random.default_rng(0).random((50, 3)):
        exact = (sum(Fraction(x) ** 2 for x in values) + sum(map(Fraction, values)) ** 2) / 12
        (least,), (most,) = least_square(values[None]), greatest_square(values[None])
        assert least <= exact <= most <= least * (1 + 1e-13)
    # Of max(x, 0) with x from -1 to 3 the mean square is 9 / 4.
    assert 0 < least_square(np.array([[-1.0, 3.0]]))[0] <= 9 / 4
