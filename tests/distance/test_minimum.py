"""Minimum distances: bounds hold the exact value, shapes meet, derivatives, refusals, the published voxel method."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jhd._distance.hausdorff import directed_hausdorff, hausdorff, hausdorff_at_most
from jhd._distance.minimum import minimum_distance
from jhd._distance.published.cube_intervals import CubeIntervals
from jhd._distance.published.two_step import TwoStep
from jhd._distance.published.voxel_pairs import VoxelPairs
from jhd._distance.search.branch_and_bound import BranchAndBound, chosen_method
from jhd._results.solution import RESULTS, NotProvenError, name_of
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.patch import BezierPatch
from jhd._shapes.simple_curves import circle, point_set, polyline
from tests.distance.test_nonisolated_maxima import sphere
from tests.sweeps import swept

# A cubic that rises to 0.75 at its middle, where its curvature is 6.
ARCH = np.array([[0.0, 0], [1, 1], [2, 1], [3, 0]]) / [3, 1]
GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, 4)] * 2, indexing="ij"), axis=-1)
# Central differences of a value with an error of 1e-15 and the step 1e-5.
DIFFERENCES = 1e-8


def surface(heights, z=0.0):
    return BezierPatch(np.concatenate([GRID, z + np.asarray(heights)[..., None]], axis=-1))


def holds(found, exact, width):
    """lower <= exact <= upper without any tolerance; the exact value may be an interval of floats."""
    low, high = np.min(exact), np.max(exact)
    return found.lower <= high and found.upper >= low and found.upper - found.lower <= width


def sampled(a, b, parameters):
    """The least distance over samples, refined by a local method from the nearest of them."""
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 12)] * parameters, indexing="ij"), axis=-1).reshape(-1, parameters)
    apart = np.sum((np.asarray(a(*grid.T))[:, None] - np.asarray(b(*grid.T))[None]) ** 2, axis=-1)
    starts = np.argsort(apart, axis=None)[::29][:6]

    def square(x):
        e = np.asarray(a(*x[:parameters])) - np.asarray(b(*x[parameters:]))
        return float(e @ e)

    best = apart.min()
    for start in starts:
        i, j = divmod(int(start), len(grid))
        x = np.concatenate([grid[i], grid[j]])
        best = min(best, minimize(square, x, bounds=[(0, 1)] * x.size, method="L-BFGS-B").fun)
    return best**0.5


@pytest.mark.parametrize(
    ("name", "a", "b", "exact"),
    [
        ("sampled", ARCH, ARCH + [0, 2.0], None),
        ("middle to middle", ARCH, ARCH * [1, -1] + [0, 2.0], 0.5),
        ("end to middle", ARCH, np.stack([np.full(4, 0.5), np.linspace(1, 2, 4)], axis=1), 0.25),
        ("crossing", ARCH, ARCH * [1, -1] + [0, 1.0], 0.0),
        ("touching", ARCH, ARCH * [1, -1] + [0, 1.5], 0.0),
        ("gap of 1e-6", ARCH, ARCH * [1, -1] + [0, 1.5 + 2.0**-20], 2.0**-20),
        ("coincident", ARCH, ARCH, 0.0),
        ("reversed", ARCH, ARCH[::-1], 0.0),
        ("a point", ARCH, np.tile([0.5, 1.0], (4, 1)), 0.25),
        ("far away", ARCH + 2.0**30, ARCH * [1, -1] + [0, 2.0] + 2.0**30, 0.5),
        ("parallel lines", np.linspace([0, 0], [1, 0], 4), np.linspace([0.25, 1], [2, 1], 4), 1.0),
    ],
)
def test_bounds_of_curves_hold_the_exact_distance(name, a, b, exact):
    if exact is None:
        exact = sampled(BezierCurve(a), BezierCurve(b), 1)
    scale = max(1.0, float(np.abs(a).max()))
    found = minimum_distance(BezierCurve(a), BezierCurve(b))
    assert found.lower <= found.value <= found.upper
    # The samples and the offset coordinates are rounded.
    slack = 1e-9 if name == "sampled" else (4 * scale * 2.0**-53 if scale > 1 else 0.0)
    assert holds(found, [exact - slack, exact + slack], 2e-9)
    apart = np.linalg.norm(np.asarray(found.point_a) - np.asarray(found.point_b))
    assert abs(apart - float(found.value)) <= 1e-12 * scale


@pytest.mark.slow
def test_rational_curves_and_shapes_of_many_pieces():
    a, b = circle([0, 0], 3.0), circle([0, 7], 2.0)
    found = minimum_distance(a, b)
    # The stored circles are rounded.
    assert holds(found, [2 - 1e-15, 2 + 1e-15], 1e-9)
    np.testing.assert_allclose(found.point_a, [0, 3], atol=1e-7)
    inside = minimum_distance(circle([0, 0], 3.0), circle([0.5, 0], 1.0))
    assert holds(inside, [1.5 - 1e-15, 1.5 + 1e-15], 1e-9)


def test_point_sets_and_polylines_are_curves_too():
    found = minimum_distance(point_set([[0.0, 0], [5, 5]]), polyline([[5.0, 6], [9, 6]]))
    assert holds(found, 1.0, 1e-8) and found.point_a.tolist() == [5, 5]


MOVE = jnp.array([0.1, 2.0])


def distance_of(rows, move):
    return minimum_distance(BezierCurve(rows), BezierCurve(ARCH * [1, -1] + move)).value


@pytest.mark.slow
def test_the_derivatives_are_those_of_differences():
    rows, h = jnp.asarray(ARCH), 1e-5
    slope = jax.grad(distance_of)(rows, MOVE)
    for i, j in ((1, 0), (2, 1)):
        step = jnp.zeros_like(rows).at[i, j].set(h)
        found = (distance_of(rows + step, MOVE) - distance_of(rows - step, MOVE)) / (2 * h)
        assert abs(float(found - slope[i, j])) < DIFFERENCES


@pytest.mark.slow
def test_derivatives_are_the_same_under_jit_and_in_a_batch_and_zero_where_curves_meet():
    rows = jnp.asarray(ARCH)
    moves = jnp.stack([MOVE, jnp.array([0.0, 2.0]), jnp.array([0.0, 1.0])])
    both = jax.jit(jax.vmap(jax.value_and_grad(distance_of, 1), (None, 0)))
    values, slopes = both(rows, moves)
    np.testing.assert_allclose(values[1:], [0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(slopes[0], jax.grad(distance_of, 1)(rows, MOVE), atol=1e-10)
    # At distance zero the derivative is zero by convention.
    np.testing.assert_allclose(slopes[1:], [[0, 1], [0, 0]], atol=1e-7)


@pytest.mark.exhaustive
def test_derivatives_are_zero_where_a_patch_crosses_a_surface_and_points_meet_but_for_rounding():
    saddle = ImplicitSurface.parse("z - x*y", [-1, -1, -1], [1, 1, 1])
    corners = 0.7 * jnp.array([[[-1, -1, -0.5], [-1, 1, 0.3]], [[1, -1, 0.4], [1, 1, -0.7]]])
    value, slope = jax.value_and_grad(lambda x: minimum_distance(BezierPatch(x), saddle).value)(corners)
    assert 0 <= float(value) < 1e-14
    np.testing.assert_array_equal(slope, 0.0)
    place = BezierPatch(corners)(0.3, 1 / 3) + 2e-17
    value, slope = jax.value_and_grad(lambda x: minimum_distance(point_set(place[None]), BezierPatch(x)).value)(corners)
    assert 0 <= float(value) < 1e-14
    np.testing.assert_array_equal(slope, 0.0)


@pytest.mark.parametrize("gap", swept([1e-5, 1e-7, 1e-9]))
def test_ends_and_borders_that_nearly_touch_hold_their_place(gap):
    flat = BezierPatch(np.array([[[-1.0, -1, 0], [-1, 1, 0]], [[1, -1, 0], [1, 1, 0]]]))
    segment, tip = np.array([[0.1, 0.2, 0], [1, 0.5, 1]]), np.array([[0.3, 1, 0], [0.4, 1.5, 0.3]])
    up, along = jnp.array([0, 0, 1.0]), jnp.array([0, 0.6, 0.8])
    over = jax.grad(lambda t: minimum_distance(BezierCurve(segment + t * up), flat).value)(gap)
    np.testing.assert_allclose(over, 1.0, rtol=1e-6)
    for shape in (BezierCurve, lambda x: point_set(x[:1])):
        # The foot is on a side of the patch.
        beside = jax.grad(lambda t, shape=shape: minimum_distance(shape(tip + t * along), flat).value)(gap)
        np.testing.assert_allclose(beside, 1.0, rtol=1e-6)


@pytest.mark.slow
def test_second_derivatives_follow_the_nearest_points():
    def distance(x):
        return minimum_distance(BezierCurve(ARCH), point_set(jnp.stack([x, jnp.asarray(1.5)])[None])).value

    h = 1e-4
    second = jax.grad(jax.grad(distance))(0.45)
    difference = (jax.grad(distance)(0.45 + h) - jax.grad(distance)(0.45 - h)) / (2 * h)
    assert abs(float(second - difference)) < 1e-5


@pytest.mark.exhaustive
def test_numbers_that_are_known_late_and_unusable_are_reported():
    found = jax.jit(lambda x: minimum_distance(BezierCurve(ARCH * x), BezierCurve(ARCH + 3.0)))(jnp.nan)
    assert name_of(found.result) == "nonfinite_value" and found.lower == 0 and np.isinf(found.upper)


@pytest.mark.parametrize(
    ("a", "options", "error", "message"),
    [
        (3, {}, TypeError, "a must be a shape of jhd, an array of points"),
        (BezierCurve(np.zeros((2, 3))), {}, ValueError, "a has 3 coordinates a point and b has 2"),
        (BezierCurve(ARCH), {"atol": -1.0}, ValueError, "atol is -1; needs a number of at least 0"),
        (BezierCurve(ARCH), {"rtol": np.zeros(2)}, ValueError, r"rtol has shape \(2,\)"),
        (BezierCurve(ARCH), {"max_steps": 9}, TypeError, "takes no max_steps: write method=jhd.Branch"),
        (BezierCurve(ARCH), {"tolerance": 0.1}, TypeError, "takes no tolerance: write atol=... .a length. or rtol="),
        (BezierCurve(ARCH), {"method": "fast"}, TypeError, r"method must be BranchAndBound\(\) for BezierCurve and"),
        (BezierCurve(ARCH), {"method": VoxelPairs(0.1)}, TypeError, "for BezierCurve and BezierCurve; got VoxelPairs"),
    ],
)
def test_what_is_no_question_is_refused(as_a_user, a, options, error, message):
    with pytest.raises(error, match=message):
        minimum_distance(a, BezierCurve(ARCH + 3.0), **options)


def test_a_search_that_is_cut_short_says_so_and_its_bounds_are_true():
    a, b = BezierCurve(ARCH), BezierCurve(ARCH * [1, -1] + [0.1, 2.5])
    with pytest.raises(NotProvenError) as caught:
        minimum_distance(a, b, BranchAndBound(max_steps=0))
    reached, full = caught.value.solution, minimum_distance(a, b)
    assert name_of(reached.result) == "gap_not_closed"
    assert reached.lower <= full.lower and reached.upper >= full.upper and reached.lower > 0


def test_a_method_holds_the_options_and_not_both_are_given():
    a, b = BezierCurve(ARCH), BezierCurve(ARCH * [1, -1] + [0.1, 2.5])
    for entry in (minimum_distance, hausdorff):
        found = [entry(a, b, BranchAndBound(atol=0.5, rtol=0.1)), entry(a, b, atol=0.5, rtol=0.1)]
        assert (found[0].lower, found[0].upper) == (found[1].lower, found[1].upper)
        with pytest.raises(ValueError, match="rtol is -1"):
            entry(a, b, rtol=-1.0)
        other = entry(a, b, BranchAndBound(rtol=0.1, max_steps=100), atol=0.5)
        assert (found[0].lower, found[0].upper) == (other.lower, other.upper)
        with pytest.raises(TypeError, match="^rtol stands in the method and in the call: pass it once"):
            entry(a, b, BranchAndBound(rtol=0.2), atol=0.5, rtol=0.1)
    # The default of a method that is made inside jit is traced.
    assert float(jax.jit(lambda: chosen_method(BranchAndBound(max_steps=9), 0.25, None).rtol)()) == 0.25
    with pytest.raises(TypeError, match="atol cannot be combined with TwoStep: pass its own options"):
        hausdorff(a, b, TwoStep(), atol=0.5)


def test_the_time_limit_ends_a_search_with_the_bounds_reached():
    a, b = circle([0, 0], 1.0), circle([0, 0], 1.5)
    hard = {"method": BranchAndBound(atol=1e-14, max_steps=10**6), "max_seconds": 1e-3, "throw": False}
    for entry in (minimum_distance, directed_hausdorff):
        found = entry(a, b, **hard)
        assert name_of(found.result) == "out_of_time" and found.lower <= 0.5 <= found.upper
    assert not hausdorff_at_most(a, b, 0.5, hard["method"], max_seconds=1e-3).ok
    with pytest.raises(TypeError, match="max_seconds cannot be combined with CubeIntervals"):
        hausdorff(a, b, CubeIntervals(), max_seconds=1)
    with pytest.raises(ValueError, match="max_seconds is 0; needs a positive number"):
        minimum_distance(a, b, max_seconds=0)


def test_progress_is_reported():
    seen = []
    full = minimum_distance(BezierCurve(ARCH), BezierCurve(ARCH + [0.1, 2.0]), progress=seen.append)
    assert seen and all(x.lower <= full.value <= x.upper and x.stage == "minimum" for x in seen)
    assert seen[-1].done == int(full.stats["steps"])


def test_the_solution_prints_and_becomes_json():
    found = minimum_distance(BezierCurve(ARCH), BezierCurve(ARCH * [1, -1] + [0, 2.0]))
    assert "between (0.5, 0.75) and (0.5, 1.25), successful" in repr(found)
    assert '"result": "successful"' in found.to_json() and abs(float(found) - 0.5) < 1e-12


@pytest.mark.parametrize(("seed", "rational"), swept(itertools.product(range(4), [False, True]), slow=[(1, True)]))
def test_bounds_of_random_patches_are_on_both_sides_of_local_minima(seed, rational):
    random = np.random.default_rng(seed)
    weights = [np.exp(0.7 * random.normal(size=(4, 4))) if rational else None for _ in range(2)]
    a = BezierPatch(random.normal(size=(4, 4, 3)), weights[0])
    b = BezierPatch(random.normal(size=(4, 4, 3)) + [0, 0, 4.0 * (seed % 3)], weights[1])
    found = minimum_distance(a, b)
    local = sampled(a, b, 2)
    assert found.lower <= local + 1e-12 and found.upper <= local + 1e-7
    assert found.upper - found.lower <= 1e-8


@pytest.mark.slow
def test_patches_that_touch_and_tiny_gaps():
    flat, bowl = np.zeros((4, 4)), 0.2 + 2 * ((GRID - 0.5) ** 2).sum(-1)
    # The net of u^2 + v^2 about the middle has its least value at the middle; the same by evaluation.
    least = float(np.asarray(surface(bowl)(0.5, 0.5))[2])
    for gap in (0.0, 1e-10, 1e-6, 1e-3):
        found = minimum_distance(surface(flat), surface(bowl, gap - least), atol=1e-12)
        assert holds(found, [max(gap - 1e-15, 0), gap + 1e-15], 2e-12)


@pytest.mark.slow
def test_a_curve_and_a_patch():
    line = BezierCurve([[0.5, 0.5, 1.0], [0.5, 0.5, 3.0]])
    plate = surface(np.zeros((4, 4)))
    found, turned = minimum_distance(line, plate), minimum_distance(plate, line)
    assert holds(found, 1.0, 1e-8) and holds(turned, 1.0, 1e-8)
    for point in (found.point_b, turned.point_a):
        np.testing.assert_allclose(point, [0.5, 0.5, 0], atol=1e-6)


@pytest.mark.slow
def test_the_derivative_of_a_distance_of_patches():
    random = np.random.default_rng(1)
    heights = 0.25 * random.normal(size=(2, 4, 4))
    a, b = surface(heights[0]).control_points, surface(heights[1], 1.0).control_points

    def distance(rows):
        return minimum_distance(BezierPatch(rows), BezierPatch(b)).value

    slope, h = jax.grad(distance)(a), 1e-5
    for place in ((0, 0, 2), (3, 2, 0), (1, 2, 2)):
        step = jnp.zeros_like(a).at[place].set(h)
        difference = (distance(a + step) - distance(a - step)) / (2 * h)
        assert abs(float(difference - slope[place])) < DIFFERENCES


SPHERES = (
    ImplicitSurface.parse("x^2 + y^2 + z^2 - 9", [-3, -3, -3], [3, 3, 3]),
    ImplicitSurface.parse("x^2 + (y - 7)^2 + z^2 - 4", [-2, 5, -2], [2, 9, 2]),
)


# Boxes of both spheres: those that touch them, wider ones, far larger ones, and small ones about the nearest points.
BOXES = [
    ([-3, -3, -3], [3, 3, 3], [-2, 5, -2], [2, 9, 2]),
    ([-4, -4, -4], [4, 4, 4], [-3, 4, -3], [3, 10, 3]),
    ([-10, -10, -10], [10, 10, 10], [-10, -10, -10], [10, 10, 10]),
    ([-1000, -1000, -1000], [100, 100, 100], [-100, -100, -100], [1000, 1000, 1000]),
    ([-3, 2.9, -3], [3, 3, 3], [-0.1, 5, -0.2], [0.3, 5.2, 0.1]),
    ([-1, -1, 0], [1, 3.5, 1], [0, 4.5, -1], [2, 6, 0]),
    ([-3, -3.1, -3], [3.3, 3, 3], [-2, 5, -2.2], [2, 9.5, 2]),
]


@pytest.mark.parametrize("k", swept(range(len(BOXES))))
def test_the_papers_spheres_are_two_apart_in_any_boxes(k):
    boxes = BOXES[k]
    a = ImplicitSurface.parse("x^2 + y^2 + z^2 - 9", *boxes[:2])
    b = ImplicitSurface.parse("x^2 + (y - 7)^2 + z^2 - 4", *boxes[2:])
    found = minimum_distance(a, b, atol=1e-12)
    assert found.lower <= 2 <= found.upper
    assert max(abs(float(x) - 2) for x in (found.lower, found.value, found.upper)) <= 1e-12
    np.testing.assert_allclose(found.point_a, [0, 3, 0], atol=1e-12)


@pytest.mark.exhaustive
def test_surfaces_that_are_cut_that_meet_and_that_are_empty():
    upper = ImplicitSurface.parse("(x - 0.5)^2 + (y - 7)^2 + z^2 - 4", [-2, 7, -3], [3, 10, 3])
    # The nearest point of the half sphere is on its border, at x = -1.5.
    exact = 51.25**0.5 - 3
    assert holds(minimum_distance(SPHERES[0], upper), [exact - 1e-15, exact + 1e-15], 1e-8)
    across = ImplicitSurface.parse("x^2 + (y - 4)^2 + z^2 - 4", [-2, 2, -2], [2, 6, 2])
    found = minimum_distance(SPHERES[0], across)
    assert found.lower == 0 and found.upper <= 1e-8
    empty = ImplicitSurface.parse("x^2 + y^2 + z^2 + 1", [-3, -3, -3], [3, 3, 3])
    for pair, name in (((empty, SPHERES[1]), "a: "), ((SPHERES[1], empty), "b: ")):
        with pytest.raises(ValueError, match=f"{name}the surface is empty"):
            minimum_distance(*pair)


@pytest.mark.parametrize("axis", swept("xyz"))
def test_a_sphere_that_touches_faces_of_its_box_where_it_is_nearest(axis):
    # The side of the box holds the place, so that its multiplier does not follow from what is free.
    sphere = ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [-1] * 3, [1] * 3)
    plane = ImplicitSurface.parse(f"{axis} - 2", [-3] * 3, [3] * 3)
    assert holds(minimum_distance(sphere, plane), 1.0, 1e-8)


# The tables of these searches grow to the same length, and so they share all programs.
ROOM = BranchAndBound(queue_size=1 << 10)


@pytest.mark.slow
def test_sheets_far_closer_to_each_other_than_to_a_sphere():
    sheets = ImplicitSurface.parse("1048576 * z^2 - 1", [-1.6] * 3, [1.6] * 3)
    sphere = ImplicitSurface.parse("x^2 + y^2 + (z - 1)^2 - 0.25", [-1.6] * 3, [1.6] * 3)
    assert holds(minimum_distance(sheets, sphere, ROOM), 0.5 - 2.0**-10, 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("inner", "outer", "exact"),
    [
        ("x^2 + y^2 + z^2 - 0.25", "(x - 0.125)^2 + y^2 + z^2 - 1.5625", 0.625),
        ("x^2 + y^2 + z^2 - 1", "x^2 + y^2 - 2.25", 0.5),
    ],
)
def test_a_sphere_inside_of_another_surface_where_many_places_are_about_as_near(inner, outer, exact):
    a, b = (ImplicitSurface.parse(text, [-1.75] * 3, [1.75] * 3) for text in (inner, outer))
    assert holds(minimum_distance(a, b, ROOM), exact, 1e-8)


INSIDE = {
    "cylinders": ("x^2 + y^2 - 0.25", "x^2 + y^2 - 1", 0.5, 1e-8),
    "sheets": ("z^2 - 0.0001", "(z - 0.5)^2 - 0.0001 - 0.0001 * x^2", 0.49 - 0.01 * 5**0.5, 1e-8),
    "tori": (
        "(x^2 + y^2 + z^2 + 0.91)^2 - 4 * x^2 - 4 * y^2",
        "(x^2 + y^2 + z^2 + 0.84)^2 - 4 * x^2 - 4 * y^2",
        0.1,
        7e-6,
    ),
}


@pytest.mark.parametrize("name", swept(INSIDE, slow=["sheets"]))
def test_surfaces_inside_of_each_other_that_are_as_near_everywhere_or_along_a_line(name):
    inner, outer, exact, gap = INSIDE[name]
    a, b = (ImplicitSurface.parse(text, [-2] * 3, [2] * 3) for text in (inner, outer))
    assert holds(minimum_distance(a, b, BranchAndBound(atol=gap, queue_size=ROOM.queue_size)), exact, gap)


@pytest.mark.parametrize(
    ("kind", "shift"),
    swept(
        itertools.product(["circle", "sphere", "polynomial"], [0.0, 1e-3]),
        quick=[("circle", 0.0), ("circle", 1e-3)],
        slow=[("sphere", 1e-3), ("polynomial", 0.0), ("polynomial", 1e-3)],
    ),
)
def test_a_point_about_the_center_of_what_is_round_is_as_far_as_the_radius(kind, shift):
    if kind == "circle":
        shape, place = circle([0.0, 0.0], 2.0), [shift, 0.0]
    else:
        shape, place = (sphere(2.0) if kind == "sphere" else SPHERES[0]), [0.0, shift, 0.0]
    shape = ImplicitSurface.parse("x^2 + y^2 + z^2 - 4", [-3] * 3, [3] * 3) if kind == "polynomial" else shape
    found = minimum_distance(shape, point_set([place, np.multiply(place, 0.5)]))
    assert holds(found, 2.0 - shift, 1e-10)
    assert np.array_equal(found.point_b, place)
    assert float(np.linalg.norm(found.point_a)) == pytest.approx(2.0)


@pytest.mark.exhaustive
def test_the_derivative_of_the_distance_of_the_nearest_point_is_that_of_its_foot():
    def distance(rows):
        return minimum_distance(point_set(rows), circle([0.0, 0.0], 2.0)).value

    rows = np.array([[0.3, 0.4], [0.1, 0.0], [0.0, -6.0]])
    slopes = jax.grad(distance)(rows)
    np.testing.assert_allclose(slopes, [[-0.6, -0.8], [0, 0], [0, 0]], atol=1e-12)
    # 2 - |x| has the second derivatives of -|x|.
    expected = np.zeros((3, 2, 3, 2))
    expected[0, :, 0] = -2 * (np.eye(2) - np.outer([0.6, 0.8], [0.6, 0.8]))
    np.testing.assert_allclose(jax.hessian(distance)(rows), expected, atol=1e-9)


@pytest.mark.slow
def test_the_derivative_of_a_distance_of_surfaces():
    def distance(x):
        coefficients = SPHERES[0].coefficients.at[0, 0, 0].set(-(x**2))
        return minimum_distance(ImplicitSurface(coefficients, [-4] * 3, [4] * 3, reduced=False), SPHERES[1]).value

    # The radius of one sphere takes as much off the distance.
    assert abs(float(jax.grad(distance)(3.0)) + 1.0) < 1e-6


@pytest.mark.exhaustive
def test_a_curve_and_a_patch_against_a_surface():
    line = BezierCurve([[-1.0, 0, 5], [1, 0, 5]])
    assert holds(minimum_distance(line, SPHERES[0]), 2.0, 1e-8)
    plate = surface(np.zeros((4, 4)), 4.0)
    assert holds(minimum_distance(SPHERES[0], plate), 1.0, 1e-8)


@pytest.mark.slow
def test_the_voxel_method_is_unproven_and_its_samples_are_on_the_surfaces():
    found = minimum_distance(*SPHERES, VoxelPairs(0.5, 6))
    assert found.result == RESULTS.not_certified and found.lower == 0 and np.isinf(found.upper)
    # VoxelPairs has no rules to choose from.
    assert "rule" not in RESULTS[found.result]
    # Any two points of the surfaces are at least as far apart as the nearest.
    assert 2 - 1e-12 <= float(found.value) <= 2.5
    for shape, point in zip(SPHERES, (found.point_a, found.point_b), strict=True):
        assert abs(float(shape(point))) < 1e-12
    tied = VoxelPairs(0.5, 6).pairs(*SPHERES)
    best = minimum_distance(*SPHERES, VoxelPairs(0.5, 6, ties="all"))
    assert float(best.value) == tied.distance.min() and tied.distance[0] == float(found.value)
    steps = tied.cells_b - tied.cells_a
    assert len({int(step @ step) for step in steps}) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spacing": 0.0}, "spacing is 0.0"),
        ({"spacing": 0.1, "samples": 1}, "samples is 1"),
        ({"spacing": 0.1, "ties": "some"}, "ties is 'some'"),
        ({"spacing": 0.1, "origin": [0.0, 0.0]}, r"origin has shape \(2,\)"),
    ],
)
def test_voxels_of_no_size_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        VoxelPairs(**options)
