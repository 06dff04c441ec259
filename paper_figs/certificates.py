"""CPU seconds to check certificates, and their cells, for every pair of kinds of shapes.

Numbers by certificates's experiment.

Caption: CPU seconds of the check of a certificate in exact integers, and its number of cells, for ten random pairs of
shapes for every pair of kinds; the least and the largest are filled. The numbers on the right count refused forgeries,
two hundred for each certificate: bounds one digit beyond the certified ones, missing cells, wrong foot points, other
shapes. Decisions that one point answers have no cells.

Alt text: A table of 23 pairs of kinds with two dot plots on logarithmic axes, check times below a second and numbers of
cells up to a hundred, and a column of refused forgeries, 2000 in every row.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Color and marker of each distance.
_LOOKS = {"largest": (BLUE, "o"), "smallest": (ORANGE, "D"), "decision": (VERMILLION, "^")}
_NAMES = {"largest": "Hausdorff distance", "smallest": "smallest distance", "decision": "decision"}
_PANELS = {"within": ("checking", "CPU time (s)"), "cells": ("cells", "number of cells")}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    mixes = numbers["mixes"]
    with style():
        figure = Figure(figsize=(85 * MM, (30 + 4.1 * len(mixes)) * MM), layout="constrained")
        axes = figure.subplots(1, 2, sharey=True)
        for ax, (key, (title, label)), name in zip(axes, _PANELS.items(), "ab", strict=True):
            _draw(ax, mixes, key)
            ax.set_xlabel(label)
            letter(ax, name, title)
        axes[0].set_yticks(range(len(mixes)), [_label(mix) for mix in mixes])
        for ax in axes:
            ax.tick_params(axis="y", length=0)
        axes[0].set_ylim(len(mixes) - 0.5, -0.5)
        right = axes[1].secondary_yaxis("right")
        right.set_yticks(range(len(mixes)), [_refused(mix) for mix in mixes])
        right.tick_params(axis="y", length=0)
        right.spines["right"].set_visible(False)
        axes[1].annotate("refused", (1.0, 1.0), (4, 3), "axes fraction", textcoords="offset points")
        handles, labels = _keys(axes[0])
        figure.legend(handles, labels, loc="outside lower center", ncols=2, columnspacing=1.2, handletextpad=0.2)
    return figure


def _draw(ax: Axes, mixes: list[dict[str, Any]], key: str) -> None:
    """Draw a dot for each certificate, and a line from the least to the largest of a pair of kinds."""
    for k, mix in enumerate(mixes):
        color, marker = _LOOKS[mix["distance"]]
        values = np.sort([found[key] for found in mix["certificates"]])
        # The filled marks at the ends are drawn last, on top of the others.
        ax.plot(values, np.full(len(values), k), color=GRAY, linewidth=0.6, zorder=1)
        mark: dict[str, Any] = {"marker": marker, "s": 11, "linewidths": 0.6, "edgecolors": color}
        ax.scatter(values[1:-1], np.full(len(values[1:-1]), k), facecolors="white", zorder=2, **mark)
        ends = values[[0, -1]] if len(values) else values
        ax.scatter(ends, np.full(len(ends), k), facecolors=color, zorder=3, **mark)
    every = np.array([found[key] for mix in mixes for found in mix["certificates"]], float)
    if key == "cells":
        # If a witness answers, there are no cells.
        ax.set_xscale("symlog", linthresh=1.0)
        ax.set_xlim(-0.3, 2 * every.max())
        ticks = [0, *(10**k for k in range(3) if 10**k <= 2 * every.max())]
        ax.set_xticks(ticks, [str(x) for x in ticks])
    else:
        ax.set_xscale("log")
        ax.set_xlim(*10.0 ** np.array([np.floor(np.log10(every.min()) - 0.1), np.ceil(np.log10(every.max()) + 0.1)]))
    ax.grid(axis="y", color="#E4E4E4", linewidth=0.5, zorder=0)
    ax.set_axisbelow(True)
    ax.minorticks_off()


def _label(mix: dict[str, Any]) -> str:
    first, second = mix["kinds"]
    return f"{first}, {second.removeprefix('plane ')}"


def _refused(mix: dict[str, Any]) -> str:
    """Return the number of refused forgeries, with the number tried if some were not refused."""
    tried = sum(sum(found["forgeries"].values()) for found in mix["certificates"])
    others = sum(len(found["accepted"]) + len(found["escaped"]) for found in mix["certificates"])
    return f"{tried - others} of {tried}" if others else f"{tried}"


def _keys(ax: Axes) -> tuple[list[Any], list[str]]:
    marks = [
        ax.scatter([], [], s=11, marker=marker, facecolors=color, edgecolors=BLACK, linewidths=0.3)
        for color, marker in _LOOKS.values()
    ]
    return marks, [_NAMES[name] for name in _LOOKS]


if __name__ == "__main__":
    main()
