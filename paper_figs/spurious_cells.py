"""Cells that are kept but hold no point: their locations, and their effect on the published interval.

Numbers by spurious_cells' experiment.

Caption: Cells that are kept but hold no point: their location, and their effect on the published interval. The interval
misses the distance for every number of cells up to 256: for a distance of 2.5 it is too small by 0.87 and more, and for
0.1 too large by 1.5 and more. The safe rule and the branch and bound of jhd enclose both distances, and certify none
from an empty surface.

Alt text: Top, three square slices with cells along circles and a line, and hatched cells away from them. Bottom,
interval bars for five numbers of cells; the red bars of the published rule miss the dashed true distance.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

import jhd

_LINES = 241
_RULES = {"paper": ("published rule", VERMILLION, -0.16), "safe": ("safe rule", BLUE, 0.16)}
_TITLES = ("cells of $B$ without a point", "cells of $A$ without a point", "$A$ has no point")

# Text instead of a bar, if a method gives no number.
_NO_NUMBER = {
    "empty": "certified empty",
    "empty_surface": "certified empty",
    "existence_not_certified": "not certified",
}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 128 * MM), layout="constrained")
        axes: Any = figure.subplots(2, len(numbers["pairs"]), height_ratios=(1.15, 1.0))
        for k, pair in enumerate(numbers["pairs"]):
            _draw_cells(axes[0, k], pair, "abc"[k], _TITLES[k])
            _draw_intervals(axes[1, k], pair, numbers["cells"], "def"[k])
        axes[1, 0].set_ylabel("distance of $A$ from $B$")
        edge = {"edgecolor": BLACK, "linewidth": 0.4}
        keys = [
            Patch(facecolor=BLUE, alpha=0.55, label="cells of $A$, certified", **edge),
            Patch(facecolor=ORANGE, alpha=0.55, label="cells of $B$, certified", **edge),
            Patch(facecolor="white", hatch="//////", label="kept, not certified", edgecolor=VERMILLION, linewidth=0.8),
            Line2D([], [], color=VERMILLION, linewidth=4, label="published rule"),
            Line2D([], [], color=BLUE, linewidth=4, alpha=0.7, label="safe rule"),
            Line2D([], [], color=PURPLE, marker="*", linestyle="none", markersize=7, label="jhd (branch and bound)"),
            Line2D([], [], color=BLACK, linestyle=(0, (4, 2)), label="true distance"),
        ]
        figure.legend(handles=keys, loc="outside upper center", ncols=4, columnspacing=1.4)
    return figure


def _draw_cells(ax: Axes, pair: dict[str, Any], name: str, title: str) -> None:
    """Draw the kept cells of both surfaces in some layers, and the sections of the surfaces with the first plane."""
    low, high = np.inf, -np.inf
    for layers, color in zip(pair["slices"], (BLUE, ORANGE), strict=True):
        for layer in layers:
            steps, origin = np.array(layer["spacing"])[:2], np.array(layer["lower"])[:2]
            cells = np.reshape(layer["cells"], (-1, 2))
            squares = origin + steps * (cells[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]))
            certified = np.array(layer["certified"], bool)
            fill = {"facecolor": color, "alpha": 0.55, "edgecolor": BLACK, "linewidth": 0.2}
            ax.add_collection(PolyCollection(list(squares[certified]), **fill))
            doubt: dict[str, Any] = {"facecolor": "white", "edgecolor": VERMILLION, "linewidth": 0.8}
            ax.add_collection(PolyCollection(list(squares[~certified]), hatch="////////", **doubt))
            low, high = min(low, origin.min()), max(high, -origin.min())
    line = np.linspace(low, high, _LINES)
    x, y = np.meshgrid(line, line)
    points = np.stack([x, y, np.full_like(x, pair["planes"][0])], axis=-1)
    for text, dash in zip(pair["polynomials"], ("-", "--"), strict=True):
        values = np.asarray(jhd.ImplicitSurface.parse(text, [low] * 3, [high] * 3)(points))
        if values.min() < 0 < values.max():
            ax.contour(x, y, values, levels=[0.0], colors=BLACK, linewidths=0.8, linestyles=dash)
    ax.set(xlim=(low, high), ylim=(low, high), xlabel="$x$", ylabel="$y$")
    ax.set_xticks(np.linspace(low, high, 5))
    ax.set_yticks(np.linspace(low, high, 5))
    ax.set_aspect("equal")
    ax.spines[["top", "right"]].set_visible(True)
    planes = " and ".join(f"{plane:g}" for plane in pair["planes"])
    ax.text(0.5, 0.03, f"$z$ = {planes}", transform=ax.transAxes, ha="center")
    letter(ax, name, title)


def _draw_intervals(ax: Axes, pair: dict[str, Any], cells: list[int], name: str) -> None:
    """Draw intervals by both rules against the number of cells, up to the border if there is no upper end."""
    tops = [found["upper"] for rule in _RULES for found in pair[rule] if found["result"] not in _NO_NUMBER]
    top = 1.15 * max([x for x in tops if x is not None] + [pair["exact"] or 0.0])
    for rule, (_, color, shift) in _RULES.items():
        for k, found in enumerate(pair[rule]):
            if found["result"] in _NO_NUMBER:
                _write_upright(ax, k + 1.6 * shift, top, _NO_NUMBER[found["result"]], color)
                continue
            upper = top if found["upper"] is None else found["upper"]
            kind = {"color": color, "linewidth": 4, "alpha": 0.7 if rule == "safe" else 1.0}
            ax.plot([k + shift] * 2, [found["lower"], upper], solid_capstyle="butt", **kind)
            if upper == top:
                ax.plot([k + shift], [top], marker="^", color=color, markersize=6, clip_on=False)
    labels = [str(count) for count in cells]
    if pair["search"] is not None:
        labels.append("jhd")
        found = pair["search"]
        if found["result"] in _NO_NUMBER:
            _write_upright(ax, len(cells), top, _NO_NUMBER[found["result"]], PURPLE)
        else:
            ends = [found["lower"], found["upper"]]
            ax.plot([len(cells)] * 2, ends, color=PURPLE, linewidth=4, solid_capstyle="butt")
            ax.plot([len(cells)], [float(np.mean(ends))], marker="*", color=PURPLE, markersize=7, zorder=5)
    if pair["exact"] is not None:
        ax.axhline(pair["exact"], color=BLACK, linestyle=(0, (4, 2)), linewidth=0.9)
    else:
        ax.text(0.5, 0.97, "there is no distance", transform=ax.transAxes, ha="center", va="top", color=GRAY)
    ax.set_xticks(range(len(labels)), labels)
    ax.set(xlim=(-0.5, len(labels) - 0.5), ylim=(0, top), xlabel="cells along each axis")
    letter(ax, name)


def _write_upright(ax: Axes, x: float, top: float, text: str, color: str) -> None:
    ax.text(x, 0.03 * top, text, rotation=90, ha="center", va="bottom", color=color)


if __name__ == "__main__":
    main()
