"""Bounds of the distance over cells: what far points cost where all of a surface is about as near to them."""

import numpy as np
import pytest

import jhd
from jhd._distance.cells.arc_length_area import flat_triangles
from jhd._distance.cells.mean_bounds import NEAR, distances_over
from jhd._distance.normalization.nets import net_of
from jhd._distance.search import on_patches
from jhd._distance.search.targets import target_of
from tests.distance.test_nonisolated_maxima import sphere
from tests.reference import distances_to_triangles
from tests.sweeps import swept


@pytest.mark.slow
def test_bounds_inside_a_sphere_do_not_ask_for_the_last_digits_about_its_center(monkeypatch):
    random = np.random.default_rng(3)
    corners = random.normal(size=(48, 1, 3)) + 0.1 * random.normal(size=(48, 3, 3))
    corners = 0.49 * corners / np.linalg.norm(corners, axis=2, keepdims=True)
    target, blocks = on_patches.NetTarget(net_of(sphere(0.5))), []
    bounded, kept = on_patches.in_blocks, on_patches._bounded

    def counted(program, *arguments):
        blocks.append(program is kept)
        return bounded(program, *arguments)

    monkeypatch.setattr(on_patches, "in_blocks", counted)
    cells = flat_triangles(corners, 0.0)
    found = distances_over(cells, target, np.dtype(np.float64), np.full(48, 0.47), 1e-9)
    # Half of what the last digits take.
    assert sum(blocks) < 500
    share = random.dirichlet([1, 1, 1], (2000,))
    exact = 0.5 - np.linalg.norm(np.einsum("nk,ckd->cnd", share, corners), axis=2)
    assert np.all(found.lower[:, None] <= exact) and np.all(exact <= found.upper[:, None])
    # Means of samples are within a few of their standard errors.
    room = 6 * np.std(exact, axis=1) / 2000**0.5
    assert np.all(found.mean[:, 0] <= exact.mean(axis=1) + room) and np.all(
        exact.mean(axis=1) - room <= found.mean[:, 1]
    )


@pytest.mark.parametrize("kind", swept(["apart", "across", "copy", "flat"], quick=["across"], slow=["copy", "flat"]))
def test_bounds_beside_a_mesh_hold_and_lose_nothing_over_parallel_faces(kind):
    random = np.random.default_rng(len(kind))
    vertices = 0.4 * random.normal(size=(40, 3))
    triangles = random.permuted(np.tile(np.arange(40), (24 if kind == "flat" else 60, 1)), axis=1)[:, :3]
    if kind == "flat":
        vertices[:, 2] = 0.0
    middle = 0.4 * random.normal(size=(32, 1, 3)) + (1.5 if kind == "apart" else 0.0)
    size = 10.0 ** random.uniform(-4, 0, (32, 1, 1))
    corners = middle + size * random.normal(size=(32, 3, 3))
    if kind == "copy":
        corners = vertices[triangles]
    if kind == "flat":
        # Within a face, and over it by so much.
        corners = 0.25 * vertices[triangles] + 0.75 * vertices[triangles].mean(axis=1, keepdims=True)
        corners[..., 2] = 0.01
    mesh = jhd.TriangleMesh(vertices, triangles)
    cells = flat_triangles(corners, 0.0)
    found = distances_over(cells, target_of(mesh), np.dtype(float), np.full(len(corners), NEAR), 1e-9)
    share = random.dirichlet([1, 1, 1], (100,))
    places = np.einsum("nk,ckd->cnd", share, corners)
    exact = np.array([[distances_to_triangles(x, vertices[triangles]).min() for x in own] for own in places])
    assert np.all(found.lower[:, None] <= exact + 1e-14) and np.all(exact <= found.upper[:, None] + 1e-14)
    room = 6 * np.std(exact, axis=1) / 100**0.5
    assert np.all(found.mean[:, 0] <= exact.mean(axis=1) + room)
    assert np.all(exact.mean(axis=1) - room <= found.mean[:, 1])
    below, above = np.einsum("nk,ckb->bcn", share, found.ends)
    assert np.all(below <= exact + 1e-14) and np.all(exact <= above + 1e-14)
    wide = 6 * np.std(exact**2, axis=1) / 100**0.5
    assert np.all(found.square[:, 0] <= np.mean(exact**2, axis=1) + wide)
    assert np.all(np.mean(exact**2, axis=1) - wide <= found.square[:, 1])
    if kind == "flat":
        assert np.all(0.01 - found.mean[:, 0] < 1e-12)


def test_a_triangle_that_is_near_a_corner_alone_counts():
    corners = np.array([[[-0.9, -0.5, 0.0], [0.9, -0.5, 0.0], [0.0, 0.9, 0.0]]])
    far = [[-3.0, -3.0, -0.3], [3.0, -3.0, -0.3], [0.0, 5.0, -0.3]]
    near = [[0.9, -0.5, 0.01], [0.91, -0.5, 0.01], [0.9, -0.51, 0.01]]
    mesh = jhd.TriangleMesh(np.array([*far, *near]), np.array([[0, 1, 2], [3, 4, 5]]))
    found = distances_over(flat_triangles(corners, 0.0), target_of(mesh), np.dtype(float), np.array([NEAR]), 1e-9)
    assert found.lower[0] <= 0.01
    # The part that is nearer to the small one is small.
    assert 0.0 < found.mean[0, 0] < 0.3 <= found.upper[0]
