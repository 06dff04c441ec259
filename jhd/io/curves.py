"""Curves as JSON: one object with a `type` and the arrays that its constructor takes, points as rows.

| type | keys (optional ones in brackets) |
|---|---|
| `BezierCurve` | `control_points`, [`weights`] |
| `BSplineCurve` | `control_points`, `knots`, [`weights`], [`periodic`] |
| `BezierSegments` | `control_points`, [`weights`], [`following`] |
| `polyline` | `points`, [`closed`] |
| `points` | `points` |
| `circle` | `centre`, `radius` |

A key `comment` is allowed everywhere. The last three are conveniences for files written by hand; what is saved is one
of the first three. Floats are written so that the same floats are read back.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jhd.io.errors import ParseError, read_text
from jhd.shapes.bezier import BezierCurve
from jhd.shapes.bspline import BSplineCurve
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve, circle, points, polyline


class _Kind(NamedTuple):
    build: Callable[..., AbstractCurve]
    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()


_KINDS = {
    "BezierCurve": _Kind(BezierCurve, ("control_points",), ("weights",)),
    "BSplineCurve": _Kind(BSplineCurve, ("control_points", "knots"), ("weights", "periodic")),
    "BezierSegments": _Kind(BezierSegments, ("control_points",), ("weights", "following")),
    "polyline": _Kind(polyline, ("points",), ("closed",)),
    "points": _Kind(points, ("points",)),
    "circle": _Kind(circle, ("centre", "radius")),
}
_FLAGS = ("closed", "periodic")


def curve_to_dict(curve: AbstractCurve) -> dict[str, Any]:
    """The curve as JSON can hold it: its type and its arrays as nested lists; keys without a value are left out.

    Raises:
        TypeError: not a curve of a type that files hold.
    """
    check_curve("curve", curve)
    name = type(curve).__name__
    if name not in _KINDS:
        raise TypeError(f"curve is a {name}; files hold {', '.join(list(_KINDS)[:3])}.")
    kind = _KINDS[name]
    fields = {key: getattr(curve, key) for key in (*kind.needed, *kind.optional)}
    return {"type": name} | {
        key: value if isinstance(value, bool) else np.asarray(value).tolist()
        for key, value in fields.items()
        if value is not None
    }


def curve_from_dict(content: Any) -> AbstractCurve:
    """The curve that such a dictionary describes; see the table of this module.

    >>> curve_from_dict({"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]], "closed": True}).segments().count
    3

    Raises:
        TypeError: not a dictionary.
        ValueError: no or an unknown type, a key that is missing or unknown, and whatever the constructor refuses.
    """
    if not isinstance(content, Mapping):
        raise TypeError(f"A curve is a JSON object with a key 'type'; got {type(content).__name__}.")
    if "type" not in content:
        raise ValueError(f"The key 'type' is missing; needs one of {', '.join(_KINDS)}.")
    name = content["type"]
    if not isinstance(name, str) or name not in _KINDS:
        raise ValueError(f"type is {name!r}; needs one of {', '.join(_KINDS)}.")
    kind = _KINDS[name]
    given = {key: value for key, value in content.items() if key not in ("type", "comment") and value is not None}
    _check_keys(name, kind, given)
    positional = [given.pop(key) for key in kind.needed]
    try:
        return kind.build(*positional, **given)
    except TypeError as error:
        raise ValueError(str(error)) from error


def _check_keys(name: str, kind: _Kind, given: Mapping[str, Any]) -> None:
    for key in kind.needed:
        if key not in given:
            raise ValueError(f"{name} has no key {key!r}; needs {', '.join(kind.needed)}.")
    known = (*kind.needed, *kind.optional)
    for key, value in given.items():
        if key not in known:
            raise ValueError(f"{name} has an unknown key {key!r}; known are {', '.join(known)}.")
        if key in _FLAGS and not isinstance(value, bool):
            raise ValueError(f"{key} is {value!r}; needs true or false.")


def save_curve(file: str | Path, curve: AbstractCurve) -> None:
    """Writes the curve as JSON, one key a line.

    Raises:
        TypeError: not a curve of a type that files hold.
    """
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in curve_to_dict(curve).items()]
    Path(file).write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def load_curve(file: str | Path) -> AbstractCurve:
    """The curve in a JSON file.

    Raises:
        FileNotFoundError: there is no such file.
        ParseError: text that is no JSON, with line and column; or JSON that is no curve, with the file and the key.
    """
    text = read_text(file)
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise ParseError(f"JSON: {error.msg}.", file, error.lineno, error.colno) from error
    try:
        return curve_from_dict(content)
    except (TypeError, ValueError) as error:
        raise ParseError(str(error), file) from error
