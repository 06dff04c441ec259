"""Results as nested dictionaries, lists, numbers and names, for JSON and files."""

from dataclasses import fields
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jhd._results.outcomes import names_of


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
