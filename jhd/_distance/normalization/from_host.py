"""Host searches inside compiled functions: under jit, vmap and grad they are called back from there.

The search is not differentiated; derivatives are attached to its result outside, by the rules for known shapes. The
searches of a batch run one after the other.

A search computes on a device of its own (`host_device`): the compiled function that waits for it may occupy all threads
of its device. JAX would choose the function's device, and what runs on a chosen device is not kept on disk.
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jhd._runtime.jax_internals import host_device


def from_host(function: Callable[..., Any], like: Any, *arguments: Any) -> Any:
    """What a function of known arrays gives, where the arrays are traced.

    Args:
        function: takes the arguments with NumPy arrays in place of tracers; its answer is a function of them alone.
        like: shapes and types of its answer, as jax.ShapeDtypeStruct.
        arguments: pytrees of arrays.
    """
    device = host_device()

    def known(*values: Any) -> Any:
        with jax.default_device(device):
            found = function(*jax.tree_util.tree_map(np.asarray, values))
        return jax.tree_util.tree_map(lambda x, s: np.asarray(x, s.dtype).reshape(s.shape), found, like)

    return jax.pure_callback(known, like, *jax.lax.stop_gradient(arguments), vmap_method="sequential")
