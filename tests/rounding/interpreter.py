"""Kernels evaluated step by step in an arithmetic of one's own: exact, in a narrow format, or with errors enclosed.

What a kernel computes is taken from its jaxpr, so constants and order are those of the package. Integers, booleans and
all that moves numbers about are NumPy's; floating-point numbers are whatever the arithmetic makes of them: an array, or
a tuple of arrays of one shape. Primitives that are not known are refused by name.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

COMPARED: dict[str, Callable] = {
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "eq": np.equal,
    "ne": np.not_equal,
}
_WHOLE: dict[str, Callable] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "max": np.maximum,
    "min": np.minimum,
    "rem": np.fmod,
    "neg": np.negative,
    "abs": np.abs,
    "and": np.bitwise_and,
    "or": np.bitwise_or,
    "not": np.invert,
    "clamp": lambda low, x, high: np.minimum(np.maximum(x, low), high),
    **COMPARED,
}
_OVER = {"reduce_max": np.max, "reduce_min": np.min, "reduce_sum": np.sum, "reduce_and": np.all, "reduce_or": np.any}
_CALLS = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr"}
_SAME = ("stop_gradient", "copy", "copy_p", "optimization_barrier", "pvary", "pcast")


class AbstractArithmetic(ABC):
    """What floating-point numbers are, and what operations make of them."""

    @abstractmethod
    def lift(self, x: np.ndarray, constant: bool) -> Any:
        """Numbers of a floating-point array, which a kernel is given or has as a constant of its own."""

    @abstractmethod
    def apply(self, name: str, operands: list[Any], parameters: dict[str, Any]) -> Any:
        """The result of one primitive of arithmetic on numbers of one shape, or of scalars."""

    @abstractmethod
    def compare(self, name: str, x: Any, y: Any) -> np.ndarray:
        """The truth of a comparison."""

    @abstractmethod
    def select(self, which: np.ndarray, cases: list[Any]) -> Any:
        """One of several numbers, place by place."""

    @abstractmethod
    def value(self, x: Any) -> np.ndarray:
        """Ordinary numbers close to these, for choices that any answer serves."""


def evaluate(function: Callable, arithmetic: AbstractArithmetic, inputs: Sequence[Any], given: Sequence[Any]) -> Any:
    """The results of a function of arrays, in an arithmetic.

    Args:
        function: of arrays, traced with `inputs`.
        arithmetic: the numbers.
        inputs: NumPy arrays of the types and shapes that the function takes.
        given: the same as numbers of the arithmetic; None where it is what the arithmetic makes of the input.
    """
    closed = jax.make_jaxpr(function)(*inputs)
    values = [_lifted(arithmetic, x, False) if y is None else y for x, y in zip(inputs, given, strict=True)]
    found = run(closed, arithmetic, values)
    return found[0] if len(found) == 1 else found


def run(closed: Any, arithmetic: AbstractArithmetic, values: Sequence[Any]) -> list[Any]:
    """The results of a closed jaxpr."""
    jaxpr = closed.jaxpr
    known: dict[Any, Any] = {
        variable: _lifted(arithmetic, x, True) for variable, x in zip(jaxpr.constvars, closed.consts, strict=True)
    }
    known.update(zip(jaxpr.invars, values, strict=True))
    last = {v: k for k, equation in enumerate(jaxpr.eqns) for v in equation.invars if not isinstance(v, core.Literal)}

    def read(x: Any) -> Any:
        return _lifted(arithmetic, x.val, True) if isinstance(x, core.Literal) else known[x]

    with np.errstate(all="ignore"):
        for k, equation in enumerate(jaxpr.eqns):
            results = _equation(equation, arithmetic, [read(x) for x in equation.invars])
            known.update(zip(equation.outvars, results, strict=True))
            for x in equation.invars:
                if not isinstance(x, core.Literal) and last[x] == k and x not in jaxpr.outvars:
                    known.pop(x, None)
        return [read(x) for x in jaxpr.outvars]


def _lifted(arithmetic: AbstractArithmetic, x: Any, constant: bool) -> Any:
    x = np.asarray(x)
    return arithmetic.lift(x, constant) if np.issubdtype(x.dtype, np.floating) else x


def _is_float(x: Any) -> bool:
    return np.issubdtype(x.aval.dtype, np.floating)


def _parts(x: Any) -> tuple:
    return x if isinstance(x, tuple) else (x,)


def each_part(function: Callable, *xs: Any) -> Any:
    """The function of every array that numbers consist of."""
    found = [function(*row) for row in zip(*map(_parts, xs), strict=True)]
    return type(xs[0])(*found) if isinstance(xs[0], tuple) else found[0]


def _equation(equation: Any, arithmetic: AbstractArithmetic, operands: list[Any]) -> list[Any]:
    name, parameters = equation.primitive.name, equation.params
    if name in _CALLS:
        inner = parameters[_CALLS[name]]
        return run(inner if hasattr(inner, "consts") else core.ClosedJaxpr(inner, ()), arithmetic, operands)
    if name in _LOOPS:
        return _LOOPS[name](arithmetic, operands, equation)
    if name in _SAME:
        return operands
    if name == "unstack":
        return _unstacked(operands, parameters)
    if name == "sort" and not any(_is_float(x) for x in equation.invars):
        return [np.asarray(x) for x in equation.primitive.bind(*operands, **parameters)]
    if name in _MOVES:
        return [_MOVES[name](operands, parameters, equation)]
    return [_computed(equation, arithmetic, operands)]


def _computed(equation: Any, arithmetic: AbstractArithmetic, operands: list[Any]) -> Any:
    name, parameters = equation.primitive.name, equation.params
    if name == "select_n":
        which, *cases = operands
        if not _is_float(equation.invars[1]):
            return np.where(which, cases[1], cases[0])
        shape = _parts(cases[0])[0].shape
        return arithmetic.select(np.broadcast_to(which, shape).astype(int), cases)
    if name == "convert_element_type":
        new = parameters["new_dtype"]
        if _is_float(equation.invars[0]):
            return operands[0] if np.issubdtype(new, np.floating) else arithmetic.value(operands[0]).astype(new)
        x = operands[0].astype(new)
        return arithmetic.lift(x, False) if np.issubdtype(new, np.floating) else x
    if name in ("argmin", "argmax"):
        x = arithmetic.value(operands[0]) if _is_float(equation.invars[0]) else operands[0]
        return getattr(np, name)(x, axis=parameters["axes"][0]).astype(parameters["index_dtype"])
    if not _is_float(equation.invars[0]):
        return _of_integers(name, operands, parameters)
    return _of_numbers(equation, arithmetic, operands)


def _of_numbers(equation: Any, arithmetic: AbstractArithmetic, operands: list[Any]) -> Any:
    name = equation.primitive.name
    if name == "scatter-add":
        new, there = _scattered(operands, equation.params, equation)
        total = arithmetic.apply("add", [operands[0], new], {})
        return each_part(lambda x, y: np.where(there, y, x), operands[0], total)
    if name == "is_finite":
        return np.isfinite(arithmetic.value(operands[0]))
    if name in COMPARED:
        if equation.invars[0] is equation.invars[1]:
            # Whether a number is one is asked by comparing it with itself.
            return COMPARED[name](*[arithmetic.value(operands[0])] * 2)
        return arithmetic.compare(name, *operands)
    return arithmetic.apply(name, operands, equation.params)


def _of_integers(name: str, operands: list[Any], parameters: dict[str, Any]) -> Any:
    if name in _OVER:
        return np.asarray(_OVER[name](operands[0], axis=tuple(parameters["axes"])))
    if name not in _WHOLE:
        raise NotImplementedError(f"the primitive {name} of integers is not known.")
    return np.asarray(_WHOLE[name](*operands))


def _broadcast(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    shape, places = parameters["shape"], parameters["broadcast_dimensions"]

    def one(x: np.ndarray) -> np.ndarray:
        wide = [1] * len(shape)
        for k, place in enumerate(places):
            wide[int(place)] = x.shape[k]
        return np.broadcast_to(x.reshape(wide), shape)

    return each_part(one, operands[0])


def _slice(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    start, stop = parameters["start_indices"], parameters["limit_indices"]
    steps = parameters["strides"] or (1,) * len(start)
    index = tuple(slice(int(a), int(b), int(c)) for a, b, c in zip(start, stop, steps, strict=True))
    return each_part(lambda x: x[index], operands[0])


def _dynamic_slice(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    x, *starts = operands
    index = _block(starts, parameters["slice_sizes"], _parts(x)[0].shape)
    return each_part(lambda x: x[index], x)


def _updated(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    x, new, *starts = operands
    index = _block(starts, _parts(new)[0].shape, _parts(x)[0].shape)

    def one(x: np.ndarray, new: np.ndarray) -> np.ndarray:
        changed = np.array(x)
        changed[index] = new
        return changed

    return each_part(one, x, new)


def _block(starts: list[Any], sizes: Any, shape: tuple[int, ...]) -> tuple[slice, ...]:
    rows = zip(starts, sizes, shape, strict=True)
    return tuple(slice(a, a + n) for a, n in ((int(np.clip(s, 0, m - n)), int(n)) for s, n, m in rows))


def _padded(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    config = [tuple(int(k) for k in row) for row in parameters["padding_config"]]
    if any(low < 0 or high < 0 or inner for low, high, inner in config):
        raise NotImplementedError("padding between numbers, or by less than nothing.")

    def one(x: np.ndarray, value: np.ndarray) -> np.ndarray:
        wide = np.empty([low + n + high for n, (low, high, _) in zip(x.shape, config, strict=True)], x.dtype)
        wide[...] = value
        wide[tuple(slice(low, low + n) for n, (low, _, _) in zip(x.shape, config, strict=True))] = x
        return wide

    return each_part(one, *operands)


def _gathered(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    x, index = operands
    shape = _parts(x)[0].shape
    # Places are gathered by the primitive itself, then whatever the numbers are made of.
    places = np.arange(int(np.prod(shape))).reshape(shape)
    taken = np.asarray(equation.primitive.bind(places, np.asarray(index), **parameters))
    return each_part(lambda x: x.reshape(-1)[taken], x)


def _scattered(operands: list[Any], parameters: dict[str, Any], equation: Any) -> tuple[Any, np.ndarray]:
    """For each place of the first operand the new number that goes there, and where there is one."""
    x, index, new = operands
    shape, count = _parts(x)[0].shape, _parts(new)[0].size
    numbers = {key: parameters[key] for key in ("dimension_numbers", "indices_are_sorted", "unique_indices", "mode")}
    places = np.arange(count).reshape(_parts(new)[0].shape)
    taken = np.asarray(jax.lax.scatter(np.full(shape, -1), np.asarray(index), places, **numbers))
    if np.sum(taken >= 0) != count:
        raise NotImplementedError("several numbers that go to one place, or nowhere.")
    return each_part(lambda new: new.reshape(-1)[np.maximum(taken, 0)], new), taken >= 0


def _set(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    new, there = _scattered(operands, parameters, equation)
    return each_part(lambda x, new: np.where(there, new, x), operands[0], new)


def _stacked(operands: list[Any], parameters: dict[str, Any], equation: Any) -> Any:
    return each_part(lambda *x: np.stack(x, parameters["axis"]), *operands)


def _unstacked(operands: list[Any], parameters: dict[str, Any]) -> list[Any]:
    moved = each_part(lambda x: np.moveaxis(x, parameters["axis"], 0), operands[0])
    return [_row(moved, k) for k in range(len(_parts(moved)[0]))]


_MOVES: dict[str, Callable] = {
    "broadcast_in_dim": _broadcast,
    "reshape": lambda x, p, e: each_part(lambda x: x.reshape(e.outvars[0].aval.shape), x[0]),
    "squeeze": lambda x, p, e: each_part(lambda x: x.reshape(e.outvars[0].aval.shape), x[0]),
    "expand_dims": lambda x, p, e: each_part(lambda x: x.reshape(e.outvars[0].aval.shape), x[0]),
    "transpose": lambda x, p, e: each_part(lambda x: x.transpose(p["permutation"]), x[0]),
    "rev": lambda x, p, e: each_part(lambda x: np.flip(x, p["dimensions"]), x[0]),
    "concatenate": lambda x, p, e: each_part(lambda *x: np.concatenate(x, p["dimension"]), *x),
    "iota": lambda x, p, e: np.asarray(jax.lax.iota_p.bind(**p)),
    "stack": _stacked,
    "slice": _slice,
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _updated,
    "pad": _padded,
    "gather": _gathered,
    "scatter": _set,
}


def _row(x: Any, k: int) -> Any:
    return each_part(lambda part: part[k], x)


def _scan(arithmetic: AbstractArithmetic, operands: list[Any], equation: Any) -> list[Any]:
    parameters = equation.params
    inner, length, reverse = parameters["jaxpr"], parameters["length"], parameters["reverse"]
    # Versions of JAX name the counts differently. What a step takes or makes a row of has one axis more outside.
    within = getattr(inner, "jaxpr", inner)
    rows = sum(x.aval.ndim > y.aval.ndim for x, y in zip(equation.invars, within.invars, strict=True))
    carried = sum(x.aval.ndim == y.aval.ndim for x, y in zip(equation.outvars, within.outvars, strict=True))
    constants = len(operands) - carried - rows
    fixed, state, columns = (
        operands[:constants],
        operands[constants : constants + carried],
        operands[constants + carried :],
    )
    outputs: list[list[Any]] = []
    for k in reversed(range(length)) if reverse else range(length):
        found = run(inner, arithmetic, [*fixed, *state, *(_row(x, k) for x in columns)])
        state, out = found[:carried], found[carried:]
        outputs.append(out)
    if reverse:
        outputs.reverse()
    return [*state, *(each_part(lambda *x: np.stack(x), *column) for column in zip(*outputs, strict=True))]


def _while(arithmetic: AbstractArithmetic, operands: list[Any], equation: Any) -> list[Any]:
    parameters = equation.params
    first, second = parameters["cond_nconsts"], parameters["body_nconsts"]
    asked, fixed, state = operands[:first], operands[first : first + second], operands[first + second :]
    while run(parameters["cond_jaxpr"], arithmetic, [*asked, *state])[0]:
        state = run(parameters["body_jaxpr"], arithmetic, [*fixed, *state])
    return state


def _cond(arithmetic: AbstractArithmetic, operands: list[Any], equation: Any) -> list[Any]:
    return run(equation.params["branches"][int(operands[0])], arithmetic, operands[1:])


_LOOPS: dict[str, Callable] = {"scan": _scan, "while": _while, "cond": _cond}
