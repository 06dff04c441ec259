"""Derivatives of numbers that a search found, as functions of the few rows of the shapes that determine them.

As in jhd._distance.normalization.custom_derivatives, the numbers found are constants, and a function that has their
values at the location found has the derivatives. Derivatives that nobody takes cost nothing. Inside jit they are part
of the compiled function. If the shapes are known and a derivative is taken around the call, each operation would be
compiled separately, in every process. So one kept compiled function computes all slopes in the rows; it serves shapes
of any number of rows.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jhd._runtime.arrays import bound, is_traced, is_tracing
from jhd._runtime.compiled import compiled


class TouchedRows(NamedTuple):
    """Some rows of an array of a shape."""

    array: Any  # numbers that may be differentiated
    # Indices of the rows that count, an array of any shape; None for the whole array. A negative index stands for 0.
    index: Any = None
    table: Any = None  # if given, the index refers to rows of this table, which holds the rows of the array

    def places(self) -> Any:
        """Return the indices of the rows that count; None for all."""
        if self.index is None:
            return None
        if self.table is None:
            return jnp.clip(self.index, 0, self.array.shape[0] - 1)
        return jnp.asarray(self.table)[jnp.clip(self.index, 0, self.table.shape[0] - 1)]


class MovingNumbers(NamedTuple):
    """Numbers as functions of the shapes, and which of them have derivatives."""

    numbers: Any  # a pytree of arrays, in the structure of the numbers found
    where: Any  # a prefix of the same pytree; elsewhere the derivatives are zero


Function = Callable[[Any, Any], MovingNumbers]


def following(function: Function, found: Any, parts: Any, constants: Any) -> Any:
    """Return the numbers found, with the derivatives of a function wherever the numbers and the function are finite.

    Args:
        function: a function of a module of this package, of the rows of the parts and the constants.
        found: a pytree of few numbers, constants.
        parts: a pytree whose leaves are of type TouchedRows.
        constants: a pytree of arrays that are not differentiated.
    """
    return _following(function, *bound((found, parts, constants)))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _following(function: Function, found: Any, parts: Any, constants: Any) -> Any:
    return found


def _rule(function: Function, primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    """Return the numbers found and their change for given changes of the parts: the derivative rule of `following`."""
    found, parts, constants = primals
    # Further derivatives are also derivatives of the numbers as functions.
    here = following(function, found, parts, constants) if is_traced(parts) else found
    rows, places = _touched(parts)
    moves = [None if isinstance(part.array, SymbolicZero) else part.array for part in _leaves(tangents[1])]
    if is_tracing():
        # Only the changes of the requested numbers remain of it.
        leaves, form = jax.tree_util.tree_flatten(rows)
        moved = [
            jnp.zeros_like(row) if x is None else x if k is None else x[k]
            for row, k, x in zip(leaves, places, moves, strict=True)
        ]
        numbers = partial(_numbers, function, found, constants)
        _, change, usable = jax.jvp(numbers, (rows,), (form.unflatten(moved),), has_aux=True)
        return here, jax.tree_util.tree_map(lambda x, known: jnp.where(known, x, 0.0), change, usable)
    slopes = _slopes(function, found, rows, constants)
    moved = [(slope, k, x) for slope, k, x in zip(slopes, places, moves, strict=True) if x is not None]
    return here, _changed(found, moved)


_following.defjvp(_rule, symbolic_zeros=True)


def _numbers(function: Function, found: Any, constants: Any, rows: Any) -> tuple[Any, Any]:
    """Return the numbers as functions of the rows, and which of them have derivatives."""
    numbers, where = function(rows, constants)
    usable = jax.tree_util.tree_map(
        lambda x, y, known: known & jnp.isfinite(x - y), found, numbers, jax.tree.broadcast(where, found)
    )
    return numbers, usable


def _is_part(x: Any) -> bool:
    return isinstance(x, TouchedRows)


def _leaves(parts: Any) -> list[TouchedRows]:
    return jax.tree_util.tree_leaves(parts, is_leaf=_is_part)


def _rows(parts: Any) -> tuple[Any, list[Any]]:
    """Return the rows that count, in the structure of the parts, and their indices in the arrays."""
    places = [part.places() for part in _leaves(parts)]
    rows = [
        part.array if k is None else jnp.asarray(part.array)[k] for part, k in zip(_leaves(parts), places, strict=True)
    ]
    return jax.tree_util.tree_unflatten(jax.tree_util.tree_structure(parts, is_leaf=_is_part), rows), places


_touched = compiled(_rows)


@partial(compiled, static=(0,))
def _slopes(function: Function, found: Any, rows: Any, constants: Any) -> list[Array]:
    """Return the derivatives of all numbers, in a row, in each array of rows."""

    def numbers(rows: Any) -> tuple[Array, Array]:
        # Backpropagation sends zeros through numbers without derivatives too, so the function must be finite there.
        flat = (ravel_pytree(x)[0] for x in _numbers(function, found, constants, rows))
        return next(flat), next(flat)

    slopes, usable = jax.jacrev(numbers, has_aux=True)(rows)
    leaves = jax.tree_util.tree_leaves(slopes)
    return [jnp.where(usable.reshape(-1, *[1] * (x.ndim - 1)), x, 0.0) for x in leaves]


@compiled
def _changed(found: Any, moved: list[tuple[Array, Any, Array]]) -> Any:
    """Return the change of the numbers for given changes of the arrays."""
    flat, form = ravel_pytree(found)
    total = jnp.zeros_like(flat)
    for slope, places, x in moved:
        # Sums keep the batch axis of vmap in front, but a matrix product may move it.
        rows = x if places is None else x[places]
        total = total + jnp.sum(slope * rows[None], axis=range(1, slope.ndim))
    return form(total)
