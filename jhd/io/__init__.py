"""Files to shapes and back: fonts, SVG, JSON, IGES, meshes, point clouds, results and certificates."""

from jhd.io.certificates import load_certificate as load_certificate
from jhd.io.clouds import load_points as load_points
from jhd.io.curves import curve_from_dict as curve_from_dict
from jhd.io.curves import curve_to_dict as curve_to_dict
from jhd.io.curves import load_curve as load_curve
from jhd.io.curves import save_curve as save_curve
from jhd.io.errors import ParseError as ParseError
from jhd.io.iges import load_iges as load_iges
from jhd.io.iges_writer import save_iges as save_iges
from jhd.io.load import load_shape as load_shape
from jhd.io.meshes import load_mesh as load_mesh
from jhd.io.meshes import save_mesh as save_mesh
from jhd.io.outlines import outline as outline
from jhd.io.outlines import parse_font_spec as parse_font_spec
from jhd.io.results import load_result as load_result
from jhd.io.results import save_result as save_result
from jhd.io.surfaces import load_surface as load_surface
from jhd.io.surfaces import save_surface as save_surface
from jhd.io.surfaces import surface_from_dict as surface_from_dict
from jhd.io.surfaces import surface_to_dict as surface_to_dict
from jhd.io.svg import path as path
from jhd.io.svg import read_svg as read_svg
from jhd.io.svg import write_svg as write_svg
