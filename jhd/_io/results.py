"""Results in files: JSON for reading, npz for computing.

Both formats hold three entries: `type`, the class name of the result; `solution`, its fields; `context`, additional
data of the caller (seed, versions, device, command). JSON writes numbers that are not finite as null; npz keeps them,
and keeps arrays. Enumerations are stored by the names of their members. Fields without a value are null in JSON and
absent in npz.
"""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from jhd._io.described import load_json
from jhd._io.errors import ParseError, shown
from jhd._results.outcomes import names_of
from jhd._results.solution import stored_fields, to_plain
from jhd._runtime.archives import read_arrays
from jhd._runtime.files import replace_file

# Keys of nested fields are joined by it in npz files.
_JOIN = "."


def save_result(file: str | Path, solution: eqx.Module, /, **context: object) -> None:
    """Write a result, for example a `HausdorffSolution` or a batch of them, to a JSON or npz file.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     solution = jhd.directed_hausdorff(jhd.point_set([[0, 0]]), jhd.point_set([[3, 4]]))
    ...     jhd.io.save_result(f"{folder}/result.json", solution, seed=7)
    ...     content = jhd.io.load_result(f"{folder}/result.json")
    >>> content["solution"]["value"], content["context"]
    (5.0, {'seed': 7})

    Args:
        file: name with the suffix .json or .npz. An existing file is replaced.
        solution: a result of this package.
        context: additional numbers, texts, lists and dictionaries to store with it.

    Returns:
        None.

    Raises:
        TypeError: `solution` is not a result, or JSON cannot hold an entry of `context`.
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


def load_result(file: str | Path) -> dict[str, object]:
    """Load a result that `save_result` wrote.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     solution = jhd.directed_hausdorff(jhd.point_set([[0, 0]]), jhd.point_set([[3, 4]]))
    ...     jhd.io.save_result(f"{folder}/result.json", solution)
    ...     content = jhd.io.load_result(f"{folder}/result.json")
    >>> content["type"], content["solution"]["value"]
    ('HausdorffSolution', 5.0)

    Args:
        file: name with the suffix .json or .npz.

    Returns:
        A dictionary with the keys `type`, `solution` and `context`. `solution` is a nested dictionary: of numbers,
        names and lists from JSON, of NumPy arrays from npz.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: the file is damaged, or does not contain a result.
        ValueError: another suffix.
    """
    content = load_json(file) if _suffix(file) == ".json" else _load_npz(file)
    if not isinstance(content, dict):
        raise ParseError("is not a saved result: it is not a JSON object.", file)
    missing = {"type", "solution", "context"} - content.keys()
    if missing:
        raise ParseError(f"is not a saved result: it has no {sorted(missing)[0]!r}.", file)
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
    """Arrays by joined names; settings that are not arrays also as arrays."""
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
    """Whether the value is a member of an enumeration, or a batch of members; in equinox these are Modules, too."""
    return hasattr(value, "_enumeration")


def _names(members: Any) -> np.ndarray:
    """The names of a batch of members, in its shape."""
    return np.reshape(names_of(members), np.shape(members._value))


def _load_npz(file: str | Path) -> dict[str, Any]:
    try:
        content = _nested(read_arrays(file))
        for key, read in (("type", str), ("context", lambda text: json.loads(str(text)))):
            if key in content:
                content[key] = read(content[key])
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: no such file.") from None
    except (ValueError, RecursionError) as error:
        raise ParseError(f"is not an npz file of a result: {shown(str(error), 200)}", file) from error
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
                raise ValueError(f"{joined!r} is a part of an entry that is an array itself.")
        if last in place:
            raise ValueError(f"{joined!r} is an array and has parts.")
        place[last] = array
    return content
