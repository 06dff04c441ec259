"""Pieces of shapes in integers, and their parts: compositions of a piece with a map.

A piece is a polynomial over a weight in the Bernstein form of its domain, a product of simplices: a point has none, a
curve an interval, a triangle itself, a patch two intervals, and an implicit surface the six tetrahedra of its box. A
part is the piece after a map of another simplex into its domain; with forms F_0, F_1, ... of the map, which add up to
W, the Bernstein polynomial of the exponents i becomes multinomial(i) F_0^i_0 F_1^i_1 ..., which is W^n times the
polynomial.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations
from typing import Any, NamedTuple

from jhd._distance.certificate.verification.polynomials import (
    Degree,
    Domain,
    Polynomial,
    combined,
    elevated,
    exponents,
    from_coefficients,
    multinomials,
    powers,
    product,
    total,
)


class ExactPiece(NamedTuple):
    """A piece: the corners of each simplex of its domain, the degree on each, and control points in integers.

    `rows` holds the coordinates times the weight one after the other, `weight` the weights, or one number; all are
    multiplied by 2^bits.
    """

    corners: tuple[int, ...]
    degrees: Degree
    rows: tuple[tuple[int, ...], ...]
    weight: tuple[int, ...]
    bits: int

    @property
    def parameters(self) -> int:
        """Number of parameters of a point."""
        return sum(self.corners) - len(self.corners)


class Part(NamedTuple):
    """Coordinates over the weight on a domain, each in its degree there, and multiplied by 2^bits."""

    domain: Domain
    coordinates: list[Polynomial]
    degree: Degree
    weight: Polynomial
    weight_degree: Degree
    bits: int


class Map(NamedTuple):
    """A map into the domain of a piece: for each simplex of the domain the forms of its corners, and their sum.

    `degrees` are the degrees of these forms on the domain of the map. Forms and sums are multiplied by 2^bits. If all
    sums are one before that, `sums` is `None`.
    """

    domain: Domain
    forms: list[list[Polynomial]]
    sums: list[Polynomial] | None
    degrees: list[Degree]
    bits: list[int]


def common_power(*shapes: Mapping[str, Any]) -> int | None:
    """Return the power of two that makes all coordinates whole numbers, the least one; None if one is a polynomial."""
    if any(shape["kind"] == "surface" for shape in shapes):
        return None
    found = set()
    for shape in shapes:
        rows = shape["vertices"] if shape["kind"] == "mesh" else shape["control_points"]
        while isinstance(rows[0], list):
            rows = [x for row in rows for x in row]
        for top, whole in (float(x).as_integer_ratio() for x in rows if x):
            found.add(whole.bit_length() - (top & -top).bit_length())
    return max(found, default=0)


def pieces_of(shape: Mapping[str, Any], power: int | None = None) -> list[ExactPiece]:
    """Return the pieces of a shape as stored in a certificate, after its structure has been checked.

    Args:
        shape: the shape.
        power: a power of two by which the coordinates are multiplied, as from `common_power`, so that tiny lengths are
            short numbers. None leaves them.
    """
    if shape["kind"] == "mesh":
        vertices = shape["vertices"]
        return [_piece((3,), (1,), [vertices[i] for i in triangle], None, power) for triangle in shape["triangles"]]
    if shape["kind"] == "surface":
        return [_piece((4,), (1,), path, None) for path in tetrahedra(shape["lower"], shape["upper"])]
    nets = shape["control_points"]
    weights = shape["weights"] or [None] * len(nets)
    if shape["kind"] == "curve":
        degree = len(nets[0]) - 1
        if degree == 0:
            return [_piece((), (), points, w, power) for points, w in zip(nets, weights, strict=True)]
        return [_piece((2,), (degree,), points, w, power) for points, w in zip(nets, weights, strict=True)]
    degrees = (len(nets[0]) - 1, len(nets[0][0]) - 1)
    rows = [[x for row in net for x in row] for net in nets]
    flat = [None if w is None else [x for row in w for x in row] for w in weights]
    return [_piece((2, 2), degrees, points, w, power) for points, w in zip(rows, flat, strict=True)]


def tetrahedra(lower: Sequence[float], upper: Sequence[float]) -> list[list[list[float]]]:
    """Return the corners of six tetrahedra that fill a box: paths along its sides between opposite corners."""
    found = []
    for axes in permutations(range(3)):
        corner, path = list(lower), [list(lower)]
        for axis in axes:
            corner[axis] = upper[axis]
            path.append(list(corner))
        found.append(path)
    return found


def integers(numbers: Iterable[float]) -> tuple[list[int], int]:
    """Return integers m_i and k with numbers m_i / 2^k."""
    ratios = [float(x).as_integer_ratio() for x in numbers]
    bits = max((whole.bit_length() for _, whole in ratios), default=1)
    return [top << (bits - whole.bit_length()) for top, whole in ratios], bits - 1


def _piece(
    corners: tuple[int, ...],
    degrees: Degree,
    points: Sequence[Sequence[float]],
    weights: Sequence[float] | None,
    power: int | None = None,
) -> ExactPiece:
    """Return a piece in integers from control points and weights given as floats."""
    columns, bits = integers(x for column in zip(*points, strict=True) for x in column)
    if power is not None:
        columns, bits = [x << power >> bits if power > 0 else x >> bits - power for x in columns], 0
    n = len(points)
    rows = [columns[k : k + n] for k in range(0, len(columns), n)]
    if weights is None:
        return ExactPiece(corners, degrees, tuple(map(tuple, rows)), (1 << bits,), bits)
    factors, more = integers(weights)
    rows = [tuple(w * x for w, x in zip(factors, row, strict=True)) for row in rows]
    return ExactPiece(corners, degrees, tuple(rows), tuple(w << bits for w in factors), bits + more)


def simplex(corners: int) -> Domain:
    """Return the domain of maps of a simplex with `corners` corners."""
    return (tuple(range(corners)),)


def box_map(piece: ExactPiece, box: Sequence[Sequence[float]]) -> Map:
    """Return the map of a product of intervals, or of a triangle, onto the part of the domain with these corners.

    Args:
        piece: the piece with this domain.
        box: for each simplex of the domain, the parameters of its corners one after the other.
    """
    domain, found, used = [], [], 0
    for count, numbers in zip(piece.corners, box, strict=True):
        variables = tuple(range(used, used + count))
        domain.append(variables)
        used += count
        size = count - 1
        rows = [numbers[k : k + size] for k in range(0, len(numbers), size)]
        found.append(_forms((count,), rows, None, variables, 1))
    degrees = [tuple(int(i == k) for i in range(len(domain))) for k in range(len(domain))]
    return Map(tuple(domain), [forms[0] for forms, *_ in found], None, degrees, [bits for *_, bits in found])


def simplex_map(
    piece: ExactPiece, corners: int, rows: Sequence[Sequence[float]], weights: Sequence[float] | None = None
) -> Map:
    """Return the map of a simplex into the domain of a piece, given Bernstein coefficients of its parameters.

    Args:
        piece: the piece with this domain.
        corners: number of corners of the simplex.
        rows: parameters, times the weight if there are weights, in the order of `exponents`; one row is a constant, as
            many rows as corners an affine map.
        weights: weights of the rows.
    """
    domain = simplex(corners)
    degree = next(m for m in range(len(rows) + 1) if len(exponents(corners, m)) == len(rows))
    forms, weight, bits = _forms(piece.corners, rows, weights, domain[0], degree)
    count = len(piece.corners)
    return Map(domain, forms, None if weights is None else [weight] * count, [(degree,)] * count, [bits] * count)


def _forms(
    corners: tuple[int, ...],
    rows: Sequence[Sequence[float]],
    weights: Sequence[float] | None,
    variables: tuple[int, ...],
    degree: int,
) -> tuple[list[list[Polynomial]], Polynomial, int]:
    """Return the forms of each simplex's corners, their sum, and the bits; the first is the sum less the others."""
    columns = [list(column) for column in zip(*rows, strict=True)]
    numbers, bits = integers([x for column in columns for x in column] + list(weights or [1.0] * len(rows)))
    size = len(rows)
    scaled = [numbers[k : k + size] for k in range(0, len(numbers), size)]
    *parameters, weight = [from_coefficients(row, variables, degree) for row in scaled]
    forms, start = [], 0
    for count in corners:
        others = parameters[start : start + count - 1]
        forms.append([combined(weight, 1, total(others), -1), *others])
        start += count - 1
    return forms, weight, bits


def composed(piece: ExactPiece, to: Map) -> Part:
    """Return the composition of the piece with the map."""
    bases = [_basis(forms, n) for forms, n in zip(to.forms, piece.degrees, strict=True)]
    degree = _degree(piece.degrees, to)
    coordinates = [_contracted(row, bases) for row in piece.rows]
    more = sum(n * k for n, k in zip(piece.degrees, to.bits, strict=True))
    bits, constant = piece.bits + more, piece.weight[0]
    if len(piece.weight) > 1:
        return Part(to.domain, coordinates, degree, _contracted(piece.weight, bases), degree, bits)
    if to.sums is None:
        return Part(to.domain, coordinates, degree, {0: constant << more}, (0,) * len(degree), bits)
    weight: Polynomial = {0: constant}
    for f, n in zip(to.sums, piece.degrees, strict=True):
        weight = product(weight, powers(f, n)[n])
    return Part(to.domain, coordinates, degree, weight, degree, bits)


def _degree(degrees: Degree, to: Map) -> Degree:
    found = [0] * len(to.domain)
    for n, form in zip(degrees, to.degrees, strict=True):
        for k, m in enumerate(form):
            found[k] += n * m
    return tuple(found)


def _basis(forms: list[Polynomial], degree: int) -> list[Polynomial]:
    """Return the Bernstein polynomials of a simplex in these forms."""
    rising = [powers(form, degree) for form in forms]
    found = []
    for term, number in zip(exponents(len(forms), degree), multinomials(len(forms), degree), strict=True):
        f: Polynomial = {0: number}
        for power, i in zip(rising, term, strict=True):
            f = product(f, power[i])
        found.append(f)
    return found


def _contracted(numbers: Sequence[int], bases: list[list[Polynomial]]) -> Polynomial:
    """Return the sum of the numbers times the products of the Bernstein polynomials of the simplices."""
    if not bases:
        return {0: numbers[0]}
    first, *rest = bases
    size = len(numbers) // len(first)
    parts = [_contracted(numbers[k * size : (k + 1) * size], rest) for k in range(len(first))]
    return total([product(f, part) for f, part in zip(first, parts, strict=True)])


def difference(x: Part, y: Part) -> Part:
    """Return the difference x - y as one part on their common domain."""
    degree = tuple(max(p) for p in zip(_sum(x.degree, y.weight_degree), _sum(y.degree, x.weight_degree), strict=True))
    coordinates = []
    for mine, other in zip(x.coordinates, y.coordinates, strict=True):
        p = elevated(product(mine, y.weight), x.domain, _sum(x.degree, y.weight_degree), degree)
        q = elevated(product(other, x.weight), x.domain, _sum(y.degree, x.weight_degree), degree)
        coordinates.append(combined(p, 1, q, -1))
    weight_degree = _sum(x.weight_degree, y.weight_degree)
    return Part(x.domain, coordinates, degree, product(x.weight, y.weight), weight_degree, x.bits + y.bits)


def _sum(x: Degree, y: Degree) -> Degree:
    return tuple(i + j for i, j in zip(x, y, strict=True))
