"""Nearest points of meshes: bounds without exception, right triangles, bounded memory, any unit and offset."""

from fractions import Fraction

import numpy as np
import pytest

import jhd._triangles.closest_point as module
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.box_tree import WIDTH, box_tree, hints
from jhd._triangles.closest_point import (
    closest_points,
    in_unit_of,
    nearest_triangles,
    outward,
    triangle_tree,
    triangles_within,
)
from jhd._triangles.point_triangle import frames
from tests.reference import distances_to_triangles
from tests.sweeps import swept
from tests.triangles.exact_triangles import exact_distance_sq, hard_points, hard_triangles

# All meshes and batches have these sizes, so that they share programs.
TRIANGLES, POINTS = 24, 60
# Computed distances are off by rounding, as a share of the largest coordinate.
ROUNDING = 1e-15


def soup(corners):
    return TriangleMesh(np.asarray(corners).reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def sphere(count):
    """A closed mesh of about `count` triangles on the unit sphere."""
    rows = max(3, int(np.sqrt(count / 4)))
    v, u = np.meshgrid(
        np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False), indexing="ij"
    )
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1)
    points[0], points[-1] = [0, 0, 1], [0, 0, -1]
    i, j = np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij")
    a, b = i * 2 * rows + j, i * 2 * rows + (j + 1) % (2 * rows)
    c, d = a + 2 * rows, b + 2 * rows
    quads = np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3)
    corners = points.reshape(-1, 3)[quads]
    kept = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 1e-12
    return TriangleMesh(points.reshape(-1, 3), quads[kept])


def check_bounds(mesh, points, found):
    """No tolerance: the exact distance of the stored floats is between the bounds."""
    corners = np.asarray(mesh.corners)
    for k, point in enumerate(points):
        exact, lower, upper = (
            exact_distance_sq(point, corners),
            *(Fraction(float(x[k])) for x in (found.lower, found.upper)),
        )
        assert lower >= 0 and lower**2 <= exact <= upper**2, k


@pytest.mark.parametrize(
    ("scale", "offset"),
    [(1.0, 0.0), (1e-3, 1e6), (1e150, 0.0), (1e-150, 0.0), (1e303, 0.0), (1e-309, 0.0), (1.0, [1e8, 0, -3])],
    ids="plain details huge tiny largest subnormal mixed".split(),
)
def test_bounds_hold_on_slivers_segments_points_and_large_triangles(scale, offset):
    rng = np.random.default_rng(7)
    corners = hard_triangles(rng, TRIANGLES)
    points = hard_points(rng, corners, POINTS)
    mesh, points = soup(corners * scale + offset), points * scale + offset
    found = closest_points(mesh, points)
    check_bounds(mesh, points[::4], type(found)(*(x[::4] for x in found)))
    size = max(np.abs(points).max(), np.abs(np.asarray(mesh.vertices)).max())
    reached = np.linalg.norm(points / size - found.foot / size, axis=1)
    np.testing.assert_allclose(reached, found.distance / size, rtol=0, atol=ROUNDING)
    # Below the smallest normal number lengths are not told apart.
    assert np.all(found.upper - found.lower <= 1e-12 * size + 4 * np.finfo(float).smallest_normal)


@pytest.mark.parametrize("seed", swept(range(12), 0, 3))
def test_bounds_hold_on_random_hard_meshes(seed):
    rng = np.random.default_rng(seed)
    corners = hard_triangles(rng, TRIANGLES)
    points = hard_points(rng, corners, POINTS)
    mesh = soup(corners)
    found = closest_points(mesh, points)
    check_bounds(mesh, points, found)
    exact = np.sqrt([float(exact_distance_sq(p, corners)) for p in points])
    np.testing.assert_allclose(found.distance, exact, rtol=1e-14, atol=ROUNDING * np.abs(corners).max())


@pytest.mark.parametrize("far", [1e10, 1e140, 1e300])
def test_points_far_away_are_measured(far):
    rng = np.random.default_rng(3)
    mesh = soup(hard_triangles(rng, TRIANGLES))
    points = rng.normal(size=(POINTS, 3)) * far
    points[0] = 0.0
    found = closest_points(mesh, points)
    check_bounds(mesh, points[:3], found)
    np.testing.assert_allclose(found.upper[1:], found.lower[1:], rtol=1e-12)


def test_coordinates_are_exact_zeros_off_the_feature_that_holds_the_foot():
    mesh = soup(np.repeat([[[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]], TRIANGLES, axis=0))
    points = np.zeros((POINTS, 3))
    points[:7] = [[1, 1, 2], [-1, -2, 1], [5, -1, 0], [-1, 6, 0], [1, -3, 0], [-2, 2, 0], [3, 4, 1]]
    found = closest_points(mesh, points)
    zeros = [[False] * 3, [0, 1, 1], [1, 0, 1], [1, 1, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]]
    np.testing.assert_array_equal(found.t[:7] == 0, zeros)
    np.testing.assert_allclose(found.t[:7].sum(axis=1), 1, rtol=1e-15)
    np.testing.assert_allclose(found.distance[:7], np.sqrt([4, 6, 5, 5, 9, 4, 1 + 144 / 25]), rtol=1e-15)


def test_every_point_finds_its_nearest_triangle_in_a_large_mesh(monkeypatch):
    mesh = sphere(3000)
    tree = triangle_tree(mesh)
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.normal(size=(58, 3)), [[0, 0, 0], [0, 0, 1e-9]]])
    # At the center all triangles are equally near; blocks this small are many times overfull then.
    monkeypatch.setattr(module, "BLOCKS", (512,))
    found = nearest_triangles(tree, np.ldexp(points, -tree.exponent))
    for k in (*range(0, 58, 6), 58, 59):
        rows = np.broadcast_to(np.ldexp(points[k], -tree.exponent), (mesh.count, 3))
        brute = module.pair_squares(tree.table, rows, np.arange(mesh.count))
        assert found.square[k] == brute.min()
        assert brute[found.triangle[k]] == brute.min()


def test_a_better_guess_changes_nothing_but_the_work():
    rng = np.random.default_rng(4)
    mesh = sphere(3000)
    tree = triangle_tree(mesh)
    points = np.ldexp(rng.normal(size=(POINTS, 3)), -tree.exponent)
    plain = nearest_triangles(tree, points)
    guessed = nearest_triangles(tree, points, np.zeros(POINTS, np.int32))
    np.testing.assert_array_equal(plain.square, guessed.square)


def test_every_box_holds_its_triangles_and_every_triangle_is_in_one():
    corners = np.random.default_rng(0).normal(size=(777, 3, 3))
    tree = box_tree(corners)
    assert sorted(tree.order) == list(range(777))
    assert [level.count for level in tree.levels] == [98, 13, 2, 1]
    rows, span = corners[tree.order], WIDTH
    for level in tree.levels:
        for i in range(level.count):
            own = rows[i * span : (i + 1) * span].reshape(-1, 3)
            box = tree.boxes[level.start + i]
            np.testing.assert_array_equal(box[:3].min(axis=1), own.min(axis=0))
            np.testing.assert_array_equal(box[3:].max(axis=1), own.max(axis=0))
        span *= WIDTH


def test_hints_name_triangles_that_are_near():
    mesh = sphere(3000)
    corners = np.asarray(mesh.corners)
    grid = hints(corners)
    points = np.random.default_rng(2).uniform(-1, 1, (200, 3))
    hinted = np.linalg.norm(corners[grid.at(points)].mean(axis=1) - points, axis=1)
    nearest = np.linalg.norm(corners.mean(axis=1) - points[:, None], axis=2).min(axis=1)
    assert np.all(hinted <= nearest + 3 * grid.side)


def test_frames_measure_their_own_defect():
    given = hard_triangles(np.random.default_rng(5), 400) / 1e4
    for dtype, largest in ((np.float64, 4e-15), (np.float32, 1e-6)):
        corners = given.astype(dtype).astype(float)
        found = frames(corners, dtype)
        table = found.table.astype(np.float64)
        a, u, v, length = table[:, :3], table[:, 3:6], table[:, 6:9], table[:, 9]
        others = np.take_along_axis(corners, ((found.turn[:, None] + [1, 2]) % 3)[..., None], axis=1)
        first = np.linalg.norm(a + length[:, None] * u - others[:, 0], axis=1)
        second = np.linalg.norm(a + table[:, 16:17] * u + table[:, 17:] * v - others[:, 1], axis=1)
        # The differences here have roundings of the size of A.
        assert np.all(np.maximum(first, second) <= found.defect * found.longest + 1e-16)
        assert found.defect <= largest
        assert np.all(found.table[:, 17] >= 0) and np.all(found.table[:, 16] <= found.table[:, 9])


def test_a_bound_that_is_no_number_does_not_become_one():
    ends = [outward(np.array([np.nan, 0.0, -1.0, 1.0]), 0, np.dtype(float), sign) for sign in (-1, 1)]
    assert np.isnan(ends[0][0]) and np.isnan(ends[1][0])
    np.testing.assert_array_equal([end[1:3] for end in ends], 0.0)
    assert ends[0][3] < 1.0 < ends[1][3]


@pytest.mark.parametrize("exponent", [0, 200, -200])
def test_all_triangles_within_a_bound_are_found_and_points_with_too_many_have_none(exponent):
    random = np.random.default_rng(4)
    corners = random.normal(size=(90, 3, 3)) * 10.0 ** random.uniform(-3, 0, (90, 1, 1))
    points = random.normal(size=(30, 3))
    exact = np.array([distances_to_triangles(point, corners) for point in points])
    bound = np.sort(exact, axis=1)[np.arange(30), random.integers(0, 12, 30)]
    tree, scaled = in_unit_of(triangle_tree(soup(np.ldexp(corners, exponent))), np.ldexp(points, exponent))
    who, row = triangles_within(tree, scaled, np.ldexp(bound, exponent - tree.exponent), 90)
    found = set(zip(who.tolist(), tree.order[row].tolist(), strict=True))
    wanted = set(zip(*(x.tolist() for x in np.nonzero(exact <= bound[:, None])), strict=True))
    assert len(found) == len(who) and wanted <= found
    few, _ = triangles_within(tree, scaled, np.ldexp(bound, exponent - tree.exponent), 5)
    count = np.bincount(who, minlength=30)
    assert np.all(np.isin(np.bincount(few, minlength=30), [0, *range(6)])) and not np.any(
        np.isin(few, np.flatnonzero(count > 5))
    )
    assert 0 < len(few) < len(who)
