"""A scan with outliers, the outline registered by each statistic, and the errors against the fraction of outliers.

Numbers by scan_with_outliers' experiment.

Caption: A scan of 400 points with a tenth of outliers, the known outline registered to it by each statistic, and the
largest error against the fraction of outliers. From 5 % of outliers on, the maximum and the root mean square are off by
19 to 64 times the noise. Up to 20 %, the mean stays within 1.5 times the noise and the quantile within the noise.

Alt text: Left, a rounded triangular outline with scanned points, a cloud of outliers at the lower right, and two
outlines pulled towards it. Right, errors of four statistics against the fraction of outliers.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

import jhd

_MEASURES = {
    "maximum": (VERMILLION, "v", (0, (2, 1))),
    "root mean square": (ORANGE, "^", (0, (4, 1.2))),
    "mean": (GREEN, "s", (0, (4, 1.2, 1, 1.2))),
    "quantile": (BLUE, "o", "-"),
}
_MARKS: dict[str, Any] = {"markersize": 4.0, "markeredgecolor": BLACK, "markeredgewidth": 0.5}
# The scan with the nearest fraction of outliers is shown.
_SHOWN = 0.1
_SAMPLES = 481
_TICKS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    labels = {name: name for name in _MEASURES} | {"quantile": f"quantile {numbers['quantile']:g}"}
    shown = min(numbers["cases"], key=lambda case: abs(case["share"] - _SHOWN))
    with style():
        figure = Figure(figsize=(175 * MM, 84 * MM), layout="constrained")
        places, errors = figure.subplots(1, 2, width_ratios=(1.05, 1))
        _draw_places(places, shown)
        letter(places, "a", f"{len(shown['scan'])} points, {shown['share']:.0%} of them outliers")
        _draw_errors(errors, numbers)
        letter(errors, "b", "certified errors of the registration")
        handles = [Line2D([], [], color=GRAY, marker=".", markersize=3, linestyle="none", label="scan")]
        for name, (color, marker, line) in _MEASURES.items():
            look: dict[str, Any] = {"color": color, "marker": marker, "linestyle": line, "linewidth": 1.4}
            handles.append(Line2D([], [], **look, label=labels[name], **_MARKS))
        figure.legend(handles=handles, loc="outside lower center", ncols=5, columnspacing=1.6, handlelength=3.2)
    return figure


def _draw_places(ax: Axes, case: dict[str, Any]) -> None:
    ax.plot(
        *np.array(case["scan"]).T, color=GRAY, marker=".", markersize=2.8, markeredgewidth=0, linestyle="none", zorder=3
    )
    for name, (color, _, line) in _MEASURES.items():
        curve = jhd.BSplineCurve.uniform(np.array(case["fits"][name]["control_points"]), periodic=True).segments()
        points = np.asarray(curve(np.linspace(0.0, curve.count, _SAMPLES)))
        # If two curves agree, both are seen: the lower one is broader.
        ax.plot(*points.T, color=color, linestyle=line, linewidth=3.2 if name == "mean" else 1.2)
    ax.set_aspect("equal")
    ax.axis("off")


def _draw_errors(ax: Axes, numbers: dict[str, Any]) -> None:
    shares = [100 * case["share"] for case in numbers["cases"]]
    for name, (color, marker, line) in _MEASURES.items():
        errors = [case["fits"][name]["upper"] for case in numbers["cases"]]
        ax.semilogy(shares, errors, color=color, marker=marker, linestyle=line, linewidth=1.4, **_MARKS)
    ax.axhline(numbers["noise"], color=GRAY, linewidth=0.8, linestyle=":")
    note: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "va": "bottom", "color": GRAY}
    ax.annotate("noise", (1.0, numbers["noise"]), (0, 1.5), xycoords=ax.get_yaxis_transform(), **note)
    ax.set_xlabel("fraction of outliers (%)")
    ax.set_ylabel("largest error (input units)")
    ax.set_yticks(_TICKS)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())


if __name__ == "__main__":
    main()
