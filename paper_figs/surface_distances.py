"""Six pairs of shapes of different kinds: the one that holds the farthest place in the colors of its distance.

Numbers by surface_distances's experiment.

Caption: Six pairs of shapes of different kinds: patches, a curve, points, tori, an implicit surface and a mesh; the
shape with the farthest point is colored by its distance. Every pair closes to its tolerance in less than two seconds.
Samples in the same time have errors of a hundred times the gap and more.
"""

from typing import Any

import numpy as np
from common import MM, Picture, outward, power_text, shape, solution, style
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import jhd
from jhd._plot.colored import pieces_of

_COLUMNS = 3
# From where pairs are seen, elevation and azimuth in degrees; the others from the side of the farthest place.
_VIEWS = {"sheet, moved sheet": (35, -60), "curve, sheet": (20, -55), "points, sheet": (35, -60)}


def main() -> None:
    """Loads and draws."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers["pairs"]))


def _figure(pairs: list[dict[str, Any]]) -> Figure:
    rows = -(-len(pairs) // _COLUMNS)
    with style():
        figure = Figure(figsize=(175 * MM, rows * 66 * MM))
        for k, pair in enumerate(pairs):
            row, column = divmod(k, _COLUMNS)
            left, top, height = column / _COLUMNS, 1 - row / rows, 1 / rows
            place = (left + 0.004, top - 0.88 * height, 0.24, 0.8 * height)
            ax: Any = figure.add_axes(place, projection="3d")
            bar = figure.add_axes((left + 0.245, top - 0.72 * height, 0.01, 0.52 * height))
            _draw(ax, bar, pair)
            figure.text(left + 0.012, top - 0.02, f"$\\bf{{({'abcdef'[k]})}}$ {pair['name']}", va="top")
            figure.text(left + 0.012, top - height + 0.015, _text(pair), va="bottom", linespacing=1.3)
    return figure


def _draw(ax: Any, bar: Any, pair: dict[str, Any]) -> None:
    """The colored shape and its color bar; of curves and points also the surface that distances are taken to."""
    a, b = shape(pair["a"]), shape(pair["b"])
    found = solution(pair["solution"])
    jhd.plot.distances(a, b, found, ax, color_bar=False)
    if isinstance(a, jhd.BezierSegments):
        faces = Poly3DCollection(pieces_of(b).corners, facecolors="#808080", alpha=0.3, linewidth=0, rasterized=True)
        ax.add_collection3d(faces)
    for line in ax.lines:
        if line.get_gid() == "witness":
            line.set_markersize(4)
    if not isinstance(a, jhd.BezierSegments):
        low, high = (np.array([getattr(ax, f"get_{x}lim")()[end] for x in "xyz"]) for end in (0, 1))
        ax.set_box_aspect(high - low, zoom=1.15)
    ax.set_axis_off()
    if pair["name"] in _VIEWS:
        ax.view_init(*_VIEWS[pair["name"]])
    top = float(found.value)
    bar.imshow(np.linspace(0, 1, 256)[:, None], cmap="viridis", origin="lower", extent=(0, 1, 0, top), aspect="auto")
    bar.set_xticks([])
    bar.yaxis.tick_right()
    bar.locator_params(axis="y", nbins=4)
    bar.set_title("distance", loc="right", pad=4)


def _text(pair: dict[str, Any]) -> str:
    """The bounds and what they cost, and what samples say in the same time."""
    lower, upper = pair["solution"]["lower"], pair["solution"]["upper"]
    which = "h" if pair["directed"] else "H"
    tree = pair["samples"]
    ours = f"{outward(lower, upper, 6)[0]} ≤ ${which}$, gap {power_text(upper - lower)}, {pair['seconds']:.1f} s"
    return f"{ours}\nsamples: off by {power_text(tree['off'])}, {tree['seconds']:.1f} s"


if __name__ == "__main__":
    main()
