"""Errors of the local search: the fraction of points above each error, and their location about a long profile.

Grids have one vertex a voxel, as published, or 256 voxels a side if that would need more.

Numbers by local_search_error's experiment.

Caption: Errors of the published search around the nearest vertices: the fraction of points above each error, and their
location about a long profile. With one vertex a voxel, 15 to 30 % of the distances are too large on smooth meshes, and
11 to 32 % on parts, by up to 14 % of the diagonal.

Alt text: Left, log-log curves of the percentage of points above each error for five meshes, from about 20 down to 0.01.
Right, an L-shaped section with dark patches of large errors outside both legs and at the diagonal.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

_LINES = ((BLUE, "-"), (GREEN, "--"), (ORANGE, "-."), (PURPLE, (0, (5, 1, 1, 1, 1, 1))), (VERMILLION, ":"))
# Errors in the section that have a color, in percent of the diagonal.
_LOW, _HIGH = 0.01, 10
_PLAIN = FuncFormatter(lambda x, _: f"{x:g}")


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 74 * MM), layout="constrained")
        shares, section = figure.subplots(1, 2, width_ratios=(1.05, 1))
        _draw_shares(shares, numbers)
        _draw_section(figure, section, numbers["section"])
        figure.legend(*shares.get_legend_handles_labels(), loc="outside lower left", ncols=5, columnspacing=2.0)
    return figure


def _draw_shares(ax: Axes, numbers: dict[str, Any]) -> None:
    for k, mesh in enumerate(numbers["meshes"]):
        way = next((way for way in mesh["ways"] if way["published"]), mesh["ways"][-1])
        color, line = _LINES[k % len(_LINES)]
        # If no point is above, the line leaves the picture at the bottom.
        above = 100 * np.maximum(way["above"], 1e-9)
        levels = 100 * np.array(numbers["levels"])
        ax.loglog(levels, above, color=color, linestyle=line, linewidth=1.2, label=mesh["name"])
    ax.set_xlim(1e-3, 30)
    ax.set_ylim(0.01, 100)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(_PLAIN)
    ax.set_xlabel("error (% of the diagonal of the box)")
    ax.set_ylabel("points with a larger error, %")
    letter(ax, "a", "how large errors are, one vertex a voxel")


def _draw_section(figure: Figure, ax: Axes, section: dict[str, Any]) -> None:
    x, y, error = (np.array(section[key]) for key in ("x", "y", "error"))
    shown = np.ma.masked_less(100 * error.T, _LOW)
    image = ax.pcolormesh(x, y, shown, cmap="cividis_r", norm=LogNorm(_LOW, _HIGH), shading="nearest", rasterized=True)
    outline = np.array(section["outline"])
    ax.plot(*np.concatenate([outline, outline[:1]]).T, color=BLACK, linewidth=0.9)
    ax.set_aspect("equal")
    ax.set_xlabel("$x$")
    ax.set_ylabel("$y$")
    bar = figure.colorbar(image, ax=ax, shrink=0.92)
    bar.ax.yaxis.set_major_formatter(_PLAIN)
    bar.set_label("error (% of the diagonal)")
    letter(ax, "b", f"section of the L-profile; white: below {_LOW} %")


if __name__ == "__main__":
    main()
