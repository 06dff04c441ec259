"""Base classes of results: numbers with certified bounds, and solutions, single or in a batch.

A batch is one solution whose leaves have leading axes, as vmap returns it. It can be indexed. Its text counts the
entries that did not succeed. JSON and files hold nested dictionaries, lists, numbers and names.
"""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields
from html import escape
from types import EllipsisType
from typing import Any, NoReturn, SupportsFloat, TypeVar, cast

import equinox as eqx
import jax
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from jhd._results.display import fields_shown, is_read
from jhd._results.outcomes import RESULTS, names_of
from jhd._runtime.arrays import is_traced
from jhd._runtime.decimals import interval_text, lower_text, upper_text
from jhd._runtime.jax_internals import to_device

# Fields that a notebook shows of a solution, if it has them.
_SHOWN = (
    *("answer", "value", "distance", "lower", "upper", "error", "statistic", "maximum", "rms", "mean", "size"),
    *("optimality", "event", "direction", "witness", "point_a", "point_b", "foot", "element", "segment", "t", "result"),
)
# Functions that write the bounds among them.
_ENDS = {"lower": lower_text, "upper": upper_text}

_HOST = np.ndarray, np.generic

Index = ArrayLike | Sequence[int] | slice | EllipsisType | None
Batch = TypeVar("Batch", bound="AbstractSolution")


class AbstractResult(eqx.Module):
    """Result of an entry point, as text, as JSON and as a table in a notebook."""

    def to_dict(self) -> dict[str, object]:
        """The solution as nested dictionaries, lists, numbers and names.

        Returns:
            One entry for each field. Numbers that are not finite are None, and members of enumerations are names.
        """
        return to_plain(self)

    def to_json(self, **options: object) -> str:
        """The solution as JSON text: numbers that are not finite are null, members of enumerations are names.

        Args:
            options: options of json.dumps, for example indent=2.

        Returns:
            The JSON text of `to_dict`.
        """
        return json.dumps(self.to_dict(), **cast(dict[str, Any], options))

    def _repr_html_(self) -> str:
        """The solution in a notebook: a table of its numbers; for a batch the printed text."""
        if not is_read(self) or _batch_shape(self) or np.ndim(getattr(self, "lower", 0)):
            return f"<pre>{escape(repr(self))}</pre>"
        known = {name: getattr(self, name, None) for name in _SHOWN}
        rows = {name: _cell(name, value) for name, value in known.items() if value is not None}
        cells = "".join(f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in rows.items() if text)
        picture = getattr(getattr(self, "shape", None), "_repr_svg_", lambda: None)() or ""
        return f"<table><caption>{type(self).__name__}</caption>{cells}</table>{picture}"

    def __format__(self, spec: str) -> str:
        """The certified bounds in a number format, lower rounded down and upper rounded up; without a format the text.

        A Deviation shows its mean, as `float` does, and a FitSolution its statistic or its error.

        Raises:
            TypeError: the solution has no bounds of one number, or it is traced.
        """
        if not spec:
            return str(self)
        bounded = _bounded(self)
        lower, upper = (getattr(bounded, name, np.empty(2)) for name in _ENDS)
        if is_traced(lower, upper) or np.ndim(lower) or np.ndim(upper):
            raise TypeError(
                f"a number format needs one number; this {type(self).__name__} holds several, none or a tracer."
            )
        return interval_text(lower, upper, spec)

    def _compared(self, other: object) -> NoReturn:
        # Bounds may overlap, so there is no order.
        numbers = [name for name in _SHOWN[:8] if not isinstance(getattr(self, name, ""), str | None)]
        ask = f"compare its {' or '.join(numbers)}; for distances use hausdorff_at_most or minimum_at_most"
        raise TypeError(f"a {type(self).__name__} is not a number: {ask}.")

    __lt__ = __le__ = __gt__ = __ge__ = _compared


class AbstractBounds(AbstractResult):
    """A number with certified bounds."""

    value: eqx.AbstractVar[Array | float]
    lower: eqx.AbstractVar[Array | float]
    upper: eqx.AbstractVar[Array | float]

    def __float__(self) -> float:
        if is_traced(self.value):
            raise TypeError("the number is traced and not known yet: use its `value` instead.")
        return float(self.value)


class Bounds(AbstractBounds):
    """Certified bounds of a number.

    `float(bounds)` is the midpoint. `f"{bounds:.3f}"` shows both bounds, rounded outward.

    Args:
        lower: the lower bound.
        upper: the upper bound; inf if none is certified.
    """

    lower: float
    upper: float

    def __init__(self, lower: SupportsFloat, upper: SupportsFloat):
        self.lower, self.upper = float(lower), float(upper)

    @property
    def value(self) -> float:
        """Midpoint of the bounds; its error is at most half of `upper - lower`."""
        return 0.5 * self.lower + 0.5 * self.upper

    def __repr__(self) -> str:
        return fields_shown(self, "lower", "upper")


class AbstractOutcome(AbstractResult):
    """Result of an entry point with a code `result` that tells how it ended, or an array of codes."""

    # The field `result` is left to each class: checkers of types would take it for the first argument of all.

    @property
    def ok(self) -> Array:
        """Whether all requested bounds and conditions hold; a boolean array if there are several results."""
        return _result(self) == RESULTS.successful


class AbstractSolution(AbstractOutcome):
    """Result of an entry point, single or a batch. The batch axes are the axes of `result`."""

    def __getitem__(self: Batch, index: Index | tuple[Index, ...]) -> Batch:
        """Entries of a batch, by an index along its axes, as in NumPy.

        Raises:
            TypeError: the solution is not a batch.
            IndexError: the index is outside the batch.
        """
        shape, entry = _batch_shape(self), cast(Any, index)
        if not shape:
            raise TypeError(
                f"this {type(self).__name__} is a single result; only a batch, as vmap returns it, can be indexed."
            )
        if not is_traced(index):
            # NumPy raises an error for an index that is out of range; JAX would take the nearest entry.
            np.empty(shape, bool)[entry]
        if is_traced(self, entry):
            return jax.tree_util.tree_map(lambda x: x[entry], self)
        # On the host, where nothing is compiled.
        return on_device(jax.tree_util.tree_map(lambda x: np.asarray(x)[entry], self))


def stored_fields(value: eqx.Module) -> list[str]:
    """The names of the fields of a result in files and JSON."""
    return [field.metadata.get("name", field.name) for field in fields(value) if field.metadata.get("stored", True)]


def to_plain(value: Any) -> Any:
    """A result as nested dictionaries, lists, numbers and names, ready for JSON; non-finite numbers become None."""
    if hasattr(value, "_enumeration"):  # a member of an enumeration is a Module too
        names = names_of(value)
        return names if isinstance(names, str) else np.reshape(names, value._value.shape).tolist()
    if isinstance(value, eqx.Module):
        return {name: to_plain(getattr(value, name)) for name in stored_fields(value)}
    if isinstance(value, dict):
        return {name: to_plain(item) for name, item in value.items()}
    if isinstance(value, jax.Array | np.ndarray):
        return to_plain(np.asarray(value).tolist())
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _bounded(solution: Any) -> Any:
    """The part of a solution whose bounds a number format shows."""
    found = [x for name in ("mean", "statistic", "error") if (x := getattr(solution, name, None)) is not None]
    return found[0] if found else solution


def _result(solution: Any) -> Any:
    return getattr(solution, "result", None)


def _batch_shape(solution: Any) -> tuple[int, ...]:
    return np.shape(getattr(_result(solution), "_value", 0))


def _cell(name: str, value: Any) -> str:
    """The text of a value: a number in full, a bound rounded outward, the point of a witness, or a result code."""
    if hasattr(value, "_enumeration"):
        return names_of(value)
    if hasattr(value, "point"):
        return f"at {_cell('point', value.point)}"
    if isinstance(value, AbstractResult):
        return " to ".join(_cell(end, getattr(value, end)) for end in _ENDS if getattr(value, end, None) is not None)
    numbers = np.asarray(value)
    if numbers.ndim == 0:
        return _ENDS.get(name, repr)(numbers.item())
    return f"({', '.join(f'{x:.9g}' for x in numbers.tolist())})" if numbers.ndim == 1 else ""


def on_device(solution: Any) -> Any:
    """The solution with JAX arrays instead of NumPy arrays."""
    leaves, structure = jax.tree_util.tree_flatten(solution)
    return jax.tree_util.tree_unflatten(structure, leaves_on_device(leaves))


def leaves_on_device(leaves: list[Any]) -> list[Any]:
    """The leaves of a tree with JAX arrays instead of NumPy arrays."""
    places = [k for k, leaf in enumerate(leaves) if isinstance(leaf, _HOST)]
    for k, leaf in zip(places, to_device([leaves[k] for k in places]), strict=True):
        leaves[k] = leaf
    return leaves


def shown_many(solution: Any, name: str) -> str | None:
    """A batch or an unknown solution in two lines: the range of the numbers with this name, and counts of failures.

    None for a single solution, which prints itself.
    """
    kind, numbers, shape = type(solution).__name__, getattr(solution, name), _batch_shape(solution)
    if numbers is None or not is_read(solution):
        return f"{kind}({name}={eqx.tree_pformat(numbers)},\n  traced: known at run time)"
    if not shape:
        return None
    numbers, padded = np.asarray(numbers), getattr(solution, "valid", None)
    numbers = numbers if padded is None else numbers[np.asarray(padded)]
    span = ""
    if numbers.size:
        span = f", {name} from {lower_text(np.min(numbers), '.9g')} to {upper_text(np.max(numbers), '.9g')}"
    counts = Counter(names_of(solution.result))
    total, good = counts.total(), counts.pop("successful", 0)
    why = ", ".join(f"{count} {end}" for end, count in counts.most_common())
    ended = "all successful" if good == total else f"{total - good} of {total} not successful: {why}"
    return f"{kind}(batch of {' x '.join(map(str, shape))}{span},\n  {ended}; index it)"
