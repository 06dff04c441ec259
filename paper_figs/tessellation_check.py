"""A triangulation in the colors of its distance to the surface, and the distance against the number of triangles.

Numbers by tessellation_check's experiment.

Caption: A triangulation of 100 NURBS patches colored by its distance to the surface, and the distance against the
number of triangles. The distance from the mesh is 73 to 97 % of the error that the mesher states. Samples overestimate
the distance from the finest mesh by a factor of more than 39, and the distance to it by more than 100.

Alt text: Left, a wavy sheet of triangles, mostly dark blue with yellow spots near the left corner. Right, a log-log
plot in which certified distances follow the stated error down, while samples level off above it.
"""

from typing import Any

import numpy as np
from common import BLACK, MM, Picture, grouped, letter, style
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
        title = f"$\\bf{{(a)}}$ {numbers['patches']} patches, {chosen['count']} triangles"
        ax = colored_shape(figure, numbers["mesh"], numbers["surface"], chosen["to_surface"]["solution"], title)
        ax.view_init(35, -60)
        _distances(figure.add_axes((0.6, 0.16, 0.365, 0.74)), numbers["meshes"])
    return figure


def _distances(ax: Any, meshes: list[dict[str, Any]]) -> None:
    count = np.array([mesh["count"] for mesh in meshes])
    both_ways(ax, count, meshes)
    promised = [mesh["promised"] for mesh in meshes]
    ax.plot(count, promised, color=BLACK, marker="_", linestyle="-", linewidth=0.6, label="stated by the mesher")
    ax.set_xticks(count, [grouped(x) for x in count])
    ax.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    ax.set_xlabel("triangles")
    # Room for the key.
    ax.set_ylim(bottom=meshes[-1]["to_mesh"]["lower"] / 20)
    ax.legend(loc="lower left", handlelength=1.8, labelspacing=0.25)
    letter(ax, "b", "bounds to 2 and 5 % of the distance")


if __name__ == "__main__":
    main()
