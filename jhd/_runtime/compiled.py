"""Functions compiled quickly, kept between processes, and limited to the number that a process can hold.

A process holds at most `MOST` executables, about 1.7 MB each. Beyond that number, the least recently called functions
lose theirs. They are read from disk, or compiled again, when the function is called again.
"""

import functools
import gc
import itertools
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakSet

import jax
import numpy as np
from jax.core import eval_context
from jax.sharding import SingleDeviceSharding
from jax.tree_util import tree_flatten, tree_unflatten

from jhd._runtime.arrays import is_tracing
from jhd._runtime.c_library import give_back
from jhd._runtime.forks import check_process
from jhd._runtime.jax_internals import count_executables, host_device, is_literal, trace_context
from jhd._runtime.memory import check_memory
from jhd._runtime.programs import NotKeptError, is_ours, load, name_of_program, refused, short_name, store
from jhd._runtime.sharding import may_be_shared, without_mesh

_R = TypeVar("_R")

# Measured with jaxlib 0.10.2, whose default level is 3. Its newer fusion emitters for CPUs make a separate object for
# every loop: twice the time to compile and four times the memory mappings, for executables that run no faster. Level 1
# saves a quarter of the rest, and is as fast except for loops over large arrays.
_EMITTERS, _LEVEL = "xla_cpu_use_fusion_emitters", "xla_backend_optimization_level"
# Cuts reductions of more than 32 numbers into windows, which become up to a thousand lines of code each: a twelfth of
# the code of a search. At level 1 they stay whole; large arrays want several threads, for which they must be cut.
_PASSES, _WINDOWS = "xla_disable_hlo_passes", "tree_reduction_rewriter"
# On Linux a process crashes at its limit of memory mappings; each executable takes some hundreds of them.
_MAPPINGS, _LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_SHARE = 0.75
# Most executables of a process: half a gigabyte. All combinations of kinds of shapes take some hundred.
MOST = 300

# Bytes of arguments above which the memory of an executable is checked: this takes a third of a millisecond.
_LARGE = 1 << 20
# Bytes that count as free without asking the system.
_ALWAYS = 1 << 28
_LESS = "fewer points or segments at once, or a smaller capacity of the method, take less"

# All objects that hold executables, and a counter that orders their calls.
_programs: WeakSet[Any] = WeakSet()
_changing = threading.Lock()
_calls = itertools.count()
# Whether searches become part of the traced function instead of calls of the host; JAX keeps a trace for each.
_in_program: Any = jax.make_user_context(False)
# Called before a function is compiled.
_permission: ContextVar[Callable[[], object] | None] = ContextVar("permission", default=None)


@contextmanager
def asking(permission: Callable[[], object]) -> Iterator[None]:
    """Call `permission` before each compilation in this block; it raises an error to forbid the compilation."""
    token = _permission.set(permission)
    try:
        yield
    finally:
        _permission.reset(token)


@contextmanager
def inline_searches(enabled: bool = True) -> Iterator[None]:
    """Compile searches into the functions that are traced in this context, instead of calling them on the host.

    On CPUs a function under `jax.jit` calls distances, their decisions, `project` and `stationary_points` on the host.
    The host keeps compiled searches on disk, and computes a batch on all cores. Use this context if the function
    must not call the host: for `jax.export`, or to keep the function in the compilation cache of JAX. Its first call
    then compiles the search, which takes about ten seconds. On GPUs searches of curves and of implicit surfaces are
    always compiled in. Meshes, parametric surfaces and mixed pairs are always searched on the host.

    A function that is called in the context and outside is traced once for each. `JHD_HOST_CALLS=0` in the environment
    has the effect of the context on the whole process.

    >>> import jax
    >>> import jhd
    >>> circle, segment = jhd.circle([0, 0], 1.0), jhd.polyline([(0, 3), (1, 3)])
    >>> with jhd.inline_searches():
    ...     value = jax.jit(lambda shape: jhd.minimum_distance(shape, segment).value)(circle)
    >>> round(float(value), 9)
    2.0

    Args:
        enabled: whether searches are compiled in; False: call the host again within an outer context.

    Returns:
        A context manager, which also serves as a decorator.
    """
    with _in_program(enabled):
        yield


def calls_host() -> bool:
    """Whether functions traced here may call kept executables on the host."""
    if _in_program.value or os.getenv("JHD_HOST_CALLS") == "0":
        return False
    return jax.default_backend() == "cpu" and jax.process_count() == 1


def _ask() -> None:
    permission = _permission.get()
    if permission is not None:
        permission()


@contextmanager
def _uncollected() -> Iterator[None]:
    """Pause garbage collection during a compilation, of which it takes a twentieth of the time."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def compiled(function: Callable[..., _R], static: tuple[int, ...] = (), *, level: int | None = 1) -> Callable[..., _R]:
    """jax.jit for functions called from the host, quick to compile; inside another trace it acts as plain jax.jit.

    Arguments at the positions in `static` are compile-time constants. Loops over large arrays can run twice as fast if
    XLA optimizes at level 3 (`optimized`) or with its defaults (None).

    On CPUs each executable of a function of this package is kept on disk (jhd._runtime.programs), and other processes
    only read it. If the process comes near the system's limit of memory mappings, all executables made here are
    dropped; they are read or compiled again when needed.
    """
    inner, plain, kept = jax.jit(function, static_argnums=static), _Plain(function, static, level), None

    @functools.wraps(function)
    def call(*args: Any) -> _R:
        nonlocal kept
        check_process()
        # Options are allowed to the outermost jit only.
        if is_tracing(*args):
            return inner(*args)
        # Known numbers need no part in an enclosing derivative, which would cost milliseconds.
        with eval_context(), without_mesh():
            if os.getenv("JHD_CACHE") == "0":
                return plain(*args)
            if kept is None:  # only here, as the function has its name by now
                keeps = trace_context is not None and is_ours(function)
                kept = _Kept(function, static, level, plain) if keeps else plain
            return kept(*args)

    return call


# For loops over large arrays.
optimized = functools.partial(compiled, level=3)


class _Plain:
    """The executables of one function as made by jit."""

    def __init__(self, function: Callable[..., Any], static: tuple[int, ...], level: int | None):
        self._made = functools.cache(lambda: jax.jit(function, static_argnums=static, compiler_options=_options(level)))
        self.count, self.last = 0, 0
        # Kinds of arguments that have been compiled; dropped executables are made again without asking permission.
        self._static, self._kinds = static, set()
        # Executables for large arguments, for which there is memory.
        self._large: dict[Any, Any] = {}
        with _changing:
            _programs.add(self)

    def __call__(self, *args: Any) -> Any:
        program, self.last = self._made(), next(_calls)
        leaves, tree = tree_flatten(tuple([x for i, x in enumerate(args) if i not in self._static]))
        kinds = (
            tree,
            tuple([(type(args[i]), args[i]) for i in self._static]),
            tuple([(np.shape(x), _type(x)) for x in leaves]),
        )
        if kinds not in self._kinds:
            _ask()
        with inline_searches():
            if sum(getattr(x, "nbytes", 0) for x in leaves) > _LARGE and not _is_watched() and _usual(leaves):
                result = self._with_room(program, kinds, leaves, args)
            else:
                result = program(*args)
        self._kinds.add(kinds)
        count = count_executables(program) + len(self._large)
        if count != self.count:
            self.count = count
            make_room()
        return result

    def _with_room(self, program: Any, kinds: Any, leaves: list[Any], args: tuple) -> Any:
        """The results, if there is memory for them, from an executable of its own, as jit would compile again."""
        key = trace_context and trace_context(), kinds, tuple([_kind(x) for x in leaves])
        run = self._large.get(key)
        if run is None:
            with _uncollected():
                run = program.lower(*args).compile()
            _check_room(run)
            self._large[key] = run
        return run(*[x for i, x in enumerate(args) if i not in self._static])

    def clear(self) -> None:
        """Drop all executables."""
        if self.count:
            program: Any = self._made()
            program.clear_cache()
            self._large.clear()
            self.count = 0


class _Kept:
    """The executables of one function by the kinds of their arguments, read from disk if kept there."""

    def __init__(self, function: Callable[..., Any], static: tuple[int, ...], level: int | None, plain: _Plain):
        self._function, self._static, self._level, self._plain = function, static, level, plain
        # Executables by quick keys of the arguments, and by names; several keys may have one name.
        self._known: dict[Any, Any] = {}
        self._named: dict[Any, Any] = {}
        self.last = 0
        self._lock = threading.RLock()
        with _changing:
            _programs.add(self)

    def __call__(self, *args: Any) -> Any:
        if _is_watched():
            return self._plain(*args)
        static, self.last = self._static, next(_calls)
        fixed = tuple([(type(args[i]), args[i]) for i in static])
        leaves, tree = tree_flatten(tuple([x for i, x in enumerate(args) if i not in static]) if static else args)
        key = (trace_context(), tree, fixed, tuple([_kind(x) for x in leaves]))  # pyright: ignore[reportOptionalCall]
        found = self._known.get(key)
        if found is not None:
            return tree_unflatten(found[1], found[0](*leaves))
        moved = [_moved(x) for x in leaves]
        if any(x is not y for x, y in zip(moved, leaves, strict=True)):
            return self(*_arguments(tree, moved, [(i, args[i]) for i in static]))
        if key in self._known or not _usual(leaves):
            self._known[key] = None
            return self._plain(*args)
        return self._first(key, leaves, args)

    def clear(self) -> None:
        """Drop all executables."""
        self._known.clear()
        self._named.clear()

    @property
    def count(self) -> int:
        """The number of executables."""
        return len(self._named)

    def _first(self, key: Any, leaves: list[Any], args: tuple) -> Any:
        """The results of the first call with a key, for which the executable is then known (None: left to jit)."""
        _, tree, fixed, _ = key
        like = [_like(x) for x in leaves]
        constants = [(i, x) for i, (_, x) in zip(self._static, fixed, strict=True)]
        device = _device()
        try:
            kinds = [(x.shape, np.dtype(x.dtype), x.weak_type) for x in like]
            # One name serves both devices, and calls in either context.
            with jax.default_device(None), inline_searches():
                context: Any = trace_context()  # pyright: ignore[reportOptionalCall]
                name = name_of_program(self._function, tree, kinds, context, (constants, self._level))
        except NotKeptError as error:
            refused[self._function.__qualname__] = str(error)
            self._known[key] = None
            return self._plain(*args)
        with self._lock:  # several threads may need one executable, which only one of them should compile
            found, results = self._named.get((name, device)), None
            if found is None:
                found, results = _tried(load(name, device), leaves)
            if found is None:
                _ask()
                found = self._compiled(name, tree, constants, like)
                store(name, *found)
                _check_room(found[0])
            self._known[key] = self._named[name, device] = found
            make_room()
        # Not within the lock: the executable may call the host, and the host this function again.
        return tree_unflatten(found[1], found[0](*leaves) if results is None else results)

    def _compiled(self, name: str, tree: Any, constants: list[tuple[int, Any]], like: list[Any]) -> tuple[Any, Any]:
        made: Any = None

        def flat(*leaves: Any) -> list[Any]:
            nonlocal made
            results, made = tree_flatten(self._function(*_arguments(tree, leaves, constants)))
            return results

        # With this name, a cache of JAX has no older version, which could not be kept here.
        flat.__name__ = short_name(name).replace("-", "_")
        program = jax.jit(flat, compiler_options=_options(self._level))
        # An executable that calls the host cannot be kept.
        with _uncollected(), inline_searches():
            return program.lower(*like).compile(), made


def _arguments(tree: Any, leaves: Any, constants: list[tuple[int, Any]]) -> list[Any]:
    """The arguments of these leaves, with constants at their positions."""
    args = list(tree_unflatten(tree, leaves))
    for i, x in constants:
        args.insert(i, x)
    return args


def _check_room(program: Any) -> None:
    """Raise MemoryError if an executable would take more memory for its arrays than is free."""
    try:
        sizes = program.memory_analysis() if jax.default_backend() == "cpu" else None
    except (jax.errors.JaxRuntimeError, NotImplementedError, AttributeError):  # not every version says
        sizes = None
    if sizes is not None:
        need = sizes.temp_size_in_bytes + sizes.output_size_in_bytes
        if need > _ALWAYS:
            check_memory(need, "this computation would take", _LESS)


def _tried(found: Any, leaves: list[Any]) -> tuple[Any, Any]:
    """An executable read from disk, and its results; None and None if it does not run, which only a call shows."""
    if found is None:
        return None, None
    _check_room(found[0])
    try:
        return found, jax.block_until_ready(found[0](*leaves))
    except jax.errors.JaxRuntimeError:
        return None, None


def _is_watched() -> bool:
    """Whether JAX checks every result for NaN or infinity; then calls are left to jit."""
    return jax.config.jax_debug_nans or jax.config.jax_debug_infs  # pyright: ignore[reportAttributeAccessIssue]


def _kind(x: Any) -> Any:
    """Key of a leaf: quick to determine, and covers all on which the executable depends."""
    of = type(x)
    if of is np.ndarray:
        return x.shape, x.dtype
    if of in (bool, int, float):
        return of
    if is_literal(x):
        return x.shape, x.dtype, x.weak_type  # pyright: ignore[reportAttributeAccessIssue]
    return (x.aval, x.sharding, x.committed) if isinstance(x, jax.Array) else (of, getattr(x, "dtype", None))


def _type(x: Any) -> Any:
    return getattr(x, "dtype", type(x))


def _usual(leaves: list[Any]) -> bool:
    """Whether all are numbers on the one device for which executables are kept, with the usual settings."""
    if jax.default_backend() != "cpu" or jax.process_count() > 1:
        return False
    if jax.config.jax_disable_jit or _chosen() not in (None, host_device()):  # pyright: ignore
        return False
    home, alone = SingleDeviceSharding(_device()), jax.device_count() == 1
    return all(_is_usual(x, home, alone) for x in leaves)


def _chosen() -> Any:
    """The device that the user has chosen for computations, if any."""
    return jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]


def _device() -> Any:
    return _chosen() or jax.devices()[0]


def _moved(x: Any) -> Any:
    """The array as one of NumPy if it lies on the device for calls of the host and is used elsewhere, or vice versa.

    Also if it lies whole on each device of a mesh with explicit axes, which a program for one device does not have.
    """
    if isinstance(x, jax.Array) and may_be_shared(x) and x.is_fully_replicated:
        return np.asarray(x)
    if not isinstance(x, jax.Array) or x.committed:
        return x
    ours = jax.devices()
    there, here = x.sharding.device_set.isdisjoint(ours), _device() not in ours
    return x if there == here else np.asarray(x)


def _is_usual(x: Any, home: Any, alone: bool) -> bool:
    if type(x) in (bool, int, float):
        return True
    if type(x) is not np.ndarray and not isinstance(x, jax.Array | np.generic) and not is_literal(x):
        return False
    number = isinstance(x.dtype, np.dtype) and x.dtype.isnative and x.dtype.kind in "biuf"
    return number and (not isinstance(x, jax.Array) or (x.sharding == home and (alone or not x.committed)))


def _like(x: Any) -> jax.ShapeDtypeStruct:
    kind = jax.typeof(x)
    # A loop returns weakly typed integers as strong ones, which should not need another executable. So functions must
    # not depend on weak types of integers, for example next to narrower ones.
    weak = kind.weak_type and not (isinstance(x, jax.Array) and kind.dtype.kind in "iu")
    return jax.ShapeDtypeStruct(kind.shape, kind.dtype, weak_type=weak)


def make_room() -> None:
    """Release memory after compiling or reading an executable, and drop surplus executables.

    Near the system's limit of memory mappings all are dropped, otherwise the least recently used ones beyond `MOST`.
    """
    give_back()
    with _changing:
        holders = sorted(_programs, key=lambda holder: holder.last)
    excess = sum(holder.count for holder in holders) - MOST
    for holder in holders:
        if excess <= 0:
            break
        excess -= holder.count
        holder.clear()
    try:
        limit = int(_LIMIT.read_text())
        with _MAPPINGS.open("rb") as lines:
            count = sum(1 for _ in lines)
    except OSError:  # not Linux: no such limit
        return
    if count > _SHARE * limit:
        for holder in holders:
            holder.clear()
        gc.collect()


@functools.cache
def _options(level: int | None) -> dict[str, Any] | None:
    """Return the compile options of a level that this version of XLA knows and that XLA_FLAGS does not set."""
    if level is None or jax.default_backend() != "cpu":
        return None
    flags = os.getenv("XLA_FLAGS", "")
    whole = [(_PASSES, _WINDOWS)] if level == 1 else []
    options = [(_EMITTERS, False), (_LEVEL, level), *whole]
    return {name: value for name, value in options if name not in flags and _is_option(name, value)}


@functools.cache
def _is_option(name: str, value: Any) -> bool:
    try:
        jax.jit(lambda x: x, compiler_options={name: value}).lower(0.0).compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True
