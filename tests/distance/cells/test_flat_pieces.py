"""Flat pieces beside implicit surfaces: their points are near the surface, and none is where nothing is known."""

import jax
import numpy as np

from jhd._distance.cells.flat_pieces import beside_surface
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._shapes import ImplicitSurface

# Below the apex of a cone that opens upward, whose nearest point is the apex, and beside its flank.
CORNERS = np.array([[-0.25, 0.0, -0.5], [0.25, 0.0, -0.5]])
APEX, FLANK = np.zeros(3), np.array([0.5, 0.0, 0.5])


def test_at_the_apex_of_a_cone_no_plane_is_proven_and_every_number_is_finite():
    cone = ImplicitSurface.parse("x**2 + y**2 - z**2", [-1, -1, -1], [1, 1, 1])
    side, _, _ = prepare_surfaces(cone, cone)
    feet = np.stack([APEX, FLANK])
    flats = jax.jit(lambda *rows: beside_surface(side, *rows))(feet, np.zeros(2), CORNERS)
    origin, first, second, sag = (np.asarray(x) for x in flats)
    assert all(np.all(np.isfinite(x)) for x in (origin, first, second))
    assert np.isinf(sag[0]) and not np.any(np.isnan(sag))
    # Shares of the piece at the flank, whose points are this far from the cone: |r - |z|| by the cosine of 45 degrees.
    places = [origin[1] + s * first[1] + t * second[1] for s in (0, 0.5, 1) for t in (0, 0.5, 1)]
    far = [abs(np.hypot(x, y) - abs(z)) * np.sqrt(0.5) for x, y, z in places]
    assert max(far) <= sag[1] * (1 + 1e-12) + 1e-15
