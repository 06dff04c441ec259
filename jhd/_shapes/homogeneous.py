"""Arrays of (rational) Bezier control points in homogeneous form, their derivatives and their affine images.

Homogeneous form: points times weights, with the weights as the last coordinate; without weights just the points.
"""

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from jhd._arithmetic import bernstein
from jhd._arithmetic.scaling import common_exponent, ldexp
from jhd._runtime.arrays import array_of, is_traced, module_of, on_host, real_array, undifferentiated
from jhd._shapes.checks import Numbers


def homogeneous(control_points: Any, weights: Any) -> Any:
    """The points times their weights, with the weights as one more coordinate; just the points if weights is None.

    NumPy arrays give NumPy arrays.
    """
    if weights is None:
        return control_points
    return (_product if isinstance(weights, np.ndarray) else _compiled_product)(control_points, weights)


def _product(points: Any, weights: Any) -> Any:
    return module_of(weights).concatenate([points * weights[..., None], weights[..., None]], axis=-1)


_compiled_product = jax.jit(_product)


def in_unit(control_points: Array, weights: Array | None) -> tuple[Any, Any, Any, Any]:
    """Points and weights divided by powers of two, each with its largest entry in [1/2, 1), and these powers.

    Then products of both are normal numbers, except for points tiny compared with the others. Known arrays are divided
    on the host, which keeps subnormal numbers.
    """
    xp: Any = jnp if is_traced(control_points, weights) else np
    parts = [None if x is None else xp.asarray(x) for x in (control_points, weights)]
    powers = [0 if x is None else common_exponent(undifferentiated(x)) for x in parts]
    points, divided = (None if x is None else ldexp(x, -k) for x, k in zip(parts, powers, strict=True))
    return points, divided, powers[0], powers[1]


def out_of_unit(array: Array | None, power: Any) -> Any:
    """An array times a power of two, on the host if it is known."""
    return None if array is None else ldexp(array, power)


def cartesian(homogeneous: Any, rational: bool) -> tuple[Any, Any]:
    """Points and weights of an array in homogeneous form; the weights are None if it is not rational."""
    if not rational:
        return homogeneous, None
    return (_quotient if isinstance(homogeneous, np.ndarray) else _compiled_quotient)(homogeneous)


def _quotient(homogeneous: Any) -> tuple[Any, Any]:
    weights = homogeneous[..., -1]
    return homogeneous[..., :-1] / weights[..., None], weights


_compiled_quotient = jax.jit(_quotient)


# Each of these is many small operations, which take longer to compile one by one than together.
restrict = jax.jit(partial(bernstein.restrict, axis=-2))
split = jax.jit(partial(bernstein.split, axis=-2))
elevate = jax.jit(partial(bernstein.elevate, axis=-2), static_argnames="target")


def elevated(coefficients: np.ndarray, degree: int) -> np.ndarray:
    """`elevate` in NumPy: no compilation for each number of segments; the end points keep their bits."""
    n = coefficients.shape[-2] - 1
    if n == degree:
        return coefficients
    raised = np.zeros((*coefficients.shape[:-2], degree + 1, coefficients.shape[-1]))
    for i, row in enumerate(bernstein.product_weights(degree - n, n)):
        raised[..., i : i + n + 1, :] += row[:, None] * coefficients
    return raised


@jax.jit
def evaluate(control_points: Array, weights: Array | None, segment: ArrayLike, t: ArrayLike) -> Array:
    """Points at t of the given segments among (segments, points, dim); segment and t broadcast."""
    segment, t = jnp.broadcast_arrays(jnp.asarray(segment), jnp.asarray(t))
    pieces = homogeneous(control_points, weights)[segment]
    value = bernstein.evaluate(jnp.moveaxis(pieces, -2, 0), t[..., None], axis=0)
    return cartesian(value, weights is not None)[0]


@partial(jax.jit, static_argnames=("whole", "inside"))
def cut(h: Array, t: ArrayLike, whole: int, inside: int) -> tuple[Array, Array]:
    """The segments before and after the cut at t of the segment `whole`, or at its start if inside is 0."""
    if not inside:
        return h[:whole], h[whole:]
    left, right = split(h[whole], t)
    return jnp.concatenate([h[:whole], left[None]]), jnp.concatenate([right[None], h[whole + 1 :]])


@jax.jit
def hodograph(control_points: Array, weights: Array | None) -> tuple[Array, Array | None]:
    """Control points and weights of the derivative of Bezier segments (..., points, dim).

    For x/w it is (x'w - xw') / w^2 with the numerator raised from degree 2 n - 2 to 2 n.
    """
    if weights is None:
        return bernstein.derivative(control_points, axis=-2), None
    n = control_points.shape[-2] - 1
    denominator = bernstein.multiply(weights, weights)
    numerator = bernstein.elevate(wronskian(control_points, weights), 2 * n, axis=-2) if n else control_points * 0.0
    return numerator / denominator[..., None], denominator


def wronskian(control_points: Array, weights: Array, absolute: bool = False) -> Array:
    """Coefficients of x'w - xw' for x = w p, in degree 2 n - 2 (the leading terms of degree 2 n - 1 cancel), n >= 1.

    B_i B_j' - B_i' B_j = C(n,i) C(n,j) (j - i) s^(i+j-1) (1-s)^(2n-1-i-j), so coefficient i + j - 1 collects
    (j - i) w_i w_j (p_j - p_i) for i < j: differences of control points, no cancellation of large coordinates.
    If `absolute`, absolute values of the terms are summed, for bounds of rounding.
    """
    n = control_points.shape[-2] - 1
    pairs = [(i, j) for i in range(n + 1) for j in range(i + 1, n + 1)]
    i, j = (np.array(column) for column in zip(*pairs, strict=True))
    factor = np.array([(b - a) * math.comb(n, a) * math.comb(n, b) / math.comb(2 * n - 2, a + b - 1) for a, b in pairs])
    terms = (factor * weights[..., i] * weights[..., j])[..., None] * (
        control_points[..., j, :] - control_points[..., i, :]
    )
    terms = jnp.abs(terms) if absolute else terms
    rows = [jnp.sum(terms[..., np.flatnonzero(i + j - 1 == k), :], axis=-2) for k in range(2 * n - 1)]
    return jnp.stack(rows, axis=-2)


@np.errstate(over="ignore", invalid="ignore")
def affine_image(points: Array, matrix: Numbers, offset: Numbers) -> Array:
    """Rows x of `points` mapped to matrix x + offset.

    Raises:
        ValueError: the matrix does not take points of this dimension, or the offset does not fit its result.
    """
    matrix, offset = real_array("matrix", matrix), real_array("offset", offset)
    if matrix.ndim != 2 or matrix.shape[1] != points.shape[-1]:
        dim = points.shape[-1]
        scaling = f" To scale by a number, pass number * jnp.eye({dim})." if matrix.ndim == 0 else ""
        raise ValueError(f"matrix has shape {matrix.shape}; needs (new_dim, {dim}).{scaling}")
    if offset.ndim > 1 or offset.shape not in ((), (1,), (matrix.shape[0],)):
        raise ValueError(f"offset has shape {offset.shape}; needs ({matrix.shape[0]},).")
    # A sum of products in full precision: matrix products may run in reduced precision on accelerators.
    rows, columns, shift = on_host(points, matrix, offset)
    return array_of((rows[..., None, :] * columns).sum(axis=-1) + shift)
