"""A noisy outline with its fit by cubics, the distances that all methods reach, and the times of all methods.

Numbers by noisy_outline's experiment.

Caption: A noisy outline with its fit by 20 cubics, and the distances and CPU times of all methods for 100 to 10 000
vertices. For all numbers of vertices, the minimax fit of jhd is certified to be nearer than least squares, Adam on
three losses and SciPy's smoothing spline. Times of Adam are for 600 steps at each of three rates, on every fifth vertex
of 10 000.

Alt text: Left, a rounded triangular outline with its noise magnified in an inset. Center and right, log-log plots of
distance and CPU time against the number of vertices; the line of jhd has the least distances.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, bezier, grouped, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

_METHODS = {
    "least squares": (GRAY, "s", (0, (1, 1))),
    "Adam, Chamfer": (ORANGE, "^", (0, (4, 1.2))),
    "Adam, soft Hausdorff": (PURPLE, "D", (0, (4, 1.2, 1, 1.2))),
    "Adam, hard Hausdorff": (VERMILLION, "v", (0, (2, 1))),
    "smoothing spline": (GREEN, "P", (0, (6, 2))),
    "minimax fit": (BLUE, "o", "-"),
}
# This package, under its name.
_LABELS = {"minimax fit": "jhd (minimax fit)"}
_MARKS: dict[str, Any] = {"markersize": 3.6, "markeredgecolor": BLACK, "markeredgewidth": 0.5}
_MILLI = 1e3


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    cases = numbers["cases"]
    with style():
        figure = Figure(figsize=(175 * MM, 84 * MM), layout="constrained")
        shape, distance, seconds = figure.subplots(1, 3, width_ratios=(1.15, 1, 1))
        shown = next(case for case in reversed(cases) if case["points"] is not None and case["vertices"] <= 400)
        _draw_shape(shape, shown)
        letter(shape, "a", f"{shown['vertices']} vertices, {numbers['segments']} cubics")
        for name, look in _METHODS.items():
            found = [case["methods"][name] for case in cases]
            _draw(distance, cases, [_MILLI * entry["upper"] for entry in found], name, look)
            if name != "least squares":
                _draw(seconds, cases, [entry["seconds"] for entry in found], name, look)
        distance.set_ylabel("certified Hausdorff distance (1/1000)")
        letter(distance, "b", "distance")
        seconds.set_ylabel("CPU time (s)")
        letter(seconds, "c", "time")
        handles, labels = distance.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, columnspacing=1.6, handlelength=2.6)
    return figure


def _draw_shape(ax: Axes, case: dict[str, Any]) -> None:
    points = np.array(case["points"])
    ax.plot(*np.vstack([points, points[:1]]).T, color=GRAY, linewidth=0.5)
    curve = bezier(case["shape"])
    t = np.linspace(0, curve.count, 40 * curve.count + 1)
    ax.plot(*np.asarray(curve(t)).T, color=BLUE, linewidth=1.4)
    joints = np.array(case["shape"])[:, 0]
    ax.plot(*joints.T, color=BLUE, marker="o", linestyle="none", **_MARKS)
    ax.set_aspect("equal")
    ax.axis("off")
    # The noise is a hundredth of the outline, so an inset magnifies a part.
    near = ax.inset_axes((0.3, 0.3, 0.36, 0.36))
    near.plot(*np.vstack([points, points[:1]]).T, color=BLACK, linewidth=0.5, marker=".", markersize=2)
    near.plot(*np.asarray(curve(t)).T, color=BLUE, linewidth=1.0)
    middle, half = points[len(points) // 2], 0.05 * np.ptp(points[:, 0])
    near.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half), xticks=[], yticks=[])
    near.set_aspect("equal")
    near.spines[:].set_visible(True)
    ax.indicate_inset_zoom(near, edgecolor=BLACK, alpha=1.0, linewidth=0.6)


def _draw(ax: Axes, cases: list[dict[str, Any]], values: list[float], name: str, look: Any) -> None:
    color, marker, line = look
    options: dict[str, Any] = {"color": color, "marker": marker, "linestyle": line, **_MARKS}
    ax.loglog([c["vertices"] for c in cases], values, label=_LABELS.get(name, name), **options)
    ax.set_xlabel("vertices of the outline")
    # A label at every second number of vertices, and numbers instead of powers of ten on the other axis.
    ax.set_xticks([case["vertices"] for case in cases[::2]], [grouped(case["vertices"]) for case in cases[::2]])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    ax.yaxis.set_minor_formatter(FuncFormatter(lambda y, _: f"{y:g}" if _is_short(ax) and f"{y:e}"[0] in "235" else ""))


def _is_short(ax: Axes) -> bool:
    """Return True if an axis has few powers of ten, so that there is room for numbers between them."""
    low, high = ax.get_ylim()
    return high < 100 * low


if __name__ == "__main__":
    main()
