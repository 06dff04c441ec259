"""Hausdorff distances of meshes: exact answers, bounds that hold, witnesses, derivatives, tolerances, interruption."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.normalization.stopping import Aim
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.search.meshes import MeshSearch
from jhd._distance.search.search import Listener, drive
from jhd._results.solution import EVENTS, RESULTS
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.closest_point import closest_points
from tests.distance.nearest.test_meshes import torus
from tests.shapes.test_mesh import CORNERS, CUBE
from tests.sweeps import swept
from tests.triangles.exact_triangles import exact_distance_sq, hard_triangles

METHOD = BranchAndBound()
# The roof has its ridge over the middle of a square of side two; feet of its ridge are on both slopes of the valley.
PLATE = TriangleMesh([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
VALLEY = TriangleMesh(
    [[-1.0, -1, 1], [0, -1, 0], [1, -1, 1], [-1, 1, 1], [0, 1, 0], [1, 1, 1]],
    [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]],
)


def mesh_directed(a, b, method=METHOD, level=-np.inf, ceiling=np.inf, progress=None):
    """The search itself, without derivatives."""
    return drive(MeshSearch(a, b, method, Aim(level, ceiling)), Listener(progress))


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


@pytest.mark.slow
def test_the_derivative_counts_all_feet():
    lid = PLATE.transform(np.eye(3), [0, 0, 1])

    def distance(height, slope):
        """Both slopes of the valley rise by `slope`, its bottom by `height`."""
        steep = VALLEY.vertices * jnp.array([1.0, 1.0, 1.0]).at[2].set(slope) + jnp.array([0.0, 0.0, 1.0]) * height
        return jhd.directed_hausdorff(lid, TriangleMesh(steep, VALLEY.triangles)).value

    # The distance is (1 - height) cos(arctan slope).
    gradient = jax.grad(distance, (0, 1))(0.0, 1.0)
    np.testing.assert_allclose(gradient, [-np.sqrt(0.5), -0.5 * np.sqrt(0.5)], atol=1e-6)


@pytest.mark.slow
def test_the_derivative_in_the_vertices_is_that_of_differences():
    rng = np.random.default_rng(4)
    a, b = torus(12, 8), torus(10, 7)
    moved = a.vertices + 0.1 * rng.normal(size=a.vertices.shape)
    directions = rng.normal(size=(2, 3))

    def distance(s):
        first = TriangleMesh(moved + s * directions[0], a.triangles)
        return jhd.directed_hausdorff(first, TriangleMesh(b.vertices * (1 + s) + s * directions[1], b.triangles)).value

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
    np.testing.assert_allclose(a.point(found.witness.element, found.witness.t), found.witness.point, atol=1e-13 * size)
    feet = np.linalg.norm(np.asarray(found.witness.feet) - np.asarray(found.witness.point), axis=1)
    np.testing.assert_allclose(feet, float(found.value), atol=2e-8 * size)


def test_bounds_hold_on_soups_of_hard_triangles():
    rng = np.random.default_rng(2)
    for scale, offset in ((1.0, 0.0), (1e-3, 1e3), (1e100, 0.0)):
        a, b = (soup(hard_triangles(rng, 24) * scale + offset) for _ in range(2))
        check(a, b, mesh_directed(a, b, METHOD), rng)


@pytest.mark.parametrize("seed", swept(range(12), slow=range(2)))
def test_bounds_hold_on_random_soups(seed):
    rng = np.random.default_rng(seed)
    a, b = (soup(hard_triangles(rng, int(rng.integers(1, 40)))) for _ in range(2))
    check(a, b, mesh_directed(a, b, METHOD), rng)


@pytest.mark.exhaustive
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


@pytest.mark.slow
def test_meshes_in_map_coordinates_keep_their_digits():
    # As in the test above; moved by whole numbers, the coordinates are the same floats.
    lid, origin = PLATE.transform(np.eye(3), [0, 0, 1]), np.array([431234, 5412345, 210])
    a, b = (TriangleMesh(np.asarray(x.vertices) + origin, x.triangles) for x in (lid, VALLEY))
    near = jhd.directed_hausdorff(lid, VALLEY)
    for function in (jhd.directed_hausdorff, jax.jit(jhd.directed_hausdorff)):
        found = function(a, b)
        assert found.result == RESULTS.successful
        assert all(float(getattr(found, x)) == float(getattr(near, x)) for x in ("lower", "value", "upper"))
        for x in ("point", "feet"):
            np.testing.assert_allclose(getattr(found.witness, x), getattr(near.witness, x) + origin, rtol=1e-15)

    def raised(z, lid, valley):
        return jhd.directed_hausdorff(TriangleMesh(lid.vertices + z * jnp.eye(3)[2], lid.triangles), valley).value

    slopes = [jax.grad(raised)(0.0, *pair) for pair in ((a, b), (lid, VALLEY))]
    np.testing.assert_allclose(*slopes, rtol=1e-15)


@pytest.mark.slow
def test_no_search_says_that_it_has_closed_a_gap_that_rounding_leaves():
    method = BranchAndBound(atol=1e-18)
    lid, points = PLATE.transform(np.eye(3), [0.1, 0.2, 0.7]), jhd.point_set([[0.1, 0.2, 0.3], [0.7, 0.1, 0.4]])
    for a in (lid, points, jhd.polyline([(0.1, 0.2, 0.3), (0.4, 0.1, 0.9)])):
        found = jhd.directed_hausdorff(a, VALLEY, method, throw=False)
        assert found.result == RESULTS.gap_not_closed and 1e-18 < float(found.upper - found.lower) < 1e-12
    a, b = (jhd.polyline(x) for x in ([(0.1, 0.2), (0.4, 0.1)], [(0.3, 0.7), (0.9, 0.8)]))
    assert jhd.minimum_distance(a, b, method, throw=False).result == RESULTS.gap_not_closed


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
        if report.done == 1:
            raise KeyboardInterrupt

    reports = []
    stopped = mesh_directed(a, b, METHOD, progress=interrupting)
    assert stopped.result == RESULTS.interrupted
    for found in (few, stopped):
        assert float(found.lower) <= float(full.lower) <= float(full.upper) <= float(found.upper) + 1e-10
    assert [report.done for report in reports] == [0, 1]
    assert reports[1].lower <= float(full.upper) and reports[1].upper >= float(full.lower)


def test_more_cells_than_there_is_room_for_end_the_search_with_true_bounds(monkeypatch):
    monkeypatch.setattr("jhd._distance.search.meshes._ROOM", 1)
    a, b = torus(12, 8), torus(10, 7)
    found, full = (
        mesh_directed(a, b, BranchAndBound(queue_size=16)),
        mesh_directed(a, b, BranchAndBound(queue_size=4096)),
    )
    assert found.result == RESULTS.capacity_reached and full.result == RESULTS.successful
    assert float(found.lower) <= float(full.lower) <= float(full.upper) <= float(found.upper)


def test_other_shapes_are_refused(as_a_user):
    with pytest.raises(TypeError, match="b must be a shape of jhd, .* a mesh .* got float"):
        jhd.directed_hausdorff(PLATE, 1.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="b: text is not a shape"):
        jhd.directed_hausdorff(PLATE, "a plate")  # pyright: ignore[reportArgumentType]


def lifted(shift):
    """A cube, larger by a tenth and moved, which has its farthest corner on one side."""
    return TriangleMesh(CORNERS * 1.1 + jnp.asarray(shift), CUBE)


@pytest.mark.slow
def test_a_compiled_program_gives_the_plain_answer_and_its_derivative():
    cube = TriangleMesh(CORNERS, CUBE)

    def distance(shift):
        return jhd.hausdorff(lifted(shift), cube)

    shifts = jnp.array([[0.0, 0, 0.25], [0.5, 0.1, 0]])
    plain = [distance(shift) for shift in shifts]
    batch = jax.jit(jax.vmap(distance))(shifts)
    for k, one in enumerate(plain):
        assert (batch.lower[k], batch.value[k], batch.upper[k]) == (one.lower, one.value, one.upper)
        assert batch.stats["a_to_b_steps"][k] == one.stats["a_to_b_steps"]
    slopes = jax.jit(jax.vmap(jax.grad(lambda shift: distance(shift).value)))(shifts)
    expected = [jax.grad(lambda shift: distance(shift).value)(shift) for shift in shifts]
    np.testing.assert_allclose(slopes, expected, atol=1e-14)
    assert np.abs(slopes).max() > 0.5


def test_a_search_called_from_a_program_runs_beside_other_work():
    cube = TriangleMesh(CORNERS, CUBE)

    @jax.jit
    def both(shift, x):
        step = lambda _, y: jnp.sin(y @ y.T) / 2  # noqa: E731
        return jhd.directed_hausdorff(lifted(shift), cube).value + 0 * jax.lax.fori_loop(0, 20, step, x)[0, 0]

    expected = jhd.directed_hausdorff(lifted(jnp.array([0.0, 0, 0.5])), cube).value
    pending = [both(jnp.array([0.0, 0, 0.5]), jnp.full((64, 64), 1.0 / (64 + k))) for k in range(4)]
    np.testing.assert_array_equal(jnp.stack(pending), jnp.full(4, expected))


def test_what_is_no_number_in_a_program_is_reported():
    cube = TriangleMesh(CORNERS, CUBE)
    found = jax.jit(lambda shift: jhd.hausdorff(lifted(shift), cube))(jnp.array([0, 0, jnp.nan]))
    assert found.result == RESULTS.nonfinite_value and found.lower == 0 and np.isinf(found.upper)


@pytest.mark.parametrize("power", swept([520, 0, -520], slow=1))
def test_second_derivatives_do_not_depend_on_the_unit(power):
    unit = 2.0**power
    above, below = np.array([(0, 0, 3.0), (1, 0, 3), (0, 1, 3.5)]), np.array([(-1, -1, 0.0), (1, -1, 0), (0, 1, 0.5)])

    def distance(s):
        source, target = (TriangleMesh(x * unit, [(0, 1, 2)]) for x in (jnp.asarray(above) * s, below))
        return jhd.directed_hausdorff(source, target).value / unit

    # The foot of (0, s, 3.5 s) is the corner (0, 1, 0.5): the distance is |(s - 1, 3.5 s - 0.5)|, at s = 1 that is 3.
    np.testing.assert_allclose(jax.hessian(distance)(1.0), 1 / 3, rtol=1e-12)
