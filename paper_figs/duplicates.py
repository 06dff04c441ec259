"""Number of pairs that remain at each stage, their distances, and some of the pairs; numbers by duplicates.

Caption: Pairs of 11 683 letters that remain at each stage of a search for near-duplicates, the distances of the 905
pairs found, and some of the pairs. About a thousand of 68 million pairs are searched, none stays undecided, in under 30
CPU seconds once compiled.

Alt text: Two dot plots on logarithmic axes with the numbers of pairs and the CPU times, a step curve of the distances
found, and six overlaid pairs of nearly identical letters.
"""

from typing import Any

import numpy as np
from common import BLUE, GRAY, GREEN, MM, ORANGE, Picture, bezier, grouped, letter, power_text, style
from matplotlib.figure import Figure

from jhd import plot

_DASHED = (0, (4, 1.2))


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 88 * MM), layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.0, 0.8))
        left, middle, right = parts[0].subplots(1, 3)
        _draw_pairs(left, numbers)
        _draw_time(middle, numbers)
        _draw_distances(right, numbers)
        _draw_shown(parts[1], numbers)
    return figure


def _points(ax: Any, names: list[str], values: list[float], colors: list[str], form: str) -> None:
    """Plot numbers over many powers of ten as points with text; a logarithmic axis has no zero for bars."""
    ax.hlines(range(len(names)), 0, values, color="#C0C0C0", linewidth=0.8)
    ax.scatter(values, range(len(names)), 28, color=colors, zorder=3)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(-0.5, len(names) - 0.5)
    ax.set_xscale("log")
    ax.set_xlim(min(values) / 8, 60 * max(values))
    ax.invert_yaxis()
    for k, value in enumerate(values):
        ax.annotate(grouped(value, form), (value, k), (6, 0), textcoords="offset points", va="center")
    ax.tick_params(axis="y", length=0)
    ax.minorticks_off()


def _draw_pairs(ax: Any, numbers: dict[str, Any]) -> None:
    names = ["all pairs", "searched", f"within {numbers['within']:g} em"]
    _points(ax, names, [numbers["pairs"], numbers["computed"], numbers["found"]], [GRAY, ORANGE, BLUE], ",")
    ax.set_xlabel("pairs")
    letter(ax, "a", f"{grouped(numbers['shapes'])} letters")


def _draw_time(ax: Any, numbers: dict[str, Any]) -> None:
    spent = numbers["spent"]
    values = [numbers["cpu_a_pair"] * numbers["pairs"], spent["pivots"], spent["rest"]]
    names = ["all distances\n(estimated)", "pivot distances", "search"]
    _points(ax, names, values, [GRAY, GREEN, ORANGE], ",.3g" if max(values) < 1e3 else ",.0f")
    ax.set_xlabel("CPU time (s)")
    letter(ax, "b", "time, once compiled")


def _draw_distances(ax: Any, numbers: dict[str, Any]) -> None:
    distance = np.sort(np.array(numbers["grouped"]["distance"], dtype=float))
    count = np.arange(1, len(distance) + 1)
    ax.step([0.0, *distance, numbers["within"]], [0, *count, len(distance)], where="post", color=BLUE)
    ax.set(xlabel="distance (em)", ylabel="pairs within the distance", xlim=(0, numbers["within"]), ylim=(0, None))
    letter(ax, "c", "distances found")


def _draw_shown(part: Any, numbers: dict[str, Any]) -> None:
    axes = np.atleast_1d(part.subplots(1, len(numbers["shown"])))
    for ax, pair in zip(axes, numbers["shown"], strict=True):
        first, second = (bezier(points) for points in pair["curves"])
        plot.curve(first, ax, control_polygon=False)
        plot.curve(second, ax, color=ORANGE, linestyle=_DASHED, control_polygon=False)
        _square(ax, first, second)
        ax.set_axis_off()
        codes = [f"U+{ord(sign):04X}" for sign in pair["letters"]]
        ax.set_title(f"{codes[0]}\n{codes[1]}\n$d$ = {_short(pair['distance'])} em", fontsize=8)
    part.suptitle("$\\bf{(d)}$ pairs of letters, one solid and one dashed", x=0.01, ha="left", fontsize=8)


def _square(ax: Any, *curves: Any) -> None:
    """Set limits of one length along both axes, so that all panels have one form."""
    points = np.concatenate([np.asarray(curve.control_points).reshape(-1, 2) for curve in curves])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, 0.54 * np.max(high - low)
    ax.set_xlim(middle[0] - half, middle[0] + half)
    ax.set_ylim(middle[1] - half, middle[1] + half)


def _short(x: float) -> str:
    """Return a number with two digits."""
    return f"{x:.2g}" if x >= 1e-4 else power_text(x, 1)


if __name__ == "__main__":
    main()
