"""Printed forms of objects: kinds, counts and numbers, in one line if it suffices, and never an error.

Objects pass through JAX with leaves that are not numbers (tracers, shapes, markers of JAX). They print too, without the
unknown parts.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import jax
import numpy as np

from jhd._runtime.arrays import is_traced
from jhd._runtime.decimals import lower_text, upper_text

BoundText = Callable[..., str]

_DIGITS = ".4g"
# Fields that are bounds.
_BOUNDS: dict[str, BoundText] = {"lower": lower_text, "upper": upper_text, "deviation": upper_text}


def described(thing: Any, *parts: str) -> str:
    """The name of the class of an object with the given parts in parentheses; empty parts are left out."""
    return f"{type(thing).__name__}({', '.join(part for part in parts if part)})"


def opaque(thing: Any) -> str | None:
    """The text for an object with leaves that are not numbers or arrays; None if all its leaves are."""
    leaves = jax.tree_util.tree_leaves(thing)
    known = all(hasattr(leaf, "shape") or isinstance(leaf, bool | int | float | str) for leaf in leaves)
    return None if known else described(thing, "...")


def is_read(thing: Any) -> bool:
    """Whether all leaves of an object are numbers or arrays that can be read on this host."""
    leaves = jax.tree_util.tree_leaves(thing)
    return all(is_known(leaf) or isinstance(leaf, bool | int | float | str) for leaf in leaves)


def fields_shown(thing: Any, *names: str) -> str:
    """The text of the object with the named fields that are not None."""
    pairs = ((name, getattr(thing, name)) for name in names)
    shown = (f"{name}={value_text(value, _BOUNDS.get(name))}" for name, value in pairs if value is not None)
    return opaque(thing) or described(thing, *shown)


def value_text(value: Any, bound: BoundText | None = None) -> str:
    """A value in a few characters: numbers, the sizes of long arrays, or the text of the object.

    Args:
        value: the value.
        bound: `lower_text` or `upper_text` if the entries of an array are bounds.
    """
    if not hasattr(value, "shape"):
        if isinstance(value, float):
            return f"{value:.6g}" if bound is None else bound(value)
        return repr(value)
    if is_traced(value):
        return f"traced {size_text(value.shape)}".rstrip()
    if not is_known(value) or np.size(value) > 6 or 0 in value.shape:
        return f"{size_text(value.shape)} array"
    entries, number = np.asarray(value), _number if bound is None else partial(bound, spec=_DIGITS)
    return number(entries) if entries.ndim == 0 else f"[{', '.join(map(number, entries.ravel()))}]"


def size_text(shape: Iterable[int]) -> str:
    """The lengths of axes: `4 x 3`."""
    return " x ".join(map(str, shape))


def count_text(count: int, name: str, plural: str | None = None) -> str:
    """A count with a noun: `1 segment`, `2 segments`."""
    return f"{count} {name if count == 1 else plural or name + 's'}"


def batch_text(values: Any, axes: int) -> str:
    """The size of a batch, if an array has more axes than one object has."""
    lead = values.shape[: len(values.shape) - axes]
    return f"batch of {size_text(lead)}" if lead else ""


def net_text(values: Any, weights: Any) -> str:
    """The location of control points and whether they have weights: `rational, in the plane, control points in ...`."""
    kind = "" if weights is None else "rational"
    parts = (kind, {2: "in the plane", 3: "in space"}.get(values.shape[-1], ""), box_text(values))
    return ", ".join(part for part in parts if part)


def box_text(points: Any, name: str = "box") -> str:
    """The bounding box of an array of points, whose last axis holds coordinates; empty if it is unknown."""
    if is_traced(points):
        return "traced"
    if not is_known(points) or 0 in points.shape:
        return ""
    rows = np.asarray(points).reshape(-1, points.shape[-1])
    return between_text(rows.min(axis=0), rows.max(axis=0), name)


def between_text(lower: Any, upper: Any, name: str = "box") -> str:
    """A box by two of its corners; empty for unknown corners and batches."""
    if not (is_known(lower) and is_known(upper)) or np.ndim(lower) != 1:
        return ""
    low, high = (", ".join(map(_number, np.asarray(end))) for end in (lower, upper))
    return f"{name} ({low}) to ({high})"


def most_text(name: str, bounds: Any) -> str:
    """A name followed by the largest upper bound, rounded up; empty if the bounds are unknown."""
    return f"{name} {upper_text(np.max(np.asarray(bounds)), '.6g')}" if is_known(bounds) and np.size(bounds) else ""


def is_known(value: Any) -> bool:
    """Whether the entries of an array can be read on this host."""
    if is_traced(value) or not isinstance(value, np.ndarray | np.generic | jax.Array):
        return False
    return getattr(value, "is_fully_addressable", True) and not getattr(value, "is_deleted", lambda: False)()


def _number(value: Any) -> str:
    return format(value, _DIGITS) if np.issubdtype(np.asarray(value).dtype, np.floating) else str(value)
