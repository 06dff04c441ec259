"""A collection of shapes of any kinds: checked once, in the form for searches, with their extents."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from jhd._distance.collections.blocks import CurveRows, PairKind, row_of
from jhd._distance.normalization.coordinates import extremes
from jhd._runtime.arrays import is_tracing
from jhd._shapes.as_shape import as_shape, check_several
from jhd._shapes.curve import AbstractCurve, BezierSegments

# Bytes of padded curves that a collection keeps: enough for ten thousand outlines of one size, not of all sizes.
_KEPT = 1 << 25


class Collection:
    """Shapes of one dimension, in the order given.

    Args:
        name: its name in errors.
        shapes: shapes, or objects that jhd.as_shape accepts.

    Raises:
        TypeError: something that is no shape, or traced arrays.
        ValueError: no shape, or shapes of the plane and of space.
    """

    def __init__(self, name: str, shapes: Iterable[Any]):
        check_several(name, shapes)
        self.shapes = [_working(f"{name}[{k}]", shape) for k, shape in enumerate(shapes)]
        if not self.shapes:
            raise ValueError(f"{name} is empty; needs at least one shape.")
        if is_tracing(self.shapes):
            raise TypeError(f"{name} must be concrete shapes: collections are searched from the host, not under jit.")
        self.dim = self.shapes[0].dim
        for k, shape in enumerate(self.shapes):
            if shape.dim != self.dim:
                raise ValueError(
                    f"{name}[{k}] has {shape.dim} coordinates and {name}[0] has {self.dim}; needs the same."
                )
        self.corners = [_corners(shape) for shape in self.shapes]
        self._rows: dict[tuple[int, PairKind], CurveRows] = {}
        self._bytes = 0

    def __len__(self) -> int:
        return len(self.shapes)

    def row(self, k: int, kind: PairKind) -> CurveRows:
        """Return a curve in the form for compiled functions."""
        found = self._rows.get((k, kind))
        if found is None:
            found = row_of(self.shapes[k], kind)
            size = sum(x.nbytes for x in found if x is not None)
            if self._bytes + size > _KEPT:
                self._rows.clear()
                self._bytes = 0
            self._rows[k, kind] = found
            self._bytes += size
        return found


def both_collections(name: str, shapes: Any, other_name: str, others: Any) -> tuple[Collection, Collection]:
    """Return two collections of one dimension; the first one twice if the second is None.

    Raises:
        TypeError: see Collection.
        ValueError: see Collection.
    """
    a = Collection(name, shapes)
    b = a if others is None else Collection(other_name, others)
    if a.dim != b.dim:
        raise ValueError(f"{name} has shapes of {a.dim} coordinates and {other_name} of {b.dim}; needs the same.")
    return a, b


def _working(name: str, value: Any) -> Any:
    try:
        shape: Any = as_shape(value)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{name}: {error}") from error
    return shape.segments() if isinstance(shape, AbstractCurve) else shape


def _corners(shape: Any) -> tuple[np.ndarray, np.ndarray]:
    if isinstance(shape, BezierSegments):
        return extremes(np.asarray(shape.control_points))
    low, high = shape.bounds
    return np.asarray(low), np.asarray(high)
