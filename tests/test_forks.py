"""A process forked from one that has computed refuses at once to compute; one forked before does as any other."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jhd
from jhd._runtime import forks
from tests.processes import python

A, B = jhd.polyline([(0, 0), (1, 0)]), jhd.point_set([[0.0, 1.0]])
MESH = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
ENTRIES = {
    "hausdorff": lambda: jhd.hausdorff(A, B),
    "directed": lambda: jhd.directed_hausdorff(A, B),
    "at_most": lambda: jhd.hausdorff_at_most(A, B, 1.0),
    "minimum": lambda: jhd.minimum_distance(A, B),
    "deviation": lambda: jhd.deviation(A, B),
    "project": lambda: jhd.project(np.zeros((1, 2)), A),
    "signed_distance": lambda: jhd.signed_distance(np.zeros((1, 3)), MESH),
    "pairwise": lambda: jhd.pairwise([A, B]),
    "nearest_shapes": lambda: jhd.nearest_shapes([A], [B]),
    "field": lambda: jhd.AdaptiveDistanceField.build(MESH, 0.1),
    "transform": lambda: jhd.distance_transform(np.eye(3, dtype=bool)),
    "fit_curve": lambda: jhd.fit_curve(A, degree=2, segments=1),
    "critical_pairs": lambda: jhd.critical_pairs(A, A),
    "profile": lambda: jhd.distance_profile(A, A),
}


@pytest.mark.parametrize("name", ENTRIES)
def test_every_entry_refuses_a_forked_process(name, monkeypatch):
    monkeypatch.setattr(forks, "_forked", True)
    with pytest.raises(RuntimeError, match=r"forked from one in which JAX had computed.*\"spawn\""):
        ENTRIES[name]()


def test_four_threads_at_once_find_what_one_finds():
    random = np.random.default_rng(0)
    pairs = [tuple(jhd.point_set(random.random((5, 2))) for _ in range(2)) for _ in range(16)]
    alone = [float(jhd.directed_hausdorff(a, b)) for a, b in pairs]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda pair: float(jhd.directed_hausdorff(*pair)), pairs)) == alone


SCRIPT = """
import os, signal, sys, warnings
import jax, jhd, jhd.io

warnings.simplefilter("ignore")  # JAX warns of forks too

def told(action):
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(60)  # ends it where it waits for ever
        try:
            said = repr(action())
        except RuntimeError as error:
            said = str(error)
        os.write(writer, said.encode())
        os._exit(0)
    os.close(writer)
    os.waitpid(child, 0)
    return os.read(reader, 1000).decode()

shapes = lambda: (jhd.point_set([[0.0, 0.0]]), jhd.point_set([[3.0, 4.0]]))
print(told(lambda: float(jhd.directed_hausdorff(*shapes()))))
a, b = shapes()
jax.numpy.sin(1.0)
print(told(lambda: jhd.directed_hausdorff(a, b)))
print(told(lambda: jhd.io.parse_path("M0 0L1 1").count))
print(float(jhd.directed_hausdorff(a, b)))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks of other systems")
def test_forked_processes_compute_refuse_or_read():
    done = python("-c", SCRIPT)
    before, after, read, own = done.stdout.splitlines()
    assert (before, own, read) == ("5.0", "5.0", "1")
    assert after.startswith("this process was forked from one in which JAX had computed")
