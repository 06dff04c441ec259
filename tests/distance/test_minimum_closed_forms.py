"""Minimum distances against closed forms: each mix of kinds, apart, touching, crossing, one inside the other, moved.

The shapes of a family have the same numbers of pieces and degrees, so that each family runs in one program. The exact
distance is that of the shapes as they are meant; what their stored floats differ from it is the slack of its case.
"""

import itertools
from fractions import Fraction

import numpy as np
import pytest

import jhd
from jhd._distance.minimum import minimum_distance
from tests.sweeps import swept

# The default tolerance in diagonals is 1e-10 of the box of both shapes; what a family of nearest pairs leaves open.
GAP = 1e-9


def check(a, b, exact, slack=0.0, gap=GAP):
    """lower <= exact <= upper both ways round, the points lie as far apart as the value, and the gap is closed."""
    for p, q in ((a, b), (b, a)):
        found = minimum_distance(p, q)
        assert found.lower <= exact + slack and exact - slack <= found.upper, (found, exact)
        assert found.lower <= found.value <= found.upper and found.upper - found.lower <= gap, found
        apart = np.linalg.norm(np.asarray(found.point_a) - np.asarray(found.point_b))
        size = max(1.0, np.max(np.abs(found.point_a)), np.max(np.abs(found.point_b)))
        assert abs(apart - float(found.value)) <= 1e-12 * size


# ---- circles -------------------------------------------------------------------------------------

CIRCLES = {
    "apart": ((0, 0), 1, (5, 0), 2),
    "apart at an angle": ((1, 2), 0.5, (4, 6), 1.5),
    "touching from outside": ((0, 0), 1, (3, 0), 2),
    "touching from inside": ((0, 0), 3, (1, 0), 2),
    "crossing": ((0, 0), 2, (2, 1), 1.5),
    "inside": ((0, 0), 4, (1, 0.5), 1),
    "a small one beside a large one": ((0, 0), 1e3, (1e3 + 2, 0), 1e-3),
    "close": ((0, 0), 1, (2 + 2.0**-20, 0), 1),
}


def between_circles(p, r, q, s):
    centers = np.hypot(*np.subtract(p, q))
    return max(centers - r - s, abs(r - s) - centers, 0.0)


@pytest.mark.parametrize("scale", swept([2.0**-30, 1.0, 2.0**30], 1))
@pytest.mark.parametrize("name", CIRCLES)
def test_circles(name, scale):
    p, r, q, s = CIRCLES[name]
    a, b = jhd.circle(np.multiply(p, scale), r * scale), jhd.circle(np.multiply(q, scale), s * scale)
    size = scale * (np.max(np.abs([*p, *q])) + max(r, s))
    check(a, b, scale * between_circles(p, r, q, s), slack=4e-16 * size, gap=GAP * size)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (2.0**20, -(2.0**18)), (-(2.0**40), 2.0**40)])
def test_a_translation_that_rounds_nothing_changes_nothing(offset):
    a, b = jhd.circle([0, 0], 1.0).control_points, jhd.circle([4, 3], 2.0).control_points
    # Their control points on a grid that the offsets keep, without weights.
    grid = 2.0**-10
    a, b = (np.round(np.asarray(x) / grid) * grid for x in (a, b))
    near = minimum_distance(jhd.BezierSegments(a), jhd.BezierSegments(b))
    far = minimum_distance(jhd.BezierSegments(a + offset), jhd.BezierSegments(b + offset))
    assert near.lower <= far.upper and far.lower <= near.upper
    assert far.upper - far.lower <= GAP and abs(float(far.value - near.value)) <= GAP


# ---- straight segments in space, exactly -----------------------------------------------------------


def dot(u, v):
    return sum(x * y for x, y in zip(u, v, strict=True))


def minus(u, v):
    return [x - y for x, y in zip(u, v, strict=True)]


def point_to_segment_sq(p, a, b):
    """The squared distance of a point from a segment, in rational numbers."""
    d = minus(b, a)
    length = dot(d, d)
    t = Fraction(0) if length == 0 else max(Fraction(0), min(Fraction(1), dot(minus(p, a), d) / length))
    off = minus(p, [x + t * y for x, y in zip(a, d, strict=True)])
    return dot(off, off)


def segments_sq(a, b):
    """The squared distance of two segments: at an end of one of them, or where the join is normal to both."""
    (p, q), (r, s) = ([[Fraction(x) for x in row] for row in rows.tolist()] for rows in (a, b))
    found = [point_to_segment_sq(p, r, s), point_to_segment_sq(q, r, s)]
    found += [point_to_segment_sq(r, p, q), point_to_segment_sq(s, p, q)]
    d, e, f = minus(q, p), minus(s, r), minus(p, r)
    dd, de, ee, df, ef = dot(d, d), dot(d, e), dot(e, e), dot(d, f), dot(e, f)
    determinant = dd * ee - de * de
    if determinant:
        t, u = (de * ef - ee * df) / determinant, (dd * ef - de * df) / determinant
        if 0 <= t <= 1 and 0 <= u <= 1:
            off = [x + t * y - u * z for x, y, z in zip(f, d, e, strict=True)]
            found.append(dot(off, off))
    return min(found)


def holds_square(found, square):
    return Fraction(float(found.lower)) ** 2 <= square <= Fraction(float(found.upper)) ** 2


SPECIAL = {
    "crossing": ([[0, 0, 0], [2, 2, 2]], [[0, 2, 0], [2, 0, 2]]),
    "end on the other": ([[0, 0, 0], [4, 0, 0]], [[1, 0, 0], [1, 5, 2]]),
    "one line, apart": ([[0, 0, 0], [1, 1, 1]], [[2, 2, 2], [5, 5, 5]]),
    "skew": ([[0, 0, 0], [4, 0, 0]], [[2, -1, 3], [2, 1, 3]]),
    "a point": ([[1, 2, 3], [1, 2, 3]], [[0, 0, 0], [4, 0, 0]]),
    "nearly parallel": ([[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1 - 2.0**-30, 0]]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECIAL)
def test_segments_in_space(name):
    a, b = (np.array(rows, dtype=float) for rows in SPECIAL[name])
    found = minimum_distance(jhd.BezierCurve(a), jhd.BezierCurve(b), throw=False)
    assert holds_square(found, segments_sq(a, b))
    assert found.upper - found.lower <= 1e-7


@pytest.mark.slow
def test_random_segments_in_space_on_a_grid():
    random, wrong = np.random.default_rng(0), []
    for seed in range(40):
        # Whole numbers: ends that touch, parallel and crossing segments are frequent.
        a, b = random.integers(-2, 3, size=(2, 2, 3)).astype(float)
        found = minimum_distance(jhd.BezierCurve(a), jhd.BezierCurve(b), throw=False)
        if not (holds_square(found, segments_sq(a, b)) and found.lower <= found.value <= found.upper):
            wrong.append((seed, a.tolist(), b.tolist(), found))
    assert not wrong


# ---- random curves, against samples from both sides ----------------------------------------------


def test_bounds_of_random_cubics_are_on_both_sides_of_dense_samples():
    random, wrong = np.random.default_rng(1), []
    u = np.linspace(0, 1, 201)
    for seed in range(24):
        a, b = random.normal(size=(2, 4, 2)) + [[[0, 0]], [[1.5 * (seed % 4), 0]]]
        curves = jhd.BezierCurve(a), jhd.BezierCurve(b)
        found = minimum_distance(*curves, throw=False)
        x, y = (np.asarray(curve(u)) for curve in curves)
        least = np.sqrt(np.min(np.sum((x[:, None] - y[None]) ** 2, axis=-1)))
        # Every point lies within half a step of a sample, whose length the hodograph bounds.
        reach = sum(3 * np.max(np.linalg.norm(np.diff(rows, axis=0), axis=1)) for rows in (a, b)) * u[1] / 2
        if not (found.lower <= least and least - reach <= found.upper and found.lower <= found.value <= found.upper):
            wrong.append((seed, found, least))
    assert not wrong


# ---- points --------------------------------------------------------------------------------------


def test_points_to_a_circle_and_to_points():
    random = np.random.default_rng(2)
    for shift in (0.0, 1.5, 6.0):
        rows = 0.5 * random.normal(size=(4, 2)) + [shift, 0]
        exact = np.min(np.abs(np.hypot(*rows.T) - 2))
        check(jhd.point_set(rows), jhd.circle([0, 0], 2.0), exact, slack=1e-15)
        others = random.normal(size=(4, 2))
        exact = np.min(np.hypot(*(rows[:, None] - others[None]).transpose(2, 0, 1)))
        check(jhd.point_set(rows), jhd.point_set(others), exact, slack=4e-16)


# ---- surfaces ------------------------------------------------------------------------------------

THIRDS = np.arange(4) / 3


def patch(height):
    """A bicubic over [0, 1]^2 whose net has these heights; a plane net is the plane, up to the thirds."""
    x, y = np.meshgrid(THIRDS, THIRDS, indexing="ij")
    return jhd.BezierPatch(np.stack([x, y, height(x, y)], axis=-1))


def along(start, end):
    return jhd.BezierCurve(np.linspace(start, end, 4))


PLATE = patch(lambda x, y: 0 * x)
SLOPE = 0.5
CURVES = {
    "above, upright": (along([0.5, 0.5, 1], [0.5, 0.5, 3]), PLATE, 1.0),
    "through": (along([0.5, 0.25, -1], [0.5, 0.5, 2]), PLATE, 0.0),
    "beside": (along([2, 0.5, -1], [2, 0.5, 1]), PLATE, 1.0),
    "off a corner": (along([4, 5, 0], [7, 9, 0]), PLATE, 5.0),
    "above a slope": (along([0.5, 0.5, 1.25], [0.5, 0.5, 3]), patch(lambda x, y: SLOPE * x), 1 / np.hypot(1, SLOPE)),
}


@pytest.mark.parametrize("name", swept(CURVES, slow=CURVES))
def test_a_curve_and_a_patch(name):
    curve, surface, exact = CURVES[name]
    check(curve, surface, exact, slack=2e-15)


@pytest.mark.parametrize(("height", "exact"), [(1.0, 1.0), (2.0**-16, 2.0**-16), (0.0, 0.0), (-0.125, 0.0)])
@pytest.mark.slow
def test_a_bowl_over_a_plate(height, exact):
    # The net of heights (1, -1/3, -1/3, 1) is that of (2 u - 1)^2.
    parabola = np.array([1, -1 / 3, -1 / 3, 1])
    bowl = patch(lambda x, y: parabola[:, None] + parabola[None] + height)
    check(bowl, PLATE, exact, slack=2e-15)


SPHERE = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 9", [-3] * 3, [3] * 3)
TO_SPHERE = {
    "beside": (along([-1, 0, 5], [1, 0, 5]), 2.0),
    "inside": (along([0, 0, 0], [0.5, 0.5, 0.5]), 3 - np.sqrt(0.75)),
    "through": (along([0, 0, 0], [0, 6, 0]), 0.0),
    "touching": (along([-1, 3, 0], [1, 3, 0]), 0.0),
    "ending near": (along([3, 4, 0], [6, 8, 0]), 2.0),
}


# Inside, where the distance is nearly the same all along, the table grows, which compiles again.
@pytest.mark.parametrize("name", swept(TO_SPHERE, slow=["beside"]))
def test_a_curve_and_a_sphere(name):
    curve, exact = TO_SPHERE[name]
    check(curve, SPHERE, exact, slack=2e-15, gap=1e-8)


@pytest.mark.parametrize(("height", "exact"), swept([(3.0 + 2.0**-12, 2.0**-12), (4.0, 1.0), (1.0, 0.0)], slow=1))
def test_a_patch_and_a_sphere(height, exact):
    x, y = np.meshgrid(4 * THIRDS - 2.25, 4 * THIRDS - 1.75, indexing="ij")
    plate = jhd.BezierPatch(np.stack([x, y, np.full_like(x, height)], axis=-1))
    check(plate, SPHERE, exact, slack=2e-15, gap=1e-8)


# ---- meshes --------------------------------------------------------------------------------------


def box(low, high):
    """The twelve triangles of a box."""
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))), dtype=float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return jhd.TriangleMesh(corners, [[f[0], f[i], f[i + 1]] for f in faces for i in (1, 2)])


BOXES = {
    "face to face": (([0, 0, 0], [1, 1, 1]), ([3, 0, 0], [4, 1, 1]), 4),
    "edge to edge": (([0, 0, 0], [1, 1, 1]), ([4, 5, 0], [6, 6, 1]), 25),
    "corner to corner": (([0, 0, 0], [1, 1, 1]), ([3, 4, 7], [5, 6, 8]), 4 + 9 + 36),
    "one inside the other": (([-4, -4, -4], [4, 4, 4]), ([-1, -1, 0], [1, 2, 3]), 1),
    "sharing a corner": (([0, 0, 0], [1, 1, 1]), ([1, 1, 1], [2, 2, 2]), 0),
    "crossing": (([0, 0, 0], [2, 2, 2]), ([1, 1, 1], [3, 3, 3]), 0),
}


@pytest.mark.parametrize("name", BOXES)
def test_boxes(name):
    first, second, square = BOXES[name]
    found = minimum_distance(box(*first), box(*second))
    # Next to each other, both ways round.
    assert holds_square(found, Fraction(square)) and found.upper <= np.nextafter(found.lower, np.inf)
    back = minimum_distance(box(*second), box(*first))
    assert (back.lower, back.upper) == (found.lower, found.upper)


def test_points_and_a_polyline_against_a_box():
    cube = box([-1, -1, -1], [1, 1, 1])
    check(jhd.point_set([[4.0, 0, 0], [0, 3, 0], [0, 0, -9]]), cube, 2.0)
    check(jhd.point_set([[0.25, 0.0, 0.5]]), cube, 0.5)
    check(jhd.polyline([[-5.0, 4, 0], [5, 4, 0], [5, 9, 0]]), cube, 3.0)
    check(jhd.polyline([[0.0, 0, 0], [5, 4, 0]]), cube, 0.0)
