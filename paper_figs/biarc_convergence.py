"""Number of biarcs against tolerance with theory, and the fraction of the certified deviation that is attained.

Numbers by biarc_convergence's experiment.

Caption: Number of biarcs against tolerance for five curves, compared with theory, and the fraction of the certified
deviation that samples and the Hausdorff distance attain, which is 84 to 95.5 %. For tolerances up to 1e-4 of the
diagonal the count grows with their power -0.31 to -0.34 and is 1.3 to 2.0 times the theoretical count.

Alt text: Top, five curves split into arcs of alternating colors. Bottom, log-log counts of arcs along dashed lines of
theory, and marks of the attained fraction of the deviation, mostly near 0.93.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator

import jhd

_LINES: dict[str, dict[str, Any]] = {
    "smooth": {"color": BLUE, "marker": "o"},
    "inflecting": {"color": ORANGE, "marker": "s"},
    "cusped": {"color": GREEN, "marker": "^"},
    "rational": {"color": VERMILLION, "marker": "D"},
    "spline": {"color": PURPLE, "marker": "v"},
}
_TITLES = {
    "smooth": "convex cubic",
    "inflecting": "inflecting cubic",
    "cusped": "cubic with a cusp",
    "rational": "rational ellipse",
    "spline": "closed spline",
}
_MARK: dict[str, Any] = {"markersize": 3.8, "markeredgecolor": BLACK, "markeredgewidth": 0.4}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    curves = numbers["curves"]
    with style():
        figure = Figure(figsize=(175 * MM, 112 * MM), layout="constrained")
        top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[0.52, 1.0])[:, 0]
        panels = top.subplots(1, len(curves), squeeze=False)[0]
        for k, (ax, (name, entry)) in enumerate(zip(panels, curves.items(), strict=True)):
            _draw_arcs(ax, entry)
            letter(ax, "abcde"[k], _TITLES[name])
        counts, used = bottom.subplots(1, 2)
        _draw_counts(counts, curves)
        letter(counts, "abcdefg"[len(curves)], "arcs needed")
        _draw_used(used, curves)
        letter(used, "abcdefg"[len(curves) + 1], "deviation attained")
        for ax in (counts, used):
            ax.set_xlabel("tolerance / diagonal of the curve's box")
            ax.xaxis.set_major_locator(FixedLocator([1e-2, 1e-4, 1e-6, 1e-8]))
            ax.xaxis.set_minor_locator(NullLocator())
            ax.invert_xaxis()
    return figure


def _draw_arcs(ax: Axes, entry: dict[str, Any]) -> None:
    """Draw the arcs of one tolerance, alternating between two colors, and their ends."""
    drawn = entry["drawn"]
    arcs = jhd.BezierSegments(np.array(drawn["control_points"]), np.array(drawn["weights"]))
    t = np.linspace(0, 1, 33)
    for k in range(arcs.count):
        color, line = ((BLUE, "-"), (ORANGE, "-"))[k % 2]
        ax.plot(*np.asarray(arcs(k + np.minimum(t, 1 - 1e-12))).T, color=color, linestyle=line, linewidth=1.4)
    ends = np.asarray(arcs.control_points)[:, [0, -1]].reshape(-1, 2)
    ax.plot(*ends.T, linestyle="none", marker=".", markersize=2.6, color=BLACK)
    # All panels keep one size, so that their titles are aligned.
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.06)
    ax.axis("off")
    ax.text(0.5, -0.02, f"{arcs.count} arcs", transform=ax.transAxes, ha="center", va="top")


def _draw_counts(ax: Axes, curves: dict[str, Any]) -> None:
    for name, entry in curves.items():
        rows = entry["rows"]
        share = [row["share"] for row in rows]
        ax.loglog(share, [row["arcs"] for row in rows], linestyle="none", label=_TITLES[name], **_LINES[name], **_MARK)
        theory = [row["theory"] for row in rows]
        ax.loglog(share, theory, color=_LINES[name]["color"], linewidth=0.9, linestyle=(0, (4, 1.5)))
    ax.set_ylabel("number of arcs")
    ax.set_ylim(0.8, 4 * ax.get_ylim()[1])
    handles, labels = ax.get_legend_handles_labels()
    handles.append(Line2D([], [], color=GRAY, linewidth=0.9, linestyle=(0, (4, 1.5))))
    labels.append("theory, slope $-1/3$")
    ax.legend(handles, labels, loc="upper left", labelspacing=0.2, handletextpad=0.3, borderaxespad=0.0)


def _draw_used(ax: Axes, curves: dict[str, Any]) -> None:
    """Plot the farthest sample and the bounds of the distance as fractions of the largest certified deviation."""
    for k, (name, entry) in enumerate(curves.items()):
        rows = entry["rows"]
        x = np.array([row["share"] for row in rows]) * 10 ** (0.13 * (len(curves) // 2 - k))
        low, high = (np.array([row[key] / row["deviation"] for row in rows]) for key in ("lower", "upper"))
        ax.plot(x, [row["sampled"] / row["deviation"] for row in rows], linestyle="none", **_LINES[name], **_MARK)
        ax.vlines(x, low, high, color=BLACK, linewidth=1.0, zorder=5)
        ax.plot(x, low, linestyle="none", marker="_", color=BLACK, markersize=6, markeredgewidth=0.8, zorder=5)
    ax.axhline(1.0, color=GRAY, linewidth=0.8)
    ax.set_xscale("log")
    ax.set_ylim(0.78, 1.06)
    ax.text(0.02, 1.006, "certified deviation", transform=ax.get_yaxis_transform(), va="bottom", color=GRAY)
    ax.set_ylabel("fraction of the certified deviation")
    handles = [
        Line2D([], [], linestyle="none", marker="o", color="white", **_MARK),
        Line2D([], [], linestyle="none", marker="_", color=BLACK, markersize=6, markeredgewidth=0.8),
    ]
    labels = ["farthest sample", "distance, certified"]
    ax.legend(handles, labels, loc="lower left", ncols=2, handletextpad=0.3, columnspacing=1.0)


if __name__ == "__main__":
    main()
