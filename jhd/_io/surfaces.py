"""Parametric surfaces as JSON, in the format of curves: one object with a `type` and the arrays of its constructor.

| type | keys (optional ones in brackets) |
|---|---|
| `BezierPatch` | `control_points` (rows, columns, 3), [`weights`] (rows, columns) |
| `BSplineSurface` | `control_points` (rows, columns, 3), `knots_u`, `knots_v`, [`weights`] (rows, columns) |
| `BezierPatches` | `control_points` (patches, rows, columns, 3), [`weights`] (patches, rows, columns) |

`knots_u` belong to the rows. Degrees follow from the numbers of knots, rows and columns. A key `comment` is always
allowed. Floats are written so that the same floats are read back.
"""

from collections.abc import Mapping
from pathlib import Path

from jhd._io.described import DescribedKind, Kinds, built, check_suffix, described, load_described, save_described
from jhd._io.iges import IGES_SUFFIXES
from jhd._io.iges_writer import save_iges
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.patch import AbstractPatch, BezierPatch, BezierPatches

SURFACE_KINDS: Kinds = {
    "BezierPatch": DescribedKind(BezierPatch, ("control_points",), ("weights",)),
    "BSplineSurface": DescribedKind(BSplineSurface, ("control_points", "knots_u", "knots_v"), ("weights",)),
    "BezierPatches": DescribedKind(BezierPatches, ("control_points",), ("weights",)),
}


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
    return described(surface, SURFACE_KINDS[name])


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
    return built("surface", content, SURFACE_KINDS)


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
    if check_suffix("surface", file, (".json", *IGES_SUFFIXES)) == ".json":
        save_described(file, content)
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
