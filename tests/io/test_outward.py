"""Shapes to other packages: exact where these can hold them, refused or within a proven deviation where they cannot."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.path import Path
from scipy.interpolate import BSpline, NdBSpline

import jhd
import jhd.io

RANDOM = np.random.default_rng(51)
KNOTS = np.sort(RANDOM.normal(size=9))
KNOTS_U, KNOTS_V = np.sort(RANDOM.normal(size=7)), np.sort(RANDOM.normal(size=5))
SPLINES = {
    "curve": jhd.BSplineCurve(RANDOM.normal(size=(5, 2)), KNOTS),
    "periodic": jhd.BSplineCurve.uniform(RANDOM.normal(size=(5, 3)), periodic=True),
    "surface": jhd.BSplineSurface(RANDOM.normal(size=(4, 3, 3)), KNOTS_U, KNOTS_V),
}


@pytest.mark.parametrize("name", SPLINES)
def test_splines_go_to_scipy_and_back_bit_for_bit(name):
    shape = SPLINES[name]
    spline = jhd.io.to_scipy(shape)
    again = jhd.as_shape(spline)
    assert isinstance(spline, BSpline | NdBSpline) and type(again) is type(shape)
    for field in shape.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, field), getattr(shape, field))


def test_bezier_curves_and_segments_are_splines_over_the_same_parameters():
    rows = np.array([[[0.0, 0], [1, 2], [2, 0]], [[5, 5], [6, 5], [6, 6]]])
    spline = jhd.io.to_scipy(jhd.BezierSegments(rows))
    np.testing.assert_array_equal(spline(np.array([0.5, 1.0, 1.5])), [[1, 1], [5, 5], [5.75, 5.25]])
    np.testing.assert_array_equal(jhd.io.to_scipy(jhd.BezierCurve(rows[0]))(0.5), [1, 1])
    patch = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]])
    np.testing.assert_array_equal(jhd.io.to_scipy(patch)((0.5, 0.5)), [1, 1, 1])


def test_rational_shapes_go_to_scipy_in_homogeneous_form_alone():
    circle = jhd.circle([1, 2], 3)
    with pytest.raises(ValueError, match="rational, and SciPy's splines have no weights; pass homogeneous=True"):
        jhd.io.to_scipy(circle)
    h = jhd.io.to_scipy(circle, homogeneous=True)(np.linspace(0, 4, 17))
    np.testing.assert_allclose(np.linalg.norm(h[:, :2] / h[:, 2:] - [1, 2], axis=1), 3, rtol=1e-15)
    line = jhd.io.to_scipy(jhd.polyline([[0, 0], [1, 2]]), homogeneous=True)
    np.testing.assert_array_equal(line(0.5), [0.5, 1, 1])
    with pytest.raises(TypeError, match="must be a BSplineSurface or a BezierPatch; got BezierPatches"):
        jhd.io.to_scipy(jhd.BezierPatches(np.zeros((2, 2, 2, 3))))


def test_surfaces_go_to_the_names_of_geomdl_and_back():
    weights = RANDOM.uniform(0.5, 2, (4, 3))
    for surface in (SPLINES["surface"], jhd.BSplineSurface(RANDOM.normal(size=(4, 3, 3)), KNOTS_U, KNOTS_V, weights)):
        found: Any = jhd.io.to_geomdl(surface)
        assert found["degree_u"] == 2 and found["degree_v"] == 1 and found["ctrlpts_size_v"] == 3
        # Points run along v first.
        np.testing.assert_array_equal(found["ctrlpts"][1], surface.control_points[0, 1])
        other: Any = SimpleNamespace(**found)
        again = jhd.as_shape(other)
        assert isinstance(again, jhd.BSplineSurface)
        np.testing.assert_array_equal(again.control_points, surface.control_points)
        np.testing.assert_array_equal(again.knots_u, surface.knots_u)
        np.testing.assert_array_equal(again.weights, np.ones((4, 3)) if surface.weights is None else surface.weights)


def test_straight_curves_go_to_shapely_and_back_bit_for_bit():
    rows = RANDOM.normal(size=(4, 2))
    line = jhd.io.to_shapely(jhd.polyline(rows))
    assert isinstance(line, shapely.LineString)
    np.testing.assert_array_equal(line.coords, rows)
    both = jhd.io.to_shapely(jhd.BezierSegments.join([jhd.polyline(rows), jhd.polyline(rows + 9, closed=True)]))
    assert isinstance(both, shapely.MultiLineString) and [x.is_closed for x in both.geoms] == [False, True]
    space = jhd.io.to_shapely(jhd.polyline(RANDOM.normal(size=(3, 3))))
    assert space.has_z


def test_areas_are_those_inside_of_an_odd_number_of_contours():
    ring, hole, island, other = (jhd.circle([x, 0], r) for x, r in ((0, 3), (0, 2), (0, 1), (9, 1)))
    disc = jhd.io.to_shapely(ring, 1e-3, filled=True)
    assert disc.geom_type == "Polygon" and 9 * np.pi - 6 * np.pi * 1e-3 <= disc.area <= 9 * np.pi + 6 * np.pi * 1e-3
    many = jhd.io.to_shapely(jhd.BezierSegments.join([ring, hole, island, other]), 1e-3, filled=True)
    assert many.geom_type == "MultiPolygon" and abs(many.area - 7 * np.pi) < 14 * np.pi * 1e-3


@pytest.mark.parametrize(
    ("curve", "options", "error", "message"),
    [
        (jhd.circle([0, 0], 1), {}, ValueError, "the curve has degree 2; give tolerance for a polyline"),
        (
            jhd.polyline([[0, 0], [1, 0], [1, 1], [0, 1]]),
            {"filled": True},
            ValueError,
            "needs closed contours in the plane",
        ),
        (jhd.polyline([[0, 0], [1, 1], [1, 0], [0, 1]], closed=True), {"filled": True}, ValueError, "cross"),
        (
            jhd.BezierSegments.join([jhd.polyline([[x, x], [x + 2, x], [x, x + 2]], closed=True) for x in (0, 0.5)]),
            {"filled": True},
            ValueError,
            "the contours cross each other or themselves",
        ),
        (jhd.point_set([[0, 0]]), {"tolerance": 1.0}, ValueError, "curve is a point set"),
    ],
)
def test_what_is_no_geometry_is_refused(curve, options, error, message):
    with pytest.raises(error, match=message):
        jhd.io.to_shapely(curve, **options)


def test_letters_go_to_matplotlib_and_back_bit_for_bit():
    letter = jhd.io.load_glyph("DejaVu Sans", "o")
    path = jhd.io.to_path(letter)
    assert isinstance(path, Path)
    again = jhd.BezierSegments.from_path(path)
    np.testing.assert_array_equal(again.control_points, letter.control_points)
    np.testing.assert_array_equal(again.next_segment, letter.next_segment)


def test_what_paths_cannot_hold_is_drawn_by_cubics_within_atol():
    circle = jhd.circle([0, 0], 2)
    with pytest.raises(ValueError, match="curve is rational; paths hold .*: give tolerance for cubics"):
        jhd.io.to_path(circle)
    path: Any = jhd.io.to_path(circle, 1e-4)
    assert set(path.codes.tolist()) == {1, 4, 79}
    ends = np.asarray(path.vertices)[::3]
    assert len(ends) == 9 and np.abs(np.linalg.norm(ends, axis=1) - 2).max() < 1e-15
    cubics = np.asarray(jhd.BezierSegments.from_path(path)(np.linspace(0, len(path.codes) // 3, 999)))
    assert np.abs(np.linalg.norm(cubics, axis=1) - 2).max() <= 1e-4
    for curve, message in ((jhd.point_set([[0, 0]]), "degree 0"), (jhd.polyline(np.eye(3)), "3 coordinates a point")):
        with pytest.raises(ValueError, match=message):
            jhd.io.to_path(curve)


def test_a_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "shapely", None)
    with pytest.raises(ImportError, match=r"to_shapely needs shapely: pip install jhd\[geometry\]"):
        jhd.io.to_shapely(jhd.polyline([[0, 0], [1, 1]]))
