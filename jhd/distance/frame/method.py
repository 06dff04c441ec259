"""What a Hausdorff method is: fields are its options, and one function answers one direction of a prepared pair."""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx

from jhd.distance.frame.prepare import Frame
from jhd.shapes.curve import BezierSegments
from jhd.solution import HausdorffSolution


class Aim(NamedTuple):
    """What of a distance matters, in the common coordinates: nothing up to `level`, nothing more above `ceiling`."""

    level: Any
    ceiling: Any


class AbstractHausdorffMethod(eqx.Module):
    """Options of a method, and how it is carried out on a pair of curves in common scaled coordinates."""

    @abstractmethod
    def directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """The directed distance in the common coordinates, pure and traceable.

        Args:
            a: control points with coordinates in [-1, 1], off by at most `preparation_error`.
            b: likewise.
            frame: leads back to the user's coordinates; tolerances are in their unit.
            aim: what of the answer matters; a method may ignore it.
        """


class AbstractHostMethod(AbstractHausdorffMethod):
    """A method whose work depends on the numbers: it runs on the host, on known curves only, not under jit or vmap."""
