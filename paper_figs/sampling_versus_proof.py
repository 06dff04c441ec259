"""Error against time of sampled, polygonal and certified distances.

Numbers by sampling_versus_proof's experiment. Stars are gaps that jhd has certified at a tolerance of 1e-10 of the
diagonal.

Caption: Error against time for four pairs of curves: samples in SciPy's k-d tree, polylines in shapely, and jhd (stars:
certified gaps), all in both directions. The search of jhd is inside the compiled function (`jhd.inline_searches`).
For two closed splines of 90 control points, both directions are certified in less than 4 ms (star in (a)). One
direction alone (not drawn) takes less than 3 ms; the tree with 400 samples a segment takes more than 250 times
as long, with an error of 1e-9 in one direction and 1e-6 in the other.

Alt text: Four log-log panels of error against time. Lines for the k-d tree and polylines fall slowly from upper left to
lower right and stay above 1e-10; one red star in each panel, for jhd, lies below them.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GREEN, MM, ORANGE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

_TITLES = {
    "splines": "two closed splines, 90 points each",
    "cubics": "two cubics",
    "parabola": "parabola with and without a bar",
    "letters": "letter a in two fonts",
}
_EDGE: dict[str, Any] = {"markeredgecolor": BLACK, "markeredgewidth": 0.4}
_SERIES: dict[str, dict[str, Any]] = {
    "k-d tree": {"color": ORANGE, "marker": "D", "linestyle": "-", "label": "SciPy k-d tree"},
    "shapely": {"color": BLUE, "marker": "s", "linestyle": (0, (4, 1.2)), "label": "shapely"},
    "shapely, densify": {"color": GREEN, "marker": "^", "linestyle": (0, (1, 1)), "label": "shapely, densified"},
}
_STAR: dict[str, Any] = {"color": VERMILLION, "marker": "*", "markersize": 11, "linestyle": "none", **_EDGE}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    """Return a figure with one panel for each pair."""
    with style():
        figure = Figure(figsize=(175 * MM, 128 * MM), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, sharey=True)
        for ax, (name, pair), number in zip(axes.flat, numbers["pairs"].items(), "abcd", strict=False):
            _draw(ax, pair, numbers["chosen"])
            letter(ax, number, _TITLES[name])
        axes[0, 0].set_ylim(1e-15, 1)
        axes[0, 0].set_yticks(10.0 ** np.arange(-15, 1, 3))
        for ax in axes[-1]:
            ax.set_xlabel("time (s)")
        for ax in axes[:, 0]:
            ax.set_ylabel("error (in diagonals of the box)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        places: dict[str, Any] = {"loc": "outside lower center", "ncols": 5, "columnspacing": 1.1}
        figure.legend(handles, labels, handlelength=1.9, handletextpad=0.5, **places)
    return figure


def _draw(ax: Axes, pair: dict[str, Any], chosen: float) -> None:
    """Plot errors of the peers, for the tree with the number of samples at its ends, and the certified gap."""
    for method, line in _SERIES.items():
        entries = [entry for entry in pair["entries"] if entry["method"] == method]
        time, error = ([entry[key] for entry in entries] for key in ("seconds", "error"))
        ax.loglog(time, error, markersize=3.6, **line, **_EDGE)
        if method == "k-d tree":
            # If the line of the tolerance is close below the last marker, the label stands below the line.
            drop = -22 if error[-1] < 30 * chosen else -11
            for entry, offset, ha in ((entries[0], (5, 3), "left"), (entries[-1], (-4, drop), "right")):
                text, place = f"{entry['samples']} a segment", (entry["seconds"], entry["error"])
                note = ax.annotate(text, place, offset, textcoords="offset points", ha=ha)
                note.set_path_effects([withStroke(linewidth=1.5, foreground="white")])
    (ours,) = (e for e in pair["entries"] if e["method"] == "jhd" and e["tolerance"] == chosen)
    ax.loglog([ours["seconds"]], [ours["gap"]], label="jhd: certified gap", zorder=5, **_STAR)
    ax.axhline(chosen, color=BLACK, linewidth=0.6, linestyle=(0, (1, 1.5)), label="tolerance of jhd")
    ax.minorticks_off()


if __name__ == "__main__":
    main()
