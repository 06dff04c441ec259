"""A lower bound of the time of a check, from the degrees of the shapes and the number of cells.

A cell has the difference of two shapes on a simplex, of one degree, and its square. Polynomials in k variables of
degree n have T = (n + k - 1 choose k - 1) terms; to compose one and to square one take about T^2 / 2 products for each
coordinate. If the cell is an interval, its ends have the digits of a float, and numbers have n times as many. Halves of
cells, further feet and multipliers take additional time.
"""

from collections.abc import Mapping, Sized
from math import comb
from typing import Any

from jhd._distance.certificate.verification.structure import ShapeSize

# On a fast machine: seconds of a cell, and of a product of short numbers; how many bits take as long again.
_CELL, _PRODUCT, _BITS = 3e-5, 3e-8, 200


def count_of(cells: Any) -> int:
    """Return the number of cells; 0 if it is not known before they are read."""
    return len(cells) if isinstance(cells, Sized) else 0


def expected_seconds(cells: Mapping[str, Any] | None, sizes: Mapping[str, ShapeSize]) -> float:
    """Return the least time in seconds to check the cells of a largest distance.

    Args:
        cells: the cells of each direction.
        sizes: the sizes of `a` and `b`.
    """
    found = [(name, count_of(rows)) for name, rows in (cells or {}).items() if name[0] in sizes and name[-1] in sizes]
    return sum(count * _seconds_of_cell(sizes[name[0]], sizes[name[-1]]) for name, count in found)


def _seconds_of_cell(source: ShapeSize, target: ShapeSize) -> float:
    k, most = source.cell_corners, max(source.degree, target.degree)
    terms = [comb(n + k - 1, k - 1) for n in (source.degree, target.degree, most)]
    bits = 53 * (most if k == 2 else 1)
    return _CELL + _PRODUCT * (1 + bits / _BITS) * source.dim * sum(n * n for n in terms) / 2
