"""Approximations of shapes with their certified deviation, and their limits."""

from collections.abc import Iterator
from typing import Any, Generic, TypeVar

import equinox as eqx

from jhd._results.display import fields_shown
from jhd._runtime.arrays import is_traced, real_array
from jhd._shapes.checks import Numbers

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


def checked_tolerance(tolerance: Numbers, shape: object, needed: str, pieces: str) -> float:
    """The tolerance of an approximation, a positive number.

    Args:
        tolerance: as passed by the user.
        shape: the shape to approximate.
        needed: start of the message if `shape` or `tolerance` is traced.
        pieces: the parts of the approximation, for the same message.
    """
    if is_traced(shape, tolerance):
        raise TypeError(f"{needed} and tolerance: the number of {pieces} depends on them.")
    value = real_array("tolerance", tolerance)
    if value.shape != () or not float(value) > 0:
        raise ValueError(f"tolerance is {value}; needs one positive number.")
    return float(value)


def check_count(pieces: int, option: str, most: int, tolerance: float) -> None:
    """Raise ValueError if an approximation within the tolerance has more pieces than its option allows."""
    if pieces > most:
        raise ValueError(f"tolerance is {tolerance:g}; needs more than {option} = {most}. Raise one of them.")


def chunks(count: int) -> list[slice]:
    """Slices that divide the rows of cells into chunks: few enough for their numbers to stay close to the processor."""
    return [slice(k, k + 4096) for k in range(0, count, 4096)]
