"""Meshes of implicit surfaces: closed forms on both sides of the deviation, borders in the box, and refusals."""

import numpy as np
import pytest

import jhd
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.implicit_mesh import NotRegularError, march, nodes_of
from jhd._shapes.mesh import edges_of
from tests.reference import distances_to_triangles
from tests.sweeps import swept

# Of coordinates of order one.
ROUNDING = 1e-13


def characteristic(mesh):
    return mesh.vertices.shape[0] - len(edges_of(mesh).count) + mesh.count


def barycentric_samples(mesh):
    """Points of all triangles: corners, middles of edges, centroids and others."""
    grid = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6
    return np.einsum("kc,tcd->tkd", grid, np.asarray(mesh.corners)).reshape(-1, 3)


@pytest.mark.parametrize(("power", "tolerance"), swept([(-500, 0.05), (0, 0.01), (500, 0.05), (0, 0.05)], 1, 1))
def test_a_sphere_gives_a_closed_mesh_within_the_deviation_at_every_scale(power, tolerance):
    # So divided that all coefficients are floats: x^2 / r + y^2 / r + z^2 / r - r.
    coefficients = np.zeros((3, 3, 3))
    coefficients[2, 0, 0] = coefficients[0, 2, 0] = coefficients[0, 0, 2] = np.ldexp(1.0, -power)
    coefficients[0, 0, 0] = -np.ldexp(1.0, power)
    box = np.ldexp([[-2.0, -2.0, -1.5], [2.0, 1.5, 2.0]], power)
    mesh, deviation = ImplicitSurface(coefficients, *box).to_mesh(np.ldexp(tolerance, power))
    assert mesh.is_closed and mesh.is_manifold and characteristic(mesh) == 2
    # A closed surface around the center: the farthest of its points is as far from the sphere as the sphere from it.
    off = np.abs(np.linalg.norm(np.ldexp(barycentric_samples(mesh), -power), axis=1) - 1).max()
    assert 0.1 * tolerance <= off <= np.ldexp(deviation, -power) <= tolerance
    assert mesh.count <= 250 / tolerance


def test_a_plane_is_met_exactly_where_coordinates_are_subnormal():
    lower, upper = np.ldexp([-1.0, -1, -1], -1060), np.ldexp([1.0, 1, 1], -1060)
    mesh, deviation = ImplicitSurface([[[0.0, 0.0], [3.0, 0.0]], [[1.0, 0.0], [0.0, 0.0]]], lower, upper).to_mesh(
        1e-321
    )
    x, y = np.asarray(mesh.vertices)[:, :2].T
    assert characteristic(mesh) == 1 and np.all(np.abs(x + 3 * y) <= 3.2 * deviation) and deviation <= 1e-321


@pytest.mark.slow
def test_a_torus_of_degree_four_is_within_the_deviation_of_every_point_of_the_mesh_and_the_other_way_round():
    torus = ImplicitSurface.parse("(x^2 + y^2 + z^2 + 3)^2 - 16*(x^2 + y^2)", [-4, -4, -2], [4, 4, 2])
    mesh, deviation = torus.to_mesh(0.05)
    assert mesh.is_closed and characteristic(mesh) == 0 and deviation <= 0.05
    x, y, z = barycentric_samples(mesh).T
    off = np.abs(np.hypot(np.hypot(x, y) - 2, z) - 1).max()
    assert 0.005 <= off <= deviation
    t, s = np.random.default_rng(0).uniform(0, 2 * np.pi, size=(2, 100))
    points = np.stack([(2 + np.cos(s)) * np.cos(t), (2 + np.cos(s)) * np.sin(t), np.sin(s)], axis=1)
    corners = np.asarray(mesh.corners)
    assert max(distances_to_triangles(point, corners).min() for point in points) <= deviation


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    swept(
        [
            ("x*y - z", [-1, -1, -1], [1, 1, 1]),  # through four corners of the box
            ("x^2 + y^2 + z^2 - 1", [0, 0, 0], [2, 2, 2]),  # an octant, with its border in three faces
            ("x - y", [-1, -1, -1], [1, 1, 1]),  # through two edges of the box
            ("x^3 + y - z/2 - 1/8", [-1, -0.5, 0.25], [1, 1, 2]),
        ],
        2,
        2,
    ),
)
def test_the_border_in_the_faces_of_the_box_is_met(text, lower, upper):
    surface = ImplicitSurface.parse(text, lower, upper)
    mesh, deviation = surface.to_mesh(0.01)
    edges = edges_of(mesh)
    assert characteristic(mesh) == 1 and mesh.is_manifold
    # Edges of one triangle alone lie in a face of the box.
    alone = (edges.count == 1)[edges.edge]
    ends = np.asarray(mesh.corners)[:, [[0, 1], [1, 2], [2, 0]]][alone]
    in_face = (ends == np.array(lower)) | (ends == np.array(upper))
    assert len(ends) and np.all(np.any(np.all(in_face, axis=1), axis=1))
    # Points of the surface on lines along each axis, those in the faces included.
    random, found = np.random.default_rng(3), []
    for axis in range(3):
        start = random.uniform(lower, upper, size=(8, 3))
        start[::2, (axis + 1) % 3] = np.array(upper)[(axis + 1) % 3]
        places = np.repeat(start[:, None], 2001, axis=1)
        places[..., axis] = np.linspace(lower[axis], upper[axis], 2001)
        x, y, z = np.moveaxis(places, -1, 0)
        values = np.polynomial.polynomial.polyval3d(x, y, z, np.asarray(surface.coefficients))
        row, k = np.nonzero((values[:, 1:] < 0) != (values[:, :-1] < 0))
        found.append(places[row, k])
    # The step of the samples is what they are off by.
    corners = np.asarray(mesh.corners)
    apart = [distances_to_triangles(point, corners).min() for point in np.concatenate(found)]
    assert np.max(apart) <= deviation + 2 / 2000


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ("x^2 + y^2 - z^2", [0, 0, 0]),
        ("x*y", [0, 0, None]),
        ("x^2 + y^2 + z^2 - 1", None),  # touches all six faces
        ("z - 1", [None, None, 1]),
    ],
)
def test_a_surface_that_is_not_regular_is_refused_with_the_place(text, near):
    with pytest.raises(NotRegularError, match="could not be proven regular near") as caught:
        ImplicitSurface.parse(text, [-1, -1, -1], [1, 1, 1]).to_mesh(0.1)
    place = caught.value.point
    if near is None:
        assert abs(np.linalg.norm(place) - 1) < 0.01 and np.sort(np.abs(place))[1] < 0.01
    else:
        assert all(y is None or abs(x - y) < 0.01 for x, y in zip(place, near, strict=True))


def test_what_cannot_be_is_refused():
    sphere = ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [-2, -2, -2], [2, 2, 2])
    for tolerance in (0.0, -1.0):
        with pytest.raises(ValueError, match="needs one positive number"):
            sphere.to_mesh(tolerance)
    with pytest.raises(ValueError, match="max_triangles"):
        sphere.to_mesh(0.01, max_triangles=1000)
    with pytest.raises(ValueError, match="rounding"):
        sphere.to_mesh(1e-17)
    for text in ("x^2 + y^2 + z^2 + 1", "x + y + z - 10"):
        with pytest.raises(ValueError, match="the surface is empty"):
            ImplicitSurface.parse(text, [-1, -1, -1], [1, 1, 1]).to_mesh(0.1)


def test_a_piecewise_linear_function_is_zero_on_its_triangles_and_they_face_its_positive_side():
    cells = np.array(list(np.ndindex(3, 2, 2)))
    nodes, corners = nodes_of(cells)
    values = nodes @ [1.0, -2.0, 0.5] + 0.3
    found = march(nodes, corners, values)
    places = found.low + found.share[:, None] * (found.high - found.low)
    assert np.abs(places @ [1.0, -2.0, 0.5] + 0.3).max() < ROUNDING
    a, b, c = np.moveaxis(places[found.triangles], 1, 0)
    areas = np.cross(b - a, c - a) @ np.array([2, -4, 1]) / np.sqrt(21)
    # None of them faces another way, so the areas along the normal are the areas.
    np.testing.assert_allclose(areas, np.linalg.norm(np.cross(b - a, c - a), axis=1), atol=ROUNDING)
    assert areas.sum() > 1


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", [5, 0])
def test_random_surfaces_and_their_meshes_are_within_the_deviation(seed):
    random = np.random.default_rng(seed)
    degree = 2 + seed % 3
    coefficients = random.normal(size=(degree + 1,) * 3)
    coefficients[np.indices(coefficients.shape).sum(axis=0) > degree] = 0
    surface = ImplicitSurface(coefficients, [-1.0, -0.7, -0.5], [0.8, 1.0, 1.2])
    mesh, deviation = surface.to_mesh(0.02)
    samples = barycentric_samples(mesh)
    there = jhd.project(samples[random.integers(len(samples), size=24)], surface, throw=False)
    assert np.asarray(there.lower).max() <= deviation
    corners = np.asarray(mesh.corners)
    back = [distances_to_triangles(foot, corners).min() for foot in np.asarray(there.foot)]
    assert np.max(back) <= deviation + ROUNDING
