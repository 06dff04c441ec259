"""Polynomials of integers on products of simplices, and the proof that one is nowhere negative.

A point of a simplex is a convex combination of its corners; its barycentric coordinates are the variables. A polynomial
is homogeneous in the variables of each simplex, {exponents: coefficient}: the coefficients are its Bernstein
coefficients times multinomial numbers, so that products are plain convolutions and the signs stay. All exponents of a
term are packed into one integer, a byte for each variable.
"""

import math
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from functools import cache
from itertools import product as pairs_of

Polynomial = dict[int, int]
# The variables of each simplex of a domain.
Domain = tuple[tuple[int, ...], ...]
# The degree in the variables of each simplex.
Degree = tuple[int, ...]
# The variables of each simplex in the order in which it is cut, its degree, and how often it has been cut.
Split = tuple[tuple[tuple[int, ...], int, int], ...]

# Bits of one exponent, and so the largest degree of all.
BITS = 8
# Parts in all: next to a maximum there are about twenty, most polynomials need none.
MOST_PARTS = 1500
# Called before each of these parts: raises if the time of a check is over.
ON_PART: ContextVar[Callable[[], object] | None] = ContextVar("ON_PART", default=None)


def variable(index: int) -> int:
    """Return the code of a variable alone."""
    return 1 << (BITS * index)


def powers_of(code: int, count: int) -> list[int]:
    """Return the exponents of the first `count` variables, which are all in a term."""
    return list(code.to_bytes(count, "little"))


def product(f: Polynomial, g: Polynomial) -> Polynomial:
    """Return the product f g."""
    result: Polynomial = {}
    known = result.get
    for i, x in f.items():
        for j, y in g.items():
            result[i + j] = known(i + j, 0) + x * y
    return result


def square(f: Polynomial) -> Polynomial:
    """Return f^2, with half of the products."""
    result: Polynomial = {}
    known, terms = result.get, list(f.items())
    for k, (i, x) in enumerate(terms):
        result[2 * i] = known(2 * i, 0) + x * x
        doubled = 2 * x
        for j, y in terms[:k]:
            result[i + j] = known(i + j, 0) + doubled * y
    return result


def powers(f: Polynomial, count: int) -> list[Polynomial]:
    """Return 1, f, f^2, ... f^count."""
    found: list[Polynomial] = [{0: 1}]
    for _ in range(count):
        found.append(product(found[-1], f))
    return found


def combined(f: Polynomial, x: int, g: Polynomial, y: int) -> Polynomial:
    """Return x f + y g."""
    result = {i: x * c for i, c in f.items()}
    for i, c in g.items():
        result[i] = result.get(i, 0) + y * c
    return result


def total(polynomials: list[Polynomial]) -> Polynomial:
    """Return the sum of polynomials."""
    result: Polynomial = {}
    for f in polynomials:
        for i, c in f.items():
            result[i] = result.get(i, 0) + c
    return result


@cache
def one(domain: Domain, degree: Degree) -> Polynomial:
    """Return the constant 1 in a degree: powers of the sums of the variables."""
    result: Polynomial = {0: 1}
    for variables, n in zip(domain, degree, strict=True):
        result = product(result, powers({variable(i): 1 for i in variables}, n)[n])
    return result


def elevated(f: Polynomial, domain: Domain, degree: Degree, higher: Degree) -> Polynomial:
    """Return f in a higher degree."""
    if degree == higher:
        return f
    return product(f, one(domain, tuple(n - m for n, m in zip(higher, degree, strict=True))))


@cache
def exponents(count: int, degree: int) -> list[tuple[int, ...]]:
    """Return the exponents of the terms of a degree in `count` variables, high powers of the first variables first."""
    if count == 1:
        return [(degree,)]
    return [(first, *rest) for first in range(degree, -1, -1) for rest in exponents(count - 1, degree - first)]


@cache
def multinomials(count: int, degree: int) -> list[int]:
    """Return the factor of each of these terms: degree! over the factorials of the exponents."""
    return [math.factorial(degree) // math.prod(math.factorial(i) for i in term) for term in exponents(count, degree)]


def from_coefficients(coefficients: Sequence[int], variables: tuple[int, ...], degree: int) -> Polynomial:
    """Return the polynomial with these Bernstein coefficients, in the order of `exponents`."""
    count = len(variables)
    numbers = zip(coefficients, exponents(count, degree), multinomials(count, degree), strict=True)
    return {sum(i * variable(v) for i, v in zip(term, variables, strict=True)): c * m for c, term, m in numbers if c}


def reduced(f: Polynomial) -> Polynomial:
    """Return f over the largest power of two that divides all coefficients: equal signs, shorter numbers."""
    bits = min(((c & -c).bit_length() for c in f.values() if c), default=1) - 1
    return {i: c >> bits for i, c in f.items()} if bits else f


def failure(
    f: Polynomial,
    domain: Domain,
    degree: Degree,
    most_parts: int = MOST_PARTS,
    is_proven: Callable[[Polynomial, int], bool] = lambda f, depth: False,
) -> str | None:
    """Return why a polynomial is not proven to be non-negative on its domain; None if it is.

    Args:
        f: the polynomial.
        domain: the variables of the simplices of the domain.
        degree: the degrees in these simplices.
        most_parts: largest number of parts to examine.
        is_proven: another proof for a part with negative coefficients, called with the number of its cuts.
    """
    if min(f.values(), default=0) >= 0:
        return None
    # Halvings in a row that one polynomial may take, for each variable beyond the first.
    most = 48 * sum(len(variables) - 1 for variables in domain)
    start: Split = tuple((variables, n, 0) for variables, n in zip(domain, degree, strict=True))
    parts, on_part = [(reduced(f), start, 0)], ON_PART.get()
    for _ in range(most_parts):
        if on_part is not None:
            on_part()
        f, split, depth = parts.pop()
        if min(f.values(), default=0) < 0:
            if any(f.get(corner, 0) < 0 for corner in _corners(split)):
                return "is false"
            if depth == most:
                return f"is not proven in {most} halvings"
            if not is_proven(f, depth):
                parts += [(reduced(half), rest, depth + 1) for half, rest in _halves(f, split)]
        if not parts:
            return None
    return f"is not proven in {most_parts} parts"


def _corners(split: Split) -> list[int]:
    """Return the exponents of the terms that give the values at the corners of the domain."""
    return [sum(found) for found in pairs_of(*([n * variable(i) for i in variables] for variables, n, _ in split))]


def _halves(f: Polynomial, split: Split) -> list[tuple[Polynomial, Split]]:
    """Return both halves after a cut of the simplex that was cut least for its dimension.

    This keeps triangles and tetrahedra in shape. A single corner cannot be cut.
    """
    sizes = [(cuts / (len(v) - 1) if len(v) > 1 else math.inf, k) for k, (v, _, cuts) in enumerate(split)]
    k = min(sizes)[1]
    variables, n, cuts = split[k]
    return [
        (half_of(f, kept, moved, n), (*split[:k], (order, n, cuts + 1), *split[k + 1 :]))
        for kept, moved, order in cuts_of(variables, cuts)
    ]


def cuts_of(order: tuple[int, ...], cuts: int) -> list[tuple[int, int, tuple[int, ...]]]:
    """Return for each half of a simplex the corner that stays, the corner that the middle replaces, and the order.

    Source: Maubach, Local bisection refinement for n-simplicial grids (1995).
    """
    n = len(order) - 1
    last = n - cuts % n
    first = (order[0], order[last], order)
    return [first, (order[last], order[0], (*order[1 : last + 1], order[0], *order[last + 1 :]))]


def half_of(f: Polynomial, kept: int, moved: int, n: int) -> Polynomial:
    """Return 2^n times the polynomial with the corner `moved` replaced by the middle between `moved` and `kept`.

    If x and y are the barycentric coordinates of the corner kept and of the middle, the coordinates before were x + y/2
    and y/2.
    """
    low, high, mask = BITS * kept, BITS * moved, (1 << BITS) - 1
    step = variable(moved) - variable(kept)
    result: Polynomial = {}
    known = result.get
    for code, c in f.items():
        p, q = (code >> low) & mask, (code >> high) & mask
        c <<= n - p - q
        for k in range(p + 1):
            # The term x^(p - k) y^(k + q) of (2 x + y)^p y^q.
            place = code + k * step
            result[place] = known(place, 0) + (c * math.comb(p, k) << (p - k))
    return result
