"""Lengths and areas of closed forms lie between their bounds, at every size, and what has none is refused."""

import math
from typing import Any

import numpy as np
import pytest

import jhd

QUARTER = np.sqrt(0.5)
PARABOLA = 0.5 * math.sqrt(5) + 0.25 * math.asinh(2)  # y = x^2 from 0 to 1
# A quarter of a cylinder of radius 1 and height 3.
CYLINDER = jhd.BezierPatch(
    np.array([[[1, 0, z], [1, 1, z], [0, 1, z]] for z in (0.0, 3.0)]), np.array([[1, QUARTER, 1]] * 2)
)


def test_lengths_of_circles_lines_and_a_parabola_are_those_of_closed_forms():
    curves = [
        (jhd.circle((0, 0), 1.0), 2 * math.pi),
        (jhd.BezierCurve([(0, 0), (0.5, 0), (1, 1)]), PARABOLA),
        (jhd.polyline([(1e6, 0), (1e6 + 1, 0), (1e6, 0)]), 2.0),
        (jhd.polyline([(0, 0, 0), (1, 2, 2)]), 3.0),
    ]
    for scale in (1.0, 2.0**-600, 2.0**400):
        for curve, exact in curves:
            found = jhd.arc_length(curve.transform(scale * np.eye(curve.dim)))
            assert found.lower <= exact * scale <= found.upper <= found.lower * (1 + 1.1e-6)
    point = jhd.arc_length(jhd.polyline([(3, 4), (3, 4)]))
    assert point.lower == point.upper == 0


def test_areas_of_a_cylinder_and_of_a_mesh_are_those_of_closed_forms():
    # Its last vertex has no triangle.
    mesh = jhd.TriangleMesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 1], [1e12] * 3], [[0, 1, 2], [0, 3, 1]])
    for surface, exact in ((CYLINDER, 1.5 * math.pi), (mesh, 3.0)):
        found = jhd.surface_area(surface)
        assert found.lower <= exact <= found.upper <= found.lower * (1 + 1.1e-4)
    # An octant of the unit sphere: beside its pole the remainder of dividing by the weight is small, as the area is.
    arc, weights = np.array([[1.0, 0], [1, 1], [0, 1]]), np.array([1, QUARTER, 1])
    rows = [np.hstack([share * arc, np.full((3, 1), height)]) for share, height in ((1, 0.0), (1, 1.0), (0, 1.0))]
    octant = jhd.BezierPatch(np.array(rows), np.outer(weights, weights))
    found = jhd.surface_area(octant, rtol=5e-4, max_cells=1 << 14)
    assert found.lower <= math.pi / 2 <= found.upper
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])
    for scale in (2.0**-600, 2.0**600):  # the area underflows and overflows
        found = jhd.surface_area(jhd.TriangleMesh(scale * corners, [[0, 1, 2]]))
        assert found.lower <= 2 * min(scale, 1e154) * min(scale, 1e154) <= found.upper
    assert float(jhd.surface_area(jhd.BezierPatch([[[0, 0, 0], [1, 0, 0]]]))) == 0


def test_what_has_no_length_or_area_is_refused_and_an_open_gap_is_an_error():
    with pytest.raises(TypeError, match="curve is a TriangleMesh; needs a curve"):
        jhd.arc_length(jhd.TriangleMesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]]))
    with pytest.raises(TypeError, match="curve is a BezierSegments; needs a curve with a length"):
        jhd.arc_length(jhd.point_set([(0, 0)]))
    with pytest.raises(TypeError, match="surface must be a mesh or a parametric surface; got Bezier"):
        jhd.surface_area(jhd.circle((0, 0), 1.0))
    refused: dict[str, Any] = {
        "rtol is -1": {"rtol": -1},
        "atol has shape": {"atol": [1, 2]},
        "max_cells is 0": {"max_cells": 0},
        "max_seconds is 0": {"max_seconds": 0},
    }
    for message, options in refused.items():
        with pytest.raises(ValueError, match=message):
            jhd.arc_length(jhd.circle((0, 0), 1.0), **options)
    with pytest.raises(jhd.NotProvenError, match="cells prove .* only. Raise a tolerance or max_cells") as caught:
        jhd.arc_length(jhd.circle((0, 0), 1.0), rtol=1e-12, max_cells=64)
    assert caught.value.solution.lower <= 2 * math.pi <= caught.value.solution.upper
    known = jhd.arc_length(jhd.circle((0, 0), 1.0), rtol=1e-12, max_cells=64, throw=False)
    assert known.to_dict() == caught.value.solution.to_dict()
    with pytest.raises(jhd.NotProvenError, match="cells prove .* only. Raise a tolerance or max_seconds"):
        jhd.arc_length(jhd.circle((0, 0), 1.0), rtol=1e-12, max_seconds=1e-9)
    late = jhd.circle((0, 0), 1.0).length(rtol=1e-12, max_seconds=1e-9, throw=False)
    assert late.lower <= 2 * math.pi <= late.upper


def test_shapes_have_their_length_and_area():
    surface = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[3, 0, 0], [3, 2, 0]]])
    for found, exact in ((jhd.polyline([(0, 0), (3, 4)]).length(), 5), (surface.area(), 6)):
        assert exact - 1e-9 < found.lower <= exact <= found.upper < exact + 1e-9
    assert (
        jhd.circle((0, 0), 1.0).length(rtol=1e-3).to_dict()
        == jhd.arc_length(jhd.circle((0, 0), 1.0), rtol=1e-3).to_dict()
    )


def test_more_cells_never_prove_less():
    mesh = jhd.TriangleMesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 1]], [[0, 1, 2], [0, 3, 1]])
    few, many = (jhd.surface_area(mesh, rtol=0, atol=0, max_cells=n, throw=False) for n in (16, 1024))
    assert few.lower <= many.lower <= 3 <= many.upper <= few.upper
