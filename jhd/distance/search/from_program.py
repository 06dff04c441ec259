"""Searches that run from the host, called from compiled programs: under jit, vmap and grad they are no exception.

A batch is searched one after the other. Derivatives are attached outside, so nothing here is differentiated. What a
plain call refuses cannot be refused from a program: the result says so.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context


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
        answer = search(shapes, *options) if usable else unusable
        return jax.tree_util.tree_map(lambda x, form: np.asarray(x, form.dtype), answer, forms)

    return jax.pure_callback(host, forms, shapes, *options, vmap_method="sequential")


def _all(test: Callable[[Any], Any], values: Any) -> bool:
    return all(np.all(test(np.asarray(x))) for x in jax.tree_util.tree_leaves(values))


def _any(test: Callable[[Any], Any], values: Any) -> bool:
    return any(np.any(test(np.asarray(x))) for x in jax.tree_util.tree_leaves(values))
