"""Progress of long calls: every `progress=` callback receives a `Progress`."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

__all__ = ["Callback", "Progress"]


class Progress(NamedTuple):
    """Progress of a long call: the current stage, its finished items, and the bounds reached so far.

    Args:
        stage: name of the current stage, for example "a_to_b", "minimum", "distances" or "start 1".
        done: number of finished items of this stage: steps, cells, levels, shapes or pairs.
        total: number of items of this stage as far as it is known, which can grow; None if it is unknown.
        lower: certified lower bound of the distance, in the unit of the coordinates; None if the stage has no bounds.
        upper: certified upper bound of the distance; None if the stage has no bounds.
        details: other numbers by name. Fits report "value" and "optimality"; voxelizations report "tested" and "kept"
            cells; fields report "tested" and "split" cells, and "samples".
    """

    stage: str
    done: int
    total: int | None = None
    lower: float | None = None
    upper: float | None = None
    details: Mapping[str, float] = MappingProxyType({})


Callback = Callable[[Progress], object]
"""A function that is called with a Progress from time to time."""
