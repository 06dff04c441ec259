"""Outlines before and after fitting by few cubics, numbers stored, and the progress of fits with 60 parameters.

Numbers by outline_fit's experiment.

Caption: A letter before and after fitting by few cubics, the numbers stored for six letters and the tolerance used by
three methods, and the progress of two fits with 60 parameters. Every fit is certified to keep its tolerance. The
minimax fits need 56 and 62 segments for tolerances of 0.004 and 0.002 em, the longest least-squares pieces 66 and 77.

Alt text: Six panels: the letter S with 30 and with 10 segments and their handles, bars of the numbers stored, marks of
the tolerance used, and two plots of falling distance against time for compiled and uncompiled runs.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, bezier, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

_METHODS = {
    "fit_outline": ("jhd (minimax)", GREEN, "", "o"),
    "longest": ("least squares, longest pieces", ORANGE, "////", "s"),
    "split": ("least squares, split", PURPLE, "....", "^"),
}
_RUNS = {"cold": ("nothing compiled", VERMILLION, "--", "s"), "warm": ("compiled", BLUE, "-", "o")}
# Index of the letter that is shown.
_SHOWN = 0
# Percent above the least distance; values below this one are drawn at it.
_FLOOR = 1e-5
_HALO = [withStroke(linewidth=2.0, foreground="white")]
_MILLI = 1e3


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 132 * MM), layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.05, 1.0))
        before, after, bars = parts[0].subplots(1, 3, width_ratios=(0.8, 0.8, 1.5))
        glyph = numbers["glyphs"][_SHOWN]
        fits = [fit for fit in glyph["fits"] if fit["method"] == "fit_outline"]
        fit = fits[min(1, len(fits) - 1)]
        shown = np.concatenate([np.reshape(x["control_points"], (-1, 2)) for x in (glyph, fit)])
        limits = np.transpose([shown.min(axis=0) - 0.02, shown.max(axis=0) + 0.02])
        _draw_outline(before, glyph["control_points"], limits, f"{glyph['stored'][0]} segments", "a", "stored outline")
        within = f"{fit['segments']} cubics within {fit['tolerance']:g} em"
        _draw_outline(after, fit["control_points"], limits, within, "b", "fitted")
        _draw_bars(bars, numbers["glyphs"])
        used, *convergence = parts[1].subplots(
            1, 1 + len(numbers["cases"]), width_ratios=[1.0] + [1.1] * len(numbers["cases"])
        )
        _draw_used(used, numbers["glyphs"])
        for ax, name, case in zip(convergence, "ef", numbers["cases"], strict=False):
            _draw_convergence(ax, name, case)
    return figure


def _draw_outline(ax: Axes, control_points: Any, limits: Any, text: str, name: str, title: str) -> None:
    """Draw the outline with its nodes and handles."""
    points = np.asarray(control_points)
    t = np.linspace(0, 1, 40)
    for segment in points:
        ax.plot(*np.asarray(bezier([segment])(t)).T, color=BLACK)
        for handle in (segment[:2], segment[-2:]):
            ax.plot(*handle.T, color=GRAY, linewidth=0.5)
        ax.plot(*segment[1:-1].T, color=BLUE, marker="o", markersize=2.2, linestyle="none")
    ax.plot(*points[:, 0].T, color=VERMILLION, marker="s", markersize=3.4, linestyle="none")
    ax.set_aspect("equal")
    ax.set(xlim=limits[0], ylim=limits[1])
    ax.axis("off")
    ax.text(0.5, -0.01, text, transform=ax.transAxes, ha="center", va="top")
    letter(ax, name, title)


def _draw_bars(ax: Axes, glyphs: list[dict[str, Any]]) -> None:
    """Plot the numbers stored at each tolerance, all letters together, as a fraction of the stored outlines."""
    tolerances = sorted({fit["tolerance"] for glyph in glyphs for fit in glyph["fits"]}, reverse=True)
    stored = sum(glyph["stored"][1] for glyph in glyphs)
    for k, (method, (label, color, hatch, _)) in enumerate(_METHODS.items()):
        for place, tolerance in enumerate(tolerances):
            mine = [f for g in glyphs for f in g["fits"] if f["method"] == method and f["tolerance"] == tolerance]
            numbers = sum(f["numbers"] for f in mine)
            bar = {"color": color, "hatch": hatch, "edgecolor": BLACK, "linewidth": 0.5}
            ax.bar(place + 0.27 * (k - 1), 100 * numbers / stored, 0.25, label=None if place else label, **bar)
            count = str(sum(f["segments"] for f in mine))
            at = (place + 0.27 * (k - 1), 100 * numbers / stored)
            ax.annotate(count, at, (0, 2), textcoords="offset points", ha="center", path_effects=_HALO, zorder=5)
    ax.axhline(100, color=BLACK, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.set_xticks(range(len(tolerances)), [f"{_MILLI * tolerance:g}" for tolerance in tolerances])
    ax.set(xlabel="tolerance (em / 1000)", ylabel="numbers stored (%)")
    ax.set_ylim(0, 1.42 * max(100.0, ax.get_ylim()[1]))
    ax.legend(loc="upper left", borderaxespad=0.1, handlelength=1.6)
    letter(ax, "c", "numbers of all letters; segments above bars")


def _draw_used(ax: Axes, glyphs: list[dict[str, Any]]) -> None:
    """Plot the certified error of every fit, divided by its tolerance."""
    tolerances = sorted({fit["tolerance"] for glyph in glyphs for fit in glyph["fits"]}, reverse=True)
    for k, (method, (_, color, _, marker)) in enumerate(_METHODS.items()):
        mine = [(tolerances.index(f["tolerance"]), f) for g in glyphs for f in g["fits"] if f["method"] == method]
        x = [place + 0.22 * (k - 1) for place, _ in mine]
        y = [f["upper"] / f["tolerance"] for _, f in mine]
        ax.plot(
            x,
            y,
            color=color,
            marker=marker,
            markersize=3.6,
            linestyle="none",
            markeredgecolor=BLACK,
            markeredgewidth=0.4,
        )
    ax.axhline(1, color=BLACK, linewidth=0.8)
    ax.set_xticks(range(len(tolerances)), [f"{_MILLI * tolerance:g}" for tolerance in tolerances])
    ax.set(xlabel="tolerance (em / 1000)", ylabel="certified error / tolerance")
    ax.set_xlim(-0.5, len(tolerances) - 0.5)
    letter(ax, "d", "tolerance used")


def _draw_convergence(ax: Axes, name: str, case: dict[str, Any]) -> None:
    """Plot the relative excess of the distance over the least one of all runs, against time."""
    best = case["best"]
    others = [found for run, found in case["runs"].items() if run not in _RUNS]
    for k, found in enumerate(others):
        above = np.maximum(100 * (np.array(found["value"]) / best - 1), _FLOOR)
        label = None if k else "from its end, displaced"
        ax.plot(found["at"], above, color=GRAY, linestyle=(0, (1, 1)), linewidth=0.9, label=label)
    for run, (label, color, line, marker) in _RUNS.items():
        if run in case["runs"]:
            found = case["runs"][run]
            above = 100 * (np.array(found["value"]) / best - 1)
            ax.plot(
                found["at"],
                np.maximum(above, _FLOOR),
                color=color,
                linestyle=line,
                marker=marker,
                markersize=2.2,
                label=label,
            )
    ax.axhspan(_FLOOR, 1, color=GREEN, alpha=0.15, linewidth=0)
    ax.text(0.1, 3 * _FLOOR, "within 1 %", transform=ax.get_yaxis_transform(), va="bottom")
    ax.set_yscale("log")
    ax.set_ylim(_FLOOR, 1e7)
    ax.set(xlabel="time (s)", ylabel="above the least distance found (%)")
    ax.legend(loc="upper right", borderaxespad=0.1)
    kind = {2: "quadratics", 3: "cubics"}[case["degree"]]
    letter(ax, name, f"{case['segments']} {kind}, {2 * case['segments'] * case['degree']} parameters")


if __name__ == "__main__":
    main()
