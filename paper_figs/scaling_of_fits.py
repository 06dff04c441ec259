"""Seconds of a fit by cubics: against the vertices of its target, and against its own free points.

Numbers by scaling_of_fits' experiment.

Caption: Time of a fit by cubics against the number of vertices of its target, up to 100 000, and against its number of
free points. The time of a step grows more slowly than the number of vertices. Beyond 120 free points it grows faster
than their number.

Alt text: Two log-log plots of CPU time, against the vertices of the target and against the free points of the fit, with
lines for the start, a step, the certified error and all maxima, and a straight line for proportional growth.
"""

from typing import Any

from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, VERMILLION, Picture, grouped, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

_PARTS = {
    "start": ("start by least squares", ORANGE, "s", (0, (4, 1.2))),
    "step": ("a step", BLUE, "o", "-"),
    "proof": ("certified error", GREEN, "^", (0, (1, 1))),
    "all": ("all maxima, once", VERMILLION, "D", (0, (4, 1.2, 1, 1.2))),
}
_MARKS: dict[str, Any] = {"markersize": 3.6, "markeredgecolor": BLACK, "markeredgewidth": 0.5}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(150 * MM, 80 * MM), layout="constrained")
        vertices, points = figure.subplots(1, 2, sharey=True)
        _draw(vertices, numbers["by_vertices"], "vertices", "vertices of the target")
        letter(vertices, "a", f"{numbers['by_vertices'][0]['points']} free points")
        _draw(points, numbers["by_segments"], "points", "free points of the fit")
        letter(points, "b", f"{numbers['by_segments'][0]['vertices']} vertices")
        vertices.set_ylabel("CPU time (s)")
        handles, labels = vertices.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, columnspacing=1.6, handlelength=2.6)
    return figure


def _draw(ax: Axes, cases: list[dict[str, Any]], name: str, label: str) -> None:
    for part, (text, color, marker, line) in _PARTS.items():
        known = [case for case in cases if case[part] is not None]
        ax.loglog(
            [case[name] for case in known],
            [case[part] for case in known],
            color=color,
            marker=marker,
            linestyle=line,
            label=text,
            **_MARKS,
        )
    places = [cases[0][name], cases[-1][name]]
    ax.loglog(
        places, [cases[0]["step"] * x / places[0] for x in places], color=GRAY, linewidth=0.7, label="proportional"
    )
    ax.set_xlabel(label)
    ax.set_xticks([case[name] for case in cases[::2]], [grouped(case[name]) for case in cases[::2]])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())


if __name__ == "__main__":
    main()
