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
    """Return free memory of the C library to the system: half of the hundred megabytes used for a compilation.

    Takes a few milliseconds with the GNU library; does nothing with others.
    """
    trim = _function("malloc_trim")
    if trim is not None:
        trim(0)


@contextmanager
def subnormals_kept() -> Iterator[None]:
    """Keep subnormal numbers in NumPy operations in this block and in threads that it starts.

    Threads of XLA take subnormal numbers for zero. Afterwards the thread is as before. Only on Linux and macOS.
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
    """The function of this name in the C library of this process, or None."""
    library = _library()
    return None if library is None else getattr(library, name, None)


@functools.cache
def _usual_state() -> Any:
    """The initial floating-point state of threads (FE_DFL_ENV); None if it is not known."""
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
