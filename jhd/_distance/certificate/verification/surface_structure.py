"""The structure of the parts of a certificate that belong to implicit surfaces.

- The shape: `coefficients` of x^i y^j z^k, and the corners `lower` and `upper` of the box that holds its zeros.
- A point of the surface: `at` and `way`, three coordinates each, in space. The polynomial changes its sign between
  at - way and at + way, or is zero at both.
- A foot on the surface: `map`, the point as one row, or as one row for each corner of the cell; `way`, in the same
  form; `zero`, the multiplier of the foot.
- A cell of the surface: `zero`, the multiplier of the cell, which is null if the cell holds no zero; such a cell has no
  feet.
"""

import math
from collections.abc import Mapping
from typing import Any

from jhd._distance.certificate.verification.values import (
    CertificateError,
    check_keys,
    check_list,
    check_numbers,
    check_parameters,
)

# Degree in each variable, and in all, that is read: beyond them one cell could take hours.
LARGEST, LARGEST_IN_ALL = 10, 12


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
