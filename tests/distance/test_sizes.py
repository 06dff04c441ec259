"""Lengths and areas of closed forms lie between their bounds, at every size, and what has none is refused."""

import math
from fractions import Fraction
from typing import Any

import mpmath
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


def short(values):
    """Numbers rounded to few digits, so that sums of small multiples of them are exact."""
    return np.round(2**24 * np.asarray(values)) / 2**24


def noise(*shape, seed, size):
    """Random numbers of at most some size, with few digits."""
    return short(size * np.random.default_rng(seed).uniform(-1, 1, shape))


def bernstein(rows, t):
    """Value and derivative of a polynomial with coefficients `rows` at a 50-digit number, by de Casteljau's rule."""
    n = len(rows) - 1
    while len(rows) > 2:
        rows = [(1 - t) * a + t * b for a, b in zip(rows, rows[1:], strict=False)]
    return (1 - t) * rows[0] + t * rows[1], n * (rows[1] - rows[0])


def moving(points, weights, t):
    """Point and derivative of a rational curve at a 50-digit number."""
    w, slope = bernstein([mpmath.mpf(x) for x in weights], t)
    found = [bernstein([mpmath.mpf(x) * mpmath.mpf(y) for x, y in zip(c, weights, strict=True)], t) for c in points.T]
    return [x / w for x, _ in found], [(dx - x / w * slope) / w for x, dx in found]


def quad(f, ends) -> Any:
    """The integral of a smooth function by rules of Gauss, of 24 nodes at last, far beyond double precision."""
    return mpmath.quad(f, ends, method="gauss-legendre", maxdegree=4)


def enclosed_area(points, weights):
    """The area within the border of a plane patch, by the integral of x dy along it."""
    sides = [np.s_[:, 0], np.s_[-1, :], np.s_[::-1, -1], np.s_[0, ::-1]]

    def part(side, t):
        (x, _), (_, dy) = moving(points[side], weights[side], t)
        return x * dy

    with mpmath.workdps(50):
        return sum(quad(lambda t, side=side: part(side, t), [0, 1]) for side in sides)


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("degrees", [(8, 8), (12, 12), (20, 3)])
def test_areas_of_plane_patches_of_high_degree_are_certified(degrees, rational):
    u, v = np.meshgrid(*(short(np.linspace(0, 1, n + 1)) for n in degrees), indexing="ij")
    plane = np.stack([u, v], axis=-1) + noise(*u.shape, 2, seed=sum(degrees), size=0.25 / max(degrees))
    weights = 1 + noise(*u.shape, seed=1, size=1e-6) if rational else np.ones_like(u)
    exact = 9 * enclosed_area(plane, weights)
    # In a tilted plane: both vectors have the length three and are perpendicular.
    points = plane @ np.array([[1.0, 2, 2], [2, 1, -2]])
    found = jhd.surface_area(
        jhd.BezierPatch(points, weights if rational else None), rtol=1e-12, max_cells=64, throw=False
    )
    assert mpmath.mpf(found.lower) <= exact <= mpmath.mpf(found.upper)
    assert found.upper - found.lower <= (1e-9 if rational else 5e-11) * found.upper


@pytest.mark.parametrize("rational", [False, True])
def test_lengths_of_curves_of_degree_twenty_are_certified(rational):
    t = np.linspace(0, 1, 21)
    points = np.stack([t, np.sin(3 * t), t**2], axis=1) + noise(21, 3, seed=3, size=0.1)
    weights = 1 + noise(21, seed=4, size=0.2) if rational else np.ones(21)

    def speed(t):
        return mpmath.sqrt(sum(x * x for x in moving(points, weights, t)[1]))

    with mpmath.workdps(50):
        exact = quad(speed, mpmath.linspace(0, 1, 4))
    found = jhd.arc_length(jhd.BezierCurve(points, weights if rational else None))
    assert mpmath.mpf(found.lower) <= exact <= mpmath.mpf(found.upper)


def test_the_length_of_a_straight_curve_of_degree_twenty_is_certified():
    along = np.sort(noise(21, seed=5, size=1))
    curve = jhd.BezierCurve(along[:, None] * np.array([1.0, 2, 2]))
    found = jhd.arc_length(curve, rtol=1e-12, max_cells=64, throw=False)
    exact = 3 * (Fraction(along[-1]) - Fraction(along[0]))
    assert Fraction(found.lower) <= exact <= Fraction(found.upper) <= Fraction(found.lower) * Fraction(1 + 5e-11)
