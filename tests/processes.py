"""Processes that tests start: none outlives its test, none waits for a reader, and none is waited for for ever."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any

# Seconds; far more than any of them takes on two busy cores.
LONGEST = 900
# Bytes that are read of a terminal at once.
_PIECE = 4096


@contextmanager
def started(*command: str, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A process, which is killed when the block ends, and on POSIX all that it has started, if they are still there."""
    alone = os.name == "posix"
    with subprocess.Popen(command, text=True, start_new_session=alone, **options) as process:
        try:
            yield process
        finally:
            kill(process)


def kill(process: subprocess.Popen[str]) -> None:
    """Ends a process that `started` has started and all of its group, whether or not it has ended by itself."""
    if os.name == "posix":
        # There may be nobody left, or nobody but a process that has ended and was not asked for its status.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()


def ran(*command: str, status: int | None = 0, **options: Any) -> subprocess.CompletedProcess[str]:
    """What a process printed that ended with this status; None stands for any."""
    with started(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options) as process:
        out, err = process.communicate(timeout=LONGEST)
    assert status in (None, process.returncode), f"status {process.returncode}\n{out[-3000:]}\n{err[-3000:]}"
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def python(*words: str, status: int | None = 0, **options: Any) -> subprocess.CompletedProcess[str]:
    """Likewise of this interpreter; the words follow its name."""
    return ran(sys.executable, *words, status=status, **options)


def at_once(commands: Iterable[Sequence[str]], **options: Any) -> list[str]:
    """What processes printed that run beside each other, all of which are read all the time."""
    commands = list(commands)
    with ThreadPoolExecutor(len(commands)) as pool:
        return [done.stdout for done in pool.map(lambda command: ran(*command, **options), commands)]


class Terminal:
    """A pseudo-terminal that is read all the time: after a few thousand bytes that nobody reads its process stops.

    Args:
        awaited: a text that `seen` waits for.
    """

    def __init__(self, awaited: str):
        import pty

        self._awaited, self._seen = awaited.encode(), threading.Event()
        self._ours, self.theirs = pty.openpty()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        shown = b""
        # Linux ends what is read of a terminal that nobody holds any more with an error.
        with suppress(OSError):
            while piece := os.read(self._ours, _PIECE):
                shown += piece
                if self._awaited in shown:
                    self._seen.set()

    def seen(self) -> bool:
        """Whether the text was written, which is waited for."""
        return self._seen.wait(LONGEST)

    def __enter__(self) -> "Terminal":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.theirs)
        self._reader.join(LONGEST)
        os.close(self._ours)
