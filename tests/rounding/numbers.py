"""Numbers for the interpreter: exact ones, and those of a format with as many bits as one likes."""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from tests.rounding.interpreter import COMPARED, AbstractArithmetic

# Roots are taken with so many bits after the point, rounded down: nothing beside what is looked for.
_ROOT_BITS = 600


def root(x: Fraction) -> Fraction:
    """The square root of a number that is not negative, rounded down to 2^-600."""
    return Fraction(math.isqrt((x.numerator << 2 * _ROOT_BITS) // x.denominator), 1 << _ROOT_BITS)


def exactly(x: Any) -> np.ndarray:
    """The same numbers as fractions."""
    x = np.asarray(x)
    found = np.empty(x.shape, object)
    found.reshape(-1)[:] = [Fraction(v) for v in x.reshape(-1).tolist()]
    return found


class _AbstractOfArrays(AbstractArithmetic):
    """Numbers that are one array each."""

    def compare(self, name: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(COMPARED[name](x, y)).astype(bool)

    def select(self, which: np.ndarray, cases: list[np.ndarray]) -> np.ndarray:
        return np.choose(which, cases)


class Exact(_AbstractOfArrays):
    """Rational numbers: kernels without any rounding; of roots see `root`."""

    def lift(self, x: np.ndarray, constant: bool) -> np.ndarray:
        return exactly(x)

    def value(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(x, float)

    def apply(self, name: str, operands: list[np.ndarray], parameters: dict[str, Any]) -> np.ndarray:
        if name not in _EXACT:
            raise NotImplementedError(f"the primitive {name} is not known.")
        return np.asarray(_EXACT[name](operands, parameters), object)


def _over(function: Callable) -> Callable:
    return lambda x, p: function(x[0], axis=tuple(int(k) for k in p["axes"]))


_EXACT: dict[str, Callable] = {
    "add": lambda x, p: x[0] + x[1],
    "sub": lambda x, p: x[0] - x[1],
    "mul": lambda x, p: x[0] * x[1],
    "div": lambda x, p: x[0] / x[1],
    "neg": lambda x, p: -x[0],
    "abs": lambda x, p: np.abs(x[0]),
    "max": lambda x, p: np.maximum(x[0], x[1]),
    "min": lambda x, p: np.minimum(x[0], x[1]),
    "square": lambda x, p: x[0] * x[0],
    "integer_pow": lambda x, p: x[0] ** p["y"],
    "sqrt": lambda x, p: np.vectorize(root, otypes=[object])(x[0]),
    "reduce_sum": _over(np.sum),
    "reduce_max": _over(np.max),
    "reduce_min": _over(np.min),
}


class Rounded(_AbstractOfArrays):
    """Numbers of `bits` binary digits, every operation rounded.

    Args:
        bits: of the significand, at most 24: operations in double precision are exact then, or far more accurate.
        way: "nearest", to even; "down", "up", "zero" or "away", by which all errors go one way.
        least: results below this number are flushed to zero.
    """

    def __init__(self, bits: int, way: str = "nearest", least: float = 0.0):
        self.bits, self.way, self.least = bits, way, least

    def lift(self, x: np.ndarray, constant: bool) -> np.ndarray:
        return self.rounded(np.asarray(x, float)) if constant else np.asarray(x, float)

    def value(self, x: np.ndarray) -> np.ndarray:
        return x

    def rounded(self, x: np.ndarray) -> np.ndarray:
        """The numbers of the format next to these."""
        fraction, exponent = np.frexp(x)
        found = np.ldexp(_WAYS[self.way](np.ldexp(fraction, self.bits)), exponent - self.bits)
        return np.where(np.abs(found) < self.least, 0.0, found)

    def apply(self, name: str, operands: list[np.ndarray], parameters: dict[str, Any]) -> np.ndarray:
        x = operands[0]
        if name == "reduce_sum":
            axes = tuple(int(k) for k in parameters["axes"])
            rows = np.moveaxis(x, axes, range(len(axes))).reshape(-1, *np.delete(x.shape, axes).astype(int))
            total = rows[0]
            for row in rows[1:]:
                total = self.rounded(total + row)
            return np.asarray(total)
        if name == "integer_pow":
            total = x
            for _ in range(parameters["y"] - 1):
                total = self.rounded(total * x)
            return total
        if name in ("neg", "abs", "max", "min", "reduce_max", "reduce_min"):
            return np.asarray(_EXACT[name](operands, parameters), float)
        if name not in _ROUNDED:
            raise NotImplementedError(f"the primitive {name} is not known.")
        return self.rounded(np.asarray(_ROUNDED[name](*operands)))


_ROUNDED: dict[str, Callable] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "square": np.square,
    "sqrt": np.sqrt,
}
_WAYS: dict[str, Callable] = {
    "nearest": np.rint,
    "down": np.floor,
    "up": np.ceil,
    "zero": np.trunc,
    "away": lambda x: np.copysign(np.ceil(np.abs(x)), x),
}
