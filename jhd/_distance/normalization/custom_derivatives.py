"""Derivatives attached to numbers that a search found without them, in one way for all searches.

No search is differentiated: its results are constants. The equations that hold there make the same numbers functions of
the shapes, and `number + f - constant(f)` has the digits of the number and the derivatives of f, of all orders.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from jhd._runtime.compiled import compiled


@compiled
def carrying(number: Any, other: Array, where: Array | bool = True) -> Array:
    """Return `number` with the derivatives of `other`, if `where` holds and both are finite, else without derivatives.

    The computation of `other` must be finite even if `where` is False: backpropagation sends zeros through it, and zero
    times infinity is NaN. Callers without a valid point must evaluate it at some other one.
    """
    usable = where & jnp.isfinite(number) & jnp.isfinite(other)
    return number + jnp.where(usable, other - lax.stop_gradient(other), 0.0)


def attached(found: Any, where: Array | bool = True, **others: Array) -> Any:
    """Return `found`, with the fields named in `others` carrying the derivatives of these."""
    return replace(found, **{name: carrying(getattr(found, name), other, where) for name, other in others.items()})


@jax.custom_jvp
def without_derivative(value: Any, where: Array | bool = True) -> Any:
    """Return the value with NaN derivatives if `where` holds: they are unknown."""
    return value


@without_derivative.defjvp
def _(primals: Any, tangents: Any) -> Any:
    # A second derivative evaluates the value again.
    return without_derivative(*primals), tangents[0] * jnp.where(primals[1], jnp.nan, 1.0)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def at_rest(function: Callable[[Any, Any], Array], state: Any, rows: Any) -> Array:
    """Return function(state, rows) with its derivative in the rows at a fixed state (the envelope theorem).

    The state may depend on the rows, which determines second and higher derivatives.

    Args:
        function: a function of a module of this package, of the state and the rows.
        state: a stationary point of the function.
        rows: the arrays in which it is differentiated.
    """
    return function(state, rows)


@at_rest.defjvp
def _(function: Callable[[Any, Any], Array], primals: Any, tangents: Any) -> Any:
    return at_rest(function, *primals), jax.jvp(partial(function, primals[0]), primals[1:], tangents[1:])[1]
