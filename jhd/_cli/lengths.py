"""Lengths of the command line: numbers, or shares of the diagonal of the box of the shapes, as 0.1%.

The diagonal and its shares are rounded to four digits, so that they are read and typed again as they are used.
"""

import math
from typing import Any, NamedTuple

_DIGITS = 4


class Length(NamedTuple):
    """A length as it was given.

    Args:
        number: a length in input units, or a share of the diagonal.
        of_diagonal: whether it is a share.
        text: the words given.
    """

    number: float
    of_diagonal: bool
    text: str

    def of(self, *shapes: Any) -> float:
        """The length in input units beside these shapes."""
        return _rounded(self.number * rounded_diagonal(*shapes)) if self.of_diagonal else self.number


def length(text: str) -> Length:
    """The length that a text says.

    Raises:
        ValueError: the text says none.
    """
    number, sign, rest = text.strip().partition("%")
    if rest:
        raise ValueError(f"{text!r} is no length")
    return Length(float(number) / 100 if sign else float(number), bool(sign), text.strip())


def rounded_diagonal(*shapes: Any) -> float:
    """The diagonal of the box of all control points, vertices and boxes, to four digits.

    Raises:
        ValueError: shapes of different dimensions.
    """
    # Help names lengths before the package is imported.
    from jhd.distance.search.mixes import diagonal_of
    from jhd.shapes.checks import check_same_dim

    for shape in shapes[1:]:
        check_same_dim(shapes[0].dim, shape.dim)
    return _rounded(diagonal_of(*shapes))


def _rounded(x: float) -> float:
    return float(f"{x:.{_DIGITS}g}")


def share_text(distance: Any, diagonal: float) -> str:
    """A distance as a share of the diagonal, to three digits; empty where there is no diagonal or no distance."""
    share = float(distance) / diagonal if diagonal > 0 else math.nan
    return f"{100 * share:.3g}%" if math.isfinite(share) else ""
