"""Every bound of a cell of curves has room for the rounding errors that are derived from its steps."""

import numpy as np
import pytest

from tests.rounding.curve_kernels import BOUNDS, Pairs
from tests.rounding.margins import margin

QUICK = [((1, 1), 2, True)]
SLOW = [
    ((p, q), dim, rational)
    for p, q in ((1, 1), (2, 3), (1, 6), (4, 4), (6, 6))
    for dim in (2, 3)
    for rational in (False, True)
]


def least_share(name, pairs):
    """The least ratio of what the constants leave to the derived error."""
    function, modules, sign = BOUNDS[name]
    left, error = margin(function, pairs.inputs, modules, sign)
    assert np.all(error > 0)
    return np.min(left / error)


@pytest.mark.parametrize("degrees, dim, rational", QUICK)
@pytest.mark.parametrize("name", BOUNDS)
def test_bounds_have_room_for_the_derived_error(name, degrees, dim, rational):
    assert least_share(name, Pairs(degrees, dim, rational)) >= 1


@pytest.mark.slow
@pytest.mark.parametrize("degrees, dim, rational", SLOW)
@pytest.mark.parametrize("name", BOUNDS)
def test_bounds_of_higher_degrees_have_room_for_the_derived_error(name, degrees, dim, rational):
    assert least_share(name, Pairs(degrees, dim, rational)) >= 1
