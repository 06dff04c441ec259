"""Results in files: JSON to read, npz to compute with.

Both hold three things: `type`, the name of the result's class; `solution`, its fields; `context`, what the caller adds
(seed, versions, device, command). JSON writes numbers that are not finite as null; npz keeps them, and keeps arrays.
Enumerations are stored by the names of their members, fields without a value are null in JSON and absent in npz.
"""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from jhd._results.solution import stored_fields, to_plain
from jhd._runtime.archives import read_arrays
from jhd._runtime.files import replace_file
from jhd.io.errors import ParseError, read_text, shown

# Keys of nested fields are joined by it in npz files.
_JOIN = "."


def save_result(file: str | Path, solution: eqx.Module, /, **context: Any) -> None:
    """Writes a result, for example a `HausdorffSolution` or a batch of them, as JSON or npz by the suffix of the file.

    Args:
        file: ends in .json or .npz.
        solution: any result of this package.
        context: numbers, texts, lists and dictionaries to keep beside it.

    Raises:
        TypeError: the solution is no result, or an entry of the context is nothing that JSON can hold.
        ValueError: another suffix.
    """
    suffix = _suffix(file)
    if not isinstance(solution, eqx.Module):
        raise TypeError(f"solution must be a result of this package; got {type(solution).__name__}.")
    name = type(solution).__name__
    plain_context = {key: _plain(key, value) for key, value in context.items()}
    if suffix == ".json":
        content = {"type": name, "solution": _plain("solution", solution), "context": plain_context}
        replace_file(file, json.dumps(content, indent=2, allow_nan=False) + "\n")
        return
    arrays = {"type": np.array(name), "context": np.array(json.dumps(plain_context))}
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays, **_flatten("solution", solution))
    replace_file(file, stream.getvalue())


def load_result(file: str | Path) -> dict[str, Any]:
    """What `save_result` wrote: a dictionary of `type`, `solution` and `context`.

    Returns:
        `solution` as a nested dictionary: of numbers, names and lists from JSON, of NumPy arrays from npz.

    Raises:
        FileNotFoundError: there is no such file.
        ParseError: the file is damaged, or holds something else.
        ValueError: a suffix other than .json and .npz.
    """
    content = _load_json(file) if _suffix(file) == ".json" else _load_npz(file)
    missing = {"type", "solution", "context"} - content.keys()
    if missing:
        raise ParseError(f"is no saved result: it has no {sorted(missing)[0]!r}.", file)
    return content


def _suffix(file: str | Path) -> str:
    suffix = Path(file).suffix.lower()
    if suffix not in (".json", ".npz"):
        raise ValueError(f"{file}: the suffix is {suffix!r}; results are stored as .json or .npz.")
    return suffix


def _plain(name: str, value: Any) -> Any:
    """The value as JSON can hold it; numbers that are not finite become None."""
    if _is_member(value):
        return _names(value).tolist()
    if isinstance(value, eqx.Module):
        return {field: _plain(f"{name}.{field}", getattr(value, field)) for field in stored_fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(f"{name}[{key!r}]", item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(f"{name}[{index}]", item) for index, item in enumerate(value)]
    if isinstance(value, Path):
        return str(value)
    plain = to_plain(np.asarray(value) if isinstance(value, np.generic) else value)
    if plain is None or isinstance(plain, str | bool | int | float | list):
        return plain
    raise TypeError(f"{name} is a {type(value).__name__}; needs numbers, texts, lists, dictionaries or arrays.")


def _flatten(name: str, value: Any) -> dict[str, np.ndarray]:
    """Arrays by joined names; settings that are no arrays as arrays too."""
    if value is None:
        return {}
    if _is_member(value):
        return {name: _names(value)}
    if isinstance(value, eqx.Module):
        value = {field: getattr(value, field) for field in stored_fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        value = value._asdict()  # pyright: ignore[reportAttributeAccessIssue]
    elif isinstance(value, tuple | list) and any(isinstance(entry, tuple | list | eqx.Module) for entry in value):
        value = dict(enumerate(value))
    if isinstance(value, Mapping):
        parts = [_flatten(f"{name}{_JOIN}{key}", item) for key, item in value.items()]
        return {key: array for part in parts for key, array in part.items()}
    array = np.asarray(value)
    if array.dtype == object:
        raise TypeError(f"{name} is a {type(value).__name__}; npz files hold arrays, numbers and names.")
    return {name: array}


def _is_member(value: Any) -> bool:
    """Whether it is a member of an enumeration, or a batch of members; equinox makes them Modules too."""
    return hasattr(value, "_enumeration")


def _names(members: Any) -> np.ndarray:
    """The names of a batch of members, in its shape."""
    by_index = {int(member._value): name for name, member in members._enumeration._name_to_item.items()}
    values = np.asarray(members._value)
    return np.array([by_index[int(index)] for index in values.ravel()]).reshape(values.shape)


def _load_json(file: str | Path) -> dict[str, Any]:
    try:
        content = json.loads(read_text(file))
    except json.JSONDecodeError as error:
        raise ParseError(f"JSON: {error.msg}.", file, error.lineno, error.colno) from error
    except (ValueError, RecursionError) as error:
        raise ParseError(f"JSON: {shown(str(error), 100)}.", file) from None
    if not isinstance(content, dict):
        raise ParseError("is no saved result: it is no JSON object.", file)
    return content


def _load_npz(file: str | Path) -> dict[str, Any]:
    try:
        content = _nested(read_arrays(file))
        for key, read in (("type", str), ("context", lambda text: json.loads(str(text)))):
            if key in content:
                content[key] = read(content[key])
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: no such file.") from None
    except (ValueError, RecursionError) as error:
        raise ParseError(f"is no npz file of a result: {shown(str(error), 200)}", file) from error
    return content


def _nested(arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The arrays in nested dictionaries, by the parts of their names."""
    content: dict[str, Any] = {}
    for joined, array in arrays.items():
        *parents, last = joined.split(_JOIN)
        place = content
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise ValueError(f"{joined!r} is inside of what is an array itself.")
        if last in place:
            raise ValueError(f"{joined!r} is an array and holds others.")
        place[last] = array
    return content
