"""Executables kept between processes: their names, and their conversion to files and back.

An executable is read without tracing, so its name must cover everything that tracing and compilation depend on: the
function and the source of this package, the kinds and structure of the arguments, the settings and versions of the
compiler, and the processor. A function that cannot be named uniquely is not kept. Neither is an executable with calls
to anything but LAPACK: a callback is an address in the process that created it.
"""

import enum
import functools
import hashlib
import os
import pickle
import platform
import re
import sys
import time
import types
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jaxlib
import lineax as lx
import numpy as np
import optimistix as optx
from jax.experimental import serialize_executable

from jhd._runtime import storage
from jhd._runtime.jax_internals import has_lapack, is_missing_field, prepare_lapack, settings

_PACKAGE, _FOLDER = "jhd", os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
# Source changed after this time differs from the source that this process runs.
_STARTED = time.time()
# Packages whose classes may occur in a structure: their versions, and the source of this package, are in a name.
_KNOWN = ("jhd", "jax", "jaxlib", "equinox", "lineax", "optimistix", "numpy", "builtins")
# The methods by which a class defines how its objects are pickled.
_PICKLED = {"__reduce__", "__reduce_ex__", "__getnewargs__", "__getnewargs_ex__"}
# Python prints an object without its own text with an address, which differs in each process.
_ADDRESS = re.compile(r" at 0x[0-9a-f]+>")
# Settings that change no executable.
_ASIDE = re.compile(
    "jax_(enable_|raise_)?(compilation|persistent)_cache|jax_log|jax_debug_log|jax_explain|jax_traceback"
)
# The lines of /proc/cpuinfo that identify the processor, on x86 and on ARM.
_PROCESSOR = re.compile(r"^(?:vendor_id|cpu family|model|model name|flags|Features|CPU \w+)\s*:.*$", re.MULTILINE)
# Functions that compiled code may call: parts of XLA itself, and LAPACK, which must be looked up first.
_INSIDE, _LAPACK = ("TopK",), "lapack_"
# First bytes of code on Linux and macOS. Executables that JAX read from its own cache lack them and are not kept.
_CODE = b"\x7fELF", b"\xcf\xfa\xed\xfe"
_TARGETS = re.compile(r'custom_call_target="([^"]*)"')


# Reasons why no executable of a function was kept, by the name of the function, for `jhd doctor`.
refused: dict[str, str] = {}

# The last constants of each module, and their hash.
_LAST: dict[str, tuple[list[Any], str]] = {}


class NotKeptError(Exception):
    """An object without a text that identifies it in every process."""


def is_ours(function: Callable[..., Any]) -> bool:
    """Whether a function is the object that this package defines under its name."""
    module = getattr(function, "__module__", None) or ""
    if module.partition(".")[0] != _PACKAGE:
        return False
    named = vars(sys.modules[module]).get(getattr(function, "__qualname__", ""))
    while named is not None and named is not function:
        named = getattr(named, "__wrapped__", None)
    return named is function


def name_of_program(function: Callable[..., Any], tree: Any, kinds: Any, context: Any, options: Any) -> str:
    """A text that identifies an executable uniquely.

    Args:
        function: a function of this package, see `is_ours`.
        tree: the structure of its arguments.
        kinds: shape, type and weakness of each array.
        context: the settings on which a trace depends, as given by JAX.
        options: compile-time constants and compiler options.

    Raises:
        NotKeptError: there is no such text.
    """
    asked = [
        f"{function.__module__}.{function.__qualname__}",
        _structure(tree),
        *map(_plain, (kinds, context, options)),
    ]
    # The settings of the process; a thread may have others.
    known = settings()
    if not known:
        raise NotKeptError("the settings of JAX")
    asked_for = sorted((key, value) for key, value in known.items() if not _ASIDE.match(key))
    current = [f"{key}={getattr(jax.config, key, value)!r}" for key, value in asked_for]
    for text in current:
        if _ADDRESS.search(text):
            raise NotKeptError(text)
    return "\n".join([*asked, *_surroundings(), _constants(function.__module__), *current])


def load(name: str, device: Any) -> tuple[Callable[..., Any], Any] | None:
    """The executable of a name, from flat arguments to flat results, and their structure; None if there is none."""
    folder = storage.programs_folder()
    body = None if folder is None else storage.read(folder, short_name(name))
    if body is None:
        return None
    try:
        known, count, targets, example, payload = pickle.loads(zlib.decompress(body))
        if known != name:
            return None
        if any(target.startswith(_LAPACK) for target in targets):
            prepare_lapack()
        # A structure cannot be pickled (equinox marks a missing field by object identity), but an example of it can.
        given, made = (((0,) * count, {}), jax.tree_util.tree_structure(example))
        run = serialize_executable.deserialize_and_load(
            payload,
            jax.tree_util.tree_structure(given),
            jax.tree_util.tree_structure([0] * made.num_leaves),
            backend=device.client,
            execution_devices=[device],
        )
    except Exception:  # if it cannot be read for any reason, it can be compiled
        return None
    return run, made


def store(name: str, run: Any, made: Any) -> bool:
    """Store an executable from flat arguments to flat results and the structure of these; return whether it could."""
    folder = storage.programs_folder()
    if folder is None:
        return False
    try:
        targets = sorted(set(_TARGETS.findall(run.as_text())))
        if not all(target in _INSIDE or (has_lapack and target.startswith(_LAPACK)) for target in targets):
            return False
        example = jax.tree_util.tree_unflatten(made, [0] * made.num_leaves)
        if jax.tree_util.tree_structure(pickle.loads(pickle.dumps(example))) != made:
            return False
        payload, given, _ = serialize_executable.serialize(run)
        if not any(mark in payload for mark in _CODE):
            return False
        body = pickle.dumps((name, given.num_leaves, targets, example, payload))
    except Exception:  # this version of JAX cannot write it
        return False
    return storage.write(folder, short_name(name), zlib.compress(body, 1))


def short_name(name: str) -> str:
    """The name of the file of an executable: the name of its function, and a hash."""
    function = name.partition("\n")[0].rpartition(".")[2].strip("_")
    return f"{function}-{hashlib.sha256(name.encode()).hexdigest()[:40]}"


def _structure(tree: Any) -> str:
    node = tree.node_data()
    if node is None:
        return "*"
    inner = ",".join(map(_structure, tree.children()))
    return f"{_class(node[0])}({_plain(node[1])})[{inner}]"


def _plain(value: Any) -> str:
    """Return a text that identifies a value uniquely.

    A class that defines how its objects are pickled (`__reduce__`, `__getnewargs__`) names all parts of its objects.
    The default object of a class stands for the class: JAX and equinox have single objects for absent values.

    Raises:
        NotKeptError: if there is no such text.
    """
    if value is None or isinstance(value, bool | int | float | str | bytes) and type(value).__module__ == "builtins":
        return f"{type(value).__name__}:{value!r}"
    if isinstance(value, type):
        return _class(value)
    if isinstance(value, jax.tree_util.PyTreeDef):
        return f"structure:{_structure(value)}"
    if isinstance(value, np.dtype):
        return f"dtype:{value.str}:{value.name}"
    if type(value) in (tuple, list, dict, set, frozenset):
        items: Any = value
        parts = [_plain(x) for x in (items.items() if type(value) is dict else items)]
        return f"{type(value).__name__}({','.join(sorted(parts) if isinstance(value, set | frozenset) else parts)})"
    if isinstance(value, enum.Enum):
        return f"{_class(type(value))}.{value.name}"
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return f"{_class(type(value))}({','.join(map(_plain, value))})"
    if isinstance(value, types.FunctionType) and is_ours(value):
        return f"function:{value.__module__}.{value.__qualname__}:{_constants(value.__module__)}"
    return _object(value)


def _object(value: Any) -> str:
    kind = type(value)
    if is_missing_field(value) or _is_default(value):
        return _class(kind)
    made = _pickled(value)
    if isinstance(made, tuple):
        return f"{_class(kind)}{_plain(tuple(made[1:]))}"
    raise NotKeptError(f"{kind.__name__} {value!r}")


def _pickled(value: Any) -> Any:
    """Return how pickle recreates the value; None if its class does not define it, or its objects change."""
    try:
        hash(value)
        explicit = any(vars(base).keys() & _PICKLED for base in type(value).__mro__[:-1])
        return value.__reduce_ex__(4) if explicit else None
    except Exception:
        return None


def _is_default(value: Any) -> bool:
    """Return whether a class of JAX's gives this very object if it is called without arguments."""
    kind = type(value)
    if kind.__module__.partition(".")[0] != "jax":
        return False
    try:
        return kind() is value
    except Exception:  # a class that needs arguments
        return False


def _class(kind: type) -> str:
    name = f"{kind.__module__}.{kind.__qualname__}"
    if kind.__module__.partition(".")[0] not in _KNOWN:
        raise NotKeptError(name)
    found: Any = sys.modules.get(kind.__module__)
    for part in kind.__qualname__.split("."):
        found = getattr(found, part, None)
    if found is not kind and kind is not type(None):
        raise NotKeptError(name)
    return name


@functools.cache
def _surroundings() -> tuple[str, ...]:
    """Texts for everything on which all executables of this process depend."""
    packages = jax, jaxlib, eqx, lx, optx, np
    device = jax.devices()[0]
    return (
        _source(),
        " ".join(f"{package.__name__} {package.__version__}" for package in packages),
        f"{sys.version} {platform.machine()} {sys.byteorder}",
        processor(),
        # The number of threads, into which work may be cut.
        str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        f"{device.platform} {device.device_kind} {device.client.platform_version}",
        str(os.getenv("XLA_FLAGS")),
    )


def _source() -> str:
    """A hash of the source of this package.

    Raises:
        NotKeptError: the source cannot be read, or has changed since this process started.
    """
    files = _files()
    if not files or any(os.stat(file).st_mtime > _STARTED for file in files):
        raise NotKeptError("source")
    return source_sum()


def source_sum() -> str:
    """A hash of the current source files of this package."""
    total = hashlib.sha256()
    for file in _files():
        with open(file, "rb") as lines:
            content = lines.read()
        total.update(f"{os.path.relpath(file, _FOLDER)} {len(content)}\n".encode())
        total.update(content)
    return total.hexdigest()


def _files() -> list[str]:
    # Paths as texts take a fifth of the time of objects.
    rows = [os.path.join(folder, name) for folder, _, names in os.walk(_FOLDER) for name in names]
    return sorted(row for row in rows if row.endswith(".py"))


def processor() -> str:
    """A text that identifies the instructions of the processor; the name of the machine if the system has none."""
    try:
        lines = sorted(set(_PROCESSOR.findall(Path("/proc/cpuinfo").read_text())))
    except OSError:
        lines = []
    return "; ".join(lines) if lines else f"{platform.node()} {platform.processor()}"


def _constants(module: str) -> str:
    """A hash of the current constants of a module and of all modules it uses, as a user may have changed one."""
    slots = _slots(module)
    values = [names.get(key) for names, key in slots]
    last = _LAST.get(module)
    # The same objects compare at once.
    if last is None or last[0] != values:
        texts = [f"{key}={_constant(value)}" for (_, key), value in zip(slots, values, strict=True)]
        last = _LAST[module] = values, hashlib.sha256("\n".join(texts).encode()).hexdigest()
    return last[1]


@functools.cache
def _slots(module: str) -> list[tuple[dict[str, Any], str]]:
    """The names of constants and functions in a module of this package and in all modules its names lead to."""
    found, ahead = {module: None}, [module]
    while ahead:
        for value in list(vars(sys.modules[ahead.pop()]).values()):
            name = value.__name__ if isinstance(value, types.ModuleType) else getattr(value, "__module__", None)
            if isinstance(name, str) and name.startswith(f"{_PACKAGE}.") and name in sys.modules and name not in found:
                found[name] = None
                ahead.append(name)
    # The modules that keep executables do not affect them, and differ from process to process.
    spaces = [vars(sys.modules[name]) for name in found if name not in (__name__, storage.__name__)]
    return [(names, key) for names in spaces for key in sorted(names) if _is_constant(key, names[key])]


def _is_constant(key: str, value: Any) -> bool:
    if key.startswith("__") or type(value) not in (bool, int, float, str, tuple, types.FunctionType):
        return False
    try:
        _constant(value)
    except NotKeptError:
        return False
    return True


def _constant(value: Any) -> str:
    function = isinstance(value, types.FunctionType)
    return f"{value.__module__}.{value.__qualname__}" if function else _plain(value)
