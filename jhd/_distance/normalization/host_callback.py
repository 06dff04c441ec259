"""Computations of the host inside compiled functions: under jit, vmap and grad they are called from there.

What is called is not differentiated; derivatives are attached to its answer outside, by the rules that serve known
shapes. Only `answer_in_program` differentiates, since the locations that a statistic is summed over depend on the
numbers of the shapes: a function that is differentiated calls once for the answer and for the gradient of its value.
Of a batch the calls run one after the other; where only points of one shape differ, they are one call.

A call computes on a device of its own (`host_device`): the compiled function that waits for it may occupy all threads
of its device. JAX would choose the function's device, and what runs on a chosen device is not kept on disk.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context

from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness
from jhd._runtime.jax_internals import host_device


def from_host(function: Callable[..., Any], like: Any, *arguments: Any, rows: bool = False) -> Any:
    """What a function of known arrays gives, where the arrays are traced.

    Args:
        function: takes the arguments with NumPy arrays in place of tracers; its answer is a function of them alone.
        like: shapes and types of its answer, as jax.ShapeDtypeStruct.
        arguments: pytrees of arrays.
        rows: the first argument is an array whose rows have one row each of the answer; a batch of it is one call.
    """
    device = host_device()
    ranks = [np.ndim(x) for x in jax.tree_util.tree_leaves(arguments)]

    def called(*values: Any) -> Any:
        found = function(*values)
        return jax.tree_util.tree_map(lambda x, s: np.asarray(x, s.dtype), found, like)

    def known(*values: Any) -> Any:
        values = jax.tree_util.tree_map(np.asarray, values)
        with jax.default_device(device):
            if rows:
                return _by_rows(called, like, ranks, values)
            return jax.tree_util.tree_map(lambda x, s: x.reshape(s.shape), called(*values), like)

    method = "expand_dims" if rows else "sequential"
    return jax.pure_callback(known, like, *jax.lax.stop_gradient(arguments), vmap_method=method)


def _by_rows(function: Callable[..., Any], like: Any, ranks: list[int], values: Any) -> Any:
    """What a function of rows and other arguments gives for a batch: one call for each of the other arguments.

    Args:
        function: from the arguments to an answer for each row.
        like: the form of the answer without a batch.
        ranks: of the leaves of the arguments without a batch.
        values: the arguments; leaves have the same axes of the batch in front, of length one if they do not differ.
    """
    leaves, form = jax.tree_util.tree_flatten(values)
    batches = [x.shape[: x.ndim - rank] for x, rank in zip(leaves, ranks, strict=True)]
    every, others = np.broadcast_shapes(*batches), np.broadcast_shapes(*batches[1:])
    points = np.broadcast_to(leaves[0], every + leaves[0].shape[len(every) :])
    leaves = [np.broadcast_to(x, others + x.shape[len(others) :]) for x in leaves[1:]]
    out = jax.tree_util.tree_map(lambda s: np.empty(every + s.shape, s.dtype), like)
    for k in np.ndindex(others):
        some = tuple(slice(None) if n == 1 else i for n, i in zip(others, k, strict=True))
        joined = points[some].reshape(-1, *points.shape[len(every) + 1 :])
        found = function(*form.unflatten([joined, *(x[(*k, ...)] for x in leaves)]))
        for whole, part in zip(*map(jax.tree_util.tree_leaves, (out, found)), strict=True):
            whole[some] = part.reshape(whole[some].shape)
    return out


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


def answer_in_program(
    answer: Callable[..., Any], refused: Callable[[], Any], shapes: Any, options: dict[str, Any]
) -> Any:
    """What is answered about shapes that are known when the program runs, its first leaf differentiable in them.

    Args:
        answer: from the shapes and the options by name, all known, to a pytree; differentiable outside of programs.
        refused: makes the answer about shapes that are none, or that a plain call refuses; every answer has its form.
        shapes: a pytree, of which arrays of real numbers are differentiated.
        options: arrays, numbers or None; not differentiated.
    """
    shapes, options = jax.tree_util.tree_map(jnp.asarray, (shapes, options))
    numbers, rest = eqx.partition(shapes, eqx.is_inexact_array)
    with eval_context():
        form = jax.tree_util.tree_structure(refused())

    def answered(shapes: Any, options: Any) -> Any:
        try:
            return answer(eqx.combine(*shapes), **options)
        except ValueError:
            return refused()

    def plain(*given: Any) -> Any:
        return answered(*jax.tree_util.tree_map(jnp.asarray, given))

    def derived(*given: Any) -> Any:
        (numbers, rest), options = jax.tree_util.tree_map(jnp.asarray, given)

        def first(numbers: Any) -> Any:
            found = answered((numbers, rest), options)
            return jax.tree_util.tree_leaves(found)[0], jax.lax.stop_gradient(found)

        gradient, found = jax.grad(first, has_aux=True)(numbers)
        return found, gradient

    @jax.custom_jvp
    def leaves(numbers: Any, rest: Any, options: Any) -> Any:
        return tuple(jax.tree_util.tree_leaves(from_program(plain, refused, (numbers, rest), options)))

    def with_change(primals: Any, tangents: Any) -> Any:
        numbers, rest, options = primals
        none = lambda: (refused(), jax.tree_util.tree_map(lambda x: jnp.zeros(x.shape, x.dtype), numbers))  # noqa: E731
        found, gradient = from_program(derived, none, (numbers, rest), options)
        change = sum(map(jnp.vdot, *map(jax.tree_util.tree_leaves, (gradient, tangents[0]))))
        first, *others = jax.tree_util.tree_leaves(found)
        return (first, *others), (jnp.asarray(change, first.dtype), *map(_still, others))

    leaves.defjvp(with_change)
    return jax.tree_util.tree_unflatten(form, leaves(numbers, rest, options))


def _still(x: Any) -> Any:
    """The change of what is constant: of whole numbers JAX wants one of a kind of their own."""
    return jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.inexact) else np.zeros(x.shape, jax.dtypes.float0)
