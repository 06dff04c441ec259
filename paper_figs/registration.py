"""An outline registered to another by the Hausdorff distance and by ICP: overlays, and final distances by angle.

Numbers by registration's experiment.

Caption: The letter S of one font registered to the S of another by the Hausdorff distance and by ICP, and the distances
reached from eight starting angles. The best rigid motion is 8 % nearer than the best result of ICP, the best similarity
26 %. An exact copy is recovered to 1e-13 from 3 angles, by ICP from 4; other angles end more than 0.05 x-heights away.

Alt text: Top, four overlays of a gray and a dashed blue letter S: before, by ICP, and by jhd with rigid motions and
similarities. Bottom, three plots of the final distance against the starting angle.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, VERMILLION, Picture, bezier, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jhd import plot

_DASHED = (0, (4, 1.2))
_LOOK: dict[str, tuple[str, dict[str, Any]]] = {
    "icp": ("ICP", {"color": ORANGE, "marker": "s", "markersize": 4.0}),
    "ours": ("jhd", {"color": BLUE, "marker": "o", "markersize": 4.5}),
    "icp_then_ours": ("jhd from the end of ICP", {"color": BLACK, "marker": "x", "markersize": 4.0}),
}
# Smaller distances are rounding errors, and are drawn here.
_FLOOR = 1e-16


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    problems = numbers["problems"]
    with style():
        figure = Figure(figsize=(175 * MM, 122 * MM), layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1.0))
        top, bottom = parts
        shown = top.subplots(1, 4, sharey=True, sharex=True)
        _draw_overlays(shown, numbers)
        top.legend(*_legend(shown), loc="outside lower center", ncols=4, handlelength=2.2)
        ends = bottom.subplots(1, 3)
        for k, (ax, (name, problem)) in enumerate(zip(ends, problems.items(), strict=True)):
            _draw_ends(ax, problem, np.degrees(numbers["angles"]))
            letter(ax, "efg"[k], "exact copy" if name == "copy" else str(name))
        ends[0].set_ylabel("Hausdorff distance (x-heights)")
        bottom.legend(*ends[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _legend(shown: Any) -> tuple[list[Any], list[str]]:
    """Return handles and labels of all axes, each label once."""
    found = {}
    for ax in shown:
        handles, labels = ax.get_legend_handles_labels()
        found.update(zip(labels, handles, strict=True))
    return list(found.values()), list(found)


def _draw_overlays(shown: Any, numbers: dict[str, Any]) -> None:
    problems = numbers["problems"]
    rigid, similar = problems["rigid"], problems["similarity"]
    first, second = (name.replace("STIXGeneral", "STIX General") for name in numbers["fonts"])
    source = np.asarray(numbers["source"])
    best_icp = min(rigid["icp"], key=lambda entry: entry["upper"])
    fits: list[Any] = [
        (source, rigid["before"][0], "before", None),
        (_moved(source, best_icp["parameters"]), best_icp["value"], "rigid, ICP", None),
        (rigid["fit"], rigid["pairs"]["value"], "rigid, jhd", rigid["pairs"]),
        (similar["fit"], similar["pairs"]["value"], "similarity, jhd", similar["pairs"]),
    ]
    for k, (ax, (points, value, words, pairs)) in enumerate(zip(shown, fits, strict=True)):
        plot.curve(bezier(rigid["target"]), ax, color=GRAY, label=first, control_polygon=False)
        plot.curve(bezier(points), ax, color=BLUE, linestyle=_DASHED, label=second, control_polygon=False)
        if pairs is not None:
            _draw_pairs(ax, pairs)
        ax.set_axis_off()
        letter(ax, "abcd"[k], f"{words}\n$d$ = {value:.4f}")


def _moved(points: np.ndarray, parameters: Any) -> np.ndarray:
    cosine, sine = np.cos(parameters[0]), np.sin(parameters[0])
    return points @ np.array([[cosine, sine], [-sine, cosine]]) + parameters[1:3]


def _draw_pairs(ax: Axes, pairs: dict[str, Any]) -> None:
    """Draw the equal largest distances."""
    points, feet = np.asarray(pairs["points"]), np.asarray(pairs["feet"])
    for point, two in zip(points, feet, strict=True):
        for foot in two:
            ax.plot(*np.stack([point, foot]).T, color=VERMILLION, linewidth=1.2, zorder=4)
    marks: dict[str, Any] = {"linestyle": "none", "markersize": 3.2, "color": VERMILLION, "zorder": 5}
    ax.plot(*points.T, marker="o", label="largest distances", **marks)
    ax.plot(*feet.reshape(-1, 2).T, marker="s", markerfacecolor="white", **marks)


def _draw_ends(ax: Axes, problem: dict[str, Any], angles: np.ndarray) -> None:
    tiny = min(entry["value"] for method in _LOOK for entry in problem[method]) < 1e-9
    starts: dict[str, Any] = {"color": GRAY, "linestyle": ":", "marker": ".", "markersize": 3, "linewidth": 0.8}
    ax.plot(angles, problem["before"], label="start", **starts)
    for method, (words, look) in _LOOK.items():
        values = np.maximum([entry["value"] for entry in problem[method]], _FLOOR)
        drawn: dict[str, Any] = {**look, "markerfacecolor": "none", "markeredgewidth": 0.9, "linestyle": "none"}
        ax.plot(angles, values, label=words, **drawn)
    ax.set_xticks([0, 90, 180, 270])
    ax.set_xlim(-20, 335)
    ax.set_xlabel("starting angle (degrees)")
    if tiny:
        ax.set_yscale("log")
        ax.set_ylim(_FLOOR / 3, 5)
        ax.set_yticks([1e-16, 1e-12, 1e-8, 1e-4, 1])
        ax.minorticks_off()
    else:
        ax.set_ylim(0, None)


if __name__ == "__main__":
    main()
