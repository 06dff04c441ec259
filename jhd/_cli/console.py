"""Tools for commands: progress on a terminal, times, JSON, the exit status, device and precision."""

import _thread
import json
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from shutil import get_terminal_size
from typing import Any

import jax

import jhd
from jhd._cli.report import interrupted, progress_text, successful
from jhd._results.solution import to_plain
from jhd._runtime.starting import INTERRUPTED
from jhd._runtime.storage import chosen_folder, made
from jhd.progress import Callback, Progress

# Seconds between updates of the elapsed time.
_SECOND = 1.0
# Least seconds between two reports that are shown.
_PACE = 0.1


def json_text(solution: Any, content: Any = None, **context: Any) -> str:
    """A result in the format of `jhd.io.save_result`; `content` replaces the fields of the solution."""
    context |= {"version": jhd.__version__, "device": device(), "precision": precision()}
    plain = to_plain(solution) if content is None else content
    stored = {"type": type(solution).__name__, "solution": plain, "context": context}
    return json.dumps(stored, indent=2, allow_nan=False)


def exit_status(*solutions: Any) -> int:
    """The exit status: 0 if all solutions are successful, 130 if one was interrupted, otherwise 1."""
    if any(interrupted(solution) for solution in solutions):
        return INTERRUPTED
    return 0 if all(successful(solution) for solution in solutions) else 1


def timed(action: Callable[[], Any]) -> tuple[Any, float]:
    """The value of the action, after all of it has been computed, and the elapsed seconds."""
    start = time.perf_counter()
    value = jax.block_until_ready(action())
    return value, time.perf_counter() - start


@contextmanager
def busy(message: str) -> Iterator[Callback]:
    """Show a message and the elapsed seconds while the block runs; only if standard error is a terminal.

    Yields a function that shows progress: pass it as `progress=` to any call. The seconds also count during
    compilation, which reports no progress.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return

    start, line, shown, over = time.perf_counter(), threading.Lock(), f"{message} ...", threading.Event()

    def write(text: str) -> None:
        # A line that does not fit would wrap, and its first part would stay.
        print(f"\r\x1b[K{text[: get_terminal_size().columns - 1]}", end="", file=sys.stderr, flush=True)

    def show(text: str | None = None) -> None:
        nonlocal shown
        with line:
            shown = shown if text is None else text
            if not over.is_set():
                write(f"{shown}, {time.perf_counter() - start:.0f} s")

    def tick() -> None:
        while not over.wait(_SECOND):
            show()

    show()
    threading.Thread(target=tick, daemon=True).start()
    try:
        yield lambda progress: show(progress_text(progress))
    finally:
        with line:
            over.set()
            write("")


def paced(show: Callback) -> Callback:
    """A callback that passes on at most one report in 0.1 s, for thousands of reports a second."""
    last = -_PACE

    def call(progress: Progress) -> None:
        nonlocal last
        if time.perf_counter() - last >= _PACE:
            show(progress)
            last = time.perf_counter()

    return call


@contextmanager
def interrupts_heard() -> Iterator[None]:
    """Resend any interrupt that Python drops while the block runs.

    Python drops exceptions that cannot be caught, raised in a finalizer or in a function that the garbage collector
    calls. JAX has such a function, and an interrupt that arrives during a collection is always raised there.
    """
    usual, sent = sys.unraisablehook, []

    def hook(dropped: Any) -> None:
        if not issubclass(dropped.exc_type, KeyboardInterrupt):
            usual(dropped)
            return
        # Seconds after which a dropped interrupt is sent again: by then the function that dropped it has ended.
        again = threading.Timer(0.02, _thread.interrupt_main)
        again.daemon = True
        sent.append(again)
        again.start()

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = usual
        for again in sent:
            again.cancel()


def device() -> str:
    """The name of the device that JAX uses."""
    return jax.devices()[0].device_kind


def precision() -> str:
    """The precision of all numbers: float64 or float32."""
    return "float64" if jax.config.jax_enable_x64 else "float32"  # pyright: ignore[reportAttributeAccessIssue]


def switch_cache_on() -> None:
    """Let JAX cache its compiled functions next to the cache of jhd, unless it has a cache folder already."""
    folder = chosen_folder()
    if folder is None or jax.config.jax_compilation_cache_dir:  # pyright: ignore[reportAttributeAccessIssue]
        return
    if not made(folder / "jax"):
        return
    jax.config.update("jax_compilation_cache_dir", str(folder / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
