"""Isolated points of two implicit surfaces, measured to the opposite surface before the minimum search.

About such a point no sign of the polynomial proves anything and no part of the surface is a graph. So cells that hold
the point get smaller and smaller, and so do nearby cells of the opposite surface; these are many if all of it is about
equally near. The nearest points to a known point are found at once (jhd._distance.nearest.surfaces). The rest of the
surface has no such point.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.lagrange import WithSurface
from jhd._distance.cells.pairs import BestPair
from jhd._distance.normalization.surfaces import Side
from jhd._distance.search.closest import ClosestState
from jhd._distance.search.on_surfaces import SurfaceTarget


class IsolatedPairs(NamedTuple):
    """What is left of a pair of surfaces, and what is known of their isolated points.

    Args:
        problem: the pair without these points.
        lower: a lower bound of their distances from the other surface; infinite where there is none.
        best: the nearest one of them with its foot, or None.
    """

    problem: WithSurface
    lower: float
    best: BestPair | None

    def told(self, table: ClosestState) -> ClosestState:
        """A table that begins with what is known."""
        best = table.best if self.best is None or not self.best.upper < table.best.upper else self.best
        return table._replace(settled=jnp.minimum(table.settled, self.lower).astype(table.settled.dtype), best=best)


def isolated_pairs(problem: WithSurface) -> IsolatedPairs:
    """Both surfaces with their isolated points measured.

    Raises:
        ValueError: one has such a point, and the other is proven to have no point in its box.
    """
    sides: Any = problem[:2]
    found = [_measured(own, other) for own, other in zip(sides, sides[::-1], strict=True)]
    pairs = [(upper, np.concatenate(x if k == 0 else x[::-1])) for k, (_, _, upper, *x) in enumerate(found) if x]
    best = None
    if pairs:
        upper, x = min(pairs, key=lambda pair: pair[0])
        zero: Any = jnp.array(0)
        apart: Any = np.sqrt(np.sum((x[:3] - x[3:]) ** 2))
        best = BestPair(jnp.asarray(upper), jnp.asarray(np.minimum(apart, upper)), zero, zero, jnp.asarray(x))
    left = problem._replace(a=found[0][0], b=found[1][0])
    return IsolatedPairs(left, min(found[0][1], found[1][1]), best)


def _measured(own: Side, other: Side) -> tuple[Any, ...]:
    """A surface without its isolated points, bounds of their distances, and the nearest with its foot, if any."""
    points = own.isolated
    known = (np.asarray(points.half) > 0) & (np.asarray(points.radius) >= 0) & np.asarray(points.there)
    if not known.any():
        return own, np.inf, np.inf
    center, radius = np.asarray(points.center)[known], np.asarray(points.radius)[known]
    found = SurfaceTarget(other).nearest(center)
    room = gamma(4, center.dtype)
    # Differences round towards either side by less than this share of the larger number.
    lower = np.maximum(found.lower - radius - room * found.lower, 0.0)
    upper = (found.upper + radius) * (1 + room)
    left = points._replace(radius=np.where(known, -np.inf, points.radius), there=np.asarray(points.there) & ~known)
    k = int(np.argmin(upper))
    ends = (center[k], found.foot[k]) if np.isfinite(upper[k]) else ()
    return own._replace(isolated=left), float(np.min(lower)), upper[k], *ends
