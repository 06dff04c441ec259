"""Cells that five ways to bound a polynomial keep: on the last level, level by level, and against time.

Numbers by ranges' experiment.

Caption: Cells that five range bounds of a polynomial keep: on the last level, level by level, and against time.
Bernstein coefficients keep at most 3 % more cells than are certified to hold a point, and modified affine arithmetic 3
to 34 %. The power form keeps up to nine times as many.

Alt text: Four plots with one mark for each of five range bounds: cells kept for six surfaces, cells kept by level for
the Barth sextic, ranges per second, and time of voxelization.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

_KINDS = {
    "interval": ("interval, powers", GRAY, "v", ":"),
    "horner": ("interval, Horner", PURPLE, "^", (0, (1, 1))),
    "centered": ("centered", ORANGE, "D", "-."),
    "modified_affine": ("modified affine", VERMILLION, "s", "--"),
    "bernstein": ("Bernstein", BLUE, "o", "-"),
}
# Offsets of the kinds from each other along the axis.
_SHIFTS = dict(zip(_KINDS, (-0.24, -0.12, 0.0, 0.12, 0.24), strict=True))
# The surface whose levels are shown: the last one.
_SHOWN = -1


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 118 * MM), layout="constrained")
        ratio, levels, rate, cost = figure.subplots(2, 2).ravel()
        names = list(numbers["surfaces"])
        _draw_ratios(ratio, numbers, names)
        _draw_levels(levels, numbers, names[_SHOWN])
        _draw_rates(rate, numbers, names)
        _draw_cost(cost, numbers, names)
        handles, labels = levels.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=6, columnspacing=1.2, handlelength=2.4)
    return figure


def _style(kind: str) -> dict[str, Any]:
    label, color, marker, line = _KINDS[kind]
    return {"label": label, "color": color, "marker": marker, "linestyle": line, "markersize": 4.0}


def _draw_one(ax: Axes, kind: str, y: list[float]) -> None:
    ax.semilogy(np.arange(len(y)) + _SHIFTS[kind], y, **(_style(kind) | {"linestyle": "none"}))


def _certified(ways: dict[str, Any]) -> int:
    return max(way["certified"] for way in ways.values())


def _by_surface(ax: Axes, numbers: dict[str, Any], names: list[str]) -> None:
    degrees = numbers["degrees"]
    shown = [name.replace("tanglecube", "tangle-\ncube") for name in names]
    gaps = [" " if "-" in text else "\n" for text in shown]
    labels = [f"{text}{gap}({degrees[name]})" for text, gap, name in zip(shown, gaps, names, strict=True)]
    ax.set_xticks(range(len(names)), labels)
    ax.set_xlim(-0.4, len(names) - 0.6)
    ax.set_xlabel("surface (degree)")


def _draw_ratios(ax: Axes, numbers: dict[str, Any], names: list[str]) -> None:
    for kind in _KINDS:
        ways = [numbers["surfaces"][name] for name in names]
        y = [way[kind]["levels"][-1] / _certified(way) for way in ways]
        _draw_one(ax, kind, y)
    ax.axhline(1, color=BLACK, linewidth=0.8)
    ax.yaxis.set_major_locator(FixedLocator([1, 2, 4, 8]))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_yticklabels(["1", "2", "4", "8"])
    ax.set_ylabel("cells kept / certified")
    _by_surface(ax, numbers, names)
    letter(ax, "a", f"cells kept of {numbers['cells'][0]}$^3$")


def _draw_levels(ax: Axes, numbers: dict[str, Any], name: str) -> None:
    ways = numbers["surfaces"][name]
    for kind in _KINDS:
        counts = ways[kind]["levels"]
        ax.semilogy(range(len(counts)), counts, **_style(kind))
    last = len(ways["bernstein"]["levels"]) - 1
    ax.semilogy(range(last + 1), 8.0 ** np.arange(last + 1), color=BLACK, linewidth=0.8, label="all cells")
    ax.set_xlabel("level of the octree")
    ax.set_ylabel("cells kept")
    letter(ax, "b", f"level by level: {name}")


def _draw_rates(ax: Axes, numbers: dict[str, Any], names: list[str]) -> None:
    rates = {kind: [numbers["surfaces"][name][kind]["rate"] for name in names] for kind in _KINDS}
    for kind, y in rates.items():
        _draw_one(ax, kind, y)
    every = [y for row in rates.values() for y in row]
    ax.set_ylim(min(every) / 2, max(every) * 2)
    ax.set_ylabel("ranges per second")
    _by_surface(ax, numbers, names)
    letter(ax, "c", "speed of one range, one core")


def _draw_cost(ax: Axes, numbers: dict[str, Any], names: list[str]) -> None:
    for kind in _KINDS:
        ways = [numbers["surfaces"][name][kind] for name in names]
        _draw_one(ax, kind, [way["seconds"] for way in ways])
    ax.set_ylabel("time (s)")
    _by_surface(ax, numbers, names)
    letter(ax, "d", f"voxelization at {numbers['cells'][1]}$^3$, with certification")


if __name__ == "__main__":
    main()
