"""The inequalities that prove that a cell is near its feet, and that two parts are apart.

Over a cell the distance to the foot phi_k(u) is |e_k(u)| / w_k(u), two polynomials. One foot is enough if all Bernstein
coefficients of e_k are at most `bound` times the coefficients of w_k. Otherwise, with the slacks
P_k = bound^2 w_k^2 - |e_k|^2, it is proven that

    sum_k (l_k P_k + m_k f_b(q_k + s_k n_k)) + m f_a >= 0

for multipliers l_k whose Bernstein coefficients are not negative and not all zero, and m_k, m of any sign: over the
cell, and over s_k from -1 to 1 for each foot on a surface f_b. If one of the l_k is positive at u, a zero of a surface
f_a, and with the s_k for which q_k + s_k n_k are zeros of f_b, one of the feet is then within the bound. This holds
everywhere except on sides of the cell, to which the bound extends because distances are continuous.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from jhd._distance.certificate.verification.convexity import failure_in_space
from jhd._distance.certificate.verification.pieces import (
    ExactPiece,
    Map,
    Part,
    composed,
    difference,
    simplex_map,
)
from jhd._distance.certificate.verification.polynomials import (
    MOST_PARTS,
    Domain,
    combined,
    elevated,
    failure,
    square,
    total,
)
from jhd._distance.certificate.verification.zeros import (
    ZeroForm,
    ZeroSet,
    extended,
    is_free,
    is_in_box,
    negative,
    of_corners,
    shifted,
    sum_of,
    times,
    tube_of,
    value_on,
)


def slack_of(e: Part, bound: float | Fraction) -> ZeroForm:
    """Return bound^2 w^2 - |e|^2 for a difference e / w."""
    top, whole = Fraction(bound).as_integer_ratio()
    degree = tuple(2 * n for n in e.degree)
    weights = elevated(square(e.weight), e.domain, tuple(2 * n for n in e.weight_degree), degree)
    squares = total([square(f) for f in e.coordinates])
    bits = 2 * (e.bits + whole.bit_length() - 1)
    return ZeroForm(combined(weights, top * top, squares, -whole * whole), degree, bits)


def is_hull_at_most(e: Part, bound: float | Fraction) -> bool:
    """Return whether all Bernstein coefficients of a difference, and so the difference, are at most `bound` long."""
    top, whole = Fraction(bound).as_integer_ratio()
    weight = elevated(e.weight, e.domain, e.weight_degree, e.degree)
    return all(
        whole * whole * sum(f.get(i, 0) ** 2 for f in e.coordinates) <= top * top * w * w for i, w in weight.items()
    )


def failure_of_cell(
    source: ExactPiece,
    cell: Map,
    targets: Sequence[ExactPiece],
    zeros: tuple[ZeroSet | None, ZeroSet | None],
    entry: Mapping[str, Any],
    parts: int = MOST_PARTS,
) -> str | None:
    """Return why the bound of a cell is not proven; None if it is.

    Args:
        source: the piece of the cell.
        cell: the map of a simplex onto it.
        targets: the pieces of the other shape.
        zeros: the polynomials of both shapes, None for shapes that are no surfaces.
        entry: the feet, multipliers and bound of the cell, as stored in a certificate.
        parts: largest number of parts to try.
    """
    mine, other = zeros
    part = composed(source, cell)
    if mine is not None and entry["zero"] is None:
        return None if is_free(mine, part) else "is not proven: the cell may hold a zero"
    corners, feet = len(cell.domain[0]), entry["feet"]
    count = len(feet) if other is not None else 0
    domain: Domain = (*cell.domain, *((corners + 2 * k, corners + 2 * k + 1) for k in range(count)))
    whole = extended(part, domain)
    apart: list[Part] = []
    terms: list[ZeroForm] = []
    for k, foot in enumerate(feet):
        if other is None:
            to = simplex_map(targets[foot["piece"]], corners, foot["map"], foot["weights"])
            there = composed(targets[foot["piece"]], to)
        else:
            tube = tube_of(foot, domain, k + 1)
            if not is_in_box(other, foot):
                return f"is not proven: foot {k} leaves the box"
            for sign, end in zip((-1, 1), tube.ends, strict=True):
                value = value_on(other, end)
                value = value if sign > 0 else negative(value)
                if failure_in_space(value.terms, end.domain, value.degree, parts) is not None:
                    return f"is not proven: foot {k} has no change of sign"
            there = tube.places
            terms.append(times(of_corners(foot["zero"], domain, [0, k + 1]), value_on(other, there)))
        apart.append(difference(whole, extended(there, domain)))
    is_plain, numbers = zeros == (None, None), entry["multipliers"]
    if is_plain and any(is_hull_at_most(e, entry["bound"]) for e in apart):
        return None
    for k, e in enumerate(apart):
        slack = slack_of(e, entry["bound"])
        terms.append(slack if numbers is None else times(of_corners(numbers[k], domain, [0]), slack))
    if mine is not None:
        value = value_on(mine, part)
        value = value._replace(degree=value.degree + (0,) * count)
        terms.append(times(of_corners(entry["zero"], domain, [0]), value))
    found = sum_of(terms, domain)
    # Planes cost a search for the least value, which only surfaces need.
    proof = failure if is_plain else failure_in_space
    return proof(found.terms, domain, found.degree, parts)


def joined(mine: Part, other: Part) -> tuple[Part, Part, Domain]:
    """Return two parts on the product of their domains, and this domain."""
    moved = shifted(other, sum(len(variables) for variables in mine.domain))
    domain = mine.domain + moved.domain
    ahead = (0,) * len(mine.domain)
    there = moved._replace(domain=domain, degree=ahead + moved.degree, weight_degree=ahead + moved.weight_degree)
    return extended(mine, domain), there, domain


def failure_of_pair(
    parts: tuple[Part, Part],
    zeros: tuple[ZeroSet | None, ZeroSet | None],
    numbers: Sequence[Sequence[float] | None],
    bound: float | Fraction,
    most_parts: int = MOST_PARTS,
) -> str | None:
    """Return why it is not proven that two parts, or the zeros in them, are `bound` apart; None if it is.

    Args:
        parts: parts of both shapes, each on a domain of its own.
        zeros: the polynomials of the parts that belong to surfaces.
        numbers: their multipliers.
        bound: the distance.
        most_parts: largest number of parts to try.
    """
    mine, there, domain = joined(*parts)
    terms = [negative(slack_of(difference(mine, there), bound))]
    count = len(parts[0].domain)
    simplices = [list(range(count)), list(range(count, len(domain)))]
    for k, (zero, part) in enumerate(zip(zeros, (mine, there), strict=True)):
        if zero is not None:
            factor = of_corners(numbers[k] or [0.0], domain, simplices[k])
            terms.append(times(factor, value_on(zero, part)))
    found = sum_of(terms, domain)
    return failure_in_space(found.terms, domain, found.degree, most_parts)
