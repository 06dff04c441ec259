"""Interval arithmetic on arrays, rounded outward.

Every operation returns an interval that contains the exact result of real arithmetic for every choice of numbers in its
operands. An infinite end means that no bound is known. No operation returns NaN; a NaN operand gives the whole line.
One operation widens by two to four units in the last place. For long formulas an a-priori bound
(`rounding.absolute_error`) is therefore both cheaper and narrower.

Source: Moore, Kearfott & Cloud, Introduction to Interval Analysis (2009), chapters 2 to 5; Hickey, Ju & van Emden,
Interval arithmetic: from principles to implementation, JACM 48 (2001), for the products of zero and infinity.
"""

import operator
from collections.abc import Callable
from typing import Union

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jhd._arithmetic import rounding
from jhd._results.display import described, fields_shown, is_known
from jhd._runtime.decimals import lower_text, upper_text

Operand = Union["Interval", ArrayLike]


def _lower(x: ArrayLike) -> Array:
    return rounding.flush_down(_floats(x, "lower"))


def _upper(x: ArrayLike) -> Array:
    return rounding.flush_up(_floats(x, "upper"))


class Interval(eqx.Module):
    """Intervals of real numbers, lower <= x <= upper elementwise, with outward rounding; empty if lower > upper.

    Floats in arithmetic are taken as exact. Ends are zero, normal or infinite. Subnormal ends are moved outward,
    because XLA computes with them as if they were zero. A NaN becomes an infinite end.

    >>> import jhd
    >>> third = jhd.arithmetic.Interval.exact(1.0) / 3.0
    >>> bool((3.0 * third).contains(1.0)), bool(third.width < 1e-15)
    (True, True)

    Args:
        lower: lower ends; a number that is not a float of the default precision is rounded down, as in `exact`.
        upper: upper ends, of the same shape; rounded up accordingly.
    """

    lower: Float[Array, "..."] = eqx.field(converter=_lower)
    upper: Float[Array, "..."] = eqx.field(converter=_upper)

    @classmethod
    def exact(cls, x: ArrayLike) -> "Interval":
        """The interval of the number x alone, or of its neighboring floats if x is not representable.

        Args:
            x: real numbers. A float array of JAX is taken as it is, whatever its precision; Python and NumPy numbers
                are compared with their converted values. NaN gives the whole line; infinity gives the numbers beyond
                the largest float.

        Returns:
            An Interval with the shape of `x`.
        """
        if isinstance(x, jax.Array):
            return cls._of_array(x)
        given = np.asarray(x)
        with np.errstate(over="ignore"):
            near = given.astype(jnp.result_type(float))
        if given.dtype == near.dtype:
            return cls._of_ends(jnp.asarray(near), jnp.asarray(near))
        # Python's comparison of an integer with a float is exact, NumPy's converts the integer first.
        with np.errstate(invalid="ignore"):
            below, above = given.astype(object) < near.astype(object), given.astype(object) > near.astype(object)
        lower = np.where(below.astype(bool), np.nextafter(near, -np.inf), near)
        upper = np.where(above.astype(bool), np.nextafter(near, np.inf), near)
        return cls._of_ends(jnp.asarray(lower), jnp.asarray(upper))

    @classmethod
    def _of_array(cls, x: Array) -> "Interval":
        if jnp.issubdtype(x.dtype, jnp.floating):
            return cls._of_ends(x, x)
        near = x.astype(float)
        wide = jnp.abs(near) >= 1 / rounding.unit_roundoff(near.dtype)
        down, up = rounding.round_down(near), rounding.round_up(near)
        return cls(jnp.where(wide, down, near), jnp.where(wide, up, near))

    @classmethod
    def _of_ends(cls, lower: Array, upper: Array) -> "Interval":
        # Comparisons take subnormal numbers for zeros, so these move outward first.
        lower, upper, top = rounding.flush_down(lower), rounding.flush_up(upper), rounding.largest(lower.dtype)
        return cls(jnp.minimum(lower, top), jnp.maximum(upper, -top))

    @classmethod
    def whole(cls, shape: tuple[int, ...] = ()) -> "Interval":
        """The whole line, from -inf to inf.

        Args:
            shape: shape of the arrays of ends; the default is a single interval.

        Returns:
            An Interval of this shape.
        """
        return cls(jnp.full(shape, -jnp.inf), jnp.full(shape, jnp.inf))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the arrays of ends."""
        return self.lower.shape

    @property
    def width(self) -> Float[Array, "..."]:
        """Upper bound of upper - lower; infinite if an end is infinite."""
        return rounding.round_up(self.upper - self.lower)

    @property
    def midpoint(self) -> Float[Array, "..."]:
        """A finite float inside the interval, near its middle; 0 for the whole line.

        Infinite ends count as the largest float.
        """
        top = rounding.largest(self.lower.dtype)
        lower, upper = jnp.maximum(self.lower, -top), jnp.minimum(self.upper, top)
        return jnp.clip(0.5 * lower + 0.5 * upper, lower, upper)

    @property
    def empty(self) -> Bool[Array, "..."]:
        """Whether lower > upper, for example after the intersection of disjoint intervals."""
        return self.lower > self.upper

    def contains(self, x: ArrayLike) -> Bool[Array, "..."]:
        """Whether lower <= x <= upper; exact for every float, including subnormal ones.

        Args:
            x: numbers; one that is not a float counts as the interval that `exact` gives.

        Returns:
            Booleans in the common shape of the interval and `x`.
        """
        known = Interval.exact(x)
        return (self.lower <= known.lower) & (known.upper <= self.upper)

    def __repr__(self) -> str:
        if is_known(self.lower) and self.lower.ndim == 0:
            return described(self, lower_text(self.lower), upper_text(self.upper))
        return fields_shown(self, "lower", "upper")

    def __getitem__(self, index: object) -> "Interval":
        return Interval(self.lower[index], self.upper[index])  # pyright: ignore[reportArgumentType]

    def __neg__(self) -> "Interval":
        return Interval(-self.upper, -self.lower)

    def __add__(self, other: Operand) -> "Interval":
        other = as_interval(other)
        return Interval(
            rounding.round_down(self.lower + other.lower),
            rounding.round_up(self.upper + other.upper),
        )

    def __sub__(self, other: Operand) -> "Interval":
        return self + -as_interval(other)

    def __mul__(self, other: Operand) -> "Interval":
        """The range of products: the hull of the four products of ends, with 0 * inf = 0.

        An infinite end stands for arbitrarily large numbers.
        """
        return _hull_of_ends(_product, self, as_interval(other))

    def __truediv__(self, other: Operand) -> "Interval":
        """The range of quotients; the whole line if `other` contains zero, even as an end."""
        other = as_interval(other)
        pole = (other.lower <= 0) & (other.upper >= 0)
        divisor = Interval(jnp.where(pole, 1.0, other.lower), jnp.where(pole, 1.0, other.upper))
        result = _hull_of_ends(_quotient, self, divisor)
        return Interval(jnp.where(pole, -jnp.inf, result.lower), jnp.where(pole, jnp.inf, result.upper))

    def __radd__(self, other: ArrayLike) -> "Interval":
        return self + other

    def __rsub__(self, other: ArrayLike) -> "Interval":
        return as_interval(other) - self

    def __rmul__(self, other: ArrayLike) -> "Interval":
        return self * other

    def __rtruediv__(self, other: ArrayLike) -> "Interval":
        return as_interval(other) / self

    def __abs__(self) -> "Interval":
        inside = jnp.maximum(self.lower, -self.upper)
        return Interval(jnp.maximum(inside, 0.0), jnp.maximum(-self.lower, self.upper))

    def __pow__(self, exponent: int) -> "Interval":
        """The range of x**exponent: even powers are nonnegative, odd ones monotone; x**0 is one, also at zero.

        Raises:
            TypeError: the exponent is not an integer.
        """
        try:
            exponent = operator.index(exponent)
        except TypeError as error:
            raise TypeError(f"exponent must be an integer; it is {exponent!r}.") from error
        if exponent < 0:
            return 1.0 / self**-exponent
        base = self if exponent % 2 else abs(self)
        low, high = (_power(Interval(end, end), exponent) for end in (base.lower, base.upper))
        return Interval(low.lower, high.upper)

    def square(self) -> "Interval":
        """The range of x**2, never below zero."""
        return self**2

    def sqrt(self) -> "Interval":
        """The square roots of the nonnegative numbers in the interval; [0, 0], widened, if all numbers are negative."""
        lower, upper = (jnp.sqrt(jnp.maximum(end, 0.0)) for end in (self.lower, self.upper))
        return Interval(
            jnp.where(lower > 0, rounding.round_down(lower), 0.0),
            jnp.where(upper > 0, rounding.round_up(upper), 0.0),
        )

    def minimum(self, other: Operand) -> "Interval":
        """The range of min(x, y) for x and y in the two intervals.

        Args:
            other: an interval, or exact numbers.

        Returns:
            An Interval in the common shape of both.
        """
        other = as_interval(other)
        return Interval(jnp.minimum(self.lower, other.lower), jnp.minimum(self.upper, other.upper))

    def maximum(self, other: Operand) -> "Interval":
        """The range of max(x, y) for x and y in the two intervals.

        Args:
            other: an interval, or exact numbers.

        Returns:
            An Interval in the common shape of both.
        """
        other = as_interval(other)
        return Interval(jnp.maximum(self.lower, other.lower), jnp.maximum(self.upper, other.upper))

    def intersection(self, other: Operand) -> "Interval":
        """The numbers in both intervals; `empty` if there are none.

        Args:
            other: an interval, or exact numbers.

        Returns:
            An Interval in the common shape of both.
        """
        other = as_interval(other)
        return Interval(jnp.maximum(self.lower, other.lower), jnp.minimum(self.upper, other.upper))

    def hull(self, other: Operand) -> "Interval":
        """The smallest interval that contains this one and `other`.

        Args:
            other: an interval, or exact numbers.

        Returns:
            An Interval in the common shape of both.
        """
        other = as_interval(other)
        return Interval(jnp.minimum(self.lower, other.lower), jnp.maximum(self.upper, other.upper))


def _floats(x: ArrayLike, end: str) -> ArrayLike:
    """Arrays of floats unchanged; for other numbers the given end of their intervals."""
    known = isinstance(x, jax.Array) and jnp.issubdtype(x.dtype, jnp.floating)
    return x if known else getattr(Interval.exact(x), end)


def as_interval(x: Operand) -> Interval:
    """An interval as it is; a number as the interval that contains only it."""
    return x if isinstance(x, Interval) else Interval.exact(x)


def _product(x: Array, y: Array) -> Array:
    zero = (x == 0) | (y == 0)
    return jnp.where(zero, 0.0, x) * jnp.where(zero, 0.0, y)


def _quotient(x: Array, y: Array) -> Array:
    unbounded = jnp.isinf(y)
    return jnp.where(unbounded, 0.0, rounding.quotient(x, jnp.where(unbounded, 1.0, y)))


def _hull_of_ends(operation: Callable[[Array, Array], Array], a: Interval, b: Interval) -> Interval:
    """The extreme values of an operation that is monotone in each operand and has the sign of their product.

    Rounding keeps order, so widening the smallest rounded value covers the smallest exact one. If the signs are known,
    an end at zero stays there.
    """
    values = [operation(x, y) for x in (a.lower, a.upper) for y in (b.lower, b.upper)]
    lower = rounding.round_down(jnp.minimum(jnp.minimum(*values[:2]), jnp.minimum(*values[2:])))
    upper = rounding.round_up(jnp.maximum(jnp.maximum(*values[:2]), jnp.maximum(*values[2:])))
    same = ((a.lower >= 0) & (b.lower >= 0)) | ((a.upper <= 0) & (b.upper <= 0))
    opposite = ((a.lower >= 0) & (b.upper <= 0)) | ((a.upper <= 0) & (b.lower >= 0))
    return Interval(
        jnp.where(same, jnp.maximum(lower, 0.0), lower), jnp.where(opposite, jnp.minimum(upper, 0.0), upper)
    )


def _power(x: Interval, exponent: int) -> Interval:
    """The power by repeated squaring, for x of one sign."""
    if exponent <= 1:
        return x if exponent else Interval.exact(jnp.ones_like(x.lower))
    half = _power(x, exponent // 2)
    return half * half * x if exponent % 2 else half * half
