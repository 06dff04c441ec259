"""Cells that cover a shape by construction: simplices in the domains of its pieces, one after the other.

- On a curve they are intervals [t0, t1]. Each begins at the end that the intervals before it have reached, or before
  it.
- Triangles, and patches as two triangles, are cut between two corners, again and again. A cell is named by its cuts,
  one letter for each: `a` and `b` are the halves of a triangle cut between its first two corners, with the first and
  with the second of these; `c` and `d` are the halves of a triangle cut between the first and the third corner, `e` and
  `f` between the second and the third. The middle replaces the corner that is left out. Cells come in the order of the
  letters, so the next cell is known: the other half of the last cut.
- The tetrahedra of the box of a surface are cut in the same way, each in a fixed order of its corners: between the
  first and the last, in the children between the first and the last but one, then between the first and the second, and
  so on; `a` is the half with the first corner.
- A point is its own cell.

Corners of cells are multiples of 2^-52, written as floats, which hold them exactly.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any

from jhd._distance.certificate.verification.pieces import ExactPiece, Map, simplex_map
from jhd._distance.certificate.verification.polynomials import cuts_of
from jhd._distance.certificate.verification.structure import CertificateError

Triangle = tuple[tuple[float, ...], ...]

# For each letter, the corner that stays and the corner that the middle replaces.
_CUTS = {"a": (0, 1), "b": (1, 0), "c": (0, 2), "d": (2, 0), "e": (1, 2), "f": (2, 1)}
# Cuts of one cell: each may add a binary digit to the corners, which floats hold up to here.
MOST_CUTS = 52


def roots(piece: ExactPiece) -> list[Triangle]:
    """Return the triangles in the domain of a piece from which its cells are cut."""
    if piece.corners == (4,):
        return [((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    if piece.corners == (3,):
        return [((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
    return [((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), ((0.0, 0.0), (0.0, 1.0), (1.0, 1.0))]


def half(triangle: Triangle, letter: str, depth: int = 0) -> Triangle:
    """Return the half named by a letter, of a triangle, or of a tetrahedron after `depth` cuts."""
    if len(triangle) == 4:
        kept, moved, order = cuts_of((0, 1, 2, 3), depth)["ab".index(letter)]
    else:
        (kept, moved), order = _CUTS[letter], (0, 1, 2)
    corners = list(triangle)
    corners[moved] = tuple(0.5 * (x + y) for x, y in zip(triangle[kept], triangle[moved], strict=True))
    return tuple(corners[k] for k in order)


def cover(
    place: str, pieces: Sequence[ExactPiece], entries: Iterable[Mapping[str, Any]]
) -> Iterator[tuple[Any, str, Map]]:
    """Yield the entries with their names and cells, each cell as a map of a simplex into the domain of its piece.

    Raises:
        CertificateError: the next entry does not continue the cover, or entries are left at the end.
    """
    numbered = _Numbered(place, entries)
    for index, piece in enumerate(pieces):
        if not piece.corners:
            entry = numbered.next_of(index)
            _check_cell(numbered, entry, None)
            yield entry, numbered.name, simplex_map(piece, 1, [[]])
        elif piece.corners == (2,):
            yield from _intervals(numbered, index, piece)
        else:
            for number, root in enumerate(roots(piece)):
                yield from _triangles(numbered, index, piece, root, str(number) if len(roots(piece)) > 1 else "")
    numbered.end()


class _Numbered:
    """The entries one by one, with the name of the last one."""

    def __init__(self, place: str, entries: Iterable[Mapping[str, Any]]):
        self.place, self.entries, self.count, self.ahead = place, iter(entries), -1, None

    @property
    def name(self) -> str:
        """Name of the last entry."""
        return f"{self.place}[{self.count}]"

    def next_of(self, piece: int) -> Mapping[str, Any]:
        """Return the next entry, which must belong to the piece."""
        entry = self.peek()
        if entry is None or entry["piece"] != piece:
            found = "there is no further cell" if entry is None else f"piece is {entry['piece']}"
            raise CertificateError(f"{self.place}[{self.count + 1}]: {found}; piece {piece} is not covered.")
        self.count, self.ahead = self.count + 1, None
        return entry

    def peek(self) -> Mapping[str, Any] | None:
        """Return the next entry without taking it; None at the end."""
        if self.ahead is None:
            self.ahead = next(self.entries, None)
        return self.ahead

    def end(self) -> None:
        """Raise CertificateError if entries are left."""
        if self.peek() is not None:
            raise CertificateError(f"{self.place}[{self.count + 1}]: everything is covered already.")


def _check_cell(numbered: _Numbered, entry: Mapping[str, Any], wanted: Any) -> None:
    if entry["cell"] != wanted:
        raise CertificateError(f"{numbered.name}.cell is {repr(entry['cell'])}; the next one is {repr(wanted)}.")


def _intervals(numbered: _Numbered, index: int, piece: ExactPiece) -> Iterator[tuple[Any, str, Map]]:
    reached, follows = 0.0, True
    while reached < 1 or follows:
        entry = numbered.next_of(index)
        cell = entry["cell"]
        if not isinstance(cell, list):
            raise CertificateError(f"{numbered.name}.cell is {repr(cell)}; needs the ends of an interval.")
        if cell[0] > reached:
            hole = f"between {reached!r} and {cell[0]!r}"
            raise CertificateError(f"{numbered.name} leaves piece {index} uncovered {hole}.")
        reached = max(reached, cell[1])
        yield entry, numbered.name, simplex_map(piece, 2, [[cell[0]], [cell[1]]])
        ahead = numbered.peek()
        follows = ahead is not None and ahead["piece"] == index


def _triangles(
    numbered: _Numbered, index: int, piece: ExactPiece, root: Triangle, prefix: str
) -> Iterator[tuple[Any, str, Map]]:
    """Yield the cells of a triangle, whose names all begin with the prefix."""
    left: list[tuple[str, Triangle]] = [(prefix, root)]
    letters, start = "a" if len(root) == 4 else "ace", len(prefix)
    while left:
        name, triangle = left.pop()
        entry = numbered.next_of(index)
        cell = entry["cell"]
        if not isinstance(cell, str) or not cell.startswith(name):
            raise CertificateError(f"{numbered.name}.cell is {repr(cell)}; the next one begins with {name!r}.")
        if len(cell) > MOST_CUTS:
            raise CertificateError(f"{numbered.name}.cell has {len(cell)} cuts; needs at most {MOST_CUTS}.")
        for letter in cell[len(name) :]:
            if letter not in letters:
                raise CertificateError(
                    f"{numbered.name}.cell is {repr(cell)}: at {repr(letter)} a half before it is left out."
                )
            other = chr(ord(letter) + 1)
            depth = len(name) - start
            left.append((name + other, half(triangle, other, depth)))
            name, triangle = name + letter, half(triangle, letter, depth)
        yield entry, numbered.name, simplex_map(piece, len(root), triangle)
