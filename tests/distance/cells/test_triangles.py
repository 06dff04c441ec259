"""Cells of meshes: computed points are as close to what they stand for as the bounds of cells allow."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jhd._distance.cells.triangles import MeshSide
from tests.rounding.interpreter import evaluate
from tests.rounding.numbers import Rounded, exactly

COUNT = 40
LEVELS = 150
# What double precision errs by in so many levels, with room: far less than single precision does in one.
DOUBLE = 1e-12


def sides():
    """Random triangles, and some whose corners 1 and 2 lie in one direction, so that errors of weights add up."""
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1, 1, (COUNT, 3, 3)).astype(np.float32)
    corners[::2] = np.sign(corners[::2, :1]) * np.array([[-1], [1], [1]], np.float32)
    tree: Any = SimpleNamespace(error=lambda distance: 2.0**-20 * distance)
    return MeshSide(corners, 1.0, tree, corners)


def parts(weights, shares):
    """The barycentric coordinates of a part of a cell, with corners on the edges behind its own, level by level."""
    for share in shares:
        weights = weights + share * (weights[:, [1, 2, 0]] - weights)
    return weights


@pytest.mark.parametrize("way", ("nearest", "up", "down"))
@pytest.mark.parametrize("levels", (0, 1, LEVELS))
def test_points_of_cells_are_within_the_slack_of_the_exact_ones(levels, way):
    side, owner = sides(), np.arange(COUNT)
    whole = np.broadcast_to(np.eye(3, dtype=np.float32), (COUNT, 3, 3)) + np.zeros((COUNT, 1, 1), np.float32)
    shares = np.random.default_rng(4).uniform(0, 1, levels).astype(np.float32)
    weights = evaluate(parts, Rounded(24, way), [whole, shares], [None, None]) if levels else whole
    computed = side.points(owner, weights.astype(np.float32))
    # Double precision is exact beside single precision.
    exact = side._replace(corners=side.corners.astype(float)).points(owner, parts(whole.astype(float), shares))
    apart = np.sqrt(np.sum((computed - exact) ** 2, axis=-1))
    assert np.max(apart) > 2.0**-26
    assert np.all(apart + DOUBLE <= side.slack(levels))


def test_bounds_of_cells_are_above_the_distance_with_all_its_errors():
    side = sides()
    distance = np.random.default_rng(5).uniform(0, 1, 200).astype(np.float32)
    for depth in (0, 3):
        error = exactly(side.tree.error(distance.astype(float))) + exactly(side.slack(depth))
        # The square is given in double precision, so that its root is the distance.
        upper = side.reach(distance.astype(float) ** 2, np.array(depth))
        assert np.all(exactly(distance) + error <= exactly(upper))
