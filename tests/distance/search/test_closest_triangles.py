"""Minimum distances of meshes: the exact one of all pairs, meshes that meet, other shapes, derivatives, refusals."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.minimum import minimum_distance
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._results.solution import NotProvenError, name_of
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.curve import BezierSegments
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import BezierPatch
from jhd._shapes.simple_curves import point_set, polyline
from jhd._triangles.exact_triangles import exact_pair
from tests.sweeps import swept
from tests.triangles.exact_triangles import hard_triangles

# Central differences of a value with an error of 1e-16 and the step 1e-5.
DIFFERENCES = 1e-9
# A few neighboring floats.
ULPS = 4 * 2.0**-53


def soup(corners):
    return TriangleMesh(np.asarray(corners).reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


# Of the corners of a cube as binary numbers.
CUBE = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
CUBE += [[1, 5, 7], [1, 7, 3]]


def sphere(rows, radius=1.0, center=(0.0, 0.0, 0.0)):
    """A closed mesh of 4 rows (rows - 1) triangles whose poles are on the third axis."""
    v, u = np.meshgrid(
        np.linspace(0, np.pi, rows + 1)[1:-1], np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False), indexing="ij"
    )
    ring = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rows - 2), np.arange(2 * rows), indexing="ij")
    k = (j + 1) % (2 * rows)
    quads = np.stack([i * 2 * rows + j, (i + 1) * 2 * rows + j, i * 2 * rows + k, (i + 1) * 2 * rows + k], axis=-1)
    faces = np.concatenate([quads[..., [0, 1, 2]], quads[..., [2, 1, 3]]]).reshape(-1, 3)
    j, last, count = np.arange(2 * rows), len(ring) - 2 * rows, len(ring)
    k = (j + 1) % (2 * rows)
    north = np.stack([np.full(2 * rows, count), j, k], axis=1)
    south = np.stack([np.full(2 * rows, count + 1), last + k, last + j], axis=1)
    poles = np.array([[0.0, 0, 1], [0, 0, -1]])
    return TriangleMesh(
        radius * np.concatenate([ring, poles]) + np.asarray(center), np.concatenate([faces, north, south])
    )


def exact_square(a, b):
    """The least squared distance of all pairs of triangles."""
    a, b = np.asarray(a.corners), np.asarray(b.corners)
    return min(exact_pair(x, y).square for x in a for y in b)


def encloses(found, square):
    lower, upper = Fraction(float(found.lower)), Fraction(float(found.upper))
    return lower**2 <= square <= upper**2 and found.lower <= found.value <= found.upper


@pytest.mark.parametrize("seed", range(6))
def test_bounds_of_triangles_of_all_kinds_hold_the_exact_distance_and_are_neighbors(seed):
    rng = np.random.default_rng(seed)
    a, b = hard_triangles(rng, 8), hard_triangles(rng, 8)
    shift = [[0.0, 0, 0], [3, 0, 0], [1e3, 0, 0], [1e-3, 2, 0], [0, 0, 8], [1e7, 1e7, 1e7]][seed]
    a, b = soup(a), soup(b + np.array(shift))
    found = minimum_distance(a, b)
    assert encloses(found, exact_square(a, b))
    assert found.upper - found.lower <= ULPS * found.upper
    assert name_of(found.result) == "successful"


@pytest.mark.parametrize(
    ("name", "b", "exact"),
    [
        ("beside", sphere(12, 1.0, (0.0, 0.0, 2.5)), 0.5),
        ("far", sphere(12, 1.0, (0.0, 0.0, 1e6)), 1e6 - 2),
        ("touching", sphere(12, 1.0, (0.0, 0.0, 2.0)), 0.0),
        ("almost touching", sphere(12, 1.0, (0.0, 0.0, 2.0 + 2.0**-40)), 2.0**-40),
        ("through each other", sphere(12, 1.0, (0.3, 0.2, 0.5)), 0.0),
        ("the same", sphere(12), 0.0),
    ],
)
def test_spheres(name, b, exact):
    found = minimum_distance(sphere(12), b)
    assert found.lower <= exact <= found.upper and found.upper - found.lower <= ULPS * max(exact, 1.0)
    assert abs(float(found.value) - exact) <= ULPS * max(exact, 1.0)
    apart = np.linalg.norm(np.asarray(found.point_a) - np.asarray(found.point_b))
    assert abs(apart - exact) <= 4 * ULPS * max(exact, 1.0)
    if exact == 0:
        assert found.upper == 0


def test_of_a_mesh_inside_another_one_the_distance_of_the_surfaces_is_meant():
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]) @ np.array([[1.0, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]])
    inner = TriangleMesh(signs @ turn + [0.1, 0.2, 0.3], CUBE)
    exact = 4 - np.abs(np.asarray(inner.vertices)).max()
    found = minimum_distance(TriangleMesh(4 * signs, CUBE), inner)
    assert found.lower <= exact <= found.upper and found.upper - found.lower <= ULPS


def test_meshes_that_share_no_corner_and_meet_have_a_distance_of_exactly_zero():
    a = soup([[[0.1, 0.2, 0.3], [1.7, 0.3, 0.1], [0.2, 1.9, 0.4]]])
    b = soup([[[0.5, 0.6, -1.1], [0.6, 0.7, 1.3], [3.3, 3.1, 1.7]]])
    found = minimum_distance(a, b)
    assert found.lower == found.value == found.upper == 0
    # The point where the edge goes through the face, once rounded for each.
    np.testing.assert_allclose(found.point_a, found.point_b, atol=1e-15)


def moved(mesh, scale, offset):
    return TriangleMesh(mesh.vertices * scale + offset, mesh.triangles)


def test_the_last_digit_survives_a_move_far_away_and_any_unit():
    a, b = sphere(8), sphere(8, 1.0, (0.0, 0.0, 2.5))
    near = float(minimum_distance(a, b).value)
    for unit in (2.0**900, 2.0**-900):
        scaled = minimum_distance(moved(a, unit, 0.0), moved(b, unit, 0.0))
        assert float(scaled.value) == near * unit
    far = minimum_distance(moved(a, 1.0, 2.0**30), moved(b, 1.0, 2.0**30))
    assert encloses(far, Fraction(1, 4)) and abs(float(far.value) - 0.5) <= 2.0**-22


def test_points_and_polylines_are_measured_against_meshes():
    ball = sphere(12)
    found = minimum_distance(point_set([[0.0, 0, 3], [4, 4, 4]]), ball)
    assert found.value == 2 and found.point_b.tolist() == [0, 0, 1]
    line = polyline([[-5.0, 0, 2], [5, 0, 2], [5, 5, 2]])
    found = minimum_distance(ball, line)
    assert found.lower <= 1 <= found.upper and found.point_b.tolist() == [0, 0, 2]
    through = BezierSegments(np.array([[[0.0, 0, 0], [0.1, 0, 9]]]), np.array([[1.0, 3.0]]))
    assert minimum_distance(ball, through).upper == 0


def test_of_many_pairs_at_one_distance_the_bounds_meet_the_tolerance():
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), axis=-1).reshape(-1, 2) / 4
    index = np.arange(16).reshape(4, 4)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [2, 1, 3]]])
    tilt = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    a, b = (TriangleMesh(np.insert(grid, 2, z, axis=1) @ tilt, faces) for z in (0.0, 2.0**-20))
    found = minimum_distance(a, b)
    # The tilted corners are rounded.
    assert abs(float(found.value) - 2.0**-20) < 1e-15 and found.upper - found.lower <= 1e-10
    assert encloses(found, exact_square(a, b))


A = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
FEATURES = {
    "two corners": [[5.0, 0, 1], [7, 0, 2], [6, 1, 3]],
    "a corner and an edge": [[2.0, -1, 1], [3, -4, 2], [1, -4, 4]],
    "a corner and a face": [[1.0, 1, 1], [1, 2, 3], [3, 1, 4]],
    "two edges": [[2.0, -1, -2], [2, -1, 3], [2, -6, 0]],
}


@pytest.mark.parametrize("name", swept(FEATURES, slow=["a corner and a face", "two edges"]))
def test_first_and_second_derivatives_are_those_of_differences(name):
    corners = jnp.stack([A, np.array(FEATURES[name])])
    ways = np.random.default_rng(3).normal(size=(2, 2, 3, 3))

    def distance(x):
        return minimum_distance(TriangleMesh(x[0], [[0, 1, 2]]), TriangleMesh(x[1], [[0, 1, 2]])).value

    h, slope = 1e-5, jax.grad(distance)
    for way in ways:
        first = (distance(corners + h * way) - distance(corners - h * way)) / (2 * h)
        assert abs(float(first - jnp.sum(slope(corners) * way))) < DIFFERENCES
        second = (slope(corners + h * way) - slope(corners - h * way)) / (2 * h)
        found = jax.jvp(slope, (corners,), (jnp.asarray(way),))[1]
        np.testing.assert_allclose(found, second, atol=DIFFERENCES)


@pytest.mark.slow
def test_the_points_move_with_the_corners_and_where_meshes_meet_derivatives_are_zero():
    def gap(z):
        return minimum_distance(sphere(6), point_set(jnp.stack([0.1, 0.2, z])[None]))

    value, slope = jax.value_and_grad(lambda z: gap(z).value)(3.0)
    assert abs(float(slope) - 1) < 0.02 and value > 0
    h = 1e-5
    moved = jax.jacfwd(lambda z: gap(z).point_b)(3.0)
    np.testing.assert_allclose(moved, (gap(3.0 + h).point_b - gap(3.0 - h).point_b) / (2 * h), atol=1e-9)
    rows = jnp.asarray(A)
    met = jax.grad(lambda x: minimum_distance(TriangleMesh(x, [[0, 1, 2]]), soup([A + 0.0])).value)(rows)
    assert not met.any()


OTHERS = {
    "a curve": (BezierCurve([[2.0, 0, 1], [1.5, 1, 1], [2, 2, 1]]), 0.75),
    "a patch": (BezierPatch([[[2.0, 0, 0], [2, 0, 2]], [[2, 2, 0], [2, 2, 2]]]), 1.0),
    "a surface": (ImplicitSurface.parse("(x - 3)^2 + y^2 + z^2 - 1", [1, -2, -2], [4, 2, 2]), 1.0),
}


@pytest.mark.parametrize("name", swept(OTHERS, slow=["a patch"]))
def test_curves_and_surfaces_are_measured_against_meshes(name):
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    other, exact = OTHERS[name]
    for found in (
        minimum_distance(TriangleMesh(signs, CUBE), other),
        minimum_distance(other, TriangleMesh(signs, CUBE)),
    ):
        assert found.lower <= exact <= found.upper and found.upper - found.lower <= 1e-8


@pytest.mark.slow
def test_under_jit_and_in_a_batch_the_bounds_hold_too():
    far = jnp.asarray(A) + jnp.array([1.0, 1, 2])

    def solved(x):
        return minimum_distance(TriangleMesh(x, [[0, 1, 2]]), TriangleMesh(far, [[0, 1, 2]]))

    rows = jnp.asarray(A) + jnp.array([0.0, 1.0, 5.0])[:, None, None]
    found = jax.jit(jax.vmap(solved))(rows)
    for k, x in enumerate(rows):
        plain = solved(x)
        assert found.lower[k] <= plain.upper and found.upper[k] >= plain.lower
        assert abs(float(found.value[k] - plain.value)) < 1e-9
    slopes = jax.jit(jax.vmap(jax.grad(lambda x: solved(x).value)))(rows)
    np.testing.assert_allclose(slopes[2], jax.grad(lambda x: solved(x).value)(rows[2]), atol=1e-6)


def test_other_kinds_and_dimensions_are_refused():
    with pytest.raises(TypeError, match="b must be a shape of jhd.* got int"):
        minimum_distance(sphere(4), 3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="a has 3 coordinates a point and b has 2"):
        minimum_distance(sphere(4), point_set([[0.0, 0]]))


def test_progress_is_reported_and_a_search_that_is_cut_short_says_so():
    seen = []
    a, b = sphere(12), sphere(12, 1.0, (0.3, 0.4, 2.5))
    full = minimum_distance(a, b, progress=seen.append)
    assert seen and all(x.lower <= full.value <= x.upper for x in seen)
    with pytest.raises(NotProvenError) as caught:
        minimum_distance(a, b, BranchAndBound(max_steps=1))
    reached = caught.value.solution
    assert name_of(reached.result) == "gap_not_closed" and reached.lower <= full.lower <= full.upper <= reached.upper


def test_interruption_keeps_the_bounds_reached():
    def stop(progress):
        raise KeyboardInterrupt

    found = minimum_distance(sphere(12), sphere(12, 1.0, (0.3, 0.4, 2.5)), progress=stop, throw=False)
    assert name_of(found.result) == "interrupted" and 0 <= found.lower <= found.upper < np.inf


@pytest.mark.parametrize("seed", swept(range(20), slow=range(2)))
def test_bounds_hold_the_exact_distance_of_many_random_meshes(seed):
    rng = np.random.default_rng(100 + seed)
    a, b = hard_triangles(rng, 12), hard_triangles(rng, 16) * 10.0 ** rng.uniform(-6, 2)
    b = b + rng.normal(size=3) * 10.0 ** rng.uniform(-3, 4)
    a, b = soup(a), soup(b)
    found = minimum_distance(a, b)
    assert encloses(found, exact_square(a, b)) and found.upper - found.lower <= ULPS * found.upper


@pytest.mark.slow
def test_two_meshes_of_seventy_thousand_triangles_take_few_blocks_and_few_exact_pairs():
    a = sphere(132)
    for shift in ((0.3, 0.2, 2.5), (5.0, 7.0, 9.0), (0.5, 0.3, 0.2), (0.0, 0.0, 2.0)):
        found = minimum_distance(a, TriangleMesh(a.vertices + np.array(shift), a.triangles))
        assert found.stats["steps"] <= 30 and found.stats["exact"] <= 80
