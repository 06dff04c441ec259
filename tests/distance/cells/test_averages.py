"""Bounds of the distance over cells: what far points cost where all of a surface is about as near to them."""

import numpy as np
import pytest

from jhd.distance.cells.averages import distances_over
from jhd.distance.cells.measures import flat_triangles
from jhd.distance.frame.nets import net_of
from jhd.distance.search import on_patches
from tests.distance.test_families import sphere


@pytest.mark.slow
def test_bounds_inside_a_sphere_do_not_ask_for_the_last_digits_about_its_centre(monkeypatch):
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
