"""The proofs of a certificate that shapes are apart of which one at least is a polynomial surface.

As in closest_pairs, pairs of parts are cut until each is proven. Beside planes there are two more proofs: a part of a
surface, a tetrahedron of its box, may be free of zeros; and of a place x of the one part and y of the other

    |x - y|^2 - bound^2 + m f_a(x) + n f_b(y) >= 0

with multipliers m and n that are affine on their parts. It is linear in these: they are found as for the cells of a
cover (surface_multipliers), with the nearest places of the two parts as the tight ones.
"""

from collections.abc import Callable
from fractions import Fraction
from typing import Any, cast

import numpy as np

from jhd.distance.certificate.closest_pairs import between, first_order
from jhd.distance.certificate.covering import UncoveredError
from jhd.distance.certificate.pair_multipliers import pair_multipliers
from jhd.distance.certificate.sides import ShapeSide
from jhd.distance.certificate.surface_side import SurfaceSide
from jhd.distance.certificate.verification.apart import Ordered, PartOfShape, failure_of_plane
from jhd.distance.certificate.verification.pieces import ExactPiece
from jhd.distance.certificate.verification.surface_proofs import failure_of_pair
from jhd.distance.certificate.verification.zeros import ZeroSet, is_free

# Cuts of one piece in a row, after which the bound is given up.
_MOST_CUTS = 50
# Parts into which an exact check may cut a pair here.
_PARTS = 200
# A plane that falls short by this share in floating point is not worth an exact check.
_SURELY = 1e-14
# Pairs between two reports.
_REPORTED = 100


class _SurfaceParts:
    """The parts of one shape.

    Args:
        pieces: of the shape, in integers.
        zeros: its polynomial, if it is a surface.
        side: the shape in floating point; None of a single point.
        is_ordered: whether the pieces may be put into another order.
    """

    def __init__(
        self,
        pieces: list[ExactPiece],
        zeros: ZeroSet | None,
        side: ShapeSide | SurfaceSide | None,
        is_ordered: bool,
    ):
        self.zeros, self.side = zeros, side
        middles = np.array([np.mean(_corners(piece), axis=0) for piece in pieces])
        self.order = first_order(middles) if is_ordered and len(pieces) > 1 else None
        self.exact = Ordered(pieces, self.order)
        self._corners = [_corners(pieces[k]) for k in (self.order or range(len(pieces)))]

    def points(self, part: PartOfShape) -> np.ndarray:
        """Control points whose hull holds the part."""
        if part.box is None:
            return np.concatenate(self._corners[part.first : part.last])
        return np.array([[x / w for x in row] for row, w in self.exact.points(part)])

    def letters(self, part: PartOfShape) -> list[str]:
        """The first letters of all the ways to cut the part."""
        if part.last - part.first > 1:
            return ["x"]
        corners = self.exact.pieces[part.first].corners
        if corners == (3,):
            return ["a", "c", "e"]
        return ["a"] if corners == (4,) else ["a", "c"][: len(corners)]

    def is_free(self, part: PartOfShape) -> bool:
        """Whether it holds no zero."""
        if self.zeros is None or part.last - part.first > 1:
            return False
        points = self.points(part)
        values = cast(SurfaceSide, self.side).values(
            np.concatenate([points, 0.5 * (points[:, None] + points).reshape(-1, 3)])
        )
        return bool(np.min(values) * np.max(values) > 0) and is_free(self.zeros, self.exact.part(part))

    def piece(self, part: PartOfShape) -> int:
        """The number of the only piece."""
        return part.first if self.order is None else self.order[part.first]


def _corners(piece: ExactPiece) -> np.ndarray:
    weights = piece.weight if len(piece.weight) > 1 else piece.weight * len(piece.rows[0])
    return np.array([[x / w for x, w in zip(row, weights, strict=True)] for row in piece.rows], float).T


def parts_of(side: ShapeSide | SurfaceSide, is_ordered: bool = True) -> _SurfaceParts:
    """The parts of a shape in the unit of its arrays."""
    return _SurfaceParts(side.exact, side.zeros if isinstance(side, SurfaceSide) else None, side, is_ordered)


def part_of_point(piece: ExactPiece) -> _SurfaceParts:
    """A point as a shape."""
    return _SurfaceParts([piece], None, None, False)


def keep_surfaces_apart(
    mine: _SurfaceParts,
    other: _SurfaceParts,
    lower: float | Fraction,
    max_cells: int,
    report: Callable[[int, int], None],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The orders of the pieces, and pairs of parts that are all proven to be `lower` apart.

    Raises:
        UncoveredError: too many or too narrow parts would be needed.
    """
    entries: list[dict[str, Any]] = []
    left = [("", mine.exact.whole(), other.exact.whole())]
    while left:
        name, p, q = left.pop()
        proof = _proof(mine, p, other, q, lower)
        if proof is not None:
            entries.append({"pair": name, **proof})
        else:
            left += _halves(name, (mine, p), (other, q))
        if len(entries) + len(left) > max_cells:
            raise UncoveredError(f"more than {max_cells} pairs are needed: raise max_cells, or atol.")
        if len(entries) % _REPORTED == 0:
            report(len(entries), len(left))
    report(len(entries), 0)
    return {"a": mine.order, "b": other.order}, entries


def _proof(
    mine: _SurfaceParts, p: PartOfShape, other: _SurfaceParts, q: PartOfShape, lower: float | Fraction
) -> dict[str, Any] | None:
    for k, (parts, part) in enumerate(((mine, p), (other, q))):
        if parts.is_free(part):
            return {"free": k}
    points = mine.points(p), other.points(q)
    normal = between(*points)
    length = float(np.linalg.norm(normal))
    if length > 0:
        unit = normal / length
        gap = np.min(points[1] @ unit) - np.max(points[0] @ unit)
        if gap >= float(lower) * (1 - _SURELY):
            plane = unit.tolist()
            if failure_of_plane(mine.exact.points(p), other.exact.points(q), plane, lower) is None:
                return {"plane": plane}
    if max(p.last - p.first, q.last - q.first) > 1:
        return None
    parts = mine.exact.part(p), other.exact.part(q)
    first, second = (each.side if isinstance(each.side, SurfaceSide) else None for each in (mine, other))
    zeros = pair_multipliers(parts, (first, second), float(lower))
    if zeros is None:
        return None
    failed = failure_of_pair(parts, (mine.zeros, other.zeros), zeros, lower, _PARTS)
    return {"zeros": zeros} if failed is None else None


def _halves(
    name: str, mine: tuple[_SurfaceParts, PartOfShape], other: tuple[_SurfaceParts, PartOfShape]
) -> list[tuple[Any, ...]]:
    """Both halves of a pair, the first one last, of which the larger part is cut.

    Raises:
        UncoveredError: neither can be cut.
    """
    ways = []
    for (parts, part), capital in ((mine, False), (other, True)):
        used = sum(1 for x in name if x.isupper() == capital and x.lower() not in "xy")
        size = float(np.linalg.norm(np.ptp(parts.points(part), axis=0)))
        if part.last - part.first > 1:
            size *= 8.0
        if used < _MOST_CUTS:
            ways += [(size, parts, part, letter, capital) for letter in parts.letters(part)]
    if not ways:
        raise UncoveredError(f"the pair {name!r} is not proven to be apart.")
    longest = max(way[0] for way in ways)
    best = max((way for way in ways if way[0] == longest), key=_reach)
    _, parts, part, letter, capital = best
    found = []
    for x in (chr(ord(letter) + 1), letter):
        half = parts.exact.half(part, x)
        found.append((name + (x.upper() if capital else x), *((mine[1], half) if capital else (half, other[1]))))
    return found


def _reach(way: tuple[Any, ...]) -> float:
    """How much smaller a cut makes the halves."""
    _, parts, part, letter, _ = way
    halves = [parts.points(parts.exact.half(part, x)) for x in (letter, chr(ord(letter) + 1))]
    return -max(float(np.linalg.norm(np.ptp(points, axis=0))) for points in halves)
