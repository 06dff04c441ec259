"""Where smooth branches of a function meet along lines."""

import numpy as np
import pytest

from jhd._distance.statistics.breakpoints import OnLines, kinks

ENDS = np.zeros(4), np.ones(4)
WHERE = np.array([0.1, 1 / 3, 0.7, 0.99])
# Brackets become their squares, seven times: of these kinks nothing but rounding and a few slow ones stays.
CLOSE = 1e-9


def branches(bend):
    """A parabola that bends by so much more, and is another branch, behind some places."""

    def look(t):
        behind = t > WHERE
        value = 0.3 * t**2 + t + np.where(behind, bend * (t - WHERE), 0.0)
        return OnLines(t, value, 0.6 * t + 1 + np.where(behind, bend, 0.0), behind.astype(int))

    return look


@pytest.mark.parametrize("bend", [-2.0, 0.5])
def test_kinks_are_found_by_the_tangents_on_both_sides(bend):
    found = kinks(branches(bend), *ENDS)
    assert np.allclose(found.place, WHERE, rtol=0, atol=CLOSE)
    assert np.array_equal(found.before, [0, 0, 0, 0]) and np.array_equal(found.behind, [1, 1, 1, 1])


def test_branches_that_touch_without_a_kink_are_told_apart_by_their_labels():
    assert np.allclose(kinks(branches(0.0), *ENDS).place, WHERE, rtol=0, atol=2.0**-7)


def test_a_kink_within_one_label_is_found_by_slopes():
    look = branches(-2.0)
    found = kinks(lambda t: look(t)._replace(label=np.zeros(4, int)), *ENDS)
    assert np.allclose(found.place, WHERE, rtol=0, atol=CLOSE)
