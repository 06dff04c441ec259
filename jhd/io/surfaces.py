"""Parametric surfaces as JSON, in the format of curves: one object with a `type` and the arrays of its constructor.

| type | keys (optional ones in brackets) |
|---|---|
| `BezierPatch` | `control_points` (rows, columns, 3), [`weights`] (rows, columns) |
| `BSplineSurface` | `control_points`, `knots_u`, `knots_v`, [`weights`], likewise; `knots_u` go with the rows |
| `BezierPatches` | `control_points` (patches, rows, columns, 3), [`weights`] (patches, rows, columns) |

Degrees are not named: they are numbers of knots - rows - 1, or rows - 1. A key `comment` is allowed everywhere. Floats
are written so that the same floats are read back.
"""

from pathlib import Path
from typing import Any

from jhd.io.described import DescribedKind, Kinds, built, check_suffix, described, load_described, save_described
from jhd.io.iges import IGES_SUFFIXES
from jhd.io.iges_writer import save_iges
from jhd.shapes.bspline_surface import BSplineSurface
from jhd.shapes.patch import AbstractPatch, BezierPatch, BezierPatches

SURFACE_KINDS: Kinds = {
    "BezierPatch": DescribedKind(BezierPatch, ("control_points",), ("weights",)),
    "BSplineSurface": DescribedKind(BSplineSurface, ("control_points", "knots_u", "knots_v"), ("weights",)),
    "BezierPatches": DescribedKind(BezierPatches, ("control_points",), ("weights",)),
}


def surface_to_dict(surface: AbstractPatch) -> dict[str, Any]:
    """The surface as JSON can hold it: its type and its arrays as nested lists; keys without a value are left out.

    Raises:
        TypeError: not a parametric surface of a type that files hold.
    """
    name = type(surface).__name__
    if name not in SURFACE_KINDS:
        raise TypeError(f"surface is a {name}; files hold {', '.join(SURFACE_KINDS)}.")
    return described(surface, SURFACE_KINDS[name])


def surface_from_dict(content: Any) -> AbstractPatch:
    """The surface that such a dictionary describes; see the table of this module.

    >>> net = [[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]]
    >>> surface_from_dict({"type": "BezierPatch", "control_points": net})(0.5, 0.5).tolist()
    [1.0, 1.0, 1.0]

    Raises:
        TypeError: not a dictionary.
        ValueError: no or an unknown type, a key that is missing or unknown, and whatever the constructor refuses.
    """
    return built("surface", content, SURFACE_KINDS)


def save_surface(file: str | Path, surface: AbstractPatch) -> None:
    """Writes the surface; the suffix names the kind: .json, of one key a line, or .igs or .iges, see `save_iges`.

    Raises:
        TypeError: not a parametric surface of a type that files hold.
        ValueError: another suffix.
    """
    content = surface_to_dict(surface)
    if check_suffix("surface", file, (".json", *IGES_SUFFIXES)) == ".json":
        save_described(file, content)
    else:
        save_iges(file, surface)


def load_surface(file: str | Path) -> AbstractPatch:
    """The parametric surface in a JSON file.

    Raises:
        FileNotFoundError: there is no such file.
        ParseError: text that is no JSON, with line and column; or JSON that is no surface, with the file and the key.
    """
    return load_described("surface", file, SURFACE_KINDS)
