"""All candidate events by a solver of polynomial systems: the method of Elber & Grandine, for plane curves.

The maximum over a of the distance to b lies at an end of a segment of a, or at one of finitely many events: an
antipodal pair, a normal of a through an end of b, or two equally near foot points. The method solves all systems of
equations of these events (`jhd._distance.published.events`). Their foot points may be far from the nearest one, so
there are many more events than maxima. Each event is refined by Newton's method and measured by the certified nearest
point; the farthest one wins.

Sources: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008. Kim et
al. 2010 compare their method with this method without trimming.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array
from typing_extensions import override

from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.method import AbstractHostMethod
from jhd._distance.normalization.stopping import Aim
from jhd._distance.published.events.candidates import Search, candidate_events
from jhd._distance.published.events.host_pair import HostPair, check_served
from jhd._distance.published.events.survivors import EventPieces
from jhd._distance.published.farthest import best_of
from jhd._results.solution import HausdorffSolution
from jhd._runtime.arrays import check_scalar, check_whole
from jhd._shapes.checks import optional_array
from jhd._shapes.curve import BezierSegments


class AlgebraicEvents(AbstractHostMethod):
    """Hausdorff distance of polynomial plane curves by solving for all candidate events; not under jit.

    Changes to the source, Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and
    R^3, GMP 2008:

     - Divided differences and tests at joints remove the trivial solutions, in which both foot points coincide.
     - Free ends and corners of b are segments of one point, so their events have the same equations.
     - Every event is measured by the certified nearest point of all of b.
     - Curves of roots are reported as intervals of distances.

    `value` is the largest certified distance of all candidates, and `lower` is its certified lower bound. `upper` is
    infinite. The solver discards a box only if rounding allows it. However, it is not proven that no event is missed if
    the tangents of b differ by rounding at a joint.

    `stats` counts `pairs` of segments, `boxes` examined, `candidates` (final boxes, and ends of segments).
    `roots` counts the candidates that are isolated roots, double ones included. `unresolved` counts boxes on curves of
    roots, on which the equations vanish along a stretch. Their distances lie between `unresolved_lower` and
    `unresolved_upper`, in the unit of the coordinates. If they may exceed the value by more than `box_size`, the result
    is gap_not_closed. If `max_boxes` is reached, it is capacity_reached.

    Use it as `jhd.directed_hausdorff(a, b, jhd.published.AlgebraicEvents())`.

    Args:
        box_size: size of the final boxes in space before Newton's method, in the unit of the coordinates; by default
            1e-8 of the largest half extent of the pair, up to a factor of two.
        capacity: number of open boxes of one system from which it counts as a system with a curve of roots.
        max_boxes: largest number of boxes examined in all.

    Raises:
        ValueError: a negative `box_size`, or a count that is too small.
    """

    box_size: Array | None = eqx.field(default=None, converter=optional_array("box_size"))
    capacity: int = eqx.field(static=True, default=256)
    max_boxes: int = eqx.field(static=True, default=2**23)

    def __check_init__(self) -> None:
        check_scalar("box_size", self.box_size)
        check_whole("capacity", self.capacity, 16)
        check_whole("max_boxes", self.max_boxes, 0)

    @override
    def _directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        check_served(type(self).__name__, a, b)
        pair = HostPair.of(a, b)
        count = pair.a.moving
        side = np.broadcast_to(np.array([[0.0], [1.0]]), (2, count))
        whole = EventPieces(np.arange(count), side, np.broadcast_to(np.array([[0.0], [np.inf]]), (2, count)))
        search = Search(final_size(self.box_size, frame), self.capacity, self.max_boxes)
        candidates, stats = candidate_events(pair, whole, search)
        return best_of(pair, candidates, None, stats, search, frame)


def final_size(box_size: Array | None, frame: Frame) -> float:
    """Return the size of final boxes in common coordinates, not below the resolution of parameters."""
    # Default size of final boxes, as a fraction of the extent of the pair; Newton's method continues from there.
    return 1e-8 if box_size is None else max(float(frame.common(np.asarray(box_size))), 1e-13)
