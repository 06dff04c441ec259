"""Messages for arguments that belong elsewhere, and for calls that cannot be traced."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import jax

from jhd._runtime.arrays import is_tracing

Called = TypeVar("Called", bound=Callable[..., Any])


def belongs(**places: str) -> Callable[[Called], Called]:
    """Decorator: a call with one of these keywords raises a TypeError with the correct way to write it.

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
    """Decorator: a call of a constructor with too few positional arguments, and no keywords, raises TypeError.

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
    """Raise TypeError inside a function that is being traced, for a call that needs concrete numbers."""
    if is_tracing(*values):
        raise TypeError(
            f"{name}() is a search on the host, which cannot run inside jit, vmap or grad: call it outside, or "
            "differentiate jhd.hausdorff or jhd.soft_hausdorff of the shape."
        )


def traceable(build: Callable[[Any], Any], parameters: Any) -> Any:
    """build(parameters), to be differentiated; if something in `build` cannot be traced, the error says so."""
    try:
        return build(parameters)
    except jax.errors.JAXTypeError as error:
        raise TypeError(
            "build is traced, but it needs a value that is unknown during tracing: write it in jax.numpy, without "
            f"NumPy, float() or `if` on the parameters. {str(error).splitlines()[0]}"
        ) from error
