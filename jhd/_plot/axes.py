"""Axes of pictures, created on demand, with colors and sizes suitable for print."""

from typing import Any

import numpy as np

from jhd._shapes.foreign import Axes

BLUE, ORANGE, VERMILLION, GRAY = "#0072B2", "#E69F00", "#D55E00", "#707070"
PALE_BLUE = "#C9E3F2"

COLUMN_INCHES = 85 / 25.4
TEXT_POINTS = 8  # size of text that stays legible when a column is printed


def axes_for(ax: Axes | None, dim: int) -> Axes:
    """The given axes, checked, or the axes of a new figure one column wide."""
    if ax is None:
        import matplotlib.pyplot as plt

        size = COLUMN_INCHES, COLUMN_INCHES
        if dim == 3:
            # No layout engine sees the labels of space axes: the label of z needs room at the right.
            return plt.figure(figsize=size).add_axes((0.0, 0.13, 0.86, 0.75), projection="3d")
        return plt.figure(figsize=size, layout="constrained").add_subplot()
    if dim == 3 and ax.name != "3d":
        raise ValueError("ax has two dimensions; a shape in space needs axes made with projection='3d'.")
    return ax


def finish(ax: Any) -> None:
    """Equal scales, and text of one size."""
    ax.set_aspect("equal")
    ax.tick_params(labelsize=TEXT_POINTS)
    if ax.name == "3d":
        ax.locator_params(nbins=4)  # the shorter axes appear at a slant, so that more labels would overlap
    for name in "xyz" if ax.name == "3d" else "xy":
        getattr(ax, f"set_{name}label")(f"${name}$", fontsize=TEXT_POINTS)


def draw(ax: Any, points: Any, gid: str, **style: Any) -> None:
    """Points in rows as one line, found by its gid."""
    ax.plot(*np.moveaxis(np.asarray(points), -1, 0), gid=gid, solid_capstyle="round", **style)


def mark(ax: Any, points: Any, gid: str, square: bool = False, **style: Any) -> None:
    """Points in rows as dots or white squares with a black edge, found by their gid."""
    dot: dict[str, Any] = {"marker": "o", "markersize": 5.5, "color": VERMILLION, "zorder": 6}
    shape = {"marker": "s", "markersize": 4.5, "markerfacecolor": "white", "zorder": 5} if square else dot
    draw(ax, points, gid, linestyle="none", markeredgecolor="black", markeredgewidth=0.8, **(shape | style))


def legend_above(ax: Any, columns: int, **style: Any) -> None:
    """A legend above the axes, in text of one size."""
    place: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "borderaxespad": 0.2}
    ax.legend(ncols=columns, fontsize=TEXT_POINTS, frameon=False, columnspacing=1.2, **place, **style)
