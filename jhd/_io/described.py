"""Curves and parametric surfaces as JSON: one object with a `type` and the arrays that its constructor takes.

| type | keys (optional ones in brackets) |
|---|---|
| `BezierCurve` | `control_points`, [`weights`] |
| `BSplineCurve` | `control_points`, `knots`, [`weights`], [`periodic`] |
| `BezierSegments` | `control_points`, [`weights`], [`next_segment`] |
| `polyline` | `points`, [`closed`] |
| `points` | `points` |
| `circle` | `center`, `radius` |
| `BezierPatch` | `control_points` (rows, columns, 3), [`weights`] (rows, columns) |
| `BSplineSurface` | `control_points` (rows, columns, 3), `knots_u`, `knots_v`, [`weights`] (rows, columns) |
| `BezierPatches` | `control_points` (patches, rows, columns, 3), [`weights`] (patches, rows, columns) |

Points are rows. `polyline`, `points` and `circle` are for files written by hand; saved files use the other types.
`knots_u` belong to the rows. Degrees follow from the numbers of knots, rows and columns. A key `comment` is always
allowed, and keys whose value is null count as absent. Floats are written so that the same floats are read back.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jhd._io.errors import ParseError, read_text, shown
from jhd._io.iges import IGES_SUFFIXES
from jhd._io.iges_writer import save_iges
from jhd._io.svg import load_svg, save_svg
from jhd._runtime.files import replace_file
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd._shapes.patch import AbstractPatch, BezierPatch, BezierPatches
from jhd._shapes.simple_curves import circle, point_set, polyline

_FLAGS = ("closed", "periodic")


class DescribedKind(NamedTuple):
    """A type of described objects: the constructor, its required keys in order, and its optional keys."""

    build: Callable[..., Any]
    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()


# Types by their names.
Kinds = Mapping[str, DescribedKind]

CURVE_KINDS: Kinds = {
    "BezierCurve": DescribedKind(BezierCurve, ("control_points",), ("weights",)),
    "BSplineCurve": DescribedKind(BSplineCurve, ("control_points", "knots"), ("weights", "periodic")),
    "BezierSegments": DescribedKind(BezierSegments, ("control_points",), ("weights", "next_segment")),
    "polyline": DescribedKind(polyline, ("points",), ("closed",)),
    "points": DescribedKind(point_set, ("points",)),
    "circle": DescribedKind(circle, ("center", "radius")),
}
SURFACE_KINDS: Kinds = {
    "BezierPatch": DescribedKind(BezierPatch, ("control_points",), ("weights",)),
    "BSplineSurface": DescribedKind(BSplineSurface, ("control_points", "knots_u", "knots_v"), ("weights",)),
    "BezierPatches": DescribedKind(BezierPatches, ("control_points",), ("weights",)),
}


def curve_to_dict(curve: AbstractCurve) -> dict[str, object]:
    """A dictionary of a curve for JSON: its type and its arrays as nested lists, without empty keys.

    >>> import jhd
    >>> jhd.io.curve_to_dict(jhd.BezierCurve([[0, 0], [1, 2], [2, 0]]))
    {'type': 'BezierCurve', 'control_points': [[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]]}

    Args:
        curve: a BezierCurve, a BSplineCurve or BezierSegments.

    Returns:
        A dictionary that `curve_from_dict` converts back to the same curve.

    Raises:
        TypeError: a curve of another type, or not a curve.
    """
    check_curve("curve", curve)
    name = type(curve).__name__
    if name not in CURVE_KINDS:
        raise TypeError(f"files of curves hold {', '.join(list(CURVE_KINDS)[:3])}; got {name}.")
    return _described(curve, CURVE_KINDS[name])


def curve_from_dict(content: Mapping[str, object]) -> AbstractCurve:
    """The curve that a dictionary describes: the inverse of `curve_to_dict`.

    >>> import jhd
    >>> content = {"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]], "closed": True}
    >>> jhd.io.curve_from_dict(content).segments().count
    3

    Args:
        content: a dictionary with the key `type`: "BezierCurve" (keys `control_points`, optional `weights`),
            "BSplineCurve" (also `knots`, optional `periodic`), "BezierSegments" (optional `next_segment`), "polyline"
            (`points`, optional `closed`), "points" (`points`) or "circle" (`center`, `radius`). A key `comment` is
            ignored.

    Returns:
        The curve.

    Raises:
        TypeError: `content` is not a dictionary.
        ValueError: the type is missing or unknown, a key is missing or unknown, or the constructor refuses a value.
    """
    return _built("curve", content, CURVE_KINDS)


def save_curve(file: str | Path, curve: AbstractCurve) -> None:
    """Write a curve to a file; the suffix selects the format.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_curve(f"{folder}/curve.json", jhd.BezierCurve([[0, 0], [1, 2], [2, 0]]))
    ...     jhd.io.load_curve(f"{folder}/curve.json").control_points.tolist()
    [[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]]

    Args:
        file: name with the suffix .json (one key per line), .svg (see `save_svg`), .igs or .iges (see `save_iges`). An
            existing file is replaced.
        curve: a BezierCurve, a BSplineCurve or BezierSegments.

    Returns:
        None.

    Raises:
        TypeError: a curve of another type, or not a curve.
        ValueError: another suffix, or a curve that the format cannot hold, for example a curve in space in SVG.
    """
    suffix = _known_suffix("curve", file, (".json", ".svg", *IGES_SUFFIXES))
    check_curve("curve", curve)
    if suffix == ".json":
        _save_json(file, curve_to_dict(curve))
    else:
        (save_svg if suffix == ".svg" else save_iges)(file, curve)


def load_curve(file: str | Path) -> AbstractCurve:
    """Load a curve from a JSON or SVG file; `load_shape` reads other formats too.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_curve(f"{folder}/corner.svg", jhd.polyline([[0, 0], [1, 0], [1, 1]]))
    ...     jhd.io.load_curve(f"{folder}/corner.svg").count
    2

    Args:
        file: name of a file written by `save_curve` or by hand (see `curve_from_dict`), or an SVG file.

    Returns:
        The curve; for SVG everything that the file draws, see `load_svg`.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: text that is not JSON, with line and column; JSON that does not describe a curve, with the key; or
            an SVG file that `load_svg` refuses.
    """
    if Path(file).suffix.lower() == ".svg":
        return load_svg(file)
    return load_described("curve", file, CURVE_KINDS)


def surface_to_dict(surface: AbstractPatch) -> dict[str, object]:
    """A dictionary of a surface for JSON: its type and its arrays as nested lists, without empty keys.

    >>> import jhd
    >>> net = [[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]]
    >>> sorted(jhd.io.surface_to_dict(jhd.BezierPatch(net)))
    ['control_points', 'type']

    Args:
        surface: a BezierPatch, a BSplineSurface or BezierPatches.

    Returns:
        A dictionary that `surface_from_dict` converts back to the same surface.

    Raises:
        TypeError: a surface of another type, or not a parametric surface.
    """
    name = type(surface).__name__
    if name not in SURFACE_KINDS:
        raise TypeError(f"files of surfaces hold {', '.join(SURFACE_KINDS)}; got {name}.")
    return _described(surface, SURFACE_KINDS[name])


def surface_from_dict(content: Mapping[str, object]) -> AbstractPatch:
    """The surface that a dictionary describes: the inverse of `surface_to_dict`.

    >>> import jhd
    >>> net = [[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]]
    >>> jhd.io.surface_from_dict({"type": "BezierPatch", "control_points": net})(0.5, 0.5).tolist()
    [1.0, 1.0, 1.0]

    Args:
        content: a dictionary with the key `type`: "BezierPatch" or "BezierPatches" (keys `control_points`, optional
            `weights`), or "BSplineSurface" (also `knots_u` and `knots_v`). A key `comment` is ignored.

    Returns:
        The surface.

    Raises:
        TypeError: `content` is not a dictionary.
        ValueError: the type is missing or unknown, a key is missing or unknown, or the constructor refuses a value.
    """
    return _built("surface", content, SURFACE_KINDS)


def save_surface(file: str | Path, surface: AbstractPatch) -> None:
    """Write a parametric surface to a file; the suffix selects the format.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> patch = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]])
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_surface(f"{folder}/patch.json", patch)
    ...     jhd.io.load_surface(f"{folder}/patch.json").degrees
    (1, 1)

    Args:
        file: name with the suffix .json (one key per line), .igs or .iges (see `save_iges`). An existing file is
            replaced.
        surface: a BezierPatch, a BSplineSurface or BezierPatches.

    Returns:
        None.

    Raises:
        TypeError: a surface of another type, or not a parametric surface.
        ValueError: another suffix.
    """
    content = surface_to_dict(surface)
    if _known_suffix("surface", file, (".json", *IGES_SUFFIXES)) == ".json":
        _save_json(file, content)
    else:
        save_iges(file, surface)


def load_surface(file: str | Path) -> AbstractPatch:
    """Load a parametric surface from a JSON file; `load_iges` and `load_shape` read IGES files.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> patch = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]])
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_surface(f"{folder}/patch.json", patch)
    ...     jhd.io.load_surface(f"{folder}/patch.json").degrees
    (1, 1)

    Args:
        file: name of a file written by `save_surface`, or by hand (see `surface_from_dict`).

    Returns:
        The surface.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: text that is not JSON, with line and column; or JSON that does not describe a surface, with the key.
    """
    return load_described("surface", file, SURFACE_KINDS)


def _described(shape: Any, kind: DescribedKind) -> dict[str, Any]:
    """The shape as JSON can hold it: its type and its arrays as nested lists; keys without a value are left out."""
    fields = {key: getattr(shape, key) for key in (*kind.needed, *kind.optional)}
    return {"type": type(shape).__name__} | {
        key: value if isinstance(value, bool) else np.asarray(value).tolist()
        for key, value in fields.items()
        if value is not None
    }


def _built(what: str, content: Any, kinds: Kinds) -> Any:
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


def _known_suffix(what: str, file: str | Path, known: tuple[str, ...]) -> str:
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


def _save_json(file: str | Path, content: Mapping[str, Any]) -> None:
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
        return _built(what, content, kinds)
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
