"""Computations of the host inside compiled functions: under jit, vmap and grad they are called from there.

The called functions are not differentiated; derivatives are attached to their results outside, by the rules for known
shapes. Only `answer_in_program` differentiates, since the locations that a statistic is summed over depend on the
numbers of the shapes: a function that is differentiated calls once for the answer and for the gradient of its value.
The calls for a batch run one after the other; if only points of one shape differ, they are one call.

Searches that could also be traced run there as kept compiled functions (`by_kept_program`). They are not compiled with
the calling function, and all cores work on the blocks of a batch.

On CPUs a call gets the memory of its arguments (`buffer_callback`). `jax.pure_callback` makes arrays of them, for which
it may wait for a thread of the device while all threads wait for calls like it.

XLA's threads take subnormal numbers for zero; a call keeps them.

A call computes on a device of its own (`host_device`): the compiled function that waits for it may occupy all threads
of its device. JAX would choose the function's device, and functions compiled for a chosen device are not kept on disk.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from math import prod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_context
from jax.experimental.buffer_callback import buffer_callback
from jaxtyping import Array

from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, Witness
from jhd._runtime.arrays import array_of, is_traced, varying
from jhd._runtime.c_library import subnormals_kept
from jhd._runtime.compiled import calls_host, compiled, optimized
from jhd._runtime.jax_internals import host_device
from jhd._runtime.sharding import is_partitioned, shared_by_devices

# Batch members in one compiled function, one after the other. An eighth of them is worth a call, so that the cores
# finish at about the same time.
_BLOCK = 32


def from_host(function: Callable[..., Any], like: Any, *arguments: Any, rows: bool = False) -> Any:
    """Call a function of known arrays on the host, also if the arrays are traced; return its result.

    Args:
        function: takes the arguments with NumPy arrays instead of tracers; its result depends only on them.
        like: shapes and types of the result, as jax.ShapeDtypeStruct.
        arguments: pytrees of arrays.
        rows: whether the first argument is an array with one row for each row of the result; a batch of it is one call.
    """
    # The precision of the calling thread; the call comes from another one.
    device, wide = host_device(), _is_wide()
    ranks = [np.ndim(x) for x in jax.tree_util.tree_leaves(arguments)]

    def called(*values: Any) -> Any:
        found = function(*values)
        return jax.tree_util.tree_map(lambda x, s: np.asarray(x, s.dtype), found, like)

    def known(*values: Any) -> Any:
        values = jax.tree_util.tree_map(np.asarray, values)
        with subnormals_kept(), jax.default_device(device), jax.enable_x64(wide):
            if rows:
                return _by_rows(called, like, ranks, values)
            return jax.tree_util.tree_map(lambda x, s: x.reshape(s.shape), called(*values), like)

    arguments = jax.lax.stop_gradient(arguments)
    method = "expand_dims" if rows else "sequential"
    if jax.default_backend() != "cpu":
        return jax.pure_callback(known, like, *arguments, vmap_method=method)

    def filled(_: Any, out: Any, *values: Any) -> None:
        # Copies: arguments that are kept must not change with the memory of the function.
        found = known(*jax.tree_util.tree_map(lambda x: np.asarray(x).copy(), values))
        for place, x in zip(*map(jax.tree_util.tree_leaves, (out, found)), strict=True):
            np.asarray(place)[...] = x

    return buffer_callback(filled, like, vmap_method=method)(*arguments)


def _is_wide() -> bool:
    """Return whether numbers have 64 bits in this thread."""
    return jax.config.jax_enable_x64  # pyright: ignore[reportAttributeAccessIssue]


def _by_rows(function: Callable[..., Any], like: Any, ranks: list[int], values: Any) -> Any:
    """Evaluate a function of rows and other arguments for a batch: one call for each of the other arguments.

    `like` and `ranks` describe the result and the leaves of the arguments without the axes of the batch, which come
    first; an axis of length one is not batched.
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
    """Return the result of `search` for numbers that are known only when the compiled function runs.

    Args:
        search: maps the shapes and the options, all numbers known, to a result.
        refused: makes the result if a number of a shape is not finite or an option is NaN; every result has its form.
        shapes: a pytree of arrays, not to be differentiated.
        options: pytrees of arrays, not to be differentiated.
    """
    with eval_context():
        unusable = refused()
    forms = jax.tree_util.tree_map(lambda x: jax.ShapeDtypeStruct(jnp.shape(x), jnp.result_type(x)), unusable)

    def host(shapes: Any, *options: Any) -> Any:
        usable = all(np.all(np.isfinite(x)) for x in jax.tree_util.tree_leaves(shapes))
        usable = usable and not any(np.any(np.isnan(x)) for x in jax.tree_util.tree_leaves(options))
        return search(shapes, *options) if usable else unusable

    return from_host(host, forms, shapes, *options)


def by_kept_program(
    function: Callable[..., Any], answer: Any, own: tuple, shared: tuple = (), block: int = _BLOCK
) -> Any:
    """Evaluate a traceable function for traced arrays: on CPUs on the host, by its kept compiled function, else traced.

    Args:
        function: function of the shared arguments, then of its own; a function of a module of this package, or a named
            tuple of constants that can be called.
        answer: shapes and types of its result, as jax.ShapeDtypeStruct; None for functions that are always traced.
        own: arguments, pytrees of arrays that are not differentiated.
        shared: arguments that are passed once for a batch if they have no batch axis.
        block: largest number of batch members in one call of the compiled function.
    """
    if answer is None or not calls_host() or is_partitioned((own, shared)):
        return shared_by_devices(function)(*shared, *own)
    # If all numbers are known, some are Python numbers.
    own, shared = jax.tree_util.tree_map(lambda x: x if hasattr(x, "dtype") else np.asarray(x), (own, shared))
    rows, row = (packed(jax.lax.stop_gradient(x)) for x in (own, shared))
    forms = form_of(shared), form_of(own)
    length = _length(form_of(answer), rows.dtype)
    like = jax.ShapeDtypeStruct((1, length), rows.dtype)
    found = from_host(partial(answers, function, forms, length, block), like, rows[None], row, rows=True)
    return varying(unpacked(form_of(answer), found[0]), (own, shared))


def of_known_rows(function: Callable[..., Any], answer: Any, rows: np.ndarray, shared: tuple, block: int) -> Any:
    """Return the results of `by_kept_program` for known rows: each row is the own argument of one member of a batch."""
    row = packed(jax.tree_util.tree_map(np.asarray, shared))
    forms, form = (form_of(shared), form_of((rows[0],))), form_of(answer)
    return unpacked(form, answers(function, forms, _length(form, rows.dtype), block, rows, row))


def like_result() -> Any:
    """Return the shape and type of a member of RESULTS."""
    return jax.tree_util.tree_map(lambda x: jax.ShapeDtypeStruct((), x.dtype), RESULTS.successful)


class Packing(NamedTuple):
    """Layout of arrays in one row of numbers: their structure, shapes and types."""

    tree: Any
    kinds: tuple[tuple[tuple[int, ...], np.dtype], ...]


def form_of(values: Any) -> Packing:
    """Return the packing of arrays."""
    leaves, tree = jax.tree_util.tree_flatten(values)
    return Packing(tree, tuple((x.shape, np.dtype(jax.dtypes.canonicalize_dtype(x.dtype))) for x in leaves))


def _length(form: Packing, row: np.dtype) -> int:
    wide = jnp.result_type(int).itemsize // row.itemsize
    return sum((1 if _is_real(kind) else wide) * prod(shape) for shape, kind in form.kinds)


def _is_real(kind: np.dtype) -> bool:
    return kind.kind in "fV"  # types that NumPy does not have, such as bfloat16, are of kind V


def packed(values: Any) -> Any:
    """Return all numbers in one row: passing one array to the host takes as long as a short step of a search.

    Whole numbers are stored by their bits.
    """
    leaves = jax.tree_util.tree_leaves(values)
    kind = jnp.result_type(float, *(x.dtype for x in leaves if _is_real(x.dtype)))
    xp: Any = jnp if is_traced(leaves) else np

    def row(x: Any) -> Any:
        if _is_real(x.dtype):
            return xp.ravel(x).astype(kind)
        whole = xp.ravel(x).astype(jnp.result_type(int))
        return whole.view(kind) if xp is np else jnp.ravel(jax.lax.bitcast_convert_type(whole, kind))

    return xp.concatenate([xp.zeros(0, kind), *map(row, leaves)])


def unpacked(form: Packing, rows: Any) -> Any:
    """Return the arrays of a row, or of rows with axes in front."""
    leaves, start, batch, whole = [], 0, rows.shape[:-1], jnp.result_type(int)
    for shape, kind in form.kinds:
        real = _is_real(kind)
        each = 1 if real else whole.itemsize // rows.dtype.itemsize
        part = rows[..., start : start + each * prod(shape)]
        start += each * prod(shape)
        if not real and isinstance(part, np.ndarray):
            part = np.ascontiguousarray(part).view(whole)
        elif not real:
            part = jax.lax.bitcast_convert_type(part if each == 1 else part.reshape(*batch, -1, each), whole)
        leaves.append(part.reshape(*batch, *shape).astype(kind))
    return form.tree.unflatten(leaves)


def answers(
    function: Callable[..., Any],
    forms: tuple[Packing, Packing],
    length: int,
    block: int,
    rows: np.ndarray,
    shared: np.ndarray,
) -> np.ndarray:
    """Return the packed results for packed arguments, by the kept compiled function.

    Args:
        function: as in `by_kept_program`.
        forms: packings of its shared arguments, and of its own.
        length: length of a packed result.
        block: largest number of rows in one call.
        rows: its own arguments, packed.
        shared: the shared arguments, packed.
    """
    if len(rows) == 1:
        with jax.default_device(host_device()):
            return np.asarray(_one(function, forms, rows[0], shared))[None]
    step = max(block // 8, min(block, len(rows) // (4 * cores())))
    out, blank = np.empty((len(rows), length), rows.dtype), np.zeros((block, length), rows.dtype)

    def some(start: int) -> None:
        part = rows[start : start + step]
        filled = np.concatenate([part, np.broadcast_to(part[-1], (block - len(part), part.shape[1]))])
        found = _many(function, forms, np.asarray(len(part)), blank, filled, shared)
        out[start : start + step] = np.asarray(found)[: len(part)]

    on_all_cores(some, range(0, len(rows), step))
    return out


@partial(compiled, static=(0, 1))
def _one(function: Callable[..., Any], forms: tuple[Packing, Packing], own: Array, shared: Array) -> Any:
    return packed(function(*unpacked(forms[0], shared), *unpacked(forms[1], own)))


@partial(optimized, static=(0, 1))
def _many(
    function: Callable[..., Any], forms: tuple[Packing, Packing], count: Any, blank: Array, rows: Array, shared: Array
) -> Array:
    """Return the results for the first `count` rows of a block, computed one after the other."""
    given = unpacked(forms[0], shared)

    def member(k: Any, out: Any) -> Any:
        return out.at[k].set(packed(function(*given, *unpacked(forms[1], rows[k]))))

    return jax.lax.fori_loop(0, count, member, blank)


def cores() -> int:
    """Return how many threads may compute at a time."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_all_cores(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """Return work(item) for each item, on the device for host calls; the waiting thread takes part."""
    device, wide, found, left = host_device(), _is_wide(), [None] * len(items), iter(range(len(items)))

    def some(_: int = 0) -> None:
        with jax.default_device(device), jax.enable_x64(wide):
            for k in left:
                found[k] = work(items[k])

    helpers = min(cores(), len(items)) - 1
    if helpers < 1:
        some()
        return found
    with ThreadPoolExecutor(helpers) as pool:
        others = pool.map(some, range(helpers))
        some()
        list(others)
    return found


class AnswerForm(NamedTuple):
    """The form of every answer of a search: its precision, dimension, feet, shapes of both parameters, and counts."""

    dtype: Any
    dim: int
    feet: int
    t: tuple[int, ...]
    params: tuple[int, ...]
    counts: tuple[str, ...]

    def refused(self, result: Any = RESULTS.nonfinite_value) -> HausdorffSolution:
        """Return the result for invalid shapes."""
        # Operations of JAX would be compiled for it.
        number = lambda x, *shape: array_of(np.full(shape, x, self.dtype))  # noqa: E731
        none = array_of(np.zeros((), jnp.result_type(int)))
        witness = Witness(
            element=none,
            t=number(jnp.nan, *self.t),
            point=number(jnp.nan, self.dim),
            feet=number(jnp.nan, self.feet, self.dim),
            feet_elements=array_of(np.zeros(self.feet, jnp.result_type(int))),
            feet_params=number(jnp.nan, self.feet, *self.params),
            multipliers=array_of(np.eye(1, self.feet, dtype=self.dtype)[0]),
            event=EVENTS.coincident,
            direction=DIRECTIONS.a_to_b,
        )
        stats = {name: none for name in self.counts}
        return HausdorffSolution(number(jnp.inf), number(0.0), number(jnp.inf), witness, result, stats)

    def like(self, *batch: int) -> Any:
        """Return the shapes and types of a result, or of several results."""
        return jax.tree_util.tree_map(lambda x: jax.ShapeDtypeStruct((*batch, *x.shape), x.dtype), _example(self))


@lru_cache(maxsize=64)
def _example(form: AnswerForm) -> HausdorffSolution:
    with eval_context():
        return form.refused()


def answer_in_program(
    answer: Callable[..., Any], refused: Callable[[], Any], shapes: Any, options: dict[str, Any]
) -> Any:
    """Return a result for shapes that are known when the compiled function runs; its first leaf is differentiable.

    Args:
        answer: maps the shapes and the options by name, all known, to a pytree; differentiable outside of compiled
            functions.
        refused: makes the result for shapes that are invalid or that a plain call refuses; every result has its form.
        shapes: a pytree; its arrays of real numbers are differentiated.
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
    """Return the zero tangent of a constant; for integers JAX requires a type of its own."""
    return jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.inexact) else np.zeros(x.shape, jax.dtypes.float0)
