"""Errors of curve conversions over their tolerance, and one curve that Agg draws too long; numbers by flattening_check.

Caption: Errors of the curve conversions of matplotlib's Agg and of fontTools as a fraction of their tolerance, the
fraction of curves that exceed Agg's half pixel, and one curve that Agg draws 25 pixels too long. fontTools keeps its
tolerance on every input. On thin curves and hairpins Agg errs by up to 46 % of their size. All answers are certified.

Alt text: Four panels: cumulative curves of error over tolerance with a gray region for violations, horizontal bars of
violations for each kind of curve, and two pixel strips of a hairpin, the upper one drawn too long.
"""

from typing import Any

import numpy as np
from common import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    MM,
    ORANGE,
    PURPLE,
    VERMILLION,
    Picture,
    bezier,
    letter,
    solution,
    style,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jhd import plot

_LINES: dict[str, dict[str, Any]] = {
    "Agg, cubics": {"color": VERMILLION, "linestyle": "-", "marker": "o"},
    "Agg, quadratics": {"color": ORANGE, "linestyle": (0, (4, 1.2)), "marker": "D"},
    "cu2qu": {"color": BLUE, "linestyle": (0, (6, 1, 1, 1)), "marker": "s"},
    "qu2cu": {"color": GREEN, "linestyle": (0, (1, 1)), "marker": "^"},
}
# Color and hatch of each size in pixels.
_BARS = ((PURPLE, "...."), (ORANGE, ""), (GREEN, "////"))
_LEAST = 1e-3


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 118 * MM), layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.45, 1.0))
        top, bottom = parts
        used, shares = top.subplots(1, 2, width_ratios=(1.15, 1.0))
        _draw_used(used, numbers["entries"])
        _draw_shares(shares, numbers["entries"])
        strips = bottom.subplots(2, 1, sharex=True, sharey=True)
        _draw_strips(strips, numbers)
    return figure


def _draw_used(ax: Axes, entries: list[dict[str, Any]]) -> None:
    """Plot empirical distributions over all kinds of curves, sizes and tolerances."""
    for name, line in _LINES.items():
        ratios = [np.array(e["upper"], dtype=float) / e["tolerance"] for e in entries if e["name"] == name]
        used = np.sort(np.concatenate(ratios))
        share = 100 * np.arange(1, len(used) + 1) / len(used)
        marks = {"markevery": max(1, len(used) // 7), "markersize": 4, "markeredgecolor": BLACK, "markeredgewidth": 0.5}
        ax.plot(np.maximum(used, _LEAST / 2), share, label=f"{name} ({len(used)})", **line, **marks)
    ax.axvspan(1, 1e4, color=GRAY, alpha=0.15, linewidth=0)
    ax.axvline(1, color=BLACK, linewidth=0.8)
    ax.annotate("tolerance broken", (1, 50), (4, 0), textcoords="offset points", va="center")
    largest = max(max(e["upper"]) / e["tolerance"] for e in entries)
    ax.set(xscale="log", xlim=(_LEAST, 20 * largest), ylim=(0, 101))
    ax.set(xlabel="certified distance / tolerance", ylabel="curves within this distance (%)")
    ax.legend(loc="lower right", borderaxespad=0.1, handlelength=2.6)
    letter(ax, "a", "tolerance used, all curves")


def _draw_shares(ax: Axes, entries: list[dict[str, Any]]) -> None:
    """Plot the fractions of curves for which the error of Agg is certified to exceed half a pixel."""
    mine = [e for e in entries if e["name"].startswith("Agg")]
    rows = list(dict.fromkeys((e["name"].split(", ")[1], e["family"]) for e in mine))
    sizes = sorted({e["size"] for e in mine})
    height = 0.8 / len(sizes)
    for k, (size, (color, hatch)) in enumerate(zip(sizes, _BARS, strict=False)):
        found = {(e["name"].split(", ")[1], e["family"]): e for e in mine if e["size"] == size}
        shares = [100 * found[row]["answers"]["no"] / found[row]["count"] for row in rows]
        place = np.arange(len(rows)) + (k - (len(sizes) - 1) / 2) * height
        kind: dict[str, Any] = {"color": color, "hatch": hatch, "edgecolor": BLACK, "linewidth": 0.5}
        ax.barh(place, shares, height, label=f"{size:g} pixels", **kind)
    for k, row in enumerate(rows):
        if not any(e["answers"]["no"] for e in mine if row == (e["name"].split(", ")[1], e["family"])):
            ax.annotate("none", (0, k), (3, 0), textcoords="offset points", va="center")
    split = [row[0] for row in rows].index("quadratics") - 0.5
    ax.axhline(split, color=GRAY, linewidth=0.6, linestyle=":")
    for first, last, words in ((-0.5, split, "cubics"), (split, len(rows) - 0.5, "quadratics")):
        ax.annotate(words, (103, (first + last) / 2), rotation=90, va="center", annotation_clip=False)
    ax.set_yticks(range(len(rows)), [family for _, family in rows])
    ax.invert_yaxis()
    ax.tick_params(axis="y", length=0)
    ax.set(xlim=(0, 102), xlabel="curves farther than half a pixel (%)")
    ax.legend(loc="upper right", borderaxespad=0.1, handlelength=1.4, title="size of the curve")
    letter(ax, "b", "Agg's flattening, certified violations")


def _draw_strips(axes: Any, numbers: dict[str, Any]) -> None:
    """Draw the pixels of one hairpin, by Agg as a curve and as many chords, at one scale."""
    drawn, worst = numbers["drawn"], numbers["specimens"][0]
    (width, height), (x, y) = drawn["canvas"], drawn["origin"]
    titles = "a hairpin, drawn by Agg from its control points", "the hairpin along 1000 chords, drawn by Agg"
    for ax, name, title, key in zip(axes, "cd", titles, ("curve", "chords"), strict=True):
        box = (-x, width - x, -y, height - y)
        ax.imshow(np.array(drawn[key]), cmap="gray", vmin=-300, vmax=255, extent=box, interpolation="nearest")
        plot.curve(bezier(worst["a"]), ax, color=BLUE, control_polygon=False, samples=200)
        ax.lines[0].set_linewidth(0.7)
        if key == "curve":
            plot.witness(solution(worst["solution"]), ax, distance=False, empty_circle=False)
            ax.lines[-1].set_label("$d$ = " + f"{worst['solution']['value']:.2f} pixels")
        ax.set(xlabel="", ylabel="$y$ (pixels)", yticks=[-4, 0, 4])
        letter(ax, name, title)
    axes[0].lines[0].set_label("exact curve")
    axes[1].set_xlabel("$x$ (pixels)")
    places: dict[str, Any] = {"loc": "outside lower center", "ncols": 4, "handlelength": 2.0, "columnspacing": 1.4}
    axes[0].figure.legend(*axes[0].get_legend_handles_labels(), **places)


if __name__ == "__main__":
    main()
