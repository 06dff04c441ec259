"""Six pairs of shapes of different kinds: the shape with the farthest point, colored by its distance.

Numbers by surface_distances's experiment.

Caption: Six pairs of shapes of different kinds: patches, a curve, points, tori, an implicit surface and a mesh; the
shape with the farthest point is colored by its distance. Every pair closes to its tolerance in less than two seconds.
Samples that take as long are off by more than 1e4 times the tolerance in (a) to (c), by more than a hundred times in
(d) and by more than ten times the gap in (e). In (f), whose gap is wide, their estimate lies within the bounds.

Alt text: Six renderings colored from dark blue to yellow by distance: a wavy sheet, points on it, a curve above it, two
tori and a bumpy ball, each with its farthest point, a color bar and two lines of numbers.
"""

from typing import Any

import numpy as np
from common import MM, Picture, outward, power_text, shape, solution, style
from matplotlib import colormaps
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import jhd
from jhd._plot.colored import distances_at, pieces_of

_COLUMNS = 3
# Fraction of a color that faces turned from the light lose: otherwise a constant distance would show no shape.
_SHADE, _SLIVER = 0.4, 1e-3
# Elevation and azimuth of some views in degrees; other pairs are seen from the side of the farthest point.
_VIEWS = {"sheet, moved sheet": (35, -60), "curve, sheet": (20, -55), "points, sheet": (35, -60)}


def main() -> None:
    """Draw and save the figure."""
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
    """Draw the colored shape and its color bar; for curves and points also the surface that distances are taken to."""
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
    pair_shown = (b, a) if found.direction == jhd.DIRECTIONS.b_to_a else (a, b)
    for faces in ax.collections:
        if faces.get_gid() == "deviation" and isinstance(faces, Poly3DCollection):
            faces.set(**dict.fromkeys(("facecolor", "edgecolor"), _lit(ax, *pair_shown, top)))
    bar.imshow(np.linspace(0, 1, 256)[:, None], cmap="viridis", origin="lower", extent=(0, 1, 0, top), aspect="auto")
    bar.set_xticks([])
    bar.yaxis.tick_right()
    bar.locator_params(axis="y", nbins=4)
    bar.set_title("distance", loc="right", pad=4)


def _lit(ax: Any, a: Any, b: Any, top: float) -> np.ndarray:
    """Return colors of the faces of a shape by their distances, darker if turned away from the light."""
    pieces = pieces_of(a)
    colors = colormaps["viridis"](np.mean(distances_at(pieces.points, b, top)[pieces.rows], axis=1) / top)
    first, second = (pieces.corners[:, k] - pieces.corners[:, 0] for k in (1, 2))
    normal = np.cross(first, second)
    length = np.linalg.norm(normal, axis=1)
    azimuth, height = np.radians([ax.azim, ax.elev])
    # From the left above the eye.
    azimuth, height = azimuth - 0.5, min(height + 0.6, 1.4)
    light = np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)])
    # Slivers at the borders of patches have no direction.
    clear = length > _SLIVER * np.max(length)
    dark = np.where(clear, 1 - np.abs(normal @ light) / np.where(clear, length, 1.0), 0.0)
    colors[:, :3] *= 1 - _SHADE * dark[:, None]
    return colors


def _text(pair: dict[str, Any]) -> str:
    """Return text with the bounds and their time, and the error and time of samples."""
    lower, upper = pair["solution"]["lower"], pair["solution"]["upper"]
    which = "h" if pair["directed"] else "H"
    tree = pair["samples"]
    ours = f"{outward(lower, upper, 6)[0]} ≤ ${which}$, gap {power_text(upper - lower)}, {_time(pair['seconds'])}"
    off = f"off by {power_text(tree['off'])}" if tree["off"] > 0 else "within the bounds"
    return f"{ours}\nsamples: {off}, {_time(tree['seconds'])}"


def _time(seconds: float) -> str:
    """Return a time with one significant digit if it is below a second, else with one decimal."""
    return f"{seconds:.1f} s" if seconds >= 1 else f"{seconds:.1g} s"


if __name__ == "__main__":
    main()
