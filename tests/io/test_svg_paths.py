"""Path data of curves: what is exact comes back, arcs are arcs, and the rest is within tolerance of the curve."""

import math
import re

import numpy as np
import pytest

import jhd
import jhd.io
from tests.sweeps import swept

RANDOM = np.random.default_rng(61)


def words(d):
    """Path data as commands with their numbers."""
    return [
        (x[0], [float(n) for n in re.findall(r"-?[0-9.]+(?:e[-+]?[0-9]+)?", x[1:])])
        for x in re.findall("[A-Z][^A-Z]*", d)
    ]


def off_ellipse(x, center, radii, degrees):
    """How far the values of the equation of an ellipse are from 1."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    local = (x - center) @ np.array([[c, -s], [s, c]])
    return np.abs(np.sum((local / radii) ** 2, axis=1) - 1).max()


def test_circles_are_four_arcs_with_the_numbers_of_a_person():
    assert jhd.io.format_path(jhd.circle([1, 2], 3)) == (
        "M4.0,2.0 A3 3 0 0 1 1.0,5.0 A3 3 0 0 1 -2.0,2.0 A3 3 0 0 1 1.0,-1.0 A3 3 0 0 1 4.0,2.0 Z"
    )
    clockwise = jhd.io.format_path(jhd.circle([0, 0], 0.1).reverse())
    assert clockwise.startswith("M0.1,0.0 A0.1 0.1 0 0 0 0.0,-0.1 ")


@pytest.mark.parametrize("degree", [2, 3])
def test_arcs_of_ellipses_are_arcs_in_any_degree_and_position(degree):
    matrix = 5 * RANDOM.normal(size=(2, 2))
    ring = jhd.circle([0, 0], 1).transform(matrix, [30, -7]).elevate(degree)
    d = jhd.io.format_path(ring)
    left, sizes, _ = np.linalg.svd(matrix)
    angle = math.degrees(math.atan2(left[1, 0], left[0, 0])) % 180
    assert [letter for letter, _ in words(d)] == ["M", "A", "A", "A", "A", "Z"]
    for _, numbers in words(d)[1:5]:
        np.testing.assert_allclose(numbers[:3], [*sizes, angle], rtol=1e-9)
        assert numbers[3] == 0 and numbers[4] == float(np.linalg.det(matrix) > 0)
    again = jhd.io.parse_path(d)
    x = np.asarray(again(np.linspace(0, again.count, 41)))
    assert off_ellipse(x, np.array([30, -7]), sizes, angle) < 1e-9


def test_an_arc_of_more_than_a_quarter_is_two():
    half = jhd.BezierSegments([[[1.0, 0], [1, math.sqrt(3)], [-0.5, math.sqrt(0.75)]]], [[1, 0.5, 1]])
    assert [letter for letter, _ in words(jhd.io.format_path(half))] == ["M", "A", "A"]


def test_a_drawing_of_lines_cubics_and_arcs_keeps_its_kinds():
    d = "M 0 0 C 100 900 900 900 1000 0 A 500 200 0 0 1 0 0 Z"
    again = words(jhd.io.format_path(jhd.io.parse_path(d)))
    assert [letter for letter, _ in again] == ["M", "C", "A", "A", "Z"]
    assert again[1][1] == [100, 900, 900, 900, 1000, 0] and again[2][1][:3] == [500, 200, 0]
    assert again[3][1][-2:] == [0, 0]


def test_what_is_no_arc_is_refused_without_a_tolerance_and_within_it_otherwise():
    hyperbola = jhd.BezierSegments([[[0.0, 0], [1, 2], [2, 0]]], [[1, 3, 1]])
    with pytest.raises(ValueError, match="is rational; paths hold .* give tolerance"):
        jhd.io.format_path(hyperbola)
    d = jhd.io.format_path(hyperbola, tolerance=1e-3)
    assert {letter for letter, _ in words(d)} == {"M", "C"}
    read = jhd.io.parse_path(d)
    x = np.asarray(read(np.linspace(0, read.count, 301)))
    # With barycentric coordinates a, b, c in the triangle of the control points it is b^2 = 4 w^2 a c; w = 3.
    b = x[:, 1] / 2
    c = (x[:, 0] - b) / 2
    residual = np.abs(b**2 - 36 * (1 - b - c) * c)
    # The gradient of the equation is below 40 inside of the triangle.
    assert 0 < residual.max() < 40 * 1e-3
    quintic = jhd.BezierCurve(RANDOM.normal(size=(6, 2)))
    with pytest.raises(ValueError, match="has degree 5"):
        jhd.io.format_path(quintic)
    assert jhd.io.format_path(quintic, tolerance=0.01).count("C") > 1


@pytest.mark.parametrize("tolerance", swept([1e-4, 1e-1], 0, 1))
def test_what_is_read_back_is_proven_to_be_near(tolerance):
    rows = RANDOM.normal(size=(4, 3, 2))
    curve = jhd.BezierSegments(rows, np.stack([np.ones(4), [0.2, 0.9, 0.9999999, 2.5], np.ones(4)], axis=1))
    read = jhd.io.parse_path(jhd.io.format_path(curve, tolerance=tolerance))
    assert float(jhd.hausdorff(curve, read, throw=False).lower) <= tolerance


def test_nearly_parabolic_and_flat_arcs_come_back(tmp_path):
    for weights, corner in (([1, 1 - 1e-9, 1], [1, 2]), ([1, 0.5, 1], [1, 1e-9]), ([1, 0.5, 1], [1, 0])):
        curve = jhd.BezierSegments([[[0.0, 0], corner, [2, 0]]], [weights])
        read = jhd.io.parse_path(jhd.io.format_path(curve, tolerance=1e-6))
        x = np.asarray(read(np.linspace(0, read.count, 201)))
        middle = np.asarray(curve(0.5))
        assert np.abs(x[:, 1].max() - middle[1]) <= 2e-6


@pytest.mark.parametrize("tolerance", [0, -1.0, float("nan")])
def test_a_tolerance_is_positive(tolerance):
    with pytest.raises(ValueError, match="tolerance is .*needs a positive number, or None"):
        jhd.io.format_path(jhd.circle([0, 0], 1), tolerance=tolerance)
