"""The methods `length` of curves and `area` of parametric surfaces, and the functions behind them.

The functions need cells of searches, so a module of a higher layer adds them when it is imported: jhd._distance.sizes.
"""

from collections.abc import Callable

import equinox as eqx

from jhd._results.batches import Bounds
from jhd._shapes.checks import Numbers

SIZE_OF: dict[str, Callable[..., Bounds]] = {}
"""Functions of a shape and the options of the method, by the name of the method."""


class AbstractHasLength(eqx.Module):
    """A shape with a length."""

    def length(
        self,
        *,
        rtol: Numbers = 1e-6,
        atol: Numbers | None = None,
        max_cells: int = 1 << 18,
        throw: bool = True,
        max_seconds: float | None = None,
    ) -> Bounds:
        """The length of the curve with certified bounds, as `jhd.arc_length` computes them.

        >>> import jhd
        >>> print(f"{jhd.polyline([(0, 0), (3, 4)]).length():.3f}")
        [4.999, 5.001]

        Args:
            rtol: tolerance on `upper - lower`, relative to `upper`.
            atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; by default 1e-12 of the
                diagonal of the bounding box. The larger tolerance counts.
            max_cells: largest number of cells.
            throw: whether to raise NotProvenError if the bounds do not close; by default True.
            max_seconds: wall time in seconds after which no further cells are cut; by default no limit.

        Returns:
            Bounds of the length, in the unit of the coordinates.

        Raises:
            TypeError: the curve is a point set, or it is traced.
            ValueError: an option that is out of range.
            NotProvenError: the bounds do not close, and `throw` is True.
        """
        limits = {"max_cells": max_cells, "max_seconds": max_seconds}
        return SIZE_OF["length"](self, rtol=rtol, atol=atol, throw=throw, **limits)


class AbstractHasArea(eqx.Module):
    """A shape with an area."""

    def area(
        self,
        *,
        rtol: Numbers = 1e-4,
        atol: Numbers | None = None,
        max_cells: int = 1 << 18,
        throw: bool = True,
        max_seconds: float | None = None,
    ) -> Bounds:
        """The area of the surface with certified bounds, as `jhd.surface_area` computes them.

        >>> import jhd
        >>> surface = jhd.BezierPatch([[[0, 0, 0], [0, 2, 0]], [[3, 0, 0], [3, 2, 0]]])
        >>> print(f"{surface.area():.3f}")
        [5.999, 6.001]

        Args:
            rtol: tolerance on `upper - lower`, relative to `upper`.
            atol: absolute tolerance on `upper - lower`, in the square of the unit of the coordinates; by default 1e-12
                of the squared diagonal of the bounding box. The larger tolerance counts.
            max_cells: largest number of cells.
            throw: whether to raise NotProvenError if the bounds do not close; by default True.
            max_seconds: wall time in seconds after which no further cells are cut; by default no limit.

        Returns:
            Bounds of the area, in the square of the unit of the coordinates.

        Raises:
            TypeError: the surface is traced.
            ValueError: an option that is out of range.
            NotProvenError: the bounds do not close, and `throw` is True.
        """
        limits = {"max_cells": max_cells, "max_seconds": max_seconds}
        return SIZE_OF["area"](self, rtol=rtol, atol=atol, throw=throw, **limits)
