"""Objects of other packages become shapes with the same points, in every entry, or are refused by name."""

from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib.path
import numpy as np
import pytest
import shapely
import trimesh
from matplotlib.figure import Figure
from scipy.interpolate import BSpline, NdBSpline

import jhd
from jhd import plot
from jhd._shapes import biarcs, least_tolerance

# Its shapes are of the kind that is expected here.
as_shape: Any = jhd.as_shape
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3]])
ROWS = np.array([[0.0, 0], [1, 2], [2, -1], [3, 0]])
NET = np.random.default_rng(5).normal(size=(3, 4, 3))
WEIGHTS = np.linspace(0.5, 2, 12).reshape(3, 4)
KNOTS_U, KNOTS_V = [0.0, 0, 0.5, 1, 1], [0.0, 0, 0, 0.25, 1, 1, 1]

# Attributes as Open3D (legacy, tensors), PyVista and trimesh have them; Open3D and PyVista are not installed here.
MESHES = {
    "arrays": (CORNERS, FACES),
    "lists": [CORNERS.tolist(), FACES.tolist()],
    "trimesh": trimesh.Trimesh(CORNERS, FACES, process=False),
    "open3d": SimpleNamespace(vertices=CORNERS, triangles=FACES),
    "open3d tensors": SimpleNamespace(
        vertex=SimpleNamespace(positions=CORNERS), triangle=SimpleNamespace(indices=FACES)
    ),
    "pyvista": SimpleNamespace(
        points=CORNERS, faces=np.array([3, 0, 2, 1, 3, 0, 1, 3]), lines=np.array([], int), n_strips=0
    ),
}
CLOUDS = {
    "array": CORNERS,
    "lists": CORNERS.tolist(),
    "jax": jnp.asarray(CORNERS),
    "trimesh": trimesh.PointCloud(CORNERS),
    "open3d": SimpleNamespace(points=CORNERS),
    "open3d tensors": SimpleNamespace(point=SimpleNamespace(positions=CORNERS)),
    "pyvista": SimpleNamespace(points=CORNERS, faces=np.array([], int), lines=np.array([], int)),
}
LINES = {
    "open3d": SimpleNamespace(points=CORNERS, lines=np.array([[0, 1], [1, 2], [3, 0]])),
    "pyvista": SimpleNamespace(points=CORNERS, faces=np.array([], int), lines=np.array([3, 0, 1, 2, 2, 3, 0])),
}


@pytest.mark.parametrize("name", MESHES)
def test_vertices_and_faces_of_any_package_are_a_mesh(name):
    mesh = as_shape(MESHES[name])
    assert isinstance(mesh, jhd.TriangleMesh)
    np.testing.assert_array_equal(mesh.corners, CORNERS[FACES])


@pytest.mark.parametrize("name", CLOUDS)
def test_points_without_faces_are_a_set_of_points(name):
    cloud = as_shape(CLOUDS[name])
    assert isinstance(cloud, jhd.BezierSegments) and cloud.degree == 0
    np.testing.assert_array_equal(cloud.control_points[:, 0], CORNERS)


@pytest.mark.parametrize("name", LINES)
def test_points_joined_by_lines_are_segments(name):
    lines = as_shape(LINES[name])
    assert isinstance(lines, jhd.BezierSegments)
    np.testing.assert_array_equal(lines.control_points, CORNERS[[[0, 1], [1, 2], [3, 0]]])


def geomdl_surface(**more):
    """The attributes of geomdl's NURBS.Surface: points in one list, those of one row in u after the other."""
    return SimpleNamespace(
        degree_u=1,
        degree_v=3,
        ctrlpts_size_u=3,
        ctrlpts_size_v=4,
        ctrlpts=NET.reshape(-1, 3).tolist(),
        weights=WEIGHTS.ravel().tolist(),
        knotvector_u=[0, 0, 0.5, 1, 1],
        knotvector_v=[0, 0, 0, 0, 1, 1, 1, 1],
        vertices=[],
        faces=[],
        **more,
    )


def splinepy_spline(knots, points, weights, sizes):
    """The attributes of splinepy's splines: points in one array, the first parameter runs first."""
    return SimpleNamespace(
        degrees=np.array([0] * len(sizes)),
        knot_vectors=knots,
        control_points=points,
        weights=None if weights is None else weights.reshape(-1, 1),
        control_mesh_resolutions=np.array(sizes),
    )


def test_splines_of_other_packages_have_the_same_points():
    t = np.linspace(0, 1, 7)
    knots = np.array([0.0, 0, 0, 0.4, 1, 1, 1])
    scipy_curve = BSpline(knots, ROWS, 2)
    np.testing.assert_allclose(as_shape(scipy_curve)(t), scipy_curve(t), atol=1e-15)
    np.testing.assert_allclose(as_shape(NdBSpline((knots,), ROWS, 2))(t), scipy_curve(t), atol=1e-15)
    scipy_surface = NdBSpline((np.array(KNOTS_U), np.array(KNOTS_V)), NET, (1, 2))
    places = np.stack([t, t[::-1]], axis=1)
    np.testing.assert_allclose(as_shape(scipy_surface)(t, t[::-1]), scipy_surface(places), atol=1e-14)
    curve = SimpleNamespace(degree=2, ctrlpts=ROWS.tolist(), knotvector=list(knots), weights=None)
    np.testing.assert_allclose(as_shape(curve)(t), scipy_curve(t), atol=1e-15)
    surface = as_shape(geomdl_surface())
    np.testing.assert_array_equal(surface.control_points, NET)
    np.testing.assert_array_equal(surface.weights, WEIGHTS)
    rows, weights = NET.swapaxes(0, 1).reshape(-1, 3), WEIGHTS.T.ravel()
    other = as_shape(splinepy_spline([KNOTS_U, KNOTS_V], rows, weights, (3, 4)))
    np.testing.assert_array_equal(other.control_points, NET)
    np.testing.assert_array_equal(other.weights, WEIGHTS)
    assert as_shape(splinepy_spline(None, rows, None, (3, 4))).degrees == (2, 3)
    assert isinstance(as_shape(splinepy_spline(None, ROWS, None, (4,))), jhd.BezierCurve)


def test_outlines_of_other_packages_are_their_lines():
    square = shapely.box(0, 0, 1, 2)
    assert as_shape(square).count == 4
    path = matplotlib.path.Path([[0, 0], [1, 0], [1, 1]])
    assert as_shape(path).count == 2


def test_entries_take_what_becomes_a_shape(as_a_user):
    apart = CORNERS + [0, 0, 3.0]
    assert float(jhd.hausdorff(CORNERS, apart)) == 3.0 == float(jhd.directed_hausdorff(CORNERS.tolist(), apart))
    assert float(jhd.minimum_distance(MESHES["trimesh"], apart)) == 2.0
    assert jhd.hausdorff_at_most(CORNERS, apart, 4.0)
    found = jhd.project([0.25, 0.25, -2.0], MESHES["arrays"])
    assert found.lower <= 2.0 <= found.upper <= 2.0 + 1e-12
    assert abs(float(jhd.signed_distance([0.25, 0.25, -2.0], MESHES["pyvista"])) - 2.0) <= 1e-12


def test_pictures_and_arcs_take_what_becomes_a_shape():
    path = matplotlib.path.Path(ROWS)
    arcs = biarcs(path, 1e-3)
    assert arcs.count == 3 and least_tolerance(path) == 0.0
    assert plot.curve(path, Figure().add_subplot()).lines[0].get_gid() == "curve"
    space = Figure().add_subplot(projection="3d")
    assert plot.mesh(MESHES["pyvista"], space) is space
    with pytest.raises(TypeError, match=r"shape: text is not a shape: jhd\.io\.load_shape reads files"):
        plot.curve("bunny.ply", Figure().add_subplot())  # pyright: ignore[reportArgumentType]


def test_traced_arrays_are_points_and_vertices_with_derivatives():
    slope = jax.jit(jax.grad(lambda x: as_shape(x).bounds[1].sum()))(jnp.asarray(CORNERS[:1]))
    np.testing.assert_array_equal(slope, np.ones((1, 3)))
    assert jax.jit(jax.grad(lambda x: as_shape((x, FACES)).area))(jnp.asarray(CORNERS))[1, 0] > 0


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (3, TypeError, "shape must be a shape of jhd, an array of points, .*; got int"),
        ("bunny.ply", TypeError, r"text is not a shape: jhd\.io\.load_shape reads files, .*; got str\."),
        (np.zeros((2, 4)), ValueError, r"points has shape \(2, 4\)"),
        (np.zeros((0, 3)), ValueError, "at least 1"),
        ((CORNERS, FACES[:, [0, 1, 2, 2]]), ValueError, r"triangles has shape \(2, 4\)"),
        ((CORNERS, FACES + 0.5), TypeError, "triangles must be integers"),
        (SimpleNamespace(points=CORNERS, faces=np.array([4, 0, 1, 2, 3])), ValueError, "faces.0. has 4 corners"),
        # A list whose rows end by -1 would be read for ever.
        (SimpleNamespace(points=CORNERS, faces=np.array([2, 0, 1, -1])), ValueError, "entry 3 of a flat list"),
        (SimpleNamespace(points=CORNERS, faces=np.array([4, 0, 1])), ValueError, "of which there are 2"),
        (SimpleNamespace(points=CORNERS, faces=FACES, lines=FACES[:, :2]), ValueError, "faces and lines"),
        (geomdl_surface(trims=[1]), ValueError, "the surface is trimmed"),
        (NdBSpline(([0.0, 0, 1, 1],) * 3, np.zeros((2, 2, 2, 3)), 1), ValueError, "the spline has 3 parameters"),
        (trimesh.load_path(ROWS), TypeError, "got Path2D"),
        (SimpleNamespace(points=CORNERS, cells=[FACES]), TypeError, "got SimpleNamespace"),
    ],
    ids="number text wide empty quads shares pyvista_quads ended short both trimmed volume path grid".split(),
)
def test_what_is_no_shape_is_refused(as_a_user, value, error, message):
    with pytest.raises(error, match=message):
        as_shape(value)


def test_entries_say_which_of_the_shapes_is_none(as_a_user):
    with pytest.raises(ValueError, match=r"b: points has shape \(2, 4\)"):
        jhd.hausdorff(CORNERS, np.zeros((2, 4)))
