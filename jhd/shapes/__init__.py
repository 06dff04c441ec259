"""Shapes: curves, parametric and implicit surfaces, meshes and point sets."""

from jhd.shapes.approximation import Approximation
from jhd.shapes.as_shape import as_shape
from jhd.shapes.bezier import BezierCurve
from jhd.shapes.biarc import BiarcCurve, biarcs, least_tolerance
from jhd.shapes.bspline import BSplineCurve
from jhd.shapes.bspline_surface import BSplineSurface
from jhd.shapes.curve import AbstractCurve, BezierSegments, circle, point_set, polyline
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.implicit_mesh import NotRegularError
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import BezierPatch, BezierPatches, Partials, PatchMesh
from jhd.shapes.prepared import Prepared, prepare
