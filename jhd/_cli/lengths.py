"""Numbers of the command line: lengths, which may be percentages of the diagonal of the joint bounding box, and others.

Fractions are those of the whole diagonal; only its printed value is rounded, to four digits.
"""

import argparse
import math
from typing import Any, NamedTuple


class Length(NamedTuple):
    """A length as given on the command line."""

    number: float  # length in input units, or fraction of the diagonal
    of_diagonal: bool  # whether the number is a fraction of the diagonal
    text: str  # text on the command line

    def of(self, *shapes: Any) -> float:
        """The length in input units for these shapes."""
        return self.number * _diagonal(*shapes) if self.of_diagonal else self.number


def length(text: str) -> Length:
    """The length written in a text; argparse adds the name of the option to errors, here and below."""
    number = _number(text, "a length of at least 0 in input units, or a percentage such as 0.1%")
    return Length(number, "%" in text, text.strip())


def fraction(text: str) -> float:
    """The fraction written in a text."""
    return _number(text, "a number of at least 0, or a percentage such as 0.1%")


def seconds(text: str) -> float:
    """The time written in a text."""
    return _number(text, "a positive number of seconds", least=math.ulp(0.0), sign="")


def _number(text: str, needed: str, least: float = 0.0, sign: str = "%") -> float:
    word = text.strip()
    try:
        number = float(word[:-1]) / 100 if sign and word.endswith(sign) else float(word)
    except ValueError:
        number = math.nan
    if not number >= least:
        raise argparse.ArgumentTypeError(f"needs {needed}; got {word!r}")
    return number


def rounded_diagonal(*shapes: Any) -> float:
    """The diagonal of the box of all control points, vertices and boxes, to four digits.

    Raises:
        ValueError: the dimensions of the shapes differ.
    """
    return float(f"{_diagonal(*shapes):.4g}")


def _diagonal(*shapes: Any) -> float:
    # Help names lengths before the package is imported.
    from jhd._distance.search.bodies import diagonal_of
    from jhd._shapes.checks import check_same_dim

    for shape in shapes[1:]:
        check_same_dim(shapes[0].dim, shape.dim)
    return diagonal_of(*shapes)


def share_text(distance: Any, diagonal: float) -> str:
    """A distance as a percentage of the diagonal, to three digits; empty without a diagonal or a distance."""
    share = float(distance) / diagonal if diagonal > 0 else math.nan
    return f"{100 * share:.3g}%" if math.isfinite(share) else ""
