"""Arguments that are easily looked for in the wrong place, and where they belong."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

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
