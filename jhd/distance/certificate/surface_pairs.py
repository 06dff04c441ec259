"""The proofs of a certificate that shapes are apart of which one at least is a polynomial surface.

As in closest_pairs, pairs of parts are cut until each is proven. Beside planes there are two more proofs: a part of a
surface, a tetrahedron of its box, may be free of zeros; and of a place x of the one part and y of the other

    |x - y|^2 - bound^2 + m f_a(x) + n f_b(y) >= 0

with multipliers m and n that are affine on their parts. It is linear in these: they are found as for the cells of a
cover (surface_multipliers), with the nearest places of the two parts as the tight ones.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any, cast

import numpy as np

from jhd.distance.certificate.closest_pairs import PairCut, between, first_order, proven_apart
from jhd.distance.certificate.pair_multipliers import pair_multipliers
from jhd.distance.certificate.sides import ShapeSide
from jhd.distance.certificate.surface_side import SurfaceSide
from jhd.distance.certificate.verification.apart import Ordered, PartOfShape, failure_of_plane
from jhd.distance.certificate.verification.pieces import ExactPiece
from jhd.distance.certificate.verification.surface_proofs import failure_of_pair
from jhd.distance.certificate.verification.zeros import ZeroSet, is_free

# Parts into which an exact check may cut a pair here.
_PARTS = 200
# A plane that falls short by this share in floating point is not worth an exact check.
_SURELY = 1e-14


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
    return proven_apart((mine, other), partial(_proof, lower), _largest, max_cells, report)


def _proof(
    lower: float | Fraction, mine: _SurfaceParts, p: PartOfShape, other: _SurfaceParts, q: PartOfShape
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


def _largest(ways: list[PairCut]) -> PairCut:
    """A cut of the larger part: of several pieces if there are any, else the one that makes the halves smallest."""

    def size(way: PairCut) -> float:
        return _extent(way.parts.points(way.part)) * (8.0 if way.part.last - way.part.first > 1 else 1.0)

    sizes = {way.is_second: size(way) for way in ways}
    largest = max(sizes.values())
    return min(
        (way for way in ways if sizes[way.is_second] == largest),
        key=lambda way: max(_extent(way.parts.points(half)) for _, half in way.halves()),
    )


def _extent(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))
