"""Distances between all letters of two fonts, the nearest ones, and four pairs of outlines; numbers by fonts.

Caption: All 26 x 26 distances between the letters of DejaVu Sans and STIX General, certified to 1e-9 x-heights, and
four pairs of outlines. The nearest letter is certified to be the same for 45 of 52 letters and another one for 5
(filled marks); 2 are tied (open marks). Searches for the nearest letters compute less than a tenth of the distances
and compare less than a quarter with a bound.

Alt text: A 26 by 26 heat map of distances between letters, with a dark diagonal framed in white, and four pairs of
overlaid outlines (o, p, l with i, z with r) with their farthest points.
"""

from typing import Any

import numpy as np
from common import BLACK, MM, ORANGE, VERMILLION, Picture, bezier, letter, solution, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jhd import plot

_FONTS = {"DejaVu Sans": "DejaVu Sans", "STIXGeneral": "STIX General"}
_DASHED = (0, (4, 1.2))


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 108 * MM), layout="constrained")
        parts: Any = figure.subfigures(1, 2, width_ratios=(1.5, 1.0))
        left, right = parts
        _draw_matrix(left.add_subplot(), numbers)
        axes = right.subplots(2, 2, sharex=True, sharey=True)
        for k, (ax, pair) in enumerate(zip(axes.flat, numbers["pairs"], strict=False)):
            _draw_pair(ax, pair, numbers, "bcde"[k])
        for ax in axes.flat[len(numbers["pairs"]) :]:
            ax.remove()
        below: dict[str, Any] = {"loc": "outside lower center", "handletextpad": 0.6, "columnspacing": 1.2}
        left.legend(*left.axes[0].get_legend_handles_labels(), ncols=3, handlelength=1.0, **below)
        right.legend(*axes[0, 0].get_legend_handles_labels(), ncols=2, handlelength=2.2, **below)
    return figure


def _draw_matrix(ax: Axes, numbers: dict[str, Any]) -> None:
    matrix, letters = numbers["matrix"], list(numbers["letters"])
    image = ax.imshow(np.array(matrix["value"]), cmap="cividis", vmin=0, interpolation="nearest")
    for k in range(len(letters)):
        ax.add_patch(Rectangle((k - 0.5, k - 0.5), 1, 1, fill=False, edgecolor="white", linewidth=0.9))
    for name in ("rows", "columns"):
        _mark(ax, matrix["nearest"][name], letters, name)
    ax.set_xticks(range(len(letters)), letters)
    ax.set_yticks(range(len(letters)), letters)
    ax.tick_params(length=0, pad=2)
    ax.spines[:].set_visible(False)
    first, second = (_FONTS[font] for font in numbers["fonts"])
    ax.set(xlabel=f"letter of {second}", ylabel=f"letter of {first}")
    bar = ax.figure.colorbar(image, ax=ax, location="right", shrink=0.8, aspect=30, pad=0.02)
    bar.set_label(f"Hausdorff distance $d$ ({numbers['unit']}s)")
    bar.outline.set_linewidth(0.6)  # pyright: ignore[reportCallIssue]
    letter(ax, "a", "all pairs of letters; framed: the same letter")


def _mark(ax: Axes, entries: list[dict[str, Any]], letters: list[str], name: str) -> None:
    """Draw filled marks if another letter is the nearest, hollow marks at both letters if their bounds overlap."""
    # Both directions have room next to each other in one cell.
    marker, aside = (">", -0.22) if name == "rows" else ("v", 0.22)
    style: dict[str, Any] = {"marker": marker, "markersize": 3.6, "linestyle": "none", "markeredgewidth": 0.7}
    filled: dict[str, Any] = {"markerfacecolor": VERMILLION, "markeredgecolor": "white"}
    hollow: dict[str, Any] = {"markerfacecolor": "none", "markeredgecolor": "white"}
    line = name.removesuffix("s")
    for kind, words in ((filled, "nearest"), (hollow, "tied")):
        places = []
        for k, entry in enumerate(entries):
            if bool(entry["tied"]) == (kind is hollow) and (entry["tied"] or entry["nearest"] != letters[k]):
                places += [(k, letters.index(other)) for other in (entry["nearest"], *entry["tied"])]
        points = np.reshape(places, (-1, 2)) if name == "columns" else np.reshape(places, (-1, 2))[:, ::-1]
        if places:
            ax.plot(points[:, 0] + aside, points[:, 1], **style, **kind)
            shown = {**style, **kind, "markeredgecolor": BLACK, "markersize": 4.5}
            ax.plot([], [], **shown, label=f"{words} in {line}")


def _draw_pair(ax: Axes, pair: dict[str, Any], numbers: dict[str, Any], name: str) -> None:
    first, second = (_FONTS[font] for font in numbers["fonts"])
    plot.curve(bezier(pair["a"]), ax, label=first, control_polygon=False)
    plot.curve(bezier(pair["b"]), ax, color=ORANGE, linestyle=_DASHED, label=second, control_polygon=False)
    plot.witness(solution(pair["solution"]), ax, distance=False, empty_circle=False)
    # The distance stands above each panel, not in the common legend.
    ax.lines[-1].set_label("_")
    ax.set_axis_off()
    same = pair["letters"][0] == pair["letters"][1]
    words = f"{pair['kind']}: {pair['letters'][0]}" if same else " and ".join(pair["letters"])
    letter(ax, name, f"{words}\n$d$ = {pair['solution']['value']:.4f}")


if __name__ == "__main__":
    main()
