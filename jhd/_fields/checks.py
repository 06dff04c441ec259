"""Checks of the options of distance fields: each returns the value, or raises an error with the valid range."""

import math
import operator
from typing import Any

import numpy as np

from jhd._runtime.arrays import real_array


def one_of(name: str, value: object, names: tuple[str, ...]) -> Any:
    """The value, which must be one of these names."""
    if value not in names:
        raise ValueError(f"{name} is {value!r}; needs one of {', '.join(map(repr, names))}.")
    return value


def positive(name: str, value: object) -> float:
    """The value as a positive, finite number."""
    number = np.asarray(real_array(name, value))
    if number.ndim:
        raise ValueError(f"{name} has shape {number.shape}; needs a scalar.")
    if not 0 < float(number) < math.inf:
        raise ValueError(f"{name} is {float(number):g}; needs a positive number.")
    return float(number)


def whole(name: str, value: object, least: int, most: int) -> int:
    """The value as a whole number within a range, its ends included."""
    try:
        number = operator.index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        raise TypeError(f"{name} must be a whole number; got {type(value).__name__}.") from None
    if not least <= number <= most:
        raise ValueError(f"{name} is {number}; needs {least} to {most}.")
    return number
