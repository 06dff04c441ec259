"""Two shapes kept apart: pairs of parts that cover all pairs of points, with a plane between the parts of each.

A part is a range of pieces, in an order that the certificate gives, or a part of one piece. Again and again one of the
parts of a pair is cut into halves. A pair is named by its cuts: small letters for the part of a, capital letters for
the part of b.

- `x` and `y` are the halves of a range. If the number of pieces is odd, the first half has one piece less.
- `a` and `b` are the halves of the first interval in the domain of a piece, `c` and `d` the halves of the second.
- Triangles, and the tetrahedra of an implicit surface, are cut as in `cells`.

Pairs come in the order of the letters, so that the next one is known and nothing is left out.

A plane with normal n keeps two parts a distance apart if n.x is at most m at all control points of one part and at
least M at all control points of the other part, with M - m at least that distance times the length of n: the parts lie
in the hulls of these points. A part of an implicit surface may also be free of zeros, or the distance may be proven for
zeros only (`inequalities`).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any, NamedTuple

from jhd._distance.certificate.verification.cells import MOST_CUTS, half
from jhd._distance.certificate.verification.pieces import ExactPiece, Part, box_map, composed, integers
from jhd._distance.certificate.verification.polynomials import elevated
from jhd._distance.certificate.verification.structure import CertificateError

# For each simplex of the domain of a piece, its corners: the box that is cut.
Box = tuple[tuple[float, ...], ...]
# Homogeneous coordinates: a point times a weight, and the weight.
Homogeneous = tuple[tuple[int, ...], int]


class PartOfShape(NamedTuple):
    """A range of pieces in their order, or a box of the domain of a single piece, with the number of its cuts."""

    first: int
    last: int
    box: Box | None
    depth: int = 0


class Ordered:
    """The pieces of a shape in an order, and the control points of their parts.

    Args:
        pieces: the pieces.
        order: their indices, each once; None is the order in which they stand.
    """

    def __init__(self, pieces: Sequence[ExactPiece], order: Sequence[int] | None):
        self.pieces = pieces if order is None else [pieces[k] for k in order]
        self._points: dict[int, list[Homogeneous]] = {}

    def whole(self) -> PartOfShape:
        """Return the whole shape."""
        return PartOfShape(0, len(self.pieces), None)

    def half(self, part: PartOfShape, letter: str) -> PartOfShape | None:
        """Return the half named by a small letter; None if the part cannot be cut so."""
        if letter in "xy":
            middle = (part.first + part.last) // 2
            if part.last - part.first < 2:
                return None
            return PartOfShape(*((part.first, middle) if letter == "x" else (middle, part.last)), None)
        if part.last - part.first > 1:
            return None
        corners = self.pieces[part.first].corners
        box = part.box or whole_box(corners)
        cut = _half_of(corners, box, letter, part.depth)
        return None if cut is None else PartOfShape(part.first, part.last, cut, part.depth + 1)

    def points(self, part: PartOfShape) -> Iterator[Homogeneous]:
        """Return control points whose hull holds the part."""
        if part.box is None:
            for k in range(part.first, part.last):
                if k not in self._points:
                    self._points[k] = _points_of(self.pieces[k])
                yield from self._points[k]
            return
        yield from points_of_part(self.part(part))

    def part(self, part: PartOfShape) -> Part:
        """Return a part of a single piece."""
        piece = self.pieces[part.first]
        return composed(piece, box_map(piece, part.box or whole_box(piece.corners)))


def whole_box(corners: tuple[int, ...]) -> Box:
    """Return the whole domain as a box."""
    return tuple(tuple(float(i == k + 1) for i in range(count) for k in range(count - 1)) for count in corners)


def _half_of(corners: tuple[int, ...], box: Box, letter: str, depth: int) -> Box | None:
    """Return the half of a box in the domain of a piece that a letter names; None if there is none."""
    if corners in ((3,), (4,)):
        if letter not in ("abcdef" if corners == (3,) else "ab"):
            return None
        size = corners[0] - 1
        found = half(tuple(box[0][k : k + size] for k in range(0, len(box[0]), size)), letter, depth)
        return (tuple(number for corner in found for number in corner),)
    k, second = divmod(ord(letter) - ord("a"), 2)
    if not 0 <= k < len(corners):
        return None
    low, high = box[k]
    middle = 0.5 * (low + high)
    return (*box[:k], (middle, high) if second else (low, middle), *box[k + 1 :])


def _points_of(piece: ExactPiece) -> list[Homogeneous]:
    weights = piece.weight if len(piece.weight) > 1 else piece.weight * len(piece.rows[0])
    return list(zip(zip(*piece.rows, strict=True), weights, strict=True))


def points_of_part(part: Part) -> list[Homogeneous]:
    """Return the control points of a part of a piece."""
    weights = elevated(part.weight, part.domain, part.weight_degree, part.degree)
    return [(tuple(f.get(i, 0) for f in part.coordinates), w) for i, w in weights.items()]


def failure_of_plane(
    mine: Iterable[Homogeneous], others: Iterable[Homogeneous], normal: Sequence[float], bound: float | Fraction
) -> str | None:
    """Return why a plane does not keep the hulls of two point sets `bound` apart; None if it does."""
    n, _ = integers(normal)
    gap = min(_heights(n, others)) - max(_heights(n, mine))
    if gap < 0 or gap * gap < Fraction(bound) ** 2 * sum(x * x for x in n):
        return "is not proven by the plane"
    return None


def _heights(normal: Sequence[int], points: Iterable[Homogeneous]) -> Iterator[Fraction]:
    for x, w in points:
        yield Fraction(sum(p * q for p, q in zip(normal, x, strict=True)), w)


def pairs(
    place: str, a: Ordered, b: Ordered, entries: Iterable[Mapping[str, Any]]
) -> Iterator[tuple[Any, str, PartOfShape, PartOfShape]]:
    """Yield the entries with their names and parts.

    Raises:
        CertificateError: the next entry does not continue the cuts, or entries are left at the end.
    """
    left = [("", a.whole(), b.whole())]
    numbered = iter(entries)
    count = 0
    while left:
        done, mine, other = left.pop()
        name, entry = f"{place}[{count}]", next(numbered, None)
        if entry is None:
            raise CertificateError(f"{name}: there is no further pair; what begins with {repr(done)} is left.")
        letters = entry["pair"]
        if not letters.startswith(done):
            raise CertificateError(f"{name}.pair is {repr(letters)}; the next one begins with {repr(done)}.")
        # Cuts of one pair, of ranges too.
        if len(letters) > 160 or any(_cuts(letters, kind) > MOST_CUTS for kind in (str.islower, str.isupper)):
            raise CertificateError(f"{name}.pair has {len(letters)} cuts; needs fewer.")
        for letter in letters[len(done) :]:
            beside = chr(ord(letter) + 1)
            halves = [_cut(a, b, mine, other, x) for x in (letter, beside)] if letter in "xaceXACE" else [None]
            if halves[0] is None or halves[1] is None:
                raise CertificateError(f"{name}.pair is {repr(letters)}: {repr(letter)} is no first half there.")
            left.append((done + beside, *halves[1]))
            done, (mine, other) = done + letter, halves[0]
        yield entry, name, mine, other
        count += 1
    if next(numbered, None) is not None:
        raise CertificateError(f"{place}[{count}]: everything is covered already.")


def _cuts(letters: str, kind: Any) -> int:
    """Return how often a piece of shape a or b is cut."""
    return sum(1 for letter in letters if kind(letter) and letter not in "xyXY")


def _cut(
    a: Ordered, b: Ordered, mine: PartOfShape, other: PartOfShape, letter: str
) -> tuple[PartOfShape, PartOfShape] | None:
    if letter.islower():
        found = a.half(mine, letter)
        return None if found is None else (found, other)
    found = b.half(other, letter.lower())
    return None if found is None else (mine, found)
