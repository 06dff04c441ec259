"""Arguments that are easily looked for in the wrong place, and where they belong."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import jax

from jhd._runtime.arrays import is_tracing

Called = TypeVar("Called", bound=Callable[..., Any])


def belongs(**places: str) -> Callable[[Called], Called]:
    """A call with one of these keywords raises TypeError that says what to write instead.

    >>> @belongs(atol="write method=BranchAndBound(atol=...)")
    ... def measured(a): return a
    >>> measured(1, atol=2)
    Traceback (most recent call last):
    TypeError: measured() takes no atol: write method=BranchAndBound(atol=...).
    """

    def decorated(function: Called) -> Called:
        name = function.__qualname__.removesuffix(".__init__")

        @wraps(function)
        def called(*args: Any, **kwargs: Any) -> Any:
            for key in kwargs:
                if key in places:
                    raise TypeError(f"{name}() takes no {key}: {places[key]}.")
            return function(*args, **kwargs)

        return cast(Called, called)

    return decorated


def takes(count: int, message: str) -> Callable[[Called], Called]:
    """A constructor that is called with fewer positional arguments, and no others, raises TypeError with the message.

    >>> class Pair:
    ...     @takes(2, "write Pair(*both)")
    ...     def __init__(self, first, second): ...
    >>> Pair((1, 2))
    Traceback (most recent call last):
    TypeError: Pair() needs 2 arguments, got one: write Pair(*both).
    """

    def decorated(function: Called) -> Called:
        name = function.__qualname__.removesuffix(".__init__").rpartition(".")[2]

        @wraps(function)
        def called(self: Any, *args: Any, **kwargs: Any) -> Any:
            if len(args) == 1 < count and not kwargs:
                raise TypeError(f"{name}() needs {count} arguments, got one: {message}.")
            return function(self, *args, **kwargs)

        return cast(Called, called)

    return decorated


def refuse_tracing(name: str, *values: object) -> None:
    """Raises TypeError inside a program that is being traced, for a call that works with known numbers alone."""
    if is_tracing(*values):
        raise TypeError(
            f"{name}() is a search on the host, which cannot run inside jit, vmap or grad: call it outside; what is "
            "differentiable is jhd.hausdorff or jhd.soft_hausdorff of the shape."
        )


def traceable(build: Callable[[Any], Any], parameters: Any) -> Any:
    """build(parameters), whose derivatives are taken; an error that comes of what is not traceable says so."""
    try:
        return build(parameters)
    except jax.errors.JAXTypeError as error:
        raise TypeError(
            "build is traced, and something in it needs a number that is not known yet: write it in jax.numpy, without "
            f"NumPy, float() or `if` on the parameters. {str(error).splitlines()[0]}"
        ) from error
