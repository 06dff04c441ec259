"""What commands share: the word that something lasts, seconds, JSON, the exit status, and what the program runs on."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from shutil import get_terminal_size
from typing import Any

import jax

import jhd
from jhd.report import progress_text, successful
from jhd.solution import to_plain


def print_json(solution: Any, content: Any = None, **context: Any) -> None:
    """Prints the result as `jhd.io.save_result` writes it, so that `jhd.io.load_result` reads it; or content for it."""
    context |= {"version": jhd.__version__, "device": device(), "precision": precision()}
    plain = to_plain(solution) if content is None else content
    stored = {"type": type(solution).__name__, "solution": plain, "context": context}
    print(json.dumps(stored, indent=2, allow_nan=False))


def exit_status(*solutions: Any) -> int:
    """The exit status: 0 where all were reached as asked for."""
    return 0 if all(successful(solution) for solution in solutions) else 1


def timed(action: Callable[[], Any]) -> tuple[Any, float]:
    """What the action returns, when all of it has been computed, and the seconds that took."""
    start = time.perf_counter()
    value = jax.block_until_ready(action())
    return value, time.perf_counter() - start


@contextmanager
def busy(message: str) -> Iterator[Callable[[Any], None]]:
    """Shows the message while the block runs, and the progress handed to what it yields; on a terminal only."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return

    start = time.perf_counter()

    def show(text: str) -> None:
        told = text and f"{text}, {time.perf_counter() - start:.0f} s"
        # A line that does not fit would be broken, and its first part stay.
        print(f"\r\x1b[K{told[: get_terminal_size().columns - 1]}", end="", file=sys.stderr, flush=True)

    show(f"{message} ...")
    try:
        yield lambda progress: show(progress if isinstance(progress, str) else progress_text(progress))
    finally:
        show("")


def device() -> str:
    """The name of the device that programs run on."""
    return jax.devices()[0].device_kind


def precision() -> str:
    """The precision of all numbers."""
    return "float64" if jax.config.jax_enable_x64 else "float32"  # pyright: ignore[reportAttributeAccessIssue]
