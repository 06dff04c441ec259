"""Which tests are run: of sweeps over many cases the quick and the slow ones, and those for CPUs alone."""

from collections.abc import Callable, Collection, Iterable
from typing import Any

import jax
import pytest

# On accelerators no program is kept, and memory and options of the compiler are not asked for.
CPU_ONLY = pytest.mark.skipif(jax.default_backend() != "cpu", reason="about programs and memory of CPUs")


def swept(
    cases: Iterable[Any],
    quick: int | Collection[Any] = (),
    slow: int | Collection[Any] = (),
    ids: Callable[[Any], str] | None = None,
) -> list[Any]:
    """Return all cases as parameters of one test; a tuple is a case of several parameters.

    Args:
        cases: The values of the sweep.
        quick: The cases without a marker, or how many: the first ones.
        slow: The cases of the slow tests, or how many: those that follow. Every kind of case that a claim is about
            belongs to one of the two.
        ids: The name of one parameter; without it those that pytest gives, of numbers and texts these themselves.
    """
    cases = list(cases)

    def chosen(wanted: int | Collection[Any], start: int) -> Collection[int]:
        if isinstance(wanted, int):
            return range(start, start + wanted)
        return [k for k, case in enumerate(cases) if case in wanted]

    always, often = chosen(quick, 0), chosen(slow, quick if isinstance(quick, int) else 0)

    def parameter(k: int, case: Any) -> Any:
        marks = () if k in always else pytest.mark.slow if k in often else pytest.mark.exhaustive
        values = case if isinstance(case, tuple) else (case,)
        return pytest.param(*values, id=None if ids is None else "-".join(map(ids, values)), marks=marks)

    return [parameter(k, case) for k, case in enumerate(cases)]
