"""Annealing: what it takes, and that it comes near from afar, with control points that the farthest place leaves."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._fitting.annealing import annealing
from jhd._runtime.clock import Clock

ROWS = np.random.default_rng(3).normal(size=(4, 4, 2))
TARGET = jhd.BezierSegments(ROWS)


def moved(offset):
    return jhd.BezierSegments(jnp.asarray(ROWS) + offset)


def begun(temperature, statistic: Any = None, target: Any = TARGET, clock: Any = None):
    return annealing(temperature, statistic, moved, target, np.ones_like, clock or Clock())


def test_only_the_distance_of_curves_is_annealed_and_by_a_length():
    with pytest.raises(ValueError, match="temperature is given with the statistic Mean"):
        begun(0.1, jhd.MeanDistance())
    with pytest.raises(TypeError, match="target must be a curve"):
        begun(0.1, target=jhd.ImplicitSurface.parse("x + y + z", [-1, -1, -1], [1, 1, 1]))
    with pytest.raises(ValueError, match="temperature is -1"):
        jhd.minimize_hausdorff(moved, np.zeros(2), TARGET, temperature=-1.0)


def test_without_a_temperature_or_time_a_start_stays_as_it_is():
    start, over = np.array([0.3, 0.1]), Clock(1e-9)
    assert begun(None)(start) is start
    while not over.is_over():
        pass
    assert begun(0.1, clock=over)(start) is start


@pytest.mark.exhaustive
def test_a_curve_that_was_moved_away_is_brought_back():
    start = np.array([1.5, -1.0])
    end = begun(0.5)(start)
    before, after = (float(jhd.hausdorff(TARGET, moved(x)).value) for x in (start, end))
    assert after < 0.02 * before
    fit = jhd.minimize_hausdorff(moved, start, TARGET, temperature=0.5, max_steps=2)
    assert float(fit.error.value) < 0.02 * before
