"""Implicit surfaces in integers: the zeros of a polynomial in a box, and proofs about them.

The box is cut into six tetrahedra, which are the pieces of the surface; a point of a piece counts only if the
polynomial is zero there. Statements about all zeros are proven with multipliers: if g + m f is not negative on a cell,
for any polynomial m, then g is not negative at the zeros of f. The existence of a zero is proven by a change of sign:
if f(q - n) <= 0 <= f(q + n), some point q + s n with s between -1 and 1 is a zero, provided that both ends lie in the
box.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from jhd._distance.certificate.verification.pieces import Part, integers, simplex
from jhd._distance.certificate.verification.polynomials import (
    Degree,
    Domain,
    Polynomial,
    combined,
    elevated,
    from_coefficients,
    one,
    product,
    total,
    variable,
)
from jhd._distance.certificate.verification.values import CertificateError


class ZeroSet(NamedTuple):
    """The polynomial of a surface, {(i, j, k): coefficient} times 2^bits, its total degree, and the box."""

    terms: dict[tuple[int, int, int], int]
    degree: int
    bits: int
    lower: tuple[Fraction, ...]
    upper: tuple[Fraction, ...]


class ZeroForm(NamedTuple):
    """A polynomial on a domain, in its degree there, and multiplied by 2^bits."""

    terms: Polynomial
    degree: Degree
    bits: int


def zeros_of(shape: Mapping[str, Any]) -> ZeroSet | None:
    """Return the polynomial of a surface; None for other shapes."""
    if shape["kind"] != "surface":
        return None
    flat = {
        (i, j, k): x
        for i, row in enumerate(shape["coefficients"])
        for j, numbers in enumerate(row)
        for k, x in enumerate(numbers)
        if x != 0
    }
    numbers, bits = integers(flat.values())
    box = (tuple(map(Fraction, shape[end])) for end in ("lower", "upper"))
    return ZeroSet(dict(zip(flat, numbers, strict=True)), max(map(sum, flat)), bits, *box)


# ---- forms ---------------------------------------------------------------------------------------


def sum_of(forms: Sequence[ZeroForm], domain: Domain) -> ZeroForm:
    """Return the sum, in the least common degree."""
    degree = tuple(map(max, zip(*(f.degree for f in forms), strict=True)))
    # Terms of a polynomial that is checked: some seconds.
    if math.prod(math.comb(n + len(v) - 1, n) for n, v in zip(degree, domain, strict=True)) > 40_000:
        raise CertificateError(f"a polynomial of degrees {degree} is too large to be checked.")
    bits = max(f.bits for f in forms)
    found: Polynomial = {}
    for f in forms:
        found = combined(found, 1, elevated(f.terms, domain, f.degree, degree), 1 << (bits - f.bits))
    return ZeroForm(found, degree, bits)


def times(x: ZeroForm, y: ZeroForm) -> ZeroForm:
    """Return the product."""
    degree = tuple(map(sum, zip(x.degree, y.degree, strict=True)))
    return ZeroForm(product(x.terms, y.terms), degree, x.bits + y.bits)


def negative(x: ZeroForm) -> ZeroForm:
    """Return the negative."""
    return x._replace(terms={i: -c for i, c in x.terms.items()})


def of_corners(numbers: Sequence[float], domain: Domain, used: Sequence[int]) -> ZeroForm:
    """Return a number, or interpolate one for each corner of a product of some simplices of a domain."""
    values, bits = integers(numbers)
    degree = tuple(int(len(numbers) > 1 and k in used) for k in range(len(domain)))
    if len(numbers) == 1:
        return ZeroForm({0: values[0]}, degree, bits)
    corners = [0]
    for k in used:
        corners = [i + variable(v) for i in corners for v in domain[k]]
    return ZeroForm(dict(zip(corners, values, strict=True)), degree, bits)


def value_on(zeros: ZeroSet, part: Part) -> ZeroForm:
    """Return the composition of the polynomial with a part without weights."""
    if len(part.weight) > 1 or part.weight[0] != 1 << part.bits:
        raise CertificateError("an implicit surface is composed with a piece that has weights.")
    unit = one(part.domain, part.degree)
    powers = [[{0: 1}] for _ in range(3)]
    for found, x in zip(powers, part.coordinates, strict=True):
        for _ in range(zeros.degree):
            found.append(product(found[-1], x))
    layers: list[list[Polynomial]] = [[] for _ in range(zeros.degree + 1)]
    for index, c in zeros.terms.items():
        f: Polynomial = {0: c}
        for found, n in zip(powers, index, strict=True):
            f = product(f, found[n]) if n else f
        layers[sum(index)].append(f)
    value = total(layers[0])
    for layer in layers[1:]:
        value = total([product({i: c << part.bits for i, c in value.items()}, unit), *layer])
    return ZeroForm(value, tuple(zeros.degree * n for n in part.degree), zeros.bits + zeros.degree * part.bits)


def extended(part: Part, domain: Domain) -> Part:
    """Return a part of the first simplices of a domain, constant on the others."""
    more = (0,) * (len(domain) - len(part.domain))
    return part._replace(domain=domain, degree=part.degree + more, weight_degree=part.weight_degree + more)


def shifted(part: Part, by: int) -> Part:
    """Return the part with variables renumbered by adding `by`."""

    def moved(f: Polynomial) -> Polynomial:
        return {i * variable(by): c for i, c in f.items()}

    domain = tuple(tuple(v + by for v in variables) for variables in part.domain)
    return part._replace(domain=domain, coordinates=[moved(f) for f in part.coordinates], weight=moved(part.weight))


def is_free(zeros: ZeroSet, part: Part) -> bool:
    """Return whether all Bernstein coefficients of the polynomial on a part have one sign, so that it has no zero."""
    value = value_on(zeros, part)
    count = math.prod(math.comb(n + len(v) - 1, n) for n, v in zip(value.degree, part.domain, strict=True))
    signs = {(c > 0) - (c < 0) for c in value.terms.values()}
    return len(value.terms) == count and signs in ({1}, {-1})


# ---- points --------------------------------------------------------------------------------------


class NearZero(NamedTuple):
    """A point, on a domain of its own, that has a zero of a polynomial within `reach`."""

    point: Part
    reach: Fraction


def place_of(zeros: ZeroSet, place: Mapping[str, Any], name: str) -> NearZero:
    """Return the point of a surface; raise CertificateError unless there is a change of sign in the box."""
    ends = [place_in(zeros, [x + s * Fraction(w) for x, w in _both(place)]) for s in (-1, 1)]
    if None in ends:
        raise CertificateError(f"{name} is not in the box of its surface.")
    first, last = (_value(zeros, end) for end in ends if end is not None)
    if first * last > 0:
        raise CertificateError(f"{name}: the polynomial has no change of sign there.")
    columns, bits = integers(place["at"])
    point = Part(simplex(1), [{0: x} for x in columns], (0,), {0: 1 << bits}, (0,), bits)
    return NearZero(point, length_of(place["way"]))


def _both(place: Mapping[str, Any]) -> list[tuple[Fraction, float]]:
    return [(Fraction(x), w) for x, w in zip(place["at"], place["way"], strict=True)]


def place_in(zeros: ZeroSet, x: Sequence[Fraction]) -> Sequence[Fraction] | None:
    """Return the point, if it is in the box."""
    inside = all(low <= t <= high for low, t, high in zip(zeros.lower, x, zeros.upper, strict=True))
    return x if inside else None


def _value(zeros: ZeroSet, x: Sequence[Fraction]) -> Fraction:
    return sum((c * x[0] ** i * x[1] ** j * x[2] ** k for (i, j, k), c in zeros.terms.items()), Fraction(0))


def length_of(way: Sequence[float]) -> Fraction:
    """Return an upper bound of the length of a vector, very close to it."""
    numbers, bits = integers(way)
    square = sum(x * x for x in numbers) << 128
    root = math.isqrt(square)
    return Fraction(root + (root * root < square), 1 << (bits + 64))


# ---- feet ----------------------------------------------------------------------------------------


class Tube(NamedTuple):
    """A foot on a surface: the points q + s n on a cell times an interval, and q - n and q + n on the cell."""

    places: Part
    ends: tuple[Part, Part]


def tube_of(foot: Mapping[str, Any], domain: Domain, interval: int) -> Tube:
    """Return the tube of a foot.

    Args:
        foot: the foot as stored in a certificate.
        domain: the cell, and intervals for feet.
        interval: the index of the interval of this foot.
    """
    rows, way = foot["map"], foot["way"]
    numbers, bits = integers([x for column in zip(*rows, strict=True) for x in column] + list(way))
    size, n = len(rows), int(len(rows) > 1)
    q = [from_coefficients(numbers[k * size : (k + 1) * size], domain[0], n) for k in range(3)]
    unit = one(domain[:1], (n,))
    low, high = (variable(v) for v in domain[interval])
    across, along = {low: 1, high: 1}, {low: -1, high: 1}
    coordinates, ends = [], ([], [])
    for f, w in zip(q, numbers[3 * size :], strict=True):
        coordinates.append(combined(product(f, across), 1, product(unit, along), w))
        for found, sign in zip(ends, (-1, 1), strict=True):
            found.append(combined(f, 1, unit, sign * w))
    degree = tuple(n if k == 0 else int(k == interval) for k in range(len(domain)))
    still, weight = (0,) * len(domain), {0: 1 << bits}
    places = Part(domain, coordinates, degree, weight, still, bits)
    first, last = (Part(domain[:1], found, (n,), weight, (0,), bits) for found in ends)
    return Tube(places, (first, last))


def is_in_box(zeros: ZeroSet, foot: Mapping[str, Any]) -> bool:
    """Return whether both ends of a tube lie in the box over the whole cell."""
    return all(
        place_in(zeros, [Fraction(x) + s * Fraction(w) for x, w in zip(row, foot["way"], strict=True)]) is not None
        for row in foot["map"]
        for s in (-1, 1)
    )
