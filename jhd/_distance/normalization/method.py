"""The interface of a method: its fields are options, and it tells which shapes it serves."""

from abc import abstractmethod
from dataclasses import fields
from typing import Any

import equinox as eqx

from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.stopping import Aim
from jhd._results.display import fields_shown
from jhd._results.solution import HausdorffSolution
from jhd._shapes.curve import AbstractCurve, BezierSegments


class AbstractMethod(eqx.Module):
    """Options of a method."""

    @classmethod
    @abstractmethod
    def serves(cls, a: object, b: object) -> bool:
        """Return whether the method can measure this pair of shapes."""


class AbstractHausdorffMethod(AbstractMethod):
    """Options of a method for Hausdorff distances."""

    def __repr__(self) -> str:
        return fields_shown(self, *(field.name for field in fields(self)))


class AbstractCurveMethod(AbstractHausdorffMethod):
    """Options of a method for curves only, which measures a pair of curves in common coordinates."""

    @classmethod
    def serves(cls, a: object, b: object) -> bool:
        """Return whether both are curves."""
        return isinstance(a, AbstractCurve) and isinstance(b, AbstractCurve)

    @abstractmethod
    def _directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """Return the directed distance in the common coordinates, pure and traceable.

        Args:
            a: the source curve, with control points in [-1, 1], off by at most `preparation_error`.
            b: the target curve, prepared in the same way.
            frame: the map back to the coordinates of the user; tolerances are in their unit.
            aim: the range in which the answer matters; a method may ignore it.

        Returns:
            A HausdorffSolution in the common coordinates.
        """


class AbstractHostMethod(AbstractCurveMethod):
    """A method that runs on the host, on concrete curves, not under jit or vmap: its work depends on the numbers."""


def check_serves(method: Any, a: Any, b: Any, known: tuple[type[AbstractMethod], ...]) -> None:
    """Raise TypeError, naming the methods that serve the pair, unless the method serves the shapes."""
    if isinstance(method, known) and method.serves(a, b):
        return
    *names, last = [f"{kind.__name__}()" for kind in known if kind.serves(a, b)]
    serving = f"{', '.join(names)} or {last}" if names else last
    kinds = f"{type(a).__name__} and {type(b).__name__}"
    if isinstance(method, type):
        came = f"the class {method.__name__}: call it"
    elif isinstance(method, int | float):
        came = f"{method}: as a tolerance it is atol={method}"
    else:
        came = type(method).__name__
    raise TypeError(f"method must be {serving} for {kinds}; got {came}.")
