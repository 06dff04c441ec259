"""Executors of other packages and processes that end: the same bits come out, or the error says how to go on."""

import os
import signal
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from tests.processes import LONGEST, Terminal, python, started

POSIX = pytest.mark.skipif(os.name != "posix", reason="there is no signal that a process cannot refuse")

# Sets of points take no program of curves, so that a worker is there as soon as it has imported the package.
_BEGIN = """
import multiprocessing, os, signal, sys
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
import numpy as np
import jhd
from jhd._distance.collections import entries

random = np.random.default_rng(3)
shapes = [jhd.point_set(random.standard_normal((40, 2))) for _ in range(24)]
folder = sys.argv[1]


def kill(pids):
    for pid in pids:
        os.kill(pid, signal.SIGKILL)


class Once:
    \"\"\"Ends all workers when some of the work is done.\"\"\"

    def __init__(self, workers):
        self.workers, self.killed = workers, 0

    def __call__(self, progress):
        if progress.done >= 60 and not self.killed:
            pids = self.workers()
            kill(pids)
            self.killed = len(pids)


def main():
    entries._PAIRS = 24
    jhd.pairwise(shapes, store=folder + "/whole")
"""
_END = """

if __name__ == "__main__":
    main()
"""
# A cluster gives a worker up that is not back within 15 seconds, which on a busy machine is no time to import all.
_DASK = """
    import dask
    from distributed import Client, LocalCluster

    dask.config.set({"distributed.deploy.lost-worker-timeout": "600s"})
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**options) as cluster, Client(cluster) as client:
        once = Once(lambda: list(client.run(os.getpid).values()))
        found = jhd.pairwise(shapes, executor=client.get_executor(), store=folder + "/killed", progress=once)
    assert once.killed == 2 and found.computed == 24 * 23 // 2
"""
_PROCESSES = """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        once = Once(lambda: [process.pid for process in multiprocessing.active_children()])
        try:
            jhd.pairwise(shapes, executor=pool, store=folder + "/killed", progress=once)
            raise AssertionError("nothing was lost")
        except BrokenExecutor as error:
            assert "a second call with this store continues" in error.__notes__[0]
    assert once.killed >= 1
    assert 0 < jhd.pairwise(shapes, store=folder + "/killed").computed < 24 * 23 // 2
"""
_LOKY = """
    from loky import ProcessPoolExecutor as LokyExecutor

    with LokyExecutor(1) as pool:
        jhd.pairwise(shapes, executor=pool, store=folder + "/killed")
"""
_MPI = """
    from mpi4py.futures import MPIPoolExecutor

    with MPIPoolExecutor(1) as pool:
        jhd.pairwise(shapes, executor=pool, store=folder + "/killed")
"""


def check_same_bytes(tmp_path, body):
    """Runs the script, which leaves two stores, one of threads alone: they hold the same."""
    script = tmp_path / "run.py"
    script.write_text(_BEGIN + body + _END)
    python(str(script), str(tmp_path))
    whole, other = ({file.name: file.read_bytes() for file in (tmp_path / x).iterdir()} for x in ("whole", "killed"))
    assert len(whole) == 1 + 24 and whole == other


@pytest.mark.exhaustive
@POSIX
@pytest.mark.skipif(find_spec("distributed") is None, reason="dask[distributed] is not installed")
def test_workers_of_dask_that_are_killed_are_replaced_and_leave_the_same_bytes(tmp_path):
    check_same_bytes(tmp_path, _DASK)


@pytest.mark.exhaustive
@POSIX
def test_a_process_that_is_killed_ends_a_plain_pool_and_a_second_call_goes_on(tmp_path):
    check_same_bytes(tmp_path, _PROCESSES)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("loky") is None, reason="loky is not installed")
def test_workers_of_loky_find_the_same_bytes(tmp_path):
    check_same_bytes(tmp_path, _LOKY)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mpi4py") is None, reason="mpi4py is not installed")
def test_workers_of_mpi_find_the_same_bytes(tmp_path):
    check_same_bytes(tmp_path, _MPI)


@pytest.mark.slow
@POSIX
def test_the_command_line_shows_a_bar_and_ctrl_c_keeps_what_is_done(tmp_path):
    random = np.random.default_rng(1)
    for k in range(60):
        np.save(tmp_path / f"{k:02d}.npy", random.standard_normal((20_000, 2)))
    command = [sys.executable, "-m", "jhd", "pairwise", str(tmp_path)]
    with (
        Terminal("distances [") as terminal,
        started(*command, stdout=subprocess.PIPE, stderr=terminal.theirs) as running,
    ):
        assert terminal.seen()
        running.send_signal(signal.SIGINT)
        out, _ = running.communicate(timeout=LONGEST)
    lines = out.splitlines()
    undone = [line for line in lines if line.endswith("\tinterrupted")]
    assert running.returncode == 130 and len(lines) == 60 * 59 // 2
    assert 0 < len(undone) < len(lines) and all(line.startswith("nan [0, inf]") for line in undone)
