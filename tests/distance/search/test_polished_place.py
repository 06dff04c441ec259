"""A Newton step of a place between feet, of equations whose solution is known."""

import numpy as np
import pytest

from jhd._distance.search.polished_place import _basic, _newton


def test_a_step_makes_distances_equal_where_the_slopes_are_opposite():
    # Distances 1 + x and 1.5 - x are equal at x = 1/4, with half the weight each.
    step, shares = _newton(np.zeros((1, 1)), np.array([[1.0], [-1.0]]), np.array([1.0, 1.5]))
    np.testing.assert_allclose(step, [0.25], rtol=1e-14)
    np.testing.assert_allclose(shares, [0.5, 0.5], rtol=1e-14)


def test_one_more_foot_than_directions_balances_as_all_of_them_do():
    rng = np.random.default_rng(1)
    slopes = rng.normal(size=(4, 2))
    slopes[3] = -np.sum(slopes[:3], axis=0)
    kept, shares = _basic(slopes, np.full(4, 0.25))
    assert len(kept) == 3 and np.all(shares >= 0)
    np.testing.assert_allclose([*(shares @ slopes[kept]), np.sum(shares)], [0, 0, 1], atol=1e-14)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_give_no_step_without_a_word(bad, capfd):
    step, shares = _newton(np.full((1, 1), bad), np.array([[1.0], [-1.0]]), np.array([1.0, 1.5]))
    assert np.all(np.isnan(step)) and np.all(np.isnan(shares))
    assert capfd.readouterr() == ("", "")
