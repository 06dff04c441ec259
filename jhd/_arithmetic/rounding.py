"""Rounding: the only file that knows about ulps.

The model of one floating-point addition, subtraction, multiplication or square root, for every backend that XLA
compiles to, is

    fl(x op y) = (x op y)(1 + delta) + epsilon,   |delta| <= u,   |epsilon| <= nu,

for operands that are zero or normal, with u the unit roundoff of `unit_roundoff` and nu the smallest normal number: XLA
flushes subnormal operands and results to zero. A flushed *operand* is an error of its own, which a factor enlarges:
if operands come from outside, `flush_down` and `flush_up` make them normal first, outward. Multiply-adds may be
fused and sums reordered; a fused operation rounds once instead of twice, so separate roundings cover it.

A division counts as **two** roundings: XLA replaces x / y by x * (1 / y) where y is constant or broadcast (measured:
one third of the results of x / 3 differ in the last bit). There 1 / y is flushed to zero for |y| > 1 / nu, so that
x / y becomes 0; `quotient` avoids that. It also merges constant factors, (x * a) * b into x * (a * b), so a factor
that guards against underflow must not be a constant.

Source: Higham, Accuracy and Stability of Numerical Algorithms (2002), sections 2.2 and 3.1.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import Array


def unit_roundoff(dtype: DTypeLike) -> float:
    """Largest relative error u of one operation in the model above: 2^-53 in float64, 2^-24 in float32.

    On accelerators it is 2^-22 in float32. XLA divides and takes square roots there by `div.full` and `sqrt.approx`,
    with relative errors of up to 2^-22 and 2^-23 (NVIDIA, PTX ISA, instructions `div` and `sqrt`; measured on an H200:
    2.03 and 0.94 units in the last place). In float64 both are correctly rounded.
    """
    u = float(jnp.finfo(dtype).eps) / 2
    return 4 * u if jnp.dtype(dtype) == jnp.float32 and jax.default_backend() != "cpu" else u


def smallest_normal(dtype: DTypeLike) -> float:
    """Smallest positive normal number nu; anything below it may be flushed to zero."""
    return float(jnp.finfo(dtype).smallest_normal)


def largest(dtype: DTypeLike) -> float:
    """Largest finite number."""
    return float(jnp.finfo(dtype).max)


def like_double(tolerance: float, dtype: DTypeLike) -> float:
    """A tolerance chosen for double precision, and for others the same power of their unit roundoff.

    For heuristics alone: 1e-6, which is u^0.38, is about 2e-3 in single precision.
    """
    return tolerance ** (math.log(unit_roundoff(dtype)) / math.log(unit_roundoff(np.float64)))


def gamma(operations: float, dtype: DTypeLike) -> float:
    """Bound on the relative error of a product of `operations` factors (1 + delta), |delta| <= u.

    For k u <= 0.01 every product of k factors (1 + delta_i)^(+-1) is 1 + theta with
    |theta| <= k u / (1 - k u) <= 1.0102 k u (Higham, Lemma 3.1). The returned 1.02 k u leaves 0.9 % of room, far more
    than the roundings of computing it and of the few operations that apply it need.

    Raises:
        ValueError: k u > 0.01, for which the bound does not hold.
    """
    bound = 1.02 * operations * unit_roundoff(dtype)
    if operations < 0 or bound > 0.0102:
        raise ValueError(
            f"gamma needs 0 <= operations * u <= 0.01; operations is {operations}, dtype {np.dtype(dtype)}."
        )
    return bound


def cast(x: ArrayLike, dtype: DTypeLike, toward: float) -> np.ndarray:
    """Known numbers in another precision, rounded towards an infinity.

    >>> float(cast(np.asarray(1 - 2.0**-40), np.float32, -np.inf)) == 1 - 2.0**-24
    True
    """
    x = np.asarray(x)
    with np.errstate(over="ignore"):
        near = x.astype(dtype)
    beyond = near < x if toward > 0 else near > x
    return np.where(beyond, np.nextafter(near, np.asarray(toward, dtype)), near)


def absolute_error(operations: int, magnitude: ArrayLike) -> Array:
    """Bound gamma(k) m + 2 k nu on the absolute error of a chain of k operations on numbers of magnitude at most m.

    It holds if the exact result is a sum of terms whose absolute values add up to at most m, each term passes
    through at most k roundings, and every underflow is multiplied by factors that sum to at most two: de Casteljau's
    algorithm, products of Bernstein forms with weights applied last, matrix products. The result is rounded up.

    Args:
        operations: k, the number of roundings a term passes through.
        magnitude: m, non-negative; infinite gives infinity.
    """
    m = jnp.asarray(magnitude)
    return round_up(gamma(operations, m.dtype) * m + 2 * operations * smallest_normal(m.dtype))


def round_down(x: ArrayLike) -> Array:
    """Lower bound of the exact result of the one operation (+, -, *, /, square root) whose rounded result is x.

    Let z be the exact result for operands that are zero or normal, and e = fl(4 u |x| + 2 nu). The answer is fl(x - e).

    - |x - z| <= max(2.5 u |x|, 1.5 nu), also for a division by reciprocal (two roundings) and a flushed result, and x
      is zero or has the sign of z.
    - e >= max(4 u |x|, 2 nu): rounding is monotone, both are floats, and where 4 u |x| is flushed 2 nu exceeds it.
    - Where 4 u |x| >= 2 nu: fl(x - e) <= x - e + u |x - e| <= x - 4 u |x| + u (1 + 8 u) |x| <= x - 2.5 u |x|, and
      2.5 u |x| >= 1.25 nu while z is normal, so the first bound is the one that counts.
    - Where 4 u |x| < 2 nu: fl(x - e) <= x - 2 nu + u (|x| + 4 nu) <= x - 1.4 nu, and 2.5 u |x| < 1.25 nu. The bound
      1.5 nu counts for |x| <= 4 nu only; there e = 2 nu and the subtraction is exact.
    - A result in (-nu, 0) that is flushed to zero has x > 0, so z > 0.
    - Where the compiler fuses a product with the subtraction, it computes fl(z - e) <= z, since e exceeds u |z - e|.
    - x = +inf: z overflowed, so it exceeds the largest float, which replaces x. x = -inf stays. NaN, which
      comes from an invalid operation, gives -inf: no bound.

    >>> float(round_down(1.0)) < 1.0 < float(round_up(1.0))
    True
    """
    x = jnp.asarray(x)
    finite = jnp.minimum(x, largest(x.dtype))
    return jnp.where(jnp.isnan(x), -jnp.inf, finite - _margin(finite))


def round_up(x: ArrayLike) -> Array:
    """Upper bound of the exact result of the one operation whose rounded result is x: -round_down(-x)."""
    return -round_down(-jnp.asarray(x))


def _margin(x: Array) -> Array:
    return 4 * unit_roundoff(x.dtype) * jnp.abs(x) + 2 * smallest_normal(x.dtype)


def flush_down(x: ArrayLike) -> Array:
    """Largest number not above x that is zero, normal or infinite: the identity except for subnormal x.

    The processor compares subnormal numbers as zeros, so they are told apart by their bits, which no backend changes.
    NaN, of which nothing is known, gives -inf.
    """
    x = jnp.asarray(x)
    positive, negative = _subnormal(x)
    x = jnp.where(negative, -smallest_normal(x.dtype), jnp.where(positive, 0.0, x)).astype(x.dtype)
    return jnp.where(jnp.isnan(x), -jnp.inf, x)


def flush_up(x: ArrayLike) -> Array:
    """Smallest number not below x that is zero, normal or infinite: -flush_down(-x)."""
    return -flush_down(-jnp.asarray(x))


def _subnormal(x: Array) -> tuple[Array, Array]:
    bits, first_normal = _bits(x)
    lowest = jnp.iinfo(bits.dtype).min
    return (bits > 0) & (bits < first_normal), (bits > lowest) & (bits < lowest + first_normal)


def _bits(x: Array) -> tuple[Array, int]:
    info = jnp.finfo(x.dtype)
    return lax.bitcast_convert_type(x, jnp.dtype(f"int{info.bits}")), 1 << info.nmant


def ordered(x: ArrayLike) -> Array:
    """Integers in the order of non-negative numbers, also of subnormal ones, which comparisons take for zeros.

    Negative numbers give negative integers; minus zero gives the integer of zero.
    """
    bits = _bits(jnp.asarray(x))[0]
    return jnp.where(bits == jnp.iinfo(bits.dtype).min, 0, bits)


def power_of_two(x: ArrayLike) -> Array:
    """Largest power of two not above |x|; one if x is subnormal, zero or not finite.

    Dividing by it changes no digit: only results below nu lose, at most nu.
    """
    x = jnp.abs(jnp.asarray(x))
    bits, first_normal = _bits(x)
    power = lax.bitcast_convert_type(bits & -first_normal, x.dtype)
    return jnp.where((bits >= first_normal) & (x < jnp.inf), power, 1.0).astype(x.dtype)


def quotient(x: ArrayLike, y: ArrayLike) -> Array:
    """The quotient x / y of normal or zero x and normal y, with at most two roundings, ready for round_down.

    If both are at least one they are divided by 16, exactly, so that 1 / y, which XLA may form, is not flushed.
    Elsewhere it is flushed only if |y| > 1 / nu, and then |x| < 1, so the quotient is below nu. The factor depends on
    x because XLA merges constant factors: x * (1 / 16) / (constant / 16) becomes x * (1 / constant) again.
    """
    x, y = jnp.asarray(x), jnp.asarray(y)
    scale = jnp.where((jnp.abs(x) >= 1) & (jnp.abs(y) >= 1), 1 / 16, 1.0).astype(y.dtype)
    return (x * scale) / (y * scale)


def widen(lower: ArrayLike, upper: ArrayLike, error: ArrayLike) -> tuple[Array, Array]:
    """Bounds, rounded outward, of every number that an a-priori error bound allows: [lower - error, upper + error].

    Args:
        lower: computed lower ends, zero or normal.
        upper: computed upper ends, zero or normal.
        error: non-negative; a subnormal one counts as nu.
    """
    error = flush_up(error)
    return round_down(lower - error), round_up(upper + error)
