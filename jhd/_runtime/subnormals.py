"""Arithmetic of the host with subnormal numbers, in threads of XLA too, which take them for zero."""

import ctypes
import functools
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# More bytes than the floating-point state of a thread takes on any system.
_STATE = 256


@contextmanager
def subnormals_kept() -> Iterator[None]:
    """In this block, and in threads that it starts, operations of NumPy keep subnormal numbers.

    The state of the thread is as before afterwards. Systems whose C library does not change it are left as they are.
    """
    functions = _functions()
    if functions is None:
        yield
        return
    save, restore, usual = functions
    state = ctypes.create_string_buffer(_STATE)
    save(state)
    restore(usual)
    try:
        yield
    finally:
        restore(state)


@functools.cache
def _functions() -> tuple[Any, Any, Any] | None:
    """Functions of the C library that save and restore the state of a thread, and the state that threads begin with."""
    try:
        library = ctypes.CDLL(None)
        save, restore = library.fegetenv, library.fesetenv
        if sys.platform == "linux":
            usual = ctypes.c_void_p(-1)
        elif sys.platform == "darwin":
            usual = ctypes.c_void_p(ctypes.addressof(ctypes.c_char.in_dll(library, "_FE_DFL_ENV")))
        else:
            return None
    except (OSError, AttributeError, TypeError, ValueError):
        return None
    return save, restore, usual
