"""CPU time of the first call of a process by phase: without a cache on disk, with a cold and with a warm cache.

Numbers by first_call's experiment.

Caption: CPU time of the first call of a process after the import, by phase: without a cache on disk, with a cold
(empty) cache, and with a warm cache. With a warm cache, distances and a gradient take less than a fifth, a fit less
than a quarter and functions under jax.jit, which call the kept search, less than two fifths of the time without a
cache. Bounds are bitwise identical.

Alt text: Stacked horizontal bars in nine groups of three, one bar each without a cache, with a cold cache and with a
warm cache. In most groups the warm bars are by far the shortest.
"""

from typing import Any

import numpy as np
from common import BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, Picture, style
from matplotlib.figure import Figure
from matplotlib.patches import Patch

# Phases from left to right, with their color and hatch.
_PHASES = {
    "tracing": ("tracing and lowering", ORANGE, "//"),
    "XLA": ("compiling (XLA)", PURPLE, ""),
    "writing": ("writing the cache", GREEN, ".."),
    "reading": ("reading the cache", BLUE, "xx"),
    "rest": ("rest; all phases, if not told apart", GRAY, ""),
}
_WAYS = {"without": "no cache", "first": "cold cache", "second": "warm cache"}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers["entries"]))


def _figure(entries: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, (24 + 14 * len(entries)) * MM), layout="constrained")
        ax: Any = figure.subplots()
        places = [4 * k + i for k in range(len(entries)) for i in range(len(_WAYS))]
        rows = [entry[way] for entry in entries.values() for way in _WAYS]
        left = np.zeros(len(rows))
        for phase, (_, color, hatch) in _PHASES.items():
            widths = np.array([row["phases"][phase] for row in rows])
            ax.barh(places, widths, left=left, color=color, hatch=hatch, edgecolor="white", linewidth=0.3)
            left += widths
        for place, row in zip(places, rows, strict=True):
            ax.annotate(
                f"{row['seconds']:.2f}", (row["seconds"], place), (2, 0), textcoords="offset points", va="center"
            )
        labels = [way if k else f"{name}, {way}" for name in entries for k, way in enumerate(_WAYS.values())]
        ax.set_yticks(places, labels)
        ax.invert_yaxis()
        ax.set_xlabel("CPU time (s)")
        ax.margins(y=0.01)
        look: dict[str, Any] = {"edgecolor": "white", "linewidth": 0.3}
        keys = [Patch(facecolor=color, hatch=hatch, label=name, **look) for name, color, hatch in _PHASES.values()]
        figure.legend(handles=keys, loc="outside upper center", ncols=3)
    return figure


if __name__ == "__main__":
    main()
