"""Nearest points of meshes through the public entries: derivatives, tracing, signs, and what is refused."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.project import project
from jhd._distance.project_methods import NewtonProjection
from jhd._distance.published.vertex_voxels import VertexVoxels
from jhd._distance.signed_distance import signed_distance
from jhd._results.solution import RESULTS
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.unit import in_unit
from jhd._triangles.winding import _numbers, _prepared, is_inside, solid_angles
from tests.shapes.test_mesh import CORNERS, CUBE
from tests.triangles.exact_triangles import exact_distance_sq, hard_points, hard_triangles

VERTICES = np.array([[0, 0, 0], [1, 0.1, 0], [0.2, 1, 0.3], [1, 1, -0.4]])
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])
# Feet in a face, at a corner, on a border, and on the edge between both triangles.
QUERIES = np.array([[0.3, 0.3, 0.7], [-1, -0.5, 0.2], [0.5, -1, 0.3], [0.6, 0.55, 1.5]])
DIFFERENCE, NEAR = 1e-5, 1e-8


def answer(point, vertices):
    found = project(point, TriangleMesh(vertices, TRIANGLES))
    return jnp.concatenate([found.distance[None], found.foot, found.t])


slopes = jax.jit(jax.jacobian(answer, (0, 1)))


def differences(function, x):
    """Central differences of an array-valued function in all entries of x, last axes."""
    columns = []
    for index in np.ndindex(x.shape):
        step = np.zeros(x.shape)
        step[index] = DIFFERENCE
        columns.append((np.asarray(function(x + step)) - np.asarray(function(x - step))) / (2 * DIFFERENCE))
    return np.stack(columns, axis=-1).reshape(*columns[0].shape, *x.shape)


@pytest.mark.slow
@pytest.mark.parametrize("query", QUERIES, ids="face corner border edge".split())
def test_derivatives_are_those_of_differences(query):
    by_point, by_vertices = slopes(jnp.array(query), jnp.array(VERTICES))
    # On a common edge either triangle may be named, and coordinates are those on it.
    rows = 4 if np.array_equal(query, QUERIES[-1]) else 7
    expected = differences(lambda x: answer(x, VERTICES), query), differences(lambda x: answer(query, x), VERTICES)
    np.testing.assert_allclose(by_point[:rows], expected[0][:rows], atol=NEAR)
    np.testing.assert_allclose(by_vertices[:rows], expected[1][:rows], atol=NEAR)


@pytest.mark.slow
@pytest.mark.parametrize("query", QUERIES, ids="face corner border edge".split())
def test_second_derivatives_are_those_of_differences(query):
    def distance(point, vertices):
        return answer(point, vertices)[0]

    slope = jax.grad(distance, (0, 1))
    second = jax.hessian(distance, (0, 1))(jnp.array(query), jnp.array(VERTICES))
    for i in range(2):
        by_point = differences(lambda x, i=i: slope(jnp.array(x), jnp.array(VERTICES))[i], query)
        by_vertices = differences(lambda x, i=i: slope(jnp.array(query), jnp.array(x))[i], VERTICES)
        np.testing.assert_allclose(second[i][0], by_point, atol=1e-7)
        np.testing.assert_allclose(second[i][1], by_vertices, atol=1e-7)


def test_on_the_mesh_the_derivative_is_zero_and_beside_it_a_unit_vector():
    gradient = jax.grad(lambda x: answer(x, VERTICES)[0])
    np.testing.assert_array_equal(gradient(jnp.array(VERTICES[0])), 0.0)
    normal = np.cross(VERTICES[1] - VERTICES[0], VERTICES[2] - VERTICES[0])
    normal /= np.linalg.norm(normal)
    close = gradient(jnp.array(VERTICES[:3].mean(axis=0) - 1e-13 * normal))
    np.testing.assert_allclose(close, -normal, atol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1e150])
def test_under_jit_all_triangles_are_compared_with_the_same_proof(scale):
    rng = np.random.default_rng(5)
    corners = hard_triangles(rng, 24) * scale
    points = hard_points(rng, corners / scale, 24) * scale
    mesh = TriangleMesh(corners.reshape(-1, 3), np.arange(72).reshape(-1, 3))
    known, traced = project(points, mesh), jax.jit(project)(points, mesh)
    np.testing.assert_allclose(traced.distance / scale, known.distance / scale, atol=1e-12)
    for found in (known, traced):
        for k in range(0, 24, 5):
            lower, upper = (Fraction(float(x[k])) for x in (found.lower, found.upper))
            assert lower**2 <= exact_distance_sq(points[k], corners) <= upper**2
        assert np.all(np.asarray(found.result == RESULTS.successful))


def test_under_jit_a_query_that_is_no_number_says_so():
    mesh = TriangleMesh(VERTICES, TRIANGLES)
    found = jax.jit(lambda x: project(x, mesh))(jnp.array([[np.nan, 0, 0], QUERIES[0]]))
    assert (float(found.lower[0]), float(found.upper[0])) == (0.0, np.inf)
    assert (found.result == RESULTS.nonfinite_value).tolist() == [True, False]


def test_the_shape_of_the_queries_is_kept():
    found = project(QUERIES.reshape(2, 2, 3), TriangleMesh(VERTICES, TRIANGLES))
    assert (found.distance.shape, found.foot.shape, found.t.shape) == ((2, 2), (2, 2, 3), (2, 2, 3))
    assert found.element.tolist()[0] == [0, 0]


@pytest.mark.parametrize(
    ("points", "options", "error", "message"),
    [
        ([0.0, 0.0], {}, ValueError, r"points has shape \(2,\); needs \(\.\.\., 3\)"),
        (np.zeros((0, 3)), {}, ValueError, "points is empty"),
        ([0.0, np.nan, 0.0], {}, ValueError, r"points\[1\] is not finite: nan"),
        (["a"] * 3, {}, TypeError, "points must be real numbers"),
        ([0.0, 0.0, 0.0], {"method": NewtonProjection()}, TypeError, "None for meshes, .* or VertexVoxels; got Newton"),
    ],
)
def test_what_cannot_be_projected_is_refused(points, options, error, message):
    with pytest.raises(error, match=message):
        project(points, TriangleMesh(VERTICES, TRIANGLES), **options)


def test_the_local_search_claims_an_upper_bound_alone_and_moves_with_points_and_vertices():
    mesh = TriangleMesh(VERTICES, TRIANGLES)
    assert [VertexVoxels(n).voxels(mesh) for n in (None, 8)] == [2, 8]
    found = project(QUERIES.reshape(2, 2, 3), mesh, VertexVoxels())
    assert found.foot.shape == (2, 2, 3) and not np.any(found.lower)
    assert np.all(np.asarray(found.result == RESULTS.successful))
    # Two triangles with a common edge are both around every vertex that is near to these points.
    np.testing.assert_array_equal(found.distance, project(QUERIES.reshape(2, 2, 3), mesh).distance)
    derivatives = [
        jax.grad(lambda x, v, m=m: project(x, TriangleMesh(v, TRIANGLES), m).distance, (0, 1))(QUERIES[0], VERTICES)
        for m in (None, VertexVoxels())
    ]
    jax.tree_util.tree_map(np.testing.assert_array_equal, *derivatives)


def test_the_local_search_is_refused_on_curves_under_jit_and_with_options_out_of_range():
    with pytest.raises(TypeError, match="method must be one of BestFirstProjection, .* for curves; got VertexVoxels"):
        project([0.0, 0], jhd.polyline([[0.0, 0], [1, 1]]), VertexVoxels())
    with pytest.raises(TypeError, match="VertexVoxels runs on the host, not under jit"):
        jax.jit(lambda x: project(x, TriangleMesh(VERTICES, TRIANGLES), VertexVoxels()))(QUERIES)
    with pytest.raises(ValueError, match="resolution asks for 300 voxels along each axis; capacity is 16777216"):
        project(QUERIES, TriangleMesh(VERTICES, TRIANGLES), VertexVoxels(300))
    with pytest.raises(TypeError, match="pass a concrete mesh"):
        jax.jit(lambda x: VertexVoxels().voxels(TriangleMesh(x, TRIANGLES)))(VERTICES)
    with pytest.raises(ValueError, match="resolution is 0; needs a whole number of at least 1"):
        VertexVoxels(0)
    with pytest.raises(ValueError, match="capacity is -1; needs a whole number of at least 1"):
        VertexVoxels(capacity=-1)
    with pytest.raises(ValueError, match="transform is 'chamfer'; needs one of 'exact', 'vector_propagation'"):
        VertexVoxels(transform="chamfer")


def cube_distance(points):
    """The signed distance to the surface of the unit cube, exactly but for rounding."""
    q = np.abs(points - 0.5) - 0.5
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)


@pytest.mark.parametrize("sign", ["winding", "pseudonormal"])
@pytest.mark.parametrize("turned", [False, True])
def test_signed_distances_of_a_cube_are_negative_inside(sign, turned):
    points = np.random.default_rng(1).uniform(-0.5, 1.5, (60, 3))
    points[:3] = [[0.5, 0.5, 0.5], [0.5, 0.5, 1e-12], [1.5, 0.5, 0.5]]
    # Every vertex three times over, as in files with seams, and a triangle without area.
    separate = np.asarray(CORNERS[CUBE[:, ::-1] if turned else CUBE]).reshape(-1, 3)
    triangles = np.concatenate([np.arange(36).reshape(-1, 3), [[0, 0, 1]]])
    found = signed_distance(points, TriangleMesh(separate, triangles), sign)
    np.testing.assert_allclose(found, cube_distance(points), atol=1e-15)


# Lower and upper corners of boxes, and a point outside from which a wall is seen nearly along its length.
THIN_BOXES = [
    ((-1, -3, -2), (1, 3, -1.9999999962747097), (0.9999999974967718, 0.6345642953989598, -1.9999999897337255)),
    ((-1, -3, -4), (1, -2.9999999701976776, 2), (-0.9999999999955489, -2.9999999701903746, 0.2632588306102695)),
    ((-1, -4, -1), (-0.9999999850988388, 1, 3), (-0.9999999965463869, -2.2870797968127095, -1.0000000000009046)),
    ((-1, -1, -4), (1, 3, -3.999999985098839), (1.000000000001291, 1.881006121702768, -4.000000000001144)),
]


def test_the_sign_is_certain_beside_thin_walls():
    for low, high, point in THIN_BOXES:
        box = TriangleMesh(np.where(np.asarray(CORNERS) > 0, high, low), CUBE)
        assert 0 < float(signed_distance(point, box)) < 1e-8
        assert float(signed_distance(0.5 * np.add(low, high), box)) < 0


def test_the_sign_comes_through_jit_and_derivatives():
    mesh = TriangleMesh(CORNERS, CUBE)
    points = np.random.default_rng(2).uniform(-0.5, 1.5, (24, 3))
    np.testing.assert_allclose(jax.jit(signed_distance)(points, mesh), cube_distance(points), atol=1e-15)
    gradient = jax.grad(lambda x: signed_distance(x, mesh))(jnp.array([0.5, 0.4, 0.9]))
    np.testing.assert_allclose(gradient, [0, 0, 1], atol=1e-15)


def test_a_mesh_with_a_hole_has_an_inside_by_winding_alone():
    mesh = TriangleMesh(CORNERS, CUBE[1:])
    points = np.array([[0.5, 0.5, 0.5], [0.1, 0.9, 0.9], [2, 0.5, 0.5]])
    assert (signed_distance(points, mesh) < 0).tolist() == [True, True, False]
    turned = np.concatenate([CUBE[:1, ::-1], CUBE[1:]])
    for other in (mesh, TriangleMesh(CORNERS, turned)):
        with pytest.raises(ValueError, match="sign='pseudonormal' needs a closed mesh"):
            signed_distance(points, other, "pseudonormal")


def test_averages_count_triangles_alike_so_a_vertex_with_many_on_one_side_turns_the_sign():
    # A pyramid with the top at z = 3, one of its sides cut into a fan of 31 triangles.
    low = np.linspace(-1, 1, 32)
    around = np.concatenate([np.stack([np.ones(32), low], axis=1), [[-1, 1], [-1, -1]]])
    vertices = np.concatenate([np.pad(around, ((0, 0), (0, 1))), [[0, 0, 3]]])
    i, count = np.arange(len(around)), len(around)
    triangles = np.stack([i, (i + 1) % count, np.full(count, count)], axis=1)
    base = np.stack([np.full(count - 2, count - 1), i[1:-1], i[:-2]], axis=1)
    mesh = TriangleMesh(vertices, np.concatenate([triangles, base]))
    above = np.array([[-1.0, 0, 3.5], [1, 0, 3.5], [0, 0, 1]])
    by_sign = {sign: signed_distance(above, mesh, sign) for sign in ("winding", "pseudonormal", "average")}
    assert [(np.asarray(x) < 0).tolist() for x in by_sign.values()] == 2 * [[False, False, True]] + [
        [True, False, True]
    ]
    # With the local search, the published sign is the default.
    method = VertexVoxels(8)
    for sign, same in ((None, "average"), ("winding", "winding")):
        np.testing.assert_allclose(signed_distance(above, mesh, sign, method=method), by_sign[same], rtol=1e-15)


def test_unknown_signs_other_shapes_and_traced_pseudonormals_are_refused(as_a_user):
    mesh = TriangleMesh(CORNERS, CUBE)
    with pytest.raises(ValueError, match="sign is 'raycast'; needs one of 'winding', 'pseudonormal', 'average'"):
        signed_distance([0.0, 0, 0], mesh, "raycast")
    with pytest.raises(TypeError, match="mesh must be a TriangleMesh"):
        signed_distance([0.0, 0, 0], jhd.point_set([[0.0, 0, 0]]))  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="under jit use sign='winding'"):
        jax.jit(lambda x: signed_distance(x, mesh, "pseudonormal"))(jnp.zeros(3))


def torus(rows, columns):
    u, v = (np.linspace(0, 2 * np.pi, n, endpoint=False) for n in (rows, columns))
    u, v = np.meshgrid(u, v, indexing="ij")
    width = 1 + 0.4 * np.cos(v)
    points = np.stack([width * np.cos(u), width * np.sin(u), 0.4 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (i + 1) % rows * columns + j, (i + 1) % rows * columns + (j + 1) % columns
    return TriangleMesh(points, np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3))


@pytest.mark.slow
def test_errors_of_winding_numbers_hold_and_all_ways_to_decide_agree():
    mesh = torus(40, 20)
    points = np.random.default_rng(3).uniform(-1.5, 1.5, (400, 3))
    points[200:] = np.asarray(mesh.corners)[:200, 0] * (1 + 1e-4 * np.random.default_rng(4).normal(size=(200, 1)))
    unit, power = in_unit(mesh)
    prepared = _prepared(unit, np.ldexp(points, -power))
    exact, bound = _numbers(*prepared, 0.0)
    np.testing.assert_allclose(exact, np.round(exact), atol=1e-9)
    assert np.max(bound) < 1e-6
    for tolerance in (1e-2, 1e-4):
        number, error = _numbers(*prepared, tolerance)
        assert np.all(np.abs(number - exact) <= error + bound)
        assert np.max(error) > 1e-6
    inside = np.abs(exact) > 0.5
    np.testing.assert_array_equal(is_inside(mesh, points), inside)
    for sign in ("winding", "pseudonormal"):
        np.testing.assert_array_equal(np.asarray(signed_distance(points, mesh, sign)) < 0, inside)


def test_a_solid_angle_is_an_eighth_in_a_corner_and_unsure_on_the_triangle():
    inner = np.eye(3)[None]
    value, bound = solid_angles(jnp.array(np.concatenate([inner, -inner, inner - 1 / 3])))
    np.testing.assert_allclose(value[:2], [1 / 8, -1 / 8], rtol=1e-14)
    assert float(bound[0]) < 1e-13 and float(bound[2]) == pytest.approx(1.0)


def test_sides_of_planes_are_found_for_coordinates_of_any_size():
    corners = np.array([[0.25, -0.5, 1.0], [1.5, 0.75, -0.5], [-1.0, 1.25, 0.5]])
    mesh = jhd.TriangleMesh(corners * 1e110, [[0, 1, 2]])
    # As close to the plane as rounding allows.
    point = np.array([0.3, 0.3, 0.4]) @ (corners * 1e110)
    assert np.isfinite(float(jhd.signed_distance(point, mesh)))
