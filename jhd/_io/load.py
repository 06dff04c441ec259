"""Loading of shapes from one string, for the command line and scripts."""

import re
from collections.abc import Callable
from pathlib import Path

from jhd._io.clouds import CLOUD_SUFFIXES, load_points
from jhd._io.described import CURVE_KINDS, SURFACE_KINDS, load_described
from jhd._io.errors import ParseError, read_bytes
from jhd._io.geometries import GEOMETRY_SUFFIXES, load_geometry
from jhd._io.glyphs import load_glyph, parse_font_spec
from jhd._io.iges import IGES_SUFFIXES, load_iges, united
from jhd._io.meshes import MESH_SUFFIXES, SCENE_SUFFIXES, load_mesh
from jhd._io.ply import read_ply
from jhd._io.polygons import mesh_of
from jhd._io.svg import load_svg, parse_path
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch

_PATH_DATA = re.compile(r"\s*[Mm][\s]*[-+.\d]")
_ACCEPTED = (
    f"a curve is a .json, .svg, .igs, {' or '.join(GEOMETRY_SUFFIXES)} file, font:NAME:LETTER, or SVG path data "
    "(M0 0 ...); a parametric surface is a .json or .igs file; a mesh is a file "
    f"{', '.join((*MESH_SUFFIXES, *SCENE_SUFFIXES))}; points are a file {', '.join(CLOUD_SUFFIXES)}, or .ply "
    "without faces"
)


def load_shape(text: str | Path) -> AbstractCurve | AbstractPatch | TriangleMesh:
    """Load a shape from a file, a letter of a font, or SVG path data.

    The suffix of a file, in any case, decides how it is read:

    - `.json`: a curve or a parametric surface, see `load_curve` and `load_surface`
    - `.svg`: everything that the file draws, see `load_svg`
    - `.igs`, `.iges`: all curves, or all surfaces, as one shape, see `load_iges`
    - `.obj`, `.stl`, `.ply`, `.off`, `.glb`, `.gltf`, `.3mf`: a mesh, see `load_mesh`
    - `.xyz`, `.csv`, `.txt`, `.npy`, and `.ply` without faces: a point set, see `load_points`
    - `.geojson`, `.wkt`: the points, lines and rings of all geometries, in the unit of the file, with shapely

    Letters are in font units, of which fonts have 1000 or 2048 to the em. To compare letters of two fonts, load them by
    `load_glyph` with `size=1`.

    >>> import jhd
    >>> jhd.io.load_shape("M0 0 H4 V2 Z").count, jhd.io.load_shape("font:DejaVu Sans:l").count
    (3, 4)

    Args:
        text: a file name or Path with one of these suffixes, `font:NAME:LETTER` (see `load_glyph`), or SVG path data
            (see `parse_path`).

    Returns:
        The shape. An IGES file with a single spline gives that spline.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: the file or the path data cannot be read; the message gives the line or byte. Also for an existing
            file with another suffix.
        ImportError: a package that reads the file is not installed; the message names the extra.
        ValueError: a font that is not known to matplotlib, or a letter that it lacks.
    """
    text = str(text)
    if text.startswith("font:"):
        return load_glyph(*parse_font_spec(text))
    suffix = Path(text).suffix.lower()
    if suffix in _READERS:
        return _READERS[suffix](text)
    if _PATH_DATA.match(text):
        return parse_path(text)
    raise _refusal(text, suffix)


def _json_shape(file: str) -> AbstractCurve | AbstractPatch:
    return load_described("shape", file, {**CURVE_KINDS, **SURFACE_KINDS})


def _iges_shape(file: str) -> AbstractCurve | AbstractPatch:
    """The only shape of a file, or all its shapes as one if all are curves or all are surfaces."""
    found = load_iges(file)
    curves = [shape for shape in found if isinstance(shape, AbstractCurve)]
    surfaces = [shape for shape in found if isinstance(shape, AbstractPatch)]
    if curves and surfaces:
        counts = f"{len(curves)} curve{'s' * (len(curves) > 1)} and {len(surfaces)} surface{'s' * (len(surfaces) > 1)}"
        raise ParseError(f"holds {counts}; use load_iges to get them one by one.", file)
    return found[0] if len(found) == 1 else united(found)


def _ply_shape(file: str) -> BezierSegments | TriangleMesh:
    """The mesh, or the points if there are no faces."""
    found = read_ply(file, read_bytes(file))
    return mesh_of(file, found) if len(found.sizes) else load_points(file)


_READERS: dict[str, Callable[[str], AbstractCurve | AbstractPatch | TriangleMesh]] = {
    **dict.fromkeys((*MESH_SUFFIXES, *SCENE_SUFFIXES), load_mesh),
    **dict.fromkeys(CLOUD_SUFFIXES, load_points),
    **dict.fromkeys(GEOMETRY_SUFFIXES, load_geometry),
    ".json": _json_shape,
    ".svg": load_svg,
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
