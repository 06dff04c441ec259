"""Times, boxes and gains of trimming against the number of control points, with the times printed in 2010.

Numbers by kim10_table's experiment. Each mark is one pair; lines join the geometric means of one size.

Caption: Times, boxes and gains of trimming against the number of control points, with the times printed in 2010 (table
1 of Kim et al., with our own data); each mark is one pair, its shape the kind of event, and lines join the geometric
means of one size. Values agree with the certified distance to 1e-9 of the diagonal, except for the steps as printed (in
the table, not drawn), whose value may be too small. Trimming never examines more boxes.

Alt text: Three log-log plots against the number of control points, with marks for single pairs and lines through their
means: times of five methods with the printed ones, boxes examined, and the gain by trimming.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullFormatter, NullLocator

_DASHED, _DOTTED, _DASH_DOTTED = (0, (4, 1.2)), (0, (1, 1)), (0, (5, 1.2, 1, 1.2))
_MARK: dict[str, Any] = {"markersize": 3.2, "markeredgecolor": BLACK, "markeredgewidth": 0.3}
_TIMES: dict[str, dict[str, Any]] = {
    "AlgebraicEvents": {"color": VERMILLION, "label": "all events"},
    "BiarcTrimming": {"color": BLUE, "label": "trimming"},
    "trimming without biarcs": {"color": PURPLE, "linestyle": _DASHED, "label": "trimming, biarcs given"},
    "TwoStep": {"color": ORANGE, "linestyle": _DOTTED, "label": "two-step"},
    "BranchAndBound": {"color": GREEN, "linestyle": _DASH_DOTTED, "label": "jhd (branch and bound)"},
}
# The kinds of event; marks are shifted, so that none hides another.
_KINDS = {
    "end": ("o", "end of $A$"),
    "foot_at_end": ("s", "foot at an end of $B$"),
    "antipodal": ("^", "antipodal"),
    "self_bisector": ("D", "two feet"),
}
_APART = 1.06
_PRINTED: dict[str, Any] = {"color": GRAY, "linestyle": _DOTTED, "markersize": 4.5, "linewidth": 0.8}
_LEGEND: dict[str, Any] = {"handlelength": 2.2, "labelspacing": 0.25, "handletextpad": 0.5, "borderaxespad": 0.1}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers["entries"]))


def _figure(entries: list[dict[str, Any]]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 92 * MM), layout="constrained")
        times, boxes, gains = figure.subplots(1, 3, sharex=True, width_ratios=[1.25, 1.0, 1.0])
        _draw_times(times, entries)
        letter(times, "a", "warm time of one distance")
        _draw_boxes(boxes, entries)
        letter(boxes, "b", "boxes of the solver")
        _draw_gains(gains, entries)
        letter(gains, "c", "gain by trimming")
        counts = sorted({entry["count"] for entry in entries})
        for ax in (times, boxes, gains):
            ax.set_xlabel("control points of either curve")
            ax.xaxis.set_major_locator(FixedLocator(counts))
            ax.xaxis.set_minor_locator(NullLocator())
            ax.set_xticklabels([str(count) for count in counts])
        handles, labels = times.get_legend_handles_labels()
        for marker, label in _KINDS.values():
            handles.append(Line2D([], [], linestyle="none", marker=marker, color="white", **_MARK))
            labels.append(label)
        figure.legend(handles, labels, loc="outside lower center", ncols=4, **_LEGEND)
    return figure


def _drawn(ax: Axes, entries: list[dict[str, Any]], values: Any, look: dict[str, Any]) -> None:
    """Draw a mark for each pair, its shape the kind of event, and a line through the geometric means."""
    counts = sorted({entry["count"] for entry in entries})
    rows = [np.array([values(entry) for entry in entries if entry["count"] == count]) for count in counts]
    line = {"color": look["color"], "linestyle": look.get("linestyle", "-"), "linewidth": 1.0}
    ax.loglog(counts, [np.exp(np.mean(np.log(row))) for row in rows], **line, label=look["label"])
    for k, (kind, (marker, _)) in enumerate(_KINDS.items()):
        shown = [(_APART ** (2 * k - 3) * e["count"], values(e)) for e in entries if e["kind"] == kind]
        ax.loglog(*np.transpose(shown or np.empty((0, 2))), marker, color=look["color"], **_MARK)


def _draw_times(ax: Axes, entries: list[dict[str, Any]]) -> None:
    for name, look in _TIMES.items():
        _drawn(ax, entries, lambda entry, name=name: entry["seconds"][name], look)
    labels = {"all events, printed 2010": "x", "trimming, printed 2010": "+"}
    _draw_printed(ax, entries, lambda printed: np.divide(printed, 1000), labels)
    ax.set_ylabel("time (s)")


def _draw_printed(ax: Axes, entries: list[dict[str, Any]], values: Any, labels: dict[str, str]) -> None:
    """Draw the printed numbers of the source, each at its own size."""
    known = sorted((entry["count"], values(entry["printed"])) for entry in entries if entry["printed"])
    for k, (label, marker) in enumerate(labels.items()):
        look = {**_PRINTED, "marker": marker, "label": label}
        ax.loglog([count for count, _ in known], [value[k] for _, value in known], **look)


def _draw_boxes(ax: Axes, entries: list[dict[str, Any]]) -> None:
    for name in ("AlgebraicEvents", "BiarcTrimming"):
        # If nothing is left to solve, there is no box; the scale has no zero.
        _drawn(ax, entries, lambda entry, name=name: max(entry["boxes"][name], 1), _TIMES[name])
    ax.set_ylabel("boxes examined")


def _draw_gains(ax: Axes, entries: list[dict[str, Any]]) -> None:
    for name in ("BiarcTrimming", "trimming without biarcs"):
        gain = lambda entry, name=name: entry["seconds"]["AlgebraicEvents"] / entry["seconds"][name]  # noqa: E731
        _drawn(ax, entries, gain, _TIMES[name])
    _draw_printed(ax, entries, lambda printed: (printed[0] / printed[1],), {"printed 2010": "*"})
    ax.axhline(1.0, color=GRAY, linewidth=0.6)
    ax.set_ylabel("time of all events / with trimming")
    ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[-1:], labels[-1:], loc="lower right", bbox_to_anchor=(1.0, 0.08), **_LEGEND)


if __name__ == "__main__":
    main()
