"""The proofs of a certificate of a minimum distance: pairs of parts with planes between them, a place on each shape.

Pieces are put into an order in which halves of ranges lie beside each other. A pair of parts is kept apart by a plane
whose normal is that of the solution, or the shortest vector between the hulls of control points, as Gilbert's steps
find it; a pair for which neither is enough is cut, the larger part of it. Every plane is checked exactly.

Source: Gilbert, An iterative procedure for computing the minimum of a quadratic form on a convex set (1966).
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from jhd.distance.certificate.sides import ShapeSide, on_triangle
from jhd.distance.certificate.subdivision import UncoveredError
from jhd.distance.certificate.verification.apart import Ordered, PartOfShape, failure_of_plane, whole_box
from jhd.distance.certificate.verification.pieces import difference
from jhd.distance.certificate.verification.proofs import failure_at_most, point_of

# Places that tell how long a part is.
_SAMPLES = 5
# Steps towards the shortest vector between two hulls.
_STEPS = 24
# Cuts of one piece in a row, after which the bound is given up: floats hold no more.
_MOST_CUTS = 50
# A plane that falls short by this share of the size in floating point is not worth an exact check.
_SURELY = 1e-14
# Steps in turn from a foot on one shape to that on the other.
_ROUNDS = 6
# Points of a shape are this near to their feet, in units of the largest coordinate.
_ON_SHAPE = 1e-9
# Pairs between two reports.
_REPORTED = 100


class _PartsInFloats:
    """The parts of one shape with their control points in floating point.

    Args:
        side: the shape.
    """

    def __init__(self, side: ShapeSide):
        corners = side.rows[..., :-1] / side.rows[..., -1:]
        self._points = corners.reshape(len(corners), -1, corners.shape[-1])
        self.order = first_order(self._points.mean(axis=1)) if len(corners) > 1 else None
        if self.order is not None:
            self._points = self._points[self.order]
        self.exact = Ordered(side.exact, self.order)
        self._side = side

    def points(self, part: PartOfShape) -> np.ndarray:
        """Control points whose hull holds the part."""
        if part.box is None:
            return self._points[part.first : part.last].reshape(-1, self._points.shape[-1])
        rows = np.array([[x / w for x in row] for row, w in self.exact.points(part)])
        return self._side.scaled(rows)

    def length(self, part: PartOfShape, letter: str) -> float:
        """How long the part is in the direction of a cut."""
        if letter == "x":
            return float(np.linalg.norm(np.ptp(self.points(part), axis=0)))
        corners, k = self.exact.pieces[part.first].corners, (ord(letter) - ord("a")) // 2
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
        places = self._side.points(np.full(len(x), piece), x)
        return float(np.sum(np.linalg.norm(np.diff(places, axis=0), axis=-1)))


def first_order(middles: np.ndarray) -> list[int]:
    """The pieces by halves of halves, each cut across the longest side of its box."""

    def sorted_rows(rows: np.ndarray) -> Iterator[int]:
        if len(rows) == 1:
            yield int(rows[0])
            return
        x = middles[rows]
        rows = rows[np.argsort(x[:, np.argmax(np.ptp(x, axis=0))], kind="stable")]
        yield from sorted_rows(rows[: len(rows) // 2])
        yield from sorted_rows(rows[len(rows) // 2 :])

    return list(sorted_rows(np.arange(len(middles))))


def keep_apart(
    a: ShapeSide, b: ShapeSide, direction: np.ndarray, lower: float, max_cells: int, report: Callable[[int, int], None]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The orders of the pieces, and pairs of parts that are all proven to be `lower` apart.

    Args:
        a: one shape.
        b: the other one, with the same exponent and center.
        direction: from the place of a that is nearest to b to that of b, about.
        lower: the bound to prove, above zero, in the unit of the stored arrays.
        max_cells: most pairs, before it is given up.
        report: called with the numbers of proven and of open pairs now and then.

    Raises:
        UncoveredError: too many or too narrow parts would be needed.
    """
    limit = float(np.ldexp(lower, -a.exponent))

    def proof(mine: _PartsInFloats, p: PartOfShape, other: _PartsInFloats, q: PartOfShape) -> dict[str, Any] | None:
        normal = _plane((mine.points(p), other.points(q)), direction, limit)
        if normal is None or failure_of_plane(mine.exact.points(p), other.exact.points(q), normal, lower) is not None:
            return None
        return {"plane": normal}

    return proven_apart((_PartsInFloats(a), _PartsInFloats(b)), proof, _longest, max_cells, report)


def proven_apart(
    shapes: tuple[Any, Any],
    proof: Callable[[Any, PartOfShape, Any, PartOfShape], dict[str, Any] | None],
    chosen: Callable[[list["PairCut"]], "PairCut"],
    max_cells: int,
    report: Callable[[int, int], None],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The orders of the pieces, and pairs of parts with their proofs; what is not proven is cut.

    Args:
        shapes: the parts of both.
        proof: a proof that two parts are apart, or None.
        chosen: which of the ways to cut a pair is taken.
        max_cells: most pairs, before it is given up.
        report: called with the numbers of proven and of open pairs now and then.

    Raises:
        UncoveredError: too many or too narrow parts would be needed.
    """
    mine, other = shapes
    entries: list[dict[str, Any]] = []
    left = [("", mine.exact.whole(), other.exact.whole())]
    while left:
        name, p, q = left.pop()
        found = proof(mine, p, other, q)
        if found is not None:
            entries.append({"pair": name, **found})
        else:
            left += _halves(name, (mine, p), (other, q), chosen)
        if len(entries) + len(left) > max_cells:
            raise UncoveredError(f"more than {max_cells} pairs are needed: raise max_cells, or atol.")
        if len(entries) % _REPORTED == 0:
            report(len(entries), len(left))
    report(len(entries), 0)
    return {"a": mine.order, "b": other.order}, entries


class PairCut(NamedTuple):
    """A way to cut a pair: the parts of a shape, the part that is cut, the letter of its first half, and if it is b."""

    parts: Any
    part: PartOfShape
    letter: str
    is_second: bool

    def halves(self) -> list[tuple[str, PartOfShape]]:
        """The letters and the halves, the first one last."""
        return [(x, self.parts.exact.half(self.part, x)) for x in (chr(ord(self.letter) + 1), self.letter)]


def _longest(ways: list[PairCut]) -> PairCut:
    return max(ways, key=lambda way: way.parts.length(way.part, way.letter))


def _halves(
    name: str,
    mine: tuple[Any, PartOfShape],
    other: tuple[Any, PartOfShape],
    chosen: Callable[[list[PairCut]], PairCut],
) -> list[tuple[str, PartOfShape, PartOfShape]]:
    """Both halves of a pair, the first one last, of which one part is cut.

    Raises:
        UncoveredError: neither can be cut.
    """
    ways = []
    for (parts, part), is_second in ((mine, False), (other, True)):
        used = sum(1 for x in name if x.isupper() == is_second and x.lower() not in "xy")
        letters = _letters(parts.exact, part) if used < _MOST_CUTS else []
        ways += [PairCut(parts, part, letter, is_second) for letter in letters]
    if not ways:
        raise UncoveredError(f"the pair {name!r} is not proven to be apart.")
    way = chosen(ways)
    if way.is_second:
        return [(name + x.upper(), mine[1], half) for x, half in way.halves()]
    return [(name + x, half, other[1]) for x, half in way.halves()]


def _letters(exact: Ordered, part: PartOfShape) -> list[str]:
    """The first letters of all the ways to cut a part."""
    if part.last - part.first > 1:
        return ["x"]
    corners = exact.pieces[part.first].corners
    if corners == (3,):
        return ["a", "c", "e"]
    # A tetrahedron is always cut at its newest corner.
    return ["a"] if corners == (4,) else ["a", "c"][: len(corners)]


def _plane(points: tuple[np.ndarray, np.ndarray], direction: np.ndarray, limit: float) -> list[float] | None:
    """A normal that keeps both hulls the limit apart, as far as floating point can tell."""
    p, q = points
    for normal in (direction, between(p, q)):
        length = float(np.linalg.norm(normal))
        if length > 0:
            unit = normal / length
            if np.min(q @ unit) - np.max(p @ unit) >= limit * (1 - _SURELY) - _SURELY:
                return unit.tolist()
    return None


def between(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The shortest vector from one hull to the other, about."""
    v = q.mean(axis=0) - p.mean(axis=0)
    for _ in range(_STEPS):
        support = q[np.argmin(q @ v)] - p[np.argmax(p @ v)]
        step = v - support
        size = float(step @ step)
        share = float(step @ v) / size if size > 0 else 0.0
        if share <= 0:
            break
        v = v - min(share, 1.0) * step
    return v


def closest_places(
    a: ShapeSide, b: ShapeSide, points: tuple[np.ndarray, np.ndarray], upper: float
) -> dict[str, Any] | None:
    """A place on each shape, proven to be at most `upper` apart; None where none is found.

    Args:
        a: one shape.
        b: the other one.
        points: about the nearest points of both, in the unit of the stored arrays.
        upper: the bound.
    """
    sides, scaled = (a, b), [a.scaled(x)[None] for x in points]
    # Both points lie on their shapes: a near foot that is apart from its point is not the nearest.
    feet = [side.feet_within(x, _ON_SHAPE) for side, x in zip(sides, scaled, strict=True)]
    for _ in range(_ROUNDS):
        at = [[float(x) for x in _few_digits(side, found.x[0])] for side, found in zip(sides, feet, strict=True)]
        pieces = [int(found.piece[0]) for found in feet]
        places = [point_of(side.exact[k], x) for side, k, x in zip(sides, pieces, at, strict=True)]
        if failure_at_most([difference(*places)], upper, None) is None:
            return {name: {"piece": k, "at": x} for name, k, x in zip("ab", pieces, at, strict=True)}
        there = b.local(feet[1].piece, feet[1].x, a.points(feet[0].piece, feet[0].x))
        feet = [a.local(feet[0].piece, feet[0].x, b.points(there.piece, there.x)), there]
    return None


def _few_digits(side: ShapeSide, x: np.ndarray) -> np.ndarray:
    """Parameters inside the domain, without tiny numbers, which would make long integers."""
    x = np.where(x < math.ldexp(1.0, -60), 0.0, x)
    return on_triangle(x) if side.corners == (3,) else x
