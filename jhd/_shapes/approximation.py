"""Approximations of shapes with their certified deviation."""

from collections.abc import Iterator
from typing import Any, Generic, TypeVar

import equinox as eqx

from jhd._results.display import fields_shown

Approximating = TypeVar("Approximating")


class Approximation(eqx.Module, Generic[Approximating]):
    """An approximation of a shape with a certified deviation; unpack it as `shape, deviation = ...`.

    Args:
        shape: the approximation: a `BezierSegments` or a `TriangleMesh`.
        deviation: certified bound of the Hausdorff distance between the approximation and the original, in both
            directions, in the unit of the coordinates.
    """

    shape: Approximating
    deviation: float

    def __repr__(self) -> str:
        return fields_shown(self, "shape", "deviation")

    def __iter__(self) -> Iterator[Any]:
        return iter((self.shape, self.deviation))
