"""Intervals of cells: the published ones to the last digit, where they are wrong, and the safe rule, which never is."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest

import jhd
from jhd._distance.published import cube_intervals
from jhd._fields.octree import voxelize
from jhd._results.solution import name_of
from jhd._shapes import ImplicitSurface
from jhd.published import CubeIntervals
from tests.sweeps import swept

LOWER, UPPER = [-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]


def parsed(text, lower=LOWER, upper=UPPER):
    return ImplicitSurface.parse(text, lower, upper)


CONES = parsed("x^2/4 + y^2/4 - z^2/9"), parsed("x^2/16 + y^2/4 - z^2/9")
# The exact distances: a point of the second cone on an edge of the box; a point of the first with two feet.
EXACT_H21 = (math.sqrt(43) - 4) / 3
EXACT_H12 = 0.798859586020371


def bounds(solution):
    return float(solution.lower), float(solution.upper)


@pytest.mark.parametrize("pairs", swept(["separable", "tiles"], quick=["separable"]))
def test_the_paper_rule_gives_the_published_interval(pairs):
    method = CubeIntervals(64, rule="paper", pairs=pairs)
    both, there = method._surfaces(*CONES), method._directed_surfaces(*CONES)
    assert bounds(both) == (math.sqrt(17 / 32), math.sqrt(103 / 128))
    assert bounds(there) == (math.sqrt(105) / 16, math.sqrt(185) / 16)
    assert name_of(both.result) == name_of(there.result) == "not_certified"
    assert float(both.value) == (math.sqrt(17 / 32) + math.sqrt(103 / 128)) / 2
    assert not both.directed and there.directed
    assert name_of(both.direction) == "b_to_a" and name_of(both.event) == "a_end"
    assert int(there.stats["cells_a"]) == 8464 and int(there.stats["cells_b"]) == 12440
    assert int(there.stats["pairs"]) == 8464 * 12440 == int(both.stats["a_to_b_pairs"])


@pytest.mark.parametrize("pairs", swept(["separable", "tiles"], slow=["separable"]))
def test_the_safe_rule_holds_the_distances_of_the_cones(pairs):
    method = CubeIntervals(64, pairs=pairs)
    both, there = method._surfaces(*CONES), method._directed_surfaces(*CONES)
    for solution, exact in ((both, EXACT_H21), (there, EXACT_H12)):
        lower, upper = bounds(solution)
        assert lower < exact < upper and lower <= float(solution.value) <= upper
        # Two diagonals of a cell: one for the place of the point, one for that of its foot.
        assert upper - lower < 2 * math.sqrt(3) / 16
        assert name_of(solution.result) == "successful"


def test_the_witness_is_where_the_upper_end_comes_from():
    solution = CubeIntervals(32)._directed_surfaces(*CONES)
    witness = solution.witness
    assert witness.feet.shape == (4, 3) and witness.multipliers.tolist() == [1, 0, 0, 0]
    assert int(witness.element) == -1 and np.isnan(witness.t)
    apart = np.abs(np.asarray(witness.point - witness.feet[0])) + 4 / 32
    assert abs(np.linalg.norm(apart) - float(solution.upper)) < 1e-12


BALL = parsed("x^2 + y^2 + z^2 - 1")
COUNTEREXAMPLES = {
    # The isolated cells of b at (1.2, 0, 0) hold no point, so a's points near it are far from b.
    "cells of b without a point": (
        BALL,
        parsed("((x - 1.2)^2 + y^2 + z^2 + 1e-4)*(x + 1.5)"),
        (1.4169730, 1.5649980),
        2.5,
    ),
    # The isolated cells of a hold no point; all its points are 0.1 away from b.
    "cells of a without a point": (
        parsed("((x - 1.7)^2 + (y - 1.7)^2 + (z - 1.7)^2 + 1e-4)*(x^2 + y^2 + z^2 - 1)"),
        parsed("x^2 + y^2 + z^2 - 1.21"),
        (1.7688714, 1.9852976),
        0.1,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", COUNTEREXAMPLES)
def test_the_paper_rule_is_wrong_where_cells_hold_no_point_and_the_safe_rule_is_not(case):
    a, b, published, exact = COUNTEREXAMPLES[case]
    lower, upper = bounds(CubeIntervals(64, rule="paper")._directed_surfaces(a, b))
    assert abs(lower - published[0]) < 1e-6 and abs(upper - published[1]) < 1e-6
    assert not lower <= exact <= upper
    safe = CubeIntervals(64)._directed_surfaces(a, b)
    assert float(safe.lower) <= exact <= float(safe.upper) and name_of(safe.result) == "successful"


@pytest.mark.slow
def test_distances_between_vertices_are_the_same_on_one_grid_and_no_bound_on_two():
    """The second way of the source. One cell holds all of another: its vertices are far from the vertices of that."""
    ways = [CubeIntervals(8, "paper", "tiles", ends) for ends in ("cells", "vertices")]
    cells, vertices = (bounds(method._surfaces(*CONES)) for method in ways)
    assert cells == vertices
    a, b = parsed("z - 0.5", [0, 0, 0], [1, 1, 1]), parsed("z - 0.75", [-1, -1, -1], [2, 2, 2])
    for ends, lower in (("cells", 0.0), ("vertices", math.sqrt(3))):
        found = bounds(CubeIntervals(1, "paper", "tiles", ends)._directed_surfaces(a, b))
        assert found == (lower, 2 * math.sqrt(3))
        # The planes are a quarter apart: the interval from the vertices is false.
        assert (found[0] <= 0.25) == (ends == "cells")


EMPTY = parsed("(x - 0.3)^2 + (y - 0.3)^2 + (z - 0.3)^2 + 1e-4")


@pytest.mark.slow
def test_a_surface_without_points_gets_no_number_from_the_safe_rule():
    invented = CubeIntervals(64, rule="paper")._directed_surfaces(EMPTY, BALL)
    assert float(invented.lower) > 0.3
    there, back = CubeIntervals(64)._directed_surfaces(EMPTY, BALL), CubeIntervals(64)._directed_surfaces(BALL, EMPTY)
    both = CubeIntervals(64)._surfaces(BALL, EMPTY)
    for solution in (there, back, both):
        assert name_of(solution.result) == "existence_not_certified" and np.isnan(solution.value)
    assert float(there.lower) == 0 and float(back.upper) == math.inf == float(both.upper)
    # Smaller cells show that it is empty.
    with pytest.raises(ValueError, match="the surface is empty"):
        voxelize(EMPTY, 512)


def sphere(x, radius, lower, upper, size):
    a = np.zeros((3, 3, 3))
    a[2, 0, 0] = a[0, 2, 0] = a[0, 0, 2] = 1
    a[1, 0, 0], a[0, 0, 0] = -2 * x * size, (x * x - radius * radius) * size * size
    return ImplicitSurface(a, np.array(lower) * size, np.array(upper) * size)


def farthest(distance, radius, other):
    """Exact directed distance of two whole spheres: over a sphere the distances from the other center fill a range."""
    return max(abs(end - other) for end in (abs(distance - radius), distance + radius))


def check_spheres(seed, size, separable):
    """Random spheres on one line, in one cube or in boxes of their own, against their exact distances."""
    rng = np.random.default_rng(seed)
    x, y = rng.integers(-16, 17, 2) / 16
    radii = rng.integers(8, 24, 2) / 16
    ends = [([c - r, -r, -r], [c + r, r, r]) for c, r in zip((x, y), radii, strict=True)]
    room = rng.integers(1, 9, (2, 2, 3)) / 8
    boxes = [(low - more[0], high + more[1]) for (low, high), more in zip(ends, room, strict=True)]
    if separable:
        reach = np.abs(boxes).max()
        boxes = [(np.full(3, -reach), np.full(3, reach))] * 2
    a, b = (sphere(c, r, *box, size) for c, r, box in zip((x, y), radii, boxes, strict=True))
    method, apart = CubeIntervals(16), Fraction(float(abs(x - y)))
    exact = [farthest(apart, Fraction(r), Fraction(s)) * Fraction(size) for r, s in (radii, radii[::-1])]
    for solution, z in ((method._directed_surfaces(a, b), exact[0]), (method._surfaces(a, b), max(exact))):
        lower, upper = bounds(solution)
        assert Fraction(lower) <= z and (math.isinf(upper) or z <= Fraction(upper))
    if separable:
        tiles = CubeIntervals(method.cells, pairs="tiles")._directed_surfaces(a, b)
        assert bounds(tiles) == bounds(method._directed_surfaces(a, b))


@pytest.mark.parametrize(
    ("seed", "separable"), swept(itertools.product(range(3), [True, False]), quick=[(0, True), (1, False)])
)
def test_intervals_hold_the_exact_distance_of_spheres(seed, separable):
    check_spheres(seed, 1.0, separable)


@pytest.mark.parametrize(
    ("seed", "size", "separable"),
    swept(
        itertools.product(range(10, 14), [1.0, 2.0**500, 2.0**-500], [True, False]),
        slow=[(10, 2.0**500, True), (11, 2.0**-500, False)],
    ),
)
def test_intervals_hold_the_exact_distance_of_spheres_of_all_sizes(seed, size, separable):
    check_spheres(seed, size, separable)


@pytest.mark.parametrize("unit", [Fraction(1, 3), Fraction(1, 16), Fraction(3, 7) * 2**900, Fraction(1, 2**900)])
def test_lengths_are_rounded_outward_by_one_float_or_not_at_all(unit):
    scale = cube_intervals._Scale(unit, exact=True)
    for square in (0, 1, 2, 136, 206, 3 * 257**2):
        lower, upper = (float(x) for x in scale.lengths(square, square, outward=True))
        exact = square * unit**2
        assert Fraction(lower) ** 2 <= exact <= Fraction(upper) ** 2
        assert upper <= math.nextafter(lower, math.inf)
        # Only the square roots that are floats are kept.
        assert (lower == upper) == (square == 0 or (square == 1 and Fraction(float(unit)) == unit))
    assert float(scale.lengths(1, math.inf, outward=True)[1]) == math.inf
    assert Fraction(float(scale.lengths(1, 4, outward=True)[1])) ** 2 >= 4 * unit**2


def test_rounded_squares_get_the_room_of_five_roundings():
    lower, upper = cube_intervals._Scale(Fraction(1), exact=False).lengths(2.0, 2.0, outward=True)
    least, most = Fraction(2) * (1 - Fraction(5, 2**53)), Fraction(2) * (1 + Fraction(5, 2**53))
    assert Fraction(float(lower)) ** 2 < least and most < Fraction(float(upper)) ** 2
    assert float(upper) - float(lower) < 20 * 2**-53


def test_cells_in_common_coordinates_cover_the_exact_ones():
    a, b = parsed("x + y - 1", [0.1, 0.2, -0.3], [0.7, 1.3, 0.1]), parsed("z", [-1 / 3, 0, -0.1], [1.1, 0.3, 0.7])
    *both, scale = CubeIntervals(7)._cells(a, b, None)
    origin = [Fraction(x) for x in a.lower.tolist()]
    rounded = 0
    for cells, surface in zip(both, (a, b), strict=True):
        for axis in range(3):
            low, high = (Fraction(float(end[axis])) for end in surface.bounds)
            for i, below, above in zip(cells.places[:, axis], cells.lower[axis], cells.upper[axis], strict=True):
                ends = [(low + (high - low) * (int(i) + k) / 7 - origin[axis]) / scale.unit for k in (0, 1)]
                assert Fraction(float(below)) <= ends[0] and ends[1] <= Fraction(float(above))
                rounded += Fraction(float(below)) < ends[0]
    assert rounded > 0


def test_far_from_the_origin_nothing_is_lost():
    near = CubeIntervals(16)._surfaces(parsed("x^2 + y^2 + z^2 - 1"), parsed("x^2 + y^2 + z^2 - 2.25"))
    shift = 2.0**20
    moved = [parsed(f"x^2 + y^2 + z^2 - {r}").transform(np.eye(3), [shift, 0.0, -shift]) for r in (1, 2.25)]
    assert bounds(CubeIntervals(16)._surfaces(*moved)) == bounds(near)


def test_boxes_of_their_own_are_compared_in_tiles():
    # Different boxes: the part of the plane that each surface is differs, and so do the grids.
    a = parsed("z", [0, 0, -1], [1, 1, 1])
    b = parsed("z - 0.5", [0, 0, -1], [3, 1, 1.5])
    there, back = CubeIntervals(20)._directed_surfaces(a, b), CubeIntervals(20)._directed_surfaces(b, a)
    for solution, exact in ((there, 0.5), (back, math.sqrt(4.25))):
        lower, upper = bounds(solution)
        assert lower <= exact <= upper and upper - lower < 0.6


def test_a_surface_on_itself_has_lower_bound_zero():
    lower, upper = bounds(CubeIntervals(32)._surfaces(BALL, BALL))
    assert lower == 0 < upper <= 2 * math.sqrt(3) / 8 * (1 + 1e-15)


def test_progress_is_reported_for_both_surfaces():
    seen = []
    CubeIntervals(16)._surfaces(*CONES, progress=seen.append)
    assert [x.done for x in seen] == [0, 1, 2, 3, 4] * 2


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"cells": 0}, ValueError, "cells is 0; needs 1 to 1048576"),
        ({"cells": 2.5}, TypeError, "cells must be a whole number; got float"),
        ({"rule": "fast"}, ValueError, "rule is 'fast'; needs 'safe' or 'paper'"),
        ({"pairs": "some"}, ValueError, "pairs is 'some'; needs 'separable' or 'tiles'"),
        ({"ends": "vertices"}, ValueError, "ends is 'vertices', which certifies no bound; use it with rule='paper'"),
    ],
)
def test_other_options_are_refused(options, kind, message):
    with pytest.raises(kind, match=message):
        CubeIntervals(**options)


@pytest.mark.usefixtures("as_a_user")
def test_curves_are_refused():
    curve = jhd.point_set([[0.0, 0.0, 0.0]])
    with pytest.raises(TypeError, match="b must be an ImplicitSurface; got BezierSegments"):
        CubeIntervals()._surfaces(BALL, curve)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="AlgebraicEvents.. for BezierSegments and BezierSegments; got CubeIntervals"):
        jhd.hausdorff(curve, curve, CubeIntervals())


def test_the_entries_take_surfaces():
    small = CubeIntervals(16)
    assert bounds(jhd.directed_hausdorff(*CONES, small)) == bounds(small._directed_surfaces(*CONES))
    assert bounds(jhd.hausdorff(*CONES, small)) == bounds(small._surfaces(*CONES))
    paper = jhd.hausdorff(*CONES, CubeIntervals(16, rule="paper"))
    assert name_of(paper.result) == "not_certified"


def test_a_surface_that_proves_nothing_raises_and_keeps_what_is_known():
    point = parsed("(x - 0.3)^2 + y^2 + z^2")
    with pytest.raises(jhd.NotProvenError, match="raise cells") as caught:
        jhd.hausdorff(point, CONES[0], CubeIntervals(16))
    lower, upper = bounds(caught.value.solution)
    assert lower <= upper == math.inf


@pytest.mark.parametrize(
    ("shapes", "method", "message"),
    [
        ((CONES[0], "x^2 - 1"), None, "b: text is not a shape: .*ImplicitSurface.parse reads polynomials; got str."),
        (
            CONES,
            jhd.published.TwoStep(),
            r"BranchAndBound\(\) or CubeIntervals\(\) for ImplicitSurface and ImplicitSurface; got TwoStep.",
        ),
        (
            (jhd.circle([0.0, 0.0], 1.0),) * 2,
            CubeIntervals(),
            "AlgebraicEvents.. for BezierSegments and BezierSegments; got",
        ),
    ],
)
def test_pairs_and_methods_that_do_not_go_together_are_refused(shapes, method, message, as_a_user):
    with pytest.raises(TypeError, match=message):
        jhd.hausdorff(shapes[0], shapes[1], method)
