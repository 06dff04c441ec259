"""Fraction of the points of a scan that are farther from the model than a distance, before and after a fit.

Numbers by scan_to_model's experiment.

Caption: Fraction of 94 249 scanned points that are farther from the model than a distance, before and after its heights
are fitted to the root mean square. The root mean square falls to the noise level, to within 5 %. The largest distance
is certified to 1e-9 before and after.

Alt text: Two falling curves of the percentage of points against the distance: dashed before the fit, solid and much
steeper after it. Marks on the axis show the largest distances, a dotted line the noise.
"""

from typing import Any

import numpy as np
from common import BLUE, GRAY, MM, VERMILLION, Picture, style
from matplotlib.figure import Figure

_LINES = {"before": (VERMILLION, "--", "s"), "after": (BLUE, "-", "o")}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(85 * MM, 66 * MM), layout="constrained")
        ax = figure.add_subplot()
        share = 100 * (1 - np.array(numbers["quantiles"]))
        for name, (color, dashes, mark) in _LINES.items():
            found = numbers["ends"][name]
            distance, largest = 1e3 * np.array(found["distances"]), 1e3 * found["upper"]
            ax.plot(distance, share, color=color, linestyle=dashes, label=f"{name} the fit")
            label = f"{name}, largest: {largest:.3f}"
            ax.plot([largest], [0], color=color, linestyle="none", marker=mark, clip_on=False, zorder=5, label=label)
        ax.axvline(
            1e3 * numbers["noise"], color=GRAY, linewidth=0.8, linestyle=":", label="noise, 1 standard deviation"
        )
        ax.set_xlim(left=0)
        ax.set_ylim(0, 100)
        ax.set_xlabel("distance to the model (thousandths of the side)")
        ax.set_ylabel("points that are farther (%)")
        ax.legend(loc="upper right", handlelength=1.8)
    return figure


if __name__ == "__main__":
    main()
