"""The loop that proves all parts of a shape or of a pair of shapes, and the halves of parts without a proof."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from jhd._distance.certificate.verification.cells import half, roots
from jhd._distance.certificate.verification.pieces import ExactPiece
from jhd._distance.certificate.verification.polynomials import exponents

# A cell or a pair of parts in the form of certificates.
Entry = dict[str, Any]
# Called with the numbers of proven and of open parts.
Report = Callable[[int, int], None]

# The letters of the halves of a triangle, for each pair of corners between which it is cut.
_LETTERS = {(0, 1): "ab", (0, 2): "cd", (1, 2): "ef"}


class UncoveredError(Exception):
    """Not all parts are proven; the message says why, and what to do."""

    @classmethod
    def far(cls, piece: int, x: np.ndarray) -> "UncoveredError":
        """Return the error for a point at parameters of a piece that is farther away than the bound."""
        return cls(
            f"the point of piece {piece} at parameters {x.tolist()} is farther from the other shape than this bound. "
            "Pass the solution of these two shapes in this order, or a larger slack."
        )

    @classmethod
    def narrow(cls, piece: int, x: np.ndarray) -> "UncoveredError":
        """Return the error for a cell that is not proven and cannot be cut."""
        return cls(f"no proof is found near piece {piece} at parameters {x.tolist()}: pass a larger slack.")


# One or more parts that are not proven yet.
Open = TypeVar("Open")
# The entries that are proven in one step, and the open parts that are left of those taken.
Step = tuple[list[Entry], list[Open]]


def prove_all(
    first: list[Open],
    step: Callable[[Open], Step[Open]],
    max_cells: int,
    report: Report,
    noun: str = "cells",
    size: Callable[[Open], int] = lambda part: 1,
) -> list[Entry]:
    """Return the entries that prove all parts.

    Args:
        first: the parts at the beginning.
        step: proves parts, and cuts those without a proof.
        max_cells: largest number of entries before the attempt is given up.
        report: called after each step with the numbers of proven and of open parts.
        noun: what the parts are called in messages.
        size: returns the number of parts in one of the list.

    Raises:
        UncoveredError: too many parts would be needed.
    """
    left, entries = first, []
    waiting = sum(map(size, left))
    while left:
        taken = left.pop()
        proven, opened = step(taken)
        entries += proven
        left += opened
        waiting += sum(map(size, opened)) - size(taken)
        if len(entries) + waiting > max_cells:
            raise UncoveredError(f"more than {max_cells} {noun} are needed: raise max_cells, or pass a larger slack.")
        report(len(entries), waiting)
    return entries


def one_by_one(
    prove: Callable[[Open], Entry | None], cut: Callable[[Open], list[Open]]
) -> Callable[[Open], Step[Open]]:
    """Return a step that proves one part, or cuts it."""

    def step(part: Open) -> Step[Open]:
        entry = prove(part)
        return ([], cut(part)) if entry is None else ([entry], [])

    return step


def in_order(entries: list[Entry]) -> list[Entry]:
    """Return the cells in the order of certificates."""
    return sorted(entries, key=lambda entry: (entry["piece"], entry["cell"] or []))


def first_cells(exact: ExactPiece, corners: int) -> list[tuple[str, np.ndarray]]:
    """Return names and parameters of the first cells of a piece; of a patch, two triangles."""
    if corners < 3:
        return [("", np.linspace(0.0, 1.0, corners)[:, None][:, : exact.parameters])]
    simplices = roots(exact)
    return [(str(k) if len(simplices) > 1 else "", np.array(x)) for k, x in enumerate(simplices)]


def cell_name(name: str, x: np.ndarray) -> str | list[float] | None:
    """Return a cell in the form of certificates: its name, the ends of an interval, or None for a whole piece."""
    return name if len(x) > 2 else x[:, 0].tolist() if len(x) == 2 else None


def grid(corners: int, degree: int) -> np.ndarray:
    """Return barycentric coordinates of samples of a cell, (samples, corners)."""
    return np.array(exponents(corners, degree), float) / degree


def shortest(x: np.ndarray) -> list[list[float]]:
    """Return the rows of a map; one row if all are equal."""
    return x[:1].tolist() if np.all(x == x[0]) else x.tolist()


def longest_side(points: np.ndarray) -> str:
    """Return the letters of the halves between the farthest corners; a tetrahedron is cut at its newest corner."""
    pairs = list(_LETTERS) if len(points) == 3 else [(0, 1)]
    return _LETTERS[max(pairs, key=lambda pair: float(np.sum((points[pair[0]] - points[pair[1]]) ** 2)))]


def half_of_cell(x: np.ndarray, letter: str, depth: int = 0) -> np.ndarray:
    """Return the half, named by `letter`, of a cell with these parameters of its corners and number of cuts."""
    if len(x) > 2:
        return np.array(half(tuple(map(tuple, x.tolist())), letter, depth))
    middle = 0.5 * (x[0] + x[1])
    return np.array([x[0], middle] if letter == "a" else [middle, x[1]])
