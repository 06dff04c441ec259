"""What a Hausdorff method is: fields are its options, and one function answers one direction of a prepared pair."""

from abc import abstractmethod

import equinox as eqx

from jhd.shapes.curve import BezierSegments
from jhd.solution import HausdorffSolution


class AbstractHausdorffMethod(eqx.Module):
    """Options of a method, and how it is carried out on a pair of curves in common scaled coordinates."""

    @abstractmethod
    def directed(self, a: BezierSegments, b: BezierSegments) -> HausdorffSolution:
        """The directed distance, pure and traceable.

        Args:
            a: control points within the unit box about the origin, each coordinate off by at most one unit roundoff.
            b: likewise.
        """
