"""Minimum distances with implicit surfaces far from the origin and in extreme sizes: true bounds, equally close."""

from fractions import Fraction

import jax
import numpy as np
import pytest

from jhd import BezierCurve, BranchAndBound, minimum_distance
from jhd._results.solution import name_of
from jhd._shapes.implicit import ImplicitSurface
from tests.sweeps import swept

# Two of the sizes that coordinates come in, as powers of two: half of the exponents are left to the coefficients.
EXTREMES = swept([-1000, -300, 300, 1000], slow=[-1000, 1000])
CENTERS = (0.0, 0.0, 0.0), (0.0, 7.0, 0.0)
RADII = (3.0, 2.0)


def sphere(center, radius, exponent=0):
    """A sphere in the box that touches it, coordinates times a power of two and the polynomial over that power."""
    x, unit = np.asarray(center, float), 2.0**exponent
    coefficients = np.zeros((3, 3, 3))
    for axis in range(3):
        place = np.eye(3, dtype=int)[axis]
        coefficients[tuple(2 * place)], coefficients[tuple(place)] = 1 / unit, -2 * x[axis]
    coefficients[0, 0, 0] = (x @ x - radius**2) * unit
    return ImplicitSurface(coefficients, (x - radius) * unit, (x + radius) * unit)


def spheres(offset=0.0, exponent=0):
    a, b = (sphere(np.add(c, offset), r, exponent) for c, r in zip(CENTERS, RADII, strict=True))
    return a, b


def enclosed(found, exact, gap):
    assert Fraction(float(found.lower)) <= exact <= Fraction(float(found.upper))
    assert float(found.upper) - float(found.lower) <= gap


@pytest.mark.parametrize("offset", swept([2.0**20, -(2.0**24)], slow=[-(2.0**24)]))
def test_spheres_far_from_the_origin_are_as_close_as_near_it(offset):
    found = minimum_distance(*spheres(offset))
    enclosed(found, 2, 1e-12)
    np.testing.assert_allclose(np.asarray(found.point_a) - offset, [0, 3, 0], atol=1e-8)


@pytest.mark.parametrize("exponent", EXTREMES)
def test_spheres_of_extreme_sizes_are_as_close_as_those_of_size_one(exponent):
    found = minimum_distance(*spheres(exponent=exponent))
    enclosed(found, 2 * Fraction(2) ** exponent, 1e-12 * 2.0**exponent)


@pytest.mark.exhaustive
def test_bounds_hold_far_from_the_origin_under_a_trace():
    """Moving rounds there, so the gap may stay open; the bounds may not lie."""

    def bounds(coefficients):
        a = ImplicitSurface(coefficients, near[0].lower, near[0].upper, reduced=False)
        found = minimum_distance(a, near[1], BranchAndBound(max_steps=50), throw=False)
        return found.lower, found.upper

    near = spheres(2.0**10)
    lower, upper = jax.jit(bounds)(near[0].coefficients)
    assert lower <= 2 <= upper


@pytest.mark.exhaustive
def test_a_curve_far_from_the_origin_beside_a_surface():
    offset = np.array([2.0**20, 2.0**22, -(2.0**21)])
    curve = BezierCurve(np.array([[-1.0, 0, 5], [0, 1, 5], [1, 0, 5]]) + offset)
    found = minimum_distance(curve, sphere(offset, 3.0))
    near = minimum_distance(BezierCurve(curve.control_points - offset), sphere(np.zeros(3), 3.0))
    assert float(near.lower) <= float(found.upper) and float(found.lower) <= float(near.upper)
    assert name_of(found.result) == "successful" and float(found.upper - found.lower) <= 1e-8
