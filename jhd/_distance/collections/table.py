"""The table of all distances of two collections, filled part by part, or read from a store."""

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor
from typing import Any

import numpy as np

from jhd._distance.collections.blocks import MeasuredPairs
from jhd._distance.collections.shapes import Collection
from jhd._distance.collections.store import Store
from jhd._distance.collections.tasks import measured, pairs_between
from jhd._results.outcomes import RESULTS
from jhd._runtime.memory import check_memory

# Exceptions of other packages' executors when they give up a worker, as Dask does after some tries.
_LOST = ("KilledWorker",)


def check_table(rows: int, columns: int) -> None:
    """Raise MemoryError if there is no room for the table: three floats and a result for each pair."""
    work = f"a table of {rows} by {columns} distances would take"
    check_memory(32.0 * rows * columns, work, "nearest_shapes and pairs_within need no table")


class DistanceTable:
    """Distances of all pairs, as far as they are known.

    Args:
        a: the first collection.
        b: the second one; if it is the first one, each pair is measured once.
        pairs: approximate number of pairs of a part.
    """

    def __init__(self, a: Collection, b: Collection, pairs: int):
        self._a, self._b, self._step = a, b, max(1, pairs // len(b))
        shape = len(a), len(b)
        check_table(*shape)
        self.value, self.lower, self.upper = np.full(shape, np.nan), np.zeros(shape), np.full(shape, np.inf)
        self.result = np.full(shape, int(RESULTS.interrupted._value))
        self.done, self.computed = 0, 0
        self.total = len(a) * (len(a) - 1) // 2 if a is b else len(a) * len(b)
        if a is b:
            known = 0.0, 0.0, 0.0, int(RESULTS.successful._value)
            for array, number in zip(self._arrays(), known, strict=True):
                np.fill_diagonal(array, number)

    def fill(self, executor: Executor, method: Any, store: Store | None, report: Callable[[int, int], None]) -> None:
        """Measure all pairs except in parts that the store has, and store new parts."""
        try:
            for part, (rows, columns) in enumerate(self._parts()):
                known = None if store is None else store.read(part)
                if known is not None:
                    self._put(rows, columns, known)
                    report(self.done, self.total)
                    continue
                left = len(rows)
                for index, found in measured(executor, self._a, self._b, pairs_between(rows, columns), method):
                    self._put(rows[index], columns[index], found)
                    self.computed, left = self.computed + len(index), left - len(index)
                    # A report may end the call; a whole part is stored before.
                    if store is not None and not left:
                        store.write(part, MeasuredPairs(*(array[rows, columns] for array in self._arrays())))
                    report(self.done, self.total)
        except Exception as error:
            if store is not None and (isinstance(error, BrokenExecutor) or type(error).__name__ in _LOST):
                error.add_note("A worker was lost. Finished parts are kept: a second call with this store continues.")
            raise

    def _parts(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Return rows and columns of the pairs to measure, some rows of the table at a time."""
        same, count = self._a is self._b, len(self._b)
        for start in range(0, len(self._a), self._step):
            rows = np.arange(start, min(start + self._step, len(self._a)))
            row, column = np.repeat(rows, count), np.tile(np.arange(count), len(rows))
            yield (row[column > row], column[column > row]) if same else (row, column)

    def _put(self, rows: np.ndarray, columns: np.ndarray, found: MeasuredPairs) -> None:
        for array, numbers in zip(self._arrays(), found, strict=True):
            array[rows, columns] = numbers
            if self._a is self._b:
                array[columns, rows] = numbers
        self.done += len(rows)

    def _arrays(self) -> tuple[np.ndarray, ...]:
        return self.value, self.lower, self.upper, self.result
