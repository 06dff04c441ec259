"""Checks of single values of a certificate: objects, lists and numbers of the right kinds and sizes."""

import math
from collections.abc import Mapping, Sequence
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any

# Bits of parameters and multipliers behind the point.
MOST_BITS = 256


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
