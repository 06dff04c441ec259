"""The published local search: what it looks at, where it errs, what it claims, how much room it takes."""

from fractions import Fraction

import numpy as np
import pytest

import jhd
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.prepared import prepared
from jhd._triangles.closest_point import closest_points, triangle_tree
from jhd.published import VertexVoxels
from tests.sweeps import swept
from tests.triangles.exact_triangles import exact_distance_sq, hard_triangles
from tests.triangles.test_closest_point import soup, sphere

# Computed distances are off by rounding, as a share of the largest coordinate.
ROUNDING = 1e-14


def voxels_of(mesh, points, resolution):
    """The voxels that points are in."""
    corners = np.asarray(mesh.corners)
    lower = corners.min(axis=(0, 1))
    side = (corners.max(axis=(0, 1)) - lower).max()
    return np.clip(np.floor((points - lower) / side * resolution), 0, resolution - 1)


def as_published(mesh, points, resolution):
    """Distances by the words of the paper: every pair of voxels compared, and triangles one by one, exactly."""
    corners = np.asarray(mesh.corners)
    cells = voxels_of(mesh, corners, resolution)
    features = np.unique(cells.reshape(-1, 3), axis=0)
    found = []
    for point, own in zip(points, voxels_of(mesh, points, resolution), strict=True):
        squares = ((features - own) ** 2).sum(axis=1)
        tied = features[squares == squares.min()]
        around = np.any(np.all(cells[:, :, None] == tied, axis=3), axis=(1, 2))
        found.append(float(exact_distance_sq(point, corners[around])) ** 0.5)
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("resolution", swept([3, 1, 8], 1, 2))
def test_distances_are_those_of_the_triangles_around_all_equally_near_features(resolution):
    rng = np.random.default_rng(resolution)
    mesh = TriangleMesh(np.asarray(sphere(120).vertices) * [1, 0.7, 0.4], sphere(120).triangles)
    points = rng.uniform(-1, 1, (40, 3)) * [1.5, 1, 1]
    # Of the middle there are many nearest features.
    points[0] = 0.01
    found = VertexVoxels(resolution)._search(points, mesh)
    np.testing.assert_allclose(found.distance, as_published(mesh, points, resolution), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.norm(points - found.foot, axis=1), found.distance, rtol=0, atol=ROUNDING)
    exact = closest_points(mesh, points).distance
    assert np.all(found.distance >= exact - ROUNDING)
    # A single voxel holds all triangles, so nothing is missed.
    assert resolution > 1 or np.all(found.distance <= exact + ROUNDING)


def test_a_large_triangle_whose_vertices_are_far_is_missed():
    # Above the middle of a large triangle there is a small one: its vertices are nearest, and it is not.
    large, small = [[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]], [[0.0, 0, 3], [0.5, 0, 3], [0, 0.5, 3]]
    mesh, points = soup(np.array([large, small])), np.array([[0.0, 0, 1], [0, 0, 2.5], [8, -8, 1]])
    found = VertexVoxels()._search(points, mesh)
    np.testing.assert_allclose(found.distance, [2.0, 0.5, 1.0], atol=ROUNDING)
    np.testing.assert_allclose(closest_points(mesh, points).distance, [1.0, 0.5, 1.0], atol=ROUNDING)
    assert found.triangle.tolist() == [1, 1, 0]


@pytest.mark.parametrize("scale", [1.0, 1e150, 1e-150, 1e303, 1e-309])
def test_upper_bounds_hold_on_slivers_and_points_in_any_unit_and_nothing_is_claimed_below(scale):
    rng = np.random.default_rng(4)
    mesh = soup(hard_triangles(rng, 24) * scale)
    points = rng.normal(size=(20, 3)) * 10.0 ** rng.uniform(-2, 3, (20, 1)) * scale
    found = VertexVoxels(16)._search(points, mesh)
    corners = np.asarray(mesh.corners)
    for k, point in enumerate(points):
        triangle = corners[found.triangle[k], None]
        upper = Fraction(float(found.upper[k]))
        assert exact_distance_sq(point, corners) <= exact_distance_sq(point, triangle) <= upper**2
    assert not np.any(found.lower)


def test_the_resolution_is_the_least_power_of_two_that_parts_the_vertices_and_seams_count_once():
    box = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.3, 0, 0]]
    triangles = np.array([[0, 4, 2], [4, 1, 3], [0, 4, 3]])
    mesh = TriangleMesh(box, triangles)
    # 0 and 0.3 share half of the cube, and not a quarter.
    assert VertexVoxels()._grid(mesh).nearest.shape == (4, 4, 4) and VertexVoxels().voxels(mesh) == 4
    apart = TriangleMesh(np.array(box)[triangles].reshape(-1, 3), np.arange(9).reshape(-1, 3))
    assert VertexVoxels()._grid(apart).nearest.shape == (4, 4, 4)
    # A vertex of no triangle is no part of the surface.
    more = TriangleMesh([*box, [0.31, 0, 0], [99, 0, 0]], triangles)
    assert VertexVoxels()._grid(more).nearest.shape == (4, 4, 4)


def test_the_triangles_of_a_feature_are_those_with_a_corner_in_it_each_once():
    mesh = sphere(120)
    # It is kept with the mesh.
    grid, again = (prepared(mesh)._part(VertexVoxels(4)._grid) for _ in range(2))
    assert grid is again
    cells = voxels_of(mesh, np.asarray(mesh.corners), 4)
    for k, feature in enumerate(grid.features):
        inside = np.flatnonzero(np.any(np.all(cells == feature, axis=2), axis=1))
        named = triangle_tree(mesh).order[grid.triangles[grid.starts[k] : grid.starts[k + 1]]]
        assert sorted(named) == inside.tolist()


def test_where_the_published_transform_names_a_farther_feature_those_at_its_distance_are_taken():
    # With every vector right or too long, distances are those of real triangles, and rarely differ.
    mesh, points = sphere(400), np.random.default_rng(2).uniform(-1, 1, (60, 3))
    near, far = (VertexVoxels(16, transform=name)._search(points, mesh) for name in ("exact", "vector_propagation"))
    assert np.all(far.distance >= closest_points(mesh, points).distance - ROUNDING)
    assert np.count_nonzero(np.abs(far.distance - near.distance) > ROUNDING) <= 3


def test_vertices_that_are_too_close_for_the_capacity_are_refused_with_what_would_be_needed():
    points = np.zeros((1, 3))
    near = soup(np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1e-3, 0]]]))
    with pytest.raises(ValueError, match="one vertex a voxel needs 1024 voxels along each axis; capacity is 16777216"):
        VertexVoxels()._search(points, near)
    nearer = soup(np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1e-9, 0]]]))
    with pytest.raises(ValueError, match=r"needs more than 1048576 voxels .*: give a lower resolution, or more cap"):
        VertexVoxels()._search(points, nearer)
    assert VertexVoxels(8)._search(points, nearer).distance[0] == 0.0


def test_a_mesh_at_one_place_is_one_voxel():
    found = VertexVoxels()._search(np.zeros((1, 3)), soup(np.ones((1, 3, 3))))
    np.testing.assert_allclose(found.distance, np.sqrt(3), rtol=ROUNDING)


@pytest.mark.slow
def test_algorithm_1_as_published_splits_the_cube_about_the_mesh_by_local_distances_and_averaged_signs():
    """The leaves are those of the printed recursion, and their values those of the local search."""
    mesh, atol, method, depth = sphere(120), 0.1, VertexVoxels(8), 3
    field = jhd.AdaptiveDistanceField.build(mesh, atol, "full", method=method, max_depth=depth)
    # Distances of the local search jump, so somewhere no cell is small enough.
    assert field.sign == "average" and field.unresolved > 0

    def measured(points):
        return np.asarray(jhd.signed_distance(points, mesh, method=method))

    weights = np.array(list(np.ndindex(3, 3, 3))) / 2
    leaves = []

    def recurse(low, side, level):
        values = measured(low + side * weights).reshape(3, 3, 3)
        corners = values[::2, ::2, ::2]
        for axis in range(3):
            corners = np.insert(corners, 1, corners.mean(axis=axis), axis=axis)
        if level == depth or np.max(np.abs(corners - values)) <= atol:
            leaves.append((*low, side))
        else:
            for step in np.ndindex(2, 2, 2):
                recurse(low + 0.5 * side * np.array(step), 0.5 * side, level + 1)

    low, high = (np.asarray(end) for end in mesh.bounds)
    recurse(low, float(np.max(high - low)), 0)
    spacing = np.asarray(field.spacing)
    places = np.asarray(field.lower) + spacing * np.asarray(field.leaf_corners)
    found = np.column_stack([places, spacing * np.asarray(field.widths)])
    assert 8 < len(found) == len(leaves) < 8**depth
    names = [np.round(np.array(x) * 2.0**20).astype(int).tolist() for x in (found, leaves)]
    assert sorted(names[0]) == sorted(names[1])
    np.testing.assert_allclose(np.asarray(field.values)[np.asarray(field.corners)[:, 0]], measured(places), atol=1e-12)
    with pytest.raises(ValueError, match="a method needs mode='full'"):
        jhd.AdaptiveDistanceField.build(mesh, atol, method=method)
