"""The ends of intervals move outward where floats are no plain numbers."""

import jax.numpy as jnp
import numpy as np

from jhd.arithmetic.interval import Interval


def test_subnormal_ends_move_outward_and_nan_is_no_bound():
    ends = jnp.array([5e-324, -5e-324, np.nan, 1.5])
    found = Interval(ends, ends)
    nu = float(np.finfo(float).tiny)
    assert found.lower.tolist() == [0.0, -nu, -np.inf, 1.5] and found.upper.tolist() == [nu, 0.0, np.inf, 1.5]
