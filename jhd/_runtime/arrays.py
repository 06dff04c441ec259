"""Checks of user input (real, finite arrays, with messages that name the input), and tables of arrays."""

import numbers
import operator
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import Array

from jhd._runtime.jax_internals import is_batch, is_trace_clean, to_device, varying_axes

Rows = TypeVar("Rows", bound=tuple)
Values = TypeVar("Values")

# How frames and tensors of other packages become arrays: their methods, and the calls.
_CONVERSIONS = {"to_numpy": "to_numpy()", "detach": "detach().cpu().numpy()", "numpy": "numpy()"}


def is_traced(*values: object) -> bool:
    """Whether any leaf is a tracer, so that its values are not known yet."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree_util.tree_leaves(values))


def is_tracing(*values: object) -> bool:
    """Whether any leaf is a tracer, or operations on known numbers are traced too, as inside jit."""
    # Asking JAX takes a hundredth of the time of an operation.
    return not is_trace_clean() and is_traced(values, jnp.zeros(()))


def array_of(values: ArrayLike, dtype: DTypeLike | None = None) -> Array:
    """`jnp.asarray` that compiles nothing for NumPy arrays; JAX would compile a function for each shape."""
    if isinstance(values, np.ndarray | np.generic) and not is_tracing():
        # Without warnings of NumPy: callers, who know the name of the array, refuse numbers that are not finite.
        with np.errstate(invalid="ignore", over="ignore"):
            return to_device([np.asarray(values, dtype)])[0]
    return jnp.asarray(values, dtype=dtype)


def undifferentiated(values: Values) -> Values:
    """The values without their derivatives: tracers through `stop_gradient`, known ones as they are.

    Under a trace every operation gives a tracer, even `stop_gradient` of known arrays; these must stay known.
    """
    return jax.tree_util.tree_map(lambda x: jax.lax.stop_gradient(x) if isinstance(x, Tracer) else x, values)


def bound(values: Values) -> Values:
    """The values, with a copy of each array that vmap batches.

    A NumPy constant that is batched inside jit becomes a tracer that functions with custom derivatives refuse.
    """
    return jax.tree_util.tree_map(lambda x: jnp.copy(x) if is_batch(x) else x, values)


def on_host(*arrays: Any) -> tuple[Any, ...]:
    """Known arrays as NumPy arrays, so that moving their rows compiles nothing.

    If one is traced, or lies on a device that the user has chosen, all are returned unchanged.
    """
    if is_tracing(*arrays) or any(getattr(x, "committed", False) for x in arrays):
        return arrays
    return tuple(None if x is None else np.asarray(x) for x in arrays)


def same_arrays(a: Any, b: Any) -> bool:
    """Whether two trees of arrays are known and equal, number by number."""
    (first, structure), (second, other) = (jax.tree_util.tree_flatten(x) for x in (a, b))
    if structure != other or is_traced(first, second):
        return False
    if not all(isinstance(x, np.ndarray | jax.Array | float | int) for x in (*first, *second)):
        return False
    return all(np.array_equal(x, y) for x, y in zip(first, second, strict=True))


def module_of(x: Any) -> Any:
    """NumPy for NumPy arrays, else jax.numpy: for formulas used on the host and in compiled functions."""
    return np if isinstance(x, np.ndarray) else jnp


def varying(values: Any, *sources: object) -> Any:
    """The values, marked under shard_map as varying over all device axes over which one of the sources varies.

    A loop keeps the marks of its start, so a constant start needs the marks of the arrays used in the loop.
    """
    axes = frozenset().union(*(varying_axes(x) for x in jax.tree_util.tree_leaves(sources) if isinstance(x, Tracer)))
    if not axes:
        return values

    def marked(x: Any) -> Array:
        lacking = tuple(axes - varying_axes(x))
        return jax.lax.pcast(x, lacking, to="varying") if lacking else x

    return jax.tree_util.tree_map(marked, values)


def in_chunks(function: Callable[[Any], Any], rows: Any, chunk: int) -> Any:
    """Apply the function to every row (first axis of all leaves), in batches of `chunk` rows.

    Rows are repeated up to whole chunks: a remainder would be compiled a second time.
    """
    count = jax.tree_util.tree_leaves(rows)[0].shape[0]
    if count <= chunk:
        return jax.vmap(function)(rows)
    index = np.minimum(np.arange(-(-count // chunk) * chunk), count - 1).reshape(-1, chunk)
    found = jax.lax.map(jax.vmap(function), jax.tree_util.tree_map(lambda x: x[index], rows))
    return jax.tree_util.tree_map(lambda x: x.reshape((-1, *x.shape[2:]))[:count], found)


def bare_array(name: str, value: Any) -> np.ndarray:
    """A value as a NumPy array; masks, units, data frames and tensors are refused, whose meaning would be dropped.

    An array of NumPy is copied: its owner may change it, and arrays of JAX on CPUs share memory with it if they can.

    Raises:
        TypeError: a table or tensor of another package, or an array with masked entries, or rows of which one is such.
        ValueError: an array with a unit; ragged nesting.
    """
    several = value if isinstance(value, list | tuple) else (value,)
    kinds = set(map(type, several))
    for kind in kinds:
        _check_foreign(name, kind)
    for rows in several if any(issubclass(kind, np.ndarray) for kind in kinds) else ():
        if isinstance(rows, np.ma.MaskedArray) and np.ma.is_masked(rows):
            count = int(np.ma.count_masked(rows))
            raise TypeError(f"{name} has a mask with {count} hidden entries; remove them first (np.ma.compress_rows).")
        unit = getattr(rows, "unit", getattr(rows, "units", None)) if isinstance(rows, np.ndarray) else None
        if unit is not None:
            raise ValueError(f"{name} has the unit {unit}, which is not read; pass the numbers without the unit.")
    try:
        return np.asarray(value) if isinstance(value, jax.Array) else np.array(value)
    except ValueError as error:
        raise ValueError(f"{name} must be a rectangular array of numbers; its rows differ in length.") from error


def _check_foreign(name: str, kind: type) -> None:
    """Raise TypeError, with the conversion to call, for a table or tensor whose columns have names or a gradient."""
    if issubclass(kind, np.ndarray | np.generic | jax.Array | list | tuple | float | int):
        return
    for method, call in _CONVERSIONS.items():
        if hasattr(kind, method):
            whole = f"{kind.__module__.partition('.')[0]}.{kind.__qualname__}"
            raise TypeError(f"{name} is a {whole}, not an array; pass its {call}.")


def real_array(name: str, value: Any) -> Array:
    """The value as a floating-point array of the default precision; tracers and derivatives pass through.

    Raises:
        TypeError: not numbers, complex ones, a mask, or a table or tensor of another package.
        ValueError: ragged nesting, a unit, or an entry that is not finite (not checked under tracing).
    """
    if isinstance(value, Tracer):
        if jnp.issubdtype(value.dtype, jnp.complexfloating):
            raise TypeError(f"{name} must be real numbers; its dtype is {value.dtype}.")
        return value.astype(float)
    if is_traced(value):
        return jnp.asarray(value, dtype=float)
    if isinstance(value, str):
        raise TypeError(f"{name} is {value!r}; needs {number_instead(name, value)}.")
    given = bare_array(name, value)
    if given.dtype.kind not in "fiub" and given.dtype.name != "bfloat16":
        raise TypeError(f"{name} must be real numbers; its dtype is {given.dtype}.")
    # An array of ours already: making another one costs more than all of the checks.
    kept = isinstance(value, jax.Array) and value.dtype == jnp.result_type(float)
    array = value if kept else array_of(given, float)
    check_finite(name, array)
    return array


def number_instead(name: str, text: str) -> str:
    """The number to pass instead of a text, in words."""
    if not text.endswith("%"):
        return "numbers"
    share = f"{text[:-1]} / 100"
    if name == "rtol":
        return f"a number: {share}"
    return f"a number; for the diagonal of the box of a shape: {share} * np.linalg.norm(np.subtract(*shape.bounds))"


def check_finite(name: str, array: ArrayLike) -> None:
    """Raise ValueError naming the first row that holds a NaN or an infinity; tracers pass."""
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


def check_scalar(name: str, value: Array | None, *, positive: bool = False) -> None:
    """Raise ValueError unless the array is one number of at least 0, or above it; None and values of tracers pass."""
    if value is None:
        return
    if value.shape != ():
        raise ValueError(f"{name} has shape {value.shape}; needs a scalar.")
    if is_traced(value):
        return
    if not (float(value) > 0 if positive else float(value) >= 0):
        needed = "positive number" if positive else "number of at least 0"
        raise ValueError(f"{name} is {float(value):g}; needs a {needed}.")


def check_whole(name: str, value: object, least: int) -> None:
    """Raise ValueError unless the value is an int of at least this size."""
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} is {value!r}; needs a whole number of at least {least}.")


def whole(name: str, value: object, least: int) -> int:
    """A whole number, of NumPy's types too, as an int; ValueError for anything else and below the least."""
    number = int(value) if isinstance(value, numbers.Integral) and not isinstance(value, bool) else value
    check_whole(name, number, least)
    return cast(int, number)


def whole_between(name: str, value: object, least: int, most: int) -> int:
    """The value as a whole number from `least` to `most`; TypeError if it is none, ValueError out of the range."""
    try:
        number = operator.index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        raise TypeError(f"{name} must be a whole number; got {type(value).__name__}.") from None
    if not least <= number <= most:
        raise ValueError(f"{name} is {number}; needs {least} to {most}.")
    return number


def positive(name: str, value: Any) -> float:
    """The value as a positive, finite number."""
    number = real_array(name, value)
    check_scalar(name, number, positive=True)
    return float(number)


def one_of(name: str, value: Any, names: Sequence[str]) -> Any:
    """The value; ValueError unless it is one of these names."""
    if value not in names:
        raise ValueError(f"{name} is {value!r}; needs one of {', '.join(map(repr, names))}.")
    return value


def taken(table: Rows, rows: Any) -> Rows:
    """Some rows of a table: of a NamedTuple of arrays whose first axes agree, of such tables, and of None."""
    return jax.tree_util.tree_map(lambda x: x[rows], table)


def joined(tables: Sequence[Rows]) -> Rows:
    """The rows of some tables of one type, one table after the other, on the host."""
    return jax.tree_util.tree_map(lambda *x: np.concatenate(x), *tables)
