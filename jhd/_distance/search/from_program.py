"""Whole searches called from compiled functions; their result reports inputs that a plain call refuses."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context

from jhd._distance.normalization.from_host import from_host
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness


class AnswerForm(NamedTuple):
    """The form of every answer of a search: its precision, dimension, feet, shapes of both parameters, and counts."""

    dtype: Any
    dim: int
    feet: int
    t: tuple[int, ...]
    params: tuple[int, ...]
    counts: tuple[str, ...]

    def refused(self, result: Any = RESULTS.nonfinite_value) -> HausdorffSolution:
        """What is answered about shapes that are none."""
        number = lambda x, *shape: jnp.full(shape, x, self.dtype)  # noqa: E731
        none = jnp.array(0)
        witness = Witness(
            element=none,
            t=number(jnp.nan, *self.t),
            point=number(jnp.nan, self.dim),
            feet=number(jnp.nan, self.feet, self.dim),
            feet_elements=jnp.zeros(self.feet, int),
            feet_params=number(jnp.nan, self.feet, *self.params),
            multipliers=number(0.0, self.feet).at[0].set(1.0),
            event=EVENTS.coincident,
            direction=DIRECTIONS.a_to_b,
        )
        stats = {name: none for name in self.counts}
        return HausdorffSolution(number(jnp.inf), number(0.0), number(jnp.inf), witness, result, stats)


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
        usable = all(np.all(np.isfinite(x)) for x in jax.tree_util.tree_leaves(shapes))
        usable = usable and not any(np.any(np.isnan(x)) for x in jax.tree_util.tree_leaves(options))
        return search(shapes, *options) if usable else unusable

    return from_host(host, forms, shapes, *options)
