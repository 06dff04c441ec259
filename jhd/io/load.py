"""One text to one shape: what the command line and scripts hand in."""

import re
from collections.abc import Callable
from pathlib import Path

from jhd.io.clouds import CLOUD_SUFFIXES, load_points
from jhd.io.curves import CURVE_KINDS
from jhd.io.described import load_described
from jhd.io.errors import ParseError, read_bytes
from jhd.io.iges import IGES_SUFFIXES, load_iges, united
from jhd.io.meshes import MESH_SUFFIXES, load_mesh
from jhd.io.outlines import outline, parse_font_spec
from jhd.io.ply import read_ply
from jhd.io.polygons import mesh_of
from jhd.io.surfaces import SURFACE_KINDS
from jhd.io.svg import path, read_svg
from jhd.shapes.curve import AbstractCurve, BezierSegments
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch

_PATH_DATA = re.compile(r"\s*[Mm][\s]*[-+.\d]")
_ACCEPTED = (
    "a curve is a .json or .svg file, font:NAME:LETTER, or SVG path data (M0 0 ...); a parametric surface is a "
    f".json or .igs file; a mesh is a file {', '.join(MESH_SUFFIXES[:-1])} or {MESH_SUFFIXES[-1]}; points are a file "
    f"{', '.join(CLOUD_SUFFIXES)}, or .ply without faces"
)


def load_shape(text: str | Path) -> AbstractCurve | AbstractPatch | TriangleMesh:
    """The shape that the text names: a file, a letter of a font, or SVG path data itself.

    Args:
        text: `NAME.json` (a curve or a parametric surface, see `load_curve` and `load_surface`), `NAME.svg` (all that
            it draws), `NAME.igs` or `.iges` (all its B-spline curves, or all its surfaces, see `load_iges`), a mesh
            file (see `load_mesh`), points (see `load_points`; a .ply file without faces too), `font:NAME:LETTER`, or
            path data. A text that ends as a file name is one, and so is a Path.

    Raises:
        FileNotFoundError: a file that does not exist.
        ParseError: a file or path data that cannot be read, with its place.
        ValueError: another suffix, or nothing of these.
    """
    text = str(text)
    if text.startswith("font:"):
        return outline(*parse_font_spec(text))
    suffix = Path(text).suffix.lower()
    if suffix in _READERS:
        return _READERS[suffix](text)
    if _PATH_DATA.match(text):
        return path(text)
    raise _refusal(text, suffix)


def _json_shape(file: str) -> AbstractCurve | AbstractPatch:
    return load_described("shape", file, {**CURVE_KINDS, **SURFACE_KINDS})


def _iges_shape(file: str) -> AbstractCurve | AbstractPatch:
    """The only shape of a file, or all of them as one where all are curves or all are surfaces."""
    found = load_iges(file)
    curves = [shape for shape in found if isinstance(shape, AbstractCurve)]
    surfaces = [shape for shape in found if isinstance(shape, AbstractPatch)]
    if curves and surfaces:
        counts = f"{len(curves)} curve{'s' * (len(curves) > 1)} and {len(surfaces)} surface{'s' * (len(surfaces) > 1)}"
        raise ParseError(f"holds {counts}; load_iges gives them one by one.", file)
    return found[0] if len(found) == 1 else united(found)


def _ply_shape(file: str) -> BezierSegments | TriangleMesh:
    """The mesh, or where there are no faces the points."""
    found = read_ply(file, read_bytes(file))
    return mesh_of(file, found) if len(found.sizes) else load_points(file)


_READERS: dict[str, Callable[[str], AbstractCurve | AbstractPatch | TriangleMesh]] = {
    **dict.fromkeys(MESH_SUFFIXES, load_mesh),
    **dict.fromkeys(CLOUD_SUFFIXES, load_points),
    ".json": _json_shape,
    ".svg": read_svg,
    **dict.fromkeys(IGES_SUFFIXES, _iges_shape),
    ".ply": _ply_shape,
}
SHAPE_SUFFIXES = tuple(_READERS)


def _refusal(text: str, suffix: str) -> Exception:
    try:
        exists = Path(text).is_file()
    except (OSError, ValueError):
        # A name that is too long, or holds a null character.
        exists = False
    if exists:
        return ParseError(f"the suffix is {suffix!r}; {_ACCEPTED}.", text)
    return FileNotFoundError(f"{text}: no such file; {_ACCEPTED}.")
