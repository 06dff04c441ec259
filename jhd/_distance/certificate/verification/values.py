"""Checks of single values of a certificate, and of its parts that belong to implicit surfaces.

- The shape: `coefficients` of x^i y^j z^k, and the corners `lower` and `upper` of the box that holds its zeros.
- A point of the surface: `at` and `way`, three coordinates each, in space. The polynomial changes its sign between
  at - way and at + way, or is zero at both.
- A foot on the surface: `map`, the point as one row, or as one row for each corner of the cell; `way`, in the same
  form; `zero`, the multiplier of the foot.
- A cell of the surface: `zero`, the multiplier of the cell, which is null if the cell holds no zero; such a cell has no
  feet.
"""

import math
from collections.abc import Mapping, Sequence
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any

# Bits of parameters and multipliers behind the point.
MOST_BITS = 256
# Degree in each variable, and in all, that is read: beyond them one cell could take hours.
LARGEST, LARGEST_IN_ALL = 10, 12


class CertificateError(ValueError):
    """A certificate is refused: it has an unknown format, is incomplete, or does not prove its claim."""


class UncheckedCertificateError(CertificateError):
    """The time limit ended before a certificate was checked."""


def check_keys(place: str, value: Any, keys: Sequence[str], more: Sequence[str] = ()) -> None:
    """Raise CertificateError unless it is an object with these keys, and no others except `more`."""
    if not isinstance(value, Mapping):
        raise CertificateError(f"{place} is {repr(value)}; needs an object with {', '.join(keys)}.")
    for key in keys:
        if key not in value:
            raise CertificateError(f"{place} has no {key!r}.")
    for key in value:
        if key not in keys and key not in more:
            raise CertificateError(f"{place} has an unknown key {repr(key)}; known are {', '.join(keys)}.")


def check_list(place: str, value: Any, least: int = 1, most: int | None = None) -> Sequence[Any]:
    """Return the value; raise CertificateError unless it is a list of `least` to `most` entries."""
    if not isinstance(value, list) or len(value) < least or (most is not None and len(value) > most):
        wanted = f"at least {least}" if most is None else f"{least}" if least == most else f"{least} to {most}"
        raise CertificateError(f"{place} is {repr(value)}; needs a list of {wanted}.")
    return value


def check_numbers(place: str, values: Sequence[Any], least: float = -math.inf, most: float = math.inf) -> None:
    """Raise CertificateError unless all of them are floats in the range."""
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise CertificateError(f"{place} holds {repr(value)}; needs a number.")
        if isinstance(value, int) and abs(value) > 2**53:
            raise CertificateError(f"{place} holds a whole number above 2^53, which is no float.")
        if not math.isfinite(value) or not least <= value <= most:
            raise CertificateError(f"{place} holds {value!r}; needs finite numbers from {least} to {most}.")


def check_positive(place: str, values: Sequence[Any]) -> None:
    """Raise CertificateError unless all of them are positive floats."""
    check_numbers(place, values)
    if min(values) <= 0:
        raise CertificateError(f"{place} holds {min(values)!r}; needs positive numbers.")


def check_index(place: str, value: Any, count: int) -> None:
    """Raise CertificateError unless it is an index below `count`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
        raise CertificateError(f"{place} is {repr(value)}; needs a whole number from 0 to {count - 1}.")


def check_parameters(place: str, values: Sequence[Any], most: float = 1.0, least: float = 0.0) -> None:
    """Raise CertificateError unless all of them are floats in the range, with few bits."""
    check_numbers(place, values, least, most)
    for value in values:
        if float(value).as_integer_ratio()[1].bit_length() > MOST_BITS or abs(value) > 2.0**MOST_BITS:
            raise CertificateError(f"{place} holds {value!r}; needs multiples of 2^-{MOST_BITS - 1}, and none huge.")


# ---- implicit surfaces ---------------------------------------------------------------------------


def check_surface(name: str, shape: Mapping[str, Any]) -> int:
    """Return the total degree of a polynomial; raise CertificateError unless the shape is one with its box."""
    place, degree = f"{name}.coefficients", -1
    rows = check_list(place, shape["coefficients"], 1, LARGEST + 1)
    columns = len(check_list(f"{place}[0]", rows[0], 1, LARGEST + 1))
    count = len(check_list(f"{place}[0][0]", rows[0][0], 1, LARGEST + 1))
    for i, row in enumerate(rows):
        for j, numbers in enumerate(check_list(f"{place}[{i}]", row, columns, columns)):
            check_numbers(f"{place}[{i}][{j}]", check_list(f"{place}[{i}][{j}]", numbers, count, count))
            degree = max([degree, *(i + j + k for k, x in enumerate(numbers) if x != 0)])
    if not 1 <= degree <= LARGEST_IN_ALL:
        raise CertificateError(f"{place} are of degree {degree}; needs 1 to {LARGEST_IN_ALL}.")
    for end in ("lower", "upper"):
        check_numbers(f"{name}.{end}", check_list(f"{name}.{end}", shape[end], 3, 3))
    if not all(low < high for low, high in zip(shape["lower"], shape["upper"], strict=True)):
        raise CertificateError(f"{name}.lower is not below {name}.upper.")
    return degree


def check_surface_place(place: str, found: Any, more: tuple[str, ...] = ()) -> None:
    """Raise CertificateError unless `found` is a point of a surface, with the keys `more` in addition."""
    check_keys(place, found, ("at", "way", *more))
    for key in ("at", "way"):
        check_parameters(f"{place}.{key}", check_list(f"{place}.{key}", found[key], 3, 3), math.inf, -math.inf)


def check_surface_foot(place: str, foot: Any, corners: int) -> None:
    """Raise CertificateError unless `foot` is a foot on a surface, for a cell with `corners` corners."""
    check_keys(place, foot, ("map", "way", "zero"))
    rows = check_list(f"{place}.map", foot["map"])
    if len(rows) not in (1, corners):
        raise CertificateError(f"{place}.map has {len(rows)} rows; needs one of 1, {corners}.")
    for k, row in [*enumerate(rows), ("", foot["way"])]:
        name = f"{place}.map[{k}]" if k != "" else f"{place}.way"
        check_parameters(name, check_list(name, row, 3, 3), math.inf, -math.inf)
    check_multiplier(f"{place}.zero", foot["zero"], 2 * corners)


def check_multiplier(place: str, numbers: Any, corners: int) -> None:
    """Raise CertificateError unless it is a number, or a list with one for each corner."""
    if len(check_list(place, numbers, 1, corners)) not in (1, corners):
        raise CertificateError(f"{place} has {len(numbers)} numbers; needs one of 1, {corners}.")
    check_parameters(place, numbers, math.inf, -math.inf)
