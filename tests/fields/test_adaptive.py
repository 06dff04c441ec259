"""Adaptively sampled fields: exact samples, tested tolerances, true bounds, derivatives, meshes and files."""

import sys
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd._fields.adaptive_samples as samples_module
from jhd._distance.signed_distance import signed_distance
from jhd._fields.adaptive import AdaptiveDistanceField
from jhd._fields.adaptive_build import may_meet
from jhd._fields.adaptive_error import LeafBoxes, largest_error
from jhd._fields.adaptive_samples import surface_of
from jhd._fields.boxes import CORNERS
from jhd._shapes.mesh import TriangleMesh
from tests.sweeps import swept

# Roundings of distances of about one.
ROUNDING = 1e-14
SIZE = np.array([0.5, 0.3, 0.4])
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def block(size: Any = SIZE, center: Any = 0.0, turned=False):
    """A closed box of twelve triangles."""
    triangles = np.array([[q[0], q[1], q[2]] for q in QUADS] + [[q[0], q[2], q[3]] for q in QUADS])
    return TriangleMesh((2 * CORNERS - 1) * size + center, triangles[:, ::-1] if turned else triangles)


def block_distance(points, size=SIZE):
    """The signed distance of that box in closed form."""
    q = np.abs(points) - size
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(np.max(q, axis=-1), 0)


def torus(rows=24):
    """A closed mesh of 4 rows^2 triangles about the z axis."""
    u, v = np.meshgrid(*[np.arange(n) * 2 * np.pi / n for n in (2 * rows, rows)], indexing="ij")
    ring = 1 + 0.4 * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), 0.4 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.indices(u.shape)
    a, b = i * rows + j, i * rows + (j + 1) % rows
    c, d = ((i + 1) % (2 * rows) * rows + k for k in (j, (j + 1) % rows))
    return TriangleMesh(points, np.stack([a, c, d, a, d, b], axis=-1).reshape(-1, 3))


def union(*meshes):
    """Triangles of several meshes in one."""
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    triangles = [np.asarray(m.triangles) + s for m, s in zip(meshes, starts, strict=False)]
    return TriangleMesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(triangles))


def holed():
    mesh = torus(8)
    return TriangleMesh(mesh.vertices, mesh.triangles[5:])


@pytest.fixture(scope="module")
def field():
    return AdaptiveDistanceField.build(block(), 4e-3)


@pytest.fixture(scope="module")
def full():
    return AdaptiveDistanceField.build(block(), 2e-2, "full")


def boxes(field):
    """Lower corners, sides and values of the leaves."""
    lower = np.asarray(field.lower) + float(field.spacing) * np.asarray(field.leaf_corners)
    return lower, float(field.spacing) * np.asarray(field.widths), np.asarray(field.values)[np.asarray(field.corners)]


@pytest.mark.slow
@pytest.mark.parametrize("which", ["field", "full"])
def test_the_leaves_fill_the_box_and_their_corners_hold_exact_distances(which, request):
    field = request.getfixturevalue(which)
    lower, side, values = boxes(field)
    assert np.isclose(np.sum(side**3), np.prod(field.upper - field.lower), rtol=1e-14)
    places = lower[:, None] + side[:, None, None] * CORNERS
    np.testing.assert_allclose(values, block_distance(places), rtol=0, atol=ROUNDING)
    middles = lower + 0.5 * side[:, None]
    np.testing.assert_allclose(field(middles), values.mean(axis=1), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_every_leaf_in_full_mode_is_within_the_tolerance_at_its_19_points(full):
    lower, side, _ = boxes(full)
    assert full.unresolved == 0
    for step in np.ndindex(3, 3, 3):
        # A little inside, so that no neighbor is asked.
        points = lower + side[:, None] * np.clip(np.array(step) / 2, 1e-9, 1 - 1e-9)
        assert np.max(np.abs(np.asarray(full(points)) - block_distance(points))) <= float(full.tolerance) + 1e-8


@pytest.mark.slow
def test_the_band_is_refined_at_the_surface_alone_and_has_the_right_sign_elsewhere(field):
    lower, side, values = boxes(field)
    middle = lower + 0.5 * side[:, None]
    far = np.abs(block_distance(middle)) > 0.87 * side
    assert np.all(np.abs(block_distance(middle)[side == side.min()]) < 3 * side.min())
    assert np.all(np.sign(values[far]) == np.sign(block_distance(middle))[far, None])
    assert field.unresolved == 0 and field.leaves < 20_000


def test_a_cell_that_holds_a_point_of_the_surface_is_never_left_out():
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.random((4000, 3)), rng.integers(0, 3, (200, 3)) / 2])
    assert np.all(may_meet(np.linalg.norm(points[:, None] - CORNERS, axis=2), 1.0))
    assert not np.any(may_meet(np.full((1, 8), 0.9), 1.0))


@pytest.mark.parametrize("sign", swept(["pseudonormal", "winding"], 1, 1))
def test_samples_of_a_curved_mesh_have_the_exact_signed_distance(sign):
    mesh = torus(12)
    field = AdaptiveDistanceField.build(mesh, 2e-2, sign=sign)
    lower, side, values = boxes(field)
    places = (lower[:, None] + side[:, None, None] * CORNERS).reshape(-1, 3)
    np.testing.assert_allclose(values.ravel(), signed_distance(places, mesh), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_signs_are_right_where_sheets_cross_lie_in_each_other_or_are_turned():
    mesh = union(block(), block(SIZE, 0.2), block(0.1 * SIZE, -0.2, turned=True), block(1e-3 * SIZE, 0.8))
    field = AdaptiveDistanceField.build(mesh, 2e-2)
    lower, side, values = boxes(field)
    places = (lower[:, None] + side[:, None, None] * CORNERS).reshape(-1, 3)
    np.testing.assert_allclose(values.ravel(), signed_distance(places, mesh), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_few_winding_numbers_are_asked_for(monkeypatch):
    asked, reports = [], []
    ask = samples_module.is_inside
    monkeypatch.setattr(samples_module, "is_inside", lambda m, p, f=None: asked.append(len(p)) or ask(m, p, f))
    AdaptiveDistanceField.build(torus(), 1e-2, progress=reports.append)
    assert [r.done for r in reports] == list(range(len(reports))) and reports[-1].details["split"] == 0
    first = reports[0].details["samples"]
    assert sum(asked[1:]) < 0.02 * (reports[-1].details["samples"] - first)


def test_a_mesh_in_another_unit_gives_the_same_field(field):
    for power in (-40, 30):
        other = AdaptiveDistanceField.build(block(SIZE * 2.0**power), 4e-3 * 2.0**power)
        assert np.array_equal(other.values, field.values * 2.0**power)
        assert np.array_equal(other.corners, field.corners)


def test_details_far_from_the_origin_are_kept():
    far = AdaptiveDistanceField.build(block(1e-3 * SIZE, 1e6), 2e-5)
    lower, side, values = boxes(far)
    # Coordinates near 1e6 have an ulp of 1e-10.
    places = lower[:, None] + side[:, None, None] * CORNERS - 1e6
    np.testing.assert_allclose(values, block_distance(places, 1e-3 * SIZE), rtol=0, atol=4e-10)
    assert np.max(np.asarray(far.upper - far.lower)) < 2e-3


@pytest.mark.parametrize(
    "mesh",
    swept([[[0.3, 1, 2]] * 3, [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]]], 1, 2),
)
def test_meshes_without_volume_have_fields(mesh):
    mesh = TriangleMesh(mesh, [[0, 1, 2]])
    field = AdaptiveDistanceField.build(mesh, 0.05, max_depth=3)
    points = np.random.default_rng(1).uniform(field.lower, field.upper, (50, 3))
    assert np.all(np.isfinite(field(points))) and np.all(np.asarray(field.values) >= 0)


def test_limits_stop_the_refinement_and_say_so(field):
    shallow = AdaptiveDistanceField.build(block(), 4e-3, max_depth=1)
    small = AdaptiveDistanceField.build(block(), 4e-3, max_cells=field.leaves // 2)
    assert shallow.depth == 1 and shallow.unresolved > 0
    assert small.leaves < field.leaves // 2 and small.unresolved > 0


def test_the_batch_shape_is_kept_and_jit_and_vmap_agree(field):
    points = np.random.default_rng(2).uniform(-0.7, 0.7, (4, 5, 3))
    values = field(points)
    assert values.shape == (4, 5) and field(points[0, 0]).shape == ()
    np.testing.assert_allclose(eqx.filter_jit(lambda f, p: f(p))(field, points), values, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(jax.vmap(jax.vmap(field))(points), values, rtol=0, atol=ROUNDING)


def test_outside_of_the_box_the_distance_to_it_is_added(field):
    low, high = np.asarray(field.lower), np.asarray(field.upper)
    points = np.random.default_rng(3).uniform(-4, 4, (300, 3))
    inside = np.clip(points, low, high)
    beyond = np.linalg.norm(points - inside, axis=1)
    np.testing.assert_allclose(field(points), np.asarray(field(inside)) + beyond, rtol=0, atol=ROUNDING)
    coarse = float(field.widths.max() * field.spacing)
    assert np.all(np.asarray(field(points)) >= block_distance(points) - coarse)
    assert np.all(np.asarray(field(points)) <= block_distance(points) + 2 * beyond + coarse)
    slope = jax.vmap(jax.grad(field))(jnp.asarray(points[beyond > 0]))
    assert np.all(np.isfinite(slope))


def test_the_derivative_in_the_point_is_that_of_the_interpolation(field):
    points = np.random.default_rng(4).uniform(-0.55, 0.55, (40, 3))
    slope, step = np.asarray(jax.vmap(jax.grad(field))(jnp.asarray(points))), 1e-7
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        differences = (np.asarray(field(points + shift)) - np.asarray(field(points - shift))) / (2 * step)
        # Points next to a face of their leaf would have differences of two leaves.
        np.testing.assert_allclose(slope[:, axis], differences, rtol=0, atol=1e-6)
    at_corner = jax.grad(field)(field.lower)
    assert np.all(np.isfinite(at_corner)) and np.linalg.norm(at_corner) > 0.5


def test_the_derivative_in_the_values_gives_the_weights_of_the_corners(field):
    point = jnp.array([0.49, 0.1, 0.05])
    weights = jax.grad(lambda v: eqx.tree_at(lambda f: f.values, field, v)(point))(field.values)
    used = np.flatnonzero(weights)
    assert 0 < len(used) <= 8 and np.isclose(float(weights.sum()), 1.0)
    assert np.isclose(float(weights @ field.values), float(field(point)), rtol=0, atol=ROUNDING)


def largest_seen(field, mesh, count=20_000):
    """The largest error at random points of leaves that meet the surface, and on their diagonals."""
    lower, side, _ = boxes(field)
    which = np.abs(np.asarray(signed_distance(lower + 0.5 * side[:, None], mesh))) <= 0.8 * side
    which |= field.mode == "full"
    rng = np.random.default_rng(5)
    chosen = rng.choice(np.flatnonzero(which), count)
    points = lower[chosen] + side[chosen, None] * rng.uniform(1e-9, 1 - 1e-9, (count, 3))
    return float(np.max(np.abs(np.asarray(field(points)) - np.asarray(signed_distance(points, mesh)))))


@pytest.mark.parametrize("which", ["field", "full"])
@pytest.mark.slow
def test_the_proven_error_is_above_all_that_is_seen_and_not_far(which, request):
    field, mesh = request.getfixturevalue(which), block()
    proven, seen = field.proven_error(mesh, max_boxes=60_000), largest_seen(field, mesh)
    sampled = field.sampled_error(mesh, 20_000)
    assert max(seen, sampled) <= proven <= 2.5 * max(seen, sampled)
    assert sampled >= 0.5 * seen
    # With room for nothing but the leaves the bound is wider, and true.
    assert proven <= field.proven_error(mesh, max_boxes=1)


@pytest.mark.slow
def test_the_proven_error_sees_wrong_values_and_another_mesh():
    mesh, turned = block(), block(SIZE, np.array([0.03, 0.02, 0.0]))
    field = AdaptiveDistanceField.build(mesh, 2e-2)
    noise = np.random.default_rng(6).normal(0, 0.02, field.values.shape)
    worse = eqx.tree_at(lambda f: f.values, field, field.values + noise)
    for other, of in ((worse, mesh), (field, turned)):
        assert other.proven_error(of, max_boxes=20_000) >= largest_seen(other, of)
    assert worse.proven_error(mesh, max_boxes=20_000) > 0.03


@pytest.mark.parametrize("sign", [1, -1])
def test_one_value_that_is_off_is_in_the_proven_error(sign):
    # Samples are taken in the middle, where an eighth of it is left.
    box = LeafBoxes(np.array([[0.6, -0.05, -0.05]]), np.array([0.1]), np.full((1, 8), 0.1))
    box.values[0] += 0.1 * CORNERS[:, 0]
    box.values[0, 5] += sign * 0.05
    assert 0.05 <= largest_error(surface_of(block()), box, 1.0, 1) <= 0.06


@pytest.mark.slow
def test_the_proven_error_of_a_cube_is_at_most_three_tolerances():
    cube = block(np.full(3, 0.5))
    assert AdaptiveDistanceField.build(cube, 1e-2).proven_error(cube, max_boxes=20_000) < 0.03


@pytest.mark.slow
def test_the_mesh_of_a_field_is_closed_outward_and_near():
    mesh = torus()
    field = AdaptiveDistanceField.build(mesh, 5e-3)
    found = field.to_mesh(64)
    assert found.is_closed and found.is_manifold
    assert np.isclose(float(found.volume), float(mesh.volume), rtol=0.01) and float(mesh.volume) > 0
    assert np.max(np.abs(np.asarray(signed_distance(found.vertices, mesh)))) < 1e-2
    # Vertices are zeros of the field itself, found along edges of the grid, but for its jumps.
    off = np.abs(np.asarray(field(found.vertices)))
    assert np.median(off) < 1e-4 and off.max() < 5e-3


@pytest.mark.slow
def test_the_mesh_of_a_field_does_not_depend_on_how_the_grid_is_cut(monkeypatch):
    import jhd._fields.adaptive_extract as module

    field = AdaptiveDistanceField.build(torus(8), 2e-2)
    whole = field.to_mesh(40)
    monkeypatch.setattr(module, "_TILES", 2)
    cut = field.to_mesh(40)
    assert whole.count == cut.count and cut.is_closed and whole.is_manifold
    np.testing.assert_allclose(np.asarray(cut.vertices), np.asarray(whole.vertices), rtol=0, atol=1e-12)


def test_a_missing_scikit_image_is_named(field, monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage.measure", None)
    with pytest.raises(ImportError, match=r"scikit-image: pip install jhd\[mesh\]"):
        field.to_mesh(8)


@pytest.mark.slow
def test_an_open_mesh_has_a_field_but_no_proof():
    mesh = holed()
    field = AdaptiveDistanceField.build(mesh, 0.1, max_depth=3)
    lower, side, values = boxes(field)
    places = (lower[:, None] + side[:, None, None] * CORNERS).reshape(-1, 3)[::7]
    np.testing.assert_allclose(values.ravel()[::7], signed_distance(places, mesh), rtol=0, atol=ROUNDING)
    assert field.sampled_error(mesh, 100) > 0
    with pytest.raises(ValueError, match="equally often in both directions"):
        field.proven_error(mesh)
    with pytest.raises(ValueError, match="sign='winding'"):
        AdaptiveDistanceField.build(mesh, 0.1, sign="pseudonormal")


def test_a_field_is_written_and_read_without_loss(full, tmp_path):
    full.save(tmp_path / "field.npz")
    read = AdaptiveDistanceField.load(tmp_path / "field.npz")
    assert jax.tree_util.tree_structure(read) == jax.tree_util.tree_structure(full)
    for one, other in zip(*map(jax.tree_util.tree_leaves, (read, full)), strict=True):
        assert one.dtype == other.dtype and np.array_equal(one, other)


def test_an_interruption_leaves_the_stored_field_alone(full, tmp_path, monkeypatch):
    path = tmp_path / "field.npz"
    path.write_bytes(b"old")

    def interrupted(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        full.save(path)
    assert path.read_bytes() == b"old" and [file.name for file in tmp_path.iterdir()] == ["field.npz"]


def changed(field, path, **arrays):
    field.save(path)
    with np.load(path) as stored:
        content = {**stored, **arrays}
    np.savez(path, **content)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"format": "another"}, "another version"),
        ({"roots": np.full((4, 4, 4), 10**6)}, "roots"),
        ({"corners": np.zeros((3, 8), int)}, "corners has shape"),
        ({"values": np.array([np.nan])}, "values"),
        ({"mode": "none"}, "mode is 'none'"),
        ({"depth": 99}, "depth is 99"),
        ({"nodes": np.array([object()])}, "objects of Python"),
        ({"depth": np.inf}, "infinity"),
        ({"roots": np.full((4, 4, 4), (1 << 32) + 1)}, "roots holds int64 up to 4294967297; needs integers of 32 bits"),
        ({"corners": np.full((3, 8), 1.0)}, "corners holds float64"),
        ({"spacing": -0.5}, "spacing is -0.5 and tolerance"),
        ({"tolerance": 0.0}, "tolerance 0; needs positive lengths"),
    ],
)
def test_files_that_hold_no_field_are_refused_with_their_name(full, tmp_path, arrays, message):
    path = tmp_path / "field.npz"
    changed(full, path, **arrays)
    with pytest.raises(ValueError, match=f"field.npz: .*{message}"):
        AdaptiveDistanceField.load(path)


@pytest.mark.parametrize("shift", [-1, 1 << 20])
def test_a_field_with_leaves_out_of_its_grid_is_refused(full, tmp_path, shift):
    leaf_corners = np.asarray(full.leaf_corners).copy()
    leaf_corners[0] += shift
    changed(full, tmp_path / "field.npz", leaf_corners=leaf_corners)
    with pytest.raises(ValueError, match="field.npz: leaf_corners has leaves out of the box"):
        AdaptiveDistanceField.load(tmp_path / "field.npz")


def test_files_that_are_no_archive_are_refused_with_their_name(tmp_path):
    path = tmp_path / "field.npz"
    for content in (b"", b"no archive", b"PK\x03\x04 cut off"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"field\.npz: "):
            AdaptiveDistanceField.load(path)
    np.save(tmp_path / "one.npy", np.zeros(3))
    with pytest.raises(ValueError, match=r"one\.npy: "):
        AdaptiveDistanceField.load(tmp_path / "one.npy")
    with pytest.raises(FileNotFoundError, match="no such file"):
        AdaptiveDistanceField.load(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"surface": "bunny"}, TypeError, "surface"),
        ({"tolerance": 0.0}, ValueError, "tolerance is 0; needs a positive number"),
        ({"tolerance": -1e-3}, ValueError, "tolerance is -0.001"),
        ({"tolerance": np.nan}, ValueError, "tolerance is not finite"),
        ({"tolerance": [1e-3, 1e-3]}, ValueError, "needs a scalar"),
        ({"tolerance": 1j}, TypeError, "tolerance must be real"),
        ({"mode": "half"}, ValueError, "mode is 'half'; needs one of 'band', 'full'"),
        ({"sign": "ray"}, ValueError, "sign is 'ray'; needs one of 'winding', 'pseudonormal'"),
        ({"max_depth": 99}, ValueError, "max_depth is 99; needs 0 to 15"),
        ({"max_cells": 1.5}, TypeError, "max_cells"),
    ],
)
def test_what_cannot_be_built_is_refused(options, error, message):
    with pytest.raises(error, match=message):
        AdaptiveDistanceField.build(**{"surface": block(), "tolerance": 1e-2, **options})


def test_bad_questions_to_a_field_are_refused(full):
    for points, message in (
        ([np.nan, 0, 0], "points is not finite|points"),
        ([0.0, 1.0], "needs"),
        (np.zeros((0, 3)), "empty"),
    ):
        with pytest.raises(ValueError, match=message):
            full(points)
    for resolution in (1, -3):
        with pytest.raises(ValueError, match=f"resolution is {resolution}; needs 2"):
            full.to_mesh(resolution)
    positive = eqx.tree_at(lambda f: f.values, full, jnp.abs(full.values) + 1.0)
    with pytest.raises(ValueError, match="no zero was found with a resolution of 16"):
        positive.to_mesh(16)
    with pytest.raises(ValueError, match="rtol is 0"):
        full.proven_error(block(), rtol=0.0)
    with pytest.raises(ValueError, match="samples is 0"):
        full.sampled_error(block(), 0)
    with pytest.raises(TypeError, match="TriangleMesh"):
        full.sampled_error("mesh")  # pyright: ignore[reportArgumentType]
    far = AdaptiveDistanceField.build(block(SIZE, 50.0), 0.1)
    with pytest.raises(ValueError, match="no leaf of the field meets the mesh"):
        far.sampled_error(block())


def test_building_under_tracing_is_refused():
    def distance(vertices):
        return AdaptiveDistanceField.build(TriangleMesh(vertices, block().triangles), 0.1)(jnp.zeros(3))

    with pytest.raises(TypeError, match="traced"):
        jax.jit(distance)(block().vertices)


@pytest.mark.parametrize("seed", swept(range(4)))
def test_the_proven_error_is_true_on_rough_meshes(seed):
    mesh = torus(10)
    rough = np.random.default_rng(seed).normal(0, 0.03, mesh.vertices.shape)
    mesh = TriangleMesh(np.asarray(mesh.vertices) + rough, mesh.triangles)
    for mode, tolerance in (("band", 2e-2), ("full", 5e-2)):
        field = AdaptiveDistanceField.build(mesh, tolerance, mode)
        assert field.proven_error(mesh, max_boxes=100_000) >= largest_seen(field, mesh, 200_000)
