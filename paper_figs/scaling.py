"""Time, cells, memory and compilation against the number of segments; numbers by scaling's experiment.

Times are of the noisy pairs; they jump when the next larger compiled function is used. The start alone is a plain call.

Caption: Time, cells, memory and compile time for 1 to 2000 segments, with the search inside the compiled function
(`jhd.inline_searches`). Lines join sizes that functions are compiled for; open marks are sizes that are padded to
the next one. 2000 x 2000 segments are certified to 1e-10 of the diagonal in less than a tenth of a second in each
direction, with fewer than n + 64 cells for n segments and less than 1 GB of memory. Above 384 segments the search runs
in blocks, whose tables are smaller. Tracing and compiling take 8 to 40 s.

Alt text: Four panels against the number of segments on a logarithmic axis: times of five calls, numbers of cells, and
memory as lines with filled and open marks, and stacked bars of tracing and compile time.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

_MARK: dict[str, Any] = {"markersize": 3.4, "markeredgecolor": BLACK, "markeredgewidth": 0.4}
_DASHED = (0, (4, 1.2))
_TIMES: dict[str, dict[str, Any]] = {
    "both, plain": {"color": BLUE, "marker": "s", "linestyle": _DASHED, "label": "both directions, plain call"},
    "both, compiled": {"color": BLUE, "marker": "o", "label": "both directions, compiled function"},
    "directed, compiled": {"color": VERMILLION, "marker": "^", "label": "one direction, compiled function"},
    "start": {
        "color": BLACK,
        "marker": "x",
        "linestyle": (0, (1, 1)),
        "label": "start alone, one direction",
    },
    "k-d tree": {"color": ORANGE, "marker": "D", "linestyle": (0, (1, 1)), "label": "k-d tree, one direction"},
}
_CELLS: dict[tuple[str, str], dict[str, Any]] = {
    ("noisy", "cells, both"): {"color": BLUE, "marker": "o", "label": "noisy, both directions"},
    ("noisy", "cells"): {"color": VERMILLION, "marker": "^", "label": "noisy, one direction"},
    ("refined", "cells, both"): {
        "color": GREEN,
        "marker": "v",
        "linestyle": _DASHED,
        "label": "refined, both directions",
    },
}
_MEMORY: dict[str, dict[str, Any]] = {
    "both, peak": {"color": BLUE, "marker": "o", "label": "peak of the process, both directions"},
    "both, reserved": {
        "color": PURPLE,
        "marker": "v",
        "linestyle": _DASHED,
        "label": "reserved by XLA, both directions",
    },
    "directed, reserved": {
        "color": VERMILLION,
        "marker": "^",
        "linestyle": _DASHED,
        "label": "reserved by XLA, one direction",
    },
}
_SLOPE: dict[str, Any] = {"color": GRAY, "linewidth": 0.7, "linestyle": (0, (3, 1.5))}
_LEGEND: dict[str, Any] = {"handlelength": 2.0, "labelspacing": 0.3, "handletextpad": 0.5, "borderaxespad": 0.1}
_MB = 1e6


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    """Return a figure with four panels over one axis."""
    with style():
        figure = Figure(figsize=(175 * MM, 128 * MM), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True)
        _draw_times(axes[0, 0], numbers["kinds"]["noisy"])
        _draw_cells(axes[0, 1], numbers["kinds"])
        _draw_memory(axes[1, 0], numbers["programs"])
        _draw_compilation(axes[1, 1], numbers["programs"], numbers["cold"])
        axes[0, 0].set_xlim(0.75, 4500)
        axes[0, 0].xaxis.set_major_locator(FixedLocator([1, 10, 100, 1000]))
        axes[0, 0].xaxis.set_minor_locator(NullLocator())
        for ax in axes[1]:
            ax.set_xlabel("segments of either curve")
    return figure


def _draw_times(ax: Axes, entries: list[dict[str, Any]]) -> None:
    for name, line in _TIMES.items():
        _by_size(ax, entries, [entry[name] for entry in entries], line, padded=name != "k-d tree")
    ax.set_ylim(2e-5, 2)
    ax.set_ylabel("time (s)")
    ax.legend(loc="upper left", **_LEGEND)
    letter(ax, "a", "warm time, noisy pairs")


def _by_size(
    ax: Axes, entries: list[dict[str, Any]], values: list[float], line: dict[str, Any], padded: bool = True
) -> None:
    """Plot a line through the sizes that functions are compiled for, and open marks off the line for padded sizes."""
    exact = np.array([not padded or entry["segments"] == entry["padded"] for entry in entries])
    count, y = np.array([entry["segments"] for entry in entries]), np.array(values)
    ax.loglog(count[exact], y[exact], **_MARK, **line)
    mark = {**_MARK, "markeredgecolor": line["color"], "markeredgewidth": 0.7, "markerfacecolor": "none"}
    ax.loglog(count[~exact], y[~exact], marker=line["marker"], linestyle="none", **mark)


def _draw_cells(ax: Axes, kinds: dict[str, Any]) -> None:
    for (kind, key), line in _CELLS.items():
        _by_size(ax, kinds[kind], [entry[key] for entry in kinds[kind]], line)
    ax.set_ylabel("cells bounded")
    ax.set_ylim(2, 3000)
    ax.legend(loc="upper left", **_LEGEND)
    letter(ax, "b", "cells until $10^{-10}$ of the diagonal is certified")


def _draw_memory(ax: Axes, entries: list[dict[str, Any]]) -> None:
    for name, line in _MEMORY.items():
        known = [entry for entry in entries if entry[name] is not None]
        ax.loglog([e["padded"] for e in known], [e[name] / _MB for e in known], **_MARK, **line)
    ax.set_ylim(0.04, 1e3)
    ax.set_ylabel("memory (MB)")
    # Between the process, above, and the tables, below.
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, 0.82), **_LEGEND)
    letter(ax, "c", "memory, by size compiled for")


def _draw_compilation(ax: Axes, entries: list[dict[str, Any]], cold: bool) -> None:
    count, width = np.array([entry["padded"] for entry in entries]), 1.3
    trace, compiled = (np.array([entry[key] for entry in entries]) for key in ("trace", "compile"))
    bars: dict[str, Any] = {"width": count * (width - 1 / width), "edgecolor": BLACK, "linewidth": 0.4}
    ax.bar(count, trace, color=ORANGE, hatch="////", label="tracing", **bars)
    ax.bar(count, compiled, bottom=trace, color=BLUE, label="compiling" if cold else "loading", **bars)
    ax.set_ylim(0, 1.35 * np.max(trace + compiled))
    ax.set_ylabel("time (s)")
    ax.legend(loc="upper left", ncols=2, **_LEGEND)
    letter(ax, "d", "first call, one direction, by size compiled for")


if __name__ == "__main__":
    main()
