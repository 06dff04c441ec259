"""Ten thousand shapes, the near ones among all pairs of them, and all that is made of them stay below a gigabyte."""

import sys

import pytest

from tests.processes import python

_RUN = """
import numpy as np
import jhd

random = np.random.default_rng(0)
turns = np.exp(2j * np.pi * np.arange(40) / 40)


def outline(count):
    at = np.exp(2j * np.pi * np.arange(count) / count) * random.integers(1, 10_000)
    at = at + 0.0005 * random.standard_normal((2, count)).T @ [1, 1j]
    return jhd.polyline(np.stack([at.real, at.imag], axis=1), closed=True)


shapes = [outline(count) for count in random.choice([12, 24, 47], 10_000)]
near = jhd.pairs_within(shapes, threshold=0.002)
assert near.computed > 1000, near
# Of this process alone: what resource counts begins with the process that started it.
with open("/proc/self/status") as lines:
    print(*(line.split()[1] for line in lines if line.startswith("VmHWM")))
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere the peak is counted otherwise")
def test_ten_thousand_shapes_take_less_than_a_gigabyte():
    assert int(python("-c", _RUN).stdout) * 1024 < 1e9
