"""Compiled functions for any number of rows: compiled once, at the cost of the rows that count.

A call takes a block of rows and the number of rows that count. The compiled function processes some of them at a time.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._triangles.closest_point import in_blocks_of

# Rows that one call of a compiled function takes.
BLOCK = 1024


def in_blocks(program: Any, shape: Any, *rows: np.ndarray) -> Any:
    """Apply a compiled function of shape, count and rows to any number of rows, in blocks of one size."""
    return in_blocks_of((BLOCK,), partial(program, shape), rows)


def each(function: Any, count: Array, rows: tuple[Array, ...], lanes: int) -> Any:
    """Apply a function to the first `count` rows, `lanes` at a time; all other rows give zeros."""
    if lanes > 1:
        return in_groups(jax.vmap(function), count, rows, lanes)
    return in_groups(partial(_single, function), count, rows, lanes)


def in_groups(function: Any, count: Array, rows: tuple[Array, ...], lanes: int) -> Any:
    """Apply a function of `lanes` rows to the first `count` rows; all other rows give zeros."""
    # Traced once, for its shapes and for the loop.
    function = jax.jit(function)
    shapes = jax.eval_shape(function, *(x[:lanes] for x in rows))
    shapes = jax.tree_util.tree_map(lambda x: jax.ShapeDtypeStruct((len(rows[0]), *x.shape[1:]), x.dtype), shapes)
    start = jax.tree_util.tree_map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    def step(k: Array, out: Any) -> Any:
        part = [jax.lax.dynamic_slice_in_dim(x, k * lanes, lanes) for x in rows]
        found = function(*part)
        return jax.tree_util.tree_map(lambda x, y: jax.lax.dynamic_update_slice_in_dim(x, y, k * lanes, 0), out, found)

    return jax.lax.fori_loop(0, (count + lanes - 1) // lanes, step, start)


def _single(function: Any, *part: Array) -> Any:
    """Apply a function to one row, without a batch, in which a loop would cost more."""
    return jax.tree_util.tree_map(lambda x: x[None], function(*(x[0] for x in part)))
