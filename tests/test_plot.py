"""Pictures: what the artists hold, and that nothing global changes."""

from typing import Any

import jax
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

import jhd
from jhd import plot
from jhd._plot.nets import quadrilaterals, quadrilaterals_of_patches

# An arch over a base line: the top of the arch, at t = 1/2, is 1 above the line.
ARCH = jhd.BezierSegments([[[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]]])
BASE = jhd.polyline([(0.0, 0.0), (2.0, 0.0)])
# Two squares, one contour each; and a cubic with a joint, in space.
SQUARES = jhd.BezierSegments.join(
    [jhd.polyline([(x, 0.0), (x + 1, 0.0), (x + 1, 1.0), (x, 1.0)], closed=True) for x in (0.0, 3.0)]
)
SPACE = jhd.BezierSegments(np.arange(24.0).reshape(2, 4, 3) % 7)


def a_solution(point, feet, lower, upper, t=0.5):
    point, feet = jnp.array(point), jnp.array(feet)
    witness = jhd.Witness(
        element=jnp.array(0),
        t=jnp.array(t),
        point=point,
        feet=feet,
        feet_elements=jnp.zeros(2, dtype=int),
        feet_params=jnp.array([0.5, 0.5]),
        multipliers=jnp.array([1.0, 0.0]),
        event=jhd.EVENTS.antipodal,
        direction=jhd.DIRECTIONS.a_to_b,
    )
    value = jnp.linalg.norm(point - feet[0])
    bounds = value, jnp.array(lower), jnp.array(upper)
    return jhd.HausdorffSolution(*bounds, witness=witness, result=jhd.RESULTS.successful, stats={})


TOP = a_solution([1.0, 1.0], [[1.0, 0.0], [1.0, 0.0]], 1.0, 1.0)
IN_SPACE = a_solution([1.0, 1.0, 3.0], [[1.0, 0.0, 3.0], [1.0, 2.0, 3.0]], 1.0, 1.0)


def axes(dim=2):
    figure = Figure()
    return figure.add_subplot(projection="3d") if dim == 3 else figure.add_subplot()


def artist(ax, gid) -> Any:
    (found,) = [a for a in ax.get_children() if a.get_gid() == gid]
    return found


def data(ax, gid):
    line = artist(ax, gid)
    columns = line.get_data_3d() if ax.name == "3d" else line.get_data()
    return np.column_stack([np.asarray(column, dtype=float) for column in columns])


@pytest.fixture(autouse=True)
def nothing_global_changes():
    settings = dict(mpl.rcParams)
    yield
    assert dict(mpl.rcParams) == settings
    assert plt.get_fignums() == []


@pytest.mark.parametrize(
    "draw",
    [
        lambda ax: plot.curve(ARCH, ax),
        lambda ax: plot.witness(TOP, ax),
        lambda ax: plot.solution(ARCH, BASE, TOP, ax),
        lambda ax: plot.distance_profile(ARCH, BASE, ax, TOP, samples=8),
    ],
)
def test_the_axes_given_are_returned_with_legible_text_and_can_be_drawn(draw):
    ax = axes()
    assert draw(ax) is ax
    ax.figure.canvas.draw()
    texts = [ax.xaxis.label, ax.yaxis.label, *ax.get_xticklabels(), *ax.texts]
    assert {text.get_fontsize() for text in texts} == {8}


def test_without_axes_a_figure_one_column_wide_is_made():
    for shape, name in ((ARCH, "rectilinear"), (SPACE, "3d")):
        ax: Any = plot.curve(shape)
        assert ax.name == name
        assert ax.figure.get_size_inches()[0] * 25.4 == pytest.approx(85)
        plt.close(ax.figure)


def test_a_curve_is_drawn_through_its_points_with_its_control_polygon():
    ax = plot.curve(ARCH, axes(), samples=4)
    drawn = data(ax, "curve")
    np.testing.assert_allclose(drawn[:-1], ARCH(np.linspace(0, 1, 5)), atol=1e-15)
    np.testing.assert_array_equal(data(ax, "control_polygon")[:-1], ARCH.control_points[0])
    assert ax.get_aspect() == 1


def test_a_rational_curve_is_drawn_on_the_curve():
    drawn = data(plot.curve(jhd.circle((1.0, 2.0), 3.0), axes()), "curve")
    radius = np.linalg.norm(drawn - [1.0, 2.0], axis=1)
    np.testing.assert_allclose(radius[np.isfinite(radius)], 3.0, rtol=1e-14)


def test_contours_are_closed_and_not_joined_by_false_lines():
    drawn = data(plot.curve(SQUARES, axes()), "curve")
    gaps = np.flatnonzero(np.isnan(drawn[:, 0]))
    assert gaps.tolist() == [8, 17]
    for contour in (drawn[:8], drawn[9:17]):
        np.testing.assert_array_equal(contour[0], contour[-1])
        assert np.max(np.linalg.norm(np.diff(contour, axis=0), axis=1)) == 1


def test_a_space_curve_needs_space_axes():
    drawn = data(plot.curve(SPACE, axes(3), samples=4), "curve")
    assert drawn.shape[1] == 3
    np.testing.assert_allclose(drawn[:5], SPACE.point(0, np.linspace(0, 1, 5)), atol=1e-13)
    with pytest.raises(ValueError, match="projection='3d'"):
        plot.curve(SPACE, axes())


def test_points_are_dots_without_lines():
    points = [(0.0, 0.0), (1.0, 2.0), (3.0, 1.0)]
    ax = plot.curve(jhd.point_set(points), axes())
    np.testing.assert_array_equal(data(ax, "curve"), points)
    assert artist(ax, "curve").get_linestyle() == "None"


def test_the_witness_lies_where_the_solution_says():
    ax = plot.witness(TOP, axes())
    np.testing.assert_array_equal(data(ax, "witness"), [TOP.witness.point])
    np.testing.assert_array_equal(data(ax, "feet"), [[1.0, 0.0]])  # the repeated foot is drawn once
    np.testing.assert_array_equal(data(ax, "joining_lines")[:2], [[1.0, 1.0], [1.0, 0.0]])
    np.testing.assert_allclose(np.linalg.norm(data(ax, "empty_circle") - [1.0, 1.0], axis=1), 1.0)
    assert artist(ax, "distance").get_text() == "$d$ = 1"


def test_a_witness_in_space_has_two_feet_and_no_circle():
    ax = plot.witness(IN_SPACE, axes(3))
    np.testing.assert_array_equal(data(ax, "feet"), IN_SPACE.witness.feet)
    assert not [a for a in ax.get_children() if a.get_gid() == "empty_circle"]
    with pytest.raises(ValueError, match="projection='3d'"):
        plot.witness(IN_SPACE, axes())


@pytest.mark.parametrize(
    ("lower", "upper", "text"),
    [
        (2.0, 2.0 + 1e-12, "$d$ ≈ 2"),
        (61.806132, np.inf, "$d$ ≥ 61.80"),
        (0.123456, 0.126543, "0.1234 ≤ $d$ ≤ 0.1266"),
        (0.0, 0.0, "$d$ = 0"),
    ],
)
def test_the_distance_is_written_as_what_is_proven(lower, upper, text):
    ax = plot.witness(a_solution([1.0, 1.0], [[1.0, 0.0], [1.0, 0.0]], lower, upper), axes())
    assert artist(ax, "distance").get_text() == text


def test_a_distance_of_zero_can_be_drawn():
    ax: Any = plot.witness(a_solution([1.0, 1.0], [[1.0, 1.0], [1.0, 1.0]], 0.0, 0.0), axes())
    ax.figure.draw_without_rendering()
    assert np.all(np.isfinite([*ax.get_xlim(), *ax.get_ylim()]))


def test_a_batch_is_refused():
    batch = jax.tree_util.tree_map(lambda leaf: jnp.stack([leaf] * 3), TOP)
    with pytest.raises(ValueError, match=r"batch of shape \(3,\)"):
        plot.witness(batch, axes())


def test_both_curves_have_their_own_color_and_line_style():
    ax: Any = plot.solution(ARCH, BASE, TOP, axes(), labels=("arch", "base"))
    first, second = [a for a in ax.get_children() if a.get_gid() == "curve"]
    assert first.get_color() != second.get_color()
    assert (first.get_linestyle(), second.get_linestyle()) == ("-", "--")
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert named == ["arch", "base", "witness", "foot", "$d$ = 1"]
    assert plot.solution(ARCH, BASE, TOP, axes(), legend=False).get_legend() is None


def test_curves_of_different_dimensions_are_refused():
    with pytest.raises(ValueError, match="a has 2 coordinates; b has 3"):
        plot.solution(ARCH, SPACE, TOP, axes(3))
    with pytest.raises(ValueError, match="a has 3 coordinates; b has 2"):
        plot.distance_profile(SPACE, ARCH, axes())


def test_the_profile_is_the_distance_along_a_with_its_maximum_and_the_witness():
    ax = plot.distance_profile(ARCH, BASE, axes(), TOP, samples=8)
    t = np.linspace(0, 1, 9)
    np.testing.assert_allclose(data(ax, "profile")[:-1], np.column_stack([t, 4 * t * (1 - t)]), atol=1e-12)
    np.testing.assert_allclose(data(ax, "candidates"), [[0.5, 1.0]], atol=1e-12)
    np.testing.assert_array_equal(data(ax, "witness"), [[0.5, 1.0]])
    assert artist(ax, "level").get_ydata() == [1.0, 1.0]
    assert ax.get_ylabel() == "distance to B (input units)"


def test_a_witness_on_the_other_curve_is_a_level_only():
    ax = plot.distance_profile(BASE, ARCH, axes(), TOP, samples=8)
    assert not [a for a in ax.get_children() if a.get_gid() == "witness"]
    artist(ax, "level")


def test_the_profile_of_closed_contours_has_no_candidates_from_their_seams():
    # Along a square about the origin the distance to the origin has its maxima at the corners, sqrt(2) away.
    square = jhd.polyline([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)], closed=True)
    ax = plot.distance_profile(square, jhd.point_set([(0.0, 0.0)]), axes(), samples=8)
    np.testing.assert_allclose(data(ax, "candidates"), [[k, np.sqrt(2)] for k in range(4)], rtol=1e-12)
    assert len([a for a in ax.get_children() if a.get_gid() == "segment_boundary"]) == 3


def test_the_profile_of_a_point_set_has_one_dot_a_point():
    ax = plot.distance_profile(jhd.point_set([(0.0, 1.0), (1.0, 2.0)]), BASE, axes())
    drawn = data(ax, "profile")
    np.testing.assert_allclose(drawn[np.isfinite(drawn[:, 0])], [[0.0, 1.0], [1.0, 2.0]], atol=1e-12)


def test_the_profile_needs_a_step():
    with pytest.raises(ValueError, match="samples is 0"):
        plot.distance_profile(ARCH, BASE, axes(), samples=0)


# A sphere, and a cone that its box cuts off at z = -2 and z = 2.
BALL = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [-2, -2, -2], [2, 2, 2])
CONE = jhd.ImplicitSurface.parse("x^2/4 + y^2/4 - z^2/9", [-2, -2, -2], [2, 2, 2])


def test_a_surface_is_drawn_from_quadrilaterals_on_it_that_end_on_its_box():
    sphere, cone = quadrilaterals(BALL, 8), quadrilaterals(CONE, 9)
    np.testing.assert_allclose(np.linalg.norm(sphere, axis=-1), 1.0, atol=1e-6)
    # Twice the area from the triangles of each; of the sphere some is lost, of the cone the edges of the disks.
    areas = [np.cross(q[:, 2] - q[:, 0], q[:, 3] - q[:, 1]) for q in (sphere, cone)]
    sphere_area, cone_area = (np.linalg.norm(x, axis=1).sum() / 2 for x in areas)
    assert 0.9 < sphere_area / (4 * np.pi) < 1
    assert 0.9 < cone_area / (2 * np.pi * (4 / 3) * np.hypot(4 / 3, 2)) < 1.02
    x, y, z = np.moveaxis(cone, -1, 0)
    assert (z.min(), z.max()) == (-2, 2)
    border = np.abs(z) == 2
    np.testing.assert_allclose(np.hypot(x, y)[border], 4 / 3, atol=1e-6)


def test_surfaces_are_one_artist_with_a_key_each():
    ax = axes(3)
    assert plot.surfaces((BALL, CONE), ax, labels=("ball", "cone"), cells=8) is ax
    faces = artist(ax, "surface")
    assert len(faces.get_facecolor()) == len(quadrilaterals(BALL, 8)) + len(quadrilaterals(CONE, 8))
    assert [line.get_label() for line in ax.lines] == ["ball", "cone"]
    ax.figure.canvas.draw()
    with pytest.raises(ValueError, match="projection='3d'"):
        plot.surface(BALL, axes())
    with pytest.raises(
        TypeError, match="must be an ImplicitSurface or a parametric surface; got BezierSegments|^Type-check error"
    ):
        plot.surfaces((BALL, SPACE), axes(3))  # pyright: ignore[reportArgumentType]


def test_parametric_surfaces_are_drawn_beside_polynomial_ones():
    flat = np.stack([*np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"), np.ones((3, 3))], axis=-1)
    patch = jhd.BezierPatch(flat)
    ax = plot.surfaces((patch, BALL), axes(3), cells=8)
    corners = quadrilaterals_of_patches(patch, 8)
    assert corners.shape == (64, 4, 3) and len(artist(ax, "surface").get_facecolor()) == 64 + len(
        quadrilaterals(BALL, 8)
    )
    # Squares of a quarter, in cyclic order, that cover the patch.
    np.testing.assert_allclose(np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=-1), 0.25, atol=1e-12)
    np.testing.assert_array_equal(corners.reshape(-1, 3).min(axis=0), [-1, -1, 1])
    np.testing.assert_array_equal(corners.reshape(-1, 3).max(axis=0), [1, 1, 1])
    two = jhd.BezierPatches(np.stack([flat, flat + [2, 0, 0]]))
    assert len(quadrilaterals_of_patches(two, 8)) == 2 * 36
    assert plot.surface(patch, axes(3)) is not None
    with pytest.raises(TypeError, match="solution must be a Hausdorff.* or Minimum.*; got tuple|^Type-check error"):
        plot.solution(patch, BALL, (), axes(3))  # pyright: ignore[reportArgumentType]


def test_a_solution_of_two_surfaces_shows_both_and_the_witness():
    ax: Any = plot.solution(BALL, CONE, IN_SPACE, axes(3), labels=("ball", "cone"))
    np.testing.assert_array_equal(data(ax, "witness"), [IN_SPACE.witness.point])
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert named == ["ball", "cone", "witness", "feet", "$d$ = 1"]
    low, high = ax.get_zlim()
    assert low <= -2 and high >= 3


def some_voxels(places, proven):
    origin, steps = jnp.array([-2.0, -2.0, -2.0]), jnp.array([0.5, 0.5, 0.5])
    return jhd.Voxels(jnp.array(places), origin, steps, jnp.array(proven))


def test_cells_show_their_outer_faces_by_what_is_proven():
    pair = some_voxels([[0, 0, 0], [1, 0, 0], [3, 3, 3]], [True, False, False])
    ax: Any = plot.voxels(pair, axes(3))
    faces = artist(ax, "voxels")
    # Two cells side by side hide one face each.
    assert len(faces.get_facecolor()) == 5 + 5 + 6
    blue = np.sum(faces.get_facecolor()[:, 2] > faces.get_facecolor()[:, 0])
    assert blue == 5
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["certified (1)", "not certified (2)"]


def test_a_section_tells_inside_outside_and_boundary_apart():
    kept = some_voxels([[5, 4, 4], [7, 0, 4], [0, 0, 0]], [True, False, True])
    ax = plot.section(BALL, kept, axes(), at=0.1)
    mesh = artist(ax, "cells").get_array()
    assert mesh.shape == (8, 8)
    # Rows are y. The layer holds the first two cells; the sphere has radius two cells.
    assert mesh[4, 5] == 2 and mesh[0, 7] == 3 and mesh[0, 0] == 1 and mesh[4, 4] == 0
    assert np.sum(mesh == 0) == 12 - 1 and np.sum(mesh == 3) == 1
    assert artist(ax, "unproven").get_hatch()
    radius = np.concatenate([np.linalg.norm(path, axis=1) for path in artist(ax, "curve").get_paths()[0].to_polygons()])
    np.testing.assert_allclose(radius, np.sqrt(1 - 0.01), atol=1e-3)
    with pytest.raises(ValueError, match="axis is 3"):
        plot.section(BALL, kept, axes(), axis=3)
    with pytest.raises(ValueError, match="at is 2.5; the box has -2 to 2"):
        plot.section(BALL, kept, axes(), at=2.5)


CUBE = jhd.TriangleMesh(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]],
    [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2]],
)


def test_meshes_are_faces_with_the_witness_of_their_distance():
    ax = axes(3)
    moved = CUBE.transform(np.eye(3), [2.0, 0.0, 0.0])
    assert plot.solution(CUBE, moved, jhd.hausdorff(CUBE, moved), ax) is ax
    (faces,) = [artist for artist in ax.collections if artist.get_gid() == "surface"]
    assert len(faces.get_facecolor()) == 2 * CUBE.count
    assert {"witness", "feet"} <= {line.get_gid() for line in ax.lines}
    assert plot.mesh(CUBE, axes(3), label="cube") is not None
    with pytest.raises(TypeError, match="TriangleMesh"):
        plot.mesh(BALL, axes(3))  # pyright: ignore[reportArgumentType]


SQUARE = jhd.polyline([(0.0, 0.0, 3.0), (1.0, 0.0, 3.0), (1.0, 1.0, 3.0)])
# Shapes, two points of them that are nearest, and how many faces are drawn.
NEAREST = {
    "plane": (jhd.polyline([(0.0, 0.0), (2.0, 0.0)]), jhd.circle((1.0, 3.0), 1.0), (1.0, 0.0), (1.0, 2.0), 0),
    "space": (SQUARE, jhd.point_set([(0.0, 0.0, 5.0)]), (0.0, 0.0, 3.0), (0.0, 0.0, 5.0), 0),
    "mesh and curve": (CUBE, SQUARE, (1.0, 1.0, 1.0), (1.0, 1.0, 3.0), CUBE.count),
    "surface and mesh": (BALL, CUBE, (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), CUBE.count + len(quadrilaterals(BALL, 48))),
}


@pytest.mark.parametrize("name", NEAREST)
def test_a_minimum_distance_shows_both_nearest_points_their_line_and_the_distance_proven(name):
    a, b, first, second, faces = NEAREST[name]
    length = np.linalg.norm(np.subtract(second, first))
    value, *points = (jnp.asarray(x) for x in (length, first, second))
    found = jhd.MinimumSolution(value, value, value, points[0], points[1], jhd.RESULTS.successful, {})
    ax: Any = plot.solution(a, b, found, axes(len(first)))
    np.testing.assert_array_equal(data(ax, "witness"), [first])
    np.testing.assert_array_equal(data(ax, "feet"), [second])
    np.testing.assert_array_equal(data(ax, "joining_lines")[:2], [first, second])
    assert "empty_circle" not in {line.get_gid() for line in ax.lines}
    drawn = [len(artist.get_facecolor()) for artist in ax.collections if artist.get_gid() == "surface"]
    assert drawn == ([faces] if faces else [])
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert set(named) == {"A", "B", "nearest points", "$d$ = 2"}


def test_a_mesh_of_very_many_triangles_is_drawn_coarser():
    turn = np.linspace(0, 2 * np.pi, 151)
    grid = np.stack(np.meshgrid(turn, turn, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.stack([np.cos(grid[:, 0]), np.sin(grid[:, 0]), grid[:, 1] / 6], axis=1)
    index = np.arange(151 * 151).reshape(151, 151)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    ax = plot.mesh(jhd.TriangleMesh(points, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])), axes(3))
    (faces,) = [artist for artist in ax.collections if artist.get_gid() == "surface"]
    assert 5_000 < len(faces.get_facecolor()) <= 20_000
