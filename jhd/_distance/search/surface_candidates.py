"""Implicit surfaces from the host: cells that may hold their points, points near given points, and targets.

There is one compiled function for any number of cells, and one for any number of points. Starts of searches and
sources of cells need no others.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jhd._arithmetic.polynomials import slopes
from jhd._distance.nearest.forms import boxes, form
from jhd._distance.nearest.surface_points import projected, proven_radius, with_singular_radius
from jhd._distance.nearest.surfaces import CLOUD_STEPS, Cover, SurfaceCloud, grid, halved, starts_of_cloud
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.candidates import Target
from jhd._distance.search.row_batches import in_blocks, in_groups
from jhd._distance.search.solutions import with_some_point
from jhd._results.solution import on_device
from jhd._runtime.compiled import compiled
from jhd._shapes.prepared import prepared

# Cells or points processed in one batch.
_LANES = 64


class PlacesNear(NamedTuple):
    """Points near given points, lengths within which the surface has a point, and its gradients there.

    Args:
        points: the points, on the surface if that is proven.
        radius: length within which the surface has a point; infinite if nothing is proven.
        slope: gradients at the points.
    """

    points: Any  # (places, 3)
    radius: Any  # (places,)
    slope: Any  # (places, 3)


def looked_at(side: Side) -> tuple[Target, Any]:
    """Return a side with cover and cloud, and whether it provably has no point in its box; stored with the side."""
    return prepared(side)._part(_looked_at)


def _looked_at(side: Side) -> tuple[Target, Any]:
    """Compute `looked_at`; the search for a point anywhere is compiled only if no point of the cloud is proven."""
    side = jax.tree_util.tree_map(np.asarray, side)
    low, high = grid(side)
    alive = may_vanish(side, low.T, high.T)
    starts, fixed = starts_of_cloud(side)
    found = places_near(side, starts.T, fixed.T, thorough=False)
    side, cover, cloud = on_device((side, (low, high, alive), (found.points.T, found.radius)))
    target = Target(side, Cover(*cover), SurfaceCloud(*cloud))
    return (target, np.asarray(False)) if np.any(np.isfinite(found.radius)) else _with_some_point(target)


_with_some_point = compiled(with_some_point)


def may_vanish(
    side: Side, low: Float[np.ndarray, "cells 3"], high: Float[np.ndarray, "cells 3"]
) -> Bool[np.ndarray, " cells"]:
    """Return a mask of the cells that may hold a point of the surface."""
    return in_blocks(_may_vanish, side, low, high)


def eighths(
    side: Side, low: Float[np.ndarray, "cells 3"], high: Float[np.ndarray, "cells 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ends of the eighths of cells that may hold a point of the surface, and the cell of each."""
    low, high = (x.reshape(3, 8, -1).T.reshape(-1, 3) for x in halved(low.T, high.T))
    rows = np.flatnonzero(may_vanish(side, low, high))
    return low[rows], high[rows], rows // 8


def places_near(
    side: Side, starts: Float[np.ndarray, "places 3"], fixed: Bool[np.ndarray, "places 3"], thorough: bool
) -> PlacesNear:
    """Return points of the surface near points of the box, which keep the coordinates that are fixed."""
    return PlacesNear(*in_blocks(_places_near, (side, np.asarray(thorough)), starts, fixed))


@compiled
def _may_vanish(side: Side, count: Array, low: Array, high: Array) -> Array:
    return in_groups(lambda low, high: form(side, boxes(low.T, high.T)).may_vanish, count, (low, high), _LANES)


@compiled
def _places_near(how: tuple[Side, Array], count: Array, starts: Array, fixed: Array) -> Any:
    side, thorough = how

    def group(starts: Array, fixed: Array) -> PlacesNear:
        found = projected(side, starts.T, fixed.T, CLOUD_STEPS)
        radius = proven_radius(side, found)
        radius = jax.lax.cond(thorough, lambda r: with_singular_radius(side, found, r), lambda r: r, radius)
        slope = slopes(jnp.asarray(side.coefficients), found)[1]
        return PlacesNear(found.T, radius, slope.T)

    return in_groups(group, count, (starts, fixed), _LANES)
