"""Triangle meshes: what they refuse, what they measure, which edges they share, how they move and differentiate."""

from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._shapes.mesh import TriangleMesh, check_mesh, edges_of, places_of
from jhd._shapes.simple_curves import point_set

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
# Six squares, two triangles each, counter-clockwise from outside.
SQUARES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
CUBE = np.array([t for a, b, c, d in SQUARES for t in ((a, b, c), (a, c, d))])
TETRAHEDRON = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
CORNER = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    ("vertices", "triangles", "error", "message"),
    [
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], ValueError, r"vertices has shape \(3, 2\); needs \(vertices, 3\)"),
        ([0, 0, 0], [[0, 0, 0]], ValueError, r"vertices has shape \(3,\)"),
        (np.zeros((3, 9)), [[0, 1, 2]], ValueError, r"needs \(vertices, 3\)\. They are rows: pass the transpose\?"),
        (np.zeros((0, 3)), [[0, 0, 0]], ValueError, "vertices is empty"),
        (CORNER, np.zeros((0, 3), int), ValueError, "triangles is empty"),
        (CORNER, [], ValueError, r"triangles has shape \(0,\); needs \(triangles, 3\)"),
        (CORNER, [[0, 1]], ValueError, r"triangles has shape \(1, 2\)"),
        (CORNER, [[0, 1, 2], [0, 1]], ValueError, "its rows differ in length"),
        (CORNER, [[0, 1, 2], [0, 1, -1]], ValueError, r"triangles\[1\] is \(0, 1, -1\); needs indices from 0 to 3"),
        (CORNER, [[0, 1, 4]], ValueError, r"triangles\[0\] is \(0, 1, 4\); needs indices from 0 to 3\.$"),
        (CORNER, [[1, 2, 3], [4, 3, 2]], ValueError, "from 0 to 3; if they start at 1, subtract 1"),
        (CORNER, [[0.0, 1.0, 2.0]], TypeError, "triangles must be integers; its dtype is float64"),
        (CORNER, [[True, False, True]], TypeError, "its dtype is bool"),
        (CORNER, [["0", "1", "2"]], TypeError, "triangles must be integers"),
        ([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]], [[0, 1, 2]], ValueError, r"vertices\[1\] is not finite"),
        ([[0, 0, 0], [1, 0, np.inf], [0, 1, 0]], [[0, 1, 2]], ValueError, r"vertices\[1\] is not finite"),
        ([["a"] * 3] * 3, [[0, 1, 2]], TypeError, "vertices must be real numbers"),
        (np.eye(3) * 1j, [[0, 1, 2]], TypeError, "vertices must be real numbers"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, triangles, error, message):
    with pytest.raises(error, match=message):
        TriangleMesh(vertices, triangles)


def test_a_cube_has_its_area_volume_box_and_normals():
    cube = TriangleMesh(CORNERS + [1e3, 0, 0], CUBE)
    assert (float(cube.area), float(cube.volume), cube.count, cube.dim) == (6.0, 1.0, 12, 3)
    np.testing.assert_array_equal(cube.bounds, [[1e3, 0, 0], [1e3 + 1, 1, 1]])
    outward = cube.corners.mean(axis=1) - jnp.array([1e3 + 0.5, 0.5, 0.5])
    assert float(jnp.min(jnp.sum(cube.normals * outward, axis=1))) >= 0.5
    assert cube.is_closed and cube.is_manifold


def test_measures_of_tiny_and_huge_meshes_keep_their_digits():
    # The last two areas are outside the range of floats, and the normals are not.
    for scale in (1e-120, 1e120, 1e-200, 1e200):
        mesh = TriangleMesh(np.array(CORNER) * scale, TETRAHEDRON)
        with np.errstate(over="ignore"):
            exact = (1.5 + np.sqrt(3) / 2) * np.square(scale)
        assert float(mesh.area) == pytest.approx(exact, rel=1e-14, abs=0)
        np.testing.assert_allclose(mesh.normals[2], np.full(3, 1 / np.sqrt(3)), rtol=1e-14)


def test_degenerate_triangles_have_no_normal_no_edges_and_finite_derivatives():
    triangles = [[0, 1, 2], [3, 3, 3], [0, 0, 1]]

    def measured(vertices):
        mesh = TriangleMesh(vertices, triangles)
        return mesh.area + jnp.sum(mesh.normals)

    mesh = TriangleMesh(CORNER, triangles)
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1], [0, 0, 0], [0, 0, 0]])
    assert float(mesh.area) == 0.5
    assert edges_of(mesh).edge[1:].tolist() == [[-1] * 3] * 2
    # Normals turn: -1 for each of the corners lifted on the far sides; the area grows by half where a leg does.
    np.testing.assert_allclose(
        jax.jit(jax.grad(measured))(mesh.vertices), [[-0.5, -0.5, 2], [0.5, 0, -1], [0, 0.5, -1], [0, 0, 0]], atol=1e-14
    )


def test_vertices_that_no_triangle_names_are_no_part_of_the_box():
    mesh = TriangleMesh([*CORNER, [9, 9, 9]], [[0, 1, 2]])
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 0]])
    assert mesh.vertices.shape == (5, 3)


@pytest.mark.parametrize(
    ("triangles", "closed", "manifold"),
    [
        (TETRAHEDRON, True, True),
        (TETRAHEDRON[:3], False, True),
        ([[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]], True, False),
        ([*TETRAHEDRON, *TETRAHEDRON], True, False),
        ([[0, 1, 2], [0, 2, 1]], True, True),
        ([[0, 1, 2], [0, 1, 3]], False, False),
        ([*TETRAHEDRON, [0, 0, 1]], True, True),
    ],
    ids="tetrahedron open turned twice sheet opposed degenerate".split(),
)
def test_borders_and_orientation_are_seen(triangles, closed, manifold):
    mesh = TriangleMesh(CORNER, triangles)
    assert (mesh.is_closed, mesh.is_manifold) == (closed, manifold)


def test_vertices_at_one_place_count_as_one():
    separate = np.asarray(TriangleMesh(CORNERS, CUBE).corners).reshape(-1, 3)
    separate = np.where(separate == 0, -0.0, separate)
    separate[::2] += 0.0
    mesh = TriangleMesh(separate, np.arange(36).reshape(-1, 3))
    assert mesh.is_closed and mesh.is_manifold
    assert len(np.unique(places_of(separate))) == 8


def test_edges_of_a_traced_mesh_are_refused():
    with pytest.raises(TypeError, match="cannot be traced"):
        jax.jit(lambda v: v * TriangleMesh(v, TETRAHEDRON).is_closed)(jnp.array(CORNER))


@pytest.mark.parametrize(
    "matrix", [np.diag([2.0, 3.0, 0.5]), np.diag([-1.0, 1.0, 1.0]), [[0, 1, 0], [1, 0, 0], [0, 0, 1]]]
)
def test_an_affine_map_moves_the_vertices_and_keeps_outside_outside(matrix):
    mesh = TriangleMesh(CORNERS, CUBE)
    image = mesh.transform(matrix, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(image.vertices, CORNERS @ np.asarray(matrix).T + [1, 2, 3])
    assert float(image.volume) == pytest.approx(abs(np.linalg.det(matrix)))


def test_a_map_is_differentiable_and_wrong_ones_are_refused():
    mesh = TriangleMesh(CORNERS, CUBE)
    gradient = jax.jit(jax.grad(lambda s: mesh.transform(s * jnp.eye(3)).volume))(2.0)
    assert float(gradient) == pytest.approx(12.0)
    with pytest.raises(ValueError, match=r"matrix has shape \(2, 3\); needs \(3, 3\)"):
        mesh.transform(np.ones((2, 3)))
    with pytest.raises(ValueError, match="offset has shape"):
        mesh.transform(np.eye(3), [1.0, 2.0])


def test_meshes_pass_through_vmap():
    scales = jnp.array([1.0, 2.0])
    meshes = jax.jit(jax.vmap(lambda s: TriangleMesh(CORNERS, CUBE).transform(s * jnp.eye(3))))(scales)
    assert meshes.count == 12
    np.testing.assert_allclose(jax.jit(jax.vmap(lambda m: m.volume))(meshes), [1, 8])


def test_points_are_named_by_barycentric_coordinates():
    mesh = TriangleMesh(CORNER, TETRAHEDRON)
    np.testing.assert_allclose(mesh.point(2, [0.5, 0.25, 0.25]), [0.5, 0.25, 0.25])
    np.testing.assert_array_equal(mesh.point([0, 1], np.eye(3)[:2]), [[0, 0, 0], [1, 0, 0]])


def test_meshes_of_other_libraries_are_taken():
    trimesh: Any = SimpleNamespace(vertices=CORNERS, faces=CUBE)
    open3d: Any = SimpleNamespace(vertices=CORNERS.tolist(), triangles=CUBE.tolist())
    mesh = TriangleMesh.from_object(trimesh)
    np.testing.assert_array_equal(mesh.triangles, TriangleMesh.from_object(open3d).triangles)
    assert TriangleMesh.from_object(mesh) is mesh
    with pytest.raises(TypeError, match="mesh must be a TriangleMesh, or an object with vertices and faces"):
        TriangleMesh.from_object(CORNERS)  # pyright: ignore[reportArgumentType]


def test_other_shapes_are_no_meshes():
    check_mesh("b", TriangleMesh(CORNER, TETRAHEDRON))
    with pytest.raises(TypeError, match="b must be a TriangleMesh .* got BezierSegments"):
        check_mesh("b", point_set([[0, 1]]))
