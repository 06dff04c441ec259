"""Implicit surfaces with points at which the polynomial does not change its sign: exact arithmetic proves them."""

import equinox as eqx
import numpy as np
import pytest

import jhd
from jhd._results.solution import name_of

BOX = [-1.6] * 3, [1.6] * 3
SPHERE = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", *BOX)
CLOSE = 1e-9


def assert_is(found, exact):
    assert found.lower <= exact <= found.upper and found.upper - found.lower < CLOSE, found


@pytest.mark.slow
def test_a_sphere_with_a_point_inside_is_as_far_as_the_point():
    both = jhd.ImplicitSurface.parse("((x - 0.5)**2 + y**2 + z**2) * (x**2 + y**2 + z**2 - 1)", *BOX)
    assert_is(jhd.directed_hausdorff(both, SPHERE), 0.5)
    slope = eqx.filter_grad(lambda b: jhd.directed_hausdorff(both, b).value)(SPHERE)
    # The sphere f = -c grows by the root of 1 + c.
    assert abs(float(slope.coefficients[0, 0, 0]) + 0.5) < 1e-6


@pytest.mark.exhaustive  # a program of degree 4
def test_where_the_polynomial_is_just_above_zero_there_is_no_point():
    text = "((x - 0.5)**2 + y**2 + z**2 + 1 / 1125899906842624) * (x**2 + y**2 + z**2 - 1)"
    surface, method = jhd.ImplicitSurface.parse(text, *BOX), jhd.BranchAndBound(atol=5e-7)
    found = jhd.directed_hausdorff(surface, SPHERE, method, throw=False)
    assert found.lower == 0 and found.upper < 1e-6


@pytest.mark.slow
def test_a_sphere_that_touches_its_box_from_outside_is_a_point():
    point = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [1, -1, -1], [3, 1, 1])
    other = jhd.ImplicitSurface.parse("(x - 3)**2 + y**2 + z**2 - 1", [0, -3, -3], [5, 3, 3])
    assert_is(jhd.directed_hausdorff(point, other), 1.0)
    assert_is(jhd.minimum_distance(point, other), 1.0)
    assert_is(jhd.directed_hausdorff(jhd.point_set(np.array([[3.0, 0, 0]])), point), 2.0)


@pytest.mark.slow
def test_a_small_cap_of_a_sphere_is_as_far_as_its_rim():
    cap = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1000000", [1000 - 1e-5, -2000, -2000], [3000, 2000, 2000])
    rim, top = np.sqrt(1e6 - (1000 - 1e-5) ** 2), jhd.point_set([[1000.0, 0, 0]])
    found = jhd.directed_hausdorff(cap, top, atol=1e-6)
    assert found.lower <= np.hypot(rim, 1e-5) <= found.upper
    assert not jhd.hausdorff_at_most(cap, top, 1e-3, directed=True)


@pytest.mark.exhaustive
def test_a_point_that_no_simple_fraction_names_stays_in_doubt():
    # A fraction that is not simple: the exact polynomial is zero there, but no evaluation in floats shows it.
    text = "((9973 * x - 4000)**2 + 99460729 * (y**2 + z**2)) * (x**2 + y**2 + z**2 - 1)"
    found = jhd.directed_hausdorff(jhd.ImplicitSurface.parse(text, *BOX), SPHERE, throw=False)
    assert found.lower <= 5973 / 9973 <= found.upper < 5973 / 9973 + CLOSE
    assert name_of(found.result) == "existence_not_certified"


@pytest.mark.slow
def test_points_of_surfaces_count_in_minimum_distances_where_all_of_the_other_is_as_near():
    point = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2", *BOX)
    other = jhd.ImplicitSurface.parse("x**2 + (y - 1.25)**2 + z**2", *BOX)
    for a, b, exact in ((point, SPHERE, 1.0), (SPHERE, point, 1.0), (point, other, 1.25)):
        assert_is(jhd.minimum_distance(a, b), exact)
    same = jhd.minimum_distance(point, point)
    assert same.lower == 0 and same.upper < 1e-300


@pytest.mark.slow
def test_points_on_a_face_an_edge_and_a_corner_of_their_box_count():
    for count in (1, 2, 3):
        text = " + ".join(f"({x} - {2 if k < count else 0})**2" for k, x in enumerate("xyz"))
        point = jhd.ImplicitSurface.parse(text, [-2] * 3, [2] * 3)
        assert_is(jhd.minimum_distance(point, SPHERE), 2 * np.sqrt(count) - 1)
