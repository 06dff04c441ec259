"""Reading and writing of files: fonts, SVG, JSON, IGES, meshes, point clouds, results and certificates."""

from jhd.io.certificates import load_certificate
from jhd.io.clouds import load_points
from jhd.io.curves import curve_from_dict, curve_to_dict, load_curve, save_curve
from jhd.io.errors import ParseError
from jhd.io.glyphs import load_glyph, load_glyphs, parse_font_spec
from jhd.io.iges import load_iges
from jhd.io.iges_writer import save_iges
from jhd.io.load import load_shape
from jhd.io.meshes import load_mesh, save_mesh
from jhd.io.outward import to_geomdl, to_path, to_scipy, to_shapely
from jhd.io.results import load_result, save_result
from jhd.io.surfaces import load_surface, save_surface, surface_from_dict, surface_to_dict
from jhd.io.svg import format_path, load_svg, parse_path, save_svg

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
