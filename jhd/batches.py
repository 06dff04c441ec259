"""Batches of solutions: one solution whose leaves have leading axes, as vmap makes them.

They are indexed, tell which of them succeeded, and count the others where they are shown, every kind in one way.
"""

from collections import Counter
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from jhd.arrays import is_traced
from jhd.outcomes import RESULTS, names_of


class AbstractSolution(eqx.Module):
    """What an entry returns, single or as a batch; the axes of `result` are those of the batch."""

    # The field `result` is left to each class: checkers of types would take it for the first argument of all.

    @property
    def ok(self) -> Array:
        """Whether everything that was asked for holds: of a batch an array."""
        return _result(self) == RESULTS.successful

    def __getitem__(self, index: Any) -> Any:
        """Some of a batch, by an index as NumPy takes it, along its axes.

        Raises:
            TypeError: a single solution.
            IndexError: outside the batch.
        """
        shape = np.shape(_result(self)._value)
        if not shape:
            raise TypeError(
                f"this {type(self).__name__} is a single one; only a batch, as vmap makes it, has an index."
            )
        if not is_traced(index):
            # NumPy says what is outside, where JAX takes what is nearest.
            np.empty(shape, bool)[index]
        if is_traced(self, index):
            return jax.tree_util.tree_map(lambda x: x[index], self)
        # On the host, where nothing is compiled.
        return on_device(jax.tree_util.tree_map(lambda x: np.asarray(x)[index], self))


def _result(solution: Any) -> Any:
    return solution.result


def on_device(solution: Any) -> Any:
    """The same with arrays of JAX's in place of NumPy's; all together, since one transfer takes as long as many."""
    leaves, structure = jax.tree_util.tree_flatten(solution)
    places = [k for k, leaf in enumerate(leaves) if isinstance(leaf, np.ndarray | np.generic)]
    if not places:
        return solution
    for k, leaf in zip(places, jax.device_put([leaves[k] for k in places]), strict=True):
        leaves[k] = leaf
    return jax.tree_util.tree_unflatten(structure, leaves)


def shown_many(solution: Any, name: str) -> str | None:
    """A batch, or what is traced, in two lines: the range of the numbers of this name, failures by their kinds.

    None for a single solution, which shows itself.
    """
    kind, numbers, shape = type(solution).__name__, getattr(solution, name), np.shape(solution.result._value)
    if is_traced(solution):
        return f"{kind}({name}={eqx.tree_pformat(numbers)},\n  traced: known when the program runs)"
    if not shape:
        return None
    numbers = np.asarray(numbers)
    span = f", {name} from {np.min(numbers):.9g} to {np.max(numbers):.9g}" if numbers.size else ""
    counts = Counter(names_of(solution.result))
    total, good = counts.total(), counts.pop("successful", 0)
    why = ", ".join(f"{count} {end}" for end, count in counts.most_common())
    ended = "all successful" if good == total else f"{total - good} of {total} not successful: {why}"
    return f"{kind}(batch of {' x '.join(map(str, shape))}{span},\n  {ended}; index it)"
