"""Parametric surfaces: what they refuse, that every form is the same surface, and meshes with a proven deviation."""

from fractions import Fraction
from math import comb

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.mesh import edges_of
from jhd._shapes.patch import BezierPatch, BezierPatches
from tests.reference import distances_to_triangles
from tests.sweeps import swept

RANDOM = np.random.default_rng(0)
POINTS = RANDOM.normal(size=(4, 3, 3))
WEIGHTS = RANDOM.uniform(0.5, 2.0, size=(4, 3))
# Of coordinates of order one.
ROUNDING = 1e-13


def value(points, weights, u, v):
    """The defining formula, in power form."""
    n, m = points.shape[0] - 1, points.shape[1] - 1
    b = np.array([comb(n, i) * u**i * (1 - u) ** (n - i) for i in range(n + 1)])
    c = np.array([comb(m, j) * v**j * (1 - v) ** (m - j) for j in range(m + 1)])
    w = b[:, None] * c * (1.0 if weights is None else weights)
    return np.einsum("ij,ijd->d", w, points) / w.sum()


@pytest.mark.parametrize(
    ("points", "weights", "error", "message"),
    [
        (POINTS[0], None, ValueError, r"control_points has shape \(3, 3\); needs \(rows, columns, 3\)"),
        (np.zeros((0, 2, 3)), None, ValueError, "control_points is empty"),
        (POINTS[..., :2], None, ValueError, r"control_points has 2 coordinates a point; needs 3\."),
        (np.zeros((3, 4, 5)), None, ValueError, r"control_points has 5 coordinates a point; needs 3\."),
        (POINTS, WEIGHTS[:2], ValueError, "weights has 2 x 3"),
        (POINTS, -WEIGHTS, ValueError, r"weights\[0, 0\] is not positive"),
        (POINTS * [np.nan, 1, 1], None, ValueError, r"control_points\[0, 0\] is not finite"),
        (POINTS * 1j, None, TypeError, "must be real numbers"),
        ([[["a", "b", "c"]]], None, TypeError, "must be real numbers"),
    ],
)
def test_what_is_no_patch_is_refused(as_a_user, points, weights, error, message):
    with pytest.raises(error, match=message):
        BezierPatch(points, weights)


def test_degrees_of_a_surface_that_are_not_two_are_named(as_a_user):
    with pytest.raises(TypeError, match="degrees must be two integers; got 3"):
        BSplineSurface.clamped(np.zeros((5, 5, 3)), 3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match=r"takes no degree: .* BSplineSurface\.clamped"):
        BSplineSurface(np.zeros((5, 5, 3)), degree=3)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize(
    ("knots_u", "knots_v", "message"),
    [
        ([0, 0, 1], [0, 0, 1, 1], "knots_u has 3 entries; 4 rows need at least 5"),
        (np.arange(10.0), [0, 0, 1, 1], "control_points has 4 rows; degree 5"),
        ([0, 0, 1, 0.5, 2, 2], np.arange(6.0), r"knots_u\[3\] is 0.5; needs at least knots_u\[2\]"),
        (np.arange(8.0), np.zeros(6), "the domain has length zero"),
        (np.zeros((2, 3)), np.arange(6.0), r"knots_u has shape \(2, 3\)"),
    ],
)
def test_what_are_no_knots_is_refused(as_a_user, knots_u, knots_v, message):
    with pytest.raises(ValueError, match=message):
        BSplineSurface(POINTS, knots_u, knots_v)


@pytest.mark.parametrize("weights", swept([WEIGHTS, None], 0, 1))
def test_a_patch_is_its_formula_and_its_parts_are_parts_of_it(weights):
    patch = BezierPatch(POINTS, weights)
    u, v = 0.3, 0.8
    exact = value(POINTS, weights, u, v)
    same = [
        patch(u, v),
        patch.elevate(5, 4)(u, v),
        patch.patches().point(0, u, v),
        patch.split(0.6)[0](u / 0.6, v),
        patch.split(0.5, axis=1)[1](u, (v - 0.5) / 0.5),
        patch.restrict(0.1, 0.5, 0.6, 1.0)((u - 0.1) / 0.4, (v - 0.6) / 0.4),
        patch.transform(2 * np.eye(3), [1.0, 0, 0])(u, v) / 2 - np.array([0.5, 0, 0]),
    ]
    for point in same:
        np.testing.assert_allclose(point, exact, atol=ROUNDING)
    with pytest.raises(ValueError, match="axis is 2"):
        patch.split(0.5, axis=2)


def test_a_spline_surface_and_its_patches_are_one_surface_without_gaps():
    surface = BSplineSurface.clamped(RANDOM.normal(size=(5, 4, 3)), (3, 2), RANDOM.uniform(0.5, 2.0, (5, 4)))
    patches = surface.patches()
    assert patches.count == 4 and patches.degrees == (3, 2)
    u, v = RANDOM.uniform(0, 2, 20), RANDOM.uniform(0, 2, 20)
    index = np.floor(u).astype(int) * 2 + np.floor(v).astype(int)
    np.testing.assert_allclose(patches.point(jnp.asarray(index), u % 1, v % 1), surface(u, v), atol=ROUNDING)
    net = np.asarray(patches.control_points).reshape(2, 2, 4, 3, 3)
    assert np.array_equal(net[0, :, -1], net[1, :, 0]) and np.array_equal(net[:, 0, :, -1], net[:, 1, :, 0])


def test_partial_derivatives_are_those_of_differences():
    patch, h = BezierPatch(POINTS, WEIGHTS), 1e-5
    here, up, right = patch.partials(0.4, 0.6), patch.partials(0.4 + h, 0.6), patch.partials(0.4, 0.6 + h)
    for found, first, second in (
        (here.u, up.point, here.point),
        (here.v, right.point, here.point),
        (here.uu, up.u, here.u),
        (here.uv, right.u, here.u),
        (here.vv, right.v, here.v),
    ):
        np.testing.assert_allclose(found, (first - second) / h, atol=1e-3)


def test_the_image_is_differentiable_in_the_map():
    slope = jax.grad(lambda m: BezierPatch(POINTS).transform(m)(0.0, 0.0)[1])(jnp.eye(3))
    np.testing.assert_allclose(slope[1], POINTS[0, 0], atol=ROUNDING)
    assert np.all(np.asarray(slope)[[0, 2]] == 0)


def to_triangles(points, corners):
    """Distances from points to the nearest triangle, by brute force in barycentric coordinates."""
    grid = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12
    samples = np.einsum("kc,tcd->tkd", grid, corners).reshape(-1, 3)
    return np.sqrt(((points[:, None] - samples[None]) ** 2).sum(-1)).min(1)


@pytest.mark.parametrize(("weights", "offset"), swept([(WEIGHTS, 1e6), (None, 0.0), (WEIGHTS, 0.0), (None, 1e6)], 0, 2))
def test_no_point_at_equal_parameters_is_farther_from_the_mesh_than_its_deviation(weights, offset):
    patch = BezierPatch(POINTS + offset, weights)
    mesh, deviation = patch.to_mesh(0.1)
    assert 0 < deviation <= 0.1
    u, v = (x.ravel() for x in np.meshgrid(*[np.linspace(0, 1, 41)] * 2))
    on_surface, corners = np.asarray(patch(u, v)) - offset, np.asarray(mesh.corners) - offset
    # The mesh is sampled too, so its samples may miss the nearest point by the size of their grid.
    size = np.sqrt(((corners[:, :2] - corners[:, 1:]) ** 2).sum(-1)).max() / 12
    found = to_triangles(on_surface, corners).max()
    assert found <= deviation + size
    # A tenth of the bound at least is there: the bound is not loose.
    assert found >= 0.1 * deviation


def test_a_bilinear_patch_has_the_twist_as_its_deviation_and_a_flat_one_none():
    saddle = BezierPatch([[[0, 0, 0], [0, 1, 1]], [[1, 0, 1], [1, 1, 0]]])
    mesh, deviation = saddle.to_mesh(0.6)
    # v00 - v10 - v01 + v11 has length two, a quarter of it is reached at the middle.
    assert mesh.count == 2 and 0.5 <= deviation <= 0.5 + ROUNDING
    flat = BezierPatch([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]])
    assert flat.to_mesh(1e-9).deviation < ROUNDING


def test_neighboring_patches_share_the_vertices_of_their_edges():
    surface = BSplineSurface.clamped(RANDOM.normal(size=(5, 5, 3)), (2, 2))
    mesh = surface.to_mesh(0.2).shape
    edges = edges_of(mesh).count
    # Euler: vertices - edges + triangles is one for a disc, and more where patches were apart.
    assert mesh.is_manifold and mesh.vertices.shape[0] - len(edges) + mesh.count == 1


def sphere():
    """The unit sphere with poles and a seam: half a circle turned around the z axis, knots repeated."""
    turn = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], float)
    half, corner = np.array([[0, -1], [1, -1], [1, 0], [1, 1], [0, 1]], float), np.sqrt(0.5)
    points = np.concatenate([turn[:, None] * half[None, :, :1], np.broadcast_to(half[:, 1:], (9, 5, 1))], axis=-1)
    weights = np.array([1, corner] * 4 + [1])[:, None] * np.array([1, corner, 1, corner, 1])
    return BSplineSurface(points, [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], [0, 0, 0, 1, 1, 2, 2, 2], weights)


@pytest.mark.parametrize("atol", [0.01, 0.001])
def test_a_sphere_with_poles_and_a_seam_gives_a_closed_mesh_within_the_deviation(atol):
    mesh, deviation = sphere().to_mesh(atol)
    edges = edges_of(mesh)
    assert mesh.is_closed and mesh.is_manifold
    assert mesh.vertices.shape[0] - len(edges.count) + int(edges.proper.sum()) == 2
    centers = np.linalg.norm(np.asarray(mesh.corners).mean(1), axis=1)
    assert np.allclose(np.linalg.norm(np.asarray(mesh.vertices), axis=1), 1, atol=ROUNDING)
    assert 0.3 * atol < (1 - centers).max() <= deviation <= atol
    assert mesh.count <= 40 / atol


@pytest.mark.parametrize("turned", [False, True])
def test_neighbors_of_different_curvature_share_their_edge_in_either_direction(turned):
    flat = np.stack(np.meshgrid([1.0, 2.0, 3.0], [0.0, 1.0, 2.0], [0.0], indexing="ij"), axis=-1)[:, :, 0]
    bent = flat - [2.0, 0, 0] + [[[0, 0, 3.0]], [[0, 0, -4.0]], [[0, 0, 0]]]
    flat[:, 1, 2] += 1.0
    bent[-1] = flat[0]
    # The second one with both parameters exchanged and reversed: its last column is the shared edge.
    other = flat[::-1, ::-1].swapaxes(0, 1) if turned else flat
    mesh = BezierPatches(np.stack([bent, other])).to_mesh(1e-3).shape
    edges = edges_of(mesh)
    assert np.all(edges.count <= 2) and edges.proper.all()
    assert mesh.vertices.shape[0] - len(edges.count) + mesh.count == 1
    # The straight border of the bent one is one edge; where it bends most there are many.
    on_edge = np.asarray(mesh.vertices)[:, 0]
    assert np.sum(on_edge < 0.5) > 3 * np.sum(on_edge > 2.5)


def test_vertices_that_are_rounded_more_than_cells_bend_are_counted():
    # So far away the last digit of a coordinate is 2e-6, which no number of cells makes smaller.
    deviation = BezierPatch(POINTS + 1e10).to_mesh(3e-3).deviation
    assert 2e-3 < deviation <= 3e-3


@pytest.mark.parametrize("heights", [(0, 50, 100), (0, 1, 100)], ids=["even", "uneven"])
def test_a_cylinder_is_cut_along_its_axis_alone(heights):
    arc = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    net = arc[:, None] + np.array(heights)[None, :, None] * [0, 0, 1.0]
    mesh, deviation = BezierPatch(net, np.array([[1.0], [np.sqrt(0.5)], [1.0]]) * np.ones(3)).to_mesh(1e-4)
    height, vertices = np.round(np.asarray(mesh.vertices)[:, 2], 9), np.asarray(mesh.vertices)
    assert set(height) == {0.0, 100.0} and mesh.count == len(vertices) - 2
    chords = np.linalg.norm(np.diff(vertices[height == 0, :2], axis=0), axis=1)
    assert (1 - np.sqrt(1 - chords**2 / 4)).max() <= deviation <= 1e-4


def uneven(random, bend):
    """Control points of a convex quadrilateral with uneven parameters, bent by so much in each coordinate."""
    u, v = (np.sort(np.append(random.uniform(size=2) ** 4, [0, 1])) for _ in range(2))
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) + random.uniform(-0.3, 0.3, size=(4, 2))
    across = np.stack([1 - u, u])[:, None, :, None] * np.stack([1 - v, v])[None, :, None, :]
    flat = np.einsum("ijkl,ijd->kld", across, corners.reshape(2, 2, 2))
    points = np.concatenate([flat, np.zeros((4, 4, 1))], axis=-1) + np.multiply(
        bend, random.uniform(-1, 1, size=(4, 4, 3))
    )
    return points @ np.linalg.qr(random.normal(size=(3, 3)))[0]


def test_a_flat_patch_is_two_triangles_however_uneven_its_parameters_are():
    patch = BezierPatch(uneven(np.random.default_rng(0), 0.0))
    mesh, deviation = patch.to_mesh(1e-9)
    assert mesh.count == 2 and deviation < 100 * ROUNDING


def test_nearly_flat_patches_and_their_meshes_are_within_the_deviation_of_each_other():
    random, line = np.random.default_rng(1), np.linspace(0, 1, 41)
    along = np.stack([(1 - line) ** 3, 3 * line * (1 - line) ** 2, 3 * line**2 * (1 - line), line**3], axis=1)
    grid = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8
    tight = 0
    for bend in np.repeat(np.array([(0.01, 0.01, 0.01), (0, 0, 0.1)]), 6, axis=0):
        points = uneven(random, bend)
        mesh, deviation = BezierPatch(points).to_mesh(4 * bend[2])
        corners = np.asarray(mesh.corners)
        surface = np.einsum("ai,bj,ijd->abd", along, along, points)
        steps = max(np.linalg.norm(np.diff(surface, axis=k), axis=-1).max() for k in (0, 1))
        there = max(distances_to_triangles(x, corners).min() for x in surface[::4, ::4].reshape(-1, 3))
        samples = np.einsum("kc,tcd->tkd", grid, corners).reshape(-1, 1, 3)
        back = np.linalg.norm(samples - surface.reshape(-1, 3), axis=-1).min(axis=1).max()
        assert there <= deviation and back <= deviation + steps
        tight += there > 0.1 * deviation
    assert tight > 8


def test_the_mesh_moves_with_the_surface_and_has_its_derivatives():
    made = BezierPatch(POINTS, WEIGHTS).to_mesh(0.05)
    same = made.on(BezierPatch(POINTS, WEIGHTS))
    np.testing.assert_allclose(same.vertices, made.shape.vertices, atol=ROUNDING)
    total = lambda points: jnp.sum(made.on(BezierPatch(points, WEIGHTS)).vertices[:, 2])  # noqa: E731
    slope, step = jax.grad(total)(jnp.asarray(POINTS)), np.random.default_rng(5).normal(size=POINTS.shape)
    # Vertices are linear in the control points.
    assert np.all(np.asarray(slope)[..., :2] == 0)
    np.testing.assert_allclose(np.sum(slope * step), total(POINTS + step) - total(POINTS), rtol=1e-11)
    with pytest.raises(ValueError, match="a vertex is on patch 1"):
        BezierPatches(np.stack([POINTS, POINTS + 1])).to_mesh(0.1).on(BezierPatch(POINTS))


def tensor_point(points, weights, u, v):
    """A point of a patch in exact rational arithmetic."""
    p, q = points.shape[0] - 1, points.shape[1] - 1
    total, weight = [Fraction(0)] * 3, Fraction(0)
    for i in range(p + 1):
        for j in range(q + 1):
            share = comb(p, i) * u**i * (1 - u) ** (p - i) * comb(q, j) * v**j * (1 - v) ** (q - j)
            share *= Fraction(float(weights[i, j]))
            total = [x + share * Fraction(float(y)) for x, y in zip(total, points[i, j], strict=True)]
            weight += share
    return [x / weight for x in total]


@pytest.mark.parametrize("degrees", [(1, 7), (3, 2)])
def test_points_of_a_patch_with_weights_from_1e_minus_6_to_1e6_are_within_the_deviation(degrees):
    random = np.random.default_rng(sum(degrees))
    shape = (degrees[0] + 1, degrees[1] + 1)
    points, weights = random.normal(size=(*shape, 3)), 10.0 ** random.uniform(-6, 6, size=shape)
    made = BezierPatch(points, weights).to_mesh(0.05)
    assert made.deviation <= 0.05 and made.shape.is_manifold
    corners = np.asarray(made.shape.corners)
    for _ in range(10):
        # Near the ends too, where such weights make the surface run.
        u, v = (Fraction(float(x)) for x in random.beta(0.3, 0.3, size=2))
        point = np.array([float(x) for x in tensor_point(points, weights, u, v)])
        assert distances_to_triangles(point, corners).min() <= made.deviation + ROUNDING


def test_meshes_are_refused_where_they_cannot_be():
    patch = BezierPatch(POINTS)
    for atol in (0.0, -1.0):
        with pytest.raises(ValueError, match="needs one positive number"):
            patch.to_mesh(atol)
    with pytest.raises(ValueError, match="more than max_triangles = 100"):
        patch.to_mesh(1e-6, max_triangles=100)
    with pytest.raises(ValueError, match="rounding leaves more"):
        patch.to_mesh(1e-17)
    with pytest.raises(TypeError, match="concrete surface"):
        jax.jit(lambda p: BezierPatch(p).to_mesh(0.1).deviation)(POINTS)


def test_several_patches_are_one_surface():
    both = BezierPatches(np.stack([POINTS, POINTS + [5.0, 0, 0]]))
    np.testing.assert_allclose(both(1.25, 0.5), both.point(1, 0.25, 0.5), atol=ROUNDING)
    lower, upper = both.bounds
    assert np.all(lower <= POINTS.min((0, 1))) and upper[0] == POINTS[..., 0].max() + 5.0


def test_the_union_of_surfaces_takes_the_largest_degrees_and_weights_of_one():
    net = [[[0.0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 4]]]
    patch, sheet = BezierPatch(net), BezierPatches(np.ones((2, 2, 2, 3)))
    union = BezierPatches.join([patch, sheet])
    np.testing.assert_array_equal(union.control_points, np.concatenate([[net], np.ones((2, 2, 2, 3))]))
    weighted = BezierPatches.join([patch, BezierPatch(net, [[1, 2], [3, 4]])])
    np.testing.assert_array_equal(weighted.weights, [[[1, 1], [1, 1]], [[1, 2], [3, 4]]])
    for bad, error in (([], ValueError), ([patch, net], TypeError)):
        with pytest.raises(error, match="join needs at least one|must be a parametric surface|^Type-check error"):
            BezierPatches.join(bad)


@pytest.mark.slow
def test_patches_of_a_higher_degree_are_the_same_surface():
    rows = np.random.default_rng(5).normal(size=(2, 2, 3, 3))
    patches = BezierPatches(rows, np.random.default_rng(6).uniform(0.5, 2, size=(2, 2, 3)))
    raised = BezierPatches.join([patches, BezierPatch(np.zeros((4, 2, 3)))])
    assert raised.degrees == (3, 2) and raised.count == 3
    u, v = np.meshgrid(np.linspace(0, 1.9, 7), np.linspace(0, 1, 5))
    np.testing.assert_allclose(raised(u, v), patches(u, v), atol=1e-14)


@pytest.mark.parametrize("weighted", swept([True, False], 0, 1))
def test_a_part_of_a_spline_surface_is_the_surface_there(weighted):
    random = np.random.default_rng(7)
    weights = random.uniform(0.5, 2, size=(5, 6)) if weighted else None
    knots = [0, 0, 0, 0.25, 0.5, 1, 1, 1], [0, 1, 2, 3, 4, 5, 6, 7, 8.5, 9]
    surface = BSplineSurface(random.normal(size=(5, 6, 3)), *knots, weights)
    part = surface.restrict(0.25, 0.75, 3.5, 4)
    assert [[float(x) for x in ends] for ends in part.domain] == [[0.25, 0.75], [3.5, 4]]
    u, v = np.meshgrid(np.linspace(0.25, 0.75, 6), np.linspace(3.5, 4, 5))
    np.testing.assert_allclose(part(u, v), surface(u, v), atol=1e-14)
    with pytest.raises(ValueError, match="u0 and u1 are 0.5 and 0.5; needs 0 <= u0 < u1 <= 1"):
        surface.restrict(0.5, 0.5, 3, 6)
    with pytest.raises(ValueError, match="v0 and v1 are 2 and 4; needs 3 <= v0 < v1 <= 6"):
        surface.restrict(0, 1, 2, 4)
    with pytest.raises(TypeError, match="needs concrete knots and ends"):
        jax.jit(lambda u: surface.restrict(u, 1, 3, 6).control_points)(0.5)


@pytest.mark.slow
def test_knots_may_be_differentiated_where_the_points_are_known():
    points, other = np.random.default_rng(0).normal(size=(4, 3, 3)), [0.0, 0, 0, 1, 1, 1]

    def height(knot):
        knots = jnp.array([0.0, 0, 0, 0, 1, 1, 1]).at[3].set(knot)
        return BSplineSurface(points, knots, other).patches().control_points[1, 1, 1, 2]

    slope = (height(0.4 + 1e-6) - height(0.4 - 1e-6)) / 2e-6
    assert abs(float(jax.grad(height)(0.4) - slope)) < 1e-7
