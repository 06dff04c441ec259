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

from pathlib import Path
from typing import Any

from jhd.io.described import DescribedKind, Kinds, built, check_suffix, described, load_described, save_described
from jhd.io.iges import IGES_SUFFIXES
from jhd.io.iges_writer import save_iges
from jhd.io.svg import read_svg, write_svg
from jhd.shapes.bezier import BezierCurve
from jhd.shapes.bspline import BSplineCurve
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve, circle, points, polyline

CURVE_KINDS: Kinds = {
    "BezierCurve": DescribedKind(BezierCurve, ("control_points",), ("weights",)),
    "BSplineCurve": DescribedKind(BSplineCurve, ("control_points", "knots"), ("weights", "periodic")),
    "BezierSegments": DescribedKind(BezierSegments, ("control_points",), ("weights", "following")),
    "polyline": DescribedKind(polyline, ("points",), ("closed",)),
    "points": DescribedKind(points, ("points",)),
    "circle": DescribedKind(circle, ("centre", "radius")),
}


def curve_to_dict(curve: AbstractCurve) -> dict[str, Any]:
    """The curve as JSON can hold it: its type and its arrays as nested lists; keys without a value are left out.

    Raises:
        TypeError: not a curve of a type that files hold.
    """
    check_curve("curve", curve)
    name = type(curve).__name__
    if name not in CURVE_KINDS:
        raise TypeError(f"curve is a {name}; files hold {', '.join(list(CURVE_KINDS)[:3])}.")
    return described(curve, CURVE_KINDS[name])


def curve_from_dict(content: Any) -> AbstractCurve:
    """The curve that such a dictionary describes; see the table of this module.

    >>> curve_from_dict({"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]], "closed": True}).segments().count
    3

    Raises:
        TypeError: not a dictionary.
        ValueError: no or an unknown type, a key that is missing or unknown, and whatever the constructor refuses.
    """
    return built("curve", content, CURVE_KINDS)


def save_curve(file: str | Path, curve: AbstractCurve) -> None:
    """Writes the curve; the suffix names the kind: .json, of one key a line, .svg, see `write_svg`, or .igs or .iges.

    Raises:
        TypeError: not a curve of a type that files hold.
        ValueError: another suffix, or a curve that such a file cannot hold, as one in space in SVG.
    """
    suffix = check_suffix("curve", file, (".json", ".svg", *IGES_SUFFIXES))
    if suffix == ".json":
        save_described(file, curve_to_dict(curve))
    elif suffix == ".svg":
        check_curve("curve", curve)
        write_svg(file, curve)
    else:
        check_curve("curve", curve)
        save_iges(file, curve)


def load_curve(file: str | Path) -> AbstractCurve:
    """The curve in a JSON file, or all that an SVG file draws; `load_shape` reads what other files hold.

    Raises:
        FileNotFoundError: there is no such file.
        ParseError: text that is no JSON, with line and column; or JSON that is no curve, with the file and the key; or
            an SVG file that `read_svg` refuses.
    """
    if Path(file).suffix.lower() == ".svg":
        return read_svg(file)
    return load_described("curve", file, CURVE_KINDS)
