"""Numbers with a proven bound of their rounding error: the tool that derives what the constants of kernels must be.

A number is known as a range [low, high] of the exact value, which inputs from ranges have, and a bound of how far the
computed value is from it, where every operation rounds by a relative u and an absolute nu. The bound covers what XLA
may do: it fuses products with sums (one rounding less), divides by multiplying with a reciprocal (two roundings),
flushes what is below nu, and sums in any order. Errors of the operands are carried in full, products of errors too, so
the bound is none of first order alone. All of it is computed in double precision and rounded outward.

What is chosen by numbers (a branch, an index) is chosen by the exact ones; where ranges do not tell, the tool says so.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tests.rounding.interpreter import AbstractArithmetic, each_part

# Room for the roundings of a few operations on bounds, in double precision.
_ROOM = 1 + 2.0**-48
_LEAST = 2.0**-1070
# Constants with more digits than this have been rounded themselves: weights like 1/3, not 0.5 or 6.
_SHORT = 20


class Known(NamedTuple):
    """Ranges of exact values, and bounds of the errors of the computed ones."""

    low: np.ndarray
    high: np.ndarray
    error: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """The largest absolute value of the exact number."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    @property
    def computed(self) -> np.ndarray:
        """The largest absolute value of the computed one."""
        return (self.size + self.error) * _ROOM


class Enclosed(AbstractArithmetic):
    """Numbers with errors, in a format of unit roundoff u and smallest normal number nu."""

    def __init__(self, u: float, nu: float):
        self.u, self.nu = u, nu

    def known(self, low: Any, high: Any, error: Any = 0.0) -> Known:
        """Numbers from ranges that are off by an error already."""
        low, high, error = np.broadcast_arrays(*(np.asarray(x, float) for x in (low, high, error)))
        return Known(low, high, error)

    def lift(self, x: np.ndarray, constant: bool) -> Known:
        x = np.asarray(x, float)
        fraction = np.ldexp(np.frexp(np.where(np.isfinite(x), x, 0.0))[0], _SHORT)
        rounded = constant & (fraction != np.rint(fraction))
        return Known(x, x, np.where(rounded, self.u * np.abs(x), 0.0) * _ROOM)

    def value(self, x: Known) -> np.ndarray:
        return np.where(np.isfinite(x.low) & np.isfinite(x.high), 0.5 * (x.low + x.high), x.low)

    def compare(self, name: str, x: Known, y: Known) -> Any:
        low, high = np.less(x.high, y.low), np.greater(x.low, y.high)
        touching = (x.low == x.high) & (y.low == y.high) & (x.low == y.low)
        surely = {
            "lt": (low, high | touching | np.equal(x.low, y.high)),
            "gt": (high, low | touching | np.equal(x.high, y.low)),
            "le": (low | np.equal(x.high, y.low), high),
            "ge": (high | np.equal(x.low, y.high), low),
            "eq": (touching, low | high),
            "ne": (low | high, touching),
        }
        true, false = surely[name]
        if not np.all(true | false):
            raise NotImplementedError(f"ranges do not tell what the comparison {name} gives.")
        return np.asarray(true)

    def select(self, which: np.ndarray, cases: list[Known]) -> Known:
        return Known(*(np.choose(which, rows) for rows in zip(*cases, strict=True)))

    def apply(self, name: str, operands: list[Known], parameters: dict[str, Any]) -> Known:
        if name not in _OPERATIONS:
            raise NotImplementedError(f"the primitive {name} is not known.")
        return _OPERATIONS[name](self, operands, parameters)

    def rounded(self, low: np.ndarray, high: np.ndarray, carried: np.ndarray, exact: Any, times: int = 1) -> Known:
        """A result from its range and what the errors of the operands make of it; `exact` where nothing is rounded."""
        low, high = np.where(exact, low, np.nextafter(low, -np.inf)), np.where(exact, high, np.nextafter(high, np.inf))
        size = np.maximum(np.abs(low), np.abs(high)) + carried
        u = self.u * times * (1 + self.u) ** times
        return Known(
            low, high, np.where(exact, carried, carried + u * size + times * self.nu) * _ROOM + _LEAST * ~exact
        )


def _zero(x: Known) -> np.ndarray:
    return (x.size == 0) & (x.error == 0)


def _power(x: Known) -> np.ndarray:
    """Whether a factor is a power of two, which only moves the exponent."""
    return (x.low == x.high) & (x.error == 0) & (np.abs(np.frexp(x.low)[0]) == 0.5)


def _negated(x: Known) -> Known:
    return Known(-x.high, -x.low, x.error)


def _sum(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    x, y = operands
    found = numbers.rounded(x.low + y.low, x.high + y.high, x.error + y.error, _zero(x) | _zero(y))
    # Where both ends of the range are sums without rounding they stay: a difference of equal numbers is zero.
    low, high = (np.where(_is_sum(a, b), a + b, end) for a, b, end in ((x[0], y[0], found[0]), (x[1], y[1], found[1])))
    return Known(low, high, found.error)


def _is_sum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether the rounded sum is the exact one (Knuth's error-free sum)."""
    total = a + b
    part = total - a
    return (a - (total - part)) + (b - part) == 0


def _product(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    x, y = operands
    ends = [a * b for a in (x.low, x.high) for b in (y.low, y.high)]
    carried = (x.size * y.error + x.error * y.computed) * _ROOM
    exact = _zero(x) | _zero(y) | _power(x) | _power(y)
    return numbers.rounded(np.minimum.reduce(ends), np.maximum.reduce(ends), carried, exact)


def _quotient(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    x, y = operands
    least = np.minimum(np.abs(y.low), np.abs(y.high))
    if np.any((y.low <= 0) & (y.high >= 0) | (y.error >= least)):
        raise NotImplementedError("a divisor may vanish.")
    ends = [a / b for a in (x.low, x.high) for b in (y.low, y.high)]
    low, high = np.minimum.reduce(ends), np.maximum.reduce(ends)
    size = np.maximum(np.abs(low), np.abs(high))
    carried = (x.error + size * y.error) / (least - y.error) * _ROOM
    # The reciprocal may be flushed.
    carried = np.where(_power(y), carried, carried + x.computed * numbers.nu)
    return numbers.rounded(low, high, carried, _zero(x) | _power(y), 2)


def _root(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    (x,) = operands
    low, high = (np.sqrt(np.maximum(end, 0.0)) for end in (x.low, x.high))
    both = low + np.sqrt(np.maximum(x.low - x.error, 0.0))
    carried = np.where(both > 0, x.error / np.where(both > 0, both, 1.0), np.inf)
    return numbers.rounded(low, high, np.minimum(carried, np.sqrt(x.error)) * _ROOM, _zero(x))


def _absolute(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    (x,) = operands
    return Known(np.maximum(np.maximum(x.low, -x.high), 0.0), x.size, x.error)


def _larger(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    x, y = operands
    error = np.maximum(x.error, y.error)
    error = np.where(x.low - x.error > (y.high + y.error), x.error, error)
    error = np.where(y.low - y.error > x.high + x.error, y.error, error)
    return Known(np.maximum(x.low, y.low), np.maximum(x.high, y.high), error)


def _largest(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    (x,), axes = operands, tuple(int(k) for k in parameters["axes"])
    # Only those that may be the largest ones as computed can be taken.
    possible = x.high + x.error >= np.max(x.low - x.error, axis=axes, keepdims=True)
    error = np.max(np.where(possible, x.error, 0.0), axis=axes)
    return Known(np.max(x.low, axis=axes), np.max(x.high, axis=axes), error)


def _total(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    (x,), axes = operands, tuple(int(k) for k in parameters["axes"])
    terms = np.sum(~_zero(x), axis=axes)
    sizes = np.sum(x.computed, axis=axes) * _ROOM
    n = np.maximum(terms - 1, 0)
    rounding = n * numbers.u / (1 - n * numbers.u) * sizes + n * numbers.nu
    lost = terms * 2.0**-52 * sizes
    carried = np.sum(x.error, axis=axes)
    error = (carried + rounding) * (1 + terms * 2.0**-50)
    return Known(np.sum(x.low, axis=axes) - lost, np.sum(x.high, axis=axes) + lost, error)


def _scalar_product(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    (summed, batch), (x, y) = parameters["dimension_numbers"], operands
    if len(summed[0]) != 1:
        raise NotImplementedError("a dot_general along several axes.")
    # Batches first, and last what is summed.
    count = len(batch[0])
    rows, columns = (
        each_part(lambda v, k=k: np.moveaxis(v, (*batch[k], summed[k][0]), (*range(count), -1)), z)
        for k, z in enumerate((x, y))
    )
    free, own = (z.low.ndim - 1 - count for z in (columns, rows))
    rows = each_part(lambda v: v.reshape(*v.shape[:-1], *[1] * free, v.shape[-1]), rows)
    columns = each_part(lambda v: v.reshape(*v.shape[:count], *[1] * own, *v.shape[count:]), columns)
    product = _product(numbers, [rows, columns], {})
    return _total(numbers, [product], {"axes": (product.low.ndim - 1,)})


def _whole_power(numbers: Enclosed, operands: list[Known], parameters: dict[str, Any]) -> Known:
    if parameters["y"] < 1:
        raise NotImplementedError("a power that is not positive.")
    total = operands[0]
    for _ in range(parameters["y"] - 1):
        total = _product(numbers, [total, operands[0]], {})
    return total


_OPERATIONS: dict[str, Callable] = {
    "add": _sum,
    "sub": lambda n, x, p: _sum(n, [x[0], _negated(x[1])], p),
    "mul": _product,
    "div": _quotient,
    "sqrt": _root,
    "neg": lambda n, x, p: _negated(x[0]),
    "abs": _absolute,
    "max": _larger,
    "min": lambda n, x, p: _negated(_larger(n, [_negated(v) for v in x], p)),
    "reduce_max": _largest,
    "reduce_min": lambda n, x, p: _negated(_largest(n, [_negated(x[0])], p)),
    "reduce_sum": _total,
    "integer_pow": _whole_power,
    "square": lambda n, x, p: _product(n, [x[0], x[0]], p),
    "dot_general": _scalar_product,
}
