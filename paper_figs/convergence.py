"""Gaps of four upper bounds against the width of the cell, and against the cells of a search.

Numbers by convergence's experiment; the second figure is convergence_cells (.png, .pdf).

Caption: Gaps of four upper bounds of the distance over a cell against its width, at an antipodal maximum, at a
one-to-two maximum and on coincident curves, with fitted slopes (numbers) and theoretical slopes (dashed); second
picture: against the number of cells of a search. At both maxima the bound of jhd has order 8 and needs 3 cells for
1e-10 of the diagonal; the other three bounds need at least 27.

Alt text: Four log-log panels of gaps against cell width. Straight lines have their fitted slopes written next to them
and dashed slopes of theory; dots mark the level of rounding.

Alt text of cells: Four log-log panels of gaps against the number of cells bounded. At both maxima the line of jhd drops
below the dotted default tolerance first.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

_TITLES = {
    "antipodal": "antipodal maximum",
    "one_to_two": "one-to-two maximum",
    "coincident_line": "a line as two cubics; jhd: cubic map",
    "coincident_circle": "a circle, other weights; jhd: Möbius map",
}
_SERIES: dict[str, dict[str, Any]] = {
    "Lipschitz": {"color": GRAY, "marker": "s", "label": "Lipschitz"},
    "one branch": {"color": ORANGE, "marker": "D", "label": "one branch, cubic map"},
    # Larger and open, so that it is seen if it equals the bound before.
    "lambda": {"color": BLUE, "marker": "o", "markersize": 5.5, "markerfacecolor": "none", "label": "two branches, λ"},
    "affine map": {"color": GREEN, "marker": "^", "label": "affine map"},
    "Moebius map": {"color": PURPLE, "marker": "v", "label": "Möbius map"},
    "ours": {"color": VERMILLION, "marker": "o", "label": "jhd"},
}
# Series of bounds that the numbers call by another name.
_SAME = {"ours, affine map": "affine map", "cubic map": "one branch"}
_HALVED: dict[str, Any] = {"color": BLACK, "marker": "x", "markeredgewidth": 0.9, "label": "jhd, cells halved"}
_MARK: dict[str, Any] = {"markersize": 3.2, "markeredgecolor": BLACK, "markeredgewidth": 0.3}
_DASHES: dict[str, Any] = {"color": BLACK, "linewidth": 0.7, "linestyle": (0, (3, 1.5)), "zorder": 5}
_DOTS: dict[str, Any] = {"color": BLACK, "linewidth": 0.6, "linestyle": (0, (1, 1.5))}
_ROUNDING: dict[str, Any] = {"color": VERMILLION, "marker": ".", "markersize": 2.5, "linestyle": "none"}
_LEGEND: dict[str, Any] = {"handlelength": 1.6, "labelspacing": 0.25, "columnspacing": 1.5}
_LABELS = [
    *(line["label"] for line in _SERIES.values()),
    _HALVED["label"],
    "slope by theory",
    "allowance for rounding",
    "default tolerance",
]
# Slopes stand to the left of their lines; to the right if another line is on the left.
_RIGHT = {
    *((pair, family) for pair in ("antipodal", "one_to_two") for family in ("ours, affine map", "ours")),
    ("one_to_two", "one branch"),
    ("coincident_line", "ours"),
    ("coincident_circle", "ours"),
}


def main() -> None:
    """Draw and save the figures."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers, _draw_local, "cell width $h$ (part of the segment)"))
    picture.save(_figure(picture.numbers, _draw_cells, "cells bounded"), "_cells")


def _figure(numbers: dict[str, Any], draw: Callable[[Axes, dict[str, Any], str], None], label: str) -> Figure:
    """Return a figure with one panel for each pair, and one legend."""
    with style():
        figure = Figure(figsize=(175 * MM, 128 * MM), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, sharey=True)
        for ax, (name, title), number in zip(axes.flat, _TITLES.items(), "abcd", strict=True):
            draw(ax, numbers, name)
            letter(ax, number, title)
            ax.set_yticks(10.0 ** np.arange(-15, 1, 3))
            ax.minorticks_off()
        for ax in axes[-1]:
            ax.set_xlabel(label)
        for ax in axes[:, 0]:
            ax.set_ylabel("gap (in diagonals of the box)")
        # Lines of one kind in two panels have one entry.
        lines = [line for ax in axes.flat for line in ax.lines if not line.get_label().startswith("_")]
        handles = {line.get_label(): line for line in lines}
        order = sorted(handles, key=_LABELS.index)
        figure.legend(handles=[handles[key] for key in order], loc="outside lower center", ncols=4, **_LEGEND)
    return figure


def _line(family: str) -> dict[str, Any]:
    """Return color, marker and label of one upper bound."""
    line = {**_MARK, **(_HALVED if family == "ours, halved" else _SERIES[_SAME.get(family, family)])}
    return {**line, "markeredgecolor": line["color"]} if line.get("markerfacecolor") == "none" else line


def _draw_local(ax: Axes, numbers: dict[str, Any], pair: str) -> None:
    """Plot gaps and fitted slopes with lines of the theoretical slope; points at the floor of rounding are small."""
    width, families = np.array(numbers["width"]), numbers["local"][pair]
    floor = families["ours"]["floor"]
    for family, entry in families.items():
        gap, line = np.array(entry["gap"]), _line(family)
        # A line ends when it meets the floor.
        above = gap > (3 * floor if family == "ours" else floor)
        last = len(gap) if above.all() else int(np.argmin(above))
        ax.loglog(width[:last], gap[:last], **line)
        if family == "ours":
            ax.loglog(width[last:], gap[last:], **_ROUNDING)
        if (pair, family) != ("antipodal", "lambda"):
            _draw_slope(ax, width, entry, line["color"], (pair, family) in _RIGHT)
    ax.plot([], [], label="slope by theory", **_DASHES)
    ax.plot([], [], label="allowance for rounding", **_ROUNDING)
    ax.set_ylim(1e-16, 3)


def _draw_slope(ax: Axes, width: np.ndarray, entry: dict[str, Any], color: str, right: bool) -> None:
    """Write the slope, and draw a line of the theoretical order through the middle of the fitted points."""
    fitted = np.array(entry["fitted"], dtype=int)
    place = tuple(np.exp(np.mean(np.log(x[fitted]))) for x in (width, np.array(entry["gap"])))
    text = "exact" if entry["order"] is None else "" if entry["slope"] is None else f"{entry['slope']:.2f}"
    if entry["order"] is not None and text:
        ends = width[fitted[[0, -1]]] * np.array([1.35, 1 / 1.35])
        ax.loglog(ends, place[1] * (ends / place[0]) ** entry["order"], **_DASHES)
    offset, ha, va = ((4, -5), "left", "top") if right else ((-4, 4), "right", "bottom")
    note = ax.annotate(text, place, offset, textcoords="offset points", color=color, ha=ha, va=va, zorder=6)
    note.set_path_effects([withStroke(linewidth=1.5, foreground="white")])


def _draw_cells(ax: Axes, numbers: dict[str, Any], pair: str) -> None:
    """Plot the largest bound left in each search."""
    for family, entry in numbers["cells"][pair].items():
        count, gap = np.array(entry["count"]), np.array(entry["gap"])
        ax.loglog(count, np.maximum(gap, 1e-16), markevery=_spread(count), **_line(family))
    ax.axhline(numbers["goal"], label="default tolerance", **_DOTS)
    ax.set_ylim(1e-15, 3)


def _spread(count: np.ndarray) -> list[int]:
    """Return indices of the first, the last and some entries between, about evenly apart on a logarithmic axis."""
    steps = np.unique(np.round(np.log2(count) * 3).astype(int), return_index=True)[1]
    return sorted({*map(int, steps), len(count) - 1})


if __name__ == "__main__":
    main()
