"""Shapes as JSON: one object with a `type` and the arrays that its constructor takes, points as rows.

`jhd._io.curves` and `jhd._io.surfaces` hold the tables of types and keys. A key `comment` is allowed everywhere, and
keys whose value is null count as absent. Floats are written so that the same floats are read back.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jhd._io.errors import ParseError, read_text, shown
from jhd._runtime.files import replace_file

_FLAGS = ("closed", "periodic")


class DescribedKind(NamedTuple):
    """A type of described objects: the constructor, its required keys in order, and its optional keys."""

    build: Callable[..., Any]
    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()


# Types by their names.
Kinds = Mapping[str, DescribedKind]


def described(shape: Any, kind: DescribedKind) -> dict[str, Any]:
    """The shape as JSON can hold it: its type and its arrays as nested lists; keys without a value are left out."""
    fields = {key: getattr(shape, key) for key in (*kind.needed, *kind.optional)}
    return {"type": type(shape).__name__} | {
        key: value if isinstance(value, bool) else np.asarray(value).tolist()
        for key, value in fields.items()
        if value is not None
    }


def built(what: str, content: Any, kinds: Kinds) -> Any:
    """The shape of one of the kinds that a dictionary describes.

    Raises:
        TypeError: not a dictionary.
        ValueError: the type is missing or unknown, a key is missing or unknown, or the constructor refuses a value.
    """
    if not isinstance(content, Mapping):
        raise TypeError(f"A {what} is a JSON object with a key 'type'; got {type(content).__name__}.")
    if "type" not in content:
        raise ValueError(f"The key 'type' is missing; needs one of {', '.join(kinds)}.")
    name = content["type"]
    if not isinstance(name, str) or name not in kinds:
        raise ValueError(f"type is {shown(name)}; needs one of {', '.join(kinds)}.")
    kind = kinds[name]
    given = {key: value for key, value in content.items() if key not in ("type", "comment") and value is not None}
    _check_keys(name, kind, given)
    positional = [given.pop(key) for key in kind.needed]
    try:
        return kind.build(*positional, **given)
    except TypeError as error:
        raise ValueError(str(error)) from error


def _check_keys(name: str, kind: DescribedKind, given: Mapping[str, Any]) -> None:
    for key in kind.needed:
        if key not in given:
            raise ValueError(f"{name} has no key {key!r}; needs {', '.join(kind.needed)}.")
    known = (*kind.needed, *kind.optional)
    for key, value in given.items():
        if key not in known:
            raise ValueError(f"{name} has an unknown key {shown(key)}; known are {', '.join(known)}.")
        if key in _FLAGS and not isinstance(value, bool):
            raise ValueError(f"{key} is {shown(value)}; needs true or false.")
        if key not in _FLAGS and _holds_boolean(value):
            raise ValueError(f"{key} holds true or false; needs numbers.")


def check_suffix(what: str, file: str | Path, known: tuple[str, ...]) -> str:
    """The suffix of a file to write, in lower case.

    Raises:
        TypeError: something else than a path.
        ValueError: another suffix.
    """
    if not isinstance(file, str | Path):
        raise TypeError(f"file is a {type(file).__name__}; pass the file first, then the {what}.")
    suffix = Path(file).suffix.lower()
    if suffix not in known:
        raise ValueError(f"the suffix of {file} is {suffix!r}; a {what} is written as {', '.join(known)}.")
    return suffix


def save_described(file: str | Path, content: Mapping[str, Any]) -> None:
    """Write a described shape as JSON, one key a line."""
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items()]
    replace_file(file, "{\n" + ",\n".join(lines) + "\n}\n")


def load_described(what: str, file: str | Path, kinds: Kinds) -> Any:
    """The shape of one of the kinds in a JSON file.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: text that is not JSON, with line and column; or JSON that does not describe such a shape, with the
            file and key.
    """
    try:
        content = load_json(file)
    except ParseError as error:
        if Path(file).suffix.lower() == ".json":
            raise
        message = f"{error.reason[:-1]}; load_shape reads formats other than JSON."
        raise ParseError(message, file, error.line, error.column) from None
    try:
        return built(what, content, kinds)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ParseError(str(error), file) from error


def load_json(file: str | Path) -> Any:
    """The content of a JSON file, in which no object has a key twice.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: text that is not JSON, with line and column.
    """
    text = read_text(file)
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except json.JSONDecodeError as error:
        raise ParseError(f"JSON: {error.msg}.", file, error.lineno, error.colno) from error
    except (ValueError, RecursionError) as error:
        # Integers of more digits than Python takes, and brackets deeper than its stack.
        raise ParseError(f"JSON: {shown(str(error), 100)}.", file) from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these keys; ValueError if one occurs twice."""
    content = dict(pairs)
    if len(content) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))
        raise ValueError(f"the key {shown(twice)} occurs twice in one object")
    return content


def _holds_boolean(value: Any) -> bool:
    """Whether a list holds true or false, at any depth."""
    waiting = [value]
    while waiting:
        entry = waiting.pop()
        if isinstance(entry, bool):
            return True
        if isinstance(entry, list | tuple):
            waiting.extend(entry)
    return False
