"""Derivatives of a few numbers that a search found, by functions of the few rows of the shapes that they hang on.

What is said in jhd.distance.frame.attach holds: what was found are constants, and a function that has their values at
the place found has the derivatives. Inside jit it is part of the program. Where the shapes are known, and a derivative
is being taken around the call, each of its operations would be compiled by itself, in every process. So all slopes in
the rows are found there by a program of its own, which is kept and serves shapes of any number of rows.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jhd._runtime.arrays import is_tracing
from jhd._runtime.compiled import compiled
from jhd.distance.frame.attach import carrying

Numbers = dict[str, Array]


class TouchedRows(NamedTuple):
    """Some rows of an array of a shape.

    Args:
        array: of numbers that may be differentiated.
        index: which rows count, an array of any shape; None for the whole array. Below zero it stands for the first.
        table: where given, the index is that of rows of this table, which hold the rows of the array.
    """

    array: Any
    index: Any = None
    table: Any = None

    def places(self) -> Any:
        """The rows that count; None for all."""
        if self.index is None:
            return None
        if self.table is None:
            return jnp.clip(self.index, 0, self.array.shape[0] - 1)
        return jnp.asarray(self.table)[jnp.clip(self.index, 0, self.table.shape[0] - 1)]


class MovingNumbers(NamedTuple):
    """Numbers as functions of the shapes, and where they are; elsewhere they have no derivatives."""

    numbers: Numbers
    where: dict[str, Any]


def following(function: Callable[[Any, Any], MovingNumbers], found: Numbers, parts: Any, constants: Any) -> Numbers:
    """The numbers found, the same ones, with the derivatives of a function wherever that and they are finite.

    Args:
        function: one of a module of this package, from the rows of the parts and the constants.
        found: few numbers, constants.
        parts: a pytree whose leaves are of type TouchedRows.
        constants: a pytree of arrays that are not differentiated.
    """
    if is_tracing():
        moving = function(_rows(parts)[0], jax.lax.stop_gradient(constants))
        return {name: carrying(x, moving.numbers[name], moving.where.get(name, True)) for name, x in found.items()}
    return _following(function, found, parts, constants)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _following(function: Callable[[Any, Any], MovingNumbers], found: Numbers, parts: Any, constants: Any) -> Numbers:
    return found


def _rule(function: Callable[[Any, Any], MovingNumbers], primals: tuple, tangents: tuple) -> tuple[Numbers, Numbers]:
    found, parts, constants = primals
    rows, places = _touched(parts)
    slopes = _slopes(function, found, rows, constants)
    moves = [part.array for part in _leaves(tangents[1])]
    moved = [
        (slope, place, x)
        for slope, place, x in zip(slopes, places, moves, strict=True)
        if not isinstance(x, SymbolicZero)
    ]
    return found, _changed(found, moved)


_following.defjvp(_rule, symbolic_zeros=True)


def _is_part(x: Any) -> bool:
    return isinstance(x, TouchedRows)


def _leaves(parts: Any) -> list[TouchedRows]:
    return jax.tree_util.tree_leaves(parts, is_leaf=_is_part)


def _rows(parts: Any) -> tuple[Any, list[Any]]:
    """The rows that count, in the structure of the parts, and their places in the arrays."""
    places = [part.places() for part in _leaves(parts)]
    rows = [
        part.array if k is None else jnp.asarray(part.array)[k] for part, k in zip(_leaves(parts), places, strict=True)
    ]
    return jax.tree_util.tree_unflatten(jax.tree_util.tree_structure(parts, is_leaf=_is_part), rows), places


_touched = compiled(_rows)


@partial(compiled, static=(0,))
def _slopes(function: Callable[[Any, Any], MovingNumbers], found: Numbers, rows: Any, constants: Any) -> list[Array]:
    """The derivatives of all numbers, in a row, in each array of rows."""

    def numbers(rows: Any) -> tuple[Array, Array]:
        moving = function(rows, constants)
        usable = {
            name: moving.where.get(name, True) & jnp.isfinite(x) & jnp.isfinite(moving.numbers[name])
            for name, x in found.items()
        }
        # Zeros go back through what is left out, where the function must be finite as well.
        return ravel_pytree({name: moving.numbers[name] for name in found})[0], ravel_pytree(usable)[0]

    slopes, usable = jax.jacrev(numbers, has_aux=True)(rows)
    leaves = jax.tree_util.tree_leaves(slopes)
    return [jnp.where(usable.reshape(-1, *[1] * (x.ndim - 1)), x, 0.0) for x in leaves]


@compiled
def _changed(found: Numbers, moved: list[tuple[Array, Any, Array]]) -> Numbers:
    """How the numbers change where the arrays do."""
    flat, form = ravel_pytree(found)
    total = jnp.zeros_like(flat)
    for slope, places, x in moved:
        # Sums keep the batch axis of vmap in front, where a matrix product may move it.
        rows = x if places is None else x[places]
        total = total + jnp.sum(slope * rows[None], axis=range(1, slope.ndim))
    return form(total)
