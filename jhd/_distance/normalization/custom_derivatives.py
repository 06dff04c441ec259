"""Derivatives attached to numbers that a search found without them, in one way for all searches.

No search is differentiated: what it finds are constants. The equations that hold there make the same numbers functions
of the shapes, and `number + f - constant(f)` has the digits of the number and the derivatives of f, of all orders.
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
    """The number, with the derivatives of the other one where asked for and both are finite, elsewhere with none.

    The other must be finite where it is evaluated: what is left out here still sends zeros back through it, and zero
    times what is not finite is NaN. Whoever has no place to evaluate it at puts in one.
    """
    usable = where & jnp.isfinite(number) & jnp.isfinite(other)
    return number + jnp.where(usable, other - lax.stop_gradient(other), 0.0)


def attached(found: Any, where: Array | bool = True, **others: Array) -> Any:
    """What was found, with its fields named in `others` carrying the derivatives of these."""
    return replace(found, **{name: carrying(getattr(found, name), other, where) for name, other in others.items()})


@jax.custom_jvp
def without_derivative(value: Any, where: Array | bool = True) -> Any:
    """The value, whose derivatives are NaN where asked for: they are not known."""
    return value


@without_derivative.defjvp
def _(primals: Any, tangents: Any) -> Any:
    # Of what is differentiated twice the value is asked for again.
    return without_derivative(*primals), tangents[0] * jnp.where(primals[1], jnp.nan, 1.0)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def at_rest(function: Callable[[Any, Any], Array], state: Any, rows: Any) -> Array:
    """A number of a state and rows, whose derivative is that in the rows at a fixed state (the envelope theorem).

    The state may be a function of the rows, on which second and higher derivatives depend.

    Args:
        function: one of a module of this package, of the state and the rows.
        state: where the number is stationary.
        rows: the arrays that it is differentiated in.
    """
    return function(state, rows)


@at_rest.defjvp
def _(function: Callable[[Any, Any], Array], primals: Any, tangents: Any) -> Any:
    return at_rest(function, *primals), jax.jvp(partial(function, primals[0]), primals[1:], tangents[1:])[1]
