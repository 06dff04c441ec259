"""Fraction of the distances that a search for nearest letters computes; numbers by collection_search.

The dotted line is the time of all distances, estimated from a few queries.

Caption: Fraction of the distances that a search for the nearest letters computes, its time, and some letters with their
nearest ones; the dotted line shows the estimated time for all distances. The nearest of 2000 letters takes at most
0.3 % of the distances, the five nearest less than 1 %.

Alt text: Two small log-log plots against the number of letters, for the distances computed and for the time, and a
table of the letters g, R and the ampersand, each overlaid with its four nearest letters.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, VERMILLION, Picture, bezier, grouped_ticks, letter, style
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

import jhd
from jhd._results.solution import RESULTS

_LOOKS: dict[int, dict[str, Any]] = {
    1: {"color": BLUE, "marker": "o", "label": "nearest"},
    5: {"color": VERMILLION, "marker": "s", "linestyle": (0, (4, 1.2)), "label": "five nearest"},
}
_MARK: dict[str, Any] = {"markersize": 4.0, "markeredgecolor": BLACK, "markeredgewidth": 0.4}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 88 * MM), layout="constrained")
        parts: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.45))
        _draw_work(parts[0], numbers)
        _draw_letters(parts[1], numbers)
    return figure


def _draw_work(part: Any, numbers: dict[str, Any]) -> None:
    """Plot fractions and CPU seconds against the number of shapes."""
    above, below = part.subplots(2, 1, sharex=True)
    for k, looks in _LOOKS.items():
        entries = [entry for entry in numbers["searches"] if entry["k"] == k]
        sizes = [entry["shapes"] for entry in entries]
        above.loglog(sizes, [100 * entry["share"] for entry in entries], **looks, **_MARK)
        below.loglog(sizes, [entry["spent"]["cpu"] for entry in entries], **looks, **_MARK)
    sizes = np.array(sorted({entry["shapes"] for entry in numbers["searches"]}))
    every = numbers["cpu_a_pair"] * numbers["queries"] * sizes
    below.loglog(sizes, every, color=GRAY, linestyle=(0, (1, 1)), linewidth=1.4, label="all distances (estimated)")
    letter(above, "a", f"fraction computed, {numbers['queries']} letters")
    letter(below, "b", "time, once compiled")
    above.set_ylabel("distances (%)")
    below.set(ylabel="CPU time (s)", xlabel=f"letters of {numbers['fonts'][1]} to choose from")
    below.set_xticks(sizes, [f"{size}" for size in sizes])
    for ax in (above, below):
        ax.minorticks_off()
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 3)))
        ax.yaxis.set_major_formatter(grouped_ticks())
    part.legend(*below.get_legend_handles_labels(), loc="outside lower center", ncols=1, handlelength=2.6)


def _draw_letters(part: Any, numbers: dict[str, Any]) -> None:
    """Draw letters with their nearest ones, from the stored outlines."""
    shown = numbers["shown"]
    value, lower, upper = (np.array(shown[key], dtype=float) for key in ("value", "lower", "upper"))
    count, k = value.shape
    shapes = [bezier(points) for row in shown["shapes"] for points in row]
    ties = tuple(np.zeros(ties, int) for ties in shown["ties"])
    index = np.arange(count * k).reshape(count, k)
    found = jhd.Neighbors(index, value, lower, upper, RESULTS.successful, ties, 0)
    axes = part.subplots(count, 1 + k, squeeze=False)
    queries = [bezier(points) for points in shown["queries"]]
    names = [name for row in shown["neighbors"] for name in row]
    jhd.plot.neighbors(queries, shapes, found, axes, query_names=shown["letters"], names=names)
    words = f"{numbers['fonts'][0]} (solid), nearest of {numbers['fonts'][1]} (dashed), $d$ in em"
    part.suptitle(f"$\\bf{{(c)}}$ {words}", x=0.02, ha="left", fontsize=8)


if __name__ == "__main__":
    main()
