"""Drawings for meshes that approximate surfaces: the mesh colored by its distance, and the bounds."""

from typing import Any

import numpy as np
from common import BLUE, GRAY, VERMILLION, shape, solution
from matplotlib.figure import Figure

import jhd

_WAYS = {"to_surface": ("mesh to surface", BLUE, "o", "--"), "to_mesh": ("surface to mesh", VERMILLION, "s", ":")}


def colored_shape(figure: Figure, a: Any, b: Any, found: Any, title: str, left: float = 0.0, top: float = 1.0) -> Any:
    """Draw a stored shape colored by its distance to another one, seen from its farthest point; a third wide."""
    ax: Any = figure.add_axes((left, top - 0.98, 0.36, 0.86), projection="3d")
    found = solution(found)
    jhd.plot.distances(shape(a), shape(b), found, ax, color_bar=False)
    ax.set_axis_off()
    low, high = (np.array([getattr(ax, f"get_{x}lim")()[end] for x in "xyz"]) for end in (0, 1))
    ax.set_box_aspect(high - low, zoom=1.05)
    figure.text(left + 0.012, top - 0.035, title, va="top")
    bar = figure.add_axes((left + 0.375, top - 0.8, 0.014, 0.56))
    ends = (0.0, 1.0, 0.0, float(found.value))
    bar.imshow(np.linspace(0, 1, 256)[:, None], cmap="viridis", origin="lower", extent=ends, aspect="auto")
    bar.set_xticks([])
    bar.locator_params(axis="y", nbins=4)
    bar.yaxis.tick_right()
    bar.yaxis.set_label_position("right")
    bar.set_ylabel("distance to the surface")
    return ax


def both_ways(ax: Any, x: np.ndarray, meshes: list[dict[str, Any]]) -> None:
    """Plot the certified bounds and sampled distances of both directions over one number of each mesh; logarithmic."""
    for way, (name, color, mark, dashes) in _WAYS.items():
        ends = np.array([[mesh[way][end] for end in ("lower", "upper")] for mesh in meshes])
        middle = ends.mean(axis=1)
        bars: Any = np.stack([middle - ends[:, 0], ends[:, 1] - middle])
        # A small square inside a ring, as both directions are often equal.
        style: dict[str, Any] = {"markersize": 7, "markerfacecolor": "none"} if mark == "o" else {"markersize": 3}
        ax.errorbar(x, middle, bars, color=color, marker=mark, linestyle="none", label=f"{name}, certified", **style)
        samples = [mesh[way]["samples"]["value"] for mesh in meshes]
        ax.plot(x, samples, color=GRAY, linestyle=dashes, label=f"{name}, samples")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylabel("distance (units of the surface)")
