"""Checks of control points, weights and parameters, common to all curves and parametric surfaces."""

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import Array
from typing_extensions import TypeAliasType

from jhd._runtime.arrays import is_traced, module_of, real_array
from jhd._shapes.foreign import ConvertsToArray

# Nested to the depth of the control points of patches. Text is a sequence of text, so the alias must not be recursive.
Row = Array | np.ndarray | Sequence[ArrayLike]
Table = Array | np.ndarray | ConvertsToArray | Sequence[Row]
Numbers = TypeAliasType("Numbers", ArrayLike | Row | Table | Sequence[Table] | Sequence[Sequence[Table]])
"""Numbers as functions take them: a number, an array, or lists of these, up to four deep."""


def check_control_points(control_points: Array, weights: Array | None, axes: tuple[str, ...]) -> None:
    """Raise ValueError unless the arrays have these axes, two or three coordinates and positive weights to match.

    Args:
        control_points: their coordinates.
        weights: one for each point, or None.
        axes: names; the last one is "dim", or "3" if the points must be in space.
    """
    shape = control_points.shape
    if len(shape) != len(axes):
        raise ValueError(f"control_points has shape {shape}; needs ({', '.join(axes)}).")
    if 0 in shape:
        raise ValueError(f"control_points is empty: its shape is {shape}.")
    dims = (3,) if axes[-1] == "3" else (2, 3)
    if shape[-1] not in dims:
        turned = f" Its shape is {shape}; points are rows: pass its transpose?" if shape[-2] in (2, 3) else ""
        needed = " or ".join(map(str, dims))
        raise ValueError(f"control_points has {shape[-1]} coordinates a point; needs {needed}.{turned}")
    if weights is None:
        return
    if weights.shape != shape[:-1]:
        came = f"{weights.size} entries" if weights.ndim == 1 and len(axes) == 2 else _count(weights.shape)
        raise ValueError(f"weights has {came}; control_points has {_count(shape[:-1])} points.")
    if is_traced(weights):
        return
    bad = np.argwhere(np.asarray(weights) <= 0)
    if bad.size:
        place = tuple(int(i) for i in bad[0])
        value = float(np.asarray(weights)[place])
        raise ValueError(f"weights[{', '.join(map(str, place))}] is not positive: {value:g}.")
    least, most = (float(f(np.asarray(weights))) for f in (np.min, np.max))
    limit = largest_weight_ratio(weights.dtype)
    if most / limit > least:
        raise ValueError(f"weights range from {least:g} to {most:g}; their ratio must be at most {limit:g}.")


def checked_net(control_points: Numbers, weights: Numbers | None, axes: tuple[str, ...]) -> tuple[Array, Array | None]:
    """Control points and their weights as arrays, checked by `check_control_points`."""
    points = real_array("control_points", control_points)
    given = None if weights is None else real_array("weights", weights)
    check_control_points(points, given, axes)
    return points, given


def checked_points(points: Numbers, dim: int = 3) -> Array:
    """Points as an array (..., dim).

    Raises:
        TypeError: not real numbers.
        ValueError: not finite, empty, or with another number of coordinates.
    """
    queries = real_array("points", points)
    if queries.ndim == 0 or queries.shape[-1] != dim:
        raise ValueError(f"points has shape {queries.shape}; needs (..., {dim}).")
    if queries.size == 0:
        raise ValueError(f"points is empty: its shape is {queries.shape}.")
    return queries


def check_same_dim(a: int, b: int) -> None:
    """Raise ValueError unless points of both shapes have equally many coordinates."""
    if a != b:
        raise ValueError(f"a has {a} coordinates a point and b has {b}; needs the same.")


def check_degrees(dtype: DTypeLike, *degrees: int) -> None:
    """Raise ValueError if a degree exceeds the largest one for which functions are compiled."""
    # Binomials of twice that are far from overflow.
    limit = 128 if np.dtype(dtype).itemsize >= 8 else 32
    if max(degrees) > limit:
        raise ValueError(
            f"the degree is {max(degrees)}; must be at most {limit}: approximate the shape in a lower degree."
        )


def largest_weight_ratio(dtype: DTypeLike) -> float:
    """Largest ratio of the weights of a curve: bounds meet its fourth power, which must stay a normal number."""
    return 1e50 if np.dtype(dtype).itemsize >= 8 else 1e9


def _count(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) if shape else "no axis"


def optional_array(name: str) -> Callable[[Numbers | None], Array | None]:
    """A converter for a field that holds an array or None."""

    def converted(value: Numbers | None) -> Array | None:
        return None if value is None else real_array(name, value)

    return converted


def checked_between(name: str, t: Numbers, lower: ArrayLike, upper: ArrayLike) -> Array:
    """The scalar t as an array; ValueError unless it lies strictly between the bounds; tracers pass."""
    value = real_array(name, t)
    if value.ndim:
        raise ValueError(f"{name} has shape {value.shape}; needs a scalar.")
    if is_traced(t, lower, upper):
        return value
    # From t and not from the array, which is a tracer inside a compiled function.
    number, low, high = (float(np.asarray(x)) for x in (t, lower, upper))
    if not low < number < high:
        raise ValueError(f"{name} is {number:g}; needs {low:g} < {name} < {high:g}.")
    return value


def checked_parameter(name: str, t: Numbers) -> Array:
    """Parameters of a Bezier segment as an array; ValueError unless all are in [0, 1]; tracers pass."""
    value = real_array(name, t)
    if not is_traced(value) and not bool(jnp.all((value >= 0) & (value <= 1))):
        raise ValueError(f"{name} is {np.asarray(value)}; needs 0 <= {name} <= 1.")
    return value


def usable_numbers(control_points: Any, weights: Any) -> Any:
    """Whether points are finite, and weights finite, positive and within the largest ratio; NumPy or JAX arrays."""
    xp: Any = module_of(control_points)
    good = xp.all(xp.isfinite(control_points))
    if weights is None:
        return good
    least, most = xp.min(weights), xp.max(weights)
    return good & (least > 0) & (most < xp.inf) & (most / largest_weight_ratio(weights.dtype) <= least)


def empty_surface(name: str = "") -> ValueError:
    """The error to raise for an implicit surface without points in its box; `name` is its name in a pair."""
    of = f"{name}: " if name else ""
    return ValueError(f"{of}the surface is empty: the polynomial is proven to have no zero in the box.")
