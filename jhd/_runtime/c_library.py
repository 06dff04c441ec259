"""Calls of the C library of this process: memory is given back, and arithmetic of the host keeps subnormal numbers."""

import ctypes
import functools
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# More bytes than the floating-point state of a thread takes on any system.
_STATE = 256


def give_back() -> None:
    """Free memory that the C library holds goes to the system: half of the hundred megabytes a program takes to make.

    Done by the GNU library, a few milliseconds; others need no asking, or cannot be asked.
    """
    trim = _function("malloc_trim")
    if trim is not None:
        trim(0)


@contextmanager
def subnormals_kept() -> Iterator[None]:
    """In this block, and in threads that it starts, operations of NumPy keep subnormal numbers.

    Threads of XLA take them for zero. Afterwards the thread is as before. Only on Linux and macOS.
    """
    save, restore, usual = _function("fegetenv"), _function("fesetenv"), _usual_state()
    if save is None or restore is None or usual is None:
        yield
        return
    state = ctypes.create_string_buffer(_STATE)
    save(state)
    restore(usual)
    try:
        yield
    finally:
        restore(state)


@functools.cache
def _function(name: str) -> Any:
    """A function of the C library of this process, None where it has none of this name."""
    library = _library()
    return None if library is None else getattr(library, name, None)


@functools.cache
def _usual_state() -> Any:
    """The floating-point state that threads begin with (FE_DFL_ENV); None where it is not known."""
    if sys.platform == "linux":
        return ctypes.c_void_p(-1)
    if sys.platform != "darwin":
        return None
    try:
        return ctypes.byref(ctypes.c_char.in_dll(_library(), "_FE_DFL_ENV"))
    except (ValueError, TypeError):
        return None


@functools.cache
def _library() -> Any:
    try:
        return ctypes.CDLL(None)
    except (OSError, TypeError):  # Windows has no such handle
        return None
