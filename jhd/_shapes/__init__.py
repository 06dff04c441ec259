"""Shapes: curves, parametric and implicit surfaces, meshes and point sets."""

from jhd._shapes.approximation import Approximation
from jhd._shapes.as_shape import as_shape
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.biarc import BiarcCurve, biarcs, least_tolerance
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.curve import AbstractCurve, BezierSegments, circle, point_set, polyline
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.implicit_mesh import NotRegularError
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import BezierPatch, BezierPatches, Partials, PatchMesh
from jhd._shapes.prepared import Prepared, prepare
