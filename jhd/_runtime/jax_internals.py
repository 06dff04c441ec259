"""All uses of interfaces of JAX and equinox that are not public, each in one function.

Every function states its behavior in a version without the interface. No numerical result of this package depends on
these interfaces: only the cache between processes, early refusals, and the time of a call.
"""

import copyreg
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jax._src import config as _config
from jax._src import core as _core
from jax._src import layout as _layout
from jax._src import xla_bridge as _bridge
from jax._src.interpreters import batching as _batching
from jax._src.interpreters import pxla as _pxla
from jax.sharding import SingleDeviceSharding

try:
    from jaxlib.xla_client import batched_device_put as _batched_device_put
except ImportError:
    _batched_device_put: Any = None
try:
    from jaxlib.xla_client import make_cpu_client as _make_cpu_client
except ImportError:
    _make_cpu_client: Any = None
try:
    from jaxlib import lapack as _lapack
except ImportError:
    _lapack: Any = None

# An executable that is read from disk must refer to the single object for "any layout", or JAX takes its results for
# arrays of another kind and compiles every function again to which they are passed (seen in 0.12.0.1).
_any_layout = getattr(_layout, "AutoLayout", None)
if _any_layout is not None:
    copyreg.pickle(type(_any_layout), lambda _: "AutoLayout")

# All of this was tested with jax 0.10.2 and 0.12.0.1, and equinox 0.13.8.

# The settings that a trace depends on besides its arguments, as a tuple. None if JAX does not say: then no executable
# is kept on disk.
trace_context: Callable[[], tuple[Any, ...]] | None = getattr(_config, "trace_context", None)


def is_trace_clean() -> bool:
    """Return whether no transformation is being traced; False, the slower answer, if JAX does not say."""
    return getattr(_core, "trace_state_clean", lambda: False)()


def is_initialized() -> bool:
    """Return whether JAX has started its devices and their threads; False if JAX does not say."""
    return getattr(_bridge, "backends_are_initialized", lambda: False)()


def settings() -> Mapping[str, Any]:
    """Return all settings of JAX by name, empty if JAX does not list them: then no executable is kept on disk."""
    return getattr(jax.config, "values", None) or {}


def varying_axes(x: Any) -> frozenset[str]:
    """Return the axes of the device mesh along which an array differs under `shard_map`; empty if JAX does not say."""
    return getattr(getattr(jax.typeof(x), "manual_axis_type", None), "varying", frozenset())


def is_batch(x: Any) -> bool:
    """Return whether `x` stands for a batch under vmap; False if JAX does not say: see `bound` in _runtime.arrays."""
    return isinstance(x, getattr(_batching, "BatchTracer", ()))


def count_executables(jitted: Any) -> int:
    """Return how many executables a jitted function holds; 0 if JAX does not say."""
    return getattr(jitted, "_cache_size", lambda: 0)()


def to_device(arrays: Sequence[Any]) -> list[jax.Array]:
    """Return NumPy arrays as arrays of JAX on the default device.

    `jax.device_put`, which takes five times as long, does it under traces, and if JAX has no such interface.
    """
    device = getattr(_pxla, "get_default_device", lambda: None)()
    if _batched_device_put is None or device is None or not is_trace_clean():
        return jax.device_put(list(arrays))
    home, kinds = SingleDeviceSharding(device), [jax.typeof(x) for x in arrays]
    return [
        _batched_device_put(kind, home, [np.asarray(x, kind.dtype)], [device], False)
        for x, kind in zip(arrays, kinds, strict=True)
    ]


def is_literal(x: Any) -> bool:
    """Return whether `x` is a NumPy array in the form in which JAX passes known numbers to derivative rules."""
    return isinstance(x, np.ndarray) and hasattr(x, "weak_type")


def is_missing_field(x: Any) -> bool:
    """Return whether `x` is the single object by which equinox marks a field that has no value."""
    return type(x).__name__ == "_Missing" and type(x).__module__.startswith("equinox")


@lru_cache(maxsize=1)
def host_device() -> Any:
    """Return a CPU device for computations inside a call of the host from a compiled function.

    Such a function may occupy all threads of its device while it waits for the host. The device that is returned has
    threads of its own, and computes on the calling thread. It is the first CPU device if JAX has no such interface, and
    among several processes.
    """
    if _make_cpu_client is None or jax.process_count() > 1:
        return jax.local_devices(backend="cpu")[0]
    return _make_cpu_client(asynchronous=False, num_devices=1).devices()[0]


def prepare_lapack() -> None:
    """Look up the addresses of LAPACK, as lowering does; an executable that was read from disk needs them.

    Raises:
        ImportError: if this jaxlib has no such module; then no executable that calls LAPACK is kept on disk.
    """
    if _lapack is None:
        raise ImportError("jaxlib.lapack")
    _lapack.prepare_lapack_call("gesdd", np.dtype(np.float64))


has_lapack = _lapack is not None
