"""How many distances of letters per second do threads, processes, Dask's workers and several devices compute?

The same pairs of letters, of 17 to 48 segments each, by `jhd.pairwise` on threads, spawned processes, workers of loky
and Dask if these are installed, and several devices that XLA simulates on the CPU, each in a process of its own. For
comparison, a plain loop of `jhd.hausdorff`. Everything is called twice and the second call counts, which excludes
compilation and the start of workers. CPU seconds include this process and the tasks of its workers. The saved numbers
state the number of processors and the load of the machine: more workers than processors gain nothing, and wall times
mean little if the machine is busy.

Claims: the result of a pair is bitwise identical on all of these. A plain loop takes more than three times
the CPU seconds of blocks, and more workers add less than 30 % to the CPU seconds of a pair.

Feeds: figure and table "workers".
Takes: 2 minutes.
"""

import hashlib
import json
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jax
import numpy as np
from common import Run, markdown
from common_collections import SMALL, Glyphs, between, glyphs_of, load

import jhd

_FONT = "DejaVu Sans"
# Letters on each side of the table, and their numbers of segments, which fit one compiled function.
_SIDE, _SEGMENTS = 48, (17, 48)
_THREADS, _PROCESSES, _DEVICES = (1, 2, 4, 8), (1, 2), (1, 2, 4)
# Number of pairs in the plain loop.
_PLAIN = 200
_FLAG = "--xla_force_host_platform_device_count"


def timed(function: Callable[[Any], Any], argument: Any) -> tuple[Any, float]:
    """Return the result of a task and the CPU seconds that this process spent meanwhile; one task at a time."""
    start = time.process_time()
    return function(argument), time.process_time() - start


class Metered(Executor):
    """Hands tasks on to an executor, and adds up the CPU seconds of its workers.

    Args:
        inner: does the work, one task at a time in each process.
    """

    def __init__(self, inner: Executor):
        self._inner, self._lock = inner, threading.Lock()
        self.spent = 0.0
        workers = getattr(inner, "_max_workers", None)
        if workers is not None:
            self._max_workers = workers

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_: Any) -> Future:
        """Return a future with the result of a task."""
        outer: Future = Future()
        self._inner.submit(timed, fn, *args).add_done_callback(partial(self._done, outer))
        return outer

    def _done(self, outer: Future, inner: Future) -> None:
        error = inner.exception()
        if error is not None:
            outer.set_exception(error)
            return
        found, spent = inner.result()
        with self._lock:
            self.spent += spent
        outer.set_result(found)


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    side, small = (6 if run.smoke else _SIDE), run.smoke
    a, b = _letters(small, side)
    entries = [_plain(a, b, 2 if small else _PLAIN)]
    for count in (1, 2) if small else _THREADS:
        with ThreadPoolExecutor(count) as pool:
            entries.append(_measured("threads", count, pool, a, b))
    if not small:
        for name, start in _pools().items():
            for count in _PROCESSES:
                with start(count) as inner:
                    entries.append(_measured(name, count, Metered(inner), a, b))
        entries += [_devices(count) for count in _DEVICES]
    numbers = {"processors": os.cpu_count(), "load": load(), "pairs": side * side, "entries": entries}
    run.save(numbers, _table(numbers))


def _letters(small: bool, side: int) -> tuple[Glyphs, Glyphs]:
    """Return the letters of both sides."""
    if small:
        glyphs = glyphs_of(SMALL, small=True)
    else:
        glyphs = between(glyphs_of([_FONT]), *_SEGMENTS)
    order = np.random.default_rng(0).permutation(len(glyphs.curves))
    return glyphs.take(order[:side]), glyphs.take(order[side : 2 * side])


def _pools() -> dict[str, Callable[[int], Any]]:
    """Return the available executors with other processes as workers."""
    found: dict[str, Callable[[int], Any]] = {"processes": _spawned}
    if find_spec("loky"):
        found["loky"] = _loky
    if find_spec("distributed"):
        found["Dask"] = _dask
    return found


def _spawned(count: int) -> Executor:
    return ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"))


def _loky(count: int) -> Executor:
    from loky import ProcessPoolExecutor as LokyExecutor  # pyright: ignore[reportMissingImports]

    return LokyExecutor(count)


@contextmanager
def _dask(count: int) -> Iterator[Executor]:
    from distributed import Client, LocalCluster

    options: dict[str, Any] = {"n_workers": count, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**options) as cluster, Client(cluster) as client:
        yield client.get_executor()


def _measured(kind: str, count: int, pool: Executor, a: Glyphs, b: Glyphs) -> dict[str, Any]:
    """Return the second of two calls, when all workers have started and everything is compiled."""
    jhd.pairwise(a.curves, b.curves, executor=pool)
    before = getattr(pool, "spent", 0.0)
    start, wall = time.process_time(), time.perf_counter()
    found = jhd.pairwise(a.curves, b.curves, executor=pool)
    wall = time.perf_counter() - wall
    cpu = time.process_time() - start + getattr(pool, "spent", 0.0) - before
    text = hashlib.sha256(np.stack([found.value, found.lower, found.upper]).tobytes()).hexdigest()
    pairs = found.computed
    return {
        "kind": kind,
        "workers": count,
        "rate": pairs / wall,
        "cpu_a_pair": cpu / pairs,
        "bits": text,
        "load": load(),
    }


def _plain(a: Glyphs, b: Glyphs, pairs: int) -> dict[str, Any]:
    """Time a loop of single calls, once all functions that it needs are compiled."""
    chosen = [(x, y) for x in a.curves for y in b.curves][:pairs]
    for x, y in chosen:
        jhd.hausdorff(x, y)
    start, wall = time.process_time(), time.perf_counter()
    for x, y in chosen:
        jhd.hausdorff(x, y)
    wall, cpu = time.perf_counter() - wall, time.process_time() - start
    return {"kind": "plain loop", "workers": 1, "rate": pairs / wall, "cpu_a_pair": cpu / pairs, "load": load()}


def _devices(count: int) -> dict[str, Any]:
    """Measure with `count` devices, in a process that starts with them."""
    environment = {
        **os.environ,
        "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {_FLAG}={count}",
        "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir or ""),  # pyright: ignore
    }
    command = [sys.executable, "-c", "import workers; workers.report_devices()"]
    done = subprocess.run(
        command, cwd=Path(__file__).parent, env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def report_devices() -> None:
    """Measure in this process on all of its devices, and print the numbers."""
    with ThreadPoolExecutor(1) as pool:
        print(json.dumps(_measured("devices", len(jax.devices()), pool, *_letters(False, _SIDE))))


def _table(numbers: dict[str, Any]) -> str:
    rows = [
        [entry["kind"], entry["workers"], f"{entry['rate']:.0f}", f"{1e3 * entry['cpu_a_pair']:.2f}"]
        for entry in numbers["entries"]
    ]
    return markdown(
        [f"{numbers['processors']} processors", "workers", "pairs per second", "CPU time per pair (ms)"], rows
    )


if __name__ == "__main__":
    main()
