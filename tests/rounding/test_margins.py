"""Every bound of a cell of curves has room for the rounding errors that are derived from its steps."""

import numpy as np
import pytest

from tests.rounding.curve_kernels import BOUNDS, Pairs
from tests.rounding.margins import margin
from tests.sweeps import swept

QUICK = [((1, 1), 2, True)]
# Four degrees, both dimensions and both kinds are among the first four.
SLOW = [((1, 6), 3, True), ((6, 6), 2, False), ((4, 4), 3, False), ((2, 3), 2, True)]
SLOW += [
    case
    for p, q in ((1, 1), (2, 3), (1, 6), (4, 4), (6, 6))
    for dim in (2, 3)
    for rational in (False, True)
    if (case := ((p, q), dim, rational)) not in SLOW
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


@pytest.mark.parametrize("degrees, dim, rational", swept(SLOW, 0, 1))
@pytest.mark.parametrize("name", BOUNDS)
def test_bounds_of_higher_degrees_have_room_for_the_derived_error(name, degrees, dim, rational):
    assert least_share(name, Pairs(degrees, dim, rational)) >= 1
