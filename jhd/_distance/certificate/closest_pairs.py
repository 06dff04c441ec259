"""The proofs that two shapes are apart: pairs of parts, each with a proof of its own.

The pieces are put into an order in which halves of ranges are neighbors. Each pair of parts is proven by the first of
these that applies, and is cut otherwise:

- One part is a tetrahedron of the box of an implicit surface that is free of zeros.
- A plane keeps the parts apart. Its normal is the direction of the solution, or the shortest vector between the hulls
  of control points, found by Gilbert's steps.
- With the polynomials f_a and f_b of implicit surfaces, and multipliers m and n that are affine on the parts,

      |x - y|^2 - bound^2 + m f_a(x) + n f_b(y) >= 0

  for all points x of the one part and y of the other (see pair_multipliers).

Every proof is checked exactly.

Source: Gilbert, An iterative procedure for computing the minimum of a quadratic form on a convex set (1966).
"""

import math
from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from typing import NamedTuple

import numpy as np
from typing_extensions import override

from jhd._distance.certificate.cutting import Entry, Report, UncoveredError, one_by_one, prove_all
from jhd._distance.certificate.pair_multipliers import pair_multipliers
from jhd._distance.certificate.sides import AbstractPieces
from jhd._distance.certificate.verification.apart import Ordered, PartOfShape, failure_of_plane, whole_box
from jhd._distance.certificate.verification.inequalities import failure_of_pair
from jhd._distance.certificate.verification.pieces import ExactPiece
from jhd._distance.certificate.verification.zeros import ZeroSet

# Points that tell how long a part is.
_SAMPLES = 5
# A plane that falls short by this fraction of the size in floating point is not worth an exact check.
_SURELY = 1e-14


class PointSide(AbstractPieces):
    """A single point in the unit of its coordinates.

    Args:
        exact: the point in integers.
        point: the point in floating point.
    """

    cell_corners, exponent = 1, 0

    def __init__(self, exact: ExactPiece, point: np.ndarray):
        self.exact, self.hulls = [exact], point[None, None]

    @override
    def points(self, piece: np.ndarray, x: np.ndarray) -> np.ndarray:
        return self.hulls[piece, 0]


class _SideParts:
    """The parts of one shape.

    Args:
        side: the shape.
        is_ordered: whether the pieces may be put into another order.
    """

    def __init__(self, side: AbstractPieces, is_ordered: bool):
        self.side, self._hulls = side, side.hulls
        self.order = first_order(self._hulls.mean(axis=1)) if is_ordered and len(self._hulls) > 1 else None
        if self.order is not None:
            self._hulls = self._hulls[self.order]
        self.exact = Ordered(side.exact, self.order)

    def points(self, part: PartOfShape) -> np.ndarray:
        """Return control points whose hull holds the part."""
        if part.box is None:
            return self._hulls[part.first : part.last].reshape(-1, self._hulls.shape[-1])
        return self.side.scaled(np.array([[x / w for x in row] for row, w in self.exact.points(part)]))

    def extent(self, part: PartOfShape) -> float:
        """Return the diagonal of the box of the control points."""
        return float(np.linalg.norm(np.ptp(self.points(part), axis=0)))

    def length(self, part: PartOfShape, letter: str) -> float:
        """Return the length of the part in the direction of a cut."""
        if letter == "x":
            return self.extent(part)
        corners, k = self.exact.pieces[part.first].corners, (ord(letter) - ord("a")) // 2
        if corners == (4,):
            return self.extent(part)
        box = part.box or whole_box(corners)
        if corners == (3,):
            i, j = ((0, 1), (0, 2), (1, 2))[k]
            ends = np.array(box[0]).reshape(3, 2)
            x = np.stack([ends[i], ends[j]])
        else:
            # Along the middle of the box.
            x = np.tile(np.mean(box, axis=1), (_SAMPLES, 1))
            x[:, k] = np.linspace(box[k][0], box[k][1], _SAMPLES)
        piece = part.first if self.order is None else self.order[part.first]
        points = self.side.points(np.full(len(x), piece), x)
        return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=-1)))


def first_order(middles: np.ndarray) -> list[int]:
    """Return the pieces in an order of nested halves, each cut across the longest side of its box."""

    def sorted_rows(rows: np.ndarray) -> Iterator[int]:
        if len(rows) == 1:
            yield int(rows[0])
            return
        x = middles[rows]
        rows = rows[np.argsort(x[:, np.argmax(np.ptp(x, axis=0))], kind="stable")]
        yield from sorted_rows(rows[: len(rows) // 2])
        yield from sorted_rows(rows[len(rows) // 2 :])

    return list(sorted_rows(np.arange(len(middles))))


class _PartPair(NamedTuple):
    """A part of each shape, and the bound in the unit of the stored arrays."""

    name: str
    shapes: tuple[_SideParts, _SideParts]
    parts: tuple[PartOfShape, PartOfShape]
    bound: float | Fraction

    @property
    def zeros(self) -> tuple[ZeroSet | None, ZeroSet | None]:
        """The polynomials of implicit surfaces."""
        return self.shapes[0].side.zeros, self.shapes[1].side.zeros

    def with_part(self, k: int, letter: str) -> "_PartPair | None":
        """Return the pair with a half instead of the part of a or b; None if the part cannot be cut so."""
        half = self.shapes[k].exact.half(self.parts[k], letter)
        if half is None:
            return None
        parts = (half, self.parts[1]) if k == 0 else (self.parts[0], half)
        return self._replace(name=self.name + (letter.upper() if k else letter), parts=parts)


def keep_apart(
    a: AbstractPieces,
    b: AbstractPieces,
    bound: float | Fraction,
    max_cells: int,
    report: Report,
    direction: np.ndarray | None = None,
    is_ordered: bool = True,
) -> tuple[dict[str, list[int] | None], list[Entry]]:
    """Prove that all pairs of parts of two shapes are `bound` apart; return the orders of the pieces, and the proofs.

    Args:
        a: one shape.
        b: the other shape, with the same exponent.
        bound: the bound to prove, above zero, in the unit of the stored arrays.
        max_cells: largest number of pairs before the attempt is given up.
        report: called after each step with the numbers of proven and open pairs.
        direction: approximate shortest vector from a to b, if known.
        is_ordered: whether the pieces may be put into another order.

    Raises:
        UncoveredError: too many or too narrow parts would be needed.
    """
    shapes = _SideParts(a, is_ordered), _SideParts(b, is_ordered)
    whole = _PartPair("", shapes, (shapes[0].exact.whole(), shapes[1].exact.whole()), bound)
    entries = prove_all([whole], one_by_one(partial(_proof, direction), _halves), max_cells, report, "pairs")
    return {"a": shapes[0].order, "b": shapes[1].order}, entries


# ---- proofs --------------------------------------------------------------------------------------


def _proof(direction: np.ndarray | None, pair: _PartPair) -> Entry | None:
    found = _by_freedom(pair) or _by_plane(pair, direction) or _by_zeros(pair)
    return None if found is None else {"pair": pair.name, **found}


def _by_freedom(pair: _PartPair) -> Entry | None:
    for k, (shape, part) in enumerate(zip(pair.shapes, pair.parts, strict=True)):
        if shape.side.zeros is None or part.last - part.first > 1:
            continue
        points = shape.points(part)
        samples = np.concatenate([points, 0.5 * (points[:, None] + points).reshape(-1, 3)])
        if shape.side.is_empty(shape.exact.part(part), samples):
            return {"free": k}
    return None


def _by_plane(pair: _PartPair, direction: np.ndarray | None) -> Entry | None:
    p, q = (shape.points(part) for shape, part in zip(pair.shapes, pair.parts, strict=True))
    limit = float(np.ldexp(float(pair.bound), -pair.shapes[0].side.exponent))
    for normal in (between(p, q),) if direction is None else (direction, between(p, q)):
        length = math.hypot(*normal)
        if length > 0:
            unit = normal / length
            if np.min(q @ unit) - np.max(p @ unit) >= limit * (1 - _SURELY) - _SURELY:
                mine, other = (shape.exact.points(part) for shape, part in zip(pair.shapes, pair.parts, strict=True))
                failed = failure_of_plane(mine, other, unit.tolist(), pair.bound)
                if failed is None:
                    return {"plane": unit.tolist()}
    return None


def between(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Approximate shortest vector from one hull to the other."""
    v = q.mean(axis=0) - p.mean(axis=0)
    # Steps towards the shortest vector between two hulls.
    for _ in range(24):
        support = q[np.argmin(q @ v)] - p[np.argmax(p @ v)]
        step = v - support
        size = float(step @ step)
        share = float(step @ v) / size if size > 0 else 0.0
        if share <= 0:
            break
        v = v - min(share, 1.0) * step
    return v


def _by_zeros(pair: _PartPair) -> Entry | None:
    if pair.zeros == (None, None) or any(part.last - part.first > 1 for part in pair.parts):
        return None
    parts = pair.shapes[0].exact.part(pair.parts[0]), pair.shapes[1].exact.part(pair.parts[1])
    numbers = pair_multipliers(parts, (pair.shapes[0].side, pair.shapes[1].side), float(pair.bound))
    if numbers is None:
        return None
    # Parts into which the exact check of a polynomial may cut a pair here.
    failed = failure_of_pair(parts, pair.zeros, numbers, pair.bound, 200)
    return {"zeros": numbers} if failed is None else None


# ---- cuts ----------------------------------------------------------------------------------------


def _halves(pair: _PartPair) -> list[_PartPair]:
    """Return both halves of a pair after a cut of one part, the first half last.

    Raises:
        UncoveredError: neither part can be cut.
    """
    ways = []
    for k, (shape, part) in enumerate(zip(pair.shapes, pair.parts, strict=True)):
        used = sum(1 for x in pair.name if x.isupper() == (k > 0) and x.lower() not in "xy")
        # Cuts of one piece in a row, after which the bound is given up: floats hold no more.
        ways += [(k, letter) for letter in (_letters(shape.exact, part) if used < 50 else [])]
    if not ways:
        raise UncoveredError(f"no proof is found for the pair {pair.name!r}: pass a larger slack.")
    # How much longer a range of pieces counts next to an implicit surface: multipliers are for single pieces.
    first = 1.0 if pair.zeros == (None, None) else 8.0

    def length(way: tuple[int, str]) -> float:
        return pair.shapes[way[0]].length(pair.parts[way[0]], way[1]) * (first if way[1] == "x" else 1.0)

    k, letter = max(ways, key=length)
    found = (pair.with_part(k, x) for x in (chr(ord(letter) + 1), letter))
    return [half for half in found if half is not None]


def _letters(exact: Ordered, part: PartOfShape) -> list[str]:
    """Return the first letter of each way to cut a part."""
    if part.last - part.first > 1:
        return ["x"]
    corners = exact.pieces[part.first].corners
    if corners == (3,):
        return ["a", "c", "e"]
    # A tetrahedron is always cut at its newest corner.
    return ["a"] if corners == (4,) else ["a", "c"][: len(corners)]
