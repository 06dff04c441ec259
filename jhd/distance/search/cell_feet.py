"""Which of the feet that are known near a cell are kept for its bounds and for its parts."""

import numpy as np

from jhd.distance.cells.surfaces import FEET
from jhd.distance.nearest.target import FootRows

# Feet count together where their distances agree to this many diameters of a cell.
_TOGETHER = 2.0


def spread(feet: FootRows, places: np.ndarray) -> FootRows:
    """Some feet of each cell: the nearest to the middle, and of those about as near the farthest from each other."""
    there = np.where(feet.error[..., None] < np.inf, feet.point, np.nan).astype(np.float64)
    middle = places[:, :1].astype(np.float64)
    size = np.sqrt(np.max(np.sum((places - middle) ** 2, axis=2), axis=1))
    far = np.sqrt(np.sum((there - middle) ** 2, axis=2))
    far = np.where(np.isnan(far), np.inf, far)
    first = np.argmin(far, axis=1)
    index = np.arange(len(first))
    reach = far[index, first] + _TOGETHER * size
    chosen = [first]
    apart = np.sum((there - there[index, first][:, None]) ** 2, axis=2)
    for _ in range(FEET - 1):
        after = np.argmax(np.where(far <= reach[:, None], apart, -1.0), axis=1)
        chosen.append(after)
        apart = np.fmin(apart, np.sum((there - there[index, after][:, None]) ** 2, axis=2))
    rows = np.stack(chosen, axis=1)
    return feet.map(lambda x: x[index[:, None], rows])


def put(feet: FootRows, cells: np.ndarray, rows: FootRows) -> None:
    """One foot more for each of some cells, in place of the last one."""
    for held, new in zip(feet, rows, strict=True):
        held[cells, -1] = new
