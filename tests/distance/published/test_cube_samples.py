"""Surfaces on a grid of cubes: the cubes that a mesh meets, the axis of the lines, pairs of all kinds of surfaces."""

import itertools

import numpy as np
import pytest

import jhd
from jhd._distance.published.voxel_pairs import cube_side, samples_in
from jhd._results.solution import name_of
from tests.triangles.test_closest_point import soup, sphere


def test_the_cubes_of_a_mesh_are_those_that_its_triangles_meet():
    """Every place of a triangle is in one of its cubes, and every cube of it is as near as a step of the places."""
    rng = np.random.default_rng(3)
    # One triangle is twenty cubes long, so it is cut; one is a point, one a segment.
    corners = np.concatenate(
        [rng.uniform(0, 4, (6, 3, 3)), [[[1, 1, 1]] * 3], [[[0, 0, 0], [3.9, 3.9, 3.9], [1, 1, 1]]]]
    )
    corners = np.concatenate([corners * 0.25, [[[0.0, 0, 0], [4, 1, 0.3], [0.2, 4, 3.9]]]])
    steps = np.array([(i, j, 60 - i - j) for i in range(61) for j in range(61 - i)]) / 60
    spacing = 0.2
    for triangle in corners:
        found = cube_side(soup(triangle[None]), 0.0).occupied(np.zeros(3), spacing, 32)
        places = steps @ triangle
        inside = np.floor(places / spacing).astype(int)
        assert {tuple(x) for x in inside} <= {tuple(x) for x in found}
        gaps = np.maximum(np.maximum(found[:, None] * spacing - places, places - (found[:, None] + 1) * spacing), 0)
        assert np.linalg.norm(gaps, axis=2).min(axis=1).max() <= np.ptp(triangle, axis=0).max() / 30


def test_lines_run_along_the_axis_with_the_largest_projection_and_not_along_the_gradient_at_the_middle():
    """The plane z = 0.1 as a factor: in the middle of the cube the gradient of the product is steepest along x."""
    text = "(z - 0.1)*(2 + 10*(x - 0.5) + 15*(x - 0.5)^2)"
    surface = jhd.ImplicitSurface.parse(text, [0, 0, 0], [1, 1, 1])
    gradient = np.abs(np.asarray(surface.gradient(np.full(3, 0.5))))
    assert np.argmax(gradient) == 0
    found = samples_in(cube_side(surface, 0.0), np.zeros(3), 1.0, 4)
    assert len(found) == 16
    np.testing.assert_allclose(found[:, 2], 0.1, atol=1e-12)


def kinds():
    """Surfaces whose highest place is (0, 0, 1): a polynomial and a mesh of a ball, and a paraboloid."""
    ball = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [-1.5] * 3, [1.5] * 3)
    dome = np.array([[[x, y, 1.5 - (x * x + y * y) / 2] for y in (-1.0, 0, 1)] for x in (-1.0, 0, 1)])
    return {"implicit": ball, "mesh": sphere(400), "patch": jhd.BezierPatch(dome)}


def off(name, point):
    """How far a point is from one of them, for the paraboloid in height."""
    x, y, z = point
    if name == "patch":
        return abs(z - 1 + (x * x + y * y) / 4)
    return (
        abs(np.hypot(np.hypot(x, y), z) - 1) if name == "implicit" else float(jhd.project(point, sphere(400)).distance)
    )


@pytest.mark.slow
@pytest.mark.parametrize("names", list(itertools.combinations_with_replacement(kinds(), 2)), ids="-".join)
def test_pairs_of_all_kinds_of_surfaces_are_served(names):
    """The second one is turned over and raised by four, so that the nearest places are at heights one and three."""
    a, b = (kinds()[name] for name in names)
    found = jhd.minimum_distance(
        a, b.transform(np.diag([1.0, 1, -1]), [0.0, 0, 4]), jhd.published.VoxelPairs(0.25, 6, ties="all")
    )
    assert name_of(found.result) == "not_certified"
    # Lines are 0.05 apart; a patch is sampled on a mesh within 0.0005 of it.
    assert 2 - 1e-3 <= float(found.value) <= 2.1
    points = np.asarray(found.point_a), np.asarray(found.point_b) * [1, 1, -1] + [0, 0, 4]
    assert all(off(name, point) <= 1e-3 for name, point in zip(names, points, strict=True))
