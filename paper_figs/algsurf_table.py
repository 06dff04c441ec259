"""The paper's two cones: width against time of cells and of the search, their intervals, cells kept, pairs per second.

Numbers by algsurf_table's experiment.

Caption: The two cones of the paper: width of the interval against time, the intervals, cells kept on each level, and
pairs per second. The printed interval [sqrt(17/32), sqrt(103/128)] belongs to 64 cells along the box, whose edge is
1/16. The printed tolerance of 1/64 is the edge of 256 cells. The branch and bound of jhd certifies (sqrt(43) - 4) / 3
to eleven digits in less than a second.

Alt text: Four panels: interval width against time, where jhd drops below 1e-11 within a second; vertical interval bars
that shrink around the exact distance; excess cells by level; and three bars of pairs of cells per second.
"""

from fractions import Fraction
from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, power_text, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

_RULES = {"paper": ("published rule", VERMILLION, "s", "--"), "safe": ("safe rule", BLUE, "^", "-.")}
_RANGES = {
    "centered": ("centered", ORANGE, "D", "-."),
    "modified_affine": ("modified affine", VERMILLION, "s", "--"),
    "interval": ("interval", GRAY, "v", ":"),
    "bernstein": ("Bernstein", BLUE, "o", "-"),
}
# If a search ends within rounding of the distance, a logarithmic axis cannot show its half width.
_NARROWEST = 1e-14
_PRINTED = r"printed, $\epsilon = 1/64$"


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 128 * MM), layout="constrained")
        width, interval, kept, rate = figure.subplots(2, 2).ravel()
        _draw_widths(width, numbers)
        _draw_intervals(interval, numbers)
        _draw_kept(kept, numbers["levels"])
        _draw_rates(rate, numbers)
    return figure


def _by_rule(numbers: dict[str, Any], rule: str) -> list[dict[str, Any]]:
    return [found for found in numbers["rules"] if found["rule"] == rule]


def _draw_widths(ax: Axes, numbers: dict[str, Any]) -> None:
    for rule, (label, color, marker, line) in _RULES.items():
        found = _by_rule(numbers, rule)
        half = [(x["upper"] - x["lower"]) / 2 for x in found]
        look = {"color": color, "marker": marker, "linestyle": line, "markersize": 4, "label": label}
        ax.loglog([x["separable"] for x in found], half, **look)
    search = numbers["search"]
    if search:
        half = [max((x["upper"] - x["lower"]) / 2, _NARROWEST) for x in search]
        look = {"color": GREEN, "marker": "o", "markersize": 4, "label": "jhd (branch and bound)"}
        ax.loglog([x["seconds"] for x in search], half, **look)
    paper = numbers["paper"]
    ax.loglog([paper["seconds"]], [paper["half"]], color=BLACK, marker="*", markersize=9, linestyle="none")
    point = (paper["seconds"], paper["half"])
    ax.annotate("paper,\n9 days", point, (0, -7), textcoords="offset points", ha="center", va="top")
    ax.set_xlim(right=1e7)
    ax.set_ylim(bottom=min(half) / 10, top=10)
    ax.yaxis.set_major_locator(LogLocator(numticks=9))
    ax.set(xlabel="time (s)", ylabel="half width of the interval")
    ax.legend(loc="center right", borderaxespad=0.1)
    letter(ax, "a", "width against time, one core")


def _draw_intervals(ax: Axes, numbers: dict[str, Any]) -> None:
    cells = [found["cells"] for found in _by_rule(numbers, "paper")]
    for (rule, (label, color, _, _)), shift in zip(_RULES.items(), (-0.14, 0.14), strict=True):
        for k, found in enumerate(_by_rule(numbers, rule)):
            name = None if k else label
            ends = [found["lower"], found["upper"]]
            ax.plot([k + shift] * 2, ends, color=color, linewidth=4.5, solid_capstyle="butt", label=name)
    if numbers["paper"]["cells"] in cells:
        k = cells.index(numbers["paper"]["cells"]) - 0.14
        middle, half = numbers["paper"]["middle"], numbers["paper"]["half"]
        bar = {"color": BLACK, "capsize": 4, "linewidth": 0.9, "marker": "_", "markersize": 7, "label": _PRINTED}
        ax.errorbar([k], [middle], [half], **bar)
    ax.axhline(numbers["exact"], color=BLACK, linestyle=(0, (4, 2)), linewidth=0.9, label=r"$(\sqrt{43}-4)/3$")
    edges = [f"{count}\n{Fraction(4, count)}" for count in cells]
    ax.set_xticks(range(len(cells)), edges)
    ax.set(
        xlim=(-0.5, len(cells) - 0.5),
        xlabel="cells along each axis, and their edge",
        ylabel="distance $H$ (input units)",
    )
    ax.legend(loc="upper right", borderaxespad=0.1)
    letter(ax, "b", "intervals of cells")


def _draw_kept(ax: Axes, levels: dict[str, Any]) -> None:
    """Plot how many more cells each range keeps than Bernstein coefficients, both surfaces together."""
    best = np.sum(levels["bernstein"], axis=0)[1:]
    for kind, (label, color, marker, line) in _RANGES.items():
        above = 100 * (np.sum(levels[kind], axis=0)[1:] / best - 1)
        look = {"color": color, "marker": marker, "linestyle": line, "markersize": 7 if kind == "interval" else 4}
        ax.plot(np.arange(1, len(best) + 1), above, label=label, **look)
    ax.set(xlabel="level of the octree", ylabel="cells kept beyond Bernstein (%)")
    ax.set_xticks(np.arange(1, len(best) + 1))
    ax.legend(loc="upper right", borderaxespad=0.1)
    letter(ax, "c", "both cones, five ranges (Horner as interval)")


def _draw_rates(ax: Axes, numbers: dict[str, Any]) -> None:
    """Plot pairs of cells per second of the published rule, and the paper's if its number of cells was run."""
    found = _by_rule(numbers, "paper")
    same = [x for x in found if x["cells"] == numbers["paper"]["cells"]]
    shown = same or found[-1:]
    pairs = shown[0]["pairs"]
    bars = [("paper", pairs / numbers["paper"]["seconds"], GRAY, "")] if same else []
    for way, name, color, hatch in (("tiles", "in tiles", ORANGE, "////"), ("separable", "separable", PURPLE, "....")):
        bars.append((name, pairs / max(shown[0][way], 1e-9), color, hatch))
    for k, (_, height, color, hatch) in enumerate(bars):
        ax.bar(k, height, 0.6, color=color, hatch=hatch, edgecolor=BLACK, linewidth=0.6)
        ax.annotate(_power(height), (k, height), (0, 2), textcoords="offset points", ha="center")
    ax.set_yscale("log")
    ax.set_ylim(1, 1e12)
    ax.set_xticks(range(len(bars)), [bar[0] for bar in bars])
    ax.set_ylabel("pairs of cells per second")
    letter(ax, "d", f"{_power(pairs)} pairs, finding the cells included")


def _power(x: float) -> str:
    return power_text(x, 1) if x >= 1e4 else f"{x:.0f}"


if __name__ == "__main__":
    main()
