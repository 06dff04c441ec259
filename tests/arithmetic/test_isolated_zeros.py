"""Single points where a polynomial is zero without a change of sign: found, proven to be there or not, and alone."""

from fractions import Fraction

import numpy as np
import pytest

from jhd._arithmetic import exact_polynomials
from jhd._arithmetic.isolated_zeros import isolated_zeros
from jhd._shapes.implicit import ImplicitSurface

SPHERE = "(x**2 + y**2 + z**2 - 1)"
SIDE = 1.6

# The place, what is proven (there, gone, unknown), and the polynomial.
CASES = {
    "a float": ([0.5, 0, 0], "there", f"((x - 0.5)**2 + y**2 + z**2) * {SPHERE}"),
    "a third": ([1 / 3, 0, 0], "there", f"((3*x - 1)**2 + 9*y**2 + 9*z**2) * {SPHERE}"),
    "lifted": ([0.5, 0, 0], "gone", f"((x - 0.5)**2 + y**2 + z**2 + 1 / 1125899906842624) * {SPHERE}"),
    "lowered": ([0.5, 0, 0], "small", f"((x - 0.5)**2 + y**2 + z**2 - 1 / 1125899906842624) * {SPHERE}"),
}


def found_in(text, lower, upper):
    stored = ImplicitSurface.parse(text, lower, upper).coefficients
    exact = exact_polynomials.trimmed(exact_polynomials.integers(stored))
    ends = np.array(lower, float), np.array(upper, float)

    def simple(place):
        return [Fraction(float(x)).limit_denominator(4096) for x in place]

    return isolated_zeros(exact, exact_polynomials.floats(exact), *ends, simple)


@pytest.mark.parametrize("name", CASES)
def test_a_point_inside_a_sphere_is_there_or_not(name):
    place, kind, text = CASES[name]
    (zero,) = found_in(text, [-SIDE] * 3, [SIDE] * 3)
    assert max(abs(float(x) - y) for x, y in zip(zero.place, place, strict=True)) < 1e-9
    assert zero.there == (kind in ("there", "small")) and zero.half > 0.01
    # The sphere itself is not in the cube.
    assert zero.half < 0.5
    assert {"there": zero.radius == 0, "gone": zero.radius < 0}.get(kind, 2.0**-25 <= zero.radius < 2.0**-22)


def test_of_a_place_that_no_fraction_names_nothing_is_proven_but_where_it_would_be():
    text = f"((x**2 - 0.5)**2 + y**2 + z**2) * {SPHERE}"
    found = found_in(text, [-SIDE] * 3, [SIDE] * 3)
    assert sorted(round(float(zero.place[0]), 9) for zero in found) == [-0.707106781, 0.707106781]
    assert all(0 <= zero.radius < 1e-14 and not zero.there for zero in found)


def test_spheres_that_touch_a_face_an_edge_or_a_corner_of_their_box_from_outside():
    for lower, upper in (
        ([1, -1, -1], [3, 1, 1]),
        ([-1, -1, -2], [1, 1, -1]),
        ([0.6, 0.8, -1], [2, 2, 1]),
    ):
        # The last point is none of floats: the stored box is beside it.
        found = found_in("x**2 + y**2 + z**2 - 1", lower, upper)
        assert len(found) == 1 and (found[0].there or found[0].radius < 0)
    (zero,) = found_in("x + y + z + 3", [-1] * 3, [1] * 3)
    assert zero.place == [-1, -1, -1] and zero.there and zero.radius == 0


@pytest.mark.parametrize("power", [26, 33, 40, 48])
def test_a_cap_that_a_face_cuts_off_next_to_a_simple_point_is_not_taken_for_it(power):
    # The point (1, 0, 0) is on the sphere and not on the face: all of the cap counts, and its rim is the farthest.
    cut, rim = 1 - 2.0**-power, np.sqrt(2.0 ** (1 - power))
    for zero in found_in("x**2 + y**2 + z**2 - 1", [cut, -1, -1], [3, 1, 1]):
        assert abs(float(zero.place[0]) - cut) < 1e-15 and zero.radius >= rim * (1 - 1e-3)
    # Beyond the sphere there is nothing.
    for zero in found_in("x**2 + y**2 + z**2 - 1", [1 + 2.0**-power, -1, -1], [3, 1, 1]):
        assert zero.radius < 0 and not zero.there


@pytest.mark.parametrize("place", [(1, 0, 0), (1, -1, 0), (1, -1, 1), (-1, 0.25, 0)])
@pytest.mark.parametrize(
    "rest", ["", "+ (x - {0}) * (y - {1})", "+ (z - {2}) * (x**2 + 1) * (z - {2}) - (y - {1})**3 / 8"]
)
def test_a_point_on_faces_from_which_the_polynomial_rises_by_its_curvature(place, rest):
    text = ("(x - {0})**2 + (y - {1})**2 + 2*(z - {2})**2" + rest).format(*place)
    (zero,) = found_in(text, [-1] * 3, [1] * 3)
    assert zero.place == list(place) and zero.there and zero.radius == 0 and zero.half > 0.05


def test_what_is_no_single_point_is_not_taken_for_one():
    box = [-SIDE] * 3, [SIDE] * 3
    for text in ("x**2 + y**2 - z**2", "(x**2 + y**2 - 1)**2 + z**2", "x**2 + y**2 + z**2 - 1", "x * y * z", "z"):
        assert found_in(text, *box) == []
    # On a face it falls from, or does not rise from.
    for text in ("(z - 1)**2 + x**2 - (y - 1)**2", "(z - 1)**2 + x**2", "x**2 + y**2 + (z - 1)"):
        assert found_in(text, [-1] * 3, [1] * 3) == []
