"""Programs compiled quickly, and not more of them than a process can hold."""

import functools
import gc
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakSet

import jax
import jax.numpy as jnp
from jax.core import eval_context

from jhd.arrays import is_traced

_R = TypeVar("_R")

# XLA's newer fusion emitters for CPUs make an object of its own of every loop: twice the time to compile and four times
# the memory mappings, for programs that run no faster here (measured with jaxlib 0.10.2).
_QUICK = {"xla_cpu_use_fusion_emitters": False}
# Linux ends a process at its limit of mappings, by a crash; code takes some hundreds of them for each program.
_MAPPINGS, _LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_SHARE = 0.75

_programs: WeakSet[Any] = WeakSet()


def compiled(function: Callable[..., _R], static: tuple[int, ...] = (), *, quick: bool = True) -> Callable[..., _R]:
    """jax.jit for what is called from the host: quick to compile; inside another trace it is traced like any other.

    Arguments at the positions named `static` are constants of the program. Loops over large arrays can run twice as
    fast where they are compiled with all that XLA has: `quick=False`.

    Where the process comes near the number of memory mappings that the system allows it, all programs made here are
    dropped, to be compiled again (or read from the persistent cache) when they are wanted.
    """
    inner, known = jax.jit(function, static_argnums=static), 0

    @functools.cache
    def outer() -> Any:
        program = jax.jit(function, static_argnums=static, compiler_options=_options() if quick else None)
        _programs.add(program)
        return program

    @functools.wraps(function)
    def call(*args: Any) -> _R:
        nonlocal known
        # Options are allowed to the outermost jit only, and a number made inside a trace is traced.
        if is_traced(args, jnp.zeros(())):
            return inner(*args)
        program = outer()
        # Known numbers need nothing of a derivative that is being taken around this call, which costs milliseconds.
        with eval_context():
            result = program(*args)
        if program._cache_size() != known:
            make_room()
            known = program._cache_size()
        return result

    return call


def make_room() -> None:
    """Drops the compiled programs if the process is near the system's limit of memory mappings."""
    try:
        limit = int(_LIMIT.read_text())
        with _MAPPINGS.open("rb") as lines:
            count = sum(1 for _ in lines)
    except OSError:  # not Linux: no such limit
        return
    if count > _SHARE * limit:
        for program in _programs:
            program.clear_cache()
        gc.collect()


@functools.cache
def _options() -> dict[str, Any] | None:
    """The options, where this version of XLA has them."""
    try:
        jax.jit(lambda x: x, compiler_options=_QUICK)(0.0)
    except jax.errors.JaxRuntimeError:
        return None
    return _QUICK
