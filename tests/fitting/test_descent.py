"""Descent over kinks: it reaches them, and ends at once where there is nothing left to lower."""

import jax.numpy as jnp
import numpy as np

from jhd._fitting.descent import descend
from jhd._results.solution import name_of
from jhd._runtime.clock import Clock

START = np.array([0.3, -0.4])


def kinked(parameters):
    return jnp.abs(parameters[0]) + 2 * jnp.abs(parameters[1] - parameters[0])


def lowered(share):
    return descend(lambda p: share * kinked(p), START, np.ones(2), 1.0, 60, 0.0, Clock(), lambda *news: None)


def test_a_kink_is_reached():
    found = lowered(1.0)
    assert found.point.value < 1e-6 * found.history[0] and np.all(np.diff(found.history) <= 0)


def test_what_rounding_leaves_of_a_distance_is_not_lowered():
    found = lowered(1e-15)
    assert found.counts["evaluations"] == 1 and found.counts["steps"] == 0
    assert name_of(found.result) == "successful"
