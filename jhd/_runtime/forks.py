"""Refusal to compute in processes forked from one that has used JAX: there JAX would wait forever."""

import os

from jhd._runtime.jax_internals import is_initialized

_MESSAGE = (
    "this process was forked from one in which JAX had computed, so the threads that JAX waits for are missing. Start "
    'processes by multiprocessing.get_context("spawn") or set_start_method("spawn"), or fork before JAX computes.'
)
_forked = False


def check_process() -> None:
    """Raise RuntimeError if this process was forked after a computation of JAX, as computations would never end."""
    if _forked:
        raise RuntimeError(_MESSAGE)


def _after_fork() -> None:
    global _forked
    _forked = _forked or is_initialized()


if hasattr(os, "register_at_fork"):  # POSIX
    os.register_at_fork(after_in_child=_after_fork)
