"""Shapes: curves, parametric and implicit surfaces, meshes and point sets.

How to add a kind of shape. A curve that consists of Bezier segments, or a surface that consists of Bezier patches, is
one class: a subclass of `AbstractCurve` with `segments()`, or of `AbstractPatch` with `patches()`. All distances,
derivatives, statistics, certificates and pictures use these segments or patches, so nothing is registered. A ruled
surface in `tests/shapes/test_new_kind.py` is an example. Any other kind needs these parts:

1. The class in this folder, and its name in `Shape` in `as_shape`. Arrays are fields; `bounds` is a box.
2. An `AbstractTarget` (`jhd._distance.nearest.target`): nearest points with bounds.
3. An `AbstractSource` (`jhd._distance.search.sources`): cells that cover the shape, how they are cut, points in them,
   and an upper bound over each.
4. A body, a subclass of `AbstractBody` (`jhd._distance.search.body`), registered with `body_of` in
   `jhd._distance.search.bodies`. It returns the target, the source and the common coordinates.
5. Derivatives: a subclass of `AbstractRows` (`jhd._distance.witness.rows`), the numbers that a point depends on, which
   `_rows_of` in `jhd._distance.witness.mixed_derivatives` selects.
6. Statistics over the shape: `net_of` in `jhd._distance.normalization.nets`. Smallest distances: `_searched` in
   `jhd._distance.minimum`. Certificates: `plain_shape` in `jhd._distance.certificate.sides`, and `pieces_of` in
   `jhd._distance.certificate.verification.pieces`. Pictures: `pieces_of` in `jhd._plot.colored`.
"""

from jhd._shapes.approximation import Approximation
from jhd._shapes.as_shape import as_shape
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.biarc import BiarcCurve, biarcs, least_tolerance
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.implicit_mesh import NotRegularError
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import BezierPatch, BezierPatches, Partials, PatchMesh
from jhd._shapes.prepared import Prepared, prepare
from jhd._shapes.simple_curves import circle, point_set, polyline
