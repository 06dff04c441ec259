"""Reading and writing of files: fonts, SVG, JSON, IGES, meshes, point clouds, results and certificates."""

from jhd._io.certificates import load_certificate
from jhd._io.clouds import load_points
from jhd._io.described import (
    curve_from_dict,
    curve_to_dict,
    load_curve,
    load_surface,
    save_curve,
    save_surface,
    surface_from_dict,
    surface_to_dict,
)
from jhd._io.errors import ParseError
from jhd._io.glyphs import load_glyph, load_glyphs, parse_font_spec
from jhd._io.iges import load_iges
from jhd._io.iges_writer import save_iges
from jhd._io.load import load_shape
from jhd._io.meshes import load_mesh, save_mesh
from jhd._io.outward import to_geomdl, to_path, to_scipy, to_shapely
from jhd._io.results import load_result, save_result
from jhd._io.svg import format_path, load_svg, parse_path, save_svg

__all__ = [
    "ParseError",
    "curve_from_dict",
    "curve_to_dict",
    "load_certificate",
    "load_curve",
    "load_iges",
    "load_mesh",
    "load_points",
    "load_result",
    "load_shape",
    "load_surface",
    "load_glyph",
    "load_glyphs",
    "parse_font_spec",
    "parse_path",
    "format_path",
    "load_svg",
    "save_curve",
    "save_iges",
    "save_mesh",
    "save_result",
    "save_surface",
    "surface_from_dict",
    "surface_to_dict",
    "to_geomdl",
    "to_path",
    "to_scipy",
    "to_shapely",
    "save_svg",
]
