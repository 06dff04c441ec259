"""Shapes that are equally far from each other along whole regions: offsets of spheres, tori and cylinders."""

import numpy as np
import pytest

import jhd
from jhd._distance.search import farthest_place
from jhd._results.solution import name_of

ARC = np.sqrt(0.5)
# A quarter of a circle with its weights, and the whole one.
QUARTER, WEIGHTS = np.array([[1.0, 0], [1, 1], [0, 1]]), np.array([1, ARC, 1])
TURNS = [np.linalg.matrix_power(np.array([[0.0, -1], [1, 0]]), k) for k in range(4)]
CIRCLE = [QUARTER @ turn.T for turn in TURNS]
# References and stored arcs are rounded by a few units of the last place.
EXACT = 1e-14


def about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def turned():
    matrix, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return matrix * np.sign(np.linalg.det(matrix))


def revolved(profiles, weights):
    """Patches of surfaces of revolution about the z axis: profiles of points (radius, height) with their weights."""
    nets = [
        np.stack([np.append(r * arc, np.full((3, 1), z), axis=1) for r, z in profile])
        for profile in profiles
        for arc in CIRCLE
    ]
    return jhd.BezierPatches(np.array(nets), np.broadcast_to(np.outer(weights, WEIGHTS), (len(nets), len(weights), 3)))


def torus(radius):
    return revolved([quarter * radius + [1, 0] for quarter in CIRCLE], WEIGHTS)


def sphere(radius):
    return revolved([radius * QUARTER, radius * QUARTER * [1, -1]], WEIGHTS)


def cylinder(radius, angle=0.0):
    return revolved([np.array([[radius, -1.0], [radius, 1]])], np.ones(2)).transform(about_z(angle))


def assert_is(found, exact, gap):
    assert name_of(found.result) == "successful"
    assert float(found.lower) <= exact + EXACT and exact - EXACT <= float(found.upper)
    assert float(found.upper - found.lower) <= gap


@pytest.mark.exhaustive
def test_turned_cylinders_are_as_far_from_each_other_as_their_radii():
    # The joints of the patches of the one lie inside of those of the other.
    found = jhd.directed_hausdorff(cylinder(1.0), cylinder(1.25, 0.7), jhd.BranchAndBound(atol=1e-7))
    assert_is(found, 0.25, 1e-7)
    assert int(found.stats["cells"]) < 1000


@pytest.mark.exhaustive
def test_tori_and_spheres_are_as_far_from_each_other_as_their_radii():
    close = jhd.BranchAndBound(atol=4e-6)
    for other in (torus(0.35), torus(0.35).transform(about_z(0.7))):
        found = jhd.directed_hausdorff(torus(0.3), other, close)
        assert_is(found, 0.05, 4e-6)
        assert int(found.stats["cells"]) < 4000
    # Their poles, where sides of patches are single points, lie at different places.
    found = jhd.directed_hausdorff(sphere(1.0), sphere(1.1).transform(turned()), close)
    assert_is(found, 0.1, 4e-6)
    assert int(found.stats["cells"]) < 6000


@pytest.mark.parametrize(
    ("a", "b", "exact"),
    [
        pytest.param(torus(0.3), torus(0.4), 0.1, marks=pytest.mark.exhaustive, id="tori"),
        pytest.param(sphere(1.0), sphere(1.5), 0.5, marks=pytest.mark.exhaustive, id="spheres"),
    ],
)
def test_the_minimum_distance_of_coaxial_tori_and_of_concentric_spheres_closes(a, b, exact):
    found = jhd.minimum_distance(a, b, atol=4e-6)
    assert_is(found, exact, 4e-6)
    # By bounds with feet that do not move the gap of the tori is 9e-3 after 4000.
    assert int(found.stats["steps"]) < 3600


@pytest.mark.exhaustive
def test_the_minimum_distance_of_concentric_circles_closes_by_default():
    found = jhd.minimum_distance(jhd.circle([0, 0], 1.0), jhd.circle([0, 0], 1.5))
    assert_is(found, 0.5, 1e-9)
    assert int(found.stats["steps"]) < 1000


RING = jhd.BezierSegments(np.pad(np.array(CIRCLE), ((0, 0), (0, 0), (0, 1))), np.tile(WEIGHTS, (4, 1)))
AXIS = jhd.polyline([(0, 0, -1.0), (0, 0, 1.0)])


@pytest.mark.slow
def test_the_minimum_distance_of_a_circle_and_its_axis_closes():
    # One point of the axis is as near to all points of the circle: feet must move on the straight one.
    for a, b in ((RING, AXIS), (AXIS, RING)):
        found = jhd.minimum_distance(a, b)
        assert_is(found, 1.0, 1e-9)
        assert int(found.stats["steps"]) < 1000


@pytest.mark.exhaustive
@pytest.mark.parametrize(("surface", "curve", "exact"), [(cylinder(1.0), AXIS, 1.0), (torus(0.3), RING, 0.3)])
def test_the_minimum_distance_of_a_surface_and_the_curve_in_its_middle_closes(surface, curve, exact):
    assert_is(jhd.minimum_distance(surface, curve), exact, 1e-9)


def implicit(polynomial):
    return jhd.ImplicitSurface.parse(polynomial, [-2] * 3, [2] * 3)


def paraboloid():
    """The graph of x^2 + y^2 above [-1, 1]^2."""
    x, y = np.meshgrid([-1.0, 0, 1], [-1.0, 0, 1], indexing="ij")
    return jhd.BezierPatch(np.stack([x, y, np.where(x == 0, -1.0, 1.0) + np.where(y == 0, -1.0, 1.0)], axis=-1))


# By bounds with feet that do not move their gaps are 3e-2 to 2e-1 after 2000 steps.
@pytest.mark.parametrize(
    ("shape", "surface", "exact", "most"),
    [
        pytest.param(sphere(1.0), "x**2 + y**2 + z**2 - 1.5625", 0.25, 900, marks=pytest.mark.exhaustive, id="spheres"),
        pytest.param(AXIS, "x**2 + y**2 - 1", 1.0, 900, marks=pytest.mark.slow, id="cylinder and axis"),
        pytest.param(
            RING,
            "(x**2 + y**2 + z**2 + 0.91)**2 - 4*x**2 - 4*y**2",
            0.3,
            2000,
            marks=pytest.mark.exhaustive,
            id="torus and circle",
        ),
        pytest.param(
            paraboloid(),
            "x**2 + y**2 + (z - 1)**2 - 0.25",
            np.sqrt(0.75) - 0.5,
            1700,
            marks=pytest.mark.exhaustive,
            id="sphere and paraboloid",
        ),
    ],
)
def test_the_minimum_distance_of_a_parametric_shape_and_an_implicit_surface_closes(shape, surface, exact, most):
    found = jhd.minimum_distance(shape, implicit(surface), atol=7e-7)
    assert_is(found, exact, 7e-7)
    assert int(found.stats["steps"]) < most


@pytest.mark.slow
def test_all_points_of_a_parametric_sphere_are_as_far_from_an_implicit_one():
    for radius in (1.0, 1.25):
        found = jhd.directed_hausdorff(
            sphere(1.0), implicit(f"x**2 + y**2 + z**2 - {radius**2}"), jhd.BranchAndBound(atol=1e-6)
        )
        assert_is(found, radius - 1, 1e-6)


@pytest.mark.parametrize(
    ("curve", "surface", "exact"),
    [
        pytest.param(
            RING, "(x**2 + y**2 + z**2 + 0.91)**2 - 4*x**2 - 4*y**2", 0.3, marks=pytest.mark.exhaustive, id="torus"
        ),
        # The program of a line beside a cone.
        pytest.param(AXIS, "x**2 + y**2 - 1", 1.0, marks=pytest.mark.slow, id="cylinder"),
    ],
)
def test_all_points_of_a_curve_are_as_far_from_the_surface_about_it(curve, surface, exact):
    # A whole circle of the surface is nearest to each of them.
    found = jhd.directed_hausdorff(curve, implicit(surface))
    assert_is(found, exact, 1e-9)
    assert int(found.stats["cells"]) < 1000


@pytest.mark.exhaustive
def test_a_farthest_place_that_is_as_near_to_a_whole_circle_closes():
    # The distance falls from the top of the sphere on all sides, as it does beside a cone's apex.
    found = jhd.directed_hausdorff(implicit("x**2 + y**2 + (z - 1)**2 - 0.25"), paraboloid())
    assert_is(found, np.sqrt(1.25), 1e-9)
    np.testing.assert_allclose(found.witness.point, [0, 0, 1.5], atol=1e-9)
    assert int(found.stats["cells"]) < 10000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("a", "b", "exact"),
    [("x**2 + y**2 + z**2 - 1", "x**2 + y**2 + z**2 - 1.5625", 0.25), ("x**2 + y**2 - 1", "x**2 + y**2 - 2.25", 0.5)],
)
def test_the_minimum_distance_of_quadrics_with_one_center_or_axis_closes_with_few_pairs(a, b, exact):
    found = jhd.minimum_distance(implicit(a), implicit(b))
    assert_is(found, exact, 1e-9)
    # By second derivatives that must be positive definite it takes 50,000 or more.
    assert int(found.stats["pairs"]) < 5000


@pytest.mark.exhaustive
def test_the_nearest_points_of_spheres_with_poles_are_given_up_with_steps_to_spare():
    found = jhd.minimum_distance(sphere(1.0), sphere(1.5), throw=False)
    assert name_of(found.result) == "nonisolated_maxima"
    assert float(found.lower) <= 0.5 + EXACT and 0.5 - EXACT <= float(found.upper)
    assert int(found.stats["steps"]) < 2500


@pytest.mark.exhaustive
def test_triangles_between_points_of_a_cylinder_are_as_far_as_their_chords():
    count = 24
    angles = 2 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.concatenate([np.append(ring, np.full((count, 1), z), axis=1) for z in (-1.0, 1.0)])
    k = np.arange(count)
    after = (k + 1) % count
    mesh = jhd.TriangleMesh(
        vertices, np.concatenate([np.stack([k, after, k + count], 1), np.stack([after, after + count, k + count], 1)])
    )
    exact = 1 - np.cos(np.pi / count)
    for a, b in ((mesh, cylinder(1.0, 0.1)), (cylinder(1.0, 0.1), mesh)):
        assert_is(jhd.directed_hausdorff(a, b, jhd.BranchAndBound(atol=1e-8)), exact, 1e-8)


def over_rectangle(x, z, height):
    """The graph of a polynomial of degree 2 in x and in z, by its polar form: of places, and of their squares."""
    ends = [np.array([[a, a], [a, b], [b, b]]) for a, b in (x, z)]
    (u, uu), (v, vv) = ((np.mean(rows, axis=1), np.prod(rows, axis=1)) for rows in ends)
    u, uu = (np.broadcast_to(rows[:, None], (3, 3)) for rows in (u, uu))
    return jhd.BezierPatch(np.stack([u, height(u, uu, vv), np.broadcast_to(v, (3, 3))], axis=-1))


@pytest.mark.exhaustive
def test_a_family_of_farthest_places_ends_long_before_there_is_no_room(monkeypatch):
    monkeypatch.setattr(farthest_place, "_FAMILY", 1000)
    outer = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1.5625", [-2] * 3, [2] * 3)
    found = jhd.directed_hausdorff(sphere(1.0), outer, jhd.BranchAndBound(atol=1e-14, max_steps=50), throw=False)
    assert name_of(found.result) == "nonisolated_maxima"
    assert float(found.lower) <= 0.25 + EXACT and 0.25 - EXACT <= float(found.upper)
    # With steps to spare and far fewer cells than the search has room for.
    assert int(found.stats["steps"]) < 20 and int(found.stats["waiting"]) < 20000


@pytest.mark.exhaustive
def test_a_maximum_between_two_feet_closes_with_few_cells():
    # The place (0, 2, 0) is as far from both sides of the trough y = x^2, and places beside it are nearer to one.
    above = over_rectangle((-0.75, 1.5), (-0.55, 0.45), lambda u, uu, vv: 2 + 0.5 * u - 0.25 * uu - 0.25 * vv)
    trough = over_rectangle((-3.0, 3.0), (-1.0, 1.0), lambda u, uu, vv: uu)
    found = jhd.directed_hausdorff(above, trough)
    assert_is(found, np.sqrt(7) / 2, 1e-9)
    assert name_of(found.event) == "one_to_two" and int(found.stats["cells"]) < 300
