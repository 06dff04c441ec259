"""Powers of two: the size of arrays, and scaling that changes no digit.

Coordinates of any size are scaled to order one before anything is multiplied: then squares neither overflow nor vanish.
NumPy scales exactly, subnormal numbers too. XLA reads these as zero; `frexp` and `ldexp` here split them by their bits,
which no backend changes, so that a compiled function scales its input without loss. Results below the smallest normal
number are zero. `jax.numpy.ldexp` is not used: it multiplies by a power function, which is not exact on GPUs.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from jhd._runtime.arrays import is_traced, undifferentiated

# Stands for the exponent of zero; below all exponents of numbers.
_NONE = -(10**6)


def common_exponent(*arrays: Any, nothing: int = 0) -> Any:
    """The k for which 2^-k times the largest entry lies in [1/2, 1); `nothing` if all entries are zero."""
    if not is_traced(arrays):
        size = max(np.max(np.abs(x)) for x in arrays)
        return np.frexp(size)[1] if size > 0 else np.int32(nothing)
    most = jnp.max(jnp.stack([_exponent(x) for x in arrays]))
    return jnp.where(most == _NONE, nothing, most)


def _exponent(x: Any) -> Any:
    if not is_traced(x):
        # On the host: the compiler takes seconds to work out a maximum of many known numbers.
        return common_exponent(x, nothing=_NONE)
    mantissa, power = frexp(x)
    return jnp.max(jnp.where(mantissa != 0, power, _NONE))


def scale_of(power: Any, dtype: Any) -> Array:
    """The number 2^-power as far as normal numbers reach, for products that are differentiated."""
    # Twenty-four powers are left at either end for the factors of later products.
    most = jnp.finfo(dtype).maxexp - 24
    return _two_to(-jnp.clip(power, -most, most), dtype)


def times_two_to(x: Any, power: Any) -> Any:
    """The product x 2^power of a normal number or zero, exact if it is normal; otherwise as `ldexp`.

    It compiles to two multiplications, `ldexp` to thirty operations.
    """
    if not is_traced(x, power):
        return np.ldexp(x, power)
    x = jnp.asarray(x)
    info = jnp.finfo(x.dtype)
    power = jnp.clip(power, 2 * info.minexp, -2 * info.minexp)
    half = power >> 1
    return x * _two_to(half, x.dtype) * _two_to(power - half, x.dtype)


def _two_to(power: Any, dtype: Any) -> Array:
    """The normal number 2^power, by its bits; infinity one power above the largest."""
    info = jnp.finfo(dtype)
    whole = jnp.dtype(f"int{info.bits}")
    return lax.bitcast_convert_type((jnp.asarray(power).astype(whole) + info.maxexp - 1) << info.nmant, dtype)


def frexp(x: Any) -> tuple[Any, Any]:
    """Mantissas in [1/2, 1) and exponents of finite numbers, subnormal ones too; 0 and 0 for zeros alone.

    A subnormal number is its integer mantissa times the smallest one, and integers become floats exactly.
    `jax.numpy.frexp` reads subnormal numbers as zero, and fails for explicitly sharded batches (seen in 0.12.0.1).
    """
    if not is_traced(x):
        return np.frexp(x)
    info = jnp.finfo(x.dtype)
    half = info.maxexp - 2  # the stored exponent of numbers in [1/2, 1)

    def parts(x: Array) -> tuple[Array, Array]:
        bits = lax.bitcast_convert_type(x, jnp.dtype(f"int{info.bits}"))
        return bits, (bits >> info.nmant) & ((1 << info.nexp) - 1)

    bits, stored = parts(x)
    digits = bits & ((1 << info.nmant) - 1)
    subnormal = (stored == 0) & (digits != 0)
    x = jnp.where(subnormal, jnp.where(bits < 0, -digits, digits).astype(x.dtype), x)
    bits, stored = parts(x)
    usual = (stored > 0) & jnp.isfinite(x)
    mantissa = lax.bitcast_convert_type(bits + ((half - stored) << info.nmant), x.dtype)
    power = jnp.where(usual, stored - half, 0) + subnormal * (info.minexp - info.nmant)
    return jnp.where(usual, mantissa, x), power.astype(jnp.int32)


def ldexp(x: Any, power: Any) -> Any:
    """The product x 2^power, exact if it is a normal number, for subnormal x too.

    NumPy rounds other results; compiled functions make them zero or infinite. The derivative is 2^power.
    """
    return _times_power(jnp.asarray(x), power) if is_traced(x, power) else np.ldexp(x, power)


@jax.custom_jvp
@jax.jit
def _times_power(x: Array, power: Any) -> Array:
    mantissa, own = frexp(x)
    info, exponent = jnp.finfo(x.dtype), own + power - 1
    factor = _two_to(jnp.clip(exponent, info.minexp, info.maxexp), x.dtype)
    product = jnp.where(exponent < info.minexp, 0.0, 2 * mantissa * factor)
    return jnp.where(jnp.isfinite(x) & (mantissa != 0), product, mantissa)


@_times_power.defjvp
def _derivative_of_times_power(primals: Any, tangents: Any) -> tuple[Any, Any]:
    (x, power), (dx, _) = primals, tangents
    return _times_power(x, power), times_two_to(dx, power)


def unit_weights(weights: Any, axes: int | tuple[int, ...] = -1) -> Any:
    """Positive weights scaled to a largest one in [1/2, 1) along the axes, which changes no point; differentiable."""
    xp: Any = jnp if is_traced(weights) else np
    weights = xp.asarray(weights)
    return ldexp(weights, -frexp(xp.max(weights, axis=axes, keepdims=True))[1])


def length(vectors: Any) -> Any:
    """Lengths along the last axis, whose squares neither overflow nor vanish; zero has the derivative zero."""
    xp: Any = jnp if is_traced(vectors) else np
    size = xp.max(abs(vectors), axis=-1, keepdims=True)
    size = undifferentiated(size)
    square = xp.sum((vectors / xp.where(size > 0, size, 1.0)) ** 2, axis=-1)
    # NaN stays NaN.
    some = square != 0
    return xp.where(some, size[..., 0] * xp.sqrt(xp.where(some, square, 1.0)), 0.0)


def unit(vectors: Any) -> Any:
    """The vectors along the last axis over their lengths; zero ones stay."""
    size: Any = length(vectors)[..., None]
    return vectors / (jnp if is_traced(size) else np).where(size > 0, size, 1.0)
