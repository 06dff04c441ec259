"""The largest bound left against the cells of a search on two patches, for five bounds of a cell.

Numbers by surface_bounds's experiment.

Caption: Number of cells of a patch that a certified distance needs, for four bounds of a cell and for jhd: surfaces
that are parallel at the farthest point, two equally near foot points, and a constant distance. The search of jhd closes
to 1e-10 of the diagonal with fewer than a hundred cells. With two foot points or a constant distance no other bound
closes within 129 cells.

Alt text: Three log-log plots of gaps against the number of cells. The line of jhd drops below the dotted tolerance in
each of them; in the second and third panel the other four lines stay above it.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_TITLES = {"parallel": "parallel tangent planes", "ridge": "two feet", "planes": "equally far everywhere"}
_LINES: dict[str, dict[str, Any]] = {
    "Lipschitz": {"color": GRAY, "marker": "s"},
    "one foot": {"color": ORANGE, "marker": "D"},
    # Larger and open, so that it is seen if it equals the next one.
    "moving foot": {
        "color": GREEN,
        "marker": "^",
        "markersize": 6.0,
        "markerfacecolor": "none",
        "markeredgecolor": GREEN,
    },
    "two branches": {"color": BLUE, "marker": "v"},
    "jhd": {"color": VERMILLION, "marker": "o"},
}
_MARK: dict[str, Any] = {"markersize": 3.2, "markeredgecolor": BLACK, "markeredgewidth": 0.3}
_DOTS: dict[str, Any] = {"color": BLACK, "linewidth": 0.6, "linestyle": (0, (1, 1.5))}
# Lower bounds of the axes; the search of jhd ends below.
_LEAST = 1e-12


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    pairs = numbers["pairs"]
    with style():
        figure = Figure(figsize=(175 * MM, 74 * MM), layout="constrained")
        axes = figure.subplots(1, len(pairs), sharex=True, sharey=True, squeeze=False)[0]
        for ax, name, number in zip(axes, pairs, "abc", strict=False):
            _draw(ax, pairs[name]["searches"], numbers["goal"])
            letter(ax, number, _TITLES[name])
            ax.set_xlabel("cells bounded")
        axes[0].set_ylabel("gap (in diagonals of the box)")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, handlelength=1.6)
    return figure


def _draw(ax: Axes, searches: dict[str, Any], goal: float) -> None:
    for family, line in _LINES.items():
        count, gap = (np.array(searches[family][key], float) for key in ("cells", "gap"))
        ax.loglog(count, np.maximum(gap, _LEAST), label=family, markevery=_spread(count), **{**_MARK, **line})
    ax.axhline(goal, label="default tolerance", **_DOTS)
    ax.set_ylim(_LEAST / 3, 10)
    ax.set_yticks(10.0 ** np.arange(-12, 1, 3))
    ax.minorticks_off()


def _spread(count: np.ndarray) -> list[int]:
    """Return indices of the first, the last and some entries between, about evenly apart on a logarithmic axis."""
    steps = np.unique(np.round(np.log2(count) * 2).astype(int), return_index=True)[1]
    return sorted({*map(int, steps), len(count) - 1})


if __name__ == "__main__":
    main()
