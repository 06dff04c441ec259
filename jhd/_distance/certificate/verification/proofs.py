"""The proofs: that all cells are near their feet (`inequalities`), and that the witness is far from the other shape."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from fractions import Fraction
from functools import partial
from math import comb
from typing import Any, NamedTuple

from jhd._distance.certificate.verification.apart import Ordered, PartOfShape, failure_of_plane, pairs, whole_box
from jhd._distance.certificate.verification.cells import cover
from jhd._distance.certificate.verification.inequalities import (
    failure_of_cell,
    failure_of_pair,
    is_hull_at_most,
    slack_of,
)
from jhd._distance.certificate.verification.pieces import (
    ExactPiece,
    Part,
    box_map,
    common_power,
    composed,
    difference,
    pieces_of,
    simplex_map,
)
from jhd._distance.certificate.verification.polynomials import ON_PART, failure
from jhd._distance.certificate.verification.structure import (
    KINDS,
    CertificateError,
    ShapeSize,
    check_content,
    check_entry,
    check_pair,
)
from jhd._distance.certificate.verification.values import UncheckedCertificateError
from jhd._distance.certificate.verification.zeros import NearZero, ZeroSet, is_free, negative, place_of, zeros_of

# How bounds are written, the lower one and the upper one: rounded outward.
_OUTWARD = [Context(prec=17, rounding=way) for way in (ROUND_FLOOR, ROUND_CEILING)]
# On a fast machine: seconds of a cell, and of a product of short numbers; how many bits take as long again.
_CELL, _PRODUCT, _BITS = 3e-5, 3e-8, 200
# How the distances are written.
NAMES = {"directed": "h(A, B)", "two_sided": "H(A, B)", "minimum": "d(A, B)"}


class Proven(NamedTuple):
    """The bounds that a certificate proves: lower <= distance <= upper."""

    kind: str  # "directed" (largest distance of a point of a to b), "two_sided" (Hausdorff distance) or "minimum"
    lower: float  # the proven lower bound
    upper: float | None  # the proven upper bound; None if the certificate claims none.
    cells: int  # number of cells that were checked


class _Deadline:
    """The time limit of a check, also tested before it begins, and the callback that reports progress."""

    def __init__(self, seconds: float | None, progress: Callable[[str], object] | None):
        if seconds is not None and (not hasattr(seconds, "__float__") or not float(seconds) > 0):
            raise ValueError(f"max_seconds is {seconds!r}; needs a positive number.")
        self.seconds, self.end = seconds, None if seconds is None else time.monotonic() + seconds
        self.progress, self.place = progress, ""

    def begin(self, expected: float) -> None:
        """Raise UncheckedCertificateError if the check is expected to exceed the time limit."""
        if self.seconds is not None and expected > self.seconds:
            raise UncheckedCertificateError(f"takes {expected:.3g} seconds or more; max_seconds is {self.seconds!r}.")

    def check(self, place: str, count: int = 0) -> None:
        """Report the location, one of `count`; raise UncheckedCertificateError after the time limit."""
        self.place = place + (f" of {count}" if count else "")
        if self.progress is not None:
            self.progress(self.place)
        self.check_within()

    def check_within(self) -> None:
        """Raise UncheckedCertificateError after the limit, at the current location."""
        if self.end is not None and time.monotonic() > self.end:
            raise UncheckedCertificateError(f"is not checked in {self.seconds!r} seconds; it ends at {self.place}.")


def verify(content: Any, max_seconds: float | None = None, progress: Callable[[str], object] | None = None) -> Proven:
    """The bounds that a certificate proves; see jhd.verify. `progress` gets the name of the next part.

    Raises:
        CertificateError: something is missing, invalid or not proven, or the check takes too long.
    """
    deadline, content = _Deadline(max_seconds, progress), getattr(content, "content", content)
    sizes = check_content(content)
    deadline.begin(expected_seconds(content["cells"], sizes))
    claim, power = content["claim"], common_power(content["a"], content["b"])
    sides = {name: _side_of(content[name], sizes[name], power) for name in ("a", "b")}
    token = ON_PART.set(deadline.check_within)
    try:
        check = _check_minimum if claim["kind"] == "minimum" else _check_maximum
        count = check(content, sides, deadline)
    finally:
        ON_PART.reset(token)
    upper = None if claim["upper"] is None else float(claim["upper"])
    return Proven(claim["kind"], float(claim["lower"]), upper, count)


class _CheckedSide(NamedTuple):
    """A shape: its size, its pieces, the polynomial of a surface, and the number of units of the pieces in one."""

    size: ShapeSize
    pieces: list[ExactPiece]
    zeros: ZeroSet | None
    unit: Fraction


def _side_of(shape: Mapping[str, Any], size: ShapeSize, power: int | None) -> _CheckedSide:
    return _CheckedSide(size, pieces_of(shape, power), zeros_of(shape), Fraction(2) ** (power or 0))


def _check_maximum(content: Mapping[str, Any], sides: Mapping[str, _CheckedSide], deadline: _Deadline) -> int:
    """Prove all cells and the witness; return the number of cells."""
    claim, count = content["claim"], 0
    for direction in KINDS[claim["kind"]] if claim["upper"] is not None else ():
        source, target = sides[direction[0]], sides[direction[-1]]
        place, entries = f"cells.{direction}", content["cells"][direction]
        checked = _checked(place, entries, partial(check_entry, source=source.size, target=target.size))
        for entry, name, cell in cover(place, source.pieces, checked):
            deadline.check(name, count_of(entries))
            if entry["bound"] > claim["upper"]:
                raise CertificateError(f"{name}.bound is {entry['bound']!r}, above the upper bound {claim['upper']!r}.")
            scaled = {**entry, "bound": Fraction(entry["bound"]) * source.unit}
            zeros = source.zeros, target.zeros
            failed = failure_of_cell(source.pieces[entry["piece"]], cell, target.pieces, zeros, scaled)
            if failed:
                raise CertificateError(f"{name}: that the distance is at most {entry['bound']!r} {failed}.")
            count += 1
    if claim["lower"] > 0:
        count += _check_witness(content, sides, deadline)
    return count


def _check_minimum(content: Mapping[str, Any], sides: Mapping[str, _CheckedSide], deadline: _Deadline) -> int:
    """Prove all pairs of parts and the two points; return the number of pairs."""
    claim, witness = content["claim"], content["witness"]
    if witness is not None:
        p, q = (_near(sides[name], witness[name], f"witness.{name}") for name in ("a", "b"))
        most = Fraction(claim["upper"]) * sides["a"].unit - p.reach - q.reach
        if most < 0 or not is_hull_at_most(difference(p.point, q.point), most):
            raise CertificateError(f"witness: that the distance is at most {claim['upper']!r} is false.")
    if claim["lower"] > 0:
        a, b = (Ordered(sides[name].pieces, content["orders"][name]) for name in ("a", "b"))
        return _check_pairs("apart", content, (sides["a"], sides["b"]), (a, b), Fraction(claim["lower"]), deadline)
    return 0


def _near(side: _CheckedSide, place: Mapping[str, Any], name: str) -> NearZero:
    """Return a point, and its distance to the point of the shape that it stands for: zero except on surfaces."""
    if side.zeros is not None:
        return place_of(side.zeros, place, name)
    return NearZero(point_of(side.pieces[place["piece"]], place["at"]), Fraction(0))


def _check_pairs(
    section: str,
    content: Mapping[str, Any],
    sides: tuple[_CheckedSide, _CheckedSide],
    ordered: tuple[Ordered, Ordered],
    bound: Fraction,
    deadline: _Deadline,
) -> int:
    """Prove that all pairs of parts of two shapes are this far apart; return their number."""
    count, place = 0, f"cells.{section}"
    checked = _checked(place, content["cells"][section], partial(check_pair, sizes=[side.size for side in sides]))
    for entry, name, mine, other in pairs(place, *ordered, checked):
        deadline.check(name, count_of(content["cells"][section]))
        failed = _failure_apart(sides, ordered, (mine, other), entry, bound)
        if failed:
            raise CertificateError(f"{name}: that the distance is at least {float(bound)!r} {failed}.")
        count += 1
    return count


def _failure_apart(
    sides: tuple[_CheckedSide, _CheckedSide],
    ordered: tuple[Ordered, Ordered],
    parts: tuple[PartOfShape, PartOfShape],
    entry: Mapping[str, Any],
    bound: Fraction,
) -> str | None:
    """Return why the proof in `entry` does not keep two parts `bound` apart; None if it does."""
    if "plane" in entry:
        mine, others = (each.points(part) for each, part in zip(ordered, parts, strict=True))
        return failure_of_plane(mine, others, entry["plane"], bound * sides[0].unit)
    # If one part holds no zero, nothing is claimed about the other part, which may have several pieces.
    named = (entry["free"],) if "free" in entry else (0, 1)
    if any(parts[k].last - parts[k].first > 1 for k in named):
        return "is not proven: a part has several pieces"
    found = {k: ordered[k].part(parts[k]) for k in named}
    if "zeros" in entry:
        return failure_of_pair((found[0], found[1]), (sides[0].zeros, sides[1].zeros), entry["zeros"], bound)
    zeros = sides[entry["free"]].zeros
    free = zeros is not None and is_free(zeros, found[entry["free"]])
    return None if free else "is not proven: the part may hold a zero"


def _checked(place: str, entries: Any, check: Callable[[str, Any], None]) -> Iterator[Mapping[str, Any]]:
    if not isinstance(entries, Iterable) or isinstance(entries, Mapping | str):
        raise CertificateError(f"{place} is {type(entries).__name__}; needs a list of cells.")
    for k, entry in enumerate(entries):
        check(f"{place}[{k}]", entry)
        yield entry


def sentence(proven: Proven) -> str:
    """Return the proven bounds as one line of text."""
    name = NAMES[proven.kind]
    lower = _OUTWARD[0].create_decimal_from_float(proven.lower)
    upper = "" if proven.upper is None else f" <= {_OUTWARD[1].create_decimal_from_float(proven.upper):g}"
    return f"{lower:g} <= {name}{upper}, {proven.cells} cell{'' if proven.cells == 1 else 's'}"


# ---- from below ----------------------------------------------------------------------------------


def _check_witness(content: Mapping[str, Any], sides: Mapping[str, _CheckedSide], deadline: _Deadline) -> int:
    """Prove the witness; return the number of pairs with parts of the other shape, if this is a surface."""
    witness, lower = content["witness"], content["claim"]["lower"]
    name, other = witness["direction"][0], witness["direction"][-1]
    place = _near(sides[name], witness, "witness")
    bound = Fraction(lower) * sides[name].unit + place.reach
    if sides[other].zeros is not None:
        point = as_piece(place.point)
        mine = _CheckedSide(ShapeSize(3, 1, (), 0), [point], None, sides[name].unit)
        ordered = Ordered([point], None), Ordered(sides[other].pieces, None)
        return _check_pairs("witness", content, (mine, sides[other]), ordered, bound, deadline)
    for index, piece in enumerate(sides[other].pieces):
        deadline.check(f"witness and piece {index} of {other}")
        failed = failure_of_witness(place.point, piece, bound)
        if failed:
            where = f"from the witness to piece {index} of {other}"
            raise CertificateError(f"witness: that the distance {where} is at least {lower!r} {failed}.")
    return 0


def point_of(piece: ExactPiece, at: Sequence[float]) -> Part:
    """Return the point of a piece at parameters, on a domain of its own."""
    return composed(piece, simplex_map(piece, 1, [at]))


def as_piece(point: Part) -> ExactPiece:
    """Return a point as a piece of a shape."""
    rows = tuple((f.get(0, 0),) for f in point.coordinates)
    return ExactPiece((), (), rows, (point.weight[0],), point.bits)


def failure_of_witness(point: Part, piece: ExactPiece, lower: float | Fraction) -> str | None:
    """Return why it is not proven that a point is at least `lower` away from a piece; None if it is."""
    part = composed(piece, box_map(piece, whole_box(piece.corners)))
    still = (0,) * len(part.domain)
    apart = difference(Part(part.domain, point.coordinates, still, point.weight, still, point.bits), part)
    form = negative(slack_of(apart, lower))
    return failure(form.terms, apart.domain, form.degree)


# ---- time ----------------------------------------------------------------------------------------


def count_of(cells: Any) -> int:
    """Return the number of cells; 0 if it is not known before they are read."""
    return len(cells) if isinstance(cells, Sized) else 0


def expected_seconds(cells: Mapping[str, Any] | None, sizes: Mapping[str, ShapeSize]) -> float:
    """Return a lower bound of the seconds that the cells of a largest distance take, from their number and degrees.

    A cell has the difference of two shapes on a simplex, of one degree, and its square. Polynomials in k variables of
    degree n have T = (n + k - 1 choose k - 1) terms; to compose one and to square one take about T^2 / 2 products for
    each coordinate. If the cell is an interval, its ends have the digits of a float, and numbers have n times as many.
    Halves of cells, further feet and multipliers take additional time.

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
