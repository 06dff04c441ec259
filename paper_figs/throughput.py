"""Pairs per second against the size of a batch; numbers by throughput's experiment.

Horizontal lines are single calls, pair by pair.

Caption: Pairs per second in batches of 1 to 1024 under vmap, on a CPU; horizontal lines show one call per pair. Batches
use all cores: on two or more, from 256 pairs on, they are at least three times as fast as compiled calls one by one for
single cubics, and twice for curves of 30 segments. With the search inside the compiled function (`jhd.inline_searches`)
batches of this size are slower.

Alt text: Two log-log panels, for cubics and for splines of 30 segments. Two rising lines show pairs per second against
the batch size; three horizontal lines show compiled calls, plain calls and the k-d tree.
"""

from typing import Any

from common import BLACK, BLUE, GREEN, MM, ORANGE, VERMILLION, Picture, grouped_ticks, letter, power_text, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

_MARK: dict[str, Any] = {"markersize": 4.0, "markeredgecolor": BLACK, "markeredgewidth": 0.4}
_BATCHES: dict[str, dict[str, Any]] = {
    "batch": {"color": VERMILLION, "marker": "o", "zorder": 3, "label": "jhd, batch"},
    "batch in the program": {
        "color": VERMILLION,
        "marker": "s",
        "markerfacecolor": "white",
        "linestyle": (0, (3, 1.5)),
        "label": "jhd, batch, search in the function",
    },
}
_LOOPS: dict[str, dict[str, Any]] = {
    "one by one": {"color": BLUE, "linestyle": (0, (4, 1.2)), "label": "jhd, one by one, compiled"},
    "plain": {"color": GREEN, "linestyle": (0, (1, 1)), "label": "jhd, plain calls"},
    "k-d tree": {"color": ORANGE, "linestyle": (0, (6, 1.2, 1, 1.2)), "label": "SciPy k-d tree"},
}
_TITLES = {"cubics": "two cubics", "splines": "two closed splines, 30 segments"}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    """Return a figure with one panel for each kind of pair."""
    with style():
        figure = Figure(figsize=(175 * MM, 78 * MM), layout="constrained")
        axes = figure.subplots(1, len(_TITLES), sharex=True, sharey=True)
        device = f"{numbers['cores']} CPU cores" if numbers["platform"] == "cpu" else numbers["kind"]
        for ax, (name, title), number in zip(axes, _TITLES.items(), "ab", strict=True):
            if name in numbers["kinds"]:
                _draw(ax, numbers["kinds"][name])
            letter(ax, number, f"{title}, {device}")
            ax.set_xlabel("pairs in a batch")
        axes[0].set_ylabel("pairs per second")
        low, high = axes[0].get_ylim()
        # Room for the text.
        axes[0].set_ylim(low / 3.5, 1.4 * high)
        axes[0].yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes[0].yaxis.set_major_formatter(grouped_ticks())
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, handlelength=2.4, columnspacing=1.4)
    return figure


def _draw(ax: Axes, found: dict[str, Any]) -> None:
    """Plot the rates of batches, and levels of single calls."""
    size = [entry["size"] for entry in found["batches"]["batch"]]
    for way, rows in found["batches"].items():
        ax.loglog(size, [1 / entry["seconds"] for entry in rows], **_BATCHES[way], **_MARK)
    levels = {name: 1 / found["loops"][name]["seconds"] for name in _LOOPS}
    for name, line in _LOOPS.items():
        ax.axhline(levels[name], linewidth=1.2, **{key: line[key] for key in ("color", "linestyle", "label")})
    error, gap = power_text(found["error"]["median"]), power_text(found["gap"])
    text = f"k-d tree: median error {error}\njhd: largest gap {gap}, certified"
    ax.text(0.03, 0.03, text, transform=ax.transAxes, linespacing=1.3)
    ax.set_xticks(size, [f"{n}" for n in size])
    ax.minorticks_off()


if __name__ == "__main__":
    main()
