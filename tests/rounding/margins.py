"""What the constants of a kernel leave for rounding, beside the error that is derived from its steps."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from jhd._arithmetic.rounding import smallest_normal, unit_roundoff
from tests.rounding.enclosed import Enclosed, Known
from tests.rounding.interpreter import evaluate

# Where a module takes the size of roundings from.
_SOURCES = ("gamma", "unit_roundoff", "smallest_normal")


def format_of(dtype: Any) -> Enclosed:
    """The arithmetic of a type of numbers."""
    return Enclosed(unit_roundoff(dtype), smallest_normal(dtype))


@contextmanager
def traced_anew(modules: Sequence[ModuleType], rounding: bool) -> Iterator[None]:
    """Functions of the modules are traced where they are called; without `rounding` as if there were none."""
    kept = [(module, name, value) for module in modules for name, value in vars(module).items()]
    try:
        for module, name, value in kept:
            if hasattr(value, "lower") and hasattr(value, "__wrapped__"):
                setattr(module, name, value.__wrapped__)
            if name in _SOURCES and not rounding:
                setattr(module, name, lambda *_: 0.0)
        yield
    finally:
        for module, name, value in kept:
            setattr(module, name, value)


def margin(
    function: Callable, inputs: Sequence[Any], modules: Sequence[ModuleType], sign: int
) -> tuple[np.ndarray, np.ndarray]:
    """What the constants move a bound by, at least, and the derived error of computing it.

    Args:
        function: computes the bound from numbers that are known exactly.
        inputs: of one type.
        modules: whose constants they are.
        sign: 1 for upper bounds, -1 for lower ones.
    """
    numbers = format_of(np.asarray(inputs[0]).dtype)
    bound, plain = (_evaluated(function, numbers, inputs, modules, rounding) for rounding in (True, False))
    left = bound.low - plain.high if sign > 0 else plain.low - bound.high
    return left, bound.error


def _evaluated(
    function: Callable, numbers: Enclosed, inputs: Sequence[Any], modules: Sequence[ModuleType], rounding: bool
) -> Known:
    with traced_anew(modules, rounding):
        # A function of its own: what has been traced is kept under the function's name.
        return evaluate(lambda *x: function(*x), numbers, inputs, [None] * len(inputs))
