"""Least squares with non-negative unknowns, against SciPy's."""

import numpy as np
import pytest
from scipy.optimize import nnls

from jhd._arithmetic.least_squares import non_negative


@pytest.mark.parametrize("size", [1.0, 1e17])
def test_the_residual_is_the_least(size):
    rng, empty = np.random.default_rng(7), 0
    for _ in range(400):
        matrix, right = rng.normal(size=(4, 3)), rng.normal(size=4)
        found, exact = non_negative(size * matrix, right), nnls(matrix, right)[0] / size
        assert np.all(found >= 0)
        # Values below 1e-15 are zero.
        np.testing.assert_allclose(found, exact, rtol=1e-9, atol=2e-15)
        empty += not found.any()
    assert empty > 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_give_zeros_without_a_word(bad, capfd):
    matrix, right = np.eye(3), np.ones(3)
    matrix[1, 2] = bad
    assert not non_negative(matrix, right).any()
    assert not non_negative(np.eye(3), np.array([1.0, bad, 1.0])).any()
    assert capfd.readouterr() == ("", "")
