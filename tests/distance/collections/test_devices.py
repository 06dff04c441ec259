"""Pairs are dealt out to all devices of a process, and rows of a table to several processes, with the same bits."""

import os
import socket
import sys

import numpy as np
import pytest

import jhd
from jhd._distance.collections.blocks import Block, CurveRows, _shares
from tests.processes import at_once


@pytest.mark.parametrize("count", [1, 2, 7, 8])
@pytest.mark.parametrize("devices", [2, 3, 8])
def test_every_pair_is_dealt_to_one_device_and_found_again(count, devices):
    # What is measured of a pair is its level here.
    level = np.minimum(np.arange(8.0), count - 1)
    rows = CurveRows(level[:, None], None, level[:, None], level[:, None])
    dealt, place = _shares(Block(rows, rows, level, level + 1, count, jhd.BranchAndBound()), devices)
    np.testing.assert_array_equal(dealt.level[place], np.arange(count))
    np.testing.assert_array_equal(dealt.b.points[:, 0], dealt.ceiling - 1)
    assert dealt.count.sum() == count and np.ptp(dealt.count) <= 1
    # The pairs of each device are the first ones of its share.
    assert np.all(place % (len(dealt.level) // devices) < dealt.count[place // (len(dealt.level) // devices)])


_SCRIPT = """
import sys
import jax
import numpy as np
from jax.experimental.multihost_utils import process_allgather
import jhd
rank = int(sys.argv[1])
jax.distributed.initialize(coordinator_address=sys.argv[2], num_processes=2, process_id=rank)
assert jax.local_device_count() == 3 and jax.device_count() == 6
random = np.random.default_rng(1)
curves = [jhd.BezierSegments(random.standard_normal((1 + k % 5, 4, 2)).cumsum(axis=0)) for k in range(8)]
mine = jhd.pairwise(curves[rank::2], curves)
table = process_allgather(np.stack([mine.value, mine.lower, mine.upper]))
# Row k of process r is that of shape 2 k + r.
print("table", np.moveaxis(np.asarray(table), 0, 2).reshape(3, 8, 8).tobytes().hex())
"""


def free_port():
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return asked.getsockname()[1]


@pytest.mark.exhaustive
def test_two_processes_of_three_devices_share_a_table_with_the_bits_of_one():
    env = os.environ | {"JAX_PLATFORMS": "cpu", "JAX_NUM_CPU_DEVICES": "3"}
    address = f"127.0.0.1:{free_port()}"
    answers = at_once([[sys.executable, "-c", _SCRIPT, str(rank), address] for rank in range(2)], env=env)
    random = np.random.default_rng(1)
    curves = [jhd.BezierSegments(random.standard_normal((1 + k % 5, 4, 2)).cumsum(axis=0)) for k in range(8)]
    alone = jhd.pairwise(curves, curves[:])
    expected = np.stack([alone.value, alone.lower, alone.upper])
    for out in answers:
        # What connects the processes may print lines of its own.
        (table,) = (line.split()[1] for line in out.splitlines() if line.startswith("table "))
        np.testing.assert_array_equal(np.frombuffer(bytes.fromhex(table)).reshape(3, 8, 8), expected)
