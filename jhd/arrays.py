"""Checks of what a user hands in: real, finite arrays, with messages that name what came and what was needed."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array


def is_traced(*values: object) -> bool:
    """Whether any leaf is a tracer, so that its values are not known yet."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree_util.tree_leaves(values))


def real_array(name: str, value: Any) -> Array:
    """The value as a floating-point array of the default precision; tracers and derivatives pass through.

    Raises:
        TypeError: not numbers, or complex ones.
        ValueError: ragged nesting, or an entry that is not finite (not checked under tracing).
    """
    if isinstance(value, Tracer):
        if jnp.issubdtype(value.dtype, jnp.complexfloating):
            raise TypeError(f"{name} must be real numbers; its dtype is {value.dtype}.")
        return value.astype(float)
    if is_traced(value):
        return jnp.asarray(value, dtype=float)
    try:
        given = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} must be a rectangular array of numbers; its rows differ in length.") from error
    if given.dtype.kind not in "fiub" and given.dtype.name != "bfloat16":
        raise TypeError(f"{name} must be real numbers; its dtype is {given.dtype}.")
    # An array of ours already: making another one costs more than all of the checks.
    kept = isinstance(value, jax.Array) and value.dtype == jnp.result_type(float)
    array = value if kept else jnp.asarray(given, dtype=float)
    check_finite(name, array)
    return array


def check_finite(name: str, array: ArrayLike) -> None:
    """Raises ValueError naming the first row that holds a NaN or an infinity; tracers pass."""
    if is_traced(array):
        return
    values = np.asarray(array)
    finite = np.isfinite(values)
    if finite.all():
        return
    where = tuple(int(i) for i in np.argwhere(~finite)[0])
    if values.ndim == 0:
        raise ValueError(f"{name} is not finite: {float(values)}.")
    place = where if values.ndim == 1 else where[:-1]
    found = values[place]
    shown = str(float(found)) if found.ndim == 0 else "(" + ", ".join(f"{float(x):g}" for x in found) + ")"
    raise ValueError(f"{name}[{', '.join(map(str, place))}] is not finite: {shown}.")
