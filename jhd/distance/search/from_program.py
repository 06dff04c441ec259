"""Whole searches called from compiled programs; what a plain call refuses, the result says there."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context

from jhd.distance.frame.from_host import from_host


def from_program(search: Callable[..., Any], refused: Callable[[], Any], shapes: Any, *options: Any) -> Any:
    """What `search` answers about numbers that are known only when the program runs.

    Args:
        search: from the shapes and the options, all numbers known, to an answer.
        refused: makes the answer where a number of a shape is not finite or an option is NaN; all have its form.
        shapes: a pytree of arrays, not to be differentiated.
        options: likewise.
    """
    with eval_context():
        unusable = refused()
    forms = jax.tree_util.tree_map(lambda x: jax.ShapeDtypeStruct(jnp.shape(x), jnp.result_type(x)), unusable)

    def host(shapes: Any, *options: Any) -> Any:
        usable = _all(np.isfinite, shapes) and not _any(np.isnan, options)
        return search(shapes, *options) if usable else unusable

    return from_host(host, forms, shapes, *options)


def _all(test: Callable[[Any], Any], values: Any) -> bool:
    return all(np.all(test(np.asarray(x))) for x in jax.tree_util.tree_leaves(values))


def _any(test: Callable[[Any], Any], values: Any) -> bool:
    return any(np.any(test(np.asarray(x))) for x in jax.tree_util.tree_leaves(values))
