"""One text to one shape: what the command line and scripts hand in."""

import re
from collections.abc import Callable
from pathlib import Path

from jhd.io.clouds import CLOUD_SUFFIXES, load_points
from jhd.io.curves import load_curve
from jhd.io.errors import ParseError
from jhd.io.meshes import MESH_SUFFIXES, load_mesh
from jhd.io.outlines import outline, parse_font_spec
from jhd.io.svg import path, read_svg
from jhd.shapes.curve import AbstractCurve
from jhd.shapes.mesh import TriangleMesh

_READERS: dict[str, Callable[[str], AbstractCurve | TriangleMesh]] = {".json": load_curve, ".svg": read_svg}
_READERS |= dict.fromkeys(MESH_SUFFIXES, load_mesh) | dict.fromkeys(CLOUD_SUFFIXES, load_points)
_PATH_DATA = re.compile(r"\s*[Mm][\s]*[-+.\d]")
_ACCEPTED = (
    "a curve is a .json or .svg file, font:NAME:LETTER, or SVG path data (M0 0 ...); a mesh is a file "
    f"{', '.join(MESH_SUFFIXES[:-1])} or {MESH_SUFFIXES[-1]}; points are a file {' or '.join(CLOUD_SUFFIXES)}"
)


def load_shape(text: str) -> AbstractCurve | TriangleMesh:
    """The shape that the text names: a curve or mesh file, a letter of a font, or SVG path data itself.

    Args:
        text: `NAME.json` (see `load_curve`), `NAME.svg` (all that it draws), a mesh file (see `load_mesh`),
            points (see `load_points`), `font:NAME:LETTER`, or path data. A text that ends as a file name is one.

    Raises:
        FileNotFoundError: a file that does not exist.
        ParseError: a file or path data that cannot be read, with its place.
        ValueError: another suffix, or nothing of these.
    """
    if text.startswith("font:"):
        return outline(*parse_font_spec(text))
    suffix = Path(text).suffix.lower()
    if suffix in _READERS:
        return _READERS[suffix](text)
    if _PATH_DATA.match(text):
        return path(text)
    raise _refusal(text, suffix)


def _refusal(text: str, suffix: str) -> Exception:
    try:
        exists = Path(text).is_file()
    except (OSError, ValueError):
        # A name that is too long, or holds a null character.
        exists = False
    if exists:
        return ParseError(f"the suffix is {suffix!r}; {_ACCEPTED}.", text)
    return FileNotFoundError(f"{text}: no such file; {_ACCEPTED}.")
