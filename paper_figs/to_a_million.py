"""Time of calls on pairs of shards, and the extrapolation to a million shapes; numbers by to_a_million.

Caption: Time of calls on pairs of shards of 500 to 4000 letters, and the extrapolation to a million shapes on a
thousand cores. All pairs would take days, the nearest of each shape one to two hours, all near-duplicates minutes, if
cores are busy 80 % of the time and the shapes are like these letters.

Alt text: Left, a log-log plot with three rising lines of CPU time against the size of the shards. Right, three dots on
a logarithmic time axis, from minutes for near-duplicates to days for all pairs.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, VERMILLION, Picture, grouped, grouped_ticks, letter, style
from matplotlib.figure import Figure

_CALLS: dict[str, dict[str, Any]] = {
    "nearest": {"color": BLUE, "marker": "o", "label": "nearest of each"},
    "within": {"color": VERMILLION, "marker": "s", "linestyle": (0, (4, 1.2)), "label": "near-duplicates"},
}
_MARK: dict[str, Any] = {"markersize": 4.0, "markeredgecolor": BLACK, "markeredgewidth": 0.4}
_ROWS = {
    "all pairs": ("all pairs", GRAY),
    "nearest": ("nearest\nof each", BLUE),
    "within": ("near-\nduplicates", VERMILLION),
}
_HOUR = 3600


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 70 * MM), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
        _draw_calls(left, numbers)
        _draw_plan(right, numbers)
    return figure


def _draw_calls(ax: Any, numbers: dict[str, Any]) -> None:
    shards = numbers["shards"]
    size = np.array([shard["size"] for shard in shards])
    for name, looks in _CALLS.items():
        ax.loglog(size, [shard[name]["cpu"] for shard in shards], **looks, **_MARK)
    every = numbers["cpu_a_pair"] * size**2
    ax.loglog(size, every, color=GRAY, linestyle=(0, (1, 1)), linewidth=1.4, label="all pairs (estimated)")
    ax.set_xticks(size, [f"{x}" for x in size])
    ax.yaxis.set_major_formatter(grouped_ticks())
    ax.minorticks_off()
    ax.set(xlabel="letters in each of two shards", ylabel="CPU time (s)")
    # Room for the key above the lines.
    ax.set_ylim(top=30 * max(every))
    ax.legend(loc="upper left", handlelength=2.6)
    letter(ax, "a", "measured: one call")


def _draw_plan(ax: Any, numbers: dict[str, Any]) -> None:
    plan, assumed = numbers["plan"], numbers["assumed"]
    hours = [plan[name]["hours"] for name in _ROWS]
    values = [_HOUR * x for x in hours]
    names, colors = zip(*_ROWS.values(), strict=True)
    # Points, as a logarithmic axis has no zero for bars.
    ax.hlines(range(len(names)), 0, values, color="#C0C0C0", linewidth=0.8)
    ax.scatter(values, range(len(names)), 28, color=colors, zorder=3)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(-0.5, len(names) - 0.5)
    ax.set_xscale("log")
    ax.set_xlim(min(values) / 4, 900 * max(values))
    ax.invert_yaxis()
    for k, name in enumerate(_ROWS):
        text = f"{_lasts(hours[k])}, {_kept(plan[name]['bytes'])} kept"
        ax.annotate(text, (values[k], k), (6, 0), textcoords="offset points", va="center")
    ax.minorticks_off()
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("time (s)")
    letter(ax, "b", f"planned: {grouped(assumed['shapes'])} shapes, {grouped(assumed['cores'])} cores")


def _lasts(hours: float) -> str:
    return f"{hours / 24:.2g} days" if hours > 48 else f"{hours:.2g} h" if hours > 1 else f"{60 * hours:.2g} min"


def _kept(count: float) -> str:
    unit = next((unit for unit in ((1e12, "TB"), (1e9, "GB"), (1e6, "MB")) if count >= unit[0]), (1.0, "B"))
    return f"{count / unit[0]:.3g} {unit[1]}"


if __name__ == "__main__":
    main()
