"""The calls that type checkers accept run, and objects that stand for shapes are told from others by type."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from beartype.door import is_bearable
from matplotlib.path import Path
from scipy.interpolate import BSpline

import jhd
from jhd.typing import Numbers, ShapeLike
from tests.typing import right

ROWS = [(0.0, 0.0), (1.0, 2.0), (3.0, 1.0)]
CORNERS = ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])


def test_an_object_that_stands_for_a_shape_has_its_type():
    mesh, curve = jhd.TriangleMesh(*CORNERS), jhd.polyline(ROWS)
    own = [mesh, curve, jhd.point_set(ROWS), jhd.BezierPatch(np.zeros((2, 2, 3)))]
    tables = [ROWS, np.array(ROWS), jnp.array(ROWS, "float32"), np.arange(6).reshape(3, 2), list(jnp.array(ROWS))]
    foreign = [mesh.to_trimesh(), jhd.io.to_shapely(curve), Path(np.array(ROWS)), BSpline([0, 0, 1, 1], ROWS[:2], 1)]
    for accepted in [*own, *tables, CORNERS, *foreign, SimpleNamespace(points=CORNERS[0], faces=CORNERS[1])]:
        assert is_bearable(accepted, ShapeLike), accepted
        assert jhd.as_shape(accepted).dim in (2, 3)


def test_another_object_has_no_type_of_a_shape():
    for refused in ("M 0 0 L 1 1", 3, 0.5, None, {"points": ROWS}, [1, 2], [("0", "1")], object()):
        assert not is_bearable(refused, ShapeLike), refused
    for refused in ("0.1%", ["1"], None, {1: 2}, object()):
        assert not is_bearable(refused, Numbers), refused


@pytest.mark.slow
def test_calls_that_a_type_checker_accepts_run(tmp_path):
    curve, statistic = jhd.polyline(right.SQUARE), jhd.MeanDistance()
    right.two_curves_and_a_gradient()
    lower, value = right.a_mesh_and_a_spline_surface()
    assert lower <= value and right.nearest()[3:] == [3, 3] and right.a_loop() > 1
    assert round(right.points_and_means(curve, statistic, jhd.BranchAndBound(), [1, 2, 3, 4]), 2) == 1.5
    assert right.files(tmp_path).dim == 2 and right.a_picture()
