"""Curves as JSON: one object with a `type` and the arrays that its constructor takes, points as rows.

| type | keys (optional ones in brackets) |
|---|---|
| `BezierCurve` | `control_points`, [`weights`] |
| `BSplineCurve` | `control_points`, `knots`, [`weights`], [`periodic`] |
| `BezierSegments` | `control_points`, [`weights`], [`next_segment`] |
| `polyline` | `points`, [`closed`] |
| `points` | `points` |
| `circle` | `center`, `radius` |

A key `comment` is always allowed. The last three types are for files written by hand; saved files use the first three.
Floats are written so that the same floats are read back.
"""

from collections.abc import Mapping
from pathlib import Path

from jhd._io.described import DescribedKind, Kinds, built, check_suffix, described, load_described, save_described
from jhd._io.iges import IGES_SUFFIXES
from jhd._io.iges_writer import save_iges
from jhd._io.svg import load_svg, save_svg
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd._shapes.simple_curves import circle, point_set, polyline

CURVE_KINDS: Kinds = {
    "BezierCurve": DescribedKind(BezierCurve, ("control_points",), ("weights",)),
    "BSplineCurve": DescribedKind(BSplineCurve, ("control_points", "knots"), ("weights", "periodic")),
    "BezierSegments": DescribedKind(BezierSegments, ("control_points",), ("weights", "next_segment")),
    "polyline": DescribedKind(polyline, ("points",), ("closed",)),
    "points": DescribedKind(point_set, ("points",)),
    "circle": DescribedKind(circle, ("center", "radius")),
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
    return described(curve, CURVE_KINDS[name])


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
    return built("curve", content, CURVE_KINDS)


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
    suffix = check_suffix("curve", file, (".json", ".svg", *IGES_SUFFIXES))
    if suffix == ".json":
        save_described(file, curve_to_dict(curve))
    elif suffix == ".svg":
        check_curve("curve", curve)
        save_svg(file, curve)
    else:
        check_curve("curve", curve)
        save_iges(file, curve)


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
