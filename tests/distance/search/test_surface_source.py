"""What searches on implicit surfaces start from: from the host as in a program."""

import jax
import numpy as np
import pytest

from jhd import ImplicitSurface
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._distance.search.solutions import target
from jhd._distance.search.surface_source import looked_at, may_vanish, places_near
from tests.sweeps import swept

BOX = (-2.0,) * 3, (2.0,) * 3
# The last one has no point.
SURFACES = {
    "ellipsoid": "x**2 + y**2/2 + z**2 - 1",
    "cone": "x**2/4 + y**2/4 - z**2/9",
    "cubic": "x**3 - y + z*x*y - 0.3",
    "empty": "x**2 + y**2 + z**2 + 1",
}


def side_of(name):
    surface = ImplicitSurface.parse(SURFACES[name], *BOX)
    return prepare_surfaces(surface, surface)[0]


@pytest.mark.parametrize("name", swept(SURFACES, slow=["empty", "cone"]))
def test_covers_and_clouds_are_those_of_one_program(name):
    side = side_of(name)
    (found, empty), (expected, none) = looked_at(side), jax.jit(target)(side)
    assert bool(empty) == bool(none) == (name == "empty")
    for x, y in zip(found.cover, expected.cover, strict=True):
        np.testing.assert_array_equal(x, y)
    known = np.isfinite(np.asarray(expected.cloud.radius))
    np.testing.assert_array_equal(np.isfinite(np.asarray(found.cloud.radius)), known)
    np.testing.assert_allclose(
        np.asarray(found.cloud.points)[:, known], np.asarray(expected.cloud.points)[:, known], atol=1e-9
    )


def test_points_near_places_are_proven_where_the_gradient_vanishes_if_that_is_asked_for():
    side, apex = side_of("cone"), np.zeros((1, 3))
    radius = [places_near(side, apex, np.ones((1, 3), bool), thorough).radius[0] for thorough in (False, True)]
    assert np.isinf(radius[0])
    assert radius[1] < 1e-5


def test_cells_that_hold_a_point_may_vanish_and_those_far_from_it_do_not():
    side = side_of("cone")
    low = np.array([[-0.01, -0.01, -0.01], [0.9, 0.9, 0.0]])
    assert may_vanish(side, low, low + 0.02).tolist() == [True, False]
