"""The proofs: that a cell is near its feet, and that the witness is far from all of the other shape.

Over a cell the distance to the foot phi_k(u) is |e_k(u)| / w_k(u), two polynomials. One foot is enough where all
Bernstein coefficients of e_k are at most `bound` times those of w_k, or where P_k = bound^2 w_k^2 - |e_k|^2 is not
negative. Of several feet it is enough that sum l_k P_k is not negative for multipliers l_k whose Bernstein coefficients
are not negative and not all zero: where one of the multipliers is positive one of the P_k is not negative, and that
is everywhere but on sides of the cell, to which the bound extends because distances are continuous.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from jhd.distance.certificate.verification.apart import Ordered, failure_of_plane, pairs
from jhd.distance.certificate.verification.cells import cover
from jhd.distance.certificate.verification.first_version import current
from jhd.distance.certificate.verification.pieces import (
    ExactPiece,
    Map,
    Part,
    box_map,
    composed,
    difference,
    integers,
    pieces_of,
    simplex_map,
)
from jhd.distance.certificate.verification.polynomials import (
    MOST_PARTS,
    Degree,
    Polynomial,
    combined,
    elevated,
    failure,
    from_coefficients,
    product,
    square,
    total,
)
from jhd.distance.certificate.verification.structure import (
    KINDS,
    CertificateError,
    ShapeSize,
    check_content,
    check_entry,
    check_pair,
)

# How the distances are written.
NAMES = {"directed": "h(A, B)", "two_sided": "H(A, B)", "minimum": "d(A, B)"}


class Proven(NamedTuple):
    """What a certificate proves: lower <= distance <= upper, upper None where it claims none; cells that were checked.

    `kind` is "directed", the largest distance of a point of a to b, "two_sided", the Hausdorff distance, or "minimum".
    """

    kind: str
    lower: float
    upper: float | None
    cells: int


class _Deadline:
    """The time after which a check is given up, and who hears of what is checked until then."""

    def __init__(self, seconds: float | None, progress: Callable[[str], object] | None):
        self.seconds, self.end = seconds, None if seconds is None else time.monotonic() + seconds
        self.progress = progress

    def check(self, place: str) -> None:
        """Raises CertificateError when it has passed."""
        if self.progress is not None:
            self.progress(place)
        if self.end is not None and time.monotonic() > self.end:
            raise CertificateError(f"is not checked in {self.seconds!r} seconds; {place} would be next.")


def verify(content: Any, seconds: float | None = None, progress: Callable[[str], object] | None = None) -> Proven:
    """What the certificate proves, after every number of it has been checked.

    Args:
        content: the certificate as `opened` reads it, or Certificate.content; its lists of cells may be any iterables.
        seconds: after how long to give up; None never does.
        progress: called with the place in the certificate that is checked next.

    Raises:
        CertificateError: something is missing, of a wrong kind, or not proven, or takes too long; it says which.
    """
    deadline, content = _Deadline(seconds, progress), current(content)
    sizes = check_content(content)
    claim = content["claim"]
    shapes = {name: pieces_of(content[name]) for name in ("a", "b")}
    if claim["kind"] == "minimum":
        count = _check_minimum(content, shapes, sizes, deadline)
    else:
        count = _check_maximum(content, shapes, sizes, deadline)
    upper = None if claim["upper"] is None else float(claim["upper"])
    return Proven(claim["kind"], float(claim["lower"]), upper, count)


def _check_maximum(
    content: Mapping[str, Any],
    shapes: Mapping[str, list[ExactPiece]],
    sizes: Mapping[str, ShapeSize],
    deadline: _Deadline,
) -> int:
    """The number of cells, all of which are proven, and so is the witness."""
    claim, count = content["claim"], 0
    for direction in KINDS[claim["kind"]] if claim["upper"] is not None else ():
        source, target = direction[0], direction[-1]
        place, entries = f"cells.{direction}", content["cells"][direction]
        checked = _checked(place, entries, partial(check_entry, source=sizes[source], target=sizes[target]))
        for entry, name, cell in cover(place, shapes[source], checked):
            deadline.check(name)
            if entry["bound"] > claim["upper"]:
                raise CertificateError(f"{name}.bound is {entry['bound']!r}, above the upper bound {claim['upper']!r}.")
            failed = failure_of_cell(shapes[source][entry["piece"]], cell, shapes[target], entry)
            if failed:
                raise CertificateError(f"{name}: that the distance is at most {entry['bound']!r} {failed}.")
            count += 1
    if claim["lower"] > 0:
        _check_witness(content["witness"], shapes, claim["lower"], deadline)
    return count


def _check_minimum(
    content: Mapping[str, Any],
    shapes: Mapping[str, list[ExactPiece]],
    sizes: Mapping[str, ShapeSize],
    deadline: _Deadline,
) -> int:
    """The number of pairs of parts, all of which are proven, and so are the two places."""
    claim, witness, count = content["claim"], content["witness"], 0
    if witness is not None:
        p, q = (point_of(shapes[name][witness[name]["piece"]], witness[name]["at"]) for name in ("a", "b"))
        failed = failure_at_most([difference(p, q)], claim["upper"], None)
        if failed:
            raise CertificateError(f"witness: that the distance is at most {claim['upper']!r} {failed}.")
    if claim["lower"] > 0:
        a, b = (Ordered(shapes[name], content["orders"][name]) for name in ("a", "b"))
        checked = _checked("cells.apart", content["cells"]["apart"], partial(check_pair, dim=sizes["a"].dim))
        for entry, name, mine, other in pairs("cells.apart", a, b, checked):
            deadline.check(name)
            failed = failure_of_plane(a.points(mine), b.points(other), entry["plane"], claim["lower"])
            if failed:
                raise CertificateError(f"{name}: that the distance is at least {claim['lower']!r} {failed}.")
            count += 1
    return count


def _checked(place: str, entries: Any, check: Callable[[str, Any], None]) -> Iterator[Mapping[str, Any]]:
    if not isinstance(entries, Iterable) or isinstance(entries, Mapping | str):
        raise CertificateError(f"{place} is {type(entries).__name__}; needs a list of cells.")
    for k, entry in enumerate(entries):
        check(f"{place}[{k}]", entry)
        yield entry


def sentence(proven: Proven) -> str:
    """What is proven, in a line."""
    name = NAMES[proven.kind]
    upper = "" if proven.upper is None else f" <= {proven.upper!r}"
    return f"{proven.lower!r} <= {name}{upper}, {proven.cells} cell{'' if proven.cells == 1 else 's'}"


# ---- from above ----------------------------------------------------------------------------------


def failure_of_cell(
    source: ExactPiece, cell: Map, targets: Sequence[ExactPiece], entry: Mapping[str, Any]
) -> str | None:
    """Why the bound of a cell is not proven; None where it is.

    Args:
        source: the piece of the cell.
        cell: the map of a simplex onto it.
        targets: the pieces of the other shape.
        entry: its feet, multipliers and bound, as they stand in a certificate.
    """
    part, corners = composed(source, cell), len(cell.domain[0])
    apart = [
        difference(part, composed(targets[foot["piece"]], simplex_map(targets[foot["piece"]], corners, **_map(foot))))
        for foot in entry["feet"]
    ]
    return failure_at_most(apart, entry["bound"], entry["multipliers"])


def _map(foot: Mapping[str, Any]) -> dict[str, Any]:
    return {"rows": foot["map"], "weights": foot["weights"]}


def failure_at_most(
    apart: Sequence[Part], bound: float, multipliers: Sequence[Sequence[float]] | None, parts: int = MOST_PARTS
) -> str | None:
    """Why it is not proven that everywhere one of the differences is at most `bound` long; None where it is.

    Args:
        apart: the differences on one simplex.
        bound: the length.
        multipliers: for each the Bernstein coefficients of its multiplier; None of one difference.
        parts: in how many parts of the simplex to try.
    """
    if any(is_hull_at_most(e, bound) for e in apart):
        return None
    domain, slacks = apart[0].domain, [slack(e, bound) for e in apart]
    if multipliers is None:
        return failure(slacks[0][0], domain, slacks[0][1], parts)
    variables, products = domain[0], []
    numbers, _ = integers(x for row in multipliers for x in row)
    most_bits = max(e.bits for e in apart)
    for e, (f, degree), row in zip(apart, slacks, multipliers, strict=True):
        m = int(len(row) > 1)
        # The slacks are squares of numbers with different powers of two.
        factor = from_coefficients([numbers.pop(0) << 2 * (most_bits - e.bits) for _ in row], variables, m)
        products.append((product(factor, f), (degree[0] + m,)))
    most = max(degree for _, degree in products)
    return failure(total([elevated(f, domain, degree, most) for f, degree in products]), domain, most, parts)


def is_hull_at_most(e: Part, bound: float) -> bool:
    """Whether all Bernstein coefficients of a difference are at most `bound` long: then it is everywhere."""
    top, whole = float(bound).as_integer_ratio()
    weight = elevated(e.weight, e.domain, e.weight_degree, e.degree)
    return all(
        whole * whole * sum(f.get(i, 0) ** 2 for f in e.coordinates) <= top * top * w * w for i, w in weight.items()
    )


def squares_of(e: Part) -> tuple[Polynomial, Polynomial, Degree]:
    """|e|^2 and w^2 of a difference e / w, in one degree."""
    doubled = tuple(2 * n for n in e.degree)
    weights = elevated(square(e.weight), e.domain, tuple(2 * n for n in e.weight_degree), doubled)
    return total([square(f) for f in e.coordinates]), weights, doubled


def slack(e: Part, bound: float) -> tuple[Polynomial, Degree]:
    """bound^2 w^2 - |e|^2, times a square, and its degree."""
    top, whole = float(bound).as_integer_ratio()
    squares, weights, degree = squares_of(e)
    return combined(weights, top * top, squares, -whole * whole), degree


# ---- from below ----------------------------------------------------------------------------------


def _check_witness(
    witness: Mapping[str, Any], shapes: Mapping[str, Sequence[ExactPiece]], lower: float, deadline: _Deadline
) -> None:
    name, other = witness["direction"][0], witness["direction"][-1]
    point = point_of(shapes[name][witness["piece"]], witness["at"])
    for index, piece in enumerate(shapes[other]):
        deadline.check(f"witness and piece {index} of {other}")
        cuts = [0.0, 1.0] if witness["cuts"] is None else witness["cuts"][index]
        for first, last in zip(cuts[:-1], cuts[1:], strict=True):
            failed = failure_of_witness(point, piece, lower, (first, last))
            if failed:
                where = f"from the witness to piece {index} of {other}"
                where += "" if witness["cuts"] is None else f" between {first!r} and {last!r}"
                raise CertificateError(f"witness: that the distance {where} is at least {lower!r} {failed}.")


def point_of(piece: ExactPiece, at: Sequence[float]) -> Part:
    """The point of a piece at parameters, on a domain of its own."""
    return composed(piece, simplex_map(piece, 1, [at]))


def failure_of_witness(
    point: Part, piece: ExactPiece, lower: float, ends: tuple[float, float] = (0.0, 1.0)
) -> str | None:
    """Why it is not proven that a point is at least `lower` away from a piece; None where it is.

    Args:
        point: the point.
        piece: the piece.
        lower: the bound.
        ends: of an interval, the part of it that is meant.
    """
    box = [list(ends) if count == 2 else [0.0, 0.0, 1.0, 0.0, 0.0, 1.0] for count in piece.corners]
    part = composed(piece, box_map(piece, box))
    still = (0,) * len(part.domain)
    apart = difference(Part(part.domain, point.coordinates, still, point.weight, still, point.bits), part)
    f, degree = slack(apart, lower)
    return failure({i: -c for i, c in f.items()}, apart.domain, degree)
