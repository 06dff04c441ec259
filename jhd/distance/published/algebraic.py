"""Every candidate event by a solver of polynomial systems: the method of Elber & Grandine, for plane curves.

The maximum over a of the distance to b lies at an end of a segment of a, or at one of finitely many events: an
antipodal pair, a normal of a through an end of b, or two equally near feet. All systems of equations of these events
are solved (`jhd.distance.published.events`), with feet that may be far from the nearest, so there are many more events
than maxima.
Each event is refined by Newton's method and measured by the proven nearest point; the farthest one wins.

Sources: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008; it is
the method without trimming that Kim et al. 2010 compare theirs with.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array

from jhd._results.solution import HausdorffSolution
from jhd._runtime.arrays import check_scalar, check_whole, real_array
from jhd.distance.frame.aim import Aim
from jhd.distance.frame.coordinates import Frame
from jhd.distance.frame.method import AbstractHostMethod
from jhd.distance.published.events.candidates import Search, candidate_events
from jhd.distance.published.events.host_pair import HostPair, check_served
from jhd.distance.published.events.survivors import EventPieces
from jhd.distance.published.farthest import best_of
from jhd.shapes.curve import BezierSegments

# Default size of final boxes, as a share of the extent of the pair; Newton's method goes on from there.
_FINAL = 1e-8


class AlgebraicEvents(AbstractHostMethod):
    """Solves for all candidate events; for polynomial curves in the plane whose control points are known.

    Changes to the source:

     - The trivial solutions, two feet that are one, are left out by divided differences and tests at joints.
     - Free ends and corners of b are segments of one point, so events there have the same equations.
     - Every event is measured by the proven nearest point of all of b.
     - Curves of roots are reported as intervals of distances.

    `value` is the largest proven distance of all candidates and `lower` the proven bound of it. `upper` is infinite:
    the solver drops a box only where rounding allows it, but that no event is missed where the tangents of b differ by
    rounding at a joint is not proven.

    `stats`: `pairs` of segments looked at, `boxes` examined by the solver, `candidates` (boxes that it ended with, and
    ends of segments), `roots` (candidates that are isolated roots, double ones included) and `unresolved`: boxes on
    curves of roots, where equations vanish along a stretch. Those are no roots; the distances there lie between
    `unresolved_lower` and `unresolved_upper`, in the unit of the coordinates. Where they may exceed the value by more
    than `atol` the result is gap_not_closed; where max_boxes was reached it is capacity_reached.

    Args:
        atol: size of final boxes in space, in the unit of the coordinates, before Newton's method; by default 1e-8 of
            the largest half extent of the pair, between one and two times.
        capacity: open boxes of one system at which it counts as one with a curve of roots.
        max_boxes: most boxes examined in all.

    Raises:
        ValueError: a negative atol, or numbers too small.
    """

    atol: Array | None = eqx.field(default=None, converter=lambda x: None if x is None else real_array("atol", x))
    capacity: int = eqx.field(static=True, default=256)
    max_boxes: int = eqx.field(static=True, default=2**23)

    def __check_init__(self) -> None:
        check_scalar("atol", self.atol)
        check_whole("capacity", self.capacity, 16)
        check_whole("max_boxes", self.max_boxes, 0)

    def directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """One direction in common coordinates.

        Raises:
            TypeError: rational segments, curves in space, or control points that are traced.
        """
        check_served(type(self).__name__, a, b)
        pair = HostPair.of(a, b)
        count = pair.a.moving
        side = np.broadcast_to(np.array([[0.0], [1.0]]), (2, count))
        whole = EventPieces(np.arange(count), side, np.broadcast_to(np.array([[0.0], [np.inf]]), (2, count)))
        search = Search(final_size(self.atol, frame), self.capacity, self.max_boxes)
        candidates, stats = candidate_events(pair, whole, search)
        return best_of(pair, candidates, None, stats, search, frame)


def final_size(atol: Array | None, frame: Frame) -> float:
    """The size of final boxes in common coordinates, not below what parameters resolve."""
    return _FINAL if atol is None else max(float(frame.common(np.asarray(atol))), 1e-13)
