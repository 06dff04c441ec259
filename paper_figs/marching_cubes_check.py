"""A mesh of marching cubes in the colors of its distance to the surface, and the distance against the cells' width.

Numbers by marching_cubes_check's experiment.

Caption: A mesh of scikit-image's marching cubes colored by its distance to the implicit surface, and the distance
against the width of the cells. The distance falls with about the square of the width (power 1.9). The usual
first-order estimate at the centers of triangles is 14 to 20 % too large on the coarsest mesh and 5 to 9 % too small on
the finest.

Alt text: Left, a rounded cube mesh in dark blue to yellow with the farthest point marked. Right, a log-log plot in
which certified distances of both directions fall with the cell width, and samples level off.
"""

from typing import Any

import numpy as np
from common import BLACK, MM, ORANGE, Picture, letter, style
from common_checks import both_ways, colored_shape
from matplotlib.figure import Figure


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    chosen = numbers["meshes"][numbers["shown"]]
    with style():
        figure = Figure(figsize=(175 * MM, 76 * MM))
        title = f"$\\bf{{(a)}}$ {chosen['cells']} cells along an axis, {chosen['count']} triangles"
        colored_shape(figure, numbers["mesh"], numbers["target"], chosen["to_surface"]["solution"], title)
        _distances(figure.add_axes((0.58, 0.16, 0.4, 0.74)), numbers["meshes"])
    return figure


def _distances(ax: Any, meshes: list[dict[str, Any]]) -> None:
    width = np.array([mesh["width"] for mesh in meshes])
    both_ways(ax, width, meshes)
    middles = [mesh["middles"] for mesh in meshes]
    ax.plot(width, middles, color=ORANGE, marker="^", markersize=4, linestyle="none", label="first order, at centers")
    guide = 0.6 * meshes[0]["upper"] * (width / width[0]) ** 2
    ax.plot(width, guide, color=BLACK, linewidth=0.6, label="square of the width")
    ticks = width[:: 2 if len(width) > 3 else 1]
    ax.set_xticks(ticks, [f"{x:.3g}" for x in ticks])
    ax.minorticks_off()
    # Room for the key.
    ax.set_ylim(0.6 * guide.min(), 25 * meshes[0]["upper"])
    ax.set_xlabel("width of a cell (units of the surface)")
    ax.legend(loc="upper left", handlelength=1.8, labelspacing=0.25)
    letter(ax, "b", "bounds to 5 % of the distance")


if __name__ == "__main__":
    main()
