"""The checker of certificates, in exact integer arithmetic and of the standard library alone.

A certificate claims lower <= h <= upper for two curves of (rational) Bezier segments, where h is the largest distance
of a point of a to b ("directed"), or the larger of that and of its counterpart from b to a ("two_sided"). Every number
of it is a float, hence a rational m / 2^k, and nothing here rounds.

- A **cell** names a part [t0, t1] of a segment of a, a segment of b, a map sigma(u) = S(u) / W(u) of [0, 1] into itself
  and a bound. All that it needs is bound^2 w(u)^2 - |e(u)|^2 >= 0 on [0, 1] for the difference e / w of A(t(u)) and
  B(sigma(u)): then every point of the part is at most `bound` away from b. sigma lies in [0, 1] because its Bernstein
  coefficients do: 0 <= S_i <= W_i and W_i > 0. The parts of each segment have to cover [0, 1].
- The **witness** is a point P of a, and for each segment of b the cuts of its parameter. All that it needs is
  |e(u)|^2 - lower^2 w(u)^2 >= 0 between cuts, for e / w = P - B.

A polynomial is proven to be non-negative on [0, 1] when its Bernstein coefficients are, if need be on halves of halves.
Polynomials are lists of integers, their Bernstein coefficients times binomials: their products are plain convolutions,
and a common positive factor of all that is compared does not matter.

Nothing of the search, and nothing of this package, is used: this file can be read, copied and run by itself,
`python verification.py FILE...`: a line for each certificate that is proven, exit status 1 where one is refused, 2
where one cannot be read.

Source: the hull property is in Farouki & Rajan, CAGD 5 (1988).
"""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any, NamedTuple

FORMAT, VERSION = "jhd-certificate", 1
KINDS = {"directed": ("a_to_b",), "two_sided": ("a_to_b", "b_to_a")}

# Halvings and parts that one polynomial may take: cells next to a maximum take some twenty, most take none.
_MOST_HALVINGS, _MOST_PARTS = 48, 400
# Degrees that are read, and the bits of parameters behind the point: beyond them a short file would take hours.
_LARGEST_DEGREE, _LARGEST_SIGMA, _MOST_BITS = 30, 3, 256

Polynomial = list[int]


class CertificateError(ValueError):
    """A certificate that is refused: no such format, or a claim in it that is not proven by what it holds."""


class Proven(NamedTuple):
    """What a certificate proves: lower <= distance <= upper, upper None where it claims none; cells that were checked.

    `kind` is "directed", the largest distance of a point of a to b, or "two_sided", the Hausdorff distance.
    """

    kind: str
    lower: float
    upper: float | None
    cells: int


class Part(NamedTuple):
    """A segment or a part of one: coordinates over the weight, a constant on polynomial segments."""

    coordinates: list[Polynomial]
    weight: Polynomial


def verify(content: Any) -> Proven:
    """What the certificate proves, after every number of it has been checked.

    Args:
        content: the JSON object of a certificate as Python's json reads it.

    Raises:
        CertificateError: something is missing, of a wrong kind, or not proven; it says which and where.
    """
    check_structure(content)
    claim = content["claim"]
    curves = {name: segments_of(content[name]) for name in ("a", "b")}
    count = 0
    for direction in KINDS[claim["kind"]] if claim["upper"] is not None else ():
        name, other = direction[0], direction[-1]
        cells = content["cells"][direction]
        _check_cover(f"cells.{direction}", name, len(curves[name]), cells)
        for index, cell in enumerate(cells):
            place = f"cells.{direction}[{index}]"
            if cell["bound"] > claim["upper"]:
                raise CertificateError(f"{place}.bound is {cell['bound']!r}, above the upper bound {claim['upper']!r}.")
            failed = failure_of_cell(curves[name][cell["segment"]], curves[other][cell["foot"]], cell)
            if failed:
                raise CertificateError(f"{place}: that the distance is at most {cell['bound']!r} {failed}.")
        count += len(cells)
    if claim["lower"] > 0:
        _check_witness(content["witness"], curves, claim["lower"])
    upper = None if claim["upper"] is None else float(claim["upper"])
    return Proven(claim["kind"], float(claim["lower"]), upper, count)


def parsed(text: str) -> Any:
    """The content of a certificate's JSON, where NaN, Infinity and a key that occurs twice are refused.

    Raises:
        json.JSONDecodeError: text that is no JSON.
        CertificateError: an object with a key that occurs twice.
        ValueError: a number that is none of JSON, or with more digits than Python reads.
        RecursionError: lists in lists beyond what Python reads.
    """
    return json.loads(text, parse_constant=_refused, object_pairs_hook=_unique)


def sentence(proven: Proven) -> str:
    """What is proven, in a line."""
    name = "h(A, B)" if proven.kind == "directed" else "H(A, B)"
    upper = "" if proven.upper is None else f" <= {proven.upper!r}"
    return f"{proven.lower!r} <= {name}{upper}, {proven.cells} cell{'' if proven.cells == 1 else 's'}"


def main(files: Sequence[str]) -> int:
    """Checks certificates in files and prints what each proves; the exit status."""
    if not files:
        print("usage: python verification.py FILE...", file=sys.stderr)
        return 2
    status = 0
    for name in files:
        try:
            with open(name, encoding="utf-8") as file:
                proven = verify(parsed(file.read()))
        except CertificateError as error:
            print(f"refused: {name}: {error}", file=sys.stderr)
            status = max(status, 1)
        except (OSError, ValueError, RecursionError) as error:
            print(f"not read: {name}: {error}", file=sys.stderr)
            status = 2
        else:
            print(f"proven: {name}: {sentence(proven)}")
    return status


def _refused(token: str) -> float:
    raise ValueError(f"{token} is no number of JSON.")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            raise CertificateError(f"the key {repr(key)} occurs twice in one object.")
        content[key] = value
    return content


# ---- what is proven ------------------------------------------------------------------------------


def segments_of(curve: Mapping[str, Any]) -> list[Part]:
    """The segments of a curve in integers, from its control points and weights (or None)."""
    rows = curve["control_points"]
    weights = curve["weights"] or [None] * len(rows)
    return [_segment(points, weight) for points, weight in zip(rows, weights, strict=True)]


def failure_of_cell(segment: Part, foot: Part, cell: Mapping[str, Any]) -> str | None:
    """Why the bound of a cell is not proven; None where it is."""
    squares, weight_sq = distance_sq(
        restricted(segment, cell["t"]), restricted(foot, cell["sigma"], cell["sigma_weights"])
    )
    return failure_at_most(squares, weight_sq, cell["bound"])


def restricted(segment: Part, sigma: Sequence[float], sigma_weights: Sequence[float] | None = None) -> Part:
    """The segment at the parameters sigma(u); [t0, t1] is a part of it, [t] a point.

    With C(u) = W(u) - S(u), the sum of c_i S^i C^(n-i) over the binomials in c_i is W^n times the polynomial at sigma.
    """
    degree = len(sigma) - 1
    numbers, _ = _integers([*sigma, *(sigma_weights or [1.0] * len(sigma))])
    s, w = (_scaled(row) for row in (numbers[: degree + 1], numbers[degree + 1 :]))
    n = len(segment.coordinates[0]) - 1
    rising, falling = _powers(s, n), _powers([x - y for x, y in zip(w, s, strict=True)], n)
    basis = [_product(rising[i], falling[n - i]) for i in range(n + 1)]
    if len(segment.weight) > 1:
        weight = _combined(segment.weight, basis)
    elif sigma_weights is not None:
        weight = [segment.weight[0] * x for x in _powers(w, n)[n]]
    else:
        weight = [segment.weight[0] * w[0] ** n]
    return Part([_combined(row, basis) for row in segment.coordinates], weight)


def distance_sq(x: Part, y: Part) -> tuple[Polynomial, Polynomial]:
    """|e|^2 and w^2 of e / w = x - y, in one degree."""
    squares: Polynomial = []
    for mine, other in zip(x.coordinates, y.coordinates, strict=True):
        e = _difference(_product(y.weight, mine), _product(x.weight, other))
        square = _product(e, e)
        squares = [p + q for p, q in zip(squares, square, strict=True)] if squares else square
    weight = _product(x.weight, y.weight)
    weight_sq = _product(weight, weight)
    return squares, _elevated(weight_sq, len(squares) - 1)


def failure_at_most(squares: Polynomial, weight_sq: Polynomial, bound: float) -> str | None:
    """Why |e| <= bound w is not proven on [0, 1]; None where it is."""
    return _failure(_slack(squares, weight_sq, bound))


def failure_at_least(squares: Polynomial, weight_sq: Polynomial, bound: float) -> str | None:
    """Why |e| >= bound w is not proven on [0, 1]; None where it is."""
    return _failure([-x for x in _slack(squares, weight_sq, bound)])


def _slack(squares: Polynomial, weight_sq: Polynomial, bound: float) -> Polynomial:
    """bound^2 w^2 - |e|^2, times a square."""
    top, whole = float(bound).as_integer_ratio()
    return [top * top * w - whole * whole * s for s, w in zip(squares, weight_sq, strict=True)]


def _check_cover(place: str, name: str, count: int, cells: Sequence[Mapping[str, Any]]) -> None:
    """Raises CertificateError unless the parts of the cells cover [0, 1] on each of the segments."""
    reached = [0.0] * count
    for cell in sorted(cells, key=lambda cell: cell["t"][0]):
        segment, (t0, t1) = cell["segment"], cell["t"]
        if t0 > reached[segment]:
            hole = f"between {reached[segment]!r} and {t0!r}"
            raise CertificateError(f"{place} leave segment {segment} of {name} uncovered {hole}.")
        reached[segment] = max(reached[segment], t1)
    for segment, t in enumerate(reached):
        if t < 1:
            raise CertificateError(f"{place} leave segment {segment} of {name} uncovered between {t!r} and 1.0.")


def _check_witness(witness: Mapping[str, Any], curves: Mapping[str, list[Part]], lower: float) -> None:
    name, other = witness["direction"][0], witness["direction"][-1]
    point = restricted(curves[name][witness["segment"]], [witness["t"]])
    for index, (segment, cuts) in enumerate(zip(curves[other], witness["cuts"], strict=True)):
        for first, last in zip(cuts[:-1], cuts[1:], strict=True):
            failed = failure_at_least(*distance_sq(point, restricted(segment, [first, last])), lower)
            if failed:
                where = f"from the witness to segment {index} of {other} between {first!r} and {last!r}"
                raise CertificateError(f"witness: that the distance {where} is at least {lower!r} {failed}.")


# ---- polynomials of integers ---------------------------------------------------------------------


def _integers(numbers: Iterable[float]) -> tuple[list[int], int]:
    """The m_i and the k for which the numbers are m_i / 2^k."""
    ratios = [float(x).as_integer_ratio() for x in numbers]
    bits = max(whole.bit_length() for _, whole in ratios)
    return [top << (bits - whole.bit_length()) for top, whole in ratios], bits - 1


def _segment(points: Sequence[Sequence[float]], weights: Sequence[float] | None) -> Part:
    columns, bits = _integers([x for column in zip(*points, strict=True) for x in column])
    n = len(points)
    rows = [columns[k : k + n] for k in range(0, len(columns), n)]
    if weights is None:
        return Part([_scaled(row) for row in rows], [1 << bits])
    factors, _ = _integers(weights)
    rows = [[w * x for w, x in zip(factors, row, strict=True)] for row in rows]
    return Part([_scaled(row) for row in rows], _scaled([w << bits for w in factors]))


@cache
def _binomials(degree: int) -> list[int]:
    return [math.comb(degree, i) for i in range(degree + 1)]


@cache
def _cofactors(degree: int) -> list[int]:
    """A common multiple of the binomials over each of them."""
    common = math.lcm(*_binomials(degree))
    return [common // x for x in _binomials(degree)]


def _scaled(coefficients: Sequence[int]) -> Polynomial:
    return [x * c for x, c in zip(coefficients, _binomials(len(coefficients) - 1), strict=True)]


def _product(f: Polynomial, g: Polynomial) -> Polynomial:
    result = [0] * (len(f) + len(g) - 1)
    for i, x in enumerate(f):
        for j, y in enumerate(g, start=i):
            result[j] += x * y
    return result


def _powers(f: Polynomial, count: int) -> list[Polynomial]:
    """1, f, f^2, ... f^count."""
    powers = [[1]]
    for _ in range(count):
        powers.append(_product(powers[-1], f))
    return powers


def _combined(factors: Polynomial, basis: Sequence[Polynomial]) -> Polynomial:
    return [sum(c * x for c, x in zip(factors, column, strict=True)) for column in zip(*basis, strict=True)]


def _elevated(f: Polynomial, degree: int) -> Polynomial:
    """The same polynomial in a higher degree: times one, whose scaled coefficients are the binomials."""
    return f if len(f) > degree else _product(f, _binomials(degree + 1 - len(f)))


def _difference(f: Polynomial, g: Polynomial) -> Polynomial:
    degree = max(len(f), len(g)) - 1
    return [x - y for x, y in zip(_elevated(f, degree), _elevated(g, degree), strict=True)]


def _failure(polynomial: Polynomial) -> str | None:
    """Why it is not proven that the polynomial is non-negative on [0, 1]; None where it is."""
    if min(polynomial) >= 0:
        return None
    parts = [([x * c for x, c in zip(polynomial, _cofactors(len(polynomial) - 1), strict=True)], 0)]
    for _ in range(_MOST_PARTS):
        coefficients, depth = parts.pop()
        if coefficients[0] < 0 or coefficients[-1] < 0:
            return "is false"
        if min(coefficients) < 0:
            if depth == _MOST_HALVINGS:
                return f"is not proven in {_MOST_HALVINGS} halvings"
            parts += [(half, depth + 1) for half in _halves(coefficients)]
        if not parts:
            return None
    return f"is not proven in {_MOST_PARTS} parts"


def _halves(coefficients: list[int]) -> tuple[list[int], list[int]]:
    """Bernstein coefficients of both halves, times 2^n: de Casteljau's algorithm without its divisions."""
    n = len(coefficients) - 1
    left, right = [], []
    for bits in range(n, -1, -1):
        left.append(coefficients[0] << bits)
        right.append(coefficients[-1] << bits)
        coefficients = [x + y for x, y in zip(coefficients[:-1], coefficients[1:], strict=True)]
    return left, right[::-1]


# ---- structure -----------------------------------------------------------------------------------


def check_structure(content: Any) -> None:
    """Raises CertificateError unless the content has all keys, with values of the right kinds, in their ranges.

    What is left to `verify` is whether the cells cover the curves and whether the bounds hold.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise CertificateError(f"is no certificate: it has no format {FORMAT!r}.")
    if content.get("version") != VERSION or isinstance(content["version"], bool):
        raise CertificateError(f"version is {repr(content.get('version'))}; this checker knows version {VERSION}.")
    _check_keys("the certificate", content, ("format", "version", "claim", "a", "b", "cells", "witness"))
    sizes = {name: _check_curve(name, content[name]) for name in ("a", "b")}
    if sizes["a"][1] != sizes["b"][1]:
        raise CertificateError(f"a has {sizes['a'][1]} coordinates a point and b has {sizes['b'][1]}.")
    claim = content["claim"]
    _check_keys("claim", claim, ("kind", "lower", "upper"))
    if not isinstance(claim["kind"], str) or claim["kind"] not in KINDS:
        raise CertificateError(f"claim.kind is {repr(claim['kind'])}; needs one of {', '.join(KINDS)}.")
    directions = KINDS[claim["kind"]]
    _check_numbers("claim.lower", [claim["lower"]], 0.0)
    _check_cells(content["cells"], claim["upper"], directions, {name: size[0] for name, size in sizes.items()})
    if content["witness"] is not None:
        _check_witness_keys(content["witness"], directions, {name: size[0] for name, size in sizes.items()})
    elif claim["lower"] > 0:
        raise CertificateError(f"claim.lower is {claim['lower']!r} and there is no witness.")


def _check_keys(place: str, value: Any, keys: Sequence[str]) -> None:
    if not isinstance(value, Mapping):
        raise CertificateError(f"{place} is {repr(value)}; needs an object with {', '.join(keys)}.")
    for key in keys:
        if key not in value:
            raise CertificateError(f"{place} has no {key!r}.")
    for key in value:
        if key not in keys:
            raise CertificateError(f"{place} has an unknown key {repr(key)}; known are {', '.join(keys)}.")


def _check_list(place: str, value: Any, least: int = 1, most: int | None = None) -> Sequence[Any]:
    if not isinstance(value, list) or len(value) < least or (most is not None and len(value) > most):
        wanted = f"at least {least}" if most is None else f"{least}" if least == most else f"{least} to {most}"
        raise CertificateError(f"{place} is {repr(value)}; needs a list of {wanted}.")
    return value


def _check_numbers(place: str, values: Sequence[Any], least: float = -math.inf, most: float = math.inf) -> None:
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise CertificateError(f"{place} holds {repr(value)}; needs a number.")
        if isinstance(value, int) and abs(value) > 2**53:
            raise CertificateError(f"{place} holds a whole number above 2^53, which is no float.")
        if not math.isfinite(value) or not least <= value <= most:
            raise CertificateError(f"{place} holds {value!r}; needs finite numbers from {least} to {most}.")


def _check_parameters(place: str, values: Sequence[Any], most: float = 1.0) -> None:
    _check_numbers(place, values, 0.0, most)
    for value in values:
        if float(value).as_integer_ratio()[1].bit_length() > _MOST_BITS or value > 2.0**_MOST_BITS:
            raise CertificateError(f"{place} holds {value!r}; needs multiples of 2^-{_MOST_BITS - 1}, and none huge.")


def _check_index(place: str, value: Any, count: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
        raise CertificateError(f"{place} is {repr(value)}; needs a whole number from 0 to {count - 1}.")


def _check_curve(name: str, curve: Any) -> tuple[int, int]:
    """The number of segments and of coordinates, after all of them have been looked at."""
    _check_keys(name, curve, ("control_points", "weights"))
    segments = _check_list(f"{name}.control_points", curve["control_points"])
    points = len(_check_list(f"{name}.control_points[0]", segments[0], 1, _LARGEST_DEGREE + 1))
    dim = len(_check_list(f"{name}.control_points[0][0]", segments[0][0], 2, 3))
    for k, segment in enumerate(segments):
        place = f"{name}.control_points[{k}]"
        for i, point in enumerate(_check_list(place, segment, points, points)):
            _check_numbers(f"{place}[{i}]", _check_list(f"{place}[{i}]", point, dim, dim))
    if curve["weights"] is not None:
        for k, row in enumerate(_check_list(f"{name}.weights", curve["weights"], len(segments), len(segments))):
            place = f"{name}.weights[{k}]"
            _check_positive(place, _check_list(place, row, points, points))
    return len(segments), dim


def _check_positive(place: str, values: Sequence[Any]) -> None:
    _check_numbers(place, values)
    if min(values) <= 0:
        raise CertificateError(f"{place} holds {min(values)!r}; needs positive numbers.")


def _check_cells(cells: Any, upper: Any, directions: Sequence[str], counts: Mapping[str, int]) -> None:
    if upper is None:
        if cells is not None:
            raise CertificateError("claim.upper is null, so cells must be null.")
        return
    _check_numbers("claim.upper", [upper], 0.0)
    _check_keys("cells", cells, directions)
    for direction in directions:
        for index, cell in enumerate(_check_list(f"cells.{direction}", cells[direction])):
            place = f"cells.{direction}[{index}]"
            _check_keys(place, cell, ("segment", "t", "foot", "sigma", "sigma_weights", "bound"))
            _check_index(f"{place}.segment", cell["segment"], counts[direction[0]])
            _check_index(f"{place}.foot", cell["foot"], counts[direction[-1]])
            _check_parameters(f"{place}.t", _check_list(f"{place}.t", cell["t"], 2, 2))
            if cell["t"][0] > cell["t"][1]:
                raise CertificateError(f"{place}.t is {cell['t']}; its ends are in the wrong order.")
            _check_numbers(f"{place}.bound", [cell["bound"]], 0.0)
            _check_sigma(place, cell["sigma"], cell["sigma_weights"])


def _check_sigma(place: str, sigma: Any, weights: Any) -> None:
    """Raises CertificateError unless 0 <= S_i <= W_i and W_i > 0, with W_i = 1 where there are no weights."""
    sigma = _check_list(f"{place}.sigma", sigma, 1, _LARGEST_SIGMA + 1)
    if weights is None:
        _check_parameters(f"{place}.sigma", sigma)
        return
    _check_positive(f"{place}.sigma_weights", _check_list(f"{place}.sigma_weights", weights, len(sigma), len(sigma)))
    for s, w in zip(sigma, weights, strict=True):
        _check_parameters(f"{place}.sigma", [s], float(w))
        _check_parameters(f"{place}.sigma_weights", [w], math.inf)


def _check_witness_keys(witness: Any, directions: Sequence[str], counts: Mapping[str, int]) -> None:
    _check_keys("witness", witness, ("direction", "segment", "t", "cuts"))
    direction = witness["direction"]
    if direction not in directions:
        raise CertificateError(f"witness.direction is {repr(direction)}; needs {' or '.join(directions)}.")
    _check_index("witness.segment", witness["segment"], counts[direction[0]])
    _check_parameters("witness.t", [witness["t"]])
    count = counts[direction[-1]]
    for k, cuts in enumerate(_check_list("witness.cuts", witness["cuts"], count, count)):
        place = f"witness.cuts[{k}]"
        _check_parameters(place, _check_list(place, cuts, 2))
        if cuts[0] != 0 or cuts[-1] != 1 or any(x > y for x, y in zip(cuts[:-1], cuts[1:], strict=True)):
            raise CertificateError(f"{place} is {repr(cuts)}; needs cuts in order from 0 to 1.")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
