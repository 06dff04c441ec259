"""Distances of many pairs on an executor: how pairs form tasks, and the results in the order of completion.

A task is a function of this module with its arguments, which can be pickled. It runs on threads, in other processes or
on other machines. Curves run in blocks through one compiled function. Shapes of other kinds, and curves of very many
segments, are searched one after the other, as in jhd.hausdorff.
"""

import os
import signal
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from jhd._distance.collections.blocks import SIZES, MeasuredPairs, block_of, kind_of, measure_block
from jhd._distance.collections.shapes import Collection
from jhd._distance.hausdorff import hausdorff
from jhd._distance.normalization.method import AbstractHausdorffMethod
from jhd._distance.pairs import pair_of
from jhd._distance.search.bodies import body_of
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._results.solution import HausdorffSolution
from jhd._shapes.curve import BezierSegments

# Tasks that are sent out for each worker: enough to keep it busy, and few enough that memory stays bounded.
_AHEAD = 3
# The same for executors that do not tell their number of workers.
_OPEN = 64


class AskedPairs(NamedTuple):
    """Pairs of shapes, and the range in which each distance matters."""

    rows: np.ndarray  # indices into the first collection
    columns: np.ndarray  # indices into the second collection
    level: np.ndarray  # distances up to this length do not matter
    ceiling: np.ndarray  # distances above this length need no closer bounds


def pairs_between(rows: Any, columns: Any, level: Any = 0.0, ceiling: Any = np.inf) -> AskedPairs:
    """Return pairs with one common level and ceiling, or one each."""
    shape = np.shape(rows)
    limits = (np.broadcast_to(np.asarray(x, float), shape) for x in (level, ceiling))
    return AskedPairs(np.asarray(rows), np.asarray(columns), *limits)


@contextmanager
def workers(executor: Executor | None) -> Iterator[Executor]:
    """Return the executor, or own threads, as many as there are usable processors.

    XLA lets other threads go on while it computes, so threads do as much as processes, and compile once.
    """
    if executor is not None:
        if not hasattr(executor, "submit"):
            raise TypeError(f"executor is {executor!r}; needs a concurrent.futures.Executor.")
        yield executor
        return
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    own = ThreadPoolExecutor(count)
    try:
        yield own
    finally:
        # A task that has begun cannot be stopped, and takes a moment.
        own.shutdown(cancel_futures=True)


def completed(executor: Executor, tasks: Iterable[tuple[Any, Callable[..., Any], Any]]) -> Iterator[tuple[Any, Any]]:
    """Yield (key, result) as tasks (key, function, argument) complete; only few are sent out at a time."""
    ahead = _AHEAD * getattr(executor, "_max_workers", _OPEN // _AHEAD)
    tasks, running = iter(tasks), {}
    try:
        while True:
            with interrupts_held() as heard:
                while not heard and len(running) < ahead and (task := next(tasks, None)) is not None:
                    running[executor.submit(task[1], task[2])] = task[0]
                finished = _finished(running, heard)
            if not running:
                return
            for future in finished:
                yield running.pop(future), future.result()
    finally:
        with interrupts_held():
            for future in running:
                future.cancel()


def _finished(running: dict[Future, Any], heard: list[int]) -> set[Future]:
    """Return the finished ones, at least one unless none runs or an interrupt is heard."""
    done: set[Future] = set()
    while running and not heard and not done:
        # Seconds after which one who waits for a task looks for an interrupt, which wakes nobody there.
        done = wait(list(running), 0.1, FIRST_COMPLETED).done
    return done


@contextmanager
def interrupts_held() -> Iterator[list[int]]:
    """Hold an interrupt back until the block ends: until then it is in the list, and it is raised at the end.

    Executors and futures take their locks in Python. An interrupt between two of their instructions leaves a lock taken
    for ever. Then a worker waits for the lock, and the caller waits for the worker. Other threads are not interrupted,
    and a handler of the user's own is left alone.
    """
    heard: list[int] = []
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield heard
        return
    signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    try:
        yield heard
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if heard:
            raise KeyboardInterrupt


def measured(
    executor: Executor, a: Collection, b: Collection, pairs: AskedPairs, method: AbstractHausdorffMethod
) -> Iterator[tuple[np.ndarray, MeasuredPairs]]:
    """Yield the indices of pairs and their distances as they are measured."""
    return completed(executor, _tasks(a, b, pairs, method))


def _tasks(
    a: Collection, b: Collection, pairs: AskedPairs, method: Any
) -> Iterator[tuple[Any, Callable[..., Any], Any]]:
    """Yield (indices, function, arguments) of tasks: pairs by kind, in blocks, then those measured alone."""
    kinds: dict[Any, list[int]] = defaultdict(list)
    for k, (i, j) in enumerate(zip(pairs.rows.tolist(), pairs.columns.tolist(), strict=True)):
        kinds[_kind(a.shapes[i], b.shapes[j], method)].append(k)
    for kind, members in sorted(kinds.items(), key=lambda item: (item[0] is None, item[0])):
        # Pairs of a task that are searched one after the other.
        length = 8 if kind is None else SIZES[kind.size]
        for start in range(0, len(members), length):
            index = np.array(members[start : start + length])
            some = AskedPairs(*(x[index] for x in pairs))
            ends = list(zip(some.rows.tolist(), some.columns.tolist(), strict=True))
            if kind is None:
                shapes = [(a.shapes[i], b.shapes[j]) for i, j in ends]
                yield index, _measure_alone, (shapes, some.level, some.ceiling, method)
            else:
                rows = [(a.row(i, kind), b.row(j, kind)) for i, j in ends]
                yield index, _measure_block, block_of(rows, some.level, some.ceiling, length, method)


def _kind(a: Any, b: Any, method: Any) -> Any:
    """Return the kind of the blocks in which a pair is measured; None if it is measured alone."""
    curves = isinstance(a, BezierSegments) and isinstance(b, BezierSegments)
    if not curves or not isinstance(method, BranchAndBound) or body_of(a).dimension == body_of(b).dimension == 0:
        return None
    return kind_of(a, b)


# Several threads may need a function that is not yet compiled; only one of them compiles it.
_first, _compiled = threading.Lock(), set()


def _measure_block(block: Any) -> MeasuredPairs:
    kind = tuple((x.shape, x.dtype) for x in (block.a.points, block.level)), block.a.weights is None, repr(block.method)
    if kind in _compiled:
        return measure_block(block)
    with _first:
        found = measure_block(block)
        _compiled.add(kind)
    return found


def _measure_alone(task: Any) -> MeasuredPairs:
    shapes, level, ceiling, method = task
    pairs = zip(shapes, level, ceiling, strict=True)
    rows: Any = [_plain(_alone(a, b, least, most, method)) for (a, b), least, most in pairs]
    columns: Any = (np.array(x) for x in zip(*rows, strict=True))
    return MeasuredPairs(*columns)


def _alone(a: Any, b: Any, level: float, ceiling: float, method: Any) -> HausdorffSolution:
    if level == 0 and ceiling == np.inf:
        return hausdorff(a, b, method, throw=False)
    pair = pair_of(a, b, method, None)
    aim: Any = np.asarray(level), np.asarray(ceiling)
    there, back = pair.both(pair.length(aim[0], 0.0), pair.length(aim[1], np.inf))
    return pair.larger(pair.reported(there), pair.reported(back))


def _plain(solution: HausdorffSolution) -> tuple[float, float, float, int]:
    return float(solution.value), float(solution.lower), float(solution.upper), int(solution.result._value)
