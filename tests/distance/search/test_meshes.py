"""Hausdorff distances of meshes: exact answers, bounds that hold, witnesses, derivatives, tolerances, interruption."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.meshes import mesh_directed
from jhd.shapes.mesh import TriangleMesh
from jhd.solution import EVENTS, RESULTS
from jhd.triangles.closest_point import closest_points
from tests.distance.nearest.test_meshes import torus
from tests.shapes.test_mesh import CORNERS, CUBE
from tests.triangles.exact_triangles import exact_distance_sq, hard_triangles

METHOD = BranchAndBound()
# The roof has its ridge over the middle of a square of side two; feet of its ridge are on both slopes of the valley.
PLATE = TriangleMesh([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
VALLEY = TriangleMesh(
    [[-1.0, -1, 1], [0, -1, 0], [1, -1, 1], [-1, 1, 1], [0, 1, 0], [1, 1, 1]],
    [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]],
)


def soup(corners):
    return TriangleMesh(np.asarray(corners).reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def divided(mesh, rng):
    """The same surface, each triangle cut into three at a point inside."""
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    inner = np.einsum("nk,nkd->nd", rng.dirichlet(np.full(3, 3.0), len(triangles)), vertices[triangles])
    index = len(vertices) + np.arange(len(triangles))
    parts = [np.stack([triangles[:, i - 1], triangles[:, i], index], axis=1) for i in range(3)]
    return TriangleMesh(np.concatenate([vertices, inner]), np.concatenate(parts))


def test_the_distance_of_a_shifted_cube_is_the_shift():
    cube = TriangleMesh(CORNERS, CUBE)
    for shift in (1e-3, 0.25):
        found = mesh_directed(cube, cube.transform(np.eye(3), [0, 0, shift]), METHOD)
        assert float(found.lower) <= shift <= float(found.upper)
        assert float(found.upper - found.lower) <= 1e-9
        assert float(found.value) == pytest.approx(shift, abs=1e-12)


def test_two_feet_balance_on_the_axis_of_a_valley():
    # From (0, y, 1) both slopes are sqrt(1/2) away, and no other point of the lid is farther.
    lid = PLATE.transform(np.eye(3), [0, 0, 1])
    found = mesh_directed(lid, VALLEY, METHOD)
    assert float(found.lower) <= np.sqrt(0.5) <= float(found.upper)
    assert float(found.upper - found.lower) <= 1e-9
    assert found.event == EVENTS.one_to_two
    np.testing.assert_allclose(found.witness.multipliers, [0.5, 0.5, 0, 0], atol=1e-6)
    np.testing.assert_allclose(np.abs(found.witness.feet[:2, 0]), 0.5, atol=1e-6)
    np.testing.assert_allclose(found.witness.point[jnp.array([0, 2])], [0, 1], atol=1e-6)


def test_the_derivative_counts_all_feet():
    lid = PLATE.transform(np.eye(3), [0, 0, 1])

    def distance(height, slope):
        """Both slopes of the valley rise by `slope`, its bottom by `height`."""
        steep = VALLEY.vertices * jnp.array([1.0, 1.0, 1.0]).at[2].set(slope) + jnp.array([0.0, 0.0, 1.0]) * height
        return mesh_directed(lid, TriangleMesh(steep, VALLEY.triangles), METHOD).value

    # The distance is (1 - height) cos(arctan slope).
    gradient = jax.grad(distance, (0, 1))(0.0, 1.0)
    np.testing.assert_allclose(gradient, [-np.sqrt(0.5), -0.5 * np.sqrt(0.5)], atol=1e-6)


def test_the_derivative_in_the_vertices_is_that_of_differences():
    rng = np.random.default_rng(4)
    a, b = torus(12, 8), torus(10, 7)
    moved = a.vertices + 0.1 * rng.normal(size=a.vertices.shape)
    directions = rng.normal(size=(2, 3))

    def distance(s):
        first = TriangleMesh(moved + s * directions[0], a.triangles)
        return mesh_directed(first, TriangleMesh(b.vertices * (1 + s) + s * directions[1], b.triangles), METHOD).value

    numeric = (float(distance(1e-5)) - float(distance(-1e-5))) / 2e-5
    assert float(jax.grad(distance)(0.0)) == pytest.approx(numeric, abs=1e-5)


def check(a, b, found, rng):
    """Bounds against samples of a and against the exact distance of the witness."""
    weights = rng.dirichlet(np.full(3, 0.5), (a.count, 40))
    corners = np.asarray(a.corners)
    points = np.concatenate([np.einsum("nsk,nkd->nsd", weights, corners).reshape(-1, 3), corners.reshape(-1, 3)])
    assert closest_points(b, points).lower.max() <= float(found.upper)
    exact = float(exact_distance_sq(np.asarray(found.witness.point), np.asarray(b.corners))) ** 0.5
    size = max(np.abs(corners).max(), np.abs(np.asarray(b.vertices)).max())
    assert float(found.lower) <= exact + 1e-14 * size
    assert found.result == RESULTS.successful
    assert float(found.value) == pytest.approx(exact, abs=1e-13 * size)
    np.testing.assert_allclose(a.point(found.witness.segment, found.witness.t), found.witness.point, atol=1e-13 * size)
    feet = np.linalg.norm(np.asarray(found.witness.feet) - np.asarray(found.witness.point), axis=1)
    np.testing.assert_allclose(feet, float(found.value), atol=2e-8 * size)


def test_bounds_hold_on_soups_of_hard_triangles():
    rng = np.random.default_rng(2)
    for scale, offset in ((1.0, 0.0), (1e-3, 1e3), (1e100, 0.0)):
        a, b = (soup(hard_triangles(rng, 24) * scale + offset) for _ in range(2))
        check(a, b, mesh_directed(a, b, METHOD), rng)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_bounds_hold_on_random_soups(seed):
    rng = np.random.default_rng(seed)
    a, b = (soup(hard_triangles(rng, int(rng.integers(1, 40)))) for _ in range(2))
    check(a, b, mesh_directed(a, b, METHOD), rng)


@pytest.mark.slow
def test_close_tori_are_bracketed_in_a_few_rounds():
    rng = np.random.default_rng(1)
    a, b = torus(60, 30), torus(47, 23)
    for first, second in ((a, b), (b, a)):
        found = mesh_directed(first, second, METHOD)
        check(first, second, found, rng)
        assert float(found.upper - found.lower) <= 1e-9 and int(found.stats["steps"]) < 30


def test_a_part_of_the_same_surface_is_at_distance_zero():
    cube = TriangleMesh(CORNERS, CUBE)
    found = mesh_directed(TriangleMesh(CORNERS, CUBE[:5]), cube, METHOD)
    assert float(found.lower) == 0.0 and float(found.upper) < 1e-12
    assert found.event == EVENTS.coincident


def test_the_same_surface_in_other_triangles_is_at_distance_zero():
    rng = np.random.default_rng(0)
    squares = CUBE.reshape(6, 6)[:, [0, 1, 2, 5]]
    other = TriangleMesh(CORNERS, [t for a, b, c, d in squares for t in ((a, b, d), (b, c, d))])
    a, b = divided(divided(TriangleMesh(CORNERS, CUBE), rng), rng), divided(other, rng)
    for first, second in ((a, b), (b, a)):
        found = mesh_directed(first, second, METHOD)
        assert found.result == RESULTS.successful
        assert float(found.lower) == 0.0 and float(found.upper) < 1e-10
        assert int(found.stats["steps"]) < 30


def test_tolerance_level_and_ceiling_end_the_search_early():
    a, b = torus(12, 8), torus(10, 7)
    full = mesh_directed(a, b, METHOD)
    loose = mesh_directed(a, b, BranchAndBound(atol=0.05))
    assert float(loose.lower) <= float(full.value) <= float(loose.upper) <= float(loose.lower) + 0.05
    assert int(loose.stats["split"]) < int(full.stats["split"])
    stopped = mesh_directed(a, b, METHOD, ceiling=0.5 * float(full.value))
    assert float(stopped.lower) > 0.5 * float(full.value) and float(stopped.upper) >= float(full.lower)
    level = 2 * float(full.value)
    pruned = mesh_directed(a, b, METHOD, level=level)
    assert int(pruned.stats["split"]) < int(full.stats["split"])
    assert float(full.lower) <= float(pruned.upper) <= level


def test_steps_that_are_used_up_and_interruption_leave_true_bounds():
    a, b = torus(12, 8), torus(10, 7)
    full = mesh_directed(a, b, METHOD)
    few = mesh_directed(a, b, BranchAndBound(max_steps=1))
    assert few.result == RESULTS.gap_not_closed

    def interrupting(report):
        reports.append(report)
        if report.steps == 1:
            raise KeyboardInterrupt

    reports = []
    stopped = mesh_directed(a, b, METHOD, progress=interrupting)
    assert stopped.result == RESULTS.interrupted
    for found in (few, stopped):
        assert float(found.lower) <= float(full.lower) <= float(full.upper) <= float(found.upper) + 1e-10
    assert [report.steps for report in reports] == [0, 1]
    assert reports[1].lower <= float(full.upper) and reports[1].upper >= float(full.lower)


def test_traced_meshes_and_other_shapes_are_refused(as_a_user):
    with pytest.raises(TypeError, match="not under jit or vmap"):
        jax.jit(lambda v: mesh_directed(TriangleMesh(v, PLATE.triangles), VALLEY, METHOD).value)(PLATE.vertices)
    with pytest.raises(TypeError, match="b must be a TriangleMesh"):
        mesh_directed(PLATE, PLATE.vertices, METHOD)  # pyright: ignore[reportArgumentType]
