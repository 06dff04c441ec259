"""Statistics inside compiled functions: called back on the host, with first derivatives.

The nodes of a statistic depend on the numbers of the shapes, so no function can be traced through them. A compiled
function that is differentiated calls once for the answer and for the gradient of its value.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context

from jhd._distance.search.from_program import from_program


def answer_in_program(
    answer: Callable[..., Any], refused: Callable[[], Any], shapes: Any, options: dict[str, Any]
) -> Any:
    """What is answered about shapes that are known when the program runs, its first leaf differentiable in them.

    Args:
        answer: from the shapes and the options by name, all known, to a pytree; differentiable outside of programs.
        refused: makes the answer about shapes that are none; every answer has its form.
        shapes: a pytree, of which arrays of real numbers are differentiated.
        options: arrays, numbers or None; not differentiated.
    """
    shapes, options = jax.tree_util.tree_map(jnp.asarray, (shapes, options))
    numbers, rest = eqx.partition(shapes, eqx.is_inexact_array)
    with eval_context():
        form = jax.tree_util.tree_structure(refused())

    @jax.custom_jvp
    def leaves(numbers: Any, rest: Any, options: Any) -> Any:
        found = from_program(partial(_answered, answer, refused), refused, (numbers, rest), options)
        return tuple(jax.tree_util.tree_leaves(found))

    def with_change(primals: Any, tangents: Any) -> Any:
        numbers, rest, options = primals
        none = partial(_without_gradient, refused, jax.tree_util.tree_map(lambda x: (x.shape, x.dtype), numbers))
        derived = partial(_derived, answer, refused)
        found, gradient = from_program(derived, none, (numbers, rest), options)
        change = sum(map(jnp.vdot, *map(jax.tree_util.tree_leaves, (gradient, tangents[0]))))
        first, *others = jax.tree_util.tree_leaves(found)
        return (first, *others), (jnp.asarray(change, first.dtype), *map(_still, others))

    leaves.defjvp(with_change)
    return jax.tree_util.tree_unflatten(form, leaves(numbers, rest, options))


def _answered(answer: Callable[..., Any], refused: Callable[[], Any], shapes: Any, options: Any) -> Any:
    """The answer about known shapes; what a plain call raises about them is a refusal here."""
    shapes, options = jax.tree_util.tree_map(jnp.asarray, (eqx.combine(*shapes), options))
    try:
        return answer(shapes, **options)
    except ValueError:
        return refused()


def _derived(answer: Callable[..., Any], refused: Callable[[], Any], shapes: Any, options: Any) -> Any:
    """The same, and the gradient of its first leaf."""
    numbers, rest = jax.tree_util.tree_map(jnp.asarray, shapes)

    def first(numbers: Any) -> Any:
        found = _answered(answer, refused, (numbers, rest), options)
        return jax.tree_util.tree_leaves(found)[0], jax.lax.stop_gradient(found)

    gradient, found = jax.grad(first, has_aux=True)(numbers)
    return found, gradient


def _without_gradient(refused: Callable[[], Any], forms: Any) -> Any:
    is_form = lambda x: isinstance(x, tuple) and len(x) == 2 and isinstance(x[1], np.dtype)  # noqa: E731
    return refused(), jax.tree_util.tree_map(lambda form: jnp.zeros(*form), forms, is_leaf=is_form)


def _still(x: Any) -> Any:
    """The change of what is constant: of whole numbers JAX wants one of a kind of their own."""
    return jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.inexact) else np.zeros(x.shape, jax.dtypes.float0)
